"""Run a station over the values of its keys: every combination of them, or draws of all at once, with every seed."""

from collections.abc import Mapping, Sequence
from itertools import product
from math import prod
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from simrob_drake.base.distributions import Choice, Values
from simrob_drake.base.errors import InvalidParameter, Unsuitable
from simrob_drake.base.messages import message
from simrob_drake.base.sampling import (
    COUNT,
    MOST_SEEDS,
    Draws,
    Sampling,
    Space,
    applying,
    choose_seeds,
    distinct,
    seed_keys,
)
from simrob_drake.base.sections import Integer, Strict
from simrob_drake.extensions.tuning.rollout import Case
from simrob_drake.extensions.tuning.scene import Scene
from simrob_drake.stations.config import StationConfig

_MOST_RUNS = 100_000


class Sweep(Strict):
    """Runs of a station that differ in some of its keys."""

    station: str
    """A name, or a file."""
    vary: Space = Field(default_factory=dict)
    """Dotted paths of keys, and the values that each takes: every combination of those that are listed; others are
    drawn anew for each seed."""
    overrides: dict[str, Any] = Field(default_factory=dict)
    """What is changed in all runs."""
    seeds: Annotated[Integer, Field(ge=1, le=MOST_SEEDS)] = 1
    """How many runs each combination gets, with the seeds 0, 1, 2 ... of all that is random."""
    sampling: Sampling | None = None
    """How all keys are drawn at once, in place of every combination."""
    count: Annotated[Integer, Field(ge=1, le=10_000)] | None = None
    """How many such draws; of a grid, how many values of each key."""

    @property
    def combinations(self) -> list[tuple[Values, int]]:
        """The values of the keys in each run, and its seed: the last key varies fastest, and the seed faster still."""
        if self._draws is not None:
            return list(product(self._draws.draws(), range(self.seeds)))
        found = [
            (self._of_seed(values, seed), seed)
            for *values, seed in product(*self._listed, range(self.seeds))
        ]
        return distinct(found) if any(one.when for one in self.vary.values()) else found

    @property
    def _draws(self) -> Draws | None:
        """What draws all keys at once, if anything does."""
        if self.sampling is None:
            return None
        return Draws(vary=self.vary, sampling=self.sampling, count=self.count or COUNT)

    @property
    def _listed(self) -> list[Sequence[Any]]:
        """The values of each key that is combined with those of all others; None for one that is drawn."""
        return [one.values if isinstance(one, Choice) else (None,) for one in self.vary.values()]

    def _of_seed(self, values: list[Any], seed: int) -> Values:
        """Return values of all keys: those that are drawn, by this seed, another one for each place."""
        every = [
            value if isinstance(one, Choice) else one.draw(np.random.default_rng([seed, place]))
            for place, (one, value) in enumerate(zip(self.vary.values(), values, strict=True))
        ]
        return applying(self.vary, every)

    def check(self, *, allow_code: bool = False) -> StationConfig:
        """Check, before anything is run, all that can be known by then, and return the first run's station.

        ``allow_code`` lets the station name Python code. Raises SimrobError: a key that the station has not, values
        that are none, seeds without anything that is random, or too many runs.
        """
        twice = next((key for key in self.vary if key in self.overrides), None)
        if twice is not None:
            raise Unsuitable(
                f"--vary {twice}",
                message("tuning.set_gives_key", "--set gives this key already"),
                message("tuning.leave_out_one", "leave out one of the two"),
            )
        if self.count is not None and self.sampling is None:
            raise Unsuitable(
                "--count",
                message(
                    "tuning.belongs_to_sampling", "it belongs to --sampling, which is not given"
                ),
            )
        many = self.seeds * (self._draws.size if self._draws else prod(map(len, self._listed)))
        if many > _MOST_RUNS:
            raise InvalidParameter(
                "--vary",
                message("tuning.of_runs", "of {many} runs", many=many),
                message("tuning.of_at_most", "of at most {most}", most=_MOST_RUNS),
            )
        first, _ = self.combinations[0]
        called = {key: f"--set {key}" for key in self.overrides} | {
            key: f"--vary {key}" for key in first
        }
        scene = Scene.of(
            self.station, {**self.overrides, **first}, called=called, allow_code=allow_code
        )
        scene.check()
        if not (self.vary or self.seeds > 1):
            raise Unsuitable(
                "--vary",
                message("tuning.nothing_is_varied", "nothing is varied"),
                message("tuning.give_it_once", "give it at least once, or --seeds above 1"),
            )
        drawn = self._draws is None and not all(
            isinstance(one, Choice) for one in self.vary.values()
        )
        if self.seeds > 1 and not (drawn or seed_keys(scene.config.model_dump())):
            what = message(
                "tuning.one_where_nothing_random",
                "1 where nothing is random: no part of the station has a seed, nothing varies by uniform or normal",
            )
            raise InvalidParameter("--seeds", self.seeds, what)
        return scene.config

    def cases(self, *, allow_code: bool = False) -> list[Case]:
        """Return all runs, checked as :meth:`check` does."""
        content = self.check(allow_code=allow_code).model_dump()
        return [
            self._case(number, values, seed, content, allow_code)
            for number, (values, seed) in enumerate(self.combinations, start=1)
        ]

    def _case(
        self, number: int, values: Values, seed: int, content: Mapping[str, Any], allow_code: bool
    ) -> Case:
        streams = choose_seeds(content, seed, self.overrides) if self.seeds > 1 else {}
        return Case(
            number, self.station, {**self.overrides, **streams, **values}, values, seed, allow_code
        )
