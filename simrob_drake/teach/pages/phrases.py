"""Axes, moves and changes of a program in words that a student reads."""

import unicodedata
from collections.abc import Iterable, Mapping
from typing import Any

from simrob_drake.programs.timeline import Change
from simrob_drake.teach.form import as_text
from simrob_drake.teach.pages.words import Words

Content = Mapping[str, Any]
"""A move as a program's file has it, an axis as a description has it."""

_TOLD = ("walk", "act", "attach", "release", "wait", "play", "tool")  # kinds of move with words of their own
_NAMED = ("tool", "gait")  # what of a move is the name of something
_SAID = {"pose": "legs.brought", "fixed": "legs.fixed"}  # what is told without its value
_MINUS = "\N{MINUS SIGN}"
_UNITS = {"deg": "°", "m": " m"}


class Phrases:
    """What pages call the axes of a robot, and what is done with them."""

    def __init__(self, t: Words, axes: Iterable[Content]) -> None:
        """Take the words, and the robot's axes."""
        self.t = t
        self._axes = {name: axis for axis in axes for name in (axis["name"], *axis["aliases"])}

    def axis(self, name: str) -> str:
        """Return what an axis is called, and which way is positive; its plain name where there are no words for it."""
        return self._named("axes", self.plain(name))

    def plain(self, name: str) -> str:
        """Return the name of an axis that may be called by an alias."""
        return str(self._axes[name]["name"]) if name in self._axes else name

    def name(self, name: str, otherwise: str | None = None) -> str:
        """Return what a gait, an act, a loop, a tool or a signal is called; else ``otherwise``, or its plain name."""
        return self._named("names", name, otherwise)

    def names(self, names: Iterable[str]) -> dict[str, str]:
        """Return what several are called, to choose from."""
        return {name: self.name(name) for name in names}

    def target(self, name: str, value: float) -> str:
        """Return where an axis goes."""
        return f"{self.axis(name)} {figure(value)}{self.unit(name)}"

    def unit(self, name: str) -> str:
        """Return what stands behind a number of an axis."""
        return _UNITS[self._axes[name]["unit"]] if name in self._axes else ""

    def move(self, move: Content) -> str:
        """Return a move in one line."""
        if "target_deg" in move:
            axes = ", ".join(self.target(axis, value) for axis, value in move["target_deg"].items())
            return self.t("legs.told_move", axes=axes, seconds=figure(move["duration"]))
        kind, content = next(iter(move.items()))
        if kind not in _TOLD:
            return as_text(move)
        told = dict(content) if isinstance(content, Mapping) else {kind: content}
        first = told.pop(next(iter(told)))
        what = figure(first) if isinstance(first, (int, float)) else self.name(first)
        rest = ", ".join(self._detail(key, value) for key, value in told.items() if value is not None)
        words = self.t(f"legs.told_{kind}", what=what)
        return f"{words} ({rest})" if rest else words

    def _detail(self, key: str, value: Any) -> str:
        """Return what else is said of a move."""
        if key in _NAMED:
            return self.name(value)
        return self.t(_SAID[key]) if key in _SAID else f"{key.replace('_', ' ')} {as_text(value)}"

    def change(self, change: Change, grid: float) -> str:
        """Return a change of a run in one line; ``grid`` is the program's [s]."""
        t = self.t
        if change.push is not None:
            at, force = change.push.at or t("legs.robot"), " ".join(map(figure, change.push.force))
            told = t("legs.told_push", at=at, force=force, seconds=figure(change.push.duration))
        elif change.drag is not None:
            seconds = figure(len(change.drag.targets) * grid)
            told = t("legs.told_drag", at=change.drag.at or t("legs.robot"), seconds=seconds)
        else:
            told = ", ".join(f"{key} = {as_text(value)}" for key, value in (change.set or {}).items())
        return t("legs.told_at", time=figure(change.time), what=told)

    def _named(self, section: str, name: str, otherwise: str | None = None) -> str:
        try:
            return self.t(f"{section}.{name}")
        except KeyError:
            return name.replace("_", " ") if otherwise is None else otherwise


def matches(search: str, texts: Iterable[str]) -> bool:
    """Tell whether each word of a search stands in some texts; capitals and accents do not count."""
    hay = " ".join(map(folded, texts))
    return all(word in hay for word in folded(search).split())


def folded(text: str) -> str:
    """Return a text as it is compared: without capitals, accents and what joins words."""
    parts = unicodedata.normalize("NFKD", text.replace("_", " ").casefold())
    return "".join(letter for letter in parts if not unicodedata.combining(letter))


def figure(value: float) -> str:
    """Return a number as briefly as it can be read."""
    return f"{round(value, 3) + 0.0:g}".replace("-", _MINUS)
