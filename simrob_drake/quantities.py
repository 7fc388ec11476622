"""Types of the figures in YAML files: ranges of numbers, poses, colours, inertias; SI units."""

from typing import Annotated

from pydantic import AfterValidator, Field
from pydrake.multibody.tree import RotationalInertia

from simrob_drake.given import LONGEST, SHORTEST
from simrob_drake.yaml_files import Number

FASTEST_RATE = 1e4
"""Largest rate at which signals are sampled [Hz]: ten samples in a step of 1 ms."""

Positive = Annotated[Number, Field(gt=0)]
NotNegative = Annotated[Number, Field(ge=0)]
Frequency = Annotated[Number, Field(gt=0, le=FASTEST_RATE)]
"""Of something that swings [Hz]: no faster than signals can show."""
Fraction = Annotated[Number, Field(ge=0, le=1)]
Triple = tuple[Number, Number, Number]
Pose = tuple[Number, Number, Number, Number, Number, Number]
"""[x y z Rz Ry Rx], R = Rz·Ry·Rx [m, rad]."""
Colour = tuple[Fraction, Fraction, Fraction, Fraction]
"""Red, green, blue, opacity."""
ORIGIN: Pose = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def _time(time: float) -> float:
    """Check that a time is neither too short nor too long for one."""
    if time and not SHORTEST <= time <= LONGEST:
        raise ValueError(f"a time is of {SHORTEST:g} to {LONGEST:g} s")
    return time


Duration = Annotated[Number, Field(gt=0), AfterValidator(_time)]
"""A time that something takes [s]."""
Instant = Annotated[Number, Field(ge=0), AfterValidator(_time)]
"""When something begins, from the start of the run [s]."""


def _possible(inertia: tuple[float, ...]) -> tuple[float, ...]:
    """Check that there is a body with these moments, and products where they are given."""
    if len(inertia) not in (3, 6):
        raise ValueError("an inertia is three moments Ixx Iyy Izz, or six numbers: with the products Ixy Ixz Iyz")
    if not RotationalInertia(*inertia).CouldBePhysicallyValid():
        raise ValueError("no body has these moments of inertia: none is negative, none exceeds the sum of the others")
    return inertia


Inertia = Annotated[tuple[Number, ...], AfterValidator(_possible)]
"""Moments Ixx Iyy Izz about the centre of mass [kg m²], and the products Ixy Ixz Iyz where they are not zero."""
