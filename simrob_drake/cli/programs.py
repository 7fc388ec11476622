"""Programs from the command line, of arms, of legged robots and of RAPID: run, checked, imported, exported."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, replace
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

from simrob_drake.base.errors import InvalidConfig, InvalidParameter, SimrobError
from simrob_drake.base.folders import written_at_once
from simrob_drake.cli import ExitCode
from simrob_drake.cli.arguments import changes_of, check_file, is_program_file, refuse, station_from
from simrob_drake.cli.options import RapidOptions, Saving
from simrob_drake.cli.saving import Frames, done_in_workcell, way_of
from simrob_drake.cli.screen import errors, say
from simrob_drake.results.result import SimulationResult
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.findings import Finding
from simrob_drake.stations.load import bare_station, station_yaml
from simrob_drake.stations.located import located_station

if TYPE_CHECKING:  # few commands need programs, which load scipy
    from simrob_drake.extensions.rapid.importing import Imported
    from simrob_drake.programs.arm import Workcell
    from simrob_drake.programs.program import Program


def run_program(
    program: Program,
    config: StationConfig,
    saving: Saving,
    frames: Frames = None,
    file: str = "",
    lines: Mapping[int, str] = MappingProxyType({}),
) -> ExitCode:
    """Run a program on a station, and save all of it as one result.

    Messages call it as ``file`` says, and the verdict its moves as ``lines`` do, by their numbers. Raises SimrobError:
    one that the robots cannot do.
    """
    from simrob_drake.programs.whole_program import of_arms, perform

    places = {f"move {number}": line for number, line in lines.items()}

    def performed(cell: Workcell) -> tuple[SimulationResult, str]:
        result = perform(cell, program, file)
        runs = (
            replace(run, moves=tuple(replace(move, place=places.get(move.place, move.place)) for move in run.moves))
            for run in result.runs
        )
        way = "" if of_arms(cell, program) else way_of(result, cell.robot_name(program.robot))
        return replace(result, runs=tuple(runs)), way

    return done_in_workcell(config, saving, lambda cell: lambda: performed(cell), frames)


def own_program(config: StationConfig) -> Program:
    """Return the program that a station carries; raises InvalidConfig: it has none, or a damaged one."""
    from simrob_drake.programs.whole_program import carried_program

    if (program := carried_program(config)) is None:
        raise InvalidConfig(config.name, "program", "missing: the moves that its robots make")
    return program


def program_from(file: str, set_: list[str] | None) -> tuple[Program, StationConfig]:
    """Return a file's program and the station that it names, with changes.

    Raises InvalidConfig: a damaged program, or one that names no station.
    """
    from simrob_drake.programs.program import Program

    program = Program.load(file)
    if program.station is None:
        raise InvalidConfig(file, "station", "missing: the name or the file of the station that it is to run on")
    return program, station_from(located_station(program.station, Path(file)), set_)


def check_program(program: Program, config: StationConfig, file: str = "") -> Finding:
    """Look whether the robots of a station can do a program, without running it; messages call it as ``file`` says.

    Raises SimrobError: what they cannot do; names the file and the move.
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


_SUFFIXES = (".mod", ".modx", ".prg", ".sys", ".sysx", ".pgf")


def is_rapid_file(file: Path | str) -> bool:
    """Tell whether a file is a RAPID module or a list of them."""
    return Path(file).suffix.lower() in _SUFFIXES


def refuse_rapid(options: RapidOptions) -> bool:
    """Refuse options of RAPID where there is none, and return what else `--allow-losses` is for."""
    chosen = {name: value for name, value in asdict(options).items() if value != getattr(RapidOptions(), name)}
    allow_losses = bool(chosen.pop("allow_losses", False))
    refuse("given with a RAPID module", **chosen)
    return allow_losses


def module_program(
    file: Path, options: RapidOptions, set_: list[str] | None
) -> tuple[Program, StationConfig, Mapping[int, str]]:
    """Return the program of a RAPID module, the station on which it is done, and the lines of its moves.

    Raises SimrobError: what is wrong or not understood, unless losses are allowed; names the file and the line.
    """
    imported, config = _imported(file, options, set_)
    _tell(imported)
    if imported.lost and not options.allow_losses:
        more = f", and {len(imported.lost) - 1} more" if len(imported.lost) > 1 else ""
        raise SimrobError(f"{imported.lost[0]}{more}; nothing moved: --allow-losses runs it without")
    return imported.program, config, imported.lines


def import_module(file: Path, out: Path | None, options: RapidOptions, *, force: bool) -> ExitCode:
    """Write the program of a RAPID module, and the station of a robot alone beside it."""
    target = out or Path(f"{file.stem}.yaml")
    station = target.with_name(f"{target.stem}_station.yaml")
    written = [target] if options.on else [target, station]
    for one in written:
        check_file(one, force=force)
    imported, config = _imported(file, options, None)
    written_at_once(target, imported.program.on(options.on or station.name).text())
    if options.on is None:
        written_at_once(station, station_yaml(config))
    _tell(imported)
    say(f"program {target}: {imported.time:.3f} s")
    say(f"next    simrob run {target}")
    if imported.lost and not options.allow_losses:
        errors.print(f"lost: {len(imported.lost)} lines; --allow-losses takes the program as it is", highlight=False)
        return ExitCode.BEYOND
    return ExitCode.DONE


def export_program(
    file: str, set_: list[str] | None, rapid: Path | None, urscript: Path | None, *, force: bool
) -> None:
    """Write a program as a RAPID module, with a table of its signals beside it, and as URScript.

    Raises SimrobError: no program, or one that cannot be done or said.
    """
    from simrob_drake.extensions.rapid.exporting import ExportedProgram, rapid_text, urscript_text
    from simrob_drake.programs.arm import Workcell

    if not is_program_file(file):
        raise InvalidConfig(file, "", "is no program: --rapid and --urscript write the moves of one")
    program, config = program_from(file, set_)
    steps = ExportedProgram.of(program, Workcell(config), file)
    texts: dict[Path, str] = {}
    if rapid is not None:
        texts[rapid], table = rapid_text(steps, rapid.stem)
        if table:
            texts[rapid.with_name(f"{rapid.stem}_io.yaml")] = table
    if urscript is not None:
        texts[urscript] = urscript_text(steps, urscript.stem)
    for target in texts:
        check_file(target, force=force)
    for target, text in texts.items():
        written_at_once(target, text)
        say(f"written {target}")
    for remark in steps.remarks:
        say(remark)


def _imported(file: Path, options: RapidOptions, set_: list[str] | None) -> tuple[Imported, StationConfig]:
    from simrob_drake.extensions.rapid.importing import import_rapid

    if options.on is None and options.robot is None:
        raise InvalidParameter("--robot", "missing", "who does it, as --robot irb120; or --on a station")
    if options.on is not None:
        config, robot = station_from(options.on, set_), options.robot
    else:
        config, robot = bare_station(str(options.robot), changes_of(set_, "--set")), None
    imported = import_rapid(file, config, robot=robot, signals=options.io, cycles=options.cycles, check=options.check)
    return imported, config


def _tell(imported: Imported) -> None:
    for remark in imported.remarks:
        mark = "lost " if remark.lost else ""
        say(f"{mark}{remark}")
