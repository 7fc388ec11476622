"""A spring between a point of a body and a target that somebody moves, as a hand or a mouse pulls."""

import weakref

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Frame

from simrob_drake.blocks.sampled import Changes, Named, SampledBlock
from simrob_drake.frames import Vector


class DragSpring(SampledBlock):
    r"""The force :math:`f = k (p_t - p) - c \dot{p}` of a target on a point, sampled and held; zero without a target.

    Ports:
        in  ``target`` (4): whether there is one, 1 or 0, and where in the world, p_t [m]; ``state`` (nq + nv): of the
            whole plant.
        out ``force`` (3) [N]: in the axes of the frame.
    """

    def __init__(
        self, *, period: float, plant: MultibodyPlant, frame: Frame, point: Vector, gains: tuple[float, float]
    ) -> None:
        """Make the block.

        Args:
            period: between samples [s].
            plant: finalized; it need not be part of the diagram.
            frame: of the body.
            point: p in the frame, shape (3,) [m].
            gains: k [N/m] and c [N·s/m].
        """
        self.units = {"force": "N"}
        reads = {"target": 4, "state": plant.num_multibody_states()}
        super().__init__(period=period, reads=reads, memory={"force": np.zeros(3)}, gives=["force"])
        self._plant, self._frame, self._point, self._gains = weakref.proxy(plant), frame.index(), point, gains
        self._scratch = plant.CreateDefaultContext()  # nothing is remembered in it: every evaluation sets it anew

    def sample(self, memory: Named, read: Named) -> Changes:
        """Return the force now."""
        pulls, *target = read["target"]
        if not pulls:
            return {"force": np.zeros(3)}
        plant, context = self._plant, self._scratch
        plant.SetPositionsAndVelocities(context, read["state"])
        frame = plant.get_frame(self._frame)
        pose, motion = frame.CalcPoseInWorld(context), frame.CalcSpatialVelocityInWorld(context)
        speed = motion.translational() + np.cross(motion.rotational(), pose.rotation() @ self._point)
        stiffness, damping = self._gains
        force = stiffness * (np.array(target) - pose @ self._point) - damping * speed
        return {"force": pose.rotation().inverse() @ force}
