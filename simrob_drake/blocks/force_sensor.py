"""Contact forces: what presses on a body, summed over all contact points and surfaces."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass

import numpy as np
from pydrake.common.value import Value
from pydrake.geometry import GeometryId
from pydrake.math import RigidTransform
from pydrake.multibody.plant import ContactResults, MultibodyPlant
from pydrake.multibody.tree import Frame
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from simrob_drake.frames import Vector


@dataclass(frozen=True)
class Contact:
    """One contact, of a point or of a surface.

    Attributes:
        first, second: the shapes.
        point: where the force acts, in the world, shape (3,) [m].
        force: on the first shape, in the world, shape (3,) [N].
        moment: on the first shape about the point, shape (3,) [N·m]; zero for a point.
        normal: of the surface, out of the second shape, shape (3,).
    """

    first: GeometryId
    second: GeometryId
    point: Vector
    force: Vector
    moment: Vector
    normal: Vector

    def normal_part(self) -> Contact:
        """Return the same contact with the part of its force along the normal alone."""
        along = (self.force @ self.normal) * self.normal
        return Contact(self.first, self.second, self.point, along, np.zeros(3), self.normal)


def contacts_of(results: ContactResults) -> Iterator[Contact]:
    """Yield the contacts of Drake's contact results."""
    nothing = np.zeros(3)
    for index in range(results.num_point_pair_contacts()):
        info = results.point_pair_contact_info(index)
        pair = info.point_pair()
        yield Contact(pair.id_B, pair.id_A, info.contact_point(), info.contact_force(), nothing, -pair.nhat_BA_W)
    for index in range(results.num_hydroelastic_contacts()):
        info = results.hydroelastic_contact_info(index)
        surface, wrench = info.contact_surface(), info.F_Ac_W()
        areas = np.array([surface.area(face) for face in range(surface.num_faces())])
        normals = np.array([surface.face_normal(face) for face in range(surface.num_faces())])
        normal = areas @ normals  # normals of the faces point out of N, into M
        if not normal.any():  # bodies that only just touch: a surface without area, and without force
            continue
        yield Contact(
            surface.id_M(),
            surface.id_N(),
            surface.centroid(),
            wrench.translational(),
            wrench.rotational(),
            normal / np.linalg.norm(normal),
        )


class ForceSensor(LeafSystem):
    r"""Measure the contact force on a body, and its moment about the origin of a frame.

    .. math:: f = \sum_i f_i, \qquad m = \sum_i (p_i - p_F) \times f_i + m_i

    over the point contacts and the contact surfaces (:math:`m_i`, about their centroids) between two sets of shapes.

    Ports:
        in  ``contact_results``: of the plant.
        in  ``body_poses``: of the plant.
        out ``wrench`` (6): f [N], then m [N·m], in the axes of the frame.
    """

    def __init__(
        self,
        *,
        plant: MultibodyPlant,
        body: Collection[GeometryId],
        other: Collection[GeometryId] | None = None,
        frame: Frame | None = None,
        normal_only: bool = False,
    ) -> None:
        """Make the block.

        Args:
            plant: finalized.
            body: the shapes that feel the force.
            other: the shapes that press; everything unless given.
            frame: whose axes and origin are used; the world's unless given.
            normal_only: leave friction out, for solvers whose tangential forces cannot be trusted.
        """
        super().__init__()
        frame = plant.world_frame() if frame is None else frame
        self._body, self._other, self._normal_only = set(body), None if other is None else set(other), normal_only
        self._index, self._fixed = int(frame.body().index()), frame.GetFixedPoseInBodyFrame()
        self._moves = not plant.IsAnchored(frame.body())
        self._pose = frame.CalcPoseInWorld(plant.CreateDefaultContext())  # where it stays, if it does
        self._results = self.DeclareAbstractInputPort("contact_results", Value[ContactResults]())
        self._poses = self.DeclareAbstractInputPort("body_poses", Value[list[RigidTransform]]())
        self.DeclareVectorOutputPort("wrench", 6, self._calc_wrench)

    def _calc_wrench(self, context: Context, output: BasicVector) -> None:
        results = self._results.Eval(context)
        if results.num_point_pair_contacts() + results.num_hydroelastic_contacts() == 0:
            output.SetFromVector(np.zeros(6))
            return
        pose = self._poses.Eval(context)[self._index] @ self._fixed if self._moves else self._pose
        force, moment = np.zeros(3), np.zeros(3)
        for contact in contacts_of(results):
            sign = self._sense(contact)
            if sign:
                counted = contact.normal_part() if self._normal_only else contact
                force += sign * counted.force
                moment += sign * (_cross(counted.point - pose.translation(), counted.force) + counted.moment)
        turn = pose.rotation().inverse()
        output.SetFromVector(np.concatenate([turn @ force, turn @ moment]))

    def _sense(self, contact: Contact) -> int:
        """Return 1 where the body is the contact's first shape, -1 where the second, 0 where it has no part in it."""
        if self._between(contact.first, contact.second):
            return 1
        return -1 if self._between(contact.second, contact.first) else 0

    def _between(self, body: GeometryId, other: GeometryId) -> bool:
        if body not in self._body:
            return False
        return other not in self._body if self._other is None else other in self._other


def _cross(first: Vector, second: Vector) -> Vector:
    """Return the cross product of two vectors (3,), for which numpy's own takes ten times as long."""
    (a, b, c), (x, y, z) = first.tolist(), second.tolist()
    return np.array([b * z - c * y, c * x - a * z, a * y - b * x])
