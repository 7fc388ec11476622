"""The command about linear models of stations: linearize."""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.table import Table

from simrob_drake.base.errors import InvalidParameter, SimrobError
from simrob_drake.base.folders import check_folder
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import message
from simrob_drake.base.yaml_files import parse_yaml
from simrob_drake.cli.arguments import station_from
from simrob_drake.cli.options import AllowCode, Force, Settings, StationArgument, with_mesh_path
from simrob_drake.cli.screen import console, say_place, table
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
            help="The references that it rests at [deg, or m], per axis: 30, [0, 30, ...] or {joint_2: 30}; with "
            "several robots {left: 30}. The initial postures by default.",
        ),
    ] = None,
    set_: Settings = None,
    out: Annotated[Path | None, typer.Option(help="Folder of the result; runs/STATION-linear-TIME by default.")] = None,
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
    console.print(f"{model.name}: {'stable' if model.is_stable else 'not stable'}", highlight=False)
    for note in model.notes:
        console.print(f"left out: {note}", highlight=False)
    say_place("result   ", folder)


def _postures(config: StationConfig, content: Any) -> dict[str, Vector]:
    """Return postures (n,) [rad or m] of figures in degrees, by robot; raises InvalidParameter: no figures per axis."""
    robots = resolve(config).robots
    by_robot = isinstance(content, Mapping) and set(content) <= set(robots)
    values = content if by_robot else dict.fromkeys([config.only_robot] if config.only_robot else robots, content)
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
                "--at", content, message("linear.numbers_per_axis", "numbers per axis, such as 30 or {{joint_2: 30}}")
            ) from problem
    return postures


def _modes_table(model: LinearModel) -> Table:
    """Make a table of the modes of a linear model, slow ones first. A pair of complex poles is one mode."""
    rows = list[tuple[str, ...]]()
    for mode in model.modes:
        pole = f"{mode.pole.real:.4g}"
        if mode.pole.imag:
            pole += f" ± {mode.pole.imag:.4g}i"
        # `mostly` is the axis, or other state, that has the largest part in the mode.
        rows.append((mode.mostly, pole, f"{mode.frequency:.3f}", f"{mode.damping:.3f}", f"{mode.time_constant:.4g}"))
    return table(("mostly", "pole [1/s]", "frequency [Hz]", "damping ratio", "fades in [s]"), *rows)
