"""The command that writes stations and programs for other software: `simrob export`."""

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer

from simrob_drake.base.errors import InvalidParameter
from simrob_drake.base.extras import require
from simrob_drake.cli.arguments import station_from
from simrob_drake.cli.options import Force, Settings, with_mesh_path
from simrob_drake.cli.programs import export_program
from simrob_drake.cli.screen import say


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


COMMANDS: dict[str, Callable[..., Any]] = {"export": export}
