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

from simrob_drake.blocks.force_sensor import contacts_of
from simrob_drake.blocks.momentum_observer import MomentumObserver
from simrob_drake.frames import Vector
from simrob_drake.results.signals import Sampler, sensor_columns
from simrob_drake.stations.ports import StationPorts
from simrob_drake.stations.robots import StationRobot
from simrob_drake.stations.sensor_config import ExternalTorque, Force
from simrob_drake.stations.targets import frame_of, shapes_of

_NO_LOAD = 1e-9  # N


def with_computed(
    sampler: Sampler, ports: StationPorts, names: list[str], times: Vector, values: Vector
) -> tuple[list[str], Vector]:
    """Return the signals of a run with those that are computed from its states.

    Args:
        sampler: of the run.
        ports: the station's.
        names: of the signals so far, k of them.
        times: of the samples, shape (m,) [s].
        values: of the signals so far, shape (m, k).
    """
    columns = [values]
    for name, sensor in ports.config.sensors.items():
        if isinstance(sensor, ExternalTorque) and not sensor.in_loop:
            robot = ports.plant.robots[sensor.robot or str(ports.config.only_robot)]
            torques, forces = _observed(sampler, ports, ports.observers[name], robot, times)
            names = names + sensor_columns(ports, "external_torque", name, torques.shape[1])
            columns.append(torques)
            if robot.tcp:
                names = names + sensor_columns(ports, "external_force", name, 3)
                columns.append(forces)
    full = np.hstack(columns)
    if ports.config.solver.scheme == "cenic" and ports.config.mode == "dynamic":
        for name, sensor in ports.config.sensors.items():
            if isinstance(sensor, Force) and sensor.rate is None:
                place = names.index(f"force.{name}.x")
                full[:, place : place + 3] += _friction(sampler, ports, sensor, times)
    return names, full


def contacts_at(sampler: Sampler, ports: StationPorts) -> Callable[[Vector], Iterator[ContactResults]] | None:
    """Return what gives the contact results at any times (k,) of a run; None in a station without contact."""
    if ports.config.contact is None or ports.config.mode == "kinematic":
        return None
    port = ports.plant.plant.get_contact_results_output_port()

    def results(times: Vector) -> Iterator[ContactResults]:
        for time in times:
            yield port.Eval(port.get_system().GetMyContextFromRoot(sampler.context_at(float(time))))

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


def _friction(sampler: Sampler, ports: StationPorts, sensor: Force, times: Vector) -> Vector:
    """Return the tangential force on a sensor's body over each sample's step (m, 3) [N], in the axes of its frame.

    The mean force of all contacts on a model that stands free is dP/dt - m g, with its momentum P at the ends of a
    step. What is left of it without the parts along the contacts' normals goes to the sensor in proportion to its part
    of all that is pressed on the model.
    """
    plant, history = ports.plant.plant, sampler.history
    context = plant.CreateDefaultContext()
    shapes = set(shapes_of(ports.plant, ports.config, sensor.body))
    others = None if sensor.other is None else set(shapes_of(ports.plant, ports.config, sensor.other))
    inspector = ports.plant.scene_graph.model_inspector()
    instance = plant.GetBodyFromFrameId(inspector.GetFrameId(next(iter(shapes)))).model_instance()
    own = {
        shape
        for index in plant.GetBodyIndices(instance)
        for shape in plant.GetCollisionGeometriesForBody(plant.get_body(index))
    }
    weight = plant.CalcTotalMass(context, [instance]) * plant.gravity_field().gravity_vector()
    frame = frame_of(ports.plant, ports.config, sensor.frame)

    ends = np.clip(np.searchsorted(history.times, times, side="left"), 1, max(len(history.times) - 1, 1))
    if len(history.times) < 2:
        return np.zeros((len(times), 3))
    steps = np.unique(np.append(ends, ends - 1))
    (states,) = sampler.sample([ports.state], history.times[steps])
    momenta = {}
    for step, state in zip(steps, states, strict=True):
        plant.SetPositionsAndVelocities(context, state)
        momenta[step] = plant.CalcSpatialMomentumInWorldAboutPoint(context, [instance], np.zeros(3)).translational()
    results = plant.get_contact_results_output_port()
    friction = np.zeros((len(times), 3))
    for row, (time, end) in enumerate(zip(times, ends, strict=True)):
        mean = (momenta[end] - momenta[end - 1]) / (history.times[end] - history.times[end - 1]) - weight
        all_normal, pressed, here = np.zeros(3), 0.0, 0.0
        root = sampler.context_at(float(time))
        for contact in contacts_of(results.Eval(plant.GetMyContextFromRoot(root))):
            sides = {contact.first: contact.second, contact.second: contact.first}
            touching = [shape for shape in sides if shape in own and sides[shape] not in own]
            if touching:
                normal = contact.normal_part().force * (1 if touching[0] == contact.first else -1)
                size = float(np.linalg.norm(normal))
                all_normal, pressed = all_normal + normal, pressed + size
                counts = touching[0] in shapes and (others is None or sides[touching[0]] in others)
                here += size if counts else 0.0
        if pressed > _NO_LOAD:
            along = all_normal / np.linalg.norm(all_normal)
            across = mean - (mean @ along) * along
            turn = frame.CalcPoseInWorld(plant.GetMyContextFromRoot(root)).rotation().inverse()
            friction[row] = turn @ (across * here / pressed)
    return friction
