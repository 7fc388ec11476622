"""Signals of a run: the ports of its station, evaluated after the run from the recorded states."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import Context, Diagram, DiagramBuilder, OutputPort

from simrob_drake.blocks.wiring import joined
from simrob_drake.frames import XYZ_QUATERNION_NAMES, Vector
from simrob_drake.results.history import History, plant_slice
from simrob_drake.stations.ports import StationPorts

AXIS_SIGNALS = {"q_ref": "reference", "q": "position", "v": "velocity", "tau": "torque"}
"""Columns with one value an axis, and the ports they come from."""

POSE_SIGNALS = {"base": "base_pose", "tcp": "tcp_pose"}
"""Columns with a pose, and the ports they come from."""


@dataclass(frozen=True)
class SignalBus:
    """All signals of a station in one port, so that one evaluation gives them all.

    Attributes:
        names: the columns' names, one an entry of the port but for the plant's state at its end.
        port: the signals, then positions and velocities of the whole plant.
    """

    names: list[str]
    port: OutputPort


def add_signal_bus(builder: DiagramBuilder, ports: StationPorts) -> SignalBus:
    """Join a station's outputs for recording."""
    names: list[str] = []
    sources: list[OutputPort] = []
    for robot in ports.plant.robots.values():
        for column, port in AXIS_SIGNALS.items():
            names += [f"{robot.prefix}{column}.{axis}" for axis in robot.axes]
            sources.append(ports.outputs[f"{robot.prefix}{port}"])
        for column, port in POSE_SIGNALS.items():
            if f"{robot.prefix}{port}" in ports.outputs:
                names += [f"{robot.prefix}{column}.{part}" for part in XYZ_QUATERNION_NAMES]
                sources.append(ports.outputs[f"{robot.prefix}{port}"])
    return SignalBus(names, joined(builder, "signals", *sources, ports.state))


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
