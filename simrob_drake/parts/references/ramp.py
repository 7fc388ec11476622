"""Go to one posture at constant speed."""

from typing import Literal

from simrob_drake.parts.references.move import ToOnePosture


class Ramp(ToOnePosture):
    """Go to a posture at constant speed, as SimRob's interpolated moves do, and stay there."""

    kind: Literal["ramp"]
