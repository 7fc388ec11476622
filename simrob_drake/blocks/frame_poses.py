"""Block that computes the poses of frames of a robot, such as its base and its tool centre points."""

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
    """Compute the poses of frames in the world from the state of their plant.

    Neither the plant nor the block has to be part of a diagram, so the block serves dynamic and kinematic stations, and
    :meth:`at` serves recorded states. One block computes all frames of a robot: each block that reads the state costs a
    solver time at every change of the state.

    Ports:
        in  ``state`` (nq + nv): positions and velocities of the whole plant.
        out ``<name>`` (7) for every frame: x y z [m] qw qx qy qz.
    """

    def __init__(self, *, plant: MultibodyPlant, frames: Mapping[str, Frame]) -> None:
        """Create the block.

        Args:
            plant: the finalized plant.
            frames: frames of the plant, by the names of their output ports.
        """
        super().__init__()
        # A strong reference would keep the plant, and the diagram that contains it, in memory.
        self._plant = weakref.proxy(plant)
        # Work space: every evaluation sets its positions anew.
        self._scratch = plant.CreateDefaultContext()
        self._state = self.DeclareVectorInputPort("state", plant.num_multibody_states())
        self._frames = {name: frame.index() for name, frame in frames.items()}
        self._moving = {
            name for name, frame in frames.items() if not plant.IsAnchored(frame.body())
        }

        state_ticket = self.input_port_ticket(self._state.get_index())
        for name in frames:
            # Drake computes the pose of an anchored frame only once.
            prerequisite = state_ticket if name in self._moving else self.nothing_ticket()
            # Drake keeps the callback, which holds the block weakly, as it would otherwise never be freed.
            calc = partial(weakly(self._calc_pose), name)
            self.DeclareVectorOutputPort(name, len(XYZ_QUATERNION_NAMES), calc, {prerequisite})

    def at(self, name: str, states: Vector) -> Vector:
        """Compute the poses of a frame in many states, as its port gives them.

        Args:
            name: name of the frame's port.
            states: states of the plant, shape (m, nq + nv).

        Returns:
            The poses x y z [m] qw qx qy qz, shape (m, 7).
        """
        if name not in self._moving:
            return np.tile(self._pose(name), (len(states), 1))
        plant = self._plant
        frame = plant.get_frame(self._frames[name])
        poses = np.empty((len(states), len(XYZ_QUATERNION_NAMES)))
        for row, positions in enumerate(states[:, : plant.num_positions()]):
            plant.SetPositions(self._scratch, positions)
            pose = frame.CalcPoseInWorld(self._scratch)
            poses[row, :3] = pose.translation()
            poses[row, 3:] = pose.rotation().ToQuaternion().wxyz()
        # A quaternion and its negative are the same rotation. Ports give the one whose qw is not negative.
        poses[poses[:, 3] < 0, 3:] *= -1
        return poses

    def _calc_pose(self, name: str, context: Context, output: BasicVector) -> None:
        """Compute the pose that the port of a name gives."""
        state = self._state.Eval(context) if name in self._moving else None
        output.SetFromVector(self._pose(name, state))

    def _pose(self, name: str, state: Vector | None = None) -> Vector:
        """Compute the pose of a frame in a state of the plant.

        Args:
            name: name of the frame's port.
            state: positions and velocities of the plant, shape (nq + nv,), or None for an anchored frame.

        Returns:
            The pose x y z [m] qw qx qy qz, shape (7,).
        """
        if state is not None:
            # Poses depend on the positions only, so the velocities at the end of the state are left out.
            positions = state[: self._plant.num_positions()]
            self._plant.SetPositions(self._scratch, positions)
        frame = self._plant.get_frame(self._frames[name])
        return xyz_quaternion_from_transform(frame.CalcPoseInWorld(self._scratch))
