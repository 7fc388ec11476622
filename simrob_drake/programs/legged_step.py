"""One step of a legged robot, as moves of a program."""

from __future__ import annotations

from typing import Any

import numpy as np

from simrob_drake.errors import InvalidParameter
from simrob_drake.programs.gaits.choice import carries, first_gait, made_for
from simrob_drake.programs.gaits.parameters import Posing, load_gaits
from simrob_drake.programs.gaits.registry import gaits_of
from simrob_drake.programs.given_moves import checked, move_of
from simrob_drake.programs.legged_geometry import LeggedGeometry
from simrob_drake.programs.moves import AnyMove, Walk, WalkMove
from simrob_drake.robots.catalog import RobotModel

SEQUENCE = "step"
"""The sequence of a robot's ``gaits.yaml`` that is a step by joint angles, if it has one."""
_PACES = ("step_time", "leg_time", "move_time")  # what gaits call the time of a step


def step_moves(robot: LeggedGeometry, move_time: float | None = None) -> list[AnyMove]:
    """Return one step ahead: the robot's sequence ``step``, else the fewest steps of its first gait, of full length.

    Args:
        robot: who.
        move_time: of each move of the sequence, or of each step of the gait [s]; their own unless given.

    Raises:
        InvalidParameter: a robot without feet or gaits, without a gait for the feet that it wears, or a time that is
            not positive.
    """
    model = robot.model
    if model.feet is None:
        raise InvalidParameter("robot", model.name, "one with legs: step() is for legged robots")
    own = load_gaits(model).sequences.get(SEQUENCE)
    if own is not None and carries(model, robot.worn_feet, made_for(model, own)):
        return _moves_of(model, own, move_time)
    known = gaits_of(model, steps=True)
    kind, figures = known[first_gait(model, robot.worn_feet, known)]
    keys = type(figures).model_fields
    changes: dict[str, Any] = {"ramp_steps": 0} if "ramp_steps" in keys else {}  # the first step has its full length
    if move_time is not None:
        changes |= {key: move_time for key in _PACES if key in keys}
    return [WalkMove(walk=checked(Walk, steps=kind.fewest, **changes))]


def _moves_of(model: RobotModel, sequence: Posing, move_time: float | None) -> list[AnyMove]:
    times = np.diff([0.0, *(target.time for target in sequence.targets)])
    return [
        move_of(
            target.target_deg
            if isinstance(target.target_deg, dict)
            else dict(zip(model.axes, model.axis_vector(target.target_deg, SEQUENCE).tolist(), strict=True)),
            float(time) if move_time is None else move_time,
        )
        for target, time in zip(sequence.targets, times, strict=True)
    ]
