"""The commands about robots: import, view, station."""

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.text import Text

from simrob_drake.cli.given import check_file, is_robot_file, refuse_import
from simrob_drake.cli.options import FileArgument, Force, with_import_options
from simrob_drake.cli.screen import console, errors
from simrob_drake.cli.simulink import (
    Assume,
    Library,
    ModelSettings,
    RunOctave,
    Variables,
    import_model,
    is_model_file,
    model_options,
    refuse_model,
)
from simrob_drake.cli.tables import payload_told, report_table, robot_table
from simrob_drake.errors import InvalidParameter
from simrob_drake.folders import written_at_once
from simrob_drake.importer.cache import robot_from_file
from simrob_drake.importer.importing import ImportedRobot, examine_robot, import_robot
from simrob_drake.importer.options import ImportOptions
from simrob_drake.robots.catalog import RobotModel, load_robot
from simrob_drake.stations.draft import draft_station


@with_import_options()
def import_file(
    *,
    file: FileArgument,
    out: Annotated[Path | None, typer.Option(help="Folder of the result; NAME_imported unless given.")] = None,
    options: ImportOptions | None,
    force: Force = False,
    library: Library = None,
    set_: ModelSettings = None,
    variables: Variables = None,
    assume: Assume = False,
    octave: RunOctave = False,
) -> None:
    """Make a published robot, a Simulink model or a CAD assembly run: convert, repair, and tell all that was done.

    For example:

        simrob import arm.urdf --out robots/arm

        simrob import station.slx --library subsystems --set q0='[0 0 0]'
    """
    if is_model_file(file):
        given = model_options(options, library=library, set_=set_, variables=variables, assume=assume, octave=octave)
        import_model(file, out, given, force=force)
        return
    refuse_model(library=library, set=set_, variables=variables, assume=assume, octave=octave)
    folder = out or Path(f"{file.stem}_imported")
    with errors.status(Text(f"importing {file}")):
        imported = import_robot(file, folder, options, force=force)
    _tell(imported)
    console.print(f"robot   {imported.model.urdf_path}", soft_wrap=True, highlight=False)
    console.print(f"next    simrob view {imported.model.urdf_path}", soft_wrap=True, highlight=False)
    console.print(f"        simrob station {imported.model.urdf_path}", soft_wrap=True, highlight=False)


def examine_file(file: Path, options: ImportOptions | None) -> None:
    """Report on a robot's file without writing anything."""
    with errors.status(Text(f"reading {file}")):
        imported = examine_robot(file, options)
    show_robot(imported.model)
    _tell(imported)
    weightless = ", ".join(imported.model.links_without_inertia) or "none"
    console.print(f"moving links without inertia: {weightless}", highlight=False)


def show_robot(robot: RobotModel) -> None:
    """Report on a robot: its axes, and what an arm can carry."""
    console.print(robot_table(robot))
    if robot.base == "fixed" and robot.tools and not robot.links_without_inertia:
        for line in payload_told(robot):
            console.print(line, highlight=False)


@with_import_options("mesh_path", "collision", "xacro_arg", "drop_loops")
def view(
    *,
    robot: Annotated[str, typer.Argument(metavar="FILE|ROBOT", help="A URDF, or a robot of `simrob list`.")],
    options: ImportOptions | None,
) -> None:
    """Show a robot in the browser, with a slider for every joint."""
    from simrob_drake.results.animation.robot_view import RobotView

    if is_robot_file(robot):
        with errors.status(Text(f"reading {robot}")):
            window = RobotView(robot_from_file(Path(robot), options))
    else:
        refuse_import("left out with a robot of the package: it is no import", options)
        window = RobotView(load_robot(robot))
    console.print(f"{robot} is shown at {window.url}", soft_wrap=True, highlight=False)
    console.print("collision geometry: Scene, collision in the page's menu; end with Stop there, or Ctrl+C here")
    try:
        window.run()
    finally:
        window.close()


@with_import_options()
def station(
    *,
    file: FileArgument,
    out: Annotated[Path | None, typer.Option(help="The station's file; NAME.yaml unless given.")] = None,
    options: ImportOptions | None,
    force: Force = False,
) -> None:
    """Write a first station for a robot's file, one that runs at once."""
    target = out or Path(f"{file.stem}.yaml")
    if target.suffix not in (".yaml", ".yml"):
        raise InvalidParameter("--out", str(target), "a file that ends in .yaml")
    check_file(target, force=force)
    with errors.status(Text(f"reading {file}")):
        text = draft_station(file, options, folder=target.absolute().parent)
    written_at_once(target, text)
    console.print(f"station {target}", soft_wrap=True, highlight=False)
    console.print(f"next    simrob check {target}", soft_wrap=True, highlight=False)
    console.print(f"        simrob run {target}", soft_wrap=True, highlight=False)


def _tell(imported: ImportedRobot) -> None:
    console.print(report_table(imported.report))
    console.print(f"{imported.report.source.name}: {imported.report.summary()}", soft_wrap=True, highlight=False)


COMMANDS: dict[str, Callable[..., Any]] = {"import": import_file, "view": view, "station": station}
