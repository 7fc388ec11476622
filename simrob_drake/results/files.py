"""Folders of results: a summary, signals, plots, a recording, and a station's file that repeats the run.

A folder appears complete or not at all. References that were passed to the run from outside of the station's file are
written as CSV files, which the station's file in the folder names.
"""

import csv
import gc
import json
import os
import signal
import sys
import textwrap
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path
from typing import Literal, NamedTuple, TypedDict

import numpy as np

from simrob_drake.base.folders import filled_at_once, free_path
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import message
from simrob_drake.blocks.references import Samples, as_reference
from simrob_drake.parts.references import TIME_COLUMN, Interpolation, Table, speed_columns
from simrob_drake.results.plots.formats import PlotFormat, plot_format
from simrob_drake.results.record.run import RecordedRun, all_events
from simrob_drake.results.record.summary import summary_of
from simrob_drake.results.verdict.verdict import Verdict
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.load import station_yaml

_COMMENT_WIDTH = 100
"""Largest count of characters of a line of a comment in YAML."""

_FRAMES = 7
"""Count of frames of the film strip of a single run, unless another one is requested."""

RUNS = Path("runs")
"""Folder in which results are saved if no other folder is given."""

# Names of files in the folder of a result.
SUMMARY = "summary.json"
SIGNALS = "signals.csv"
STATION = "station.yaml"
START = "start.json"
EVENTS = "events.csv"
PROGRAM = "program.yaml"
COMMANDS = "commands.yaml"


class Saved(TypedDict, total=False):
    """Options of :func:`save_result`."""

    force: bool
    recording: bool
    video: bool
    frames: int | Literal["events"] | None
    plots: PlotFormat


def default_folder(station: str) -> Path:
    """Path of a new folder: ``runs/<station>-<date>-<time>``, with a number appended if that exists.

    Args:
        station: name of the station.
    """
    return free_path(RUNS / f"{station}-{datetime.now():%Y%m%d-%H%M%S}", is_folder=True)


def save_result(
    result: RecordedRun,
    verdict: Verdict,
    folder: Path,
    *,
    force: bool = False,
    recording: bool = True,
    video: bool = False,
    frames: int | Literal["events"] | None = None,
    plots: PlotFormat = "png",
) -> Path:
    """Write a result to a folder: summary, signals, plots, film strip, recording, and the resolved station.

    The folder also contains the files that the station names, and as far as the result has them:

    - ``events.csv``, the events of a program, and ``program.yaml``, which repeats the program if that can be written as
      YAML. The station is then the one in which the program began.
    - ``commands.yaml``, the commands that the user gave to walks during the run. They are in the station, too.
    - ``start.json``, the state in which the run began.

    The folder appears at once, when all of its files are written.

    Args:
        result: the result.
        verdict: the verdict about it.
        folder: the folder.
        force: whether an earlier result in the folder is replaced.
        recording: whether ``recording.html`` and ``film_strip.png`` are written, and the images of cameras.
        video: whether ``video.mp4`` is written; it needs the extra ``video``.
        frames: frames of the film strip, see :func:`film_strip`. If it is None, a program has a frame of each event,
            and a single run seven frames.
        plots: format of the plots.

    Returns:
        the folder.

    Raises:
        InvalidParameter: there are fewer than two frames.
        OutputError: the folder exists and may not be replaced, or cannot be written.
        UnknownName: the format of the plots is unknown.
    """
    # Modules that draw are imported where they are needed, since they take long to load and most commands do not draw.
    from simrob_drake.results.animation.pictures import (
        check_frames,
        frame_writer,
        save_film_strip,
        save_video,
    )
    from simrob_drake.results.animation.recording import save_recording

    default_frames: int | Literal["events"] = "events" if result.runs else _FRAMES
    shown_frames = default_frames if frames is None else frames
    # Options are checked before anything is written.
    check_frames(shown_frames)
    plot_format(plots)
    if video:
        frame_writer()  # raises an error if the extra is missing
    # The summary marks a folder as a result: only a folder with one may be replaced.
    with filled_at_once(folder, marker=SUMMARY, force=force) as work:
        _write_data(result, verdict, work)
        # Plots and pictures need nothing of each other: the copy of the process draws the plots meanwhile.
        with in_background(lambda: _save_plots(result, work / "plots", plots)):
            if recording:
                save_recording(result, work / "recording.html")
                save_film_strip(result, work / "film_strip.png", frames=shown_frames)
            if video:
                save_video(result, work / "video.mp4")
            if recording and any(sensor.takes_images for sensor in result.config.sensors.values()):
                from simrob_drake.results.footage import footage_of, save_footage

                save_footage(footage_of(result), work / "cameras", video=video)
    return folder


def _write_data(result: RecordedRun, verdict: Verdict, folder: Path) -> None:
    """Write the files of a result that contain text to a folder: summary, signals, program, commands, start, station.

    Also written are the files that the station names: tables of references, and copies of files.

    Args:
        result: the result.
        verdict: the verdict about it, for the summary.
        folder: the folder.
    """
    # Names in any alphabet stay readable.
    summary = json.dumps(summary_of(result, verdict), indent=2, ensure_ascii=False)
    (folder / SUMMARY).write_text(summary + "\n", encoding="utf-8")
    write_table(folder / SIGNALS, result.names, result.times, result.values)
    if result.runs:
        _write_program(result, folder)
    if result.commanded:
        controllers = result.config.controllers
        # Only the commands: the rest of the sections is in the station's file.
        keys = {name: {controllers[name].command_key} for name in result.commanded}
        commands = station_yaml(result.config, only={"controllers": keys})
        (folder / COMMANDS).write_text(commands, encoding="utf-8")
    config = with_tables(result, folder)
    if result.start is not None:
        (folder / START).write_text(result.start.to_json() + "\n", encoding="utf-8")
        # A path without a folder is relative to the station's file, so that the folder may be moved.
        config = config.model_copy(update={"start": Path(START)})

    # Imported here: this module loads the importer of robots, which a run without saving does not need.
    from simrob_drake.stations.file_paths import with_copied_files

    station = _station_remarks(result) + station_yaml(with_copied_files(config, folder))
    (folder / STATION).write_text(station, encoding="utf-8")


def _save_plots(result: RecordedRun, folder: Path, kind: PlotFormat) -> None:
    """Write the plots of a result to a folder, in the format ``kind``."""
    # Imported here: it loads Matplotlib, which only the process that draws the plots needs.
    from simrob_drake.results.plots.own import save_plots

    save_plots(result, folder, kind)


def _write_program(result: RecordedRun, folder: Path) -> None:
    """Write the events of a program to a folder, and the program if it can be written as YAML."""
    with (folder / EVENTS).open("w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows([(TIME_COLUMN, "event"), *all_events(result)])
    if result.program:
        (folder / PROGRAM).write_text(result.program, encoding="utf-8")


def write_table(file: Path, names: list[str], times: Vector, values: Vector) -> None:
    """Write a table as CSV, so that reading it gives the same numbers to the last bit.

    Args:
        file: the file.
        names: names of the columns, without that of the time.
        times: times of the rows, shape (m,) [s].
        values: values, shape (m, k).
    """
    with file.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream)
        writer.writerow([TIME_COLUMN, *names])
        # Python writes the shortest text from which the same float is read.
        writer.writerows(np.column_stack([times, values]).tolist())


def _station_remarks(result: RecordedRun) -> str:
    """Comments for the head of ``station.yaml``, if the run was in a diagram of the user's own or began after 0 s.

    They say in what a run of the file differs from this run. For other runs the text is empty.
    """
    remarks = []
    if result.in_own_diagram:
        remarks.append(
            message(
                "results.station_alone",
                "This file is the station alone, without the diagram in which it ran. Its reference is the "
                "recorded one (reference.csv). Other inputs from the diagram, such as feedforward torques, are "
                "missing.",
            )
        )
    if result.start_time > 0:
        remarks.append(
            message(
                "results.station_began_late",
                "The run began at {begin:g} s, in the state of start.json. A run of this file begins at 0 s in that "
                'state; simulate(..., start=state, start_time="keep") begins at the time of the state.',
                begin=result.start_time,
            )
        )
    lines = [line for remark in remarks for line in textwrap.wrap(remark, _COMMENT_WIDTH)]
    return "".join(f"# {line}\n" for line in lines)


class _SampledReference(NamedTuple):
    """Samples of a robot's reference.

    Attributes:
        samples: times (m,) [s] and positions (m, n) [rad or m]; with speeds (m, 2n) if they are joined by ``hermite``.
        interpolation: how samples are joined, as the key ``interpolation`` of a table in a station's file.
    """

    samples: Samples
    interpolation: Interpolation


def with_tables(result: RecordedRun, folder: Path) -> StationConfig:
    """Write the references of a run to a folder, as far as the station's file cannot contain them.

    These are references that were passed to the run, signals of the user's diagram, and tables of other files. The
    file of a robot is ``<robot>_reference.csv``, or ``reference.csv`` in a station with one robot.

    Returns:
        the configuration of the station, in which tables with the written files are the references.
    """
    # A program may end with another station than the one in which it began.
    config = (result.begun or result.config).model_copy(update={"duration": result.config.duration})
    for robot in config.robots:
        reference = _sampled_reference(result, config, robot)
        if reference is None:
            continue
        axes = result.plant.robots[robot].axes
        columns = [*axes, *speed_columns(axes)] if reference.interpolation == "hermite" else axes
        # Samples that a user passed may be lists.
        times, values = (np.asarray(part, dtype=float) for part in reference.samples)
        file = Path("reference.csv" if config.only_robot else f"{robot}_reference.csv")
        write_table(folder / file, columns, times, values)
        table = Table(kind="table", file=file, interpolation=reference.interpolation)
        config = _with_reference(config, robot, table)
    return config


def _sampled_reference(
    result: RecordedRun, config: StationConfig, robot: str
) -> _SampledReference | None:
    """Samples of a robot's reference. Returns None if the station's file contains the reference itself.

    Args:
        result: the run.
        config: configuration of the station at the start of the run.
        robot: name of the robot.
    """
    # How simulate() joins samples that are passed to it: by smooth curves where the desired speed is used.
    joined_by: Interpolation = "cubic" if config.follows_speed(robot) else "linear"
    if result.in_own_diagram:
        # Sources of the diagram gave the reference. Times of a run of the file count from zero.
        samples = result.times - result.start_time, result.axes("q_ref", robot)
        return _SampledReference(samples, joined_by)
    passed = result.references.get(robot)
    if isinstance(passed, tuple):
        return _SampledReference(passed, joined_by)
    if passed is not None:
        # The table has the times from 0 to the planned end of the run, which may have begun later than 0.
        table = as_reference(passed).table(result.start_time + config.duration)
        return _SampledReference((table.times, table.values), table.interpolation)
    configured = config.reference_of(robot)
    if isinstance(configured, Table):
        axes = result.plant.robots[robot].axes
        return _SampledReference(configured.rows(axes), configured.interpolation)
    return None


def _with_reference(config: StationConfig, robot: str, table: Table) -> StationConfig:
    """Copy a configuration, with a table as the reference of a robot: the station's one if it is the only robot."""
    if config.only_robot:
        return config.model_copy(update={"reference": table})
    entry = config.robots[robot].model_copy(update={"reference": table})
    return config.model_copy(update={"robots": {**config.robots, robot: entry}})


@contextmanager
def in_background(work: Callable[[], object]) -> Iterator[None]:
    """Do work in a copy of this process, while this process runs the body of a ``with`` statement.

    Only the files that the work writes remain of it. If no copy can be made, the work is done after the body. If the
    work fails in the copy, it is done again in this process, where its errors are raised. If the body fails, the work
    is aborted.

    Args:
        work: function without arguments, whose result is ignored.
    """
    if not _can_copy_process():
        yield  # the body of the `with` statement runs here, and in the other case below
        work()
        return
    # A copy of the process has all objects already: nothing is sent between the two.
    copy = os.fork()  # process id of the copy; 0 in the copy
    if copy == 0:
        _work_and_exit(work)
    try:
        yield
        _, status = os.waitpid(copy, 0)
    except BaseException:
        # Killed, not asked to end: files of a copy that is still at work would appear after the error.
        os.kill(copy, signal.SIGKILL)
        os.waitpid(copy, 0)  # otherwise the copy remains as a zombie process
        raise
    if status != 0:
        work()


def _work_and_exit(work: Callable[[], object]) -> None:
    """Do work, then end the process at once: the function does not return. The exit code is 0 if the work succeeded."""
    code = 1
    try:
        # The terminal sends an interrupt to both processes; the other one handles it.
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        # Both processes share memory until one writes to it. The garbage collector would write to every object.
        gc.freeze()
        work()
        code = 0
    finally:
        # At once: exit handlers and buffered output belong to the other process.
        os._exit(code)


def _can_copy_process() -> bool:
    """Whether a copy of this process makes the work faster, and is safe.

    It needs a second core. A process with further threads, such as that of a notebook, cannot be copied: the copy would
    lack these threads, and wait for them for ever.
    """
    if sys.platform != "linux" or len(os.sched_getaffinity(0)) < 2:
        return False
    # Threads of C++ libraries count, too; Python's threading module does not list them.
    thread_count = len(os.listdir("/proc/self/task"))
    return thread_count == 1
