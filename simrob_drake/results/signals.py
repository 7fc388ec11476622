"""Signals of a run: the ports of its station, evaluated after the run from the recorded states."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import Context, Diagram, DiagramBuilder, OutputPort

from simrob_drake.blocks.wiring import joined
from simrob_drake.frames import XYZ_QUATERNION_NAMES, Vector
from simrob_drake.results.history import History, plant_slice
from simrob_drake.stations.plant import StationRobot
from simrob_drake.stations.ports import StationPorts

POSE_SIGNALS = {"base": "base_pose", "tcp": "tcp_pose"}
"""Signals that are poses, and the ports they come from."""


@dataclass(frozen=True)
class SignalBus:
    """All signals of a station in one port, so that one evaluation gives them all.

    Attributes:
        names: the signals' names, k of them.
        port: what they are made of; positions and velocities of the whole plant come last.
        matrix: what makes them of the port's values, shape (k, size of the port).
    """

    names: list[str]
    port: OutputPort
    matrix: Vector

    def signals(self, values: Vector) -> Vector:
        """Return the signals, shape (m, k), of the port's values, shape (m, size)."""
        return values @ self.matrix.T


def add_signal_bus(builder: DiagramBuilder, ports: StationPorts) -> SignalBus:
    """Join what a station's signals are made of, in as few connections as can be: each costs a solver time."""
    parts = [part for robot in ports.plant.robots.values() for part in _parts(ports, robot)]
    sources = list(dict.fromkeys(port for _, port, _ in parts if port is not ports.state))
    sources.append(ports.state)
    starts = dict(zip(sources, np.cumsum([0, *(port.size() for port in sources)]), strict=False))
    bus = joined(builder, "signals", *sources)
    matrices = []
    for _, port, matrix in parts:
        matrices.append(np.zeros((len(matrix), bus.size())))
        matrices[-1][:, starts[port] : starts[port] + port.size()] = matrix
    return SignalBus([name for names, _, _ in parts for name in names], bus, np.vstack(matrices))


def _parts(ports: StationPorts, robot: StationRobot) -> list[tuple[list[str], OutputPort, Vector]]:
    """Return a robot's signals: names, the port they are made of, and the matrix that makes them."""

    def named(signal: str, parts: Sequence[str]) -> list[str]:
        return [f"{robot.prefix}{signal}.{part}" for part in parts]

    def own(port: str) -> OutputPort:
        return ports.outputs[f"{robot.prefix}{port}"]

    each_axis, motion = np.eye(len(robot.axes)), named("q", robot.axes) + named("v", robot.axes)
    poses = [signal for signal, port in POSE_SIGNALS.items() if f"{robot.prefix}{port}" in ports.outputs]
    return [
        (named("q_ref", robot.axes), own("reference"), each_axis),
        (motion, ports.state, ports.plant.state_map(robot)),
        (named("tau", robot.axes), own("torque"), each_axis),
        *((named(pose, XYZ_QUATERNION_NAMES), own(POSE_SIGNALS[pose]), np.eye(7)) for pose in poses),
    ]


class Sampler:
    """Evaluate ports of a diagram at any time of a recorded run."""

    def __init__(self, diagram: Diagram, plant: MultibodyPlant, history: History) -> None:
        """Prepare to evaluate the ports of ``diagram`` at the states of ``history``."""
        self.diagram = diagram
        self._plant = plant
        self._context = diagram.CreateDefaultContext()
        self._plant_slice = plant_slice(diagram, plant, self._context)
        self.history = history

    @property
    def history(self) -> History:
        """The recorded states."""
        return self._history

    @history.setter
    def history(self, history: History) -> None:
        self._history = history
        self._rates = self._position_rates(history)

    def sample(self, port: OutputPort, times: Vector) -> Vector:
        """Return a port's values at ``times`` (k,), shape (k, size)."""
        states = self._history.at(times, self._plant_slice, self._rates)
        context = port.get_system().GetMyContextFromRoot(self._context)
        rows = np.empty((len(times), port.size()))
        for row in range(len(times)):
            states.put(row, self._context)
            rows[row] = port.Eval(context)
        return rows

    def context_at(self, time: float) -> Context:
        """Return the diagram's context at a time of the run; the next call changes it."""
        self._history.at(np.array([time]), self._plant_slice, self._rates).put(0, self._context)
        return self._context

    def _position_rates(self, history: History) -> Vector | None:
        """Return the time derivatives of the plant's positions at every recorded step."""
        where, plant = self._plant_slice, self._plant
        if where is None:
            return None
        velocities = history.continuous[:, where.velocities]
        if plant.IsVelocityEqualToQDot():
            return velocities
        context = plant.CreateDefaultContext()
        rates = np.empty((len(velocities), where.num_positions))
        for row, state in enumerate(history.continuous):
            plant.SetPositions(context, state[where.positions])
            rates[row] = plant.MapVelocityToQDot(context, state[where.velocities])
        return rates
