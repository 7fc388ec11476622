r"""How hard things touch: Drake's figures of contact, joint stops and dry friction in those of MuJoCo.

MuJoCo has no springs. It gives a contact pressed in by x the force

.. math:: f = \frac{k\,x + b\,\dot x - a}{R}, \qquad R = \frac{1 - d}{d}\,w

where a is the acceleration that results along it, w the inverse mass that it takes for the pair (``invweight0`` of
the two bodies), d the impedance (``solimp``, here the same at any depth) and ``solref`` = (-k d, -b d). At rest that is
a spring: with :math:`k d = K (1 - d)\, w` it is K, whatever d is. What d adds is inertia, :math:`1/R`: the contact
swings with :math:`\omega^2 = K w (1 - d)`, as on a body heavier by d / (1 - d). So d should be small. The integrator
``discrete`` looks at x and its rate at the end of a step and takes any; the others look at its start and need
:math:`\omega h \le 1/2` for a step h, so

.. math:: 1 - d = \min\Bigl(1 - d_0,\; \frac{1}{4 h^2 K w}\Bigr).

``discrete`` takes for w what the pair feels in the posture while the servos hold, and R accordingly,

.. math:: R = \frac{(1 - d)\, w}{d + h\, b\, d + h^2 k\, d}:

so w is read off R where the station begins, and the stiffness is right there.

Damping is a ratio :math:`\zeta` of the critical one, :math:`b d = 2 \zeta \omega`. Hunt and Crossley's
law :math:`f = k x (1 + D \dot x)` of Drake has none, but takes, to first order in D, as much of an impact of a mass
1/w at speed v under its weight as that with

.. math:: \zeta = \tfrac12 D A \omega \Bigl(\sin\varphi + \frac{4 \cos^3\varphi}{3 (\pi + 2 \varphi + \sin 2 \varphi)}
    \Bigr), \qquad A \omega = \sqrt{v^2 + g^2/\omega^2}, \quad \tan\varphi = \frac{g}{v \omega}, \quad \omega^2 = K w:

while :math:`x = A (\sin\theta + \sin\varphi)` is positive, :math:`\int k x D \dot x^2 dt` is what the one takes and
:math:`2 \zeta \sqrt{k/w} \int \dot x^2 dt` the other. Without weight it is :math:`\zeta = 2 D v / (3 \pi)`; at rest
the law's own slope at the depth g/ω². A ratio above 1 counts as 1: nothing bounces.

Friction creeps in MuJoCo, too: it is :math:`b_t v / R_t` up to Coulomb's limit, with :math:`R_t` = R/``impratio``.
Here :math:`b_t d = d / h` and ``impratio`` = 1/d, so that a load f slides with about f w h: what it gains within a
step.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from pydrake.geometry import GeometryId, ProximityProperties
from pydrake.multibody.plant import CalcContactFrictionFromSurfaceProperties, CoulombFriction

from simrob_drake.parts.site import StationPlant
from simrob_drake.stations.mujoco.tree import touching_pairs

LEAST_IMPEDANCE = 1e-4
"""d_0: MuJoCo knows no smaller one; a contact has then a ten-thousandth of the inertia of what touches."""
LARGEST_IMPEDANCE = 0.9999
FOOT_SPEED = 0.1
"""At which feet and tools come down, and so the v of damping where nothing falls from higher [m/s]."""
_STEPS_A_SWING = 2.0
_TINY = 1e-12


@dataclass(frozen=True)
class TouchingPair:
    """What two surfaces are together: stiffness [N/m], Hunt and Crossley's D [s/m], coefficient of friction."""

    stiffness: float
    dissipation: float
    friction: float


@dataclass(frozen=True)
class Softness:
    """MuJoCo's figures of a constraint: ``solref`` and the impedance of ``solimp``."""

    solref: tuple[float, float]
    impedance: float

    @property
    def solimp(self) -> list[float]:
        """The same impedance at any depth."""
        return [self.impedance, self.impedance, 1e-3, 0.5, 2.0]


def softness(stiffness: float, ratio: float, inverse_mass: float, step: float) -> Softness:
    """Return the figures of a spring K [N/m] damped by a ratio, for what has an inverse mass [1/kg].

    The step [s] is that of an integrator that looks at its start, and 0 for ``discrete``.
    """
    free = min(1 - LEAST_IMPEDANCE, 1 / max((_STEPS_A_SWING * step) ** 2 * stiffness * inverse_mass, _TINY))
    impedance = float(np.clip(1 - free, LEAST_IMPEDANCE, LARGEST_IMPEDANCE))
    swing = stiffness * inverse_mass * (1 - impedance)
    return Softness((-swing, -2 * min(ratio, 1.0) * np.sqrt(swing)), impedance)


def inverse_mass(regularization: float, found: Softness, step: float) -> float:
    """Return the w that ``discrete`` takes [1/kg], of the R that it makes of a constraint's figures."""
    stiffness, damping = (-figure for figure in found.solref)
    part = found.impedance + step * damping + step**2 * stiffness
    return regularization * part / (1 - found.impedance)


def dry_friction(slope: float, inverse_inertia: float, step: float) -> Softness:
    """Return the figures of friction that grows with speed by a slope c / v_s [N·m·s/rad] until it reaches c.

    It is the law above without a spring, so b d = slope (1 - d) w; and it must not turn a speed around in a step:
    b d h is at most 1.
    """
    free = min(1 - LEAST_IMPEDANCE, 1 / max(slope * inverse_inertia * step, _TINY))
    impedance = max(1 - free, LEAST_IMPEDANCE)
    return Softness((0.0, -slope * inverse_inertia * (1 - impedance)), min(impedance, LARGEST_IMPEDANCE))


def ratio(surface: TouchingPair, inverse_mass: float, speed: float, gravity: float) -> float:
    """Return the damping ratio for Hunt and Crossley's D of a surface, as derived above.

    Args:
        surface: on which something falls.
        inverse_mass: of that [1/kg].
        speed: at which it falls [m/s], positive.
        gravity: its size [m/s²].
    """
    swing = np.sqrt(surface.stiffness * inverse_mass)
    angle = np.arctan2(gravity, speed * swing)
    part = np.sin(angle) + 4 * np.cos(angle) ** 3 / (3 * (np.pi + 2 * angle + np.sin(2 * angle)))
    return float(surface.dissipation * np.hypot(speed, gravity / swing) * part / 2)


def surfaces(station: StationPlant) -> list[tuple[GeometryId, GeometryId, TouchingPair]]:
    """Return the pairs of shapes that may touch, with what they are together in Drake."""
    inspector, usual = station.scene_graph.model_inspector(), _usual(station)
    found = []
    for pair in touching_pairs(station):
        own = [inspector.GetProximityProperties(shape) for shape in pair]
        (k1, d1), (k2, d2) = (_stiffness_and_damping(properties, usual) for properties in own)
        rubs = [p.GetPropertyOrDefault("material", "coulomb_friction", CoulombFriction(1.0, 1.0)) for p in own]
        friction = CalcContactFrictionFromSurfaceProperties(*rubs).dynamic_friction()
        found.append((*pair, TouchingPair(k1 * k2 / (k1 + k2), (k2 * d1 + k1 * d2) / (k1 + k2), friction)))
    return found


def _stiffness_and_damping(properties: ProximityProperties, usual: tuple[float, float]) -> tuple[float, float]:
    keys = "point_contact_stiffness", "hunt_crossley_dissipation"
    stiffness, dissipation = (
        properties.GetPropertyOrDefault("material", key, value) for key, value in zip(keys, usual, strict=True)
    )
    return stiffness, dissipation


def _usual(station: StationPlant) -> tuple[float, float]:
    """Return stiffness and dissipation of shapes that have none of their own."""
    usual = station.scene_graph.get_config().default_proximity_properties
    return usual.point_stiffness, usual.hunt_crossley_dissipation
