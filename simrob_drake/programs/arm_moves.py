"""What programs of arms are made of beside pieces: moves in the words of RAPID, tools, waits, several moves at once.

Each is the file's face of a method of :class:`~simrob_drake.Arm` with its arguments; a recorded method gives the entry
that would call it again.
"""

from typing import Annotated, Any, Self, cast, get_args

import numpy as np
from pydantic import Field, model_validator

from simrob_drake.frames import Vector
from simrob_drake.programs.moves import Brief, Named, PlayMove, WaitMove
from simrob_drake.programs.plan import Check
from simrob_drake.programs.timing import How, Profile
from simrob_drake.quantities import Duration, Pose, Positive
from simrob_drake.yaml_files import Number, Strict

Row = Annotated[tuple[Number, ...], Field(min_length=1)]
Rows = Row | Annotated[tuple[Row, ...], Field(min_length=1)]


class _Targets(Named):
    targets: Rows | None = None
    """Where to, one or many, in SI units: postures [rad or m], places [x y z] that keep the orientation, or poses
    [x y z Rz Ry Rx]."""
    targets_deg: Rows | None = None
    """The same with angles in degrees."""
    robot: str | None = None
    """Which robot of the station; that of the program unless given."""
    points: int | None = None
    """Interpolated points on the way to each target; more are taken where the path needs them."""
    duration: Duration | None = None
    """Of the whole move [s]; at most one of this, `times` and `speed`."""
    times: Row | None = None
    """When each target is reached [s]."""
    speed: Positive | None = None
    """At which the tool centre point cruises [m/s]."""
    acceleration: Positive | None = None
    """With which it is sped up to that [m/s²]."""
    profile: Profile | None = None
    """How it is sped up and slowed down; `s_curve` with a speed, else `smooth`."""
    zone: str | Number | None = None
    """How near to a target the tool turns to the next one: `fine` to rest there, `z0` to `z200`, or a distance [m]."""
    check: Check | None = None
    """What is looked at before the move beside its reach; `limits` unless given."""

    @model_validator(mode="after")
    def _one_unit(self) -> Self:
        if (self.targets is None) == (self.targets_deg is None):
            raise ValueError("where to is given by one of targets and targets_deg")
        return self

    @property
    def how(self) -> How:
        """How it is done."""
        given = {key: getattr(self, key) for key in How.__annotations__}
        return cast(How, {key: value for key, value in given.items() if value is not None})


class AbsJ(_Targets):
    """A move of the axes."""

    stop: bool = False
    """Rest at each target."""


class _Cartesian(_Targets):
    wobj: str | Pose | None = None
    """In whose frame the targets are: a piece, one of its frames as `piece.frame`, a robot's tool or a pose; the world
    unless given. With the robot's own name that is where its reference has the tool."""
    solver: str | None = None
    """Of the inverse kinematics; `auto` unless given."""


class J(_Cartesian):
    """A move of the tool that is straight in the joints."""

    stop: bool = False
    """Rest at each target."""


class L(_Cartesian):
    """A move of the tool along straight lines."""


class C(_Cartesian):
    """A move of the tool along arcs."""

    via: Rows
    """A place [x y z] on the arc, or one for each of several [m]."""


class Tool(Named):
    """Another tool centre point."""

    name: str | None = None
    """A tool of the robot, or a piece that it carries."""
    pose: Pose | None = None
    """Or its pose in the frame of the tool that the robot has now."""
    robot: str | None = None
    """Which robot of the station; that of the program unless given."""

    @model_validator(mode="after")
    def _one_way(self) -> Self:
        if (self.name is None) == (self.pose is None):
            raise ValueError("a tool is given by one of name and pose")
        return self


class MoveAbsJMove(Strict):
    """Axes that go to a posture, or through many; see :meth:`Arm.move_abs_j`."""

    move_abs_j: AbsJ


class MoveJMove(Strict):
    """A tool that goes to poses the easiest way; see :meth:`Arm.move_j`."""

    move_j: J


class MoveLMove(Strict):
    """A tool that goes straight; see :meth:`Arm.move_l`."""

    move_l: L


class MoveCMove(Strict):
    """A tool that goes along arcs; see :meth:`Arm.move_c`."""

    move_c: C


PlannedMove = MoveAbsJMove | MoveJMove | MoveLMove | MoveCMove


class ToolMove(Strict):
    """A robot uses another tool; it takes no time."""

    tool: Tool


class TogetherMove(Brief):
    """Moves of different robots at the same time."""

    together: Annotated[tuple[PlannedMove, ...], Field(min_length=1)]
    """The moves."""
    duration: Duration | None = None
    """Of all [s]; until the last one ends unless given."""


ArmMove = PlannedMove | WaitMove | PlayMove | ToolMove | TogetherMove
PLANNED: dict[str, type[Any]] = {next(iter(kind.model_fields)): kind for kind in get_args(PlannedMove)}
"""By the names of the methods."""
ARM_KINDS: dict[str, type[ArmMove]] = {
    **PLANNED,
    "wait": WaitMove,
    "play": PlayMove,
    "tool": ToolMove,
    "together": TogetherMove,
}
"""By the key that tells them apart."""


def said(move: PlannedMove) -> tuple[str, Any]:
    """Return what a planned move is called, and what it says."""
    name = next(iter(type(move).model_fields))
    return name, getattr(move, name)


def in_si(rows: Rows, *, poses: bool, units: Vector) -> Vector:
    """Return targets in degrees in SI units.

    Args:
        rows: postures or, with ``poses``, places or poses.
        poses: which.
        units: of the axes, shape (n,): what one is in SI units.
    """
    try:
        values = np.array(rows, dtype=float)
    except ValueError:  # rows of different lengths, which the move refuses
        return cast(Vector, rows)
    scale = np.repeat([1.0, np.deg2rad(1.0)], 3)[: values.shape[-1]] if poses else units
    return values * scale if values.shape[-1] == len(scale) else values
