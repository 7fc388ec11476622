"""What a station measures: the kinds of sensor that a station file can name."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from simrob_drake.quantities import Positive
from simrob_drake.stations.kinds import named_by_kind
from simrob_drake.yaml_files import Strict


class Force(Strict):
    """Contact force [N] and moment [N·m] on a body."""

    kind: Literal["force"]
    body: str
    """What feels it: a robot, a link, a piece, or a shape of a piece (`<piece>.<shape>`)."""
    other: str | None = None
    """What presses on it: one of these, or `floor`; everything unless given."""
    frame: str = "world"
    """In whose axes force and moment are given, and about whose origin the moment: `world`, a tool, link or piece."""
    rate: Positive | None = None
    """Samples a second that a loop or a monitor gets [Hz]; it may always look unless given."""


class Distance(Strict):
    """Signed distance between two things [m]; negative: how deep they are in each other."""

    kind: Literal["distance"]
    body: str
    """A robot, a link, a piece, or a shape of a piece (`<piece>.<shape>`)."""
    other: str = "floor"
    """The same, or `floor`."""
    rate: Positive | None = None
    """Samples a second that a loop or a monitor gets [Hz]; it may always look unless given."""


class JointTorque(Strict):
    """Torque that each joint hands on to its link, between gear and link [N·m]."""

    kind: Literal["joint_torque"]
    robot: str | None = None
    """Whose joints; the only robot's unless given."""


class ExternalTorque(Strict):
    """Torque at the joints that the model does not explain, and the force at the tool that would cause it.

    A momentum observer; see :mod:`simrob_drake.blocks.momentum_observer`.
    """

    kind: Literal["external_torque"]
    robot: str | None = None
    """Whose joints; the only robot's unless given."""
    gain: Positive = 50.0
    """How fast the estimate follows [1/s]; it lags by 1/gain."""
    rate: Positive = 200.0
    """Samples a second [Hz]."""
    in_loop: bool = False
    """Sample while stepping, so that blocks can read it; otherwise it is computed after the run and costs nothing."""


SensorConfig = Annotated[Force | Distance | JointTorque | ExternalTorque, Field(discriminator="kind")]
Sensors = Annotated[dict[str, SensorConfig], named_by_kind(SensorConfig)]
