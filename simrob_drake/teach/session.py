"""What a page can do: teach a program, run it, change it while it runs, and take it away. It knows no page."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Self

from simrob_drake.errors import InvalidParameter, SimrobError, one_of
from simrob_drake.folders import alone_in, writing
from simrob_drake.importer.packages import granting, is_robot_file, package_root, robot_file
from simrob_drake.parts.controllers.own import OwnController
from simrob_drake.programs.program import Program
from simrob_drake.programs.script import script
from simrob_drake.programs.whole_program import carried_program
from simrob_drake.stations.load import loops_known, loops_on, station_content, station_yaml, switched
from simrob_drake.teach.jogging import Jogging
from simrob_drake.teach.pages.words import Notice
from simrob_drake.teach.run_client import HandOver, MakeLive, Topic, done
from simrob_drake.teach.store import Store, opened
from simrob_drake.teach.subjects import goes_on_legs, program_of, station_for
from simrob_drake.teach.teaching import Teaching

__all__ = ["Session", "Topic"]

_PROGRAM = "program.yaml"


class Session(Teaching, Jogging):
    """One robot or station being taught; tabs share it. All calls come from one thread, and none waits.

    Nothing raises because of what a user does: what is wrong becomes :attr:`message`. Methods that need the run give a
    :class:`concurrent.futures.Future` (``await asyncio.wrap_future(...)``), which never raises and can be ignored: its
    result is None where something was wrong, else True or what was asked for. The others tell by True or False whether
    it was done. Every change of the program is in :attr:`file` when the method returns.

    Attributes:
        subject: what was opened, as given.
        folder: of the program's file and of what is taken away; this subject's own.
        file: of the program.
        station: name or file of the station, and ``config``: it with its settings.
        robot: the robot that is taught, of :attr:`description`'s robots; empty in a station without any.
        description: of the station, as ``Live.open`` gives it; empty until it is there. Its ``loops``, ``{name, on}``,
            can be switched.
        program: what is stored.
        pending: moves that were tested and not added yet, as a program's file has them.
        phase: ``opening``, ``idle``, ``running``, ``paused``, ``rewinding``, ``saving`` or ``gone``.
        run: what was run since the start of the station, to be looked at.
        pace: asked for; None: as fast as it can.
        conflict: whether another editor has changed the file since: see :meth:`take_theirs` and :meth:`keep_both`.
        message: the last thing to tell; ``str(message)`` is English, ``message.key`` tells pages which.
        settings: what is changed of the station, by dotted key.
        targets: taught targets of an arm by name.
        ghosts: the branches that :meth:`branches` found last.
    """

    def __init__(self, live: MakeLive | None = None, hand_over: HandOver | None = None) -> None:
        """Begin empty; :meth:`open` makes one that can be used."""
        super().__init__(live, hand_over)
        self.subject, self.folder = "", Path()
        self._held, self._loops = ExitStack(), dict[str, dict[str, Any]]()

    @classmethod
    def open(
        cls,
        subject: str | Path,
        folder: str | Path,
        *,
        program: str | Path | None = None,
        robot: str | None = None,
        allow_code: bool = False,
        live: MakeLive | None = None,
        hand_over: HandOver | None = None,
    ) -> Self:
        """Open a robot, a station or a file; the description comes later, with the topic of its name.

        Args:
            subject: a robot's or a station's name, or the file of a robot, a station or a program.
            folder: for what is taught; made where it is missing.
            program: a file to begin with; the one that was taught last unless given.
            robot: which robot of the station; its first unless given.
            allow_code: whether the station may name Python code that is run with it.
            live: makes the run from what takes its news; :class:`~simrob_drake.teach.live.Live` unless given.
            hand_over: calls a function in the thread of all other calls, as ``loop.call_soon_threadsafe`` does. Without
                it news wait for :meth:`hear`.

        Raises:
            SimrobError: no such robot, station or file; a folder that cannot be written, or in which another process
                teaches.
        """
        if program is None and (found := program_of(subject)) is not None:
            program, subject = found
        session = cls(live, hand_over)
        session.subject, session._allow_code = str(subject), allow_code
        with ExitStack() as held:
            if is_robot_file(str(subject)):  # which somebody names here, so that its package may be read
                held.enter_context(granting([package_root(robot_file(subject, "subject"))]))
            name, session.station = station_for(subject, Path(folder))
            session.config = session._loaded({})
            session._loops = loops_known(session.config)
            robots = list(session.config.robots)
            session.robot = one_of("robot", robot, robots) if robot is not None else next(iter(robots), "")
            session.folder = (Path(folder) / name).absolute()
            with writing(session.folder):
                session.folder.mkdir(parents=True, exist_ok=True)
            held.enter_context(alone_in(session.folder))
            own = f"{session.robot}.yaml" if session._one_of_several else _PROGRAM
            session._load(Path(program).absolute() if program is not None else session.folder / own)
            session._held = held.pop_all()
        session._reopen()
        return session

    def close(self) -> None:
        """End the run and its process; another one may teach in the folder then."""
        super().close()
        self._held.close()

    # A file that another editor has changed

    def take_theirs(self) -> bool:
        """Take the file as it is now; :meth:`undo` brings back what was taught here."""
        return self._stepped(lambda: self._load(self.file), self.conflict)

    def keep_both(self) -> bool:
        """Leave the file as it is; what is taught goes to another one."""
        if not self.conflict:
            return False
        theirs, self._store = self.file.name, self._store.sibling(self.folder, new=True)
        self.file = self._store.file
        self._save()
        self._say(Notice("both_kept", {"file": theirs, "new": self.file.name}))
        return True

    # The station

    def value(self, key: str) -> Any:
        """Return what the station has under a dotted key, settings counted in; None if nothing."""
        node: Any = station_content(self.config)
        for part in key.split("."):
            node = node.get(part) if isinstance(node, dict) else None
        return node

    def set(self, key: str, value: Any) -> bool:
        """Change the station by a dotted key and open it anew, while nothing runs; None takes an entry out."""
        return self._reconfigure({**self.settings, key: value})

    def unset(self, key: str) -> bool:
        """Take a setting back."""
        return self._reconfigure({other: value for other, value in self.settings.items() if other != key})

    def switch_loop(self, name: str, on: bool) -> bool:
        """Switch an outer loop of the station on or off, while nothing runs."""
        settings = self._or_wrong(lambda: switched(self._loops, self.settings, name, on))
        return settings is not None and self._reconfigure(settings)

    def check(self) -> Future[Any]:
        """Give what ``simrob check`` says of the station with its settings."""
        return self._ask("check")

    def torque_limits(self) -> Future[Any]:
        """Give what the robot's drives can do now [N·m or N], axis by axis."""
        return self._ask("torque_limits")

    def picture(self) -> Future[Any]:
        """Give the block picture as SVG."""
        return self._ask("picture")

    # Take away: files in the folder

    def export_program(self) -> Future[Any]:
        """Write the program as YAML that ``simrob run`` takes, beside it the station if it has settings."""
        program = self._store.placed(self._whole_program(), self.settings)

        def write() -> None:
            self.conflict = not self._store.write(program)

        return self._exported(self.file, write)

    def export_script(self) -> Future[Any]:
        """Write the program as a Python script that runs by itself and gives the same signals."""
        program, file = self._whole_program(), self.file.with_suffix(".py")
        robot = self.robot if self._one_of_several else None
        legs = bool(self.robot) and goes_on_legs(self.model, program)
        code = any(isinstance(one, OwnController) for one in self.config.controllers.values())
        text = script(program, self.station, self.settings, robot=robot, legs=legs, code=code, file=file)
        return self._exported(file, lambda: self._store.make(file, text))

    def export_station(self) -> Future[Any]:
        """Write the station with its settings as YAML."""
        file, text = self._store.station_file, station_yaml(self.config)
        return self._exported(file, lambda: self._store.make(file, text))

    def export_csv(self) -> Future[Any]:
        """Write the signals of the last run; as all of these the future gives the file."""
        return self._saved("signals", ".csv")

    def export_recording(self) -> Future[Any]:
        """Write the last run as one HTML page."""
        return self._saved("page", ".html")

    def film_strip(self) -> Future[Any]:
        """Draw the last run as a strip of pictures, for who cannot see the view; the future gives the file."""
        return self._saved("strip", ".png", quietly=True)

    # How

    @property
    def _one_of_several(self) -> bool:
        """Whether the program is that of one robot beside others; arms share one, whose lines say which is meant."""
        return len(self.config.robots) > 1 and self.model.feet is not None

    def _load(self, file: Path) -> None:
        """Take what is taught in a file, or in another one where that cannot be."""
        robot = self.robot if self._one_of_several else None
        first = Store(file, self.station, robot, carried_program(self.config))
        self._store, self._history, notice = opened(first, self.folder, self._fits)
        self.file = self._store.file
        try:
            if settings := self._history.present.settings:
                self.config = self._loaded(settings)
        except SimrobError as problem:  # of a station whose file has changed
            self._wrong(problem)
            self._history.record(self._history.present.replaced(settings={}))
        self._save()
        if notice is not None:
            self._say(notice)

    def _fits(self, program: Program) -> None:
        """Check that a program can be this robot's.

        Raises:
            SimrobError: it has an axis or a kind of moves that the robot has not.
        """
        for move in program.moves:
            self._within_limits(move)
            if not (move.of_arms if self.model.feet is None else move.of_legs):
                raise InvalidParameter("move", move.key, f"one of {self.model.name}")

    def _reconfigure(self, settings: dict[str, Any]) -> bool:
        if self.phase not in ("opening", "idle", "gone"):
            return self._refused("busy")
        config = self._or_wrong(lambda: self._loaded(settings))
        if config is None:
            return False
        before, self.config = self.config, config
        self._record(self._history.present.replaced(settings=settings))
        taken = self._history.present

        def refused() -> None:
            if self._history.present is taken:
                self._history.withdraw()
                self.config = before
                self._save()
            self._set_phase("idle")

        self._reopen(refused)
        return True

    def _described(self, description: dict[str, Any]) -> dict[str, Any]:
        on = loops_on(self._loops, self.settings)
        loops = [{"name": name, "on": name in on} for name in self._loops]
        return super()._described({**description, "loops": loops})

    def _exported(self, file: Path, write: Callable[[], object]) -> Future[Any]:
        try:
            write()
        except SimrobError as problem:
            self._wrong(problem)
            return done(None)
        if self.conflict and file == self.file:
            return done(self._refused("conflict", file=file.name) or None)
        self._say(Notice("exported", {"file": str(file)}))
        self._save()  # and tell what was put aside
        return done(file)

    def _saved(self, what: str, suffix: str, *, quietly: bool = False) -> Future[Any]:
        file = self.file.with_suffix(suffix)

        def written(_: Any) -> Path:
            if not quietly:
                self._say(Notice("exported", {"file": str(file)}))
            return file

        return self._queued(what, lambda: self._travel("save", written, phase="saving", what=what, file=str(file)))
