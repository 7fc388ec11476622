"""Criteria by which runs are judged, and the verdict on a run: its figures, what passes a bound, and both in words."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from simrob_drake.errors import one_of
from simrob_drake.frames import Vector
from simrob_drake.stations.solver_config import VerdictConfig

if TYPE_CHECKING:  # a run has a verdict
    from simrob_drake.results.record.run import RecordedRun


NOTHING_LEFT_OUT: Mapping[Any, str] = MappingProxyType({})
"""Of a criterion that judges all of its subjects."""


@dataclass(frozen=True)
class Measured:
    """What a criterion measured in a run, of k subjects: axes, feet, pairs of bodies."""

    subjects: Sequence[str]  # what they are called
    values: Vector  # the worst of each, shape (k,), in SI units
    times: Vector | None = None  # when each was so, shape (k,) [s]; None where that is no moment
    # which axes slide, shape (k,), so that what is in rad of others is in m; none unless given
    slides: Sequence[bool] = ()
    limits: tuple[Vector, Sequence[str]] = (np.zeros(0), ())  # what shares are shares of, shape (k,), and their units
    left_out: Mapping[str, str] = NOTHING_LEFT_OUT  # subjects that are not judged, each with the reason


class MeasuredValue(NamedTuple):
    """The figure of one subject: its worst value with its unit, its bound if it has one, and the moment if it is one.

    A share is one of ``limit``, with its unit; 0 where it is none.
    """

    subject: str
    value: float
    unit: str
    bound: float | None
    time: float | None
    limit: float
    limit_unit: str


@dataclass(frozen=True)
class Criterion:
    """One thing by which runs are judged. Its name is that of its bound in :class:`VerdictConfig`."""

    name: str  # of the figure, such as ``final_error``
    # ``rad`` for axes (m where they slide; their bounds have the endings ``_deg`` and ``_m``), ``m``, or ``1``
    unit: str
    title: str  # of the figure, for lists
    sentence: str  # what a warning says, with ``{of}``, ``{value}``, ``{amount}`` and ``{when}``
    measure: "Callable[[RecordedRun], Measured | None]"  # gives it of a run; None where there is nothing to measure
    per_time: bool = False  # it is a part of the run's time: over runs that follow each other it is averaged
    least: bool = False  # the smaller, the worse

    def of(self, run: "RecordedRun") -> "Measure | None":
        """Return what the criterion finds in a run; None where there is nothing to measure."""
        found = self.measure(run)
        if found is None or not len(found.subjects):
            return None
        count, (limits, units) = len(found.subjects), found.limits
        columns = (
            found.subjects,
            found.values.tolist(),
            found.slides if self.unit == "rad" else [False] * count,
            [None] * count if found.times is None else found.times.tolist(),
            limits.tolist() or [0.0] * count,
            units or [""] * count,
        )
        bounds = {slides: self._bound(run.config.verdict, slides) for slides in set(columns[2])}
        entries = [
            MeasuredValue(subject, value, "m" if slides else self.unit, bounds[slides], time, limit, unit)
            for subject, value, slides, time, limit, unit in zip(*columns, strict=True)
            if subject not in found.left_out
        ]
        return Measure(self, tuple(entries), dict(found.left_out))

    def _bound(self, bounds: VerdictConfig, slides: bool) -> float | None:
        ending = "" if self.unit != "rad" else "_m" if slides else "_deg"
        bound = getattr(bounds, f"{self.name}{ending}")
        if bound == "none":
            return None
        return float(np.deg2rad(bound) if ending == "_deg" else bound)

    def passes(self, entry: MeasuredValue) -> bool:
        """Tell whether an entry is beyond its bound."""
        if entry.bound is None:
            return False
        return entry.value < entry.bound if self.least else entry.value > entry.bound


@dataclass(frozen=True)
class Measure:
    """What a criterion found in a run, of each subject."""

    criterion: Criterion
    entries: tuple[MeasuredValue, ...]
    left_out: Mapping[str, str] = NOTHING_LEFT_OUT  # subjects that are not judged, each with the reason

    @cached_property
    def worst(self) -> MeasuredValue:
        """The entry that is farthest beyond its bound, or nearest to it; one without a subject if all are left out."""
        nothing = MeasuredValue(
            subject="", value=0.0, unit=self.criterion.unit, bound=None, time=None, limit=0.0, limit_unit=""
        )
        return max(self.entries, key=self._severity, default=nothing)

    @cached_property
    def warning(self) -> str:
        """What passes its bound, in words; empty if nothing does."""
        beyond, worst = sum(map(self.criterion.passes, self.entries)), self.worst
        if not beyond:
            return ""
        sentence = self.criterion.sentence.format(
            of=worst.subject,
            value=in_words(worst.value, worst.unit),
            amount=f"{worst.value * worst.limit:.3g} of {worst.limit:.3g} {worst.limit_unit}",
            when="" if worst.time is None else f" at {worst.time:.2f} s",
        )
        others = f"; {beyond - 1} more beyond it" if beyond > 1 else ""
        return f"{sentence} (bound {in_words(worst.bound or 0.0, worst.unit)}{others})"

    def __str__(self) -> str:
        """Say in a few words what was worst."""
        if not self.entries:
            return f"{self.criterion.title} not judged"
        return f"{self.criterion.title} {in_words(self.worst.value, self.worst.unit)} ({self.worst.subject})"

    def _severity(self, entry: MeasuredValue) -> tuple[bool, float]:
        if self.criterion.least:
            return self.criterion.passes(entry), -entry.value
        return self.criterion.passes(entry), entry.value / entry.bound if entry.bound else entry.value

    def summary(self) -> dict[str, Any]:
        """Return it for ``summary.json``: the worst, and the value of each subject.

        Subjects that are not judged have no value (null), and ``left_out`` says why.
        """
        worst = self.worst
        values: dict[str, float | None] = {entry.subject: entry.value for entry in self.entries}
        about: dict[str, Any] = {"of": worst.subject, "value": worst.value, "unit": worst.unit, "bound": worst.bound}
        if not self.entries:
            about |= {"of": None, "value": None}
        each = values | dict.fromkeys(self.left_out)
        reasons = {"left_out": dict(self.left_out)} if self.left_out else {}
        return {**about, "time": worst.time, "each": each, **reasons}


@dataclass(frozen=True)
class Verdict:
    """What was asked of a run against what became of it."""

    measures: tuple[Measure, ...]  # what there was to measure, in the order of the criteria
    sample_rate: float  # at which signals were looked at [Hz]
    # at which it was looked how deep bodies and feet were in each other [Hz]; None without contact
    contact_rate: float | None = None
    # what became of each move, in order: a :class:`~simrob_drake.results.verdict.moves.MoveVerdict` each
    moves: tuple[Any, ...] = ()

    def __getitem__(self, name: str) -> Measure:
        """Return a figure by its name, such as ``final_error``."""
        known = {measure.criterion.name: measure for measure in self.measures}
        return known[one_of("figure", name, known)]

    @property
    def beyond(self) -> list[str]:
        """The names of the figures that pass their bounds."""
        return [measure.criterion.name for measure in self.measures if measure.warning]

    @property
    def warnings(self) -> list[str]:
        """What passes its bound, a sentence for each figure, and for those of each move."""
        of_moves = [warning for move in self.moves for warning in move.warnings]
        return [*(measure.warning for measure in self.measures if measure.warning), *of_moves]

    def __str__(self) -> str:
        """Return the figures that are not zero, in a line."""
        lines = [str(measure) for measure in self.measures if measure.criterion.least or measure.worst.value > 0]
        return ", ".join(lines) or "nothing to judge"

    def summary(self) -> dict[str, Any]:
        """Return it for ``summary.json``."""
        measures = {measure.criterion.name: measure.summary() for measure in self.measures}
        about = {"sample_rate": self.sample_rate, "contact_rate": self.contact_rate}
        return {**about, "figures": measures, "moves": [move.summary() for move in self.moves]}


def joined(verdicts: Sequence[Verdict], durations: Sequence[float]) -> Verdict:
    """Return the verdict on runs that follow each other and last so long [s]: of each subject the worst.

    Parts of the time are those of the whole time.
    """
    begins, whole = np.cumsum([0.0, *durations]).tolist(), sum(durations)
    found: dict[Criterion, dict[str, MeasuredValue]] = {}
    left_out: dict[Criterion, dict[str, str]] = {}
    for verdict, begin, duration in zip(verdicts, begins, durations, strict=False):
        for measure in verdict.measures:
            own = found.setdefault(measure.criterion, {})
            left_out.setdefault(measure.criterion, {}).update(measure.left_out)
            for entry in measure.entries:
                here = entry._replace(time=None if entry.time is None else begin + entry.time)
                known = own.get(entry.subject)
                if measure.criterion.per_time:
                    share = entry.value * duration / whole if whole else 0.0
                    own[entry.subject] = here._replace(value=share + (known.value if known else 0.0))
                elif known is None or measure._severity(here) > measure._severity(known):
                    own[entry.subject] = here
    measures = tuple(
        # An axis that is judged in one of the runs, as one that has a motor in some of them only, is judged.
        Measure(
            criterion,
            tuple(entries.values()),
            {subject: why for subject, why in left_out[criterion].items() if subject not in entries},
        )
        for criterion, entries in found.items()
    )
    rates = [verdict.contact_rate for verdict in verdicts if verdict.contact_rate]
    moves = tuple(move.later(at) for one, at in zip(verdicts, begins, strict=False) for move in one.moves)
    return Verdict(measures, min(v.sample_rate for v in verdicts), min(rates) if rates else None, moves)


def in_words(value: float, unit: str) -> str:
    """Return a figure with the unit that users read: degrees, millimetres, per cent."""
    shown = {"rad": (np.rad2deg(value), "deg"), "m": (1e3 * value, "mm"), "1": (100 * value, "%")}
    number, name = (value, "m") if unit == "m" and abs(value) >= 1 else shown[unit]
    return f"{number + 0.0:.3g} {name}"
