"""What became of each move that a run was asked for."""

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from simrob_drake.results.verdict.judge import AT_LIMIT, torque_shares
from simrob_drake.results.verdict.verdict import in_words

if TYPE_CHECKING:
    from simrob_drake.results.record.run import Approach, AskedMove, RecordedRun
    from simrob_drake.stations.solver_config import VerdictConfig

_LOOKS = 41  # at a move, for what comes near
_SOON = 1e-6  # s


@dataclass(frozen=True)
class MoveVerdict:
    """What was asked of a move against what became of it."""

    move: str  # what it is called, such as ``move 3 (move_l)``
    robot: str  # whose it is
    # when it began, and when it ended or was stopped [s]
    begin: float
    end: float
    reached: bool  # it went to its end, and that was near enough to its target
    # how far the tool ended from its target [m, rad]
    position_error: float
    orientation_error: float
    following_error: float  # how far the tool was from where it should have been at most [m]
    torque_time: float  # for how long an axis was at its limit of torque, of the axis that was so longest [s]
    # the largest of the tool, and the one that was asked for [m/s]; None if none was
    speed: float
    asked_speed: float | None
    # the closest that the robot and what it carries came to anything else [m], and what to what; None where nothing
    # could be met. What touched at the start, or stays as far, does not count
    distance: float | None
    nearest: str
    # smallest distance between two bodies of the robot, with what it carries [m], and the names of the two bodies. The
    # distance is negative if the bodies overlap, and None if no two bodies of the robot can collide
    own_distance: float | None = None
    own_nearest: str = ""
    warnings: tuple[str, ...] = ()  # what passes its bound, in words

    def later(self, begin: float) -> "MoveVerdict":
        """Return it as of a run that begins so late [s]."""
        return replace(self, begin=self.begin + begin, end=self.end + begin)

    def summary(self) -> dict[str, Any]:
        """Return it for ``summary.json``."""
        return {key: value for key, value in asdict(self).items() if key != "warnings"}


def judge_move(run: "RecordedRun", asked: "AskedMove") -> MoveVerdict:
    """Compare a recorded move with the move that was planned: its end, path, speed, torque and distances."""
    last = min(int(np.searchsorted(run.times, asked.duration - _SOON)), len(run.times) - 1)
    times, rows = run.times[: last + 1], slice(0, last + 1)
    tool, should = (asked.tool(run.axes(signal, asked.robot)[rows]) for signal in ("q", "q_ref"))
    target = asked.tool(asked.end[np.newaxis])[0]
    places = tool[:, :3, 3]
    speeds = np.linalg.norm(np.gradient(places, times, axis=0), axis=1) if last else np.zeros(1)
    # The angle of the rotation between both orientations of the tool: its trace is 1 + 2 cos(angle).
    cosine = (np.trace(tool[-1, :3, :3].T @ target[:3, :3]) - 1) / 2
    at_limit = torque_shares(run, run.plant.robots[asked.robot])[rows] > AT_LIMIT
    looks = np.linspace(0.0, times[-1], _LOOKS)  # distances are slow to compute: evaluate them at few times
    others, itself = asked.approaches(run.positions_at(looks))
    stopped = run.stop_time < asked.duration - _SOON
    bound = run.config.verdict.move_end
    position_error = float(np.linalg.norm(places[-1] - target[:3, 3]))
    whose = f" of {asked.robot}" if len(run.plant.robots) > 1 else ""
    found = MoveVerdict(
        move=f"{asked.place} ({asked.kind or 'move'}{whose})",
        robot=asked.robot,
        begin=0.0,
        end=min(asked.duration, run.stop_time),
        reached=not stopped and (bound == "none" or position_error <= bound),
        position_error=position_error,
        orientation_error=float(np.arccos(np.clip(cosine, -1.0, 1.0))),
        following_error=float(np.linalg.norm(places - should[:, :3, 3], axis=1).max()),
        torque_time=float(at_limit.mean(axis=0).max() * times[-1]),
        speed=float(speeds.max()),
        asked_speed=asked.speed,
        distance=_finite_distance(others),
        nearest=others.bodies,
        own_distance=_finite_distance(itself),
        own_nearest=itself.bodies,
    )
    return replace(found, warnings=tuple(_warnings(found, run.config.verdict, stopped=stopped)))


def _warnings(found: MoveVerdict, bounds: "VerdictConfig", *, stopped: bool) -> Iterator[str]:
    """Yield what passes its bound; where a move that was stopped ended is no fault of it."""
    if bounds.move_end != "none" and found.position_error > bounds.move_end and not stopped:
        yield _sentence(found, f"ends {in_words(found.position_error, 'm')} beside its target", bounds.move_end, "m")
    if bounds.move_following != "none" and found.following_error > bounds.move_following:
        yield _sentence(found, f"was {in_words(found.following_error, 'm')} off its way", bounds.move_following, "m")
    if bounds.move_speed != "none" and found.asked_speed is not None and not stopped:
        share = found.speed / found.asked_speed
        if share < bounds.move_speed:
            reached = f"reaches {found.speed:.3g} of {found.asked_speed:.3g} m/s"
            yield _sentence(found, reached, bounds.move_speed, "1")
    if bounds.move_distance != "none" and found.distance is not None and found.distance < bounds.move_distance:
        near = f"comes within {in_words(found.distance, 'm')}, {found.nearest}"
        yield _sentence(found, near, bounds.move_distance, "m")


def _finite_distance(approach: "Approach") -> float | None:
    """Smallest distance [m], or None if no pair of bodies was measured."""
    # The distance is infinite then, which files for JSON cannot contain.
    return approach.distance if np.isfinite(approach.distance) else None


def _sentence(found: MoveVerdict, what: str, bound: float, unit: str) -> str:
    return f"{found.move} {what} (bound {in_words(bound, unit)})"


def table_of_moves(moves: Sequence[MoveVerdict]) -> list[list[str]]:
    """Rows of the table of moves: the headings, then one row for each move, with values in the units for users."""
    headings = ["move", "end [s]", "reached", "beside", "following", "at torque limit"]
    table = [[*headings, "speed of asked", "nearest", "to itself"]]
    for move in moves:
        asked = "" if move.asked_speed is None else f" of {move.asked_speed:.3g}"
        near = _in_table(move.distance, move.nearest)
        itself = _in_table(move.own_distance, move.own_nearest)
        errors = [f"{1e3 * error:.1f} mm" for error in (move.position_error, move.following_error)]
        others = [f"{move.torque_time:.2f} s", f"{move.speed:.3g}{asked} m/s", near, itself]
        table.append([move.move, f"{move.end:.2f}", "yes" if move.reached else "no", *errors, *others])
    return table


def _in_table(distance: float | None, bodies: str) -> str:
    """Format a smallest distance [m] and its two bodies for the table.

    Returns an empty string if the distance is None.
    """
    return "" if distance is None else f"{1e3 * distance:z.0f} mm {bodies}"
