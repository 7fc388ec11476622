"""A robot at hand: an arm jogged by axes or tool and taught where to go; and a walk driven, by one tab at a time."""

from collections.abc import Mapping, Sequence
from concurrent.futures import Future
from typing import Any

from simrob_drake.base.arguments import plain, whole
from simrob_drake.base.errors import InvalidParameter, one_of
from simrob_drake.base.messages import message
from simrob_drake.extensions.pendant.move_runner import MoveRunner
from simrob_drake.extensions.pendant.program_book import ProgramBook
from simrob_drake.extensions.pendant.run_client import RunClient, done
from simrob_drake.extensions.pendant.store import Target
from simrob_drake.programs.moves.grip import ToolMove
from simrob_drake.programs.moves.kinds import KINDS
from simrob_drake.programs.moves.move import Move
from simrob_drake.programs.moves.walk import GoMove
from simrob_drake.programs.program import Program

_DIGITS = 6  # of degrees, and of metres: a thousandth of a millimetre


class Jogging:
    """What a pendant of an arm does. Jogs are neither stored nor wait to be; what is wrong is told by the client.

    Attributes:
        ghosts: the branches that :meth:`branches` found last.
        shown_ghost: index of the one of them that the view shows; None if it shows none.
    """

    def __init__(self, client: RunClient, book: ProgramBook, runner: MoveRunner) -> None:
        """Begin without ghosts; those of a station go when another one is there."""
        self._client, self._book, self._runner = client, book, runner
        self.ghosts: Sequence[dict[str, Any]] = ()
        self.shown_ghost: int | None = None
        # The last jog of axes: its answer, which is there when it has ended, and its targets [deg or m].
        self._last_jog: Future[Any] | None = None
        self._targets = dict[str, float]()
        client.listen(lambda _: self.hide_ghosts() if self.ghosts else None, "description")

    def where(self, frame: str = "base") -> Future[Any]:
        """Give where the arm is, as :func:`simrob_drake.extensions.pendant.arm_questions.where` tells it."""
        return self._client.ask("where", frame=frame)

    def jog_axes(
        self, targets_deg: Mapping[str, float], duration: float | None = None
    ) -> Future[Any]:
        """Move axes to positions [deg or m]; of jogs that come while another runs the last is done.

        Other axes of a jog of axes that still goes on keep their targets: a user who types two angles, one soon after
        the other, wants both.
        """
        goes_on = self._last_jog is not None and not self._last_jog.done()
        unfinished = self._targets if goes_on else {}
        targets = {**unfinished, **plain(targets_deg)}
        self._targets = targets
        self._last_jog = self._runner.when_idle(lambda: self._runner.jog(targets, duration))
        return self._last_jog

    def jog_tool(
        self, delta: Sequence[float], frame: str = "base", *, start: Sequence[float] | None = None
    ) -> Future[Any]:
        """Move the tool by [x y z Rz Ry Rx], m and degrees, along the axes of a frame, about its own point.

        The frame is ``base``, ``tool``, ``world`` or a work object; the move counts from ``start``, a pose in the base,
        or where the tool is.
        """
        by: dict[str, Any] = {"delta": plain(delta), "frame": frame, "start": plain(start)}
        return self._runner.when_idle(
            lambda: self._client.ask("jogged_axes", self._runner.jog, **by)
        )

    def jog_pose(self, pose: Sequence[float], frame: str = "base") -> Future[Any]:
        """Move the tool to a pose [x y z Rz Ry Rx], m and degrees, in a frame, by the nearest posture."""
        to: dict[str, Any] = {"pose": plain(pose), "frame": frame}
        return self._runner.when_idle(lambda: self._client.ask("inverse", self._runner.jog, **to))

    def tool(self, name: str) -> Future[Any]:
        """Use another tool; targets taught then are of it, too."""
        return self._runner.when_idle(
            lambda: self._runner.run_free([self._book.checked({ToolMove.key: name})])
        )

    def teach_target(self, name: str | None = None, frame: str = "world") -> Future[Any]:
        """Keep where the arm is in ``targets``, by a name or as ``p1`` ...; the future gives that.

        Its pose is in a frame: ``world``, or a work object that lines to it go with.
        """

        def keep(place: dict[str, Any]) -> str:
            known = self._book.history.present.targets
            called = name or next(
                text for number in range(1, len(known) + 2) if (text := f"p{number}") not in known
            )
            self._record(
                called, place, frame=frame, tool=place["tool"] or "", robot=self._book.robot
            )
            return called

        return self._client.ask("where", keep, frame=frame)

    def put_target(self, name: str, pose: Sequence[float]) -> Future[Any]:
        """Have a taught target elsewhere, at a pose in the world [m, deg], in the posture nearest to its own."""
        target = self._client.or_wrong(lambda: self._target(name))
        if target is None:
            return done(None)
        own: dict[str, Any] = {"frame": target.frame, "tool": target.tool}

        def keep(place: dict[str, Any]) -> None:
            self._record(name, place, **own, robot=target.robot)

        return self._client.ask("retaught", keep, pose=plain(pose), axes=target.axes, **own)

    def _target(self, name: str) -> Target:
        known = self._book.history.present.targets
        return known[one_of(message("pendant.target", "target"), name, known)]

    def _record(self, name: str, place: Mapping[str, Any], **how: Any) -> None:
        axes = {axis: round(value, _DIGITS) + 0.0 for axis, value in place["axes"].items()}
        target = Target(
            axes=axes, pose=tuple(round(value, _DIGITS) + 0.0 for value in place["pose"]), **how
        )
        taught = self._book.history.present
        self._book.record(taught.replaced(targets={**taught.targets, name: target}))

    def remove_target(self, name: str) -> bool:
        """Forget a taught target; lines that were made of it stay."""
        left = dict(self._book.history.present.targets)
        if left.pop(name, None) is None:
            return False
        self._book.record(self._book.history.present.replaced(targets=left))
        return True

    def add_line(
        self,
        kind: str,
        target: str,
        *,
        index: int | None = None,
        via: str | None = None,
        **how: Any,
    ) -> bool:
        """Store a line, a kind of move of arms, that goes to a taught target, before the line ``index`` or at the end.

        A line that changes the tool is put before it where the program has another one there. ``via`` is another
        target, on the arc of a ``move_c``; ``how`` are further keys: ``speed``, ``duration``, ``zone`` ...
        """

        def lengthened(program: Program) -> Program:
            goal = self._target(target)
            place = len(program.moves) if index is None else index
            for number, move in enumerate(self._lines(program, place, kind, goal, via, how)):
                program = program.with_inserted_move(place + number, move)
            return program

        return self._book.change(lengthened)

    def run_line(self, index: int) -> Future[Any]:
        """Run one stored line from where the arm is (step)."""
        moves = self._book.program.moves
        move = self._client.or_wrong(lambda: moves[whole(index, "index", 0, len(moves) - 1)])
        return (
            done(None)
            if move is None
            else self._runner.when_idle(lambda: self._runner.run_free([move]))
        )

    def branches(self, target: str | None = None) -> Future[Any]:
        """Find every posture for a taught target into ``ghosts``. The view shows the first.

        Without a target, the postures are those for where the tool is.
        """

        def found(branches: list[dict[str, Any]]) -> Any:
            self.ghosts = branches
            return self.show_branch(0 if branches else None)

        known = self._book.history.present.targets
        goal = known.get(target or "")
        of: dict[str, Any] = (
            {"pose": list(goal.pose), "frame": goal.frame, "tool": goal.tool} if goal else {}
        )
        return self._client.ask("branches", found, **of)

    def show_branch(self, number: int | None) -> Future[Any]:
        """Let the view show one of ``ghosts``.

        Only one is shown at a time: several in one place could not be told apart.

        Args:
            number: index of the one to show; one beyond the first or the last stands for that. None shows none.
        """
        if number is not None:
            number = min(max(number, 0), len(self.ghosts) - 1)
        self.shown_ghost = number
        self._client.tell("program")
        shown = [] if number is None else [self.ghosts[number]]
        postures, good = ([one[key] for one in shown] for key in ("axes", "usable"))
        return self._client.ask(
            "ghosts", lambda _: self.ghosts, postures=postures, good=good, marked=0
        )

    def choose_branch(self, number: int) -> Future[Any]:
        """Go to one of ``ghosts``, and hide them."""
        ghost = self._client.or_wrong(
            lambda: self.ghosts[whole(number, "branch", 0, len(self.ghosts) - 1)]
        )
        if ghost is None:
            return done(None)
        self.hide_ghosts()
        return self.jog_axes(ghost["axes"])

    def hide_ghosts(self) -> Future[Any]:
        """Forget the ghosts, and hide the one that is shown."""
        self.ghosts = []
        return self.show_branch(None)

    def _lines(
        self,
        program: Program,
        place: int,
        kind: str,
        goal: Target,
        via: str | None,
        how: Mapping[str, Any],
    ) -> list[Move]:
        """Return the line to a target, and before it what its tool needs."""
        before = [move for move in program.moves[:place] if isinstance(move, ToolMove)]
        now = next(
            (tool.name for tool in reversed(before) if tool.robot in (None, goal.robot)),
            self._first_tool,
        )
        lines = (
            [self._book.checked({ToolMove.key: goal.tool})] if goal.tool not in ("", now) else []
        )
        content = dict(how)
        if getattr(
            KINDS[one_of(message("pendant.kind_of_move", "kind of move"), kind, KINDS)],
            "of_axes",
            False,
        ):
            content["targets_deg"] = [goal.axes[axis] for axis in self._book.model.axes]
        else:
            content["targets_deg"] = list(goal.pose)
            content |= {} if goal.frame == "world" else {"wobj": goal.frame}
        if via is not None:
            passed = self._target(via)
            if passed.frame != goal.frame:
                raise InvalidParameter(
                    message("pendant.frame_of_via", "frame of {via}", via=via),
                    passed.frame,
                    message(
                        "pendant.as_that_of_target",
                        "{frame}, as that of the target",
                        frame=goal.frame,
                    ),
                )
            content["via"] = list(passed.pose[:3])
        return [*lines, self._book.checked({kind: content})]

    @property
    def _first_tool(self) -> str:
        robots = self._client.description.get("robots", {})
        return str(robots.get(self._book.robot, {}).get("tcp") or "")


LONGEST = 600.0  # how long a drive lasts unless it is ended [s]
STANDS = (0.0, 0.0, 0.0)
_DRIVE = GoMove(duration=LONGEST)


class Driving:
    """What a hand does. A drive that has ended waits to be added, as a tested move: a walk as long as it was driven.

    Attributes:
        driver: the tab that drives; None: nobody.
        asked: speeds ahead and to the left [m/s], and turn to the left [deg/s].
    """

    def __init__(self, client: RunClient, book: ProgramBook, runner: MoveRunner) -> None:
        """Begin with nobody at the wheel."""
        self._client, self._book, self._runner = client, book, runner
        runner.cut = self._cut
        self.driver: object = None
        self.asked = STANDS

    @property
    def limits(self) -> dict[str, float] | None:
        """What the taught robot can do; see :func:`simrob_drake.extensions.pendant.describe.description`."""
        limits: dict[str, float] | None = self._robot.get("drives")
        return limits

    def begin(self, driver: object) -> Future[Any]:
        """Let a tab drive from where the robot stands, no faster than the clock; until something else is asked for."""
        if self.driver is not None:
            self._client.refuse("driven")
            return done(None)
        if self.limits is None:
            self._client.refuse("no_drive")
            return done(None)
        if not self._client.run.moves.has_done(self._book.history.present.program.moves):
            # a walk that was driven is nothing without what was asked for when
            self._client.refuse("drive_elsewhere")
            return done(None)
        if self._client.pace is None or self._client.pace > 1.0:
            self._client.pace = 1.0
            self._client.ask("pace", factor=1.0)
        self.driver, self.asked = driver, STANDS
        ended = self._runner.try_moves(lambda: self._runner.without_fallen.with_tried(_DRIVE))
        ended.add_done_callback(lambda _: self._over())
        return ended

    def command(self, driver: object, ahead: float, sideways: float, turn: float) -> None:
        """Drive, by parts of what the robot can do, -1 to 1: ahead, to the left, turn to the left.

        It is to be said again, more than once in a second, as long as it holds. Who does not drive is not heard.
        """
        limits = self.limits
        if driver is not self.driver or driver is None or limits is None:
            return
        ahead, sideways, turn = (
            max(-1.0, min(float(part), 1.0)) for part in (ahead, sideways, turn)
        )
        back = limits["ahead" if ahead > 0 else "backward"]
        asked = (
            round(ahead * back, 4),
            round(sideways * limits["sideways"], 4),
            round(turn * limits["turn_deg"], 2),
        )
        if asked != self.asked:
            self.asked = asked
            self._client.tell("phase")
        if self._client.phase == "running":
            robot = self._book.robot if self._book.one_of_several else None
            self._client.ask(
                "steer", ahead=asked[0], sideways=asked[1], turn_deg=asked[2], robot=robot
            )

    def end(self, driver: object) -> None:
        """Let the robot stand, and end the drive, if this tab drives."""
        if driver is self.driver and driver is not None:
            self.command(driver, *STANDS)
            self._client.ask("stop")

    def _cut(self, end: float) -> bool:
        """Let a drive that was stopped at a time [s] be as long as it was; tell whether that can be known."""
        now, moves = self._book.history.present, self._client.run.moves
        begun = moves.start_of_last(_DRIVE)
        if begun is None or end <= begun or _DRIVE not in now.pending:
            return False
        cut = _DRIVE.model_copy(update={"duration": round(end - begun, 9)})
        moves.replace_last(cut)
        self._book.record(
            now.replaced(pending=tuple(cut if move == _DRIVE else move for move in now.pending))
        )
        return True

    def _over(self) -> None:
        self.driver, self.asked = None, STANDS
        self._client.tell("phase")

    @property
    def _robot(self) -> dict[str, Any]:
        robot: dict[str, Any] = self._client.description.get("robots", {}).get(self._book.robot, {})
        return robot
