"""What a station file may say: the fields below are the YAML schema, their comments its documentation.

All values are SI units and radians, except where a name ends in ``_deg``. A value "per axis" is one number for all
axes, a list in axis order, or a mapping by axis name.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, field_validator, model_validator

from simrob_drake.robots.catalog import AxisValues
from simrob_drake.robots.pieces import ORIGIN, Colour, NotNegative, Pose, Positive, Triple
from simrob_drake.stations.monitor_config import Monitors
from simrob_drake.stations.reference_config import Hold, ReferenceConfig
from simrob_drake.stations.solver_config import ContinuousSolver, SolverConfig
from simrob_drake.yaml_files import Number, Strict

Input = Literal["feedforward", "reference_velocity", "external_force"]
Realization = Literal["per_joint", "vector", "implicit"]
STANDARD_GRAVITY = 9.80665  # m/s², ISO 80000-3; the value of the Simulink library


class ServoConfig(Strict):
    """The joint servos: PID and saturation. What is not given comes from the robot's own file."""

    realization: Realization = "per_joint"
    """Separate blocks for each joint, one block for all, or inside the plant's actuators."""
    kp: AxisValues | None = None
    """Proportional gain, per axis [N·m/rad]."""
    ki: AxisValues | None = None
    """Integral gain, per axis [N·m/(rad·s)]; 0 leaves the integrators out."""
    kd: AxisValues | None = None
    """Derivative gain, per axis [N·m·s/rad]."""
    torque_limit: AxisValues | None = None
    """Saturation, per axis [N·m]; the URDF's effort unless given."""
    integral_limit: AxisValues | None = None
    """What the integral part may reach, per axis [N·m]; torque_limit unless given."""

    @field_validator("kp", "ki", "kd")
    @classmethod
    def _not_negative(cls, values: AxisValues | None) -> AxisValues | None:
        return _each(values, lambda value: value >= 0, "a gain must not be negative")

    @field_validator("torque_limit", "integral_limit")
    @classmethod
    def _positive(cls, values: AxisValues | None) -> AxisValues | None:
        return _each(values, lambda value: value > 0, "a torque limit must be positive [N·m]")


class PushConfig(Strict):
    """A force on a robot's root link, at its centre of mass and along its axes."""

    start: NotNegative
    """When it begins [s]."""
    duration: Positive = 0.1
    """How long it lasts [s]."""
    force: Triple
    """Along x, y and z of the root link [N]."""


class RobotConfig(Strict):
    """A robot of the station: one of the package by name, or any clean URDF by path."""

    model: str | None = None
    """A robot's name, of `simrob list`."""
    urdf: Path | None = None
    """A URDF file instead of a model; relative paths start at the station's file."""
    base: Pose = ORIGIN
    """Pose of the root link in the world, [x y z Rz Ry Rx]."""
    initial_deg: AxisValues = 0.0
    """Joint positions at the start, per axis."""
    tcp: str | None = None
    """Tool that `tcp_pose` follows; the last piece of the robot's chain unless given."""
    feet: str | None = None
    """What a legged robot stands on: a kind of feet of its `robot.yaml`, such as spheres_C or soles."""
    pushes: tuple[PushConfig, ...] = ()
    """Forces on its root link, such as those that it must withstand standing; dynamic stations only."""
    servo: ServoConfig | None = None
    """This robot's servos, in place of the station's."""
    reference: ReferenceConfig | None = None
    """This robot's reference, in place of the station's."""

    @model_validator(mode="after")
    def _one_origin(self) -> RobotConfig:
        if (self.model is None) == (self.urdf is None):
            raise ValueError("a robot has either a model or a urdf")
        return self


class PieceConfig(Strict):
    """A piece of the station; every figure that is given replaces the one of the piece's own file."""

    model: str | None = None
    """A piece's name, of `simrob list`; the key's own name unless given."""
    parent: str | None = None
    """What it hangs on: `world`, a robot, or another piece (then its TCP); the only robot unless given."""
    pose: Pose = ORIGIN
    """Pose in the parent's frame, [x y z Rz Ry Rx]."""
    mass: NotNegative | None = None
    """Mass [kg]."""
    com: Triple | None = None
    """Centre of mass in the piece's frame [m]."""
    inertia: tuple[NotNegative, NotNegative, NotNegative] | None = None
    """Moments of inertia about the centre of mass [kg m²]."""
    tcp: Pose | None = None
    """Pose of the tool centre point in the piece's frame, [x y z Rz Ry Rx]."""
    colour: Colour | None = None
    """Red, green, blue, opacity."""


class FloorConfig(Strict):
    """A square floor around the world's origin, its top at z = 0."""

    size: Positive = 3.0
    """Length of a side [m]."""


class ContactConfig(Strict):
    """Contact between robots, pieces and floor. A station without this section has none."""

    model: Literal["point", "hydroelastic", "hydroelastic_with_fallback"] = "point"
    self_collision: bool = False
    """Contact between the links of one robot."""


class JointStops(Strict):
    """Elastic end stops of the joints, for the schemes that know no joint limits; figures of the Simulink joints."""

    stiffness: Positive = 5.73e5
    """Spring of a stop [N·m/rad]; 1e4 N·m/deg."""
    damping: NotNegative = 573.0
    """Damper of a stop [N·m·s/rad]; 10 N·m·s/deg."""


class StationConfig(Strict):
    """A whole station, resolved: writing it to YAML and loading that gives an equal one."""

    name: str
    description: str = ""
    mode: Literal["dynamic", "kinematic"] = "dynamic"
    """Dynamic: moved by torque. Kinematic: the motion is the input, and the torque is computed."""
    robots: Annotated[dict[str, RobotConfig], Field(min_length=1)]
    pieces: dict[str, PieceConfig] = Field(default_factory=dict)
    servo: ServoConfig = ServoConfig()
    reference: ReferenceConfig = Hold(kind="hold")
    inputs: tuple[Input, ...] = ()
    """Input ports beside `reference`."""
    floor: FloorConfig | None = None
    contact: ContactConfig | None = None
    joint_stops: JointStops = JointStops()
    gravity: Number = STANDARD_GRAVITY
    """Gravity along -z [m/s²]."""
    solver: SolverConfig = ContinuousSolver(kind="continuous")
    monitors: Monitors = Field(default_factory=dict)
    duration: Positive = 3.0
    """Simulated time [s]."""
    sample_rate: Positive = 100.0
    """Samples a second of the signals [Hz]."""

    @model_validator(mode="after")
    def _forces_need_dynamics(self) -> StationConfig:
        if self.mode == "kinematic" and any(robot.pushes for robot in self.robots.values()):
            raise ValueError("a kinematic station knows no forces, so it has no pushes")
        return self

    @field_validator("robots", "pieces", "monitors")
    @classmethod
    def _plain_names(cls, entries: dict[str, Any]) -> dict[str, Any]:
        for name in entries:
            if not name.isidentifier():
                raise ValueError(f"'{name}' is no plain name (letters, digits and _, no digit first)")
        return entries

    @property
    def only_robot(self) -> str | None:
        """The name of the station's robot if it has one only; then ports and columns carry no prefix."""
        return next(iter(self.robots)) if len(self.robots) == 1 else None

    def prefix(self, robot: str) -> str:
        """Return what stands before the names of a robot's ports, blocks and columns."""
        return "" if self.only_robot else f"{robot}."

    def servo_of(self, robot: str) -> ServoConfig:
        """Return a robot's own servo section, or the station's."""
        return self.robots[robot].servo or self.servo

    def reference_of(self, robot: str) -> ReferenceConfig:
        """Return a robot's own reference section, or the station's."""
        return self.robots[robot].reference or self.reference


def _each(values: AxisValues | None, accepts: Any, meaning: str) -> AxisValues | None:
    """Return per-axis values if every number in them is accepted."""
    listed = values.values() if isinstance(values, dict) else values if isinstance(values, list) else [values]
    if values is not None and not all(accepts(value) for value in listed):
        raise ValueError(meaning)
    return values
