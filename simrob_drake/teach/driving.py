"""A walk that is driven by hand: by one tab at a time, which others may stop."""

from concurrent.futures import Future
from typing import Any

from simrob_drake.programs.moves.go import GoMove
from simrob_drake.teach.move_runner import MoveRunner
from simrob_drake.teach.program_book import ProgramBook
from simrob_drake.teach.run_client import RunClient, done

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
        """What the taught robot can do; see :func:`simrob_drake.teach.describe.description`."""
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
            self._client.refuse("drive_elsewhere")  # a walk that was driven is nothing without what was asked for when
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
        ahead, sideways, turn = (max(-1.0, min(float(part), 1.0)) for part in (ahead, sideways, turn))
        back = limits["ahead" if ahead > 0 else "backward"]
        asked = round(ahead * back, 4), round(sideways * limits["sideways"], 4), round(turn * limits["turn_deg"], 2)
        if asked != self.asked:
            self.asked = asked
            self._client.tell("phase")
        if self._client.phase == "running":
            robot = self._book.robot if self._book.one_of_several else None
            self._client.ask("steer", ahead=asked[0], sideways=asked[1], turn_deg=asked[2], robot=robot)

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
        self._book.record(now.replaced(pending=tuple(cut if move == _DRIVE else move for move in now.pending)))
        return True

    def _over(self) -> None:
        self.driver, self.asked = None, STANDS
        self._client.tell("phase")

    @property
    def _robot(self) -> dict[str, Any]:
        robot: dict[str, Any] = self._client.description.get("robots", {}).get(self._book.robot, {})
        return robot
