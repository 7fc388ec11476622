"""Loops around the servos: the kinds of controller that a station file can name."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any

from pydrake.systems.framework import LeafSystem

from simrob_drake.parts.controllers.loop import LoopSection, Reader
from simrob_drake.parts.kinds import Kinds

KINDS = Kinds(
    __name__,
    {
        "own": "own.OwnController",
        "sequencer": "sequencer.Sequencer",
        "objective": "objective.Objective",
        "fall_guard": "fall_guard.FallGuard",
        "balance": "balance.Balance",
        "force_control": "force_control.ForceControl",
        "motor_protection": "motor_protection.MotorProtection",
        "signal_flow": "signal_flow.SignalFlow",
        "touchdown": "touchdown.Touchdown",
        "policy": "policy.Policy",
        "walk": "walk.Walk",
    },
)
if TYPE_CHECKING:
    from simrob_drake.parts.controllers.balance import Balance
    from simrob_drake.parts.controllers.fall_guard import FallGuard
    from simrob_drake.parts.controllers.force_control import ForceControl
    from simrob_drake.parts.controllers.motor_protection import MotorProtection
    from simrob_drake.parts.controllers.objective import Objective
    from simrob_drake.parts.controllers.own import OwnController
    from simrob_drake.parts.controllers.policy import Policy
    from simrob_drake.parts.controllers.sequencer import Sequencer
    from simrob_drake.parts.controllers.signal_flow import SignalFlow
    from simrob_drake.parts.controllers.touchdown import Touchdown
    from simrob_drake.parts.controllers.walk import Walk

    ControllerConfig = (
        OwnController
        | Sequencer
        | Objective
        | FallGuard
        | Balance
        | ForceControl
        | MotorProtection
        | SignalFlow
        | Touchdown
        | Policy
        | Walk
    )
else:
    ControllerConfig = Annotated[Any, KINDS]

Controllers = Annotated[dict[str, ControllerConfig], KINDS.names_are_kinds]


def loops_of(controllers: Controllers) -> dict[str, LoopSection]:
    """Return those controllers that are loops of the package's, by name."""
    return {name: section for name, section in controllers.items() if isinstance(section, LoopSection)}


def flows_of(controllers: Controllers) -> "dict[str, SignalFlow]":
    """Return those controllers that are signal flows, by name."""
    return {name: section for name, section in controllers.items() if section.kind == "signal_flow"}


def readers_of(controllers: Controllers) -> dict[str, Reader]:
    """Return those controllers that are of the package's, and tell what they read and drive, by name."""
    return {**loops_of(controllers), **flows_of(controllers)}


def own_blocks(controllers: Controllers) -> Mapping[str, LeafSystem]:
    """Return the blocks of those that are the user's own, made anew, by name."""
    own = {name: section for name, section in controllers.items() if section.kind == "own"}
    return {name: section.block(f"controllers.{name}") for name, section in own.items()}
