"""What a page can do: teach a program, run it, change it while it runs, and take it away. It knows no page."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future
from pathlib import Path
from typing import Any, Literal, Self

from simrob_drake.programs.program import Program
from simrob_drake.teach.notices import Notice

Topic = Literal["program", "phase", "tick", "message", "description", "history"]


class Session:
    """One robot or station being taught; tabs share it. All calls come from one thread, and none waits.

    Nothing raises because of what a user does: what is wrong becomes :attr:`message`. Methods that need the run give a
    :class:`concurrent.futures.Future` (``await asyncio.wrap_future(...)``; its result is None where something was
    wrong, and it never raises, so that it can be ignored); the others tell by True or False whether it was done.

    Every change of the program is in :attr:`file` when the method returns.

    Attributes:
        subject: what was opened, as given.
        folder: of the program's file and of what is taken away.
        file: of the program.
        station: name or file of the station.
        robot: the robot that is taught, of :attr:`description`'s robots.
        description: of the station, as ``Live.open`` gives it; empty until it is there.
        program: what is stored.
        pending: moves that were tested and not added yet, as a program's file has them.
        phase: ``opening``, ``idle``, ``running`` or ``paused``.
        time: where the run is [s], and ``ratio``: simulated time over the clock's.
        pace: asked for; None: as fast as it can.
        message: the last thing to tell; ``str(message)`` is English, ``message.key`` tells pages which.
        values: last value of each watched signal.
        history: of each watched signal its last values, as ``(time, value)`` in a ring; ``session.history[name]``.
        settings: what is changed of the station, by dotted key.
        targets: taught targets of an arm by name, each ``{axes: [...], pose: [...], tool: ...}``.
        ghosts: the branches that :meth:`branches` found last.
    """

    def __init__(self) -> None:
        """Make one by :meth:`open`."""
        self.subject, self.folder, self.file, self.station, self.robot = "", Path(), Path(), "", ""
        self.description: dict[str, Any] = {}
        self.program = Program()
        self.pending: tuple[dict[str, Any], ...] = ()
        self.phase, self.time, self.ratio = "opening", 0.0, 0.0
        self.pace: float | None = 1.0
        self.message = Notice()
        self.values: dict[str, Any] = {}
        self.history: dict[str, Any] = {}
        self.settings: dict[str, Any] = {}
        self.targets: dict[str, dict[str, Any]] = {}
        self.ghosts: list[dict[str, Any]] = []

    @classmethod
    def open(
        cls,
        subject: str | Path,
        folder: str | Path,
        *,
        program: str | Path | None = None,
        live: Callable[[Callable[[dict[str, Any]], None]], Any] | None = None,
        hand_over: Callable[[Callable[[], None]], object] | None = None,
    ) -> Self:
        """Open a robot, a station or a file; returns at once, and ``description`` comes with the topic of its name.

        Args:
            subject: a robot's or a station's name, or the file of a URDF or a station.
            folder: for the program and what is taken away; made where it is missing.
            program: a file to begin with; that of the folder unless given.
            live: makes the run from what takes its news; :class:`~simrob_drake.teach.live.Live` unless given.
            hand_over: calls a function in the thread of all other calls, as ``loop.call_soon_threadsafe`` does. Without
                it news wait for :meth:`hear`.

        Raises:
            SimrobError: no such robot, station or file.
        """
        return cls()

    def hear(self, timeout: float = 0.0) -> None:
        """Take the news that have come, waiting for the first so long [s]: for scripts, which hand nothing over."""

    def close(self) -> None:
        """End the run and its process."""

    def listen(self, callback: Callable[[Topic], None]) -> Callable[[], None]:
        """Let something be called after each change with what changed; returns what ends that.

        ``program``: program, pending, undo, targets; ``description``: description and settings.
        """
        return lambda: None

    def listen_to_view(self, callback: Callable[[dict[str, Any]], None]) -> Callable[[], None]:
        """Let something have each news ``view`` ``{subject, commands}``; returns what ends that."""
        return lambda: None

    def wrong_target(self, axis: str, value: Any) -> str:
        """Return what is wrong with a target [deg or m] of an axis, for its field; empty if nothing is."""
        return ""

    # Teach

    @property
    def can_undo(self) -> bool:
        """Whether :meth:`undo` has something to take back."""
        return False

    @property
    def can_redo(self) -> bool:
        """Whether :meth:`redo` has something to bring back."""
        return False

    def undo(self) -> bool:
        """Take back the last change of program, tested moves, targets or settings."""
        return False

    def redo(self) -> bool:
        """Bring back what :meth:`undo` took."""
        return False

    def test(self, targets_deg: Mapping[str, float], duration: float | None = None) -> Future[Any]:
        """Try a move of axes [deg or m], together with those tested before it since the last :meth:`add`.

        All go together, in the same time [s], from where the robot was before the first; that of the last test unless
        given. Nothing is stored.
        """
        return _nothing()

    def add(self) -> bool:
        """Store what was tested."""
        return False

    def discard(self) -> Future[Any]:
        """Forget what was tested, and go back to before it."""
        return _nothing()

    def simulate(self) -> Future[Any]:
        """Run all that is stored from the start; what was tested and not added is forgotten."""
        return _nothing()

    def reset(self) -> Future[Any]:
        """Erase the program and go back to the start; :meth:`undo` brings it back."""
        return _nothing()

    def step(self) -> Future[Any]:
        """Try one step (Paso): it waits for :meth:`add` or :meth:`discard`, as a tested move."""
        return _nothing()

    def walk(self, steps: int, amplitude: float = 1.0, gait: str | None = None, **changes: Any) -> Future[Any]:
        """Try to walk, likewise."""
        return _nothing()

    def act(self, name: str, **changes: Any) -> Future[Any]:
        """Try an act, likewise."""
        return _nothing()

    def wait(self, seconds: float) -> Future[Any]:
        """Try to stand still, likewise."""
        return _nothing()

    def attach(
        self, piece: str, tool: str | None = None, *, pose: Sequence[float] | None = None, robot: str | None = None
    ) -> Future[Any]:
        """Take a piece, likewise; ``pose`` [x y z Rz Ry Rx] puts it into the hand."""
        return _nothing()

    def release(self, piece: str, parent: str = "world", *, fixed: bool = False) -> Future[Any]:
        """Let go of a piece, likewise."""
        return _nothing()

    def insert(self, index: int, move: Mapping[str, Any]) -> bool:
        """Put a move, as a program's file has it, before the stored one of a number; their count: at the end."""
        return False

    def edit(self, index: int, move: Mapping[str, Any]) -> bool:
        """Put another move in the place of a stored one."""
        return False

    def remove(self, index: int) -> bool:
        """Take a stored move out."""
        return False

    def move_entry(self, index: int, to: int) -> bool:
        """Give a stored move another place."""
        return False

    def remove_change(self, index: int) -> bool:
        """Take one of ``program.changes`` out."""
        return False

    def edit_change(self, index: int, change: Mapping[str, Any]) -> bool:
        """Put another change in the place of one of ``program.changes``."""
        return False

    def set_grid(self, seconds: float) -> bool:
        """Set the program's grid [s], at whose multiples it can be paused and changed."""
        return False

    def describe(self, text: str) -> bool:
        """Give the program its line of description."""
        return False

    # While it runs

    def pause(self) -> Future[Any]:
        """Pause at the next tick of the grid."""
        return _nothing()

    def go_on(self) -> Future[Any]:
        """Go on after a pause, or from a moment that was gone back to; what came after that is forgotten."""
        return _nothing()

    def one_tick(self) -> Future[Any]:
        """Go on for one tick of the grid."""
        return _nothing()

    def stop(self) -> Future[Any]:
        """End the run where it is."""
        return _nothing()

    def set_pace(self, factor: float | None) -> Future[Any]:
        """Run so many times as fast as the clock, 0.1 to 4; None: as fast as it can."""
        return _nothing()

    def rewind(self, time: float) -> Future[Any]:
        """Show a moment of what was run [s]."""
        return _nothing()

    def change(self, key: str, value: Any) -> Future[Any]:
        """Change the running station by a dotted key, such as ``servo.kp``; it goes into the program with its time."""
        return _nothing()

    def push(self, at: str, force: Sequence[float], duration: float = 0.1) -> Future[Any]:
        """Push a body with a force [N] for a time [s]; it goes into the program, too."""
        return _nothing()

    def drag(self, at: str, point: Sequence[float], target: Sequence[float] | None) -> Future[Any]:
        """Pull a point of a body [m] to a place in the world [m] by a spring, or let go of it; likewise."""
        return _nothing()

    def watch(self, signals: Sequence[str]) -> Future[Any]:
        """Have these signals in ``values`` and ``history``; tabs that share a session name all that they show."""
        return _nothing()

    # An arm

    def jog_axes(self, targets_deg: Mapping[str, float], duration: float | None = None) -> Future[Any]:
        """Move axes to positions [deg or m]; nothing is stored nor waits to be."""
        return _nothing()

    def jog_tool(
        self, delta: Sequence[float], frame: str = "base", *, start: Sequence[float] | None = None
    ) -> Future[Any]:
        """Move the tool by [x y z Rz Ry Rx], m and degrees, along ``base``, ``tool`` or a work object.

        Args:
            delta: by how much.
            frame: of the directions; the tool turns about its own point.
            start: the pose [m, deg] in that frame that ``delta`` counts from; where the tool is unless given.
        """
        return _nothing()

    def tool(self, name: str) -> Future[Any]:
        """Use another tool; lines added then have it, too."""
        return _nothing()

    def teach_target(self, name: str | None = None) -> Future[Any]:
        """Keep where the arm is in ``targets``; the future gives its name, ``p1``, ``p2``, ... unless given."""
        return _nothing()

    def remove_target(self, name: str) -> bool:
        """Forget a taught target; lines that were made of it stay."""
        return False

    def add_line(
        self,
        kind: Literal["move_abs_j", "move_j", "move_l", "move_c"],
        target: str,
        *,
        index: int | None = None,
        via: str | None = None,
        wobj: str | None = None,
        **how: Any,
    ) -> bool:
        """Store a line that goes to a taught target, with ``speed``, ``duration``, ``zone`` and so on of a program.

        A line that changes the tool is put before it where the program has another one there.

        Args:
            kind: of move.
            target: its name.
            index: before which line; at the end unless given.
            via: another target, on the arc of a ``move_c``.
            wobj: in whose frame the file says it, so that it goes with that piece; the world unless given.
            how: further keys of the line.
        """
        return False

    def run_line(self, index: int) -> Future[Any]:
        """Run one stored line from where the arm is (step)."""
        return _nothing()

    def branches(self) -> Future[Any]:
        """Find every posture that has the tool where it is, into ``ghosts`` and into the view."""
        return _nothing()

    def choose_branch(self, number: int) -> Future[Any]:
        """Go to one of ``ghosts``, and hide them."""
        return _nothing()

    def hide_ghosts(self) -> Future[Any]:
        """Hide the ghosts."""
        return _nothing()

    # The station

    def schema(self) -> dict[str, Any]:
        """Return the JSON Schema of a station's file, to make forms of."""
        return {}

    def value(self, key: str) -> Any:
        """Return what the station has under a dotted key, settings counted in; None if nothing."""
        return None

    def set(self, key: str, value: Any) -> bool:
        """Change the station by a dotted key and open it anew, idle; None takes an entry out."""
        return False

    def unset(self, key: str) -> bool:
        """Take a setting back."""
        return False

    def switch_loop(self, name: str, on: bool) -> bool:
        """Switch an outer loop of the station on or off, idle."""
        return False

    def check(self) -> Future[Any]:
        """Give what ``simrob check`` says of the station with its settings."""
        return _nothing()

    def picture(self) -> Future[Any]:
        """Give the block picture as SVG."""
        return _nothing()

    def parameters(self, block: str) -> Future[Any]:
        """Give a block's parameters."""
        return _nothing()

    # Take away: files in ``folder``

    def export_program(self) -> Future[Any]:
        """Write the program as YAML that ``simrob run`` takes, with the station beside it where it has settings."""
        return _nothing()

    def export_script(self) -> Future[Any]:
        """Write the program as a Python script that runs by itself and gives the same signals."""
        return _nothing()

    def export_station(self) -> Future[Any]:
        """Write the station with its settings as YAML."""
        return _nothing()

    def export_csv(self) -> Future[Any]:
        """Write the signals of the last run; as all of these the future gives the file."""
        return _nothing()

    def export_recording(self) -> Future[Any]:
        """Write the last run as one HTML page."""
        return _nothing()


def _nothing() -> Future[Any]:
    """Return what is there already: nothing."""
    done: Future[Any] = Future()
    done.set_result(None)
    return done
