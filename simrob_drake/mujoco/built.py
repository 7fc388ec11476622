"""A station that is built in MuJoCo: its model, and between what it tells and what Drake calls that."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from pydrake.systems.framework import Diagram

from simrob_drake.frames import Vector
from simrob_drake.mujoco.limits import check_sayable
from simrob_drake.signals import Signal
from simrob_drake.stations.closed import closed_station
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.mujoco.coordinates import Coordinates
from simrob_drake.stations.mujoco.model import STEP, Driver, mujoco_model
from simrob_drake.stations.mujoco.names import Names
from simrob_drake.stations.mujoco.sensors import OutputSensors
from simrob_drake.stations.ports import StationPorts
from simrob_drake.stations.resolve import ResolvedStation, check_parts, resolve

STATE = mujoco.mjtState.mjSTATE_FULLPHYSICS
"""What MuJoCo keeps of each step."""


@dataclass(frozen=True)
class BuiltStation:
    """A station in MuJoCo.

    Attributes:
        station: what it is made of.
        diagram, ports: the station in Drake, whose ports tell what its signals are.
        spec, model: of MuJoCo.
        outputs: how the model's sensors give outputs of the station, by their names.
        columns: of the sensors in their data, by their names.
        coordinates: between Drake's positions and velocities and MuJoCo's.
        step: length of a step [s].
    """

    station: ResolvedStation
    diagram: Diagram
    ports: StationPorts
    spec: mujoco.MjSpec
    model: mujoco.MjModel
    outputs: dict[str, OutputSensors]
    columns: dict[str, slice]
    coordinates: Coordinates
    step: float

    @classmethod
    def of(
        cls,
        config: StationConfig,
        *,
        step: float = STEP,
        integrator: str | None = None,
        seen: bool = False,
        moved_by_torque: bool = True,
    ) -> BuiltStation:
        """Build a station; the arguments are those of :func:`~simrob_drake.stations.mujoco.model.mujoco_model`.

        Raises:
            SimrobError: one that cannot be, or that MJCF cannot say; the message names the part.
        """
        station = resolve(config)
        check_parts(station)
        check_sayable(config, station.robots, moved_by_torque=moved_by_torque)
        closed = closed_station(station)
        driver: Driver = "controls" if moved_by_torque else "motion"
        made = mujoco_model(station, closed.ports.plant, step=step, integrator=integrator, seen=seen, driver=driver)
        columns = {
            made.model.sensor(index).name: slice(start, start + size)
            for index, (start, size) in enumerate(zip(made.model.sensor_adr, made.model.sensor_dim, strict=True))
        }
        plant = closed.ports.plant.plant
        coordinates = Coordinates.of(plant, made.model, Names(plant))
        return cls(
            station, closed.diagram, closed.ports, made.spec, made.model, dict(made.outputs), columns, coordinates, step
        )

    @property
    def signals(self) -> list[Signal]:
        """The station's signals that are known here."""
        return [signal for signal in self.ports.signals if self._known(signal)]

    @property
    def left_out(self) -> list[str]:
        """The station's other outputs, by the sensor that tells them, such as ``imu``."""
        return list(
            dict.fromkeys(signal.part or signal.output for signal in self.ports.signals if not self._known(signal))
        )

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
