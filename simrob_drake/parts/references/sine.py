"""Swing about the initial posture."""

from typing import Literal

import numpy as np

from simrob_drake.blocks.references import SineReference
from simrob_drake.frames import Vector
from simrob_drake.parts.captions import shown_positions
from simrob_drake.parts.references.reference import ReferenceSection
from simrob_drake.parts.site import ResolvedRobot
from simrob_drake.robots.axis_map import AxisValues
from simrob_drake.robots.catalog import RobotModel
from simrob_drake.sections import Frequency


class SineWave(ReferenceSection):
    """Swing about the initial posture."""

    kind: Literal["sine"]
    amplitude_deg: AxisValues = 10.0
    """Largest distance from the middle, per axis."""
    frequency: Frequency = 0.5
    """Swings a second [Hz]."""
    phase_deg: AxisValues = 0.0
    """Angle at the start, per axis; 0 starts in the middle."""

    def trajectory(self, robot: ResolvedRobot, start: Vector) -> SineReference:
        """Return the swing about ``start`` (n,) [rad or m]."""
        model = robot.model
        return SineReference(
            centre=start,
            amplitude=model.user_units * model.axis_vector(self.amplitude_deg, "reference.amplitude_deg"),
            frequency=self.frequency,
            phase=np.deg2rad(model.axis_vector(self.phase_deg, "reference.phase_deg")),
        )

    def caption(self, model: RobotModel) -> str:
        """Return it in words."""
        return f"sine ±{shown_positions(self.amplitude_deg, model)}, {self.frequency:g} Hz"
