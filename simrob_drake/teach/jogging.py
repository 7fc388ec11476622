"""An arm at hand: jogged by its axes or its tool, taught where it is to go, and in which of its postures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import Future
from typing import Any

from simrob_drake.arguments import plain, whole
from simrob_drake.errors import InvalidParameter, one_of
from simrob_drake.programs.moves.kinds import KINDS
from simrob_drake.programs.moves.move import Move
from simrob_drake.programs.moves.tool import ToolMove
from simrob_drake.programs.program import Program
from simrob_drake.teach.move_runner import MoveRunner
from simrob_drake.teach.run_client import done
from simrob_drake.teach.taught import Target

_DIGITS = 6  # of degrees, and of metres: a thousandth of a millimetre


class Jogging(MoveRunner):
    """What a pendant of an arm does. Jogs are neither stored nor wait to be.

    Attributes: those of the session that tell of arms.
    """

    ghosts: Sequence[dict[str, Any]] = ()

    def where(self, frame: str = "base") -> Future[Any]:
        """Give where the arm is, as :func:`simrob_drake.teach.arm_questions.where` tells it."""
        return self._ask("where", frame=frame)

    def jog_axes(self, targets_deg: Mapping[str, float], duration: float | None = None) -> Future[Any]:
        """Move axes to positions [deg or m]; of jogs that come while another runs the last is done."""
        return self._when_idle(lambda: self._jog(plain(targets_deg), duration))

    def jog_tool(
        self, delta: Sequence[float], frame: str = "base", *, start: Sequence[float] | None = None
    ) -> Future[Any]:
        """Move the tool by [x y z Rz Ry Rx], m and degrees, along ``base``, ``tool``, ``world`` or a work object.

        Args:
            delta: by how much.
            frame: of the directions; the tool turns about its own point.
            start: the pose in the base that ``delta`` counts from [m, deg]; where the tool is unless given.
        """
        by: dict[str, Any] = {"delta": plain(delta), "frame": frame, "start": plain(start)}
        return self._when_idle(lambda: self._ask("jogged_axes", self._jog, **by))

    def jog_pose(self, pose: Sequence[float], frame: str = "base") -> Future[Any]:
        """Move the tool to a pose [x y z Rz Ry Rx], m and degrees, in a frame, by the nearest posture."""
        return self._when_idle(lambda: self._ask("inverse", self._jog, pose=plain(pose), frame=frame))

    def tool(self, name: str) -> Future[Any]:
        """Use another tool; targets taught then are of it, too."""
        return self._when_idle(lambda: self._run_free([self._checked({ToolMove.key: name})]))

    def teach_target(self, name: str | None = None, frame: str = "world") -> Future[Any]:
        """Keep where the arm is in ``targets``, with its pose in a frame; the future gives the name.

        Args:
            name: what it is called; ``p1``, ``p2``, ... unless given.
            frame: ``world``, or a work object that lines to it go with.
        """

        def keep(place: dict[str, Any]) -> str:
            known = self._history.present.targets
            called = name or next(text for number in range(1, len(known) + 2) if (text := f"p{number}") not in known)
            axes = {axis: round(value, _DIGITS) + 0.0 for axis, value in place["axes"].items()}
            pose = tuple(round(value, _DIGITS) + 0.0 for value in place["pose"])
            target = Target(axes=axes, pose=pose, frame=frame, tool=place["tool"] or "", robot=self.robot)
            self._record(self._history.present.replaced(targets={**known, called: target}))
            return called

        return self._ask("where", keep, frame=frame)

    def remove_target(self, name: str) -> bool:
        """Forget a taught target; lines that were made of it stay."""
        left = dict(self._history.present.targets)
        if left.pop(name, None) is None:
            return False
        self._record(self._history.present.replaced(targets=left))
        return True

    def add_line(self, kind: str, target: str, *, index: int | None = None, via: str | None = None, **how: Any) -> bool:
        """Store a line that goes to a taught target, with ``speed``, ``duration``, ``zone`` and so on of a program.

        A line that changes the tool is put before it where the program has another one there.

        Args:
            kind: the key of a kind of move of arms.
            target: its name.
            index: before which line; at the end unless given.
            via: another target, on the arc of a ``move_c``.
            how: further keys of the line.
        """

        def lengthened(program: Program) -> Program:
            known = self._history.present.targets
            goal = known[one_of("target", target, known)]
            place = len(program.moves) if index is None else index
            for number, move in enumerate(self._lines(program, place, kind, goal, via, how)):
                program = program.inserted(place + number, move)
            return program

        return self._edit(lengthened)

    def run_line(self, index: int) -> Future[Any]:
        """Run one stored line from where the arm is (step)."""
        moves = self.program.moves
        move = self._or_wrong(lambda: moves[whole(index, "index", 0, len(moves) - 1)])
        return done(None) if move is None else self._when_idle(lambda: self._run_free([move]))

    def branches(self, target: str | None = None) -> Future[Any]:
        """Find every posture for a taught target, or for where the tool is, into ``ghosts`` and into the view."""

        def found(branches: list[dict[str, Any]]) -> Any:
            self.ghosts = branches
            self._tell("program")
            return self.mark_branch(None)

        known = self._history.present.targets
        goal = known.get(target or "")
        of: dict[str, Any] = {"pose": list(goal.pose), "frame": goal.frame, "tool": goal.tool} if goal else {}
        return self._ask("branches", found, **of)

    def mark_branch(self, number: int | None) -> Future[Any]:
        """Let the view show one of ``ghosts`` less faint than the others, or none."""
        postures, good = ([one[key] for one in self.ghosts] for key in ("axes", "usable"))
        return self._ask("ghosts", lambda _: self.ghosts, postures=postures, good=good, marked=number)

    def choose_branch(self, number: int) -> Future[Any]:
        """Go to one of ``ghosts``, and hide them."""
        ghost = self._or_wrong(lambda: self.ghosts[whole(number, "branch", 0, len(self.ghosts) - 1)])
        if ghost is None:
            return done(None)
        self.hide_ghosts()
        return self.jog_axes(ghost["axes"])

    def hide_ghosts(self) -> Future[Any]:
        """Hide the ghosts."""
        self.ghosts = []
        self._tell("program")
        return self.mark_branch(None)

    def _described(self, description: dict[str, Any]) -> dict[str, Any]:
        if self.ghosts:  # of the station before
            self.hide_ghosts()
        return super()._described(description)

    def _jog(self, targets_deg: Mapping[str, float], duration: float | None = None) -> Future[Any]:
        self.run.moves.append([None], self.run.start, free=True)
        return self._start("free", "jog", targets_deg=targets_deg, duration=duration)

    def _lines(
        self, program: Program, place: int, kind: str, goal: Target, via: str | None, how: Mapping[str, Any]
    ) -> list[Move]:
        """Return the line to a target, and before it what its tool needs."""
        before = [move for move in program.moves[:place] if isinstance(move, ToolMove)]
        now = next((tool.name for tool in reversed(before) if tool.robot in (None, goal.robot)), self._first_tool)
        lines = [self._checked({ToolMove.key: goal.tool})] if goal.tool not in ("", now) else []
        content = dict(how)
        if getattr(KINDS[one_of("kind of move", kind, KINDS)], "of_axes", False):
            content["targets_deg"] = [goal.axes[axis] for axis in self.model.axes]
        else:
            content["targets_deg"] = list(goal.pose)
            content |= {} if goal.frame == "world" else {"wobj": goal.frame}
        if via is not None:
            known = self._history.present.targets
            passed = known[one_of("target", via, known)]
            if passed.frame != goal.frame:
                raise InvalidParameter(f"frame of {via}", passed.frame, f"{goal.frame}, as that of the target")
            content["via"] = list(passed.pose[:3])
        return [*lines, self._checked({kind: content})]

    @property
    def _first_tool(self) -> str:
        robots = self.description.get("robots", {})
        return str(robots.get(self.robot, {}).get("tcp") or "")
