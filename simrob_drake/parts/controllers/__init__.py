"""Loops around the servos: the kinds of controller that a station file can name."""

from typing import TYPE_CHECKING, Annotated, Any

from simrob_drake.parts.controllers.loop import flows_of, loops_of, readers_of
from simrob_drake.parts.controllers.own import own_blocks
from simrob_drake.parts.kinds import Kinds

__all__ = ["KINDS", "ControllerConfig", "Controllers", "flows_of", "loops_of", "own_blocks", "readers_of"]

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
