"""Kinds of monitor: limits of joints and motors, standing still, running away, contact, falls, and limits of a box.

Each class is a kind of section under ``monitors`` in a station file. Its method `condition` returns the condition that
ends a run, with a function *excess* of the watched signals: the condition holds if the excess is not negative. The run
ends once the condition has held for the time `hold`, and not before the time `after`: both are keys of all monitors.
Most of the classes compute one excess for each axis or side, and the largest of them decides. A function *why* gives
the reason of the end in words. A robot has n axes.
"""

import math
from functools import cache
from typing import Literal, NamedTuple

import numpy as np
from pydantic import model_validator

from simrob_drake.base.errors import InvalidParameter, one_of
from simrob_drake.base.files import models_root
from simrob_drake.base.frames import Vector, lean
from simrob_drake.base.messages import compound, join_texts, message
from simrob_drake.base.sections import (
    NotNegative,
    Number,
    Positive,
    Strict,
    Triple,
    validate_section,
)
from simrob_drake.base.yaml_files import read_yaml
from simrob_drake.blocks.monitor import Condition
from simrob_drake.parts.monitors.monitor import (
    MonitorSection,
    PoseMonitorSection,
    SensorMonitorSection,
    axis_outputs,
    condition_on_largest,
)
from simrob_drake.parts.resolved import ResolvedRobot, StationContents
from simrob_drake.robots.axis_map import AxisValues
from simrob_drake.robots.description_files import gripper_advice
from simrob_drake.robots.grasps import stroke_of

_UPPER = message("base.upper", "upper")
_LOWER = message("base.lower", "lower")
_ABOVE = message("parts.above", "above")
_BELOW = message("parts.below", "below")
_XYZ = "xyz"


class JointLimit(MonitorSection):
    """End the run when a joint reaches a limit of its range."""

    kind: Literal["joint_limit"]
    margin_deg: Number = 0.0
    """Distance before the limit at which the run ends, for axes that turn [deg]; negative for a distance beyond the
    limit."""
    margin_m: Number = 0.0
    """Distance before the limit at which the run ends, for axes that slide [m]."""

    def condition(self, name: str, station: StationContents) -> Condition:
        """Make the condition; its excess is the largest overshoot of a limit, with the margin [rad or m].

        Args:
            name: name of the section.
            station: contents of the station.
        """
        robot = station.robot(self.robot, f"monitors.{name}")
        count = len(robot.axes)
        # Margin of each axis, shape (n,) [rad or m]. A positive one makes the range smaller on both sides.
        margin = robot.model.bounds(self.margin_deg, self.margin_m)
        all_lower, all_upper = robot.model.axis_limits
        lower = all_lower + margin
        upper = all_upper - margin

        def overshoots(position: Vector) -> Vector:
            """Overshoots of the upper limits of all axes, then of the lower ones, shape (2 n,)."""
            return np.concatenate([position - upper, lower - position])

        def why(index: int, _: float) -> str:
            """Reason of the end of the run, by the index of the largest overshoot."""
            # The first n overshoots are those of the upper limits.
            is_upper = index < count
            axis = index if is_upper else index - count
            limit = upper[axis] if is_upper else lower[axis]
            return message(
                "parts.reached_limit",
                "{axis} reached its {side} limit of {limit}",
                axis=robot.axes[axis],
                side=_UPPER if is_upper else _LOWER,
                limit=robot.model.units[axis].format(limit),
            )

        return condition_on_largest(axis_outputs(robot, "position"), overshoots, why)


# A servo counts as saturated if less than this part of its torque limit is missing [1], since rounding errors keep the
# recorded torque of a saturated servo slightly below its limit.
_AT_LIMIT = 1e-6


class TorqueLimit(MonitorSection):
    """End the run when a servo stays at its torque limit, or beyond one of the monitor's own."""

    kind: Literal["torque_limit"]
    hold: NotNegative = 0.5
    """Time for which the servo must stay at the limit [s]."""
    limit: AxisValues | None = None
    """Torque that counts as the limit, per axis [N·m or N]. Unless given, that of the servo, or the torque that its
    motor can give at the present speed. Axes that a mapping leaves out keep the limit of their servo."""

    def check(self, name: str, station: StationContents) -> None:
        """Check that the robot exists, and that the limits are positive.

        Args:
            name: name of the section.
            station: contents of the station.

        Raises:
            SimrobError: the robot or an axis does not exist, no robot is named and the station does not have exactly
                one, a list of limits has a wrong length, or a limit is not positive.
        """
        super().check(name, station)
        limits = self._limits(station.robot(self.robot, f"monitors.{name}"))
        # The excess divides by the limits. A negation, so that it also finds values that are not numbers.
        if not (limits > 0).all():
            raise InvalidParameter(
                f"monitors.{name}.limit",
                float(limits.min()),
                message("parts.positive_torque", "positive [N·m or N]"),
            )

    def _limits(self, robot: ResolvedRobot) -> Vector:
        """Torque limit of each axis, shape (n,) [N·m or N]: that of the section, or else that of the servo.

        The limit of the servo of a passive axis is infinite, since such an axis has no torque. Errors name the key
        ``limit``.
        """
        servo_limits = robot.gains.judged_limit
        if self.limit is None:
            return servo_limits
        return robot.model.axis_vector(self.limit, "limit", servo_limits)

    def condition(self, name: str, station: StationContents) -> Condition:
        """Make the condition; its excess is the largest used part of a limit, minus one [1].

        Args:
            name: name of the section.
            station: contents of the station.
        """
        robot = station.robot(self.robot, f"monitors.{name}")
        # Whether the limit is the torque that a motor can give at its present speed, which falls along a line. Limits
        # of the section's own replace these lines. In a kinematic station torques are computed from the motion, and
        # only compared with constant limits.
        uses_motor_lines = (
            self.limit is None and robot.gains.line is not None and station.engine.moves_by_forces
        )
        if uses_motor_lines:
            return self._condition_of_motors(robot)
        return self._condition_of_limits(robot)

    def _condition_of_motors(self, robot: ResolvedRobot) -> Condition:
        """Make the condition on the torque that each motor can give at its speed."""

        def excesses(torque: Vector, speed: Vector) -> Vector:
            """Used part of each axis's torque at its speed, minus one, shape (n,) [1]."""
            # A share of 1 is the whole torque that the motor has at this speed.
            return robot.gains.torque_shares(torque, speed) - 1 + _AT_LIMIT

        def why(index: int, _: float) -> str:
            """Reason of the end of the run, by the index of the axis with the largest excess (which is not used)."""
            return message(
                "parts.stayed_at_motor_limit",
                "{axis} stayed at the limit of its motor for {hold:g} s",
                axis=robot.axes[index],
                hold=self.hold,
            )

        return condition_on_largest(axis_outputs(robot, "torque", "velocity"), excesses, why)

    def _condition_of_limits(self, robot: ResolvedRobot) -> Condition:
        """Make the condition on constant torque limits: those of the section, or else those of the servos."""
        limits = self._limits(robot)
        if self.limit is None:
            what = message("parts.its_torque_limit", "its torque limit")
        else:
            what = message("parts.the_limit", "the limit")

        def excesses(torque: Vector) -> Vector:
            """Used part of each axis's limit, minus one, shape (n,) [1]."""
            return np.abs(torque) / limits - 1 + _AT_LIMIT

        def why(index: int, _: float) -> str:
            """Reason of the end of the run, by the index of the axis."""
            unit = robot.model.units[index].effort
            return message(
                "parts.stayed_at_limit",
                "{axis} stayed at {what} of {bound} for {hold:g} s",
                axis=robot.axes[index],
                what=what,
                bound=compound("{limit:g} {effort}", limit=limits[index], effort=unit),
                hold=self.hold,
            )

        return condition_on_largest(axis_outputs(robot, "torque"), excesses, why)


class Settled(MonitorSection):
    """End the run when the robot stands still."""

    kind: Literal["settled"]
    hold: NotNegative = 0.2
    """Time for which the robot must stand still [s]."""
    speed_deg: Positive = 0.1
    """Speed below which an axis that turns stands still [deg/s]."""
    speed_m: Positive = 1e-3
    """Speed below which an axis that slides stands still [m/s]."""
    error_deg: Positive | None = None
    """Largest position error of axes that turn; unless given any error counts as settled."""
    error_m: Positive | None = None
    """Largest position error of axes that slide [m]; unless given any error counts as settled."""

    def condition(self, name: str, station: StationContents) -> Condition:
        r"""Make the condition; its excess is how far below its bound the worst axis is, as a part of the bound [1].

        With the speeds v, the position errors e and their bounds it is
        :math:`1 - \max_i \max(|v_i| / v_{max,i}, |e_i| / e_{max,i})`, without the errors if none is bounded.

        Args:
            name: name of the section.
            station: contents of the station.
        """
        robot = station.robot(self.robot, f"monitors.{name}")
        # Bounds in SI units, shape (n,). An error without a bound may be infinite.
        speed_bounds = robot.model.bounds(self.speed_deg, self.speed_m)
        error_bounds = robot.model.bounds(
            math.inf if self.error_deg is None else self.error_deg,
            math.inf if self.error_m is None else self.error_m,
        )

        # Parts of bounds have no unit, so axes that turn can be compared with axes that slide.
        def used_speed(velocity: Vector) -> float:
            """Largest speed as a part of its bound."""
            return float((np.abs(velocity) / speed_bounds).max())

        def excess_of_speed(velocity: Vector) -> float:
            """Excess of the condition if errors do not count."""
            return 1 - used_speed(velocity)

        def excess_with_error(velocity: Vector, position: Vector, reference: Vector) -> float:
            """Excess of the condition with the errors of the positions."""
            used_error = float((np.abs(reference - position) / error_bounds).max())
            return 1 - max(used_speed(velocity), used_error)

        def why(*_: Vector) -> str:
            """Reason of the end of the run, with the speeds that count as standing still."""
            # The keys are the bounds in words: axes with the same bound are named once.
            bounds = dict[str, None]()
            for bound, unit in zip(speed_bounds, robot.model.units, strict=True):
                bounds[compound("{bound:g} {unit}/s", bound=bound / unit.size, unit=unit.name)] = (
                    None
                )
            return message(
                "parts.stood_still",
                "the robot has stood still (below {speeds}) for {hold:g} s",
                speeds=join_texts(bounds, message("base.and", " and ")),
                hold=self.hold,
            )

        # Positions and references are only watched if errors count: each input costs time at every step.
        if self.error_deg is None and self.error_m is None:
            return Condition(axis_outputs(robot, "velocity"), excess_of_speed, why)
        watched = axis_outputs(robot, "velocity", "position", "reference")
        return Condition(watched, excess_with_error, why)


class Divergence(MonitorSection):
    """End the run when a joint becomes faster than any real one: the simulation has diverged."""

    kind: Literal["divergence"]
    speed_limit: Positive = 100.0
    """Speed that counts as running away [rad/s, or m/s of axes that slide]."""

    def condition(self, name: str, station: StationContents) -> Condition:
        """Make the condition; its excess is the largest speed minus the limit [rad/s or m/s].

        Args:
            name: name of the section.
            station: contents of the station.
        """
        robot = station.robot(self.robot, f"monitors.{name}")

        def excesses(velocity: Vector) -> Vector:
            """Speed of each axis minus the limit, shape (n,) [rad/s or m/s]."""
            # The same number serves in rad/s and in m/s: it only has to be far above the speeds of real joints.
            return np.abs(velocity) - self.speed_limit

        def why(index: int, excess: float) -> str:
            """Reason of the end of the run, by the index and the excess of the fastest axis."""
            unit = f"{robot.model.units[index].si}/s"
            return message(
                "parts.ran_away",
                "{axis} diverged: its speed is {speed:.4g} {unit}, above {limit:g} {unit}",
                axis=robot.axes[index],
                # The excess is the speed minus the limit.
                speed=excess + self.speed_limit,
                unit=unit,
                limit=self.speed_limit,
            )

        return condition_on_largest(axis_outputs(robot, "velocity"), excesses, why)


class PowerLimit(MonitorSection):
    r"""End the run when the mechanical power of a robot's joints, :math:`\sum_i |\tau_i v_i|`, is too large."""

    kind: Literal["power_limit"]
    limit: Positive
    """Largest power of all joints together [W]; braking counts as driving does."""

    def condition(self, name: str, station: StationContents) -> Condition:
        """Make the condition; its excess is the power minus the limit [W].

        Args:
            name: name of the section.
            station: contents of the station.
        """
        robot = station.robot(self.robot, f"monitors.{name}")
        reason = message(
            "parts.power_reached_limit",
            "the power of the joints of {robot} reached the limit of {limit:g} W{lasting}",
            robot=robot.name,
            limit=self.limit,
            lasting=self.hold_text,
        )

        def excesses(torque: Vector, velocity: Vector) -> Vector:
            """Power of all joints minus the limit, shape (1,) [W]."""
            # Absolute values of the products, so that braking counts as driving does.
            power = np.abs(torque * velocity).sum()
            return np.array([power - self.limit])

        watched = axis_outputs(robot, "torque", "velocity")
        return condition_on_largest(watched, excesses, lambda *_: reason)


class EmptyGrip(MonitorSection):
    """End the run when all fingers of a gripper are closed: nothing is between them, or what was has slipped out."""

    kind: Literal["empty_grip"]
    hold: NotNegative = 0.05
    """Time for which the fingers must be closed [s]."""
    part: Positive = 0.02
    """Opening up to which a finger counts as closed, as a part of the way from closed to open, beyond the opening at
    which the shapes of the fingers meet."""

    def check(self, name: str, station: StationContents) -> None:
        """Check that the robot exists and has fingers.

        Args:
            name: name of the section.
            station: contents of the station.

        Raises:
            SimrobError: the robot does not exist or has no fingers, or no robot is named and the station does not have
                exactly one.
        """
        super().check(name, station)
        robot = station.robot(self.robot, f"monitors.{name}")
        if not robot.model.fingers:
            expected = message(
                "parts.robot_with_gripper",
                "a robot with a gripper in its robot.yaml; {advice}",
                advice=gripper_advice(robot.model),
            )
            raise InvalidParameter(f"monitors.{name}.robot", robot.name, expected)

    def condition(self, name: str, station: StationContents) -> Condition:
        """Make the condition; its excess is the opening that counts as closed minus that of the most open finger [1].

        The opening of a finger is 0 if it is closed, and 1 if it is open.

        Args:
            name: name of the section.
            station: contents of the station.
        """
        robot = station.robot(self.robot, f"monitors.{name}")
        # Only the axes of fingers count, by their indices among all axes of the robot.
        indices = list(robot.model.fingers)
        # Positions of each finger's axis at the two ends of its way [rad or m].
        closed = np.array([ends[0] for ends in robot.model.fingers.values()])
        opened = np.array([ends[1] for ends in robot.model.fingers.values()])

        # Shapes of fingers may meet before their joints are closed: then the opening at which their gap is 0 is above
        # 0.
        stroke = stroke_of(robot.model)
        opening_at_touch = stroke.opening(0.0) if stroke else 0.0
        largest_opening = self.part + opening_at_touch

        def excess(position: Vector) -> float:
            """Opening that counts as closed minus the opening of the most open finger [1]."""
            # One finger that is held open by a piece is enough for a grip that is not empty.
            openings = (position[indices] - closed) / (opened - closed)
            return largest_opening - float(openings.max())

        reason = message(
            "parts.fingers_closed",
            "the fingers of {robot} closed with nothing between them",
            robot=robot.name,
        )
        return Condition(axis_outputs(robot, "position"), excess, lambda _: reason)


class Contact(SensorMonitorSection):
    """End the run when two things touch: a distance sensor reads 0."""

    kind: Literal["contact"]
    distance: NotNegative = 0.0
    """Distance that counts as contact [m]."""

    def condition(self, name: str, station: StationContents) -> Condition:
        """Make the condition; its excess is the distance that counts as contact minus the measured one [m].

        The proximity switch of the Simulink library works like this.

        Args:
            name: name of the section.
            station: contents of the station.
        """
        sensor = self.watched_sensor(name, station, "distance")
        # The reason names what touches, which only the section of the sensor knows.
        section = station.sensors[sensor]
        names = message(
            "parts.body_and_other",
            "{body} and {other}",
            body=section.body,
            other=section.other,
        )
        if self.distance:
            millimetres = 1e3 * self.distance
            reason = message(
                "parts.nearer_than",
                "{names} are closer than {distance:g} mm",
                names=names,
                distance=millimetres,
            )
        else:
            reason = message("parts.touch", "{names} touch", names=names)

        def excesses(distance: Vector) -> Vector:
            """Distance that counts as contact minus the measured one, shape (1,) [m]."""
            return self.distance - distance

        # There is only one excess. The function makes it infinite if the distance is not a number, which ends the run.
        return condition_on_largest({f"distance.{sensor}": 1}, excesses, lambda *_: reason)


class ForceLimit(SensorMonitorSection):
    """End the run when the force at a force sensor is too large."""

    kind: Literal["force_limit"]
    limit: Positive | str
    """Largest force [N], or a body region of ISO/TS 15066 such as `hands_and_fingers`."""

    def condition(self, name: str, station: StationContents) -> Condition:
        """Make the condition; its excess is the magnitude of the force minus the limit [N].

        Args:
            name: name of the section.
            station: contents of the station.
        """
        sensor = self.watched_sensor(name, station, "force")
        limit = force_limit(self.limit)
        region = ""
        if isinstance(self.limit, str):
            region = compound(" ({region})", region=self.limit.replace("_", " "))
        reason = message(
            "parts.force_reached_limit",
            "the force on {body} reached the limit of {limit:g} N{region}{lasting}",
            body=station.sensors[sensor].body,
            limit=limit,
            region=region,
            lasting=self.hold_text,
        )

        def excesses(force: Vector) -> Vector:
            """Magnitude of the force minus the limit, shape (1,) [N]."""
            return np.array([np.linalg.norm(force) - limit])

        return condition_on_largest({f"force.{sensor}": 3}, excesses, lambda *_: reason)


class _LimitTable(Strict):
    """Content of the file with the limits of ISO/TS 15066.

    Attributes:
        source: where the limits are from.
        unit: unit of the limits.
        quasi_static_force: largest force on a clamped body region, by the name of the region.
    """

    source: str
    unit: str
    quasi_static_force: dict[str, Positive]


@cache
def quasi_static_limits() -> dict[str, float]:
    """Read the largest forces [N] on clamped body regions (quasi-static contact), by the name of the region."""
    # A clamped part of a body cannot move away, so the standard allows lower forces on it than for a short hit.
    file = models_root() / "limits" / "iso_ts_15066.yaml"
    return dict(validate_section(_LimitTable, read_yaml(file), file).quasi_static_force)


def force_limit(limit: float | str) -> float:
    """Find the force [N] of a limit.

    Args:
        limit: the force itself [N], or the name of a body region of ISO/TS 15066.

    Raises:
        UnknownName: there is no such body region.
    """
    if not isinstance(limit, str):
        return limit
    regions = quasi_static_limits()
    region = one_of(message("parts.body_region", "body region"), limit, regions)
    return regions[region]


def _not_finite(who: str) -> str:
    """Write the reason of the end of a run in which the pose of a robot, a tool or a piece, ``who``, is not finite."""
    return message(
        "parts.is_nowhere",
        "the pose of {who} is not finite: the simulation has diverged",
        who=who,
    )


class _FallExcess(NamedTuple):
    """Excesses of a fall's two bounds, as parts of the bounds [1]. A bound that is not given has -1.

    Attributes:
        low: 1 - height / bound. It is not negative if the height is too small.
        leaning: tilt / bound - 1. It is not negative if the tilt is too large.
    """

    low: float
    leaning: float

    @property
    def is_finite(self) -> bool:
        """Whether both are finite. They are not if the simulation has diverged."""
        return math.isfinite(self.low) and math.isfinite(self.leaning)


class Fall(PoseMonitorSection):
    """End the run when a robot's base, or a free piece, is too low or leans too far."""

    kind: Literal["fall"]
    height: Positive | None = None
    """Height of its origin over the ground beneath, below which it has fallen [m]."""
    tilt_deg: Positive | None = None
    """Angle from how it stood at the start beyond which it has fallen."""

    @model_validator(mode="after")
    def _check_has_bound(self) -> "Fall":
        """Check that at least one bound is given.

        Raises:
            ValueError: neither ``height`` nor ``tilt_deg`` is given.
        """
        if self.height is None and self.tilt_deg is None:
            raise ValueError(
                message(
                    "parts.fall_needs_bound", "a fall monitor needs a bound: height or tilt_deg"
                )
            )
        return self

    def faller(self, only_robot: str | None) -> str | None:
        """Name of the robot whose fall the section watches.

        Args:
            only_robot: name of the station's only robot; None if it has none or several.

        Returns:
            The name. None if the section names a piece, or if it names no robot and the station does not have exactly
            one.
        """
        if self.piece is not None:
            return None
        return self.robot or only_robot

    def condition(self, name: str, station: StationContents) -> Condition:
        """Make the condition; its excess is the larger excess of the two bounds, as a part of the bound [1].

        Args:
            name: name of the section.
            station: contents of the station.
        """
        pose_source = self.watched_pose(name, station, "base_pose")
        subject = pose_source.subject
        ground = station.ground
        largest_tilt = None if self.tilt_deg is None else math.radians(self.tilt_deg)
        # Direction in the body that points up at the start, a unit vector. A plain list, since `lean` is called at each
        # step and is faster without arrays.
        world_up = np.array([0.0, 0.0, 1.0])
        up: list[float] = (pose_source.start.rotation().inverse() @ world_up).tolist()

        def excesses(pose: Vector) -> _FallExcess:
            """Excesses of a pose, x y z [m] qw qx qy qz."""
            quaternion = pose.tolist()[3:]
            # Both are parts of their bounds, so a height in m can be compared with an angle.
            low = -1.0
            if self.height is not None:
                low = 1 - ground.height(pose) / self.height
            leaning = -1.0
            if largest_tilt is not None:
                leaning = lean(up, *quaternion) / largest_tilt - 1
            return _FallExcess(low, leaning)

        def excess(pose: Vector) -> float:
            """Larger excess of the two bounds [1]. It is infinite if a height or tilt with a bound is not finite."""
            # Plain names and comparisons, since this is evaluated at every step.
            low, leaning = excesses(pose)
            # A pose that is not finite ends the run: comparisons would ignore a value that is not a number.
            if not (math.isfinite(low) and math.isfinite(leaning)):
                return math.inf
            return low if low >= leaning else leaning

        def why(pose: Vector) -> str:
            """Reason why the run ends: the pose is not finite, too low, or leans too far."""
            found = excesses(pose)
            if not found.is_finite:
                return _not_finite(subject)
            # If both bounds are exceeded, the reason is the one that is exceeded more.
            if found.low >= found.leaning or largest_tilt is None:
                return message(
                    "parts.fell_too_low",
                    "{who} fell: its height is below {height:g} m",
                    who=subject,
                    height=self.height,
                )
            return message(
                "parts.fell_leaning",
                "{who} fell: it leans by more than {tilt:g} deg",
                who=subject,
                tilt=self.tilt_deg,
            )

        return Condition(pose_source.watched, excess, why)


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
    def _check_box(self) -> "Workspace":
        """Check that the box is not empty.

        Raises:
            ValueError: a lower bound is not below the upper one.
        """
        if any(low >= high for low, high in zip(self.lower, self.upper, strict=True)):
            raise ValueError(
                message(
                    "parts.lower_below_upper",
                    "lower is {lower}; it must be below upper, {upper}, in x, y and z",
                    lower=list(self.lower),
                    upper=list(self.upper),
                )
            )
        return self

    def condition(self, name: str, station: StationContents) -> Condition:
        """Make the condition; its excess is the largest distance by which x, y or z of the pose is out of bounds [m].

        Args:
            name: name of the section.
            station: contents of the station.
        """
        port = f"tcp_pose.{self.tool}" if self.tool else "tcp_pose"
        pose_source = self.watched_pose(name, station, port)

        def overshoots(pose: Vector) -> Vector:
            """Overshoots of the upper bounds of x, y and z, then of the lower ones, shape (6,)."""
            position = pose[:3]
            return np.concatenate([position - self.upper, self.lower - position])

        def why(index: int, overshoot: float) -> str:
            """Reason of the end of the run, by the index and the value of the largest overshoot."""
            # An overshoot that is not a number arrives here as infinite, and belongs to no side of the box.
            if math.isinf(overshoot):
                return _not_finite(pose_source.subject)
            # The first three overshoots are those of the upper bounds.
            is_upper = index < len(_XYZ)
            axis = index % len(_XYZ)
            return message(
                "parts.left_workspace",
                "{who} left its workspace: {axis} {side} {bound:g} m",
                who=pose_source.subject,
                axis=_XYZ[axis],
                side=_ABOVE if is_upper else _BELOW,
                bound=self.upper[axis] if is_upper else self.lower[axis],
            )

        return condition_on_largest(pose_source.watched, overshoots, why)
