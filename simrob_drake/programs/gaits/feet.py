"""The feet of a robot seen in walking direction: where each touches the floor, and which axes move it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from simrob_drake.errors import InvalidParameter
from simrob_drake.frames import Vector
from simrob_drake.interpolation import stacked
from simrob_drake.kinematics.chain import Chain
from simrob_drake.kinematics.skeleton import Skeleton

UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class Foot:
    """A foot, in the frame in which the robot walks along x and has y at its left.

    Attributes:
        name: such as left_foot.
        link: the frame of its link.
        axes: of the leg, the hip first.
        leg: these axes from the root to the point, in a frame that is the world's when the foot stands and looks ahead.
        point: middle of the contact, in the link [m]: of the spheres' middles, or of a sole's top and bottom.
        over: height of the point over the floor when the foot stands [m].
        upright: rotation of the link when the foot stands flat and looks ahead, shape (3, 3).
        home: the point when all axes are zero, seen from the root [m].
        half: half of the contact's length and width, from the middle [m]; zeros for a ball.
    """

    name: str
    link: str
    axes: tuple[int, ...]
    leg: Chain
    point: Vector
    over: float
    upright: Vector
    home: Vector
    half: Vector

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


def facing_rotation(facing_deg: float) -> Vector:
    """Return the rotation of a root that looks along the world's x, shape (3, 3).

    Args:
        facing_deg: where the robot looks if its root is not turned, counterclockwise from x [deg].
    """
    return np.asarray(rotations_about(UP, np.array([-np.deg2rad(facing_deg)]))[0])


def feet_of(skeleton: Skeleton, facing_deg: float, kind: str | None = None) -> list[Foot]:
    """Return the feet of a robot.

    Args:
        skeleton: of the robot.
        facing_deg: as in :func:`facing_rotation`.
        kind: of its feet; the default one unless given.

    Raises:
        InvalidParameter: a robot without feet.
        UnknownName: no such kind.
    """
    model = skeleton.model
    if model.feet is None:
        raise InvalidParameter(f"robot {model.name}", "one without feet", "a legged one, to walk")
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
            point, over = upright.T @ middle, contact.radius
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
