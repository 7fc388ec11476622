"""What may end a run: the kinds of monitor that a station file can name."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field

from simrob_drake.robots.pieces import NotNegative, Positive
from simrob_drake.yaml_files import Number, Strict


class _Monitor(Strict):
    """What all monitors share."""

    robot: str | None = None
    """Whom it watches; the only robot unless given."""
    after: NotNegative = 0.0
    """When watching begins [s]."""
    hold: NotNegative = 0.0
    """How long the condition must last [s]."""


class JointLimit(_Monitor):
    """End the run when a joint reaches a limit of its range."""

    kind: Literal["joint_limit"]
    margin_deg: Number = 0.0
    """How far before the limit the run ends; negative: beyond it."""


class TorqueLimit(_Monitor):
    """End the run when a servo stays at its torque limit."""

    kind: Literal["torque_limit"]
    hold: NotNegative = 0.5


class Settled(_Monitor):
    """End the run when the robot stands still."""

    kind: Literal["settled"]
    hold: NotNegative = 0.2
    speed_deg: Positive = 0.1
    """Speed of the fastest joint below which the robot stands still [deg/s]."""
    error_deg: Positive | None = None
    """Largest position error; unless given any error counts as settled."""


class Divergence(_Monitor):
    """End the run when a joint runs away."""

    kind: Literal["divergence"]
    speed_limit: Positive = 100.0
    """Speed that counts as running away [rad/s]."""


MonitorConfig = Annotated[JointLimit | TorqueLimit | Settled | Divergence, Field(discriminator="kind")]
MONITOR_KINDS = ("joint_limit", "torque_limit", "settled", "divergence")


def with_kinds(monitors: Any) -> Any:
    """Let a monitor whose name is a kind do without the key ``kind``."""
    if not isinstance(monitors, dict):
        return monitors
    return {
        name: {"kind": name, **(entry or {})} if name in MONITOR_KINDS and isinstance(entry, dict | None) else entry
        for name, entry in monitors.items()
    }


Monitors = Annotated[dict[str, MonitorConfig], BeforeValidator(with_kinds)]
