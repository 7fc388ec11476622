"""A criterion by which runs are judged, and the figure that it gives of one."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from simrob_drake.frames import Vector
from simrob_drake.stations.solver_config import VerdictConfig

if TYPE_CHECKING:  # a run has a verdict
    from simrob_drake.results.record.run import RecordedRun


@dataclass(frozen=True)
class Measured:
    """What a criterion measured in a run, of k subjects: axes, feet, pairs of bodies.

    Attributes:
        subjects: what they are called.
        values: the worst of each, shape (k,), in SI units.
        times: when each was so, shape (k,) [s]; None where that is no moment.
        slides: which axes slide, shape (k,), so that what is in rad of others is in m; none unless given.
        limits: what shares are shares of, shape (k,), and their units.
    """

    subjects: Sequence[str]
    values: Vector
    times: Vector | None = None
    slides: Sequence[bool] = ()
    limits: tuple[Vector, Sequence[str]] = (np.zeros(0), ())


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
    """One thing by which runs are judged. Its name is that of its bound in :class:`VerdictConfig`.

    Attributes:
        name: of the figure, such as ``final_error``.
        unit: ``rad`` for axes (m where they slide; their bounds have the endings ``_deg`` and ``_m``), ``m``, or ``1``.
        title: of the figure, for lists.
        sentence: what a warning says, with ``{of}``, ``{value}``, ``{amount}`` and ``{when}``.
        measure: gives it of a run; None where there is nothing to measure.
        per_time: it is a part of the run's time: over runs that follow each other it is averaged.
        least: the smaller, the worse.
    """

    name: str
    unit: str
    title: str
    sentence: str
    measure: Callable[[RecordedRun], Measured | None]
    per_time: bool = False
    least: bool = False

    def entries(self, run: RecordedRun) -> list[MeasuredValue]:
        """Return what it finds in a run, of each subject."""
        found = self.measure(run)
        if found is None:
            return []
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
        return [
            MeasuredValue(subject, value, "m" if slides else self.unit, bounds[slides], time, limit, unit)
            for subject, value, slides, time, limit, unit in zip(*columns, strict=True)
        ]

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
