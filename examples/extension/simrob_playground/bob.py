"""Gait of a robot that bobs: it bends its legs, and stretches them again."""

from typing import ClassVar

import numpy as np
from pydantic import Field

from simrob_drake.base.sections import Integer
from simrob_drake.blocks.references import smooth
from simrob_drake.programs.gaits.motion import Gait, JointMotion, Pace
from simrob_drake.programs.gaits.phases import samples
from simrob_drake.programs.gaits.sequences import standing_height
from simrob_drake.programs.gaits.walker import Walker
from simrob_drake.robots.axis_map import AxisValues


class Bob(Gait):
    """Bending and stretching all legs at the same place."""

    section: ClassVar[str] = "bobs"

    low_deg: AxisValues
    """Posture with bent legs, per axis [deg]. Axes that are left out stay at zero."""
    half_time: Pace = 0.6
    """Time from the stretched to the bent posture [s]."""
    times: Integer = Field(default=2, ge=1, le=100)
    """Number of times that the robot goes down and up."""

    def plan(self, walker: Walker, steps: int = 0, amplitude: float = 1.0) -> JointMotion:
        """Plan the motion.

        The part s(t) of the way down rises from 0 to 1 and falls back in each period of two half times T:

            s(t) = b(t / T) for t < T,    s(t) = b(2 - t / T) for t >= T,

        with the smooth blend b, which begins and ends at rest.
        """
        model = walker.model
        size = len(model.axes)
        low = model.axis_vector(self.low_deg, "low_deg", np.zeros(size)) * model.user_units

        moving = 2 * self.half_time * self.times
        times = samples(moving + self.rest)
        phase = np.minimum(times, moving) / self.half_time % 2.0
        share = smooth(np.where(phase < 1.0, phase, 2.0 - phase))
        positions = amplitude * share[:, np.newaxis] * low

        # The planned pose of the root: upright, as high as the legs are long.
        root = np.tile(np.eye(4), (len(times), 1, 1))
        for index, angles in enumerate(positions):
            root[index, 2, 3] = standing_height(walker.skeleton, angles, self.feet)
        return JointMotion(model, self.feet, times, positions, root)
