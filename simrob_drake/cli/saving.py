"""From a run to its folder, and to what the screen says of it; one way for all commands that simulate."""

import sys
from collections.abc import Callable
from math import degrees
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from rich.text import Text

from simrob_drake.base.folders import check_folder
from simrob_drake.cli import ExitCode
from simrob_drake.cli.options import Saving
from simrob_drake.cli.screen import console, errors, finished_first, say, table
from simrob_drake.cli.tables import cells_table
from simrob_drake.results.files import COMMANDS, SUMMARY, Saved, default_folder
from simrob_drake.results.record.summary import remarks_of
from simrob_drake.results.record.walks import legged_robots, locomotion
from simrob_drake.results.result import SimulationResult, table_of
from simrob_drake.results.verdict.moves import table_of_moves
from simrob_drake.stations.checks import check_station
from simrob_drake.stations.config import StationConfig

if TYPE_CHECKING:
    from simrob_drake.programs.arm import Workcell

Frames = int | Literal["events"] | None  # of a film strip: how many, or one for each event


def prepared_folder(config: StationConfig, saving: Saving) -> Path:
    """Return where the result will be saved, after looking at all that would keep it from that; say what will go wrong.

    Raises SimrobError: the folder cannot be written, the station cannot be run, or videos cannot be made.
    """
    folder = saving.out or default_folder(config.name)
    check_folder(folder, marker=SUMMARY, force=saving.force)
    if saving.video:
        from simrob_drake.results.animation.pictures import frame_writer

        frame_writer()
    for finding in check_station(config):
        if finding.level == "warning":
            errors.print(Text.assemble(("warning", "yellow"), f" {finding.subject}: {finding.text}"))
    return folder


def wait_for_watcher(url: str) -> None:
    """Say where the motion is shown, and let a user at a terminal open that."""
    console.print(f"watch it at {url}", highlight=False)
    if sys.stdin.isatty():
        console.input("open it in a browser, then press Enter to start ")


def done_in_workcell(
    config: StationConfig,
    saving: Saving,
    prepare: "Callable[[Workcell], Callable[[], tuple[SimulationResult, str]]]",
    frames: Frames = None,
) -> ExitCode:
    """Let what is prepared be done in a station, shown if asked; save it with what is said of it, a line."""
    from simrob_drake.programs.arm import Workcell  # few commands need programs, which load scipy

    cell = Workcell(config)
    folder = prepared_folder(config, saving)
    cell.progress = not saving.live
    perform = prepare(cell)
    if saving.live:
        wait_for_watcher(cell.show())
    try:
        result, more = perform()
    finally:
        cell.close()
    return saved(result, folder, saving, more=more, frames=frames)


def way_of(result: SimulationResult, robot: str) -> str:
    """Return how far a robot came, and how it turned, in words; nothing of one that cannot tell."""
    if result.ending == "diverged" or robot not in legged_robots(result):
        return ""
    found = locomotion(result, robot)
    way = f"{found.distance:.3f} m at {found.speed:.3f} m/s on average, {found.ahead:.3f} m ahead"
    side, turn = ("left" if value >= 0 else "right" for value in (found.drift, found.yaw))
    turned = f"turned by {abs(degrees(found.yaw)):.1f} deg to the {turn}"
    return f"{robot} came {way} and {abs(found.drift):.3f} m to the {side}, and {turned}"


def saved(result: SimulationResult, folder: Path, saving: Saving, *, more: str = "", frames: Frames = None) -> ExitCode:
    """Save a result, show it with ``more``, a line about the run, and return the exit code.

    ``frames`` are those of the film strip. Raises Interrupted: the user insisted; nothing was saved.
    """
    kept: Saved = {**saving.kept, "frames": frames}
    with finished_first(f"the files of {folder}") as interrupted:
        result.save(folder, **kept)
    console.print(table(*table_of(result)))
    if result.cells:
        console.print(cells_table(result))
    console.print(f"{result.config.name}: {result.message}", highlight=False)
    for remark in remarks_of(result):
        console.print(remark, highlight=False)
    if more:
        console.print(more, highlight=False)
    console.print(result.pace, highlight=False)
    if result.verdict.moves:
        console.print(table(*table_of_moves(result.verdict.moves)))
    say(f"verdict   {result.verdict}")
    for warning in result.verdict.warnings:
        errors.print(Text.assemble(("warning", "yellow"), f" {warning}"))
    say(f"result    {folder}")
    if result.commanded:
        say(f"commanded {folder / COMMANDS}")
    if not saving.no_recording:
        say(f"recording {(folder / 'recording.html').resolve().as_uri()}")
    return ExitCode.INTERRUPTED if interrupted() else exit_code(result, strict=saving.strict)


def exit_code(result: SimulationResult, *, strict: bool = False) -> ExitCode:
    """Return what a run's end means to a shell."""
    codes = {"diverged": ExitCode.DIVERGED, "failed": ExitCode.DIVERGED, "interrupted": ExitCode.INTERRUPTED}
    return codes.get(result.ending, ExitCode.BEYOND if strict and result.warnings else ExitCode.DONE)
