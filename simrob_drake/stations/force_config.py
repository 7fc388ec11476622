"""A force at the tool over time: the kinds that a station file can name."""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated, Literal

from pydantic import Field, model_validator

from simrob_drake.robots.pieces import NotNegative, Positive, Triple
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


class Push(Strict):
    """A constant force for a while."""

    start: NotNegative
    """When it begins [s]."""
    duration: Positive
    """How long it lasts [s]."""
    force: Triple
    """Along the axes of the tool [N]."""


class Pushes(Strict):
    """One push after the other, and nothing between them."""

    kind: Literal["pushes"]
    pushes: Annotated[tuple[Push, ...], Field(min_length=1)]

    @model_validator(mode="after")
    def _one_after_the_other(self) -> Pushes:
        for before, after in pairwise(self.pushes):
            if after.start < before.start + before.duration:
                raise ValueError(f"the push at {after.start:g} s begins before the one before it has ended")
        return self


ExternalForce = Annotated[SineForce | Pushes, Field(discriminator="kind")]
