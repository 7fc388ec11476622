"""Moves that take as little time as speeds, accelerations and torques of the joints allow (TOPP-RA, Pham & Pham, 2018).

A *law* is the part of a path at which the robots are over time, from 0 to 1. The fastest law along a path has
accelerations that jump from one limit to another. Here each value of the law is replaced by its mean over a short time,
so that the acceleration is continuous. Then the whole motion is slowed down as far as the motors need it.

A path or motion of several robots is one array of axes: those of one robot after those of the other.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from pydrake.math import BsplineBasis
from pydrake.multibody.optimization import Toppra
from pydrake.trajectories import BsplineTrajectory, Trajectory
from scipy.interpolate import BSpline

from simrob_drake.base.errors import InvalidParameter
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import message
from simrob_drake.dynamics import Dynamics
from simrob_drake.parts.station_plant import StationRobot
from simrob_drake.programs.model import StationModel
from simrob_drake.programs.plan import Plan
from simrob_drake.programs.segments import Segment, Stretch, free_spline

_LEAST_GRID = 100  # least count of intervals of the path, at whose ends the limits hold
_MOST_GRID = 300  # largest count of them
_MEAN_TIME = 0.02  # time over which the law is averaged [s]
_LARGEST_MEAN = 0.125  # largest part of the motion over which the law is averaged [1]
_SAMPLES = 8  # count of samples of the averaged law in the time of one mean
_FINE_SAMPLES = 8  # count of samples of the law between two of these, by which it is integrated
_USED_PART = 0.995  # part of the limits that the law uses, because the averaged one overshoots [1]
_UNLIMITED = 1e6  # limit of axes that have none; the solver accepts no infinity

# Slowing a motion down for the motors: count of tries, and the factor beyond the limit that ends them.
_TRIES = 6
_ENOUGH = 1 + 1e-9
# Count of tries if torques of motors fall with their speed. A step by the square root of the excess is exact for
# torques of inertia, but takes away only half of the excess there.
_TRIES_WITH_LINES = 24


class _Law(NamedTuple):
    """A sampled law.

    Attributes:
        times: times of the samples, shape (k,) [s].
        parts: part of the path at these times, from 0 to 1, shape (k,).
    """

    times: Vector
    parts: Vector


class FastestMotion(NamedTuple):
    """A motion along a path in the least time.

    Attributes:
        stretch: the motion, from rest to rest.
        passes: times at which it passes the targets, shape (k,) [s].
    """

    stretch: Stretch
    passes: Vector


class _RobotMotion(NamedTuple):
    """Motion of one of several robots, sampled at m times.

    Attributes:
        robot: the robot.
        dynamics: its equation of motion.
        positions: positions of its n axes, shape (m, n) [rad or m].
        velocities: velocities, shape (m, n) [rad/s or m/s].
        accelerations: accelerations, shape (m, n) [rad/s² or m/s²].
    """

    robot: StationRobot
    dynamics: Dynamics
    positions: Vector
    velocities: Vector
    accelerations: Vector

    def torque_excess(self, factor: float) -> float:
        """Largest ratio of a torque to what its motor can give if the motion takes `factor` times as long [1].

        It is at most 1 if the motors can follow.
        """
        velocities = self.velocities / factor
        torques = self.dynamics.inverse_dynamics(
            self.positions, velocities, self.accelerations / factor**2
        )
        return float(self.robot.gains.torque_shares(torques, velocities).max())


@dataclass(frozen=True, eq=False)
class Motors:
    """Motors of robots that move at the same time, with what these robots carry.

    Attributes:
        model: the station, with free pieces fixed where they begin: what fingers hold has no weight here.
        robots: names of the robots that move. Arrays of this class have their axes one robot after the other.
    """

    model: StationModel
    robots: Sequence[str]

    @property
    def station_robots(self) -> list[StationRobot]:
        """The robots that move, with their motors and limits in the station."""
        return [self.model.robots[robot] for robot in self.robots]

    def fastest(self, segment: Segment, speed: float | None) -> FastestMotion:
        """Compute the fastest motion along a path, from rest to rest.

        Args:
            segment: the path of all robots.
            speed: largest speed of their tools [m/s]. If it is None, they have no limit.

        Raises:
            InvalidParameter: the motors could not even hold the robots on the path.
        """
        # The path as a spline, the averaged law on it, the motion that results, and its slowdown for the motors.
        path = free_spline(segment.parts, segment.postures)
        law = _average(self._jumping_law(path, len(segment.parts), speed))
        stretch = Stretch(law.times, path(law.parts))
        factor = self._needed_slowdown(stretch)
        # The targets are at the parts `passes` of the path: the law gives the time at each of them.
        passes = factor * np.interp(segment.passes, law.parts, law.times)
        return FastestMotion(stretch.at(0.0, factor), passes)

    def _jumping_law(self, path: BSpline, points: int, speed: float | None) -> Trajectory:
        """Compute the fastest law along a path, with accelerations that jump.

        Args:
            path: postures of all robots as a function of the part of the path.
            points: count of points of the path, which determines how many intervals are checked.
            speed: largest speed of the tools [m/s], or None.

        Raises:
            InvalidParameter: the motors could not even hold the robots on the path.
        """
        plant = self.model.plant
        robots = self.station_robots
        # Limits and control points of the spline for all positions of the plant, also of robots that do not move. All
        # joints have one position and one velocity, because pieces that move freely are fixed in this model.
        speeds = np.full(plant.num_velocities(), _UNLIMITED)
        accelerations = np.full(plant.num_velocities(), _UNLIMITED)
        torques = np.full(plant.num_velocities(), _UNLIMITED)
        control_points = np.tile(plant.GetPositions(self.model.context), (len(path.c), 1))
        first_axis = 0
        for robot in robots:
            axes = slice(first_axis, first_axis + len(robot.axes))
            indices = robot.axis_map.velocity_places  # indices of the robot's axes in the plant
            control_points = robot.axis_map.spread_positions(path.c[:, axes], control_points)
            speeds[indices] = _USED_PART * robot.speed_limits
            accelerations[indices] = np.minimum(_USED_PART * robot.model.accelerations, _UNLIMITED)
            # Friction takes its part of the torque; the plant of the solver has none. Passive axes have no motor, and
            # so no limit here.
            left_torques = np.minimum(
                _USED_PART * (robot.gains.limit_at_rest - robot.model.friction), _UNLIMITED
            )
            torques[indices] = np.where(robot.gains.passive, _UNLIMITED, left_torques)
            first_axis = axes.stop
        # The spline of SciPy, with degree k, knots t and control points c, as one of Drake.
        basis = BsplineBasis(path.k + 1, path.t.tolist())
        trajectory = BsplineTrajectory(basis, list(control_points[:, :, np.newaxis]))
        interval_count = int(np.clip(points, _LEAST_GRID, _MOST_GRID))
        problem = Toppra(trajectory, plant, np.linspace(0.0, 1.0, interval_count + 1))
        problem.AddJointVelocityLimit(-speeds, speeds)
        problem.AddJointAccelerationLimit(-accelerations, accelerations)
        problem.AddJointTorqueLimit(-torques, torques)
        if speed is not None:
            for robot in robots:
                problem.AddFrameTranslationalSpeedLimit(robot.tools[robot.tcp], speed)
        law = problem.SolvePathParameterization()
        if law is None:
            raise InvalidParameter(
                "profile",
                "time_optimal",
                message(
                    "programs.motors_cannot_hold",
                    "another profile: the motors cannot hold the robot on this path",
                ),
            )
        return law

    def _needed_slowdown(self, stretch: Stretch) -> float:
        """Compute the factor, at least 1, by which a motion has to take longer so that the motors can follow.

        Limits of speed and acceleration count, too. If not even the largest count of tries reaches the torque limits,
        the factor of the last try is returned.

        Args:
            stretch: the motion of all robots.
        """
        # A plan of all robots together, under the name of the first: it samples the motion at the times of checks.
        plan = Plan(self.robots[0], (stretch,), stretch.times[-1:], len(stretch.times))
        positions, velocities, accelerations = plan.motion(plan.looks)
        factor = 1.0
        motions = list[_RobotMotion]()
        first_axis = 0
        for name in self.robots:
            robot = self.model.robots[name]
            axes = slice(first_axis, first_axis + len(robot.axes))
            first_axis = axes.stop
            motion = _RobotMotion(
                robot,
                self.model.dynamics(name),
                positions[:, axes],
                velocities[:, axes],
                accelerations[:, axes],
            )
            # Speeds fall with the factor, accelerations with its square. Without a limit the ratio is 0.
            factor = max(factor, np.abs(motion.velocities / robot.speed_limits).max())
            factor = max(
                factor, np.sqrt(np.abs(motion.accelerations / robot.model.accelerations).max())
            )
            motions.append(motion)
        # The torque has parts that do not fall with the factor, such as gravity: the excess is reduced step by step.
        # A line is the torque of a motor as a function of its speed.
        has_lines = any(motion.robot.gains.line is not None for motion in motions)
        for _ in range(_TRIES_WITH_LINES if has_lines else _TRIES):
            excess = max(motion.torque_excess(factor) for motion in motions)
            if excess <= 1.0:
                break
            factor *= max(np.sqrt(excess), 1.0) * _ENOUGH
        return float(factor)


def _average(law: Trajectory) -> _Law:
    r"""Replace each value of a law by its mean over a short time.

    The mean at time t is :math:`\frac{1}{T} \int_{t-T}^{t} s(\tau)\,d\tau`, so that the law takes T longer. T is
    `_MEAN_TIME`, or less for a short law.

    Args:
        law: the law, from 0 to 1, as a function of time with a single value.
    """
    end_time = law.end_time()
    mean_time = min(_MEAN_TIME, _LARGEST_MEAN * end_time)
    step = mean_time / (_SAMPLES * _FINE_SAMPLES)
    # The law is sampled finely, from T before it begins. The robots rest before and after it.
    fine_times = np.arange(-mean_time, end_time + mean_time + step, step)
    values = law.vector_values(np.clip(fine_times, 0.0, end_time).tolist())[0]
    # Integral of the law up to each fine time: each sample counts until the next one.
    integral = np.append(0.0, np.cumsum(values)) * step
    integral_times = np.append(fine_times, fine_times[-1] + step)
    # The averaged law has a sample for every `_FINE_SAMPLES` of these. Its mean is a difference of two integrals.
    duration = end_time + mean_time
    count = int(np.ceil(duration / (_FINE_SAMPLES * step))) + 1
    times = np.linspace(0.0, duration, count)
    until_now = np.interp(times, integral_times, integral)
    until_before = np.interp(times - mean_time, integral_times, integral)
    parts = (until_now - until_before) / mean_time
    # The sums are not exact: scale the parts so that they begin at 0 and end at 1.
    return _Law(times, np.clip((parts - parts[0]) / (parts[-1] - parts[0]), 0.0, 1.0))
