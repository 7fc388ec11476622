"""A program as controllers take it: moves to one target each, with postures, frames and times, of one arm."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
from pydrake.math import RigidTransform

from simrob_drake.errors import InvalidParameter
from simrob_drake.frames import Vector
from simrob_drake.interpolation import Arc, turned_by
from simrob_drake.kinematics.chain import Chain
from simrob_drake.programs.arm import Workcell
from simrob_drake.programs.moves.attach import AttachMove
from simrob_drake.programs.moves.grip import FingerMove
from simrob_drake.programs.moves.motion import ArmMotion
from simrob_drake.programs.moves.move import Move, move_name, naming
from simrob_drake.programs.moves.move_abs_j import MoveAbsJ
from simrob_drake.programs.moves.move_c import MoveC
from simrob_drake.programs.moves.move_j import MoveJ
from simrob_drake.programs.moves.move_l import MoveL
from simrob_drake.programs.moves.release import ReleaseMove
from simrob_drake.programs.moves.tool import ToolMove
from simrob_drake.programs.moves.wait import WaitMove
from simrob_drake.programs.plan import Plan
from simrob_drake.programs.planning import Planning, places
from simrob_drake.programs.program import Program
from simrob_drake.programs.segments import zone_size
from simrob_drake.programs.timing import profile_of

_UNSAID = ("points", "check", "solver")
"""Keys of moves that other languages have no word for, and that change no move's way or time by much."""


@dataclass(frozen=True)
class TargetMove:
    """A move of a tool to one target."""

    key: str  # what kind of move of a program it is
    pose: RigidTransform  # of the tool, in the world
    posture: Vector  # shape (n,) [rad or m]
    via: Vector | None  # a place on an arc, in the world (3,) [m]
    wobj: RigidTransform  # pose of the work object in the world
    tool: RigidTransform  # pose of the tool centre point in the robot's first tool frame
    speed: float | None  # at which the tool cruises [m/s]; None where the time counts
    time: float  # that it takes [s]
    length: float  # of a line or an arc [m]
    turn: float  # of the tool [rad]
    zone: float  # around the target [m]; 0 to rest there
    acceleration: float | None  # of the tool [m/s²], where that was asked for


Step = TargetMove | WaitMove | AttachMove | ReleaseMove | FingerMove


@dataclass
class ExportedProgram:
    """The steps of a program, of the arm that does it."""

    name: str  # of the station's robot
    chain: Chain  # of its axes to its first tool, from its base
    units: Vector  # of its axes as users have them, shape (n,) [rad or m]
    base: RigidTransform  # pose of its base in the world
    steps: list[Step] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)  # what cannot be said in other languages

    @classmethod
    def of(cls, program: Program, cell: Workcell, file: str = "") -> ExportedProgram:
        """Return the steps of a program; the cell goes on to its end without a run.

        Args:
            program: of one arm.
            cell: where it is done.
            file: that it stands in, for messages.

        Raises:
            InvalidParameter: moves that no other language can say, such as those of two robots together.
            SimrobError: what cannot be done; names the move.
        """
        name = cell.robot_name(program.robot)
        own = cell.robot(name)
        flange = own.tools[next(iter(own.model.tools))]
        found = cls(name, cell.model.chain(name, flange), own.model.user_units, own.base)
        if program.changes:
            found.remarks.append("changes of the station while it runs are left out")
        for number, move in enumerate(program.moves):
            with naming(move_name(number, len(program.moves), file)):
                found._take(move, cell, f"moves[{number}]")
        return found

    def _take(self, move: Move, cell: Workcell, called: str) -> None:
        whose = getattr(move, "robot", None)
        if whose not in (None, self.name):
            raise InvalidParameter("robot", whose, f"{self.name}: an exported program is of one robot")
        if isinstance(move, (MoveAbsJ, MoveJ, MoveL, MoveC)):
            planning = cell.planning(self.name)
            plan = move.plan(planning)
            self.steps += self._legs(move, planning, plan, called)
            cell.stand([plan], None)
        elif isinstance(move, (WaitMove, AttachMove, ReleaseMove, FingerMove)):
            self.steps.append(move)
            move.perform(cell, self.name, cell.stand)
        elif isinstance(move, ToolMove):
            move.perform(cell, self.name, cell.stand)
        else:
            raise InvalidParameter(
                "the move", move.key, "move_abs_j, move_j, move_l, move_c, wait, tool, or one that takes or lets go"
            )

    def _legs(self, move: ArmMotion, planning: Planning, plan: Plan, called: str) -> Iterator[TargetMove]:
        how, wobj = move.how, planning.frame(getattr(move, "wobj", None))
        cruises = "speed" in how and profile_of(how) == "s_curve"
        zone, postures = zone_size(how.get("zone", "fine")), plan.postures(plan.arrivals)
        self._tell_unsaid(move, how, zone, len(postures), called)
        if move.of_axes:
            postures = planning.chain.postures(move.rows(planning))
            rows = planning.chain.forward(postures)
        else:
            rows = planning.poses(move.rows(planning), getattr(move, "wobj", None))
            if zone and move.key == MoveJ.key:  # which passes by where it would rest
                postures = planning.inverse(getattr(move, "solver", None)).solve(rows, planning.start).positions
        arcs = places(move.via, wobj, "via") if hasattr(move, "via") else [None] * len(postures)
        tool = RigidTransform(self.chain.home).inverse() @ RigidTransform(planning.chain.home)
        before, times = planning.pose, np.diff(plan.arrivals, prepend=0.0)
        for number, (pose, posture, via, time) in enumerate(zip(rows, postures, arcs, times, strict=True), 1):
            yield TargetMove(
                key=move.key, pose=RigidTransform(pose), posture=posture, via=via, wobj=wobj, tool=tool,
                length=_length(before[:3, 3], via, pose[:3, 3]),
                speed=how["speed"] if cruises else None, time=float(time), turn=turned_by(before[:3, :3], pose[:3, :3]),
                zone=zone if number < len(rows) else 0.0, acceleration=how.get("acceleration"),
            )  # fmt: skip
            before = pose

    def _tell_unsaid(self, move: ArmMotion, how: Mapping[str, Any], zone: float, count: int, called: str) -> None:
        left = [key for key in _UNSAID if key in move.model_fields_set and getattr(move, key) is not None]
        tell = partial("{}: {}".format, called)
        if left:
            self.remarks.append(tell(f"{', '.join(left)} left out"))
        if how.get("profile", "smooth") != "smooth" and ("speed" not in how or how["profile"] != "s_curve"):
            self.remarks.append(tell(f"profile {how['profile']} left out: only its time is kept"))
        if zone and "speed" not in how:
            self.remarks.append(tell("a zone with a duration: each target has its time"))
        if count > 1 and not zone and hasattr(move, "stop") and not move.stop:
            self.remarks.append(tell("passes its targets smoothly here, rests at each there; give it a zone"))


def _length(begin: Vector, via: Vector | None, end: Vector) -> float:
    return float(np.linalg.norm(end - begin)) if via is None else Arc.through(begin, via, end, "the arc").length
