"""The commands about stations: list, run, check, diagram."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.table import Table
from rich.text import Text

from simrob_drake.cli.exit_codes import ExitCode
from simrob_drake.cli.robots import ROBOT_SUFFIXES, Estimate, MeshPath, examine_file
from simrob_drake.cli.screen import console, errors
from simrob_drake.errors import InvalidParameter
from simrob_drake.folders import check_folder
from simrob_drake.results.files import SUMMARY, default_folder
from simrob_drake.results.result import SimulationResult
from simrob_drake.robots.catalog import load_robot, robot_names
from simrob_drake.robots.pieces import load_piece, piece_names
from simrob_drake.simulate import simulate
from simrob_drake.stations.checks import check_station
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.load import load_station, station_names
from simrob_drake.tables import convergence_table, findings_table, result_table
from simrob_drake.yaml_files import parse_yaml

StationArgument = Annotated[str, typer.Argument(metavar="STATION", help="A name from `simrob list`, or a YAML file.")]
SetOption = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY.PATH=VALUE", help="Change a key of the station; may be given several times."),
]


def list_all() -> None:
    """List the stations, robots and pieces that come with the package."""
    rows = [
        ("station", {name: load_station(name).description for name in station_names()}),
        ("robot", {name: load_robot(name).description for name in robot_names()}),
        ("piece", {name: load_piece(name).description for name in piece_names()}),
    ]
    for kind, entries in rows:
        table = Table(kind, "description", box=None, pad_edge=False)
        for name, description in entries.items():
            table.add_row(name, description)
        console.print(table)
        console.print()


def run(
    station: StationArgument,
    duration: Annotated[float | None, typer.Option(help="Simulated time [s], in place of the station's.")] = None,
    set_: SetOption = None,
    out: Annotated[Path | None, typer.Option(help="Folder of the result; runs/STATION-TIME unless given.")] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace a result that is there.")] = False,
    live: Annotated[bool, typer.Option("--live", help="Show the motion in the browser while it is computed.")] = False,
    no_recording: Annotated[bool, typer.Option("--no-recording", help="No recording and no film strip.")] = False,
    video: Annotated[bool, typer.Option("--video", help="Write an MP4, too (needs the extra `video`).")] = False,
    converge: Annotated[
        bool, typer.Option("--converge", help="Run again ten times tighter and print the difference.")
    ] = False,
) -> int:
    """Run a station, and save signals, plots and a recording."""
    config = load_station(station, _overrides(set_, duration))
    folder = out or default_folder(config.name)
    check_folder(folder, marker=SUMMARY, force=force)
    if video:
        from simrob_drake.results.film_strip import frame_writer

        frame_writer()
    _warn(config)
    result = _simulated(config, live)
    result.save(folder, force=force, recording=not no_recording, video=video)
    console.print(result_table(result))
    console.print(f"{config.name}: {result.message}", highlight=False)
    console.print(f"{result.realtime_rate:.0f} × real time, {len(result.step_times) - 1} steps", highlight=False)
    console.print(f"result    {folder}", soft_wrap=True, highlight=False)
    if not no_recording:
        console.print(f"recording {(folder / 'recording.html').resolve().as_uri()}", soft_wrap=True, highlight=False)
    if converge:
        _converge(result)
    codes = {"diverged": ExitCode.DIVERGED, "interrupted": ExitCode.INTERRUPTED}
    return codes.get(result.ending, ExitCode.DONE)


def check(
    station: Annotated[str, typer.Argument(metavar="STATION|FILE.urdf", help="A station, or a robot's file.")],
    set_: SetOption = None,
    mesh_path: MeshPath = None,
    estimate_inertia: Estimate = False,
) -> None:
    """Say before any run what a station's robots need, and what will go wrong; or what an import would do."""
    if Path(station).suffix in ROBOT_SUFFIXES:
        examine_file(Path(station), mesh_path, estimate_inertia)
        return
    findings = check_station(load_station(station, _overrides(set_)))
    console.print(findings_table(findings))


def diagram(
    station: StationArgument,
    out: Annotated[Path | None, typer.Option(help="FILE.svg, .dot or .mmd; DOT on the screen unless given.")] = None,
    set_: SetOption = None,
) -> None:
    """Draw the block structure of a station."""
    from simrob_drake.results.block_picture import save_block_picture, station_dot

    config = load_station(station, _overrides(set_))
    if out is None:
        print(station_dot(config))
    else:
        console.print(str(save_block_picture(config, out)), soft_wrap=True, highlight=False)


def _overrides(settings: list[str] | None, duration: float | None = None) -> dict[str, Any]:
    """Turn ``key.path=value`` texts into overrides."""
    overrides: dict[str, Any] = {} if duration is None else {"duration": duration}
    for setting in settings or []:
        key, equals, value = setting.partition("=")
        if not (key and equals):
            raise InvalidParameter("--set", setting, "of the form key.path=value")
        overrides[key.strip()] = parse_yaml(value, f"--set {setting}")
    return overrides


def _warn(config: StationConfig) -> None:
    """Say beforehand what the run will show."""
    for finding in check_station(config):
        if finding.level == "warning":
            errors.print(Text.assemble(("warning", "yellow"), f" {finding.subject}: {finding.text}"))


def _simulated(config: StationConfig, live: bool) -> SimulationResult:
    if not live:
        return simulate(config)
    from simrob_drake.results.live import LiveView

    view = LiveView(config)
    console.print(f"watch it at {view.url}", highlight=False)
    if sys.stdin.isatty():
        console.input("open it in a browser, then press Enter to start ")
    try:
        return simulate(config, progress=False, on_step=view.on_step)
    finally:
        view.close()


def _converge(result: SimulationResult) -> None:
    if result.config.mode == "kinematic":
        console.print("a kinematic station has no solver: nothing to converge")
        return
    tight = result.config.model_copy(update={"solver": result.config.solver.tighter()})
    console.print(convergence_table(result, simulate(tight)))


COMMANDS: dict[str, Callable[..., Any]] = {"list": list_all, "run": run, "check": check, "diagram": diagram}
