"""What a caller asks of a run, checked: durations, references, pushes."""

from collections.abc import Mapping
from typing import Any, TypeAlias

import numpy.typing as npt
from pydantic import ValidationError
from pydrake.trajectories import PiecewisePolynomial, Trajectory

from simrob_drake.arguments import instance, seconds
from simrob_drake.blocks.references import Reference, Samples, SineReference
from simrob_drake.errors import InvalidParameter, one_of, quoted
from simrob_drake.frames import Vector, numbers
from simrob_drake.parts.forces import Push
from simrob_drake.stations.config import StationConfig, check_effort

ReferenceLike: TypeAlias = Reference | npt.ArrayLike | Samples
"""A trajectory (n, 1), an array (m, 1 + n) with the time first, or a pair of times (m,) and positions (m, n)."""
ReferencesLike: TypeAlias = ReferenceLike | Mapping[str, ReferenceLike] | None
"""One for the only robot, or some by robot; none as the station says."""


def with_duration(config: StationConfig, duration: Any) -> StationConfig:
    """Return a configuration with a duration [s], its own if None.

    Raises:
        InvalidParameter: no positive time, or so long that a run would have too many samples or steps.
    """
    if duration is None:
        return config
    longer = config.model_copy(update={"duration": seconds(duration)})
    check_effort(longer)
    return longer


def with_pushes(config: StationConfig, pushes: Mapping[str, Any] | None) -> StationConfig:
    """Return a configuration with other ``forces``, sections or keys, by name; raises InvalidParameter: none such."""
    if pushes is None:
        return config
    instance(pushes, "pushes", Mapping, "a mapping of names to pushes")
    others = {name: force for name, force in config.forces.items() if not isinstance(force, Push)}
    made = dict[str, Push]()
    for name, push in pushes.items():
        try:
            made[name] = push if isinstance(push, Push) else Push.model_validate({"kind": "push", **push})
        except (ValidationError, TypeError) as problem:
            expected = "a mapping of at, start, duration and force, as under forces: in a station"
            raise InvalidParameter(f"pushes: {name}", quoted(push), expected) from problem
    return config.model_copy(update={"forces": {**others, **made}})


def by_robot(config: StationConfig, reference: Any) -> dict[str, Reference | Samples]:
    """Return references by robot, arrays as times and positions; raises InvalidParameter or UnknownName: for nobody."""
    if reference is None:
        return {}
    if not isinstance(reference, Mapping):
        if config.only_robot is None:
            raise InvalidParameter("reference", "one for all", f"a mapping by robot: {', '.join(config.robots)}")
        reference = {config.only_robot: reference}
    return {one_of("robot", name, config.robots): _trajectory_or_samples(one) for name, one in reference.items()}


def _trajectory_or_samples(reference: Any) -> Reference | Samples:
    if isinstance(reference, SineReference):
        return reference
    if isinstance(reference, Trajectory):
        empty = isinstance(reference, PiecewisePolynomial) and reference.get_number_of_segments() < 1
        if empty or not reference.rows() or reference.cols() != 1:
            shape = "no segment" if empty else f"{reference.rows()} x {reference.cols()}"
            raise InvalidParameter("reference", f"a trajectory of {shape}", "of shape (n, 1), one row a joint")
        return reference
    pair = isinstance(reference, tuple) and len(reference) == 2
    times, positions = map(numbers, reference) if pair else _split(numbers(reference))
    if times.ndim != 1 or positions.ndim != 2 or not (times.size and positions.size):
        expected = "a trajectory, an array (m, 1 + n) whose first column is the time, or a pair of times and positions"
        raise InvalidParameter("reference", quoted(reference), expected)
    return times, positions


def _split(rows: Vector) -> tuple[Vector, Vector]:
    """Return the first column of an array, and the others."""
    return (rows[:, 0], rows[:, 1:]) if rows.ndim == 2 and rows.size else (rows, rows)
