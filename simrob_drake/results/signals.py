"""Signals of a run: the ports of its station, evaluated after the run from the recorded states."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import Context, Diagram, OutputPort

from simrob_drake.frames import XYZ_QUATERNION_NAMES, Vector
from simrob_drake.results.history import History, plant_slice
from simrob_drake.stations.ports import StationPorts
from simrob_drake.stations.robots import StationRobot

POSE_SIGNALS = {"base": "base_pose", "tcp": "tcp_pose"}
"""Signals that are poses, and the ports they come from."""


@dataclass(frozen=True)
class Signals:
    """Signals that are made of one port.

    Attributes:
        names: k of them.
        port: what they are made of.
        matrix: what makes them of the port's values, shape (k, size of the port).
    """

    names: list[str]
    port: OutputPort
    matrix: Vector


def signals_of(ports: StationPorts) -> list[Signals]:
    """Return the signals of a station, in the order of the columns of a result."""
    return [signals for robot in ports.plant.robots.values() for signals in _of_robot(ports, robot)]


def _of_robot(ports: StationPorts, robot: StationRobot) -> list[Signals]:
    def named(signal: str, parts: Sequence[str]) -> list[str]:
        return [f"{robot.prefix}{signal}.{part}" for part in parts]

    def own(port: str) -> OutputPort:
        return ports.outputs[f"{robot.prefix}{port}"]

    each_axis, motion = np.eye(len(robot.axes)), named("q", robot.axes) + named("v", robot.axes)
    poses = [signal for signal, port in POSE_SIGNALS.items() if f"{robot.prefix}{port}" in ports.outputs]
    return [
        Signals(named("q_ref", robot.axes), own("reference"), each_axis),
        Signals(motion, ports.state, ports.plant.state_map(robot)),
        Signals(named("tau", robot.axes), own("torque"), each_axis),
        *(Signals(named(pose, XYZ_QUATERNION_NAMES), own(POSE_SIGNALS[pose]), np.eye(7)) for pose in poses),
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

    def sample(self, ports: Sequence[OutputPort], times: Vector) -> list[Vector]:
        """Return the values of ports at ``times`` (k,), for each port shape (k, size)."""
        states = self._history.at(times, self._plant_slice, self._rates)
        contexts = [port.get_system().GetMyContextFromRoot(self._context) for port in ports]
        values = [np.empty((len(times), port.size())) for port in ports]
        for row in range(len(times)):
            states.put(row, self._context)
            for port, context, rows in zip(ports, contexts, values, strict=True):
                rows[row] = port.Eval(context)
        return values

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
