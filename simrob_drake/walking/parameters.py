"""Parameters of a robot's reacting walk: the section `reacting` of its `gaits.yaml`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar

from pydantic import Field, model_validator

from simrob_drake.base.errors import Unsuitable
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
    validate_section,
)
from simrob_drake.robots.axis_map import AxisValues
from simrob_drake.robots.catalog import RobotModel
from simrob_drake.robots.gaits_file import GAITS_FILE, gaits_file

REACTING = "reacting"
"""Name of the section in a robot's ``gaits.yaml``."""
EVENEST = 1.5
"""Peak over mean speed of the most even rest-to-rest motion, a cubic whose acceleration jumps at both ends [1]."""
SOFTEST = 1.875
"""Peak over mean speed of the softest rest-to-rest motion, a quintic with the least jerk [1]."""
Share = Annotated[Number, Field(ge=0, le=1)]


class Bearing(Strict):
    """Posture of a robot while it walks."""

    height: Length
    """Height of the root over the floor [m]."""
    pitch_deg: Number = 0.0
    """Forward pitch of the trunk [deg]."""
    posture_deg: AxisValues = 0.0
    """Angles of the axes that are in no leg [deg]. Knees bend to the same side as in this posture."""


class MaxSpeed(Strict):
    """Largest commands that the legs can follow. Larger commands are clipped."""

    ahead: Speed
    """Largest speed ahead [m/s]."""
    backward: Speed
    """Largest speed backward [m/s]."""
    sideways: Speed = 0.0
    """Largest speed to each side [m/s]."""
    turn_deg: Annotated[NotNegative, Field(le=3600)] = 0.0
    """Largest turning speed to each side [deg/s]."""


class Foothold(Strict):
    """Region in which a foot may land, measured from the stance foot."""

    ahead: Length
    """Largest distance ahead [m]."""
    behind: Length
    """Largest distance behind [m]."""
    inner: Number
    """Least distance to the foot's own side [m]. It keeps the feet from crossing."""
    outer: Length
    """Largest distance to the foot's own side [m]."""
    rise: Length = 0.06
    """Largest step up or down, if a height map of the ground is used [m]."""


class Feedback(Renamed):
    """Parameters of the feedback: how measured errors change the steps and the references."""

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
    """Rate at which the reference of the centre of mass approaches its estimate [1/s]."""
    lean_rate: NotNegative = 0.0
    """Rate at which the reference of the trunk's lean approaches the measured lean [1/s]."""
    upright_rate: NotNegative = 5.0
    """Rate at which the reference of the trunk's lean returns to upright [1/s]."""
    lean_integral: NotNegative = 0.5
    """Integral gain that removes a lasting lean of the trunk [1/s]."""
    offset_rate: NotNegative = 0.5
    """Rate at which a lasting offset of the centre of mass from its reference is learnt [1/s]. A learnt offset is no
    error."""
    deadband: tuple[NotNegative, NotNegative] = (0.03, 0.02)
    """Errors of the divergent component that no step answers, ahead and sideways [m]. Swinging legs cause such
    errors."""
    zmp_limit: tuple[NotNegative, NotNegative] = (0.0, 0.0)
    """Largest shift of the zero-moment point in the soles against an error, ahead and sideways [m]."""
    zmp_gain: NotNegative = 2.0
    """Shift of the zero-moment point for each metre of error [1]."""
    brace_threshold: Positive | None = None
    """Error sideways from which the robot stops on both feet until the error is over [m], for legs that cannot step
    aside. The robot always walks on if this is not set."""
    step_gain: Share = 1.0
    """Part of an error outside of the deadband that a step answers [1]."""
    hurry_threshold: NotNegative = 0.03
    """Error from which the next foot lifts without a weight transfer [m]."""
    min_swing_time: Duration = 0.15
    """Least duration of a swing [s]."""
    max_swing_time: Duration = 0.5
    """Largest duration of a swing [s]."""
    place_weight: NotNegative = 0.02
    """Cost of a distance from the planned foothold over that from the foothold which the divergent component requires
    [1]."""
    time_weight: NotNegative = 0.1
    """Cost of a landing before or after its planned time, in the same units [m²/s²]."""
    max_foot_speed: Positive = 1.5
    """Largest speed of a swing foot [m/s]."""
    speed_integral: Share = 0.1
    """Part of the distance which a step lacks that is added to the next steps [1]."""
    heading_gain: NotNegative = 1.0
    """Turning speed for an error of the heading that the commands ask for [1/s]."""
    landing_height: NotNegative = 0.0
    """Height of a foot at the end of its swing [m]. Legs yield under the weight, so a foot without this height touches
    before it has reached its foothold, and slides."""
    early_touchdown: Share = 0.5
    """Part of a swing from which a foot that touches ends the step [1]. With 1, no step ends before its time. Without a
    height map, the foot is at the height of the stance foot from this part on, but not before a tenth of the swing."""
    late_touchdown: NotNegative = 0.0
    """Largest time for which the walk waits for a foot that touches late [s]."""
    search_speed: NotNegative = 0.2
    """Speed at which a late foot goes down [m/s]."""
    height_rate: NotNegative = 5.0
    """Rate at which the root approaches its height over a new stance foot that is higher or lower [1/s]."""
    level_rate: NotNegative = 5.0
    """Rate at which the trunk of a quadruped becomes level over two feet of different heights [1/s]."""
    slope_rate: NotNegative = 1.0
    """Rate at which the slope of the feet approaches that of the stance foot [1/s]. It is 0 for a level floor."""
    touch_force: Positive | None = None
    """Vertical force from which a foot touches [N], if `reads` names force sensors of the feet, in the world's axes.
    With sensors, a foot of a pair that touches waits for the other one, and a stance foot without contact goes down if
    `late_touchdown` is not 0. Without sensors, heights decide."""


class WalkingParameters(Renamed):
    """Parameters of a reacting walk: posture, steps and feedback."""

    renamed: ClassVar[Mapping[str, str]] = {
        "height": "bearing.height",
        "pitch_deg": "bearing.pitch_deg",
        "posture_deg": "bearing.posture_deg",
        "rises": "lift_exponent",
        "quicken": "max_speed_change",
        "fastest": "max_speed",
        "reach": message(
            "walking.foothold_renamed", "foothold, whose near and far are inner and outer"
        ),
    }

    bearing: Bearing
    """Posture of the trunk and of the axes that are in no leg."""
    groups: tuple[tuple[str, ...], tuple[str, ...]] = (("right_foot",), ("left_foot",))
    """Feet that stand and swing at the same time, the right group first. They are tools of the robot."""
    stance_deg: AxisValues = 0.0
    """Angles of the axes in a stance with flat soles that look ahead [deg]. The walk has the same distance between the
    feet, plus `widen` on each side."""
    widen: Number = 0.0
    """Distance by which each foot is further out than in the stance [m]."""
    step_time: Duration
    """Time from one touchdown to the next [s]."""
    double_support: Annotated[Number, Field(ge=0, lt=0.9)] = 0.2
    """Part of a step in which both feet stand [1]."""
    lift: Length
    """Largest height of the swing foot [m]."""
    zmp_inward: Number = 0.0
    """Distance of the zero-moment point from the middle of the stance foot towards the other foot [m]."""
    zmp_ahead: Number = 0.0
    """Distance of the zero-moment point ahead of the middle of the stance foot [m]."""
    lift_exponent: Annotated[Number, Field(ge=1, le=4)] = 3.0
    """Exponent n of the height of the swing foot, lift (4 s (1 - s))^n, while s goes from 0 to 1 [1]. A foot with a
    larger exponent lifts and lands more softly."""
    swing_peak: Annotated[Number, Field(ge=EVENEST, le=SOFTEST)] = SOFTEST
    """Peak over mean speed of the swing foot [1]: 1.875 is the softest motion, 1.5 is the easiest for slow joints."""
    settle: Duration = 0.6
    """Duration of the weight transfer before the first step [s]."""
    max_speed_change: tuple[Positive, Positive, Positive] = (0.06, 0.03, 15.0)
    """Largest change of the speed ahead and sideways [m/s] and of the turning speed [deg/s] from one step to the
    next."""
    max_speed: MaxSpeed
    foothold: Foothold
    feedback: Feedback | None = Field(default_factory=Feedback)
    """Parameters of the feedback, or none for a walk that goes as planned without measurements."""

    @model_validator(mode="after")
    def _check_foothold(self) -> WalkingParameters:
        """Check that the region in which a foot may land has a positive width.

        Raises:
            ValueError: ``foothold.outer`` is not larger than ``foothold.inner``.
        """
        if self.foothold.outer <= self.foothold.inner:
            raise ValueError(
                message(
                    "walking.foothold_order",
                    "foothold.outer is {outer:g} m; it must be larger than foothold.inner, {inner:g} m",
                    outer=self.foothold.outer,
                    inner=self.foothold.inner,
                )
            )
        return self


def load_walking(model: RobotModel, changes: Mapping[str, Any] | None = None) -> WalkingParameters:
    """Load the parameters of a robot's walk.

    Args:
        model: model of the robot. Its ``gaits.yaml`` has a section ``reacting``.
        changes: parameters that replace those of the file, by name. A section such as ``feedback`` only changes the
            parameters that it names. A list such as ``zmp_limit`` is replaced by a list, or changed at the indices
            ("0", "1" ...) that a section names.

    Raises:
        InvalidParameter: the robot has no file ``gaits.yaml``.
        Unsuitable: the file has no such section, or an empty one.
        InvalidConfig: the file cannot be read, or a parameter is invalid.
    """
    gaits = gaits_file(model)
    section = gaits.section(REACTING)
    if not section:
        raise Unsuitable(
            message("base.robot_called", "robot {name}", name=model.name),
            message(
                "walking.no_walk_by_commands",
                "its {file} has no section {section} with the parameters of a walk",
                file=GAITS_FILE,
                section=REACTING,
            ),
            message("walking.add_section", "add the section, or choose another robot"),
        )
    parameters = _apply_changes(section, changes or {})
    return validate_section(WalkingParameters, parameters, f"{gaits.file}: {REACTING}")


def _apply_changes(own: Any, change: Any) -> Any:
    """Apply changes to a parameter, to a section or to a list, and return the result as a new object.

    The result may be invalid: it is validated with the whole section.

    Args:
        own: the parameter, section or list.
        change: a new value, or a mapping from names, or indices of a list as texts, to changes.
    """
    if not isinstance(change, Mapping):
        return change
    if isinstance(own, list):
        indices = {str(index) for index in range(len(own))}
        if indices.issuperset(change):
            return [
                _apply_changes(value, change.get(str(index), value))
                for index, value in enumerate(own)
            ]
    # A mapping for anything but a section replaces it: a section that the file leaves out begins empty, and the
    # validation refuses a mapping in place of a number, or of a list that lacks one of the indices.
    section = own if isinstance(own, Mapping) else {}
    changed = {key: _apply_changes(section.get(key), value) for key, value in change.items()}
    return {**section, **changed}
