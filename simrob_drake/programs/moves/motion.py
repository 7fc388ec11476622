"""Base classes of moves of an arm's axes or of its tool: targets and options.

A *target* is a posture of the axes, a *pose* of the tool, or a *place*: a position that keeps the tool's orientation. A
*planning* is the start of a move of one arm: its posture, its limits and its surroundings.
"""

import re
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
"""Numbers of one target."""
Rows = Row | Annotated[tuple[Row, ...], Field(min_length=1)]
"""Numbers of one target or of several."""


class ArmMotion(Move):
    """A move of an arm to targets. A subclass adds its own keys and implements :meth:`plan`.

    Attributes:
        of_axes: whether the targets are postures of the axes, not poses of the tool.
    """

    brief: ClassVar[bool] = True
    of_legs: ClassVar[bool] = False
    of_axes: ClassVar[bool] = False

    targets: Rows | None = None
    """One target or several in SI units: postures [rad or m], places [x y z] that keep the orientation, or poses
    [x y z Rz Ry Rx]."""
    targets_deg: Rows | None = None
    """The targets with angles in degrees."""
    robot: str | None = None
    """Robot of the station that moves. If it is not set, that of the program."""
    points: Integer | None = None
    """Count of interpolated points on the way to each target. More are used where the path needs them."""
    duration: Duration | None = None
    """Duration of the whole move [s]. At most one of this, `times` and `speed` may be set."""
    times: Row | None = None
    """Time at which each target is reached [s]."""
    speed: Positive | None = None
    """Speed at which the tool centre point cruises [m/s]."""
    acceleration: Positive | None = None
    """Acceleration of the tool up to this speed [m/s²]."""
    profile: Profile | None = None
    """How the move speeds up and slows down. If it is not set, `s_curve` with a speed, else `smooth`."""
    zone: str | Number | None = None
    """How near to a target the tool turns to the next one: `fine` to rest there, `z0` to `z200`, or a distance [m]."""
    check: Check | None = CHECKED
    """What is checked before the move in addition to its reach. Null, like `limits`, leaves out collisions."""

    @model_validator(mode="after")
    def _one_unit(self) -> Self:
        """Check that the targets are given in exactly one unit."""
        if (self.targets is None) == (self.targets_deg is None):
            raise ValueError(
                message(
                    "programs.one_of_targets", "exactly one of targets and targets_deg must be set"
                )
            )
        return self

    @property
    def how(self) -> How:
        """Options of the move that are set. The option `check` is always there, because its None means `limits`."""
        # Only options that are set are passed on: a planner sees from the missing ones that the timing is free.
        options = {key: getattr(self, key) for key in How.__annotations__}
        return cast(
            How,
            {key: value for key, value in options.items() if value is not None or key == "check"},
        )

    def pieces(self) -> Iterable[str]:
        """Name of the work object, without its frame, if the move names one: of a piece, or of a robot."""
        wobj = getattr(self, "wobj", None)
        if not isinstance(wobj, str):
            return ()
        # A frame of a piece is written as `piece.frame`.
        piece, _, _ = wobj.partition(".")
        return (piece,)

    def plan(self, planning: Planning) -> Plan:
        """Plan and check the move.

        Args:
            planning: the start of the move: posture, limits, surroundings.

        Raises:
            SimrobError: the move cannot be done. The message names the first bad point.
        """
        raise NotImplementedError

    def perform(self, cell: StatefulStation, robot: str | None, run: Run) -> Any:
        """Plan the move, and run the plan; see :meth:`Move.perform`."""
        return run([self.plan(cell.planning(self.robot or robot))], None)

    def rows(self, planning: Planning) -> Any:
        """Targets in SI units: one or several postures [rad or m], places [m] or poses [m, rad], or a posture's name.

        A posture may leave out the fingers. Degrees of a wrong count of numbers may be returned unchanged: the planner
        refuses them with a message, whatever they are.

        Args:
            planning: the start of the move, for the units of the robot's axes.
        """
        if self.targets_deg is None:
            return self.targets
        try:
            values = np.array(self.targets_deg, dtype=float)
        except ValueError:  # rows of different lengths
            return self.targets_deg
        # Factors on the numbers of one target, which convert angles to radians.
        if self.of_axes:
            units = planning.units_of(values.shape[-1])
            return values if units is None else values * units
        pose_units = np.repeat([1.0, np.deg2rad(1.0)], 3)  # of x, y, z and of three angles
        # A place has the first three coordinates of a pose only.
        units = pose_units[: values.shape[-1]]
        return values * units if values.shape[-1] == len(units) else values


class ToolMotion(Strict):
    """Further keys of an arm's motion whose targets are places or poses of its tool."""

    wobj: str | Pose | None = None
    """Frame of the targets: a piece, one of its frames as `piece.frame`, a robot's tool or a pose. If it is not set,
    the world. The robot's own name means the tool at its reference."""
    solver: SolverName | None = None
    """Solver of the inverse kinematics. If it is not set, `auto`."""


def describe(method: Callable[..., Any], plan: Callable[..., Plan]) -> None:
    """Set name, docstring and signature of a method of an arm, so that `help` lists every option.

    They are made from those of the planning function: without its first argument, and with the options of
    :class:`How` in place of ``**how``.

    Args:
        method: the method, which runs what `plan` plans. It is changed.
        plan: function ``plan_<name>`` whose first argument is the planning, and whose last one is ``**how``.
    """
    text = getdoc(plan) or ""
    # The options are listed at the end of the docstring of `How`.
    _, _, options_text = (getdoc(How) or "").partition("Attributes:\n")
    # The method has no `planning`: the arm itself is the start of its moves.
    text = re.sub(r"^    planning: .*\n", "", text, flags=re.MULTILINE)
    method.__doc__ = text.replace("    how: see :class:`How`.", options_text.rstrip())
    method.__name__ = plan.__name__.removeprefix("plan_")
    _, *own_parameters, _ = signature(plan).parameters.values()  # without `planning` and `how`
    options = [
        Parameter(
            key,
            Parameter.KEYWORD_ONLY,
            default=CHECKED if key == "check" else None,
            annotation=kind,
        )
        for key, kind in How.__annotations__.items()
    ]
    # `inspect.signature` reads this attribute. The method itself takes any arguments and passes them to `plan`.
    arm = Parameter("self", Parameter.POSITIONAL_ONLY)
    parameters = [arm, *own_parameters, *options]
    vars(method)["__signature__"] = Signature(parameters, return_annotation="SimulationResult")
