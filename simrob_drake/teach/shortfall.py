"""How far a joint or a tool is from where it should be, and why, by what is told of both."""

from collections.abc import Mapping
from math import inf
from typing import Any, Literal, NamedTuple

Level = Literal["", "amber", "red"]
"""How much it is: nothing to speak of, to be seen, or a lot."""
Reason = Literal["", "limit", "stop", "moving", "gains"]
"""The drive is at its limit, a stop holds the joint, it is on its way, or it rests where its gains hold it."""

BOUNDS: Mapping[str, tuple[float, float]] = {"deg": (2.0, 10.0), "m": (0.002, 0.01)}
"""From where on it is amber, and red [deg or m]."""
_FULL = 0.995  # of a limit, which solvers reach but for rounding
_AT_STOP: Mapping[str, float] = {"deg": 0.5, "m": 0.0005}  # deg or m
_STILL: Mapping[str, float] = {"deg": 5.0, "m": 0.01}  # deg/s or m/s


class Shortfall(NamedTuple):
    """What is left between asked and done.

    Attributes:
        off: how far the joint is from where it should be, positive beyond it [deg or m].
        level: how much that is.
        reason: why; nothing where nothing is to be told.
    """

    off: float
    level: Level = ""
    reason: Reason = ""


def level_of(off: float, unit: str) -> Level:
    """Return how much it is to be off by something [deg or m]."""
    amber, red = BOUNDS[unit]
    return "red" if abs(off) >= red else "amber" if abs(off) >= amber else ""


def shortfall(
    axis: Mapping[str, Any],
    asked: float,
    done: float,
    *,
    speed: float = 0.0,
    torque: float = 0.0,
    limit: float = inf,
) -> Shortfall:
    """Return how far an axis is from where it should be, and why.

    Args:
        axis: its ``unit``, ``deg`` or ``m``, and its limits ``low`` and ``high``, as a description has them.
        asked: where it should be [deg or m].
        done: where it is [deg or m].
        speed: how fast it moves [deg/s or m/s].
        torque: of its drive [N·m or N].
        limit: of that.
    """
    unit, off = axis["unit"], done - asked
    level = level_of(off, unit)
    if abs(torque) >= _FULL * limit:
        return Shortfall(off, "red", "limit")
    if not level:
        return Shortfall(off)
    if not axis["low"] + _AT_STOP[unit] < done < axis["high"] - _AT_STOP[unit]:
        return Shortfall(off, level, "stop")
    return Shortfall(off, level, "moving" if abs(speed) > _STILL[unit] else "gains")
