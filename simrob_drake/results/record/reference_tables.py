"""The references of a run as CSV files that its ``station.yaml`` can name, so that it can be run again."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
from pydrake.trajectories import Trajectory

from simrob_drake.blocks.references import Samples, hermite_samples
from simrob_drake.frames import Vector
from simrob_drake.parts.references.table import TIME_COLUMN, Interpolation, Table, speed_columns
from simrob_drake.results.record.run import RecordedRun
from simrob_drake.stations.config import StationConfig

_TRAJECTORY_RATE = 1000.0
"""Samples a second [Hz] of a Drake trajectory that is not made of smooth cubics."""


def write_table(file: Path, names: list[str], times: Vector, values: Vector) -> None:
    """Write numbers so that reading them gives the same bits."""
    with file.open("w", newline="", encoding="utf-8") as lines:
        writer = csv.writer(lines)
        writer.writerow([TIME_COLUMN, *names])
        writer.writerows(np.column_stack([times, values]).tolist())


def with_tables(result: RecordedRun, folder: Path) -> StationConfig:
    """Write the references that are no part of the configuration as tables, and return one that names them."""
    config = result.config
    for robot in config.robots:
        reference, given = config.reference_of(robot), result.references.get(robot)
        axes = result.plant.robots[robot].axes
        columns, way = list(axes), _way_through_samples(config)
        if isinstance(given, Trajectory):
            columns, way = [*axes, *speed_columns(axes)], "hermite"
            times, values = _rows_of(given, config.duration)
        elif given is not None:
            times, values = _arrays(given)
        elif isinstance(reference, Table):
            way = reference.interpolation
            columns = [*axes, *speed_columns(axes)] if way == "hermite" else columns
            times, values = _arrays(reference.rows(axes))
        else:
            continue
        file = Path("reference.csv" if config.only_robot else f"{robot}_reference.csv")
        write_table(folder / file, columns, times, values)
        config = _with_reference(config, robot, Table(kind="table", file=file, interpolation=way))
    return config


def _way_through_samples(config: StationConfig) -> Interpolation:
    """Return how samples that simulate() is given are joined: smoothly where their derivatives are needed."""
    return "linear" if config.mode == "dynamic" and "reference_velocity" not in config.inputs else "cubic"


def _rows_of(reference: Trajectory, duration: float) -> tuple[Vector, Vector]:
    """Return times (m,) and positions with velocities (m, 2n) of a trajectory, as far as a run follows it."""
    first, last = reference.start_time(), reference.end_time()
    start, end = max(first, 0.0), min(last, duration)
    if start >= end:  # it begins after the run, or is over before: one of its ends is held
        held = reference.value(float(np.clip(0.0, first, last)))[:, 0]
        return np.array([0.0, duration]), np.tile(np.append(held, np.zeros_like(held)), (2, 1))
    times, positions, velocities = hermite_samples(reference, start, end, _TRAJECTORY_RATE)
    return times, np.hstack([positions, velocities])


def _arrays(samples: Samples) -> tuple[Vector, Vector]:
    return np.asarray(samples[0], dtype=float), np.asarray(samples[1], dtype=float)


def _with_reference(config: StationConfig, robot: str, table: Table) -> StationConfig:
    if config.only_robot:
        return config.model_copy(update={"reference": table})
    entry = config.robots[robot].model_copy(update={"reference": table})
    return config.model_copy(update={"robots": {**config.robots, robot: entry}})
