"""The verdict on a run: measured values, compared with bounds.

A *criterion* measures one quantity of a run, such as ``final_error``, for several *subjects*: axes, feet, pairs of
bodies. Its result for one run is a `Measure`, with an entry for each subject. The `Verdict` on a run has the measures
of all criteria. The *bounds* of the values are given in the section ``verdict`` of the station's file. A value that
violates its bound becomes a warning.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from simrob_drake.base.errors import one_of
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import Message, compound, join_texts, message
from simrob_drake.base.remarks import SEVERITY_WORDS, Remark, Remedy, Severity, worst_severity
from simrob_drake.results.html import html_of_remarks
from simrob_drake.results.record.run import move_title
from simrob_drake.results.verdict.remedies import MakeRemedy
from simrob_drake.results.verdict.severity import VIOLATION, severity_of_value
from simrob_drake.results.verdict.words import (
    amount_for_users,
    amount_in_words,
    capitalize,
    count_in_words,
    in_words,
    rounded_in_words,
    text_table,
)
from simrob_drake.stations.solver_config import VerdictConfig

if TYPE_CHECKING:  # this import would be circular: a run has a verdict
    from simrob_drake.results.record.run import MoveSpan, RecordedRun


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
    left_out: Mapping[str, str] = field(default_factory=dict)


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
        move: in a program, name of the move in which the value occurred, such as ``move 2``; empty otherwise.
    """

    subject: str
    value: float
    unit: str
    bound: float | None
    time: float | None
    limit: float
    limit_unit: str
    move: str = ""


@dataclass(frozen=True)
class Criterion:
    """A quantity by which runs are judged.

    Attributes:
        name: name of the quantity, such as ``final_error``. The section ``verdict`` of a station file gives its bound
            under the names ``bound_keys``.
        unit: ``m``, ``1`` for a share, or ``rad`` for axes. The values of prismatic axes are in m, and the bounds of
            axes have the endings ``_deg`` and ``_m``.
        title: short title for tables.
        sentence: text of a warning, with the placeholders ``{of}`` (subject), ``{value}``, ``{amount}``, ``{when}``
            (time and move) and ``{during}`` (time and move, in a program only).
        measure: measures the quantity in a run; returns None if there is nothing to measure.
        per_time: whether the value is a share of the run's time, which is averaged over runs that follow each other.
        least: whether smaller values are worse, as for distances.
        default_bound: for a criterion of an extension, its bound in stations that give none, in the unit of the values;
            None for no bound. The criteria of the core have theirs in :class:`VerdictConfig`.
        remedy: finds what most likely brings the value within its bound; None if nothing is known about that.
        shows_share: whether tables show a share of a limit in per cent; otherwise as an amount, such as 37.2 N·m.
        catalogue: first word of the ids ``<catalogue>.title_<name>`` and ``<catalogue>.beyond_<name>`` under which
            other languages have title and sentence. An extension gives the name under which it announces its messages.
    """

    name: str
    unit: str
    title: str
    sentence: str
    measure: "Callable[[RecordedRun], Measured | None]"
    per_time: bool = False
    least: bool = False
    default_bound: float | None = None
    remedy: MakeRemedy | None = None
    shows_share: bool = False
    catalogue: str = "results"

    @property
    def title_message(self) -> Message:
        """The title, for all languages."""
        return message(f"{self.catalogue}.title_{self.name}", self.title)

    @property
    def bound_keys(self) -> tuple[str, ...]:
        """Keys of the section ``verdict`` that give its bounds: two for axes, which may be revolute or prismatic."""
        if self.unit == "rad":
            return (f"{self.name}_deg", f"{self.name}_m")
        return (self.name,)

    def of(self, run: "RecordedRun") -> "Measure | None":
        """Measure the quantity in a run, and add the bounds; for a violated bound, also a remedy.

        Returns None if there is nothing to measure.
        """
        measured = self.measure(run)
        if measured is None or not measured.subjects:
            return None
        # Subjects that are not judged have no entry, so that they can never be the worst one.
        entries = []
        for index, subject in enumerate(measured.subjects):
            if subject not in measured.left_out:
                entries.append(self._entry(measured, index, run.config.verdict))
        result = Measure(self, tuple(entries), dict(measured.left_out))
        if self.remedy is None or not result.warning:
            return result
        # A remedy may need the plant, which is slow to evaluate: it is searched for violated bounds only.
        return replace(result, remedy=self.remedy(run, result.worst))

    def _entry(self, measured: Measured, index: int, bounds: VerdictConfig) -> MeasuredValue:
        """Make the entry of one subject.

        Args:
            measured: the values of all subjects.
            index: index of the subject among them.
            bounds: the section ``verdict`` of the station.
        """
        # Only axes have the unit rad here, and those that slide have values in m.
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
        """Bound of a value, in rad, m or as a share. Returns None if there is no bound.

        Args:
            bounds: the section ``verdict`` of the station; it has the word ``none`` where there is no bound.
            is_prismatic: whether the value is that of an axis that slides.
        """
        key = self.bound_keys[1 if is_prismatic else 0]
        bound = getattr(bounds, key, None)
        if bound is None:  # a criterion of an extension, in a station that does not name it
            return self.default_bound
        if bound == "none":
            return None
        # Bounds of angles are in degrees in the file, and values in radians.
        return float(np.deg2rad(bound) if key.endswith("_deg") else bound)

    def is_violated_by(self, entry: MeasuredValue) -> bool:
        """Whether a value violates its bound."""
        if entry.bound is None:
            return False
        return entry.value < entry.bound if self.least else entry.value > entry.bound


class Rank(NamedTuple):
    """Key for comparing entries. An entry that violates its bound is worse than all entries that do not.

    Attributes:
        is_violation: whether the entry violates its bound. It is compared first.
        amount: size of the value, in the sense that a larger amount is worse.
    """

    is_violation: bool
    amount: float


class CriterionRow(NamedTuple):
    """An entry of the table of criteria.

    Attributes:
        severity: how the value is judged.
        criterion: title of the criterion.
        value: the worst value, with its unit.
        bound: bound of the value, with its unit; ``–`` if there is none.
        worst: the part with the worst value, such as an axis.
    """

    severity: Severity
    criterion: str
    value: str
    bound: str
    worst: str


TABLE_HEADINGS = (
    "",
    message("results.heading_criterion", "criterion"),
    message("results.heading_value", "value"),
    message("results.heading_bound", "bound"),
    message("results.heading_worst", "worst part"),
)
"""Headings of the table of criteria. The first column shows severities and has none."""

_TIME_ROUNDING = 1e-6
"""Times that differ by at most this are equal [s]."""

NO_BOUND = "–"
"""What a table shows instead of a bound if there is none."""


@dataclass(frozen=True)
class Measure:
    """Result of a criterion for one run.

    Attributes:
        criterion: the criterion.
        entries: the values, one for each subject that is judged.
        left_out: subjects that are not judged, each with the reason.
        remedy: what most likely brings the worst value within its bound. None if it is within, or if no remedy is
            known.
    """

    criterion: Criterion
    entries: tuple[MeasuredValue, ...]
    left_out: Mapping[str, str] = field(default_factory=dict)
    remedy: Remedy | None = None

    @cached_property
    def worst(self) -> MeasuredValue:
        """The entry that violates its bound most, or if none does, is nearest to it: in comparison with its own bound.

        Values that have no bound, or the bound 0, are compared as they are. If smaller values are worse, it is the
        entry with the smallest value of those that violate their bounds, or of all if none does.

        If all subjects are left out, it is an entry with an empty subject, the value 0 and no bound.
        """
        nothing = MeasuredValue(
            subject="",
            value=0.0,
            unit=self.criterion.unit,
            bound=None,
            time=None,
            limit=0.0,
            limit_unit="",
        )
        return max(self.entries, key=self._rank, default=nothing)

    @cached_property
    def warning(self) -> str:
        """A sentence about the worst entry, with the count of other violations, if there are any.

        It is an empty text if no entry violates its bound.
        """
        violations = sum(map(self.criterion.is_violated_by, self.entries))
        if not violations:
            return ""
        worst = self.worst
        sentence = message(
            f"{self.criterion.catalogue}.beyond_{self.criterion.name}",
            self.criterion.sentence,
            of=worst.subject,
            value=in_words(worst.value, worst.unit),
            amount=_amount_of_limit(worst),
            when=_when(worst),
            during=_during(worst),
        )
        bound = in_words(worst.bound or 0.0, worst.unit)
        if violations == 1:
            return message(
                "results.with_bound", "{sentence} (bound {bound})", sentence=sentence, bound=bound
            )
        return message(
            "results.with_bound_and_others",
            "{sentence} (bound {bound}; {others} more {others:violation|violations})",
            sentence=sentence,
            bound=bound,
            others=violations - 1,
        )

    @property
    def severity(self) -> Severity:
        """Severity of the worst entry."""
        return severity_of_value(
            is_violation=bool(self.warning), has_bound=self.worst.bound is not None
        )

    @property
    def remark(self) -> Remark | None:
        """The warning with its severity and remedy, or None if all values are within their bounds."""
        return Remark(VIOLATION, self.warning, self.remedy) if self.warning else None

    @property
    def row(self) -> CriterionRow:
        """Entry of the table of criteria, with the worst value, its bound and its subject as texts."""
        worst = self.worst
        return CriterionRow(
            severity=self.severity,
            criterion=self.criterion.title_message,
            value=self._in_table(worst.value),
            bound=NO_BOUND if worst.bound is None else self._in_table(worst.bound),
            worst=worst.subject,
        )

    def _in_table(self, value: float) -> Message:
        """Write a value of the worst entry, or its bound, for the table. Shares of a limit are written as amounts."""
        worst = self.worst
        # A share alone would not show how large the torque or the speed was.
        if worst.limit_unit and not self.criterion.shows_share:
            return amount_in_words(value, worst.limit, worst.limit_unit)
        return rounded_in_words(value, worst.unit)

    def __str__(self) -> str:
        """Title of the criterion, worst value and subject; "not judged" if all subjects are left out."""
        if not self.entries:
            return f"{self.criterion.title} not judged"
        return f"{self.criterion.title} {in_words(self.worst.value, self.worst.unit)} ({self.worst.subject})"

    def _rank(self, entry: MeasuredValue) -> Rank:
        """Rank of an entry, by which it is compared with others.

        Values count as multiples of their bounds if these are not zero, since the axes of a robot may have bounds in
        different units. If smaller values are worse, the negative value counts.
        """
        is_violation = self.criterion.is_violated_by(entry)
        if self.criterion.least:
            return Rank(is_violation, -entry.value)
        if entry.bound:
            return Rank(is_violation, entry.value / entry.bound)
        return Rank(is_violation, entry.value)

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
            "severity": self.severity,
            "each": values,
        }
        if self.left_out:
            content["left_out"] = dict(self.left_out)
        return content


def _amount_of_limit(entry: MeasuredValue) -> Message:
    """Write a share as an amount of its limit, such as ``37.2 of 150 N·m``.

    The text has no meaning for a value that is no share; no sentence uses it then.
    """
    amount = amount_for_users(entry.value * entry.limit, entry.limit_unit)
    limit = amount_for_users(entry.limit, entry.limit_unit)
    return message(
        "results.amount_of_limit",
        "{amount:.6g} of {limit:.6g} {unit}",
        amount=amount.number,
        limit=limit.number,
        unit=limit.unit,
    )


def _when(entry: MeasuredValue) -> Message:
    """Write at what time, and in a program in which move, a value occurred, with a space before it.

    Empty if the time is not known.
    """
    if entry.time is None:
        return compound("")
    at = message("results.at_time", " at {time:.2f} s", time=entry.time)
    if not entry.move:
        return at
    return message(
        "results.at_time_in_move", " at {time:.2f} s, in {move}", time=entry.time, move=entry.move
    )


def _during(entry: MeasuredValue) -> Message:
    """Write the same as `_when` for a value that occurred in a move of a program. Empty for a single run."""
    return _when(entry) if entry.move else compound("")


@dataclass(frozen=True, repr=False)
class Verdict:
    """Judgement of a run by all criteria.

    Attributes:
        measures: results of the criteria for which there was something to measure, in the order of the criteria.
        sample_rate: rate at which signals were recorded [Hz].
        contact_rate: rate at which overlaps of bodies and slips of feet were evaluated [Hz]. None if no bodies
            overlapped and no robot can walk.
        moves: results of the moves that the run consists of, in order: instances of
            :class:`~simrob_drake.results.verdict.moves.MoveVerdict`.
        ended: how the run ended, in words. Empty if that is not known.
        severity_of_end: severity of how the run ended.
        doubts: reasons of the solver why the result may be wrong, in words.
        notes: facts about the station that matter for all values, in words, such as estimated inertias.
    """

    measures: tuple[Measure, ...]
    sample_rate: float
    contact_rate: float | None = None
    moves: tuple[Any, ...] = ()
    ended: str = ""
    severity_of_end: Severity = "success"
    doubts: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()

    def __getitem__(self, name: str) -> Measure:
        """Result of a criterion by its name, such as ``final_error``.

        Raises:
            UnknownName: there is no such criterion, or it had nothing to measure.
        """
        known = {measure.criterion.name: measure for measure in self.measures}
        return known[one_of(message("results.criterion", "criterion"), name, known)]

    @property
    def beyond(self) -> list[str]:
        """Names of the criteria whose bounds are violated."""
        return [measure.criterion.name for measure in self.measures if measure.warning]

    @property
    def warnings(self) -> list[str]:
        """A sentence for each criterion whose bound is violated, then the warnings of the moves; no doubts."""
        warnings = [measure.warning for measure in self.measures if measure.warning]
        for move in self.moves:
            warnings += move.warnings
        return warnings

    @property
    def remarks(self) -> list[Remark]:
        """Remarks about the run: a sentence that sums it up, one for each doubt and each warning, then notes.

        Warnings have their remedies. A run that failed has the sentence only: what its signals violate after that is
        no news.
        """
        if self.severity_of_end == "failure":
            return [Remark("failure", self.sentence)]
        warnings = [Remark(VIOLATION, doubt) for doubt in self.doubts]
        warnings += [measure.remark for measure in self.measures if measure.remark is not None]
        for move in self.moves:
            warnings += move.remarks
        # Notes do not count: they are true of good runs, too.
        severity = worst_severity([Remark(self.severity_of_end, self.ended), *warnings])
        # The sentence comes first, with the severity of the worst remark: pages show it as the headline.
        return [
            Remark(severity, self.sentence),
            *warnings,
            *(Remark("note", note) for note in self.notes),
        ]

    @property
    def severity(self) -> Severity:
        """Severity of the whole verdict: that of its worst remark."""
        return self.remarks[0].severity

    @property
    def sentence(self) -> str:
        """A sentence on how the run ended and which values violate their bounds, without a capital and a full stop.

        For example: ``ran to its end at 3 s. Two targets missed, by up to 31.3 mm``.
        """
        parts = [part for part in (self.ended, self.judgement) if part]
        return join_texts(parts, ". ")

    @property
    def judgement(self) -> str:
        """The part of the sentence about values that violate their bounds. It is empty if the run failed."""
        if self.severity_of_end == "failure":
            return ""
        return join_texts(self._judgements(), ". ")

    def _judgements(self) -> Iterator[Message]:
        """Yield the sentences of the judgement: on missed targets, violated bounds, moves, and the solver's doubts.

        If there is nothing to say about any of these, the only sentence is that all is within bounds.
        """
        misses = [move.position_error for move in self.moves if move.misses_target]
        if misses:
            yield _missed_targets(misses)
        beyond = [measure.criterion.title_message for measure in self.measures if measure.warning]
        if len(beyond) == 1:
            yield message("results.one_bound", "One bound exceeded: {titles}", titles=beyond[0])
        elif beyond:
            count = count_in_words(len(beyond))
            titles = join_texts(beyond)
            yield message(
                "results.several_bounds",
                "{count} bounds exceeded: {titles}",
                count=count,
                titles=titles,
            )
        # Each move that misses its target has one remark about that. The rest is about paths, speeds and
        # distances.
        others = sum(len(move.remarks) for move in self.moves) - len(misses)
        if others == 1:
            yield message("results.other_warning", "One more warning about a move")
        elif others:
            yield message(
                "results.other_warnings",
                "{count} more warnings about moves",
                count=count_in_words(others),
            )
        # The sentence names friction, the usual doubt after an import. For all others it refers to the warnings.
        frictions_alone = bool(self.doubts) and all(map(_is_about_friction, self.doubts))
        if frictions_alone:
            yield message("results.friction_left_out", "Joint friction was left out")
        elif self.doubts:
            yield message("results.solver_doubts", "The result may be inaccurate: see the warning")
        if not (misses or beyond or others or self.doubts):
            yield message("results.all_within", "All within bounds")

    @property
    def table(self) -> list[CriterionRow]:
        """The table of criteria: those that are violated first.

        Criteria whose worst value is 0 or negative are left out, except for distances; so are those without entries.
        """
        shown = [
            measure
            for measure in self.measures
            if measure.criterion.least or measure.worst.value > 0
        ]
        rows = [measure.row for measure in shown if measure.entries]
        # Sorting is stable: otherwise the criteria keep their order.
        return sorted(rows, key=lambda row: row.severity != VIOLATION)

    def __str__(self) -> str:
        """The sentence of the verdict."""
        return capitalize(self.sentence)

    def __repr__(self) -> str:
        """The sentence, and the table of criteria."""
        return "\n".join([str(self), *text_table([self.headings, *self.cells])])

    @property
    def headings(self) -> tuple[str, ...]:
        """Headings of the table of criteria."""
        return TABLE_HEADINGS

    @property
    def cells(self) -> list[tuple[str, ...]]:
        """Rows of the table of criteria as texts; the severities are words, such as ``ok``."""
        return [(SEVERITY_WORDS[row.severity], *row[1:]) for row in self.table]

    def _repr_html_(self) -> str:
        """The sentence, the warnings with their remedies, and the table of criteria, as a notebook shows them."""
        return html_of_remarks(self.sentence, self.remarks, [self.headings, *self.cells])

    def summary(self) -> dict[str, Any]:
        """Content for ``summary.json``."""
        return {
            "severity": self.severity,
            "sentence": capitalize(self.sentence),
            "remarks": [remark.summary() for remark in self.remarks[1:]],
            "sample_rate": self.sample_rate,
            "contact_rate": self.contact_rate,
            "figures": {measure.criterion.name: measure.summary() for measure in self.measures},
            "moves": [move.summary() for move in self.moves],
        }


def _is_about_friction(doubt: str) -> bool:
    """Whether a reason why a result may be wrong is joint friction that the import of a robot left out."""
    return isinstance(doubt, Message) and doubt.id == "stations.friction_left_out"


def _missed_targets(misses: Sequence[float]) -> Message:
    """Write the count of moves that missed their targets, and the largest distance of these [m]."""
    distance = in_words(max(misses), "m")
    if len(misses) == 1:
        return message(
            "results.missed_target", "One target missed, by {distance}", distance=distance
        )
    count = count_in_words(len(misses))
    return message(
        "results.missed_targets",
        "{count} targets missed, by up to {distance}",
        count=count,
        distance=distance,
    )


def join_verdicts(
    verdicts: Sequence[Verdict],
    durations: Sequence[float],
    names: Sequence[str] = (),
    starts: Sequence[float] = (),
) -> Verdict:
    """Combine the verdicts on runs that follow each other. For each subject the worst value of all runs is kept.

    A value that is a share of the time becomes a share of the whole time. Times of the combined verdict count from the
    start of the first run. How the last run ended, doubts and notes are not set.

    Args:
        verdicts: the verdicts, in the order of the runs.
        durations: durations of the runs [s].
        names: names of the moves that the runs are, such as ``move 2``. Empty if they have none.
        starts: simulated times at which the runs start [s]. Empty if all start at 0.
    """
    begins = np.cumsum([0.0, *durations])[:-1].tolist()
    total_time = sum(durations)
    entries: dict[Criterion, dict[str, MeasuredValue]] = {}  # the combined entry of each subject
    left_out: dict[Criterion, dict[str, str]] = {}
    moves = list[Any]()
    # The remedy of the latest run in which the criterion is violated.
    remedies: dict[Criterion, Remedy | None] = {}
    move_names = names or [""] * len(verdicts)
    start_times = starts or [0.0] * len(verdicts)
    for verdict, begin, start, duration, name in zip(
        verdicts, begins, start_times, durations, move_names, strict=True
    ):
        shift = begin - start  # from the time of the run to that of the program [s]
        for measure in verdict.measures:
            if measure.warning:
                remedies[measure.criterion] = measure.remedy
            own = entries.setdefault(measure.criterion, {})  # combined entries of this criterion
            left_out.setdefault(measure.criterion, {}).update(measure.left_out)
            for entry in measure.entries:
                time = None if entry.time is None else shift + entry.time
                shifted = entry._replace(time=time, move=name or entry.move)
                before = own.get(entry.subject)
                own[entry.subject] = _combine(measure, before, shifted, duration, total_time)
        moves += [move.later(begin) for move in verdict.moves]

    measures = []
    for criterion, own in entries.items():
        # A subject that is judged in one of the runs counts as judged, such as an axis that has a motor in some runs.
        never_judged = {
            subject: why for subject, why in left_out[criterion].items() if subject not in own
        }
        measures.append(
            Measure(criterion, tuple(own.values()), never_judged, remedies.get(criterion))
        )
    contact_rates = [verdict.contact_rate for verdict in verdicts if verdict.contact_rate]
    return Verdict(
        measures=tuple(measures),
        sample_rate=min(verdict.sample_rate for verdict in verdicts),
        contact_rate=min(contact_rates) if contact_rates else None,
        moves=tuple(moves),
    )


def with_move_names(verdict: Verdict, spans: Sequence["MoveSpan"]) -> Verdict:
    """Add to each value of a program the name of the move in which it occurred.

    Values that have the name of a move already, or no time, are not changed.

    Args:
        verdict: verdict on the program.
        spans: when the moves of the program began and ended.
    """
    measures = []
    for measure in verdict.measures:
        entries = tuple(
            entry._replace(move=entry.move or _move_at(entry.time, spans))
            for entry in measure.entries
        )
        measures.append(replace(measure, entries=entries))
    return replace(verdict, measures=tuple(measures))


def _move_at(time: float | None, spans: Sequence["MoveSpan"]) -> str:
    """Name of the move that a program made at a time [s]. Empty if the time is None, or no move was made then.

    At the time at which a move ends and the next one begins, it is the one that ends: its final error occurs then.

    Args:
        time: the time, since the start of the program [s].
        spans: when the moves of the program began and ended, in order.
    """
    if time is None:
        return ""
    for span in spans:
        # A move without duration, such as one that attaches a piece, has no values of its own.
        has_duration = span.end > span.begin
        is_inside = span.begin - _TIME_ROUNDING <= time <= span.end + _TIME_ROUNDING
        if has_duration and is_inside:
            return move_title(span.index) if span.is_named else ""
    return ""


def _combine(
    measure: Measure,
    known: MeasuredValue | None,
    new: MeasuredValue,
    duration: float,
    total_time: float,
) -> MeasuredValue:
    """Combine the entry of a subject in one run with its entry in the runs before: the worse of the two.

    Of equal entries, the earlier is kept. Shares of the time are added instead, each in proportion to the duration of
    its run.

    Args:
        measure: the measure that contains the new entry.
        known: combined entry of the runs before; None if they have none.
        new: entry in this run, with its time since the start of the first run.
        duration: duration of this run [s].
        total_time: duration of all runs [s].
    """
    if measure.criterion.per_time:
        # Each run adds its time at the limit, divided by the time of the program.
        share = new.value * duration / total_time if total_time else 0.0
        return new._replace(value=share + (known.value if known else 0.0))
    if known is None or measure._rank(new) > measure._rank(known):
        return new
    return known
