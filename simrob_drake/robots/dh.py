"""Tables of Denavit-Hartenberg parameters: what an arm is, in the words of the textbooks; and the URDF of one.

It looks like an arm: a drum at each joint, tubes between them, a foot and a flange.
"""

import xml.etree.ElementTree as ET
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, model_validator
from pydrake.geometry import Cylinder, Sphere
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix

from simrob_drake.base.frames import Vector, transform_from_pose
from simrob_drake.base.messages import message
from simrob_drake.base.sections import ORIGIN, Colour, Inertia, NotNegative, Number, Pose, Positive, Strict, Triple
from simrob_drake.robots.pieces import solid_inertia
from simrob_drake.robots.urdf import Solid, add_colour, add_joint, add_motor, add_solid, set_inertia, written

BASE_LINK, TOOL_LINK = "base_link", "tool0"
_JOINT = "joint_{}"

Range = tuple[Number, Number]


class DhRow(Strict):
    """One joint and the link that it moves.

    Mass, centre of mass and inertia are those of the link, in the frame of this row.
    """

    joint: str | None = None
    """Its name; `joint_1` and so on unless given."""
    type: Literal["revolute", "prismatic"] = "revolute"
    """Whether it turns about z or slides along it."""
    a: Number = 0.0
    """Length along x [m]."""
    alpha_deg: Number = 0.0
    """Twist about x [deg]."""
    d: Number = 0.0
    """Offset along z [m]; of a prismatic joint, where its zero is."""
    offset_deg: Number = 0.0
    """Turn about z [deg]; of a revolute joint, where its zero is."""
    limit_deg: Range | None = None
    """Lowest and highest angle of a revolute joint [deg]."""
    limit: Range | None = None
    """Lowest and highest place of a prismatic joint [m]."""
    velocity_deg: Positive | None = None
    """Largest speed of a revolute joint [deg/s]."""
    velocity: Positive | None = None
    """Largest speed of a prismatic joint [m/s]."""
    effort: Positive
    """Largest torque [N·m] or force [N] of the motor."""
    damping: NotNegative = 0.0
    """Viscous friction [N·m·s/rad or N·s/m]."""
    mass: NotNegative = 0.0
    """Of the link [kg]."""
    com: Triple | None = None
    """Centre of mass [m]; that of the generated shape unless given."""
    inertia: Inertia | None = None
    """About the centre of mass [kg m²]; that of the generated shape, with the link's mass, unless given."""

    @model_validator(mode="after")
    def _fitting(self) -> "DhRow":
        revolute = self.type == "revolute"
        own, other = ("limit_deg", "limit") if revolute else ("limit", "limit_deg")
        spared = "velocity" if revolute else "velocity_deg"
        limits = getattr(self, own)
        if limits is None:
            raise ValueError(message("robots.dh_joint_needs", "a {kind} joint needs {key}", kind=self.type, key=own))
        if getattr(self, other) is not None or getattr(self, spared) is not None:
            raise ValueError(
                message(
                    "robots.dh_joint_has_both",
                    "a {kind} joint has {key} and {other_key}",
                    kind=self.type,
                    key=own,
                    other_key=own.replace("limit", "velocity"),
                )
            )
        if limits[0] >= limits[1]:
            raise ValueError(
                message(
                    "robots.dh_limits_order",
                    "{key} is not a lower and a higher figure: {lower:g}, {upper:g}",
                    key=own,
                    lower=limits[0],
                    upper=limits[1],
                )
            )
        return self

    @property
    def range(self) -> tuple[float, float]:
        """Lowest and highest position [rad or m]."""
        low, high = self.limit or tuple(np.deg2rad(self.limit_deg or (0.0, 0.0)).tolist())
        return low, high

    @property
    def speed(self) -> float | None:
        """Largest speed [rad/s or m/s]."""
        return self.velocity if self.velocity_deg is None else float(np.deg2rad(self.velocity_deg))


class DhTable(Strict):
    """An arm as a table: base, a row a joint, tool.

    Rows multiply to the pose of the tool: classical ones as Rz(q + offset) Tz(d) Tx(a) Rx(alpha), modified (Craig's)
    as Rx(alpha) Tx(a) Rz(q + offset) Tz(d); where the joint is prismatic, q adds to d.
    """

    convention: Literal["classical", "modified"]
    """How the figures of a row are meant; modified ones are Craig's."""
    rows: Annotated[tuple[DhRow, ...], Field(min_length=1)]
    """One a joint, from the base outward."""
    base: Pose = ORIGIN
    """Pose of the table's first frame in the base link, [x y z Rz Ry Rx]."""
    tool: Pose = ORIGIN
    """Pose of the tool flange in the last frame, [x y z Rz Ry Rx]."""
    thickness: Positive | None = None
    """Radius of the generated arm at its base [m]; a part of its length unless given."""
    colour: Colour = (0.86, 0.87, 0.89, 1.0)
    """Of the tubes between the joints."""
    joint_colour: Colour = (0.16, 0.38, 0.62, 1.0)
    """Of the joints."""

    @property
    def joints(self) -> list[str]:
        """The names of the joints."""
        return [row.joint or _JOINT.format(number) for number, row in enumerate(self.rows, 1)]

    def link_frames(self) -> list[RigidTransform]:
        """Return the pose of each row's frame in its link, whose own frame moves with the joint, about z or along it.

        A classical row's length and twist lie behind its joint, a modified one's before it.
        """
        if self.convention == "classical":
            return [_motion(row.offset_deg, row.d, row.a, row.alpha_deg) for row in self.rows]
        return [_motion(row.offset_deg, row.d, 0.0, 0.0) for row in self.rows]

    def origins(self) -> list[RigidTransform]:
        """Return the pose of each joint at zero in the link before, and last that of the tool in the last link."""
        befores = [RigidTransform()] * len(self.rows)
        if self.convention == "modified":
            befores = [_motion(0.0, 0.0, row.a, row.alpha_deg) for row in self.rows]
        starts = [transform_from_pose(self.base), *self.link_frames()]
        return [start @ end for start, end in zip(starts, [*befores, transform_from_pose(self.tool)], strict=True)]


def described_by_table(content: dict[str, Any]) -> Any:
    """Fill in what a robot's description need not say where it has a table: root, axes and tools."""
    rows = content["dh"].get("rows")
    if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
        return content
    joints = [row.get("joint") or _JOINT.format(number) for number, row in enumerate(rows, 1)]
    return {"root": BASE_LINK, "axes": joints, "tools": {TOOL_LINK: TOOL_LINK}, **content}


def _motion(turn_deg: float, z: float, x: float, twist_deg: float) -> RigidTransform:
    """Return Rz(turn) Tz(z) Tx(x) Rx(twist)."""
    turn, twist = np.deg2rad([turn_deg, twist_deg])
    return RigidTransform(RollPitchYaw(twist, 0.0, turn), np.array([x * np.cos(turn), x * np.sin(turn), z]))


_THICKNESS = 0.055  # radius at the base over the arm's length
_TAPER = 0.5  # how much thinner its end is
_DRUM = 1.25, 2.6  # radius and length of a joint over the tube's radius
_FOOT = 1.8, 0.3  # of the base, likewise
_FLANGE = 0.8, 0.4  # of the tool's end, likewise
_FLANGE_COLOUR: Colour = (0.66, 0.68, 0.7, 1.0)
_NOTHING = 1e-6  # m; shorter tubes are left out


@dataclass(frozen=True)
class LinkShape:
    """A shape of a link, in the link's frame, and its colour."""

    solid: Solid
    colour: Colour


def dh_robot(name: str, table: DhTable) -> ET.Element:
    """Return the ``robot`` element of an arm.

    Its links are ``base_link``, ``link_1`` ... and ``tool0``; each moves about the z axis of its own frame, or along
    it. The pose of ``tool0`` in ``base_link`` is the product of the table.
    """
    robot = ET.Element("robot", name=name)
    shapes, origins, frames = link_shapes(table), table.origins(), table.link_frames()
    names = [BASE_LINK, *(f"link_{number}" for number in range(1, len(table.rows) + 1)), TOOL_LINK]
    links = [ET.SubElement(robot, "link", name=link) for link in names]
    for link, shapes_of_link in zip(links, [*shapes, []], strict=True):
        _add_shapes(link, shapes_of_link)
    for number, (row, joint_name) in enumerate(zip(table.rows, table.joints, strict=True)):
        _add_inertia(links[number + 1], row, frames[number], shapes[number + 1])
        ends = {"parent": names[number], "child": names[number + 1]}
        joint = add_joint(robot, joint_name, kind=row.type, pose=origins[number], **ends)
        _add_motion(joint, row)
        add_motor(robot, joint_name, drive=f"{joint_name}_transmission")
    add_joint(robot, "flange", parent=names[-2], child=names[-1], pose=origins[-1])
    return robot


def _add_shapes(link: ET.Element, shapes: list[LinkShape]) -> None:
    for number, shape in enumerate(shapes):
        name = f"{link.get('name')}_{number}"
        add_colour(add_solid(link, "visual", name, shape.solid), f"{name}_colour", shape.colour)
        add_solid(link, "collision", name, shape.solid)


def _add_inertia(link: ET.Element, row: DhRow, frame: RigidTransform, shapes: list[LinkShape]) -> None:
    """Add the link's inertia: what the row gives of it, the rest from its shapes."""
    if row.mass == 0:
        return
    whole = solid_inertia([shape.solid for shape in shapes], closed=True)
    centre = whole.centre if row.com is None else frame @ np.array(row.com)
    if row.inertia is None:
        moments, turn = row.mass / whole.volume * whole.moments, RotationMatrix()
    else:
        moments, turn = np.array(row.inertia), frame.rotation()
    set_inertia(link, mass=row.mass, moments=moments.tolist(), pose=RigidTransform(turn, centre))


def _add_motion(joint: ET.Element, row: DhRow) -> None:
    ET.SubElement(joint, "axis", xyz="0 0 1")
    low, high = row.range
    limit = ET.SubElement(joint, "limit", lower=written(low), upper=written(high), effort=written(row.effort))
    if row.speed is not None:
        limit.set("velocity", written(row.speed))
    ET.SubElement(joint, "dynamics", damping=written(row.damping))


def link_shapes(table: DhTable) -> list[list[LinkShape]]:
    """Return the shapes of all links, the base first: tubes along z, then straight to the next joint or the tool."""
    origins, radii = table.origins(), _radii(table)
    links = []
    for number, (end, radius) in enumerate(zip(origins, radii, strict=True)):
        shapes = [LinkShape(tube, table.colour) for tube in _tubes(end.translation(), radius)]
        if number:
            shapes.append(LinkShape(_joint(table, number, radius), table.joint_colour))
        else:
            wide, high = (part * radius for part in _FOOT)
            shapes.append(LinkShape(_drum(RigidTransform(), wide, high, high / 2), table.joint_colour))
        if number == len(table.rows):
            wide, long = (part * radius for part in _FLANGE)
            shapes.append(LinkShape(_drum(end, wide, long, -long / 2), _FLANGE_COLOUR))
        links.append(shapes)
    return links


def _radii(table: DhTable) -> Vector:
    length = sum(float(np.linalg.norm(origin.translation())) for origin in table.origins()[1:])
    length += sum(row.range[1] - row.range[0] for row in table.rows if row.type == "prismatic")
    thickness = table.thickness or _THICKNESS * max(length, 0.1)
    return np.asarray(thickness * np.linspace(1.0, 1.0 - _TAPER, len(table.rows) + 1))


def _tubes(end: Vector, radius: float) -> list[Solid]:
    """Return tubes from the origin to a point, with a ball where they bend."""
    corner = np.array([0.0, 0.0, end[2]])
    tubes = [_tube(a, b, radius) for a, b in ((np.zeros(3), corner), (corner, end)) if _apart(a, b)]
    return [*tubes, Solid(RigidTransform(corner), Sphere(radius))] if len(tubes) > 1 else tubes


def _joint(table: DhTable, number: int, radius: float) -> Solid:
    row = table.rows[number - 1]
    if row.type == "prismatic":  # a rod that slides through the link before
        return _tube(np.array([0.0, 0.0, -row.range[1]]), np.array([0.0, 0.0, radius]), 0.7 * radius)
    wide, long = _DRUM[0] * radius, _DRUM[1] * radius
    stands = number == 1 and not _apart(table.origins()[0].translation(), np.zeros(3))  # on the ground, not half in it
    return _drum(RigidTransform(), wide, long, long / 2 if stands else 0.0)


def _drum(frame: RigidTransform, wide: float, long: float, middle: float) -> Solid:
    """Return a cylinder along z of a frame, its middle at a place there."""
    return Solid(frame @ RigidTransform(np.array([0.0, 0.0, middle])), Cylinder(wide, long))


def _tube(start: Vector, end: Vector, radius: float) -> Solid:
    turn = RotationMatrix.MakeFromOneVector(end - start, 2)
    return Solid(RigidTransform(turn, (start + end) / 2), Cylinder(radius, float(np.linalg.norm(end - start))))


def _apart(a: Vector, b: Vector) -> bool:
    return bool(np.linalg.norm(b - a) > _NOTHING)
