"""A program as one run, whoever does it: arms together, or a robot with legs."""

from simrob_drake.programs.arm_program import ARM_ONLY
from simrob_drake.programs.legged_robot import LeggedRobot
from simrob_drake.programs.program import Program
from simrob_drake.programs.recorded import STATION
from simrob_drake.programs.workcell import Workcell
from simrob_drake.results.result import SimulationResult
from simrob_drake.results.whole import joined


def perform(cell: Workcell, program: Program, file: str = "") -> SimulationResult:
    """Let the robots of a station do a program, and return all of it as one result.

    Args:
        cell: the station.
        program: what they do.
        file: that it stands in, for messages.

    Raises:
        SimrobError: what they cannot do; names the move.
    """
    given = file or program
    if of_arms(cell, program):
        return cell.perform(given)
    robot, begun = LeggedRobot(cell, program.robot), (cell.config, cell.state)
    robot.run(given)
    return joined(robot.runs, begun=begun, left=cell.config, program=program.on(STATION).text())


def of_arms(cell: Workcell, program: Program) -> bool:
    """Tell whether a program is done by arms: it has moves of theirs, or its robots have no legs."""
    if program.references:
        return False
    robots = cell.config.robots if program.robot is None else [cell.robot_name(program.robot)]
    models = [cell.robot(name).model for name in robots]
    legless = all(model.base == "fixed" and model.feet is None and model.tools for model in models)
    return legless or any(isinstance(move, ARM_ONLY) for move in program.moves)
