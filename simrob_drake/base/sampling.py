"""Cases: values of several keys, drawn from distributions or taken from a grid; and the seeds of random parts.

A case is a mapping of values by the dotted paths of keys. A *space* is a mapping of distributions by these paths.
"""

import json
from collections.abc import Mapping, Sequence
from itertools import product
from math import prod
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeAlias, TypeVar

import numpy as np
from pydantic import AfterValidator, Field, model_validator

from simrob_drake.base.distributions import AnyDistribution, Distribution, Values
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import message
from simrob_drake.base.renaming import former_names_of
from simrob_drake.base.sections import Integer, Strict

Sampling = Literal["sobol", "latin", "random", "grid"]
"""Ways to choose cases: the scrambled sequence of Sobol, a Latin hypercube, independent draws, or all combinations of
evenly spaced values."""

COUNT = 16
"""Count of cases by default."""

_MOST = 10_000
"""Largest count of cases that are drawn."""

_MOST_CASES = 100_000
"""Largest count of cases of a grid."""

_Case = TypeVar("_Case")
"""A case, or another object that JSON can write."""


def _check_order(space: dict[str, AnyDistribution]) -> dict[str, AnyDistribution]:
    """Check that the condition ``when`` of each key names keys before it only, and return the space.

    Raises:
        ValueError: a condition names another key.
    """
    before = set[str]()
    for key, distribution in space.items():
        # Values are chosen in the order of the keys, so a condition can only depend on keys that have a value by then.
        for other in distribution.when.keys() - before:
            raise ValueError(
                message(
                    "base.when_key_later",
                    "{key}.when.{other} must be a key that comes before {key}",
                    key=key,
                    other=other,
                )
            )
        before.add(key)
    return space


Space: TypeAlias = Annotated[dict[str, AnyDistribution], AfterValidator(_check_order)]
"""Distributions by the dotted paths of keys."""


def applying(space: Mapping[str, Distribution], values: Sequence[Any]) -> Values:
    """Make a case. Keys whose condition ``when`` is not met are left out.

    Args:
        space: distributions by key.
        values: one value for each key, in their order.
    """
    case: Values = {}
    for (key, distribution), value in zip(space.items(), values, strict=True):
        if distribution.applies(case):
            case[key] = value
    return case


def at(space: Mapping[str, Distribution], parts: Sequence[float] | Vector) -> Values:
    """Compute the case at a point of the space.

    Args:
        space: distributions by key.
        parts: shares of the draws of each key, from 0 to 1, shape (n,).
    """
    values = [
        distribution.quantile(part)
        for distribution, part in zip(space.values(), parts, strict=True)
    ]
    return applying(space, values)


def draw_case(space: Mapping[str, Distribution], source: np.random.Generator) -> Values:
    """Draw a case at random."""
    # Values of keys that will be left out are drawn, too, so that the following cases do not depend on the conditions.
    values = [distribution.draw(source) for distribution in space.values()]
    return applying(space, values)


def distinct(cases: Sequence[_Case]) -> list[_Case]:
    """Keep only one of several equal cases, at the place of the last of them.

    Cases are equal if JSON writes them equally.
    """
    kept: dict[str, _Case] = {}
    for case in cases:
        # Cases contain lists and mappings, which cannot be the keys of a dict. Their text in JSON can.
        key = json.dumps(case, sort_keys=True, default=str)
        # A dict appends a new key at its end, so an equal case is removed and added again.
        first = kept.pop(key, case)
        kept[key] = first
    return list(kept.values())


class Draws(Strict):
    """Distributions over keys, and how cases are chosen from them."""

    vary: Space = Field(default_factory=dict)
    """Distribution of each key that varies, by the dotted path of the key."""
    count: Annotated[Integer, Field(ge=1, le=_MOST)] = COUNT
    """Count of cases. In a grid, count of values for each key; a choice has all of its values."""
    sampling: Sampling = "sobol"
    """Method that spreads the cases over all keys."""
    seed: Annotated[Integer, Field(ge=0)] = 0
    """Seed of the random numbers. The same seed gives the same cases."""

    @model_validator(mode="after")
    def _check_size(self) -> "Draws":
        """Check that a grid has not too many cases."""
        if self.size > _MOST_CASES:
            raise ValueError(
                message("base.too_many_cases", "a grid has at most {most} cases", most=_MOST_CASES)
            )
        return self

    @property
    def size(self) -> int:
        """Largest count of cases. There are fewer if some of a grid are equal."""
        if self.sampling == "grid" or not self.vary:
            # The cases of a grid are only counted here: making them could fill the memory before the check of the size.
            return prod(len(distribution.grid(self.count)) for distribution in self.vary.values())
        return self.count

    def draws(self) -> list[Values]:
        """Choose the cases; they are the same for the same seed. Without keys there is one case, which is empty."""
        if not self.vary:
            return [{}]
        if self.sampling == "grid":
            combinations = product(
                *(distribution.grid(self.count) for distribution in self.vary.values())
            )
            # Combinations are equal if they differ in keys that are left out.
            return distinct([applying(self.vary, values) for values in combinations])
        points = _points(self.sampling, len(self.vary), self.count, self.seed)
        return [at(self.vary, parts) for parts in points]


def _points(sampling: Sampling, keys: int, count: int, seed: int) -> Vector:
    """Choose points of the unit cube: shares of the draws of each key, shape (count, keys).

    Args:
        sampling: how the points are chosen: all but ``grid``.
        keys: count of the keys.
        count: count of the points.
        seed: seed of the random numbers.
    """
    source = np.random.default_rng(seed)
    if sampling == "random":
        return source.random((count, keys))
    from scipy.stats import qmc  # imported here, since it takes long to load

    if sampling == "latin":
        return np.asarray(qmc.LatinHypercube(keys, rng=source).random(count))
    # Sobol's sequence is balanced for powers of two: the smallest one that is not below the count.
    exponent = (count - 1).bit_length()
    return np.asarray(qmc.Sobol(keys, rng=source).random_base2(exponent)[:count])


MOST_SEEDS = 1000
"""Distance between the seeds of two random parts of a station: so many runs with consecutive seeds share no stream."""


def choose_seeds(
    content: Mapping[str, Any], seed: int, changes: Mapping[str, Any]
) -> dict[str, int]:
    """Choose seeds for the random parts of a station, each with a stream of random numbers of its own.

    Args:
        content: content of the station's file.
        seed: seed of the run.
        changes: changes of the content, by dotted paths of keys. No seed is chosen for a key among them.

    Returns:
        the chosen seeds by the dotted paths of their keys.
    """
    fixed = seed_keys(changes)
    seeds = {}
    for index, key in enumerate(seed_keys(content)):
        if key not in fixed:
            seeds[key] = seed + MOST_SEEDS * index
    return seeds


def seed_keys(content: Mapping[str, Any], above: str = "") -> list[str]:
    """List the dotted paths of all keys ``seed`` in a station's sections: of noise, terrain and biases.

    Args:
        content: content of the station's file, or of a section of it.
        above: path of this section, with a dot at its end; empty for the whole file.
    """
    found = []
    for key, value in content.items():
        path = f"{above}{key}"
        # The keys of changes are whole paths, such as sensors.imu.seed.
        if key.rpartition(".")[2] == "seed":
            found.append(path)
        elif isinstance(value, Mapping):
            found += seed_keys(value, f"{path}.")
    return found


if not TYPE_CHECKING:
    # The type checker does not see the former names, so that this package cannot use them.
    __getattr__ = former_names_of(
        __name__,
        {
            "drawn": "draw_case",
            "seeded": "choose_seeds",
        },
    )
