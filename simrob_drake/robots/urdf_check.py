"""Find the defects of a URDF before Drake reads it.

Drake accepts some defects without a warning. Others fail an assertion, which may end the process.
"""

import math
import re
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Callable
from functools import lru_cache, partial
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

from simrob_drake.base.errors import InvalidModel
from simrob_drake.base.file_cache import FileState, file_state
from simrob_drake.base.messages import compound, join_texts, message
from simrob_drake.robots.urdf import (
    DRAKE,
    LIMITED_JOINTS,
    MOMENTS,
    MOVABLE_JOINTS,
    copy_of,
    driven_joints,
    impossible,
    joint_value,
    link_of,
    mass_of,
    moments_of,
    name_of,
    read_urdf,
    transmissions_of,
)

NUMBER_COUNTS = {
    **dict.fromkeys(("xyz", "rpy", "size"), (3,)),
    **dict.fromkeys(
        (
            "lower",
            "upper",
            "effort",
            "velocity",
            "damping",
            "friction",
            "radius",
            "length",
            "value",
        ),
        (1,),
    ),
    **dict.fromkeys((*MOMENTS, "multiplier", "offset"), (1,)),
    # One number scales all directions of a mesh.
    "scale": (1, 3),
    "rgba": (4,),
}
"""Counts of numbers that each attribute may have."""

SHAPE_SIZES = {
    "box": {"size": 3},
    "sphere": {"radius": 1},
    "cylinder": {"radius": 1, "length": 1},
    # Drake reads a capsule with and without its namespace, and an ellipsoid only with it.
    "capsule": {"radius": 1, "length": 1},
    f"{DRAKE}capsule": {"radius": 1, "length": 1},
    f"{DRAKE}ellipsoid": {"a": 1, "b": 1, "c": 1},
}
"""Sizes of each shape that is no mesh, with their counts of numbers."""

MOST_LINKS = 3000
"""Largest count of links of a robot. With 3000 joints, the dense matrices of Drake take 1.2 GB."""

NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?", re.ASCII)
"""A decimal number, with or without an exponent. Python's float() would also accept "1_000", "nan" and other digits."""

_WORLD = "world"
"""Name of the link that every plant of Drake has."""

Refuse = Callable[[str, str], InvalidModel]
"""Function that makes the error for a defect from the element, such as ``joint 'elbow'``, and the problem in words."""


def checked_urdf(path: Path) -> ET.Element:
    """Read a URDF file and check it for defects. Returns a copy of its ``robot`` element.

    Raises:
        InvalidModel: the file cannot be read or has a defect; names the element and what would be right.
    """
    return copy_of(_read_and_check(path, file_state(path)))


@lru_cache(maxsize=64)
def _read_and_check(path: Path, state: FileState | None) -> ET.Element:
    """Read and check a URDF file. Results are cached until the file changes.

    Args:
        path: the file.
        state: state of the file. The function does not read it: it is part of the cache's key, so that a changed file
            is read again. It also distinguishes files that have one relative path from different folders.
    """
    root = read_urdf(path)
    check_urdf(root, path)
    return root


def check_urdf(root: ET.Element, path: Path) -> None:
    """Check a URDF for the defects that fail an assertion in Drake, or that Drake accepts without a warning.

    Args:
        root: the ``robot`` element.
        path: the file, for messages.

    Raises:
        InvalidModel: the URDF has a defect; names the file, the element and what would be right.
    """
    # The order matters: numbers are checked before other checks convert them, and the tree before its joints.
    refuse = partial(InvalidModel, path)
    check_size(root, refuse)
    for element in (*root.iterfind("link"), *root.iterfind("joint"), *root.iterfind("material")):
        _check_numbers(element, refuse)
    _check_tree(root, refuse)
    for joint in root.iterfind("joint"):
        _check_joint(joint, refuse)
    for link in root.iterfind("link"):
        _check_inertial(link, refuse)
        for shape in link.iterfind("*/geometry/*"):
            problem = shape_defect(shape)
            if problem:
                raise refuse(
                    message(
                        "robots.tag_of_link",
                        "link '{link}' <{tag}>",
                        link=name_of(link),
                        tag=shape.tag,
                    ),
                    problem,
                )
    _check_actuators(root, refuse)
    _check_materials(root, refuse)


def check_size(root: ET.Element, refuse: Refuse) -> None:
    """Check that a robot does not have more links than Drake has memory for.

    Args:
        root: the ``robot`` element.
        refuse: makes the error.

    Raises:
        InvalidModel: the robot has too many links.
    """
    count = len(root.findall("link"))
    if count > MOST_LINKS:
        raise refuse(
            "",
            message(
                "robots.too_many_links",
                "has {count} links; at most {most} are accepted, since memory grows with the square of their count",
                count=count,
                most=MOST_LINKS,
            ),
        )


def _check_numbers(element: ET.Element, refuse: Refuse) -> None:
    """Check the count and the form of the numbers in an element and its children.

    Args:
        element: a link, a joint or a material.
        refuse: makes the error.

    Raises:
        InvalidModel: an attribute has a wrong count of numbers, or a word that is no finite number.
    """
    # One table serves all elements: an attribute has the same form wherever a URDF has it.
    owner = compound("{tag} '{name_of}'", tag=element.tag, name_of=name_of(element))
    for part in element.iter():
        for key, counts in NUMBER_COUNTS.items():
            if key not in part.attrib:
                continue
            where = f"{owner} <{part.tag}>"
            text = part.attrib[key]
            words = text.split()
            if len(words) not in counts:
                expected = join_texts([str(count) for count in counts], message("base.or", " or "))
                raise refuse(
                    where,
                    message(
                        "robots.count_of_numbers",
                        '{key}="{text}" has {count} {count:number|numbers}; it must have {expected}',
                        key=key,
                        text=text,
                        count=len(words),
                        expected=expected,
                    ),
                )
            for word in words:
                # Words for such numbers get another message than mistyped ones: some exporters write them.
                if word.lower().lstrip("+-") in ("nan", "inf", "infinity"):
                    raise refuse(
                        where, message("robots.not_finite", "'{text}' is not finite", text=text)
                    )
                if not NUMBER.fullmatch(word):
                    raise refuse(
                        where, message("robots.not_a_number", "'{text}' is not a number", text=text)
                    )
                # A number such as 1e999 has the right form, but is infinite as a double.
                if not math.isfinite(float(word)):
                    raise refuse(
                        where, message("robots.not_finite", "'{text}' is not finite", text=text)
                    )


def _check_tree(root: ET.Element, refuse: Refuse) -> None:
    """Check that names are unique, and that the joints connect all links to a tree with one root.

    Args:
        root: the ``robot`` element.
        refuse: makes the error.

    Raises:
        InvalidModel: a name is missing, occurs twice or is ``world``; a joint names an unknown link; or the links and
            joints are no tree.
    """
    for tag in ("link", "joint"):
        names = [name_of(element) for element in root.iterfind(tag)]
        # An element without a name can be described by its position in the file only.
        if "" in names:
            raise refuse(
                message(
                    "robots.element_number",
                    "<{tag}> number {index}",
                    tag=tag,
                    index=names.index("") + 1,
                ),
                message("robots.without_name", "has no name"),
            )
        repeated = [name for name, count in Counter(names).items() if count > 1]
        for name in repeated:
            raise refuse(
                f"{tag} '{name}'",
                message("robots.name_twice", "is defined twice; names must be unique"),
            )
    # A dict as a set that keeps the order of the file, for the message about root links.
    links = {name_of(link): None for link in root.iterfind("link")}
    # Drake would take a link of this name for its world, and fix the robot to it.
    if _WORLD in links:
        raise refuse(
            message("robots.link_called", "link '{link}'", link=_WORLD),
            message("robots.name_of_the_world", "has the name of Drake's own world; rename it"),
        )
    for joint in root.iterfind("joint"):
        for end in ("parent", "child"):
            if link_of(joint, end) not in links:
                raise refuse(
                    message("robots.joint_called", "joint '{joint}'", joint=name_of(joint)),
                    message(
                        "robots.no_such_link",
                        "its {end} '{link}' is not a link of the robot",
                        end=end,
                        link=link_of(joint, end),
                    ),
                )
    parents = check_parents(root, refuse)
    roots = [link for link in links if link not in parents]
    # No root at all means that the file has no links: a loop has been refused before.
    if len(roots) != 1:
        # A few names are enough to find the place: a robot in pieces can have hundreds of roots.
        listed = f" ({', '.join(roots[:5])})" if roots else ""
        raise refuse(
            "",
            message(
                "robots.root_links",
                "has {count} root links{names}; a URDF must be a tree with one root link",
                count=len(roots),
                names=listed,
            ),
        )


def check_parents(root: ET.Element, refuse: Refuse) -> dict[str, str]:
    """Find the parent of each link, and check that no link has two parents and no joints form a loop.

    Args:
        root: the ``robot`` element.
        refuse: makes the error.

    Returns:
        the name of the parent link, by the name of the child link.

    Raises:
        InvalidModel: a joint connects a link with itself, a link is the child of two joints, or joints form a loop.
    """
    # The joint whose child each link is, by the name of the link.
    holders: dict[str, ET.Element] = {}
    for joint in root.iterfind("joint"):
        child = link_of(joint, "child")
        if link_of(joint, "parent") == child:
            raise refuse(
                message("robots.joint_called", "joint '{joint}'", joint=name_of(joint)),
                message("robots.joins_to_itself", "connects link '{child}' to itself", child=child),
            )
        if child in holders:
            both = message(
                "robots.two_joints",
                "'{first}' and '{second}'",
                first=name_of(holders[child]),
                second=name_of(joint),
            )
            raise refuse(
                message("robots.link_called", "link '{link}'", link=child),
                message(
                    "robots.child_of_two",
                    "is the child of two joints, {both}; a URDF must be a tree",
                    both=both,
                ),
            )
        holders[child] = joint
    # Each link now has one parent at most, so that only a cycle of parents can be left as a loop. Links in the order of
    # the file make the message the same every time.
    parents = {child: link_of(joint, "parent") for child, joint in holders.items()}
    child_links = [name for name in map(name_of, root.iterfind("link")) if name in parents]
    try:
        TopologicalSorter({name: [parents[name]] for name in child_links}).prepare()
    except CycleError as problem:
        loop = " - ".join(problem.args[1])
        raise refuse(
            "",
            message(
                "robots.loop",
                "has a kinematic loop: {loop}; a URDF must be a tree, so remove one joint",
                loop=loop,
            ),
        ) from None
    return parents


def _check_joint(joint: ET.Element, refuse: Refuse) -> None:
    """Check type, axis, limits and damping of a joint, and that it does not mimic another one.

    Of a fixed joint only the type is checked.

    Args:
        joint: the joint.
        refuse: makes the error.

    Raises:
        InvalidModel: one of these is wrong.
    """
    where = message("robots.joint_called", "joint '{joint}'", joint=name_of(joint))
    kind = joint.get("type", "")
    if kind not in (*MOVABLE_JOINTS, "fixed"):
        known = ", ".join((*MOVABLE_JOINTS, "fixed"))
        raise refuse(
            where,
            message(
                "robots.type_of_joint",
                "its type is '{kind}'; a station's robot has joints of the types {known}",
                kind=kind,
                known=known,
            ),
        )
    if kind == "fixed":
        return
    # Drake applies a mimic under discrete solvers only. An import writes it in a form that stations read.
    if joint.find("mimic") is not None:
        raise refuse(
            where,
            message(
                "robots.mimics",
                "mimics another joint; convert the robot with `simrob import`, so that stations couple the two joints",
            ),
        )
    # A vector of any length except zero gives a direction.
    axis = joint.find("axis")
    if axis is not None and not any(float(number) for number in axis.get("xyz", "1 0 0").split()):
        raise refuse(
            compound("{where} <axis>", where=where),
            message("robots.zero_axis", "is zero; it must be a direction"),
        )
    _check_limit(joint, where, refuse)
    # Negative damping would drive the joint faster and faster.
    if joint_value(joint, "damping", "dynamics") < 0:
        raise refuse(
            compound("{where} <dynamics>", where=where),
            message("robots.negative_damping", "damping is negative"),
        )


def _check_limit(joint: ET.Element, where: str, refuse: Refuse) -> None:
    """Check the ``<limit>`` of a joint, whose attributes are known to be numbers.

    Args:
        joint: the joint.
        where: the joint, for messages.
        refuse: makes the error.

    Raises:
        InvalidModel: limits that the type of the joint needs are missing, only one limit is given, the lower limit is
            not below the upper one, or speed or effort are negative.
    """
    limit = joint.find("limit")
    if limit is None:
        if joint.get("type") in LIMITED_JOINTS:
            raise refuse(
                where,
                message("robots.needs_limit", "a revolute or prismatic joint needs a <limit>"),
            )
        return
    # A continuous joint may have limits, and then needs both: a missing one is 0 by the definition of URDF, which is
    # hardly meant.
    where = compound("{where} <limit>", where=where)
    if "lower" in limit.attrib or "upper" in limit.attrib or joint.get("type") in LIMITED_JOINTS:
        missing = [key for key in ("lower", "upper") if key not in limit.attrib]
        if missing:
            raise refuse(
                where,
                message(
                    "robots.has_no",
                    "has no {missing}",
                    missing=join_texts(missing, message("robots.and_no", " and no ")),
                ),
            )
        # Equal limits describe a joint that cannot move, for which a URDF has the type "fixed".
        lower = float(limit.attrib["lower"])
        upper = float(limit.attrib["upper"])
        if lower >= upper:
            raise refuse(
                where,
                message(
                    "robots.lower_not_below_upper",
                    "lower {lower:g} is not below upper {upper:g}",
                    lower=lower,
                    upper=upper,
                ),
            )
    for key in ("velocity", "effort"):
        if float(limit.get(key, 0)) < 0:
            raise refuse(
                where,
                message(
                    "robots.negative_value",
                    "{key} {value} is negative",
                    key=key,
                    value=limit.get(key),
                ),
            )


def _check_inertial(link: ET.Element, refuse: Refuse) -> None:
    """Check that a link has no inertia, or one that a body can have.

    Args:
        link: the link.
        refuse: makes the error.

    Raises:
        InvalidModel: ``<mass>`` or ``<inertia>`` is missing, the mass is negative, there are moments without mass, or
            no body can have such moments.
    """
    inertial = link.find("inertial")
    if inertial is None:
        return
    where = message("robots.inertial_of_link", "link '{link}' <inertial>", link=name_of(link))
    mass = inertial.find("mass")
    inertia = inertial.find("inertia")
    if mass is None or inertia is None:
        raise refuse(where, message("robots.needs_mass_and_inertia", "needs <mass> and <inertia>"))
    if mass_of(link) < 0:
        raise refuse(
            where,
            message("robots.negative_mass", "mass {mass} kg is negative", mass=mass.get("value")),
        )
    # A link without mass and moments is a mere frame, which is allowed.
    moments = moments_of(inertial)
    if mass_of(link) == 0 and moments.diagonal().any():
        raise refuse(
            where,
            message(
                "robots.moments_without_mass",
                "has moments of inertia but no mass; Drake would assume 1 kg without a warning",
            ),
        )
    # Drake would replace impossible moments by those of a sphere without a warning.
    problem = impossible(moments)
    if problem:
        raise refuse(where, problem)


def shape_defect(shape: ET.Element) -> str:
    """Write the defect in the sizes of a shape, or that a mesh has no ``filename``. Returns an empty text if neither.

    Args:
        shape: child of a ``<geometry>``, such as a ``<box>``. Shapes of unknown tags have no defect.
    """
    if shape.tag == "mesh" and "filename" not in shape.attrib:
        return message("robots.has_no_filename", "has no filename")
    for key, count in SHAPE_SIZES.get(shape.tag, {}).items():
        text = shape.get(key)
        if text is None:
            return message("robots.has_no_key", "has no {key}", key=key)
        # A size of 0 would make a flat shape, which has no volume and no contact.
        numbers = numbers_in(text)
        if numbers is None or len(numbers) != count:
            return message(
                "robots.words_where_numbers",
                'has {key}="{text}"; it must have {count} positive {count:number|numbers}',
                key=key,
                text=text,
                count=count,
            )
        if not all(number > 0 for number in numbers):
            return message(
                "robots.not_positive",
                'has {key}="{text}"; it must be positive',
                key=key,
                text=text,
            )
    return ""


def numbers_in(text: str) -> list[float] | None:
    """Read the numbers in a text, or return None if one of its words is no finite number."""
    words = text.split()
    if not all(NUMBER.fullmatch(word) for word in words):
        return None
    numbers = [float(word) for word in words]
    return numbers if all(map(math.isfinite, numbers)) else None


def _check_materials(root: ET.Element, refuse: Refuse) -> None:
    """Check that each material has a colour, its own or that of another material of its name.

    Drake reads nothing else of a material. Materials of visuals are checked only if they have a name.

    Args:
        root: the ``robot`` element.
        refuse: makes the error.

    Raises:
        InvalidModel: a material has no colour, or a texture.
    """
    materials = [*root.iterfind("material"), *root.iterfind("link/visual/material[@name]")]
    defined = {
        name_of(material) for material in materials if material.find("color[@rgba]") is not None
    }
    for material in materials:
        if material.find("texture") is not None or name_of(material) not in defined:
            raise refuse(
                message("robots.material_called", "material '{name}'", name=name_of(material)),
                message(
                    "robots.material_needs",
                    "needs a name and a colour, and must not have a texture",
                ),
            )


def _check_actuators(root: ET.Element, refuse: Refuse) -> None:
    """Check that every joint that moves has one motor that Drake reads, or is passive.

    A joint is passive if other joints have motors, and either no transmission drives this joint or its file states an
    effort of 0. In a file without any motor, no joint counts as passive: the file does not describe motors at all.

    Args:
        root: the ``robot`` element.
        refuse: makes the error.

    Raises:
        InvalidModel: the robot has no motors, or a joint has two transmissions, one of another type, or no positive
            effort although it is not passive.
    """
    transmissions = transmissions_of(root)
    joints = [joint for joint in root.iterfind("joint") if joint.get("type") in MOVABLE_JOINTS]
    has_motors = bool(driven_joints(root))
    for joint in joints:
        own = transmissions.get(name_of(joint), [])
        where = message("robots.joint_called", "joint '{joint}'", joint=name_of(joint))
        if not own and not has_motors:
            missing = message(
                "robots.no_transmission",
                "has no <transmission>, so that no motor can move it; add one",
            )
            raise refuse(where, missing)
        # Another joint has a motor, so that this one is passive.
        if not own:
            continue
        # Drake would make two actuators, and a servo commands only one of them.
        if len(own) > 1:
            raise refuse(where, message("robots.two_transmissions", "has two transmissions"))
        if not (own[0].findtext("type") or "").strip().endswith("SimpleTransmission"):
            expected = message(
                "robots.simple_transmission",
                "the <type> of its transmission must be SimpleTransmission: Drake makes motors of no other type",
            )
            raise refuse(where, expected)
        limit = joint.find("limit")
        is_stated = limit is not None and "effort" in limit.attrib
        # An effort of 0 that the file states is meant if other joints have more: the joint is passive.
        is_passive = is_stated and has_motors
        if joint_value(joint, "effort") <= 0 and not is_passive:
            raise refuse(
                compound("{where} <limit>", where=where),
                message(
                    "robots.effort_not_positive",
                    "the effort must be positive [N·m or N], or the motor cannot move the joint",
                ),
            )
