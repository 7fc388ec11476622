"""The contacts of a plant as arrays, made once for all that look at them, and the force with which they press."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from pydrake.common.value import AbstractValue, Value
from pydrake.geometry import GeometryId
from pydrake.math import RigidTransform
from pydrake.multibody.plant import ContactResults, MultibodyPlant
from pydrake.multibody.tree import Frame
from pydrake.systems.framework import BasicVector, Context

from simrob_drake.blocks.block import Block
from simrob_drake.frames import Vector
from simrob_drake.lifetime import weakly


@dataclass(frozen=True)
class Contacts:
    """What touches what at one moment: k points and surfaces, in the world.

    Attributes:
        pairs: the first and the second shape of each.
        points: where the forces act, shape (k, 3) [m].
        forces: on the first shapes, shape (k, 3) [N].
        moments: on the first shapes about the points, shape (k, 3) [N·m]; zero for points.
        normals: of the surfaces, out of the second shapes, shape (k, 3).
    """

    pairs: list[tuple[GeometryId, GeometryId]]
    points: Vector
    forces: Vector
    moments: Vector
    normals: Vector

    @classmethod
    def of(cls, results: ContactResults | Contacts) -> Contacts:
        """Return the contacts of Drake's contact results; those of another engine are contacts already."""
        if isinstance(results, Contacts):
            return results
        pairs, rows = [], []
        for index in range(results.num_point_pair_contacts()):
            info = results.point_pair_contact_info(index)
            pair = info.point_pair()
            pairs.append((pair.id_B, pair.id_A))
            rows.append((info.contact_point(), info.contact_force(), _NOTHING, -pair.nhat_BA_W))
        for index in range(results.num_hydroelastic_contacts()):
            info = results.hydroelastic_contact_info(index)
            surface, wrench = info.contact_surface(), info.F_Ac_W()
            areas = np.array([surface.area(face) for face in range(surface.num_faces())])
            normals = np.array([surface.face_normal(face) for face in range(surface.num_faces())])
            normal = areas @ normals  # normals of the faces point out of N, into M
            if not normal.any():  # bodies that only just touch: a surface without area, and without force
                continue
            pairs.append((surface.id_M(), surface.id_N()))
            unit = normal / np.linalg.norm(normal)
            rows.append((surface.centroid(), wrench.translational(), wrench.rotational(), unit))
        return cls(pairs, *np.array(rows).reshape(-1, 4, 3).transpose(1, 0, 2))

    @classmethod
    def together(cls, moments: Sequence[Contacts]) -> Contacts:
        """Return the contacts of several moments, one behind the other."""
        arrays = ([getattr(each, name) for each in moments] for name in ("points", "forces", "moments", "normals"))
        return cls([pair for each in moments for pair in each.pairs], *map(np.vstack, arrays))

    @cached_property
    def normal_forces(self) -> Vector:
        """The parts of the forces along the normals, shape (k, 3) [N]."""
        return np.asarray((self.forces * self.normals).sum(axis=1, keepdims=True) * self.normals)

    def senses(self, body: Collection[GeometryId], other: Collection[GeometryId] | None = None) -> Vector:
        """Return 1 where a body's shape is a contact's first, -1 where it is the second, shape (k,).

        Zero where the body has no part in it, or touches something else than ``other``; unless given that is all but
        the body itself.
        """

        def between(shape: GeometryId, presses: GeometryId) -> bool:
            return shape in body and (presses not in body if other is None else presses in other)

        known = {(a, b): between(a, b) or -1.0 * between(b, a) for a, b in set(self.pairs)}
        return np.array([known[pair] for pair in self.pairs], dtype=float)


_NOTHING = np.zeros(3)


class ContactReader(Block):
    """Hand on a plant's contact results as :class:`Contacts`, read once for all blocks that need them.

    Ports:
        in  ``contact_results``: of the plant.
        out ``contacts``.
    """

    def __init__(self) -> None:
        """Make the block."""
        super().__init__()
        self._results = self.DeclareAbstractInputPort("contact_results", Value[ContactResults]())
        self.DeclareAbstractOutputPort("contacts", Value[object], weakly(self._read))

    def _read(self, context: Context, output: AbstractValue) -> None:
        output.set_value(Contacts.of(self._results.Eval(context)))


class ForceSensor(Block):
    r"""Measure the contact force on a body, and its moment about the origin of a frame.

    .. math:: f = \sum_i f_i, \qquad m = \sum_i (p_i - p_F) \times f_i + m_i

    over the point contacts and the contact surfaces (:math:`m_i`, about their centroids) between two sets of shapes.

    Ports:
        in  ``contacts``: those of a plant, of a ContactReader.
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
        """Make the block for the shapes of ``body`` on which those of ``other`` press; everything unless given.

        The frame is the world's unless given. ``normal_only`` leaves friction out, for solvers whose tangential forces
        cannot be trusted.
        """
        super().__init__()
        frame = plant.world_frame() if frame is None else frame
        self._body, self._other, self._normal_only = set(body), None if other is None else set(other), normal_only
        self._index, self._fixed = int(frame.body().index()), frame.GetFixedPoseInBodyFrame()
        self._moves = not plant.IsAnchored(frame.body())
        self._pose = frame.CalcPoseInWorld(plant.CreateDefaultContext())  # where it stays, if it does
        self._contacts = self.DeclareAbstractInputPort("contacts", Value[object]())
        self._poses = self.DeclareAbstractInputPort("body_poses", Value[list[RigidTransform]]())
        self.DeclareVectorOutputPort("wrench", 6, weakly(self._calc_wrench))

    def _calc_wrench(self, context: Context, output: BasicVector) -> None:
        contacts: Contacts = self._contacts.Eval(context)
        if not any(shape in self._body for pair in contacts.pairs for shape in pair):  # at once, for loops ask often
            output.SetFromVector(np.zeros(6))
            return
        senses = contacts.senses(self._body, self._other)
        if not senses.any():
            output.SetFromVector(np.zeros(6))
            return
        pose = self._poses.Eval(context)[self._index] @ self._fixed if self._moves else self._pose
        forces = senses[:, np.newaxis] * (contacts.normal_forces if self._normal_only else contacts.forces)
        moment = _summed_cross(contacts.points - pose.translation(), forces)
        if not self._normal_only:
            moment += senses @ contacts.moments
        turn = pose.rotation().inverse()
        output.SetFromVector(np.concatenate([turn @ forces.sum(axis=0), turn @ moment]))


def _summed_cross(arms: Vector, forces: Vector) -> Vector:
    """Return the sum of the cross products of rows (k, 3)."""
    products = arms.T @ forces
    return np.array([products[k - 2, k - 1] - products[k - 1, k - 2] for k in range(3)])
