"""What may end a run: the kinds of monitor that a station file can name."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from simrob_drake.quantities import NotNegative, Positive, Triple
from simrob_drake.stations.kinds import named_by_kind
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
    """How far before the limit the run ends, for axes that turn; negative: beyond it."""
    margin_m: Number = 0.0
    """The same for axes that slide [m]."""


class TorqueLimit(_Monitor):
    """End the run when a servo stays at its torque limit."""

    kind: Literal["torque_limit"]
    hold: NotNegative = 0.5
    """How long it must stay there [s]."""


class Settled(_Monitor):
    """End the run when the robot stands still."""

    kind: Literal["settled"]
    hold: NotNegative = 0.2
    """How long it must stand [s]."""
    speed_deg: Positive = 0.1
    """Speed below which an axis that turns stands still [deg/s]."""
    speed_m: Positive = 1e-3
    """Speed below which an axis that slides stands still [m/s]."""
    error_deg: Positive | None = None
    """Largest position error of axes that turn; unless given any error counts as settled."""
    error_m: Positive | None = None
    """Largest position error of axes that slide [m]; unless given any error counts as settled."""


class Divergence(_Monitor):
    """End the run when a joint runs away."""

    kind: Literal["divergence"]
    speed_limit: Positive = 100.0
    """Speed that counts as running away [rad/s, or m/s of axes that slide]."""


class _SensorMonitor(_Monitor):
    """What monitors of sensors share."""

    sensor: str | None = None
    """The sensor, by its name; the only one of its kind unless given."""


class Contact(_SensorMonitor):
    """End the run when two things touch: a distance sensor reads 0."""

    kind: Literal["contact"]
    distance: NotNegative = 0.0
    """Distance that counts as contact [m]."""


class ForceLimit(_SensorMonitor):
    """End the run when the force at a force sensor is too large."""

    kind: Literal["force_limit"]
    limit: Positive | str
    """Largest force [N], or a body region of ISO/TS 15066 such as `hands_and_fingers`."""


class _PoseMonitor(_Monitor):
    """What monitors of poses share."""

    piece: str | None = None
    """A free piece to watch, in place of a robot."""


class Workspace(_PoseMonitor):
    """End the run when the tool, or a free piece, leaves a box."""

    kind: Literal["workspace"]
    lower: Triple
    """Smallest x, y and z in the world [m]."""
    upper: Triple
    """Largest x, y and z in the world [m]."""
    tool: str | None = None
    """The robot's tool that is watched; its `tcp` unless given."""

    @model_validator(mode="after")
    def _not_empty(self) -> Workspace:
        if any(low >= high for low, high in zip(self.lower, self.upper, strict=True)):
            raise ValueError(f"lower must be below upper, {list(self.upper)}")
        return self


class Fall(_PoseMonitor):
    """End the run when a robot's base, or a free piece, is too low or leans too far."""

    kind: Literal["fall"]
    height: Positive | None = None
    """Height of its origin below which it has fallen [m]."""
    tilt_deg: Positive | None = None
    """Angle from how it stood at the start beyond which it has fallen."""

    @model_validator(mode="after")
    def _some_bound(self) -> Fall:
        if self.height is None and self.tilt_deg is None:
            raise ValueError("a fall needs a bound: height or tilt_deg")
        return self


MonitorConfig = Annotated[
    JointLimit | TorqueLimit | Settled | Divergence | Contact | ForceLimit | Workspace | Fall,
    Field(discriminator="kind"),
]
Monitors = Annotated[dict[str, MonitorConfig], named_by_kind(MonitorConfig)]
