"""A program in URScript, the language of Universal Robots."""

from __future__ import annotations

import re

import numpy as np
from pydrake.math import RigidTransform

from simrob_drake.frames import Vector
from simrob_drake.programs.moves.attach import AttachMove
from simrob_drake.programs.moves.grip import GripMove
from simrob_drake.programs.moves.wait import WaitMove
from simrob_drake.programs.timing import ACCELERATION
from simrob_drake.rapid.steps import ExportedProgram, TargetMove
from simrob_drake.rapid.values import number_text

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
            lines.append(_move(step, steps))
    function = re.sub(r"\W", "_", name)
    return "\n".join([f"def {function}():", *(f"  {line}" for line in lines), "end", f"{function}()", ""])


def _move(leg: TargetMove, steps: ExportedProgram) -> str:
    radius = f", r={number_text(leg.zone)}" if leg.zone else ""
    if leg.key in ("move_abs_j", "move_j"):
        return f"movej([{_row(leg.posture)}], t={number_text(leg.time)}{radius})"
    here, base = leg.pose, steps.base.inverse()
    push = number_text(leg.acceleration or ACCELERATION)
    pace = f"t={number_text(leg.time)}" if leg.speed is None else f"a={push}, v={number_text(leg.speed)}"
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
