"""Cells of joint targets that a robot goes through in its own time (SimRob's automatic control, thesis p. 98 to 102).

A sequencer lies over the reference, beneath the loops that the station has, for one run.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from simrob_drake.arguments import instance
from simrob_drake.errors import InvalidParameter
from simrob_drake.parts.controllers import loops_of
from simrob_drake.parts.controllers.postures import Cell, Pace, Sequencer
from simrob_drake.programs.geometry import CellRobot
from simrob_drake.programs.moves.joints import JointMove
from simrob_drake.results.result import SimulationResult
from simrob_drake.sections import Positive, validated
from simrob_drake.stations.resolve import check_parts, resolve

NAME = "automatic"  # what the sequencer is called in the station that runs a program


class Automatic(Pace):
    """How a robot goes through the references of a program."""

    timeout: Positive = 15.0
    """How long a cell may take [s]."""


def pace_of(value: bool | Automatic | Mapping[str, Any]) -> Automatic:
    """Return how to go through cells, True for as usual.

    Raises:
        InvalidConfig: a wrong entry of a mapping; InvalidParameter: no mapping at all.
    """
    if value is True:
        return Automatic()
    expected = "True, or a mapping such as {'tolerance_deg': 3, 'timeout': 20}"
    if isinstance(value, Automatic):
        return value
    return validated(Automatic, dict(instance(value, NAME, Mapping, expected)), NAME)


def run_cells(robot: CellRobot, cells: Sequence[JointMove], pace: Automatic) -> SimulationResult:
    """Let a robot go through cells from where it is, while others hold their places; the run ends with the last one.

    Sequencers that the station has for the robot do nothing meanwhile. Raises InvalidParameter: no cell, a target
    beyond its limits, or a kinematic station; InvalidConfig: a cell whose way takes longer than the time-out.
    """
    if not cells:
        raise InvalidParameter("the program", "without references", "one with some: add_reference() stores them")
    cell, own = robot.cell, robot.cell.config
    others = {
        name: one
        for name, one in own.controllers.items()
        if not (isinstance(one, Sequencer) and (one.robot or own.only_robot) == robot.name)
    }
    section = validated(
        Sequencer,
        {
            "kind": "sequencer",
            "robot": robot.name,
            "priority": min((loop.priority or 0 for loop in loops_of(others).values()), default=0) - 1,
            "cells": [Cell(targets_deg=move.target_deg, duration=move.duration) for move in cells],
            "ends": True,
            **pace.model_dump(),
        },
        NAME,
    )
    longest = len(cells) * (pace.timeout + 1 / section.rate) + 2 / section.rate  # with the first sample and the last
    station = own.model_copy(update={"controllers": {**others, NAME: section}})
    check_parts(resolve(station))
    cell.change(station)
    try:
        result = cell.follow({}, longest)
    finally:
        cell.change(own)
    if cell.state is not None:  # the next sequence begins anew
        left = {name: block for name, block in cell.state.blocks.items() if name != f"controller.{NAME}"}
        cell.state = replace(cell.state, blocks=left)
    return result
