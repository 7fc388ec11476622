"""The command that measures how much a robot that walks withstands: pushes."""

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import typer
from rich.table import Table

from simrob_drake.base.messages import compound, message
from simrob_drake.base.sections import validate_section
from simrob_drake.cli import ExitCode
from simrob_drake.cli.arguments import changes_of, refuse
from simrob_drake.cli.options import (
    AllowCode,
    Force,
    Scheduler,
    Settings,
    StationArgument,
    Workers,
    with_mesh_path,
)
from simrob_drake.cli.screen import TABLE, console, say_place, table
from simrob_drake.results.files import default_folder

_SIDES = {
    0.0: message("tuning.forward", "forward"),
    90.0: message("tuning.left", "left"),
    180.0: message("tuning.backward", "backward"),
    270.0: message("tuning.right", "right"),
}
"""Words for directions of a push [deg], from the robot's heading."""

_NONE = message("tuning.none", "none")


def _text_cell(value: Any) -> str:
    """Cell with a text as it is."""
    return _NONE if value is None else str(value)


def _number_cell(value: float | None) -> str:
    """Cell with a number of three digits, or "none" if there is no number."""
    return _NONE if value is None else compound("{value:.3g}", value=value)


def _time_cell(value: float | None) -> str:
    """Cell with a time [s]."""
    return _NONE if value is None else compound("{value:.4g}", value=value)


def _share_cell(value: float | None) -> str:
    """Cell with a share in per cent."""
    return _NONE if value is None else compound("{value:.0%}", value=value)


def _direction_cell(value: float | None) -> str:
    """Cell with the direction of pushes [deg]. None stands for all directions together."""
    if value is None:
        return message("tuning.all_directions", "all")
    return _SIDES.get(value) or compound("{angle:g}°", angle=value)


class _Column(NamedTuple):
    """A column of the table of a summary.

    Attributes:
        title: heading of the column.
        cell: writes a value of the summary.
    """

    title: str
    cell: Callable[[Any], str]


_COLUMNS: dict[str, _Column] = {
    "settings": _Column(message("tuning.settings", "settings"), _text_cell),
    "direction_deg": _Column(message("tuning.direction", "direction"), _direction_cell),
    "burden": _Column(message("tuning.burden", "burden"), _text_cell),
    "pushes": _Column(message("tuning.pushes", "pushes"), _text_cell),
    "withstood": _Column(message("tuning.withstood", "withstood"), _share_cell),
    "weakest_force": _Column(message("tuning.weakest_force", "weakest [N]"), _number_cell),
    "weakest_impulse": _Column(message("tuning.weakest_impulse", "weakest [N·s]"), _number_cell),
    "weakest_impulse_per_mass": _Column(
        message("tuning.weakest_per_mass", "weakest [N·s/kg]"), _number_cell
    ),
    "moment": _Column(message("tuning.moment", "at [s]"), _time_cell),
    "median_force": _Column(message("tuning.median_force", "median [N]"), _number_cell),
    "median_impulse": _Column(message("tuning.median_impulse", "median [N·s]"), _number_cell),
    "median_impulse_per_mass": _Column(
        message("tuning.median_per_mass", "median [N·s/kg]"), _number_cell
    ),
    "weakest": _Column(message("tuning.weakest", "weakest"), _number_cell),
    "median": _Column(message("tuning.median", "median"), _number_cell),
    "unit": _Column(message("tuning.unit", "unit"), _text_cell),
}
"""Columns of the table of a summary by the key of the summary, in the order in which they are shown."""


@with_mesh_path
def pushes(
    station: StationArgument,
    directions: Annotated[
        int | None,
        typer.Option(
            min=1,
            help=message(
                "tuning.help_pushes_directions",
                "Count of directions; 4 by default, the first is forward.",
            ),
        ),
    ] = None,
    phases: Annotated[
        int | None,
        typer.Option(
            min=1,
            help=message(
                "tuning.help_pushes_phases", "Count of moments over the period; 8 by default."
            ),
        ),
    ] = None,
    period: Annotated[
        float | None,
        typer.Option(
            help=message(
                "tuning.help_pushes_period", "Time of two steps [s]; the walk's own by default."
            )
        ),
    ] = None,
    start: Annotated[
        float | None,
        typer.Option(
            help=message("tuning.help_pushes_start", "The first moment [s]; 3 by default.")
        ),
    ] = None,
    duration: Annotated[
        float | None,
        typer.Option(
            help=message(
                "tuning.help_pushes_duration", "How long a push lasts [s]; 0.1 by default."
            )
        ),
    ] = None,
    after: Annotated[
        float | None,
        typer.Option(
            help=message(
                "tuning.help_pushes_after",
                "Time for which the robot must stay up afterwards [s]; 2 by default.",
            )
        ),
    ] = None,
    at: Annotated[
        str | None,
        typer.Option(
            help=message(
                "tuning.help_pushes_at", "A tool or link that is pushed; the root by default."
            )
        ),
    ] = None,
    from_: Annotated[
        float | None,
        typer.Option(
            "--from",
            metavar="N",
            help=message("tuning.help_pushes_from", "The force that a search tries first [N]."),
        ),
    ] = None,
    newtons: Annotated[
        float | None,
        typer.Option(
            "--newtons",
            metavar="N",
            help=message(
                "tuning.help_pushes_newtons", "Push by this force [N]; nothing is searched for."
            ),
        ),
    ] = None,
    vary: Annotated[
        list[str] | None,
        typer.Option(
            metavar="BURDEN",
            help=message(
                "tuning.help_pushes_vary",
                "Search in place of pushes: load, friction, stiffness, slope, step.",
            ),
        ),
    ] = None,
    seconds: Annotated[
        float | None,
        typer.Option(
            help=message(
                "tuning.help_pushes_seconds",
                "Time for which the robot walks under a burden [s]; 10 by default.",
            )
        ),
    ] = None,
    least: Annotated[
        float | None,
        typer.Option(
            help=message(
                "tuning.help_pushes_least",
                "Part of its way that the robot must go under a burden; 0.5 by default.",
            )
        ),
    ] = None,
    close: Annotated[
        float | None,
        typer.Option(
            help=message(
                "tuning.help_pushes_close",
                "Accuracy at which a search ends, as a part of the result; 0.1 by default.",
            )
        ),
    ] = None,
    seeds: Annotated[
        int,
        typer.Option(
            min=0,
            help=message(
                "tuning.help_pushes_seeds", "Draws of posture, noise, masses and friction."
            ),
        ),
    ] = 0,
    set_: Settings = None,
    variant: Annotated[
        list[str] | None,
        typer.Option(
            metavar="KEY.PATH=VALUE",
            help=message(
                "tuning.help_pushes_variant",
                "Do all with this changed, too; may be given several times.",
            ),
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            help=message("tuning.help_pushes_out", "Folder; runs/STATION-pushes-TIME by default.")
        ),
    ] = None,
    workers: Workers = None,
    scheduler: Scheduler = None,
    force: Force = False,
    allow_code: AllowCode = False,
) -> int:
    """Push a robot that walks from all sides, at all moments of its steps: the largest pushes that it withstands.

    Table, summary and picture come of it. One that was interrupted goes on when it is given again with the same --out.

    For example:

        simrob pushes zjudancer_dynamic --set gait.name=walk --out runs/pushes

        simrob pushes zjudancer_dynamic --set gait.name=walk --newtons 10 --seeds 20

        simrob pushes zjudancer_dynamic --set gait.name=walk --vary slope
    """
    from simrob_drake.extensions.tuning.burdens import Burdens
    from simrob_drake.extensions.tuning.walking_folder import PushMap, WalkingFolder

    of_pushes: dict[str, Any] = {
        "directions": directions,
        "phases": phases,
        "period": period,
        "start": start,
    }
    of_pushes |= {"duration": duration, "after": after, "first": from_, "force": newtons}
    of_burdens: dict[str, Any] = {"seconds": seconds, "least": least}
    if vary:
        refuse(message("tuning.no_effect_with_vary", "it has no effect with --vary"), **of_pushes)
    else:
        refuse(
            message("tuning.effect_with_vary", "it has an effect only with --vary"), **of_burdens
        )
    keys = {
        "station": str(Path(station).resolve()) if Path(station).is_file() else station,
        "overrides": changes_of(set_, "--set"),
        "variant": changes_of(variant, "--variant"),
        "seeds": seeds,
        "close": close,
        "at": at,
        **({"vary": vary, **of_burdens} if vary else of_pushes),
    }
    kind = Burdens if vary else PushMap
    walking = validate_section(
        kind, {key: value for key, value in keys.items() if value is not None}, "simrob pushes"
    )
    folder = out or default_folder(f"{Path(station).stem}-pushes")
    if scheduler:
        refuse(
            message(
                "tuning.cluster_decides",
                "with --scheduler the cluster decides how many workers there are",
            ),
            workers=workers,
        )
    place = WalkingFolder(folder, walking, force=force, allow_code=allow_code)
    rows = place.run(workers=workers, scheduler=scheduler)
    console.print(_table(walking.summary(rows)))
    say_place(TABLE, folder / f"{walking.name}.csv")
    return ExitCode.DONE


def _table(rows: list[dict[str, Any]]) -> Table:
    """Make the table of a summary.

    Args:
        rows: the rows of the summary, all with the same keys.
    """
    shown = {key: column for key, column in _COLUMNS.items() if key in rows[0]}
    cells = [[column.cell(row[key]) for key, column in shown.items()] for row in rows]
    return table([column.title for column in shown.values()], *cells, numbers=False)
