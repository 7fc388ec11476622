"""The command that writes stations and programs for other software: `simrob export`."""

from collections.abc import Callable, Mapping
from dataclasses import make_dataclass
from pathlib import Path
from typing import Annotated, Any

import typer

from simrob_drake.base.errors import InvalidConfig, InvalidParameter, SimrobError
from simrob_drake.base.extension import code_of_extension
from simrob_drake.base.folders import check_ending, check_new_file, written_at_once
from simrob_drake.base.messages import join_texts, message
from simrob_drake.cli.arguments import station_from
from simrob_drake.cli.options import (
    ChosenOptions,
    Force,
    OptionGroup,
    Settings,
    flag_of,
    with_group,
    with_groups,
    with_mesh_path,
)
from simrob_drake.cli.programs import program_from
from simrob_drake.cli.screen import WRITTEN, say_place, say_text
from simrob_drake.programs.exporter import (
    Exporter,
    ProgramExporter,
    StationExporter,
    all_exporters,
    load_exporter,
)
from simrob_drake.programs.program_files import is_program_file

_FORMATS = all_exporters()
"""Exporters by the name of their format, or the reason why one cannot be used."""


def _format_option(name: str, exporter: Exporter | SimrobError) -> tuple[str, Any, None]:
    """Describe the option ``--FORMAT FILE`` as a field of a dataclass: its name, its type, and its default.

    An exporter that cannot be used has an option, too: `export` raises the error if a user gives the option.

    Args:
        name: name of the format.
        exporter: the exporter, or the error that says why it cannot be used.
    """
    text: str
    if isinstance(exporter, SimrobError):
        text = message("cli.cannot_be_used", "Cannot be used: {problem}", problem=exporter)
    else:
        text = exporter.help
    option = Annotated[Path | None, typer.Option(flag_of(name), metavar="FILE", help=text)]
    return name, option, None


def _with_formats(command: Callable[..., Any]) -> Callable[..., Any]:
    """Give a command the options of all exporters.

    The command takes the options ``--FORMAT FILE`` as ``files``, and the further options of the exporters
    (`options_class`) as ``options``.
    """
    files = make_dataclass("Files", [_format_option(name, exporter) for name, exporter in _FORMATS.items()])
    further_options = [
        OptionGroup(owner=flag_of(name), options_class=exporter.options_class)
        for name, exporter in _FORMATS.items()
        if not isinstance(exporter, SimrobError)
    ]
    return with_groups(further_options, "options")(with_group(files, "files")(command))


@with_mesh_path
@_with_formats
def export(
    *,
    station: Annotated[
        str,
        typer.Argument(
            metavar="STATION|PROGRAM",
            help=message("cli.help_export_station", "A name from `simrob list`, or the YAML file of either."),
        ),
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
        found = (
            message("cli.asked_for_both", "asked for a station and a program")
            if targets
            else message("cli.asked_for_nothing", "asked for nothing")
        )
        raise InvalidParameter(
            message("cli.simrob_export", "simrob export"),
            found,
            message("cli.given_formats", "given {formats}", formats=_known_formats()),
        )
    for name, exporter in exporters.items():
        if exporter.suffix:
            check_ending(targets[name], [exporter.suffix], flag_of(name))
    _check_targets_differ(targets)
    options.refuse_all_but([exporter.options_class for exporter in exporters.values()])
    if of_programs:
        _export_program(station, set_, targets, of_programs, options, force=force)
    else:
        _export_station(station, set_, targets, of_stations, options, force=force)


def _check_targets_differ(targets: Mapping[str, Path]) -> None:
    """Check that no two formats are written into the same file.

    Args:
        targets: file to write for each format, by the format's name.

    Raises:
        InvalidParameter: two formats have the same file.
    """
    formats = dict[Path, str]()  # by absolute path of the file
    for name, file in targets.items():
        first = formats.setdefault(file.resolve(), name)
        if first != name:
            raise InvalidParameter(
                flag_of(name),
                str(file),
                message("cli.other_file_than", "another file than that of {option}", option=flag_of(first)),
            )


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

    Args:
        station: name or file of the station.
        set_: changes of the station, as the option ``--set`` takes them.
        targets: file to write for each format, by the format's name.
        exporters: exporter of each format, by the format's name.
        options: values of the further options of all exporters.
        force: whether to replace files that exist.

    Raises:
        SimrobError: there is no such station, a format cannot express it, or a file exists. Formats before that one are
            written.
    """
    config = station_from(station, set_)
    for name, exporter in exporters.items():
        check_new_file(targets[name], force=force)
        with code_of_extension(exporter.owner, message("cli.the_exporter", "the exporter {name}", name=name)):
            written = exporter.export_station(config, targets[name], options.of(exporter.options_class), force=force)
        for path in written:
            say_place(WRITTEN, path)


def _known_formats() -> str:
    """List the options of all formats for a message: "--mjcf, or --rapid or --urscript".

    Formats of stations come first, then those of programs. Formats that cannot be used are left out.
    """
    of_stations = [flag_of(name) for name, exporter in _FORMATS.items() if isinstance(exporter, StationExporter)]
    of_programs = [flag_of(name) for name, exporter in _FORMATS.items() if isinstance(exporter, ProgramExporter)]
    either = message("cli.or", " or ")
    listed = [join_texts(flags, either) for flags in (of_stations, of_programs) if flags]
    return join_texts(listed, message("cli.or_format", ", or ")) or message(
        "cli.format_of_extension", "a format of an installed extension, and none adds one"
    )


def _export_program(
    source: str,
    set_: list[str] | None,
    targets: Mapping[str, Path],
    exporters: Mapping[str, ProgramExporter],
    options: ChosenOptions,
    *,
    force: bool,
) -> None:
    """Write a program in one or several formats. Nothing is written if one of the formats cannot express the program.

    Args:
        source: file of the program.
        set_: changes of the program's station, as the option ``--set`` takes them.
        targets: file to write for each format, by the format's name.
        exporters: exporter of each format, by the format's name.
        options: values of the further options of all exporters.
        force: whether to replace files that exist.

    Raises:
        SimrobError: the source is no program, the program cannot be done, a format cannot express it, or a file exists.
    """
    if not is_program_file(source):
        formats = join_texts([flag_of(name) for name in exporters], message("base.and", " and "))
        raise InvalidConfig(
            source, "", message("cli.no_program", "is no program: {formats} write the moves of one", formats=formats)
        )
    program, config = program_from(source, set_)
    texts = dict[Path, str]()
    remarks = dict[str, None]()  # a set that keeps the order. Two formats may have the same remark
    for name, exporter in exporters.items():
        own_options = options.of(exporter.options_class)
        with code_of_extension(exporter.owner, message("cli.the_exporter", "the exporter {name}", name=name)):
            found = exporter.program_texts(program, config, targets[name], own_options, source=source)
        texts |= found.texts
        remarks |= dict.fromkeys(found.remarks)
    for file in texts:
        check_new_file(file, force=force)
    for file, text in texts.items():
        written_at_once(file, text)
        say_place(WRITTEN, file)
    for remark in remarks:
        say_text(remark)


COMMANDS: dict[str, Callable[..., Any]] = {"export": export}
