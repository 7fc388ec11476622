"""A search for figures: what varies, what it costs, under which conditions, and which others prove it."""

import json
from collections.abc import Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import Field

from simrob_drake.base.arguments import as_path
from simrob_drake.base.distributions import AnyDistribution, Choice, Values
from simrob_drake.base.errors import InvalidConfig, SimrobError, one_of
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import compound, message
from simrob_drake.base.packages import Border
from simrob_drake.base.sampling import Draws, Space, applying, at, choose_seeds, distinct
from simrob_drake.base.sections import (
    Boolean,
    Integer,
    NotNegative,
    Number,
    Positive,
    Strict,
    validate_section,
)
from simrob_drake.base.yaml_files import read_yaml
from simrob_drake.extensions.tuning.journal import COMPLETED, Row
from simrob_drake.extensions.tuning.rollout import SIGNED, UNITS, Case, Margin
from simrob_drake.extensions.tuning.scene import Scene, of_station
from simrob_drake.stations.file_paths import changes_with_absolute_paths, station_with_absolute_path
from simrob_drake.stations.load import load_station


class Conditions(Draws):
    """Changes of a station under which it is run for one figure of cost: every case, with every draw and every seed."""

    cases: list[dict[str, Any]] = Field(default=[{}], min_length=1)
    """Changes of the station, such as other loads, moves and pushes."""
    seeds: list[Annotated[int, Field(strict=True)]] = Field(default=[0], min_length=1)
    """Of all that is random in it."""
    drawn: Boolean = False
    """Whether each seed is another robot on another floor, too: joints 0.5° beside, other masses, other friction."""

    @property
    def every(self) -> dict[str, Values]:
        """All changes, by what errors call them: each case with each draw of what varies."""
        if not self.vary:
            return {f"cases.{place}": case for place, case in enumerate(self.cases)}
        draws = list(enumerate(self.draws(), start=1))
        every = enumerate(self.cases)
        return {
            message(
                "tuning.draw_of_cases", "cases.{place}, draw {number}", place=place, number=number
            ): {
                **case,
                **draw,
            }
            for place, case in every
            for number, draw in draws
        }

    @property
    def keys(self) -> list[str]:
        """All keys that are changed in some case."""
        return distinct([*(key for case in self.cases for key in case), *self.vary])

    def located(self, folder: Path, border: Border) -> Self:
        """Return them with absolute paths; raises InvalidConfig: one that may not be read."""
        cases = [changes_with_absolute_paths(case, folder, border) for case in self.cases]
        return self.model_copy(
            update={"cases": cases, "vary": located_space(self.vary, folder, border)}
        )


def located_space(
    space: Mapping[str, AnyDistribution], folder: Path, border: Border
) -> dict[str, AnyDistribution]:
    """Return distributions with absolute paths in what is chosen from; as :func:`changes_with_absolute_paths` does."""
    found = dict(space)
    for key, one in space.items():
        if isinstance(one, Choice):
            values = [
                changes_with_absolute_paths({key: value}, folder, border)[key]
                for value in one.values
            ]
            found[key] = one if values == one.values else Choice(values=values, when=one.when)
    return found


Method = Literal[
    "cma", "tpe", "gp", "genetic", "random", "nelder_mead", "powell", "differential_evolution"
]
SEVERAL_AIMS = (
    "genetic",
    "tpe",
    "gp",
    "random",
)  # methods that look for the best trades between several costs
Weights = Annotated[dict[str, Number], Field(min_length=1)]
Parameters = Values  # values of what varies, by key


class Study(Strict):
    """What ``study.yaml`` holds."""

    station: str
    """A name, or a file beside the study's."""
    overrides: dict[str, Any] = Field(default_factory=dict)
    """What is changed in all runs."""
    vary: Space = Field(min_length=1)
    """What is searched for: dotted paths of keys of the station, of a gait or of a program, and what they may be."""
    cost: Weights | Annotated[list[Weights], Field(min_length=2)]
    """Weights of measures; their weighted sum is to be small. Several in a list are traded for each other."""
    limits: dict[str, Positive] = Field(default_factory=dict)
    """What a measure must not exceed; beyond, a run costs ``failure`` times the part by which it does."""
    least: dict[str, Positive] = Field(default_factory=dict)
    """What a measure must not fall below, likewise."""
    margin: Margin | None = None
    """The push that the measure ``margin`` is about."""
    failure: NotNegative = 100.0
    """What a run costs that does not go to its end; one that ends at once costs twice as much."""
    method: Method = "cma"
    trials: Integer = Field(default=200, ge=1, le=1_000_000)
    """How many sets of figures are tried."""
    together: Integer = Field(default=8, ge=1, le=1000)
    """How many of them are chosen at a time, and tried side by side; the same for any number of processes."""
    seed: Integer = Field(default=0, ge=0)
    """Of the search."""
    prune: Boolean = False
    """Whether a trial is left, its other runs not made, once it must cost more than the best of the batches before."""
    search: Conditions = Conditions()
    proof: Conditions | None = None
    """Conditions that the search never sees; nothing is proven without."""

    @classmethod
    def read(cls, file: Path | str) -> Self:
        """Return a file's study; raises InvalidConfig: it is none; SimrobError: no such station, key or measure."""
        file = as_path(file, "file")
        study = validate_section(cls, read_yaml(file), file)
        study = study.located(file).model_copy(
            update={"station": station_with_absolute_path(study.station, file)}
        )
        study.check(file)
        return study

    def located(self, file: Path) -> Self:
        """Return the study with absolute paths in all that it changes; raises InvalidConfig: one is out of bounds."""
        folder, border = file.absolute().parent, Border(file)
        changed: dict[str, Any] = {
            kind: one.located(folder, border) for kind, one in self._conditions
        }
        changed["overrides"] = changes_with_absolute_paths(self.overrides, folder, border)
        return self.model_copy(update={"vary": located_space(self.vary, folder, border), **changed})

    def check(self, where: Path | str = "study") -> None:
        """Check what can be known before the search; raises SimrobError: no such station, key or measure."""
        for name in self.measures:
            one_of(message("tuning.measure", "measure"), name.rpartition(".")[2], UNITS)
        if len(self.aims) > 1 and self.method not in SEVERAL_AIMS:
            expected = message(
                "tuning.knows_one_cost",
                "knows one cost, and here are {count}; these know several: {methods}",
                count=len(self.aims),
                methods=", ".join(SEVERAL_AIMS),
            )
            raise InvalidConfig(
                where,
                message("tuning.method_called", "method {method}", method=self.method),
                expected,
            )
        if self.margin is None and any(name.endswith("margin") for name in self.measures):
            raise InvalidConfig(
                where,
                "margin",
                message("tuning.needed_for_margin", "this key is needed where a margin counts"),
            )
        for kind, conditions in self._conditions:
            self._check_conditions(kind, conditions, where)
        self._check_apart(where)
        if self.prune:
            self._check_prunable(where)

    def _check_prunable(self, where: Path | str) -> None:
        """Check that a study may be pruned: a trial is broken off once its first runs cost more than others.

        So there must be one cost to which each run can only add, and more than one run in a trial.

        Raises:
            InvalidConfig: at ``prune``.
        """
        signed = [
            name
            for aim in self.aims
            for name, weight in aim.items()
            if weight < 0 or name.rpartition(".")[2] in SIGNED
        ]
        if signed or len(self.aims) > 1:
            why = (
                message(
                    "tuning.can_count_less",
                    "and {measure} can count less than 0",
                    measure=signed[0],
                )
                if signed
                else message("tuning.and_here_are", "and here are {count}", count=len(self.aims))
            )
            raise InvalidConfig(
                where,
                "prune",
                message(
                    "tuning.one_cost_only", "is for one cost that no run lowers, {why}", why=why
                ),
            )
        if len(self.cases(self.start, self.search)) == 1:
            raise InvalidConfig(
                where,
                "prune",
                message(
                    "tuning.nothing_to_leave_out", "has nothing to leave out: each trial is one run"
                ),
            )

    def _check_conditions(self, kind: str, conditions: Conditions, where: Path | str) -> None:
        """Check the scene of each case, and of its first draw where something is drawn; the others differ in values."""
        for name, case in conditions.every.items():
            twice = next((key for key in case if key in self.vary), None)
            if twice is not None:
                raise InvalidConfig(
                    where,
                    f"{kind}.{name}.{twice}",
                    message("tuning.varies", "varies; a case cannot change it"),
                )
            called = {
                key: f"{kind}.{'vary' if key in conditions.vary else name} {key}" for key in case
            }
            called |= {key: f"overrides {key}" for key in self.overrides}
            called |= {key: f"vary {key}" for key in self.vary}
            scene = Scene.of(self.station, {**self.overrides, **case, **self.start}, called=called)
            if name.partition(", draw ")[2] not in ("", "1"):
                continue
            try:
                scene.check()
            except SimrobError as problem:
                raise InvalidConfig(where, f"{kind}.{name}", str(problem)) from None
            if self.margin is not None:
                scene.pushed(self.margin.push, 0.0)

    def _check_apart(self, where: Path | str) -> None:
        """Check that no run of the proof is one of the search: by what is run, however a file says it."""
        if self.proof is None:
            return
        seen = {case.scene().digest for case in self.cases(self.start, self.search)}
        names = [(name, seed) for name in self.proof.every for seed in self.proof.seeds]
        for (name, seed), case in zip(names, self.cases(self.start, self.proof), strict=True):
            if case.scene().digest in seen:
                same = message(
                    "tuning.run_of_the_search",
                    "is with seed {seed} a run of the search, too; a proof has others",
                    seed=seed,
                )
                raise InvalidConfig(where, f"proof.{name}", same)

    @property
    def _conditions(self) -> list[tuple[str, Conditions]]:
        return [("search", self.search), *([("proof", self.proof)] if self.proof else [])]

    @property
    def aims(self) -> list[dict[str, float]]:
        """The costs, each the weights of measures."""
        return self.cost if isinstance(self.cost, list) else [self.cost]

    @property
    def measures(self) -> list[str]:
        """All measures that count."""
        return list(
            dict.fromkeys([*(name for aim in self.aims for name in aim), *self.limits, *self.least])
        )

    @property
    def start(self) -> Parameters:
        """Where the search begins."""
        return applying(self.vary, [one.first for one in self.vary.values()])

    def at(self, parts: Vector) -> Parameters:
        """Return the figures at parts of what they may be, shape (n,)."""
        return at(self.vary, parts)

    def parameters_of(self, row: Mapping[str, Any]) -> Parameters:
        """Return the figures in the row of a trial; none if they cannot be those of one."""
        found = applying(self.vary, [row.get(key) for key in self.vary])
        return found if all(self.vary[key].holds(value) for key, value in found.items()) else {}

    def cases(self, parameters: Parameters, conditions: Conditions, first: int = 1) -> list[Case]:
        """Return the runs that tell what figures cost, numbered from ``first``."""
        runs = [(case, seed) for case in conditions.every.values() for seed in conditions.seeds]
        return [
            self._case(number, parameters, case, seed, drawn=conditions.drawn)
            for number, (case, seed) in enumerate(runs, start=first)
        ]

    def _case(
        self,
        number: int,
        parameters: Parameters,
        case: Mapping[str, Any],
        seed: int,
        *,
        drawn: bool,
    ) -> Case:
        changed = {**self.overrides, **case}
        streams = _streams(self.station, json.dumps(of_station(changed), sort_keys=True), seed)
        overrides = {**changed, **streams, **parameters}
        return Case(
            number, self.station, overrides, parameters, seed, drawn=drawn, margin=self.margin
        )

    def judged(self, row: Row) -> tuple[Vector, float]:
        """Return what a run costs, shape (aims,), and by which part it breaks limits, which is in these, too."""
        known = {name: float(row[name]) for name in self.measures if row.get(name) is not None}
        measures = {name: value for name, value in known.items() if np.isfinite(value)}
        counts = row["ended"] == COMPLETED or bool(row.get("fall") and "fall" in measures)
        if not counts or len(measures) < len(self.measures):
            done = (
                0.0
                if counts
                else float(row.get("stop_time", 0.0)) / float(row.get("duration", np.inf))
            )
            return np.full(len(self.aims), self.failure * (2.0 - done)), 2.0 - done
        over = sum(max(measures[name] / most - 1.0, 0.0) for name, most in self.limits.items())
        over += sum(max(1.0 - measures[name] / least, 0.0) for name, least in self.least.items())
        costs = [sum(weight * measures[name] for name, weight in aim.items()) for aim in self.aims]
        return np.array(costs) + self.failure * over, float(over)

    def mean(self, rows: Sequence[Row]) -> tuple[Vector, float]:
        """Return the means of what runs cost and of how far they break limits."""
        costs, over = zip(*(self.judged(row) for row in rows), strict=True)
        return np.mean(costs, axis=0), float(np.mean(over))

    def check_measures(self, rows: Sequence[Row]) -> None:
        """Check measures where the search begins; raises InvalidConfig: one that no run to its end has."""
        ended = [row for row in rows if row["ended"] == COMPLETED]
        for name in self.measures:
            if ended and all(row.get(name) is None for row in ended):
                raise InvalidConfig(
                    "study",
                    f"cost.{name}",
                    message("tuning.means_nothing", "means nothing in this station"),
                )


def in_table(value: Any) -> str:
    """Write a value for a table. None, the value of a key that the search does not change, is a dash."""
    if value is None:
        return "–"
    if isinstance(value, float):
        return compound("{value:.5g}", value=value)
    return str(value)


def named(costs: Vector) -> dict[str, float]:
    """Return costs, shape (aims,), by the names of their columns."""
    names = ["cost"] if len(costs) == 1 else [f"cost_{place}" for place in range(1, len(costs) + 1)]
    return dict(zip(names, costs.tolist(), strict=True))


@lru_cache(maxsize=1000)
def _streams(station: str, changed: str, seed: int) -> dict[str, int]:
    """Return the seeds of a station with changes, which are the same for all figures that are tried."""
    overrides = json.loads(changed)
    return choose_seeds(load_station(station, overrides).model_dump(), seed, overrides)
