"""Torques of a planned move against what the motors of its robots give, before anything moves.

A plan is a motion of one robot, or of several that move together. At a fraction s of its speed, its torques are those
of gravity plus s² times those of the motion; at s = 0 the robots are held still along the path. A *share* is a torque
over the largest torque that the motor can give; the motor may give less the faster it turns (its *line*).
"""

import warnings
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import compound, message
from simrob_drake.programs.errors import TorqueLimitExceeded
from simrob_drake.programs.plan import MARGIN, Plan, Remedy
from simrob_drake.programs.time_optimal import Motors

_FULL = 1.0 + 1e-6  # share of its limit up to which a motor gives a torque, rounding included
# Largest count of steps in which a move is slowed down; each step comes nearer to the limits.
_MOST_TRIES = 8


class TorqueShortage(UserWarning):
    """A move in a given time needs more torque than a motor gives, so that the robot lags behind."""


def slowed_for_motors(motors: Motors, plan: Plan) -> Plan:
    """Slow a plan of one or more robots down until their motors give its torques.

    The plan is returned as it is if it is not too fast, if the station is kinematic, so that no motor is simulated, or
    if the motors could not even hold the robots along the path: then `check_torques` refuses the plan. After the
    largest count of tries, the plan may still need a little more than the motors give.

    Args:
        motors: motors of the robots that move together, in the order of the plan's axes.
        plan: plan whose duration is not fixed by the user.
    """
    if not motors.model.config.engine.moves_by_forces or _needs_too_much(motors, plan, speed=0.0):
        return plan
    factor = 1.0
    for _ in range(_MOST_TRIES):
        share = _largest_share(motors, plan, speed=1.0 / factor)
        if share <= _FULL:
            break
        # Torques of the motion fall with the square of the duration, but those of gravity stay. So one step with the
        # square root does not suffice.
        factor *= MARGIN * np.sqrt(share)
    return plan if factor == 1.0 else slower(plan, factor)


def slower(plan: Plan, factor: float) -> Plan:
    """Make a copy of a plan along the same path that takes ``factor`` times as long."""
    stretches = tuple(stretch.at(0.0, factor) for stretch in plan.stretches)
    return replace(plan, stretches=stretches, arrivals=plan.arrivals * factor)


def check_torques(motors: Motors, robot: str, plan: Plan, remedy: Remedy) -> None:
    """Compare the torques of a plan of one robot with the limits of its motors.

    A kinematic station, which has no motors, is not checked.

    Args:
        motors: motors of the robot.
        robot: the robot's name.
        plan: the plan.
        remedy: writes the advice of the warning for a slower move.

    Raises:
        TorqueLimitExceeded: the motors cannot even hold the robot still somewhere along the path.

    Warns:
        TorqueShortage: the move in its given time needs more torque than a motor gives.
    """
    if not motors.model.config.engine.moves_by_forces:
        return
    station_robot = motors.model.robots[robot]
    limits = station_robot.gains.limit_at_rest  # of each motor [N·m or N]
    # First the torques that hold the robot still, then those of the motion.
    for speed in (0.0, 1.0):
        torques, speeds, shares = _loads(motors, robot, plan, speed)
        # The time and the axis of the largest share.
        row, axis = np.unravel_index(int(shares.argmax()), shares.shape)
        if shares[row, axis] <= _FULL:
            continue
        unit = station_robot.model.effort_units[axis]
        needed = compound("{torques:.4g} {unit}", torques=abs(torques[row, axis]), unit=unit)
        maximum = message(
            "programs.limit_of_motor",
            "the limit of its motor is {limit:.4g} {unit}",
            limit=limits[axis],
            unit=unit,
        )
        # Limits at the speeds of the axes at this time: the lower ones for negative torques, else the upper ones.
        if station_robot.gains.line is not None:
            at_speed = np.where(
                torques[row] < 0.0,
                *station_robot.gains.line.bounds(speeds[row], station_robot.gains.torque_limit),
            )
            maximum += message(
                "programs.limit_at_speed",
                ", {torque:.4g} {unit} at its speed there",
                torque=abs(at_speed[axis]),
                unit=unit,
            )
        time = float(plan.looks[row])  # `_loads` has one row for each of these times
        point = plan.point_at(time)
        if speed == 0.0:
            raise TorqueLimitExceeded(
                point.name,
                station_robot.axes[axis],
                point=point.number,
                time=time,
                torque=float(torques[row, axis]),
                shown=message(
                    "programs.needed_to_hold",
                    "{needed} to stay at rest there, and {maximum}; raise servo.torque_limit or reduce the load",
                    needed=needed,
                    maximum=maximum,
                ),
            )
        # The motion itself is possible, only not in the time that the user wants: a warning is enough.
        factor = slower_factor(motors, plan)
        advice = remedy(factor, factor * plan.duration)
        subject = compound("{point}: {axes}", point=point.name, axes=station_robot.axes[axis])
        text = message(
            "programs.would_lag_behind",
            "{subject} would need {needed} at {time:.2f} s, and {maximum}, so that it lags behind",
            subject=subject,
            needed=needed,
            time=time,
            maximum=maximum,
        )
        warnings.warn(
            compound("{text}; {advice}", text=text, advice=advice), TorqueShortage, stacklevel=2
        )


def slower_factor(motors: Motors, plan: Plan) -> float:
    """Factor on the duration of a plan by which :func:`slowed_for_motors` slows it down; 1 if it leaves it as it is."""
    return slowed_for_motors(motors, plan).duration / plan.duration


def _needs_too_much(motors: Motors, plan: Plan, speed: float) -> bool:
    """Whether a plan, run at a fraction of its speed, needs more torque than the motors of its robots give."""
    return _largest_share(motors, plan, speed) > _FULL


def _largest_share(motors: Motors, plan: Plan, speed: float) -> float:
    """Largest share of what a motor can give, over all robots of a plan that is run at a fraction of its speed.

    Args:
        motors: motors of the robots that move together, in the order of the plan's axes.
        plan: the plan.
        speed: fraction of the plan's speed, from 0 to 1.
    """
    largest = 0.0
    first_axis = 0  # index of the robot's first axis among the axes of the plan
    for robot in motors.robots:
        station_robot = motors.model.robots[robot]
        axes = slice(first_axis, first_axis + len(station_robot.axes))
        first_axis = axes.stop
        own_plan = plan if len(motors.robots) == 1 else plan.of_axes(robot, axes)
        largest = max(largest, float(_loads(motors, robot, own_plan, speed).shares.max()))
    return largest


class _Loads(NamedTuple):
    """Loads of the motors of one robot at k times of a plan, each of shape (k, n)."""

    torques: Vector  # [N·m or N]
    speeds: Vector  # [rad/s or m/s]
    shares: Vector  # torques as shares of what the motors can give at these speeds


def _loads(motors: Motors, robot: str, plan: Plan, speed: float) -> _Loads:
    """Loads of the motors of one robot, at the times `plan.looks` of its plan that is run at a fraction of its speed.

    The torques and shares of fingers are 0: fingers press on what they hold, with a force that no plan determines.

    Args:
        motors: motors of the robot, perhaps among those of others.
        robot: name of the robot.
        plan: plan of this robot alone.
        speed: fraction of the plan's speed, from 0 to 1.
    """
    motion = plan.motion(plan.looks)
    dynamics = motors.model.dynamics(robot)
    inverse_dynamics: Callable[..., Vector] = dynamics.inverse_dynamics
    # At a fraction s of its speed, the motion has velocities s v and accelerations s² a.
    speeds = speed * motion.velocities
    if speed == 0.0:
        torques = dynamics.gravity(motion.positions)
    else:
        torques = inverse_dynamics(motion.positions, speeds, speed**2 * motion.accelerations)
    station_robot = motors.model.robots[robot]
    fingers = list(station_robot.model.fingers)  # indices of axes
    torques[:, fingers] = 0.0
    shares = station_robot.gains.torque_shares(torques, speeds)
    shares[:, fingers] = 0.0
    return _Loads(torques, speeds, shares)
