"""What is done to a run while it runs: paused, gone back in, changed, pushed and pulled."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Future
from typing import Any

from simrob_drake.errors import InvalidParameter, SimrobError, quoted
from simrob_drake.programs.moves import plain
from simrob_drake.programs.timeline import Change
from simrob_drake.teach.hub import done
from simrob_drake.teach.trying import Trying
from simrob_drake.yaml_files import validated

SLOWEST, FASTEST = 0.1, 4.0
"""Simulated time over the clock's that can be asked for."""


class Driving(Trying):
    """The bar of a run, the gains and the hand in the picture."""

    def pause(self) -> Future[Any]:
        """Pause at the next tick of the grid."""
        return self._ask("pause")

    def go_on(self) -> Future[Any]:
        """Go on after a pause, or from a moment that was gone back to; what came after that is forgotten."""
        if self.phase == "idle" and self._rewound:
            return self._start(self._kind_seen, "go_on")
        return self._proceed("go_on")

    def one_tick(self) -> Future[Any]:
        """Go on for one tick of the grid after a pause."""
        return self._proceed("one_tick")

    def _proceed(self, method: str) -> Future[Any]:
        """Ask for more of a run; in one that was gone back in there is no more but from there."""
        self._rewound = self._rewound and self.phase == "idle"
        return self._ask(method)

    def set_pace(self, factor: float | None) -> Future[Any]:
        """Run so many times as fast as the clock, 0.1 to 4; None: as fast as it can."""
        known = isinstance(factor, (int, float)) and SLOWEST <= factor <= FASTEST
        if factor is not None and not known:
            expected = f"{SLOWEST:g} to {FASTEST:g} times as fast as the clock, or None: as fast as it can"
            self._wrong(InvalidParameter("pace", quoted(factor), expected))
            return done(None)
        self.pace = factor
        self._tell("phase")
        return self._ask("pace", factor=factor)

    def rewind(self, time: float) -> Future[Any]:
        """Show a moment of what was run [s]."""

        def shown(_: Any) -> bool:
            self._stand(float(time))
            self._rewound = True
            return True

        return self._ask("rewind", shown, time=time)

    def change(self, key: str, value: Any) -> Future[Any]:
        """Change the running station by a dotted key, such as ``servo.kp``; it goes into the program with its time."""
        return self._changed("change", {"set": {key: value}}, settings={key: value})

    def push(self, at: str, force: Sequence[float], duration: float = 0.1) -> Future[Any]:
        """Push a body with a force [N] for a time [s]; it goes into the program, too."""
        push = {"at": at, "force": force, "duration": duration}
        return self._changed("push", {"push": push}, **push)

    def drag(self, at: str, point: Sequence[float], target: Sequence[float] | None) -> Future[Any]:
        """Pull a point of a body [m] to a place in the world [m] by a spring, or let go of it; likewise."""
        drag = {"at": at, "point": point, "targets": [[0, 0, 0] if target is None else target]}
        return self._changed("drag", {"drag": drag}, at=at, point=point, target=target)

    def _changed(self, method: str, change: dict[str, Any], **arguments: Any) -> Future[Any]:
        """Ask for a change, if a program's file could have it."""
        try:
            validated(Change, {"time": 0.0, **plain(change)}, "the change")
        except SimrobError as problem:
            self._wrong(problem)
            return done(None)
        return self._ask(method, **plain(arguments))
