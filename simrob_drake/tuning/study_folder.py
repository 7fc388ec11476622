"""The folder of a study: every trial as it ends, the best of them, and what that is worth where it was never tried.

Trials stand in a journal of Optuna, ``trials.log``, which its own tools show, too.
"""

from pathlib import Path
from typing import Any

import numpy as np
import yaml

from simrob_drake.errors import InvalidConfig, OutputError
from simrob_drake.folders import alone_in, check_folder, written_at_once
from simrob_drake.frames import Vector
from simrob_drake.progress import progress_bar
from simrob_drake.stations.load import load_station, station_yaml
from simrob_drake.tuning.engines import Engine, engine
from simrob_drake.tuning.packages import needed
from simrob_drake.tuning.rollout import Row, killed, rollout
from simrob_drake.tuning.search import Enough, search
from simrob_drake.tuning.study import Conditions, Figures, Study
from simrob_drake.tuning.sweep_folder import station_digest, write_rows
from simrob_drake.yaml_files import read_yaml, validated

STUDY, STATION, TRIALS, PROOF = "study.yaml", "station.yaml", "trials.csv", "proof.csv"
_JOURNAL = "trials.log"


class StudyFolder:
    """A study and its trials, in a folder.

    Attributes:
        folder: where they stand.
        study: what is searched for.
        trials: the figures that were tried, and what each cost, in order.
    """

    def __init__(self, folder: Path, study: Study, *, force: bool = False) -> None:
        """Begin a study in a new folder, or go on with the same one.

        Raises:
            SimrobError: a study that cannot be, or the extra ``tune`` is missing.
            OutputError: the folder holds something else, or cannot be written.
            InvalidConfig: its station has changed since it began.
        """
        self.folder, self.study = folder, study
        study.check(folder / STUDY)
        if not force and (folder / STUDY).is_file():
            found = validated(Study, read_yaml(folder / STUDY), folder / STUDY)
            if found.model_copy(update={"trials": study.trials}) != study:
                raise OutputError(f"{folder} holds another study; choose another folder or replace it with --force")
        else:
            check_folder(folder, marker=STUDY, force=force)
            (folder / _JOURNAL).unlink(missing_ok=True)
        written_at_once(folder / STUDY, yaml.safe_dump(study.model_dump(mode="json"), sort_keys=False, width=120))
        self._kept = _journal(folder / _JOURNAL)
        digest = station_digest(load_station(study.station, {**study.overrides, **study.start}))
        if self._kept.user_attrs.get("station", digest) != digest:
            changed = "has changed since this study began; begin another, or put it back"
            raise InvalidConfig(folder / STUDY, study.station, changed)
        self._kept.set_user_attr("station", digest)
        self.trials: list[tuple[Figures, float]] = [
            ({key: trial.params[key] for key in study.vary}, trial.value) for trial in self._kept.trials
        ]
        self._asked = 0

    @property
    def best(self) -> tuple[Figures, float]:
        """The figures that cost least, and what they cost."""
        return min(self.trials, key=lambda trial: trial[1])

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

            def costs(points: Vector) -> Vector:
                found = self._costs(workers_, points[: study.trials - self._asked])
                if move:
                    move(self._asked, f"least cost {self.best[1]:.4g}")
                if len(found) < len(points) or self._asked == study.trials:
                    raise Enough
                return found

            search(study.method, start, costs, together=study.together, seed=study.seed)
            proof = self._proof(workers_)
        tried = [{"trial": place, **one, "cost": cost} for place, (one, cost) in enumerate(self.trials, start=1)]
        write_rows(self.folder / TRIALS, tried)
        write_rows(self.folder / PROOF, proof)
        winner = load_station(study.station, {**study.overrides, **self.best[0]})
        written_at_once(self.folder / STATION, station_yaml(winner))
        return proof

    def _costs(self, workers: Engine, points: Vector) -> Vector:
        """Return what points cost, from what is kept or from new runs, and keep that."""
        asked = [self.study.at(point) for point in points]
        known = self.trials[self._asked : self._asked + len(asked)]
        if any(figures != kept for figures, (kept, _) in zip(asked, known, strict=False)):
            told = "holds trials of a search by other versions of packages; begin another study"
            raise InvalidConfig(self.folder / _JOURNAL, "", told)
        new = asked[len(known) :]
        for figures, rows in zip(new, self._runs(workers, new, self.study.search), strict=True):
            cost = float(np.mean([self.study.costs(row) for row in rows]))
            self._keep(figures, cost, [row["ended"] for row in rows])
            self.trials.append((figures, cost))
        self._asked += len(asked)
        return np.array([cost for _, cost in self.trials[self._asked - len(asked) : self._asked]])

    def _runs(self, workers: Engine, tried: list[Figures], under: Conditions) -> list[list[Row]]:
        """Return the rows of all runs of each set of figures."""
        many = len(under.cases) * len(under.seeds)
        cases = [self.study.cases(figures, under, first=many * place) for place, figures in enumerate(tried)]
        flat = [case for some in cases for case in some]
        rows = {row["number"]: row for row in workers.outcomes(rollout, flat, killed)}
        return [[rows[case.number] for case in some] for some in cases]

    def _proof(self, workers: Engine) -> list[Row]:
        found = self._runs(workers, [self.study.start, self.best[0]], self.study.proof)
        told = zip(("start", "best"), found, strict=True)
        return [{"of": of, **row, "cost": self.study.costs(row)} for of, rows in told for row in rows]

    def _keep(self, figures: Figures, cost: float, ended: list[str]) -> None:
        import optuna

        ranges: dict[str, optuna.distributions.BaseDistribution] = {
            key: optuna.distributions.FloatDistribution(one.low, one.high, log=one.log)
            for key, one in self.study.vary.items()
        }
        trial = optuna.create_trial(params=figures, distributions=ranges, value=cost, user_attrs={"ended": ended})
        self._kept.add_trial(trial)


def _journal(file: Path) -> Any:
    """Return the study of Optuna that a file keeps."""
    with needed("a study"):
        import optuna
        from optuna.storages import JournalStorage
        from optuna.storages.journal import JournalFileBackend

    optuna.logging.set_verbosity(optuna.logging.WARNING)
    storage = JournalStorage(JournalFileBackend(str(file)))
    return optuna.create_study(study_name="simrob", storage=storage, load_if_exists=True)
