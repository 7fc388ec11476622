"""Whether the numbers of a robot or a piece are plausible: the usual slips with units.

One list of checks for all robots, whatever file they come from: each reader ends in a URDF. The checks doubt only what
is far beyond real machines, so that a doubt nearly always is a slip.
"""

import math
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from simrob_drake.frames import Vector
from simrob_drake.robots.bodies import carriers
from simrob_drake.robots.shape_inertia import inertia_of_shapes
from simrob_drake.robots.urdf import joint_limits, link_of, mass_of, moments_of, name_of, pose_of, root_link

# Bounds of what is not doubted. Slips with units are larger: grams for kilograms make a density 1e3 times as large,
# millimetres for metres 1e9 times as small, kg mm² for kg m² moments 1e6 times as large. Published robots reach the
# bounds where a shape stands for something larger or smaller than itself.
HEAVIEST = 1e5
"""Largest density of a body [kg/m³]; gold has 2e4."""
LIGHTEST = 0.1
"""Smallest density of a body [kg/m³]; air has 1.2."""
_LEAST_MOMENTS, _MOST_MOMENTS = 1e-5, 1e3  # moments of a body by those of a solid one of its mass and shapes
_NEGLIGIBLE = 1e-3  # mass of a link by that of the robot that changes no motion
_TOKEN = 1e-6  # volume of shapes that only stand for something, a cube of 10 mm [m³]
_FAR = 1.0  # distance of a centre of mass from the middle of its body that is never doubted [m]
_SPREADS = 2.0  # and as many radii of gyration of the body beside it
_STRONG, _HEAVY = 50.0, 100.0  # payload by the robot's own mass, and the payload [kg] up to which that is not doubted
_LONGEST = 30.0  # link of a robot [m]
_MOST_TURNS = 4 * math.pi  # limit of a joint that is not doubted [rad]
_WHOLE = 1e-3  # deviation from a whole number of half turns that is rounding
_ENDLESS = 1e4  # limits beyond are a way to write that there are none [rad]


class Doubt(NamedTuple):
    """A number that is hardly meant."""

    where: str  # the element, as in ``link 'rod' <inertial>``
    text: str  # what is doubtful, and what might be meant


class MassProperties(NamedTuple):
    """Mass and its distribution, of a body or of its shapes filled evenly."""

    mass: float  # [kg]
    centre: Vector  # of mass, shape (3,) [m]
    trace: float  # sum of the principal moments about the centre of mass [kg m²]

    @property
    def spread(self) -> float:
        """Sum of the principal moments by the mass [m²]: twice the mean square distance from the centre."""
        return self.trace / self.mass


def robot_doubts(robot: ET.Element, folder: Path | None) -> list[Doubt]:
    """Find the numbers of a robot that are hardly meant.

    Args:
        robot: a checked ``robot`` element.
        folder: in which its meshes lie; None leaves them out.
    """
    sizes = _sizes(robot)
    doubts = list[Doubt]()
    whole = sum(mass_of(link) for link in robot.iterfind("link"))
    for link in robot.iterfind("link"):
        if mass_of(link) > _NEGLIGIBLE * whole:
            doubts += _link_doubts(link, sizes[name_of(link)], folder)
    doubts += list(_joint_doubts(robot))
    return doubts


def _sizes(robot: ET.Element) -> dict[str, float]:
    """The size of each link by the joints at it [m]: the farthest one from its frame, and the frame's own offset."""
    sizes = {name_of(link): 0.0 for link in robot.iterfind("link")}
    for joint in robot.iterfind("joint"):
        offset = float(np.linalg.norm(pose_of(joint).translation()))
        for end in ("parent", "child"):
            link = link_of(joint, end)
            sizes[link] = max(sizes.get(link, 0.0), offset)
    return sizes


def _link_doubts(link: ET.Element, size: float, folder: Path | None) -> list[Doubt]:
    """Find the doubtful numbers of a link's inertia, by its shapes, or by its size [m] if it has none."""
    inertial = link.find("inertial")
    if inertial is None:
        return []
    where = f"link '{name_of(link)}' <inertial>"
    own = MassProperties(mass_of(link), pose_of(inertial).translation(), float(np.trace(moments_of(inertial))))
    solid = inertia_of_shapes(link, folder, 1.0)
    if solid is None or solid.get_mass() < _TOKEN:
        return [Doubt(where, text) for text in _doubts_by_size(own, size)]
    centre = solid.get_com()
    moments = solid.Shift(centre).CalcRotationalInertia().CopyToFullMatrix3()
    shapes = MassProperties(solid.get_mass(), centre, float(np.trace(moments)))
    return [Doubt(where, text) for text in doubts_by_shapes(own, shapes)]


def doubts_by_shapes(own: MassProperties, shapes: MassProperties) -> list[str]:
    """Compare the mass of a body with what its shapes would have at 1 kg/m³, so that their mass is their volume."""
    texts = []
    density = own.mass / shapes.mass
    if not LIGHTEST <= density <= HEAVIEST:
        texts.append(f"mass {own.mass:g} kg in {shapes.mass:.3g} m³ is {density:.3g} kg/m³; grams, or mm?")
    if not shapes.spread > 0:  # lost in rounding: the shapes lie absurdly far out
        return texts
    apart = float(np.linalg.norm(own.centre - shapes.centre))
    if apart > _FAR + _SPREADS * math.sqrt(shapes.spread):
        texts.append(f"its centre of mass lies {apart:.3g} m from the middle of its shapes; in mm?")
    ratio = own.spread / shapes.spread
    if ratio > _MOST_MOMENTS or 0 < ratio < _LEAST_MOMENTS:
        texts.append(f"its moments are {ratio:.3g} times those of a solid body of its mass and shapes")
    return texts


def _doubts_by_size(own: MassProperties, size: float) -> list[str]:
    """Compare the mass of a link without shapes with its size by the joints at it [m]."""
    texts = []
    apart = float(np.linalg.norm(own.centre))
    if apart > _FAR + _SPREADS * size:
        texts.append(f"its centre of mass lies {apart:.3g} m from its joint, and the joints at it {size:.3g} m; in mm?")
    gyration = math.sqrt(own.spread / 2)
    if gyration > _FAR + _SPREADS * max(size, apart):
        told = f"its moments are those of {own.mass:.4g} kg {gyration:.3g} m from the centre of mass"
        texts.append(f"{told}, and the joints at it are {size:.3g} m apart; in kg mm², or g m²?")
    return texts


def payload_doubt(payload: float, mass: float) -> str:
    """Text of a doubt about the mass that a robot can hold; empty if the mass is plausible.

    Args:
        payload: mass that its motors hold at rest [kg].
        mass: of its moving links [kg].
    """
    if payload <= 0:
        return "its motors do not hold its own links; are masses, lengths or efforts in other units?"
    if payload > _STRONG * mass and payload > _HEAVY:
        return f"{payload / mass:.3g} times its own mass; are masses, lengths or efforts in other units?"
    return ""


def moving_mass(robot: ET.Element) -> float:
    """The mass of the links that joints move [kg]."""
    root = root_link(robot)
    carrier = carriers(robot)
    return sum(mass_of(link) for link in robot.iterfind("link") if carrier[name_of(link)] != root)


def _joint_doubts(robot: ET.Element) -> Iterator[Doubt]:
    """Yield the doubtful offsets and limits of joints. Of the offsets only the first is reported."""
    for joint in robot.iterfind("joint"):
        away = float(np.linalg.norm(pose_of(joint).translation()))
        if away > _LONGEST:
            text = f"is {away:.4g} m from the joint before it; were millimetres meant? lengths of a URDF are in metres"
            yield Doubt(f"joint '{name_of(joint)}'", text)
            break
    for joint in robot.iterfind("joint"):
        lower, upper = joint_limits(joint)
        largest = max(-lower, upper)
        if not math.isfinite(largest):
            continue
        where = f"joint '{name_of(joint)}' <limit>"
        is_whole = abs(largest / math.pi - round(largest / math.pi)) < _WHOLE  # whoever writes 8 pi means radians
        if joint.get("type") == "revolute" and _MOST_TURNS < largest <= _ENDLESS and not is_whole:
            text = f"lower {lower:g}, upper {upper:g} rad are {largest / math.tau:.1f} turns; were degrees meant?"
            yield Doubt(where, text)
        elif joint.get("type") == "prismatic" and _LONGEST < largest <= _ENDLESS:
            yield Doubt(where, f"lower {lower:g}, upper {upper:g} m; were millimetres meant?")
