"""Pieces that slipped out of fingers, as a measure of a run's verdict, and grips that held none.

Fingers *hold* a free piece while two links of their robot touch it. A piece is *lost* if fingers held it, and at the
end of the run they do not, although nothing opened them.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from simrob_drake.base.messages import Message, message
from simrob_drake.parts.station_plant import StationRobot
from simrob_drake.results.record.piece_contacts import ContactSample
from simrob_drake.results.record.run import RecordedRun
from simrob_drake.results.verdict.moves import name_of_move
from simrob_drake.results.verdict.verdict import Measured

_OPENED = 0.01
"""Fingers are opened if their reference moves by at least this share of their range, away from closed."""

_HOLDING_LINKS = 2
"""Count of links of a robot that must touch a piece at the same time to hold it."""


class _Hold(NamedTuple):
    """The last contact sample at which fingers held a piece. Contacts are evaluated at some samples of a run only.

    Attributes:
        sample: index of the sample of the run.
        lost_at: index of the next contact sample, at which they no longer hold it. It is None if they hold the
            piece at the end.
    """

    sample: int
    lost_at: int | None


def measure_lost_piece(run: RecordedRun) -> Measured | None:
    """Measure how far each lost piece is, at the end, from where the fingers held it [m]; 0 if they still hold it.

    Distances are measured in the frame of the gripper. They are 0 for pieces that are released on purpose, too. The
    time of a value is the first evaluated sample at which the fingers no longer hold the piece, or the last evaluated
    one if they hold it to the end. A piece that several grippers held has one value for each.

    Returns:
        the distances, one for each pair of a piece and a gripper that held it, or None if fingers held no free piece.
    """
    grippers = [robot for robot in run.plant.robots.values() if robot.model.fingers]
    if not grippers:
        return None
    pieces = []
    distances = []
    times = []
    for piece, contacts in run.piece_contacts.items():
        for robot in grippers:
            hold = _last_hold(contacts, robot)
            if hold is None:
                continue
            is_lost = hold.lost_at is not None and not _opens_after(run, robot, hold.sample)
            # A piece that is held to the end has the error 0, at the last sample at which its contacts were
            # evaluated. So has a piece that was released on purpose, at the sample after it was held.
            lost_at = hold.sample if hold.lost_at is None else hold.lost_at
            pieces.append(piece)
            distances.append(_distance_in_hand(run, robot, piece, hold.sample) if is_lost else 0.0)
            times.append(run.times[lost_at])
    if not pieces:
        return None
    return Measured(pieces, np.array(distances), np.array(times))


def empty_grips(run: RecordedRun) -> list[Message]:
    """Find the grips that hold no piece at the end of their run, each as a sentence.

    The list is empty for a station without free pieces or without contact, in which fingers cannot hold anything.
    """
    grips = [move for move in run.moves if move.kind == "grip"]
    # Contacts are computed when they are first used, which takes time: only for runs with a grip.
    if not grips or not run.piece_contacts:
        return []
    notes = []
    for move in grips:
        robot = run.plant.robots[move.robot]
        last_contacts = [contacts[-1:] for contacts in run.piece_contacts.values()]
        if any(_last_hold(contacts, robot) is not None for contacts in last_contacts):
            continue
        notes.append(
            message(
                "results.empty_grip",
                "{move}: the fingers hold no piece at its end",
                move=name_of_move(run, move),
            )
        )
    return notes


def _last_hold(contacts: Sequence[ContactSample], robot: StationRobot) -> _Hold | None:
    """Find the last time at which at least two links of a robot touched a piece. Returns None if they never did.

    Args:
        contacts: contacts of the piece, in the order of time.
        robot: a robot with fingers.
    """
    # Any two links of the robot: a finger and the palm hold a piece as well as two fingers do.
    links = {f"{robot.prefix}{link}" for link in robot.model.links}
    lost_at: int | None = None
    # From the end, since only the last hold counts: a piece that is put down and grasped again is not lost.
    for contact in reversed(contacts):
        if len(links & contact.partners) >= _HOLDING_LINKS:
            return _Hold(contact.sample, lost_at)
        lost_at = contact.sample
    return None


def _opens_after(run: RecordedRun, robot: StationRobot, sample: int) -> bool:
    """Whether the reference of a finger opens after a sample, so that a piece is released on purpose.

    Args:
        run: the run.
        robot: the robot with the fingers.
        sample: index of the last sample of the run at which the piece is held.
    """
    references = run.axes("q_ref", robot.name)[sample:]  # shape (samples, axes) [rad or m]
    # Fingers by the index of their axis, each with the positions at which it is closed and open.
    for axis, (closed, opened) in robot.model.fingers.items():
        # The reference counts, not the position: a large piece keeps the fingers open, whatever is asked of
        # them.
        openness = (references[:, axis] - closed) / (opened - closed)  # 0 closed, 1 open
        if openness.max() - openness[0] > _OPENED:
            return True
    return False


def _distance_in_hand(run: RecordedRun, robot: StationRobot, piece: str, sample: int) -> float:
    """Distance by which a piece moved in the frame of the gripper from a sample to the end of the run [m].

    Args:
        run: the run.
        robot: the robot with the gripper.
        piece: name of the piece.
        sample: index of the sample.
    """
    plant = run.plant.plant
    context = plant.CreateDefaultContext()
    first_finger = next(iter(robot.model.fingers))
    # The link that carries the fingers, since the fingers themselves move when the piece slips.
    palm = robot.joints[first_finger].parent_body().body_frame()
    piece_frame = run.plant.free_pieces[piece].body_frame()
    places = []
    for positions in run.positions_at(np.array([run.times[sample], run.times[-1]])):
        plant.SetPositions(context, positions)
        places.append(plant.CalcRelativeTransform(context, palm, piece_frame).translation())
    return float(np.linalg.norm(places[1] - places[0]))
