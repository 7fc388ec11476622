"""A session without a run, for the shell of the page: it notes what it is told to do, and says what a test lets it."""

from concurrent.futures import Future
from pathlib import Path
from types import SimpleNamespace

import numpy as np
from legs_session import be_all_parts, take
from pydrake.geometry import Role

from simrob_drake import load_station
from simrob_drake.extensions.pendant.pages.words import Notice
from simrob_drake.extensions.pendant.run import TaughtRun
from simrob_drake.results.animation.camera import WINDOW_ASPECT, camera_on, side
from simrob_drake.results.animation.drawn import commands, draw_geometry, look
from simrob_drake.results.animation.scene import ViewedStation

_KINDS = {"humanoid": "legs", "roid1": "legs", "irb120": "arm"}


def drawing(station):
    """What a run tells the view of a station at its start."""
    scene = ViewedStation(load_station(station))
    scene.place(scene.initial)
    prefixes = {"station": Role.kIllustration}
    camera = camera_on(
        scene.extents(scene.initial[np.newaxis]), aspect=WINDOW_ASPECT, azimuth=side(scene.station)
    )

    def draw(meshcat):
        draw_geometry(meshcat, scene.query(), prefixes)
        look(meshcat, camera)

    return commands(draw)


class Exports:
    """What is taken away of a session; a test says what comes of it."""

    def __init__(self, session):
        self.session = session


class StubSession:
    can_undo = can_redo = conflict = False

    def __init__(self, subject="humanoid", *, station=None, drawn=()):
        be_all_parts(self)
        self.exports = Exports(self)
        self.subject, self.robot, self.station = subject, subject, station or f"{subject}_dynamic"
        self.phase, self.pace, self.run, self.message = "opening", 1.0, TaughtRun(), Notice()
        self.description, self.settings, self.targets, self.pending, self.ghosts = (
            {},
            {},
            {},
            (),
            [],
        )
        self.file, self.folder = Path(), Path()
        self.inspected = []
        self.calls, self._hearers, self._lookers, self._drawn = [], [], [], drawn
        self.program, self.changes = SimpleNamespace(grid=0.05, moves=[]), ()
        self.closed = False

    def inspect(self, signals):
        self.inspected.extend(signals)
        self.told("inspected")

    def listen(self, callback):
        self._hearers.append(callback)
        return lambda: self._hearers.remove(callback) if callback in self._hearers else None

    def listen_to_view(self, callback):
        self._lookers.append(callback)
        if self._drawn:
            callback("scene", self._drawn)
        return lambda: self._lookers.remove(callback)

    def told(self, *topics, **news):
        """Let something change, and the listeners hear of it."""
        take(self, news)
        for topic in topics:
            for hearer in list(self._hearers):
                hearer(topic)

    def opened(self, bodies=()):
        robot = {"model": self.robot, "kind": _KINDS.get(self.robot, "other")}
        self.told(
            "description",
            "phase",
            phase="idle",
            description={"robots": {self.robot: robot}, "bodies": bodies},
        )

    def close(self):
        self.closed = True

    def watch(self, *_):
        """Keep no signals."""

    def torque_limits(self):
        """Tell no limits."""
        answer = Future()
        answer.set_result(None)
        return answer

    def __getattr__(self, name):
        if name.startswith("_"):
            raise AttributeError(name)
        return lambda *given, **named: self.calls.append((name, *given, *named.items()))


__all__ = ["Exports", "Notice", "StubSession", "drawing"]
