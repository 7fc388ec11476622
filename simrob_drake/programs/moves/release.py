"""A piece that is let go."""

from collections.abc import Iterable, Mapping
from typing import ClassVar

from simrob_drake.parts.site import WORLD
from simrob_drake.programs.geometry import LeggedGeometry
from simrob_drake.programs.grasps import let_go
from simrob_drake.programs.model import StationModel
from simrob_drake.programs.moves.move import ArmStation, Move, Outlook, Run, Stage, naming
from simrob_drake.sections import Boolean


class ReleaseMove(Move):
    """A piece that is let go; it takes no time."""

    key: ClassVar[str] = "release"
    title: ClassVar[str] = "Let a piece go"
    brief: ClassVar[bool] = True
    takes_time: ClassVar[bool] = False
    form: ClassVar[Mapping[str, str | float | None]] = {"piece": "pieces", "fixed": None}

    piece: str
    """Which."""
    parent: str = WORLD
    """Where it is then: the world, or another piece that it hangs on."""
    fixed: Boolean = False
    """Hang it in the world, too, instead of letting it fall."""
    frame: str | None = None
    """A frame of the piece that it hangs on, instead of its tool centre point."""

    def caption(self, *, robots: bool = False) -> str:
        """Return which piece is let go."""
        return f"release {self.piece}"

    def pieces(self) -> Iterable[str]:
        """Return the piece."""
        return (self.piece,)

    def perform(self, cell: ArmStation, robot: str | None, run: Run) -> None:
        """Let it go."""
        cell.release(self.piece, self.parent, frame=self.frame, fixed=self.fixed)

    def stage(self, robot: LeggedGeometry, outlook: Outlook, name: str) -> Stage:
        """Return the stage in which a robot with legs lets it go."""
        model = StationModel(outlook.station)
        outlook.station = let_go(model, self.piece, self.parent, frame=self.frame, fixed=self.fixed)
        outlook.changed = True

        def release(robot: LeggedGeometry) -> None:
            with naming(name):
                robot.cell.release(self.piece, self.parent, frame=self.frame, fixed=self.fixed)

        return release
