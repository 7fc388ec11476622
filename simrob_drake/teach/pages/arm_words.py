"""What is of arms, in words: joints, frames, poses and lines of a program; lengths in mm, as arms have them."""

from collections.abc import Iterable, Mapping, Sequence
from math import degrees, isfinite
from typing import Any

from simrob_drake.teach.form import as_text
from simrob_drake.teach.pages.phrases import Phrases, figure
from simrob_drake.teach.pages.words import Words

KINDS = {"move_abs_j": "MoveAbsJ", "move_j": "MoveJ", "move_l": "MoveL", "move_c": "MoveC"}
"""The moves, and what RAPID calls them."""
WORLD = "world"
MILLI = 1e-3
MINUS = "\N{MINUS SIGN}"

_OWN = ("base", "tool")
_HOW = ("speed", "duration", "acceleration", "zone", "wobj")
_PLACE = 3  # figures
_TURNS = ("Rz", "Ry", "Rx")
_SAME = 1e-6  # m or deg

Taught = Mapping[str, Mapping[str, Any]]
"""Targets by name, as a session has them."""


def joint_words(phrases: Phrases, name: str) -> str:
    """Return what a joint is called: the joints of arms by their number."""
    kind, _, number = name.partition("_")
    return phrases.t("arm.joint", number=number) if kind == "joint" and number.isdigit() else phrases.axis(name)


def frame_words(t: Words, frames: Iterable[str]) -> dict[str, str]:
    """Return what frames are called: those of the arm in the user's language, pieces by their names."""
    return {frame: t(f"arm.frame_{frame}") if frame in (*_OWN, WORLD) else frame for frame in frames}


def work_objects(frames: Iterable[str]) -> list[str]:
    """Return those of an arm's frames that a target can be taught in: it goes with what stands around."""
    return [frame for frame in frames if frame not in _OWN]


def pose_words(pose: Sequence[float]) -> str:
    """Return a pose [m, deg], or a place [m], in a line."""
    place = " ".join(f"{name} {_short(value / MILLI)}" for name, value in zip("xyz", pose, strict=False))
    turns = " ".join(f"{name} {_short(value)}°" for name, value in zip(_TURNS, pose[_PLACE:], strict=False))
    return " · ".join(filter(None, [f"{place} mm", turns]))


def pose_text(pose: Sequence[float]) -> str:
    """Return a pose [m, deg] as it is typed: six figures in mm and degrees."""
    return " ".join(figure(value / MILLI if number < _PLACE else value) for number, value in enumerate(pose))


def pose_of(text: str) -> list[float]:
    """Return the pose [m, deg] that six figures in mm and degrees are; empty if they are not."""
    parts = text.replace(MINUS, "-").replace(",", " ").replace(";", " ").split()
    try:
        values = [float(part) for part in parts]
    except ValueError:
        return []
    if len(values) != len("xyz") + len(_TURNS) or not all(map(isfinite, values)):
        return []
    return [value * MILLI if number < _PLACE else value for number, value in enumerate(values)]


def line_words(phrases: Phrases, move: Mapping[str, Any], targets: Taught) -> str:
    """Return a line of a program in words, with the names of taught targets that it goes to."""
    kind, content = next(iter(move.items()))
    if kind not in KINDS:
        return phrases.move(move)
    said = content if isinstance(content, Mapping) else {"targets": content}
    ways = [_target(kind, said, key, targets) for key in ("via", "targets") if key == "targets" or key in said]
    how = [_how(phrases, key, said[key]) for key in _HOW if said.get(key) is not None]
    return ", ".join([f"{KINDS[kind]} {' → '.join(ways)}", *how])


def _target(kind: str, said: Mapping[str, Any], key: str, targets: Taught) -> str:
    """Return the name of a taught target, or its figures."""
    rows = said.get(key, said.get(f"{key}_deg"))
    if not isinstance(rows, Sequence) or not rows or isinstance(rows[0], Sequence):
        return as_text(rows)
    of_axes = kind == "move_abs_j"
    if key in said:  # angles in radians
        rows = [value if number < _PLACE and not of_axes else degrees(value) for number, value in enumerate(rows)]
    for name, target in targets.items():
        taught = list(target["axes"].values()) if of_axes else target["pose"][: len(rows)]
        if _near(taught, rows) and (of_axes or target["frame"] == (said.get("wobj") or WORLD)):
            return name
    return " ".join(f"{_short(value)}°" for value in rows) if of_axes else pose_words(rows)


def _near(some: Sequence[float], others: Sequence[float]) -> bool:
    return len(some) == len(others) and all(abs(a - b) < _SAME for a, b in zip(some, others, strict=True))


def _how(phrases: Phrases, key: str, value: Any) -> str:
    if key == "speed":
        return f"{figure(value / MILLI)} mm/s"
    if key == "duration":
        return f"{figure(value)} s"
    return phrases.t("arm.in_frame", frame=as_text(value)) if key == "wobj" else f"{key} {as_text(value)}"


def _short(value: float) -> str:
    return figure(round(value, 1))
