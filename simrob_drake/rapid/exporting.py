"""A program in RAPID: a module with its targets, tools and work objects, and the table of its signals."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import yaml
from pydrake.math import RigidTransform

from simrob_drake.errors import InvalidParameter
from simrob_drake.programs.moves.attach import AttachMove
from simrob_drake.programs.moves.grip import FingerMove, GripMove
from simrob_drake.programs.moves.release import ReleaseMove
from simrob_drake.programs.moves.wait import WaitMove
from simrob_drake.rapid.configuration import configuration, has_configuration
from simrob_drake.rapid.instructions import joint_target
from simrob_drake.rapid.steps import ExportedProgram, TargetMove
from simrob_drake.rapid.values import number_text, pose_of, robtarget_of, texted

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
        """Return the name of data with a value."""
        key = f"{kind} {value}"
        if key not in self.declared:
            self.counts[stem] = self.counts.get(stem, 0) + 1
            number = self.counts[stem] * (10 if stem in ("p", "j") else 1)
            self.declared[key] = f"{stem}{number}"
            self.lines.append(f"{how} {kind} {stem}{number}:={value};")
        return self.declared[key]


def rapid_text(steps: ExportedProgram, name: str) -> tuple[str, str]:
    """Return the module of a program, and the YAML of the table that says what its signals do; empty without any.

    Raises:
        InvalidParameter: a robot with more axes than a target of RAPID has.
    """
    if steps.chain.size > _MOST_AXES:
        raise InvalidParameter("robot", steps.name, f"one of at most {_MOST_AXES} axes; it has {steps.chain.size}")
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
    body = [f"    {line}" for line in names.lines] + ["", "    PROC main()"] + [f"        {line}" for line in lines]
    text = "\n".join([f"MODULE {module}", "    ! written by simrob_drake", *body, "    ENDPROC", "ENDMODULE", ""])
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
    conf = configuration(steps.chain, leg.posture) if has_configuration(steps.chain) else (0, 0, 0, 0)
    pose = leg.wobj.inverse() @ leg.pose
    target = names.of("robtarget", "p", texted(robtarget_of(pose, conf)))
    if leg.via is not None:
        middle = RigidTransform(pose.rotation(), leg.wobj.inverse() @ np.asarray(leg.via))
        target = f"{names.of('robtarget', 'p', texted(robtarget_of(middle, conf)))},{target}"
    return f"{_WORDS[leg.key]} {target},{_speed(leg)},{_zone(leg, names)},{options};"


def _speed(leg: TargetMove) -> str:
    """Return the speed of a move, and its time where that counts."""
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
