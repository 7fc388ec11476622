"""From a run to its folder, and to what the screen says of it; one way for all commands that simulate."""

import sys
from collections.abc import Callable, Collection
from math import degrees
from pathlib import Path
from typing import TYPE_CHECKING, Literal, NamedTuple

from simrob_drake.base.folders import check_folder
from simrob_drake.base.messages import Message, compound, message, translate
from simrob_drake.base.remarks import SEVERITY_WORDS, Remark, Remedy
from simrob_drake.cli import ExitCode
from simrob_drake.cli.options import Saving
from simrob_drake.cli.screen import (
    PROGRAM as PROGRAM_LABEL,
)
from simrob_drake.cli.screen import (
    RESULT,
    SEVERITY_STYLES,
    console,
    finished_first,
    say,
    say_place,
    say_remark,
    say_text,
    say_warning,
    table,
)
from simrob_drake.cli.tables import cells_table, criteria_table
from simrob_drake.results.files import COMMANDS, PROGRAM, SUMMARY, Saved, default_folder
from simrob_drake.results.record.summary import remarks_of
from simrob_drake.results.record.walks import legged_robots, locomotion
from simrob_drake.results.result import SimulationResult, table_of
from simrob_drake.results.verdict.moves import meaning_of_distances, nearest_bodies, table_of_moves
from simrob_drake.results.verdict.severity import CONTROLLER_REMARK
from simrob_drake.results.verdict.verdict import Verdict
from simrob_drake.stations.checks import check_station
from simrob_drake.stations.config import StationConfig

if TYPE_CHECKING:
    from simrob_drake.programs.arm import Workcell

Frames = int | Literal["events"] | None
"""Count of the frames of a film strip, or "events" for a frame of each event; None for the default."""


class PreparedFolder(NamedTuple):
    """Folder for the result of a run, and the warnings that were shown before the run.

    Attributes:
        path: the folder.
        shown_warnings: texts of the warnings that were shown. The end of the run does not repeat them.
    """

    path: Path
    shown_warnings: frozenset[str]


def prepared_folder(config: StationConfig, saving: Saving) -> PreparedFolder:
    """Find the folder for the result of a run, before the run begins, and show the warnings of the station's check.

    Raises:
        SimrobError: the folder cannot be written, the station cannot be run, or videos cannot be made.
    """
    folder = saving.out or default_folder(config.name)
    check_folder(folder, marker=SUMMARY, force=saving.force)
    if saving.video:
        from simrob_drake.results.animation.pictures import frame_writer

        frame_writer()
    warnings = [finding for finding in check_station(config) if finding.level == "warning"]
    for finding in warnings:
        say_warning(compound("{subject}: {text}", subject=finding.subject, text=finding.text))
    return PreparedFolder(folder, frozenset(finding.text for finding in warnings))


def wait_for_watcher(url: str) -> None:
    """Show the address at which the motion can be watched. At a terminal, wait until the user has opened it."""
    say(message("cli.watch_at", "watch it at {url}", url=url))
    if sys.stdin.isatty():
        question = message("cli.open_in_browser", "open it in a browser, then press Enter to start ")
        console.input(translate(question))


def done_in_workcell(
    config: StationConfig,
    saving: Saving,
    prepare: "Callable[[Workcell], Callable[[], tuple[SimulationResult, str]]]",
    frames: Frames = None,
) -> ExitCode:
    """Do a move or a program in a workcell, and save and show the run.

    Args:
        config: the station.
        saving: how the run is shown and saved.
        prepare: checks that the move can be done in the workcell. Returns a function that does it, which returns the
            run and a sentence about it.
        frames: frames of the film strip.

    Raises:
        SimrobError: the move cannot be done, or the run cannot be saved.
    """
    from simrob_drake.programs.arm import Workcell  # few commands need programs, which load scipy

    cell = Workcell(config)
    prepared = prepared_folder(config, saving)
    cell.progress = not saving.live
    perform = prepare(cell)
    if saving.live:
        wait_for_watcher(cell.show())
    try:
        result, more = perform()
    finally:
        cell.close()
    return save_and_show(result, prepared, saving, more=more, frames=frames)


def way_of(result: SimulationResult, robot: str) -> str:
    """Sentence about how far a robot moved, and how it turned. Empty for a robot whose way is not known."""
    if result.ending == "diverged" or robot not in legged_robots(result):
        return ""
    found = locomotion(result, robot)
    moved = message(
        "cli.robot_moved",
        "{robot} moved {distance:.3f} m at {speed:.3f} m/s on average",
        robot=robot,
        distance=found.distance,
        speed=found.speed,
    )
    direction = message(
        "cli.ahead_and_turned",
        "{ahead:z.3f} m ahead, {drift:.3f} m to the {side}, turned by {turn:.1f} deg to the {turn_side}",
        ahead=found.ahead,
        drift=abs(found.drift),
        side=_side(found.drift),
        turn=abs(degrees(found.yaw)),
        turn_side=_side(found.yaw),
    )
    return compound("{moved}: {direction}", moved=moved, direction=direction)


def _side(value: float) -> Message:
    """Word for the sign of a distance or an angle to the side, which is positive to the left."""
    return message("cli.left", "left") if value >= 0 else message("cli.right", "right")


def save_and_show(
    result: SimulationResult, prepared: PreparedFolder, saving: Saving, *, more: str = "", frames: Frames = None
) -> ExitCode:
    """Save a result, show it, and return the exit code.

    Args:
        result: the result.
        prepared: where it is saved, and what was shown before the run.
        saving: how it is saved and shown.
        more: a sentence about the run that the result does not contain; empty if there is none.
        frames: frames of the film strip.

    Raises:
        Interrupted: the user interrupted twice; nothing was saved.
    """
    folder = prepared.path
    kept: Saved = {**saving.save_options, "frames": frames}
    with finished_first(message("cli.files_of", "the files of {folder}", folder=folder)) as interrupted:
        result.save(folder, **kept)
    _show_end(result)
    _show_verdict(
        result.verdict, f"{result.config.name}: ", with_table=saving.verdict, shown_before=prepared.shown_warnings
    )
    for remark in remarks_of(result):
        say_remark(Remark(CONTROLLER_REMARK, remark))
    if more:
        say_text(more)
    say_text(result.speed_in_words)
    say_place(RESULT, folder)
    if result.commanded:
        say_place(message("cli.commanded", "commanded"), folder / COMMANDS)
    if (folder / PROGRAM).exists():
        say_place(PROGRAM_LABEL, folder / PROGRAM)
    if not saving.no_recording:
        say_place(message("cli.recording", "recording"), (folder / "recording.html").resolve().as_uri())
    return ExitCode.INTERRUPTED if interrupted() else exit_code(result, strict=saving.strict)


def _show_end(result: SimulationResult) -> None:
    """Show tables of where the joints and pieces ended, of the cells that were reached, and of the moves."""
    console.print(table(*table_of(result)))
    if result.cells:
        console.print(cells_table(result))
    moves = result.verdict.moves
    if moves:
        console.print()
        console.print(table(*table_of_moves(moves)))
        nearest = nearest_bodies(moves)
        for line in (nearest, meaning_of_distances(moves)):
            if line:
                say_text(line)
    console.print()


def _show_verdict(verdict: Verdict, name: str, *, with_table: bool, shown_before: Collection[str] = ()) -> None:
    """Show a verdict: its sentence; the criteria as a table if a bound is violated; each remark with its remedy.

    Args:
        verdict: the verdict.
        name: what the sentence begins with.
        with_table: whether the table is shown even if all values are within their bounds.
        shown_before: texts of warnings that were shown before the run, and are left out.
    """
    summary, *remarks = verdict.remarks
    # An output without colours shows a warning or a failure by its word.
    is_plain = not console.is_terminal and summary.severity in ("warning", "failure")
    word = f"{translate(SEVERITY_WORDS[summary.severity])}: " if is_plain else ""
    sentence = translate(summary.text).rstrip(".")
    say_text(f"{word}{name}{sentence}.", SEVERITY_STYLES[summary.severity])
    if verdict.table and summary.severity != "failure" and (with_table or verdict.beyond):
        console.print(criteria_table(verdict))
    shown_remedies = list[Remedy]()
    for remark in remarks:
        if remark.text in shown_before:
            continue
        say_remark(remark, with_remedy=remark.remedy not in shown_remedies)
        if remark.remedy is not None:
            shown_remedies.append(remark.remedy)


def exit_code(result: SimulationResult, *, strict: bool = False) -> ExitCode:
    """Exit code for the end of a run."""
    codes = {"diverged": ExitCode.DIVERGED, "failed": ExitCode.DIVERGED, "interrupted": ExitCode.INTERRUPTED}
    return codes.get(result.ending, ExitCode.BEYOND if strict and result.warnings else ExitCode.DONE)
