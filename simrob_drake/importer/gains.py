"""First servo gains for a robot of which nothing but the URDF is known."""

import math
from dataclasses import dataclass

import numpy as np

from simrob_drake.constants import STANDARD_GRAVITY
from simrob_drake.frames import Vector
from simrob_drake.robots.catalog import RobotModel
from simrob_drake.robots.parse import lone_robot

_FREQUENCY = 30.0  # rad/s; an arm of 0.8 kg m² gets the 700 N·m/rad that are usual for it
_SAG = math.radians(1.0), 1e-3  # what an axis may give way under gravity [rad], and one that slides [m]
_LIGHTEST = 1e-9  # a milligram at an arm of 30 mm: what files say below that was rounded [kg m² or kg]
_POSTURES = 20


@dataclass(frozen=True)
class FirstGains:
    """Proportional [N·m/rad] and derivative [N·m·s/rad] gain of every axis, each of shape (n,)."""

    kp: Vector
    kd: Vector


def gains_of(robot: RobotModel) -> FirstGains:
    """Return the gains that a robot brings along if it does, else first ones."""
    kp, kd = robot.servo.kp, robot.servo.kd
    if kp is None or kd is None:
        return first_gains(robot)
    return FirstGains(robot.axis_vector(kp, "servo.kp"), robot.axis_vector(kd, "servo.kd"))


def first_gains(robot: RobotModel) -> FirstGains:
    """Return gains that hold a robot up and move it without overshoot; every link of it that moves has an inertia.

    With m the largest inertia that an axis meets over some postures, all others at rest, τ the largest torque of
    gravity and b the damping of its joint, kp = max(ω² m, ω b, τ / sag) with ω = 30 rad/s and a sag of 1 deg or 1 mm.
    Axes pull at each other: where all had the same kp / m, the modes of the mass matrix M would be those of
    diag(m)^-½ M diag(m)^-½, and the largest of its eigenvalues λ the one that swings most. kd = 2 √(λ kp m) damps it
    critically.

    A robot that is not fixed stands on some of its joints, so that each may feel the whole mass at half of the robot's
    height.
    """
    load = _load(robot)
    stiffness = load.torques / np.where(robot.prismatic, _SAG[1], _SAG[0])
    kp = np.maximum(stiffness, _FREQUENCY * np.maximum(_FREQUENCY * load.inertias, load.dampings))
    kd = 2 * np.sqrt(load.coupling * kp * load.inertias)
    return FirstGains(_rounded(kp), _rounded(kd))


@dataclass(frozen=True)
class _Load:
    """What n axes have to move and to hold, each of shape (n,): the largest of some postures."""

    inertias: Vector  # all other axes at rest [kg m² or kg], positive
    torques: Vector  # of gravity [N·m or N]
    dampings: Vector  # of the joints themselves [N·m·s/rad or N·s/m]
    coupling: float  # the largest eigenvalue of the mass matrix, scaled by the inertias; 1 where nothing is coupled


def _load(robot: RobotModel) -> _Load:
    lone = lone_robot(robot, floating=robot.base == "floating", collision=False)
    plant, context, places = lone.plant, lone.plant.CreateDefaultContext(), lone.axes.velocity_places
    lower, upper = (np.clip(limit, -np.pi, np.pi) for limit in robot.axis_limits)
    random = np.random.default_rng(0)
    masses, torques = [], np.zeros(len(lone.joints))
    for posture in (robot.home, *random.uniform(lower, upper, (_POSTURES, len(lone.joints)))):
        lone.axes.set_positions(plant, context, posture)
        masses.append(plant.CalcMassMatrix(context)[np.ix_(places, places)])
        torques = np.maximum(torques, np.abs(lone.axes.efforts(plant.CalcGravityGeneralizedForces(context))))
    inertias = np.maximum(np.max([np.diag(mass) for mass in masses], axis=0), _LIGHTEST)
    if robot.base == "floating":
        mass, half = plant.CalcTotalMass(context), lone.size / 2
        inertias, torques = np.maximum(inertias, mass * half**2), np.maximum(torques, mass * STANDARD_GRAVITY * half)
    scale = np.sqrt(np.outer(inertias, inertias))
    coupling = max(float(np.linalg.eigvalsh(mass / scale)[-1]) for mass in masses)
    dampings = np.array([joint.default_damping_vector()[0] for joint in lone.joints])
    return _Load(inertias, torques, dampings, max(coupling, 1.0))


def _rounded(values: Vector) -> Vector:
    """Return two significant digits of positive numbers."""
    return np.array([float(f"{value:.2g}") for value in values])
