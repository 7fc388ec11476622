"""Loops around the servos: the kinds of controller that a station file can name."""

from collections.abc import Mapping
from typing import Annotated

from pydantic import Field
from pydrake.systems.framework import LeafSystem

from simrob_drake.parts.controllers.balance import Balance
from simrob_drake.parts.controllers.fall_guard import FallGuard
from simrob_drake.parts.controllers.loop import LoopSection
from simrob_drake.parts.controllers.objective import Objective
from simrob_drake.parts.controllers.own import OwnController
from simrob_drake.parts.controllers.sequencer import Sequencer
from simrob_drake.parts.kinds import named_by_kind

ControllerConfig = Annotated[OwnController | Sequencer | Objective | FallGuard | Balance, Field(discriminator="kind")]
Controllers = Annotated[dict[str, ControllerConfig], named_by_kind(ControllerConfig)]


def loops_of(controllers: Controllers) -> dict[str, LoopSection]:
    """Return those controllers that are loops of the package's, by name."""
    return {name: section for name, section in controllers.items() if isinstance(section, LoopSection)}


def own_blocks(controllers: Controllers) -> Mapping[str, LeafSystem]:
    """Return the blocks of those that are the user's own, made anew, by name."""
    own = {name: section for name, section in controllers.items() if isinstance(section, OwnController)}
    return {name: section.block(f"controllers.{name}") for name, section in own.items()}
