"""The criteria by which runs are judged. A further criterion is one more entry of `CRITERIA`, or one of an extension.

A *criterion* measures one quantity of a run, such as the final error, for several *subjects*: axes of robots, tools,
feet, pairs of bodies. The result is a `Measured`: the worst value of each subject, and when it occurred. A measuring
function returns None if the run has nothing to measure. The bound of a criterion is a key of ``VerdictConfig``.

The signals of a run are recorded at m samples. A robot has n axes, with units rad and N·m, or m and N for prismatic
axes. A function with the decorator ``@_of_each_robot`` measures the axes of one robot; the decorator makes of it a
function that measures all robots of a run. A run *moves by forces* if it is dynamic; in a kinematic run the joints are
prescribed, and are always at their reference.
"""

import warnings
from collections.abc import Callable, Mapping
from functools import wraps
from typing import NamedTuple

import numpy as np

from simrob_drake.base.errors import shorten
from simrob_drake.base.extension import ExtensionWarning, register_core_names, usable_objects
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import join_texts, message
from simrob_drake.blocks.servo import AT_LIMIT
from simrob_drake.parts.couplings import Between
from simrob_drake.parts.station_plant import StationRobot
from simrob_drake.results.record.run import RecordedRun, robot_that_fell
from simrob_drake.results.record.torques import torque_shares
from simrob_drake.results.verdict.contact_forces import (
    measure_friction_share,
    measure_resting_force,
)
from simrob_drake.results.verdict.grips import measure_lost_piece
from simrob_drake.results.verdict.remedies import (
    contact_with_floor,
    firmer_grip,
    lag,
    less_load,
    more_grip,
    more_time_for_motors,
    more_time_for_speed,
    other_solver,
    rest_for_motor,
    sag_or_saturation,
    stiffer_contact,
)
from simrob_drake.results.verdict.severity import severity_of_end
from simrob_drake.results.verdict.verdict import (
    NOTHING_LEFT_OUT,
    Criterion,
    Measure,
    Measured,
    Verdict,
)
from simrob_drake.robots.motors import rated_torques

_COUPLING_SAMPLES = 40
"""Count of times at which the gaps of couplings are measured. The plant is set to each, which is slow."""

_PRESSES = "a finger, which grips with its full torque"
_IDLE = "no motor drives it"
"""Reasons in ``summary.json`` why an axis is not judged."""

_REGULAR_ENDINGS = ("completed", "monitor")
"""Endings of a run after which axes should be at their reference."""


class AxisValues(NamedTuple):
    """Values that were measured for the n axes of one robot.

    Attributes:
        values: the worst value of each axis, shape (n,).
        times: when each value occurred, shape (n,) [s]. None if the values belong to the whole run.
        limits: what the values are shares of, shape (n,). None if they are no shares.
        limit_units: units of the limits. Empty if the values are no shares.
        left_out: by index, the reason why an axis is not judged. The value of such an axis is 0.
    """

    values: Vector
    times: Vector | None = None
    limits: Vector | None = None
    limit_units: tuple[str, ...] = ()
    left_out: Mapping[int, str] = NOTHING_LEFT_OUT


class LargestValues(NamedTuple):
    """Largest values of k signals.

    Attributes:
        values: the values, shape (k,), in the unit of the signal.
        times: when each occurred first, shape (k,) [s].
    """

    values: Vector
    times: Vector


MeasureOfRun = Callable[[RecordedRun], Measured | None]
"""Measures a run; returns None if there is nothing to measure."""

MeasureOfRobot = Callable[[RecordedRun, StationRobot], AxisValues | None]
"""Measures the axes of one robot in a run; returns None if there is nothing to measure."""


def _of_each_robot(measure: MeasureOfRobot) -> MeasureOfRun:
    """Decorator: extend a measure of one robot to all robots of a run.

    The subjects of the new measure are the axes of all robots, with the prefixes of the robots. Robots for which the
    measure returns None are left out.
    """

    @wraps(measure)  # the name of the decorated function, by which pickle finds this one
    def of_run(run: RecordedRun) -> Measured | None:
        """Measure all robots, and join the values of their axes. Returns None if no robot has anything to measure."""
        names = list[str]()
        values = []
        times = []
        slides = list[bool]()
        limits = []
        limit_units = list[str]()
        left_out = dict[str, str]()
        for robot in run.plant.robots.values():
            axes = measure(run, robot)
            if axes is None:
                continue
            own_names = [f"{robot.prefix}{axis}" for axis in robot.axes]
            names += own_names
            values.append(axes.values)
            if axes.times is not None:
                times.append(axes.times)
            slides += list(robot.model.prismatic)
            if axes.limits is not None:
                limits.append(axes.limits)
            limit_units += axes.limit_units
            for index, reason in axes.left_out.items():
                left_out[own_names[index]] = reason
        if not values:
            return None
        return Measured(
            subjects=names,
            values=np.concatenate(values),
            times=np.concatenate(times) if times else None,
            slides=slides,
            limits=np.concatenate(limits) if limits else None,
            limit_units=limit_units,
            left_out=left_out,
        )

    return of_run


def largest(values: Vector, times: Vector) -> LargestValues:
    """Find the largest value of each signal, and when it occurred first.

    NaN is ignored, as in the signals of a run in which a block failed. A signal that is NaN throughout has the value
    NaN, at the first time.

    Args:
        values: k signals at m samples, shape (m, k).
        times: times of the samples, shape (m,) [s].
    """
    # fmax ignores NaN, which a block that failed leaves behind; max would return it.
    found = np.fmax.reduce(values, axis=0)
    first_rows = (values == found).argmax(axis=0)
    return LargestValues(found, times[first_rows])


def _errors(run: RecordedRun, robot: StationRobot) -> Vector | None:
    """Absolute distances of a robot's axes from their reference at all samples, shape (m, n) [rad or m].

    The distances of axes that are not judged are 0. Returns None for a kinematic run, in which axes are always at their
    reference.
    """
    if not run.config.engine.moves_by_forces:
        return None
    errors = np.abs(run.axes("q_ref", robot.name) - run.axes("q", robot.name))
    not_judged = list(_without_error(run, robot))
    errors[:, not_judged] = 0.0
    return errors


def _without_error(run: RecordedRun, robot: StationRobot) -> dict[int, str]:
    """Axes of a robot that are not expected at their reference, by index, each with the reason.

    These are fingers, and axes without a motor: passive ones, and those whose servo has no gain kp and that had no
    torque at all in the run. If this last condition holds for all axes of the robot, it is ignored.
    """
    left_out = _fingers(robot)
    left_out |= dict.fromkeys(np.flatnonzero(robot.gains.passive).tolist(), _IDLE)
    has_torque = run.axes("tau", robot.name).any(axis=0)
    # A servo without gains may still be driven by feedforward, such as a torque that a controller computes.
    idle = (robot.gains.kp == 0) & ~has_torque
    if not idle.all():  # in a robot without any motor, all axes are judged
        left_out |= dict.fromkeys(np.flatnonzero(idle).tolist(), _IDLE)
    return left_out


def _fingers(robot: StationRobot) -> dict[int, str]:
    """Fingers of a robot's gripper, by the index of the axis, each with the reason why it is not judged."""
    return dict.fromkeys(robot.model.fingers, _PRESSES)


def _errors_at_end(run: RecordedRun, robot: StationRobot) -> Vector | None:
    """Distances of a robot's axes at the end of a run from the posture of its controller, shape (n,) [rad or m].

    A controller may bring a robot to a posture of its own, as a swing-up brings a pendulum upright. Passive axes have
    a distance, too. Returns None if no controller has such a posture: then the reference counts.
    """
    for controller in run.config.controllers.values():
        # A controller that names no robot is one of the only robot.
        if controller.robot_name in (None, robot.name):
            distances: Vector | None = controller.distances_at_end(
                robot, run.axes("q", robot.name)[-1]
            )
            if distances is not None:
                return distances
    return None


@_of_each_robot
def _final_error(run: RecordedRun, robot: StationRobot) -> AxisValues | None:
    """Measure the distance of each axis from its target at the end of a run [rad or m].

    The target is the posture of a controller, if one has such a posture, and the reference otherwise. Returns None for
    a run that did not end regularly, that a fall ended, or that the next run of its program continues (its motion is
    not at its end); and for a kinematic run, in which axes are always at their reference.
    """
    # The user may interrupt a run anywhere, and a robot that fell lies anywhere: such an error shows nothing.
    if run.ending not in _REGULAR_ENDINGS or robot_that_fell(run) is not None or run.is_continued:
        return None
    ends = np.full(len(robot.axes), run.stop_time)
    distances = _errors_at_end(run, robot)
    if distances is not None:
        return AxisValues(distances, ends)
    errors = _errors(run, robot)
    if errors is None:
        return None
    return AxisValues(errors[-1], ends, left_out=_without_error(run, robot))


@_of_each_robot
def _largest_error(run: RecordedRun, robot: StationRobot) -> AxisValues | None:
    """Measure the largest distance of each axis from its reference [rad or m].

    Returns None for a kinematic run, and if a controller has a target posture of its own, for which it leaves the
    reference.
    """
    errors = _errors(run, robot)
    if errors is None or _errors_at_end(run, robot) is not None:
        return None
    worst = largest(errors, run.times)
    return AxisValues(worst.values, worst.times, left_out=_without_error(run, robot))


@_of_each_robot
def _beyond_stop(run: RecordedRun, robot: StationRobot) -> AxisValues:
    """Measure how far each axis was beyond an end of its range [rad or m]; negative if it stayed within."""
    lower, upper = robot.model.axis_limits  # of each axis, shape (n,)
    position = run.axes("q", robot.name)
    excess = np.maximum(lower - position, position - upper)
    worst = largest(excess, run.times)
    return AxisValues(worst.values, worst.times)


@_of_each_robot
def _torque_share(run: RecordedRun, robot: StationRobot) -> AxisValues:
    """Measure the largest absolute torque of each axis, as a share of what its motor can give. Fingers are not judged.

    The limit that users read is the torque limit of the servo, also for motors whose torque falls with their speed.
    """
    worst = largest(torque_shares(run, robot), run.times)
    return AxisValues(
        worst.values,
        worst.times,
        limits=robot.gains.torque_limit,
        limit_units=tuple(robot.model.effort_units),
        left_out=_fingers(robot),
    )


@_of_each_robot
def _torque_time(run: RecordedRun, robot: StationRobot) -> AxisValues:
    """Measure the share of the run in which each axis was at its torque limit. Fingers are not judged."""
    # Samples are evenly spaced, so the share of the samples is the share of the time; in the functions below as well.
    is_at_limit = torque_shares(run, robot) > AT_LIMIT
    return AxisValues(is_at_limit.mean(axis=0), left_out=_fingers(robot))


def _speed_shares(run: RecordedRun, robot: StationRobot) -> Vector:
    """Absolute speeds of a robot's axes as shares of their limits, at all samples, shape (m, n)."""
    return np.asarray(np.abs(run.axes("v", robot.name)) / robot.speed_limits)


@_of_each_robot
def _speed_share(run: RecordedRun, robot: StationRobot) -> AxisValues:
    """Measure the largest speed of each axis, as a share of its limit."""
    worst = largest(_speed_shares(run, robot), run.times)
    units = tuple(f"{unit.si}/s" for unit in robot.model.units)
    return AxisValues(worst.values, worst.times, limits=robot.speed_limits, limit_units=units)


@_of_each_robot
def _speed_time(run: RecordedRun, robot: StationRobot) -> AxisValues:
    """Measure the share of the run in which each axis was faster than its limit."""
    is_too_fast = _speed_shares(run, robot) > 1.0
    return AxisValues(is_too_fast.mean(axis=0))


def _payload(run: RecordedRun) -> Measured | None:
    """Measure the mass that each robot carries, as a share of its rated payload. Robots without one are left out."""
    names = []
    loads = []
    rated_payloads = []
    for robot in run.plant.robots.values():
        if robot.model.payload is not None:
            names.append(robot.name)
            loads.append(robot.load)
            rated_payloads.append(robot.model.payload)
    if not names:
        return None
    rated = np.array(rated_payloads)
    return Measured(names, np.array(loads) / rated, limits=rated, limit_units=["kg"] * len(names))


def _tcp_speed(run: RecordedRun) -> Measured | None:
    """Measure the largest speed of each robot's tool centre point, as a share of its rated speed.

    Robots without a tool or a rated speed are left out.
    """
    robots = [
        robot
        for robot in run.plant.robots.values()
        if robot.tcp and robot.model.tcp_speed is not None
    ]
    if not robots or len(run.times) < 2:  # a speed is the difference of two samples
        return None
    speeds = []
    for robot in robots:
        position = np.column_stack([run[f"{robot.prefix}tcp.{axis}"] for axis in "xyz"])
        # No signal has this speed: it is the derivative of the recorded position, by central differences.
        velocity = np.gradient(position, run.times, axis=0)
        speeds.append(np.linalg.norm(velocity, axis=1))
    rated = np.array([robot.model.tcp_speed for robot in robots])
    worst = largest(np.column_stack(speeds) / rated, run.times)
    # `robot_of` in the module of remedies reads these names.
    names = [f"tool of {robot.name}" for robot in robots]
    return Measured(
        names, worst.values, worst.times, limits=rated, limit_units=["m/s"] * len(robots)
    )


@_of_each_robot
def _rated_time(run: RecordedRun, robot: StationRobot) -> AxisValues | None:
    """Measure the share of the run in which each motor gave more than its continuous (rated) torque.

    It is 0 for an axis whose rated torque is not known. Returns None if that of no axis is known.
    """
    rated = rated_torques(robot.motors)  # infinite if it is not known
    if not np.isfinite(rated).any():
        return None
    is_beyond = np.abs(run.axes("tau", robot.name)) > rated
    return AxisValues(is_beyond.mean(axis=0))


@_of_each_robot
def _heat(run: RecordedRun, robot: StationRobot) -> AxisValues | None:
    """Measure how warm each motor got; 1 is the final temperature with the continuous torque.

    With the thermal time constant T, the torque tau and the continuous torque tau_n, the temperature theta follows
    T dtheta/dt = (tau / tau_n)² - theta, from theta = 0 at the start. It is 0 for an axis whose continuous torque is
    not known. Returns None if that of no axis is known.
    """
    rated = rated_torques(robot.motors)  # infinite if it is not known: such a motor stays cold
    if not np.isfinite(rated).any():
        return None
    # The loss in the winding is proportional to the square of the current, and so to that of the torque.
    load = (run.axes("tau", robot.name) / rated) ** 2  # at m samples and n axes, shape (m, n)
    # Time since the sample before [s]; 0 for the first sample.
    steps = np.diff(run.times, prepend=run.times[0])
    # An axis without a motor has any time constant: its load is 0.
    time_constants = np.array(
        [1.0 if motor is None else motor.thermal_time for motor in robot.motors]
    )
    heat = np.zeros_like(load)
    for row in range(1, len(load)):
        # Exact for a constant load over the step: theta approaches the load by the share 1 - exp(-step / T).
        share = -np.expm1(-steps[row] / time_constants)
        heat[row] = heat[row - 1] + share * (load[row] - heat[row - 1])
    worst = largest(heat, run.times)
    return AxisValues(worst.values, worst.times)


MOTION = (
    Criterion(
        "final_error", "rad", "final error", "{of} ended {value} from its target position{during}",
        _final_error, remedy=sag_or_saturation,
    ),
    Criterion(
        "largest_error", "rad", "largest error", "{of} was {value} from its reference{when}",
        _largest_error, remedy=lag,
    ),
    Criterion("beyond_stop", "rad", "beyond a stop", "{of} was {value} beyond its range{when}", _beyond_stop),
    Criterion(
        "torque_share", "1", "torque", "{of} needed {value} of its torque limit, {amount},{when}",
        _torque_share, remedy=more_time_for_motors,
    ),
    Criterion(
        "torque_time", "1", "time at torque limit", "{of} was at its torque limit for {value} of the run",
        _torque_time, per_time=True, remedy=more_time_for_motors,
    ),
    Criterion(
        "speed_share", "1", "speed", "{of} moved at {value} of its speed limit, {amount},{when}",
        _speed_share, remedy=more_time_for_speed,
    ),
    Criterion(
        "speed_time", "1", "time over speed limit", "{of} exceeded its speed limit for {value} of the run",
        _speed_time, per_time=True,
    ),
    Criterion(
        "rated_time", "1", "time over rated torque",
        "{of} exceeded the rated torque of its motor for {value} of the run",
        _rated_time, per_time=True, remedy=rest_for_motor,
    ),
    Criterion(
        "heat", "1", "motor heat",
        "the motor of {of} reached {value} of the temperature rise at its rated torque{when}",
        _heat, remedy=rest_for_motor,
    ),
)  # fmt: skip
"""Criteria of axes."""


def _below_floor(run: RecordedRun) -> Measured | None:
    """Measure how deep tools in use, floating bases and free pieces were below the ground [m]; negative above it.

    The depth is that of their origins. Returns None if the station has no floor, or none of these.
    """
    if run.config.floor is None:
        return None
    signals = dict[str, str]()  # by subject, the name of the signal of its pose
    for robot in run.plant.robots.values():
        if robot.tcp:
            subject = message(
                "results.tool_named", "tool {name}", name=f"{robot.prefix}{robot.tcp}"
            )
            signals[subject] = f"{robot.prefix}tcp"
    for robot in run.plant.robots.values():
        if robot.floats:
            signals[f"{robot.prefix}base"] = f"{robot.prefix}base"
    for piece in run.config.free_pieces:
        signals[piece] = f"piece.{piece}"
    if not signals:
        return None
    ground = run.plant.ground
    depths = []
    for signal in signals.values():
        position = np.column_stack([run[f"{signal}.{axis}"] for axis in "xyz"])
        height = position[:, 2]
        is_level = ground.is_level_plane  # the ground is the plane z = 0
        # On the usual floor the depth is the negative height: no terrain has to be searched for each sample.
        depths.append(-height if is_level else ground.beneath(position) - height)
    worst = largest(np.column_stack(depths), run.times)
    return Measured(list(signals), worst.values, worst.times)


def _distance(run: RecordedRun) -> Measured | None:
    """Measure the smallest distance that each distance sensor measured [m]. Returns None if there is no such sensor."""
    columns = set(run.names)  # the signals that were recorded
    signals = [
        signal
        for signal in run.signals
        if signal.role == "distance" and columns.issuperset(signal.names)
    ]
    if not signals:
        return None
    distances = np.column_stack([run[signal.names[0]] for signal in signals])
    # `largest` of the negated distances finds the smallest.
    nearest = largest(-distances, run.times)
    return Measured([signal.part for signal in signals], -nearest.values, nearest.times)


def _penetration(run: RecordedRun) -> Measured | None:
    """Measure the largest depth to which pairs of bodies overlapped [m]. Returns None if no bodies overlapped.

    At each look of the run only the deepest of all overlaps counts, see `Touch`: other pairs may be missing.
    """
    depths = run.touch.depths  # by pair of bodies, the depth [m] and the time [s]
    if not depths:
        return None
    values, times = np.array(list(depths.values())).T
    pairs = [join_texts(bodies, message("base.and", " and ")) for bodies in depths]
    return Measured(pairs, values, times)


def _foot_slip(run: RecordedRun) -> Measured | None:
    """Measure the longest distance that each foot slid over the ground in one stance, see `StanceSlide` [m].

    The time is that at which this stance ended, by lifting the foot or by the end of the run. Without robots that can
    walk, the result has no subjects.
    """
    names = []
    distances = []
    times = []
    for (robot, link), slide in run.touch.slides.items():
        # The distance, and the index of the look at which the stance ended.
        distance, row = slide.longest
        names.append(f"{run.plant.robots[robot].prefix}{link}")
        distances.append(distance)
        times.append(run.touch.times[row])
    return Measured(names, np.array(distances), np.array(times))


def _shortened_steps(run: RecordedRun) -> Measured | None:
    """Measure how often the solver tried a step again with a shorter length, as a share of its steps.

    Returns None for a solver whose steps have one length, and for a run without steps.
    """
    if run.shortened is None or len(run.step_times) < 2:
        return None
    steps = np.array([len(run.step_times) - 1.0])
    solver = message("results.the_solver", "the solver")
    unit = message("results.steps_as_unit", "steps")
    return Measured([solver], run.shortened / steps, limits=steps, limit_units=[unit])


def _coupling_gap(run: RecordedRun) -> Measured | None:
    """Measure the largest gap of each coupling that holds two bodies together, at some times of the run [m or rad].

    Returns None if there is no such coupling.
    """
    # Springs are no constraints: they may be stretched.
    all_couplings = run.config.couplings.items()
    couplings = {
        name: one for name, one in all_couplings if one.constrains and isinstance(one, Between)
    }
    if not couplings:
        return None
    plant = run.plant.plant
    context = plant.CreateDefaultContext()
    rows = np.linspace(0, len(run.times) - 1, _COUPLING_SAMPLES).astype(int)  # indices of samples
    # A short run has fewer samples than times; each is measured once.
    times = run.times[np.unique(rows)]
    gaps = np.zeros((len(times), len(couplings)))
    for row, positions in enumerate(run.positions_at(times)):
        plant.SetPositions(context, positions)
        gaps[row] = [coupling.gap(run.plant, context) for coupling in couplings.values()]
    worst = largest(gaps, times)
    return Measured(list(couplings), worst.values, worst.times)


CRITERIA = (
    *MOTION,
    Criterion(
        "tcp_speed", "1", "tool speed", "{of} moved at {value} of its rated speed, {amount},{when}",
        _tcp_speed, remedy=more_time_for_speed,
    ),
    Criterion(
        "payload", "1", "payload", "{of} carried {value} of its rated payload, {amount}", _payload, remedy=less_load
    ),
    Criterion(
        "below_floor", "m", "depth below floor", "{of} was {value} below the floor{when}",
        _below_floor, remedy=contact_with_floor,
    ),
    Criterion("distance", "m", "nearest distance", "{of} measured a distance of {value}{when}", _distance, least=True),
    Criterion(
        "penetration", "m", "penetration", "{of} penetrated each other by {value}{when}",
        _penetration, remedy=stiffer_contact,
    ),
    Criterion(
        "resting_force", "1", "contact force at rest",
        "the contact forces on {of} at rest differ from its weight by {value}{when}", measure_resting_force,
    ),
    Criterion(
        "friction_share", "1", "friction",
        "the friction between {of} is {value} of the largest that their surfaces allow{when}", measure_friction_share,
    ),
    Criterion(
        "lost_piece", "m", "lost piece",
        "{of} slipped out of the fingers{when} and ended {value} from where they held it",
        measure_lost_piece, remedy=firmer_grip,
    ),
    Criterion("coupling_gap", "m", "open coupling", "coupling {of} opened by {value} (or mrad){when}", _coupling_gap),
    Criterion(
        "foot_slip", "m", "foot slip", "{of} slid {value} over the ground during one stance{when}",
        _foot_slip, remedy=more_grip,
    ),
    Criterion(
        "shortened_steps", "1", "solver retries", "{of} repeated {amount} with a shorter length",
        _shortened_steps, remedy=other_solver, shows_share=True,
    ),
)  # fmt: skip
"""All criteria, in the order in which a verdict lists them."""


register_core_names("measures", lambda: [criterion.name for criterion in CRITERIA])


def verdict_of(run: RecordedRun) -> Verdict:
    """Judge a single run by all criteria: those of the core, then those of installed extensions.

    Criteria that have nothing to measure in the run are left out. A program is judged by its runs, see `join_verdicts`.
    """
    measures = [criterion.of(run) for criterion in CRITERIA]
    further_criteria = usable_objects("measures", Criterion, named_by="name").values()
    measures += [_measure_of_extension(criterion, run) for criterion in further_criteria]
    # Both are empty if no bodies overlapped and no robot can walk: the rate of these evaluations does not matter then.
    has_touched = run.touch.depths or run.touch.slides
    return Verdict(
        measures=tuple(measure for measure in measures if measure is not None),
        sample_rate=run.config.sample_rate,
        contact_rate=run.touch.rate if has_touched else None,
        ended=run.end_in_words,
        severity_of_end=severity_of_end(run),
        doubts=tuple(run.solver_warnings),
    )


def _measure_of_extension(criterion: Criterion, run: RecordedRun) -> Measure | None:
    """Measure a run by a criterion of an installed extension, whose function may fail.

    Returns None if the run has nothing to measure. If the extension's function raises an error, an ExtensionWarning is
    given, and the result is None, too.
    """
    try:
        return criterion.of(run)
    except Exception as problem:
        # The function is of another package. Its error must not cost the user the result of a long run.
        reason = shorten(f"{type(problem).__name__}: {problem}", 200)
        warnings.warn(
            f"the run is not judged by {criterion.name}: {reason}", ExtensionWarning, stacklevel=2
        )
        return None
