"""The folder of a study: every trial as it ends, the best of them, and what that is worth where it was never tried."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from math import inf
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from simrob_drake.base.arguments import as_path
from simrob_drake.base.errors import InvalidConfig, quote_value
from simrob_drake.base.folders import written_at_once
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import message
from simrob_drake.base.progress import progress_bar
from simrob_drake.base.yaml_files import read_yaml
from simrob_drake.extensions.tuning.analysis import plots_there, save_plots, study_in_optuna
from simrob_drake.extensions.tuning.journal import (
    ROWS,
    Journal,
    Record,
    Row,
    Trial,
    killed,
    made,
    read_spec,
    table,
    write_rows,
)
from simrob_drake.extensions.tuning.processes import Engine, engine
from simrob_drake.extensions.tuning.rollout import Case
from simrob_drake.extensions.tuning.scene import Scene
from simrob_drake.extensions.tuning.search import Enough, search
from simrob_drake.extensions.tuning.study import Conditions, Parameters, Study, named

STUDY, WINNER, TRIALS, FRONT, PROOF = (
    "study.yaml",
    "winner.yaml",
    "trials.csv",
    "front.csv",
    "proof.csv",
)
PLOTS = "plots"


def winner_of(folder: Path, study: Study) -> Parameters:
    """Return the figures that a study has found; raises InvalidConfig: it has not ended yet, or the file is damaged."""
    file = folder / WINNER
    if not file.is_file():
        raise InvalidConfig(
            folder,
            "",
            message(
                "tuning.has_no_winner",
                "has no {winner} yet: let simrob tune go on with it first",
                winner=WINNER,
            ),
        )
    content = read_yaml(file)
    wrong = next(
        (key for key, one in study.vary.items() if key in content and not one.holds(content[key])),
        None,
    )
    if wrong is not None:
        raise InvalidConfig(
            file,
            wrong,
            message(
                "tuning.value_of_study",
                "must be a value that the study may try (it is {content})",
                content=quote_value(content[wrong]),
            ),
        )
    parameters = study.parameters_of(content)
    if not parameters or parameters.keys() != content.keys():
        raise InvalidConfig(
            file,
            "",
            message(
                "tuning.values_of",
                "must hold figures of {vary}, and of nothing else",
                vary=", ".join(study.vary),
            ),
        )
    return parameters


class StudyFolder:
    """A study and its trials, in a folder."""

    def __init__(self, folder: Path | str, study: Study, *, force: bool = False) -> None:
        """Begin a study in a new folder, or go on with the same one.

        Raises SimrobError: a study that cannot be; OutputError: the folder holds something else, or cannot be written;
        InvalidConfig: its station has changed since it began, or a line of its journal is damaged.
        """
        folder = as_path(folder, "folder")
        self.folder, self.study = folder, study
        study.check(folder / STUDY)
        digest = study.cases(study.start, study.search)[0].scene().digest
        self.journal = Journal(
            folder, STUDY, study, digest, columns=self._columns, force=force, other=["trials"]
        )
        self._tried = {record.number: self._of(record) for record in self.journal.records}
        self._started = 0

    @classmethod
    def there(cls, folder: Path | str) -> "StudyFolder":
        """Return a folder's study; raises InvalidConfig: none, damaged, a changed station, or files out of bounds."""
        place = as_path(folder, "folder")
        return cls(place, read_spec(place, STUDY, Study).located(place / STUDY))

    @property
    def trials(self) -> list[tuple[Parameters, Vector]]:
        """The figures that were tried, and what each cost, in order."""
        return [(parameters, costs) for _, (parameters, costs, _) in sorted(self._tried.items())]

    @property
    def best(self) -> tuple[Parameters, Vector]:
        """The figures that cost least, and what they cost; of several costs the front's nearest to the least of all."""
        trials = self.trials
        front = [trials[place] for place in self.front()]
        costs = np.array([cost for _, cost in front])
        span = np.ptp(costs, axis=0)
        parts = (costs - costs.min(axis=0)) / np.where(span > 0, span, 1.0)
        return front[int(parts.sum(axis=1).argmin())]

    def front(self) -> list[int]:
        """Return the places of the trials that no other beats in all costs at once; with one cost just the best.

        Those that break limits count only where all do, and then by the sum of their costs.
        """
        costs = np.array([cost for _, cost in self.trials])
        within = np.flatnonzero([over <= 0 for _, (*_, over) in sorted(self._tried.items())])
        if len(self.study.aims) == 1 or not within.size:
            return [int(costs.sum(axis=1).argmin())]
        others = costs[within]
        beaten = [
            bool(((others <= own).all(axis=1) & (others < own).any(axis=1)).any()) for own in others
        ]
        return [int(place) for place in within[np.logical_not(beaten)]]

    def run(
        self, *, workers: int | None = None, scheduler: str | None = None, progress: bool = True
    ) -> list[Row]:
        """Make the trials that are not made yet, see :func:`engine`, prove the best, and return the proof's runs.

        Those of where the search began come first, then those of the best, with a column ``of``. Raises SimrobError:
        the trials that are kept are not those of this search; no such scheduler; the extra ``tune`` is missing, and
        needed.
        """
        study = self.study
        start = np.array([one.part(one.first) for one in study.vary.values()])
        with (
            self.journal.adding() as add,
            engine(workers=workers, scheduler=scheduler) as workers_,
            progress_bar(f"{study.trials} trials", study.trials, shown=progress) as move,
        ):
            self._tried = {record.number: self._of(record) for record in self.journal.records}
            self._started = 0

            def costs(points: Vector) -> tuple[Vector, Vector]:
                first = self._started
                for _ in self._make(workers_, points[: study.trials - first], add):
                    if move:
                        least = np.min([cost for _, cost in self.trials[: self._started]], axis=0)
                        cost = ", ".join(f"{one:.4g}" for one in least)
                        move(self._started, f"least cost {cost} after {self._started}")
                if self._started - first < len(points) or self._started == study.trials:
                    raise Enough
                made = [self._tried[number] for number in range(first + 1, self._started + 1)]
                return np.array([cost for _, cost, _ in made]), np.array(
                    [over for *_, over in made]
                )

            search(
                study.method,
                start,
                costs,
                together=study.together,
                seed=study.seed,
                aims=len(study.aims),
            )
            proof = self._proof(workers_)
        self._write(proof)
        return proof

    def _make(
        self, workers: Engine, points: Vector, add: Callable[[Record], None]
    ) -> Iterator[None]:
        """Try points, unless they are kept from before, and keep what they cost as soon as all before them are."""
        parameters_of = dict(enumerate(map(self.study.at, points), start=self._started + 1))
        for number, parameters in parameters_of.items():
            if number in self._tried and self._tried[number][0] != parameters:
                text = message(
                    "tuning.other_packages",
                    "holds trials of a search by other versions of packages; begin another study",
                )
                raise InvalidConfig(self.folder / ROWS, "", text)
        new = [
            parameters for number, parameters in parameters_of.items() if number not in self._tried
        ]
        trials: list[list[Any]] = self._cases(new, self.study.search)
        if self.study.prune:
            before = [
                cost[0] for number, (_, cost, _) in self._tried.items() if number <= self._started
            ]
            least = float(min(before, default=np.inf))
            trials = [
                [Race(place, self.study, tuple(cases), least)]
                for place, cases in enumerate(trials, start=1)
            ]
        runs = _in_order(workers, trials)
        for number in parameters_of:
            if number not in self._tried:
                rows = [row for record in next(runs) for row in record.rows]
                if not self._tried:
                    self.study.check_measures(rows)
                record = Record(number=number, rows=rows)
                add(record)
                self._tried[number] = self._of(record)
            self._started += 1
            yield

    def _cases(self, tried: list[Parameters], under: Conditions) -> list[list[Case]]:
        """Return the runs of each set of figures, all numbered from 1."""
        many = len(under.every) * len(under.seeds)
        return [
            self.study.cases(parameters, under, first=many * place + 1)
            for place, parameters in enumerate(tried)
        ]

    def _columns(self, record: Record) -> Sequence[Row]:
        """Return what identifies the runs of a trial: its figures, and their seeds."""
        parameters = self.study.parameters_of(record.rows[0])
        if not parameters:
            return []
        columns = [
            row for case in self.study.cases(parameters, self.study.search) for row in case.columns
        ]
        return columns[: len(record.rows)] if self.study.prune else columns

    def _of(self, record: Record) -> tuple[Parameters, Vector, float]:
        """Return the figures of a trial, what they cost, and by which part they break limits."""
        return self.study.parameters_of(record.rows[0]), *self.study.mean(record.rows)

    def _proof(self, workers: Engine) -> list[Row]:
        if self.study.proof is None:
            return []
        found = _in_order(workers, self._cases([self.study.start, self.best[0]], self.study.proof))
        return [
            {"of": of, **row, **named(self.study.judged(row)[0])}
            for of, records in zip(("start", "best"), found, strict=True)
            for row in table(records)
        ]

    def _write(self, proof: list[Row]) -> None:
        """Write what was found: all trials, those of the front, the winner, and the runs of the proof."""
        runs = {
            one.number: {"runs": len(one.rows)} for one in self.journal.records if self.study.prune
        }
        tried = [
            {
                "trial": number,
                **parameters,
                **named(costs),
                "over_limits": over,
                **runs.get(number, {}),
            }
            for number, (parameters, costs, over) in sorted(self._tried.items())
        ]
        write_rows(self.folder / TRIALS, tried)
        if len(self.study.aims) > 1:
            write_rows(self.folder / FRONT, [tried[place] for place in self.front()])
        write_rows(self.folder / PROOF, proof)
        if plots_there():
            found = study_in_optuna(self.study.method, self.study, self.journal.records)
            save_plots(found, self.folder / PLOTS)
        winner = self.best[0]
        written_at_once(self.folder / WINNER, yaml.safe_dump(winner, sort_keys=False))
        Scene.of(self.study.station, {**self.study.overrides, **winner}).write(self.folder)


def _in_order(workers: Engine, groups: Sequence[Sequence[Trial]]) -> Iterator[list[Record]]:
    """Yield the records of each group of trials, in order, as they come; no two trials have one number."""
    records: dict[int, Record] = {}
    place = 0
    for record in workers.outcomes(made, [trial for group in groups for trial in group], killed):
        records[record.number] = record
        while place < len(groups) and all(trial.number in records for trial in groups[place]):
            yield [records[trial.number] for trial in groups[place]]
            place += 1


@dataclass(frozen=True)
class Race(Trial):
    """All runs of one set of figures."""

    study: Study  # what tells what they cost
    cases: tuple[Case, ...]  # the runs, in order
    least: float = inf  # what the best of the trials before its batch costs; so a search that goes on is the same again

    @property
    def columns(self) -> list[Row]:
        """What identifies each run."""
        return [row for case in self.cases for row in case.columns]

    def measured(self) -> list[Row]:
        """Make the runs; leave the others out once the mean of all would exceed the best even if they cost 0."""
        rows = list[Row]()
        for case in self.cases:
            rows += made(case).rows
            if sum(float(self.study.judged(row)[0][0]) for row in rows) > self.least * len(
                self.cases
            ):
                break
        return rows
