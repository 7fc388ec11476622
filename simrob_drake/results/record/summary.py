"""Content of a result's file ``summary.json``, and remarks about a run.

A *remark* is a sentence of a controller about a run, such as the times at which a walk was asked for too much. Entries
of the summary that belong to robots have the name of the robot as a further level, unless the station has only one
robot.
"""

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

_MOST_SPANS = 3
"""Largest count of spans of time that a remark lists."""


def remarks_of(run: RecordedRun) -> list[str]:
    """Remarks of a station's controllers about a run, or about all runs of a program, in order."""
    # The parts of a program are its runs; a single run is its own part. The last entry is the end of the last part.
    begins = begins_of(*run.parts)[:-1] + run.start_time
    remarks: list[str] = []
    for begin, part in zip(begins.tolist(), run.parts, strict=True):
        # Controllers may differ from run to run, so each run is asked for its own.
        remarks += _remarks(part, begin)
    return remarks


def _remarks(run: RecordedRun, begin: float) -> Iterator[str]:
    """Yield the remarks of the controllers of one run: the times at which an output with a remark was not zero.

    A remark lists the first three spans of time. The others are counted.

    Args:
        run: the run.
        begin: time at which it began, since the beginning of the whole program [s]; for a single run its start.
    """
    times = begin + run.times - run.start_time
    # A controller declares which of its outputs have a remark: the sentence for times at which they are not zero.
    for name, section in run.config.controllers.items():
        for output, remark in section.remarks.items():
            spans = _spans_of_nonzero(run[f"{name}.{output}"], times)
            if not spans:
                continue
            listed = join_texts(
                message(
                    "results.span_of_time", "{first:.2f} to {last:.2f} s", first=first, last=last
                )
                for first, last in spans[:_MOST_SPANS]
            )
            further = len(spans) - _MOST_SPANS
            more = (
                message("results.and_times_more", " and {count} more times", count=further)
                if further > 0
                else ""
            )
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
    """Convert a pose x y z qw qx qy qz to a pose vector [x y z Rz Ry Rx]."""
    return [float(value) for value in pose_from_transform(transform_from_xyz_quaternion(pose))]


def summary_of(run: RecordedRun, verdict: Verdict) -> dict[str, Any]:
    """Make the content of ``summary.json``.

    It has the end of the run, final and largest values, measures of walks, the real-time rate, and versions.

    Args:
        run: the run.
        verdict: the verdict about the run.
    """
    torques = _columns(run, "tau")
    models = {name: robot.model.name for name, robot in run.plant.robots.items()}
    return {
        "station": run.config.name,
        # null instead of an empty mapping: a station of pieces has no robot.
        "robot": _without_only_robot(run, models) or None,
        "duration": run.config.duration,
        "ending": run.ending,
        "stopped_by": run.stopped_by,
        "stop_time": run.stop_time,
        "message": run.message,
        "warnings": [*run.solver_warnings, *verdict.warnings],
        "verdict": verdict.summary(),
        "remarks": remarks_of(run),
        # A kinematic station has no solver.
        "solver": run.config.solver.model_dump() if run.config.engine.moves_by_forces else None,
        "steps": len(run.step_times) - 1,  # the start of the run is no step
        "wall_time": run.wall_time,
        "realtime_rate": run.realtime_rate,
        "final": {
            "joint_position": {
                axis: float(values[-1]) for axis, values in _columns(run, "q").items()
            },
            "joint_torque": {axis: float(values[-1]) for axis, values in torques.items()},
            "base_pose": _final_pose(run, "base"),
            "tcp_pose": _final_pose(run, "tcp"),
            "piece_pose": {
                piece: pose_vector(run.piece_pose(piece)[-1]) for piece in run.config.free_pieces
            },
        },
        "peak": {
            # With their signs.
            "joint_torque": {
                axis: float(values[np.argmax(np.abs(values))]) for axis, values in torques.items()
            },
            "force": _peak_forces(run),
        },
        "motors": _motors(run),
        "servos": servos_of(run),
        "locomotion": _locomotion(run),
        # Times at which a sequencer reached its cells [s], by its name.
        "cells": run.cells,
        # Kind of each sensor, and how its values were computed.
        "sensors": {name: run.notes[name] for name in run.config.sensors},
        "units": run.units,
        "versions": {
            "simrob_drake": version("simrob-drake"),
            "drake": version("drake"),
            "numpy": version("numpy"),
            "python": platform.python_version(),
        },
    }


def _without_only_robot(run: RecordedRun, entries: dict[str, Any]) -> Any:
    """Remove the level of the robots' names if the station has only one robot.

    Args:
        run: the run.
        entries: entries by robot.

    Returns:
        the entry of the only robot, None if it has none; in stations of several robots the entries as they are.
    """
    only_robot = run.config.only_robot
    return entries.get(only_robot) if only_robot else entries


def _locomotion(run: RecordedRun) -> dict[str, Any] | None:
    """Measures of the walks of legged robots, see `Locomotion`.

    Returns None if the station has no legged robots, or if the run diverged, since the measures have no meaning then.
    """
    if run.ending == DIVERGED:
        return None
    measures = {name: asdict(locomotion(run, name)) for name in legged_robots(run)}
    return _without_only_robot(run, measures) or None


def _motors(run: RecordedRun) -> dict[str, dict[str, float | None]]:
    """Parameters of each motor and its largest absolute torque and speed in the run, by the name of its axis.

    Torques are in N·m (N for axes that slide), speeds in rad/s (m/s), both after the gear. Axes without data of a motor
    are left out. The rated torque is None if it is not known. How much of its torque a motor used, and how warm it
    became, is in the verdict.
    """
    found = dict[str, dict[str, float | None]]()
    for name, robot in run.plant.robots.items():
        peak_speeds = np.abs(run.axes("v", name)).max(axis=0)
        peak_torques = np.abs(run.axes("tau", name)).max(axis=0)
        for index, motor in enumerate(robot.motors):
            if motor is None:  # the axis has a torque limit only
                continue
            stall_torque, no_load_speed = motor.line  # on the supply voltage of the robot
            found[f"{robot.prefix}{robot.axes[index]}"] = {
                "stall_torque": stall_torque,
                "no_load_speed": no_load_speed,
                "rated_torque": motor.rated_torque,
                "peak_torque": float(peak_torques[index]),
                "peak_speed": float(peak_speeds[index]),
            }
    return found


def _peak_forces(run: RecordedRun) -> dict[str, float]:
    """Largest magnitude of each contact force in the run [N], by the name of the sensor that measures the force."""
    recorded = set(run.names)
    peaks = {}
    for signal in run.signals:
        # A program has only the columns that all of its runs have, but the declarations of all of them.
        if signal.role == "force" and recorded.issuperset(signal.names):
            # Components of the vector, shape (3, m); the norm is its magnitude at each sample.
            components = [run[name] for name in signal.names]
            peaks[signal.part] = float(np.linalg.norm(components, axis=0).max())
    return peaks


def _columns(run: RecordedRun, signal: str) -> dict[str, Vector]:
    """Samples of a signal (m,) of all axes of all robots, by the name of the axis.

    The name begins with the robot's prefix, which is empty in stations with one robot.

    Args:
        run: the run.
        signal: ``q`` (position) or ``tau`` (torque or force).
    """
    columns = {}
    for robot in run.plant.robots.values():
        for axis in robot.axes:
            columns[f"{robot.prefix}{axis}"] = run[f"{robot.prefix}{signal}.{axis}"]
    return columns


def _final_pose(run: RecordedRun, signal: str) -> Any:
    """Last pose vector [x y z Rz Ry Rx] of a signal: a list, or in stations of several robots a dict by robot.

    Robots without the signal are left out. If the only robot of a station has no such signal, the result is None.

    Args:
        run: the run.
        signal: ``base`` or ``tcp``.
    """
    recorded = set(run.names)
    poses = {}
    for name, robot in run.plant.robots.items():
        # A robot without a tool has no signal `tcp`.
        if f"{robot.prefix}{signal}.x" in recorded:
            poses[name] = pose_vector(run.pose(signal, name)[-1])
    return _without_only_robot(run, poses)
