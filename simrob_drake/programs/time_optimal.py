"""Moves that take as little time as speeds, accelerations and torques of the joints allow (TOPP-RA, Pham & Pham, 2018).

Along a given way the fastest motion has accelerations that jump from one limit to another. Here each is the mean over a
short time, so that it is continuous; then the whole is slowed down as far as the motors ask for it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

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

_GRID = 100, 300  # places on a way where limits hold, at least and at most
_MEAN, _PART = 0.02, 0.125  # s over which accelerations are averaged, but at most this part of the motion
_SAMPLES, _FINE = 8, 8  # of a mean, and of a sample
_FULL = 0.995  # of the limits: what is averaged overshoots
_NONE = 1e6  # what limits nothing
_TRIES, _ENOUGH = 6, 1 + 1e-9
_TRIES_WITH_LINES = 24
"""Largest count of steps in which a motion is slowed down for motors whose torque falls with their speed. A step by the
square root of the excess, as torques of inertia need it, takes away only half of it there."""


@dataclass(frozen=True, eq=False)
class Motors:
    """What the motors of robots that move together can do, with what these carry."""

    model: StationModel  # of the station, with nothing free in it
    robots: Sequence[str]  # that move, in turn

    @property
    def station_robots(self) -> list[StationRobot]:
        """The robots that move, in turn, with their motors and limits in the station."""
        return [self.model.robots[robot] for robot in self.robots]

    def fastest(self, segment: Segment, speed: float | None) -> tuple[Stretch, Vector]:
        """Return the motion along a segment of all robots from rest to rest, and when it passes its targets, (k,) [s].

        Their tools are no faster than ``speed`` [m/s]. Raises InvalidParameter: a way where motors could not even hold
        them.
        """
        way = free_spline(segment.parts, segment.postures)
        times, parts = _averaged(self._law(way, len(segment.parts), speed))
        stretch = Stretch(times, way(parts))
        factor = self._slower(stretch)
        return stretch.at(0.0, factor), factor * np.interp(segment.passes, parts, times)

    def _law(self, way: BSpline, points: int, speed: float | None) -> Trajectory:
        """Return how far along a way the robots are over time, from 0 to 1, with accelerations that jump."""
        plant, own = self.model.plant, [self.model.robots[robot] for robot in self.robots]
        control, begin = np.tile(plant.GetPositions(self.model.context), (len(way.c), 1)), 0
        speeds, pushes, torques = (np.full(plant.num_velocities(), _NONE) for _ in range(3))
        for robot in own:
            axes, places = slice(begin, begin + len(robot.axes)), robot.axis_map.velocity_places
            control = robot.axis_map.spread_positions(way.c[:, axes], control)
            speeds[places] = _FULL * robot.speed_limits
            pushes[places] = np.minimum(_FULL * robot.model.accelerations, _NONE)
            most = np.minimum(_FULL * (robot.gains.limit_at_rest - robot.model.friction), _NONE)
            torques[places] = np.where(robot.gains.passive, _NONE, most)
            begin = axes.stop
        path = BsplineTrajectory(BsplineBasis(way.k + 1, way.t.tolist()), list(control[:, :, np.newaxis]))
        problem = Toppra(path, plant, np.linspace(0.0, 1.0, int(np.clip(points, *_GRID)) + 1))
        problem.AddJointVelocityLimit(-speeds, speeds)
        problem.AddJointAccelerationLimit(-pushes, pushes)
        problem.AddJointTorqueLimit(-torques, torques)
        for robot in own if speed is not None else ():
            problem.AddFrameTranslationalSpeedLimit(robot.tools[robot.tcp], speed)
        found = problem.SolvePathParameterization()
        if found is None:
            raise InvalidParameter(
                "profile",
                "time_optimal",
                message("programs.motors_cannot_hold", "another one: the motors cannot hold the robot on this way"),
            )
        return found

    def _slower(self, stretch: Stretch) -> float:
        """Return in how many times its time the motors can do a motion."""
        plan = Plan(self.robots[0], (stretch,), stretch.times[-1:], len(stretch.times))
        factor, begin, parts = 1.0, 0, list[tuple[StationRobot, Dynamics, Vector, Vector, Vector]]()
        for name in self.robots:
            robot = self.model.robots[name]
            axes = slice(begin, begin := begin + len(robot.axes))
            q, v, a = (rows[:, axes] for rows in plan.motion(plan.looks))
            factor = max(factor, np.abs(v / robot.speed_limits).max())
            factor = max(factor, np.sqrt(np.abs(a / robot.model.accelerations).max()))
            parts.append((robot, self.model.dynamics(name), q, v, a))
        has_lines = any(robot.gains.line is not None for robot, *_ in parts)
        for _ in range(_TRIES_WITH_LINES if has_lines else _TRIES):
            shares = [
                robot.gains.torque_shares(dynamics.inverse_dynamics(q, v / factor, a / factor**2), v / factor).max()
                for robot, dynamics, q, v, a in parts
            ]
            if max(shares) <= 1.0:
                break
            factor *= max(np.sqrt(max(shares)), 1.0) * _ENOUGH
        return float(factor)


def _averaged(law: Trajectory) -> tuple[Vector, Vector]:
    """Return times (k,) [s] and the parts of a way then, of a law whose value is its mean over a short time."""
    whole = law.end_time()
    mean = min(_MEAN, _PART * whole)
    step = mean / (_SAMPLES * _FINE)
    fine = np.arange(-mean, whole + mean + step, step)  # at rest before and after
    gone = np.append(0.0, np.cumsum(law.vector_values(np.clip(fine, 0.0, whole).tolist())[0])) * step
    times = np.linspace(0.0, whole + mean, int(np.ceil((whole + mean) / (_SAMPLES * step))) + 1)
    until = np.append(fine, fine[-1] + step)
    parts = (np.interp(times, until, gone) - np.interp(times - mean, until, gone)) / mean
    return times, np.clip((parts - parts[0]) / (parts[-1] - parts[0]), 0.0, 1.0)
