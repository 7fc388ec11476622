"""What the joints of a station are asked to do, what holds them beside each other, and where it begins."""

from collections import ChainMap
from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np
from pydrake.math import RigidTransform

from simrob_drake.base.arguments import SHORTEST
from simrob_drake.base.errors import SimrobError
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import message
from simrob_drake.extensions.simulink.mechanics.bodies import GEARS, ROD, SPRING, Coupling
from simrob_drake.extensions.simulink.mechanics.joints import Freedom
from simrob_drake.extensions.simulink.mechanics.trees import Tree
from simrob_drake.extensions.simulink.model.nodes import Node
from simrob_drake.extensions.simulink.signals.forms import Form, Value, blocks_in, closure, of_time
from simrob_drake.extensions.simulink.signals.laws import Law
from simrob_drake.extensions.simulink.simulink_model import SimulinkModel
from simrob_drake.extensions.simulink.writing.flow import FlowWriter
from simrob_drake.extensions.simulink.writing.touching import StationFiles
from simrob_drake.extensions.simulink.writing.urdf import RobotFile, pose_list
from simrob_drake.parts.controllers.signal_flow import flow_over_time
from simrob_drake.parts.references import MOST_VALUES
from simrob_drake.results.record.state import JointState, State
from simrob_drake.robots.imports import ImportReport
from simrob_drake.stations.config import JointStops

_CORNER = 2 * SHORTEST  # how long a step takes [s]: rows of a table must be a SHORTEST apart
RATE = 200.0  # rows a second of a table
_BENT, _FINER = 2e-3, 10  # of a range: by so much rows may bend, or there are so many times as many


@dataclass
class JointMotions:
    """Where the joints of a robot are asked to be."""

    files: StationFiles  # what is written
    axes: dict[Freedom, str]  # names by degree of freedom
    values: dict[Freedom, Value | None]  # positions [rad or m]; None of what nothing drives
    start: dict[str, float]  # where each axis is at the beginning, by name [rad or m]
    table: Path  # the CSV file to write where positions change over time

    @property
    def moving(self) -> dict[Freedom, Form]:
        """The positions that change over time, and depend on nothing else."""
        found = {freedom: self.values.get(freedom) for freedom in self.axes}
        return {
            freedom: value
            for freedom, value in found.items()
            if isinstance(value, Form) and of_time(value)
        }

    def reference(self) -> dict[str, Any]:
        """Return the reference section of the robot."""
        if self.moving:
            self._sample(self.axes)
            return {"kind": "table", "file": self.table.name, "interpolation": "linear"}
        units = {name: np.pi / 180 if freedom.turns else 1.0 for freedom, name in self.axes.items()}
        targets = {name: self._held(freedom) / units[name] for freedom, name in self.axes.items()}
        if targets == {name: self.start[name] / unit for name, unit in units.items()}:
            return {"kind": "hold"}
        return {
            "kind": "hold",
            "target_deg": {name: float(f"{value:.12g}") for name, value in targets.items()},
        }

    def prescribed(self) -> dict[str, dict[str, Any]]:
        """Return a reference for each joint, by its axis."""
        if moving := self.moving:
            self._sample({freedom: self.axes[freedom] for freedom in moving})
        # by a cubic spline, for the sake of its acceleration
        follow = {
            "kind": "table",
            "file": self.table.name,
        }
        return {
            axis: follow if freedom in moving else replace(self, axes={freedom: axis}).reference()
            for freedom, axis in self.axes.items()
        }

    def _sample(self, axes: dict[Freedom, str]) -> None:
        moving = self.moving
        taken = (block for terms in closure(moving.values()) for block in blocks_in([Form(terms)]))
        steps = {block.parameters["time"] for block in taken if block.kind == "step"}
        duration = self.files.model.duration
        corners = [corner for corner in steps if 0 < corner < duration]
        most = MOST_VALUES // (len(axes) + 1) - 2 * len(corners) - 1
        even = np.linspace(0.0, duration, min(round(duration * RATE), most) + 1)
        times = np.unique(np.concatenate([even, corners, np.array(corners) - _CORNER]))
        moved = self._computed(moving, times)
        if (finer := _finer(times, moved)).size and finer.size < most - times.size:
            times = np.union1d(times, finer)
            moved = self._computed(moving, times)
        rows = np.column_stack(
            [times, *(moved.get(one, np.full_like(times, self._held(one))) for one in axes)]
        )
        header = ",".join(["time", *axes.values()])
        np.savetxt(self.table, rows, fmt="%.12g", delimiter=",", header=header, comments="")

    def _computed(self, moving: Mapping[Freedom, Form], times: Vector) -> dict[Freedom, Vector]:
        """Return positions over times (t,), by what they are of; what cannot be computed is lost, and held."""
        try:
            return dict(zip(moving, over_time(list(moving.values()), times), strict=True))
        except (RuntimeError, ValueError, SimrobError) as problem:  # of one block
            if len(moving) > 1:
                return dict(
                    ChainMap(
                        *(self._computed({one: value}, times) for one, value in moving.items())
                    )
                )
            (freedom,) = moving
            self.files.report.add(
                "lost",
                freedom.name,
                message(
                    "simulink.motion_missing",
                    "its motion is not there, it is held: {problem}",
                    problem=problem,
                ),
            )
            return {}

    def _held(self, freedom: Freedom) -> float:
        """Return a constant position; an input is taken to hold the start."""
        value = self.values.get(freedom)
        return (
            self.start[self.axes[freedom]]
            if value is None or isinstance(value, Form)
            else float(value)
        )


def _finer(times: Vector, moved: Mapping[Freedom, Vector]) -> Vector:
    """Return times between those at which positions bend too much for a line from row to row."""
    bent = np.zeros(times.size, dtype=bool)
    for row in moved.values():
        bent[1:-1] |= np.abs(np.diff(row, 2)) > _BENT * np.ptp(row) + 1e-9
    quick = np.flatnonzero(bent[:-1] | bent[1:])
    quick = quick[np.diff(times)[quick] > 2 * SHORTEST * _FINER]
    parts = np.arange(1, _FINER) / _FINER
    return np.asarray(times[quick, None] + np.diff(times)[quick, None] * parts).ravel()


def over_time(values: list[Value], times: Vector) -> Vector:
    """Return values that depend on time alone at times (t,), shape (n, t)."""
    writer = FlowWriter("law", {}, {}, ImportReport(Path()))
    sums = [writer.sum(value) for value in values]
    return flow_over_time(writer.blocks, sums, times)


def start_state(files: StationFiles, starts: Mapping[str, Mapping[str, float]]) -> State | None:
    """Return how a station begins, of positions by robot and axis [rad or m]; None where everything is at rest."""
    positions, speeds, joints = dict[str, Vector](), dict[str, Vector](), dict[str, JointState]()
    for name, robot in files.robots.items():
        called = name if len(files.robots) > 1 else "robot"
        positions[called] = np.array(list(starts[name].values()), dtype=float)
        speeds[called] = np.array([freedom.start_speed or 0.0 for freedom in robot.axes])
        if not robot.tree.root.grounded:
            joints[f"{called}::{name}/{robot.links[robot.tree.root]}"] = _free(
                robot.tree, files.turn
            )
    joints |= {
        f"{name}::{name}/{name}": _free(tree, files.turn) for tree, name in files.free.items()
    }
    moves = any(
        speed.any() for speed in (*speeds.values(), *(joint.velocity for joint in joints.values()))
    )
    return State(positions, speeds, positions, joints) if moves else None


def _free(tree: Tree, turn: RigidTransform) -> JointState:
    """Return position and velocity of a free body as Drake has them: orientation and turning rate first."""
    pose, (linear, rate) = (
        turn @ tree.base,
        (turn.rotation() @ part for part in np.split(tree.speed, 2)),
    )
    position: Vector = np.concatenate([pose.rotation().ToQuaternion().wxyz(), pose.translation()])
    return JointState(position, np.concatenate([rate, linear]))


def coupling_sections(files: StationFiles, *, kinematic: bool) -> dict[str, Any]:
    """Return the section ``couplings`` of a station; what it cannot have is told as lost."""
    sections: dict[str, Any] = {}

    def add(node: Node, section: dict[str, Any]) -> None:
        if kinematic:
            node.note(
                "lost",
                message(
                    "simulink.holds_nothing", "holds nothing in a station whose motion is given"
                ),
            )
            return
        name = files.names.give(node.path)
        sections[name] = section
        node.note(
            "read",
            message(
                "simulink.is_the_coupling",
                "it is the coupling {name}, of kind {kind}",
                name=name,
                kind=section["kind"],
            ),
        )

    def tie(tied: Coupling, kind: str, **values: float) -> None:
        ends = _ends(tied, files, framed=kind in ("weld", "hinge"))
        if ends is None:
            tied.node.note(
                "lost",
                message(
                    "simulink.end_on_nothing_moving",
                    "one of its ends is on nothing that moves here, or both are on one body",
                ),
            )
        else:
            add(tied.node, {"kind": kind, **ends, **values})

    for name, robot in files.robots.items():
        for closing in robot.tree.closings:
            tie(closing, closing.kind, **closing.parameters)
        for node, ratios in robot.tree.gears.items():
            by_axis = {
                f"{files.prefix(name)}{robot.axes[freedom]}": ratio
                for freedom, ratio in ratios.items()
            }
            add(node, {"kind": "gear", "ratios": by_axis})
    units = {"length": ("NaturalLength", "m"), "stiffness": ("SpringStiffness", "N/m"),
             "damping": ("DampingCoefficient", "N*s/m")}  # fmt: skip
    for coupling in files.model.bodies.couplings:
        if coupling.node.kind == SPRING:
            values = {
                key: coupling.node.number(name, unit=unit) for key, (name, unit) in units.items()
            }
            tie(coupling, "spring", **values)
    _tell_of_loose(files.model)
    return {"couplings": sections} if sections else {}


def _tell_of_loose(model: SimulinkModel) -> None:
    held = {coupling for tree in model.trees for coupling in tree.couplings}
    for coupling in model.bodies.couplings:
        if coupling.node.kind in (*GEARS, ROD) and coupling not in held:
            coupling.node.note(
                "lost",
                message(
                    "simulink.couples_held_by_nothing",
                    "couples mechanisms of which one is held by nothing",
                ),
            )


def _ends(held: Coupling, files: StationFiles, *, framed: bool) -> dict[str, Any] | None:
    """Return the bodies of a coupling, and its frames or their origins there; None of what cannot move apart."""
    base, follower = files.named(held.base), files.named(held.follower)
    if base is None or follower is None or base[0] == follower[0]:
        return None
    what, size = ("pose", 6) if framed else ("point", 3)
    poses = (
        pose_list(base[1] @ held.in_base)[:size],
        pose_list(follower[1] @ held.in_follower)[:size],
    )
    return {"body": base[0], what: poses[0], "other": follower[0], f"other_{what}": poses[1]}


def servo_section(robot: RobotFile, laws: Mapping[Freedom, Law]) -> dict[str, Any]:
    """Return the section `servo` of a robot, by the laws of its joints."""
    gains = {
        key: {
            axis: float(f"{getattr(laws[freedom], key):.12g}")
            for freedom, axis in robot.axes.items()
        }
        for key in ("kp", "ki", "kd")
    }
    section = {
        key: _at_once(values)
        for key, values in gains.items()
        if key != "ki" or any(values.values())
    }
    limits = {
        axis: laws[freedom].limit
        for freedom, axis in robot.axes.items()
        if isfinite(laws[freedom].limit)
    }
    return section | ({"torque_limit": limits} if limits else {})


def stop_section(robot: RobotFile) -> dict[str, Any]:
    """Return the section `joint_stops` of a robot; nothing where they are as usual."""
    found = {axis: freedom.stop for freedom, axis in robot.axes.items() if freedom.stop}
    usual = tuple(JointStops().model_dump().values())
    if all(np.allclose(stop, usual, rtol=1e-3) for stop in found.values()):
        return {}
    return {
        key: _at_once({axis: float(f"{stop[place]:.12g}") for axis, stop in found.items()})
        for place, key in enumerate(("stiffness", "damping"))
    }


def _at_once(values: dict[str, float]) -> dict[str, float] | float:
    return next(iter(values.values())) if len(set(values.values())) == 1 else values
