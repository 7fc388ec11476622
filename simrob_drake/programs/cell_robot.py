"""A robot of a station that keeps its state, as arms and legged robots share it."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from pydrake.math import RigidTransform

from simrob_drake.frames import Vector, poses_from_matrices
from simrob_drake.kinematics.chain import Chain
from simrob_drake.programs.stateful_station import StatefulStation


class CellRobot:
    """A robot of a station, as arms and legged robots share it; its methods are called, and not assigned to.

    Attributes:
        cell: the station and its state; several robots may share it.
        name: of the robot in the station.
    """

    def __setattr__(self, name: str, value: Any) -> None:
        if callable(getattr(type(self), name, None)):
            raise AttributeError(f"{name} is a method of {type(self).__name__}: call {name}({value!r})")
        super().__setattr__(name, value)

    def __init__(self, cell: StatefulStation, robot: str | None = None) -> None:
        """Take a robot of a station.

        Args:
            cell: the station.
            robot: its name in the station; needed where there are several.

        Raises:
            UnknownName: no such robot.
            InvalidParameter: a station without a robot, or no robot named where there are several.
        """
        self.cell = cell
        self.name = cell.robot_name(robot)

    def __repr__(self) -> str:
        """Say in one line which robot it is, and how it is."""
        return f"<{type(self).__name__} {self.name}: {', '.join(self._described())}>"

    def _described(self) -> list[str]:
        return [f"{self.cell.robot(self.name).model.name} in {self.cell.config.name}", f"{len(self.axes)} axes"]

    @property
    def axes(self) -> list[str]:
        """The names of the axes, in order."""
        return self.cell.robot(self.name).axes

    @property
    def tools(self) -> list[str]:
        """The names of the tool frames, and of the pieces that the robot carries."""
        return list(self.cell.robot(self.name).tools)

    @property
    def position(self) -> Vector:
        """Where the axes are, shape (n,) [rad or m]."""
        return self.cell.position(self.name)

    @property
    def velocity(self) -> Vector:
        """How fast they move, shape (n,) [rad/s or m/s]."""
        return self.cell.velocity(self.name)

    def _poses(self, chain: Chain, base: RigidTransform, q: npt.ArrayLike | None) -> Vector:
        """Return where the tool of a chain is, its base being somewhere: pose (6,), or (k, 6) for rows of postures."""
        rows = self.position if q is None else q
        poses = poses_from_matrices(base.GetAsMatrix4() @ chain.forward(rows))
        return poses if np.ndim(rows) > 1 else np.asarray(poses[0])

    @property
    def reference(self) -> Vector:
        """Where they should be, and the next move begins, shape (n,) [rad or m]."""
        return self.cell.reference(self.name)
