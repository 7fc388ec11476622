"""A browser window that shows a station while it is simulated, run after run."""

import gc
from time import perf_counter, sleep

import numpy as np

from simrob_drake.frames import Vector
from simrob_drake.results.animation.camera import camera_on, side
from simrob_drake.results.animation.recording import ASPECT, draw_tool_paths, look, open_meshcat
from simrob_drake.results.animation.scene import Scene
from simrob_drake.results.record.run import RecordedRun
from simrob_drake.results.record.state import State
from simrob_drake.stations.config import StationConfig

FRAME = 1 / 30
"""Simulated time from one picture to the next [s]."""


class LiveView:
    """Show runs in a browser at the pace of the clock, or slower where the simulation is slower.

    Hand :meth:`on_step` to ``simulate(on_step=...)``. The view only reads: it makes the run wait, and nothing else.

    Attributes:
        url: where to look; it listens on this computer only.
    """

    def __init__(self, config: StationConfig, state: State | None = None) -> None:
        """Open the window, with the station that will be run in a state, or at its initial posture.

        Raises:
            InvalidModel: a robot that cannot be built.
        """
        self._meshcat = open_meshcat()
        self.url: str = self._meshcat.web_url()
        self._config: StationConfig | None = None
        self._next_frame = self._clock_at_zero = 0.0
        self._paths = 0
        self.draw(config, state)

    def draw(self, config: StationConfig, state: State | None = None) -> None:
        """Show a station in a state, outside of any run; its robots and pieces are loaded anew where they changed."""
        if config != self._config:
            self._scene: Scene | None = Scene(config, meshcat=self._meshcat)
            self._config = config
            points, azimuth = self._scene.extents(self._scene.initial[np.newaxis]), side(self._scene.station)
            look(self._meshcat, camera_on(points, aspect=ASPECT, azimuth=azimuth))
        if self._scene is not None:
            self._scene.draw(self._scene.initial if state is None else state.of_plant(self._scene.station)[0])
        self._last: tuple[float, Vector] | None = None

    def add_paths(self, result: RecordedRun) -> None:
        """Leave the ways of the tools in a run as lines."""
        draw_tool_paths(self._meshcat, result, self._paths)
        self._paths += 1

    def on_step(self, time: float, positions: Vector) -> None:
        """Show the motion since the last step, in even pictures between its straight-line ends.

        Args:
            time: at the step's end [s].
            positions: of the whole plant, shape (nq,).
        """
        if self._scene is None or not np.isfinite(positions).all():
            return
        if self._last is None or time < self._last[0]:
            self._next_frame, self._clock_at_zero = time, perf_counter() - time
        start, low = self._last if self._last is not None and self._last[0] < time else (time, positions)
        while self._next_frame <= time:
            part = (self._next_frame - start) / (time - start) if time > start else 1.0
            self._wait_for(self._next_frame)
            self._scene.draw(low + part * (positions - low), self._next_frame)
            self._next_frame += FRAME
        self._last = (time, positions.copy())

    def close(self) -> None:
        """Close the window and its port; what comes after is not shown."""
        self._scene = None
        del self._meshcat
        gc.collect()  # Drake's diagrams are cycles: without this Meshcat would go on listening for a while

    def _wait_for(self, time: float) -> None:
        """Sleep until the clock has come to a simulated time [s]; time that was lost is not made up for."""
        ahead = self._clock_at_zero + time - perf_counter()
        if ahead > 0:
            sleep(ahead)
        elif ahead < -FRAME:
            self._clock_at_zero -= ahead
