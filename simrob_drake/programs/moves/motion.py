"""What moves of an arm's tool or axes have in common: targets, and how they are done."""

from collections.abc import Callable, Iterable
from inspect import Parameter, Signature, getdoc, signature
from typing import Annotated, Any, ClassVar, Self, cast

import numpy as np
from pydantic import Field, model_validator

from simrob_drake.base.messages import message
from simrob_drake.base.sections import Duration, Integer, Number, Pose, Positive, Strict
from simrob_drake.kinematics.registry import SolverName
from simrob_drake.programs.moves.move import Move, Run
from simrob_drake.programs.plan import CHECKED, Check, Plan
from simrob_drake.programs.planning import Planning
from simrob_drake.programs.stateful_station import StatefulStation
from simrob_drake.programs.timing import How, Profile

Row = Annotated[tuple[Number, ...], Field(min_length=1)]
Rows = Row | Annotated[tuple[Row, ...], Field(min_length=1)]


class ArmMotion(Move):
    """A move of an arm to targets. A kind has its own keys, and its ``plan``."""

    brief: ClassVar[bool] = True
    of_legs: ClassVar[bool] = False
    of_axes: ClassVar[bool] = False  # whether targets are postures, not poses

    targets: Rows | None = None
    """Where to, one or many, in SI units: postures [rad or m], places [x y z] that keep the orientation, or poses
    [x y z Rz Ry Rx]."""
    targets_deg: Rows | None = None
    """The same with angles in degrees."""
    robot: str | None = None
    """Which robot of the station; that of the program unless given."""
    points: Integer | None = None
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
    check: Check | None = CHECKED
    """What is looked at before the move beside its reach; null, as `limits`, leaves collisions out."""

    @model_validator(mode="after")
    def _one_unit(self) -> Self:
        if (self.targets is None) == (self.targets_deg is None):
            raise ValueError(message("programs.one_of_targets", "where to is given by one of targets and targets_deg"))
        return self

    @property
    def how(self) -> How:
        """How it is done."""
        options = {key: getattr(self, key) for key in How.__annotations__}
        return cast(How, {key: value for key, value in options.items() if value is not None or key == "check"})

    def pieces(self) -> Iterable[str]:
        """Return the piece that is its work object."""
        wobj = getattr(self, "wobj", None)
        return (wobj.split(".", 1)[0],) if isinstance(wobj, str) else ()

    def plan(self, planning: Planning) -> Plan:
        """Return the move, planned and checked from where an arm is; raises SimrobError: the first offending point."""
        raise NotImplementedError

    def perform(self, cell: StatefulStation, robot: str | None, run: Run) -> Any:
        """Plan it, and run the plan."""
        return run([self.plan(cell.planning(self.robot or robot))], None)

    def rows(self, planning: Planning) -> Any:
        """Return the targets in SI units."""
        if self.targets_deg is None:
            return self.targets
        try:
            values = np.array(self.targets_deg, dtype=float)
        except ValueError:  # rows of different lengths, which the plan refuses
            return self.targets_deg
        pose = np.repeat([1.0, np.deg2rad(1.0)], 3)[: values.shape[-1]]
        scale = planning.model.user_units if self.of_axes else pose
        return values * scale if values.shape[-1] == len(scale) else values


class ToolMotion(Strict):
    """The further keys of an arm's motion whose targets are places of its tool."""

    wobj: str | Pose | None = None
    """In whose frame the targets are: a piece, one of its frames as `piece.frame`, a robot's tool or a pose; the world
    unless given. With the robot's own name that is where its reference has the tool."""
    solver: SolverName | None = None
    """Of the inverse kinematics; `auto` unless given."""


def describe(method: Callable[..., Any], plan: Callable[..., Plan]) -> None:
    """Let help tell of a method what its function takes, with the keys of :class:`How` one by one."""
    text, attributes = getdoc(plan) or "", (getdoc(How) or "").partition("Attributes:\n")[2]
    text = text.replace("    planning: what the move starts from.\n", "")
    method.__doc__ = text.replace("    how: see :class:`How`.", attributes.rstrip())
    method.__name__ = plan.__name__.removeprefix("plan_")
    _, *own, _ = signature(plan).parameters.values()
    options = [
        Parameter(key, Parameter.KEYWORD_ONLY, default=CHECKED if key == "check" else None, annotation=kind)
        for key, kind in How.__annotations__.items()
    ]
    arm = Parameter("self", Parameter.POSITIONAL_ONLY)
    vars(method)["__signature__"] = Signature([arm, *own, *options], return_annotation="SimulationResult")
