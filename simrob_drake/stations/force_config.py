"""Forces over time on a robot: the kinds that a station file can name."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from simrob_drake.quantities import NotNegative, Positive, Triple
from simrob_drake.yaml_files import Number, Strict


class SineForce(Strict):
    """Swing about zero."""

    kind: Literal["sine"]
    amplitude: Triple
    """Largest force along the axes of the tool [N]."""
    frequency: Positive
    """Swings a second [Hz]."""
    phase_deg: Number = 0.0
    """Angle at the start."""


class PushConfig(Strict):
    """A constant force for a while."""

    start: NotNegative
    """When it begins [s]."""
    duration: Positive = 0.1
    """How long it lasts [s]."""
    force: Triple
    """Along x, y and z of the tool, or of the root link, that is pushed [N]."""


class Pushes(Strict):
    """Pushes; where they overlap, they add up."""

    kind: Literal["pushes"]
    pushes: Annotated[tuple[PushConfig, ...], Field(min_length=1)]
    """In any order."""


ExternalForce = Annotated[SineForce | Pushes, Field(discriminator="kind")]
