"""The command that writes stations and programs for other software: `simrob export`."""

from collections.abc import Callable, Mapping
from dataclasses import make_dataclass
from pathlib import Path
from typing import Annotated, Any

import typer

from simrob_drake.base.errors import InvalidConfig, InvalidParameter, SimrobError
from simrob_drake.base.extension import code_of_extension
from simrob_drake.base.folders import written_at_once
from simrob_drake.cli.arguments import check_file, is_program_file, station_from
from simrob_drake.cli.options import ChosenOptions, Force, Settings, with_group, with_groups, with_mesh_path
from simrob_drake.cli.programs import program_from
from simrob_drake.cli.screen import say
from simrob_drake.programs.exporter import (
    Exporter,
    ProgramExporter,
    StationExporter,
    all_exporters,
    load_exporter,
)

_FORMATS = all_exporters()
"""Exporters by the name of their format, or the reason why one cannot be used."""


def _format_option(name: str, exporter: Exporter | SimrobError) -> tuple[str, Any, None]:
    """Describe the option ``--FORMAT FILE`` as a field of a dataclass: its name, its type, and its default.

    The option of a broken exporter is there, too: its use raises the reason.
    """
    text = f"Cannot be used: {exporter}" if isinstance(exporter, SimrobError) else exporter.help
    flag = f"--{name.replace('_', '-')}"
    option = Annotated[Path | None, typer.Option(flag, metavar="FILE", help=text)]
    return name, option, None


def _with_formats(command: Callable[..., Any]) -> Callable[..., Any]:
    """Give a command the options ``--FORMAT FILE`` of all exporters as ``files``, and their own as ``options``."""
    files = make_dataclass("Files", [_format_option(name, exporter) for name, exporter in _FORMATS.items()])
    own_options = {
        f"given with --{name}": exporter.options_class
        for name, exporter in _FORMATS.items()
        if not isinstance(exporter, SimrobError)
    }
    return with_groups(own_options, "options")(with_group(files, "files")(command))


@with_mesh_path
@_with_formats
def export(
    *,
    station: Annotated[
        str, typer.Argument(metavar="STATION|PROGRAM", help="A name from `simrob list`, or the YAML file of either.")
    ],
    files: Any,
    set_: Settings = None,
    options: ChosenOptions,
    force: Force = False,
) -> None:
    """Write a station or a program in the format of another tool.

    Installed extensions add the formats: MJCF for MuJoCo, RAPID and URScript are those of this project.

    For example:

        simrob export irb120_dynamic --mjcf irb120.xml

        simrob export program.yaml --rapid Module.mod
    """
    targets = {name: file for name, file in vars(files).items() if file is not None}
    exporters = {name: load_exporter(name) for name in targets}
    of_programs = {name: one for name, one in exporters.items() if isinstance(one, ProgramExporter)}
    of_stations = {name: one for name, one in exporters.items() if isinstance(one, StationExporter)}
    if not targets or (of_programs and of_stations):
        found = "asked for a station and a program" if targets else "asked for nothing"
        raise InvalidParameter("simrob export", found, f"given {_known_formats()}")
    for name, exporter in exporters.items():
        if exporter.suffix and targets[name].suffix != exporter.suffix:
            raise InvalidParameter(f"--{name}", str(targets[name]), f"a file that ends in {exporter.suffix}")
    options.refuse_all_but([exporter.options_class for exporter in exporters.values()])
    if of_programs:
        _export_program(station, set_, targets, of_programs, options, force=force)
    else:
        _export_station(station, set_, targets, of_stations, options, force=force)


def _export_station(
    station: str,
    set_: list[str] | None,
    targets: Mapping[str, Path],
    exporters: Mapping[str, StationExporter],
    options: ChosenOptions,
    *,
    force: bool,
) -> None:
    """Write a station in one or several formats, one after the other.

    Raises:
        SimrobError: there is no such station, a format cannot express it, or a file exists.
    """
    config = station_from(station, set_)
    for name, exporter in exporters.items():
        check_file(targets[name], force=force)
        with code_of_extension(exporter.owner, f"the exporter {name}"):
            written = exporter.export_station(config, targets[name], options.of(exporter.options_class), force=force)
        for path in written:
            say(f"written {path}")


def _known_formats() -> str:
    """List the options of all formats, those of stations and those of programs."""
    usable = {name: exporter for name, exporter in _FORMATS.items() if not isinstance(exporter, SimrobError)}
    of_stations = [f"--{name}" for name, exporter in usable.items() if isinstance(exporter, StationExporter)]
    of_programs = [f"--{name}" for name, exporter in usable.items() if isinstance(exporter, ProgramExporter)]
    listed = [" or ".join(names) for names in (of_stations, of_programs) if names]
    return ", or ".join(listed) or "a format of an installed extension, and none adds one"


def _export_program(
    source: str,
    set_: list[str] | None,
    targets: Mapping[str, Path],
    exporters: Mapping[str, ProgramExporter],
    options: ChosenOptions,
    *,
    force: bool,
) -> None:
    """Write a program in one or several formats: all files, or none if one of them cannot be written.

    Raises:
        SimrobError: the source is no program, it cannot be done, or a format cannot express it.
    """
    if not is_program_file(source):
        formats = " and ".join(f"--{name}" for name in exporters)
        raise InvalidConfig(source, "", f"is no program: {formats} write the moves of one")
    program, config = program_from(source, set_)
    texts = dict[Path, str]()
    remarks = dict[str, None]()  # a set in the order of insertion: formats may have the same remarks
    for name, exporter in exporters.items():
        own_options = options.of(exporter.options_class)
        with code_of_extension(exporter.owner, f"the exporter {name}"):
            found = exporter.program_texts(program, config, targets[name], own_options, source=source)
        texts |= found.texts
        remarks |= dict.fromkeys(found.remarks)
    for file in texts:
        check_file(file, force=force)
    for file, text in texts.items():
        written_at_once(file, text)
        say(f"written {file}")
    for remark in remarks:
        say(remark)


COMMANDS: dict[str, Callable[..., Any]] = {"export": export}
