"""The command about linear models of stations: linearize."""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.table import Table

from simrob_drake.base.errors import InvalidParameter, SimrobError
from simrob_drake.base.folders import check_folder
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import compound, message
from simrob_drake.base.yaml_files import parse_yaml
from simrob_drake.cli.arguments import station_from
from simrob_drake.cli.options import AllowCode, Force, Settings, StationArgument, with_mesh_path
from simrob_drake.cli.screen import RESULT, console, say_place, say_text, table
from simrob_drake.extensions.linear import LinearModel, linearize
from simrob_drake.extensions.linear.model import MODEL_FILE
from simrob_drake.results.files import default_folder
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.resolve import resolve


@with_mesh_path
def linearize_station(
    station: StationArgument,
    at: Annotated[
        str | None,
        typer.Option(
            metavar="ANGLES",
            help=message(
                "linear.help_linearize_station_at",
                "The references that it rests at [deg, or m], per axis: 30, [0, 30, ...] or {{joint_2: 30}}; with "
                "several robots {{left: 30}}. The initial postures by default.",
            ),
        ),
    ] = None,
    set_: Settings = None,
    out: Annotated[
        Path | None,
        typer.Option(
            help=message(
                "linear.help_linearize_station_out",
                "Folder of the result; runs/STATION-linear-TIME by default.",
            )
        ),
    ] = None,
    force: Force = False,
    allow_code: AllowCode = False,
) -> None:
    """Linearize a station about a rest: print its poles, and save matrices, names and a Bode plot.

    For example:

        simrob linearize irb120_dynamic --at 30 --set servo.kd=20
    """
    config = station_from(station, set_, allow_code=allow_code)
    folder = out or default_folder(f"{config.name}-linear")
    check_folder(folder, marker=MODEL_FILE, force=force)
    model = linearize(config, None if at is None else _postures(config, parse_yaml(at, "--at")))
    model.save(folder, force=force)
    console.print(_modes_table(model))
    verdict = (
        message("linear.stable", "stable")
        if model.is_stable
        else message("linear.not_stable", "not stable")
    )
    say_text(compound("{station}: {verdict}", station=model.name, verdict=verdict))
    for note in model.notes:
        say_text(message("linear.left_out", "left out: {note}", note=note))
    say_place(RESULT, folder)


def _postures(config: StationConfig, content: Any) -> dict[str, Vector]:
    """Return postures (n,) [rad or m] of figures in degrees, by robot; raises InvalidParameter: no figures per axis."""
    robots = resolve(config).robots
    by_robot = isinstance(content, Mapping) and set(content) <= set(robots)
    values = (
        content
        if by_robot
        else dict.fromkeys([config.only_robot] if config.only_robot else robots, content)
    )
    postures = {}
    for name, positions in values.items():
        model = robots[name].model
        own = robots[name].initial / model.user_units
        try:
            postures[name] = model.user_units * model.axis_vector(positions, "--at", own)
        except SimrobError:
            raise
        except (TypeError, ValueError) as problem:
            raise InvalidParameter(
                "--at",
                content,
                message(
                    "linear.numbers_per_axis", "numbers per axis, such as 30 or {{joint_2: 30}}"
                ),
            ) from problem
    return postures


def _modes_table(model: LinearModel) -> Table:
    """Make a table of the modes of a linear model, slow ones first. A pair of complex poles is one mode."""
    rows = list[tuple[str, ...]]()
    for mode in model.modes:
        pole = compound("{real:.4g}", real=mode.pole.real)
        if mode.pole.imag:
            pole += compound(" ± {imaginary:.4g}i", imaginary=mode.pole.imag)
        numbers = [
            compound("{frequency:.3f}", frequency=mode.frequency),
            compound("{damping:.3f}", damping=mode.damping),
            compound("{time:.4g}", time=mode.time_constant),
        ]
        # `mostly` is the axis, or other state, that has the largest part in the mode.
        rows.append((mode.mostly, pole, *numbers))
    headings = (
        message("linear.mostly", "mostly"),
        message("linear.pole", "pole [1/s]"),
        message("linear.frequency", "frequency [Hz]"),
        message("linear.damping_ratio", "damping ratio"),
        message("linear.time_constant", "time constant [s]"),
    )
    return table(headings, *rows)
