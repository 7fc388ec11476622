"""A program as one run, whoever does it: arms together, or a robot with legs."""

from dataclasses import replace

from simrob_drake.programs.arm import Workcell
from simrob_drake.programs.legged_robot import LeggedRobot
from simrob_drake.programs.program import Program
from simrob_drake.programs.recorded import STATION
from simrob_drake.results.result import SimulationResult, joined
from simrob_drake.robots.catalog import RobotModel
from simrob_drake.simulation import simulate
from simrob_drake.stations.config import StationConfig


def perform(cell: Workcell, program: Program, file: str = "") -> SimulationResult:
    """Let a station's robots do a program, all as one result; raises SimrobError: the move that fails, and its file."""
    source = file or program
    if of_arms(cell, program):
        return cell.perform(source)
    robot, begun = LeggedRobot(cell, program.robot), (cell.config, cell.state)
    robot.run(source)
    text = program.on(STATION).text()
    is_named = not program.plays_references
    spans = [replace(span, is_named=is_named) for span in robot.move_spans]
    return joined(robot.runs, begun=begun, left=cell.config, program=text, move_spans=spans)


def carried_program(config: StationConfig) -> Program | None:
    """Return a station's program, None without; raises InvalidConfig: one that cannot be; names move and key."""
    return None if config.program is None else Program.of_content(config.program, f"{config.name}: program")


def run_whole(config: StationConfig) -> SimulationResult:
    """Run a station's program, or its references; raises SimrobError: what cannot be run; names the program's move."""
    program = carried_program(config)
    return simulate(config, progress=False) if program is None else perform(Workcell(config), program)


def of_arms(cell: Workcell, program: Program) -> bool:
    """Tell whether a program is done by arms: it has moves of theirs, or its robots have no legs."""
    if program.references:
        return False
    robots = cell.config.robots if program.robot is None else [cell.robot_name(program.robot)]
    return not any(goes_on_legs(cell.robot(name).model, program) for name in robots)


def goes_on_legs(model: RobotModel, program: Program) -> bool:
    """Tell whether a program is done by a :class:`~simrob_drake.LeggedRobot`, and not by the arms of a workcell."""
    return not model.is_arm and all(move.of_legs for move in program.moves)
