"""The verdict on a run: measured values, compared with bounds.

A *criterion* measures one quantity of a run, such as ``final_error``, for several *subjects*: axes, feet, pairs of
bodies. Its result for one run is a `Measure`, with an entry for each subject. The `Verdict` on a run has the measures
of all criteria. The *bounds* of the values are given in the section ``verdict`` of the station's file. A value that
violates its bound becomes a warning.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from simrob_drake.base.errors import one_of
from simrob_drake.base.frames import Vector
from simrob_drake.stations.solver_config import VerdictConfig

if TYPE_CHECKING:  # this import would be circular: a run has a verdict
    from simrob_drake.results.record.run import RecordedRun


NOTHING_LEFT_OUT: Mapping[Any, str] = MappingProxyType({})
"""Value of ``left_out`` if all subjects are judged."""


@dataclass(frozen=True)
class Measured:
    """Values that a criterion measured in a run, for k subjects.

    Attributes:
        subjects: names of the subjects.
        values: the worst value of each subject, shape (k,), in SI units, or a share.
        times: when each value occurred, shape (k,) [s]. None if a value belongs to the whole run.
        slides: for values of axes, whether each axis is prismatic, so that its value is in m instead of rad, shape
            (k,). Empty otherwise.
        limits: for shares, what each value is a share of, shape (k,). None if the values are no shares.
        limit_units: units of the limits. Empty if the values are no shares.
        left_out: subjects that are not judged, each with the reason.
    """

    subjects: Sequence[str]
    values: Vector
    times: Vector | None = None
    slides: Sequence[bool] = ()
    limits: Vector | None = None
    limit_units: Sequence[str] = ()
    left_out: Mapping[str, str] = field(default_factory=lambda: NOTHING_LEFT_OUT)


class MeasuredValue(NamedTuple):
    """The worst value of one subject.

    Attributes:
        subject: name of the subject.
        value: the value.
        unit: ``rad``, ``m``, or ``1`` for a share.
        bound: bound of the value, in the same unit, or None if there is none.
        time: when the value occurred [s]. None if it belongs to the whole run.
        limit: what the value is a share of; 0 if it is no share.
        limit_unit: unit of the limit; empty if there is none.
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
    """A quantity by which runs are judged.

    Attributes:
        name: name of the quantity, such as ``final_error``. The section ``verdict`` of a station file gives its bound
            under the names ``bound_keys``.
        unit: ``m``, ``1`` for a share, or ``rad`` for axes. The values of prismatic axes are in m, and the bounds of
            axes have the endings ``_deg`` and ``_m``.
        title: short title for lists.
        sentence: text of a warning, with the placeholders ``{of}`` (subject), ``{value}``, ``{amount}`` and ``{when}``.
        measure: measures the quantity in a run; returns None if there is nothing to measure.
        per_time: whether the value is a share of the run's time, which is averaged over runs that follow each other.
        least: whether smaller values are worse, as for distances.
        default_bound: for a criterion of an extension, its bound in stations that give none, in the unit of the values;
            None for no bound. The criteria of the core have theirs in :class:`VerdictConfig`.
    """

    name: str
    unit: str
    title: str
    sentence: str
    measure: "Callable[[RecordedRun], Measured | None]"
    per_time: bool = False
    least: bool = False
    default_bound: float | None = None

    @property
    def bound_keys(self) -> tuple[str, ...]:
        """Keys of the section ``verdict`` that give its bounds: two for axes, which may be revolute or prismatic."""
        if self.unit == "rad":
            return (f"{self.name}_deg", f"{self.name}_m")
        return (self.name,)

    def of(self, run: "RecordedRun") -> "Measure | None":
        """Measure the quantity in a run, and add the bounds. Returns None if there is nothing to measure."""
        measured = self.measure(run)
        if measured is None or not measured.subjects:
            return None
        entries = []
        for index, subject in enumerate(measured.subjects):
            if subject not in measured.left_out:
                entries.append(self._entry(measured, index, run.config.verdict))
        return Measure(self, tuple(entries), dict(measured.left_out))

    def _entry(self, measured: Measured, index: int, bounds: VerdictConfig) -> MeasuredValue:
        """Make the entry of one subject, given by its index among the measured values."""
        is_prismatic = self.unit == "rad" and bool(measured.slides[index])
        return MeasuredValue(
            subject=measured.subjects[index],
            value=float(measured.values[index]),
            unit="m" if is_prismatic else self.unit,
            bound=self._bound(bounds, is_prismatic),
            time=None if measured.times is None else float(measured.times[index]),
            limit=0.0 if measured.limits is None else float(measured.limits[index]),
            limit_unit="" if measured.limits is None else measured.limit_units[index],
        )

    def _bound(self, bounds: VerdictConfig, is_prismatic: bool) -> float | None:
        """Bound of a value, in rad, m or as a share. Returns None if the verdict has no bound (``none``)."""
        key = self.bound_keys[1 if is_prismatic else 0]
        bound = getattr(bounds, key, None)
        if bound is None:  # a criterion of an extension, in a station that does not name it
            return self.default_bound
        if bound == "none":
            return None
        return float(np.deg2rad(bound) if key.endswith("_deg") else bound)

    def is_violated_by(self, entry: MeasuredValue) -> bool:
        """Whether a value violates its bound."""
        if entry.bound is None:
            return False
        return entry.value < entry.bound if self.least else entry.value > entry.bound


class Severity(NamedTuple):
    """Key for comparing entries. An entry that violates its bound is worse than all entries that do not."""

    is_violation: bool
    amount: float  # the larger, the worse


@dataclass(frozen=True)
class Measure:
    """Result of a criterion for one run.

    Attributes:
        criterion: the criterion.
        entries: the values, one for each subject that is judged.
        left_out: subjects that are not judged, each with the reason.
    """

    criterion: Criterion
    entries: tuple[MeasuredValue, ...]
    left_out: Mapping[str, str] = field(default_factory=lambda: NOTHING_LEFT_OUT)

    @cached_property
    def worst(self) -> MeasuredValue:
        """The entry that violates its bound most, or is nearest to it.

        If all subjects are left out, it is an entry with an empty subject and the value 0.
        """
        nothing = MeasuredValue(
            subject="", value=0.0, unit=self.criterion.unit, bound=None, time=None, limit=0.0, limit_unit=""
        )
        return max(self.entries, key=self._severity, default=nothing)

    @cached_property
    def warning(self) -> str:
        """A sentence about the worst entry, if it violates its bound; otherwise an empty text."""
        violations = sum(map(self.criterion.is_violated_by, self.entries))
        if not violations:
            return ""
        worst = self.worst
        sentence = self.criterion.sentence.format(
            of=worst.subject,
            value=in_words(worst.value, worst.unit),
            amount=f"{worst.value * worst.limit:.3g} of {worst.limit:.3g} {worst.limit_unit}",
            when="" if worst.time is None else f" at {worst.time:.2f} s",
        )
        others = f"; {violations - 1} more beyond it" if violations > 1 else ""
        return f"{sentence} (bound {in_words(worst.bound or 0.0, worst.unit)}{others})"

    def __str__(self) -> str:
        """Title of the criterion, worst value and subject."""
        if not self.entries:
            return f"{self.criterion.title} not judged"
        return f"{self.criterion.title} {in_words(self.worst.value, self.worst.unit)} ({self.worst.subject})"

    def _severity(self, entry: MeasuredValue) -> Severity:
        """Severity of an entry, by which it is compared with others.

        Values count as multiples of their bounds if these are not zero, since the axes of a robot may have bounds in
        different units. If smaller values are worse, the negative value counts.
        """
        is_violation = self.criterion.is_violated_by(entry)
        if self.criterion.least:
            return Severity(is_violation, -entry.value)
        if entry.bound:
            return Severity(is_violation, entry.value / entry.bound)
        return Severity(is_violation, entry.value)

    def summary(self) -> dict[str, Any]:
        """Content for ``summary.json``: the worst entry, and the value of each subject.

        Subjects that are not judged have no value (null), and the key ``left_out`` has the reasons. It is absent if all
        subjects are judged.
        """
        is_judged = bool(self.entries)
        worst = self.worst
        values: dict[str, float | None] = {entry.subject: entry.value for entry in self.entries}
        for subject in self.left_out:
            values[subject] = None
        content: dict[str, Any] = {
            "of": worst.subject if is_judged else None,
            "value": worst.value if is_judged else None,
            "unit": worst.unit,
            "bound": worst.bound,
            "time": worst.time,
            "each": values,
        }
        if self.left_out:
            content["left_out"] = dict(self.left_out)
        return content


@dataclass(frozen=True)
class Verdict:
    """Judgement of a run by all criteria.

    Attributes:
        measures: results of the criteria for which there was something to measure, in the order of the criteria.
        sample_rate: rate at which signals were recorded [Hz].
        contact_rate: rate at which overlaps of bodies and slips of feet were evaluated [Hz]. None if nothing touched.
        moves: results of the moves that the run consists of, in order: instances of
            :class:`~simrob_drake.results.verdict.moves.MoveVerdict`.
    """

    measures: tuple[Measure, ...]
    sample_rate: float
    contact_rate: float | None = None
    moves: tuple[Any, ...] = ()

    def __getitem__(self, name: str) -> Measure:
        """Result of a criterion by its name, such as ``final_error``.

        Raises:
            UnknownName: there is no such criterion, or it had nothing to measure.
        """
        known = {measure.criterion.name: measure for measure in self.measures}
        return known[one_of("figure", name, known)]

    @property
    def beyond(self) -> list[str]:
        """Names of the criteria whose bounds are violated."""
        return [measure.criterion.name for measure in self.measures if measure.warning]

    @property
    def warnings(self) -> list[str]:
        """A sentence for each criterion whose bound is violated, then the warnings of the moves."""
        warnings = [measure.warning for measure in self.measures if measure.warning]
        for move in self.moves:
            warnings += move.warnings
        return warnings

    def __str__(self) -> str:
        """The worst value of each criterion in one line. Values of 0 are left out, except for distances."""
        shown = [measure for measure in self.measures if measure.criterion.least or measure.worst.value > 0]
        return ", ".join(map(str, shown)) or "nothing to judge"

    def summary(self) -> dict[str, Any]:
        """Content for ``summary.json``."""
        return {
            "sample_rate": self.sample_rate,
            "contact_rate": self.contact_rate,
            "figures": {measure.criterion.name: measure.summary() for measure in self.measures},
            "moves": [move.summary() for move in self.moves],
        }


def join_verdicts(verdicts: Sequence[Verdict], durations: Sequence[float]) -> Verdict:
    """Combine the verdicts on runs that follow each other. For each subject the worst value of all runs is kept.

    A value that is a share of the time becomes a share of the whole time.

    Args:
        verdicts: the verdicts, in the order of the runs.
        durations: durations of the runs [s].
    """
    begins = np.cumsum([0.0, *durations]).tolist()  # one more than runs: the last is the end
    total_time = sum(durations)
    entries: dict[Criterion, dict[str, MeasuredValue]] = {}  # the combined entry of each subject
    left_out: dict[Criterion, dict[str, str]] = {}
    moves = list[Any]()
    for verdict, begin, duration in zip(verdicts, begins, durations, strict=False):
        for measure in verdict.measures:
            own = entries.setdefault(measure.criterion, {})
            left_out.setdefault(measure.criterion, {}).update(measure.left_out)
            for entry in measure.entries:
                shifted = entry._replace(time=None if entry.time is None else begin + entry.time)
                before = own.get(entry.subject)
                own[entry.subject] = _combine(measure, before, shifted, duration, total_time)
        moves += [move.later(begin) for move in verdict.moves]

    measures = []
    for criterion, own in entries.items():
        # A subject that is judged in one of the runs counts as judged, such as an axis that has a motor in some runs.
        never_judged = {subject: why for subject, why in left_out[criterion].items() if subject not in own}
        measures.append(Measure(criterion, tuple(own.values()), never_judged))
    contact_rates = [verdict.contact_rate for verdict in verdicts if verdict.contact_rate]
    return Verdict(
        measures=tuple(measures),
        sample_rate=min(verdict.sample_rate for verdict in verdicts),
        contact_rate=min(contact_rates) if contact_rates else None,
        moves=tuple(moves),
    )


def _combine(
    measure: Measure, known: MeasuredValue | None, new: MeasuredValue, duration: float, total_time: float
) -> MeasuredValue:
    """Combine the entry of a subject in one run with its entry in the runs before: the worse of the two.

    Shares of the time are added instead, each in proportion to the duration of its run.

    Args:
        measure: the measure that contains the new entry.
        known: combined entry of the runs before; None if they have none.
        new: entry in this run, with its time since the start of the first run.
        duration: duration of this run [s].
        total_time: duration of all runs [s].
    """
    if measure.criterion.per_time:
        share = new.value * duration / total_time if total_time else 0.0
        return new._replace(value=share + (known.value if known else 0.0))
    if known is None or measure._severity(new) > measure._severity(known):
        return new
    return known


def in_words(value: float, unit: str) -> str:
    """Write a value for users: angles in degrees, lengths in millimetres (from 1 m on in metres), shares in per cent.

    Args:
        value: the value, in its SI unit or as a share.
        unit: ``rad``, ``m``, or ``1`` for a share.
    """
    if unit == "rad":
        number, name = np.rad2deg(value), "deg"
    elif unit == "m" and abs(value) >= 1:
        number, name = value, "m"
    elif unit == "m":
        number, name = 1e3 * value, "mm"
    else:
        number, name = 100 * value, "%"
    return f"{number + 0.0:.3g} {name}"  # adding 0.0 turns -0.0 into 0.0
