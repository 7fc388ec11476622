"""The parameters of a robot's walk that is made while it goes: the section `reacting` of its `gaits.yaml`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar

from pydantic import Field, model_validator

from simrob_drake.base.errors import InvalidParameter
from simrob_drake.base.messages import message
from simrob_drake.base.sections import (
    Duration,
    Length,
    NotNegative,
    Number,
    Positive,
    Renamed,
    Speed,
    Strict,
    validated,
)
from simrob_drake.robots.axis_map import AxisValues
from simrob_drake.robots.catalog import RobotModel
from simrob_drake.robots.gaits_file import GAITS_FILE, gaits_file

REACTING = "reacting"
"""The section of a robot's ``gaits.yaml``."""
EVENEST, SOFTEST = 1.5, 1.875
"""Largest speeds of a way from rest to rest, in mean ones: of one that speeds up at once, and of one of least jerk."""
Share = Annotated[Number, Field(ge=0, le=1)]


class Bearing(Strict):
    """How a robot carries itself."""

    height: Length
    """Of the root over the floor [m]."""
    pitch_deg: Number = 0.0
    """Of the trunk, forward [deg]."""
    posture_deg: AxisValues = 0.0
    """Angles of the axes that are in no leg; knees bend as they do here [deg]."""


class MaxSpeed(Strict):
    """Commands that the legs can follow; what is beyond is clipped."""

    ahead: Speed
    """[m/s]."""
    backward: Speed
    """[m/s]."""
    sideways: Speed = 0.0
    """[m/s]."""
    turn_deg: Annotated[NotNegative, Field(le=3600)] = 0.0
    """[deg/s]."""


class Foothold(Strict):
    """Where a foot may land, seen from the one that stands."""

    ahead: Length
    """[m]."""
    behind: Length
    """[m]."""
    inner: Number
    """Least way to its own side: feet do not cross [m]."""
    outer: Length
    """Largest way to its own side [m]."""
    rise: Length = 0.06
    """How far it steps up or down, where a map tells of the ground [m]."""


class Feedback(Renamed):
    """How what the robot does changes what it is asked for."""

    renamed: ClassVar[Mapping[str, str]] = {
        "follow": "com_rate",
        "lean_follow": "lean_rate",
        "lean_return": "upright_rate",
        "upright": "lean_integral",
        "learns": "offset_rate",
        "let_be": "deadband",
        "edge": "zmp_limit",
        "push": "zmp_gain",
        "braces": "brace_threshold",
        "gain": "step_gain",
        "hurry": "hurry_threshold",
        "shortest": "min_swing_time",
        "longest": "max_swing_time",
        "keeps_place": "place_weight",
        "keeps_time": "time_weight",
        "foot_speed": "max_foot_speed",
        "cruise": "speed_integral",
        "holds": "heading_gain",
        "early": "early_touchdown",
        "late": "late_touchdown",
        "search": "search_speed",
        "level": "height_rate",
        "even": "level_rate",
        "ground": "slope_rate",
        "touch": "touch_force",
    }

    com_rate: NotNegative = 10.0
    """How fast the reference of the centre of mass comes to where it is [1/s]."""
    lean_rate: NotNegative = 0.0
    """How fast the reference of the trunk's lean comes to the lean that it has [1/s]."""
    upright_rate: NotNegative = 5.0
    """How fast it comes upright [1/s]."""
    lean_integral: NotNegative = 0.5
    """How fast a lean that lasts is taken out of the trunk [1/s]."""
    offset_rate: NotNegative = 0.5
    """How fast the lasting distance of the centre of mass from its reference is learnt, and no error any more [1/s]."""
    deadband: tuple[NotNegative, NotNegative] = (0.03, 0.02)
    """Errors of the divergent component that no step answers, ahead and sideways [m]: legs that swing make some."""
    zmp_limit: tuple[NotNegative, NotNegative] = (0.0, 0.0)
    """How far the soles themselves bring the zero-moment point against an error, ahead and sideways [m]."""
    zmp_gain: NotNegative = 2.0
    """How far they do for a metre of error."""
    brace_threshold: Positive | None = None
    """Error sideways from which the robot stops, with both feet down, until it is over [m]: for legs without a step
    aside; None: it goes on."""
    step_gain: Share = 1.0
    """How much of an error beyond that a step takes up."""
    hurry_threshold: NotNegative = 0.03
    """Error from which the next foot lifts at once [m]."""
    min_swing_time: Duration = 0.15
    """Least time of a swing [s]."""
    max_swing_time: Duration = 0.5
    """Longest time of a swing [s]."""
    place_weight: NotNegative = 0.02
    """What a metre off the planned foothold costs, in metres off where the divergent component wants it."""
    time_weight: NotNegative = 0.1
    """What a second off the planned time costs, likewise [m²/s²]."""
    max_foot_speed: Positive = 1.5
    """Of a foot that swings, over the ground, at most [m/s]."""
    speed_integral: Share = 0.1
    """How much of what a step lacks of the commanded way is added to the next ones."""
    heading_gain: NotNegative = 1.0
    """How fast the trunk turns back to where the commands have it look [1/s]."""
    landing_height: NotNegative = 0.0
    """How high a foot is held at the end of its swing, as legs give way under the weight: so it touches when it has
    come to its place, not before, and slides less [m]."""
    early_touchdown: Share = 0.5
    """Part of a swing from which a foot that touches ends the step; 1: none does before its time. By then the foot has
    come to the height of the foot that stands."""
    late_touchdown: NotNegative = 0.0
    """How long a foot that should have touched is waited for [s]."""
    search_speed: NotNegative = 0.2
    """How fast it goes on downward meanwhile [m/s]."""
    height_rate: NotNegative = 5.0
    """How fast the root comes to its height over a foot that stands higher or lower than the last [1/s]."""
    level_rate: NotNegative = 5.0
    """How fast the trunk of a quadruped comes level over two feet of which one stands higher [1/s]."""
    slope_rate: NotNegative = 1.0
    """How fast the slope that feet are laid on comes to that of the foot that stands [1/s]; 0 on a level floor."""
    touch_force: Positive | None = None
    """Upward force on a foot from which it touches [N], where `reads` names sensors of the feet, in the world's axes;
    by their heights without. A foot of a pair that feels it waits for the other one; one that should stand and does
    not goes on downward, if late ones do."""


class WalkingParameters(Renamed):
    """How a robot carries itself, steps, and answers what disturbs it."""

    renamed: ClassVar[Mapping[str, str]] = {
        "height": "bearing.height",
        "pitch_deg": "bearing.pitch_deg",
        "posture_deg": "bearing.posture_deg",
        "rises": "lift_exponent",
        "quicken": "max_speed_change",
        "fastest": "max_speed",
        "reach": message("walking.foothold_renamed", "foothold, whose near and far are inner and outer"),
    }

    bearing: Bearing
    """How the trunk is carried."""
    groups: tuple[tuple[str, ...], tuple[str, ...]] = (("right_foot",), ("left_foot",))
    """The feet that stand and swing together, the right ones first; tools of the robot."""
    stance_deg: AxisValues = 0.0
    """Angles of the axes where the robot stands with its soles flat and ahead, its feet as far apart as in the walk but
    for `widen` [deg]."""
    widen: Number = 0.0
    """How much further out each foot stands than so [m]."""
    step_time: Duration
    """From one footfall to the next [s]."""
    double_support: Annotated[Number, Field(ge=0, lt=0.9)] = 0.2
    """Part of a step in which both feet stand."""
    lift: Length
    """Height of the swinging foot [m]."""
    zmp_inward: Number = 0.0
    """How far inside of the middle of each foot the zero-moment point goes [m]."""
    zmp_ahead: Number = 0.0
    """How far ahead of it [m]."""
    lift_exponent: Annotated[Number, Field(ge=1, le=4)] = 3.0
    """How gently a foot lifts and lands: the height goes with (s (1 - s)) to this power, s from 0 to 1 in the swing."""
    swing_peak: Annotated[Number, Field(ge=EVENEST, le=SOFTEST)] = SOFTEST
    """The largest speed of a foot that swings, in its mean ones: 1.875 is soft, 1.5 asks least of slow joints."""
    settle: Duration = 0.6
    """Time to shift the weight before the first step [s]."""
    max_speed_change: tuple[Positive, Positive, Positive] = (0.06, 0.03, 15.0)
    """By how much speed ahead, sideways [m/s] and turn [deg/s] change from a step to the next at most."""
    max_speed: MaxSpeed
    foothold: Foothold
    feedback: Feedback | None = Field(default_factory=Feedback)
    """None: the walk is as planned, whatever the robot does."""

    @model_validator(mode="after")
    def _feet_apart(self) -> WalkingParameters:
        if self.foothold.outer <= self.foothold.inner:
            raise ValueError(
                message(
                    "walking.foothold_order",
                    "foothold.outer, {outer:g} m, must be beyond foothold.inner, {inner:g} m",
                    outer=self.foothold.outer,
                    inner=self.foothold.inner,
                )
            )
        return self


def load_walking(model: RobotModel, changes: Mapping[str, Any] | None = None) -> WalkingParameters:
    """Return the parameters of a robot's walk, some of them changed.

    Args:
        model: the robot, whose ``gaits.yaml`` has a section ``reacting``.
        changes: parameters in place of its own; a section of theirs, such as ``feedback``, changes what it names, of a
            list such as ``zmp_limit`` the places that it names, from 0 on.

    Raises:
        InvalidParameter: a robot without such a section.
        InvalidConfig: a parameter that cannot be.
    """
    found = gaits_file(model)
    own = found.section(REACTING)
    if not own:
        expected = message(
            "walking.robot_with_reacting_walk",
            "one whose {file} has a section {section}",
            file=GAITS_FILE,
            section=REACTING,
        )
        raise InvalidParameter(
            message("base.robot_called", "robot {name}", name=model.name),
            message("walking.no_walk_by_commands", "one that has no walk by commands"),
            expected,
        )
    return validated(WalkingParameters, _changed(own, changes or {}), f"{found.file}: {REACTING}")


def _changed(own: Any, change: Any) -> Any:
    """Return a parameter, a section or a list of them, changed."""
    if not isinstance(change, Mapping):
        return change
    if isinstance(own, list) and {*change} <= {*map(str, range(len(own)))}:
        return [_changed(value, change.get(str(place), value)) for place, value in enumerate(own)]
    known = own if isinstance(own, Mapping) else {}
    return {**known, **{key: _changed(known.get(key), value) for key, value in change.items()}}
