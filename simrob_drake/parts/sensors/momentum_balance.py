r"""Friction under the scheme ``cenic``, from the balance of momentum of what stands free.

The mean force of all contacts on a model over a step is :math:`\bar f = (P_1 - P_0)/h - m g` with its momentum P at
the ends of the step. Drake's contact results give the parts along the normals; what is left across them goes to a
sensor in proportion to its share of all that is pressed on the model: one foot of two cannot be told otherwise.
"""

from collections.abc import Collection, Sequence

import numpy as np
import numpy.typing as npt
from pydrake.geometry import GeometryId
from pydrake.multibody.tree import Frame

from simrob_drake.blocks.contacts import Contacts
from simrob_drake.frames import Vector
from simrob_drake.parts.site import Site
from simrob_drake.signals import Recorded

_NO_LOAD = 1e-9  # N


class MomentumBalance:
    """What one sensor has of the friction on its model.

    What sensors have in common, contacts and momenta, is worked out once a run: it lies in the run's memo.
    """

    def __init__(
        self, site: Site, frame: Frame, body: Collection[GeometryId], other: Collection[GeometryId] | None
    ) -> None:
        """Look at the forces of ``other`` shapes, all unless given, on those of ``body``, in the axes of a frame."""
        self._plant, self._state = site.plant.plant, site.state
        self._contacts = site.plant.plant.get_contact_results_output_port()
        self._frame, self._body, self._other = frame, set(body), None if other is None else set(other)
        plant, inspector = self._plant, site.plant.scene_graph.model_inspector()
        self._instance = plant.GetBodyFromFrameId(inspector.GetFrameId(next(iter(self._body)))).model_instance()
        bodies = [plant.get_body(index) for index in plant.GetBodyIndices(self._instance)]
        self._shapes = {shape for part in bodies for shape in plant.GetCollisionGeometriesForBody(part)}

    def with_friction(self, recorded: Recorded, times: Vector, forces: Vector) -> Vector:
        """Return forces along the normals at times (m,) [s] with the sensor's share of those across, (m, 3) [N]."""
        if len(recorded.step_times) < 2:
            return forces
        contacts, rows = self._all_contacts(recorded, times)
        across = self._across(self._totals(recorded, times), contacts, rows)
        turns = np.empty((len(times), 3, 3))
        context = self._plant.CreateDefaultContext()
        for row, state in enumerate(recorded.sample([self._state], times)[0]):
            self._plant.SetPositionsAndVelocities(context, state)
            turns[row] = self._frame.CalcPoseInWorld(context).rotation().matrix()
        return np.asarray(forces + np.einsum("mji,mj->mi", turns, across))

    def _all_contacts(self, recorded: Recorded, times: Vector) -> tuple[Contacts, npt.NDArray[np.intp]]:
        """Return the contacts of all times, and to which time each of them belongs, shape (k,)."""
        key = ("contacts", times.tobytes())
        if key not in recorded.memo:
            moments: Sequence[Contacts] = [Contacts.of(found) for found in recorded.sample([self._contacts], times)[0]]
            rows = np.repeat(range(len(times)), [len(each.pairs) for each in moments])
            recorded.memo[key] = Contacts.together(moments), rows
        contacts: tuple[Contacts, npt.NDArray[np.intp]] = recorded.memo[key]
        return contacts

    def _across(self, totals: Vector, contacts: Contacts, rows: npt.NDArray[np.intp]) -> Vector:
        """Return the sensor's share of what is across the normals, shape (m, 3) [N], in the world's axes.

        ``totals`` are of all forces on the sensor's model, shape (m, 3) [N]; ``rows`` (k,) tells to which time each
        contact belongs.
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

    def _totals(self, recorded: Recorded, times: Vector) -> Vector:
        """Return the mean force of all contacts on the model over the steps around ``times``, shape (m, 3) [N]."""
        key = ("contact force", int(self._instance), times.tobytes())
        if key not in recorded.memo:
            recorded.memo[key] = self._mean_contact_forces(recorded, times)
        totals: Vector = recorded.memo[key]
        return totals

    def _mean_contact_forces(self, recorded: Recorded, times: Vector) -> Vector:
        plant, knots = self._plant, recorded.step_times
        context = plant.CreateDefaultContext()
        ends = np.clip(np.searchsorted(knots, times, side="left"), 1, len(knots) - 1)
        steps = np.unique(np.append(ends, ends - 1))
        (states,) = recorded.sample([self._state], knots[steps])
        momenta = np.empty((len(knots), 3))
        for step, state in zip(steps, states, strict=True):
            plant.SetPositionsAndVelocities(context, state)
            momentum = plant.CalcSpatialMomentumInWorldAboutPoint(context, [self._instance], np.zeros(3))
            momenta[step] = momentum.translational()
        rates = (momenta[ends] - momenta[ends - 1]) / (knots[ends] - knots[ends - 1])[:, np.newaxis]
        weight = plant.CalcTotalMass(context, [self._instance]) * plant.gravity_field().gravity_vector()
        return np.asarray(rates - weight)
