"""What a caller asks of a run, checked: durations, references, pushes."""

from collections.abc import Mapping
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt
from pydantic import ValidationError
from pydrake.trajectories import Trajectory

from simrob_drake.blocks.references import Samples
from simrob_drake.errors import InvalidParameter, UnknownName, shortened
from simrob_drake.parts.forces.push import Push
from simrob_drake.stations.config import StationConfig, check_samples

Reference: TypeAlias = Trajectory | npt.ArrayLike | Samples
"""A trajectory (n, 1), an array (m, 1 + n) with the time first, or a pair of times (m,) and positions (m, n)."""


def with_duration(config: StationConfig, duration: Any) -> StationConfig:
    """Return a configuration with a duration [s], its own if that is None.

    Raises:
        InvalidParameter: no positive time, or so long that a run would have too many samples.
    """
    if duration is None:
        return config
    if isinstance(duration, bool) or not isinstance(duration, (int, float, np.number)):
        raise InvalidParameter("duration", repr(duration), "a positive time [s]")
    if not (np.isfinite(duration) and duration > 0):
        raise InvalidParameter("duration", duration, "a positive time [s]")
    check_samples(float(duration), config.sample_rate)
    return config.model_copy(update={"duration": float(duration)})


def with_pushes(config: StationConfig, pushes: Mapping[str, Any] | None) -> StationConfig:
    """Return a configuration with other pushes, by name: sections of ``forces``, or mappings of their keys.

    Raises:
        InvalidParameter: a push that cannot be.
    """
    if pushes is None:
        return config
    others = {name: force for name, force in config.forces.items() if not isinstance(force, Push)}
    made = dict[str, Push]()
    for name, given in pushes.items():
        try:
            made[name] = given if isinstance(given, Push) else Push.model_validate({"kind": "push", **given})
        except (ValidationError, TypeError) as problem:
            expected = "a mapping of at, start, duration and force, as under forces: in a station"
            raise InvalidParameter(f"pushes: {name}", shortened(repr(given)), expected) from problem
    return config.model_copy(update={"forces": {**others, **made}})


def by_robot(config: StationConfig, reference: Any) -> dict[str, Trajectory | Samples]:
    """Return references by robot, arrays split into times and positions.

    Raises:
        InvalidParameter: one for all where there are several robots, or something that is no reference.
        UnknownName: no such robot.
    """
    if reference is None:
        return {}
    if not isinstance(reference, Mapping):
        if config.only_robot is None:
            raise InvalidParameter("reference", "one for all", f"a mapping by robot: {', '.join(config.robots)}")
        reference = {config.only_robot: reference}
    for robot in reference:
        if robot not in config.robots:
            raise UnknownName("robot", robot, config.robots)
    return {robot: _trajectory_or_samples(value) for robot, value in reference.items()}


def _trajectory_or_samples(reference: Any) -> Trajectory | Samples:
    if isinstance(reference, Trajectory):
        return reference
    try:
        if isinstance(reference, tuple) and len(reference) == 2:
            return np.asarray(reference[0], dtype=float), np.asarray(reference[1], dtype=float)
        rows = np.asarray(reference, dtype=float)
    except (TypeError, ValueError) as problem:
        expected = "a trajectory, an array (m, 1 + n) whose first column is the time, or a pair of times and positions"
        raise InvalidParameter("reference", shortened(repr(reference)), expected) from problem
    if rows.ndim != 2 or rows.shape[1] < 2:
        raise InvalidParameter("reference", f"an array of shape {rows.shape}", "of shape (m, 1 + n), the time first")
    return rows[:, 0], rows[:, 1:]
