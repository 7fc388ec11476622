"""Verdicts on the moves of a run: each recorded move is compared with the move that was planned.

A *move* is a motion of an arm's tool that a program asks for, such as ``move_l`` (along a straight line). The *tool* is
the frame of the robot's tool centre point.
"""

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from simrob_drake.blocks.servo import AT_LIMIT
from simrob_drake.results.record.torques import torque_shares
from simrob_drake.results.verdict.verdict import in_words

if TYPE_CHECKING:
    from simrob_drake.results.record.run import Approach, AskedMove, RecordedRun
    from simrob_drake.stations.solver_config import VerdictConfig

_DISTANCE_SAMPLES = 41  # count of times during a move at which distances are computed, since this is slow
_ROUNDING = 1e-6  # times that differ by at most this are equal [s]


@dataclass(frozen=True)
class MoveVerdict:
    """Comparison of a recorded move with the planned move.

    Attributes:
        move: what the move is called, such as ``move 3 (move_l)``.
        robot: name of the robot that moves.
        begin: when the move began, in simulated time [s].
        end: when it ended or was stopped [s].
        reached: whether the move was completed, and ended near enough to its target.
        position_error: distance of the tool from its target at the end [m].
        orientation_error: angle between the orientation of the tool and its target at the end [rad].
        following_error: largest distance of the tool from its planned position at the same time [m].
        torque_time: for how long an axis was at its torque limit; the largest time of all axes [s].
        speed: largest speed of the tool [m/s].
        asked_speed: speed of the tool that was asked for [m/s]; None if none was.
        distance: smallest distance between the robot, with what it carries, and any other body [m]. Bodies that touched
            at the start, or keep their distance, do not count. It is negative if the bodies overlap, and None if there
            is no other body.
        nearest: names of these two bodies.
        own_distance: smallest distance between two bodies of the robot, with what it carries [m]. It is negative if
            the bodies overlap, and None if no two bodies of the robot can collide.
        own_nearest: names of these two bodies.
        warnings: a sentence for each value that violates its bound.
    """

    move: str
    robot: str
    begin: float
    end: float
    reached: bool
    position_error: float
    orientation_error: float
    following_error: float
    torque_time: float
    speed: float
    asked_speed: float | None
    distance: float | None
    nearest: str
    own_distance: float | None = None
    own_nearest: str = ""
    warnings: tuple[str, ...] = ()

    def later(self, begin: float) -> "MoveVerdict":
        """Shift the times of the move, as part of a run that begins at a later time [s]."""
        return replace(self, begin=self.begin + begin, end=self.end + begin)

    def summary(self) -> dict[str, Any]:
        """Content for ``summary.json``: all attributes but the warnings, which the verdict lists."""
        content = asdict(self)
        del content["warnings"]
        return content


def judge_move(run: "RecordedRun", asked: "AskedMove") -> MoveVerdict:
    """Compare a recorded move with the planned move: its end, path, speed, torque and distances.

    Args:
        run: a run that begins with the move.
        asked: the planned move.
    """
    # Samples of the run up to the end of the move, or of the run if that ended first.
    last = min(int(np.searchsorted(run.times, asked.duration - _ROUNDING)), len(run.times) - 1)
    rows = slice(0, last + 1)
    times = run.times[rows]
    tool_poses = asked.tool(run.axes("q", asked.robot)[rows])  # (m, 4, 4)
    planned_poses = asked.tool(run.axes("q_ref", asked.robot)[rows])
    target = asked.tool(asked.end[np.newaxis])[0]
    positions = tool_poses[:, :3, 3]
    planned_positions = planned_poses[:, :3, 3]

    position_error = float(np.linalg.norm(positions[-1] - target[:3, 3]))
    # The angle of the rotation between both orientations of the tool: its trace is 1 + 2 cos(angle).
    rotation = tool_poses[-1, :3, :3].T @ target[:3, :3]
    cosine = (np.trace(rotation) - 1) / 2
    velocities = np.gradient(positions, times, axis=0) if last else np.zeros((1, 3))
    speeds = np.linalg.norm(velocities, axis=1)
    is_at_limit = torque_shares(run, run.plant.robots[asked.robot])[rows] > AT_LIMIT
    distance_times = np.linspace(0.0, times[-1], _DISTANCE_SAMPLES)
    approaches = asked.approaches(run.positions_at(distance_times))

    is_stopped = run.stop_time < asked.duration - _ROUNDING
    bound = run.config.verdict.move_end
    is_near_target = bound == "none" or position_error <= bound
    owner = f" of {asked.robot}" if len(run.plant.robots) > 1 else ""
    verdict = MoveVerdict(
        move=f"{asked.place} ({asked.kind or 'move'}{owner})",
        robot=asked.robot,
        begin=0.0,
        end=min(asked.duration, run.stop_time),
        reached=is_near_target and not is_stopped,
        position_error=position_error,
        orientation_error=float(np.arccos(np.clip(cosine, -1.0, 1.0))),
        following_error=float(np.linalg.norm(positions - planned_positions, axis=1).max()),
        torque_time=float(is_at_limit.mean(axis=0).max() * times[-1]),
        speed=float(speeds.max()),
        asked_speed=asked.speed,
        distance=_finite_distance(approaches.to_others),
        nearest=approaches.to_others.bodies,
        own_distance=_finite_distance(approaches.to_itself),
        own_nearest=approaches.to_itself.bodies,
    )
    warnings = _warnings(verdict, run.config.verdict, is_stopped=is_stopped)
    return replace(verdict, warnings=tuple(warnings))


def _warnings(verdict: MoveVerdict, bounds: "VerdictConfig", *, is_stopped: bool) -> Iterator[str]:
    """Yield a sentence for each value of a move that violates its bound.

    Args:
        verdict: the values of the move.
        bounds: the bounds; ``none`` if there is no bound.
        is_stopped: whether the run ended before the move did. The final position and the speed of such a move are not
            judged.
    """
    name = verdict.move
    if bounds.move_end != "none" and verdict.position_error > bounds.move_end and not is_stopped:
        text = f"{name} ends {in_words(verdict.position_error, 'm')} beside its target"
        yield f"{text} (bound {in_words(bounds.move_end, 'm')})"
    if bounds.move_following != "none" and verdict.following_error > bounds.move_following:
        text = f"{name} was {in_words(verdict.following_error, 'm')} off its way"
        yield f"{text} (bound {in_words(bounds.move_following, 'm')})"
    if bounds.move_speed != "none" and verdict.asked_speed is not None and not is_stopped:
        share = verdict.speed / verdict.asked_speed
        if share < bounds.move_speed:
            text = f"{name} reaches {verdict.speed:.3g} of {verdict.asked_speed:.3g} m/s"
            yield f"{text} (bound {in_words(bounds.move_speed, '1')})"
    if bounds.move_distance != "none" and verdict.distance is not None and verdict.distance < bounds.move_distance:
        text = f"{name} comes within {in_words(verdict.distance, 'm')}, {verdict.nearest}"
        yield f"{text} (bound {in_words(bounds.move_distance, 'm')})"


def _finite_distance(approach: "Approach") -> float | None:
    """Smallest distance [m], or None if no pair of bodies was measured."""
    # The distance is infinite then, which files for JSON cannot contain.
    return approach.distance if np.isfinite(approach.distance) else None


def table_of_moves(moves: Sequence[MoveVerdict]) -> list[list[str]]:
    """Rows of the table of moves: the headings, then one row for each move, with values in the units for users."""
    headings = ["move", "end [s]", "reached", "beside", "following", "at torque limit"]
    table = [[*headings, "speed of asked", "nearest", "to itself"]]
    for move in moves:
        speed = f"{move.speed:.3g}"
        if move.asked_speed is not None:
            speed += f" of {move.asked_speed:.3g}"
        row = [
            move.move,
            f"{move.end:.2f}",
            "yes" if move.reached else "no",
            f"{1e3 * move.position_error:.1f} mm",
            f"{1e3 * move.following_error:.1f} mm",
            f"{move.torque_time:.2f} s",
            f"{speed} m/s",
            _in_table(move.distance, move.nearest),
            _in_table(move.own_distance, move.own_nearest),
        ]
        table.append(row)
    return table


def _in_table(distance: float | None, bodies: str) -> str:
    """Format a smallest distance [m] and its two bodies for the table.

    Returns an empty string if the distance is None.
    """
    return "" if distance is None else f"{1e3 * distance:z.0f} mm {bodies}"
