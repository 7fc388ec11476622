"""Cases drawn of distributions over keys: independently, evenly over all at once, or on a grid; and seeds."""

import json
from collections.abc import Mapping, Sequence
from itertools import product
from math import prod
from typing import Annotated, Any, Literal, TypeVar

import numpy as np
from pydantic import AfterValidator, Field, model_validator

from simrob_drake.base.distributions import AnyDistribution, Distribution, Values
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import message
from simrob_drake.base.sections import Integer, Strict

Sampling = Literal["sobol", "latin", "random", "grid"]
"""Sobol's sequence, scrambled; a Latin hypercube; independent draws; or all combinations of even spacings."""
COUNT = 16  # how many cases, unless told
_Case = TypeVar("_Case")
_MOST, _MOST_CASES = 10_000, 100_000


def _in_order(space: dict[str, AnyDistribution]) -> dict[str, AnyDistribution]:
    for place, (key, one) in enumerate(space.items()):
        for other in one.when.keys() - list(space)[:place]:
            raise ValueError(
                message(
                    "base.when_key_later",
                    "{key}.when.{other} must be a key that stands before {key}",
                    key=key,
                    other=other,
                )
            )
    return space


Space = Annotated[dict[str, AnyDistribution], AfterValidator(_in_order)]  # distributions by the dotted paths of keys


def applying(space: Mapping[str, Distribution], values: Sequence[Any]) -> Values:
    """Return the values of keys, those left out under whose conditions they are."""
    found: Values = {}
    for (key, one), value in zip(space.items(), values, strict=True):
        if one.applies(found):
            found[key] = value
    return found


def at(space: Mapping[str, Distribution], parts: Sequence[float] | Vector) -> Values:
    """Return the values at parts of their draws, shape (n,)."""
    return applying(space, [one.quantile(part) for one, part in zip(space.values(), parts, strict=True)])


def drawn(space: Mapping[str, Distribution], source: np.random.Generator) -> Values:
    """Return values at random; the same number of them is drawn whatever applies."""
    return applying(space, [one.draw(source) for one in space.values()])


def distinct(cases: Sequence[_Case]) -> list[_Case]:
    """Return cases in their order, each once."""
    return list({json.dumps(one, sort_keys=True, default=str): one for one in reversed(cases)}.values())[::-1]


class Draws(Strict):
    """Distributions over keys, and so many cases of them."""

    vary: Space = Field(default_factory=dict)
    """Of each key, by its dotted path."""
    count: Annotated[Integer, Field(ge=1, le=_MOST)] = COUNT
    """How many cases; of a grid, how many values of each key that is no choice."""
    sampling: Sampling = "sobol"
    """How they are spread over all keys at once."""
    seed: Annotated[Integer, Field(ge=0)] = 0
    """Of the draws."""

    @model_validator(mode="after")
    def _few_enough(self) -> "Draws":
        if self.size > _MOST_CASES:
            raise ValueError(message("base.too_many_cases", "a grid has at most {most} cases", most=_MOST_CASES))
        return self

    @property
    def size(self) -> int:
        """How many cases there are at most."""
        if self.sampling == "grid" or not self.vary:
            return prod(len(one.grid(self.count)) for one in self.vary.values())
        return self.count

    def draws(self) -> list[Values]:
        """Return the cases, the same for the same seed; one without any key where nothing varies."""
        if not self.vary:
            return [{}]
        if self.sampling == "grid":
            combined = product(*(one.grid(self.count) for one in self.vary.values()))
            return distinct([applying(self.vary, values) for values in combined])
        return [at(self.vary, parts) for parts in _points(self.sampling, len(self.vary), self.count, self.seed)]


def _points(sampling: Sampling, keys: int, count: int, seed: int) -> Vector:
    """Return parts of draws, 0 to 1, shape (count, keys)."""
    source = np.random.default_rng(seed)
    if sampling == "random":
        return source.random((count, keys))
    from scipy.stats import qmc  # which loads for long

    if sampling == "latin":
        return np.asarray(qmc.LatinHypercube(keys, rng=source).random(count))
    powers = (count - 1).bit_length()  # Sobol's sequence is even in powers of two: the first of one
    return np.asarray(qmc.Sobol(keys, rng=source).random_base2(powers)[:count])


MOST_SEEDS = 1000


def seeded(content: Mapping[str, Any], seed: int, changes: Mapping[str, Any]) -> dict[str, int]:
    """Return the seeds of all random parts of a station, each of a stream of its own but those in ``changes``."""
    own = seed_keys(changes)
    return {key: seed + MOST_SEEDS * place for place, key in enumerate(seed_keys(content)) if key not in own}


def seed_keys(content: Mapping[str, Any], above: str = "") -> list[str]:
    """Return the dotted paths of all keys ``seed`` in a station's sections: of noise, terrain and biases."""
    found = []
    for key, value in content.items():
        path = f"{above}{key}"
        if key.rpartition(".")[2] == "seed":
            found.append(path)
        elif isinstance(value, Mapping):
            found += seed_keys(value, f"{path}.")
    return found
