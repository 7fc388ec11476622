"""Sensor of the torques that joints transmit to their links, computed from Drake's reaction forces."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from pydrake.common.value import Value
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.tree import Joint, PrismaticJoint
from pydrake.systems.framework import BasicVector, Context

from simrob_drake.base.frames import Vector
from simrob_drake.base.lifetime import weakly
from simrob_drake.blocks.block import Block


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
        # The block keeps no joint: a joint would keep the plant, and with it the whole diagram, in memory.
        self._joints = [
            _MeasuredJoint(
                number=int(joint.index()),
                is_prismatic=isinstance(joint, PrismaticJoint),
                axis=sign * _joint_axis(joint),
            )
            for joint, sign in zip(joints, signs, strict=True)
        ]
        self._forces = self.DeclareAbstractInputPort("reaction_forces", Value[list[SpatialForce]]())
        # Drake keeps the callback of a port. It gets a weak reference, as the block would otherwise never be freed.
        self.DeclareVectorOutputPort("torque", len(joints), weakly(self._calc_torque))

    def _calc_torque(self, context: Context, output: BasicVector) -> None:
        """Compute the reaction torque of each joint about its axis, or the force along it if the joint is prismatic."""
        forces = self._forces.Eval(context)
        for row, joint in enumerate(self._joints):
            reaction = forces[joint.number]
            # The torque about the axis a is the product a . m with the reaction's moment. For a prismatic joint it is
            # a . f with the reaction's force.
            vector = reaction.translational() if joint.is_prismatic else reaction.rotational()
            output.SetAtIndex(row, float(joint.axis @ vector))


class _MeasuredJoint(NamedTuple):
    """Properties of a joint that the sensor uses.

    Attributes:
        number: index of the joint in the plant, and so of its reaction force.
        is_prismatic: whether the joint slides.
        axis: unit vector of the robot's axis, shape (3,), in the joint's child frame, as reaction forces are.
    """

    number: int
    is_prismatic: bool
    axis: Vector


def _joint_axis(joint: Joint) -> Vector:
    """Unit vector of a joint's axis, shape (3,).

    Its components are the same in the joint's parent and child frame, since the joint does not turn its own axis.
    """
    if isinstance(joint, PrismaticJoint):
        return np.asarray(joint.translation_axis())
    return np.asarray(joint.revolute_axis())
