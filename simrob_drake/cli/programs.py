"""Programs from the command line, of arms and of legged robots: run, checked."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from simrob_drake.cli import ExitCode
from simrob_drake.cli.given import given_station
from simrob_drake.cli.legged import way_of
from simrob_drake.cli.saving import prepared_folder, saved, wait_for_watcher
from simrob_drake.errors import InvalidConfig
from simrob_drake.results.files import Saved
from simrob_drake.results.result import SimulationResult
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.steps import Finding

if TYPE_CHECKING:  # few commands need programs, which load scipy
    from simrob_drake.programs.program import Program
    from simrob_drake.programs.workcell import Workcell


def run_program(file: str, set_: list[str] | None, out: Path | None, *, live: bool, options: Saved) -> ExitCode:
    """Run a program on the station that it names, and save all of it as one result.

    Raises:
        InvalidConfig: a damaged program, or one that names no station.
        SimrobError: one that the robots cannot do.
    """
    from simrob_drake.programs.workcell import Workcell

    program, config = given_program(file, set_)
    cell = Workcell(config)
    folder = prepared_folder(config, out, force=options["force"], video=options["video"])
    cell.progress = not live
    if live:
        wait_for_watcher(cell.show())
    try:
        result, way = _performed(cell, program, file)
    finally:
        cell.close()
    return saved(result, folder, more=way, **options)


def check_program(file: str, set_: list[str] | None) -> list[Finding]:
    """Return what a program takes, without running it.

    Raises:
        SimrobError: as :func:`run_program`.
    """
    from simrob_drake.programs.workcell import Workcell

    program, config = given_program(file, set_)
    return [look_at(Workcell(config), program, file)]


def given_program(file: str, set_: list[str] | None) -> tuple[Program, StationConfig]:
    """Return the program of a file, and the station that it names, with what the user wants changed.

    Raises:
        InvalidConfig: a damaged program, or one that names no station.
    """
    from simrob_drake.programs.program import Program

    program = Program.load(file)
    if program.station is None:
        raise InvalidConfig(file, "station", "missing: the name or the file of the station that it is to run on")
    beside = Path(file).parent / program.station
    return program, given_station(str(beside if beside.is_file() else program.station), set_)


def look_at(cell: Workcell, program: Program, file: str) -> Finding:
    """Look whether robots can do a program; the station stays as it is.

    Raises:
        SimrobError: what they cannot do; names the file and the move.
    """
    from simrob_drake.programs.arm_program import rehearse
    from simrob_drake.programs.legged_robot import LeggedRobot
    from simrob_drake.programs.legged_stages import stages_of_program
    from simrob_drake.programs.timeline import Timeline
    from simrob_drake.programs.whole_program import of_arms
    from simrob_drake.programs.workcell import Workcell

    moves = len(program.moves)
    Timeline(program.grid, program.changes).check(cell.config)
    if not of_arms(cell, program):
        stages_of_program(LeggedRobot(cell, program.robot), program, cell.config, file)
        return Finding("ok", "program", f"{moves} moves can be done" if moves else "its cells can be reached")
    seen, time = rehearse(Workcell(cell.config), program, file)
    if seen == moves:
        return Finding("ok", "program", f"{moves} entries can be done, in {time:.4g} s")
    told = f"{seen} of {moves} entries can be done, in {time:.4g} s; moves[{seen}] depends on where a piece falls"
    return Finding("ok", "program", told)


def _performed(cell: Workcell, program: Program, file: str) -> tuple[SimulationResult, str]:
    """Let the robots of a station do a program; return all of it, and the way of one that walks in words."""
    from simrob_drake.programs.whole_program import of_arms, perform

    result = perform(cell, program, file)
    return result, "" if of_arms(cell, program) else way_of(result, cell.robot_name(program.robot))
