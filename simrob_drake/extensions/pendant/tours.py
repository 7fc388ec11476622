"""Lessons as guided tours of the page: steps in YAML, each with checks of what the session has come to."""

from collections.abc import Sequence
from itertools import islice
from math import degrees
from pathlib import Path
from typing import Annotated, Literal, NamedTuple

from pydantic import Field, model_validator

from simrob_drake.base.errors import InvalidConfig, SimrobError
from simrob_drake.base.messages import message
from simrob_drake.base.sections import Number, Strict, validate_section
from simrob_drake.base.yaml_files import read_yaml
from simrob_drake.extensions.pendant.session import Session
from simrob_drake.programs.timeline import Change

_FOLDER = Path(__file__).parent / "lessons"
_KINDS = "ended", "key", "moves", "pushed", "loop", "signal", "inspected"
Text = Annotated[dict[str, str], Field(min_length=1)]  # what is said, by language


class StepStart(NamedTuple):
    """What there was when a step began: only what comes later counts.

    Attributes:
        ending: how the last run had ended.
        moves: count of the stored moves.
        changes: changes of the run that were in the program.
        inspected: count of the signals that the user had looked at.
    """

    ending: object
    moves: int
    changes: tuple[Change, ...]
    inspected: int = 0


class Check(Strict):
    """What holds once a step is done: one of these."""

    ended: str | None = None
    """A run has ended so, or by a monitor of this name."""
    key: str | None = None
    """A key of the station, or one that was changed while it ran, lies between the bounds, or is ``value``."""
    moves: Annotated[int, Field(ge=1)] | None = None
    """So many moves more are stored, of the ``kind`` if that is said."""
    pushed: Literal[True] | None = None
    """A push is in the program."""
    loop: str | None = None
    """A loop is on."""
    signal: str | None = None
    """At the moment that is shown the ``axis`` of a signal lies between the bounds, in degrees where it is an angle."""
    inspected: str | None = None
    """The user has chosen a block or a line of the picture that shows the plot of this signal."""

    above: Number | None = None
    below: Number | None = None
    value: str | None = None
    kind: str | None = None
    axis: str | None = None

    @model_validator(mode="after")
    def _is_one(self) -> "Check":
        if sum(getattr(self, kind) is not None for kind in _KINDS) != 1:
            raise ValueError(
                message(
                    "pendant.one_is_needed", "one of {kinds} is needed", kinds=", ".join(_KINDS)
                )
            )
        if self.signal is not None and self.axis is None:
            raise ValueError(message("pendant.signal_needs_axis", "a signal needs an axis"))
        return self

    def holds(self, session: Session, start: StepStart) -> bool:
        """Whether the condition holds in a session since the step began."""
        if self.loop is not None:
            return any(
                loop["name"] == self.loop and loop["on"]
                for loop in session.description.get("loops", ())
            )
        if self.signal is not None:
            return self._between(self._last(session))
        if self.key is not None:
            changes = session.book.changes
            live = [
                change.set[self.key] for change in changes if change.set and self.key in change.set
            ]
            return self._between(live[-1] if live else session.setup.value(self.key))
        return self._has_happened(session, start)

    def _has_happened(self, session: Session, start: StepStart) -> bool:
        """Whether what the user is to do has been done since the step began: a run, moves, a push, a look."""
        book = session.book
        if self.ended is not None:
            ending = session.run.ending or {}
            is_another = session.run.ending is not start.ending
            return is_another and self.ended in (ending.get("ending"), ending.get("stopped_by"))
        if self.moves is not None:
            later = islice(book.program.moves, start.moves, None)
            return sum(self.kind in (None, move.key) for move in later) >= self.moves
        if self.inspected is not None:
            return self.inspected in session.inspected[start.inspected :]
        # Pushes are compared one by one, not counted: a step may ask to delete a push before the next one.
        return any(change.push for change in book.changes if change not in start.changes)

    def _last(self, session: Session) -> object:
        about = {signal["name"]: signal for signal in session.description.get("signals", ())}
        rows = session.run.history.get(str(self.signal), ())
        columns = about.get(self.signal, {}).get("columns", ())
        places = [
            place for place, column in enumerate(columns) if column.rpartition(".")[2] == self.axis
        ]
        if not (rows and places):
            return None
        factor = degrees(1.0) if about[self.signal]["unit"].startswith("rad") else 1.0
        return rows[-1][1][places[0]] * factor

    def _between(self, value: object) -> bool:
        if self.value is not None:
            return str(value) == self.value
        if not isinstance(value, (int, float)):
            return False
        return (self.above is None or value > self.above) and (
            self.below is None or value < self.below
        )


class TourStep(Strict):
    """A step: what to do, and by what it is known to be done."""

    text: Text
    checks: tuple[Check, ...] = ()
    subject: str | None = None
    """A robot or a station that is opened when the step begins."""


class Tour(Strict):
    """A lesson."""

    title: Text
    subject: str
    """The robot or the station that it begins with."""
    page: str | Text = ""
    """Page that tells more: an address, or a Markdown file of the documentation; of each language, if they differ."""
    steps: Annotated[tuple[TourStep, ...], Field(min_length=1)]


def tours(folder: Path | None = None) -> list[Tour]:
    """Return the lessons of the package, and behind them those of a folder, each in the order of their files' names.

    Raises InvalidConfig: a damaged file; names it, the key, and what would be right.
    """
    if folder is not None and not folder.is_dir():
        raise InvalidConfig(
            folder, "", message("pendant.no_lessons", "there is no such folder of lessons")
        )
    files = [file for place in (_FOLDER, folder) if place for file in sorted(place.glob("*.yaml"))]
    return [validate_section(Tour, read_yaml(file), file) for file in files]


def page_of(tour: Tour, language: str) -> str:
    """Page of a lesson that tells more in a language, or in the first one that there is; empty if there is none."""
    return tour.page if isinstance(tour.page, str) else spoken(tour.page, language)


def spoken(text: Text, language: str) -> str:
    """Return what is said in a language, or in the first one that there is."""
    return text.get(language, next(iter(text.values())))


class TourProgress:
    """How far somebody has come in a lesson.

    Attributes:
        tour: the lesson.
        number: of the step, from 0.
        done: which of its checks hold, or did; what held once is done.
    """

    def __init__(self, tour: Tour) -> None:
        """Begin."""
        self.tour, self.number = tour, 0
        self._begin()

    def _begin(self) -> None:
        self.done = [False] * len(self.step.checks)
        self._session: Session | None = None
        self._start = StepStart(None, 0, ())

    @property
    def step(self) -> TourStep:
        """The step."""
        return self.tour.steps[self.number]

    @property
    def subject(self) -> str:
        """What is to be open in the step."""
        subjects: Sequence[str | None] = [
            step.subject for step in self.tour.steps[: self.number + 1]
        ]
        return next((one for one in reversed(subjects) if one), self.tour.subject)

    def go(self, by: int) -> None:
        """Go to another step."""
        self.number = min(max(self.number + by, 0), len(self.tour.steps) - 1)
        self._begin()

    def look(self, session: Session) -> bool:
        """Look at a session, and tell whether all of the step is done."""
        if session is not self._session:
            self._session = session
            self._start = StepStart(
                ending=session.run.ending,
                moves=len(session.book.program.moves),
                changes=session.book.changes,
                inspected=len(session.inspected),
            )
        for place, check in enumerate(self.step.checks):
            try:
                self.done[place] = self.done[place] or check.holds(session, self._start)
            except SimrobError:  # of a station that has no such part
                continue
        return all(self.done)
