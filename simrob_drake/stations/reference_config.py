"""What a robot is asked to do over time: the kinds of reference that a station file can name."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, model_validator

from simrob_drake.quantities import NotNegative, Positive
from simrob_drake.robots.catalog import AxisValues
from simrob_drake.yaml_files import Strict


class Hold(Strict):
    """Stay at one posture."""

    kind: Literal["hold"]
    target_deg: AxisValues | None = None
    """Posture, per axis; the initial one unless given."""


class _ToOnePosture(Strict):
    """What moves to one posture share."""

    target_deg: AxisValues = 0.0
    """Posture at the end, per axis."""
    duration: Positive = 1.0
    """Time that the move takes [s]."""
    start: NotNegative = 0.0
    """When it begins [s]."""


class Ramp(_ToOnePosture):
    """Go to a posture at constant speed, as SimRob's interpolated moves do, and stay there."""

    kind: Literal["ramp"]


class Move(_ToOnePosture):
    """Go to a posture with continuous acceleration (a polynomial of degree five), and stay there."""

    kind: Literal["move"]


class Waypoint(Strict):
    """A posture and the time to be there."""

    time: Positive
    """When to be there [s]."""
    target_deg: AxisValues
    """Posture, per axis; a mapping leaves the other axes where they were."""


class Sequence(Strict):
    """Go through postures, resting at each, with continuous acceleration."""

    kind: Literal["sequence"]
    targets: Annotated[tuple[Waypoint, ...], Field(min_length=1)]
    """Postures and their times, which rise."""

    @model_validator(mode="after")
    def _sorted(self) -> Sequence:
        times = [target.time for target in self.targets]
        if any(later <= earlier for earlier, later in pairwise(times)):
            raise ValueError("the times of a sequence rise from target to target")
        return self


class SineWave(Strict):
    """Swing about the initial posture."""

    kind: Literal["sine"]
    amplitude_deg: AxisValues = 10.0
    """Largest distance from the middle, per axis."""
    frequency: Positive = 0.5
    """Swings a second [Hz]."""
    phase_deg: AxisValues = 0.0
    """Angle at the start, per axis; 0 starts in the middle."""


class Table(Strict):
    """Follow a CSV file: a column `time` [s] and one for each axis [rad], named as the axis."""

    kind: Literal["table"]
    file: Path
    """The CSV file; relative paths start at the station's file."""
    interpolation: Literal["cubic", "linear", "hermite"] = "cubic"
    """Cubic: a spline with continuous acceleration. Linear: straight lines. Hermite: cubics with the speeds [rad/s]
    that stand in a column `v.<axis>` for each axis."""


ReferenceConfig = Annotated[Hold | Ramp | Move | Sequence | SineWave | Table, Field(discriminator="kind")]
