"""What axes and bodies may come to that ends a run: limits, standing still, running away, touching, falling."""

import math
from functools import cache
from typing import Literal

import numpy as np
from pydantic import model_validator

from simrob_drake.base.errors import InvalidParameter, one_of
from simrob_drake.base.files import models_root
from simrob_drake.base.frames import Vector, lean
from simrob_drake.base.messages import compound, join_texts, message
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
            """Tell which limit was reached. An overshoot below ``count`` is of an upper limit, else of a lower."""
            side, limits, axis = (_UPPER, upper, index) if index < count else (_LOWER, lower, index - count)
            return message(
                "parts.reached_limit",
                "{axis} reached its {side} limit of {limit}",
                axis=robot.axes[axis],
                side=side,
                limit=robot.model.units[axis].shown(limits[axis]),
            )

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
            raise InvalidParameter(
                f"monitors.{name}.limit", float(limit.min()), message("parts.positive_torque", "positive [N·m or N]")
            )

    def _limits(self, robot: ResolvedRobot) -> Vector:
        own = robot.gains.judged_limit
        return own if self.limit is None else robot.model.axis_vector(self.limit, "limit", own)

    def condition(self, name: str, station: Surroundings) -> Condition:
        """Return what ends a run; its excess is the largest part of a limit that is used, minus one."""
        robot = station.robot(self.robot, f"monitors.{name}")
        limit = self._limits(robot)
        gains = robot.gains
        has_lines = self.limit is None and gains.line is not None and station.engine.moves_by_forces

        def why_of_motor(index: int, _: float) -> str:
            return message(
                "parts.stayed_at_motor_limit",
                "{axis} stayed at the limit of its motor for {hold:g} s",
                axis=robot.axes[index],
                hold=self.hold,
            )

        def excess_of_motors(torque: Vector, speed: Vector) -> Vector:
            return gains.torque_shares(torque, speed) - 1 + _AT_LIMIT

        if has_lines:
            return worst(of_axes(robot, "torque", "velocity"), excess_of_motors, why_of_motor)

        def why(index: int, _: float) -> str:
            bound = compound("{limit:g} {effort}", limit=limit[index], effort=robot.model.units[index].effort)
            what = (
                message("parts.its_torque_limit", "its torque limit")
                if self.limit is None
                else message("parts.the_limit", "the limit")
            )
            return message(
                "parts.stayed_at_limit",
                "{axis} stayed at {what} of {bound} for {hold:g} s",
                axis=robot.axes[index],
                what=what,
                bound=bound,
                hold=self.hold,
            )

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
            speeds = dict.fromkeys(
                compound("{bound:g} {unit}/s", bound=bound / unit.size, unit=unit.name) for bound, unit in bounds
            )
            return message(
                "parts.stood_still",
                "the robot has stood still (below {speeds}) for {hold:g} s",
                speeds=join_texts(speeds, message("base.and", " and ")),
                hold=self.hold,
            )

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
            return message(
                "parts.ran_away",
                "{axis} ran away: {speed:.4g} {unit}, above {limit:g} {unit}",
                axis=robot.axes[index],
                speed=speed,
                unit=unit,
                limit=self.speed_limit,
            )

        return worst(of_axes(robot, "velocity"), lambda velocity: np.abs(velocity) - self.speed_limit, why)


class PowerLimit(MonitorSection):
    r"""End the run when the mechanical power of a robot's joints, :math:`\sum_i |\tau_i v_i|`, is too large."""

    kind: Literal["power_limit"]
    limit: Positive
    """Largest power of all joints together [W]; braking counts as driving does."""

    def condition(self, name: str, station: Surroundings) -> Condition:
        """Return what ends a run; its excess is the power over the limit [W]."""
        robot = station.robot(self.robot, f"monitors.{name}")
        why = message(
            "parts.power_reached_limit",
            "the power of the joints of {robot} reached the limit of {limit:g} W{lasting}",
            robot=robot.name,
            limit=self.limit,
            lasting=self.lasting,
        )

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
            expected = message(
                "parts.robot_with_gripper",
                "one with a gripper: in its robot.yaml; {advice}",
                advice=gripper_advice(robot.model),
            )
            raise InvalidParameter(f"monitors.{name}.robot", robot.name, expected)

    def condition(self, name: str, station: Surroundings) -> Condition:
        """Return what ends a run; its excess is how much nearer to closed the most open finger is."""
        robot = station.robot(self.robot, f"monitors.{name}")
        places = list(robot.model.fingers)
        closed, opened = np.array(list(robot.model.fingers.values())).T

        stroke = stroke_of(robot.model)
        nothing = self.part + (stroke.opening(0.0) if stroke else 0.0)

        def excess(position: Vector) -> float:
            return nothing - float(((position[places] - closed) / (opened - closed)).max())

        why = message(
            "parts.fingers_closed", "the fingers of {robot} closed with nothing between them", robot=robot.name
        )
        return Condition(of_axes(robot, "position"), excess, lambda _: why)


class Contact(SensorMonitorSection):
    """End the run when two things touch: a distance sensor reads 0."""

    kind: Literal["contact"]
    distance: NotNegative = 0.0
    """Distance that counts as contact [m]."""

    def condition(self, name: str, station: Surroundings) -> Condition:
        """Return what ends a run, as the proximity switch of the Simulink library does; its excess is in metres."""
        sensor = self.watched_sensor(name, station, "distance")
        names = message(
            "parts.body_and_other",
            "{body} and {other}",
            body=station.sensors[sensor].body,
            other=station.sensors[sensor].other,
        )
        why = (
            message(
                "parts.nearer_than",
                "{names} are nearer than {distance:g} mm",
                names=names,
                distance=1e3 * self.distance,
            )
            if self.distance
            else message("parts.touch", "{names} touch", names=names)
        )
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
        region = (
            message("parts.of_region", " of {limit}", limit=self.limit.replace("_", " "))
            if isinstance(self.limit, str)
            else ""
        )
        why = message(
            "parts.force_reached_limit",
            "the force on {body} reached the limit of {limit:g} N{region}{lasting}",
            body=body,
            limit=limit,
            region=region,
            lasting=self.lasting,
        )
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
    return (
        regions[one_of(message("parts.body_region", "body region"), limit, regions)]
        if isinstance(limit, str)
        else limit
    )


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
            raise ValueError(message("parts.fall_needs_bound", "a fall needs a bound: height or tilt_deg"))
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
                return message("parts.is_nowhere", "{who} is nowhere", who=who)
            if tilt is None or low >= leaning:
                return message(
                    "parts.fell_too_low", "{who} fell: its height is below {height:g} m", who=who, height=self.height
                )
            return message(
                "parts.fell_leaning", "{who} fell: it leans by more than {tilt:g} deg", who=who, tilt=self.tilt_deg
            )

        return Condition(watched, excess, why)


_UPPER, _LOWER = message("base.upper", "upper"), message("base.lower", "lower")
_ABOVE, _BELOW = message("parts.above", "above"), message("parts.below", "below")
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
            raise ValueError(
                message("parts.lower_below_upper", "lower must be below upper, {upper}", upper=list(self.upper))
            )
        return self

    def condition(self, name: str, station: Surroundings) -> Condition:
        """Return what ends a run; its excess is how far outside the origin of the pose is [m]."""
        who, watched, _ = self.watched_pose(name, station, f"tcp_pose.{self.tool}" if self.tool else "tcp_pose")

        def overshoots(pose: Vector) -> Vector:
            return np.concatenate([pose[:3] - self.upper, self.lower - pose[:3]])

        def why(index: int, _: float) -> str:
            axis = index % len(_XYZ)
            side, bound = (_ABOVE, self.upper[axis]) if index < len(_XYZ) else (_BELOW, self.lower[axis])
            return message(
                "parts.left_workspace",
                "{who} left its workspace: {axis} {side} {bound:g} m",
                who=who,
                axis=_XYZ[axis],
                side=side,
                bound=bound,
            )

        return worst(watched, overshoots, why)
