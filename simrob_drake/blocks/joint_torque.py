"""Torques that joints hand on to their links, from Drake's reaction forces."""

from collections.abc import Sequence

import numpy as np
from pydrake.common.value import Value
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.tree import Joint, PrismaticJoint
from pydrake.systems.framework import BasicVector, Context

from simrob_drake.blocks.block import Block
from simrob_drake.frames import Vector
from simrob_drake.lifetime import weakly


class JointTorqueSensor(Block):
    """Measure the torque about, or the force along, each joint's axis: what the joint hands on to its link.

    It is the motor's torque less the joint's own damping and friction, and without the
    torque that turns the motor's rotor. Forces that act on the links from outside, such
    as elastic end stops, are no part of it.

    Ports:
        in  ``reaction_forces``: of the plant, not of one that ``cenic`` steps.
        out ``torque`` (n): [N·m], or [N] of a sliding joint.
    """

    def __init__(self, *, joints: Sequence[Joint], signs: Vector) -> None:
        """Make the block for one-axis ``joints`` whose axes count positive in the sense of ``signs`` (n,)."""
        super().__init__()
        self._joints = [
            (int(joint.index()), isinstance(joint, PrismaticJoint), sign * _axis(joint))
            for joint, sign in zip(joints, signs, strict=True)
        ]
        self._forces = self.DeclareAbstractInputPort("reaction_forces", Value[list[SpatialForce]]())
        self.DeclareVectorOutputPort("torque", len(joints), weakly(self._calc_torque))

    def _calc_torque(self, context: Context, output: BasicVector) -> None:
        """Project the force in each joint on the joint's axis."""
        forces = self._forces.Eval(context)
        for place, (index, slides, axis) in enumerate(self._joints):
            force = forces[index]
            part = force.translational() if slides else force.rotational()
            output.SetAtIndex(place, float(axis @ part))


def _axis(joint: Joint) -> Vector:
    """Axis of a joint in its frames, where it is the same in both."""
    slides = isinstance(joint, PrismaticJoint)
    return np.asarray(joint.translation_axis() if slides else joint.revolute_axis())
