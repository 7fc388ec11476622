"""First servo gains for a robot of which nothing but the URDF is known."""

import math
from dataclasses import dataclass

import numpy as np

from simrob_drake.constants import STANDARD_GRAVITY
from simrob_drake.frames import Vector
from simrob_drake.robots.catalog import RobotModel
from simrob_drake.robots.parse import lone_robot

_FREQUENCY = 30.0  # rad/s; an arm of 0.8 kg m² gets the 700 N·m/rad that are usual for it
_SAG = math.radians(1.0)  # what a joint may give way under gravity [rad]
_POSTURES = 20


@dataclass(frozen=True)
class FirstGains:
    """Proportional [N·m/rad] and derivative [N·m·s/rad] gain of every axis, each of shape (n,)."""

    kp: Vector
    kd: Vector


def first_gains(robot: RobotModel) -> FirstGains:
    """Return gains that hold a robot up and move it without overshoot; every link of it that moves has an inertia.

    With M the largest diagonal element of the mass matrix over some postures, and τ the largest torque of gravity,
    kp = max(ω² M, τ / 1 deg) with ω = 30 rad/s, and kd = 2 √(kp M), which damps the joint critically. A robot that is
    not fixed stands on some of its joints, so that each may feel the whole mass at half of the robot's height.
    """
    inertias, torques = _inertias_and_torques(robot)
    kp = np.maximum(_FREQUENCY**2 * inertias, torques / _SAG)
    kd = 2 * np.sqrt(kp * inertias)
    return FirstGains(_rounded(kp), _rounded(kd))


def _inertias_and_torques(robot: RobotModel) -> tuple[Vector, Vector]:
    """Return the largest inertia [kg m²] and the largest torque of gravity [N·m] that every axis meets."""
    lone = lone_robot(robot, floating=robot.base == "floating", collision=False)
    plant, context = lone.plant, lone.plant.CreateDefaultContext()
    lower, upper = (np.clip(limit, -np.pi, np.pi) for limit in robot.axis_limits)
    random = np.random.default_rng(0)
    inertias, torques = np.zeros(len(lone.joints)), np.zeros(len(lone.joints))
    for posture in (robot.home, *random.uniform(lower, upper, (_POSTURES, len(lone.joints)))):
        lone.axes.set_positions(plant, context, posture)
        inertias = np.maximum(inertias, np.diag(plant.CalcMassMatrix(context))[lone.axes.velocity_places])
        torques = np.maximum(torques, np.abs(lone.axes.efforts(plant.CalcGravityGeneralizedForces(context))))
    if robot.base == "floating":
        mass, half = plant.CalcTotalMass(context), lone.size / 2
        inertias, torques = np.maximum(inertias, mass * half**2), np.maximum(torques, mass * STANDARD_GRAVITY * half)
    return inertias, torques


def _rounded(values: Vector) -> Vector:
    """Return two significant digits of positive numbers, and no zeros."""
    return np.array([float(f"{max(value, 1e-3):.2g}") for value in values])
