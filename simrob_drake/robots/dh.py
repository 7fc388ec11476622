"""Arms that are described by a table of Denavit-Hartenberg parameters, and the URDF of such an arm.

The shapes of its links are generated: a drum at each joint, tubes between the joints, a foot and a flange. Their sizes
are in proportion to the length of the arm, so that they show an arm like this one, but are not its data.
"""

import xml.etree.ElementTree as ET
from dataclasses import dataclass
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from pydantic import Field, model_validator
from pydrake.geometry import Cylinder, Sphere
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix

from simrob_drake.base.frames import Vector, transform_from_pose
from simrob_drake.base.messages import message
from simrob_drake.base.sections import (
    ORIGIN,
    Colour,
    Inertia,
    NotNegative,
    Number,
    Pose,
    Positive,
    Strict,
    Triple,
)
from simrob_drake.robots.pieces import solid_inertia
from simrob_drake.robots.urdf import (
    Solid,
    add_colour,
    add_joint,
    add_motor,
    add_solid,
    format_number,
    set_inertia,
)

BASE_LINK = "base_link"
"""Name of the root link."""

TOOL_LINK = "tool0"
"""Name of the link at the tool flange."""

_JOINT = "joint_{}"
"""Name of a joint that has no name of its own, with the number of its row."""

Range = tuple[Number, Number]
"""Lowest and highest position of a joint."""


class DhRow(Strict):
    """One row of the table: a joint and the link that it moves.

    Mass, centre of mass and inertia are those of the link, in the frame of this row.
    """

    # Turns and slides have keys of their own, since a number alone would not show whether it is in degrees or metres.

    joint: str | None = None
    """Name of the joint; `joint_1` and so on unless given."""
    type: Literal["revolute", "prismatic"] = "revolute"
    """Kind of the joint: it turns about z, or slides along z."""
    a: Number = 0.0
    """Length along x [m]."""
    alpha_deg: Number = 0.0
    """Twist about x [deg]."""
    d: Number = 0.0
    """Offset along z [m]. For a prismatic joint, it is added to the position of the joint."""
    offset_deg: Number = 0.0
    """Angle about z [deg]. For a revolute joint, it is added to the position of the joint."""
    limit_deg: Range | None = None
    """Lowest and highest angle of a revolute joint [deg]."""
    limit: Range | None = None
    """Lowest and highest position of a prismatic joint [m]."""
    velocity_deg: Positive | None = None
    """Largest speed of a revolute joint [deg/s]."""
    velocity: Positive | None = None
    """Largest speed of a prismatic joint [m/s]."""
    effort: Positive
    """Largest torque [N·m] or force [N] of the motor."""
    damping: NotNegative = 0.0
    """Viscous friction [N·m·s/rad or N·s/m]."""
    mass: NotNegative = 0.0
    """Mass of the link [kg]."""
    com: Triple | None = None
    """Centre of mass of the link [m]; that of the generated shape unless given."""
    inertia: Inertia | None = None
    """Inertia of the link about its centre of mass [kg m²]; that of the generated shape, with the link's mass, unless
    given."""

    @model_validator(mode="after")
    def _check_limits(self) -> "DhRow":
        """Check that limits are given and in order, and that no key of the other kind of joint is used.

        Raises:
            ValueError: one of these does not hold; pydantic reports the error with the key.
        """
        if self.type == "revolute":
            limit_key = "limit_deg"
            velocity_key = "velocity_deg"
            limits = self.limit_deg
            has_other_keys = self.limit is not None or self.velocity is not None
        else:
            limit_key = "limit"
            velocity_key = "velocity"
            limits = self.limit
            has_other_keys = self.limit_deg is not None or self.velocity_deg is not None
        if limits is None:
            raise ValueError(
                message(
                    "robots.dh_joint_needs",
                    "a {kind} joint needs {key}",
                    kind=self.type,
                    key=limit_key,
                )
            )
        # Keys of the other kind would be ignored, and the joint would then not have the limits that the user sees.
        if has_other_keys:
            raise ValueError(
                message(
                    "robots.dh_joint_has_both",
                    "a {kind} joint has the keys {key} and {speed_key}, and not those of the other kind",
                    kind=self.type,
                    key=limit_key,
                    speed_key=velocity_key,
                )
            )
        lower, upper = limits
        if lower >= upper:
            raise ValueError(
                message(
                    "robots.dh_limits_order",
                    "{key} must be a lower limit and a higher limit; it is {lower:g}, {upper:g}",
                    key=limit_key,
                    lower=lower,
                    upper=upper,
                )
            )
        return self

    @property
    def range(self) -> tuple[float, float]:
        """Lowest and highest position [rad or m]."""
        # The checks have made sure that exactly one of the two keys is given.
        if self.limit is not None:
            return self.limit
        lower, upper = np.deg2rad(self.limit_deg or (0.0, 0.0)).tolist()
        return lower, upper

    @property
    def speed(self) -> float | None:
        """Largest speed [rad/s or m/s], or None if the row has no speed."""
        if self.velocity_deg is not None:
            return float(np.deg2rad(self.velocity_deg))
        return self.velocity


class DhTable(Strict):
    """An arm as a table: its base, one row for each joint, and its tool.

    The pose of the tool is the product of the base, the rows and the tool. With R and T for turns and translations
    about and along an axis, and the position q of the joint, a row is

        classical: Rz(q + offset) Tz(d) Tx(a) Rx(alpha)
        modified:  Rx(alpha) Tx(a) Rz(q + offset) Tz(d)

    if the joint is revolute. For a prismatic joint, q is added to d and not to the offset.
    """

    convention: Literal["classical", "modified"]
    """Order of the motions in a row. The modified convention is Craig's."""
    rows: Annotated[tuple[DhRow, ...], Field(min_length=1)]
    """Rows of the table, one for each joint, from the base outward."""
    base: Pose = ORIGIN
    """Pose of the table's first frame in the base link, [x y z Rz Ry Rx]."""
    tool: Pose = ORIGIN
    """Pose of the tool flange in the last frame, [x y z Rz Ry Rx]."""
    thickness: Positive | None = None
    """Radius of the generated arm at its base [m]; in proportion to the arm's length unless given."""
    colour: Colour = (0.86, 0.87, 0.89, 1.0)
    """Colour of the tubes between the joints."""
    joint_colour: Colour = (0.16, 0.38, 0.62, 1.0)
    """Colour of the joints."""

    @property
    def joints(self) -> list[str]:
        """Names of the joints."""
        return [row.joint or _JOINT.format(number) for number, row in enumerate(self.rows, 1)]

    def link_frames(self) -> list[RigidTransform]:
        """Compute the pose of each row's frame in the frame of its link, which moves with the joint.

        In the classical convention, all motions of a row are behind its joint, and so in the link that it moves. In the
        modified convention, length and twist are before the joint, and so in the link before.
        """
        # Offset and d are about and along the joint's own axis: both conventions can have them behind the joint.
        if self.convention == "classical":
            return [_motion(row.offset_deg, row.d, row.a, row.alpha_deg) for row in self.rows]
        return [_motion(row.offset_deg, row.d, 0.0, 0.0) for row in self.rows]

    def origins(self) -> list[RigidTransform]:
        """Compute the pose of each joint at zero in the link before, and last the pose of the tool in the last link."""
        # Length and twist are about and along the same x axis, so that their order does not matter.
        if self.convention == "modified":
            before_joints = [_motion(0.0, 0.0, row.a, row.alpha_deg) for row in self.rows]
        else:
            before_joints = [RigidTransform()] * len(self.rows)
        # One origin for each joint and one for the tool: what is behind the joint before, then what is before this one.
        row_frames = [transform_from_pose(self.base), *self.link_frames()]
        motions = [*before_joints, transform_from_pose(self.tool)]
        return [frame @ motion for frame, motion in zip(row_frames, motions, strict=True)]


def described_by_table(content: dict[str, Any]) -> Any:
    """Fill in the keys of a robot's description that follow from its table: root, axes and tools.

    A key that is given keeps its value. Content without proper rows is left as it is, since the checks of
    :class:`DhTable` describe the fault.
    """
    rows = content["dh"].get("rows")
    if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
        return content
    joints = [row.get("joint") or _JOINT.format(number) for number, row in enumerate(rows, 1)]
    return {"root": BASE_LINK, "axes": joints, "tools": {TOOL_LINK: TOOL_LINK}, **content}


def _motion(turn_deg: float, z: float, x: float, twist_deg: float) -> RigidTransform:
    """Compute the transform Rz(turn) Tz(z) Tx(x) Rx(twist).

    Args:
        turn_deg: angle about z [deg].
        z: translation along z [m].
        x: translation along the x axis after the turn [m].
        twist_deg: angle about this x axis [deg].
    """
    turn = np.deg2rad(turn_deg)
    twist = np.deg2rad(twist_deg)
    # The rotation is Rz(turn) Rx(twist). The translation along x is turned by the rotation about z before it.
    translation = np.array([x * np.cos(turn), x * np.sin(turn), z])
    return RigidTransform(RollPitchYaw(twist, 0.0, turn), translation)


_THICKNESS = 0.055
"""Radius of the arm at its base, divided by its length."""

_TAPER = 0.5
"""Share by which the radius becomes smaller from the base to the tool."""


class _DrumSize(NamedTuple):
    """Size of a drum, divided by the radius of the tube next to it."""

    radius: float
    length: float


# Sizes for the look alone: a joint is thicker than its tubes, the foot is wide and flat, and the flange is thin.
_JOINT_DRUM = _DrumSize(radius=1.25, length=2.6)
_FOOT_DRUM = _DrumSize(radius=1.8, length=0.3)
_FLANGE_DRUM = _DrumSize(radius=0.8, length=0.4)

_ROD = 0.7
"""Radius of the rod of a prismatic joint, divided by the radius of the tube."""

_FLANGE_COLOUR: Colour = (0.66, 0.68, 0.7, 1.0)
"""Colour of the flange: red, green, blue, opacity."""
_SHORTEST_TUBE = 1e-6
"""Length below which tubes are left out [m]."""


@dataclass(frozen=True)
class LinkShape:
    """A shape of a link, in the link's frame, and its colour."""

    solid: Solid
    colour: Colour


def dh_robot(name: str, table: DhTable) -> ET.Element:
    """Make the ``robot`` element of an arm.

    The links are ``base_link``, ``link_1`` and so on, and ``tool0``. Each link moves about, or along, the z axis of its
    own frame. The pose of ``tool0`` in ``base_link`` is the product of the table.

    Args:
        name: name of the robot.
        table: the table.
    """
    robot = ET.Element("robot", name=name)
    shapes = link_shapes(table)
    origins = table.origins()
    frames = table.link_frames()

    row_links = [f"link_{number}" for number in range(1, len(table.rows) + 1)]
    names = [BASE_LINK, *row_links, TOOL_LINK]
    links = [ET.SubElement(robot, "link", name=link) for link in names]
    # The last link, tool0, has no shapes.
    for link, shapes_of_link in zip(links, [*shapes, []], strict=True):
        _add_shapes(link, shapes_of_link)

    # Row i connects link i with link i + 1, where link 0 is the base. The base has no inertia: it does not move.
    for number, (row, joint_name) in enumerate(zip(table.rows, table.joints, strict=True)):
        parent = names[number]
        child = names[number + 1]
        _add_inertia(links[number + 1], row, frames[number], shapes[number + 1])
        joint = add_joint(
            robot, joint_name, kind=row.type, pose=origins[number], parent=parent, child=child
        )
        _add_motion(joint, row)
        add_motor(robot, joint_name, drive=f"{joint_name}_transmission")
    add_joint(robot, "flange", parent=names[-2], child=names[-1], pose=origins[-1])
    return robot


def _add_shapes(link: ET.Element, shapes: list[LinkShape]) -> None:
    """Add shapes to a link, each as a visual and as a collision element."""
    # Drake requires different names among the visuals of a link, and among its collision shapes.
    for number, shape in enumerate(shapes):
        name = f"{link.get('name')}_{number}"
        visual = add_solid(link, "visual", name, shape.solid)
        add_colour(visual, f"{name}_colour", shape.colour)
        add_solid(link, "collision", name, shape.solid)


def _add_inertia(
    link: ET.Element, row: DhRow, frame: RigidTransform, shapes: list[LinkShape]
) -> None:
    """Add the inertia of a link. Centre and moments that its row does not give are those of its shapes, evenly filled.

    Args:
        link: the link.
        row: the row of the table. A link without mass gets no inertia.
        frame: pose of the row's frame in the link, in which the row's values are given.
        shapes: shapes of the link, in its own frame.
    """
    if row.mass == 0:
        return
    whole = solid_inertia([shape.solid for shape in shapes], closed=True)
    centre = whole.centre if row.com is None else frame @ np.array(row.com)
    # Shapes are given in the link's own frame, and values of a row in the frame of the row.
    if row.inertia is None:
        density = row.mass / whole.volume
        moments = density * whole.moments
        rotation = RotationMatrix()
    else:
        moments = np.array(row.inertia)
        rotation = frame.rotation()
    set_inertia(
        link, mass=row.mass, moments=moments.tolist(), pose=RigidTransform(rotation, centre)
    )


def _add_motion(joint: ET.Element, row: DhRow) -> None:
    """Add the axis, the limits (of position, effort and, if the row has one, speed) and the damping to a joint."""
    # Denavit and Hartenberg's frames have their z axes along the joints.
    ET.SubElement(joint, "axis", xyz="0 0 1")
    lower, upper = row.range
    limit = ET.SubElement(
        joint,
        "limit",
        lower=format_number(lower),
        upper=format_number(upper),
        effort=format_number(row.effort),
    )
    if row.speed is not None:
        limit.set("velocity", format_number(row.speed))
    ET.SubElement(joint, "dynamics", damping=format_number(row.damping))


def link_shapes(table: DhTable) -> list[list[LinkShape]]:
    """Generate the shapes of all links but ``tool0``, those of the base first, in the frames of the links.

    Each link has a drum or a rod at its joint, and tubes to the next joint or to the tool. The base has a foot, the
    last link a flange.
    """
    links = []
    for number, (end, radius) in enumerate(zip(table.origins(), _radii(table), strict=True)):
        shapes = [LinkShape(tube, table.colour) for tube in _tubes(end.translation(), radius)]
        begin = _foot(radius) if number == 0 else _joint(table, number, radius)
        shapes.append(LinkShape(begin, table.joint_colour))
        if number == len(table.rows):
            # The outer face of the flange is at the tool, so that its centre is half its length before the tool.
            length = _FLANGE_DRUM.length * radius
            flange = _drum(
                end, radius=_FLANGE_DRUM.radius * radius, length=length, centre=-length / 2
            )
            shapes.append(LinkShape(flange, _FLANGE_COLOUR))
        links.append(shapes)
    return links


def _radii(table: DhTable) -> Vector:
    """Compute the radius of the tubes of each link but ``tool0``, from the base outward, shape (rows + 1,) [m]."""
    # Length of the extended arm. The first origin is that of the base, which may be a column of any height.
    length = sum(float(np.linalg.norm(origin.translation())) for origin in table.origins()[1:])
    length += sum(row.range[1] - row.range[0] for row in table.rows if row.type == "prismatic")
    # A spherical wrist alone has no length; its drums would have no size.
    thickness = table.thickness or _THICKNESS * max(length, 0.1)
    return np.asarray(thickness * np.linspace(1.0, 1.0 - _TAPER, len(table.rows) + 1))


def _tubes(end: Vector, radius: float) -> list[Solid]:
    """Make tubes from the origin to a point: along z, then straight to the point, with a ball at the bend.

    Args:
        end: the point, shape (3,) [m].
        radius: radius of the tubes [m].

    Returns:
        none, one or two tubes, and the ball if there are two.
    """
    # The z axis is that of the joint before: along it the next joint is offset by d, and across it by a.
    origin = np.zeros(3)
    corner = np.array([0.0, 0.0, end[2]])
    tubes = []
    for begin_of_tube, end_of_tube in ((origin, corner), (corner, end)):
        if _are_apart(begin_of_tube, end_of_tube):
            tubes.append(_tube(begin_of_tube, end_of_tube, radius))
    if len(tubes) > 1:
        tubes.append(Solid(RigidTransform(corner), Sphere(radius)))
    return tubes


def _foot(radius: float) -> Solid:
    """Make the foot of the base, which is on the ground, for a tube of a radius [m]."""
    length = _FOOT_DRUM.length * radius
    return _drum(
        RigidTransform(), radius=_FOOT_DRUM.radius * radius, length=length, centre=length / 2
    )


def _joint(table: DhTable, number: int, radius: float) -> Solid:
    """Make the shape at a joint: a drum, or the rod of a prismatic joint.

    Args:
        table: the table.
        number: number of the row, from 1.
        radius: radius of the tubes of the link that the joint moves [m].
    """
    row = table.rows[number - 1]
    if row.type == "prismatic":
        # The rod slides through the link before. It reaches back into that link even when it is extended fully.
        upper = row.range[1]
        start = np.array([0.0, 0.0, -upper])
        end = np.array([0.0, 0.0, radius])
        return _tube(start, end, _ROD * radius)
    length = _JOINT_DRUM.length * radius
    # A first joint at the origin of the base is put on the ground; half of the drum would be below it otherwise.
    first_origin = table.origins()[0].translation()
    is_on_ground = number == 1 and not _are_apart(first_origin, np.zeros(3))
    centre = length / 2 if is_on_ground else 0.0
    return _drum(RigidTransform(), radius=_JOINT_DRUM.radius * radius, length=length, centre=centre)


def _drum(frame: RigidTransform, *, radius: float, length: float, centre: float) -> Solid:
    """Make a cylinder along the z axis of a frame.

    Args:
        frame: pose of the frame in the link.
        radius: radius of the cylinder [m].
        length: its length [m].
        centre: z of its centre in the frame [m].
    """
    return Solid(frame @ RigidTransform(np.array([0.0, 0.0, centre])), Cylinder(radius, length))


def _tube(start: Vector, end: Vector, radius: float) -> Solid:
    """Make a cylinder of a radius [m] between two points (3,) [m] in the frame of the link."""
    z_axis = 2
    rotation = RotationMatrix.MakeFromOneVector(end - start, z_axis)
    length = float(np.linalg.norm(end - start))
    return Solid(RigidTransform(rotation, (start + end) / 2), Cylinder(radius, length))


def _are_apart(a: Vector, b: Vector) -> bool:
    """Whether two points (3,) [m] are so far apart that a tube is between them."""
    return bool(np.linalg.norm(b - a) > _SHORTEST_TUBE)
