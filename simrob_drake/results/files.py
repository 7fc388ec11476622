"""Write a result to a folder, all of it or nothing; its references, too, as CSV files that ``station.yaml`` names."""

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
from typing import Literal, TypedDict

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

_COMMENT_WIDTH = 100  # characters of a line of a comment in YAML
RUNS = Path("runs")
SUMMARY = "summary.json"
SIGNALS = "signals.csv"
STATION = "station.yaml"
START = "start.json"
EVENTS, PROGRAM, COMMANDS = "events.csv", "program.yaml", "commands.yaml"


class Saved(TypedDict, total=False):
    """How a result is saved, see :func:`save_result`."""

    force: bool
    recording: bool
    video: bool
    frames: int | Literal["events"] | None
    plots: PlotFormat


def default_folder(station: str) -> Path:
    """Return ``runs/<station>-<date>-<time>``, with a number behind it where that exists."""
    return free_path(RUNS / f"{station}-{datetime.now():%Y%m%d-%H%M%S}")


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
    """Write summary, signals, plots, film strip, recording and the resolved station, with the files that it names.

    Of a program that is the station in which it began; ``events.csv`` tells what happened when, and ``program.yaml``,
    where one can say it, does it all again on that station. What somebody commanded meanwhile is in the station, and
    alone in ``commands.yaml``. The folder appears at once, when everything is in it, and is returned; ``force``
    replaces a result that is there; ``recording`` is ``recording.html`` and ``film_strip.png``, whose frames are as
    :func:`film_strip` takes them, seven unless given, and of a program one an event; ``video.mp4`` needs the extra
    ``video``; plots are ``png``, ``svg`` or ``pdf``. Raises InvalidParameter: fewer than two frames; OutputError: the
    folder cannot be written, or exists; UnknownName: plots of another kind.
    """
    # what draws is loaded where it is needed: most commands do without
    from simrob_drake.results.animation.pictures import check_frames, frame_writer, save_film_strip, save_video
    from simrob_drake.results.animation.recording import save_recording

    shown: int | Literal["events"] = ("events" if result.runs else 7) if frames is None else frames
    check_frames(shown)
    plot_format(plots)
    if video:
        frame_writer()
    with filled_at_once(folder, marker=SUMMARY, force=force) as work:
        summary = json.dumps(summary_of(result, verdict), indent=2, ensure_ascii=False)
        (work / SUMMARY).write_text(summary + "\n", encoding="utf-8")
        write_table(work / SIGNALS, result.names, result.times, result.values)
        if result.runs:
            _write_program(result, work)
        if result.commanded:
            controllers = result.config.controllers
            keys = {name: {controllers[name].command_key} for name in result.commanded}
            text = station_yaml(result.config, only={"controllers": keys})
            (work / COMMANDS).write_text(text, encoding="utf-8")
        config = with_tables(result, work)
        if result.start is not None:
            (work / START).write_text(result.start.to_json() + "\n", encoding="utf-8")
            config = config.model_copy(update={"start": Path(START)})

        from simrob_drake.stations.file_paths import with_copied_files  # the importer, which a run alone does not need

        text = _station_remarks(result) + station_yaml(with_copied_files(config, work))
        (work / STATION).write_text(text, encoding="utf-8")
        with in_background(lambda: _save_plots(result, work / "plots", plots)):
            if recording:
                save_recording(result, work / "recording.html")
                save_film_strip(result, work / "film_strip.png", frames=shown)
            if video:
                save_video(result, work / "video.mp4")
            if recording and any(sensor.takes_images for sensor in result.config.sensors.values()):
                from simrob_drake.results.footage import footage_of, save_footage

                save_footage(footage_of(result), work / "cameras", video=video)
    return folder


def _save_plots(result: RecordedRun, folder: Path, kind: PlotFormat) -> None:
    from simrob_drake.results.plots.own import save_plots  # which loads matplotlib

    save_plots(result, folder, kind)


def _write_program(result: RecordedRun, folder: Path) -> None:
    with (folder / EVENTS).open("w", newline="", encoding="utf-8") as lines:
        csv.writer(lines).writerows([(TIME_COLUMN, "event"), *all_events(result)])
    if result.program:
        (folder / PROGRAM).write_text(result.program, encoding="utf-8")


def write_table(file: Path, names: list[str], times: Vector, values: Vector) -> None:
    """Write numbers so that reading them gives the same bits."""
    with file.open("w", newline="", encoding="utf-8") as lines:
        writer = csv.writer(lines)
        writer.writerow([TIME_COLUMN, *names])
        writer.writerows(np.column_stack([times, values]).tolist())


def _station_remarks(result: RecordedRun) -> str:
    """Comments for the head of ``station.yaml``, on what a run of the file repeats; empty if it repeats everything."""
    remarks = []
    if result.in_own_diagram:
        remarks.append(
            message(
                "results.station_alone",
                "This is the station alone, without the diagram in which it was run. Its reference is the recorded one "
                "(reference.csv); what else the diagram gave it, such as feedforward, is not repeated.",
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


def with_tables(result: RecordedRun, folder: Path) -> StationConfig:
    """Write the references that are no part of the configuration as tables, and return one that names them."""
    config = (result.begun or result.config).model_copy(update={"duration": result.config.duration})
    for robot in config.robots:
        reference, played = config.reference_of(robot), result.references.get(robot)
        axes = result.plant.robots[robot].axes
        way: Interpolation = "cubic" if config.follows_speed(robot) else "linear"  # as simulate() joins samples
        samples: Samples
        if result.in_own_diagram:
            # Sources of the diagram gave the reference. Times of a run of the file count from zero.
            samples = result.times - result.start_time, result.axes("q_ref", robot)
        elif isinstance(played, tuple):
            samples = played
        elif played is not None:
            made = as_reference(played).table(config.duration)
            way, samples = made.interpolation, (made.times, made.values)
        elif isinstance(reference, Table):
            way, samples = reference.interpolation, reference.rows(axes)
        else:
            continue
        columns = [*axes, *speed_columns(axes)] if way == "hermite" else axes
        times, values = (np.asarray(part, dtype=float) for part in samples)
        file = Path("reference.csv" if config.only_robot else f"{robot}_reference.csv")
        write_table(folder / file, columns, times, values)
        config = _with_reference(config, robot, Table(kind="table", file=file, interpolation=way))
    return config


def _with_reference(config: StationConfig, robot: str, table: Table) -> StationConfig:
    if config.only_robot:
        return config.model_copy(update={"reference": table})
    entry = config.robots[robot].model_copy(update={"reference": table})
    return config.model_copy(update={"robots": {**config.robots, robot: entry}})


@contextmanager
def in_background(work: Callable[[], object]) -> Iterator[None]:
    """Do work in a copy of this process while the body of a ``with`` statement runs; after it, where none can be made.

    Only the files that the work writes remain of it. Work that fails is done again here, where its errors are told; if
    the body fails, the work is broken off.
    """
    if not _can_copy():
        yield
        work()
        return
    copy = os.fork()
    if not copy:
        _work_and_leave(work)
    try:
        yield
        failed = os.waitpid(copy, 0)[1] != 0
    except BaseException:
        os.kill(copy, signal.SIGKILL)
        os.waitpid(copy, 0)
        raise
    if failed:
        work()


def _work_and_leave(work: Callable[[], object]) -> None:
    code = 1
    try:
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # an interrupt is the other's business
        gc.freeze()  # what came with it is no rubbish, nor to be copied by looking at it
        work()
        code = 0
    finally:
        os._exit(code)  # without what the other has still to write, or to tidy up


def _can_copy() -> bool:
    """Tell whether there is a second core, and no thread that a copy would lack, such as a notebook's."""
    return sys.platform == "linux" and len(os.sched_getaffinity(0)) > 1 and len(os.listdir("/proc/self/task")) == 1
