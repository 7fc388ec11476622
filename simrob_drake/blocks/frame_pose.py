"""The pose of a frame of the robot, such as its tool centre point."""

from __future__ import annotations

from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Frame
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from simrob_drake.frames import XYZ_QUATERNION_NAMES, xyz_quaternion_from_transform


class FramePose(LeafSystem):
    """Give the pose of a frame in the world, from the state of its plant.

    The plant need not be part of the diagram, so the block serves dynamic and kinematic stations alike.

    Ports:
        in  ``state`` (nq + nv): positions and velocities of the whole plant.
        out ``pose`` (7): x y z [m] qw qx qy qz.
    """

    def __init__(self, *, plant: MultibodyPlant, frame: Frame) -> None:
        """Make the block for a ``frame`` of a finalized ``plant``."""
        super().__init__()
        self._plant, self._frame = plant, frame
        self._scratch = plant.CreateDefaultContext()  # nothing is remembered in it: every evaluation sets it anew
        self._state = self.DeclareVectorInputPort("state", plant.num_multibody_states())
        self.DeclareVectorOutputPort("pose", len(XYZ_QUATERNION_NAMES), self._calc_pose)

    def _calc_pose(self, context: Context, output: BasicVector) -> None:
        self._plant.SetPositions(self._scratch, self._state.Eval(context)[: self._plant.num_positions()])
        output.SetFromVector(xyz_quaternion_from_transform(self._frame.CalcPoseInWorld(self._scratch)))
