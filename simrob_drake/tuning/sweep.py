"""Run a station over the values of its keys: every combination of them, with every seed."""

from collections.abc import Mapping
from itertools import product
from math import prod
from typing import Annotated, Any

from pydantic import Field

from simrob_drake.errors import InvalidParameter
from simrob_drake.sections import Integer, Strict
from simrob_drake.stations.config import StationConfig
from simrob_drake.tuning.rollout import Case
from simrob_drake.tuning.scene import Scene
from simrob_drake.tuning.variation import MOST_SEEDS, Variation, parsed, seed_keys, seeded

_MOST_RUNS = 100_000


class Sweep(Strict):
    """Runs of a station that differ in some of its keys."""

    station: str
    """A name, or a file."""
    vary: dict[str, str] = Field(default_factory=dict)
    """Dotted paths of keys, and the values that each takes, as :func:`~simrob_drake.tuning.variation.parsed` reads."""
    overrides: dict[str, Any] = Field(default_factory=dict)
    """What is changed in all runs."""
    seeds: Annotated[Integer, Field(ge=1, le=MOST_SEEDS)] = 1
    """How many runs each combination gets, with the seeds 0, 1, 2 ... of all that is random."""

    @property
    def variations(self) -> list[Variation]:
        """What varies, in the order of the table's columns."""
        return [parsed(key, text) for key, text in self.vary.items()]

    def check(self, *, allow_code: bool = False) -> StationConfig:
        """Check, before anything is run, all that can be known by then, and return the first run's station.

        Args:
            allow_code: whether the station may name Python code.

        Raises:
            SimrobError: a key that the station has not, values that are none, seeds without anything that is random, or
                too many runs.
        """
        twice = next((key for key in self.vary if key in self.overrides), None)
        if twice is not None:
            raise InvalidParameter(f"--vary {twice}", "given beside --set", "left out, or the only one")
        variations = self.variations
        first = {one.key: one.values[0] if one.values else one.draw(0, 0) for one in variations}
        called = {key: f"--set {key}" for key in self.overrides} | {key: f"--vary {key}" for key in first}
        scene = Scene.of(self.station, {**self.overrides, **first}, called=called, allow_code=allow_code)
        scene.check()
        config = scene.config
        if not (variations or self.seeds > 1):
            raise InvalidParameter("--vary", "left out", "given at least once, or --seeds above 1")
        if self.seeds > 1 and not (any(one.drawn for one in variations) or seed_keys(config.model_dump())):
            what = "1 where nothing is random: no part of the station has a seed, nothing varies by uniform or normal"
            raise InvalidParameter("--seeds", self.seeds, what)
        count = self.seeds * prod(len(one.values) or 1 for one in variations)
        if count > _MOST_RUNS:
            raise InvalidParameter("--vary", f"of {count} runs", f"of at most {_MOST_RUNS}")
        return config

    def cases(self, *, allow_code: bool = False) -> list[Case]:
        """Return all runs: the last key varies fastest, and the seed faster still; checked as :meth:`check` does."""
        variations, content = self.variations, self.check(allow_code=allow_code).model_dump()
        combinations = product(*(one.values or (None,) for one in variations), range(self.seeds))
        return [
            self._case(number, dict(zip(variations, values, strict=True)), seed, content, allow_code)
            for number, (*values, seed) in enumerate(combinations, start=1)
        ]

    def _case(
        self, number: int, values: Mapping[Variation, Any], seed: int, content: Mapping[str, Any], allow_code: bool
    ) -> Case:
        shown = {
            one.key: value if one.drawn is None else one.draw(seed, place)
            for place, (one, value) in enumerate(values.items())
        }
        streams = seeded(content, seed, self.overrides) if self.seeds > 1 else {}
        return Case(number, self.station, {**self.overrides, **streams, **shown}, shown, seed, allow_code)
