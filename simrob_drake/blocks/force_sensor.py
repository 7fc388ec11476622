"""Contact forces: what presses on a body, summed over all contact points and surfaces."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
from pydrake.common.value import Value
from pydrake.geometry import GeometryId
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Frame
from pydrake.systems.framework import BasicVector, Context

from simrob_drake.blocks.block import Block
from simrob_drake.blocks.contacts import Contacts
from simrob_drake.frames import Vector
from simrob_drake.lifetime import weakly


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
        self._contacts = self.DeclareAbstractInputPort("contacts", Value[object]())
        self._poses = self.DeclareAbstractInputPort("body_poses", Value[list[RigidTransform]]())
        self.DeclareVectorOutputPort("wrench", 6, weakly(self._calc_wrench))

    def _calc_wrench(self, context: Context, output: BasicVector) -> None:
        contacts: Contacts = self._contacts.Eval(context)
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
