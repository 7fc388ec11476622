"""Loops around the servos: the kinds of controller that a station file can name."""

from typing import Annotated, Any

from simrob_drake.parts.controllers.loop import LoopSection, flows_of, loops_of, readers_of
from simrob_drake.parts.controllers.own import own_blocks
from simrob_drake.parts.kinds import Kinds

__all__ = [
    "KINDS",
    "ControllerConfig",
    "Controllers",
    "flows_of",
    "loops_of",
    "own_blocks",
    "readers_of",
]

KINDS = Kinds(
    __name__,
    {
        "own": "own.OwnController",
        "sequencer": "postures.Sequencer",
        "objective": "objective.Objective",
        "fall_guard": "postures.FallGuard",
        "balance": "balance.Balance",
        "force_control": "efforts.ForceControl",
        "motor_protection": "efforts.MotorProtection",
        "signal_flow": "signal_flow.SignalFlow",
        "touchdown": "touchdown.Touchdown",
        "walk": "walk.Walk",
        "get_up": "get_up.GetUp",
        "swing_up": "swing_up.SwingUpController",
    },
    base=LoopSection,
    point="controllers",
)
ControllerConfig = Annotated[Any, KINDS]
Controllers = Annotated[dict[str, ControllerConfig], KINDS.names_are_kinds]
