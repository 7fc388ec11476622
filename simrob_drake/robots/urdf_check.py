"""Find the defects of a URDF before Drake does, where a failed assertion could end the process."""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ET
from collections.abc import Callable
from pathlib import Path

from simrob_drake.errors import InvalidModel
from simrob_drake.robots.urdf import LIMITED_JOINTS, MOVABLE_JOINTS, link_of, mass_of, name_of
from simrob_drake.robots.urdf_elements import MOMENTS, impossible, moments_of

_NUMBERS = {
    **dict.fromkeys(("xyz", "rpy", "size"), (3,)),
    **dict.fromkeys(("lower", "upper", "effort", "velocity", "damping", "friction", "radius", "length", "value"), (1,)),
    **dict.fromkeys(MOMENTS, (1,)),
    "scale": (1, 3),
    "rgba": (4,),
}
"""How many numbers each attribute holds."""

_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?", re.ASCII)
_WORLD = "world"  # Drake's own link


def check_urdf(root: ET.Element, path: Path) -> None:
    """Check all that Drake would refuse with an assertion or accept in silence.

    Raises:
        InvalidModel: names the file, the element and what would be right.
    """

    def refuse(element: str, problem: str) -> InvalidModel:
        return InvalidModel(path, element, problem)

    for element in (*root.iterfind("link"), *root.iterfind("joint"), *root.iterfind("material")):
        _check_numbers(element, refuse)
    _check_tree(root, refuse)
    for joint in root.iterfind("joint"):
        _check_joint(joint, refuse)
    for link in root.iterfind("link"):
        _check_inertial(link, refuse)
        for shape in link.iterfind("*/geometry/*"):
            _check_shape(shape, f"link '{name_of(link)}'", refuse)
    _check_actuators(root, refuse)


_Refuse = Callable[[str, str], InvalidModel]


def _check_numbers(element: ET.Element, refuse: _Refuse) -> None:
    """Check that every number is one, and that there are as many as there must be."""
    for part in element.iter():
        for key, counts in _NUMBERS.items():
            if key not in part.attrib:
                continue
            where, text = f"{element.tag} '{name_of(element)}' <{part.tag}>", part.attrib[key]
            words = text.split()
            if len(words) not in counts:
                expected = " or ".join(str(count) for count in counts)
                raise refuse(where, f'{key}="{text}" holds {len(words)} numbers, not {expected}')
            for word in words:
                if word.lower().lstrip("+-") in ("nan", "inf", "infinity"):
                    raise refuse(where, f"'{text}' is not finite")
                if not _NUMBER.fullmatch(word):
                    raise refuse(where, f"'{text}' is not a number")
                if not math.isfinite(float(word)):
                    raise refuse(where, f"'{text}' is not finite")


def _check_tree(root: ET.Element, refuse: _Refuse) -> None:
    for tag in ("link", "joint"):
        names = [name_of(element) for element in root.iterfind(tag)]
        for index, name in enumerate(names):
            if not name:
                raise refuse(f"<{tag}> number {index + 1}", "has no name")
            if name in names[:index]:
                raise refuse(f"{tag} '{name}'", "stands twice; names are unique")
    _check_ends(root, refuse)


def _check_ends(root: ET.Element, refuse: _Refuse) -> None:
    links = [name_of(link) for link in root.iterfind("link")]
    if _WORLD in links:
        raise refuse(f"link '{_WORLD}'", "has the name of Drake's own world; rename it")
    parents: dict[str, str] = {}
    for joint in root.iterfind("joint"):
        where, parent, child = f"joint '{name_of(joint)}'", link_of(joint, "parent"), link_of(joint, "child")
        for end, link in (("parent", parent), ("child", child)):
            if link not in links:
                raise refuse(where, f"its {end} '{link}' is no link")
        if parent == child:
            raise refuse(where, f"its parent and its child are both '{child}'")
        if child in parents:
            raise refuse(f"link '{child}'", "is the child of two joints; a URDF is a tree")
        parents[child] = parent
    _check_roots(links, parents, refuse)


def _check_roots(links: list[str], parents: dict[str, str], refuse: _Refuse) -> None:
    """Check that every link leads to the one root, and none round in a loop."""
    for link in links:
        seen = [link]
        while seen[-1] in parents:
            seen.append(parents[seen[-1]])
            if seen[-1] in seen[:-1]:
                loop = seen[seen.index(seen[-1]) :]
                raise refuse("", f"has a loop: {' - '.join(reversed(loop))}; a URDF is a tree")
    roots = [link for link in links if link not in parents]
    if len(roots) != 1:
        listed = f" ({', '.join(roots[:5])})" if roots else ""
        raise refuse("", f"has {len(roots)} root links{listed}; a URDF is a tree with one root")


def _check_joint(joint: ET.Element, refuse: _Refuse) -> None:
    where, kind = f"joint '{name_of(joint)}'", joint.get("type", "")
    if kind not in (*MOVABLE_JOINTS, "fixed"):
        known = ", ".join((*MOVABLE_JOINTS, "fixed"))
        raise refuse(where, f"its type is '{kind}'; a station's robot has joints of the types {known}")
    if kind == "fixed":
        return
    if joint.find("mimic") is not None:
        raise refuse(where, "mimics another joint, which no solver but a discrete one can do; give it a motor instead")
    axis = joint.find("axis")
    if axis is not None and not any(float(number) for number in axis.get("xyz", "1 0 0").split()):
        raise refuse(f"{where} <axis>", "is zero; it is a direction")
    _check_limit(joint, where, refuse)
    dynamics = joint.find("dynamics")
    if dynamics is not None and float(dynamics.get("damping", 0)) < 0:
        raise refuse(f"{where} <dynamics>", "damping is negative")


def _check_limit(joint: ET.Element, where: str, refuse: _Refuse) -> None:
    limit = joint.find("limit")
    if limit is None:
        if joint.get("type") in LIMITED_JOINTS:
            raise refuse(where, "a revolute or prismatic joint needs a <limit>")
        return
    where = f"{where} <limit>"
    if "lower" in limit.attrib or "upper" in limit.attrib or joint.get("type") in LIMITED_JOINTS:
        missing = [key for key in ("lower", "upper") if key not in limit.attrib]
        if missing:
            raise refuse(where, f"has no {' and no '.join(missing)}")
        lower, upper = float(limit.attrib["lower"]), float(limit.attrib["upper"])
        if lower >= upper:
            raise refuse(where, f"lower {lower:g} is not below upper {upper:g}")
    for key in ("velocity", "effort"):
        if float(limit.get(key, 0)) < 0:
            raise refuse(where, f"{key} {limit.get(key)} is negative")


def _check_inertial(link: ET.Element, refuse: _Refuse) -> None:
    inertial = link.find("inertial")
    if inertial is None:
        return
    where = f"link '{name_of(link)}' <inertial>"
    mass, inertia = inertial.find("mass"), inertial.find("inertia")
    if mass is None or inertia is None:
        raise refuse(where, "needs <mass> and <inertia>")
    if mass_of(link) < 0:
        raise refuse(where, f"mass {mass.get('value')} kg is negative")
    moments = moments_of(inertial)
    if mass_of(link) == 0 and moments.diagonal().any():
        raise refuse(where, "has moments of inertia but no mass; Drake would give it 1 kg in silence")
    problem = impossible(moments)  # Drake would put a sphere's in silence
    if problem:
        raise refuse(where, problem)


def _check_shape(shape: ET.Element, where: str, refuse: _Refuse) -> None:
    needed = {"box": ("size",), "cylinder": ("radius", "length"), "sphere": ("radius",), "mesh": ("filename",)}
    where = f"{where} <{shape.tag}>"
    for key in needed.get(shape.tag, ()):
        if key not in shape.attrib:
            raise refuse(where, f"has no {key}")
    for key in ("size", "radius", "length"):
        if not all(float(number) > 0 for number in shape.get(key, "").split()):
            raise refuse(where, f"size '{shape.get(key)}' is not positive")


def _check_actuators(root: ET.Element, refuse: _Refuse) -> None:
    actuated = [(name_of(joint), drive) for drive in root.iterfind("transmission") for joint in drive.iterfind("joint")]
    for joint in root.iterfind("joint"):
        if joint.get("type") not in MOVABLE_JOINTS:
            continue
        where = f"joint '{name_of(joint)}'"
        drives = [drive for name, drive in actuated if name == name_of(joint)]
        if len(drives) != 1:
            problem = (
                "has no <transmission>, so no motor can move it; add one" if not drives else "has two transmissions"
            )
            raise refuse(where, problem)
        if not (drives[0].findtext("type") or "").strip().endswith("SimpleTransmission"):
            raise refuse(
                where, "Drake makes motors of a SimpleTransmission only; change the <type> of its transmission"
            )
        limit = joint.find("limit")
        if limit is None or float(limit.get("effort", 0)) <= 0:
            raise refuse(f"{where} <limit>", "effort is not positive [N·m], so its motor could not move it")
