"""Write a result to a folder: all of it or nothing."""

from __future__ import annotations

import json
from datetime import datetime
from pathlib import Path

from simrob_drake.folders import filled_at_once
from simrob_drake.results.record.reference_tables import with_tables, write_table
from simrob_drake.results.record.run import RecordedRun
from simrob_drake.results.record.summary import summary_of
from simrob_drake.stations.load import station_yaml

RUNS = Path("runs")
SUMMARY = "summary.json"
START = "start.json"


def default_folder(station: str) -> Path:
    """Return ``runs/<station>-<date>-<time>``, with a number behind it where that exists."""
    stem = f"{station}-{datetime.now():%Y%m%d-%H%M%S}"
    candidates = (RUNS / (stem if number == 1 else f"{stem}-{number}") for number in range(1, 1000))
    return next(folder for folder in candidates if not folder.exists())


def save_result(
    result: RecordedRun, folder: Path, *, force: bool = False, recording: bool = True, video: bool = False
) -> Path:
    """Write summary, signals, plots, film strip, recording and the resolved station.

    Args:
        result: the run.
        folder: where to; it appears at once, when everything is in it.
        force: replace a result that is there.
        recording: write ``recording.html`` and ``film_strip.png``.
        video: write ``video.mp4``; needs the extra ``video``.

    Returns:
        the folder.

    Raises:
        OutputError: the folder cannot be written, or exists.
    """
    # matplotlib and Meshcat are loaded where they are needed: most commands do without
    from simrob_drake.results.animation.pictures import frame_writer, save_film_strip, save_video
    from simrob_drake.results.plots.files import save_plots

    if video:
        frame_writer()
    with filled_at_once(folder, marker=SUMMARY, force=force) as work:
        _write_summary(result, work / SUMMARY)
        _write_signals(result, work / "signals.csv")
        config = with_tables(result, work)
        if result.start is not None:
            (work / START).write_text(result.start.to_json() + "\n", encoding="utf-8")
            config = config.model_copy(update={"start": Path(START)})
        (work / "station.yaml").write_text(station_yaml(config), encoding="utf-8")
        (work / "plots").mkdir()
        save_plots(result, work / "plots")
        if recording:
            from simrob_drake.results.animation.recording import save_recording

            save_recording(result, work / "recording.html")
            save_film_strip(result, work / "film_strip.png")
        if video:
            save_video(result, work / "video.mp4")
    return folder


def _write_summary(result: RecordedRun, file: Path) -> None:
    file.write_text(json.dumps(summary_of(result), indent=2, ensure_ascii=False) + "\n", encoding="utf-8")


def _write_signals(result: RecordedRun, file: Path) -> None:
    write_table(file, result.names, result.times, result.values)
