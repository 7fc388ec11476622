"""Timing of moves: how long each segment of a move takes, and by which law of time the robot follows it.

A *segment* is a path from rest to rest. Its law of time gives the part of the path that is covered at each time. The
user may set the duration of the move, the times of its targets, or the speed of the tool, see :class:`How`. Without
any of them the timing is *free*: the move takes a usual time, or longer if the joints need it.

A *stretch* is a part of a motion: a spline of the axes over time. A segment *passes* its targets at parts of its path:
its only target is at its end, but with zones it has several.
"""

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any, Literal, NamedTuple, TypedDict, get_args

import numpy as np
import numpy.typing as npt

from simrob_drake.base.arguments import LONGEST, SHORTEST, positive, seconds
from simrob_drake.base.errors import InvalidParameter, Unsuitable, one_of
from simrob_drake.base.extras import importing_extra
from simrob_drake.base.frames import Vector, numbers
from simrob_drake.base.messages import compound, join_texts, message
from simrob_drake.blocks.cruise import LONGEST_RAMP, TimeLaw, cruise, cruise_in, smooth_law
from simrob_drake.blocks.references import PEAK
from simrob_drake.parts.station_plant import StationRobot
from simrob_drake.programs.plan import Check, Plan, rate_ratio
from simrob_drake.programs.segments import EndSlopes, Segment, Slopes, Stretch, by_law, rest
from simrob_drake.programs.smooth_path import RateLimits
from simrob_drake.programs.time_optimal import Motors

_STRAIGHT = 1e-9  # largest distance of an axis from a straight line [rad or m]
_POINTS = 6  # count of points of each part of a motion with a constant jerk: a spline of degree five needs six
_SHORTEST_PART = 1e-6  # shortest time between two changes of the jerk [s]


def jerk_limited(robots: Sequence[StationRobot], postures: Vector) -> tuple[Stretch, ...]:
    """Compute the fastest motion along a straight line of the axes within limits of speed, acceleration and jerk.

    All axes arrive at the same time. They stay on the line where that takes no longer.

    Args:
        robots: the robots that move. The axes of one robot follow those of the one before.
        postures: postures evenly spaced on the line, shape (k, n) [rad or m].

    Returns:
        The motion from rest to rest from the time 0 on, cut where the jerk of some axis changes.

    Raises:
        InvalidParameter: the path is not straight in the axes, or no motion was found.
        Unsuitable: a limit of an axis is not known.
        SimrobError: Ruckig is not installed. The message has the command that installs it.
    """
    # Ruckig is an optional dependency: without it, the error names the extra that installs it.
    with importing_extra(message("programs.jerk_limited", "profile jerk_limited"), "plan"):
        from ruckig import InputParameter, Ruckig, Synchronization, Trajectory
    start = postures[0]
    end = postures[-1]
    # Distance of each axis from its place on the line, which the postures divide evenly.
    parts = np.linspace(0.0, 1.0, len(postures))[:, np.newaxis]
    distances = np.abs(start + parts * (end - start) - postures)
    # Ruckig gets only the start and the end: it cannot follow a path that bends between them.
    if distances.max() > _STRAIGHT:
        expected = message(
            "programs.straight_without_zones",
            "another profile: this one needs a path that is straight in the axes, without zones",
        )
        raise InvalidParameter("profile", "jerk_limited", expected)
    names = [axis for robot in robots for axis in robot.axes]
    # For each limit the attribute of Ruckig's task, the values by robot, and the place where a user sets them.
    rate_limits = (
        (
            "max_velocity",
            [robot.speed_limits for robot in robots],
            message("programs.its_urdf", "the velocity limit in its URDF"),
        ),
        (
            "max_acceleration",
            [robot.model.accelerations for robot in robots],
            message("programs.acceleration_in_robot", "acceleration_deg in its robot.yaml"),
        ),
        (
            "max_jerk",
            [robot.model.jerks for robot in robots],
            message("programs.jerk_in_robot", "jerk_deg in its robot.yaml"),
        ),
    )
    task = InputParameter(len(names))
    task.current_position = start.tolist()
    task.target_position = end.tolist()
    for attribute, limits_of_robots, where in rate_limits:
        limits = np.concatenate(limits_of_robots)
        if not np.isfinite(limits).all():
            raise Unsuitable(
                "profile",
                message(
                    "programs.not_limited",
                    "jerk_limited needs a limit that {axis} does not have",
                    axis=names[limits.argmax()],  # the first infinite limit
                ),
                message("programs.limited_by", "set {where}", where=where),
            )
        setattr(task, attribute, limits.tolist())
    # Phase synchronization keeps all axes on the line, where possible.
    task.synchronization = Synchronization.Phase
    motion = Trajectory(len(names))
    result = Ruckig(len(names)).calculate(task, motion)
    if result.value < 0:
        raise InvalidParameter(
            "profile",
            "jerk_limited",
            message(
                "programs.no_ruckig_motion",
                "another profile: Ruckig found no motion ({result})",
                result=result.name,
            ),
        )
    # The jerk of some axis changes at these times. Between two of them the motion is a polynomial. A profile of Ruckig
    # has the durations of the phases of one axis with a constant jerk.
    changes = np.cumsum([[0.0, *profile.t] for profile in motion.profiles[0]], axis=1).ravel()
    breaks = np.unique(np.clip(changes, 0.0, motion.duration))
    # Axes change their jerk at nearly the same times. A spline over such a short part would be ill-conditioned.
    is_long_enough = np.diff(breaks) > _SHORTEST_PART
    breaks = np.append(breaks[:-1][is_long_enough], motion.duration)
    return tuple(
        _ruckig_stretch(np.linspace(begin, stop, _POINTS), motion)
        for begin, stop in pairwise(breaks)
    )


def _ruckig_stretch(times: Vector, motion: Any) -> Stretch:
    """Sample a trajectory of Ruckig at times (k,) [s], and make a stretch through the samples.

    The stretch has the trajectory's velocities and accelerations at both ends.
    """
    # Positions, velocities and accelerations of the axes at each time, shape (k, 3, n).
    samples = np.array([motion.at_time(time) for time in times])
    positions, velocities, accelerations = samples.transpose(1, 0, 2)
    first = EndSlopes(velocities[0], accelerations[0])
    last = EndSlopes(velocities[-1], accelerations[-1])
    return Stretch(times, positions, Slopes(first, last))


POINT_TIME = 0.1
"""Time for each point of a move whose timing is free [s]; Ts in SimRob."""
ACCELERATION = 2.0
"""Default acceleration of the tool up to its cruising speed [m/s²]. It is less if an axis cannot."""

Profile = Literal["smooth", "trapezoid", "s_curve", "time_optimal", "jerk_limited"]
"""How a move speeds up and slows down.

`smooth` is a polynomial of degree five, `trapezoid` has constant accelerations, and `s_curve` has accelerations without
jumps; the last two cruise in between. `time_optimal` is as fast as limits of speed, acceleration and torque of the
joints allow; `jerk_limited`, for moves that are straight in the joints, as limits of speed, acceleration and jerk.
"""
_LEAST_TIME_PROFILES: tuple[Profile, ...] = ("time_optimal", "jerk_limited")

# Length that counts as much as a radian of a joint, where moves are compared [m].
_TURN_LENGTH = 0.1
_FASTEST = 20.0  # largest speed of a tool; no arm is faster [m/s]
_LEAST_LENGTH = 1e-6  # least length of the path to a target, so that nothing is divided by 0 [m]
_LEAST_TIME = 0.01  # least time to a target [s]
_STAYS = 1e-9  # largest motion of an axis that rests [rad or m]
_USED_PART = 0.98  # part of the limits of the joints that is used if the timing is free [1]
_TRIES = 4  # count of tries to find an acceleration that the joints allow


class How(TypedDict, total=False):
    """Options of a move. At most one of ``duration``, ``times`` and ``speed`` may be set.

    Attributes:
        points: count of interpolated points on the way to each target. More are used where the path needs them.
        duration: duration of the whole move [s]. Several targets share it by the lengths of their paths.
        times: time at which each target is reached, shape (k,) [s].
        speed: speed at which the tool centre point cruises [m/s]. If only the joints go straight, it is a mean.
        acceleration: acceleration of the tool up to this speed [m/s²]. The default is 2, or less if an axis cannot.
        profile: see :data:`Profile`. The default is ``s_curve`` with a speed, else ``smooth``. With ``time_optimal``
            the speed is the largest one that the tool may have. ``jerk_limited`` accepts no speed.
        zone: how near to a target the tool turns to the next one: ``fine`` (the default) to rest there, RAPID's ``z0``
            to ``z200``, or a distance [m].
        check: what is checked before the move, see :data:`Check`. The default is ``collision``.
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
    """Profile of a move: the one that is set, or the default for its other options.

    Raises:
        UnknownName: there is no such profile.
        Unsuitable: a duration, times or a speed is set for a profile that takes the least time.
        InvalidParameter: an acceleration is set for a move that does not cruise.
    """
    profile: Profile = how.get("profile", "s_curve" if "speed" in how else "smooth")
    one_of(message("programs.profile", "profile"), profile, get_args(Profile))
    takes_least_time = profile in _LEAST_TIME_PROFILES
    if takes_least_time:
        unsuitable = ["duration", "times"]
        if profile == "jerk_limited":
            unsuitable.append("speed")
        for key in unsuitable:
            if key in how:
                raise Unsuitable(
                    key,
                    message(
                        "programs.profile_takes_least_time",
                        "profile='{profile}' takes the least time",
                        profile=profile,
                    ),
                )
    cruises = "speed" in how and profile != "smooth" and not takes_least_time
    if "acceleration" in how and not cruises:
        raise Unsuitable(
            "acceleration",
            message("programs.without_speed", "only a move that reaches a cruising speed has it"),
            message("programs.with_a_speed", "set speed, and profile trapezoid or s_curve"),
        )
    return profile


def is_free(how: How) -> bool:
    """Whether the user leaves the timing of a move to the planner: none of duration, times and speed is set.

    A profile that takes the least time is not free, either. For errors of the options see :func:`profile_of`.
    """
    is_set = not {"duration", "times", "speed"}.isdisjoint(how)
    return not is_set and profile_of(how) not in _LEAST_TIME_PROFILES


def speed_of(how: How) -> float:
    """Speed of a move that has one, from its options [m/s].

    Raises:
        InvalidParameter: it is not positive, or larger than that of any arm.
    """
    speed = positive(how["speed"], "speed", "m/s")
    if speed > _FASTEST:
        expected = message(
            "programs.speed_in_millimetres",
            "at most {fastest:g} m/s; if these are mm/s, give {speed:g}",
            fastest=_FASTEST,
            speed=speed / 1e3,
        )
        raise InvalidParameter("speed", compound("{speed:g} m/s", speed=speed), expected)
    return speed


def plan_timed(
    robot: str,
    segments: Sequence[Segment],
    how: How,
    points: int,
    limits: RateLimits,
    motors: Callable[[], Motors],
) -> Plan:
    """Plan a move along segments, with a rest at the end of each.

    If the timing is free, the move takes the usual time, or longer if the joints need it. If a speed is set and no
    acceleration, the tool speeds up as fast as the joints allow, at most by the default acceleration. With zones it
    keeps its speed past the corners, where less acceleration would only help by not reaching the speed.

    Whether the joints can follow in the time or with the speed that the user sets is not checked here.

    Args:
        robot: name of the robot.
        segments: the segments, one after the other.
        how: options of the move.
        points: count of points on the way to each target.
        limits: limits of the axes.
        motors: function that prepares the motors of the robots. Only a profile that takes the least time needs them.

    Raises:
        SimrobError: an option has an invalid value, see :func:`profile_of` and :func:`arrivals`.
    """
    profile = profile_of(how)
    if profile in _LEAST_TIME_PROFILES:
        return _plan_in_least_time(robot, segments, how, points, motors())
    acceleration = positive(how.get("acceleration", ACCELERATION), "acceleration", "m/s²")
    laws, is_time_free = _laws(segments, how, points, acceleration)
    plan = _plan_by_laws(robot, segments, laws, points)
    # The usual time was only a first guess: a plan that is too fast takes longer, one that could be faster does not.
    if is_time_free:
        slowdown = _needed_slowdown(plan, limits)
        if slowdown <= 1:
            return plan
        return _plan_by_laws(robot, segments, [law.slower(slowdown) for law in laws], points)
    finds_acceleration = "speed" in how and "acceleration" not in how and profile != "smooth"
    if not finds_acceleration:
        return plan
    # With zones, at least the acceleration that reaches the speed in the middle of the longest path: with the
    # acceleration a, an S-curve over the length s reaches the speed sqrt(a s / LONGEST_RAMP) there.
    least = 0.0
    if "zone" in how:
        reaching = LONGEST_RAMP * how["speed"] * (how["speed"] / _speed_lengths(segments).max())
        least = min(acceleration, reaching)
    for _ in range(_TRIES):
        # Largest ratio of a joint's acceleration to what is used of its limit. The acceleration of the tool and those
        # of the joints are not proportional, since the postures change: try again.
        excess = rate_ratio(plan.trajectory, plan.looks, limits.accelerations, 2) / _USED_PART
        if excess <= 1:
            break
        acceleration = max(acceleration / excess, least)
        laws = _laws(segments, how, points, acceleration).laws
        plan = _plan_by_laws(robot, segments, laws, points)
    return plan


def through_all(
    robot: str, segments: Sequence[Segment], how: How, points: int, limits: RateLimits
) -> Plan:
    """Plan a move smoothly through the ends of all segments, at rest only at the last.

    Between the ends the axes follow a spline, not the paths of the segments: these only decide the times.

    Args:
        robot: name of the robot.
        segments: the segments, one after the other.
        how: options of the move.
        points: count of points on the way to each target.
        limits: limits of the axes.

    Raises:
        InvalidParameter: an option has an invalid value, see :func:`arrivals`.
    """
    # If the timing is free, these times are a first guess, with which the axes may be too fast.
    times, is_time_free = arrivals(segments, how, points)
    # One spline leads through all targets. Its ends are at rest, the targets between them are not.
    postures = np.array([segments[0].postures[0], *(segment.end for segment in segments)])

    def plan_at(times: Vector) -> Plan:
        """Plan the move so that it passes the targets at times (k,) [s]."""
        stretch = Stretch(np.append(0.0, times), postures)
        return Plan(robot, (stretch,), times, points)

    plan = plan_at(times)
    slowdown = _needed_slowdown(plan, limits) if is_time_free else 1.0
    return plan if slowdown <= 1 else plan_at(times * slowdown)


def remedy(how: How, order: int, slower: float, duration: float) -> str:
    """Advice for a move that exceeds a limit: a value for the option that the user has set, or else a duration.

    Args:
        how: options of the move.
        order: 1 if a speed exceeds its limit, 2 if an acceleration or a torque does.
        slower: factor by which the move would have to take longer.
        duration: duration that it would then have [s].
    """
    # The user has set the acceleration of the tool. In a move that takes k times as long it is k² times smaller.
    if order == 2 and "acceleration" in how:
        return message(
            "programs.give_acceleration",
            "give the move an acceleration of {acceleration:.3g} m/s² or less, or a lower speed",
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
    return message(
        "programs.give_duration",
        "give the move a duration of {duration:.3g} s or more",
        duration=duration,
    )


def _needed_slowdown(plan: Plan, limits: RateLimits) -> float:
    """Compute the factor by which a plan has to take longer so that it uses at most 98 % of the limits.

    It is less than 1 if the plan could be faster.

    Args:
        plan: the plan.
        limits: limits of speed and acceleration of its axes.
    """
    factors = []
    for order, limit in enumerate(limits, start=1):  # 1 for speeds, 2 for accelerations
        ratio = rate_ratio(plan.trajectory, plan.looks, limit, order)
        # Speeds fall with the factor, accelerations with its square.
        factors.append(ratio ** (1 / order))
    return float(max(factors) / _USED_PART)


def _plan_by_laws(
    robot: str, segments: Sequence[Segment], laws: Sequence[TimeLaw], points: int
) -> Plan:
    """Plan a move from its segments and one law of time for each.

    Args:
        robot: name of the robot.
        segments: the segments.
        laws: their laws of time.
        points: count of points on the way to each target.
    """
    stretches = list[Stretch]()
    target_times = list[float]()
    begin = 0.0  # time at which the segment begins [s]
    for segment, law in zip(segments, laws, strict=True):
        stretches += [stretch.at(begin) for stretch in by_law(segment.parts, segment.postures, law)]
        target_times += (begin + law.times_of(segment.passes)).tolist()
        begin += law.duration
    return Plan(robot, tuple(stretches), np.array(target_times), points)


def _plan_in_least_time(
    robot: str, segments: Sequence[Segment], how: How, points: int, motors: Motors
) -> Plan:
    """Plan a move that takes as little time as the limits of the joints allow.

    Args:
        robot: name of the robot.
        segments: the segments.
        how: options of the move.
        points: count of points on the way to each target.
        motors: the motors of the robots.

    Raises:
        InvalidParameter: an option has an invalid value, the motors could not even hold the robots on the path, or it
            is not straight in the axes, as the profile `jerk_limited` needs it.
        Unsuitable: a limit of an axis is not known.
    """
    profile = profile_of(how)
    speed = speed_of(how) if "speed" in how else None
    stretches = list[Stretch]()
    target_times = list[float]()
    begin = 0.0
    for segment in segments:
        # The motion of this segment, and the times `passes` at which it passes its targets.
        own_stretches: tuple[Stretch, ...]
        # A segment without motion has no fastest law of time. It takes the least time to a target.
        if np.ptp(segment.postures, axis=0).max() < _STAYS:
            own_stretches = (rest(segment.end, 0.0, _LEAST_TIME),)
            passes = np.full(len(segment.passes), _LEAST_TIME)
        elif profile == "jerk_limited":
            own_stretches = jerk_limited(motors.station_robots, segment.postures)
            passes = own_stretches[-1].times[-1:]
        else:
            fastest = motors.fastest(segment, speed)
            own_stretches = (fastest.stretch,)
            passes = fastest.passes
        stretches += [stretch.at(begin) for stretch in own_stretches]
        target_times += (begin + passes).tolist()
        begin += float(own_stretches[-1].times[-1])
    return Plan(robot, tuple(stretches), np.array(target_times), points)


class _SegmentLaws(NamedTuple):
    """Laws of time of the segments of a move.

    Attributes:
        laws: one law for each segment.
        is_free: whether the planner chose their durations.
    """

    laws: list[TimeLaw]
    is_free: bool


def _laws(segments: Sequence[Segment], how: How, points: int, acceleration: float) -> _SegmentLaws:
    """Determine the law of time of each segment, for profiles that do not take the least time.

    Args:
        segments: the segments.
        how: options of the move.
        points: count of points on the way to each target.
        acceleration: acceleration of the tool up to its speed [m/s²]. It has no effect without a speed, nor for the
            profile `smooth`.

    Raises:
        InvalidParameter: an option has an invalid value, see :func:`arrivals`.
    """
    profile = profile_of(how)
    arrival = arrivals(segments, how, points)
    durations = np.diff(arrival.times, prepend=0.0).tolist()
    if profile == "smooth":
        return _SegmentLaws([smooth_law(duration) for duration in durations], arrival.is_free)
    if "speed" not in how:
        laws = [cruise_in(duration, rounded=profile == "s_curve") for duration in durations]
        return _SegmentLaws(laws, arrival.is_free)
    # A law goes from 0 to 1: speed and acceleration are divided by the length of the path. If the jerk is None,
    # `cruise` chooses one, which gives an S curve; an infinite jerk gives a trapezoid.
    jerk = None if profile == "s_curve" else np.inf
    speed = speed_of(how)
    laws = []
    for length in np.maximum(_speed_lengths(segments), _LEAST_LENGTH):
        # A path that is shorter than the ramps never reaches the speed: the law only speeds up and slows down.
        law = cruise(1.0, speed / length, acceleration / length, jerk)
        laws.append(law.slower(max(1.0, _LEAST_TIME / law.duration)))
    return _SegmentLaws(laws, False)


class Arrivals(NamedTuple):
    """Times at which segments end.

    Attributes:
        times: the times, shape (k,) [s].
        is_free: whether the planner chose them.
    """

    times: Vector
    is_free: bool


def arrivals(segments: Sequence[Segment], how: How, points: int) -> Arrivals:
    """Determine the times at which segments end, if each follows a smooth law.

    A free timing takes a usual time for each point of each target.

    Args:
        segments: the segments.
        how: options of the move.
        points: count of points on the way to each target.

    Raises:
        InvalidParameter: more than one of duration, times and speed is set, or one has an invalid value.
    """
    options = [key for key in ("duration", "times", "speed") if key in how]
    if len(options) > 1:
        raise InvalidParameter(
            message("programs.time_of_move", "the time of the move"),
            message(
                "programs.given_by",
                "given by {stated}",
                stated=join_texts(options, message("base.and", " and ")),
            ),
            message("programs.given_by_one", "given by one of them"),
        )
    if "times" in how:
        return Arrivals(_user_times(how["times"], len(segments)), False)
    if "duration" in how:
        # Each segment gets its share by the length of its path, where turns of joints count, too.
        shares = np.maximum(_lengths(segments) + _TURN_LENGTH * _turns(segments), _LEAST_LENGTH)
        times = seconds(how["duration"]) * np.cumsum(shares) / shares.sum()
        return Arrivals(_check_times(times, "duration", how["duration"]), False)
    if "speed" in how:
        # The largest speed of a smooth law is PEAK times its mean: the set speed is the largest one.
        speed = speed_of(how)
        times = np.cumsum(np.maximum(PEAK * (_speed_lengths(segments) / speed), _LEAST_TIME))
        return Arrivals(_check_times(times, "speed", how["speed"]), False)
    target_counts = [len(segment.passes) for segment in segments]
    times = POINT_TIME * points * np.cumsum(target_counts)
    return Arrivals(np.asarray(times, dtype=float), True)


def _lengths(segments: Sequence[Segment]) -> Vector:
    """Length of the path of the tool on each segment, shape (k,) [m]."""
    return np.array([segment.length for segment in segments])


def _turns(segments: Sequence[Segment]) -> Vector:
    """Largest length of the path of an axis on each segment, shape (k,) [rad or m]."""
    return np.array(
        [np.abs(np.diff(segment.postures, axis=0)).sum(axis=0).max() for segment in segments]
    )


def _speed_lengths(segments: Sequence[Segment]) -> Vector:
    """Length of each segment that a speed is applied to, for all k segments, shape (k,) [m].

    It is the length of the tool's path. If the tool does not move or only turns, it is the turn of the joint that turns
    most, where a radian, or a metre of a sliding joint, counts 0.1 m.
    """
    lengths = _lengths(segments)
    return np.where(lengths < _LEAST_LENGTH, _TURN_LENGTH * _turns(segments), lengths)


def _user_times(times: npt.ArrayLike, count: int) -> Vector:
    """Read the times of a user, one for each of a count of targets, shape (count,) [s].

    Args:
        times: the times as the user gave them [s]. For one target it may be a number.
        count: count of targets.

    Raises:
        InvalidParameter: they are no numbers, of another count, or not in ascending order.
    """
    values = np.atleast_1d(numbers(times))
    if values.shape != (count,):
        raise InvalidParameter(
            "times",
            times,
            message(
                "programs.times_a_target", "{count} times [s], one for each target", count=count
            ),
        )
    return _check_times(values, "times", times)


def _check_times(times: Vector, name: str, value: object) -> Vector:
    """Check that times of targets are in ascending order from 0, and not longer than the longest run.

    Args:
        times: the times, shape (k,) [s].
        name: name of the user's option from which they follow.
        value: value of this option.

    Returns:
        The same times.

    Raises:
        InvalidParameter: two times are too close or in the wrong order, or the last one is too large.
    """
    # The first time is measured from 0, so that it has to be positive.
    is_ascending = (np.diff(times, prepend=0.0) >= SHORTEST).all()
    if not (is_ascending and times[-1] <= LONGEST):
        raise InvalidParameter(
            name,
            value,
            message(
                "programs.time_for_each_target",
                "such that the times of the targets ascend, up to {longest:g} s",
                longest=LONGEST,
            ),
        )
    return times
