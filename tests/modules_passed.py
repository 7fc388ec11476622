"""How many modules of the package a move passes: ``python -m tests.modules_passed [--legs]``.

Counted are the modules of ``simrob_drake`` with a function that is entered (``sys.setprofile``) from the call of the
move to its return, with planning, check, run and signals; that is what has to be read to follow a move. The robot was
made before. A first move builds diagrams and reads files, so it passes more than one that follows.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

import numpy as np

PACKAGE = "simrob_drake"


@contextmanager
def modules_entered() -> Iterator[set[str]]:
    """Give the names of the package's modules whose functions are entered while this is open."""
    entered: set[str] = set()

    def look(frame: FrameType, event: str, _: object) -> None:
        name = frame.f_globals.get("__name__", "")
        if event == "call" and name.startswith(PACKAGE) and frame.f_code.co_name != "<module>":
            entered.add(name)

    sys.setprofile(look)
    try:
        yield entered
    finally:
        sys.setprofile(None)


def modules_passed(call: Callable[[], Any]) -> set[str]:
    """Return the names of the package's modules whose functions are entered during a call."""
    with modules_entered() as passed:
        call()
    return passed


def of_arm() -> dict[str, int]:
    """Return how many modules two moves of an arm pass."""
    from simrob_drake import Arm  # counted from here on

    arm = Arm("irb120_dynamic")
    near, far = (arm.pose(np.deg2rad([0, 10, 10, 0, angle, 0])) for angle in (30, 40))
    moves = {"Arm.move_j, the first": near, "Arm.move_j, the second": far}
    return {name: len(modules_passed(lambda pose=pose: arm.move_j(pose))) for name, pose in moves.items()}


def of_legs() -> dict[str, int]:
    """Return how many modules a walk passes."""
    from simrob_drake import LeggedRobot

    robot = LeggedRobot("zjudancer_walking")
    return {"LeggedRobot.go, the first": len(modules_passed(lambda: robot.go(ahead=0.05, duration=0.5)))}


if __name__ == "__main__":
    for move, count in (of_legs() if "--legs" in sys.argv else of_arm()).items():
        print(f"{move}: {count}")
