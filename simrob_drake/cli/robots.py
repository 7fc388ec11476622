"""The commands about robots: import, view, station.

A robot comes from a file, such as a URDF, which the core imports itself: it resolves, repairs and checks the file, and
reports each change. Files of other tools are imported by extensions, see :mod:`simrob_drake.cli.importers`.
"""

import shlex
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Annotated, Any

import typer

from simrob_drake.base.errors import Unsuitable
from simrob_drake.base.folders import check_ending, check_new_file, written_at_once
from simrob_drake.base.messages import compound, join_texts, message
from simrob_drake.base.packages import package_root, remember_grants, resolve_path
from simrob_drake.base.yaml_files import YAML_SUFFIXES
from simrob_drake.cli import ExitCode
from simrob_drake.cli.arguments import refuse, refuse_import
from simrob_drake.cli.importers import (
    import_with,
    importer_request,
    other_importer,
    with_importer_options,
)
from simrob_drake.cli.options import (
    ChosenOptions,
    FileArgument,
    Force,
    LanguageOptions,
    with_import_options,
    with_language,
)
from simrob_drake.cli.programs import import_program, is_language_file, refuse_language
from simrob_drake.cli.screen import (
    NEXT,
    ROBOT,
    STATION,
    console,
    progress_note,
    say,
    say_place,
    say_text,
)
from simrob_drake.cli.tables import payload_lines, report_table, robot_table
from simrob_drake.importer.importing import (
    ImportedRobot,
    default_folder,
    examine_robot,
    import_robot,
)
from simrob_drake.importer.named_robots import read_robot
from simrob_drake.importer.robot_files import is_robot_file
from simrob_drake.robots.catalog import RobotModel, robot_names
from simrob_drake.robots.imports import ImportOptions
from simrob_drake.stations.draft import draft_station


@with_language
@with_importer_options("options_class")
@with_import_options()
def import_file(
    *,
    file: FileArgument,
    out: Annotated[
        Path | None,
        typer.Option(
            help=message(
                "cli.help_import_file_out",
                "Folder of the result; by default NAME_imported, here or next to the file's package.",
            )
        ),
    ] = None,
    options: ImportOptions | None,
    force: Force = False,
    set_: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="NAME=VALUE",
            help=message(
                "cli.help_import_file_set",
                "A variable of a Simulink model; may be given several times.",
            ),
        ),
    ] = None,
    importer_options: ChosenOptions,
    language: LanguageOptions,
) -> ExitCode:
    """Import a robot, a Simulink model, a CAD assembly or a RAPID program, and report every change.

    For example:

        simrob import arm.urdf --out robots/arm

        simrob import station.slx --library subsystems --set q0='[0 0 0]'

        simrob import Module.mod --robot irb120

        simrob import scene.dmd.yaml --out stations/scene
    """
    if is_language_file(file):
        refuse_import(
            message(
                "cli.is_rapid_program", "this is a RAPID program; the option belongs to robots"
            ),
            options,
        )
        importer_options.refuse_all_but([])
        refuse(
            message("cli.belongs_to_simulink", "the option belongs to Simulink models"), set=set_
        )
        return import_program(file, out, language, force=force)
    # All imports share --allow-losses with programs, so it is passed on instead of refused.
    allow_losses = refuse_language(language)
    # A file of another tool is imported by an extension, a robot's file by the core.
    importer = other_importer(file)
    if importer is not None:
        request = importer_request(
            importer, "options_class", importer_options, options, set_, out=out, force=force
        )
        return import_with(importer, file, request, allow_losses=allow_losses)
    # The core imports this file, so the options of importers have no effect on it.
    importer_options.refuse_all_but([])
    # The report of a robot shows what is lost, but the import never stops for it: there is nothing to allow.
    refuse(
        message("cli.belongs_to_simulink", "the option belongs to Simulink models"),
        set=set_,
        allow_losses=allow_losses,
    )
    folder = out or default_folder(file)
    with progress_note(message("cli.importing", "importing {file}", file=file)):
        imported = import_robot(file, folder, options, force=force)
    _show_report(imported)
    say_place(ROBOT, imported.model.urdf_path)
    say_place(NEXT, f"simrob view {imported.model.urdf_path}")
    say_place("", f"simrob station {imported.model.urdf_path}")
    return ExitCode.DONE


def examine_file(file: Path, options: ImportOptions | None) -> None:
    """Show a robot as its file would be imported, and what the import would change, without writing anything.

    Args:
        file: the robot's file.
        options: options of the import. None if the user gives none.
    """
    with progress_note(message("cli.reading", "reading {file}", file=file)):
        imported = examine_robot(file, options)
    show_robot(imported.model)
    _show_report(imported)
    # Drake cannot simulate such a link by forces: the user has to add inertias, or to estimate them by an option.
    # A station with forces refuses such a robot later, with less about its file.
    names = imported.model.links_without_inertia
    links = join_texts(names) if names else message("cli.no_links", "none")
    say_text(
        message("cli.links_without_inertia", "moving links without inertia: {links}", links=links)
    )


def show_robot(robot: RobotModel) -> None:
    """Show the axes of a robot and, if it is an arm, the mass that it can carry."""
    console.print(robot_table(robot))
    # Without the masses of the links, the torque that is left for a payload is unknown.
    if robot.is_arm and not robot.links_without_inertia:
        for line in payload_lines(robot):
            say_text(line)


@with_import_options("mesh_path", "collision", "xacro_arg", "drop_loops")
def view(
    *,
    robot: Annotated[
        str,
        typer.Argument(
            metavar="FILE|ROBOT",
            help=message("cli.help_view_robot", "A URDF, or a robot of `simrob list`."),
        ),
    ],
    options: ImportOptions | None,
) -> None:
    """Show a robot in the browser, with a slider for every joint.

    For example:

        simrob view irb120
    """
    from simrob_drake.results.animation.robot_view import RobotView

    # A robot of the package, or a description of one, is read as it is: it has no options.
    if is_robot_file(robot):
        with progress_note(message("cli.reading", "reading {file}", file=robot)):
            window = RobotView(read_robot(robot, options))
    else:
        refuse_import(
            message(
                "cli.no_file_of_robot", "this is not the file of a robot, and nothing is imported"
            ),
            options,
        )
        window = RobotView(read_robot(robot))
    say(message("cli.shown_at", "{robot} is shown at {url}", robot=robot, url=window.url))
    hint = message(
        "cli.collision_geometry",
        "to see the collision geometry, choose Scene, collision in the menu of the page; to "
        "end, press Stop there or Ctrl+C here",
    )
    say_text(hint)
    # The call returns when the user stops the view in the browser.
    try:
        window.run()
    finally:
        window.close()


@with_import_options()
def station(
    *,
    file: FileArgument,
    out: Annotated[
        Path | None,
        typer.Option(
            help=message("cli.help_station_out", "File of the station; by default NAME.yaml.")
        ),
    ] = None,
    options: ImportOptions | None,
    force: Force = False,
) -> None:
    """Write a first station for a robot's file, ready to run.

    For example:

        simrob station arm.urdf --out arm.yaml
    """
    if str(file) in robot_names():
        raise Unsuitable(
            str(file),
            message(
                "cli.is_robot_of_package",
                "this is a robot of the package, which a station has by `robot: {{model: {name}}}`",
                name=file,
            ),
            message("cli.give_robot_file", "give the file of a robot, such as arm.urdf"),
        )
    target = out or Path(f"{file.stem}.yaml")
    # The draft needs trial runs, which take time, so the target is checked first.
    # A file with another ending would not be read as a station again.
    check_ending(target, YAML_SUFFIXES, "--out")
    check_new_file(target, force=force)
    with progress_note(message("cli.reading", "reading {file}", file=file)):
        text = draft_station(file, options, folder=target.absolute().parent)
    written_at_once(target, text)
    # The comments of the file are the remarks on it. The first is only the title of the file.
    comments = [line for line in text.splitlines() if line.startswith("# ")]
    for comment in comments[1:]:
        say_text(comment.removeprefix("# "))
    say_place(STATION, target)
    # The next commands must be allowed to read what this command was allowed to read.
    mesh_folders = options.mesh_path if options else ()
    flags = _grant_robot_folders(target, [file, *mesh_folders])
    say_place(NEXT, f"simrob check {target}{flags}")
    say_place("", f"simrob run {target}{flags}")


def _grant_robot_folders(station: Path, sources: Iterable[Path]) -> str:
    """Remember on this computer that a new station may read its robot outside of its own package.

    A station may otherwise read only files of its own package, so that a file from the internet cannot read others. The
    user has just named the robot, so the station may read it.

    Args:
        station: file of the station.
        sources: the robot's file, and the folders of its meshes.

    Returns:
        options ``--mesh-path`` that commands with the station need, each with a space in front. Empty if they need
        none: nothing is outside of the package, or this computer remembers the folders. In the latter case, the options
        for other computers are shown.
    """
    folders = _packages_outside(station, sources)
    if not folders:
        return ""
    flags = "".join(f" --mesh-path {shlex.quote(str(folder))}" for folder in folders)
    is_remembered = remember_grants(station, folders)
    # The disk cannot be written, so the user gives the folders as options of each command.
    if not is_remembered:
        return flags
    text = message(
        "cli.station_may_read",
        "The robot is outside the station's folder. This computer remembers that the station "
        "may read it. On another computer, or after moving the station, add:",
    )
    say_text(text)
    say(flags.strip())
    return ""


def _packages_outside(station: Path, sources: Iterable[Path]) -> list[Path]:
    """Find the folders outside of the station's own package from which a station reads.

    Args:
        station: file of the station.
        sources: files and folders that the station reads, the robot's file first.

    Returns:
        the package of each file, and each folder itself, without those that are within an earlier one.
    """
    own_package = package_root(resolve_path(station))
    folders = list[Path]()
    for source in map(resolve_path, sources):
        # Files in the station's own package may be read without a grant. Meshes are often in the robot's package.
        if any(source.is_relative_to(folder) for folder in (own_package, *folders)):
            continue
        # The user has named the folder, and nothing around it.
        folders.append(source if source.is_dir() else package_root(source))
    return folders


def _show_report(imported: ImportedRobot) -> None:
    """Show the report of an import, and the counts of its entries."""
    console.print(report_table(imported.report))
    file = imported.report.source.name
    say_text(compound("{file}: {summary}", file=file, summary=imported.report.summary()))


COMMANDS: dict[str, Callable[..., Any]] = {"import": import_file, "view": view, "station": station}
