"""What a station file may say about its verdict: bounds of what becomes of a run; what passes one is a warning."""

from typing import Literal

from simrob_drake.sections import NotNegative, Number, Strict

Bound = NotNegative | Literal["none"]


class VerdictConfig(Strict):
    """Bounds of a run's figures, each called as its figure; ``none`` where there shall be no bound."""

    final_error_deg: Bound = 3.0
    """How far an axis that turns may be from its reference at the end [deg]."""
    final_error_m: Bound = 0.005
    """The same of an axis that slides [m]."""
    largest_error_deg: Bound = 30.0
    """How far an axis that turns may ever be from its reference [deg]; one that jumps needs more."""
    largest_error_m: Bound = 0.05
    """The same of an axis that slides [m]."""
    beyond_stop_deg: Bound = 1.0
    """How far an axis that turns may be pressed beyond an end of its range [deg]."""
    beyond_stop_m: Bound = 0.002
    """The same of an axis that slides [m]."""
    torque_share: Bound = 1.05
    """Largest torque or force of an axis, as part of its limit, or of what its motor has at that speed: in a kinematic
    station it may be more than all."""
    torque_time: Bound = 0.05
    """Part of the run in which an axis is at its limit of torque."""
    speed_share: Bound = 1.05
    """Largest speed of an axis, as part of its motor's no-load speed or of the limit in its URDF."""
    speed_time: Bound = "none"
    """Part of the run in which an axis is beyond its limit of speed."""
    rated_time: Bound = "none"
    """Part of the run in which a motor gives more than its rated torque."""
    heat: Bound = 1.0
    """How warm a motor may get; 1 is as warm as its rated torque makes it in the end."""
    below_floor: Bound = 0.005
    """How far tools in use, floating bases and free pieces may be below the ground [m]."""
    distance: Number | Literal["none"] = -0.005
    """What sensors of distance may measure at least [m]; below 0 two bodies are in each other."""
    penetration: Bound = 0.005
    """How deep two bodies that touch may be in each other [m]."""
    foot_slip: Bound = 0.02
    """How far a foot may slide over the ground before it is lifted again [m]."""
    shortened_steps: Bound = 3.0
    """How often the solver may try steps again, shorter, as part of its steps."""
