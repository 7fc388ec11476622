"""The command that writes stations and programs for other software: `simrob export`.

An *exporter* is a class of an extension that writes one *format*, such as MJCF. It takes either stations or programs.
The command has an option ``--FORMAT FILE`` for each exporter, and the further options of all exporters.
"""

from collections.abc import Callable, Mapping
from dataclasses import make_dataclass
from pathlib import Path
from typing import Annotated, Any

import typer

from simrob_drake.base.errors import InvalidConfig, InvalidParameter, SimrobError
from simrob_drake.base.extension import code_of_extension
from simrob_drake.base.folders import check_ending, check_new_file, written_at_once
from simrob_drake.base.messages import Message, join_texts, message
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

# The formats are options of the command, so they are needed when this module is imported.
_FORMATS = all_exporters()
"""Exporters by the name of their format, or the reason why one cannot be used."""


def _format_option(name: str, exporter: Exporter | SimrobError) -> tuple[str, Any, None]:
    """Describe the option ``--FORMAT FILE`` as a field for `make_dataclass`: its name, its type, and its default None.

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
    fields = [_format_option(name, exporter) for name, exporter in _FORMATS.items()]
    files_class = make_dataclass("Files", fields)
    further_options = list[OptionGroup]()
    for name, exporter in _FORMATS.items():
        if not isinstance(exporter, SimrobError):
            further_options.append(
                OptionGroup(owner=flag_of(name), options_class=exporter.options_class)
            )
    # The command is wrapped twice: typer sees the options of both groups.
    with_files = with_group(files_class, "files")(command)
    return with_groups(further_options, "options")(with_files)


@with_mesh_path
@_with_formats
def export(
    *,
    station: Annotated[
        str,
        typer.Argument(
            metavar="STATION|PROGRAM",
            help=message(
                "cli.help_export_station",
                "A name from `simrob list`, or the YAML file of a station or a program.",
            ),
        ),
    ],
    files: Any,
    set_: Settings = None,
    options: ChosenOptions,
    force: Force = False,
) -> None:
    """Write a station or a program in the format of another tool.

    Installed extensions add the formats: those of this project are MJCF for MuJoCo; model directives, scenarios, URDF
    and SDF for Drake; RAPID and URScript.

    For example:

        simrob export irb120_dynamic --mjcf irb120.xml

        simrob export irb120_dynamic --dmd irb120.dmd.yaml

        simrob export program.yaml --rapid Module.mod
    """
    # The fields of the dataclass are the formats, and None is the value of an option that is not given.
    targets = {name: file for name, file in vars(files).items() if file is not None}
    if not targets:
        raise _wrong_formats(message("cli.asked_for_nothing", "called without a format"))
    # For a format that cannot be used, this raises the error that says why.
    exporters = {name: load_exporter(name) for name in targets}
    program_exporters = {
        name: one for name, one in exporters.items() if isinstance(one, ProgramExporter)
    }
    station_exporters = {
        name: one for name, one in exporters.items() if isinstance(one, StationExporter)
    }
    # The argument is either a station or a program, so one of the formats could not be written.
    if program_exporters and station_exporters:
        raise _wrong_formats(
            message("cli.asked_for_both", "called with formats of stations and formats of programs")
        )
    for name, exporter in exporters.items():
        # The suffix is empty for a format whose files have any suffix.
        if exporter.suffix:
            check_ending(targets[name], [exporter.suffix], flag_of(name))
    _check_targets_differ(targets)
    # An option of a format that was not asked for would have no effect.
    options.refuse_all_but([exporter.options_class for exporter in exporters.values()])
    if program_exporters:
        _export_program(station, set_, targets, program_exporters, options, force=force)
    else:
        _export_station(station, set_, targets, station_exporters, options, force=force)


def _wrong_formats(problem: Message) -> InvalidParameter:
    """Make the error for a command with no format, or with formats of stations and of programs.

    Args:
        problem: what the user asked for.
    """
    return InvalidParameter(
        message("cli.simrob_export", "simrob export"),
        problem,
        message("cli.given_formats", "called with {formats}", formats=_known_formats()),
    )


def _check_targets_differ(targets: Mapping[str, Path]) -> None:
    """Check that no two formats are written into the same file.

    Args:
        targets: file to write for each format, by the format's name.

    Raises:
        InvalidParameter: two formats have the same file.
    """
    # Absolute paths are compared, since a file has several relative ones.
    format_of_file = dict[Path, str]()
    for name, file in targets.items():
        # `setdefault` returns the format of an earlier entry, if there is one with this file.
        first = format_of_file.setdefault(file.resolve(), name)
        if first != name:
            raise InvalidParameter(
                flag_of(name),
                str(file),
                message(
                    "cli.other_file_than",
                    "a different file from that of {option}",
                    option=flag_of(first),
                ),
            )


def _export_station(
    station: str,
    settings: list[str] | None,
    targets: Mapping[str, Path],
    exporters: Mapping[str, StationExporter],
    options: ChosenOptions,
    *,
    force: bool,
) -> None:
    """Write a station in one or several formats, one after the other.

    Args:
        station: name or file of the station.
        settings: changes of the station, as the option ``--set`` takes them.
        targets: file to write for each format, by the format's name.
        exporters: exporter of each format, by the format's name.
        options: values of the further options of all exporters.
        force: whether to replace files that exist.

    Raises:
        SimrobError: there is no such station, a format cannot express it, or a file exists. Formats before that one are
            written.
    """
    config = station_from(station, settings)
    for name, exporter in exporters.items():
        # The exporter itself writes the file, and further ones next to it, such as meshes.
        check_new_file(targets[name], force=force)
        with code_of_extension(
            exporter.owner, message("cli.the_exporter", "the exporter {name}", name=name)
        ):
            written = exporter.export_station(
                config, targets[name], options.of(exporter.options_class), force=force
            )
        for path in written:
            say_place(WRITTEN, path)


def _known_formats() -> str:
    """List the options of all formats for a message: "--mjcf, or --rapid or --urscript".

    Formats of stations come first, then those of programs. Formats that cannot be used are left out.
    """
    station_flags = [
        flag_of(name)
        for name, exporter in _FORMATS.items()
        if isinstance(exporter, StationExporter)
    ]
    program_flags = [
        flag_of(name)
        for name, exporter in _FORMATS.items()
        if isinstance(exporter, ProgramExporter)
    ]
    separator = message("cli.or", " or ")
    # A user may combine formats of one of the two lists only, so the lists are separated by a comma.
    lists = [join_texts(flags, separator) for flags in (station_flags, program_flags) if flags]
    if not lists:
        return message(
            "cli.format_of_extension",
            "a format of an extension, but no installed extension has one",
        )
    return join_texts(lists, message("cli.or_format", ", or "))


def _export_program(
    source: str,
    settings: list[str] | None,
    targets: Mapping[str, Path],
    exporters: Mapping[str, ProgramExporter],
    options: ChosenOptions,
    *,
    force: bool,
) -> None:
    """Write a program in one or several formats. Nothing is written if one of the formats cannot express the program.

    Args:
        source: file of the program.
        settings: changes of the program's station, as the option ``--set`` takes them.
        targets: file to write for each format, by the format's name.
        exporters: exporter of each format, by the format's name.
        options: values of the further options of all exporters.
        force: whether to replace files that exist.

    Raises:
        SimrobError: the source is no program, the program cannot be done, a format cannot express it, or a file exists.
    """
    if not is_program_file(source):
        formats = join_texts([flag_of(name) for name in exporters], message("base.and", " and "))
        problem = message(
            "cli.no_program",
            "is not a program; only programs can be exported with {formats}",
            formats=formats,
        )
        raise InvalidConfig(source, "", problem)
    program, config = program_from(source, settings)
    # Text of each file. A format may have several files.
    texts = dict[Path, str]()
    # A set that keeps the order: two formats may have the same remark.
    remarks = dict[str, None]()
    for name, exporter in exporters.items():
        own_options = options.of(exporter.options_class)
        with code_of_extension(
            exporter.owner, message("cli.the_exporter", "the exporter {name}", name=name)
        ):
            exported = exporter.program_texts(
                program, config, targets[name], own_options, source=source
            )
        texts |= exported.texts
        remarks |= dict.fromkeys(exported.remarks)
    # All texts are made, and all files checked, before the first is written.
    for file in texts:
        check_new_file(file, force=force)
    for file, text in texts.items():
        written_at_once(file, text)
        say_place(WRITTEN, file)
    for remark in remarks:
        say_text(remark)


COMMANDS: dict[str, Callable[..., Any]] = {"export": export}
