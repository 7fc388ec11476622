"""Programs from the command line, of arms and of legged robots: run, checked."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from simrob_drake.cli import ExitCode
from simrob_drake.cli.arguments import station_from
from simrob_drake.cli.legged import way_of
from simrob_drake.cli.options import Saving
from simrob_drake.cli.saving import Frames, prepared_folder, saved, wait_for_watcher
from simrob_drake.errors import InvalidConfig
from simrob_drake.results.result import SimulationResult
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.located import located_station
from simrob_drake.stations.steps import Finding

if TYPE_CHECKING:  # few commands need programs, which load scipy
    from simrob_drake.programs.arm import Workcell
    from simrob_drake.programs.program import Program


def run_program(
    program: Program, config: StationConfig, saving: Saving, frames: Frames = None, file: str = ""
) -> ExitCode:
    """Run a program on a station, and save all of it as one result; messages call it as ``file`` says.

    Raises:
        SimrobError: one that the robots cannot do.
    """
    from simrob_drake.programs.arm import Workcell

    cell = Workcell(config)
    folder = prepared_folder(config, saving)
    cell.progress = not saving.live
    if saving.live:
        wait_for_watcher(cell.show())
    try:
        result, way = _performed(cell, program, file)
    finally:
        cell.close()
    return saved(result, folder, saving, more=way, frames=frames)


def own_program(config: StationConfig) -> Program:
    """Return the program that a station carries.

    Raises:
        InvalidConfig: it has none, or a damaged one.
    """
    from simrob_drake.programs.whole_program import carried_program

    if (program := carried_program(config)) is None:
        raise InvalidConfig(config.name, "program", "missing: the moves that its robots make")
    return program


def program_from(file: str, set_: list[str] | None) -> tuple[Program, StationConfig]:
    """Return the program of a file, and the station that it names, with what the user wants changed.

    Raises:
        InvalidConfig: a damaged program, or one that names no station.
    """
    from simrob_drake.programs.program import Program

    program = Program.load(file)
    if program.station is None:
        raise InvalidConfig(file, "station", "missing: the name or the file of the station that it is to run on")
    return program, station_from(located_station(program.station, Path(file)), set_)


def check_program(program: Program, config: StationConfig, file: str = "") -> Finding:
    """Look whether the robots of a station can do a program, without running it; messages call it as ``file`` says.

    Raises:
        SimrobError: what they cannot do; names the file and the move.
    """
    from simrob_drake.programs.arm import Workcell
    from simrob_drake.programs.legged_robot import LeggedRobot
    from simrob_drake.programs.stages import stages_of_program
    from simrob_drake.programs.timeline import Timeline
    from simrob_drake.programs.whole_program import of_arms

    cell, moves = Workcell(config), len(program.moves)
    Timeline(program.grid, program.changes).check(config)
    if not of_arms(cell, program):
        stages_of_program(LeggedRobot(cell, program.robot), program, cell.config, file)
        return Finding("ok", "program", f"{moves} moves can be done" if moves else "its cells can be reached")
    seen, time = cell.rehearse(program, file)
    if seen == moves:
        return Finding("ok", "program", f"{moves} entries can be done, in {time:.4g} s")
    message = f"{seen} of {moves} entries can be done, in {time:.4g} s; moves[{seen}] depends on where a piece falls"
    return Finding("note", "program", message)


def _performed(cell: Workcell, program: Program, file: str) -> tuple[SimulationResult, str]:
    """Let the robots of a station do a program; return all of it, and the way of one that walks in words."""
    from simrob_drake.programs.whole_program import of_arms, perform

    result = perform(cell, program, file)
    return result, "" if of_arms(cell, program) else way_of(result, cell.robot_name(program.robot))
