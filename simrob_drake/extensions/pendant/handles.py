"""What of a station a hand in the view can take hold of, and the posture that follows from where it is put.

All that goes in and out is plain data, as it crosses from process to process: poses that are told are matrices, column
by column; those that are asked for [x y z Rz Ry Rx] in m and degrees, all in the world.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.tree import Frame, RevoluteJoint, RigidBody

from simrob_drake.base.errors import one_of
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import message
from simrob_drake.extensions.pendant.arm_questions import posed
from simrob_drake.extensions.pendant.describe import kind_of
from simrob_drake.kinematics.chain import axes_and_points
from simrob_drake.kinematics.numeric import fit_postures
from simrob_drake.parts.resolved import WORLD
from simrob_drake.parts.station_plant import StationRobot
from simrob_drake.programs.arm import Workcell
from simrob_drake.programs.model import StationModel
from simrob_drake.programs.moves.joints import targets_on
from simrob_drake.results.animation.drawn import SHOWN

_LIMB = 3  # axes from the root, or more: what fewer move is turned by its links
_LEVER = 0.3  # m that a radian counts for
_LET = 1e-4  # of what a limb is not asked for, beside what it is: it counts where both can be
_BENT = 0.1  # rad or m
_NEAR = 1e-8  # m² that the square of a radian counts for: of postures that reach a pose the nearest is taken
_CLOSE, _STEPS = np.array([1e-6, 1e-6]), 100

NO_HANDLES: dict[str, Any] = {"type": "handles", "handles": {}, "links": {}}
"""Command for a view in which nothing can be taken."""


def handles(
    cell: Workcell, robot: str, targets: Mapping[str, Mapping[str, Any]], near: Mapping[str, float]
) -> dict[str, Any]:
    """Return what can be taken: the tool of an arm, limbs, pieces that stand in the world, targets; and links.

    Args:
        cell: the station, as it stands.
        robot: which one is taught; empty without any.
        targets: that were taught, ``{pose, frame}`` by name.
        near: axes that are to be elsewhere [deg or m].

    Returns:
        ``{handles: {kind:name: {pose, path}}, links: {path: {axis, point, along, turns, value, low, high}}}``, with the
        path in the view of the body that a handle is of, of each link the axis that moves it, where that is and which
        way it turns or goes, and its position and limits [deg or m], None without.
    """
    model = _posed(cell, robot, near)
    found = {
        f"piece:{name}": {
            "pose": _matrix(model.pose(model.piece_origin(name))),
            "path": _path(model.piece_origin(name).body()),
        }
        for name, piece in cell.config.pieces.items()
        if piece.parent in (None, WORLD)
    }
    own = model.robots.get(robot)
    kind = kind_of(own) if own is not None else ""
    if own is None or kind == "other":
        return {"handles": found, "links": {}}
    moved = _moved(own)
    if kind == "arm":
        arm = cell.arm(robot)
        found["tool:"] = {"pose": _matrix(arm.frame(arm))}
        for name, target in targets.items():
            found[f"target:{name}"] = {
                "pose": _matrix(arm.frame(target["frame"]) @ posed(target["pose"], "target"))
            }
    else:
        for name, (frame, end) in _limbs(own, moved).items():
            found[f"limb:{name}"] = {"pose": _matrix(model.pose(frame) @ end)}
    return {
        "handles": found,
        "links": _links(model, own, moved, _posture(own, cell.position(robot), near)),
    }


def reached(
    cell: Workcell,
    robot: str,
    limb: str,
    pose: Sequence[float],
    near: Mapping[str, float],
    *,
    turned: bool,
) -> dict[str, float]:
    """Return the axes [deg or m] that bring the end of a limb as near to a pose as they can, the root staying.

    The limb is a tool, or the link at its end. Some axes are to be ``near`` where they are not [deg or m]. Where place
    and rotation cannot both be the place counts, and the rotation if it is ``turned``.
    """
    model = _posed(cell, robot, near)
    own = model.robots[robot]
    limbs = _limbs(own, _moved(own))
    frame, end = limbs[one_of(message("pendant.limb", "limb"), limb, limbs)]
    chain = model.chain(robot, frame, own.root).with_tool(end.GetAsMatrix4())
    target = model.pose(own.root).inverse() @ posed(pose, "pose")
    place, turn = (_LET, 1.0) if turned else (1.0, _LET)
    start = _posture(own, cell.position(robot), near)
    # one that is stretched has no way to begin with
    starts = start + _BENT * np.array([0.0, 1.0, -1.0])[:, np.newaxis]
    found = fit_postures(
        chain,
        np.tile(target.GetAsMatrix4(), (len(starts), 1, 1)),
        starts,
        weights=np.repeat([place, turn * _LEVER**2], 3),
        tolerance=_CLOSE,
        iterations=_STEPS,
    )
    best = (found.costs + _NEAR * ((found.postures - start) ** 2).sum(axis=1)).argmin()
    values = (found.postures[best] / own.model.user_units).tolist()
    # No motor brings a passive axis to a target, unless the motion itself is the input.
    has_target = ~own.gains.passive | (not cell.config.engine.moves_by_forces)
    return {own.axes[axis]: values[axis] for axis in chain.order if has_target[axis]}


def _posed(cell: Workcell, robot: str, near: Mapping[str, float]) -> StationModel:
    model = cell.model
    if near:
        model.place_robots({robot: _posture(model.robots[robot], cell.position(robot), near)})
    return model


def _posture(own: StationRobot, position: Vector, near: Mapping[str, float]) -> Vector:
    for place, value in (targets_on(own.model, near, "near") if near else {}).items():
        position[place] = value
    return position


def _moved(own: StationRobot) -> dict[str, list[int]]:
    """Return which axes move each link of a robot that any does, from its root outward."""
    plant = own.plant
    beyond = [{*plant.GetBodiesKinematicallyAffectedBy([joint.index()])} for joint in own.joints]
    outward = sorted(range(len(beyond)), key=lambda axis: -len(beyond[axis]))
    bodies = [plant.get_body(index) for index in plant.GetBodyIndices(own.instance)]
    axes = {
        body.name(): [axis for axis in outward if body.index() in beyond[axis]] for body in bodies
    }
    return {link: found for link, found in axes.items() if found}


def _limbs(
    own: StationRobot, moved: Mapping[str, Sequence[int]]
) -> dict[str, tuple[Frame, RigidTransform]]:
    """Return the frames at the ends of limbs, and where in them those are: tools, else links on which nothing hangs."""
    found, covered = dict[str, tuple[Frame, RigidTransform]](), list[set[int]]()
    for tool, name in own.model.tools.items():
        frame = own.plant.GetFrameByName(name, own.instance)
        reach = {*moved.get(frame.body().name(), ())}
        if len(reach) >= _LIMB and reach not in covered:  # else another tool of the same limb
            found[tool] = frame, RigidTransform()
            covered.append(reach)
    feet = own.model.feet.kind(None) if own.model.feet else None
    for link, axes in moved.items():
        beyond = (*covered, *({*others} for others in moved.values() if len(others) > len(axes)))
        if len(axes) >= _LIMB and not any({*axes} <= others for others in beyond):
            end = (
                feet.support_points(link).mean(axis=0)
                if feet and link in feet.links
                else np.zeros(3)
            )
            found[link] = (
                own.plant.GetBodyByName(link, own.instance).body_frame(),
                RigidTransform(end),
            )
            covered.append({*axes})
    return found


def _links(
    model: StationModel, own: StationRobot, moved: Mapping[str, Sequence[int]], posture: Vector
) -> dict[str, dict[str, Any]]:
    root, units = model.pose(own.root), own.model.user_units
    along, points = axes_and_points(model.context, own.joints, own.root)
    values, low, high = (position / units for position in (posture, *own.model.axis_limits))

    def described(axis: int) -> dict[str, Any]:
        return {
            "axis": own.axes[axis],
            "point": (root @ points[axis]).tolist(),
            "along": (root.rotation() @ (own.axis_map.signs[axis] * along[axis])).tolist(),
            "turns": isinstance(own.joints[axis], RevoluteJoint),
            "value": float(values[axis]),
            "low": float(low[axis]) if np.isfinite(low[axis]) else None,
            "high": float(high[axis]) if np.isfinite(high[axis]) else None,
        }

    return {
        _path(model.plant.GetBodyByName(link, own.instance)): described(axes[-1])
        for link, axes in moved.items()
    }


def _path(body: RigidBody) -> str:
    """Return where a body hangs in the view."""
    return f"{SHOWN}/{body.scoped_name().get_full().replace('::', '/')}"


def _matrix(pose: RigidTransform) -> list[float]:
    columns: list[float] = np.round(pose.GetAsMatrix4(), 7).ravel(order="F").tolist()
    return columns
