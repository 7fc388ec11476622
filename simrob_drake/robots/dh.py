"""Tables of Denavit-Hartenberg parameters: what an arm is, in the words of the textbooks."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, model_validator
from pydrake.math import RigidTransform, RollPitchYaw

from simrob_drake.frames import transform_from_pose
from simrob_drake.sections import ORIGIN, Colour, Inertia, NotNegative, Number, Pose, Positive, Strict, Triple

BASE_LINK, TOOL_LINK = "base_link", "tool0"
_JOINT = "joint_{}"

Range = tuple[Number, Number]


class DhRow(Strict):
    """One joint and the link that it moves.

    Mass, centre of mass and inertia are those of the link, in the frame of this row.
    """

    joint: str | None = None
    """Its name; `joint_1` and so on unless given."""
    type: Literal["revolute", "prismatic"] = "revolute"
    """Whether it turns about z or slides along it."""
    a: Number = 0.0
    """Length along x [m]."""
    alpha_deg: Number = 0.0
    """Twist about x [deg]."""
    d: Number = 0.0
    """Offset along z [m]; of a prismatic joint, where its zero is."""
    offset_deg: Number = 0.0
    """Turn about z [deg]; of a revolute joint, where its zero is."""
    limit_deg: Range | None = None
    """Lowest and highest angle of a revolute joint [deg]."""
    limit: Range | None = None
    """Lowest and highest place of a prismatic joint [m]."""
    velocity_deg: Positive | None = None
    """Largest speed of a revolute joint [deg/s]."""
    velocity: Positive | None = None
    """Largest speed of a prismatic joint [m/s]."""
    effort: Positive
    """Largest torque [N·m] or force [N] of the motor."""
    damping: NotNegative = 0.0
    """Viscous friction [N·m·s/rad or N·s/m]."""
    mass: NotNegative = 0.0
    """Of the link [kg]."""
    com: Triple | None = None
    """Centre of mass [m]; that of the generated shape unless given."""
    inertia: Inertia | None = None
    """About the centre of mass [kg m²]; that of the generated shape, with the link's mass, unless given."""

    @model_validator(mode="after")
    def _fitting(self) -> DhRow:
        revolute = self.type == "revolute"
        own, other = ("limit_deg", "limit") if revolute else ("limit", "limit_deg")
        spared = "velocity" if revolute else "velocity_deg"
        limits = getattr(self, own)
        if limits is None:
            raise ValueError(f"a {self.type} joint needs {own}")
        if getattr(self, other) is not None or getattr(self, spared) is not None:
            raise ValueError(f"a {self.type} joint has {own} and {own.replace('limit', 'velocity')}")
        if limits[0] >= limits[1]:
            raise ValueError(f"{own} is not a lower and a higher figure: {limits[0]:g}, {limits[1]:g}")
        return self

    @property
    def range(self) -> tuple[float, float]:
        """Lowest and highest position [rad or m]."""
        low, high = self.limit or tuple(np.deg2rad(self.limit_deg or (0.0, 0.0)).tolist())
        return low, high

    @property
    def speed(self) -> float | None:
        """Largest speed [rad/s or m/s]."""
        return self.velocity if self.velocity_deg is None else float(np.deg2rad(self.velocity_deg))


class DhTable(Strict):
    """An arm as a table: base, a row a joint, tool.

    Rows multiply to the pose of the tool: classical ones as Rz(q + offset) Tz(d) Tx(a) Rx(alpha), modified (Craig's)
    as Rx(alpha) Tx(a) Rz(q + offset) Tz(d); where the joint is prismatic, q adds to d.
    """

    convention: Literal["classical", "modified"]
    """How the figures of a row are meant; modified ones are Craig's."""
    rows: Annotated[tuple[DhRow, ...], Field(min_length=1)]
    """One a joint, from the base outward."""
    base: Pose = ORIGIN
    """Pose of the table's first frame in the base link, [x y z Rz Ry Rx]."""
    tool: Pose = ORIGIN
    """Pose of the tool flange in the last frame, [x y z Rz Ry Rx]."""
    thickness: Positive | None = None
    """Radius of the generated arm at its base [m]; a part of its length unless given."""
    colour: Colour = (0.86, 0.87, 0.89, 1.0)
    """Of the tubes between the joints."""
    joint_colour: Colour = (0.16, 0.38, 0.62, 1.0)
    """Of the joints."""

    @property
    def joints(self) -> list[str]:
        """The names of the joints."""
        return [row.joint or _JOINT.format(number) for number, row in enumerate(self.rows, 1)]

    def link_frames(self) -> list[RigidTransform]:
        """Return the pose of each row's frame in its link, whose own frame moves with the joint, about z or along it.

        A classical row's length and twist lie behind its joint, a modified one's before it.
        """
        if self.convention == "classical":
            return [_motion(row.offset_deg, row.d, row.a, row.alpha_deg) for row in self.rows]
        return [_motion(row.offset_deg, row.d, 0.0, 0.0) for row in self.rows]

    def origins(self) -> list[RigidTransform]:
        """Return the pose of each joint at zero in the link before, and last that of the tool in the last link."""
        befores = [RigidTransform()] * len(self.rows)
        if self.convention == "modified":
            befores = [_motion(0.0, 0.0, row.a, row.alpha_deg) for row in self.rows]
        starts = [transform_from_pose(self.base), *self.link_frames()]
        return [start @ end for start, end in zip(starts, [*befores, transform_from_pose(self.tool)], strict=True)]


def described_by_table(content: dict[str, Any]) -> Any:
    """Fill in what a robot's description need not say where it has a table: root, axes and tools."""
    rows = content["dh"].get("rows")
    if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
        return content
    joints = [row.get("joint") or _JOINT.format(number) for number, row in enumerate(rows, 1)]
    return {"root": BASE_LINK, "axes": joints, "tools": {TOOL_LINK: TOOL_LINK}, **content}


def _motion(turn_deg: float, z: float, x: float, twist_deg: float) -> RigidTransform:
    """Return Rz(turn) Tz(z) Tx(x) Rx(twist)."""
    turn, twist = np.deg2rad([turn_deg, twist_deg])
    return RigidTransform(RollPitchYaw(twist, 0.0, turn), np.array([x * np.cos(turn), x * np.sin(turn), z]))
