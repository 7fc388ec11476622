"""The folder of a study: every trial as it ends, the best of them, and what that is worth where it was never tried.

Trials stand in a journal of Optuna, ``trials.log``, which its own tools show, too.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from simrob_drake.errors import InvalidConfig
from simrob_drake.extras import needed
from simrob_drake.folders import alone_in, writing, written_at_once
from simrob_drake.frames import Vector
from simrob_drake.given import as_path
from simrob_drake.progress import progress_bar
from simrob_drake.tuning import journal
from simrob_drake.tuning.engines import Engine, engine
from simrob_drake.tuning.rollout import Row, killed, rollout
from simrob_drake.tuning.scene import Scene
from simrob_drake.tuning.search import Enough, search
from simrob_drake.tuning.study import Conditions, Figures, Study, named
from simrob_drake.tuning.table import write_rows
from simrob_drake.yaml_files import validated

STUDY, WINNER, TRIALS, FRONT, PROOF = "study.yaml", "winner.yaml", "trials.csv", "front.csv", "proof.csv"
_JOURNAL = "trials.log"


class StudyFolder:
    """A study and its trials, in a folder.

    Attributes:
        folder: where they stand.
        study: what is searched for.
        trials: the figures that were tried, and what each cost, in order.
    """

    def __init__(self, folder: Path | str, study: Study, *, force: bool = False) -> None:
        """Begin a study in a new folder, or go on with the same one.

        Raises:
            SimrobError: a study that cannot be, or the extra ``tune`` is missing.
            OutputError: the folder holds something else, or cannot be written.
            InvalidConfig: its station has changed since it began.
        """
        folder = as_path(folder, "folder")
        self.folder, self.study = folder, study
        study.check(folder / STUDY)
        digest = study.cases(study.start, study.search)[0].scene().digest
        if journal.take(folder, STUDY, study, digest, force=force, other=["trials"]):
            with writing(folder):
                (folder / _JOURNAL).unlink(missing_ok=True)
        self._kept = _journal(folder / _JOURNAL, len(study.aims))
        self.trials: list[tuple[Figures, Vector]] = []
        self._over: list[float] = []
        for trial in self._kept.trials:
            self.trials.append(({key: trial.params[key] for key in study.vary}, np.array(trial.values)))
            self._over.append(trial.constraints["limits"])
        self._asked = 0

    @classmethod
    def there(cls, folder: Path | str) -> "StudyFolder":
        """Return the study that stands in a folder.

        Raises:
            InvalidConfig: there is none, it is damaged, or its station has changed since.
        """
        place = as_path(folder, "folder")
        return cls(place, validated(Study, journal.asked_of(place, STUDY), place / STUDY))

    @property
    def best(self) -> tuple[Figures, Vector]:
        """The figures that cost least, and what they cost; of several costs the front's nearest to the least of all."""
        front = self.front()
        costs = np.array([self.trials[place][1] for place in front])
        span = np.ptp(costs, axis=0)
        parts = (costs - costs.min(axis=0)) / np.where(span > 0, span, 1.0)
        return self.trials[front[int(parts.sum(axis=1).argmin())]]

    def front(self) -> list[int]:
        """Return the places of the trials that no other beats in all costs at once; with one cost just the best."""
        if len(self.study.aims) > 1 and (best := self._kept.best_trials):
            return sorted(trial.number for trial in best)
        return [min(range(len(self.trials)), key=lambda place: float(self.trials[place][1].sum()))]

    def run(self, *, workers: int | None = None, scheduler: str | None = None, progress: bool = True) -> list[Row]:
        """Make the trials that are not made yet, and prove the best.

        Args:
            workers: how many processes of this machine; as many as it has processors unless given.
            scheduler: the address of a Dask scheduler whose workers do it instead.
            progress: show a bar.

        Returns:
            the runs of the proof, those of where the search began and then those of the best, with a column ``of``.

        Raises:
            SimrobError: the trials that are kept are not those of this search; no such scheduler.
        """
        study = self.study
        start = np.array([one.part(one.first) for one in study.vary.values()])
        with (
            alone_in(self.folder),
            engine(workers=workers, scheduler=scheduler) as workers_,
            progress_bar(f"{study.trials} trials", study.trials, shown=progress) as move,
        ):
            self._asked = 0

            def costs(points: Vector) -> tuple[Vector, Vector]:
                first = self._asked
                for _ in self._tried(workers_, points[: study.trials - first]):
                    if move:
                        move(self._asked, f"least cost {_told(self.best[1])}")
                if self._asked - first < len(points) or self._asked == study.trials:
                    raise Enough
                told = slice(first, self._asked)
                return np.array([cost for _, cost in self.trials[told]]), np.array(self._over[told])

            search(study.method, start, costs, together=study.together, seed=study.seed, aims=len(study.aims))
            proof = self._proof(workers_)
        self._write(proof)
        return proof

    def _tried(self, workers: Engine, points: Vector) -> Iterator[None]:
        """Try points, unless they are kept from before, and keep what they cost as soon as all before them are."""
        asked = [self.study.at(point) for point in points]
        known = self.trials[self._asked : self._asked + len(asked)]
        if any(figures != kept for figures, (kept, _) in zip(asked, known, strict=False)):
            told = "holds trials of a search by other versions of packages; begin another study"
            raise InvalidConfig(self.folder / _JOURNAL, "", told)
        self._asked += len(known)
        new = asked[len(known) :]
        for figures, rows in zip(new, self._runs(workers, new, self.study.search), strict=True):
            if not self.trials:
                self.study.check_measures(rows)
            self._keep(figures, *self.study.mean(rows), [row["ended"] for row in rows])
            self._asked += 1
            yield

    def _runs(self, workers: Engine, tried: list[Figures], under: Conditions) -> Iterator[list[Row]]:
        """Yield the rows of all runs of each set of figures, in order, as they come."""
        many = len(under.cases) * len(under.seeds)
        cases = [self.study.cases(figures, under, first=many * place) for place, figures in enumerate(tried)]
        rows: dict[int, Row] = {}
        place = 0
        for row in workers.outcomes(rollout, [case for some in cases for case in some], killed):
            rows[row["number"]] = row
            while place < len(cases) and all(case.number in rows for case in cases[place]):
                yield [rows[case.number] for case in cases[place]]
                place += 1

    def _proof(self, workers: Engine) -> list[Row]:
        found = self._runs(workers, [self.study.start, self.best[0]], self.study.proof)
        told = zip(("start", "best"), found, strict=True)
        return [{"of": of, **row, **named(self.study.judged(row)[0])} for of, rows in told for row in rows]

    def _keep(self, figures: Figures, costs: Vector, over: float, ended: list[str]) -> None:
        import optuna

        ranges: dict[str, optuna.distributions.BaseDistribution] = {
            key: optuna.distributions.FloatDistribution(one.low, one.high, log=one.log)
            for key, one in self.study.vary.items()
        }
        trial = optuna.create_trial(
            params=figures,
            distributions=ranges,
            values=costs.tolist(),
            constraints={"limits": over},
            user_attrs={"ended": ended},
        )
        self._kept.add_trial(trial)
        self.trials.append((figures, costs))
        self._over.append(over)

    def _write(self, proof: list[Row]) -> None:
        """Write what was found: all trials, those of the front, the winner, and the runs of the proof."""
        tried = [
            {"trial": place, **figures, **named(costs), "over_limits": over}
            for place, ((figures, costs), over) in enumerate(zip(self.trials, self._over, strict=True), start=1)
        ]
        write_rows(self.folder / TRIALS, tried)
        if len(self.study.aims) > 1:
            write_rows(self.folder / FRONT, [tried[place] for place in self.front()])
        write_rows(self.folder / PROOF, proof)
        winner = self.best[0]
        written_at_once(self.folder / WINNER, yaml.safe_dump(winner, sort_keys=False))
        Scene.of(self.study.station, {**self.study.overrides, **winner}).write(self.folder)


def _told(costs: Vector) -> str:
    return ", ".join(f"{cost:.4g}" for cost in costs)


def _journal(file: Path, aims: int) -> Any:
    """Return the study of Optuna that a file keeps."""
    with needed("a study", "tune"):
        import optuna
        from optuna.storages import JournalStorage
        from optuna.storages.journal import JournalFileBackend

    optuna.logging.set_verbosity(optuna.logging.WARNING)
    storage = JournalStorage(JournalFileBackend(str(file)))
    directions: Any = ["minimize"] * aims
    return optuna.create_study(study_name="simrob", storage=storage, directions=directions, load_if_exists=True)
