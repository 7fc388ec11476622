"""The command that compares a station's run with other engines or with logged signals: `simrob compare`."""

from pathlib import Path
from typing import Annotated

import typer

from simrob_drake.base.errors import InvalidParameter
from simrob_drake.base.extension import needed_extension
from simrob_drake.base.folders import check_folder
from simrob_drake.base.messages import message
from simrob_drake.cli.arguments import refuse, station_from
from simrob_drake.cli.options import Force, Settings, StationArgument, with_mesh_path
from simrob_drake.cli.screen import console, errors, say_place, say_text, table
from simrob_drake.cli.tables import in_units
from simrob_drake.stations.config import StationConfig


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
        _compare_with_log(station_from(station, set_), with_, map_ or [], out, force=force)
        return
    refuse("it has an effect only with --with", map=map_)
    _compare_engines(station_from(station, set_), out, force=force)


def _compare_engines(config: StationConfig, out: Path | None, *, force: bool) -> None:
    """Run a station in all engines that are installed, and show and save the differences."""
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
        say_text(f"{account.name}: {account.ended}")
    headings = ("engine", "quantity", f"from {first.name} at most", "at [s]", "error bars", "within")
    console.print(table(headings, *rows, numbers=False))
    for name, why in found_by.missing.items():
        say_text(f"{name}: {why}")
    if out is not None:
        save_comparison(found_by.accounts, found, out, station=config.name, force=force)
        say_place("result  ", out)


def _compare_with_log(config: StationConfig, log: Path, map_: list[str], out: Path | None, *, force: bool) -> None:
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
        from simrob_drake.extensions.simulink.logs import NUMBERS, compare, read_log, save_differences

    own_names = {}  # name of the station's signal, perhaps with a unit, by the name in the log
    for entry in map_:
        theirs, _, ours = (part.strip() for part in entry.partition("="))
        if not (theirs and ours):
            raise InvalidParameter(
                "--map",
                entry,
                message("comparison.theirs_and_ours", "of the form THEIRS=OURS[:UNIT], as yout.1=q.joint_1:deg"),
            )
        own_names[theirs] = ours
    if out is not None:
        check_folder(out, marker=NUMBERS, force=force)
    logged = read_log(log, own_names)
    _, differences = compare(config, logged, progress=True)
    rows = [
        (found.signal, in_units(found.largest, found.unit), f"{found.at:.3f}", in_units(found.rms, found.unit))
        for found in differences
    ]
    console.print(table(("signal", "largest difference", "at [s]", "root mean square"), *rows, numbers=False))
    unknown = sorted(logged.keys() - {found.signal for found in differences})
    if unknown:
        say_text(f"not among the station's signals: {', '.join(unknown)}")
    if out is not None:
        save_differences(differences, out, force=force)
        say_place("result  ", out)
