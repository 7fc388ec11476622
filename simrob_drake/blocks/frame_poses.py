"""The poses of frames of a robot, such as its base and its tool centre points."""

import weakref
from collections.abc import Mapping
from functools import partial

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Frame
from pydrake.systems.framework import BasicVector, Context

from simrob_drake.base.frames import XYZ_QUATERNION_NAMES, Vector, xyz_quaternion_from_transform
from simrob_drake.base.lifetime import weakly
from simrob_drake.blocks.block import Block


class FramePoses(Block):
    """Give the poses of frames in the world, from the state of their plant.

    Neither the plant nor the block need be part of the diagram, so it serves dynamic and kinematic stations alike, and
    :meth:`at` recorded states. One block serves all frames of a robot: each block that reads the state costs a solver
    time at every change of it.

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
        self._frames = {name: frame.index() for name, frame in frames.items()}
        self._moving = {name for name, frame in frames.items() if not plant.IsAnchored(frame.body())}
        for name in frames:
            depends_on = moving if name in self._moving else {self.nothing_ticket()}
            calc = partial(weakly(self._calc_pose), name)
            self.DeclareVectorOutputPort(name, len(XYZ_QUATERNION_NAMES), calc, depends_on)

    def at(self, name: str, states: Vector) -> Vector:
        """Return the poses (m, 7) of a frame in states (m, nq + nv) of the plant, as its port gives them."""
        if name not in self._moving:
            return np.tile(self._pose(name), (len(states), 1))
        plant, scratch, poses = self._plant, self._scratch, np.empty((len(states), len(XYZ_QUATERNION_NAMES)))
        frame, positions = plant.get_frame(self._frames[name]), states[:, : plant.num_positions()]
        for row, own in enumerate(positions):
            plant.SetPositions(scratch, own)
            pose = frame.CalcPoseInWorld(scratch)
            poses[row, :3], poses[row, 3:] = pose.translation(), pose.rotation().ToQuaternion().wxyz()
        poses[poses[:, 3] < 0, 3:] *= -1
        return poses

    def _calc_pose(self, name: str, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._pose(name, self._state.Eval(context) if name in self._moving else None))

    def _pose(self, name: str, state: Vector | None = None) -> Vector:
        if state is not None:
            self._plant.SetPositions(self._scratch, state[: self._plant.num_positions()])
        return xyz_quaternion_from_transform(self._plant.get_frame(self._frames[name]).CalcPoseInWorld(self._scratch))
