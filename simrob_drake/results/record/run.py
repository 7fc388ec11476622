"""What was recorded of a run: signals, how it ended and how fast it was, and what happened in it when."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal, NamedTuple, Self

import numpy as np
from pydrake.multibody.plant import ContactResults
from pydrake.systems.framework import Context

from simrob_drake.blocks.references import Reference, Samples
from simrob_drake.errors import one_of
from simrob_drake.frames import VELOCITY_NAMES, XYZ_QUATERNION_NAMES, Vector
from simrob_drake.parts.site import StationPlant, StationRobot, named
from simrob_drake.results.record.piece_contacts import ContactSample, sample_piece_contacts
from simrob_drake.results.record.state import State
from simrob_drake.results.record.touch import Event, Touch, onsets
from simrob_drake.signals import Panel, Signal
from simrob_drake.stations.config import StationConfig

Ending = Literal["completed", "monitor", "diverged", "interrupted", "failed"]
DIVERGED, INTERRUPTED, FAILED = "diverged", "interrupted", "failed"
"""What stands for a monitor's name where none ended the run; of a block that failed that is the block's name."""


class Approach(NamedTuple):
    """The smallest distance between bodies along a motion."""

    distance: float  # [m]; negative if they overlap, infinite if there are none
    bodies: str  # the two bodies, such as "pencil to table"; empty if there are none


class Approaches(NamedTuple):
    """The smallest distances of a robot, with what it carries, along a motion."""

    to_others: Approach  # to anything else
    to_itself: Approach  # of its bodies to each other


@dataclass(frozen=True, eq=False)
class AskedMove:
    """A move of an arm that a run was asked for, from the start of the run."""

    kind: str  # of move, such as ``move_l``; empty where no file can say it
    robot: str  # whose it is
    duration: float  # that it takes [s]
    end: Vector  # the posture that it leads to, shape (n,) [rad or m]
    tool: Callable[[Vector], Vector]  # gives the poses (k, 4, 4) of the tool in postures (k, n)
    # gives the smallest distances along positions (k, nq) of the plant
    approaches: Callable[[Vector], Approaches]
    speed: float | None = None  # that was asked of the tool [m/s]; None if none was
    place: str = "the move"  # what its program calls it, such as ``move 3``
    # ways of the tool that a search for it tried and the recording shows, shape (k, 2, 3) [m]
    search: Vector = field(default_factory=lambda: np.zeros((0, 2, 3)))


@dataclass(frozen=True)
class RecordedRun:
    """A run: its signals, how it ended and how fast it was.

    Attributes:
        config: the station as it was run.
        plant: the station's plant, for its robots' figures.
        ending: ``completed``, ``monitor``, ``diverged``, ``interrupted`` or ``failed``.
        stopped_by: the name of the monitor that ended the run, or of the block of the user's own that failed,
            "diverged", "interrupted" (by the user), or None.
        message: how the run ended, in words.
        names: the columns of ``values``.
        signals: what the columns are, as the parts of the station declare them.
        notes: of what kind sensors and controllers are, and how they were computed, by their names.
        times: of the samples, shape (m,) [s]; evenly spaced, with the end of the run last.
        values: the signals, shape (m, k), SI units and radians.
        step_times: ends of the accepted steps [s].
        positions_at: positions of the whole plant at any times of the run: (k,) to (k, nq); others are refused.
        stepping_time, signal_time: wall-clock seconds spent on each.
        solver_warnings: why servos and solver may have made the result wrong though the run went to its end, in words.
        final_state: where the station was at the end, for another run to begin there.
        start: where it began; None at the configuration's initial posture.
        contacts_at: Drake's contact results at any times of the run; None in a station without contact.
        context: gives a context of a diagram in which the plant stands with its shapes, to be put anywhere; None where
            it stands in none.
        shortened: how often the solver tried a step again, shorter; None where all steps are of one length.
        references: what was given to simulate() in place of the configuration's references, by robot.
        did: what was done in it, in a few words, such as ``move_l of left``.
        moves: of arms that it was asked for, all from its start.
        runs: of a program, the runs that follow each other in it; see :func:`simrob_drake.results.result.joined`.
        begun: of a program, the station in which it began; None of a single run.
        marks: of a program, when a run of it ended or a piece changed hands [s], and what that was in a few words.
        program: of a program, the YAML that does it again; empty where none can say it.
        commanded: the walks that somebody commanded meanwhile; their sections hold what was commanded.
    """

    config: StationConfig
    plant: StationPlant
    ending: Ending
    stopped_by: str | None
    message: str
    names: list[str]
    signals: tuple[Signal, ...]
    notes: dict[str, dict[str, str]]
    times: Vector
    values: Vector
    step_times: Vector
    positions_at: Callable[[Vector], Vector]
    stepping_time: float
    signal_time: float
    final_state: State
    start: State | None = None
    references: dict[str, Reference | Samples] = field(default_factory=dict)
    solver_warnings: list[str] = field(default_factory=list)
    contacts_at: Callable[[Vector], Iterator[ContactResults]] | None = None
    context: Callable[[], Context] | None = None
    shortened: int | None = None
    did: str = ""
    moves: tuple[AskedMove, ...] = ()
    runs: tuple[Self, ...] = ()
    begun: StationConfig | None = None
    marks: tuple[tuple[float, str], ...] = ()
    program: str = ""
    commanded: tuple[str, ...] = ()

    def __getitem__(self, name: str) -> Vector:
        """Return a signal by its column's name, such as ``q.joint_2``, shape (m,)."""
        return self.values[:, self._places[one_of("signal", name, self._places)]]

    def axes(self, signal: str, robot: str | None = None) -> Vector:
        """Return a signal of all axes of a robot, shape (m, n): ``q_ref``, ``q``, ``v`` or ``tau``.

        Args:
            signal: the column's name before the axis.
            robot: needed where the station has several.

        Raises:
            UnknownName: no such signal or robot.
            InvalidParameter: no robot named, and the station has not just one.
        """
        station_robot = self._robot(robot)
        return self._columns(f"{station_robot.prefix}{signal}", station_robot.axes)

    def pose(self, signal: str, robot: str | None = None) -> Vector:
        """Return a pose signal, ``base`` or ``tcp``, shape (m, 7): x y z qw qx qy qz; names as in :meth:`axes`."""
        station_robot = self._robot(robot)
        return self._columns(f"{station_robot.prefix}{signal}", XYZ_QUATERNION_NAMES)

    def piece_pose(self, piece: str) -> Vector:
        """Return where a free piece was, shape (m, 7): x y z qw qx qy qz."""
        return self._columns(f"piece.{piece}", XYZ_QUATERNION_NAMES)

    def piece_velocity(self, piece: str) -> Vector:
        """Return how a free piece moved, shape (m, 6): vx vy vz [m/s] wx wy wz [rad/s], in the world's axes."""
        return self._columns(f"piece.{piece}", VELOCITY_NAMES)

    def vector(self, signal: str) -> Vector:
        """Return a signal of three columns, such as ``force.<sensor>``, shape (m, 3)."""
        return self._columns(signal, "xyz")

    @cached_property
    def touch(self) -> Touch:
        """What touched what, at samples of the run."""
        return Touch.of(self.config, self.plant, self.times, self.positions_at, self.context)

    @cached_property
    def piece_contacts(self) -> dict[str, list[ContactSample]]:
        """Contacts of each free piece at some samples, by the name of the piece.

        Empty if the station has no contact, or no free pieces.
        """
        if self.contacts_at is None or not self.plant.free_pieces:
            return {}
        return sample_piece_contacts(self.plant, self.times, self.contacts_at)

    @cached_property
    def onsets(self) -> list[Event]:
        """When bodies began to touch that were apart, in words."""
        return [] if self.contacts_at is None else list(onsets(self.plant, self.step_times, self.contacts_at))

    @property
    def units(self) -> dict[str, str]:
        """The units of the columns, by their names."""
        known = {name: unit for signal in self.signals for name, unit in zip(signal.names, signal.units, strict=True)}
        return {name: known[name] for name in self.names}

    @property
    def panels(self) -> list[Panel]:
        """The plots that parts declare, of columns that there are."""
        declared = [signal.panel for signal in self.signals if signal.panel is not None]
        return [panel for panel in declared if set(panel.columns) <= set(self.names)]

    @property
    def cells(self) -> dict[str, list[float | None]]:
        """When each cell of every sequencer was reached, since it began [s], by the controller; None: not reached."""
        found = {}
        for name, section in self.config.controllers.items():
            block = self.final_state.blocks.get(f"controller.{name}")
            if section.kind == "sequencer" and block is not None:
                times = block.discrete[-1][-len(section.cells) :].tolist()
                found[name] = [round(time, 9) if time >= 0 else None for time in times]
        return found

    def numbered(self, number: int) -> Self:
        """Return the run as that of a move of a program, counted from 0."""
        return replace(self, moves=tuple(replace(move, place=f"move {number}") for move in self.moves))

    @property
    def parts(self) -> tuple[Self, ...]:
        """The runs of a program, in order; a single run itself."""
        return self.runs or (self,)

    @property
    def stop_time(self) -> float:
        """When the run ended, in simulated time [s]."""
        return float(self.times[-1])

    @property
    def end_in_words(self) -> str:
        """How the run ended, and which monitor ended it."""
        return f"stopped by {self.stopped_by}: {self.message}" if self.ending == "monitor" else self.message

    @property
    def wall_time(self) -> float:
        """Wall-clock seconds of stepping and signals."""
        return self.stepping_time + self.signal_time

    @property
    def pace(self) -> str:
        """How fast it was stepped, and in how many steps, in words."""
        rate, steps = self.realtime_rate, f"{len(self.step_times) - 1} steps"
        if not rate:
            return steps  # it ended where it began
        digits = max(1 - int(np.floor(np.log10(rate))), 0)
        return f"{rate:.{digits}f} × real time, {steps}"

    @property
    def realtime_rate(self) -> float:
        """Simulated over wall-clock time of stepping and signals."""
        return self.stop_time / self.wall_time if self.wall_time > 0 else 0.0

    @cached_property
    def _places(self) -> dict[str, int]:
        return {name: place for place, name in enumerate(self.names)}

    def _columns(self, signal: str, parts: Iterable[str]) -> Vector:
        """Return columns of a signal, shape (m, k)."""
        names, known = [f"{signal}.{part}" for part in parts], self._places
        places = [known[name] if name in known else known[one_of("signal", name, known)] for name in names]
        return np.take(self.values, places, axis=1)

    def _robot(self, name: str | None) -> StationRobot:
        return self.plant.robots[named(name, list(self.plant.robots))]


def begins_of(*runs: RecordedRun) -> Vector:
    """Return when runs that follow each other begin, and when the last one ends [s], shape (k + 1,)."""
    return np.cumsum([0.0, *(run.stop_time for run in runs)])


def fallen(result: RecordedRun) -> str | None:
    """Return the robot whose fall ended a run, as its monitor saw; None if none did."""
    from simrob_drake.parts.monitors.sections import Fall  # as all kinds, where one is named

    monitor = result.config.monitors.get(result.stopped_by or "")
    return monitor.faller(result.config.only_robot) if isinstance(monitor, Fall) else None


_TOGETHER = 0.01  # part of the whole time in which two events are one
_MOST = 24  # of those that a picture has room for


def all_events(result: RecordedRun) -> list[Event]:
    """Return what happens in a run: its start, contacts that begin and its end; in a program, what is between, too.

    That is the ends of its runs, and what is attached and let go after them.
    """
    found = [(0.0, "start"), *result.marks]
    for begin, run in zip(begins_of(*result.parts), result.parts, strict=False):
        found += [(float(begin + time), text) for time, text in run.onsets]
    stopped = f"stopped: {result.stopped_by}" if result.ending == "monitor" else "end"
    return [*sorted(found, key=lambda event: event[0]), (result.stop_time, stopped)]


def events_of(result: RecordedRun) -> list[Event]:
    """Return the events of :func:`all_events` that pictures can show apart, two dozen at most."""
    everything, end, together = all_events(result), result.stop_time, _TOGETHER
    while len(events := _apart(everything, together * end)) > _MOST:
        together *= 1.5
    return events


def _apart(everything: list[Event], gap: float) -> list[Event]:
    """Return the first of the events within each gap [s], but rather a hand-over, as "rook to gripper", and the end."""
    events: list[Event] = []
    for time, text in everything:
        if not events or time - events[-1][0] > gap:
            events.append((time, text))
        elif time == everything[-1][0] or (" to " in text and len(events) > 1):
            events[-1] = (time, text)
    return events
