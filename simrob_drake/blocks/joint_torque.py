"""Sensor of the torques that joints transmit to their links, computed from Drake's reaction forces."""

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
    """Measure the torque about, or the force along, the axis of each joint: the part that reaches the link.

    The measured torque is the motor's torque without the part that turns the motor's rotor, and less the joint's own
    damping and friction. Forces that act on the links directly, such as those of elastic end stops, are not included.

    Ports:
        in  ``reaction_forces``: the plant's reaction forces. Do not use the block with the scheme ``cenic``.
        out ``torque`` (n): [N·m], or [N] for a prismatic joint.
    """

    def __init__(self, *, joints: Sequence[Joint], signs: Vector) -> None:
        """Make the block.

        Args:
            joints: n joints with one axis each, revolute or prismatic.
            signs: sign of the robot's axis along each joint's axis, 1 or -1, shape (n,).
        """
        super().__init__()
        self._joints = [
            (int(joint.index()), isinstance(joint, PrismaticJoint), sign * _axis(joint))
            for joint, sign in zip(joints, signs, strict=True)
        ]
        self._forces = self.DeclareAbstractInputPort("reaction_forces", Value[list[SpatialForce]]())
        self.DeclareVectorOutputPort("torque", len(joints), weakly(self._calc_torque))

    def _calc_torque(self, context: Context, output: BasicVector) -> None:
        """Compute the component of each joint's reaction force along the joint's axis."""
        forces = self._forces.Eval(context)
        for row, (index, is_prismatic, axis) in enumerate(self._joints):
            force = forces[index]
            part = force.translational() if is_prismatic else force.rotational()
            output.SetAtIndex(row, float(axis @ part))


def _axis(joint: Joint) -> Vector:
    """Unit vector of a joint's axis, shape (3,). Its components are the same in the joint's parent and child frame."""
    is_prismatic = isinstance(joint, PrismaticJoint)
    return np.asarray(joint.translation_axis() if is_prismatic else joint.revolute_axis())
