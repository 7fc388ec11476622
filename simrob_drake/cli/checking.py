"""The command `simrob check`: it examines stations, programs, robots and files of other tools before any run.

The argument decides what is examined. Each of these has its own options. An option that would have no effect on the
argument is refused, so that no user believes that it had one.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer

from simrob_drake.base.messages import message
from simrob_drake.cli.arguments import refuse, refuse_import, station_from
from simrob_drake.cli.importers import (
    examine_with,
    importer_request,
    other_importer,
    with_importer_options,
)
from simrob_drake.cli.options import AllowCode, ChosenOptions, Settings, with_import_options
from simrob_drake.cli.programs import check_program, own_program, program_from
from simrob_drake.cli.robots import examine_file, show_robot
from simrob_drake.cli.screen import console
from simrob_drake.cli.tables import findings_table
from simrob_drake.importer.named_robots import read_robot
from simrob_drake.importer.robot_files import is_robot_file
from simrob_drake.programs.program_files import is_program_file
from simrob_drake.robots.catalog import robot_names
from simrob_drake.robots.description_files import is_description_file
from simrob_drake.robots.imports import ImportOptions
from simrob_drake.simulation import Runner
from simrob_drake.stations.checks import check_station
from simrob_drake.stations.findings import Finding


@with_importer_options("reading_class")
@with_import_options("mesh_path", "estimate_inertia", "xacro_arg", "drop_loops")
def check(
    *,
    station: Annotated[
        str,
        typer.Argument(
            metavar="STATION|ROBOT|FILE",
            help=message(
                "cli.help_check_station",
                "A station, a program, a robot or its file, a Simulink model, or a CAD assembly.",
            ),
        ),
    ],
    set_: Settings = None,
    options: ImportOptions | None,
    allow_code: AllowCode = False,
    all_: Annotated[
        bool,
        typer.Option(
            "--all",
            help=message(
                "cli.help_check_all",
                "Show a row for each axis of a station, even if it is far from its torque limit.",
            ),
        ),
    ] = False,
    importer_options: ChosenOptions,
) -> None:
    """Report before any run what will go wrong in a station, what a robot can carry, or what an import would do.

    For example:

        simrob check irb120_dynamic --set servo.kp=300

        simrob check arm.urdf
    """
    # A file of another tool, such as a Simulink model, is examined by the extension that imports it.
    importer = other_importer(station)
    if importer is not None:
        refuse(
            message(
                "cli.is_file_of_other_tool",
                "this is a file of another tool; the option belongs to stations",
            ),
            allow_code=allow_code,
            all_=all_,
        )
        request = importer_request(importer, "reading_class", importer_options, options, set_)
        examine_with(importer, Path(station), request)
        return
    # The core reads all other arguments, so the options of importers have no effect on them.
    importer_options.refuse_all_but([])
    # The order of the tests matters: names of stations come last, because any text may be one.
    if is_program_file(station):
        refuse(
            message("cli.program_has_one_row", "this is a program, whose check has one row"),
            all_=all_,
        )
        _check_program_file(station, set_, options, allow_code=allow_code)
    elif is_robot_file(station) or is_description_file(station):
        refuse(
            message(
                "cli.is_file_of_robot",
                "this is the file of a robot; the option belongs to stations",
            ),
            set_=set_,
            allow_code=allow_code,
            all_=all_,
        )
        _check_robot_file(station, options)
    elif station in robot_names():
        refuse(
            message("cli.is_a_robot", "this is a robot; the option belongs to stations"),
            set_=set_,
            allow_code=allow_code,
            all_=all_,
        )
        refuse_import(
            message(
                "cli.robot_of_package", "this robot comes with the package, and nothing is imported"
            ),
            options,
        )
        show_robot(read_robot(station))
    else:
        _check_station(station, set_, options, allow_code=allow_code, show_all=all_)


def _check_program_file(
    file: str,
    settings: list[str] | None,
    options: ImportOptions | None,
    *,
    allow_code: bool,
) -> None:
    """Show whether the robots of the station that a program names can do the program.

    Args:
        file: file of the program.
        settings: changes of the station, as the option ``--set`` takes them.
        options: options of imports, of which only ``--mesh-path`` may be given. None if none is given.
        allow_code: the option ``--allow-code``, which must not be given.

    Raises:
        SimrobError: the robots cannot do the program, or an option is given that has no effect on a program.
    """
    refuse_import(
        message("cli.is_a_program", "this is a program; the option belongs to the file of a robot"),
        _without_mesh_path(options),
    )
    refuse(
        message("cli.program_without_code", "this is a program, which names no code"),
        allow_code=allow_code,
    )
    # The station of the program may have changes, so --set has an effect here.
    program, config = program_from(file, settings)
    # A wrong move is an error of `check_program`, so the table has this one row only.
    console.print(findings_table([check_program(program, config, file)]))


def _check_robot_file(file: str, options: ImportOptions | None) -> None:
    """Show the axes of a robot, the mass that it can carry, and what an import of its file would change.

    Args:
        file: a file of another tool, such as a URDF, or a description of a robot in YAML.
        options: options of the import. None if none is given. A description takes none: it is read as it is, and its
            URDF is only imported, without options, if Drake cannot read it.
    """
    if is_robot_file(file):
        examine_file(Path(file), options)
        return
    refuse_import(
        message(
            "cli.is_description_of_robot",
            "this is the description of a robot, and nothing is imported",
        ),
        options,
    )
    show_robot(read_robot(file))


def _check_station(
    station: str,
    settings: list[str] | None,
    options: ImportOptions | None,
    *,
    allow_code: bool,
    show_all: bool,
) -> None:
    """Show the findings about a station, and about the program that it carries, if it has one.

    Args:
        station: name or file of the station.
        settings: changes of the station, as the option ``--set`` takes them.
        options: options of imports, of which only ``--mesh-path`` may be given. None if none is given.
        allow_code: whether Python code that the station's file names may be run.
        show_all: whether to show a row for each axis.

    Raises:
        SimrobError: the station cannot be run, or another option of imports is given.
    """
    refuse_import(
        message("cli.is_a_station", "this is a station; the option belongs to the file of a robot"),
        _without_mesh_path(options),
    )
    config = station_from(station, settings, allow_code=allow_code)
    # The engine of the station may be another tool, which has limits of its own.
    Runner(config).check()
    program_findings = list[Finding]()
    if config.program is not None:
        program_findings.append(check_program(own_program(config), config))
    console.print(findings_table([*check_station(config), *program_findings], show_all=show_all))


def _without_mesh_path(options: ImportOptions | None) -> ImportOptions | None:
    """Options of imports that stations and programs do not take: all but ``--mesh-path``, which holds for all files."""
    if options is None:
        return None
    return options.model_copy(update={"mesh_path": ()})


COMMANDS: dict[str, Callable[..., Any]] = {"check": check}
