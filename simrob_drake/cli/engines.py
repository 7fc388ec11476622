"""A station in other engines: ``simrob export`` writes it as MJCF, ``simrob compare`` holds their runs together."""

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer

from simrob_drake.base.errors import InvalidParameter
from simrob_drake.base.extras import require
from simrob_drake.base.folders import check_folder
from simrob_drake.cli.arguments import refuse, station_from
from simrob_drake.cli.options import Force, Settings, StationArgument, with_mesh_path
from simrob_drake.cli.programs import export_program
from simrob_drake.cli.screen import console, errors, say, table
from simrob_drake.cli.simulink import compare_with_log
from simrob_drake.cli.tables import in_units
from simrob_drake.stations.config import StationConfig


@with_mesh_path
def export(
    station: Annotated[
        str, typer.Argument(metavar="STATION|PROGRAM", help="A name from `simrob list`, or the YAML file of either.")
    ],
    mjcf: Annotated[
        Path | None, typer.Option("--mjcf", metavar="FILE", help="The MJCF file of MuJoCo to write, FILE.xml.")
    ] = None,
    rapid: Annotated[
        Path | None, typer.Option("--rapid", metavar="FILE", help="The RAPID module of a program to write, FILE.mod.")
    ] = None,
    urscript: Annotated[
        Path | None, typer.Option("--urscript", metavar="FILE", help="The URScript of a program, FILE.script.")
    ] = None,
    set_: Settings = None,
    step: Annotated[float, typer.Option(help="Length of MuJoCo's steps [s].")] = 2e-3,
    force: Force = False,
) -> None:
    """Write a station as a model of MuJoCo, or a program as a RAPID module or URScript.

    For example:

        simrob export irb120_dynamic --mjcf irb120.xml

        simrob export program.yaml --rapid Module.mod
    """
    if (mjcf is None) == (rapid is None and urscript is None):
        raise InvalidParameter(
            "simrob export", "asked for two things or none", "given --mjcf, or --rapid or --urscript"
        )
    if mjcf is None:
        export_program(station, set_, rapid, urscript, force=force)
        return
    require("simrob export", "mujoco", "mujoco")
    from simrob_drake.extensions.mujoco.export import save_mjcf

    for written in save_mjcf(station_from(station, set_), mjcf, step=step, force=force):
        say(f"written {written}")


@with_mesh_path
def compare(
    station: StationArgument,
    with_: Annotated[
        Path | None,
        typer.Option("--with", metavar="FILE", help="Logged signals: .csv with a header, .mat or .parquet."),
    ] = None,
    map_: Annotated[
        list[str] | None,
        typer.Option(
            "--map",
            metavar="THEIRS=OURS",
            help="What a logged signal is called here, as yout.1=q.joint_1, or yout.1=q.joint_1:deg.",
        ),
    ] = None,
    set_: Settings = None,
    out: Annotated[Path | None, typer.Option(help="Folder for the numbers and pictures.")] = None,
    force: Force = False,
) -> None:
    """Hold a station's run against others: logged signals of the original, or other engines with error bars.

    Other engines are another scheme of Drake, MuJoCo, and inverse dynamics where it exists.

    For example:

        simrob compare irb120_dynamic --out compared

        simrob compare irb120_dynamic --with logged.mat --map yout.1=q.joint_1
    """
    if with_ is not None:
        compare_with_log(station_from(station, set_), with_, map_ or [], out, force=force)
        return
    refuse("given with --with", map=map_)
    _compare_engines(station_from(station, set_), out, force=force)


def _compare_engines(config: StationConfig, out: Path | None, *, force: bool) -> None:
    from simrob_drake.extensions.comparison.engines import NUMBERS, compare_engines, differences, save_comparison

    if out is not None:
        check_folder(out, marker=NUMBERS, force=force)
    with errors.status("running") as status:
        found_by = compare_engines(config, progress=lambda name: status.update(f"running in {name}"))
    first, *others = found_by.accounts
    found = differences(first, others)
    rows = list[tuple[str, ...]]()
    for one in found:
        largest, error = (in_units(value, one.quantity.unit) for value in (one.largest, one.error))
        within = "yes" if one.within else f"no, {one.largest / one.error:.2g} ×" if one.error > 0 else "no"
        rows.append((one.account, one.quantity.name, largest, f"{one.at:.3f}", error, within))
    for account in found_by.accounts:
        say(f"{account.name}: {account.ended}")
    headings = ("engine", "quantity", f"from {first.name} at most", "at [s]", "error bars", "within")
    console.print(table(headings, *rows, numbers=False))
    for name, why in found_by.missing.items():
        say(f"{name}: {why}")
    if out is not None:
        save_comparison(found_by.accounts, found, out, station=config.name, force=force)
        say(f"result   {out}")


COMMANDS: dict[str, Callable[..., Any]] = {"export": export, "compare": compare}
