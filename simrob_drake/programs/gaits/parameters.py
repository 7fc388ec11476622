"""The parameters of a robot's gaits, read from the `gaits.yaml` beside its `robot.yaml`."""

from collections.abc import Mapping
from typing import Annotated, Literal

from pydantic import Field

from simrob_drake.errors import InvalidParameter, UnknownName
from simrob_drake.parts.references.sequence import Waypoint
from simrob_drake.paths import models_root
from simrob_drake.quantities import NotNegative, Positive
from simrob_drake.robots.axis_values import AxisValues
from simrob_drake.robots.catalog import RobotModel, robot_names
from simrob_drake.yaml_files import Number, Strict, read_yaml, validated

GAITS_FILE = "gaits.yaml"
Pace = Annotated[Number, Field(gt=0, le=100)]
"""Time of a step, or of a part of one [s]."""


class Bearing(Strict):
    """How a robot carries itself."""

    height: Positive
    """Of the root over the floor [m]."""
    pitch_deg: Number = 0.0
    """Of the trunk, forward [deg]."""
    posture_deg: AxisValues = 0.0
    """Angles of the axes that are in no leg; knees bend as they do here."""
    lean_arms_deg: AxisValues = 0.0
    """Per axis, for a lean to the right of one degree: arms as counterweights where the ankles do not roll [deg]."""
    swing_arms_deg: AxisValues = 0.0
    """Per axis, for a left foot that is a metre ahead of the right one [deg]."""


class _Gait(Strict):
    """What all gaits on feet have."""

    rest: NotNegative = 1.0
    """Time to stand at the end [s]."""
    servo: Mapping[str, AxisValues] = Field(default_factory=dict)
    """Servo gains for it, in place of the station's: kp, kd."""


class _Planned(_Gait):
    """What gaits have whose legs are solved for."""

    bearing: Bearing
    """How the trunk is carried."""
    widen: Number = 0.0
    """How much further out each foot stands than with straight legs, or below its hip [m]."""


class _Stepping(_Planned):
    """What gaits have that go in equal steps, on a straight line or a circle."""

    step_time: Pace
    """From one footfall, of a foot or a pair, to the next [s]."""
    step_length: Number = 0.0
    """How far each step brings the robot ahead; negative walks backward [m]."""
    sideways: Number = 0.0
    """How far each step brings it to the left [m]."""
    turn_deg: Number = 0.0
    """How far each step turns it to the left [deg]."""
    ramp_steps: int = Field(default=3, ge=0)
    """Steps in which the step length grows at the start and shrinks at the end, which go in addition."""
    settle: Pace = 0.6
    """Time to shift the weight at the start and at the end [s]."""


class Walk(_Stepping):
    """A walk on two legs."""

    feet: str | None = None
    """Kind of feet; the default one unless given."""
    lift: Positive = 0.03
    """Height of the swinging foot [m]."""
    double_support: Positive = 0.2
    """Part of a step in which both feet stand."""
    zmp_inward: Number = 0.0
    """How far inside of the middle of each foot the zero-moment point goes [m]."""
    zmp_ahead: Number = 0.0
    """How far ahead of the middle of each foot it goes [m]."""


class Trot(_Stepping):
    """A gait on four legs, diagonal pairs in turn."""

    ramp_steps: int = Field(default=4, ge=0)
    """Steps in which the step length grows at the start and shrinks at the end, which go in addition."""
    lift: Positive = 0.05
    """Height of the swinging feet [m]."""
    lead: Number = 0.0
    """How far the trunk runs ahead of the middle of its feet, as a part of the step."""
    all_stand: Positive = 0.1
    """Part of a step in which all feet stand."""


class Crawl(_Planned):
    """A gait on four legs, one leg at a time."""

    leg_time: Pace
    """From one leg's footfall to the next one's [s]."""
    stride: Number = 0.0
    """How far each leg goes when its turn comes [m]."""
    lift: Positive = 0.04
    """Height of the swinging foot [m]."""
    shift: Positive = 0.6
    """Part of the leg's time in which all feet stand and the trunk goes over the next three."""
    inside: Positive = 0.04
    """How far inside of the three standing feet's triangle the zero-moment point stays [m]."""
    settle: Pace = 0.8
    """Time to stand before the first leg and after the last one [s]."""


class Stand(_Planned):
    """Standing on three legs."""

    foot: str
    """Which foot is up."""
    height: Positive = 0.03
    """How high [m]."""
    seconds: Pace = 5.0
    """How long it stays there [s]."""
    inside: Positive = 0.04
    """How far inside of the three standing feet's triangle the zero-moment point stays [m]."""


SolvedGait = Walk | Trot | Crawl | Stand
"""Gaits whose legs are solved for."""


class March(_Gait):
    """A walk on two legs by joint angles, joined by straight lines: the thesis's manner."""

    move_time: Pace = 1.0
    """Of each sub-move [s]."""
    start_deg: AxisValues
    """Posture at the start and at the end [deg]."""
    left: Annotated[tuple[AxisValues, ...], Field(min_length=2)]
    """Postures of a step with the left foot; axes that are left out are as at the start. The right one mirrors them."""
    feet: str | None = None
    """Kind of feet; the default one unless given."""
    feed_velocity: bool = False
    """Whether the servos are told the reference's velocity, too; not so in the thesis."""


class Posing(Strict):
    """Postures one after the other."""

    start_deg: AxisValues = 0.0
    """Posture at the start [deg]."""
    targets: Annotated[tuple[Waypoint, ...], Field(min_length=1)]
    """Postures, and when to be there; axes that are left out stay."""
    repeat: int = Field(default=1, ge=1, le=1000)
    """How often to go through the targets."""
    held: bool = False
    """Whether it is for a robot that is held by its trunk."""
    ramps: Literal["smooth", "linear"] = "smooth"
    """Smooth: at rest in every posture. Linear: straight lines, as in the thesis."""
    feet: str | None = None
    """Kind of feet; the default one unless given."""
    rest: NotNegative = 1.0
    """Time to stay in the last posture [s]."""
    feed_velocity: bool = True
    """Whether the servos are told the reference's velocity, too; not so in the thesis."""
    falls: bool = False
    """Whether it ends on the floor: monitors of the robot's fall do not watch it then."""


class Gaits(Strict):
    """All gaits of a robot."""

    facing_deg: Number
    """Where the robot looks while its root is not turned, counterclockwise from the world's x [deg]."""
    walks: dict[str, Walk] = Field(default_factory=dict)
    """Walks on two legs, by name."""
    trots: dict[str, Trot] = Field(default_factory=dict)
    """Gaits on four legs, diagonal pairs in turn, by name."""
    crawls: dict[str, Crawl] = Field(default_factory=dict)
    """Gaits on four legs, one leg at a time, by name."""
    marches: dict[str, March] = Field(default_factory=dict)
    """Walks on two legs by joint angles, by name."""
    stands: dict[str, Stand] = Field(default_factory=dict)
    """Stands on three legs, by name."""
    sequences: dict[str, Posing] = Field(default_factory=dict)
    """Postures one after the other, by name."""


def load_gaits(robot: str | RobotModel) -> Gaits:
    """Return the gaits of a robot, which stand beside its ``robot.yaml``.

    Args:
        robot: a robot of the package by its name, or any other's model.

    Raises:
        UnknownName: no such robot; proposes the nearest.
        InvalidParameter: a robot without gaits.
        InvalidConfig: its file has a wrong entry.
    """
    if isinstance(robot, str) and robot not in robot_names():
        raise UnknownName("robot", robot, robot_names())
    name, folder = (robot, models_root() / robot) if isinstance(robot, str) else (robot.name, robot.folder)
    file = folder / GAITS_FILE
    if not file.is_file():
        raise InvalidParameter(f"robot {name}", "one without gaits", f"one with a file {GAITS_FILE}")
    return validated(Gaits, read_yaml(file), file)
