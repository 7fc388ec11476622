"""Signals of a run: the ports of its station, evaluated after the run from the recorded states."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import RigidBody
from pydrake.systems.framework import Context, Diagram, OutputPort

from simrob_drake.frames import XYZ_QUATERNION_NAMES, Vector
from simrob_drake.results.record.history import History, plant_slice
from simrob_drake.stations.free_pieces import VELOCITY_NAMES
from simrob_drake.stations.ports import StationPorts
from simrob_drake.stations.robots import StationRobot

POSE_SIGNALS = {"base": "base_pose", "tcp": "tcp_pose"}
"""Signals that are poses, and the ports they come from."""

SENSOR_SIGNALS = ("force", "moment", "distance", "joint_torque", "external_torque", "external_force")
"""What sensors give: the ports are ``<signal>.<sensor>``."""


@dataclass(frozen=True)
class Signals:
    """Signals that are made of one port.

    Attributes:
        names: k of them.
        port: what they are made of.
        matrix: what makes them of the port's values, shape (k, size of the port).
        finish: what is done to them then, shape (m, k) to (m, k).
    """

    names: list[str]
    port: OutputPort
    matrix: Vector
    finish: Callable[[Vector], Vector] | None = None

    def of(self, rows: Vector) -> Vector:
        """Return the signals, shape (m, k), of the port's values (m, size)."""
        values = np.asarray(rows @ self.matrix.T)
        return values if self.finish is None else self.finish(values)


def signals_of(ports: StationPorts) -> list[Signals]:
    """Return the signals of a station, in the order of the columns of a result."""
    robots = [signals for robot in ports.plant.robots.values() for signals in _of_robot(ports, robot)]
    pieces = [signals for piece in ports.plant.free_pieces for signals in _of_piece(ports, piece)]
    return [*robots, *pieces, *_of_sensors(ports)]


def _of_piece(ports: StationPorts, piece: str) -> list[Signals]:
    """Return pose and velocity of a free piece."""
    body, plant = ports.plant.free_pieces[piece], ports.plant.plant
    turns = plant.num_positions() + body.floating_velocities_start_in_v() + np.array([3, 4, 5, 0, 1, 2])
    velocity = np.eye(plant.num_multibody_states())[turns]
    return [
        _free_pose(ports, body, [f"piece.{piece}.{part}" for part in XYZ_QUATERNION_NAMES]),
        Signals([f"piece.{piece}.{part}" for part in VELOCITY_NAMES], ports.state, velocity),
    ]


def _free_pose(ports: StationPorts, body: RigidBody, names: list[str]) -> Signals:
    """Return the pose of a body that is free, which the state holds."""
    places = body.floating_positions_start() + np.array([4, 5, 6, 0, 1, 2, 3])  # Drake has the quaternion first
    return Signals(names, ports.state, np.eye(ports.plant.plant.num_multibody_states())[places], unit_poses)


def unit_poses(poses: Vector) -> Vector:
    """Return poses (m, 7) with quaternions of length one whose qw is not negative."""
    size = np.linalg.norm(poses[:, 3:], axis=1, keepdims=True) * np.where(poses[:, 3:4] < 0, -1.0, 1.0)
    return np.hstack([poses[:, :3], poses[:, 3:] / size])


def _of_sensors(ports: StationPorts) -> list[Signals]:
    """Return what sensors tell, and the forces that are applied."""
    found = []
    for name, port in ports.outputs.items():
        kind, _, sensor = name.partition(".")
        if kind in SENSOR_SIGNALS and sensor in ports.config.sensors:
            names = sensor_columns(ports, kind, sensor)
            found.append(Signals(names, port, np.eye(len(names))))
        elif name.rpartition(".")[2] == "external_force":
            found.append(Signals([f"{name}.{axis}" for axis in "xyz"], port, np.eye(3)))
    return found


def sensor_columns(ports: StationPorts, kind: str, sensor: str) -> list[str]:
    """Return the columns of a sensor's signal: by axis of a robot, or x, y and z."""
    if kind == "distance":
        return [f"distance.{sensor}"]
    if kind in ("force", "moment", "external_force"):
        return [f"{kind}.{sensor}.{axis}" for axis in "xyz"]
    robot = getattr(ports.config.sensors[sensor], "robot", None) or str(ports.config.only_robot)
    return [f"{kind}.{sensor}.{axis}" for axis in ports.plant.robots[robot].axes]


def _of_robot(ports: StationPorts, robot: StationRobot) -> list[Signals]:
    def named(signal: str, parts: Sequence[str]) -> list[str]:
        return [f"{robot.prefix}{signal}.{part}" for part in parts]

    def own(port: str) -> OutputPort:
        return ports.outputs[f"{robot.prefix}{port}"]

    each_axis, motion = np.eye(len(robot.axes)), named("q", robot.axes) + named("v", robot.axes)
    felt = [port for port in (f"{robot.prefix}felt_torque",) if port in ports.outputs]
    poses = [signal for signal, port in POSE_SIGNALS.items() if f"{robot.prefix}{port}" in ports.outputs]
    body = robot.root.body()
    free = ports.config.mode == "dynamic" and body.is_floating_base_body() and robot.root.is_body_frame()

    def pose(signal: str) -> Signals:
        names = named(signal, XYZ_QUATERNION_NAMES)
        if signal == "base" and free:
            return _free_pose(ports, body, names)
        return Signals(names, own(POSE_SIGNALS[signal]), np.eye(len(names)))

    return [
        Signals(named("q_ref", robot.axes), own("reference"), each_axis),
        Signals(motion, ports.state, ports.plant.state_map(robot)),
        Signals(named("tau", robot.axes), own("torque"), each_axis),
        *(Signals(named("felt", robot.axes), own("felt_torque"), each_axis) for _ in felt),
        *(pose(signal) for signal in poses),
    ]


class Sampler:
    """Evaluate ports of a diagram at any time of a recorded run."""

    def __init__(
        self, diagram: Diagram, plant: MultibodyPlant, history: History, *, held: Collection[OutputPort] = ()
    ) -> None:
        """Prepare to evaluate the ports of ``diagram`` at the states of ``history``.

        Those of ``held`` keep over each step what an implicit scheme with frozen inputs applied in it: their value at
        the state of its end, with the time of its start.
        """
        self.diagram = diagram
        self._plant = plant
        self._held = held
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
        values = {port: np.empty((len(times), port.size())) for port in ports}
        where, state_port = self._plant_slice, self._plant.get_state_output_port()
        if where is not None and state_port in values:  # it hands on what was recorded
            values[state_port] = states.continuous[:, where.start : where.velocities.stop]
        evaluated = {port: rows for port, rows in values.items() if where is None or port != state_port}
        self._evaluate({port: rows for port, rows in evaluated.items() if port not in self._held}, states)
        held = {port: rows for port, rows in evaluated.items() if port in self._held}
        if held:
            self._evaluate(held, self._history.steps(times))
        return [values[port] for port in ports]

    def _evaluate(self, values: dict[OutputPort, Vector], states: History) -> None:
        """Fill in the rows of ports, one a state."""
        targets = [(port, port.get_system().GetMyContextFromRoot(self._context), rows) for port, rows in values.items()]
        for row in range(len(states.times)):
            states.put(row, self._context)
            for port, context, rows in targets:
                rows[row] = port.Eval(context)

    def contexts(self, times: Vector) -> Iterator[Context]:
        """Yield the diagram's context at times of the run (k,); the next one is the same, changed."""
        states = self._history.at(times, self._plant_slice, self._rates)
        for row in range(len(times)):
            states.put(row, self._context)
            yield self._context

    def context_at(self, time: float) -> Context:
        """Return the diagram's context at a time of the run; the next call changes it."""
        return next(self.contexts(np.array([time])))

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


def sampled(sampler: Sampler, ports: StationPorts, times: Vector) -> tuple[list[str], Vector]:
    """Return the names of a station's signals, k of them, and their values at times of a run (m,), shape (m, k)."""
    signals = signals_of(ports)
    rows = sampler.sample([part.port for part in signals], times)
    names = [name for part in signals for name in part.names]
    return names, np.hstack([part.of(values) for part, values in zip(signals, rows, strict=True)])
