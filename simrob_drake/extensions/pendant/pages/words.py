"""The words of the pages, in each language one file beside; and axes, moves, poses and changes of a program in them."""

import unicodedata
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from math import degrees
from pathlib import Path
from typing import Any, NamedTuple, Self

from simrob_drake.base.errors import one_of
from simrob_drake.base.messages import in_language, message, number_in_language
from simrob_drake.base.remarks import Remark, Severity, worst_severity
from simrob_drake.base.yaml_files import read_yaml
from simrob_drake.extensions.pendant.form import as_text, move_fields
from simrob_drake.extensions.pendant.move_labels import labels_of
from simrob_drake.programs.moves.kinds import KINDS, check_move
from simrob_drake.programs.moves.motion import ArmMotion
from simrob_drake.programs.moves.move import Move, content_of, kind_of
from simrob_drake.programs.timeline import Change
from simrob_drake.results.verdict.verdict import CriterionRow
from simrob_drake.results.verdict.words import capitalize

_FOLDER = Path(__file__).parent / "strings"
_BETWEEN = "."


@dataclass(frozen=True)
class Words:
    """What the pages call ``t``: a text by its key, ``section.name``; and messages in the language.

    Attributes:
        language: the language, such as ``en``.
    """

    language: str
    _texts: dict[str, str]

    def __call__(self, key: str, **values: object) -> str:
        """Return a text with values, such as figures and messages, in place of their names in braces."""
        shown = {
            name: self.render(value) if isinstance(value, str) else value
            for name, value in values.items()
        }
        return self._texts[key].format(**shown) if values else self._texts[key]

    def render(self, text: str) -> str:
        """Render a message in the language. Other texts, such as names, are returned as they are."""
        return in_language(text, self.language)

    @property
    def has_decimal_comma(self) -> bool:
        """Whether the language writes 23,5 for the number 23.5."""
        return number_in_language(".", self.language) == ","

    def figure(self, value: float) -> str:
        """Write a number as briefly as it can be read, with the decimal sign of the language."""
        digits = f"{round(value, 3) + 0.0:g}".replace("-", MINUS)
        return number_in_language(digits, self.language)

    def decimals(self, value: float, count: int) -> str:
        """Write a number with so many decimals, and the decimal sign of the language."""
        return number_in_language(f"{value:.{count}f}", self.language)


def value_text(value: Any, language: str) -> str:
    """Write a value for the user: one number with the decimal sign of the language, other values as YAML."""
    text = as_text(value)
    is_number = isinstance(value, (int, float)) and not isinstance(value, bool)
    return number_in_language(text, language) if is_number else text


def languages() -> list[str]:
    """Return the languages that there are, ``en`` first."""
    return sorted(file.stem for file in _FOLDER.glob("*.yaml"))


def words(language: str) -> Words:
    """Return the words of a language; raises UnknownName: there is no such language."""
    known = one_of(message("pendant.language", "language"), language, languages())
    return Words(language, texts_of(known))


@cache
def texts_of(language: str) -> dict[str, str]:
    """Return all texts of a language by their keys."""
    sections = read_yaml(_FOLDER / f"{language}.yaml")
    return {
        f"{section}{_BETWEEN}{name}": text
        for section, texts in sections.items()
        for name, text in (texts or {}).items()
    }


class JudgedRun(NamedTuple):
    """What the verdict of a notice is about.

    Attributes:
        number: number of the run.
        settings: keys of the station that were changed when the run ended, with their values.
    """

    number: int
    settings: Mapping[str, Any]


@dataclass(frozen=True)
class Notice:
    """A message of a session for its pages: one text, or the remarks of a verdict.

    Attributes:
        key: key of the text in the section ``notice`` of the words; empty for a text that is in ``fills``.
        fills: values that are filled into the text; ``text`` alone for an error, which has words of its own.
        wrong: whether something went wrong.
        remarks: remarks about a run, the first of which sums it up; or further lines below the text.
        criteria: the table of criteria of the run's verdict.
        judged: the run that the criteria are about. None if there are no criteria.
    """

    key: str = ""
    fills: dict[str, Any] = field(default_factory=dict)
    wrong: bool = False
    remarks: tuple[Remark, ...] = ()
    criteria: tuple[CriterionRow, ...] = ()
    judged: JudgedRun | None = None

    @classmethod
    def of_remarks(
        cls,
        remarks: Sequence[Remark],
        criteria: Sequence[CriterionRow] = (),
        judged: JudgedRun | None = None,
    ) -> Self:
        """Create the notice of remarks about a run. It is wrong if one of them is a warning or a failure."""
        wrong = worst_severity(list(remarks)) in ("warning", "failure")
        return cls(wrong=wrong, remarks=tuple(remarks), criteria=tuple(criteria), judged=judged)

    @property
    def severity(self) -> Severity:
        """Severity of the worst remark; of a notice without remarks, a failure if something went wrong."""
        if self.remarks:
            return worst_severity(list(self.remarks))
        return "failure" if self.wrong else "note"

    def lines(self, render: Callable[[str], str]) -> list[str]:
        """List the texts of the remarks. The sentence that sums up a verdict begins with a capital letter.

        Args:
            render: renders a text in the language of a page.
        """
        texts = [render(remark.text) for remark in self.remarks]
        if self.criteria:
            texts[0] = capitalize(texts[0])
        return texts

    def __str__(self) -> str:
        """Return the notice in English."""
        if self.key:
            return "\n".join([words("en")(f"notice.{self.key}", **self.fills), *self.lines(str)])
        if self.remarks:
            return "\n".join(self.lines(str))
        return str(self.fills.get("text", ""))


Content = Mapping[str, Any]  # a move as a program's file has it, an axis as a description has it

Taught = Mapping[str, Mapping[str, Any]]  # targets by name, as a session has them

MINUS = "\N{MINUS SIGN}"
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

    def loop(self, name: str) -> str:
        """Return what a loop does, in a line; nothing of one that the pages have no words for."""
        return self._named("loops", name, "")

    def names(self, names: Iterable[str]) -> dict[str, str]:
        """Return what several are called, to choose from."""
        return {name: self.name(name) for name in names}

    def target(self, name: str, value: float) -> str:
        """Return where an axis goes."""
        return f"{self.axis(name)} {self.t.figure(value)}{self.unit(name)}"

    def units(self, count: int) -> list[str]:
        """Units of the axes of a posture, such as ``°``, in the order of the axes; degrees if the axes are not known.

        Args:
            count: count of values of the posture. One without fingers has fewer values than the robot has axes.
        """
        axes = {axis["name"]: axis for axis in self._axes.values()}
        if len(axes) != count:
            axes = {name: axis for name, axis in axes.items() if not axis.get("is_finger")}
        if len(axes) != count:
            return [_UNITS["deg"]] * count
        return [_UNITS[axis["unit"]] for axis in axes.values()]

    def unit(self, name: str) -> str:
        """Return what stands behind a number of an axis."""
        return _UNITS[self._axes[name]["unit"]] if name in self._axes else ""

    def move(self, move: Content, targets: Taught | None = None) -> str:
        """Return a move in one line: in the words that the pages have for its kind, else in its own.

        One that leads to taught targets has their names.
        """
        kind = kind_of(move, KINDS.values())
        if kind is None:
            return as_text(move)
        if issubclass(kind, ArmMotion):
            return self._motion(kind, content_of(kind, move), targets or {})
        caption, phrase = check_move(move).caption(), self._named("said", kind.key, "")
        if caption not in ("", kind.key) and not phrase:
            return caption
        content = content_of(kind, move)
        first, said = (
            next(iter(content), ""),
            {key: self._value(kind, key, value) for key, value in content.items()},
        )
        phrase = phrase or self.title(kind)
        rest = [
            self._detail(kind, key, value)
            for key, value in content.items()
            if f"{{{'what' if key == first else key}}}" not in phrase
        ]
        words = phrase.format(**{**said, "what": said.get(first, "")}).strip()
        return f"{words} ({', '.join(filter(None, rest))})" if any(rest) else words

    def title(self, kind: type[Move]) -> str:
        """Return what a kind of move is called."""
        return self._named("moves", kind.key, labels_of(kind).title)

    def field(self, kind: type[Move], key: str) -> str:
        """Return what a field of a kind of move is called; its ``name`` is that of the kind."""
        return self.title(kind) if key == "name" else self._named("fields", key)

    def _value(self, kind: type[Move], key: str, value: Any) -> str:
        """Return what a field of a move has."""
        if isinstance(value, Mapping):
            return ", ".join(self.target(axis, position) for axis, position in value.items())
        if isinstance(value, (int, float)):
            return self.t.figure(value)
        is_name = isinstance(labels_of(kind).form.get(key), str) and isinstance(value, str)
        return self.name(value) if is_name else as_text(value)

    def _detail(self, kind: type[Move], key: str, value: Any) -> str:
        """Return what else is said of a move."""
        what = labels_of(kind).form.get(key)
        if value is None or value is False:
            return ""
        if value is True or what == "origin":
            return self.field(kind, key)
        value_text = self._value(kind, key, value)
        unit = _unit_of(kind, key)
        if unit and isinstance(value, (int, float)):
            value_text = f"{value_text} {unit}"
        return (
            value_text
            if isinstance(what, str)
            else f"{self._named('fields', key).lower()} {value_text}"
        )

    def _motion(self, kind: type[ArmMotion], said: Content, targets: Taught) -> str:
        """Return a move of an arm in one line, with the names of taught targets that it goes to."""
        ways = [
            _target(self, kind, said, key, targets)
            for key in ("via", "targets")
            if key == "targets" or key in said
        ]
        how = [_how(self, key, said[key]) for key in _HOW if said.get(key) is not None]
        return ", ".join([f"{self.title(kind)} {' → '.join(ways)}", *how])

    def change(self, change: Change, grid: float) -> str:
        """Return a change of a run in one line; ``grid`` is the program's [s]."""
        t = self.t
        if change.push is not None:
            at, force = (
                change.push.at or t("legs.robot"),
                " ".join(map(t.figure, change.push.force)),
            )
            what = t("legs.told_push", at=at, force=force, seconds=t.figure(change.push.duration))
        elif change.drag is not None:
            seconds = t.figure(len(change.drag.targets) * grid)
            what = t("legs.told_drag", at=change.drag.at or t("legs.robot"), seconds=seconds)
        elif change.drive is not None:
            what = t(
                "legs.told_drive",
                at=change.drive.at or t("legs.robot"),
                count=len(change.drive.commands),
            )
        else:
            settings = change.set or {}
            what = ", ".join(
                f"{key} = {value_text(value, t.language)}" for key, value in settings.items()
            )
        return t("legs.told_at", time=t.figure(change.time), what=what)

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


WORLD = "world"
MILLI = 1e-3

_OWN = ("base", "tool")
_HOW = ("speed", "duration", "acceleration", "zone", "wobj")
_PLACE = 3  # figures
_TURNS = ("Rz", "Ry", "Rx")
_SAME = 1e-6  # m or deg


def joint_words(phrases: Phrases, name: str) -> str:
    """Return what a joint is called: the joints of arms by their number."""
    kind, _, number = name.partition("_")
    return (
        phrases.t("arm.joint", number=number)
        if kind == "joint" and number.isdigit()
        else phrases.axis(name)
    )


def frame_words(t: Words, frames: Iterable[str]) -> dict[str, str]:
    """Return what frames are called: those of the arm in the user's language, pieces by their names."""
    return {
        frame: t(f"arm.frame_{frame}") if frame in (*_OWN, WORLD) else frame for frame in frames
    }


def work_objects(frames: Iterable[str]) -> list[str]:
    """Return those of an arm's frames that a target can be taught in: it goes with what stands around."""
    return [frame for frame in frames if frame not in _OWN]


def pose_words(t: Words, pose: Sequence[float]) -> str:
    """Return a pose [m, deg], or a place [m], in a line."""
    place = " ".join(
        f"{name} {_short(t, value / MILLI)}" for name, value in zip("xyz", pose, strict=False)
    )
    turns = " ".join(
        f"{name} {_short(t, value)}°" for name, value in zip(_TURNS, pose[_PLACE:], strict=False)
    )
    return " · ".join(filter(None, [f"{place} mm", turns]))


def motions() -> dict[str, type[ArmMotion]]:
    """Return the kinds of moves that lead an arm to targets, by their keys."""
    return {key: kind for key, kind in KINDS.items() if issubclass(kind, ArmMotion)}


@cache
def _unit_of(kind: type[Move], key: str) -> str:
    """Unit of a key of a kind of move, such as ``N``; empty if it has none, as the parameters of a robot's gait."""
    own_keys = {field.alias or name for name, field in kind.model_fields.items()}
    if key not in own_keys:
        return ""
    (form_field,) = move_fields(kind, [key], {})
    return form_field.unit


def _target(
    phrases: Phrases, kind: type[ArmMotion], said: Mapping[str, Any], key: str, targets: Taught
) -> str:
    """Name of the taught target that a move goes to, or else its values with their units.

    Args:
        phrases: names and units of the robot's axes.
        kind: the kind of move.
        said: keys and values of the move.
        key: key of the target, without the ending ``_deg``.
        targets: the taught targets, by name.
    """
    rows = said.get(key, said.get(f"{key}_deg"))
    if not isinstance(rows, Sequence) or not rows or isinstance(rows[0], Sequence):
        return as_text(rows)
    units = phrases.units(len(rows)) if kind.of_axes else []
    if key in said:  # angles in radians
        is_length = (
            [unit == _UNITS["m"] for unit in units]
            if kind.of_axes
            else [True] * _PLACE + [False] * len(rows)
        )
        rows = [value if is_length[number] else degrees(value) for number, value in enumerate(rows)]
    for name, target in targets.items():
        taught = list(target["axes"].values()) if kind.of_axes else target["pose"][: len(rows)]
        if _near(taught, rows) and (kind.of_axes or target["frame"] == (said.get("wobj") or WORLD)):
            return name
    if not kind.of_axes:
        return pose_words(phrases.t, rows)
    return " ".join(
        _position(phrases.t, value, unit) for value, unit in zip(rows, units, strict=True)
    )


def _position(t: Words, value: float, unit: str) -> str:
    """Write the position of an axis: an angle with one decimal, a length to the millimetre."""
    return f"{_short(t, value) if unit == _UNITS['deg'] else t.figure(value)}{unit}"


def _near(some: Sequence[float], others: Sequence[float]) -> bool:
    return len(some) == len(others) and all(
        abs(a - b) < _SAME for a, b in zip(some, others, strict=True)
    )


def _how(phrases: Phrases, key: str, value: Any) -> str:
    if key == "speed":
        return f"{phrases.t.figure(value / MILLI)} mm/s"
    if key == "duration":
        return f"{phrases.t.figure(value)} s"
    return (
        phrases.t("arm.in_frame", frame=as_text(value))
        if key == "wobj"
        else f"{key} {as_text(value)}"
    )


def _short(t: Words, value: float) -> str:
    return t.figure(round(value, 1))
