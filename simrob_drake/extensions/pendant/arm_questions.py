"""What the pendant asks about an arm: where its tool is, where a jog leads, and what each branch of a pose means.

All that goes in and out is plain data, as it crosses from process to process: positions of axes in degrees (metres of
prismatic ones) by name, poses [x y z Rz Ry Rx] in m and degrees.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix

from simrob_drake.base.errors import InvalidParameter, quote_value
from simrob_drake.base.frames import Vector, as_transform, finite, pose_from_transform
from simrob_drake.base.messages import message
from simrob_drake.parts.resolved import WORLD
from simrob_drake.programs.arm import Arm, Workcell
from simrob_drake.programs.branches import Branch
from simrob_drake.programs.moves.joints import targets_on
from simrob_drake.stations.coupled_references import with_partners

BASE, TOOL = (
    "base",
    "tool",
)  # frames of every arm: of its foot, and of its tool centre point where its reference has it

_UNITS = np.repeat([1.0, np.deg2rad(1.0)], 3)
_EASY = 2.0  # times slower than the joints can
_TICK = 0.05  # s


def frames(arm: Arm) -> list[str]:
    """Return the frames that a tool can be jogged in: base, tool, world, and what stands around with its frames."""
    pieces = arm.cell.model.resolved.pieces
    around = [
        name
        for piece in pieces.values()
        if piece.carrier != arm.name
        for name in (
            piece.name,
            *(f"{piece.name}.{frame}" for frame in list(piece.model.frame_poses)[1:]),
        )
    ]
    return [
        BASE,
        TOOL,
        WORLD,
        *around,
        *(robot for robot in arm.cell.config.robots if robot != arm.name),
    ]


def where(arm: Arm, frame: str = BASE) -> dict[str, Any]:
    """Return what a page shows of an arm at rest, all as its reference has it.

    ``{axes, pose, base_pose, off, tool, tools, frames, carried, around}``: positions [deg or m] by axis, the tool's
    pose in the frame and in the base, how far the tool itself is from there ``[m, deg]``, which tool that is and which
    there are, :func:`frames`, and the pieces that the arm carries and those that it does not.
    """
    robot, pieces = arm.cell.robot(arm.name), arm.cell.model.resolved.pieces.values()
    return {
        "axes": _by_axis(arm, arm.reference),
        "pose": tool_pose(arm, frame),
        "base_pose": tool_pose(arm),
        "off": _off(arm),
        "tool": robot.tcp,
        "tools": arm.tools,
        "frames": frames(arm),
        "carried": [piece.name for piece in pieces if piece.carrier == arm.name],
        "around": [piece.name for piece in pieces if piece.carrier != arm.name],
    }


def _off(arm: Arm) -> list[float]:
    """Return how far the tool is from where the reference has it [m], and how much it is turned from there [deg]."""
    error = _tool(arm).inverse() @ arm.tool_pose()
    return [
        float(np.linalg.norm(error.translation())),
        float(np.degrees(error.rotation().ToAngleAxis().angle())),
    ]


def tool_pose(arm: Arm, frame: str = BASE) -> list[float]:
    """Return the pose in a frame that the arm's reference gives its tool [m, deg]; measured ones are signals."""
    return _pose_values(_frame(arm, frame).inverse() @ _tool(arm))


def jogged(
    arm: Arm, delta: Sequence[float], frame: str = BASE, start: Sequence[float] | None = None
) -> list[float]:
    """Return the pose in the base after a jog by [x y z Rz Ry Rx] [m, deg] along a frame's axes, about the tool itself.

    ``start`` is the pose in the base that it counts from, as the middle of sliders is; where the arm's reference has it
    unless given.
    """
    base = _frame(arm, BASE)
    begin, by = _tool(arm) if start is None else base @ posed(start, "start"), posed(delta, "delta")
    axes = begin.rotation() if frame == TOOL else _frame(arm, frame).rotation()
    turn: RotationMatrix = axes @ by.rotation() @ axes.inverse() @ begin.rotation()
    return _pose_values(
        base.inverse() @ RigidTransform(turn, begin.translation() + axes @ by.translation())
    )


def jogged_axes(arm: Arm, **how: Any) -> dict[str, float]:
    """Return the axes for the pose that :func:`jogged` gives."""
    return inverse(arm, jogged(arm, **how))


def inverse(arm: Arm, pose: Sequence[float], frame: str = BASE) -> dict[str, float]:
    """Return the posture nearest to the arm's reference for a pose in a frame; raises Unreachable: why."""
    target = _frame(arm, frame) @ posed(pose, "pose")
    return _by_axis(arm, arm.joint(target, start=arm.reference))


def retaught(
    arm: Arm, pose: Sequence[float], frame: str, tool: str, axes: Mapping[str, float]
) -> dict[str, dict[str, float] | list[float]]:
    """Return the axes near others, and the pose in a frame, of a target whose tool is put to a pose in the world.

    Raises Unreachable: tells why, and how near the best posture comes.
    """
    arm, goal = _using(arm, tool), posed(pose, "pose")
    start = np.array([axes[axis] for axis in arm.axes]) * arm.cell.robot(arm.name).model.user_units
    return {
        "axes": _by_axis(arm, arm.joint(goal, start=start)),
        "pose": _pose_values(_frame(arm, frame).inverse() @ goal),
    }


def jog_move(
    arm: Arm, targets_deg: Mapping[str, float], duration: float | None = None
) -> dict[str, Any]:
    """Return the move that brings axes by name or alias to targets, as a program's file has it.

    Axes that are coupled to these move with them; others stay.

    It takes a time [s], unless given half as fast as the joints can. Raises JointLimitExceeded, UnknownName: what would
    do.
    """
    posture, model = arm.reference, arm.cell.robot(arm.name).model
    targets = targets_on(model, targets_deg, message("pendant.the_jog", "the jog"))
    for place, position in targets.items():
        posture[place] = position
    posture = with_partners(arm.cell.model.resolved, arm.name, posture, targets)
    time = _EASY * arm.plan.move_abs_j(posture, points=1).duration if duration is None else duration
    move = {
        "targets": posture.tolist(),
        "duration": float(max(1, np.ceil(time / _TICK - 1e-9)) * _TICK),
    }
    return {"move_abs_j": move if arm.cell.config.only_robot else {**move, "robot": arm.name}}


def branches(
    arm: Arm, pose: Sequence[float] | None = None, frame: str = BASE, tool: str = ""
) -> list[dict[str, Any]]:
    """Return every posture that brings a tool, the one in use unless named, to a pose; without a pose, where it is now.

    Usable ones come first. Each is ``{axes, torque, limit, load, room, gap, collision, usable}``: positions [deg or m],
    what holds them and the limits of that [N·m or N], by axis; ``load`` ``{share, axis}`` of a limit; ``room`` ``{left,
    unit, axis}`` to a joint's; ``gap`` ``{distance, between: [what, what]}`` to what is nearest [m], or None with
    nothing around; what would be in what; and whether the arm can stand so.
    """
    arm = _using(arm, tool)
    target = _tool(arm) if pose is None else _frame(arm, frame) @ posed(pose, "pose")
    return [_meaning(arm, branch) for branch in arm.branches(target, start=arm.reference)]


def _meaning(arm: Arm, branch: Branch) -> dict[str, Any]:
    robot = arm.cell.robot(arm.name)
    units, limits = (
        dict(zip(arm.axes, robot.model.unit_names, strict=True)),
        robot.gains.torque_limit,
    )
    near = branch.room.axis
    between = [branch.gap.body, branch.gap.other]
    return {
        "axes": _by_axis(arm, branch.posture),
        "torque": dict(zip(arm.axes, branch.torque.tolist(), strict=True)),
        "limit": dict(zip(arm.axes, limits.tolist(), strict=True)),
        "load": {"share": branch.load.value, "axis": branch.load.axis},
        "room": {
            "left": branch.room.value / robot.model.user_units[arm.axes.index(near)].item(),
            "unit": units[near],
            "axis": near,
        },
        "gap": {"distance": branch.gap.distance, "between": between} if all(between) else None,
        "collision": branch.collision,
        "usable": branch.usable,
    }


def _using(arm: Arm, tool: str) -> Arm:
    """Return the arm with a tool, in a station of its own unless it has that already."""
    if tool in ("", arm.cell.robot(arm.name).tcp):
        return arm
    cell = Workcell(arm.cell.config)
    cell.state = arm.cell.state
    return cell.arm(arm.name, tool)


def _tool(arm: Arm) -> RigidTransform:
    """Return where the reference has the tool, in the world."""
    return arm.frame(arm)


def _frame(arm: Arm, name: str) -> RigidTransform:
    if name == TOOL:
        return _tool(arm)
    return arm.cell.robot(arm.name).base if name == BASE else arm.frame(name)


def _by_axis(arm: Arm, posture: Vector) -> dict[str, float]:
    values = posture / arm.cell.robot(arm.name).model.user_units + 0.0  # no -0
    return dict(zip(arm.axes, values.tolist(), strict=True))


def posed(values: Sequence[float], name: str) -> RigidTransform:
    """Return the pose that six values are; raises InvalidParameter: they are none."""
    found = finite(values)
    if found.shape != _UNITS.shape:
        raise InvalidParameter(
            name,
            quote_value(values),
            message(
                "pendant.six_numbers_of_pose",
                "six finite numbers [x y z Rz Ry Rx] in m and degrees",
            ),
        )
    return as_transform(found * _UNITS)


def _pose_values(pose: RigidTransform) -> list[float]:
    values: list[float] = (pose_from_transform(pose) / _UNITS + 0.0).tolist()
    return values
