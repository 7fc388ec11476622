"""A station that is built in MuJoCo: what MJCF cannot say of one, its model, its controls, and what it tells."""

from collections.abc import Mapping
from dataclasses import dataclass

import mujoco
import numpy as np
from pydrake.systems.framework import Diagram

from simrob_drake.base.errors import InvalidParameter, Unsuitable
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import message
from simrob_drake.base.signals import Signal
from simrob_drake.blocks.references import Reference, reference_values
from simrob_drake.blocks.servo import ServoGains
from simrob_drake.extensions.mujoco.coordinates import Coordinates, Names
from simrob_drake.extensions.mujoco.drives import OutputSensors
from simrob_drake.extensions.mujoco.model import STEP, Driver, mujoco_model
from simrob_drake.parts.forces import Drag, ForceConfig, Push, SineForce
from simrob_drake.parts.resolved import ResolvedRobot
from simrob_drake.parts.station_plant import StationPlant
from simrob_drake.stations.closed import closed_station
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.ports import StationPorts
from simrob_drake.stations.resolve import ResolvedStation, check_parts, resolve

_NO_MODEL = message("mujoco.servos_without_model", "MJCF's servos do not know the arm's model")


def check_sayable(
    config: StationConfig, robots: Mapping[str, ResolvedRobot], *, moved_by_torque: bool = True
) -> None:
    """Check that MuJoCo moves a station as Drake does; what only measures is no hindrance.

    Where it is not ``moved_by_torque``, bodies are all that counts. Raises InvalidParameter: key, why, what would be
    right.
    """
    if not moved_by_torque:
        return
    if not config.engine.moves_by_forces:
        raise InvalidParameter(
            "mode",
            "kinematic",
            message(
                "mujoco.dynamic_only",
                "dynamic: MJCF moves things by forces, not along a given motion",
            ),
        )
    if config.controllers:
        expected = message("mujoco.no_controllers", "MJCF holds no controllers")
        raise Unsuitable("controllers", expected)
    if config.contact is not None and config.contact.model != "point":
        expected = message("mujoco.point_only", "point: MuJoCo knows no pressure over a surface")
        raise InvalidParameter("contact.model", config.contact.model, expected)
    if config.prescribed:
        raise Unsuitable(
            "prescribed", message("mujoco.joints_by_forces", "MJCF moves all joints by forces")
        )
    for name, force in config.forces.items():
        if isinstance(force, Drag):
            raise InvalidParameter(
                f"forces.{name}.kind",
                "drag",
                message("mujoco.push_or_sine", "push or sine: MJCF's forces know no target"),
            )
    for name, robot in robots.items():
        _check_servo(config, name, robot.gains)


def _check_servo(config: StationConfig, robot: str, gains: ServoGains) -> None:
    """Check that MJCF's servos can do what those of a robot do.

    MJCF knows a PID law with one limit of torque. It knows no delay of commands and no model of the arm.

    Raises:
        InvalidParameter: a setting of the servo that MJCF does not have, with its key.
        Unsuitable: the servo is on a bus.
    """
    servo = config.servo_of(robot)
    key = "servo" if config.robots[robot].servo is None else f"robots.{robot}.servo"
    if servo.law != "pid":
        raise InvalidParameter(
            f"{key}.law",
            servo.law,
            message("mujoco.pid_only", "pid: MJCF's servos know no other law"),
        )
    # A motor's largest torque falls with its speed by `slope`. MJCF can do that only as a damper of the joint, which
    # the plant has where the whole fall is one (`servo.motor.realization: implicit`).
    if gains.line is not None and (gains.line.slope > gains.damping).any():
        expected = message(
            "mujoco.none_or_damper",
            "none, or a whole damper (realization implicit): MJCF's servos have one limit at any speed",
        )
        raise InvalidParameter(
            f"{key}.motor",
            "given",
            message(
                "mujoco.mujoco_has_motors",
                "{expected}; solver.kind mujoco has motors",
                expected=expected,
            ),
        )
    if servo.bus is not None:
        raise Unsuitable(
            f"{key}.bus",
            message(
                "mujoco.commands_without_delay",
                "the servos of MJCF get their commands without delay",
            ),
        )
    if servo.feedforward != "none":
        raise InvalidParameter(
            f"{key}.feedforward",
            servo.feedforward,
            message("mujoco.none_because", "none: {reason}", reason=_NO_MODEL),
        )
    if servo.admittance_gain > 0:
        raise InvalidParameter(
            f"{key}.admittance_gain",
            servo.admittance_gain,
            message("mujoco.zero_because", "0: {reason}", reason=_NO_MODEL),
        )
    # MJCF gets the reference's speed v_r as an offset v_r kd/kp of its position (see `controls`): an integral part
    # would add that offset up, and without kp there is nothing to offset.
    if "reference_velocity" in config.inputs:
        why = message(
            "mujoco.with_reference_velocity",
            "with the input reference_velocity, which MJCF's servos have through kp alone",
        )
        if gains.ki.any():
            raise InvalidParameter(
                f"{key}.ki", gains.ki.tolist(), message("mujoco.zero_with", "0 {why}", why=why)
            )
        if ((gains.kp == 0) & (gains.kd > 0)).any():
            raise InvalidParameter(
                f"{key}.kp",
                gains.kp.tolist(),
                message("mujoco.positive_with", "positive {why}", why=why),
            )


def controls(
    plant: StationPlant,
    references: Mapping[str, Reference],
    forces: Mapping[str, ForceConfig | None],
    *,
    with_speeds: bool,
    step: float,
    count: int,
) -> Vector:
    """Return the controls of ``count`` steps of a length [s], (count, nu), of references by robot and of forces.

    References are those of a step's end, where servos act that are treated implicitly; forces, at the places that the
    model knows and in its order, None where none acts, are their means over it, so that a push gives its whole impulse
    whatever the step. A servo with_speeds minds the reference's speed, too: k_p (q_r - q) + k_d (v_r - v) is the law of
    a servo without that asks for q_r + v_r k_d / k_p.
    """
    ends = np.asarray(step * np.arange(1, count + 1), dtype=float)
    columns = []
    for name, robot in plant.robots.items():
        positions, gains = reference_values(references[name], ends), robot.gains
        if with_speeds:
            ahead = np.divide(gains.kd, gains.kp, out=np.zeros_like(gains.kd), where=gains.kp > 0)
            positions = positions + ahead * reference_values(references[name], ends, 1)
        columns.append(positions)
    columns += [force_values(force, ends - step, ends) for force in forces.values()]
    return np.hstack([np.zeros((count, 0)), *columns])


def force_values(force: ForceConfig | None, starts: Vector, ends: Vector) -> Vector:
    """Return the mean of a force over stretches of time (m,) [s], shape (m, 3) [N]; of a sine its value midway."""
    if force is None:
        return np.zeros((len(ends), 3))
    if isinstance(force, Push):
        inside = np.clip(np.minimum(ends, force.end) - np.maximum(starts, force.start), 0.0, None)
        return np.outer(inside / (ends - starts), force.force)
    assert isinstance(force, SineForce)  # which MJCF can say
    angles = 2 * np.pi * force.frequency * (starts + ends) / 2 + np.deg2rad(force.phase_deg)
    return np.outer(np.sin(angles), force.amplitude)


STATE = mujoco.mjtState.mjSTATE_FULLPHYSICS  # what MuJoCo keeps of each step


@dataclass(frozen=True)
class BuiltStation:
    """A station in MuJoCo."""

    station: ResolvedStation  # what it is made of
    # the station in Drake, whose ports tell what its signals are
    diagram: Diagram
    ports: StationPorts
    # of MuJoCo, and the model that is made of it
    spec: mujoco.MjSpec
    model: mujoco.MjModel
    # how the model's sensors give outputs of the station, by their names
    outputs: dict[str, OutputSensors]
    columns: dict[str, slice]  # of the sensors in their data, by their names
    coordinates: Coordinates  # between Drake's positions and velocities and MuJoCo's
    step: float  # length of a step [s]

    @classmethod
    def of(
        cls,
        config: StationConfig,
        *,
        step: float = STEP,
        integrator: str | None = None,
        seen: bool = False,
        moved_by_torque: bool = True,
    ) -> "BuiltStation":
        """Build a station; the arguments are those of :func:`~simrob_drake.extensions.mujoco.model.mujoco_model`.

        Raises SimrobError: one that cannot be, or that MJCF cannot say; the message names the part.
        """
        station = resolve(config)
        check_parts(station)
        check_sayable(config, station.robots, moved_by_torque=moved_by_torque)
        closed = closed_station(station)
        driver: Driver = "controls" if moved_by_torque else "motion"
        made = mujoco_model(
            station, closed.ports.plant, step=step, integrator=integrator, seen=seen, driver=driver
        )
        columns = {
            made.model.sensor(index).name: slice(start, start + size)
            for index, (start, size) in enumerate(
                zip(made.model.sensor_adr, made.model.sensor_dim, strict=True)
            )
        }
        plant = closed.ports.plant.plant
        coordinates = Coordinates.of(plant, made.model, Names(plant))
        return cls(
            station,
            closed.diagram,
            closed.ports,
            made.spec,
            made.model,
            dict(made.outputs),
            columns,
            coordinates,
            step,
        )

    @property
    def signals(self) -> list[Signal]:
        """The station's signals that are known here."""
        return [signal for signal in self.ports.outputs.signals if self._known(signal)]

    @property
    def left_out(self) -> list[str]:
        """The station's other outputs, by the sensor that tells them, such as ``imu``."""
        unknown = [signal for signal in self.ports.outputs.signals if not self._known(signal)]
        return list(dict.fromkeys(signal.part or signal.output for signal in unknown))

    def state(self, q: Vector, v: Vector) -> Vector:
        """Return MuJoCo's state at positions (nq,) and velocities (nv,) of the plant, at time zero."""
        data, state = mujoco.MjData(self.model), np.empty(mujoco.mj_stateSize(self.model, STATE))
        self.coordinates.put(data, np.append(q, v))
        mujoco.mj_getState(self.model, data, state, STATE)
        return state

    def output(self, name: str, sensed: Vector) -> Vector:
        """Return an output (m, size) of the station by the sensors' data (m, k)."""
        return self.outputs[name].of(self.columns, sensed)

    def _known(self, signal: Signal) -> bool:
        went_in = signal.role in ("reference", "applied")  # what went in is known
        return signal.compute is None and (went_in or signal.output in self.outputs)
