"""Records of runs: signals, how a run ended, how fast it was stepped, and the events in it.

A *run* is one simulation of a station. A *program* is a sequence of runs that follow each other; it is recorded as one
run, whose parts are the runs. Signals are recorded as named *columns*, such as ``q.joint_2``, at m *samples* in time.
An `Event` is something that happened at a time, such as the begin of a contact.
"""

import pickle
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from operator import attrgetter
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, Self, TypeAlias
from zlib import compress, decompress

import numpy as np
from pydrake.multibody.plant import ContactResults
from pydrake.systems.framework import Context

from simrob_drake.base.errors import nearest_name, one_of
from simrob_drake.base.frames import VELOCITY_NAMES, XYZ_QUATERNION_NAMES, Vector
from simrob_drake.base.messages import Message, compound, message
from simrob_drake.base.renaming import keep_former_attributes
from simrob_drake.base.signals import Panel, Signal
from simrob_drake.blocks.references import Reference, Samples
from simrob_drake.parts.resolved import name_or_only
from simrob_drake.parts.station_plant import StationPlant, StationRobot
from simrob_drake.results.record.disturbances import LONGEST_FALL, last_disturbance
from simrob_drake.results.record.piece_contacts import ContactSample, sample_piece_contacts
from simrob_drake.results.record.rebuilt import (
    FORMAT,
    REBUILT,
    RebuiltRun,
    check_format,
    pickled_fields,
)
from simrob_drake.results.record.state import State, Trace
from simrob_drake.results.record.touch import Event, Touch, evaluate_touch, onsets
from simrob_drake.stations.config import StationConfig

Ending = Literal["completed", "monitor", "diverged", "interrupted", "failed"]
"""How a run ended: at its full duration, by a monitor, by divergence, by the user, or because a block failed."""

ContactsAt: TypeAlias = Callable[[Vector], Iterator[ContactResults]]
"""Function that yields Drake's contact results at times (k,) [s] of a run."""

_CONTEXT_OF_PLANT = "_context_of_plant"
"""Attribute of a pickled run, see `RebuiltRun.context_of_plant`."""

# Values of Ending that are compared in several modules.
DIVERGED = "diverged"
INTERRUPTED = "interrupted"
FAILED = "failed"


class Approach(NamedTuple):
    """The smallest distance between two bodies along a motion.

    Attributes:
        distance: the distance [m]. It is negative if the bodies overlap, and infinite if there was no pair of bodies to
            measure.
        bodies: names of the two bodies, such as "pencil to table"; empty if there was no pair.
    """

    distance: float
    bodies: str


class Approaches(NamedTuple):
    """The smallest distances of a robot, with what it carries, along a motion.

    Attributes:
        to_others: distance to any other body.
        to_itself: distance between two bodies of the robot.
    """

    to_others: Approach
    to_itself: Approach


@dataclass(frozen=True, eq=False)
class AskedMove:
    """A planned move of an arm, which begins at the start of a run.

    Attributes:
        kind: kind of the move, such as ``move_l``. It is empty if the move cannot be written in a program's file.
        robot: name of the robot that moves.
        duration: planned duration [s].
        end: planned final posture, shape (n,) [rad or m].
        tool: computes the poses of the tool, shape (k, 4, 4), in postures (k, n).
        approaches: computes the smallest distances along positions of the plant (k, nq) at times (k,) [s].
        speed: planned speed of the tool [m/s]; None if none was asked for.
        place: name of the move in its program, such as ``move 3``.
        search: segments of the paths that a search for the move tried, shape (k, 2, 3) [m]. Recordings show them.
        verdict: the verdict about the move, if its run was pickled: ``tool`` and ``approaches`` are lost then.
    """

    kind: str
    robot: str
    duration: float
    end: Vector
    tool: Callable[[Vector], Vector]
    approaches: Callable[[Vector, Vector], Approaches]
    speed: float | None = None
    place: str = message("results.the_move", "the move")
    search: Vector = field(default_factory=lambda: np.zeros((0, 2, 3)))
    verdict: Any = None

    def __getstate__(self) -> dict[str, Any]:
        """Content of a pickled move, without its functions, which need a plant."""
        return {**self.__dict__, "tool": None, "approaches": None}


@dataclass(frozen=True)
class MoveSpan:
    """The time that a move of a program took.

    Attributes:
        index: index of the move in its program, from 0.
        begin: when the move began, since the start of the program [s].
        end: when the move ended, or was ended by a monitor or the user, since the start of the program [s].
        is_named: whether messages name the move by its number. It is False if no moves are stored, and the program only
            plays the station's references.
    """

    index: int
    begin: float
    end: float
    is_named: bool = True


_USUAL_NAMES = {
    "columns": "names",
    "data": "values",
    "signal_names": "names",
    "t": "times",
    "time": "times",
}
"""Names that other packages give to attributes of a result, and the names of these here."""


def _no_attribute(kind: type[Any], name: str) -> str:
    """Text of an AttributeError of a result, which proposes the nearest attribute.

    Args:
        kind: class of the result.
        name: the attribute that it does not have.
    """
    # Fields without a default are no attributes of the class, so that dir() does not list them.
    attributes = {*dir(kind), *(own.name for own in fields(kind))}
    public = {attribute for attribute in attributes if not attribute.startswith("_")}
    # Names that pandas and other packages use come first: a search would find no attribute for them, or a wrong one.
    close = _USUAL_NAMES.get(name) or nearest_name(name, public)
    if close is None or name.startswith("_"):
        return message("results.no_attribute", "a result has no attribute '{name}'", name=name)
    return message(
        "results.no_attribute_but",
        "a result has no attribute '{name}'; did you mean '{close}'?",
        name=name,
        close=close,
    )


@dataclass(frozen=True)
class RecordedRun:
    """A run: its signals, how it ended and how fast it was.

    Attributes:
        config: configuration of the station in this run.
        plant: the station's plant with its robots.
        ending: how the run ended.
        stopped_by: name of the monitor that ended the run, or of the block or function that failed; "diverged" or
            "interrupted" (by the user) if that ended the run; None if the run was completed.
        message: how the run ended, in words.
        names: names of the columns of ``values``.
        signals: declarations of the columns by the parts of the station: units, plots.
        notes: kind of each sensor and controller, and how it was computed, by its name.
        times: times of the samples, shape (m,) [s]: the start of the run, evenly spaced times, and the end of the run.
        values: the signals, shape (m, k), in SI units and radians.
        step_times: start of the run, and the ends of the accepted steps of the solver [s].
        positions_at: computes positions of the whole plant (k, nq) at times (k,) [s] within the run.
        stepping_time: wall-clock time that stepping took [s].
        signal_time: wall-clock time that evaluating the signals took [s].
        solver_warnings: reasons why the result may be wrong although the run was completed, in words.
        final_state: state of the station at the end, from which another run can begin.
        start: state at the start; None if the run began in the configuration's initial posture.
        contacts_at: yields Drake's contact results at times (k,) [s] of the run; None if the station has no contact
            forces, as a kinematic one, for a program of several runs or with handed-over pieces, and if the engine of
            an extension has not recorded them.
        context: returns a new context of the diagram at the end of the run, with its time and state, which may be
            changed. In a diagram of the user's own it contains the logs of log sinks. It is None in results that an
            earlier version has pickled, if the station is kinematic.
        shortened: how often the solver tried a step again with a shorter length; None if all steps have one length.
        references: references that were passed to simulate(), by robot; they replace those of the configuration.
        did: what the run did, in a few words, such as ``move_l of left``.
        place: name of the run's move in its program, such as ``move 3``; empty outside of programs.
        moves: planned moves of arms, all of which begin at the start of the run.
        runs: for a program, the runs that follow each other; see :func:`simrob_drake.results.result.join_runs`.
        begun: for a program, the station in which it began; None for a single run.
        marks: for a program, events at which one of its runs ended or a piece was handed over.
        move_spans: for a program, when each of its moves began and ended, in order. Several moves of joints can be one
            run, so this is the only record of when each of them began. Moves that were not begun are left out.
        program: for a program, the YAML text that repeats it; empty if it cannot be written as YAML.
        commanded: names of walks that the user commanded during the run; their sections contain the commands.
        wandering: for a program, names of the handed-over pieces, which hang on different things in its runs.
        trace: recorded states, from which the run can be continued; None for a program, and for other engines.
        in_own_diagram: whether the station was part of a diagram of the user's own.
        is_continued: whether a change of the station cut the motion at the end of the run, so that the next run of the
            program continues it.
        continues: whether the run continues a motion that a change of the station cut.
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
    # Fields that a pickled run makes again need factories: a plain default would be an attribute of the class, which
    # Python finds before it calls __getattr__.
    contacts_at: ContactsAt | None = field(default_factory=lambda: None)
    context: Callable[[], Context] | None = field(default_factory=lambda: None)
    shortened: int | None = None
    did: str = ""
    place: str = ""
    moves: tuple[AskedMove, ...] = ()
    runs: tuple[Self, ...] = ()
    begun: StationConfig | None = None
    marks: tuple[Event, ...] = ()
    move_spans: tuple[MoveSpan, ...] = ()
    program: str = ""
    commanded: tuple[str, ...] = ()
    wandering: tuple[str, ...] = ()
    trace: Trace | None = None
    in_own_diagram: bool = False
    is_continued: bool = False
    continues: bool = False

    def __getstate__(self) -> dict[str, Any]:
        """Content of a pickled run: its fields, but for the plant and what is computed from it."""
        # Compressed at the fastest level, states take less than two thirds of the memory.
        return {
            "format": FORMAT,
            "content": compress(pickle.dumps(self._pickled_content()), level=1),
        }

    def _pickled_content(self) -> dict[str, Any]:
        """Fields of the pickled run, by name."""
        return pickled_fields(self)

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore a pickled run.

        Raises:
            SimrobError: another version of the package has pickled the run.
        """
        check_format(state.get("format"))
        content = pickle.loads(decompress(state["content"]))
        # A frozen dataclass refuses assignments, but not changes of its dict.
        self.__dict__["_pickled"] = {
            key: content.pop(key) for key in ("has_contacts", "has_context", "motion")
        }
        self.__dict__.update(content)

    if not TYPE_CHECKING:  # all fields are declared

        def __getattr__(self, name: str) -> Any:
            """Make the fields that were not pickled again, when one of them is first used.

            Python calls this method for attributes that it does not find.

            Raises:
                AttributeError: a result has no attribute of this name; proposes the nearest one.
            """
            if name not in REBUILT or "_pickled" not in self.__dict__:
                raise AttributeError(_no_attribute(type(self), name), name=name, obj=self)
            self.__dict__.update(self._rebuilt_fields())
            return self.__dict__[name]

    def _rebuilt_fields(self) -> dict[str, Any]:
        """Fields of a pickled run that are computed from its plant, by name."""
        pickled = self.__dict__["_pickled"]
        rebuilt = RebuiltRun(self, has_contacts=pickled["has_contacts"], motion=pickled["motion"])
        return {
            "plant": rebuilt.plant,
            "positions_at": rebuilt.positions_at,
            "contacts_at": rebuilt.contacts_at,
            "context": rebuilt.context if pickled["has_context"] else None,
            _CONTEXT_OF_PLANT: rebuilt.context_of_plant if pickled["has_context"] else None,
        }

    def __getitem__(self, name: str) -> Vector:
        """Signal by the name of its column, such as ``q.joint_2``, shape (m,).

        Raises:
            UnknownName: there is no such column.
        """
        known_name = one_of(message("results.signal", "signal"), name, self._indices)
        return self.values[:, self._indices[known_name]]

    def __iter__(self) -> Iterator[str]:
        """Iterate over the names of the columns."""
        return iter(self.names)

    def __contains__(self, name: object) -> bool:
        """Whether there is a column of this name."""
        return name in self._indices

    def keys(self) -> list[str]:
        """Names of the columns, so that ``dict(result)`` has all signals by name."""
        return list(self.names)

    def axes(self, signal: str, robot: str | None = None) -> Vector:
        """Signal of all axes of a robot, shape (m, n).

        Args:
            signal: ``q_ref`` (desired position), ``q`` (position), ``v`` (velocity) or ``tau`` (torque or force).
            robot: name of the robot; may be None if the station has only one.

        Raises:
            UnknownName: there is no such signal or robot.
            InvalidParameter: the robot is None, and the station has several.
        """
        station_robot = self._robot(robot)
        return self._columns(f"{station_robot.prefix}{signal}", station_robot.axes)

    def pose(self, signal: str, robot: str | None = None) -> Vector:
        """Pose signal ``base`` (root link) or ``tcp`` (tool) of a robot, shape (m, 7): x y z [m] qw qx qy qz.

        Poses are in the world.

        Args:
            signal: ``base`` or ``tcp``.
            robot: name of the robot; may be None if the station has only one.

        Raises:
            UnknownName: there is no such robot, or it has no such signal, as a robot without a tool.
            InvalidParameter: the robot is None, and the station has several.
        """
        station_robot = self._robot(robot)
        return self._columns(f"{station_robot.prefix}{signal}", XYZ_QUATERNION_NAMES)

    def piece_pose(self, piece: str) -> Vector:
        """Pose of a free piece in the world, shape (m, 7): x y z [m] qw qx qy qz."""
        return self._columns(f"piece.{piece}", XYZ_QUATERNION_NAMES)

    def piece_velocity(self, piece: str) -> Vector:
        """Velocity of a free piece, shape (m, 6): vx vy vz [m/s] wx wy wz [rad/s], in the world's axes."""
        return self._columns(f"piece.{piece}", VELOCITY_NAMES)

    def vector(self, signal: str) -> Vector:
        """Signal with the three columns x, y and z, such as ``force.<sensor>``, shape (m, 3)."""
        return self._columns(signal, "xyz")

    @cached_property
    def touch(self) -> Touch:
        """Overlaps of bodies and slips of feet, evaluated at some times of the run."""
        # A pickled run has another plant, so that the context must be one of its diagram.
        plant = self.plant
        context_of = self.__dict__.get(_CONTEXT_OF_PLANT, self.context)
        return evaluate_touch(self.config, plant, self.times, self.positions_at, context_of)

    @cached_property
    def piece_contacts(self) -> dict[str, list[ContactSample]]:
        """Contacts of each free piece, by its name, at the samples chosen by `sample_piece_contacts`.

        Empty if the run has no contact results, see `contacts_at`, or if the station has no free pieces.
        """
        if self.contacts_at is None or not self.plant.free_pieces:
            return {}
        return sample_piece_contacts(self.plant, self.times, self.contacts_at)

    @cached_property
    def onsets(self) -> list[Event]:
        """Events at which two bodies began to touch; empty if the run has no contact results, see `contacts_at`."""
        if self.contacts_at is None:
            return []
        return list(onsets(self.plant, self.step_times, self.contacts_at))

    @property
    def units(self) -> dict[str, str]:
        """Units of the columns, by the name of the column."""
        # In the order of the columns, whatever the order of the declarations.
        known = dict[str, str]()
        for signal in self.signals:
            known.update(zip(signal.names, signal.units, strict=True))
        return {name: known[name] for name in self.names}

    @property
    def panels(self) -> list[Panel]:
        """Plots that the parts of the station declare. Plots with a column that was not recorded are left out."""
        declared = [signal.panel for signal in self.signals if signal.panel is not None]
        return [panel for panel in declared if set(panel.columns) <= set(self.names)]

    @property
    def cells(self) -> dict[str, list[float | None]]:
        """Times at which the cells of each sequencer were reached, since its start [s], by the name of the sequencer.

        A *sequencer* is a controller that goes through a list of cells (states). The time is None if the cell was not
        reached.
        """
        found = {}
        for name, section in self.config.controllers.items():
            # The times are kept in the block's discrete state, so that a continued run keeps them. Controllers that
            # are no sequencers have no such times: None.
            block = self.final_state.blocks.get(f"controller.{name}")
            times = None if block is None else section.cell_times(block.discrete)
            if times is not None:
                found[name] = times
        return found

    def with_move_number(self, index: int) -> Self:
        """Copy the run, with its moves named by their number in a program.

        Args:
            index: index of the move in the program, from 0. Its name counts from 1, see :func:`move_title`.
        """
        return self.at_place(move_title(index))

    def at_place(self, place: str) -> Self:
        """Copy the run, with another name for the run's move, and for all of its `moves`.

        Args:
            place: name of the move in its program, such as ``move 3``.
        """
        # Warnings about a move contain its name, so the moves get the name as well.
        moves = tuple(replace(move, place=place) for move in self.moves)
        return replace(self, place=place, moves=moves)

    @property
    def parts(self) -> tuple[Self, ...]:
        """Runs of a program, in order; for a single run, the run itself."""
        return self.runs or (self,)

    @property
    def stop_time(self) -> float:
        """End of the run, in simulated time [s]."""
        return float(self.times[-1])

    @property
    def start_time(self) -> float:
        """Start of the run, in simulated time [s]: zero, unless the run continues another one."""
        return float(self.times[0])

    @property
    def simulated_time(self) -> float:
        """Length of the run: from its start to its end, in simulated time [s]."""
        return self.stop_time - self.start_time

    @property
    def end_in_words(self) -> str:
        """End of the run in words.

        For a run that a monitor ended, it is the monitor with its reason. For a fall of a robot it is the reason, and
        the last push or pull if that began at most 5 s before. For other runs it is their `message`.
        """
        if self.ending != "monitor":
            return self.message
        if robot_that_fell(self) is None:
            return message(
                "results.stopped_by",
                "stopped by {monitor}: {reason}",
                monitor=self.stopped_by,
                reason=self.message,
            )
        # The reason contains already that the robot fell. The name of the monitor, mostly "fall", would repeat it.
        end = message("results.stopped_by_fall", "stopped because {reason}", reason=self.message)
        cause = last_disturbance(self)
        # A push long before the fall is most likely not its cause.
        if cause is None or self.stop_time - cause.begin > LONGEST_FALL:
            return end
        return message(
            "results.end_after_disturbance",
            "{end}, {time:.2f} s after {cause}",
            end=end,
            time=self.stop_time - cause.begin,
            cause=cause.text,
        )

    @property
    def wall_time(self) -> float:
        """Wall-clock time of stepping and evaluating signals [s]."""
        return self.stepping_time + self.signal_time

    @property
    def speed_in_words(self) -> str:
        """Speed of the run as a multiple of real time, and its count of steps, in words.

        The speed is left out if it is 0, as in a run that ended at its start.
        """
        rate = self.realtime_rate
        steps = message(
            "results.steps", "{count} {count:step|steps}", count=len(self.step_times) - 1
        )
        if not rate:
            return steps  # the run ended at its start
        # Two significant digits: the decimals that a rate of this size needs.
        decimals = max(1 - int(np.floor(np.log10(rate))), 0)
        shown_rate = compound(f"{{rate:.{decimals}f}}", rate=rate)
        return message("results.pace", "{rate} × real time, {steps}", rate=shown_rate, steps=steps)

    @property
    def realtime_rate(self) -> float:
        """Simulated time divided by wall-clock time; 0 if no wall-clock time was measured."""
        return self.simulated_time / self.wall_time if self.wall_time > 0 else 0.0

    @cached_property
    def _indices(self) -> dict[str, int]:
        """Index of each column, by its name."""
        return {name: index for index, name in enumerate(self.names)}

    def _columns(self, signal: str, parts: Iterable[str]) -> Vector:
        """Columns of a signal, shape (m, k): one for each part, such as an axis, with the name ``<signal>.<part>``.

        Raises:
            UnknownName: there is no such column.
        """
        known = self._indices
        # The search for the nearest name is slow, so it is done for unknown names only.
        indices = []
        for part in parts:
            name = f"{signal}.{part}"
            if name not in known:
                # raises UnknownName, with the nearest name
                one_of(message("results.signal", "signal"), name, known)
            indices.append(known[name])
        return np.take(self.values, indices, axis=1)

    def _robot(self, name: str | None) -> StationRobot:
        """Robot by its name, or the only robot if the name is None.

        Raises:
            UnknownName: there is no such robot.
            InvalidParameter: the name is None, and the station has not exactly one robot.
        """
        return self.plant.robots[name_or_only(name, list(self.plant.robots))]


keep_former_attributes(RecordedRun, pace="speed_in_words", numbered="with_move_number")


def move_title(index: int) -> Message:
    """Name of a move of a program for users, such as "move 3". It counts from 1; files and the API count from 0.

    Args:
        index: index of the move in the program, from 0.
    """
    return message("results.move_number", "move {number}", number=index + 1)


def stop_message(reason: str, time: float) -> Message:
    """Describe the stop by a monitor in words.

    Args:
        reason: the monitor's reason.
        time: time of the stop [s].
    """
    return message("results.stop_at", "{reason}, at {time:.4g} s", reason=reason, time=time)


def at_time_of_program(stop: str, begin: float) -> str:
    """Change the time in a message of :func:`stop_message` from that of a run to that of its program.

    Args:
        stop: the message. Any other text stays as it is.
        begin: time of the program at the run's time zero [s].
    """
    # A message keeps its fields, so that it can be written again with another time.
    if not isinstance(stop, Message) or stop.id != "results.stop_at":
        return stop
    return stop_message(stop.fields["reason"], begin + stop.fields["time"])


def begins_of(*runs: RecordedRun) -> Vector:
    """Times at which k runs that follow each other begin, and the end of the last run, shape (k + 1,) [s].

    Times count from the begin of the first run.
    """
    return np.cumsum([0.0, *(run.simulated_time for run in runs)])


def robot_that_fell(result: RecordedRun) -> str | None:
    """Name of the robot whose fall ended a run.

    Returns None if no monitor of the kind `fall` ended the run, or if this monitor watches a piece.
    """
    # Imported here: the kinds of monitors are loaded only if they are needed.
    from simrob_drake.parts.monitors.sections import Fall

    # `stopped_by` names a monitor or a user's block, or it is None. Only a monitor of the kind `fall` counts.
    monitor = result.config.monitors.get(result.stopped_by or "")
    return monitor.faller(result.config.only_robot) if isinstance(monitor, Fall) else None


_LEAST_GAP = 0.01
"""Events that are closer together than this are shown as one, as a share of the run's duration."""

_GAP_GROWTH = 1.5
"""Factor by which the gap grows until few enough events are left."""

_MOST_EVENTS = 24
"""Count of events for which a picture has space."""


def all_events(result: RecordedRun) -> list[Event]:
    """Events of a run, in order: its start, contacts that begin, and its end.

    In a program, the ends of its runs and the pieces that are attached and released between them are events, too.
    """
    start = Event(result.start_time, "start")
    contacts = []
    # Begins of the runs in the time of the program, of which a single run is the only one. The last entry is the end of
    # the last run.
    begins = begins_of(*result.parts)[:-1]
    for begin, run in zip(begins.tolist(), result.parts, strict=True):
        # Each run has its own times, which are shifted to those of the program. A single run keeps its own.
        shift = begin - run.start_time if result.runs else 0.0
        contacts += [Event(onset.time + shift, onset.text) for onset in run.onsets]
    # Sorting is stable: of events at the same time, marks come before contacts.
    events = sorted([start, *result.marks, *contacts], key=attrgetter("time"))
    end = f"stopped: {result.stopped_by}" if result.ending == "monitor" else "end"
    return [*events, Event(result.stop_time, end)]


def events_of(result: RecordedRun) -> list[Event]:
    """Select the most important events of :func:`all_events`, at most 24, far enough apart for a picture."""
    # The smallest time between two events grows until few enough are left: events are not spread evenly.
    everything = all_events(result)
    share = _LEAST_GAP
    events = _events_apart(everything, share * result.simulated_time)
    while len(events) > _MOST_EVENTS:
        share *= _GAP_GROWTH
        events = _events_apart(everything, share * result.simulated_time)
    return events


def _events_apart(everything: list[Event], gap: float) -> list[Event]:
    """Select events that are more than a gap [s] apart.

    Of events that are closer together the first is kept, unless a later one is more important: a piece that is handed
    over, such as "rook to gripper", or the end of the run.

    Args:
        everything: the events, in order; the end of the run is the last one.
        gap: smallest time between two events [s].
    """
    end = everything[-1].time
    events: list[Event] = []
    for event in everything:
        is_far_enough = not events or event.time - events[-1].time > gap
        is_end = event.time == end
        # A piece that is handed over has a text such as "rook to gripper". Texts of contacts have "touches" instead,
        # and those of moves "ends".
        is_hand_over = " to " in event.text
        # The start of the run is the first event. It stays, even if a piece is handed over right after it.
        may_replace = len(events) > 1
        if is_far_enough:
            events.append(event)
        elif is_end or (is_hand_over and may_replace):
            events[-1] = event
    return events
