"""Contents of a station before anything is built: its robots, its pieces, and what surrounds them.

A station file says what a station contains. It is *resolved* before the plant is built: files of robots and pieces are
read, defaults are filled in, and each piece gets the robot that carries it. Parts of a station (sensors, monitors,
controllers ...) check their own sections against the result, :class:`StationContents`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from pydrake.math import RigidTransform

from simrob_drake.base.errors import InvalidParameter, Unsuitable, one_of
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import Message, compound, join_texts, message
from simrob_drake.base.renaming import former_names_of
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


def name_or_only(
    name: str | None, known: Sequence[str], *, kind: str = "robot", key: str = "robot"
) -> str:
    """Check that a name is known, and return it. Without a name, return the only known one.

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
        raise Unsuitable(
            key,
            message("parts.there_is_none", "there is no {kind}", kind=kind),
            message("parts.add_one", "add one"),
        )
    raise InvalidParameter(
        key, None, message("parts.one_of", "one of {known}", known=", ".join(known))
    )


@dataclass(frozen=True)
class ResolvedRobot:
    """A robot of a station, with all values that its section and its own files give. It has n axes."""

    name: str  # its key in the station
    prefix: str  # text before the names of its ports, such as "left."; empty for the only robot
    model: RobotModel
    # pose of its root link in the world; only at the start if the robot floats
    base: RigidTransform
    floats: bool  # whether nothing holds its root link
    gains: ServoGains  # gains and limits of its servos
    # stiffness and damping of the stops of its axes, each shape (n,) [N·m/rad or N/m, N·m·s/rad or N·s/m]
    stops: tuple[Vector, Vector]
    initial: Vector  # positions of its axes at the start, shape (n,) [rad or m]
    # names of the pieces that it carries, each after the piece to which it is attached
    carried: tuple[str, ...]
    # those of them that are attached to its tools, directly or through other pieces
    held: tuple[str, ...]
    loads: Mapping[str, float]  # mass of each piece that it carries, by name [kg]
    # name of the frame in the plant, by the name of a tool or of a carried piece
    tool_frames: Mapping[str, str]
    tcp: str  # name of the tool in use; empty if the robot has none
    # pose of the tool centre point in the frame of the tool in use; None if the point is the origin of this frame
    tcp_offset: Pose | None
    feet: FootContact | None  # contact points of its feet; None if it has no feet
    # references of axes whose motion is prescribed in a dynamic station, with one value each, by the axis's index
    prescribed: Mapping[int, Reference]
    # motor of each axis; None for an ideal servo, which has no motor model
    motors: tuple[Motor | None, ...]

    def __repr__(self) -> str:
        tool = f", tool {self.tcp}" if self.tcp else ""
        return (
            f"<{type(self).__name__} {self.name}: {self.model.name}, {len(self.axes)} axes{tool}>"
        )

    @property
    def axes(self) -> list[str]:
        """Names of the axes, in order."""
        return list(self.model.axes)

    @property
    def load(self) -> float:
        """Mass of everything that it carries [kg]."""
        return float(sum(self.loads.values()))

    @property
    def load_in_words(self) -> Message:
        """Masses of the pieces that it carries, such as ``gripper 1 kg + load 5 kg``, without pieces of mass 0.

        The text is empty if no piece has a mass.
        """
        masses = [
            compound("{piece} {mass:.3g} kg", piece=piece, mass=mass)
            for piece, mass in self.loads.items()
            if mass
        ]
        return join_texts(masses, " + ")

    @property
    def speed_limits(self) -> Vector:
        """Largest speed of each axis, shape (n,) [rad/s or m/s].

        It is the no-load speed of the axis's motor, at which its torque has fallen to zero. Without a motor, it is the
        limit in the robot's URDF: infinite if the URDF gives none, and for a passive axis.
        """
        # A copy: the limits of the model are those of the URDF, whatever motors a station gives it.
        limits = np.array(self.model.speed_limits, dtype=float)
        for index, motor in enumerate(self.motors):
            if motor is not None:
                # The line from the stall torque, at rest, to the no-load speed, without torque.
                _, no_load_speed = motor.line
                limits[index] = no_load_speed
        return limits

    @property
    def tool_names(self) -> list[str]:
        """Names of the tools and of the carried pieces. With an offset, ``tcp`` is one of them."""
        # Without an offset, the tool centre point is the origin of the tool's own frame, which has a name already.
        has_offset = self.tcp != "" and self.tcp_offset is not None
        return [*self.tool_frames, TCP] if has_offset else [*self.tool_frames]


@dataclass(frozen=True)
class ResolvedPiece:
    """A piece of a station, such as a table or a box, with all values that its section and its own file give."""

    name: str  # its key in the station
    model: PieceModel
    parent: str  # to what it is attached: ``world``, a robot or another piece
    carrier: str  # robot that carries it, directly or through other pieces, or ``world``
    mount: str  # name of the frame of the plant to which it is attached; empty for the world
    pose: RigidTransform  # pose in that frame; in the world at the start if the piece is free
    free: bool  # whether nothing holds it, so that gravity and contact alone move it


@dataclass(frozen=True)
class StationContents:
    """Contents of a station, as its parts see them before anything is built."""

    engine: Engine  # what moves the station, with its abilities
    has_contact: bool  # whether the station file has a section ``contact``
    ground: Ground  # height of the ground, on which robots stand
    robots: Mapping[str, ResolvedRobot]  # by name
    pieces: Mapping[str, ResolvedPiece]  # by name, each after the piece to which it is attached
    sensors: Mapping[str, Any]  # sections of the sensors, by name
    # text before the names of the station's model instances in a plant that it shares with others, such as "left."
    scope: str = field(default="", kw_only=True)

    @property
    def free_pieces(self) -> list[str]:
        """Names of the pieces that nothing holds."""
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
        kind = message("parts.robot_for", "robot for {key}", key=key)
        found = name_or_only(name, list(self.robots), kind=kind, key=f"{key}.robot")
        return self.robots[found]


if not TYPE_CHECKING:
    __getattr__ = former_names_of(
        __name__, {"Surroundings": "StationContents", "named": "name_or_only"}
    )
