"""Mend malformed numbers, so that all that comes later can trust ``float()``."""

import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from dataclasses import dataclass

from simrob_drake.errors import shortened
from simrob_drake.importer.options import ImportReport
from simrob_drake.robots.urdf import DRAKE, MOMENTS, name_of
from simrob_drake.robots.urdf_check import NUMBER, NUMBER_COUNTS

LARGEST = 1e30
"""Larger figures count as infinite: no length, mass or torque is near it, and their squares would overflow."""

SMALLEST = 1e-30  # smaller ones count as zero

_UNITS = {"xyz": "m", "size": "m", "radius": "m", "length": "m", "rpy": "rad", "lower": "rad", "upper": "rad"}
_CHECKED = ("link", "joint", "material")
_LEFTOVER = re.compile(r"\$\{.*?\}|\$\(.*?\)")


@dataclass(frozen=True)
class _Rule:
    """How many numbers an attribute holds, and what stands for unreadable ones."""

    counts: tuple[int, ...] = (1,)
    default: str | None = None  # None removes the attribute, so that it counts as missing
    needed: bool = False  # nothing can be put in their place


_ZERO = _Rule((3,), "0 0 0")
_RULES: dict[tuple[str, str], _Rule] = {
    **{(tag, key): _ZERO for tag in ("origin", "frame") for key in ("xyz", "rpy")},
    ("axis", "xyz"): _Rule((3,), needed=True),
    **{("limit", key): _Rule() for key in ("lower", "upper", "effort", "velocity", f"{DRAKE}acceleration")},
    **{("dynamics", key): _Rule(default="0") for key in ("damping", "friction")},
    ("mass", "value"): _Rule(),
    **{("inertia", key): _Rule() for key in MOMENTS},
    **{(tag, "radius"): _Rule() for tag in ("cylinder", "sphere", "capsule", f"{DRAKE}capsule")},
    **{(tag, "length"): _Rule() for tag in ("cylinder", "capsule", f"{DRAKE}capsule")},
    **{(f"{DRAKE}ellipsoid", key): _Rule() for key in "abc"},
    ("box", "size"): _Rule((3,)),
    ("mesh", "scale"): _Rule((1, 3)),
    ("color", "rgba"): _Rule((3, 4)),
    (f"{DRAKE}gear_ratio", "value"): _Rule(),
    (f"{DRAKE}rotor_inertia", "value"): _Rule(),
}  # by tag and attribute

_ANYWHERE = {key: _Rule(counts) for key, counts in NUMBER_COUNTS.items()}
"""By attribute alone: the rule of places where no reader looks, but where the check wants numbers all the same."""


def mend_numbers(robot: ET.Element, report: ImportReport) -> None:
    """Mend every number of a robot that is malformed, in place.

    Decimal commas, commas between numbers, brackets and units of the SI are understood. What is not becomes the default
    of its attribute where there is one, and is removed otherwise, so that it counts as missing. Raises InvalidModel: an
    expression of xacro was not expanded, or a joint's axis is not readable.
    """
    for where, element in _placed(robot):
        for key, value in element.attrib.items():
            leftover = _LEFTOVER.search(value)
            if leftover:
                raise report.refusal(
                    where, f'{key}="{shortened(value)}" is an expression of xacro; import the xacro file itself'
                )
        for key in list(element.attrib):
            rule = _RULES.get((element.tag, key), _ANYWHERE.get(key) if where.startswith(_CHECKED) else None)
            if rule is not None and key in element.attrib:  # an unreadable moment takes the others with it
                _mend(element, key, rule, where, report)


def number(element: ET.Element | None, key: str) -> float | None:
    """Return a mended number; None where it is missing."""
    text = None if element is None else element.get(key)
    return None if text is None else float(text)


def _placed(robot: ET.Element) -> Iterator[tuple[str, ET.Element]]:
    """Yield every element with the words that say where it is."""
    yield "<robot>", robot
    for top in robot:
        whose = f"{top.tag} '{name_of(top)}'"
        for element in top.iter():
            yield (whose if element is top else f"{whose} <{element.tag.removeprefix(DRAKE)}>"), element


def _mend(element: ET.Element, key: str, rule: _Rule, where: str, report: ImportReport) -> None:
    text = element.attrib[key]
    words = [word for word in re.split(r"[ \t\r\n]+", text) if word]
    if len(words) in rule.counts and all(_is_finite(word) and not 0 < abs(float(word)) < SMALLEST for word in words):
        return
    readable = _readable(text, rule.counts, _UNITS.get(key, "kg"))
    shown = f'{key}="{shortened(text)}"'
    if readable is not None:
        element.set(key, " ".join(readable))
        report.add("repaired", where, f'{shown} written as "{element.get(key)}"')
    elif rule.needed and text.strip():
        raise report.refusal(where, f"{shown} is not {_counted(rule.counts)}")
    elif rule.default is not None:
        element.set(key, rule.default)
        report.add("defaulted", where, f'{shown} is not {_counted(rule.counts)}; "{rule.default}" instead')
    elif element.tag == "inertia":
        for moment in MOMENTS:
            element.attrib.pop(moment, None)
        report.add("dropped", where, f"{shown} is not {_counted(rule.counts)}; the moments count as missing")
    else:
        del element.attrib[key]
        report.add("dropped", where, f"{shown} is not {_counted(rule.counts)}; it counts as missing")


def _readable(text: str, counts: tuple[int, ...], unit: str) -> list[str] | None:
    """Return the numbers that a text surely means; None if it is not sure."""
    bare = text.replace("\N{MINUS SIGN}", "-").strip("()[]{} \t\r\n")
    spaced = re.sub(r"[,;]\s+|;", " ", bare)
    for candidate in (spaced, spaced.replace(",", " "), spaced.replace(",", ".")):
        words = [_without_unit(word, unit) for word in candidate.split()]
        if len(words) in counts and all(_is_finite(word) for word in words):
            return ["0" if abs(float(word)) < SMALLEST else word for word in words]
    return None


def _without_unit(word: str, unit: str) -> str:
    """Return a number without the unit that it has anyway, or the f of a programming language."""
    bare = (word.removesuffix(end) for end in (unit, "f", "F") if word.endswith(end))
    return next((rest for rest in bare if NUMBER.fullmatch(rest)), word)


def _is_finite(word: str) -> bool:
    return NUMBER.fullmatch(word) is not None and abs(float(word)) < LARGEST


def _counted(counts: tuple[int, ...]) -> str:
    listed = " or ".join(str(count) for count in counts)
    return "a finite number" if counts == (1,) else f"{listed} finite numbers"
