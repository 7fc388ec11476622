"""The command that looks at stations, programs, robots and models before any run: check."""

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer

from simrob_drake.base.messages import message
from simrob_drake.cli.arguments import refuse, refuse_import, station_from
from simrob_drake.cli.importers import examine_with, importer_request, other_importer, with_importer_options
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
                "Show a row for each axis of a station, also if it is far from its torque limit.",
            ),
        ),
    ] = False,
    importer_options: ChosenOptions,
) -> None:
    """Say before any run what will go wrong in a station, what a robot can carry, or what an import would do.

    For example:

        simrob check irb120_dynamic --set servo.kp=300

        simrob check arm.urdf
    """
    importer = other_importer(station)
    if importer is not None:
        request = importer_request(importer, "reading_class", importer_options, options, set_)
        examine_with(importer, Path(station), request)
        return
    importer_options.refuse_all_but([])
    # Stations and programs take --mesh-path, too, and none of the other options of imports.
    refusable = options and options.model_copy(update={"mesh_path": ()})
    if is_program_file(station):
        refuse_import(
            message("cli.is_a_program", "this is a program; the option belongs to the file of a robot"), refusable
        )
        refuse(message("cli.program_without_code", "this is a program, which names no code"), allow_code=allow_code)
        program, config = program_from(station, set_)
        console.print(findings_table([check_program(program, config, station)]))
        return
    if is_robot_file(station):
        refuse(
            message("cli.is_file_of_robot", "this is the file of a robot; the option belongs to stations"),
            set=set_,
            allow_code=allow_code,
        )
        examine_file(Path(station), options)
        return
    if is_description_file(station):
        refuse(
            message("cli.is_file_of_robot", "this is the file of a robot; the option belongs to stations"),
            set=set_,
            allow_code=allow_code,
        )
        refuse_import(
            message("cli.is_description_of_robot", "this is the description of a robot, and nothing is imported"),
            options,
        )
        show_robot(read_robot(station))
        return
    if station in robot_names():
        refuse(
            message("cli.is_a_robot", "this is a robot; the option belongs to stations"),
            set=set_,
            allow_code=allow_code,
        )
        refuse_import(
            message("cli.robot_of_package", "this robot comes with the package, and nothing is imported"), options
        )
        show_robot(read_robot(station))
        return
    refuse_import(
        message("cli.is_a_station", "this is a station; the option belongs to the file of a robot"), refusable
    )
    config = station_from(station, set_, allow_code=allow_code)
    Runner(config).check()
    program_findings = [] if config.program is None else [check_program(own_program(config), config)]
    console.print(findings_table([*check_station(config), *program_findings], show_all=all_))


COMMANDS: dict[str, Callable[..., Any]] = {"check": check}
