"""Signals that no port gives at once, computed after the run from its recorded states.

* Estimates of external torques: the momentum observer goes through the run sample by sample, as it would have while
  stepping.
* Friction under the scheme ``cenic``, whose contact results are exact along the normal of a contact and not across it:
  what is missing in the balance of momentum is added to the force sensors.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from pydrake.multibody.plant import ContactResults

from simrob_drake.blocks.momentum_observer import MomentumObserver
from simrob_drake.frames import Vector
from simrob_drake.results.record.momentum_balance import frictions
from simrob_drake.results.record.signals import Sampler, sensor_columns
from simrob_drake.stations.ports import StationPorts
from simrob_drake.stations.robots import StationRobot
from simrob_drake.stations.sensor_config import ExternalTorque, Force
from simrob_drake.stations.sensors import tangential_source


def with_computed(
    sampler: Sampler, ports: StationPorts, times: Vector, names: list[str], values: Vector
) -> tuple[list[str], Vector]:
    """Return the signals of a run with those that are computed from its states.

    Args:
        sampler: of the run.
        ports: the station's.
        times: of the samples, shape (m,) [s].
        names: of the signals so far, k of them.
        values: of the signals so far, shape (m, k).
    """
    columns = [values]
    for name, sensor in ports.config.sensors.items():
        if isinstance(sensor, ExternalTorque) and not sensor.in_loop:
            robot = ports.plant.robots[sensor.robot or str(ports.config.only_robot)]
            torques, forces = _observed(sampler, ports, ports.observers[name], robot, times)
            names = names + sensor_columns(ports, "external_torque", name)
            columns.append(torques)
            if robot.tcp:
                names = names + sensor_columns(ports, "external_force", name)
                columns.append(forces)
    full = np.hstack(columns)
    felt = {name: sensor for name, sensor in ports.config.sensors.items() if isinstance(sensor, Force)}
    balanced = {
        name: sensor
        for name, sensor in felt.items()
        if tangential_source(ports.plant, ports.config, sensor) == "momentum balance"
    }
    for name, friction in frictions(sampler, ports, balanced, times).items():
        place = names.index(f"force.{name}.x")
        full[:, place : place + 3] += friction
    return names, full


def contacts_at(sampler: Sampler, ports: StationPorts) -> Callable[[Vector], Iterator[ContactResults]] | None:
    """Return what gives the contact results at any times (k,) of a run; None in a station without contact."""
    if ports.config.contact is None or ports.config.mode == "kinematic":
        return None
    port = ports.plant.plant.get_contact_results_output_port()

    def results(times: Vector) -> Iterator[ContactResults]:
        for context in sampler.contexts(times):
            yield port.Eval(port.get_system().GetMyContextFromRoot(context))

    return results


def _observed(
    sampler: Sampler, ports: StationPorts, observer: MomentumObserver, robot: StationRobot, times: Vector
) -> tuple[Vector, Vector]:
    """Return external torques (m, n) and forces (m, 3) at ``times``, held from the last sample of the observer."""
    count = int(np.floor(sampler.history.end / observer.period + 1e-9)) + 1
    ticks = np.linspace(0.0, (count - 1) * observer.period, count)
    states, torques = sampler.sample([ports.state, ports.outputs[f"{robot.prefix}torque"]], ticks)
    memory = np.full(3 * len(robot.joints), np.inf)
    estimates = np.empty((count, len(robot.joints)))
    for row in range(count):
        memory = observer.next_state(memory, states[row], torques[row])
        estimates[row] = memory[: len(robot.joints)]
    last = np.clip((times / observer.period + 1e-9).astype(int), 0, count - 1)
    forces = np.zeros((len(times), 3))
    if robot.tcp:
        forces = np.array([observer.force(states[row], estimates[row]) for row in last])
    return estimates[last], forces
