"""A hand in the view: it puts tool, limbs, pieces and targets elsewhere, and turns joints by their links."""

from collections.abc import Callable, Mapping, Sequence
from math import radians
from typing import Any

from simrob_drake.extensions.pendant.jogging import Jogging
from simrob_drake.extensions.pendant.program_book import ProgramBook
from simrob_drake.extensions.pendant.run_client import RunClient
from simrob_drake.extensions.pendant.setup import Setup

_DIGITS = 6  # of metres and radians


class Hand:
    """An arm goes where its tool is put; joints of legs are set, to be tested; a piece begins where it is put.

    Attributes:
        asked: where the hand put axes last [deg or m], told by the topic ``hand``; whoever sets joints has :meth:`lean`
            show them.
    """

    def __init__(self, client: RunClient, book: ProgramBook, arm: Jogging, setup: Setup) -> None:
        """Begin with nothing to be taken."""
        self._client, self._book, self._arm, self._setup = client, book, arm, setup
        self._on, self.asked = False, dict[str, float]()
        self._leaning = self.asked
        self._kinds: dict[str, Callable[[str, Sequence[float], bool, bool], object]] = {
            "tool": lambda _, pose, *how: arm.jog_pose(pose, "world"),
            "limb": self._put_limb,
            "piece": self._put_piece,
            "target": self._put_target,
        }
        client.listen(lambda _: self._show(), "phase", "program", "description")
        client.listen(lambda _: self._lean_again(), "description")

    def open(self) -> None:
        """Have the view know from now on what can be taken."""
        self._on = True
        self._show()

    def put(self, handle: str, pose: Sequence[float], *, turned: bool, over: bool) -> None:
        """Put a handle ``kind:name`` to a pose in the world [m, deg], ``turned`` or moved; ``over``: and let go."""
        kind, _, name = handle.partition(":")
        if kind in self._kinds and self._client.phase in ("idle", "running"):
            self._kinds[kind](name, pose, turned, over)

    def turn(self, axis: str, value: float) -> None:
        """Turn or move an axis to a position [deg or m] by its link."""
        robot = self._client.description.get("robots", {}).get(self._book.robot, {})
        if robot.get("kind") == "arm":
            self._arm.jog_axes({axis: value})
        else:
            self._ask({axis: value})

    def lean(self, axes: Mapping[str, float]) -> None:
        """Show the robot as a ghost with some axes elsewhere [deg or m]; none hides it."""
        if axes == self._leaning:
            return
        self._leaning = dict(axes)
        postures = [self._leaning] if axes else []
        self._client.ask(
            "ghosts", lambda _: self._show(), postures=postures, good=[True] * len(postures)
        )

    def _lean_again(self) -> None:
        """Show the ghost again in a station that was built anew: its view began without one."""
        axes, self._leaning = self._leaning, {}
        self.lean(axes)

    def _show(self) -> None:
        """Let the view know what can be taken, and where it is now."""
        if self._on and self._client.phase == "idle":
            targets = {
                name: {"pose": one.pose, "frame": one.frame} for name, one in self._targets.items()
            }
            self._client.ask("handles", targets=targets, near=self._leaning)

    @property
    def _targets(self) -> dict[str, Any]:
        known = self._book.history.present.targets
        return {
            name: target for name, target in known.items() if target.robot in ("", self._book.robot)
        }

    def _ask(self, axes: dict[str, float]) -> None:
        self.asked = {axis: round(value, _DIGITS) for axis, value in axes.items()}
        self._client.tell("hand")

    def _put_limb(self, name: str, pose: Sequence[float], turned: bool, over: bool) -> None:
        self._client.ask(
            "reach", self._ask, limb=name, pose=list(pose), turned=turned, near=self._leaning
        )

    def _put_piece(self, name: str, pose: Sequence[float], turned: bool, over: bool) -> None:
        if over:
            turns = [radians(angle) for angle in pose[3:]]
            self._setup.set(
                f"pieces.{name}.pose",
                [round(value, _DIGITS) + 0.0 for value in (*pose[:3], *turns)],
            )
            self._show()  # where it is, if it could not be put

    def _put_target(self, name: str, pose: Sequence[float], turned: bool, over: bool) -> None:
        if over:
            self._arm.put_target(name, pose)
