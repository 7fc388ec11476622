"""A search for figures of a station: what varies, what it costs, under which conditions, and which others prove it."""

import json
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from simrob_drake.errors import InvalidConfig, one_of
from simrob_drake.frames import Vector
from simrob_drake.quantities import NotNegative, Positive
from simrob_drake.stations.load import load_station
from simrob_drake.tuning.measures import UNITS
from simrob_drake.tuning.rollout import Case, Row
from simrob_drake.tuning.variation import seeded
from simrob_drake.yaml_files import Number, Strict, read_yaml, validated

Method = Literal["cma", "tpe", "genetic", "random", "nelder_mead", "powell", "differential_evolution"]
Figures = dict[str, float]
"""Values of what varies, by key."""


class Range(Strict):
    """Between which values a key varies, and where a search begins."""

    low: Number
    high: Number
    start: Number | None = None
    """Where a search begins; in the middle unless given."""
    log: bool = False
    """Whether the search goes by factors in place of differences."""

    @model_validator(mode="after")
    def _checked(self) -> Self:
        if not self.low < self.high:
            raise ValueError("low must be below high")
        if self.log and self.low <= 0:
            raise ValueError("low must be positive where the search is logarithmic")
        if self.start is not None and not self.low <= self.start <= self.high:
            raise ValueError("start must lie between low and high")
        return self

    def value(self, part: float) -> float:
        """Return the value at a part of the range, 0 to 1."""
        part = min(max(float(part), 0.0), 1.0)
        if self.log:
            return float(self.low * (self.high / self.low) ** part)
        return self.low + (self.high - self.low) * part

    def part(self, value: float) -> float:
        """Return at which part of the range a value lies."""
        if self.log:
            return float(np.log(value / self.low) / np.log(self.high / self.low))
        return (value - self.low) / (self.high - self.low)

    @property
    def first(self) -> float:
        """Where a search begins."""
        return self.value(0.5) if self.start is None else self.start


class Conditions(Strict):
    """Under which a station is run for one figure of cost: every case with every seed."""

    cases: list[dict[str, Any]] = Field(default=[{}], min_length=1)
    """Changes of the station, such as other loads, moves and pushes."""
    seeds: list[int] = Field(default=[0], min_length=1)
    """Of all that is random in it."""


class Study(Strict):
    """What ``study.yaml`` holds."""

    station: str
    """A name, or a file beside the study's."""
    overrides: dict[str, Any] = Field(default_factory=dict)
    """What is changed in all runs."""
    vary: dict[str, Range] = Field(min_length=1)
    """What is searched for: dotted paths of keys, and their ranges."""
    cost: dict[str, Number] = Field(min_length=1)
    """Weights of measures; their weighted sum is to be small."""
    limits: dict[str, Positive] = Field(default_factory=dict)
    """What a measure must not exceed; beyond, a run costs ``failure`` times the part by which it does."""
    failure: NotNegative = 100.0
    """What a run costs that does not go to its end; one that ends at once costs twice as much."""
    method: Method = "cma"
    trials: int = Field(default=200, ge=1, le=1_000_000)
    """How many sets of figures are tried."""
    together: int = Field(default=8, ge=1, le=1000)
    """How many of them are chosen at a time, and tried side by side; the same for any number of processes."""
    seed: int = Field(default=0, ge=0)
    """Of the search."""
    search: Conditions = Conditions()
    proof: Conditions = Conditions()
    """Conditions that the search never sees."""

    @classmethod
    def read(cls, file: Path) -> Self:
        """Return the study that a file holds.

        Raises:
            InvalidConfig: it is none.
            SimrobError: a station, a key or a measure that there is not.
        """
        study = validated(cls, read_yaml(file), file)
        beside = file.parent / study.station
        if beside.is_file():
            study = study.model_copy(update={"station": str(beside.resolve())})
        study.check(file)
        return study

    def check(self, where: Path | str = "study") -> None:
        """Check all that can be known before the search.

        Raises:
            SimrobError: a station, a key or a measure that there is not.
        """
        for name in (*self.cost, *self.limits):
            one_of("measure", name.rpartition(".")[2], UNITS)
        for kind, conditions in (("search", self.search), ("proof", self.proof)):
            for number, case in enumerate(conditions.cases):
                twice = next((key for key in case if key in self.vary), None)
                if twice is not None:
                    raise InvalidConfig(where, f"{kind}.cases.{number}.{twice}", "varies; a case cannot change it")
                called = {key: f"{kind}.cases.{number} {key}" for key in case}
                called |= {key: f"overrides {key}" for key in self.overrides}
                called |= {key: f"vary {key}" for key in self.vary}
                load_station(self.station, {**self.overrides, **case, **self.start}, called=called)

    @property
    def start(self) -> Figures:
        """Where the search begins."""
        return {key: one.first for key, one in self.vary.items()}

    def at(self, parts: Vector) -> Figures:
        """Return the figures at parts of their ranges, shape (n,)."""
        return {key: one.value(part) for (key, one), part in zip(self.vary.items(), parts, strict=True)}

    def cases(self, figures: Figures, conditions: Conditions, first: int = 1) -> list[Case]:
        """Return the runs that tell what figures cost, numbered from ``first``."""
        runs = [(case, seed) for case in conditions.cases for seed in conditions.seeds]
        return [self._case(number, figures, case, seed) for number, (case, seed) in enumerate(runs, start=first)]

    def _case(self, number: int, figures: Figures, case: Mapping[str, Any], seed: int) -> Case:
        changed = {**self.overrides, **case}
        streams = _streams(self.station, json.dumps(changed, sort_keys=True), seed)
        return Case(number, self.station, {**streams, **changed, **figures}, dict(figures), seed)

    def costs(self, row: Row) -> float:
        """Return what a run costs, from its row."""
        if row["ended"] != "completed":
            done = float(row.get("stop_time", 0.0)) / float(row.get("duration", np.inf))
            return self.failure * (2.0 - done)
        cost = sum(weight * _figure(row, name) for name, weight in self.cost.items())
        over = sum(max(_figure(row, name) / most - 1.0, 0.0) for name, most in self.limits.items())
        return float(cost + self.failure * over)


@lru_cache(maxsize=1000)
def _streams(station: str, changed: str, seed: int) -> dict[str, int]:
    """Return the seeds of a station with changes, which are the same for all figures that are tried."""
    return seeded(load_station(station, json.loads(changed)).model_dump(), seed)


def _figure(row: Row, name: str) -> float:
    """Return a measure of a run; the costs of one that means nothing there are nothing to compare."""
    value = row.get(name)
    if value is None:
        raise InvalidConfig("study", f"cost.{name}", "means nothing in this station")
    return float(value)
