"""Forces over time on a station's bodies: the kinds that a station file can name."""

from typing import Annotated

from pydantic import Field

from simrob_drake.parts.forces.drag import Drag
from simrob_drake.parts.forces.push import Push
from simrob_drake.parts.forces.sine import SineForce
from simrob_drake.parts.kinds import named_by_kind

ForceConfig = Annotated[Push | Drag | SineForce, Field(discriminator="kind")]
Forces = Annotated[dict[str, ForceConfig], named_by_kind(ForceConfig)]

__all__ = ["Drag", "ForceConfig", "Forces", "Push"]
