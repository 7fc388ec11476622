"""Programs from the command line, of arms, of legged robots and in languages of robots: run, checked, imported."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, replace
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

from simrob_drake.base.errors import InvalidConfig, InvalidParameter, SimrobError
from simrob_drake.base.extension import code_of_extension
from simrob_drake.base.folders import check_new_file, written_at_once
from simrob_drake.base.messages import compound, message, translate
from simrob_drake.base.yaml_files import YAML_SUFFIXES
from simrob_drake.cli import ExitCode
from simrob_drake.cli.arguments import changes_of, refuse, station_from
from simrob_drake.cli.options import LanguageOptions, Saving
from simrob_drake.cli.saving import Frames, done_in_workcell, way_of
from simrob_drake.cli.screen import NEXT, PROGRAM, errors, say_place, say_text
from simrob_drake.importer.importer import CORE_SUFFIXES, load_importer
from simrob_drake.results.record.run import move_title
from simrob_drake.results.result import SimulationResult
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.file_paths import station_with_absolute_path
from simrob_drake.stations.findings import Finding
from simrob_drake.stations.load import bare_station, station_yaml

if TYPE_CHECKING:  # few commands need programs, which load scipy
    from simrob_drake.programs.arm import Workcell
    from simrob_drake.programs.program import Program
    from simrob_drake.programs.program_importer import ImportedProgram, ProgramImporter


def run_program(
    program: Program,
    config: StationConfig,
    saving: Saving,
    frames: Frames = None,
    file: str = "",
    lines: Mapping[int, str] = MappingProxyType({}),
) -> ExitCode:
    """Run a program on a station, and save all of it as one result.

    Args:
        program: the program.
        config: the station.
        saving: how the result is shown and saved.
        frames: frames of the film strip.
        file: file of the program, for messages.
        lines: for a program in the language of a robot, by the index of each move, its file and line. They are the
            names of the moves in the verdict.

    Raises:
        SimrobError: the robots cannot do the program.
    """
    from simrob_drake.programs.whole_program import of_arms, perform

    places = {str(move_title(index)): line for index, line in lines.items()}

    def do_program(cell: Workcell) -> tuple[SimulationResult, str]:
        """Do the program. Returns the run, and a sentence about how far a legged robot moved."""
        result = perform(cell, program, file)
        runs = (run.at_place(places[run.place]) if run.place in places else run for run in result.runs)
        way = "" if of_arms(cell, program) else way_of(result, cell.robot_name(program.robot))
        return replace(result, runs=tuple(runs)), way

    return done_in_workcell(config, saving, lambda cell: lambda: do_program(cell), frames)


def own_program(config: StationConfig) -> Program:
    """Read the program that a station carries.

    Raises:
        InvalidConfig: the station has no program, or a damaged one.
    """
    from simrob_drake.programs.whole_program import carried_program

    if (program := carried_program(config)) is None:
        raise InvalidConfig(
            config.name, "program", message("cli.missing_moves", "missing: the moves that its robots make")
        )
    return program


def program_from(file: str, set_: list[str] | None) -> tuple[Program, StationConfig]:
    """Read a program's file, and the station that it names.

    Args:
        file: the program.
        set_: changes of the station, as the option ``--set`` takes them.

    Raises:
        InvalidConfig: the program is damaged, or names no station.
    """
    from simrob_drake.programs.program import Program

    program = Program.load(file)
    if program.station is None:
        raise InvalidConfig(
            file,
            "station",
            message("cli.missing_station", "missing: the name or the file of the station that it is to run on"),
        )
    return program, station_from(station_with_absolute_path(program.station, Path(file)), set_)


def check_program(program: Program, config: StationConfig, file: str = "") -> Finding:
    """Check that the robots of a station can do a program, without running it.

    Args:
        program: the program.
        config: the station.
        file: file of the program, for messages. Empty for the program that the station carries.

    Raises:
        SimrobError: the robots cannot do a move; the message names the file and the move.
    """
    from simrob_drake.programs.arm import Workcell
    from simrob_drake.programs.legged_robot import LeggedRobot
    from simrob_drake.programs.stages import stages_of_program
    from simrob_drake.programs.timeline import Timeline
    from simrob_drake.programs.whole_program import of_arms

    cell = Workcell(config)
    moves = len(program.moves)
    Timeline(program.grid, program.changes).check(config)
    if not of_arms(cell, program):
        stages_of_program(LeggedRobot(cell, program.robot), program, cell.config, file)
        return Finding(
            "ok",
            PROGRAM,
            message("cli.moves_can_be_done", "{moves} moves can be done", moves=moves)
            if moves
            else message("cli.cells_can_be_reached", "its cells can be reached"),
        )
    # The rehearsal ends before a move that depends on the simulation, such as on where a piece falls.
    seen, time = cell.rehearse(program, file)
    if seen == moves:
        return Finding(
            "ok",
            PROGRAM,
            message("cli.entries_can_be_done", "{moves} entries can be done, in {time:.4g} s", moves=moves, time=time),
        )
    text = message(
        "cli.program_depends_on_fall",
        "{seen} of {moves} entries can be done, in {time:.4g} s; {move} depends on where a piece falls",
        seen=seen,
        moves=moves,
        time=time,
        move=move_title(seen),
    )
    return Finding("note", PROGRAM, text)


def is_language_file(file: Path | str) -> bool:
    """Whether a file holds a program in the language of a robot, such as RAPID."""
    return program_importer(file) is not None


def program_importer(file: Path | str) -> ProgramImporter | None:
    """Find the importer of a program in the language of a robot. Returns None if the file is something else.

    Args:
        file: argument of a command. Only its suffix is looked at; there may be no such file.

    Raises:
        BrokenExtension: the importer cannot be used.
        MissingExtension: an extension of this project imports such files, and it is missing.
    """
    suffix = Path(file).suffix.lower()
    if suffix in ("", *YAML_SUFFIXES, *CORE_SUFFIXES):
        # A name, a station or a robot, as in most commands: to look for extensions would take time.
        return None
    from simrob_drake.programs.program_importer import ProgramImporter

    importer = load_importer(suffix, Path(file))
    return importer if isinstance(importer, ProgramImporter) else None


def refuse_language(options: LanguageOptions) -> bool:
    """Check that no option of programs in the language of a robot is given, since there is no such program.

    Args:
        options: values of these options.

    Returns:
        value of the option ``--allow-losses``, which is not refused: importers of other files have this option, too.

    Raises:
        Unsuitable: another of these options is given.
    """
    defaults = LanguageOptions()
    chosen = {name: value for name, value in asdict(options).items() if value != getattr(defaults, name)}
    allow_losses = bool(chosen.pop("allow_losses", False))
    refuse(message("cli.belongs_to_rapid", "it belongs to RAPID modules"), **chosen)
    return allow_losses


def language_program(
    file: Path, options: LanguageOptions, set_: list[str] | None
) -> tuple[Program, StationConfig, Mapping[int, str]]:
    """Read a program in the language of a robot, to be run, and show the remarks about its lines.

    Args:
        file: the program, with the suffix of an importer of programs.
        options: options of programs in the language of a robot.
        set_: changes of the station, as the option ``--set`` takes them.

    Returns:
        the program, the station on which it is done, and for each move, by its number, its file and line.

    Raises:
        SimrobError: the program is wrong, or lines are not understood and losses are not allowed.
    """
    imported, config = _read_program(file, options, set_)
    _show_remarks(imported)
    losses = imported.losses
    if losses and not options.allow_losses:
        more = message("cli.and_more_losses", ", and {count} more", count=len(losses) - 1) if len(losses) > 1 else ""
        raise SimrobError(
            message(
                "cli.nothing_moved",
                "{first}{more}; nothing moved: --allow-losses runs it without",
                first=losses[0],
                more=more,
            )
        )
    return imported.program, config, imported.lines


def import_program(file: Path, out: Path | None, options: LanguageOptions, *, force: bool) -> ExitCode:
    """Convert a program in the language of a robot to YAML, and write the robot's station if none is named.

    Args:
        file: the program, with the suffix of an importer of programs.
        out: file for the result. None for the name of the program, in the working folder.
        options: options of programs in the language of a robot.
        force: whether to replace files that exist.

    Returns:
        BEYOND (4) if lines are lost and this is not allowed, otherwise DONE (0).

    Raises:
        SimrobError: the program cannot be read, or a file exists.
    """
    target = out or Path(f"{file.stem}.yaml")
    station = target.with_name(f"{target.stem}_station.yaml")
    new_files = [target] if options.on else [target, station]
    for file_to_write in new_files:
        check_new_file(file_to_write, force=force)
    imported, config = _read_program(file, options, None)
    written_at_once(target, imported.program.on(options.on or station.name).text())
    if options.on is None:
        written_at_once(station, station_yaml(config))
    _show_remarks(imported)
    say_place(PROGRAM, translate(compound("{file}: {time:.3f} s", file=target, time=imported.duration)))
    say_place(NEXT, f"simrob run {target}")
    losses = imported.losses
    if losses and not options.allow_losses:
        text = message(
            "cli.lost_lines",
            "lost: {count} {count:line|lines}; --allow-losses accepts the program without them",
            count=len(losses),
        )
        say_text(text, target=errors)
        return ExitCode.BEYOND
    return ExitCode.DONE


def _read_program(
    file: Path, options: LanguageOptions, set_: list[str] | None
) -> tuple[ImportedProgram, StationConfig]:
    """Read a program in the language of a robot, and find the station on which it is done.

    Args:
        file: the program, with the suffix of an importer of programs.
        options: options of programs in the language of a robot.
        set_: changes of the station, as the option ``--set`` takes them.

    Raises:
        SimrobError: neither a robot nor a station is named, or the program cannot be read.
    """
    from simrob_drake.programs.program_importer import ProgramRequest

    importer = program_importer(file)
    assert importer is not None  # the caller has looked
    if options.on is None and options.robot is None:
        raise InvalidParameter(
            "--robot", "missing", message("cli.who_does_it", "who does it, as --robot irb120; or --on a station")
        )
    if options.on is not None:
        # The robot is one of the station's; None stands for its only one.
        config = station_from(options.on, set_)
        robot = options.robot
    else:
        # The robot is one of the package's, alone on a station made for it.
        config = bare_station(str(options.robot), changes_of(set_, "--set"))
        robot = None
    request = ProgramRequest(config=config, robot=robot, signals=options.io, cycles=options.cycles, check=options.check)
    with code_of_extension(importer.owner, message("cli.the_importer", "the importer of {suffix}", suffix=file.suffix)):
        return importer.read_program(file, request), config


def _show_remarks(imported: ImportedProgram) -> None:
    """Show the remarks about lines of an imported program. Lines that are lost begin with "lost"."""
    for remark in imported.remarks:
        text = remark.text
        if remark.is_lost:
            text = message("cli.lost_line", "lost {text}", text=remark.text)
        say_text(text)
