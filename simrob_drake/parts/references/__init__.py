"""What a robot is asked to do over time: the kinds of reference that a station file can name."""

from typing import TYPE_CHECKING, Annotated, Any

from simrob_drake.parts.kinds import Kinds

KINDS = Kinds(
    __name__,
    {
        "hold": "hold.Hold",
        "ramp": "ramp.Ramp",
        "move": "move.SmoothMove",
        "trapezoid": "cruise.Trapezoid",
        "s_curve": "cruise.SCurve",
        "sequence": "sequence.Sequence",
        "sine": "sine.SineWave",
        "table": "table.Table",
    },
)
if TYPE_CHECKING:
    from simrob_drake.parts.references.cruise import SCurve, Trapezoid
    from simrob_drake.parts.references.hold import Hold
    from simrob_drake.parts.references.move import SmoothMove
    from simrob_drake.parts.references.ramp import Ramp
    from simrob_drake.parts.references.sequence import Sequence
    from simrob_drake.parts.references.sine import SineWave
    from simrob_drake.parts.references.table import Table

    ReferenceConfig = Hold | Ramp | SmoothMove | Trapezoid | SCurve | Sequence | SineWave | Table
else:
    ReferenceConfig = Annotated[Any, KINDS]
