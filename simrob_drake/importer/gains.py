"""First servo gains of a robot, computed from its masses, for robots whose files contain no gains."""

import math
from dataclasses import dataclass

import numpy as np

from simrob_drake.base.constants import LARGEST_GAIN, STANDARD_GRAVITY
from simrob_drake.base.frames import Vector
from simrob_drake.robots.catalog import RobotModel
from simrob_drake.robots.parse import lone_robot

# The inertia of 0.8 kg m² at the first axes of a small arm then gets the usual gain of about 700 N·m/rad.
_FREQUENCY = 30.0
"""Natural frequency of an axis with its first gains [rad/s]."""

_SAG_REVOLUTE = math.radians(1.0)
"""Largest error of position that gravity may cause at a revolute axis [rad]."""

_SAG_PRISMATIC = 1e-3
"""Largest error of position that gravity may cause at a prismatic axis [m]."""

# Gains for the masses of the arm alone would be too small for the pieces that the fingers will carry.
_FULL_EFFORT_ERROR = math.radians(30.0)
"""Error of position at which the motors of an arm with fingers give their largest effort [rad]."""

_PRESSING_PART = 0.1
"""Part of a finger's travel before its closed position at which its motor gives its largest effort [1]."""

# Smaller values in files are rounded zeros. Inertias must be positive, because they scale the mass matrix.
_LEAST_INERTIA = 1e-9
"""Least inertia of an axis [kg m² or kg]: that of a milligram at an arm of 30 mm."""

_POSTURE_COUNT = 20
"""Count of random postures over which the largest load is sought, in addition to the home posture."""


@dataclass(frozen=True)
class FirstGains:
    """Gains of the servos of n axes, each of shape (n,).

    Attributes:
        kp: proportional gains [N·m/rad or N/m].
        kd: derivative gains [N·m·s/rad or N·s/m].
    """

    kp: Vector
    kd: Vector


def gains_of(robot: RobotModel) -> FirstGains:
    """Servo gains of a robot: those of its description, or first gains if the description lacks `kp` or `kd`."""
    kp = robot.servo.kp
    kd = robot.servo.kd
    # A kp without its kd, or the reverse, is of no use: each is chosen for the other.
    if kp is None or kd is None:
        return first_gains(robot)
    return FirstGains(robot.axis_vector(kp, "servo.kp"), robot.axis_vector(kd, "servo.kd"))


def first_gains(robot: RobotModel) -> FirstGains:
    r"""Compute gains that hold a robot up and move it without overshoot.

    With the largest inertia m that an axis meets over some postures while all others are at rest, the largest torque τ
    of gravity at the axis, and the damping b of its joint:

    .. math:: k_p = \max(\omega^2 m,\ \omega b,\ \tau / s), \qquad k_d = 2 \sqrt{\lambda k_p m}

    with ω = 30 rad/s and a sag s of 1 deg or 1 mm. The axes are coupled by the mass matrix M. If all axes had the same
    kp / m, the modes of the robot would be the eigenvectors of diag(m)^-½ M diag(m)^-½. The mode of the largest
    eigenvalue λ is damped least, and this kd damps it critically.

    The gains are rounded to two significant digits. Those of passive axes are 0. Two cases need more than the masses:

    - A robot whose base floats stands on some of its joints, and each of them may carry the whole mass, at half of the
      robot's largest extent in its home posture.
    - Motors of fingers give their largest effort a tenth of the travel before the closed position. Those of the
      revolute axes of an arm with fingers, which will carry more than its own masses, give it at an error of 30 deg.

    Args:
        robot: the robot. Every link of it that moves has an inertia.
    """
    load = _find_load(robot)
    stiffness = load.torques / np.where(robot.prismatic, _SAG_PRISMATIC, _SAG_REVOLUTE)
    if robot.fingers:
        for_pieces = np.maximum(stiffness, robot.efforts / _FULL_EFFORT_ERROR)
        stiffness = np.where(robot.prismatic, stiffness, for_pieces)
    for index, (closed, opened) in robot.fingers.items():
        # A piece stops the fingers before they are closed. The error of position then presses them together.
        error = _PRESSING_PART * abs(opened - closed)
        stiffness[index] = max(stiffness[index], robot.efforts[index] / error)

    # Against a damping b, a reference of speed v is followed with the error v b / kp, which is v / ω here.
    # Some files hold a joint by an immense damping, such as 1e11 N·s/m: a servo does not move it with any gain.
    for_damping = np.minimum(_FREQUENCY * load.dampings, LARGEST_GAIN)
    kp = np.maximum(stiffness, np.maximum(_FREQUENCY * (_FREQUENCY * load.inertias), for_damping))
    kd = 2 * np.sqrt(load.coupling * kp * load.inertias)
    return FirstGains(
        kp=np.where(robot.passive, 0.0, _round_to_two_digits(kp)),
        kd=np.where(robot.passive, 0.0, _round_to_two_digits(kd)),
    )


@dataclass(frozen=True)
class _Load:
    """Largest load of n axes over some postures. The vectors have the shape (n,).

    Attributes:
        inertias: inertia that each axis moves if all other axes are at rest [kg m² or kg], positive.
        torques: torque or force of gravity at each axis [N·m or N].
        dampings: viscous damping of the joints themselves [N·m·s/rad or N·s/m].
        coupling: largest eigenvalue of the mass matrix that is scaled by the inertias, at least 1 [1]. It is 1 if no
            axis moves another one.
    """

    inertias: Vector
    torques: Vector
    dampings: Vector
    coupling: float


def _find_load(robot: RobotModel) -> _Load:
    """Find the largest load of a robot's axes, over its home posture and random postures."""
    lone = lone_robot(robot, floating=robot.base == "floating", collision=False)
    plant = lone.plant
    context = plant.CreateDefaultContext()
    axis_count = len(lone.joints)

    # A continuous joint has no limits to draw from. A turn from -π to π contains all of its postures.
    lower, upper = (np.clip(limit, -np.pi, np.pi) for limit in robot.axis_limits)
    # The seed is fixed, so that a robot gets the same gains in each import.
    random = np.random.default_rng(0)
    postures = random.uniform(lower, upper, (_POSTURE_COUNT, axis_count))

    # The rows of the plant's mass matrix are those of its joints, not of the axes. The sense of an axis does not
    # matter: it changes neither the diagonal of the matrix nor its eigenvalues.
    indices = lone.axes.velocity_places
    mass_matrices = []
    torques = np.zeros(axis_count)
    for posture in (robot.home, *postures):
        lone.axes.set_positions(plant, context, posture)
        mass_matrices.append(plant.CalcMassMatrix(context)[np.ix_(indices, indices)])
        gravity = lone.axes.efforts(plant.CalcGravityGeneralizedForces(context))
        torques = np.maximum(torques, np.abs(gravity))
    largest = np.max([np.diag(matrix) for matrix in mass_matrices], axis=0)
    inertias = np.maximum(largest, _LEAST_INERTIA)

    if robot.base == "floating":
        # The mass matrix of a floating robot has the masses beyond each joint only: those of a leg that swings. A
        # leg that stands carries the rest of the robot, as an inverted pendulum of half its height, for which the
        # largest extent along x, y or z is taken.
        mass = plant.CalcTotalMass(context)
        half_size = lone.size / 2
        inertias = np.maximum(inertias, mass * half_size**2)
        torques = np.maximum(torques, mass * STANDARD_GRAVITY * half_size)

    scale = np.sqrt(np.outer(inertias, inertias))
    # Eigenvalues of a symmetric matrix come in ascending order.
    coupling = max(float(np.linalg.eigvalsh(matrix / scale)[-1]) for matrix in mass_matrices)
    dampings = np.array([joint.default_damping_vector()[0] for joint in lone.joints])
    # Inertias above those of the matrices make the eigenvalues small. A single axis still needs its full damping.
    return _Load(inertias, torques, dampings, max(coupling, 1.0))


def _round_to_two_digits(values: Vector) -> Vector:
    """Round gains to two significant digits: they are first values, which a user reads in a file and then tunes."""
    return np.array([float(f"{value:.2g}") for value in values])
