"""What axes and bodies may come to that ends a run: limits, standing still, running away, touching, falling."""

import math
from functools import cache
from typing import Literal

import numpy as np
from pydantic import model_validator

from simrob_drake.base.errors import InvalidParameter, one_of
from simrob_drake.base.files import models_root
from simrob_drake.base.frames import Vector, lean
from simrob_drake.base.sections import NotNegative, Number, Positive, Strict, Triple, validated
from simrob_drake.base.yaml_files import read_yaml
from simrob_drake.blocks.monitor import Condition
from simrob_drake.parts.monitors.monitor import MonitorSection, PoseMonitorSection, SensorMonitorSection, of_axes, worst
from simrob_drake.parts.resolved import ResolvedRobot, Surroundings
from simrob_drake.robots.axis_map import AxisValues
from simrob_drake.robots.description_files import gripper_advice
from simrob_drake.robots.grasps import stroke_of


class JointLimit(MonitorSection):
    """End the run when a joint reaches a limit of its range."""

    kind: Literal["joint_limit"]
    margin_deg: Number = 0.0
    """How far before the limit the run ends, for axes that turn; negative: beyond it."""
    margin_m: Number = 0.0
    """The same for axes that slide [m]."""

    def condition(self, name: str, station: Surroundings) -> Condition:
        """Return what ends a run; its excess is the largest overshoot of a limit [rad or m]."""
        robot = station.robot(self.robot, f"monitors.{name}")
        count, margin = len(robot.axes), robot.model.bounds(self.margin_deg, self.margin_m)
        lower, upper = robot.model.axis_limits
        lower, upper = lower + margin, upper - margin

        def overshoots(position: Vector) -> Vector:
            return np.concatenate([position - upper, lower - position])

        def why(index: int, _: float) -> str:
            side, limits, axis = ("upper", upper, index) if index < count else ("lower", lower, index - count)
            return f"{robot.axes[axis]} reached its {side} limit of {robot.model.units[axis].shown(limits[axis])}"

        return worst(of_axes(robot, "position"), overshoots, why)


_AT_LIMIT = 1e-6  # part of a torque limit that may be missing where a servo counts as saturated


class TorqueLimit(MonitorSection):
    """End the run when a servo stays at its torque limit, or beyond one of the monitor's own."""

    kind: Literal["torque_limit"]
    hold: NotNegative = 0.5
    """How long it must stay there [s]."""
    limit: AxisValues | None = None
    """What counts as the limit, per axis [N·m or N]: of the servo unless given, and of a motor whose torque falls with
    its speed what it gives at that speed. Axes that a mapping leaves out keep the limit of their servo."""

    def check(self, name: str, station: Surroundings) -> None:
        """Check that the limits are positive."""
        super().check(name, station)
        limit = self._limits(station.robot(self.robot, f"monitors.{name}"))
        if not (limit > 0).all():
            raise InvalidParameter(f"monitors.{name}.limit", float(limit.min()), "positive [N·m or N]")

    def _limits(self, robot: ResolvedRobot) -> Vector:
        own = robot.gains.torque_limit
        return own if self.limit is None else robot.model.axis_vector(self.limit, "limit", own)

    def condition(self, name: str, station: Surroundings) -> Condition:
        """Return what ends a run; its excess is the largest part of a limit that is used, minus one."""
        robot = station.robot(self.robot, f"monitors.{name}")
        limit = self._limits(robot)
        gains = robot.gains
        has_lines = self.limit is None and gains.line is not None and station.engine.moves_by_forces

        def why_of_motor(index: int, _: float) -> str:
            return f"{robot.axes[index]} stayed at the limit of its motor for {self.hold:g} s"

        def excess_of_motors(torque: Vector, speed: Vector) -> Vector:
            return gains.torque_shares(torque, speed) - 1 + _AT_LIMIT

        if has_lines:
            return worst(of_axes(robot, "torque", "velocity"), excess_of_motors, why_of_motor)

        def why(index: int, _: float) -> str:
            bound = f"{limit[index]:g} {robot.model.units[index].effort}"
            what = "its torque limit" if self.limit is None else "the limit"
            return f"{robot.axes[index]} stayed at {what} of {bound} for {self.hold:g} s"

        return worst(of_axes(robot, "torque"), lambda torque: np.abs(torque) / limit - 1 + _AT_LIMIT, why)


class Settled(MonitorSection):
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

    def condition(self, name: str, station: Surroundings) -> Condition:
        """Return what ends a run; its excess is how far below the bounds the worst joint is, as a part of them."""
        robot = station.robot(self.robot, f"monitors.{name}")
        speed = robot.model.bounds(self.speed_deg, self.speed_m)
        errors = [np.inf if bound is None else bound for bound in (self.error_deg, self.error_m)]
        error, more = robot.model.bounds(*errors), () if np.isinf(errors).all() else ("position", "reference")

        def excess(velocity: Vector, *places: Vector) -> float:
            use = float((np.abs(velocity) / speed).max())
            if places:
                position, reference = places
                use = max(use, float((np.abs(reference - position) / error).max()))
            return 1 - use

        def why(*_: Vector) -> str:
            bounds = zip(speed, robot.model.units, strict=True)
            speeds = dict.fromkeys(f"{bound / unit.size:g} {unit.name}/s" for bound, unit in bounds)
            return f"the robot has stood still (below {' and '.join(speeds)}) for {self.hold:g} s"

        return Condition(of_axes(robot, "velocity", *more), excess, why)


class Divergence(MonitorSection):
    """End the run when a joint runs away."""

    kind: Literal["divergence"]
    speed_limit: Positive = 100.0
    """Speed that counts as running away [rad/s, or m/s of axes that slide]."""

    def condition(self, name: str, station: Surroundings) -> Condition:
        """Return what ends a run; its excess is the largest speed over the bound [rad/s or m/s]."""
        robot = station.robot(self.robot, f"monitors.{name}")

        def why(index: int, excess: float) -> str:
            unit, speed = f"{robot.model.units[index].si}/s", excess + self.speed_limit
            return f"{robot.axes[index]} ran away: {speed:.4g} {unit}, above {self.speed_limit:g} {unit}"

        return worst(of_axes(robot, "velocity"), lambda velocity: np.abs(velocity) - self.speed_limit, why)


class PowerLimit(MonitorSection):
    r"""End the run when the mechanical power of a robot's joints, :math:`\sum_i |\tau_i v_i|`, is too large."""

    kind: Literal["power_limit"]
    limit: Positive
    """Largest power of all joints together [W]; braking counts as driving does."""

    def condition(self, name: str, station: Surroundings) -> Condition:
        """Return what ends a run; its excess is the power over the limit [W]."""
        robot = station.robot(self.robot, f"monitors.{name}")
        why = f"the power of the joints of {robot.name} reached the limit of {self.limit:g} W{self.lasting}"

        def power(torque: Vector, velocity: Vector) -> Vector:
            return np.array([np.abs(torque * velocity).sum() - self.limit])

        return worst(of_axes(robot, "torque", "velocity"), power, lambda *_: why)


class EmptyGrip(MonitorSection):
    """End the run when all fingers of a gripper are closed: nothing is between them, or what was has slipped out."""

    kind: Literal["empty_grip"]
    hold: NotNegative = 0.05
    """How long they must be [s]."""
    part: Positive = 0.02
    """How near to closed, or to where their shapes meet before, counts, as a part of the way from closed to open."""

    def check(self, name: str, station: Surroundings) -> None:
        """Check that the robot has fingers."""
        super().check(name, station)
        robot = station.robot(self.robot, f"monitors.{name}")
        if not robot.model.fingers:
            expected = f"one with a gripper: in its robot.yaml; {gripper_advice(robot.model)}"
            raise InvalidParameter(f"monitors.{name}.robot", robot.name, expected)

    def condition(self, name: str, station: Surroundings) -> Condition:
        """Return what ends a run; its excess is how much nearer to closed the most open finger is."""
        robot = station.robot(self.robot, f"monitors.{name}")
        places = list(robot.model.fingers)
        closed, opened = np.array(list(robot.model.fingers.values())).T

        stroke = stroke_of(robot.model)
        nothing = self.part + (stroke.part(0.0) if stroke else 0.0)

        def excess(position: Vector) -> float:
            return nothing - float(((position[places] - closed) / (opened - closed)).max())

        why = f"the fingers of {robot.name} closed with nothing between them"
        return Condition(of_axes(robot, "position"), excess, lambda _: why)


class Contact(SensorMonitorSection):
    """End the run when two things touch: a distance sensor reads 0."""

    kind: Literal["contact"]
    distance: NotNegative = 0.0
    """Distance that counts as contact [m]."""

    def condition(self, name: str, station: Surroundings) -> Condition:
        """Return what ends a run, as the proximity switch of the Simulink library does; its excess is in metres."""
        sensor = self.watched_sensor(name, station, "distance")
        names = f"{station.sensors[sensor].body} and {station.sensors[sensor].other}"
        why = f"{names} are nearer than {1e3 * self.distance:g} mm" if self.distance else f"{names} touch"
        return worst({f"distance.{sensor}": 1}, lambda distance: self.distance - distance, lambda *_: why)


class ForceLimit(SensorMonitorSection):
    """End the run when the force at a force sensor is too large."""

    kind: Literal["force_limit"]
    limit: Positive | str
    """Largest force [N], or a body region of ISO/TS 15066 such as `hands_and_fingers`."""

    def condition(self, name: str, station: Surroundings) -> Condition:
        """Return what ends a run; its excess is the size of the force over the limit [N]."""
        sensor = self.watched_sensor(name, station, "force")
        body, limit = station.sensors[sensor].body, force_limit(self.limit)
        region = f" of {self.limit.replace('_', ' ')}" if isinstance(self.limit, str) else ""
        why = f"the force on {body} reached the limit of {limit:g} N{region}{self.lasting}"
        return worst({f"force.{sensor}": 3}, lambda force: np.array([np.linalg.norm(force) - limit]), lambda *_: why)


class _Table(Strict):
    source: str
    unit: str
    quasi_static_force: dict[str, Positive]


@cache
def quasi_static_limits() -> dict[str, float]:
    """Return the largest quasi-static forces [N] by body region."""
    file = models_root() / "limits" / "iso_ts_15066.yaml"
    return dict(validated(_Table, read_yaml(file), file).quasi_static_force)


def force_limit(limit: float | str) -> float:
    """Return a limit [N]: a number as it is, a body region's from the table; raises UnknownName: no such region."""
    regions = quasi_static_limits()
    return regions[one_of("body region", limit, regions)] if isinstance(limit, str) else limit


class Fall(PoseMonitorSection):
    """End the run when a robot's base, or a free piece, is too low or leans too far."""

    kind: Literal["fall"]
    height: Positive | None = None
    """Height of its origin over the ground beneath, below which it has fallen [m]."""
    tilt_deg: Positive | None = None
    """Angle from how it stood at the start beyond which it has fallen."""

    @model_validator(mode="after")
    def _some_bound(self) -> "Fall":
        if self.height is None and self.tilt_deg is None:
            raise ValueError("a fall needs a bound: height or tilt_deg")
        return self

    def faller(self, only_robot: str | None) -> str | None:
        """Return the robot that it watches, of a station with one robot or several; None if it watches a piece."""
        return None if self.piece is not None else self.robot or only_robot

    def condition(self, name: str, station: Surroundings) -> Condition:
        """Return what ends a run; its excess is the larger part of a bound by which it is exceeded."""
        who, watched, start = self.watched_pose(name, station, "base_pose")
        ground = station.ground
        tilt = None if self.tilt_deg is None else math.radians(self.tilt_deg)
        up: list[float] = (start.rotation().inverse() @ np.array([0.0, 0.0, 1.0])).tolist()

        def parts(pose: Vector) -> tuple[float, float]:
            """Return the parts by which height and tilt exceed their bounds, -1 for a bound that is not given."""
            _, _, _, *quaternion = pose.tolist()
            low = -1.0 if self.height is None else 1 - ground.height(pose) / self.height
            return low, -1.0 if tilt is None else lean(up, *quaternion) / tilt - 1

        def excess(pose: Vector) -> float:
            found = parts(pose)
            return max(found) if all(map(math.isfinite, found)) else math.inf

        def why(pose: Vector) -> str:
            low, leaning = parts(pose)
            if not (math.isfinite(low) and math.isfinite(leaning)):
                return f"{who} is nowhere"
            if tilt is None or low >= leaning:
                return f"{who} fell: its height is below {self.height:g} m"
            return f"{who} fell: it leans by more than {self.tilt_deg:g} deg"

        return Condition(watched, excess, why)


_XYZ = "xyz"


class Workspace(PoseMonitorSection):
    """End the run when the tool, or a free piece, leaves a box."""

    kind: Literal["workspace"]
    lower: Triple
    """Smallest x, y and z in the world [m]."""
    upper: Triple
    """Largest x, y and z in the world [m]."""
    tool: str | None = None
    """The robot's tool that is watched; its `tcp` unless given."""

    @model_validator(mode="after")
    def _not_empty(self) -> "Workspace":
        if any(low >= high for low, high in zip(self.lower, self.upper, strict=True)):
            raise ValueError(f"lower must be below upper, {list(self.upper)}")
        return self

    def condition(self, name: str, station: Surroundings) -> Condition:
        """Return what ends a run; its excess is how far outside the origin of the pose is [m]."""
        who, watched, _ = self.watched_pose(name, station, f"tcp_pose.{self.tool}" if self.tool else "tcp_pose")

        def overshoots(pose: Vector) -> Vector:
            return np.concatenate([pose[:3] - self.upper, self.lower - pose[:3]])

        def why(index: int, _: float) -> str:
            axis = index % len(_XYZ)
            side, bound = ("above", self.upper[axis]) if index < len(_XYZ) else ("below", self.lower[axis])
            return f"{who} left its workspace: {_XYZ[axis]} {side} {bound:g} m"

        return worst(watched, overshoots, why)
