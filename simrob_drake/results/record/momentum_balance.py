r"""Friction under the scheme ``cenic``, from the balance of momentum of what stands free.

The mean force of all contacts on a model over a step is :math:`\bar f = (P_1 - P_0)/h - m g` with its momentum P at
the ends of the step. Drake's contact results give the parts along the normals; what is left across them goes to a
sensor in proportion to its share of all that is pressed on the model: one foot of two cannot be told otherwise.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from simrob_drake.blocks.contacts import Contacts
from simrob_drake.frames import Vector
from simrob_drake.results.record.signals import Sampler
from simrob_drake.stations.ports import StationPorts
from simrob_drake.stations.sensor_config import Force
from simrob_drake.stations.targets import frame_of, shapes_of

_NO_LOAD = 1e-9  # N


def frictions(sampler: Sampler, ports: StationPorts, sensors: Mapping[str, Force], times: Vector) -> dict[str, Vector]:
    """Return what force sensors on models that stand free feel across the contacts' normals.

    Args:
        sampler: of the run.
        ports: the station's.
        sensors: by name.
        times: of the run, shape (m,) [s].

    Returns:
        by name the forces, shape (m, 3) [N], in the axes of the sensor.
    """
    felt = {name: np.zeros((len(times), 3)) for name in sensors}
    if not sensors or len(sampler.history.times) < 2:
        return felt
    plant = ports.plant.plant
    balances = {name: _Balance(ports, sensor) for name, sensor in sensors.items()}
    totals = {balance.model: balance.mean_contact_forces(sampler, times) for balance in balances.values()}
    turns = {name: np.empty((len(times), 3, 3)) for name in sensors}
    results, moments = plant.get_contact_results_output_port(), []
    for row, root in enumerate(sampler.contexts(times)):
        context = plant.GetMyContextFromRoot(root)
        moments.append(Contacts.of(results.Eval(context)))
        for name, balance in balances.items():
            turns[name][row] = balance.frame.CalcPoseInWorld(context).rotation().matrix()
    contacts, rows = Contacts.together(moments), np.repeat(range(len(times)), [len(each.pairs) for each in moments])
    for name, balance in balances.items():
        across = balance.across(totals[balance.model], contacts, rows)
        felt[name] = np.einsum("mji,mj->mi", turns[name], across)
    return felt


class _Balance:
    """What one sensor has of the friction on its model."""

    def __init__(self, ports: StationPorts, sensor: Force) -> None:
        station, plant = ports.plant, ports.plant.plant
        self._plant, self._state = plant, ports.state
        self.frame = frame_of(station, sensor.frame)
        self._body = set(shapes_of(station, ports.config, sensor.body))
        self._other = None if sensor.other is None else set(shapes_of(station, ports.config, sensor.other))
        inspector = station.scene_graph.model_inspector()
        self._instance = plant.GetBodyFromFrameId(inspector.GetFrameId(next(iter(self._body)))).model_instance()
        bodies = [plant.get_body(index) for index in plant.GetBodyIndices(self._instance)]
        self._shapes = {shape for body in bodies for shape in plant.GetCollisionGeometriesForBody(body)}

    @property
    def model(self) -> int:
        """The number of the model that the sensor sits on."""
        return int(self._instance)

    def across(self, totals: Vector, contacts: Contacts, rows: npt.NDArray[np.intp]) -> Vector:
        """Return the sensor's share of what is across the normals, shape (m, 3) [N], in the world's axes.

        Args:
            totals: of all forces on the sensor's model, shape (m, 3) [N].
            contacts: of all times.
            rows: to which time each of them belongs, shape (k,).
        """

        def summed(values: Vector) -> Vector:
            return np.asarray(np.bincount(rows, values, len(totals)), dtype=float)

        senses = contacts.senses(self._shapes)
        normals = senses[:, np.newaxis] * contacts.normal_forces
        sizes = np.linalg.norm(normals, axis=1)
        pressed, here = summed(sizes), summed(sizes * np.abs(contacts.senses(self._body, self._other)))
        normal = np.column_stack([summed(column) for column in normals.T])
        loaded = (pressed > _NO_LOAD)[:, np.newaxis]
        along = np.divide(
            normal, np.linalg.norm(normal, axis=1, keepdims=True), out=np.zeros_like(normal), where=loaded
        )
        across = totals - (totals * along).sum(axis=1, keepdims=True) * along
        share = np.divide(here, pressed, out=np.zeros_like(here), where=loaded[:, 0])
        return np.asarray(share[:, np.newaxis] * across)

    def mean_contact_forces(self, sampler: Sampler, times: Vector) -> Vector:
        """Return the mean force of all contacts on the model over the steps around ``times``, shape (m, 3) [N]."""
        plant, knots = self._plant, sampler.history.times
        context = plant.CreateDefaultContext()
        ends = np.clip(np.searchsorted(knots, times, side="left"), 1, len(knots) - 1)
        steps = np.unique(np.append(ends, ends - 1))
        (states,) = sampler.sample([self._state], knots[steps])
        momenta = np.empty((len(knots), 3))
        for step, state in zip(steps, states, strict=True):
            plant.SetPositionsAndVelocities(context, state)
            momentum = plant.CalcSpatialMomentumInWorldAboutPoint(context, [self._instance], np.zeros(3))
            momenta[step] = momentum.translational()
        rates = (momenta[ends] - momenta[ends - 1]) / (knots[ends] - knots[ends - 1])[:, np.newaxis]
        weight = plant.CalcTotalMass(context, [self._instance]) * plant.gravity_field().gravity_vector()
        return np.asarray(rates - weight)
