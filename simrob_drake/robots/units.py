"""The units of an axis: a revolute one has angles and torques, a prismatic one distances and forces."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from simrob_drake.frames import Vector


@dataclass(frozen=True)
class AxisUnit:
    """In what an axis is measured.

    Attributes:
        size: of a user's unit of position in SI.
        name: of the user's unit, and ``si`` of the one that Drake has.
        effort: unit of its torque or force.
        digits: how its positions are written.
    """

    size: float
    name: str
    si: str
    effort: str
    digits: str

    def shown(self, position: float) -> str:
        """Return a position [rad or m] in the user's unit: "110.0 deg"."""
        return f"{position / self.size:{self.digits}} {self.name}"


REVOLUTE = AxisUnit(float(np.deg2rad(1.0)), "deg", "rad", "N·m", ".1f")
PRISMATIC = AxisUnit(1.0, "m", "m", "N", ".4g")


def with_units(values: Vector, units: Sequence[str], written: Callable[[Vector], str]) -> str:
    """Return values (n,) or (n, k) as ``written`` writes them, those of each unit together with it."""
    kinds = list(dict.fromkeys(units))
    return ", ".join(f"{written(values[[unit == kind for unit in units]])} {kind}" for kind in kinds)
