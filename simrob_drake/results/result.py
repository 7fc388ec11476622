"""What a simulation returns, and the folder it can be saved to."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from simrob_drake.results.files import default_folder, save_result
from simrob_drake.results.overview import html_of, lines_of
from simrob_drake.results.record.run import RecordedRun
from simrob_drake.results.record.summary import summary_of


@dataclass(frozen=True)
class SimulationResult(RecordedRun):
    """A run, and what can be made of it. One exists however the run ended.

    Attributes: those of :class:`RecordedRun`.
    """

    def __repr__(self) -> str:
        """Return three lines about the run."""
        return "\n".join(lines_of(self))

    def _repr_html_(self) -> str:
        """Return what a notebook shows: these lines, a film strip and where all ended."""
        return html_of(self)

    def save(
        self, folder: Path | str | None = None, *, force: bool = False, recording: bool = True, video: bool = False
    ) -> Path:
        """Write the result to a folder, ``runs/<station>-<time>`` unless given, and return it.

        See :func:`simrob_drake.results.files.save_result`.
        """
        target = default_folder(self.config.name) if folder is None else Path(folder)
        return save_result(self, target, force=force, recording=recording, video=video)

    def summary(self) -> dict[str, Any]:
        """Return what ``summary.json`` holds."""
        return summary_of(self)
