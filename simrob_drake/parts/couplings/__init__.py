"""What ties joints and bodies of a station together beside its joints: the kinds that a station file can name."""

from typing import TYPE_CHECKING, Annotated, Any

from simrob_drake.parts.kinds import Kinds

KINDS = Kinds(
    __name__,
    {
        "gear": "gear.Gear",
        "ball": "constraint.Ball",
        "rod": "constraint.Rod",
        "weld": "constraint.Weld",
        "hinge": "constraint.Hinge",
        "spring": "spring.Spring",
    },
)
if TYPE_CHECKING:
    from simrob_drake.parts.couplings.constraint import Ball, Hinge, Rod, Weld
    from simrob_drake.parts.couplings.gear import Gear
    from simrob_drake.parts.couplings.spring import Spring

    CouplingConfig = Gear | Ball | Rod | Weld | Hinge | Spring
else:
    CouplingConfig = Annotated[Any, KINDS]

Couplings = Annotated[dict[str, CouplingConfig], KINDS.names_are_kinds]
