r"""A robot as planners of gaits see it: skeleton, parameters of its gaits, and its feet in the walking direction.

In plans every robot walks along x, with y to its left, in the frame of the ground. A robot whose own link frames
look elsewhere is turned by :func:`facing_rotation`. Each :class:`Foot` has a point in the middle of its contact, whose
pose is the identity rotation while the foot stands flat and looks ahead.

A foot is either a sole or a ball. Balls roll while they stand, so that their middle moves over the floor as the leg
turns. A ball of radius r that turns at :math:`\omega` without slipping moves by :math:`\dot c = \omega \times r e_z`.

The root link of a robot is the one on which its legs hang, mostly its trunk. A skeleton has the links, joints and
masses of a robot.
"""

from collections.abc import Collection
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from simrob_drake.base.errors import InvalidParameter
from simrob_drake.base.frames import Vector
from simrob_drake.base.interpolation import stack_poses
from simrob_drake.base.messages import message
from simrob_drake.blocks.references import smooth
from simrob_drake.kinematics.chain import Chain
from simrob_drake.kinematics.skeleton import Skeleton, skeleton_of
from simrob_drake.programs.gaits.zmp import LEVEL
from simrob_drake.robots.catalog import RobotModel
from simrob_drake.robots.gaits_file import GaitsFile, gaits_file

UP = np.array([0.0, 0.0, 1.0])
"""Normal of the ground, in its own frame."""


@dataclass(frozen=True)
class Foot:
    """A foot and the leg that carries it, in a frame in which the robot walks along x and has y to its left.

    Attributes:
        name: name of the foot, such as ``left_foot``.
        link: name of the link's frame.
        axes: indices of the axes of the leg, from the hip down.
        leg: kinematic chain of these axes from the root to `point`. Its last frame is that of the world when
            the foot stands flat and looks ahead.
        point: middle of the contact, in the link, shape (3,) [m]. That of a sole is half-way between its bottom and
            its top, that of spheres is between their middles.
        over: height of the point over the floor when the foot stands [m]. It is the radius of a ball.
        upright: rotation of the link when the foot stands flat and looks ahead, shape (3, 3).
        home: position of the point seen from the root when all axes are zero, shape (3,) [m].
        half: half the length and half the width of the contact, shape (2,) [m]. Both are 0 for a ball.
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
        """Compute the poses of the foot's point, shape (m, 4, 4).

        Args:
            angles: angles of all n axes of the robot, shape (m, n) [rad].
            root: poses of the root link in any frame, shape (m, 4, 4). The result is in the same frame.
        """
        leg_angles = angles[:, list(self.axes)]
        return self.leg.tool_poses(self.leg.frames(leg_angles, root))

    @property
    def is_ball(self) -> bool:
        """Whether the foot is a ball, which rolls, and not a sole."""
        return not self.half.any()

    @property
    def side(self) -> float:
        """1 for a foot to the left of the root while all axes are zero, -1 to the right of it, 0 in the middle."""
        return float(np.sign(self.home[1]))


def rotations_about(direction: Vector, angles: Vector) -> Vector:
    """Rotations about one unit vector (3,) by m angles (m,) [rad], shape (m, 3, 3)."""
    return np.asarray(Rotation.from_rotvec(np.outer(angles, direction)).as_matrix())


def upright_rotation(gravity: Vector) -> Vector:
    """Rotation (3, 3) about a horizontal axis that turns the z axis against gravity (3,).

    It is the identity if gravity is along -z, on level ground.
    """
    axis = np.cross(UP, -gravity)  # not of unit length
    sine = float(np.linalg.norm(axis))  # times |gravity|, which cancels in the arc tangent
    if sine == 0:
        return np.eye(3)
    angle = np.arctan2(sine, -gravity[2])  # between z and the direction against gravity [rad]
    return np.asarray(rotations_about(axis / sine, np.array([angle]))[0])


def facing_rotation(facing_deg: float) -> Vector:
    """Rotation (3, 3) of the root link with which the robot looks along x.

    Args:
        facing_deg: direction in which the robot looks while its root is not turned, counterclockwise from x [deg].
    """
    return np.asarray(rotations_about(UP, np.array([-np.deg2rad(facing_deg)]))[0])


def feet_of(skeleton: Skeleton, facing_deg: float, kind: str | None = None) -> list[Foot]:
    """Find the feet of a robot.

    Args:
        skeleton: links, joints and masses of the robot.
        facing_deg: direction in which the robot looks, see :func:`facing_rotation`.
        kind: kind of feet of the robot's model, such as ``soles``. If it is None, the default one.

    Raises:
        InvalidParameter: the robot has no feet.
        UnknownName: the robot has no feet of this kind.
    """
    model = skeleton.model
    if model.feet is None:
        raise InvalidParameter(
            message("base.robot_called", "robot {name}", name=model.name),
            message("programs.robot_without_feet", "a robot without feet"),
            message("programs.legged_robot", "a robot with feet"),
        )
    contact = model.feet.kind(kind)
    # Transform (4, 4) from the frame of the root link to that in which the robot walks along x.
    facing = stack_poses(np.zeros((1, 3)), facing_rotation(facing_deg)[np.newaxis])[0]
    feet = []
    for link in contact.links:
        # With all axes at zero each foot stands flat and looks ahead: this defines its upright rotation.
        # The pose `home` of the link is seen from the root.
        home = facing @ skeleton.links[link][1]
        upright = home[:3, :3]
        # A box or several spheres, such as one at each corner, are a sole. A single sphere is a ball.
        if link in contact.boxes:
            sole = contact.boxes[link]
            point = np.array(sole.centre)
            over = sole.size[2] / 2
        else:
            # The middle of the spheres is taken along the axes of the walking direction, not those of the link.
            spheres = np.array(contact.points[link]) @ upright.T
            middle = (spheres.min(axis=0) + spheres.max(axis=0)) / 2
            point = upright.T @ middle
            over = contact.surface(link).radius
        # Points of the contact around the middle of the foot, along the axes of the walking direction.
        support = (contact.support_points(link) - point) @ upright.T
        # The tool frame looks ahead when the foot does: it undoes the rotation of the link.
        tool = stack_poses(point[np.newaxis], upright.T[np.newaxis])[0]
        axes, leg = skeleton.limb(link, tool)
        feet.append(
            Foot(
                name=_foot_name(skeleton, link),
                link=link,
                axes=axes,
                leg=leg,
                point=point,
                over=over,
                upright=upright,
                home=home[:3, 3] + upright @ point,
                half=np.ptp(support[:, :2], axis=0) / 2,
            )
        )
    return feet


def _foot_name(skeleton: Skeleton, link: str) -> str:
    """Name of the foot that a link belongs to.

    It is the name of the robot's tool on the same body whose name ends in "foot", such as ``left_foot``. If there is
    none, it is the name of the link.
    """
    body = skeleton.links[link][0]
    # A frame that has several tools is called by the last of them.
    tool_of_frame = {frame: tool for tool, frame in skeleton.model.tools.items()}
    for frame, tool in tool_of_frame.items():
        if skeleton.links[frame][0] == body and tool.endswith("foot"):
            return tool
    return link


def rolled_distances(rotation: Vector, standing: npt.NDArray[np.bool_], radius: float) -> Vector:
    """Compute how far a foot that is a ball has rolled since its touchdown.

    While the foot is in the air, the distance goes back to zero, because footholds are planned as if the ball did not
    roll. A foot that stands at the first sample has not rolled there.

    Args:
        rotation: rotations of the ball at m times, shape (m, 3, 3).
        standing: whether the ball stands at these times, shape (m,).
        radius: radius of the ball [m].

    Returns:
        Displacement of the middle of the ball ahead and to the left, shape (m, 2) [m].
    """
    # For a small rotation R from one sample to the next, the rotation vector is half of the vector of the skew matrix
    # R - R^T.
    change = rotation[1:] @ rotation[:-1].transpose(0, 2, 1)
    twice_about_x = change[:, 2, 1] - change[:, 1, 2]
    twice_about_y = change[:, 0, 2] - change[:, 2, 0]
    about = np.stack([twice_about_x, twice_about_y], axis=1) / 2
    # Rolling without slip: dc = (rotation vector) x (r e_z) = r (about y, -about x).
    move = radius * np.column_stack([about[:, 1], -about[:, 0]])
    # The foot rolls between two samples only if it stands in both.
    stays_down = standing[1:] & standing[:-1]
    # How far the ball has rolled since the first sample, in all of its times on the ground.
    path = np.vstack([np.zeros((1, 2)), np.cumsum(move * stays_down[:, np.newaxis], axis=0)])
    # From one edge to the next the foot either stands or is in the air.
    changes = np.flatnonzero(np.diff(standing.astype(int))) + 1
    edges = [0, *changes, len(standing)]
    result = np.zeros((len(standing), 2))
    at_liftoff = np.zeros(2)
    for start, end in pairwise(edges):
        if standing[start]:
            result[start:end] = path[start:end] - path[start]
            at_liftoff = result[end - 1]
        else:
            # From the distance at lift-off back to zero, without reaching either: those are the samples around.
            share = np.arange(1, end - start + 1) / (end - start + 1)
            result[start:end] = np.outer(1.0 - smooth(share), at_liftoff)
    return result


@dataclass(frozen=True, eq=False)
class Walker:
    """A robot for which gaits are planned, and the conditions under which it walks.

    Attributes:
        skeleton: links, joints and masses of the robot, with what it carries.
        gaits: the robot's file ``gaits.yaml``.
        gravity: gravity in the frame of the ground in which the robot looks along x, shape (3,) [m/s²].
        is_loaded_or_inclined: whether the robot carries something or stands on a slope. Its gaits are made for neither.
    """

    skeleton: Skeleton
    gaits: GaitsFile
    gravity: Vector = field(default_factory=LEVEL.copy)
    is_loaded_or_inclined: bool = False

    @classmethod
    def of(cls, robot: "str | RobotModel | Walker") -> "Walker":
        """Prepare a robot for planning, without a load and on level ground.

        Args:
            robot: name or model of a robot with a ``gaits.yaml``. A Walker is returned unchanged.

        Raises:
            UnknownName: there is no such robot.
            InvalidParameter: the robot has no gaits, or a joint that is not revolute.
            InvalidConfig: its file of gaits cannot be read, or its ``facing_deg`` is missing or wrong. The gaits in it
                are not checked.
        """
        if isinstance(robot, Walker):
            return robot
        gaits = gaits_file(robot)
        return cls(skeleton_of(robot), gaits)

    @property
    def model(self) -> RobotModel:
        """Model of the robot."""
        return self.skeleton.model

    def feet(self, kind: str | None = None) -> list[Foot]:
        """Find the feet of a kind, such as ``soles``, or of the default kind if it is None; see :func:`feet_of`."""
        return feet_of(self.skeleton, self.gaits.facing_deg, kind)

    def feet_by_name(
        self, names: Collection[str], kind: str | None, needed: str
    ) -> dict[str, Foot]:
        """Find the feet of a robot that has exactly those that a gait is made for.

        Args:
            names: names of the feet that the gait moves.
            kind: kind of feet. If it is None, the default one.
            needed: description of the feet for the error message, such as "two feet for this gait".

        Returns:
            The feet by name, in the order of the robot's model.

        Raises:
            InvalidParameter: the robot has no feet, or other ones.
            UnknownName: the robot has no feet of this kind.
        """
        feet = {foot.name: foot for foot in self.feet(kind)}
        if sorted(feet) != sorted(names):
            raise InvalidParameter(
                message("base.robot_called", "robot {name}", name=self.model.name),
                message("programs.count_of_feet", "a robot with {count} feet", count=len(feet)),
                message("programs.robot_with", "a robot with {needed}", needed=needed),
            )
        return feet


_OTHER_SIDE = {"left": "right", "right": "left"}


def exchange_sides(model: RobotModel, values: Vector) -> Vector:
    """Exchange left and right in values of all axes, such as the angles of a posture.

    The sides are the first words of the axes' names, such as ``left_hip_yaw``: both sides need the same axes. An axis
    of no side keeps its value. The values of all yaw axes, whose names end in ``yaw``, change their sign, also those of
    no side.

    Args:
        model: the robot.
        values: one value for each axis, shape (n,).

    Returns:
        Values of the mirror image, shape (n,).
    """
    names = list(model.axes)
    result = np.empty_like(values)
    # Signs of axes are mirrored in the models: pitch axes turn forward and roll axes outward on both sides. A yaw axis
    # turns to the left on both sides, so only its sign changes in the mirror.
    for index, name in enumerate(names):
        side, _, rest = name.partition("_")
        other = index
        if side in _OTHER_SIDE:
            other = names.index(f"{_OTHER_SIDE[side]}_{rest}")
        result[index] = -values[other] if name.endswith("yaw") else values[other]
    return result
