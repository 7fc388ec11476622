"""State of a station after moves that are only looked at: no simulation, but fingers close on pieces and carry them.

A run shows where fingers stop and where a piece is then. Without a run, fingers stop where two bodies of their robot
(links, or pieces that it carries) touch a piece that lies free. From then on the piece moves with them, until they
open. The *reference* of a robot is where its axes should be: fingers that a piece stops do not reach theirs.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from pydrake.math import RigidTransform

from simrob_drake.base.frames import Vector, xyz_quaternion_from_transform
from simrob_drake.programs.model import StationModel
from simrob_drake.programs.plan import Plan
from simrob_drake.programs.stateful_station import StatefulStation
from simrob_drake.results.record.state import JointState, State, free_joint

_SUPPORT_DISTANCE = 5e-3
"""Largest distance to what lies below a piece at which the piece counts as put down, not dropped [m]."""
_ROUNDING = 1e-9  # difference of two finger positions that is due to rounding [rad or m]


class Foresight(NamedTuple):
    """Prediction of what moves lead to.

    Attributes:
        state: state of the station at the end of the moves.
        dropped: names of the pieces that fingers released with nothing below them. Where such a piece
            comes to rest is not known.
    """

    state: State
    dropped: frozenset[str]


def foresee(cell: StatefulStation, plans: Sequence[Plan], time: float) -> Foresight:
    """Predict where moves lead, without a simulation.

    All robots stand still at the end, where their references are. Only fingers that hold a piece stay apart
    from their references.

    Args:
        cell: the station, in the state in which the moves begin. Its state is not changed.
        plans: the moves, which run at the same time. Robots without a move stay.
        time: duration of the run [s].
    """
    references = {robot: cell.reference(robot) for robot in cell.config.robots}
    # A run may be shorter than a move: then the robot ends in the middle of it.
    for plan in plans:
        end = min(time, plan.duration)
        references[plan.robot] = plan.postures(np.array([end]))[0]
    at_rest = {robot: np.zeros_like(posture) for robot, posture in references.items()}
    # A station has no state before its first run: then its free pieces are where they begin, and no block has a state.
    before = cell.state or State(references, at_rest, references)
    after = replace(before, positions=references, velocities=at_rest, references=references)

    has_fingers = any(cell.robot(name).model.fingers for name in cell.config.robots)
    # Only fingers and free pieces need the collision model, which takes time to build.
    if not (has_fingers and cell.config.free_pieces):
        return Foresight(after, frozenset())

    model = cell.collision_model
    held_before = dict(model.holders)
    positions = _positions_with_grips(cell, model, plans, references)
    carried = {
        piece for piece, robot in held_before.items() if not _opens(cell, robot, references[robot])
    }
    model.place_robots(references)
    joints = {**before.joints, **_joints_of(model, carried)}
    after = replace(after, positions=positions, joints=joints)

    # A piece that was put down on something stays there. Where a piece without support comes to rest is not known.
    released = held_before.keys() - carried
    dropped = frozenset(piece for piece in released if not _is_supported(cell, after, piece))
    return Foresight(after, dropped)


def _opens(cell: StatefulStation, robot: str, reference: Vector) -> bool:
    """Whether a robot opens a finger: at its reference (n,) [rad or m] one is wider open than it is now.

    It is False for a robot without fingers.
    """
    now = cell.position(robot)
    # Each finger is an axis, here by its index, with the positions in which it is closed and open [rad or m].
    for axis, (closed, opened) in cell.robot(robot).model.fingers.items():
        # The open position of a finger may be the larger or the smaller one.
        direction = np.sign(opened - closed)
        if direction * (reference[axis] - now[axis]) > _ROUNDING:
            return True
    return False


def _positions_with_grips(
    cell: StatefulStation,
    model: StationModel,
    plans: Iterable[Plan],
    references: Mapping[str, Vector],
) -> dict[str, Vector]:
    """Predict the positions of all robots at the end of moves, with fingers where pieces stop them.

    Args:
        cell: the station, in the state in which the moves begin.
        model: collision model of the station in this state. Its robots are placed elsewhere by this function.
        plans: the moves.
        references: references (n,) [rad or m] of all robots at the end of the moves, by name.

    Returns:
        The positions (n,) [rad or m] by robot: the references, except for fingers that a piece stops.
    """
    planned = {plan.robot: plan for plan in plans}
    holding = set(model.holders.values())
    positions = dict(references)
    for robot, reference in references.items():
        fingers = list(cell.robot(robot).model.fingers)
        if not fingers or _opens(cell, robot, reference):
            continue
        # Fingers that hold a piece stay where it stops them. Fingers that close stop at the first piece.
        stopped: Vector | None = (
            None  # posture (n,) in which the fingers stop; None if nothing stops them
        )
        if robot in holding:
            stopped = cell.position(robot)
        elif robot in planned:
            stopped = _grip_posture(model, planned[robot], fingers)
        if stopped is not None:
            posture = reference.copy()
            posture[fingers] = stopped[fingers]
            positions[robot] = posture
    return positions


def _grip_posture(model: StationModel, plan: Plan, fingers: list[int]) -> Vector | None:
    """Find the first posture (n,) [rad or m] of a move in which two bodies of the robot touch a free piece.

    Returns None if the move does not close them on a piece. If the move moves its fingers, the model's robot is left in
    a posture of the move.

    Args:
        model: collision model of the station.
        plan: the move.
        fingers: indices of the axes that are fingers.
    """
    # The move leaves the fingers where they are.
    if np.array_equal(plan.start[fingers], plan.end[fingers]):
        return None
    # `looks` are the times at which a plan is checked, close enough to each other that no contact is missed.
    for posture in plan.postures(plan.looks):
        model.place_robots({plan.robot: posture})
        if plan.robot in model.gripping_robots().values():
            return np.asarray(posture)
    return None


def _joints_of(model: StationModel, pieces: Iterable[str]) -> dict[str, JointState]:
    """State of the joints of free pieces that rest where they are in a model, by the names of the joints."""
    joints = {}
    for piece in pieces:
        pose = model.pose(model.station.free_pieces[piece].body_frame())
        # A state holds the quaternion before the position.
        position = np.roll(xyz_quaternion_from_transform(pose), -3)
        joints[free_joint(piece)] = JointState(position, np.zeros(6))
    return joints


def _is_supported(cell: StatefulStation, state: State, piece: str) -> bool:
    """Whether a free piece has something else than a robot directly below it, within 5 mm.

    Args:
        cell: the station.
        state: state in which the piece lies.
        piece: name of the piece.
    """
    # The model is shared: whoever uses it next places it anew.
    model = cell.collision_model
    model.place_state(state, state.positions.__getitem__, state.references.__getitem__)
    body = model.station.free_pieces[piece]
    # A piece that rests on a table need not overlap with it. It does when it is a little lower.
    lowered = RigidTransform(np.array([0.0, 0.0, -_SUPPORT_DISTANCE])) @ model.pose(
        body.body_frame()
    )
    model.plant.SetFreeBodyPose(model.context, body, lowered)
    model.place(model.plant.GetPositions(model.context))
    # Pairs of names of bodies that touch. A robot below the piece, such as its own fingers, does not support it.
    pairs_with_robots = model.policy.touching(movers=model.robots).keys()
    other_pairs = model.policy.touching().keys() - pairs_with_robots
    return any(piece in bodies for bodies in other_pairs)
