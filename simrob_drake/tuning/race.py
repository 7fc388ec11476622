"""A trial of a search whose runs are made one after the other, for as long as it may still be the best."""

from dataclasses import dataclass
from math import inf

from simrob_drake.tuning.rollout import Case
from simrob_drake.tuning.study import Study
from simrob_drake.tuning.trial import Row, Trial, made


@dataclass(frozen=True)
class Race(Trial):
    """All runs of one set of figures.

    Attributes:
        study: what tells what they cost.
        cases: the runs, in order.
        least: what the best of the trials before its batch costs; so a search that goes on is the same again.
    """

    study: Study
    cases: tuple[Case, ...]
    least: float = inf

    @property
    def columns(self) -> list[Row]:
        """What identifies each run."""
        return [row for case in self.cases for row in case.columns]

    def measured(self) -> list[Row]:
        """Make the runs; leave the others out once the mean of all would exceed the best even if they cost 0."""
        rows = list[Row]()
        for case in self.cases:
            rows += made(case).rows
            if sum(float(self.study.judged(row)[0][0]) for row in rows) > self.least * len(self.cases):
                break
        return rows
