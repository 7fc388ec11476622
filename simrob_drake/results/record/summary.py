"""What ``summary.json`` holds, and what the parts of a station say of a run in words."""

import platform
from collections.abc import Iterator
from dataclasses import asdict
from importlib.metadata import version
from typing import Any

import numpy as np

from simrob_drake.base.frames import Vector, pose_from_transform, transform_from_xyz_quaternion
from simrob_drake.base.messages import join_texts, message
from simrob_drake.results.record.run import DIVERGED, RecordedRun, begins_of
from simrob_drake.results.record.servos import servos_of
from simrob_drake.results.record.walks import legged_robots, locomotion
from simrob_drake.results.verdict.verdict import Verdict

_MOST_SPANS = 3  # count of spans of time that a remark lists


def remarks_of(run: RecordedRun) -> list[str]:
    """Sentences of a station's controllers about a run, such as the times at which a walk was asked for too much."""
    begins = begins_of(*run.parts) + run.start_time
    return [remark for begin, part in zip(begins, run.parts, strict=False) for remark in _remarks(part, float(begin))]


def _remarks(run: RecordedRun, begin: float) -> Iterator[str]:
    """Yield the remarks of the controllers of one run: the times at which an output with a remark was not zero.

    Args:
        run: the run.
        begin: time at which it began, since the beginning of the whole program [s]; for a single run its start.
    """
    times = begin + run.times - run.start_time
    for name, section in run.config.controllers.items():
        for output, remark in section.remarks.items():
            spans = _spans_of_nonzero(run[f"{name}.{output}"], times)
            if not spans:
                continue
            listed = join_texts(
                message("results.span_of_time", "{first:.2f} to {last:.2f} s", first=first, last=last)
                for first, last in spans[:_MOST_SPANS]
            )
            further = len(spans) - _MOST_SPANS
            more = message("results.and_times_more", " and {count} times more", count=further) if further > 0 else ""
            yield message(
                "results.remark_at_times",
                "{name} {remark}: {times}{more}",
                name=name,
                remark=remark,
                times=listed,
                more=more,
            )


def _spans_of_nonzero(values: Vector, times: Vector) -> list[tuple[float, float]]:
    """Find the spans of time in which a signal is not zero.

    Args:
        values: samples of the signal, shape (m,).
        times: times of the samples, shape (m,) [s].

    Returns:
        the times of the first and of the last sample of each span [s].
    """
    # A zero before the first sample and one after the last let a span begin or end there, too.
    is_nonzero = np.concatenate([[False], values != 0.0, [False]])
    # The changes are in turn the index of the first sample of a span, and that of the sample after its last one.
    changes = np.flatnonzero(np.diff(is_nonzero))
    spans = zip(changes[::2], changes[1::2], strict=True)
    return [(float(times[first]), float(times[end - 1])) for first, end in spans]


def pose_vector(pose: Vector) -> list[float]:
    """Return x y z qw qx qy qz as a pose vector [x y z Rz Ry Rx]."""
    return [float(value) for value in pose_from_transform(transform_from_xyz_quaternion(pose))]


def summary_of(run: RecordedRun, verdict: Verdict) -> dict[str, Any]:
    """Return how a run ended and why, final and largest values, measures of walks, speed and versions."""
    robots, only, torques = run.plant.robots, run.config.only_robot, _columns(run, "tau")
    names = {name: robot.model.name for name, robot in robots.items()}
    return {
        "station": run.config.name,
        "robot": names.get(only) if only else names or None,
        "duration": run.config.duration,
        "ending": run.ending,
        "stopped_by": run.stopped_by,
        "stop_time": run.stop_time,
        "message": run.message,
        "warnings": [*run.solver_warnings, *verdict.warnings],
        "verdict": verdict.summary(),
        "remarks": remarks_of(run),
        "solver": run.config.solver.model_dump() if run.config.engine.moves_by_forces else None,
        "steps": len(run.step_times) - 1,
        "wall_time": run.wall_time,
        "realtime_rate": run.realtime_rate,
        "final": {
            "joint_position": {axis: float(values[-1]) for axis, values in _columns(run, "q").items()},
            "joint_torque": {axis: float(values[-1]) for axis, values in torques.items()},
            "base_pose": _final_pose(run, "base"),
            "tcp_pose": _final_pose(run, "tcp"),
            "piece_pose": {piece: pose_vector(run.piece_pose(piece)[-1]) for piece in run.config.free_pieces},
        },
        "peak": {
            "joint_torque": {axis: float(values[np.argmax(np.abs(values))]) for axis, values in torques.items()},
            "force": _peak_forces(run),
        },
        "motors": _motors(run),
        "servos": servos_of(run),
        "locomotion": _locomotion(run),
        "cells": run.cells,
        "sensors": {name: run.notes[name] for name in run.config.sensors},
        "units": run.units,
        "versions": {
            "simrob_drake": version("simrob-drake"),
            "drake": version("drake"),
            "numpy": version("numpy"),
            "python": platform.python_version(),
        },
    }


def _locomotion(run: RecordedRun) -> dict[str, Any] | None:
    """Return how the legged robots walked, by robot where there are several; None where nothing could be told."""
    walkers = [] if run.ending == DIVERGED else legged_robots(run)
    found = {name: asdict(locomotion(run, name)) for name in walkers}
    return found.get(run.config.only_robot) if run.config.only_robot else found or None


def _motors(run: RecordedRun) -> dict[str, dict[str, float | None]]:
    """Return what each motor has, and what it gave at most; shares of its line and its heat are in the verdict."""
    found = dict[str, dict[str, float | None]]()
    for name, robot in run.plant.robots.items():
        speeds, torques = np.abs(run.axes("v", name)).max(axis=0), np.abs(run.axes("tau", name)).max(axis=0)
        for axis, motor, speed, torque in zip(robot.axes, robot.motors, speeds, torques, strict=True):
            if motor is not None:
                found[f"{robot.prefix}{axis}"] = {
                    "stall_torque": motor.line[0],
                    "no_load_speed": motor.line[1],
                    "rated_torque": motor.rated_torque,
                    "peak_torque": float(torque),
                    "peak_speed": float(speed),
                }
    return found


def _peak_forces(run: RecordedRun) -> dict[str, float]:
    """Return the largest size of every contact force [N] by sensor."""
    felt = [signal for signal in run.signals if signal.role == "force" and set(signal.names) <= set(run.names)]
    sizes = {signal.part: np.linalg.norm([run[name] for name in signal.names], axis=0) for signal in felt}
    return {name: float(size.max()) for name, size in sizes.items()}


def _columns(run: RecordedRun, signal: str) -> dict[str, Vector]:
    """Return a signal by axis."""
    return {
        f"{robot.prefix}{axis}": run[f"{robot.prefix}{signal}.{axis}"]
        for robot in run.plant.robots.values()
        for axis in robot.axes
    }


def _final_pose(run: RecordedRun, signal: str) -> Any:
    poses = {
        name: pose_vector(run.pose(signal, name)[-1])
        for name, robot in run.plant.robots.items()
        if f"{robot.prefix}{signal}.x" in run.names
    }
    return poses.get(run.config.only_robot) if run.config.only_robot else poses
