"""What a robot is asked to do over time: the kinds of reference that a station file can name."""

from typing import Annotated

from pydantic import Field

from simrob_drake.parts.references.cruise import SCurve, Trapezoid
from simrob_drake.parts.references.hold import Hold
from simrob_drake.parts.references.move import Move
from simrob_drake.parts.references.ramp import Ramp
from simrob_drake.parts.references.sequence import Sequence
from simrob_drake.parts.references.sine import SineWave
from simrob_drake.parts.references.table import Table

ReferenceConfig = Annotated[
    Hold | Ramp | Move | Trapezoid | SCurve | Sequence | SineWave | Table, Field(discriminator="kind")
]

__all__ = ["Hold", "Move", "Ramp", "ReferenceConfig", "SCurve", "Sequence", "SineWave", "Table", "Trapezoid"]
