"""RAPID programs from the command line: run, imported, exported; and URScript, exported."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from simrob_drake.cli import ExitCode
from simrob_drake.cli.arguments import changes_of, check_file, is_program_file, refuse, station_from
from simrob_drake.cli.options import RapidOptions
from simrob_drake.cli.programs import program_from
from simrob_drake.cli.screen import console, errors
from simrob_drake.errors import InvalidConfig, InvalidParameter, SimrobError
from simrob_drake.folders import written_at_once
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.load import bare_station, station_yaml

if TYPE_CHECKING:  # few commands need programs, which load scipy
    from simrob_drake.programs.program import Program
    from simrob_drake.rapid.importing import Imported

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


def module_program(file: Path, options: RapidOptions, set_: list[str] | None) -> tuple[Program, StationConfig]:
    """Return the program of a RAPID module, and the station on which it is done.

    Raises:
        SimrobError: what is wrong or not understood, unless losses are allowed; names the file and the line.
    """
    imported, config = _imported(file, options, set_)
    _tell(imported)
    if imported.lost and not options.allow_losses:
        more = f", and {len(imported.lost) - 1} more" if len(imported.lost) > 1 else ""
        raise SimrobError(f"{imported.lost[0]}{more}; nothing moved: --allow-losses runs it without")
    return imported.program, config


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
    console.print(f"program {target}: {imported.time:.3f} s", soft_wrap=True, highlight=False)
    console.print(f"next    simrob run {target}", soft_wrap=True, highlight=False)
    if imported.lost and not options.allow_losses:
        errors.print(f"lost: {len(imported.lost)} lines; --allow-losses takes the program as it is", highlight=False)
        return ExitCode.BEYOND
    return ExitCode.DONE


def export_program(
    file: str, set_: list[str] | None, rapid: Path | None, urscript: Path | None, *, force: bool
) -> None:
    """Write a program as a RAPID module, with a table of its signals beside it, and as URScript.

    Raises:
        SimrobError: no program, or one that cannot be done or said.
    """
    from simrob_drake.programs.arm import Workcell
    from simrob_drake.rapid.exporting import ExportedProgram, rapid_text, urscript_text

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
        console.print(f"written {target}", soft_wrap=True, highlight=False)
    for remark in steps.remarks:
        console.print(remark, soft_wrap=True, highlight=False, markup=False)


def _imported(file: Path, options: RapidOptions, set_: list[str] | None) -> tuple[Imported, StationConfig]:
    from simrob_drake.rapid.importing import import_rapid

    if options.on is None and options.robot is None:
        raise InvalidParameter("--robot", "missing", "who does it, as --robot irb120; or --on a station")
    if options.on is not None:
        config, robot = station_from(options.on, set_), options.robot
    else:
        config, robot = bare_station(str(options.robot), changes_of(set_, "--set")), None
    return import_rapid(file, config, robot=robot, signals=options.io, cycles=options.cycles), config


def _tell(imported: Imported) -> None:
    for remark in imported.remarks:
        mark = "lost " if remark.lost else ""
        console.print(f"{mark}{remark}", soft_wrap=True, highlight=False, markup=False)
