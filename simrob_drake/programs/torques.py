"""Torques of a planned move against what the motors of its robots give, before anything moves."""

import warnings
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from simrob_drake.frames import Vector
from simrob_drake.programs.errors import TorqueLimitExceeded
from simrob_drake.programs.plan import Plan, Remedy
from simrob_drake.programs.time_optimal import Motors

_FULL = 1.0 + 1e-6  # share of a limit up to which a motor gives a torque, rounding included
_ENOUGH = 1.02  # margin of the times that are proposed or taken
_TRIES = 8  # times at most that a move is slowed down; each try comes nearer to the limits


class TorqueShortage(UserWarning):
    """A move in a given time needs more torque than a motor gives, so that the robot lags behind."""


def slowed_for_motors(motors: Motors, plan: Plan) -> Plan:
    """Slow a plan of one or more robots down until their motors give its torques.

    A plan whose robots cannot even be held is returned as it is: `check_torques` refuses it.

    Args:
        motors: of the robots that move together, in the order of the plan's axes.
        plan: whose time is free.
    """
    if motors.model.config.mode == "kinematic" or _needs_too_much(motors, plan, 0.0):
        return plan
    factor = 1.0
    for _ in range(_TRIES):
        share = _largest_share(motors, plan, 1.0 / factor)
        if share <= _FULL:
            break
        # Torques of motion fall with the square of the time; what gravity takes does not, hence several tries.
        factor *= _ENOUGH * np.sqrt(share)
    return plan if factor == 1.0 else slower(plan, factor)


def slower(plan: Plan, factor: float) -> Plan:
    """A plan in ``factor`` times its time, along the same way."""
    stretches = tuple(stretch.at(0.0, factor) for stretch in plan.stretches)
    return replace(plan, stretches=stretches, arrivals=plan.arrivals * factor)


def check_torques(motors: Motors, robot: str, plan: Plan, remedy: Remedy) -> None:
    """Compare the torques of a plan of one robot with the limits of its motors.

    Raises:
        TorqueLimitExceeded: the motors could not even hold the robot on its way.

    Warns:
        TorqueShortage: the move in its given time needs more torque than a motor gives.
    """
    if motors.model.config.mode == "kinematic":
        return
    own = motors.model.robots[robot]
    looks = plan.looks
    limits = own.gains.torque_limit
    for speed in (0.0, 1.0):
        torques = _torques(motors, robot, plan, speed)
        shares = np.abs(torques) / limits
        row, axis = np.unravel_index(int(shares.argmax()), shares.shape)
        if shares[row, axis] <= _FULL:
            continue
        unit = own.model.effort_units[axis]
        needed = f"{abs(torques[row, axis]):.4g} {unit}"
        maximum = f"the limit of its motor is {limits[axis]:.4g} {unit}"
        time = float(looks[row])
        number, name = plan.named(time)
        if speed == 0.0:
            raise TorqueLimitExceeded(
                name,
                own.axes[axis],
                point=number,
                time=time,
                torque=float(torques[row, axis]),
                shown=f"{needed} to hold still there, and {maximum}; raise servo.torque_limit or lighten the load",
            )
        factor = slower_factor(motors, plan)
        advice = remedy(factor, factor * plan.duration)
        text = f"{name}: {own.axes[axis]} would need {needed} at {time:.2f} s, and {maximum}, so that it lags behind"
        warnings.warn(f"{text}; {advice}", TorqueShortage, stacklevel=2)


def slower_factor(motors: Motors, plan: Plan) -> float:
    """How many times longer a plan would have to take for the motors to give its torques."""
    return slowed_for_motors(motors, plan).duration / plan.duration


def _needs_too_much(motors: Motors, plan: Plan, speed: float) -> bool:
    """Whether a plan at a part of its speed needs more torque than motors give."""
    return _largest_share(motors, plan, speed) > _FULL


def _largest_share(motors: Motors, plan: Plan, speed: float) -> float:
    """Largest ratio of a torque to its motor's limit, over all robots of a plan at a part of its speed."""
    largest, begin = 0.0, 0
    for robot in motors.robots:
        own = motors.model.robots[robot]
        axes = slice(begin, begin + len(own.axes))
        begin = axes.stop
        part = plan if len(motors.robots) == 1 else plan.of_axes(robot, axes)
        torques = _torques(motors, robot, part, speed)
        largest = max(largest, float((np.abs(torques) / own.gains.torque_limit).max()))
    return largest


def _torques(motors: Motors, robot: str, plan: Plan, speed: float) -> Vector:
    """Torques (k, n) [N·m or N] at the looks of a plan of one robot, run at a part of its speed; fingers have none.

    Fingers press on what they hold, which no plan knows.
    """
    q, v, a = plan.motion(plan.looks)
    dynamics = motors.model.dynamics(robot)
    inverse: Callable[..., Vector] = dynamics.inverse_dynamics
    torques = dynamics.gravity(q) if speed == 0.0 else inverse(q, speed * v, speed**2 * a)
    torques[:, list(motors.model.robots[robot].model.fingers)] = 0.0
    return torques
