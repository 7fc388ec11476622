"""Forces over time on a station's bodies: the kinds that a station file can name."""

from typing import TYPE_CHECKING, Annotated, Any

from simrob_drake.parts.kinds import Kinds

KINDS = Kinds(
    __name__,
    {
        "push": "push.Push",
        "drag": "drag.Drag",
        "sine": "sine.SineForce",
    },
)
if TYPE_CHECKING:
    from simrob_drake.parts.forces.drag import Drag
    from simrob_drake.parts.forces.push import Push
    from simrob_drake.parts.forces.sine import SineForce

    ForceConfig = Push | Drag | SineForce
else:
    ForceConfig = Annotated[Any, KINDS]

Forces = Annotated[dict[str, ForceConfig], KINDS.names_are_kinds]
