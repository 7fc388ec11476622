"""The commands about robots: import, view, station."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Literal

import typer
from rich.text import Text

from simrob_drake.cli.screen import console, errors
from simrob_drake.errors import InvalidParameter, OutputError
from simrob_drake.folders import written_at_once
from simrob_drake.importer.cache import robot_from_file
from simrob_drake.importer.importing import ImportedRobot, examine_robot, import_robot
from simrob_drake.importer.options import ImportOptions
from simrob_drake.robots.catalog import load_robot
from simrob_drake.stations.draft import draft_station
from simrob_drake.tables import report_table, robot_table

ROBOT_SUFFIXES = (".urdf", ".xacro", ".xml")

FileArgument = Annotated[Path, typer.Argument(metavar="FILE", help="A URDF or xacro file.")]
MeshPath = Annotated[
    list[Path] | None,
    typer.Option("--mesh-path", metavar="DIR", help="A further folder with meshes or packages; may be given often."),
]
Collision = Annotated[
    Literal["hull", "box", "none"], typer.Option(help="What collision meshes become: convex hull, box, or nothing.")
]
Estimate = Annotated[
    bool, typer.Option("--estimate-inertia", help="Estimate missing and impossible inertias from the geometry.")
]
Density = Annotated[float, typer.Option(help="Of links whose inertia is estimated [kg/m³].")]
Base = Annotated[
    Literal["auto", "fixed", "floating"], typer.Option(help="Whether the root link is fixed to the world.")
]
Friction = Annotated[
    bool, typer.Option("--friction-as-damping", help="Add joint friction, which Drake ignores, to the damping.")
]
Force = Annotated[bool, typer.Option("--force", help="Replace what is there.")]


def import_file(
    file: FileArgument,
    out: Annotated[Path | None, typer.Option(help="Folder of the result; NAME_imported unless given.")] = None,
    mesh_path: MeshPath = None,
    collision: Collision = "hull",
    estimate_inertia: Estimate = False,
    density: Density = 1000.0,
    base: Base = "auto",
    friction_as_damping: Friction = False,
    force: Force = False,
) -> None:
    """Make a published robot run: convert its meshes, repair its URDF, and tell all that was done."""
    options = _options(mesh_path, collision, estimate_inertia, density, base, friction_as_damping)
    folder = out or Path(f"{file.stem}_imported")
    with errors.status(Text(f"importing {file}")):
        imported = import_robot(file, folder, options, force=force)
    _tell(imported)
    console.print(f"robot   {imported.model.urdf_path}", soft_wrap=True, highlight=False)
    console.print(f"next    simrob view {imported.model.urdf_path}", soft_wrap=True, highlight=False)
    console.print(f"        simrob station {imported.model.urdf_path}", soft_wrap=True, highlight=False)


def examine_file(file: Path, mesh_path: list[Path] | None, estimate_inertia: bool) -> None:
    """Report on a robot's file without writing anything."""
    options = ImportOptions(mesh_path=tuple(mesh_path or ()), estimate_inertia=estimate_inertia)
    with errors.status(Text(f"reading {file}")):
        imported = examine_robot(file, options)
    console.print(robot_table(imported.model))
    _tell(imported)
    weightless = ", ".join(imported.model.links_without_inertia) or "none"
    console.print(f"moving links without inertia: {weightless}", highlight=False)


def view(
    robot: Annotated[str, typer.Argument(metavar="FILE|ROBOT", help="A URDF, or a robot of `simrob list`.")],
    mesh_path: MeshPath = None,
    collision: Collision = "hull",
) -> None:
    """Show a robot in the browser, with a slider for every joint."""
    from simrob_drake.results.robot_view import RobotView

    if Path(robot).suffix in ROBOT_SUFFIXES:
        options = _given(ImportOptions(mesh_path=tuple(mesh_path or ()), collision=collision))
        with errors.status(Text(f"reading {robot}")):
            window = RobotView(robot_from_file(Path(robot), options))
    else:
        window = RobotView(load_robot(robot))
    console.print(f"{robot} is shown at {window.url}", soft_wrap=True, highlight=False)
    console.print("collision geometry: Scene, collision in the page's menu; end with Stop there, or Ctrl+C here")
    try:
        window.run()
    finally:
        window.close()


def station(
    file: FileArgument,
    out: Annotated[Path | None, typer.Option(help="The station's file; NAME.yaml unless given.")] = None,
    mesh_path: MeshPath = None,
    collision: Collision = "hull",
    estimate_inertia: Estimate = False,
    density: Density = 1000.0,
    base: Base = "auto",
    friction_as_damping: Friction = False,
    force: Force = False,
) -> None:
    """Write a first station for a robot's file, one that runs at once."""
    options = _given(_options(mesh_path, collision, estimate_inertia, density, base, friction_as_damping))
    target = out or Path(f"{file.stem}.yaml")
    if target.suffix not in (".yaml", ".yml"):
        raise InvalidParameter("--out", str(target), "a file that ends in .yaml")
    if target.exists() and not force:
        raise OutputError(f"{target} exists already; choose another file or replace it with --force")
    with errors.status(Text(f"reading {file}")):
        text = draft_station(file, options, folder=target.absolute().parent)
    written_at_once(target, text)
    console.print(f"station {target}", soft_wrap=True, highlight=False)
    console.print(f"next    simrob check {target}", soft_wrap=True, highlight=False)
    console.print(f"        simrob run {target}", soft_wrap=True, highlight=False)


def _tell(imported: ImportedRobot) -> None:
    console.print(report_table(imported.report))
    console.print(f"{imported.report.source.name}: {imported.report.summary()}", soft_wrap=True, highlight=False)


def _options(
    mesh_path: list[Path] | None, collision: Any, estimate_inertia: bool, density: float, base: Any, friction: bool
) -> ImportOptions:
    if not 0 < density < float("inf"):
        raise InvalidParameter("--density", density, "a positive number [kg/m³]")
    return ImportOptions(
        mesh_path=tuple(mesh_path or ()),
        collision=collision,
        estimate_inertia=estimate_inertia,
        density=density,
        base=base,
        friction_as_damping=friction,
    )


def _given(options: ImportOptions) -> ImportOptions | None:
    """Return options if they ask for anything."""
    return None if options == ImportOptions() else options


COMMANDS: dict[str, Callable[..., Any]] = {"import": import_file, "view": view, "station": station}
