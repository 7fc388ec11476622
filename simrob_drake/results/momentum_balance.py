r"""Friction under the scheme ``cenic``, from the balance of momentum of what stands free.

The mean force of all contacts on a model over a step is :math:`\bar f = (P_1 - P_0)/h - m g` with its momentum P at
the ends of the step. Drake's contact results give the parts along the normals; what is left across them goes to a
sensor in proportion to its share of all that is pressed on the model: one foot of two cannot be told otherwise.
"""

from __future__ import annotations

import numpy as np
from pydrake.multibody.plant import ContactResults

from simrob_drake.blocks.force_sensor import contacts_of
from simrob_drake.frames import Vector
from simrob_drake.results.signals import Sampler
from simrob_drake.stations.ports import StationPorts
from simrob_drake.stations.sensor_config import Force
from simrob_drake.stations.targets import frame_of, shapes_of

_NO_LOAD = 1e-9  # N


class MomentumBalance:
    """What a force sensor feels across the contacts' normals, by the momentum of the model that it sits on."""

    def __init__(self, sampler: Sampler, ports: StationPorts, sensor: Force) -> None:
        """Prepare for a ``sensor`` on a model that stands free, in a recorded run."""
        station, plant = ports.plant, ports.plant.plant
        self._sampler, self._plant, self._state = sampler, plant, ports.state
        self._frame = frame_of(station, sensor.frame)
        self._body = set(shapes_of(station, ports.config, sensor.body))
        self._other = None if sensor.other is None else set(shapes_of(station, ports.config, sensor.other))
        inspector = station.scene_graph.model_inspector()
        self._instance = plant.GetBodyFromFrameId(inspector.GetFrameId(next(iter(self._body)))).model_instance()
        bodies = [plant.get_body(index) for index in plant.GetBodyIndices(self._instance)]
        self._model = {shape for body in bodies for shape in plant.GetCollisionGeometriesForBody(body)}

    def friction(self, times: Vector) -> Vector:
        """Return the force across the normals at ``times`` (m,) [s], shape (m, 3) [N], in the axes of the sensor."""
        felt = np.zeros((len(times), 3))
        if len(self._sampler.history.times) < 2:
            return felt
        results = self._plant.get_contact_results_output_port()
        totals = self._mean_contact_forces(times)
        for row, root in enumerate(self._sampler.contexts(times)):
            context = self._plant.GetMyContextFromRoot(root)
            normal, share = self._pressed(results.Eval(context))
            if share > 0:
                along = normal / np.linalg.norm(normal)
                across = totals[row] - (totals[row] @ along) * along
                felt[row] = share * (self._frame.CalcPoseInWorld(context).rotation().inverse() @ across)
        return felt

    def _mean_contact_forces(self, times: Vector) -> Vector:
        """Return the mean force of all contacts on the model over the steps around ``times``, shape (m, 3) [N]."""
        plant, knots = self._plant, self._sampler.history.times
        context = plant.CreateDefaultContext()
        ends = np.clip(np.searchsorted(knots, times, side="left"), 1, len(knots) - 1)
        steps = np.unique(np.append(ends, ends - 1))
        (states,) = self._sampler.sample([self._state], knots[steps])
        momenta = np.empty((len(knots), 3))
        for step, state in zip(steps, states, strict=True):
            plant.SetPositionsAndVelocities(context, state)
            momentum = plant.CalcSpatialMomentumInWorldAboutPoint(context, [self._instance], np.zeros(3))
            momenta[step] = momentum.translational()
        rates = (momenta[ends] - momenta[ends - 1]) / (knots[ends] - knots[ends - 1])[:, np.newaxis]
        weight = plant.CalcTotalMass(context, [self._instance]) * plant.gravity_field().gravity_vector()
        return np.asarray(rates - weight)

    def _pressed(self, results: ContactResults) -> tuple[Vector, float]:
        """Return the sum of the normal forces on the model, shape (3,) [N], and the sensor's share of their sizes."""
        total, pressed, here = np.zeros(3), 0.0, 0.0
        for contact in contacts_of(results):
            for shape, other, sign in ((contact.first, contact.second, 1), (contact.second, contact.first, -1)):
                if shape in self._model and other not in self._model:
                    normal = sign * contact.normal_part().force
                    size = float(np.linalg.norm(normal))
                    total, pressed = total + normal, pressed + size
                    counts = shape in self._body and (self._other is None or other in self._other)
                    here += size if counts else 0.0
        return total, here / pressed if pressed > _NO_LOAD else 0.0
