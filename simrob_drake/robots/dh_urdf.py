"""From a table of Denavit-Hartenberg parameters to the URDF of a robot.

It looks like an arm: a drum at each joint, tubes between them, a foot and a flange.
"""

import xml.etree.ElementTree as ET
from dataclasses import dataclass

import numpy as np
from pydrake.geometry import Cylinder, Sphere
from pydrake.math import RigidTransform, RotationMatrix

from simrob_drake.frames import Vector
from simrob_drake.robots.dh import BASE_LINK, TOOL_LINK, DhRow, DhTable
from simrob_drake.robots.solids import solid_inertia
from simrob_drake.robots.urdf import Solid, add_colour, add_joint, add_motor, add_solid, set_inertia, written
from simrob_drake.sections import Colour

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
    """Return the shapes of all links, that of the base first.

    A tube goes from each link's joint along z and then straight to the next joint, or to the tool.
    """
    origins, radii = table.origins(), _radii(table)
    links = []
    for number, (end, radius) in enumerate(zip(origins, radii, strict=True)):
        shapes = [LinkShape(tube, table.colour) for tube in _tubes(end.translation(), radius)]
        shapes += _joint(table, number, radius) if number else [_foot(table, radius)]
        if number == len(table.rows):
            shapes.append(_flange(end, radius))
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


def _joint(table: DhTable, number: int, radius: float) -> list[LinkShape]:
    row = table.rows[number - 1]
    if row.type == "prismatic":  # a rod that slides through the link before
        rod = _tube(np.array([0.0, 0.0, -row.range[1]]), np.array([0.0, 0.0, radius]), 0.7 * radius)
        return [LinkShape(rod, table.joint_colour)]
    wide, long = _DRUM[0] * radius, _DRUM[1] * radius
    stands = number == 1 and not _apart(table.origins()[0].translation(), np.zeros(3))  # on the ground, not half in it
    place = RigidTransform(np.array([0.0, 0.0, long / 2 if stands else 0.0]))
    return [LinkShape(Solid(place, Cylinder(wide, long)), table.joint_colour)]


def _foot(table: DhTable, radius: float) -> LinkShape:
    wide, high = (part * radius for part in _FOOT)
    return LinkShape(Solid(RigidTransform(np.array([0.0, 0.0, high / 2])), Cylinder(wide, high)), table.joint_colour)


def _flange(tool: RigidTransform, radius: float) -> LinkShape:
    wide, long = (part * radius for part in _FLANGE)
    place = tool @ RigidTransform(np.array([0.0, 0.0, -long / 2]))
    return LinkShape(Solid(place, Cylinder(wide, long)), _FLANGE_COLOUR)


def _tube(start: Vector, end: Vector, radius: float) -> Solid:
    turn = RotationMatrix.MakeFromOneVector(end - start, 2)
    return Solid(RigidTransform(turn, (start + end) / 2), Cylinder(radius, float(np.linalg.norm(end - start))))


def _apart(a: Vector, b: Vector) -> bool:
    return bool(np.linalg.norm(b - a) > _NOTHING)
