"""Programs in RAPID and URScript: first as controllers take them, moves to one target each, then in words."""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
import yaml
from pydrake.math import RigidTransform

from simrob_drake.base.errors import InvalidParameter
from simrob_drake.base.frames import Vector
from simrob_drake.base.interpolation import Arc, turned_by
from simrob_drake.base.messages import message
from simrob_drake.extensions.rapid.configuration import configuration, has_configuration
from simrob_drake.extensions.rapid.instructions import joint_target
from simrob_drake.extensions.rapid.values import number_text, pose_of, robtarget_of, texted
from simrob_drake.kinematics.chain import Chain
from simrob_drake.programs.arm import Workcell
from simrob_drake.programs.moves.attach import AttachMove, ReleaseMove
from simrob_drake.programs.moves.grip import FingerMove, GripMove, ToolMove
from simrob_drake.programs.moves.motion import ArmMotion
from simrob_drake.programs.moves.move import Move, move_name, naming
from simrob_drake.programs.moves.move_j import MoveAbsJ, MoveJ
from simrob_drake.programs.moves.move_l import MoveC, MoveL
from simrob_drake.programs.moves.wait import WaitMove
from simrob_drake.programs.plan import Plan
from simrob_drake.programs.planning import Planning, places
from simrob_drake.programs.program import Program
from simrob_drake.programs.segments import zone_size
from simrob_drake.programs.timing import ACCELERATION, profile_of
from simrob_drake.results.record.run import move_title

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
    def of(cls, program: Program, cell: Workcell, file: str = "") -> "ExportedProgram":
        """Return the steps of a program of one arm; the cell goes on to its end without a run.

        Raises InvalidParameter: moves that no other language can say, such as those of two robots together;
        SimrobError: what cannot be done; names the move, and the file that it stands in.
        """
        name = cell.robot_name(program.robot)
        own = cell.robot(name)
        flange = own.tools[next(iter(own.model.tools))]
        found = cls(name, cell.model.chain(name, flange), own.model.user_units, own.base)
        if program.changes:
            found.remarks.append(
                message(
                    "rapid.changes_left_out", "changes of the station while it runs are left out"
                )
            )
        for number, move in enumerate(program.moves):
            with naming(move_name(number, len(program.moves), file)):
                found._take(move, cell, move_title(number))
        return found

    def _take(self, move: Move, cell: Workcell, called: str) -> None:
        whose = getattr(move, "robot", None)
        if whose not in (None, self.name):
            raise InvalidParameter(
                "robot",
                whose,
                message(
                    "rapid.program_of_one_robot",
                    "{name}: an exported program is of one robot",
                    name=self.name,
                ),
            )
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
                message("rapid.the_move", "the move"),
                move.key,
                message(
                    "rapid.exported_moves",
                    "move_abs_j, move_j, move_l, move_c, wait, tool, or one that takes or lets go",
                ),
            )

    def _legs(
        self, move: ArmMotion, planning: Planning, plan: Plan, called: str
    ) -> Iterator[TargetMove]:
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
                postures = (
                    planning.inverse(getattr(move, "solver", None))
                    .solve(rows, planning.start)
                    .positions
                )
        arcs = places(move.via, wobj, "via") if hasattr(move, "via") else [None] * len(postures)
        tool = RigidTransform(self.chain.home).inverse() @ RigidTransform(planning.chain.home)
        before, times = planning.pose, np.diff(plan.arrivals, prepend=0.0)
        for number, (pose, posture, via, time) in enumerate(
            zip(rows, postures, arcs, times, strict=True), 1
        ):
            yield TargetMove(
                key=move.key, pose=RigidTransform(pose), posture=posture, via=via, wobj=wobj, tool=tool,
                length=float(np.linalg.norm(pose[:3, 3] - before[:3, 3])) if via is None
                else Arc.through(before[:3, 3], via, pose[:3, 3], message("rapid.the_arc", "the arc")).length,
                speed=how["speed"] if cruises else None, time=float(time), turn=turned_by(before[:3, :3], pose[:3, :3]),
                zone=zone if number < len(rows) else 0.0, acceleration=how.get("acceleration"),
            )  # fmt: skip
            before = pose

    def _tell_unsaid(
        self, move: ArmMotion, how: Mapping[str, Any], zone: float, count: int, called: str
    ) -> None:
        left = [
            key
            for key in _UNSAID
            if key in move.model_fields_set and getattr(move, key) is not None
        ]
        tell = partial("{}: {}".format, called)
        if left:
            self.remarks.append(
                tell(message("rapid.left_out", "{left} left out", left=", ".join(left)))
            )
        if how.get("profile", "smooth") != "smooth" and (
            "speed" not in how or how["profile"] != "s_curve"
        ):
            self.remarks.append(
                tell(
                    message(
                        "rapid.profile_left_out",
                        "profile {profile} left out: only its time is kept",
                        profile=how["profile"],
                    )
                )
            )
        if zone and "speed" not in how:
            self.remarks.append(
                tell(
                    message(
                        "rapid.zone_with_duration",
                        "a zone with a duration: each target has its time",
                    )
                )
            )
        if count > 1 and not zone and hasattr(move, "stop") and not move.stop:
            self.remarks.append(
                tell(
                    message(
                        "rapid.rests_at_each_there",
                        "passes its targets smoothly here, rests at each there; give it a zone",
                    )
                )
            )


_MOST_AXES = 6
_TURNING = 500.0  # deg/s, that a speed of RAPID allows
_ZONES = (0, 1, 5, 10, 15, 20, 30, 40, 50, 60, 80, 100, 150, 200)
_SPEEDS = (
    5, 10, 20, 30, 40, 50, 60, 80, 100, 150, 200, 300, 400, 500, 600, 800, 1000, 1500, 2000, 2500, 3000, 4000, 5000,
    6000, 7000,
)  # fmt: skip
_LOAD = "[0.001,[0,0,0.001],[1,0,0,0],0,0,0]"
_SMALLEST = 0.3  # mm: z0
_WORDS = {"move_abs_j": "MoveAbsJ", "move_j": "MoveJ", "move_l": "MoveL", "move_c": "MoveC"}


@dataclass
class _Names:
    """Data of a module: each is declared once."""

    declared: dict[str, str] = field(default_factory=dict)  # text to name
    lines: list[str] = field(default_factory=list)
    counts: dict[str, int] = field(default_factory=dict)

    def of(self, kind: str, stem: str, value: str, how: str = "CONST") -> str:
        key = f"{kind} {value}"
        if key not in self.declared:
            self.counts[stem] = self.counts.get(stem, 0) + 1
            number = self.counts[stem] * (10 if stem in ("p", "j") else 1)
            self.declared[key] = f"{stem}{number}"
            self.lines.append(f"{how} {kind} {stem}{number}:={value};")
        return self.declared[key]


def rapid_text(steps: ExportedProgram, name: str) -> tuple[str, str]:
    """Return a program's module and its signals' table in YAML, or ""; raises InvalidParameter: too many axes."""
    if steps.chain.size > _MOST_AXES:
        raise InvalidParameter(
            "robot",
            steps.name,
            message(
                "rapid.few_axes",
                "one of at most {most} axes; it has {size}",
                most=_MOST_AXES,
                size=steps.chain.size,
            ),
        )
    names, signals = _Names(), dict[str, dict[int, Any]]()
    lines: list[str] = []
    limited: float | None = None
    for step in steps.steps:
        if isinstance(step, WaitMove):
            lines.append(f"WaitTime {number_text(step.duration)};")
        elif not isinstance(step, TargetMove):
            lines.append(_signal(step, signals))
        else:
            if step.acceleration != limited:
                limited = step.acceleration
                lines.append(_limited(limited))
            lines.append(_move(step, steps, names))
    module = re.sub(r"\W", "_", name)[:32]
    module = module if module[:1].isalpha() else f"M_{module}"[:32]
    body = (
        [f"    {line}" for line in names.lines]
        + ["", "    PROC main()"]
        + [f"        {line}" for line in lines]
    )
    text = "\n".join(
        [f"MODULE {module}", "    ! written by simrob_drake", *body, "    ENDPROC", "ENDMODULE", ""]
    )
    table = {"signals": {name: {"does": does} for name, does in signals.items()}}
    return text, str(yaml.safe_dump(table, sort_keys=False, allow_unicode=True)) if signals else ""


def _limited(acceleration: float | None) -> str:
    if acceleration is None:
        return "PathAccLim FALSE,FALSE;"
    value = number_text(acceleration)
    return rf"PathAccLim TRUE\AccMax:={value},TRUE\DecelMax:={value};"


def _signal(move: AttachMove | ReleaseMove | FingerMove, signals: dict[str, dict[int, Any]]) -> str:
    """Return what sets the output that takes a piece, or lets it go, and note that in the table."""
    value, entry, number = int(isinstance(move, (AttachMove, GripMove))), [move.entry()], 0
    what = "gripper" if isinstance(move, FingerMove) else re.sub(r"[^A-Za-z0-9_]", "_", move.piece)
    while True:
        name = f"do_{what}{number or ''}"
        if signals.setdefault(name, {}).setdefault(value, entry) == entry:
            return f"SetDO {name},{value};"
        number += 1


def _move(leg: TargetMove, steps: ExportedProgram, names: _Names) -> str:
    tool = "tool0"
    if not leg.tool.IsNearlyEqualTo(RigidTransform(), 1e-12):
        tool = names.of("tooldata", "tcp", f"[TRUE,{texted(pose_of(leg.tool))},{_LOAD}]", "PERS")
    if leg.key == "move_abs_j":
        target = names.of("jointtarget", "j", texted(joint_target(leg.posture, steps.units)))
        return f"MoveAbsJ {target},{_speed(leg)},{_zone(leg, names)},{tool};"
    frame, options = steps.base.inverse() @ leg.wobj, f"{tool}"
    if not frame.IsNearlyEqualTo(RigidTransform(), 1e-12):
        wobj = f'[FALSE,TRUE,"",{texted(pose_of(frame))},[[0,0,0],[1,0,0,0]]]'
        options += rf"\WObj:={names.of('wobjdata', 'wobj', wobj, 'PERS')}"
    conf = (
        configuration(steps.chain, leg.posture) if has_configuration(steps.chain) else (0, 0, 0, 0)
    )
    pose = leg.wobj.inverse() @ leg.pose
    target = names.of("robtarget", "p", texted(robtarget_of(pose, conf)))
    if leg.via is not None:
        middle = RigidTransform(pose.rotation(), leg.wobj.inverse() @ np.asarray(leg.via))
        target = f"{names.of('robtarget', 'p', texted(robtarget_of(middle, conf)))},{target}"
    return f"{_WORDS[leg.key]} {target},{_speed(leg)},{_zone(leg, names)},{options};"


def _speed(leg: TargetMove) -> str:
    if leg.speed is None:
        return rf"v100\T:={number_text(leg.time)}"
    speed, turning = 1e3 * leg.speed, np.rad2deg(leg.turn) / leg.time
    if turning <= _TURNING and speed in _SPEEDS:
        return f"v{int(speed)}"
    return f"[{number_text(speed)},{number_text(max(_TURNING, np.ceil(turning)))},5000,1000]"


def _zone(leg: TargetMove, names: _Names) -> str:
    size = 1e3 * leg.zone
    if not size:
        return "fine"
    known = next((zone for zone in _ZONES if abs(max(zone, _SMALLEST) - size) < 1e-9), None)
    if known is not None:
        return f"z{known}"
    half = number_text(1.5 * size)
    return f"[FALSE,{number_text(size)},{half},{half},{number_text(0.15 * size)},{half},{number_text(0.15 * size)}]"


_OUTPUT = 0  # the digital output that grips


def urscript_text(steps: ExportedProgram, name: str) -> str:
    """Return the script of a program: poses in the robot's base as p[x, y, z, rx, ry, rz] [m, rad], axes in rad.

    Moves of axes are written as postures with their times: speeds mean the axes' there, not the tool's. Pieces are
    taken and let go by the first digital output.
    """
    lines, tool = list[str](), None
    for step in steps.steps:
        if isinstance(step, WaitMove):
            lines.append(f"sleep({number_text(step.duration)})")
        elif not isinstance(step, TargetMove):
            lines.append(
                f"set_standard_digital_out({_OUTPUT}, {isinstance(step, (AttachMove, GripMove))}) # {step.caption()}"
            )
        else:
            if tool is None or not tool.IsNearlyEqualTo(step.tool, 1e-12):
                tool = step.tool
                lines.append(f"set_tcp({_pose(tool)})")
            lines.append(_script_move(step, steps))
    function = re.sub(r"\W", "_", name)
    return "\n".join(
        [f"def {function}():", *(f"  {line}" for line in lines), "end", f"{function}()", ""]
    )


def _script_move(leg: TargetMove, steps: ExportedProgram) -> str:
    radius = f", r={number_text(leg.zone)}" if leg.zone else ""
    if leg.key in ("move_abs_j", "move_j"):
        return f"movej([{_row(leg.posture)}], t={number_text(leg.time)}{radius})"
    here, base = leg.pose, steps.base.inverse()
    push = number_text(leg.acceleration or ACCELERATION)
    pace = (
        f"t={number_text(leg.time)}"
        if leg.speed is None
        else f"a={push}, v={number_text(leg.speed)}"
    )
    if leg.via is None:
        return f"movel({_pose(base @ here)}, {pace}{radius})"
    middle = RigidTransform(here.rotation(), leg.via)
    speed = number_text(leg.speed if leg.speed is not None else leg.length / leg.time)
    return f"movec({_pose(base @ middle)}, {_pose(base @ here)}, a={push}, v={speed}{radius})"


def _pose(pose: RigidTransform) -> str:
    turn = pose.rotation().ToAngleAxis()
    return f"p[{_row([*pose.translation(), *(turn.angle() * turn.axis())])}]"


def _row(values: Vector | list[float]) -> str:
    return ", ".join(number_text(value) for value in np.asarray(values))
