"""The criteria by which runs are judged, of axes and of all else: a further one is an entry here.

Its bound stands in ``VerdictConfig``.
"""

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from simrob_drake.frames import Vector
from simrob_drake.parts.couplings import Between
from simrob_drake.parts.site import StationRobot
from simrob_drake.results.record.run import RecordedRun
from simrob_drake.results.verdict.contact_forces import measure_friction_share, measure_resting_force
from simrob_drake.results.verdict.verdict import NOTHING_LEFT_OUT, Criterion, Measured, Verdict
from simrob_drake.robots.motors import rated_torques

if TYPE_CHECKING:
    from simrob_drake.results.record.run import RecordedRun

AT_LIMIT = 0.999  # from which part of it on an axis is at its limit of torque
_LOOKS = 40  # in a run, at its couplings
_PRESSES = "a finger, which presses on what it holds as hard as it may"
_IDLE = "no motor drives it"
_WENT_ON = "completed", "monitor"  # how runs end at whose end axes should be where they are asked to be


class _Axes(NamedTuple):
    """What was measured of the axes of a robot: values (n,), their times (n,) or None, and the limits of shares."""

    values: Vector
    times: Vector | None = None
    limits: Vector = np.zeros(0)
    limit_units: tuple[str, ...] = ()
    left_out: Mapping[int, str] = NOTHING_LEFT_OUT  # axes that are not judged, each with the reason; their values are 0


def _of_each_robot(
    measure: Callable[[RecordedRun, StationRobot], _Axes | None],
) -> Callable[[RecordedRun], Measured | None]:
    """Return what measures the axes of all robots."""

    def of_run(run: RecordedRun) -> Measured | None:
        found = [(robot, measure(run, robot)) for robot in run.plant.robots.values()]
        known = [(robot, axes) for robot, axes in found if axes is not None]
        if not known:
            return None
        times, limits = ([getattr(axes, key) for _, axes in known] for key in ("times", "limits"))
        left_out = {
            f"{robot.prefix}{robot.axes[axis]}": reason
            for robot, axes in known
            for axis, reason in axes.left_out.items()
        }
        return Measured(
            [f"{robot.prefix}{axis}" for robot, _ in known for axis in robot.axes],
            np.concatenate([axes.values for _, axes in known]),
            None if times[0] is None else np.concatenate(times),
            [slides for robot, _ in known for slides in robot.model.prismatic],
            (np.concatenate(limits), [unit for _, axes in known for unit in axes.limit_units]),
            left_out,
        )

    return of_run


def largest(values: Vector, times: Vector) -> tuple[Vector, Vector]:
    """Return the largest of each column of values (m, k), and when it was so: (k,) each. What is no number is none."""
    found = np.fmax.reduce(values, axis=0)
    return found, times[(values == found).argmax(axis=0)]


def _errors(run: RecordedRun, robot: StationRobot) -> Vector | None:
    """Return how far the axes of a robot were from their reference, shape (m, n) [rad or m].

    Axes that are left out have errors of 0. Returns None for a kinematic run, in which axes are where they should be.
    """
    if run.config.mode == "kinematic":
        return None
    errors = np.abs(run.axes("q_ref", robot.name) - run.axes("q", robot.name))
    errors[:, list(_without_error(run, robot))] = 0.0
    return errors


def _without_error(run: RecordedRun, robot: StationRobot) -> dict[int, str]:
    """Return the axes of a robot that nobody expects at their reference, by index, each with the reason."""
    left_out = _fingers(robot)
    idle = (robot.gains.kp == 0) & ~run.axes("tau", robot.name).any(axis=0)
    if not idle.all():  # a robot without any motor is judged as a whole
        left_out |= dict.fromkeys(np.flatnonzero(idle).tolist(), _IDLE)
    return left_out


def _fingers(robot: StationRobot) -> dict[int, str]:
    """Return the fingers of a robot by index, each with the reason why it is not judged."""
    return dict.fromkeys(robot.model.fingers, _PRESSES)


def _of_arm(robot: StationRobot, values: Vector) -> Vector:
    """Return values (m, n) with 0 for fingers, which press on what they hold as hard as they may."""
    values[:, list(robot.model.fingers)] = 0.0
    return values


@_of_each_robot
def _final_error(run: RecordedRun, robot: StationRobot) -> _Axes | None:
    """Measure how far axes are from their reference at the end."""
    errors = _errors(run, robot)
    if errors is None or run.ending not in _WENT_ON:
        return None
    return _Axes(errors[-1], left_out=_without_error(run, robot))


@_of_each_robot
def _largest_error(run: RecordedRun, robot: StationRobot) -> _Axes | None:
    """Measure how far axes were from their reference at most."""
    errors = _errors(run, robot)
    return None if errors is None else _Axes(*largest(errors, run.times), left_out=_without_error(run, robot))


@_of_each_robot
def _beyond_stop(run: RecordedRun, robot: StationRobot) -> _Axes:
    lower, upper = robot.model.axis_limits
    position = run.axes("q", robot.name)
    return _Axes(*largest(np.maximum(lower - position, position - upper), run.times))


def torque_shares(run: RecordedRun, robot: StationRobot) -> Vector:
    """Return the parts of their limits that the torques of a robot's axes were, shape (m, n); of fingers nought."""
    torque, limit, line = run.axes("tau", robot.name), robot.gains.torque_limit, robot.gains.line
    if line is None or run.config.mode == "kinematic":
        return _of_arm(robot, np.abs(torque) / limit)
    return _of_arm(robot, line.share(torque, run.axes("v", robot.name), limit))


@_of_each_robot
def _torque_share(run: RecordedRun, robot: StationRobot) -> _Axes:
    units = tuple(robot.model.effort_units)
    shares = largest(torque_shares(run, robot), run.times)
    return _Axes(*shares, robot.gains.torque_limit, units, _fingers(robot))


@_of_each_robot
def _torque_time(run: RecordedRun, robot: StationRobot) -> _Axes:
    return _Axes((torque_shares(run, robot) > AT_LIMIT).mean(axis=0), left_out=_fingers(robot))


def _speed_shares(run: RecordedRun, robot: StationRobot) -> Vector:
    return np.asarray(np.abs(run.axes("v", robot.name)) / robot.speed_limits)


@_of_each_robot
def _speed_share(run: RecordedRun, robot: StationRobot) -> _Axes:
    units = tuple(f"{unit.si}/s" for unit in robot.model.units)
    return _Axes(*largest(_speed_shares(run, robot), run.times), robot.speed_limits, units)


@_of_each_robot
def _speed_time(run: RecordedRun, robot: StationRobot) -> _Axes:
    return _Axes((_speed_shares(run, robot) > 1.0).mean(axis=0))


def _payload(run: RecordedRun) -> Measured | None:
    found = {
        robot.name: (robot.load, robot.model.payload)
        for robot in run.plant.robots.values()
        if robot.model.payload is not None
    }
    if not found:
        return None
    loads, rated = np.array([*found.values()]).T
    return Measured([*found], loads / rated, limits=(rated, ["kg"] * len(found)))


def _tcp_speed(run: RecordedRun) -> Measured | None:
    robots = [robot for robot in run.plant.robots.values() if robot.tcp and robot.model.tcp_speed is not None]
    if not robots or len(run.times) < 2:
        return None
    places = [np.column_stack([run[f"{robot.prefix}tcp.{axis}"] for axis in "xyz"]) for robot in robots]
    speeds = [np.linalg.norm(np.gradient(place, run.times, axis=0), axis=1) for place in places]
    rated = np.array([robot.model.tcp_speed for robot in robots])
    names, units = [f"tool of {robot.name}" for robot in robots], ["m/s"] * len(robots)
    return Measured(names, *largest(np.column_stack(speeds) / rated, run.times), limits=(rated, units))


@_of_each_robot
def _rated_time(run: RecordedRun, robot: StationRobot) -> _Axes | None:
    rated = rated_torques(robot.motors)
    return _Axes((np.abs(run.axes("tau", robot.name)) > rated).mean(axis=0)) if np.isfinite(rated).any() else None


@_of_each_robot
def _heat(run: RecordedRun, robot: StationRobot) -> _Axes | None:
    """Measure how warm motors got: T θ' = (τ / τ_n)² - θ; 1 is as warm as the rated torque makes them."""
    rated = rated_torques(robot.motors)
    if not np.isfinite(rated).any():
        return None
    steps, load = np.diff(run.times, prepend=run.times[0]), (run.axes("tau", robot.name) / rated) ** 2
    times = np.array([1.0 if motor is None else motor.thermal_time for motor in robot.motors])
    heat = np.zeros_like(load)
    for look in range(1, len(load)):
        heat[look] = heat[look - 1] - np.expm1(-steps[look] / times) * (load[look] - heat[look - 1])
    return _Axes(*largest(heat, run.times))


MOTION = (
    Criterion("final_error", "rad", "final error", "{of} ended {value} off what was asked", _final_error),
    Criterion("largest_error", "rad", "largest error", "{of} was {value} off what was asked{when}", _largest_error),
    Criterion("beyond_stop", "rad", "beyond a stop", "{of} was pressed {value} beyond its range{when}", _beyond_stop),
    Criterion("torque_share", "1", "torque", "{of} needed {value} of its torque, {amount},{when}", _torque_share),
    Criterion(
        "torque_time", "1", "at the limit of torque",
        "{of} was at its limit of torque for {value} of the run", _torque_time, per_time=True,
    ),
    Criterion("speed_share", "1", "speed", "{of} moved at {value} of its speed, {amount},{when}", _speed_share),
    Criterion(
        "speed_time", "1", "beyond that of speed",
        "{of} was beyond its limit of speed for {value} of the run", _speed_time, per_time=True,
    ),
    Criterion(
        "rated_time", "1", "beyond the rated torque",
        "{of} was beyond the rated torque of its motor for {value} of the run", _rated_time, per_time=True,
    ),
    Criterion("heat", "1", "heat", "the motor of {of} got {value} as warm as its rated torque makes it{when}", _heat),
)  # fmt: skip
"""The criteria of axes."""


def _below_floor(run: RecordedRun) -> Measured | None:
    """Measure how deep tools in use, floating bases and free pieces were below the ground, negative above it."""
    if run.config.floor is None:
        return None
    robots = run.plant.robots.values()
    poses = {f"tool {robot.prefix}{robot.tcp}": f"{robot.prefix}tcp" for robot in robots if robot.tcp}
    poses |= {f"{robot.prefix}base": f"{robot.prefix}base" for robot in robots if robot.floats}
    poses |= {piece: f"piece.{piece}" for piece in run.config.free_pieces}
    points = [np.column_stack([run[f"{pose}.{part}"] for part in "xyz"]) for pose in poses.values()]
    ground = run.plant.ground
    depths = [-places[:, 2] if ground.plain else ground.beneath(places) - places[:, 2] for places in points]
    return Measured(list(poses), *largest(np.column_stack(depths), run.times)) if depths else None


def _distance(run: RecordedRun) -> Measured | None:
    felt = [signal for signal in run.signals if signal.role == "distance" and set(signal.names) <= set(run.names)]
    if not felt:
        return None
    nearest, times = largest(-np.column_stack([run[signal.names[0]] for signal in felt]), run.times)
    return Measured([signal.part for signal in felt], -nearest, times)


def _penetration(run: RecordedRun) -> Measured | None:
    found = run.touch.depths
    if not found:
        return None
    values, times = np.array(list(found.values())).T
    return Measured([f"{first} and {second}" for first, second in found], values, times)


def _foot_slip(run: RecordedRun) -> Measured | None:
    found = run.touch.slides
    longest = [slide.longest for slide in found.values()]
    names = [f"{run.plant.robots[robot].prefix}{link}" for robot, link in found]
    times = run.touch.times[[look for _, look in longest]] if longest else np.zeros(0)
    return Measured(names, np.array([way for way, _ in longest]), times)


def _shortened_steps(run: RecordedRun) -> Measured | None:
    if run.shortened is None or len(run.step_times) < 2:
        return None
    steps = np.array([len(run.step_times) - 1.0])
    return Measured(["the solver"], run.shortened / steps, limits=(steps, ["steps"]))


def _coupling_gap(run: RecordedRun) -> Measured | None:
    """Measure how far what couplings hold together was apart, at some moments of the run."""
    couplings = run.config.couplings.items()
    held = {name: one for name, one in couplings if one.constrains and isinstance(one, Between)}
    if not held:
        return None
    plant, context = run.plant.plant, run.plant.plant.CreateDefaultContext()
    times = run.times[np.unique(np.linspace(0, len(run.times) - 1, _LOOKS).astype(int))]
    gaps = np.zeros((len(times), len(held)))
    for look, positions in enumerate(run.positions_at(times)):
        plant.SetPositions(context, positions)
        gaps[look] = [coupling.gap(run.plant, context) for coupling in held.values()]
    return Measured([*held], *largest(gaps, times))


CRITERIA = (
    *MOTION,
    Criterion("tcp_speed", "1", "tool's speed", "{of} was at {value} of its rated speed, {amount},{when}", _tcp_speed),
    Criterion("payload", "1", "payload", "{of} carried {value} of its rated payload, {amount}", _payload),
    Criterion("below_floor", "m", "below the floor", "{of} was {value} below the floor{when}", _below_floor),
    Criterion("distance", "m", "nearest", "{of} measured a distance of {value}{when}", _distance, least=True),
    Criterion("penetration", "m", "penetration", "{of} were {value} deep in each other{when}", _penetration),
    Criterion(
        "resting_force", "1", "contact force at rest",
        "the contact forces on {of}, which rests, are {value} off its weight{when}", measure_resting_force,
    ),
    Criterion(
        "friction_share", "1", "friction",
        "the friction between {of} is {value} of what their surfaces can give{when}", measure_friction_share,
    ),
    Criterion("coupling_gap", "m", "open coupling", "{of} was {value} (or mrad) open{when}", _coupling_gap),
    Criterion("foot_slip", "m", "slip", "{of} slid {value} before it was lifted again{when}", _foot_slip),
    Criterion("shortened_steps", "1", "shortened steps", "{of} shortened {amount}", _shortened_steps),
)  # fmt: skip
"""What runs are judged by, in the order in which it is told."""


def verdict_of(run: RecordedRun) -> Verdict:
    """Return the verdict on a single run."""
    measures = [measure for criterion in CRITERIA if (measure := criterion.of(run)) is not None]
    touched = run.touch.depths or run.touch.slides
    return Verdict(tuple(measures), run.config.sample_rate, run.touch.rate if touched else None)
