"""What a station file may say about contact: the model, and what surfaces are made of."""

from __future__ import annotations

from typing import Literal

from pydantic import model_validator

from simrob_drake.sections import Boolean, NotNegative, Positive, Strict


class Friction(Strict):
    """Coulomb friction of a surface."""

    static: NotNegative = 1.0
    """Coefficient up to which surfaces stick to each other."""
    dynamic: NotNegative = 0.9
    """Coefficient while they slide; not above the static one."""

    @model_validator(mode="after")
    def _dynamic_is_less(self) -> Friction:
        if self.dynamic > self.static:
            raise ValueError(f"dynamic friction ({self.dynamic:g}) is not more than static friction ({self.static:g})")
        return self


class ContactMaterial(Strict):
    """A surface. What is not given comes from the shape's own file, or from Drake."""

    stiffness: Positive | None = None
    """Spring of a point contact [N/m]. Of two surfaces it is the harmonic mean, 2 k1 k2 / (k1 + k2): equal figures
    give that figure. (Drake takes the springs of two shapes in series; each gets twice the value here.)"""
    dissipation: NotNegative | None = None
    """Hunt and Crossley's d [s/m]: the force is k x (1 + d dx/dt). Of two surfaces it is the mean, each weighted with
    the stiffness of the other one. The solver scheme `sap` does not know it."""
    friction: Friction | None = None
    """Coulomb friction; of two surfaces 2 m1 m2 / (m1 + m2)."""
    hydroelastic_modulus: Positive | None = None
    """Pressure of a surface pressed in to its middle [Pa], for the hydroelastic models; 1e7 unless given."""


class ContactConfig(ContactMaterial):
    """Contact between robots, pieces and floor. A station without this section has none.

    What surfaces are made of holds for all of them, floor included; a piece's own `contact` section replaces it.
    """

    model: Literal["point", "hydroelastic", "hydroelastic_with_fallback"] = "point"
    """One spring at the deepest point, or pressure over the surface; the floor is rigid there."""
    self_collision: Boolean = False
    """Contact between the links of one robot."""
    stiction_speed: Positive = 1e-3
    """Speed up to which a contact counts as sticking [m/s]; continuous solvers let it creep that fast."""
    resolution: Positive = 0.02
    """Length of the edges of hydroelastic surfaces [m]."""
