"""The command that compares a station's run with other engines or with logged signals: `simrob compare`."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from simrob_drake.base.errors import InvalidParameter
from simrob_drake.base.extension import needed_extension
from simrob_drake.base.folders import check_folder
from simrob_drake.base.messages import compound, message, translate
from simrob_drake.cli.arguments import refuse, station_from
from simrob_drake.cli.options import AllowCode, Force, Settings, StationArgument, with_mesh_path
from simrob_drake.cli.screen import RESULT, console, errors, say_place, say_text, table
from simrob_drake.cli.tables import AT_TIME, LARGEST_DIFFERENCE, in_units
from simrob_drake.stations.config import StationConfig

if TYPE_CHECKING:
    from simrob_drake.extensions.comparison.engines import Difference


@with_mesh_path
def compare(
    station: StationArgument,
    with_: Annotated[
        Path | None,
        typer.Option(
            "--with",
            metavar="FILE",
            help=message(
                "comparison.help_compare_with",
                "Logged signals: .csv with a header, .mat or .parquet.",
            ),
        ),
    ] = None,
    map_: Annotated[
        list[str] | None,
        typer.Option(
            "--map",
            metavar="THEIRS=OURS",
            help=message(
                "comparison.help_compare_map",
                "What a logged signal is called here, as yout.1=q.joint_1, or yout.1=q.joint_1:deg.",
            ),
        ),
    ] = None,
    set_: Settings = None,
    out: Annotated[
        Path | None,
        typer.Option(
            help=message("comparison.help_compare_out", "Folder for the numbers and pictures.")
        ),
    ] = None,
    force: Force = False,
    allow_code: AllowCode = False,
) -> None:
    """Hold a station's run against others: logged signals of the original, or other engines with error bars.

    Other engines are another scheme of Drake, MuJoCo, and inverse dynamics where it exists.

    For example:

        simrob compare irb120_dynamic --out compared

        simrob compare irb120_dynamic --with logged.mat --map yout.1=q.joint_1
    """
    config = station_from(station, set_, allow_code=allow_code)
    if with_ is not None:
        _compare_with_log(config, with_, map_ or [], out, force=force)
        return
    refuse(message("comparison.only_with_log", "it has an effect only with --with"), map=map_)
    _compare_engines(config, out, force=force)


def _compare_engines(config: StationConfig, out: Path | None, *, force: bool) -> None:
    """Run a station in all engines that are installed, and show and save the differences."""
    from simrob_drake.extensions.comparison.engines import (
        NUMBERS,
        compare_engines,
        differences,
        save_comparison,
    )

    if out is not None:
        check_folder(out, marker=NUMBERS, force=force)
    with errors.status("") as status:

        def show_engine(name: str) -> None:
            """Show the engine in which the station runs now."""
            status.update(
                translate(message("comparison.running_in", "running in {engine}", engine=name))
            )

        found_by = compare_engines(config, progress=show_engine)
    first, *others = found_by.accounts
    found = differences(first, others)
    rows = list[tuple[str, ...]]()
    for one in found:
        largest = in_units(one.largest, one.quantity.unit)
        error = in_units(one.error, one.quantity.unit)
        rows.append(
            (
                one.account,
                one.quantity.name,
                largest,
                compound("{time:.3f}", time=one.at),
                error,
                _within(one),
            )
        )
    for account in found_by.accounts:
        say_text(compound("{engine}: {ending}", engine=account.name, ending=account.ended))
    headings = (
        message("comparison.engine", "engine"),
        message("comparison.quantity", "quantity"),
        message("comparison.largest_from", "largest difference from {engine}", engine=first.name),
        AT_TIME,
        message("comparison.error_bars", "error bars"),
        message("comparison.within", "within"),
    )
    console.print(table(headings, *rows, numbers=False))
    for name, why in found_by.missing.items():
        say_text(compound("{engine}: {reason}", engine=name, reason=why))
    if out is not None:
        save_comparison(found_by.accounts, found, out, station=config.name, force=force)
        say_place(RESULT, out)


def _within(difference: "Difference") -> str:
    """Say whether a difference is within its error bars, and if not, how many times as large it is."""
    if difference.within:
        return message("comparison.yes", "yes")
    if difference.error > 0:
        return message(
            "comparison.no_by_factor",
            "no, {factor:.2g} ×",
            factor=difference.largest / difference.error,
        )
    return message("comparison.no", "no")


def _compare_with_log(
    config: StationConfig, log: Path, map_: list[str], out: Path | None, *, force: bool
) -> None:
    """Compare logged signals of the original with the signals of a station, and show and save the differences.

    Args:
        config: the station.
        log: file with the logged signals.
        map_: for signals whose names differ, ``THEIRS=OURS`` or ``THEIRS=OURS:UNIT``.
        out: folder for numbers and pictures; None if nothing is to be saved.
        force: whether to replace the folder if it exists.

    Raises:
        MissingExtension: the extension ``simulink``, which reads logs, is missing.
        SimrobError: the log or `map_` cannot be read, or the folder exists.
    """
    with needed_extension("simulink", message("comparison.compare_with", "simrob compare --with")):
        from simrob_drake.extensions.simulink.logs import (
            NUMBERS,
            compare,
            read_log,
            save_differences,
        )

    own_names = {}  # name of the station's signal, perhaps with a unit, by the name in the log
    for entry in map_:
        theirs, _, ours = (part.strip() for part in entry.partition("="))
        if not (theirs and ours):
            raise InvalidParameter(
                "--map",
                entry,
                message(
                    "comparison.theirs_and_ours",
                    "of the form THEIRS=OURS[:UNIT], as yout.1=q.joint_1:deg",
                ),
            )
        own_names[theirs] = ours
    if out is not None:
        check_folder(out, marker=NUMBERS, force=force)
    logged = read_log(log, own_names)
    _, differences = compare(config, logged, progress=True)
    rows = [
        (
            found.signal,
            in_units(found.largest, found.unit),
            compound("{time:.3f}", time=found.at),
            in_units(found.rms, found.unit),
        )
        for found in differences
    ]
    console.print(
        table(
            (
                message("comparison.signal", "signal"),
                LARGEST_DIFFERENCE,
                AT_TIME,
                message("comparison.root_mean_square", "root mean square"),
            ),
            *rows,
            numbers=False,
        )
    )
    unknown = sorted(logged.keys() - {found.signal for found in differences})
    if unknown:
        text = message(
            "comparison.no_such_signals",
            "not among the station's signals: {names}",
            names=", ".join(unknown),
        )
        say_text(text)
    if out is not None:
        save_differences(differences, out, force=force)
        say_place(RESULT, out)
