"""How long the parts of a move take, and by which law of time each is gone."""

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any, Literal, TypedDict, get_args

import numpy as np
import numpy.typing as npt

from simrob_drake.base.arguments import LONGEST, SHORTEST, positive, seconds
from simrob_drake.base.errors import InvalidParameter, Unsuitable, one_of
from simrob_drake.base.extras import needed
from simrob_drake.base.frames import Vector, numbers
from simrob_drake.base.messages import compound, join_texts, message
from simrob_drake.blocks.cruise import LONGEST_RAMP, TimeLaw, cruise, cruise_in, smooth_law
from simrob_drake.blocks.references import PEAK
from simrob_drake.parts.station_plant import StationRobot
from simrob_drake.programs.plan import Check, Plan, rate_ratio
from simrob_drake.programs.segments import Segment, Stretch, by_law, rest
from simrob_drake.programs.time_optimal import Motors

_STRAIGHT = 1e-9  # rad or m that a way may leave its straight line
_POINTS = 6  # of each part in which all accelerations rise or fall evenly
_SHORTEST = 1e-6  # s between two parts


def jerk_limited(robots: Sequence[StationRobot], postures: Vector) -> tuple[Stretch, ...]:
    """Return the motions from rest to rest along straight postures (k, n) of robots, one after the other.

    All axes arrive at the same time; they stay on the line where that takes no longer. Raises InvalidParameter: an axis
    of which a limit is not known, or a way that is not straight in the axes.
    """
    with needed(message("programs.jerk_limited", "profile jerk_limited"), "plan"):
        from ruckig import InputParameter, Ruckig, Synchronization, Trajectory
    start, end = postures[0], postures[-1]
    parts = np.linspace(0.0, 1.0, len(postures))[:, np.newaxis]
    if np.abs(start + parts * (end - start) - postures).max() > _STRAIGHT:
        expected = message(
            "programs.straight_without_zones",
            "another one: it goes with moves that are straight in the axes, without zones",
        )
        raise InvalidParameter("profile", "jerk_limited", expected)
    names = [axis for robot in robots for axis in robot.axes]
    rate_limits = (
        ("velocity", [robot.speed_limits for robot in robots], message("programs.its_urdf", "its URDF")),
        (
            "acceleration",
            [robot.model.accelerations for robot in robots],
            message("programs.acceleration_in_robot", "acceleration_deg in its robot.yaml"),
        ),
        (
            "jerk",
            [robot.model.jerks for robot in robots],
            message("programs.jerk_in_robot", "jerk_deg in its robot.yaml"),
        ),
    )
    task = InputParameter(len(names))
    task.current_position, task.target_position = start.tolist(), end.tolist()
    for key, limits_of_robots, where in rate_limits:
        limits = np.concatenate(limits_of_robots)
        if not np.isfinite(limits).all():
            raise InvalidParameter(
                message("programs.rate_of_axis", "the {key} of {axis}", key=key, axis=names[limits.argmax()]),
                message("programs.not_limited", "not limited"),
                message("programs.limited_by", "limited by {where}", where=where),
            )
        setattr(task, f"max_{key}", limits.tolist())
    task.synchronization = Synchronization.Phase
    found = Trajectory(len(names))
    if (said := Ruckig(len(names)).calculate(task, found)).value < 0:
        raise InvalidParameter(
            "profile",
            "jerk_limited",
            message("programs.no_ruckig_motion", "another one: Ruckig found no motion ({result})", result=said.name),
        )
    times = np.cumsum([[0.0, *profile.t] for profile in found.profiles[0]], axis=1).ravel()
    breaks = np.unique(np.clip(times, 0.0, found.duration))
    breaks = np.append(breaks[:-1][np.diff(breaks) > _SHORTEST], found.duration)
    return tuple(_stretch(np.linspace(begin, stop, _POINTS), found) for begin, stop in pairwise(breaks))


def _stretch(times: Vector, found: Any) -> Stretch:
    positions, speeds, pushes = np.array([found.at_time(time) for time in times]).transpose(1, 0, 2)
    return Stretch(times, positions, ((speeds[0], pushes[0]), (speeds[-1], pushes[-1])))


POINT_TIME = 0.1  # time that a point of a move takes unless something else is asked [s]; Ts in SimRob
ACCELERATION = 2.0  # how fast the tool is sped up to its cruise speed unless told [m/s²], or less where an axis cannot

Profile = Literal["smooth", "trapezoid", "s_curve", "time_optimal", "jerk_limited"]
"""How a move is sped up and slowed down: by a polynomial of degree five, evenly, or with an acceleration that does not
jump; the last two cruise in between. Or as fast as limits of the joints allow: of speed, acceleration and torque, or,
straight in the joints, of speed, acceleration and jerk."""
_LEAST: tuple[Profile, ...] = ("time_optimal", "jerk_limited")
_TURN_LENGTH = 0.1  # m that a radian of a joint counts, where moves share a time
_FASTEST = 20.0  # m/s of a tool; no arm is faster
_AT_ONCE = 1e-6  # m: what the way to a target counts at least
_LEAST_TIME = 0.01  # s to a target
_STAYS = 1e-9  # rad or m: less is no way
_LESS_THAN_FULL = 0.98  # of the joints' limits, where durations are left to us
_TRIES = 4  # to find an acceleration that the joints allow
Limits = tuple[Vector, Vector]
"""Largest speeds and accelerations of axes, each of shape (n,) [rad/s or m/s, rad/s² or m/s²]."""


class How(TypedDict, total=False):
    """How a move is done; at most one of ``duration``, ``times`` and ``speed``.

    Attributes:
        points: interpolated points on the way to each target; more are taken where the path needs them.
        duration: of the whole move [s]; several targets share it by the length of their ways.
        times: when each target is reached, shape (k,) [s].
        speed: at which the tool centre point cruises [m/s]; on the mean, where only the joints go straight.
        acceleration: with which it is sped up to that [m/s²]; 2 unless given, or less where an axis cannot.
        profile: see :data:`Profile`; ``s_curve`` with a speed, else ``smooth``. With ``time_optimal`` a speed is the
            most that the tool may have; ``jerk_limited`` takes none.
        zone: how near to a target the tool turns to the next one: ``fine`` (the usual) to rest there, RAPID's ``z0`` to
            ``z200``, or a distance [m].
        check: what is looked at first, see :data:`Check`; ``collision`` unless told.
    """

    points: int
    duration: float
    times: npt.ArrayLike
    speed: float
    acceleration: float
    profile: Profile
    zone: str | float
    check: Check | None


def profile_of(how: How) -> Profile:
    """Return by which profile a move is done; raises UnknownName: none; InvalidParameter: a needless acceleration."""
    profile: Profile = how.get("profile", "s_curve" if "speed" in how else "smooth")
    one_of(message("programs.profile", "profile"), profile, get_args(Profile))
    taken = ("duration", "times", *(("speed",) if profile == "jerk_limited" else ()))
    if profile in _LEAST and (key := next((key for key in taken if key in how), None)):
        raise Unsuitable(
            key,
            message("programs.profile_takes_least_time", "profile='{profile}' takes the least time", profile=profile),
        )
    if "acceleration" in how and ("speed" not in how or profile in ("smooth", *_LEAST)):
        raise InvalidParameter(
            "acceleration",
            how["acceleration"],
            message("programs.with_a_speed", "given with a speed, of a move that cruises"),
        )
    return profile


def is_free(how: How) -> bool:
    """Whether the time of a move is left to the planner."""
    return not {"duration", "times", "speed"} & {*how} and profile_of(how) not in _LEAST


def speed_of(how: How) -> float:
    """Return the speed of a move that has one [m/s]; raises InvalidParameter: none that a tool can have."""
    speed = positive(how["speed"], "speed", "m/s")
    if speed > _FASTEST:
        expected = message(
            "programs.speed_in_millimetres",
            "at most {fastest:g} m/s; were these mm/s? Then it is {speed:g}",
            fastest=_FASTEST,
            speed=speed / 1e3,
        )
        raise InvalidParameter("speed", compound("{speed:g} m/s", speed=speed), expected)
    return speed


def timed(
    robot: str, segments: Sequence[Segment], how: How, points: int, limits: Limits, motors: Callable[[], Motors]
) -> Plan:
    """Return the move that goes segment by segment by a law of time, and rests at the end of each.

    Where its time is left to us it takes as long as the joints need; with a speed alone it is sped up as they allow.
    Past corners it keeps that speed: less acceleration would help there only by not reaching it. Raises
    InvalidParameter: as :func:`arrivals`.
    """
    if profile_of(how) in _LEAST:
        return _in_least_time(robot, segments, how, points, motors())
    push = positive(how.get("acceleration", ACCELERATION), "acceleration", "m/s²")
    found, free = _laws(segments, how, points, push)
    made = _by_laws(robot, segments, found, points)
    if free:
        slower = _needed(made, limits)
        return made if slower <= 1 else _by_laws(robot, segments, [law.slower(slower) for law in found], points)
    if "speed" not in how or "acceleration" in how or profile_of(how) == "smooth":
        return made
    reaching = LONGEST_RAMP * how["speed"] * (how["speed"] / _ways(segments).max())  # in the middle of the longest part
    least = min(push, reaching) if "zone" in how else 0.0
    for _ in range(_TRIES):
        ratio = rate_ratio(made.trajectory, made.looks, limits[1], 2) / _LESS_THAN_FULL
        if ratio <= 1:
            break
        push = max(push / ratio, least)
        made = _by_laws(robot, segments, _laws(segments, how, points, push)[0], points)
    return made


def through_all(robot: str, segments: Sequence[Segment], how: How, points: int, limits: Limits) -> Plan:
    """Return the move smoothly through all segments' ends, at rest at the last; raises as :func:`arrivals`."""
    times, free = arrivals(segments, how, points)
    rows = np.array([segments[0].postures[0], *(segment.end for segment in segments)])

    def plan(times: Vector) -> Plan:
        return Plan(robot, (Stretch(np.append(0.0, times), rows),), times, points)

    made = plan(times)
    slower = _needed(made, limits) if free else 1.0
    return made if slower <= 1 else plan(times * slower)


def remedy(how: How, order: int, slower: float, duration: float) -> str:
    """Return what to do about a move that would have to be so many times slower, and so take a duration [s].

    Because of speeds (order 1) or accelerations (2).
    """
    if order == 2 and "acceleration" in how:
        return message(
            "programs.give_acceleration",
            "give it an acceleration of {acceleration:.3g} m/s² or less, or a lower speed",
            acceleration=how["acceleration"] / slower**2,
        )
    if "speed" in how:
        wider = message("programs.or_larger_zone", ", or a larger zone") if "zone" in how else ""
        return message(
            "programs.give_speed",
            "give the move a speed of {speed:.3g} m/s or less{wider}",
            speed=how["speed"] / slower,
            wider=wider,
        )
    return message("programs.give_duration", "give the move a duration of {duration:.3g} s or more", duration=duration)


def _needed(plan: Plan, limits: Limits) -> float:
    """Return in how many times its time a plan can be done by far."""
    ratios = [rate_ratio(plan.trajectory, plan.looks, limit, order) for order, limit in enumerate(limits, 1)]
    return float(max(ratio ** (1 / order) for order, ratio in enumerate(ratios, 1)) / _LESS_THAN_FULL)


def _by_laws(robot: str, segments: Sequence[Segment], laws: Sequence[TimeLaw], points: int) -> Plan:
    stretches, arrived, begin = list[Stretch](), list[float](), 0.0
    for segment, law in zip(segments, laws, strict=True):
        stretches += [stretch.at(begin) for stretch in by_law(segment.parts, segment.postures, law)]
        arrived += (begin + law.times_of(segment.passes)).tolist()
        begin += law.duration
    return Plan(robot, tuple(stretches), np.array(arrived), points)


def _in_least_time(robot: str, segments: Sequence[Segment], how: How, points: int, motors: Motors) -> Plan:
    stretches, arrived, begin = list[Stretch](), list[float](), 0.0
    speed = speed_of(how) if "speed" in how else None
    for segment in segments:
        passed = np.full(len(segment.passes), _LEAST_TIME)
        if np.ptp(segment.postures, axis=0).max() < _STAYS:
            own: tuple[Stretch, ...] = (rest(segment.end, 0.0, _LEAST_TIME),)
        elif profile_of(how) == "jerk_limited":
            own = jerk_limited(motors.station_robots, segment.postures)
            passed = own[-1].times[-1:]
        else:
            stretch, passed = motors.fastest(segment, speed)
            own = (stretch,)
        stretches += [stretch.at(begin) for stretch in own]
        arrived += (begin + passed).tolist()
        begin += float(own[-1].times[-1])
    return Plan(robot, tuple(stretches), np.array(arrived), points)


def _laws(segments: Sequence[Segment], how: How, points: int, acceleration: float) -> tuple[list[TimeLaw], bool]:
    """Return by which law of time each segment is gone, and whether its duration was left to us."""
    profile = profile_of(how)
    times, free = arrivals(segments, how, points)
    durations = np.diff(times, prepend=0.0).tolist()
    if profile == "smooth":
        return [smooth_law(duration) for duration in durations], free
    if "speed" not in how:
        return [cruise_in(duration, rounded=profile == "s_curve") for duration in durations], free
    jerk, ways = None if profile == "s_curve" else np.inf, np.maximum(_ways(segments), _AT_ONCE)
    found = [cruise(1.0, speed_of(how) / way, acceleration / way, jerk) for way in ways]
    return [law.slower(max(1.0, _LEAST_TIME / law.duration)) for law in found], False


def arrivals(segments: Sequence[Segment], how: How, points: int) -> tuple[Vector, bool]:
    """Return when each segment ends that is gone smoothly, shape (k,) [s], and whether that was left to us.

    Raises InvalidParameter: more than one of duration, times and speed; or one that cannot be.
    """
    stated = [key for key in ("duration", "times", "speed") if key in how]
    if len(stated) > 1:
        raise InvalidParameter(
            message("programs.time_of_move", "the time of the move"),
            message("programs.given_by", "given by {stated}", stated=join_texts(stated, message("base.and", " and "))),
            message("programs.given_by_one", "given by one of them"),
        )
    if "times" in how:
        return _checked_times(how["times"], len(segments)), False
    if "duration" in how:
        shares = np.maximum(_lengths(segments) + _TURN_LENGTH * _turns(segments), _AT_ONCE)
        return _apart(seconds(how["duration"]) * np.cumsum(shares) / shares.sum(), "duration", how["duration"]), False
    if "speed" in how:
        speed = speed_of(how)
        times = np.cumsum(np.maximum(PEAK * (_ways(segments) / speed), _LEAST_TIME))
        return _apart(times, "speed", how["speed"]), False
    return POINT_TIME * points * np.cumsum([len(segment.passes) for segment in segments]), True


def _lengths(segments: Sequence[Segment]) -> Vector:
    return np.array([segment.length for segment in segments])


def _turns(segments: Sequence[Segment]) -> Vector:
    """Return how far the joint that moves most goes on each segment, shape (k,) [rad or m]."""
    return np.array([np.abs(np.diff(segment.postures, axis=0)).sum(axis=0).max() for segment in segments])


def _ways(segments: Sequence[Segment]) -> Vector:
    """Return how long the way of each segment is for a speed, shape (k,) [m]: where the tool only turns, its turn."""
    lengths = _lengths(segments)
    return np.where(lengths < _AT_ONCE, _TURN_LENGTH * _turns(segments), lengths)


def _checked_times(times: npt.ArrayLike, count: int) -> Vector:
    values = np.atleast_1d(numbers(times))
    if values.shape != (count,):
        raise InvalidParameter(
            "times", times, message("programs.times_a_target", "{count} times [s], one a target", count=count)
        )
    return _apart(values, "times", times)


def _apart(times: Vector, name: str, value: object) -> Vector:
    """Check that times (k,) [s] rise from 0, and are times that a station knows."""
    if not ((np.diff(times, prepend=0.0) >= SHORTEST).all() and times[-1] <= LONGEST):
        raise InvalidParameter(
            name,
            value,
            message(
                "programs.time_for_each_target",
                "such that each target has its time, up to {longest:g} s",
                longest=LONGEST,
            ),
        )
    return times
