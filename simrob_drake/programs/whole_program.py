"""Run a whole program as one result: with the arms of a workcell, or with a robot with legs."""

from dataclasses import replace

from simrob_drake.programs.arm import Workcell
from simrob_drake.programs.legged_robot import LeggedRobot
from simrob_drake.programs.program import Program
from simrob_drake.programs.recorded import STATION
from simrob_drake.results.result import SimulationResult, join_runs
from simrob_drake.robots.catalog import RobotModel
from simrob_drake.simulation import simulate
from simrob_drake.stations.config import StationConfig


def perform(cell: Workcell, program: Program, file: str = "") -> SimulationResult:
    """Run a program on a station from its present state, and join its runs to one result.

    Args:
        cell: the station, which is in the final state afterwards.
        program: the program.
        file: file of the program, which is then read again, so that messages name it. It is empty if there is none.

    Raises:
        SimrobError: a move cannot be done. The message names it and the file.
    """
    # With the file's name, the program is read again, so that its messages name the file and the move.
    source = file or program
    if of_arms(cell, program):
        return cell.perform(source)
    robot = LeggedRobot(cell, program.robot)
    start = (cell.config, cell.state)
    robot.run(source)
    # The result is saved with the station in which it began, so its program refers to that file.
    text = program.on(STATION).text()
    # A program that only plays the station's references has no moves that a user could know by their numbers.
    is_named = not program.plays_references
    spans = [replace(span, is_named=is_named) for span in robot.move_spans]
    return join_runs(robot.runs, begun=start, left=cell.config, program=text, move_spans=spans)


def carried_program(config: StationConfig) -> Program | None:
    """Program in the file of a station. It is None if the station has none.

    Raises:
        InvalidConfig: the program has a wrong entry. The message names the move and the key.
    """
    return (
        None
        if config.program is None
        else Program.of_content(config.program, f"{config.name}: program")
    )


def run_whole(config: StationConfig) -> SimulationResult:
    """Run a station by its program, or by its references if it has no program.

    Raises:
        SimrobError: the station, or a move of the program, cannot be run.
    """
    program = carried_program(config)
    return (
        simulate(config, progress=False) if program is None else perform(Workcell(config), program)
    )


def of_arms(cell: Workcell, program: Program) -> bool:
    """Whether arms perform a program: it has a move that robots with legs cannot do, or none of its robots has legs.

    Its robots are the one that it names, or all robots of the station. A program with references is never for arms.

    Raises:
        UnknownName: the station has no robot of the program's name.
    """
    # Only robots with legs go through references here. Arms have their own method for it.
    if program.references:
        return False
    robots = cell.config.robots if program.robot is None else [cell.robot_name(program.robot)]
    return not any(goes_on_legs(cell.robot(name).model, program) for name in robots)


def goes_on_legs(model: RobotModel, program: Program) -> bool:
    """Whether a robot has legs, and all moves of a program are possible for robots with legs.

    Then a :class:`~simrob_drake.LeggedRobot` performs the program, not the arms of a workcell.
    """
    return not model.is_arm and all(move.of_legs for move in program.moves)
