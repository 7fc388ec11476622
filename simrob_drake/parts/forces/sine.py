"""A force that swings about zero."""

from typing import Literal

import numpy as np
from pydrake.systems.primitives import Sine

from simrob_drake.parts.forces.force import ForceSection
from simrob_drake.sections import Frequency, Number, Triple


class SineForce(ForceSection):
    """A force that swings about zero."""

    kind: Literal["sine"]
    amplitude: Triple
    """Largest force along x, y and z of what it acts on [N]."""
    frequency: Frequency
    """Swings a second [Hz]."""
    phase_deg: Number = 0.0
    """Angle at the start."""

    @property
    def edges(self) -> tuple[float, ...]:
        """It has none: it is smooth."""
        return ()

    def source(self) -> Sine:
        """Return the block that gives the force (3) [N]."""
        frequency, phase = np.full(3, 2 * np.pi * self.frequency), np.full(3, np.deg2rad(self.phase_deg))
        return Sine(np.array(self.amplitude), frequency, phase)

    def caption(self) -> str:
        """Return it in words."""
        return f"sine ±{float(np.linalg.norm(self.amplitude)):g} N, {self.frequency:.3g} Hz"
