"""The torques of a kinematic station by MuJoCo's inverse dynamics: the motion is given, the forces follow."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np

from simrob_drake.blocks.references import reference_values
from simrob_drake.mujoco.built import BuiltStation
from simrob_drake.results.result import SimulationResult
from simrob_drake.simulation import simulate
from simrob_drake.stations.closed import station_references
from simrob_drake.stations.config import StationConfig


def inverse_run(config: StationConfig) -> SimulationResult:
    """Return the run of a kinematic station with torques and poses by MuJoCo, without signals that it does not know.

    Raises:
        SimrobError: a station that cannot be.
    """
    run = simulate(config, progress=False)
    built = BuiltStation.of(config, integrator="RK4", moved_by_torque=False)  # others count damping over a step
    built.model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    references, plant = station_references(built.station), built.ports.plant.plant
    q, v, a = np.zeros((3, len(run.times), plant.num_velocities()))
    q[:] = plant.GetPositions(plant.CreateDefaultContext())
    for name, robot in built.ports.plant.robots.items():
        orders = (reference_values(references[name], run.times, order) for order in range(3))
        position, velocity, acceleration = orders
        q = robot.axis_map.spread_positions(position, q)
        v = robot.axis_map.spread_velocities(velocity, v)
        a = robot.axis_map.spread_velocities(acceleration, a)
    data, forces, sensed = mujoco.MjData(built.model), np.empty_like(v), np.empty((len(q), built.model.nsensordata))
    for row in range(len(q)):
        built.coordinates.put(data, np.append(q[row], v[row]))
        data.qacc[:] = built.coordinates.to_mujoco(np.append(q[row], a[row]))[plant.num_positions() :]
        mujoco.mj_inverse(built.model, data)
        mujoco.mj_sensorPos(built.model, data)
        forces[row], sensed[row] = data.qfrc_inverse[built.coordinates.velocities], data.sensordata
    outputs = {name: built.output(name, sensed) for name in built.outputs}
    for robot in built.ports.plant.robots.values():
        sliding = robot.model.friction * np.clip(
            robot.axis_map.velocities(v) / robot.model.drives.friction_speed, -1, 1
        )
        outputs[f"{robot.prefix}torque"] = robot.axis_map.efforts(forces) + sliding
    signals = [signal for signal in built.ports.signals if signal.compute is None and signal.output in outputs]
    columns = [outputs[s.output] if s.entries is None else outputs[s.output][:, s.entries] for s in signals]
    names = [name for signal in signals for name in signal.names]
    return replace(run, names=names, signals=tuple(signals), values=np.hstack(columns))
