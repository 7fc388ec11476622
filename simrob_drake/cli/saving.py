"""Save the result of a run in its folder, and show it on the screen. All commands that simulate share this code.

A command first prepares the folder, then runs the station, and then saves and shows the result. So it finds out before
a long run that the folder cannot be written.
"""

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
    """Folder for the result of a run, and the warnings of the station's check that were shown before the run.

    Attributes:
        path: the folder.
        shown_warnings: texts of the warnings that were shown. The end of the run does not repeat them.
    """

    path: Path
    shown_warnings: frozenset[str]


def prepared_folder(config: StationConfig, saving: Saving) -> PreparedFolder:
    """Choose and check the folder for the result of a run, before the run, and show the warnings about the station.

    Args:
        config: the station. Its name is part of the name of the default folder.
        saving: options for saving the result.

    Raises:
        SimrobError: the folder cannot be written, the station cannot be run, or videos cannot be made.
    """
    folder = saving.out or default_folder(config.name)
    check_folder(folder, marker=SUMMARY, force=saving.force)
    if saving.video:
        from simrob_drake.results.animation.pictures import frame_writer

        # A missing package for videos is found now, not after the run.
        frame_writer()
    # The warnings are shown now, so that the user can stop a long run that will go wrong.
    warnings = [finding for finding in check_station(config) if finding.level == "warning"]
    for finding in warnings:
        say_warning(compound("{subject}: {text}", subject=finding.subject, text=finding.text))
    return PreparedFolder(folder, frozenset(finding.text for finding in warnings))


def wait_for_watcher(url: str) -> None:
    """Show the address at which the motion can be watched. At a terminal, wait until the user has opened it."""
    say(message("cli.watch_at", "watch the motion at {url}", url=url))
    # Without a terminal, as in a script or a test, there is no user to press Enter.
    if sys.stdin.isatty():
        question = message(
            "cli.open_in_browser", "open the address in a browser, then press Enter to start "
        )
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
        prepare: called once with the workcell, before the motion is shown. It may raise errors of the move. It returns
            a function that does the move, and returns the run and a sentence about it; the sentence may be empty.
        frames: frames of the film strip.

    Returns:
        exit code of the run.

    Raises:
        SimrobError: the move cannot be done, or the run cannot be saved.
    """
    # Few commands need programs, which load scipy.
    from simrob_drake.programs.arm import Workcell

    cell = Workcell(config)
    prepared = prepared_folder(config, saving)
    # The progress bar would only repeat the time that the browser shows.
    cell.progress = not saving.live
    perform = prepare(cell)
    if saving.live:
        wait_for_watcher(cell.show())
    try:
        result, remark = perform()
    finally:
        # The page in the browser belongs to the workcell. It would go on listening after an error, too.
        cell.close()
    return save_and_show(result, prepared, saving, remark=remark, frames=frames)


def locomotion_sentence(result: SimulationResult, robot: str) -> str:
    """Sentence about how far a legged robot moved, and how far it turned.

    Args:
        result: the run.
        robot: name of the robot. The sentence is empty unless torques move the robot, and it has feet and a base that
            moves freely. It is also empty if the run diverged.
    """
    # The last positions of a diverged run are no motion of a robot.
    if result.ending == "diverged" or robot not in legged_robots(result):
        return ""
    path = locomotion(result, robot)
    moved = message(
        "cli.robot_moved",
        "{robot} moved {distance:.3f} m at {speed:.3f} m/s on average",
        robot=robot,
        distance=path.distance,
        speed=path.speed,
    )
    # The format z writes -0.000 as 0.000.
    direction = message(
        "cli.ahead_and_turned",
        "{ahead:z.3f} m ahead, {drift:.3f} m to the {side}, turned by {turn:.1f} deg to the {turn_side}",
        ahead=path.ahead,
        drift=abs(path.drift),
        # The words give the side, so the numbers have no sign.
        side=_side(path.drift),
        turn=abs(degrees(path.yaw)),
        turn_side=_side(path.yaw),
    )
    return compound("{moved}: {direction}", moved=moved, direction=direction)


def _side(value: float) -> Message:
    """Word for the sign of a distance or an angle to the side, which is positive to the left."""
    return message("cli.left", "left") if value >= 0 else message("cli.right", "right")


def save_and_show(
    result: SimulationResult,
    prepared: PreparedFolder,
    saving: Saving,
    *,
    remark: str = "",
    frames: Frames = None,
) -> ExitCode:
    """Save a result, and then show it on the screen.

    Args:
        result: the result.
        prepared: folder for the result, and the warnings that were shown before the run.
        saving: options for saving and showing the result.
        remark: a sentence about the run that the result does not contain; empty if there is none.
        frames: frames of the film strip.

    Returns:
        exit code of the run; INTERRUPTED (130) if the user interrupted the saving, which was finished nevertheless.

    Raises:
        Interrupted: the user interrupted twice; nothing was saved.
        SimrobError: the result cannot be saved.
    """
    folder = prepared.path
    save_options: Saved = {**saving.save_options, "frames": frames}
    with finished_first(
        message("cli.files_of", "the files of {folder}", folder=folder)
    ) as was_interrupted:
        result.save(folder, **save_options)
    # The result is saved before it is shown: a broken pipe on the screen then loses no files.
    _show_end(result)
    _show_verdict(
        result.verdict,
        f"{result.config.name}: ",
        with_table=saving.verdict,
        shown_before=prepared.shown_warnings,
    )
    for controller_remark in remarks_of(result):
        say_remark(Remark(CONTROLLER_REMARK, controller_remark))
    if remark:
        say_text(remark)
    say_text(result.speed_in_words)
    _show_files(result, folder, with_recording=not saving.no_recording)
    if was_interrupted():
        return ExitCode.INTERRUPTED
    return exit_code(result, strict=saving.strict)


def _show_files(result: SimulationResult, folder: Path, *, with_recording: bool) -> None:
    """Show the folder of the result, and its files that users open or run again.

    Args:
        result: the result.
        folder: its folder.
        with_recording: whether a recording was saved.
    """
    say_place(RESULT, folder)
    # The file with the commands makes it possible to repeat a run that the user has steered.
    if result.commanded:
        say_place(message("cli.commanded", "commanded"), folder / COMMANDS)
    if (folder / PROGRAM).exists():
        say_place(PROGRAM_LABEL, folder / PROGRAM)
    if with_recording:
        # An address, unlike a path, is opened by a click in most terminals.
        address = (folder / "recording.html").resolve().as_uri()
        say_place(message("cli.recording", "recording"), address)


def _show_end(result: SimulationResult) -> None:
    """Show tables of where the joints ended (in a station without robots, the free pieces), of cells, and of moves.

    The table of cells is shown if the station has a sequencer, that of moves if the verdict judges single moves.
    """
    console.print(table(*table_of(result)))
    if result.cells:
        console.print(cells_table(result))
    moves = result.verdict.moves
    if moves:
        console.print()
        console.print(table(*table_of_moves(moves)))
        # Both sentences explain the distances of the table. They are empty if it has none.
        for sentence in (nearest_bodies(moves), meaning_of_distances(moves)):
            if sentence:
                say_text(sentence)
    console.print()


def _show_verdict(
    verdict: Verdict, name: str, *, with_table: bool, shown_before: Collection[str] = ()
) -> None:
    """Show a verdict: its sentence, the table of its criteria if a bound is violated, and its remarks with remedies.

    A run that failed has no table.

    Args:
        verdict: the verdict.
        name: beginning of the sentence, such as "irb120_dynamic: ".
        with_table: whether the table is also shown if all values are within their bounds.
        shown_before: texts of warnings that were shown before the run, and are left out.
    """
    # The first remark sums up the run.
    summary, *remarks = verdict.remarks
    # An output without colours shows a warning or a failure by its word.
    is_plain = not console.is_terminal and summary.severity in ("warning", "failure")
    word = f"{translate(SEVERITY_WORDS[summary.severity])}: " if is_plain else ""
    sentence = translate(summary.text).rstrip(".")
    say_text(f"{word}{name}{sentence}.", SEVERITY_STYLES[summary.severity])
    # After a failure, violated criteria are only its consequences.
    is_table_useful = bool(verdict.table) and summary.severity != "failure"
    if is_table_useful and (with_table or verdict.beyond):
        console.print(criteria_table(verdict))
    # Several remarks may have the same remedy, which is shown once.
    shown_remedies = list[Remedy]()
    for remark in remarks:
        if remark.text in shown_before:
            continue
        say_remark(remark, with_remedy=remark.remedy not in shown_remedies)
        if remark.remedy is not None:
            shown_remedies.append(remark.remedy)


def exit_code(result: SimulationResult, *, strict: bool = False) -> ExitCode:
    """Exit code for the end of a run.

    Args:
        result: the run.
        strict: whether warnings about the run give the code BEYOND (4), see the option ``--strict``.
    """
    # An end by a monitor or after the full duration is a success.
    codes_of_other_ends = {
        "diverged": ExitCode.DIVERGED,
        "failed": ExitCode.DIVERGED,
        "interrupted": ExitCode.INTERRUPTED,
    }
    if result.ending in codes_of_other_ends:
        return codes_of_other_ends[result.ending]
    if strict and result.warnings:
        return ExitCode.BEYOND
    return ExitCode.DONE
