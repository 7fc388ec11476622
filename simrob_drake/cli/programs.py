"""Run, check and import programs from the command line.

A *program* is a list of moves that the robots of one station make: arms, or a legged robot. It has a YAML file of its
own, or is a section of a station's file (a *carried* program). Programs in the language of a robot, such as RAPID,
are read by importers of extensions. Lines of theirs that have no counterpart here are *losses*: the program runs
without them only if the user accepts that with ``--allow-losses``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
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
from simrob_drake.cli.saving import Frames, done_in_workcell, locomotion_sentence
from simrob_drake.cli.screen import NEXT, PROGRAM, errors, say_place, say_text
from simrob_drake.importer.importer import CORE_SUFFIXES, load_importer
from simrob_drake.results.record.run import move_title
from simrob_drake.results.result import SimulationResult
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.file_paths import station_with_absolute_path
from simrob_drake.stations.findings import Finding
from simrob_drake.stations.load import bare_station, station_yaml

# Few commands need programs, which load scipy. The functions that need them import them.
if TYPE_CHECKING:
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
    """Run a program on a station, and save and show all of its moves as one result.

    Args:
        program: the program.
        config: the station.
        saving: how the result is shown and saved.
        frames: frames of the film strip.
        file: file of the program, for messages.
        lines: for a program in the language of a robot, its file and line for each move, by the index of the move.
            They are the names of the moves in the verdict. Empty for other programs.

    Returns:
        exit code of the run.

    Raises:
        SimrobError: the robots cannot do the program.
    """
    from simrob_drake.programs.whole_program import of_arms, perform

    def prepare(cell: Workcell) -> Callable[[], tuple[SimulationResult, str]]:
        """Return the function that does the program in a workcell. Nothing is checked before: `perform` does that."""

        def do_program() -> tuple[SimulationResult, str]:
            """Do the program. Returns the run, and a sentence about how far a legged robot moved; empty for arms."""
            result = perform(cell, program, file)
            # The base of an arm is fixed, so there is nothing to say about how far it moved.
            remark = ""
            if not of_arms(cell, program):
                remark = locomotion_sentence(result, cell.robot_name(program.robot))
            return _with_lines_as_places(result, lines), remark

        return do_program

    return done_in_workcell(config, saving, prepare, frames)


def _with_lines_as_places(result: SimulationResult, lines: Mapping[int, str]) -> SimulationResult:
    """Copy a result in which moves are named by their lines in the user's file, instead of as "move 3".

    Args:
        result: the result.
        lines: file and line of each move, by its index. Moves without an entry keep their names.
    """
    # A run knows its move only by the title that the core gave to it.
    line_of_title = {str(move_title(index)): line for index, line in lines.items()}
    runs = []
    for run in result.runs:
        line = line_of_title.get(run.place)
        runs.append(run if line is None else run.at_place(line))
    return replace(result, runs=tuple(runs))


def own_program(config: StationConfig) -> Program:
    """Read the program that a station carries.

    Raises:
        InvalidConfig: the station has no program, or a damaged one.
    """
    from simrob_drake.programs.whole_program import carried_program

    program = carried_program(config)
    if program is None:
        raise InvalidConfig(
            config.name,
            "program",
            message("cli.missing_moves", "this key is required: the moves of the robots"),
        )
    return program


def program_from(file: str, settings: list[str] | None) -> tuple[Program, StationConfig]:
    """Read a program's file, and the station that it names.

    Args:
        file: file of the program.
        settings: changes of the station, as the option ``--set`` takes them.

    Returns:
        the program, and the station with the changes.

    Raises:
        InvalidConfig: the program is damaged, or names no station.
        SimrobError: the station or a change is wrong.
    """
    from simrob_drake.programs.program import Program

    program = Program.load(file)
    if program.station is None:
        raise InvalidConfig(
            file,
            "station",
            message(
                "cli.missing_station",
                "this key is required: the name or the file of the station in which the program runs",
            ),
        )
    # A path in the program's file is relative to the folder of this file, not to the working folder.
    station = station_with_absolute_path(program.station, Path(file))
    return program, station_from(station, settings)


def check_program(program: Program, config: StationConfig, file: str = "") -> Finding:
    """Check that the robots of a station can do a program, without running it.

    Args:
        program: the program.
        config: the station.
        file: file of the program, for messages. Empty for the program that the station carries.

    Returns:
        how many moves can be done, for the table of findings. It is a note, not "ok", if a move can only be checked
        by a simulation.

    Raises:
        SimrobError: the robots cannot do a move; the message names the file and the move.
    """
    from simrob_drake.programs.arm import Workcell
    from simrob_drake.programs.legged_robot import LeggedRobot
    from simrob_drake.programs.stages import stages_of_program
    from simrob_drake.programs.timeline import Timeline
    from simrob_drake.programs.whole_program import of_arms

    cell = Workcell(config)
    move_count = len(program.moves)
    # Changes of the station at times of the program, such as a piece that appears, must fit the station, too.
    Timeline(program.grid, program.changes).check(config)
    if not of_arms(cell, program):
        # The stages are planned for the errors of the planner only; nothing is run.
        stages_of_program(LeggedRobot(cell, program.robot), program, cell.config, file)
        text = message("cli.moves_can_be_done", "{moves} moves can be done", moves=move_count)
        # An automatic program has cells instead of moves: postures to which a sequencer leads the robot.
        if not move_count:
            text = message("cli.cells_can_be_reached", "all of its cells can be reached")
        return Finding("ok", PROGRAM, text)
    # The rehearsal ends before a move that depends on the simulation, such as on where a piece falls.
    checked_count, duration = cell.rehearse(program, file)
    if checked_count == move_count:
        text = message(
            "cli.entries_can_be_done",
            "{moves} entries can be done, in {time:.4g} s",
            moves=move_count,
            time=duration,
        )
        return Finding("ok", PROGRAM, text)
    text = message(
        "cli.program_depends_on_fall",
        "{seen} of {moves} entries can be done, in {time:.4g} s; {move} depends on where a piece falls",
        seen=checked_count,
        moves=move_count,
        time=duration,
        # The count of the checked moves is the index of the first move that was not checked.
        move=move_title(checked_count),
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
        # The argument of most commands is a name, a station or a robot. Searching the installed extensions would only
        # delay these commands.
        return None
    from simrob_drake.programs.program_importer import ProgramImporter

    importer = load_importer(suffix, Path(file))
    return importer if isinstance(importer, ProgramImporter) else None


def refuse_language(options: LanguageOptions) -> bool:
    """Check that no option of programs in the language of a robot is given, for a command with another file.

    Args:
        options: values of the options.

    Returns:
        value of the option ``--allow-losses``, which is not refused: importers of other files have this option, too.

    Raises:
        Unsuitable: another one of the options is given.
    """
    # A value equal to its default has no effect, so it counts as not given.
    defaults = LanguageOptions()
    chosen = {
        name: value for name, value in asdict(options).items() if value != getattr(defaults, name)
    }
    allow_losses = bool(chosen.pop("allow_losses", False))
    refuse(message("cli.belongs_to_rapid", "the option belongs to RAPID modules"), **chosen)
    return allow_losses


def language_program(
    file: Path, options: LanguageOptions, settings: list[str] | None
) -> tuple[Program, StationConfig, Mapping[int, str]]:
    """Read a program in the language of a robot, to be run, and show the remarks about its lines.

    Args:
        file: the program, with the suffix of an importer of programs.
        options: options of programs in the language of a robot.
        settings: changes of the station, as the option ``--set`` takes them.

    Returns:
        the program, the station on which it is done, and the file and line of each move by its index.

    Raises:
        SimrobError: the program is wrong, or lines are not understood and losses are not allowed.
    """
    imported, config = _read_program(file, options, settings)
    _show_remarks(imported)
    if imported.losses and not options.allow_losses:
        raise _losses_error(imported.losses)
    return imported.program, config, imported.lines


def _losses_error(losses: Sequence[str]) -> SimrobError:
    """Make the error for a program with lost lines, which is not run.

    Args:
        losses: sentences about the lost lines, at least one. The message contains the first, and the count of the rest.
    """
    # One loss explains the refusal. Many would fill the screen, and `simrob import` lists all of them.
    rest_count = len(losses) - 1
    rest = (
        message("cli.and_more_losses", ", and {count} more", count=rest_count) if rest_count else ""
    )
    text = message(
        "cli.nothing_moved",
        "{first}{more}; the program was not run: --allow-losses runs it without these lines",
        first=losses[0],
        more=rest,
    )
    return SimrobError(text)


def import_program(
    file: Path, out: Path | None, options: LanguageOptions, *, force: bool
) -> ExitCode:
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
    # All files are checked before the program is read, which may take long, and before one of them is written.
    for file_to_write in new_files:
        check_new_file(file_to_write, force=force)
    # A converted program takes no changes of a station: they belong to the run of it.
    imported, config = _read_program(file, options, None)
    # The two files are in one folder, so the program names its station by the file's name alone.
    station_name = options.on or station.name
    written_at_once(target, imported.program.on(station_name).text())
    if options.on is None:
        written_at_once(station, station_yaml(config))
    _show_remarks(imported)
    say_place(
        # The time needs the decimal sign of the language, which `say_place` does not apply to a place.
        PROGRAM,
        translate(compound("{file}: {time:.3f} s", file=target, time=imported.duration)),
    )
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
    file: Path, options: LanguageOptions, settings: list[str] | None
) -> tuple[ImportedProgram, StationConfig]:
    """Read a program in the language of a robot, and find the station on which it is done.

    Args:
        file: the program, with the suffix of an importer of programs.
        options: options of programs in the language of a robot.
        settings: changes of the station, as the option ``--set`` takes them.

    Returns:
        the program with the remarks about its lines, and the station with the changes.

    Raises:
        SimrobError: neither a robot nor a station is named, or the program cannot be read.
    """
    from simrob_drake.programs.program_importer import ProgramRequest

    importer = program_importer(file)
    # Callers have checked the file with `is_language_file`.
    assert importer is not None
    if options.on is None and options.robot is None:
        raise InvalidParameter(
            "--robot",
            "missing",
            message(
                "cli.who_does_it",
                "the robot that runs the program, such as --robot irb120, or a station with --on",
            ),
        )
    if options.on is not None:
        # The robot is one of the station's; None stands for its only one.
        config = station_from(options.on, settings)
        robot = options.robot
    else:
        # The robot is named or given by its file, and alone on a station made for it.
        config = bare_station(str(options.robot), changes_of(settings, "--set"))
        robot = None
    # The options of the command line become those of an importer, which is code of an extension.
    request = ProgramRequest(
        config=config,
        robot=robot,
        signals=options.io,
        cycles=options.cycles,
        check=options.check,
    )
    # An error that no user can cause is reported as one of the extension's package.
    blamed_part = message("cli.the_importer", "the importer of {suffix}", suffix=file.suffix)
    with code_of_extension(importer.owner, blamed_part):
        return importer.read_program(file, request), config


def _show_remarks(imported: ImportedProgram) -> None:
    """Show the remarks about lines of an imported program. Lines that are lost begin with "lost"."""
    for remark in imported.remarks:
        text = remark.text
        if remark.is_lost:
            text = message("cli.lost_line", "lost: {text}", text=remark.text)
        say_text(text)
