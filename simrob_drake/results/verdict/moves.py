"""Verdicts on the moves of a run: each recorded move is compared with the move that was planned.

A *move* is a motion of an arm's tool that a program asks for, such as ``move_l`` (along a straight line). The *tool* is
the frame of the robot's tool centre point.
"""

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from simrob_drake.base.messages import Message, compound, message
from simrob_drake.base.remarks import Remark, Remedy
from simrob_drake.blocks.servo import AT_LIMIT
from simrob_drake.results.record.torques import torque_shares
from simrob_drake.results.verdict.remedies import sag_or_saturation
from simrob_drake.results.verdict.severity import VIOLATION
from simrob_drake.results.verdict.verdict import MeasuredValue
from simrob_drake.results.verdict.words import in_words

if TYPE_CHECKING:
    from simrob_drake.results.record.run import Approach, AskedMove, RecordedRun

_DISTANCE_SAMPLES = 41
"""Count of times during a move at which distances are computed. It is small, since this is slow."""

_HEADINGS = (
    message("results.heading_move", "move"),
    message("results.heading_end", "end\n[s]"),
    message("results.heading_reached", "reached"),
    message("results.heading_off_target", "off target\n[mm]"),
    message("results.heading_off_path", "off path\n[mm]"),
    message("results.heading_tool_speed", "speed\n[m/s]"),
    message("results.heading_nearest", "nearest\n[mm]"),
    message("results.heading_itself", "itself\n[mm]"),
)
"""Headings of the table of moves. ``nearest`` and ``itself`` are distances to other bodies and to the robot's own."""

_ROUNDING = 1e-6
"""Times that differ by at most this are equal [s]."""


@dataclass(frozen=True)
class MoveVerdict:
    """Comparison of a recorded move with the planned move.

    Attributes:
        move: what the move is called, such as ``move 3 (move_l)``.
        robot: name of the robot that moves.
        begin: when the move began [s]: 0 in the verdict on its own run; in that on a program, the time of the program.
        end: when it ended or was stopped, in the same time [s].
        reached: whether the move was completed, and ended near enough to its target.
        position_error: distance of the tool from its target at the end [m].
        orientation_error: angle between the orientation of the tool and its target at the end [rad].
        following_error: largest distance of the tool from its planned position at the same time [m].
        torque_time: for how long an axis was at its torque limit; the largest time of all axes [s].
        speed: largest speed of the tool [m/s].
        asked_speed: speed of the tool that was asked for [m/s]; None if none was.
        distance: smallest distance between the robot, with what it carries, and any other body [m]. Bodies that touched
            at the start, or whose distance the move does not change, do not count, nor does a finger with the piece
            that it holds. It is negative if the bodies overlap, and None if no distance counts.
        nearest: names of these two bodies.
        own_distance: smallest distance between two bodies of the robot, with what it carries [m]. The exceptions are
            those of ``distance``.
        own_nearest: names of these two bodies.
        misses_target: whether the move was completed, and ended too far from its target.
        remarks: a remark for each value that violates its bound.
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
    misses_target: bool = False
    remarks: tuple[Remark, ...] = ()

    @property
    def warnings(self) -> tuple[str, ...]:
        """A sentence for each value that violates its bound."""
        return tuple(remark.text for remark in self.remarks)

    def later(self, begin: float) -> "MoveVerdict":
        """Copy the verdict, with times of the whole program instead of those of the move's run.

        Args:
            begin: time of the program at which the run began [s].
        """
        return replace(self, begin=self.begin + begin, end=self.end + begin)

    def summary(self) -> dict[str, Any]:
        """Content for ``summary.json``: all attributes but the remarks, which the verdict lists."""
        content = asdict(replace(self, remarks=()))
        del content["remarks"]
        return content


def name_of_move(run: "RecordedRun", asked: "AskedMove") -> Message:
    """Name of a move in texts, such as ``move 3 (move_l)``; with its robot if the station has several."""
    kind = asked.kind or "move"
    if len(run.plant.robots) > 1:
        return message(
            "results.move_of_robot",
            "{place} ({kind} of {robot})",
            place=asked.place,
            kind=kind,
            robot=asked.robot,
        )
    return compound("{place} ({kind})", place=asked.place, kind=kind)


def judge_move(run: "RecordedRun", asked: "AskedMove") -> MoveVerdict:
    """Compare a recorded move with the planned move: its end, path, speed, torque and distances.

    Errors at the end are those at the end of the move, or of the run if that ended first.

    Args:
        run: a run that begins with the move, at the time zero. It may last longer than the move.
        asked: the planned move. If its run was pickled, it has a verdict, which is returned.
    """
    if asked.verdict is not None:
        known: MoveVerdict = asked.verdict
        return known
    # Samples of the run up to the end of the move, or of the run if that ended first.
    last = min(int(np.searchsorted(run.times, asked.duration - _ROUNDING)), len(run.times) - 1)
    rows = slice(0, last + 1)
    times = run.times[rows]
    postures = run.axes("q", asked.robot)[rows]
    planned_postures = run.axes("q_ref", asked.robot)[rows]
    end_posture = asked.end
    passive = run.plant.robots[asked.robot].gains.passive
    if passive.any():
        # No servo brings a passive axis anywhere: targets and path are judged for passive axes where they really were.
        planned_postures = np.where(passive, postures, planned_postures)
        end_posture = np.where(passive, postures[-1], end_posture)
    tool_poses = asked.tool(postures)  # (m, 4, 4)
    planned_poses = asked.tool(planned_postures)
    # The pose of the planned posture, so that the errors of the servos are measured and not those of the
    # inverse kinematics, which planning has checked. `tool` takes several postures; this is one.
    target = asked.tool(end_posture[np.newaxis])[0]
    positions = tool_poses[:, :3, 3]
    planned_positions = planned_poses[:, :3, 3]

    position_error = float(np.linalg.norm(positions[-1] - target[:3, 3]))
    # The angle of the rotation between both orientations of the tool: its trace is 1 + 2 cos(angle).
    rotation = tool_poses[-1, :3, :3].T @ target[:3, :3]
    cosine = (np.trace(rotation) - 1) / 2
    # A derivative needs two samples. A run that ended at its start has one: index 0.
    velocities = np.gradient(positions, times, axis=0) if last else np.zeros((1, 3))
    speeds = np.linalg.norm(velocities, axis=1)
    is_at_limit = torque_shares(run, run.plant.robots[asked.robot])[rows] > AT_LIMIT
    distance_times = np.linspace(0.0, times[-1], _DISTANCE_SAMPLES)
    approaches = asked.approaches(run.positions_at(distance_times), distance_times)

    is_stopped = run.stop_time < asked.duration - _ROUNDING
    bound = run.config.verdict.move_end
    is_near_target = bound == "none" or position_error <= bound
    verdict = MoveVerdict(
        move=name_of_move(run, asked),
        robot=asked.robot,
        begin=0.0,
        end=min(asked.duration, run.stop_time),
        reached=is_near_target and not is_stopped,
        position_error=position_error,
        # Rounding may bring the cosine of equal orientations beyond 1.
        orientation_error=float(np.arccos(np.clip(cosine, -1.0, 1.0))),
        # Compared at the same times: a tool that is late on the right path has an error, too.
        following_error=float(np.linalg.norm(positions - planned_positions, axis=1).max()),
        # Samples are evenly spaced, so the share of the samples is the share of the time.
        torque_time=float(is_at_limit.mean(axis=0).max() * times[-1]),
        speed=float(speeds.max()),
        asked_speed=asked.speed,
        distance=_finite_distance(approaches.to_others),
        nearest=approaches.to_others.bodies,
        own_distance=_finite_distance(approaches.to_itself),
        own_nearest=approaches.to_itself.bodies,
    )
    return replace(
        verdict,
        # A move that was stopped did not reach its target either, but the servos are not to blame for that.
        misses_target=not is_near_target and not is_stopped,
        remarks=tuple(_remarks(run, verdict, is_stopped=is_stopped)),
    )


def _remarks(run: "RecordedRun", verdict: MoveVerdict, *, is_stopped: bool) -> Iterator[Remark]:
    """Yield a remark for each value of a move that violates its bound.

    Args:
        run: the run, whose configuration has the bounds; ``none`` if there is no bound.
        verdict: the values of the move.
        is_stopped: whether the run ended before the move did. The final position and the speed of such a move are not
            judged.
    """
    bounds = run.config.verdict
    name = verdict.move
    if bounds.move_end != "none" and verdict.position_error > bounds.move_end and not is_stopped:
        text = message(
            "results.move_misses_target",
            "{move} ends {distance} from its target (bound {bound})",
            move=name,
            distance=in_words(verdict.position_error, "m"),
            bound=in_words(bounds.move_end, "m"),
        )
        yield Remark(VIOLATION, text, _remedy(run, verdict))
    if bounds.move_following != "none" and verdict.following_error > bounds.move_following:
        text = message(
            "results.move_leaves_path",
            "{move} deviates by {distance} from its path (bound {bound})",
            move=name,
            distance=in_words(verdict.following_error, "m"),
            bound=in_words(bounds.move_following, "m"),
        )
        yield Remark(VIOLATION, text, _remedy(run, verdict))
    if bounds.move_speed != "none" and verdict.asked_speed is not None and not is_stopped:
        # A short move may never reach its speed; the bound is a share, so that users can allow for that.
        share = verdict.speed / verdict.asked_speed
        if share < bounds.move_speed:
            text = message(
                "results.move_too_slow",
                "{move} reaches {speed:.3g} of {asked:.3g} m/s (bound {bound})",
                move=name,
                speed=verdict.speed,
                asked=verdict.asked_speed,
                bound=in_words(bounds.move_speed, "1"),
            )
            yield Remark(VIOLATION, text)
    if (
        bounds.move_distance != "none"
        and verdict.distance is not None
        and verdict.distance < bounds.move_distance
    ):
        text = message(
            "results.move_too_near",
            "the smallest distance of {move} is {distance}, {bodies} (bound {bound})",
            move=name,
            distance=in_words(verdict.distance, "m"),
            bodies=verdict.nearest,
            bound=in_words(bounds.move_distance, "m"),
        )
        # No remedy: where else the path may lead is for the user, or for a search, to decide.
        yield Remark(VIOLATION, text)


def _remedy(run: "RecordedRun", verdict: MoveVerdict) -> Remedy | None:
    """Remedy of a move whose tool is not where it should be. Returns None if none is known.

    Args:
        run: the run.
        verdict: the values of the move.
    """
    # The function below takes the worst value of a criterion, of which it reads the subject only.
    tool = MeasuredValue(
        subject=f"tool of {verdict.robot}",
        value=verdict.position_error,
        unit="m",
        bound=None,
        time=verdict.end,
        limit=0.0,
        limit_unit="",
    )
    return sag_or_saturation(run, tool)


def _finite_distance(approach: "Approach") -> float | None:
    """The distance of an approach [m], or None if no pair of bodies was measured."""
    # The distance is infinite then, which files for JSON cannot contain.
    return approach.distance if np.isfinite(approach.distance) else None


def table_of_moves(moves: Sequence[MoveVerdict]) -> list[list[str]]:
    """Rows of the table of moves: the headings, then one row for each move, with values in the units for users.

    The bodies that come nearest are in ``summary.json``: their names would make the table wider than a screen.
    """
    table: list[list[str]] = [[*_HEADINGS]]
    for move in moves:
        row = [
            move.move,
            compound("{time:.2f}", time=move.end),
            message("results.yes", "yes") if move.reached else message("results.no", "no"),
            compound("{error:.1f}", error=1e3 * move.position_error),
            compound("{error:.1f}", error=1e3 * move.following_error),
            # Rounding leaves some 1e-6 m/s of a tool that stays, as while fingers close.
            compound("{speed:.3g}", speed=round(move.speed, 4)),
            _in_table(move.distance),
            _in_table(move.own_distance),
        ]
        table.append(row)
    return table


def nearest_bodies(moves: Sequence[MoveVerdict]) -> str:
    """Write the smallest distance to another body of all moves, with the two bodies and the move.

    Distances between bodies of the same robot do not count. The text is empty if no distance was measured.
    """
    measured = [move for move in moves if move.distance is not None]
    if not measured:
        return ""
    # The distances are not None here; "or 0.0" only shows that to the type checker.
    nearest = min(measured, key=lambda move: move.distance or 0.0)
    return message(
        "results.nearest_bodies",
        "nearest: {distance}, {bodies}, in {move}",
        distance=in_words(nearest.distance or 0.0, "m"),
        bodies=nearest.nearest,
        move=nearest.move,
    )


def meaning_of_distances(moves: Sequence[MoveVerdict]) -> str:
    """Explain the columns of distances in the table of moves.

    The text is empty if neither distances to other bodies nor those of a robot to itself were measured.
    """
    if all(move.distance is None and move.own_distance is None for move in moves):
        return ""
    return message(
        "results.meaning_of_distances",
        "nearest: smallest distance to another body. itself: smallest distance between two bodies of the robot."
        " Cells are empty if the move changes no such distance. Fingers and the piece that they hold are left "
        "out",
    )


def _in_table(distance: float | None) -> str:
    """Write a smallest distance, given in m, as whole mm. Returns an empty string if the distance is None."""
    # "z" in the format turns a negative zero into zero.
    return "" if distance is None else f"{1e3 * distance:z.0f}"
