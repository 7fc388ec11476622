"""Robots and pieces of a station, resolved: what a part may know of its station before anything is built."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from pydrake.math import RigidTransform

from simrob_drake.base.errors import InvalidParameter, one_of
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import Message, compound, join_texts, message
from simrob_drake.base.sections import Pose
from simrob_drake.blocks.references import Reference
from simrob_drake.blocks.servo import ServoGains
from simrob_drake.parts.engine import Engine
from simrob_drake.parts.ground import Ground
from simrob_drake.robots.catalog import RobotModel
from simrob_drake.robots.feet import FootContact
from simrob_drake.robots.motors import Motor
from simrob_drake.robots.pieces import TCP, PieceModel

WORLD = "world"


def named(name: str | None, known: Sequence[str], *, kind: str = "robot", key: str = "robot") -> str:
    """Find which of the known names is meant: a name means itself, and None means the only one.

    Args:
        name: the name, or None if the user gives none.
        known: the known names.
        kind: what the name stands for, for errors, such as "robot" or "robot for sensors.force".
        key: key under which the user gives the name, for errors.

    Raises:
        UnknownName: the name is not known.
        InvalidParameter: the name is None, and there are several known names, or none.
    """
    if name is not None:
        return one_of(kind, name, known)
    if len(known) == 1:
        return known[0]
    if not known:
        thing = kind.partition(" for ")[0]
        raise InvalidParameter(
            key, None, message("parts.a_thing_and_there_is_none", "a {thing}, and there is none", thing=thing)
        )
    raise InvalidParameter(key, None, message("parts.one_of", "one of {known}", known=", ".join(known)))


@dataclass(frozen=True)
class ResolvedRobot:
    """A robot of a station, with all that its section and its own files say."""

    # its key in the station, and what stands before the names of its ports
    name: str
    prefix: str
    model: RobotModel  # what it is
    base: RigidTransform  # pose of its root link in the world; where it begins if it floats
    floats: bool  # whether its root link is held by nothing
    gains: ServoGains  # of its servos
    # stiffness and damping of the stops of its axes, each shape (n,) [N·m/rad or N/m, N·m·s/rad or N·s/m]
    stops: tuple[Vector, Vector]
    initial: Vector  # where its axes are at the start, shape (n,) [rad or m]
    carried: tuple[str, ...]  # the pieces that it carries, each after what it hangs on
    held: tuple[str, ...]  # those of them that hang on its tools, and not elsewhere
    loads: Mapping[str, float]  # mass of each piece that it carries, by name [kg]
    tool_frames: Mapping[str, str]  # by tool or carried piece the name of its frame in the plant
    tcp: str  # the tool in use; empty without any
    # pose of the tool centre point in that tool's frame; then the tool in use is called ``tcp``
    tcp_offset: Pose | None
    feet: FootContact | None  # what it stands on; None without
    # references of axes whose motion is prescribed in a dynamic station, of one value each, by place
    prescribed: Mapping[int, Reference]
    motors: tuple[Motor | None, ...]  # of its axes; None where a servo has none

    def __repr__(self) -> str:
        tool = f", tool {self.tcp}" if self.tcp else ""
        return f"<{type(self).__name__} {self.name}: {self.model.name}, {len(self.axes)} axes{tool}>"

    @property
    def axes(self) -> list[str]:
        """The names of the axes, in order."""
        return list(self.model.axes)

    @property
    def load(self) -> float:
        """Mass of everything that it carries [kg]."""
        return float(sum(self.loads.values()))

    @property
    def load_in_words(self) -> Message:
        """Masses of the pieces that it carries, such as ``gripper 1 kg + load 5 kg``; those without mass are left out."""
        masses = [
            compound("{piece} {mass:.3g} kg", piece=piece, mass=mass) for piece, mass in self.loads.items() if mass
        ]
        return join_texts(masses, " + ")

    @property
    def speed_limits(self) -> Vector:
        """How fast its axes may be, shape (n,) [rad/s or m/s]: the no-load speed of motors, else the URDF's limit."""
        speeds = zip(self.motors, self.model.speed_limits, strict=True)
        return np.array([limit if motor is None else motor.line[1] for motor, limit in speeds])

    @property
    def tool_names(self) -> list[str]:
        """The names of the tools, of carried pieces and, with an offset, of the tool centre point itself."""
        return [*self.tool_frames, *([TCP] if self.tcp and self.tcp_offset is not None else [])]


@dataclass(frozen=True)
class ResolvedPiece:
    """A piece of a station, with all its figures."""

    name: str  # its key in the station
    model: PieceModel  # what it is
    parent: str  # what it hangs on: ``world``, a robot or another piece
    carrier: str  # the robot that carries it, directly or through other pieces, or ``world``
    mount: str  # the name of the frame of the plant that it hangs on; empty for the world
    pose: RigidTransform  # in that frame; in the world where it is free
    free: bool  # moved by gravity and contact alone


@dataclass(frozen=True)
class Surroundings:
    """What a part may know of its station before anything is built."""

    engine: Engine  # what moves it
    has_contact: bool  # whether it has this section
    ground: Ground  # what there is to stand on
    robots: Mapping[str, ResolvedRobot]  # by name
    pieces: Mapping[str, ResolvedPiece]  # by name, each after what it hangs on
    sensors: Mapping[str, Any]  # their sections by name
    # text before the names of the station's model instances in a plant that it shares with others, such as "left."
    scope: str = field(default="", kw_only=True)

    @property
    def free_pieces(self) -> list[str]:
        """The names of the pieces that nothing holds."""
        return [name for name, piece in self.pieces.items() if piece.free]

    def robot(self, name: str | None, key: str) -> ResolvedRobot:
        """Find a robot of the station by its name. None means the only one.

        Args:
            name: name that a part gives for its robot under ``robot``.
            key: key of the part, such as ``sensors.force``, for errors.

        Raises:
            UnknownName: there is no such robot.
            InvalidParameter: the name is None, and the station has several robots, or none.
        """
        return self.robots[
            named(
                name, list(self.robots), kind=message("parts.robot_for", "robot for {key}", key=key), key=f"{key}.robot"
            )
        ]
