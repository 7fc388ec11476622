r"""A robot as its gaits are planned for it: skeleton, parameters of its gaits, and its feet in walking direction.

Feet that are balls roll while they stand: their middle moves over the floor as the leg turns. A ball of radius r that
turns at :math:`\omega` without slipping moves by :math:`\dot c = \omega \times r e_z`.
"""

from collections.abc import Collection
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from simrob_drake.base.errors import InvalidParameter
from simrob_drake.base.frames import Vector
from simrob_drake.base.interpolation import stacked
from simrob_drake.base.messages import message
from simrob_drake.blocks.references import smooth
from simrob_drake.kinematics.chain import Chain
from simrob_drake.kinematics.skeleton import Skeleton, skeleton_of
from simrob_drake.programs.gaits.zmp import LEVEL
from simrob_drake.robots.catalog import RobotModel
from simrob_drake.robots.gaits_file import GaitsFile, gaits_file

UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class Foot:
    """A foot, in the frame in which the robot walks along x and has y at its left."""

    name: str  # such as left_foot
    link: str  # the frame of its link
    axes: tuple[int, ...]  # of the leg, the hip first
    # these axes from the root to the point, in a frame that is the world's when the foot stands and looks ahead
    leg: Chain
    point: Vector  # middle of the contact, in the link [m]: of the spheres' middles, or of a sole's top and bottom
    over: float  # height of the point over the floor when the foot stands [m]
    upright: Vector  # rotation of the link when the foot stands flat and looks ahead, shape (3, 3)
    home: Vector  # the point when all axes are zero, seen from the root [m]
    half: Vector  # half of the contact's length and width, from the middle [m]; zeros for a ball

    def poses(self, angles: Vector, root: Vector) -> Vector:
        """Return the poses of the point, turned from flat and ahead, for angles (m, n) of all axes: (m, 4, 4)."""
        return self.leg.tool_poses(self.leg.frames(angles[:, list(self.axes)], root))

    @property
    def side(self) -> float:
        """1 for a left foot, -1 for a right one."""
        return float(np.sign(self.home[1]))


def rotations_about(direction: Vector, angles: Vector) -> Vector:
    """Return rotations about one unit vector (3,) by many angles (m,) [rad], shape (m, 3, 3)."""
    return np.asarray(Rotation.from_rotvec(np.outer(angles, direction)).as_matrix())


def upright(gravity: Vector) -> Vector:
    """Return the rotation, (3, 3), that brings the z axis to the opposite of gravity (3,), about a horizontal axis."""
    about = np.cross(UP, -gravity)
    sine = float(np.linalg.norm(about))
    if sine == 0:
        return np.eye(3)
    return np.asarray(rotations_about(about / sine, np.array([np.arctan2(sine, -gravity[2])]))[0])


def facing_rotation(facing_deg: float) -> Vector:
    """Return the rotation (3, 3) of a root that looks along x, if unturned it looks so far from there [deg]."""
    return np.asarray(rotations_about(UP, np.array([-np.deg2rad(facing_deg)]))[0])


def feet_of(skeleton: Skeleton, facing_deg: float, kind: str | None = None) -> list[Foot]:
    """Return the feet of a kind, of the default one unless given, of a robot that looks as in :func:`facing_rotation`.

    Raises InvalidParameter: a robot without feet; UnknownName: no such kind.
    """
    model = skeleton.model
    if model.feet is None:
        raise InvalidParameter(
            message("base.robot_called", "robot {name}", name=model.name),
            message("programs.robot_without_feet", "one without feet"),
            message("programs.legged_robot", "a legged one, to walk"),
        )
    contact = model.feet.kind(kind)
    turn = facing_rotation(facing_deg)
    names = {frame: tool for tool, frame in model.tools.items()}
    feet = []
    for link in contact.links:
        body, home = skeleton.links[link]
        home = stacked(np.zeros((1, 3)), turn[np.newaxis])[0] @ home
        upright = home[:3, :3]
        if link in contact.boxes:
            point, over = np.array(contact.boxes[link].centre), contact.boxes[link].size[2] / 2
        else:
            around = np.array(contact.points[link]) @ upright.T
            middle = (around.min(axis=0) + around.max(axis=0)) / 2
            point, over = upright.T @ middle, contact.surface(link).radius
        spread = (contact.support_points(link) - point) @ upright.T
        axes, leg = skeleton.limb(link, stacked(point[np.newaxis], upright.T[np.newaxis])[0])
        sole = next((names[f] for f in names if skeleton.links[f][0] == body and names[f].endswith("foot")), link)
        feet.append(
            Foot(
                name=sole,
                link=link,
                axes=axes,
                leg=leg,
                point=point,
                over=over,
                upright=upright,
                home=home[:3, 3] + upright @ point,
                half=np.ptp(spread[:, :2], axis=0) / 2,
            )
        )
    return feet


def rolled(rotation: Vector, standing: npt.NDArray[np.bool_], radius: float) -> Vector:
    """Return how far the middle of a ball of a radius r [m] has rolled since it landed: ahead, left (m, 2) [m].

    Its rotations are (m, 3, 3), ``standing`` (m,) tells when it stands; in the air it goes back to zero, where the next
    landing is planned.
    """
    turned = rotation[1:] @ rotation[:-1].transpose(0, 2, 1)
    about = np.stack([turned[:, 2, 1] - turned[:, 1, 2], turned[:, 0, 2] - turned[:, 2, 0]], axis=1) / 2  # x, y
    move = radius * np.column_stack([about[:, 1], -about[:, 0]])
    both = standing[1:] & standing[:-1]
    way = np.vstack([np.zeros((1, 2)), np.cumsum(move * both[:, np.newaxis], axis=0)])
    changes = np.flatnonzero(np.diff(standing.astype(int))) + 1
    edges = [0, *changes, len(standing)]
    result, last = np.zeros((len(standing), 2)), np.zeros(2)
    for start, end in pairwise(edges):
        if standing[start]:
            result[start:end] = way[start:end] - way[start]
            last = result[end - 1]
        else:
            share = np.arange(1, end - start + 1) / (end - start + 1)
            result[start:end] = np.outer(1.0 - smooth(share), last)
    return result


_SIDES = {"left": "right", "right": "left"}


@dataclass(frozen=True, eq=False)
class Walker:
    """What planners know of a robot."""

    skeleton: Skeleton  # the robot, with what it carries
    gaits: GaitsFile
    gravity: Vector = field(default_factory=LEVEL.copy)
    """In the frame of the ground, the robot looking along x, shape (3,) [m/s²]."""
    differs: bool = False  # whether it carries something or stands on a slope, which its gaits are not made for

    @classmethod
    def of(cls, robot: "str | RobotModel | Walker") -> "Walker":
        """Return what planners know of a robot with a ``gaits.yaml``: of its name, its model, or what is known already.

        Raises UnknownName: no such robot; InvalidParameter: one without gaits, or with joints that do not turn;
        InvalidConfig: a file with a wrong entry.
        """
        if isinstance(robot, Walker):
            return robot
        gaits = gaits_file(robot)
        return cls(skeleton_of(robot), gaits)

    @property
    def model(self) -> RobotModel:
        """The robot's model."""
        return self.skeleton.model

    def feet(self, kind: str | None = None) -> list[Foot]:
        """Return the feet of a kind, of the default one unless given; see :func:`feet_of`."""
        return feet_of(self.skeleton, self.gaits.facing_deg, kind)

    def feet_called(self, names: Collection[str], kind: str | None, needed: str) -> dict[str, Foot]:
        """Return the feet of a kind by their names; raises InvalidParameter: they are others; names what is needed."""
        feet = {foot.name: foot for foot in self.feet(kind)}
        if sorted(feet) != sorted(names):
            raise InvalidParameter(
                message("base.robot_called", "robot {name}", name=self.model.name),
                message("programs.count_of_feet", "one with {count} feet", count=len(feet)),
                message("programs.robot_with", "one with {needed}", needed=needed),
            )
        return feet


def mirrored(model: RobotModel, values: Vector) -> Vector:
    """Return per-axis values (n,) with left and right exchanged; turns to a side change their sense."""
    names = list(model.axes)
    result = np.empty_like(values)
    for place, name in enumerate(names):
        side, _, rest = name.partition("_")
        other = names.index(f"{_SIDES[side]}_{rest}") if side in _SIDES else place
        result[place] = -values[other] if name.endswith("yaw") else values[other]
    return result
