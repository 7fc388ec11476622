"""Runs that follow each other as one motion, to be looked at."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from simrob_drake.errors import InvalidParameter
from simrob_drake.frames import Vector
from simrob_drake.given import path
from simrob_drake.results.result import SimulationResult


def save_film(runs: Sequence[SimulationResult], file: Path | str, *, frames: int | Literal["events"] = 7) -> Path:
    """Write runs that follow each other as one film.

    Args:
        runs: of one station, each begun where the one before ended.
        file: ``.html`` for a page that plays, ``.png`` for a strip of frames, ``.mp4`` for a video.
        frames: of a strip: how many, or one for each of its ``events``.

    Returns:
        the file.

    Raises:
        InvalidParameter: no run, a piece that changes hands between them (but for a strip), or another kind of file.
        OutputError: the file cannot be written.
    """
    from simrob_drake.results.animation.pictures import save_film_strip, save_video  # which load matplotlib
    from simrob_drake.results.animation.recording import save_recording

    target = path(file, "file")
    if target.suffix == ".png":
        return save_film_strip(runs, target, frames=frames)
    if target.suffix not in (".html", ".mp4"):
        raise InvalidParameter("file", target.name, "one that ends in .html, .png, .mp4")
    return (save_recording if target.suffix == ".html" else save_video)(joined(runs), target)


def joined(runs: Sequence[SimulationResult]) -> SimulationResult:
    """Return runs that follow each other as one result, for pictures: its station is the last run's.

    Contact forces are left out, and so are signals that not all runs have.

    Raises:
        InvalidParameter: no run, or a piece that changes hands between them.
    """
    if not runs:
        raise InvalidParameter("runs", "empty", "some: what was run last")
    if any(_places(run) != _places(runs[0]) for run in runs):
        raise InvalidParameter("runs", "of a program in which a piece changes hands", "shown one by one: robot.runs")
    begins = np.concatenate([[0.0], np.cumsum([run.stop_time for run in runs])])
    names = [name for name in runs[0].names if all(name in run.names for run in runs)]
    columns = [[run.names.index(name) for name in names] for run in runs]

    def positions_at(times: Vector) -> Vector:
        number = np.clip(np.searchsorted(begins, times, side="right") - 1, 0, len(runs) - 1)
        rows = np.empty((len(times), runs[0].plant.plant.num_positions()))
        for index, run in enumerate(runs):
            own = number == index
            if own.any():
                rows[own] = run.positions_at(np.clip(times[own] - begins[index], 0.0, run.stop_time))
        return rows

    last = runs[-1]
    return replace(
        last,
        config=last.config.model_copy(update={"duration": float(begins[-1])}),
        names=names,
        times=np.concatenate([run.times + begin for run, begin in zip(runs, begins, strict=False)]),
        values=np.vstack([run.values[:, own] for run, own in zip(runs, columns, strict=True)]),
        step_times=np.concatenate([run.step_times + begin for run, begin in zip(runs, begins, strict=False)]),
        positions_at=positions_at,
        start=runs[0].start,
        contacts_at=None,
    )


def _places(run: SimulationResult) -> dict[str, Any]:
    return {name: (piece.parent, piece.frame, piece.pose) for name, piece in run.config.pieces.items()}
