"""Write a result to a folder: all of it or nothing."""

from __future__ import annotations

import csv
import json
from datetime import datetime
from pathlib import Path

import numpy as np
from pydrake.trajectories import Trajectory

from simrob_drake.folders import filled_at_once
from simrob_drake.frames import Vector
from simrob_drake.results.result import SimulationResult
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.load import station_yaml
from simrob_drake.stations.reference_config import Table
from simrob_drake.stations.references import TIME_COLUMN, Samples, read_table

RUNS = Path("runs")
SUMMARY = "summary.json"
_TRAJECTORY_RATE = 1000.0
"""Samples a second [Hz] of a Drake trajectory that is written as a table."""


def default_folder(station: str) -> Path:
    """Return ``runs/<station>-<date>-<time>``, with a number behind it where that exists."""
    stem = f"{station}-{datetime.now():%Y%m%d-%H%M%S}"
    candidates = (RUNS / (stem if number == 1 else f"{stem}-{number}") for number in range(1, 1000))
    return next(folder for folder in candidates if not folder.exists())


def save_result(
    result: SimulationResult, folder: Path, *, force: bool = False, recording: bool = True, video: bool = False
) -> Path:
    """Write summary, signals, plots, film strip, recording and the resolved station.

    Args:
        result: the run.
        folder: where to; it appears at once, when everything is in it.
        force: replace a result that is there.
        recording: write ``recording.html`` and ``film_strip.png``.
        video: write ``video.mp4``; needs the extra ``video``.

    Returns:
        the folder.

    Raises:
        OutputError: the folder cannot be written, or exists.
    """
    # matplotlib and Meshcat are loaded where they are needed: most commands do without
    from simrob_drake.results.film_strip import frame_writer, save_film_strip, save_video
    from simrob_drake.results.plots import save_plots

    if video:
        frame_writer()
    with filled_at_once(folder, marker=SUMMARY, force=force) as work:
        _write_summary(result, work / SUMMARY)
        _write_signals(result, work / "signals.csv")
        (work / "station.yaml").write_text(station_yaml(_with_tables(result, work)), encoding="utf-8")
        if result.start is not None:
            (work / "start.json").write_text(result.start.to_json() + "\n", encoding="utf-8")
        (work / "plots").mkdir()
        save_plots(result, work / "plots")
        if recording:
            from simrob_drake.results.recording import save_recording

            save_recording(result, work / "recording.html")
            save_film_strip(result, work / "film_strip.png")
        if video:
            save_video(result, work / "video.mp4")
    return folder


def _write_summary(result: SimulationResult, file: Path) -> None:
    file.write_text(json.dumps(result.summary(), indent=2, ensure_ascii=False) + "\n", encoding="utf-8")


def _write_signals(result: SimulationResult, file: Path) -> None:
    _write_table(file, result.names, result.times, result.values)


def _write_table(file: Path, names: list[str], times: Vector, values: Vector) -> None:
    """Write numbers so that reading them gives the same bits."""
    with file.open("w", newline="", encoding="utf-8") as lines:
        writer = csv.writer(lines)
        writer.writerow([TIME_COLUMN, *names])
        writer.writerows(np.column_stack([times, values]).tolist())


def _with_tables(result: SimulationResult, folder: Path) -> StationConfig:
    """Write the references that are no part of the configuration as tables, and return one that names them."""
    config = result.config
    for robot in config.robots:
        reference = config.reference_of(robot)
        given = result.references.get(robot)
        if given is None and not isinstance(reference, Table):
            continue
        axes = result.plant.robots[robot].axes
        linear = isinstance(given, tuple) and config.mode == "dynamic"
        if given is None and isinstance(reference, Table):
            given, linear = read_table(reference.file, axes), reference.interpolation == "linear"
        file = Path("reference.csv" if config.only_robot else f"{robot}_reference.csv")
        times, positions = _as_samples(given, config.duration)
        _write_table(folder / file, axes, times, positions)
        table = Table(kind="table", file=file, interpolation="linear" if linear else "cubic")
        config = _with_reference(config, robot, table)
    return config


def _as_samples(reference: Trajectory | Samples | None, duration: float) -> tuple[Vector, Vector]:
    if isinstance(reference, Trajectory):
        first, last = reference.start_time(), reference.end_time()
        start, end = max(first, 0.0), min(last, duration)
        if start >= end:  # it begins after the run, or is over before: one of its ends is held
            held = reference.value(float(np.clip(0.0, first, last)))[:, 0]
            return np.array([0.0, duration]), np.vstack([held, held])
        times = np.linspace(start, end, max(int((end - start) * _TRAJECTORY_RATE), 1) + 1)
        return times, reference.vector_values(times).T
    assert reference is not None
    return np.asarray(reference[0], dtype=float), np.asarray(reference[1], dtype=float)


def _with_reference(config: StationConfig, robot: str, table: Table) -> StationConfig:
    if config.only_robot:
        return config.model_copy(update={"reference": table})
    entry = config.robots[robot].model_copy(update={"reference": table})
    return config.model_copy(update={"robots": {**config.robots, robot: entry}})
