"""The poses of frames of a robot, such as its base and its tool centre points."""

import weakref
from collections.abc import Mapping
from functools import partial

from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Frame, FrameIndex
from pydrake.systems.framework import BasicVector, Context

from simrob_drake.blocks.block import Block
from simrob_drake.frames import XYZ_QUATERNION_NAMES, xyz_quaternion_from_transform
from simrob_drake.lifetime import weakly


class FramePoses(Block):
    """Give the poses of frames in the world, from the state of their plant.

    The plant need not be part of the diagram, so the block serves dynamic and kinematic stations alike. One block
    serves all frames of a robot: each block that reads the state costs a solver time at every change of it.

    Ports:
        in  ``state`` (nq + nv): positions and velocities of the whole plant.
        out ``<name>`` (7) for every frame: x y z [m] qw qx qy qz.
    """

    def __init__(self, *, plant: MultibodyPlant, frames: Mapping[str, Frame]) -> None:
        """Make the block for ``frames`` of a finalized ``plant``, by the names of their ports."""
        super().__init__()
        self._plant = weakref.proxy(plant)
        self._scratch = plant.CreateDefaultContext()  # nothing is remembered in it: every evaluation sets it anew
        self._state = self.DeclareVectorInputPort("state", plant.num_multibody_states())
        moving = {self.input_port_ticket(self._state.get_index())}
        for name, frame in frames.items():
            depends_on = {self.nothing_ticket()} if plant.IsAnchored(frame.body()) else moving
            calc = partial(weakly(self._calc_pose), frame.index())
            self.DeclareVectorOutputPort(name, len(XYZ_QUATERNION_NAMES), calc, depends_on)

    def _calc_pose(self, index: FrameIndex, context: Context, output: BasicVector) -> None:
        frame = self._plant.get_frame(index)
        if not self._plant.IsAnchored(frame.body()):
            positions = self._state.Eval(context)[: self._plant.num_positions()]
            self._plant.SetPositions(self._scratch, positions)
        output.SetFromVector(xyz_quaternion_from_transform(frame.CalcPoseInWorld(self._scratch)))
