"""Plausibility checks for the numbers of a robot or a piece, which find the usual slips with units.

The same checks serve all robots, whatever file format they come from: each format is converted to a URDF. The checks
doubt only numbers far beyond those of real machines, so that a doubt is nearly always a slip.

The spread of a body, the sum of its principal moments of inertia divided by its mass, is a measure of its size: it does
not depend on the unit of mass. It is compared with the spread of the body's shapes.
"""

import math
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import message
from simrob_drake.robots.bodies import carriers
from simrob_drake.robots.shape_inertia import inertia_of_shapes
from simrob_drake.robots.urdf import (
    ENDLESS,
    joint_limits,
    link_of,
    mass_of,
    moments_of,
    name_of,
    pose_of,
    root_link,
)

# Bounds of plausible numbers. Slips with units are larger: grams for kilograms make a density 1e3 times as large,
# millimetres for metres 1e9 times as small, kg mm² for kg m² moments 1e6 times as large. Published robots reach the
# bounds if a shape represents something larger or smaller than itself.
HEAVIEST = 1e5
"""Largest density of a body [kg/m³]; gold has 2e4."""
LIGHTEST = 0.1
"""Smallest density of a body [kg/m³]; air has 1.2."""
# Plausible moments of inertia of a body, in multiples of those of a solid body with its mass and shapes.
_LEAST_MOMENTS = 1e-5
_MOST_MOMENTS = 1e3
_NEGLIGIBLE = 1e-3
"""Share of the robot's mass below which a link does not affect the motion [1]."""
_SMALLEST_VOLUME = 1e-6
"""Volume below which shapes are mere markers [m³]. A cube of 10 mm has this volume."""
# Plausible distance of a centre of mass from the middle of its shapes or, without shapes, from its link's joint:
# _FAR [m] plus _SIZES times the size of the shapes or of the link.
_FAR = 1.0
_SIZES = 2.0
_STRONG = 50.0
"""Largest plausible payload, in multiples of the robot's own mass [1]. Arms carry less than their own mass."""
_HEAVY = 100.0
"""Mass up to which a payload is plausible for any robot [kg]."""
_LONGEST = 30.0
"""Length of the longest plausible link of a robot [m]."""
_MOST_TURNS = 4 * math.pi
"""Largest plausible limit of a revolute joint, two turns [rad]. Limits in degrees are larger."""
_WHOLE = 1e-3
"""Deviation from a whole number of half turns below which a limit is such a number, rounded [half turns]."""


class Doubt(NamedTuple):
    """An implausible number.

    Attributes:
        where: name of the element, such as ``link 'rod' <inertial>``.
        text: the doubtful number, and what might have been meant.
    """

    where: str
    text: str


class MassProperties(NamedTuple):
    """Mass and its distribution, of a body, or of its shapes with an even density.

    Attributes:
        mass: mass [kg].
        centre: centre of mass, shape (3,) [m].
        trace: sum of the principal moments about the centre of mass [kg m²].
    """

    mass: float
    centre: Vector
    trace: float

    @property
    def spread(self) -> float:
        """Sum of the principal moments divided by the mass [m²]: twice the mean square distance from the centre."""
        return self.trace / self.mass


def robot_doubts(robot: ET.Element, folder: Path | None) -> list[Doubt]:
    """Find the implausible numbers of a robot: of its links with more than a negligible mass, then of its joints.

    Args:
        robot: a checked ``robot`` element.
        folder: folder of the robot's meshes. If it is None, meshes are left out.
    """
    sizes = _link_sizes(robot)
    links = robot.findall("link")
    total_mass = sum(mass_of(link) for link in links)
    doubts = list[Doubt]()
    # Light links, such as those of cables and markers, often have made-up inertias that change nothing.
    for link in links:
        if mass_of(link) > _NEGLIGIBLE * total_mass:
            doubts += _link_doubts(link, sizes[name_of(link)], folder)
    doubts += list(_joint_doubts(robot))
    return doubts


def _link_sizes(robot: ET.Element) -> dict[str, float]:
    """Estimate the size of each link from the joints at it, by link name [m].

    The offset of a joint is the distance of its frame from the frame of its parent link. The offsets of the joints that
    a link carries show how far the link reaches. A link at the end of the robot carries no joints, and is taken to be
    as large as the offset of its own joint. The size is the largest of all these offsets, and 0 for a link without
    joints.
    """
    sizes = {name_of(link): 0.0 for link in robot.iterfind("link")}
    for joint in robot.iterfind("joint"):
        offset = float(np.linalg.norm(pose_of(joint).translation()))
        for end in ("parent", "child"):
            link = link_of(joint, end)
            sizes[link] = max(sizes.get(link, 0.0), offset)
    return sizes


def _link_doubts(link: ET.Element, size: float, folder: Path | None) -> list[Doubt]:
    """Find the implausible numbers of a link's inertia.

    The inertia is compared with the link's shapes or, if it has none that are larger than markers, with its size.
    A link without ``<inertial>`` has no numbers to doubt.

    Args:
        link: a ``link`` element.
        size: size of the link by the joints at it [m].
        folder: folder of the robot's meshes. If it is None, meshes are left out.
    """
    inertial = link.find("inertial")
    if inertial is None:
        return []
    where = message("robots.inertial_of_link", "link '{link}' <inertial>", link=name_of(link))
    own = MassProperties(
        mass_of(link), pose_of(inertial).translation(), float(np.trace(moments_of(inertial)))
    )
    # With a density of 1 kg/m³ the mass of the shapes is their volume in m³.
    solid = inertia_of_shapes(link, folder, 1.0)
    if solid is None or solid.get_mass() < _SMALLEST_VOLUME:
        return [Doubt(where, text) for text in _doubts_by_size(own, size)]
    # The trace of the moments does not depend on the axes, so that nothing has to be turned.
    centre = solid.get_com()
    moments = solid.Shift(centre).CalcRotationalInertia().CopyToFullMatrix3()
    shapes = MassProperties(solid.get_mass(), centre, float(np.trace(moments)))
    return [Doubt(where, text) for text in doubts_by_shapes(own, shapes)]


def doubts_by_shapes(own: MassProperties, shapes: MassProperties) -> list[str]:
    """Compare the mass and inertia of a body with its shapes. Returns a text for each doubt.

    Args:
        own: mass properties of the body.
        shapes: mass properties of its shapes with a density of 1 kg/m³, so that their mass [kg] is their volume [m³].
    """
    texts = list[str]()
    density = own.mass / shapes.mass
    if not LIGHTEST <= density <= HEAVIEST:
        texts.append(
            message(
                "robots.odd_density",
                "a mass of {mass:g} kg in {volume:.3g} m³ is a density of {density:.3g} kg/m³; "
                "were grams or millimetres meant?",
                mass=own.mass,
                volume=shapes.mass,
                density=density,
            )
        )
    # Moments of shapes that lie absurdly far from the frame are lost in rounding; "not > 0" covers NaN, too.
    if not shapes.spread > 0:
        return texts
    apart = float(np.linalg.norm(own.centre - shapes.centre))
    size_of_shapes = math.sqrt(shapes.spread)
    if apart > _FAR + _SIZES * size_of_shapes:
        texts.append(
            message(
                "robots.far_from_shapes",
                "its centre of mass is {distance:.3g} m from the middle of its shapes; were millimetres meant?",
                distance=apart,
            )
        )
    # The masses cancel out: a wrong unit of mass is found above, by the density.
    ratio = own.spread / shapes.spread
    # Moments of exactly 0 are no slip with units: they describe a point mass.
    if ratio > _MOST_MOMENTS or 0 < ratio < _LEAST_MOMENTS:
        texts.append(
            message(
                "robots.odd_moments",
                "its moments are {ratio:.3g} times those of a solid body of its mass and shapes",
                ratio=ratio,
            )
        )
    return texts


def _doubts_by_size(own: MassProperties, size: float) -> list[str]:
    """Compare the inertia of a link without shapes with its size. Returns a text for each doubt.

    Args:
        own: mass properties of the link.
        size: size of the link by the joints at it [m].
    """
    # The frame of a link is at its own joint, so that the length of the vector is the distance from this joint.
    texts = list[str]()
    apart = float(np.linalg.norm(own.centre))
    if apart > _FAR + _SIZES * size:
        texts.append(
            message(
                "robots.far_from_joint",
                "its centre of mass is {distance:.3g} m from its joint, but its joints are only {size:.3g} m apart; "
                "were millimetres meant?",
                distance=apart,
                size=size,
            )
        )
    # The spread is twice the mean square distance from the centre of mass, so that this is the root mean square [m].
    gyration = math.sqrt(own.spread / 2)
    # The joints show no size of a link at the end of the robot. The distance of its centre of mass counts as one, too.
    if gyration > _FAR + _SIZES * max(size, apart):
        moments = message(
            "robots.moments_of_mass",
            "its moments are those of a mass of {mass:.4g} kg at {gyration:.3g} m from the centre of mass",
            mass=own.mass,
            gyration=gyration,
        )
        texts.append(
            message(
                "robots.moments_and_joints",
                "{moments}, but its joints are only {size:.3g} m apart; were kg mm² or g m² meant?",
                moments=moments,
                size=size,
            )
        )
    return texts


def payload_doubt(payload: float, mass: float) -> str:
    """Write the doubt about the mass that a robot can hold. Returns an empty text if the mass is plausible.

    Args:
        payload: mass that the robot's motors can hold at rest [kg].
        mass: mass of the robot's moving links [kg].
    """
    if payload <= 0:
        return message(
            "robots.motors_too_weak",
            "its motors cannot hold its own links; are masses, lengths or efforts in other units?",
        )
    # Small robots with strong servos carry many times their own mass, and large ones carry tonnes: only both together
    # are implausible.
    if payload > _STRONG * mass and payload > _HEAVY:
        return message(
            "robots.payload_too_large",
            "{ratio:.3g} times its own mass; are masses, lengths or efforts in other units?",
            ratio=payload / mass,
        )
    return ""


def moving_mass(robot: ET.Element) -> float:
    """Compute the mass of the links that joints move [kg], to be compared with a payload by :func:`payload_doubt`."""
    root = root_link(robot)
    # Links that fixed joints connect to the root have the root as their carrier: no joint moves them.
    carrier_of_link = carriers(robot)
    return sum(
        mass_of(link) for link in robot.iterfind("link") if carrier_of_link[name_of(link)] != root
    )


def _joint_doubts(robot: ET.Element) -> Iterator[Doubt]:
    """Yield the first implausible offset of a robot's joints, then all implausible limits."""
    # A slip with units affects all offsets, so only the first implausible one is reported.
    for joint in robot.iterfind("joint"):
        offset = float(np.linalg.norm(pose_of(joint).translation()))
        if offset > _LONGEST:
            question = message(
                "robots.were_millimetres_meant",
                "were millimetres meant? lengths of a URDF are in metres",
            )
            text = message(
                "robots.far_from_last_joint",
                "is {offset:.4g} m from the joint before it; {question}",
                offset=offset,
                question=question,
            )
            yield Doubt(
                message("robots.joint_called", "joint '{joint}'", joint=name_of(joint)), text
            )
            break
    for joint in robot.iterfind("joint"):
        doubt = _limit_doubt(joint)
        if doubt:
            yield Doubt(
                message("robots.limit_of_joint", "joint '{joint}' <limit>", joint=name_of(joint)),
                doubt,
            )


def _limit_doubt(joint: ET.Element) -> str:
    """Write the doubt about the limits of a joint: lengths in millimetres, or angles in degrees.

    Returns an empty text if they are plausible, or if the joint has no limits.
    """
    # A joint without limits, or with the huge numbers by which some files say so, has no numbers to doubt.
    lower, upper = joint_limits(joint)
    largest = max(-lower, upper)
    if not math.isfinite(largest) or largest > ENDLESS:
        return ""
    if joint.get("type") == "prismatic" and largest > _LONGEST:
        return message(
            "robots.limits_in_millimetres",
            "lower {lower:g}, upper {upper:g} m; were millimetres meant?",
            lower=lower,
            upper=upper,
        )
    # A limit such as 8 pi is a whole number of half turns, and was certainly meant in radians.
    half_turns = largest / math.pi
    is_whole = abs(half_turns - round(half_turns)) < _WHOLE
    if joint.get("type") == "revolute" and largest > _MOST_TURNS and not is_whole:
        return message(
            "robots.limits_in_degrees",
            "lower {lower:g}, upper {upper:g} rad are {turns:.1f} turns; were degrees meant?",
            lower=lower,
            upper=upper,
            turns=largest / math.tau,
        )
    return ""
