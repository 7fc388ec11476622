"""What a simulation returns: a run at a glance, for a shell or a notebook, and the folder it can be saved to."""

from base64 import b64encode
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Self

import numpy as np

from simrob_drake.arguments import as_path, truth
from simrob_drake.errors import InvalidParameter, VerdictError, shortened
from simrob_drake.results.files import default_folder, save_result
from simrob_drake.results.plots.formats import PlotFormat
from simrob_drake.results.record.run import DIVERGED, FAILED, RecordedRun
from simrob_drake.results.record.summary import summary_of
from simrob_drake.results.verdict.judge import verdict_of
from simrob_drake.results.verdict.moves import judge_move
from simrob_drake.results.verdict.verdict import Verdict, joined

if TYPE_CHECKING:
    from simrob_drake.results.footage import Footage

_WIDTH = 100  # characters of a line


def table_of(result: RecordedRun) -> list[list[str]]:
    """Return headings, and where every joint ended and its torques; without robots, where the free pieces ended."""
    if not result.plant.robots:
        table = [["piece", "x [m]", "y [m]", "z [m]", "speed [m/s]"]]
        for piece in result.config.free_pieces:
            place, velocity = result.piece_pose(piece)[-1, :3], result.piece_velocity(piece)[-1, :3]
            table.append([piece, *(f"{value:.4f}" for value in place), f"{np.linalg.norm(velocity):.4f}"])
        return table
    kinematic = result.config.mode == "kinematic"
    table = [["joint", "reference", "position", "unit", "torque", "peak torque", "limit", "unit"]]
    for robot in result.plant.robots.values():
        for index, (axis, limit) in enumerate(zip(robot.axes, robot.gains.torque_limit, strict=True)):
            reference, position, torque = (result[f"{robot.prefix}{s}.{axis}"] for s in ("q_ref", "q", "tau"))
            ends = [f"{values[-1] / robot.model.user_units[index]:z.3f}" for values in (reference, position)]
            unit, effort = robot.model.unit_names[index], robot.model.effort_units[index]
            peak = torque[np.argmax(np.abs(torque))]
            shown_limit = "–" if kinematic else f"{limit:g}"
            efforts = f"{torque[-1]:z.3f}", f"{peak:z.3f}", shown_limit, effort
            table.append([f"{robot.prefix}{axis}", *ends, unit, *efforts])
    return table


def html_table(lines: Sequence[Sequence[str]]) -> str:
    """Return lines of cells, headings first, as a table of HTML."""

    def line(cells: Sequence[str], kind: str) -> str:
        return f"<tr>{''.join(f'<{kind}>{escape(cell)}</{kind}>' for cell in cells)}</tr>"

    head, *body = lines
    return f"<table>{line(head, 'th')}{''.join(line(cells, 'td') for cells in body)}</table>"


@dataclass(frozen=True)
class SimulationResult(RecordedRun):
    """A run, and what can be made of it. One exists however the run ended.

    Attributes: those of :class:`RecordedRun`.
    """

    @cached_property
    def verdict(self) -> Verdict:
        """What was asked of the run against what became of it; see ``verdict:`` in a station's file."""
        if self.runs:
            whole = joined([part.verdict for part in self.runs], [part.stop_time for part in self.runs])
        else:
            whole = verdict_of(self)
        return replace(whole, moves=(*(judge_move(self, move) for move in self.moves), *whole.moves))

    @cached_property
    def images(self) -> "dict[str, Footage]":
        """What the cameras of the station saw, by their names; rendered as it is asked for."""
        from simrob_drake.results.footage import footage_of  # which takes its time to load

        return footage_of(self)

    @property
    def warnings(self) -> list[str]:
        """Why the result may be wrong, or other than was asked, though the run went to its end, in words."""
        return [*self.solver_warnings, *self.verdict.warnings]

    def __repr__(self) -> str:
        """Return three lines: how the run ended, how much of it there is, and what became of what was asked."""
        samples = f"{len(self.times)} samples of {len(self.names)} columns to {self.stop_time:.4g} s"
        judged = shortened("; ".join(self.warnings) or str(self.verdict), _WIDTH)
        return f"{self.config.name}: {self.message}\n{samples}, {self.pace}\n{judged}"

    def _repr_html_(self) -> str:
        """Return what a notebook shows: these lines, a film strip and where all ended."""
        from simrob_drake.results.animation.pictures import film_strip  # which takes its time to load

        strip = b64encode(film_strip(self)).decode()
        return (
            f"<p>{'<br>'.join(escape(repr(self)).splitlines())}</p>"
            f'<img alt="film strip" style="max-width: 100%" src="data:image/png;base64,{strip}">'
            f"{html_table(table_of(self))}"
        )

    def save(
        self,
        folder: Path | str | None = None,
        *,
        force: bool = False,
        recording: bool = True,
        video: bool = False,
        frames: int | Literal["events"] | None = None,
        plots: PlotFormat = "png",
    ) -> Path:
        """Write the result to a folder, ``runs/<station>-<time>`` unless given, and return it.

        See :func:`simrob_drake.results.files.save_result`.
        """
        target = default_folder(self.config.name) if folder is None else as_path(folder, "folder")
        kinds = {"force": force, "recording": recording, "video": video}
        kept = {name: truth(value, name) for name, value in kinds.items()}
        return save_result(self, self.verdict, target, frames=frames, plots=plots, **kept)

    def film(self, file: Path | str, *, frames: int | Literal["events"] = 7) -> Path:
        """Write the motion as a film, and return its file.

        Args:
            file: ``.html`` for a page that plays, ``.png`` for a strip of frames, ``.mp4`` for a video.
            frames: of a strip: how many, or one for each of its ``events``.

        Raises:
            InvalidParameter: another kind of file, or fewer than two frames.
            OutputError: the file cannot be written.
        """
        from simrob_drake.results.animation.pictures import save_film_strip, save_video  # which take long to load
        from simrob_drake.results.animation.recording import save_recording

        target = as_path(file, "file")
        if target.suffix == ".png":
            return save_film_strip(self, target, frames=frames)
        if target.suffix not in (".html", ".mp4"):
            raise InvalidParameter("file", target.name, "one that ends in .html, .png, .mp4")
        return (save_recording if target.suffix == ".html" else save_video)(self, target)

    def check(self, strict: bool = True) -> Self:
        """Return the run; with ``strict`` only if it did what was asked.

        Raises:
            VerdictError: it has warnings, diverged, or a block failed in it; the error holds it as ``result``.
        """
        if truth(strict, "strict"):
            wrong = [self.message] if self.ending in (DIVERGED, FAILED) else self.warnings
            if wrong:
                raise VerdictError(f"{self.config.name}: {'; '.join(wrong)}", self)
        return self

    def summary(self) -> dict[str, Any]:
        """Return what ``summary.json`` holds."""
        return summary_of(self, self.verdict)
