"""The figures of a robot's walk that is made while it goes, read from the `walking.yaml` beside its `robot.yaml`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import Field, model_validator

from simrob_drake.errors import InvalidParameter
from simrob_drake.quantities import NotNegative, Positive
from simrob_drake.robots.axis_values import AxisValues
from simrob_drake.robots.catalog import RobotModel
from simrob_drake.yaml_files import Number, Strict, read_yaml, validated

WALKING_FILE = "walking.yaml"
Share = Annotated[Number, Field(ge=0, le=1)]


class Fastest(Strict):
    """Commands that the legs can follow; what is beyond is clipped."""

    ahead: NotNegative
    """[m/s]."""
    backward: NotNegative
    """[m/s]."""
    sideways: NotNegative = 0.0
    """[m/s]."""
    turn_deg: NotNegative = 0.0
    """[deg/s]."""


class Reach(Strict):
    """Where a foot may land, seen from the one that stands."""

    ahead: Positive
    """[m]."""
    behind: Positive
    """[m]."""
    near: Number
    """Least way to its own side: feet do not cross [m]."""
    far: Positive
    """Largest way to its own side [m]."""


class Feedback(Strict):
    """How what the robot does changes what it is asked for."""

    follow: NotNegative = 10.0
    """How fast the reference of the centre of mass comes to where it is [1/s]."""
    lean_follow: NotNegative = 0.0
    """How fast the reference of the trunk's lean comes to the lean that it has [1/s]."""
    lean_return: NotNegative = 5.0
    """How fast it comes upright [1/s]."""
    upright: NotNegative = 0.5
    """How fast a lean that lasts is taken out of the trunk [1/s]."""
    learns: NotNegative = 0.5
    """How fast the lasting distance of the centre of mass from its reference is learnt, and no error any more [1/s]."""
    let_be: tuple[NotNegative, NotNegative] = (0.03, 0.02)
    """Errors of the divergent component that no step answers, ahead and sideways [m]: legs that swing make some."""
    edge: tuple[NotNegative, NotNegative] = (0.0, 0.0)
    """How far the soles themselves bring the zero-moment point against an error, ahead and sideways [m]."""
    push: NotNegative = 2.0
    """How far they do for a metre of error."""
    braces: Positive | None = None
    """Error sideways from which the robot stops, with both feet down, until it is over [m]: for legs without a step
    aside; None: it goes on."""
    gain: Share = 1.0
    """How much of an error beyond that a step takes up."""
    hurry: NotNegative = 0.03
    """Error from which the next foot lifts at once [m]."""
    shortest: Positive = 0.15
    """Least time of a swing [s]."""
    longest: Positive = 0.5
    """Longest time of a swing [s]."""
    keeps_place: NotNegative = 0.02
    """What a metre off the planned foothold costs, in metres off where the divergent component wants it."""
    keeps_time: NotNegative = 0.1
    """What a second off the planned time costs, likewise [m²/s²]."""
    foot_speed: Positive = 1.5
    """Of a foot that swings, over the ground, at most [m/s]."""
    cruise: Share = 0.1
    """How much of what a step lacks of the commanded way is added to the next ones."""
    holds: NotNegative = 1.0
    """How fast the trunk turns back to where the commands have it look [1/s]."""
    early: Share = 0.5
    """Part of a swing from which a foot that touches ends the step; 1: none does before its time. By then the foot has
    come to the height of the foot that stands."""
    late: NotNegative = 0.0
    """How long a foot that should have touched is waited for [s]."""
    search: NotNegative = 0.2
    """How fast it goes on downward meanwhile [m/s]."""
    level: NotNegative = 5.0
    """How fast the root comes to its height over a foot that stands higher or lower than the last [1/s]."""
    even: NotNegative = 5.0
    """How fast the trunk of a quadruped comes level over two feet of which one stands higher [1/s]."""
    ground: NotNegative = 1.0
    """How fast the slope that feet are laid on comes to that of the foot that stands [1/s]; 0 on a level floor."""
    touch: Positive | None = None
    """Upward force on a foot from which it touches [N], where `reads` names sensors of the feet, in the world's axes;
    by their heights without. A foot of a pair that feels it waits for the other one; one that should stand and does
    not goes on downward, if late ones do."""


class WalkingFigures(Strict):
    """How a robot carries itself, steps, and answers what disturbs it."""

    facing_deg: Number
    """Where the robot looks while its root is not turned, counterclockwise from the world's x [deg]."""
    height: Positive
    """Of the root over the soles [m]."""
    pitch_deg: Number = 0.0
    """Of the trunk, forward [deg]."""
    posture_deg: AxisValues = 0.0
    """Angles of the axes that are in no leg; knees bend as they do here [deg]."""
    groups: tuple[tuple[str, ...], tuple[str, ...]] = (("right_foot",), ("left_foot",))
    """The feet that stand and swing together, the right ones first; tools of the robot."""
    widen: Number = 0.0
    """How much further out each foot stands than with straight legs [m]."""
    step_time: Positive
    """From one footfall to the next [s]."""
    double_support: Annotated[Number, Field(ge=0, lt=0.9)] = 0.2
    """Part of a step in which both feet stand."""
    lift: Positive
    """Height of the swinging foot [m]."""
    zmp_inward: Number = 0.0
    """How far inside of the middle of each foot the zero-moment point goes [m]."""
    zmp_ahead: Number = 0.0
    """How far ahead of it [m]."""
    rises: Annotated[Number, Field(ge=1, le=4)] = 3.0
    """How gently a foot lifts and lands: the height goes with (s (1 - s)) to this power, s from 0 to 1 in the swing."""
    settle: Positive = 0.6
    """Time to shift the weight before the first step [s]."""
    quicken: tuple[Positive, Positive, Positive] = (0.06, 0.03, 15.0)
    """By how much speed ahead, sideways [m/s] and turn [deg/s] change from a step to the next at most."""
    fastest: Fastest
    reach: Reach
    feedback: Feedback | None = Field(default_factory=Feedback)
    """None: the walk is as planned, whatever the robot does."""

    @model_validator(mode="after")
    def _feet_apart(self) -> WalkingFigures:
        if self.reach.far <= self.reach.near:
            raise ValueError(f"reach.far, {self.reach.far:g} m, must be beyond reach.near, {self.reach.near:g} m")
        return self


def load_walking(model: RobotModel, changes: Mapping[str, Any] | None = None) -> WalkingFigures:
    """Return the figures of a robot's walk, some of them changed.

    Args:
        model: the robot, which has a file `walking.yaml` beside its `robot.yaml`.
        changes: figures in place of its own; a section of theirs, such as ``feedback``, changes what it names, of a
            list such as ``edge`` the places that it names, from 0 on.

    Raises:
        InvalidParameter: a robot without such a file.
        InvalidConfig: a figure that cannot be.
    """
    file = model.folder / WALKING_FILE
    if not file.is_file():
        raise InvalidParameter(f"robot {model.name}", "one that has no walk", f"one with a file {WALKING_FILE}")
    return validated(WalkingFigures, _changed(read_yaml(file), changes or {}), file)


def _changed(own: Any, change: Any) -> Any:
    """Return a figure, a section or a list of them, changed."""
    if not isinstance(change, Mapping):
        return change
    if isinstance(own, list) and {*change} <= {*map(str, range(len(own)))}:
        return [_changed(value, change.get(str(place), value)) for place, value in enumerate(own)]
    known = own if isinstance(own, Mapping) else {}
    return {**known, **{key: _changed(known.get(key), value) for key, value in change.items()}}
