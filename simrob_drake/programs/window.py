"""A browser window that shows a workcell while it works."""

from __future__ import annotations

import gc

from simrob_drake.frames import Vector
from simrob_drake.results.animation.live import LiveView
from simrob_drake.results.animation.recording import draw_tool_paths, open_meshcat
from simrob_drake.results.record.state import State
from simrob_drake.results.result import SimulationResult
from simrob_drake.stations.config import StationConfig


class Window:
    """Shows runs at the pace of the clock, and leaves the ways of the tools as lines.

    Attributes:
        url: where to look; it listens on this computer only.
    """

    def __init__(self, config: StationConfig, state: State | None) -> None:
        """Open the window with a station in a state, or at its initial posture."""
        self._meshcat = open_meshcat()
        self.url: str = self._meshcat.web_url()
        self._config: StationConfig | None = None
        self._paths = 0
        self.draw(config, state)

    def draw(self, config: StationConfig, state: State | None) -> None:
        """Show a station in a state; its robots and pieces are loaded anew where they changed."""
        if config != self._config:
            self._view = LiveView(config, meshcat=self._meshcat)
            self._config = config
        if state is not None:
            self._view.draw(state)

    def on_step(self, time: float, positions: Vector) -> None:
        """Show a step of a run; hand it to ``simulate(on_step=...)``."""
        self._view.on_step(time, positions)

    def add_paths(self, result: SimulationResult) -> None:
        """Draw the ways of the tools in a run."""
        draw_tool_paths(self._meshcat, result, self._paths)
        self._paths += 1

    def close(self) -> None:
        """Close the window and its port."""
        self._view.close()
        del self._meshcat
        gc.collect()  # Drake's diagrams are cycles: without this Meshcat would go on listening for a while
