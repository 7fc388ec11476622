"""The most likely remedy of each violated bound, and the key of the station that applies it.

A remedy with a key and a value can be applied at once, by ``--set KEY=VALUE`` or by a button. It is offered only if the
station takes the key, and if the recorded run shows the cause, such as a servo that is not at its torque limit.

Each public function finds the remedy of one criterion. It gets the run and the worst value of the criterion, ``entry``,
with its *subject*: the name of the axis, robot, tool, foot or pair of bodies that the value belongs to. In stations of
several robots, names of axes begin with that of their robot. ``run.did`` is a text if a command or a program planned
the motion of the run. It is empty if the station's file gives the motion.
"""

from collections.abc import Callable
from math import ceil, floor, log10
from typing import Protocol

import numpy as np
import numpy.typing as npt

from simrob_drake.base.messages import message
from simrob_drake.base.remarks import Remedy
from simrob_drake.blocks.servo import AT_LIMIT
from simrob_drake.parts.station_plant import StationRobot
from simrob_drake.results.record.run import RecordedRun
from simrob_drake.results.record.torques import torque_shares
from simrob_drake.stations.solver_config import ContinuousSolver
from simrob_drake.stations.start_jump import axes_off_reference, jump_text


class WorstValue(Protocol):
    """The worst value of a criterion, as remedies look at it."""

    @property
    def subject(self) -> str:
        """Name of the subject, such as an axis."""

    @property
    def value(self) -> float:
        """The value, in SI units, or a share."""


MakeRemedy = Callable[[RecordedRun, WorstValue], Remedy | None]
"""Finds the remedy of the worst value of a violated criterion; returns None if none is known."""

_MORE_TIME = 2.0
"""A move that a motor at its limit cannot do in time is given this many times its duration."""

_MARGIN = 1.1
"""A move that is too fast is given the duration at which its speed would be at the limit, times this."""

_AT_REST = 0.01
"""An axis is at rest if its speed is below this share of its limit."""

_ANY_GRAVITY = 1e-6
"""Gravity acts on an axis if its torque is at least this share of the motor's torque."""

_SHARE_OF_START = 0.5
"""An error at the start of at least this share of the largest error is taken for its cause."""

_MOST_SWINGS = 4
"""A servo with more swings than this about a reference at rest lacks damping: a damped one has a few that count."""

_SHARE_OF_SWING = 0.5
"""A swing to one side counts if it is at least this share of the largest: those of a damped servo get small."""

_SMALLEST_SWING = 1e-3
"""Smaller swings about the reference are not spoken of [rad, or m of sliding axes]."""

_SHARE_OF_SAG = 0.5
"""An axis that keeps at least this share of its largest error when the robot rests sags, rather than lags."""

_STIFFER = 10.0
"""Bodies that sink into each other too deep get a contact stiffness so many times larger."""


def sag_or_saturation(run: RecordedRun, entry: WorstValue) -> Remedy | None:
    """Remedy of an axis, or of a robot's tool, that is not where it should be.

    If a servo swings about its reference, the remedy is damping; if a motor of the robot was saturated at any time, it
    is that of this motor; if an axis still moves at the end, it is the remedy of a lag. Otherwise gravity most likely
    causes the error: the remedy is gravity feedforward, or larger gains for servos that cannot have it or have it
    already. Returns None for a kinematic station, and if no robot is found.
    """
    robot = robot_of(run, entry.subject)
    if robot is None or not run.config.engine.moves_by_forces:
        return None
    damping = _damping_of_swing(run, robot)
    if damping is not None:
        return damping
    # A motor at its limit leaves an error whatever the gains are, so saturation is checked before the servo.
    if torque_shares(run, robot).max(initial=0.0) >= AT_LIMIT:
        return more_time_for_motors(run, entry)
    # An error that lasts while the reference moves is a lag, which gravity feedforward would not remove.
    if _moves_at_end(run, robot):
        return lag(run, entry)
    return _against_sag(run, robot)


def _against_sag(run: RecordedRun, robot: StationRobot) -> Remedy:
    """Remedy of servos that rest away from their reference: feedforward if they can have it, or else larger gains."""
    if not _takes_feedforward(run, robot):
        text = message("results.remedy_stiffer_servo", "raise the servo's gains kp and kd")
        return Remedy(text, key=_servo_key(run, robot, "kp"))
    text = message(
        "results.remedy_gravity", "the servos sag under gravity: turn on gravity feedforward"
    )
    return Remedy(text, key=_servo_key(run, robot, "feedforward"), value="gravity")


def lag(run: RecordedRun, entry: WorstValue) -> Remedy | None:
    """Remedy of an axis that is too far from its reference during the run: more time, or larger gains.

    If a servo swings about its reference, the remedy is damping; if the reference begins away from the robot, it is
    another start; if a motor of the robot was saturated at any time, it is the remedy of that motor; if at least half
    of the error is left when the robot rests, it is that of a sag. Returns None for a kinematic station, and if no
    robot is found.
    """
    robot = robot_of(run, entry.subject)
    if robot is None or not run.config.engine.moves_by_forces:
        return None
    damping = _damping_of_swing(run, robot)
    if damping is not None:
        return damping
    jump = _start_at_reference(run, robot, entry.subject)
    if jump is not None:
        return jump
    if torque_shares(run, robot).max(initial=0.0) >= AT_LIMIT:
        return more_time_for_motors(run, entry)
    if not _moves_at_end(run, robot) and _rests_away(run, robot, entry.subject):
        return _against_sag(run, robot)
    text = message(
        "results.remedy_lag", "the servos lag behind: give the motion more time, or raise kp and kd"
    )
    return _with_longer_reference(run, robot, text, _MORE_TIME)


def more_time_for_motors(run: RecordedRun, entry: WorstValue) -> Remedy | None:
    """Remedy of a motor that is at its torque limit.

    If a servo swings about its reference, the remedy is damping. If a motor of the robot is still saturated at the
    end, it presses on an obstacle or is too weak for the posture. If the reference begins away from the
    robot, the remedy is another start; for a robot with a floating base, slower steps or another motion. Otherwise it
    is more time. Returns None if no robot is found.
    """
    robot = robot_of(run, entry.subject)
    if robot is None:
        return None
    known = (
        _damping_of_swing(run, robot)
        or _less_torque_at_rest(run, robot)
        or _start_at_reference(run, robot, entry.subject)
    )
    if known is not None:
        return known
    if robot.model.base == "floating":
        return _slower_legs(run, robot, entry.subject)
    text = message("results.remedy_more_time", "give the motion more time")
    return _with_longer_reference(run, robot, text, _MORE_TIME)


def _less_torque_at_rest(run: RecordedRun, robot: StationRobot) -> Remedy | None:
    """Remedy of motors that are at their torque limits at the last sample, which more time does not help.

    They press on an obstacle, or are too weak for the posture. Returns None if no motor is at its limit at the end, and
    for a robot on legs that still moves then: in a walk, motors may be at their limits for a moment.
    """
    saturated = _saturated_at_end(run, robot)
    if not saturated.any():
        return None
    if robot.model.base == "floating" and _moves_at_end(run, robot):
        return None
    if _presses_on_something(run, robot, saturated):
        text = message(
            "results.remedy_pressing",
            "at the end the motor presses against an obstacle instead of carrying a load: remove the obstacle, "
            "or move the target",
        )
        return Remedy(text)
    text = message(
        "results.remedy_weak_motor",
        "the motor is too weak to hold this posture: reduce the load, or raise its torque limit",
    )
    return Remedy(text, key=_servo_key(run, robot, "torque_limit"))


def more_time_for_speed(run: RecordedRun, entry: WorstValue) -> Remedy | None:
    """Remedy of an axis or a tool that moves too fast: more time, in proportion to its speed.

    If a servo swings about its reference, it is damping. For a robot with a floating base it is slower steps or another
    motion. For a robot on a fixed base whose reference begins away from it, it is another start. Returns None if no
    robot is found.

    Args:
        run: the run.
        entry: the speed, as a share of its limit.
    """
    robot = robot_of(run, entry.subject)
    if robot is None:
        return None
    damping = _damping_of_swing(run, robot)
    if damping is not None:
        return damping
    if robot.model.base == "floating":
        # The reference of a robot on legs comes from its walk: it has no duration that could be longer.
        return _slower_legs(run, robot, entry.subject)
    jump = _start_at_reference(run, robot, entry.subject)
    if jump is not None:
        return jump
    text = message("results.remedy_more_time", "give the motion more time")
    # Speeds are inversely proportional to the duration: a share of 1.3 of the limit needs 1.3 times the time.
    return _with_longer_reference(run, robot, text, _MARGIN * entry.value)


def _slower_legs(run: RecordedRun, robot: StationRobot, subject: str) -> Remedy:
    """Remedy of an axis of a robot on legs that moves too fast, or whose motor is at its limit: slower steps.

    This is so for an axis of a leg if a walk moves it: a controller of the station, or a planned move of a program. For
    other axes it is another motion.

    Args:
        run: the run.
        robot: the robot, whose base floats.
        subject: name of the axis, such as ``left.left_knee``.
    """
    # The class of the section is not imported here: it loads scipy, and every run imports this module.
    walks = [
        name
        for name, section in run.config.controllers.items()
        if getattr(section, "kind", "") == "walk"
        and (getattr(section, "robot", None) or run.config.only_robot) == robot.name
    ]
    axis = subject.removeprefix(robot.prefix)
    if axis not in robot.axes or not _is_of_leg(run, robot, robot.axes.index(axis)):
        return Remedy(_SLOWER_MOTION)
    if walks:
        key = f"controllers.{walks[0]}.gait.step_time"
        return Remedy(
            message("results.remedy_slower_loop", "take slower steps: --set {key}=SECONDS", key=key)
        )
    if run.did:  # a planned move, of a program or of the command line
        text = message(
            "results.remedy_slower_walk",
            "take shorter steps (simrob walk ... --amplitude 0.5) or slower ones (--step-time SECONDS, longer than "
            "now); in a program: {example}",
            example="{walk: {steps: 4, amplitude: 0.5}}",
        )
        return Remedy(text)
    return Remedy(_SLOWER_MOTION)


# Some robots on legs do not walk: a reference or a loop of the user moves their joints.
_SLOWER_MOTION = message(
    "results.remedy_slower_motion",
    "change the reference or the loop so that this joint moves less far or more slowly, or choose a faster "
    "motor",
)


def _is_of_leg(run: RecordedRun, robot: StationRobot, axis: int) -> bool:
    """Whether an axis moves a foot of its robot. It is False for a robot without feet.

    Args:
        run: a run of the robot's station.
        robot: the robot.
        axis: index of the axis.
    """
    if robot.feet is None:
        return False
    plant = run.plant.plant
    moved = set(plant.GetBodiesKinematicallyAffectedBy([robot.joints[axis].index()]))
    feet = {plant.GetFrameByName(link, robot.instance).body().index() for link in robot.feet.links}
    return bool(moved & feet)


def _start_at_reference(run: RecordedRun, robot: StationRobot, subject: str) -> Remedy | None:
    """Remedy of an axis whose reference begins away from the robot: more time does not help.

    The remedy is another initial posture. It is offered if the error of the axis at the start of the run is at least
    half of its largest error, and one that `axes_off_reference` reports. Returns None otherwise, if the subject is no
    axis of the robot, and for a run that continues a motion.

    Args:
        run: the run.
        robot: the robot that the axis belongs to.
        subject: name of the axis, such as ``left.joint_2``.
    """
    # Index of the axis; None for another subject, such as a tool.
    axis = next(
        (index for index, name in enumerate(robot.axes) if f"{robot.prefix}{name}" == subject), None
    )
    # A run that continues a motion begins where the robot is, which lags behind its reference.
    if axis is None or run.continues:
        return None
    positions = run.axes("q", robot.name)
    references = run.axes("q_ref", robot.name)
    errors = np.abs(references[:, axis] - positions[:, axis])
    if errors[0] < _SHARE_OF_START * errors.max():
        return None
    if axis not in axes_off_reference(robot, positions[0], references[0]):
        return None
    text = message(
        "results.remedy_start",
        "{jump}: set {key}, or begin the reference where the robot begins",
        jump=jump_text(robot, axis, positions[0, axis], references[0, axis]),
        key=f"{run.config.robot_key(robot.name)}.initial_deg",
    )
    # A run that begins in a state, a planned motion, and a robot with a floating base need more than this key to begin
    # in another posture.
    if run.start is not None or run.did or robot.model.base == "floating":
        return Remedy(text)
    # The key takes degrees and metres.
    start = [_round_position(value) for value in references[0] / robot.model.user_units]
    return Remedy(text, key=f"{run.config.robot_key(robot.name)}.initial_deg", value=start)


def less_load(run: RecordedRun, entry: WorstValue) -> Remedy | None:
    """Remedy of a robot that carries more than its rated payload: a smaller load, of which it names the parts.

    Returns None if no robot is found.
    """
    robot = robot_of(run, entry.subject)
    if robot is None:
        return None
    text = message(
        "results.remedy_less_load",
        "reduce the load ({pieces}), or choose a robot with a larger payload",
        pieces=robot.load_in_words,
    )
    return Remedy(text)


def contact_with_floor(run: RecordedRun, entry: WorstValue) -> Remedy | None:
    """Remedy of a body that sank into the floor: contact, if the station has none.

    In a kinematic station contact would have no effect, so the remedy is another target. Returns None if the station
    has contact.
    """
    del entry  # the remedy is the same for all bodies
    # With contact, a body below the floor is a matter of the contact's stiffness, which another criterion
    # judges.
    if run.config.contact is not None:
        return None
    if not run.config.engine.moves_by_forces:
        text = message(
            "results.remedy_no_contact_kinematic",
            "this station has no contact: its floor is only drawn. Keep the target above the floor",
        )
        return Remedy(text)
    text = message(
        "results.remedy_no_contact",
        "this station has no contact: its floor is only drawn. Turn contact on",
    )
    solver = run.config.solver
    if not isinstance(solver, ContinuousSolver) or solver.engine.holds_joint_limits:
        return Remedy(text, key="contact", value={})
    # Other schemes with error control shorten their steps to microseconds where a body hits the floor: an arm that does
    # so at full speed takes radau3 hours, and the discrete solver sap about as long as the motion lasts.
    text = message(
        "results.remedy_contact_in_steps",
        "this station has no contact: its floor is only drawn. Turn contact on, with a solver of fixed steps",
    )
    further: dict[str, object] = {"solver.kind": "discrete"}
    for robot in run.plant.robots.values():
        if _may_be_implicit(run, robot):
            # Servos as blocks act once a step, which makes stiff ones unstable.
            further[_servo_key(run, robot, "realization")] = "implicit"
    return Remedy(text, key="contact", value={}, further=tuple(further.items()))


def stiffer_contact(run: RecordedRun, entry: WorstValue) -> Remedy | None:
    """Remedy of two bodies that are too deep in each other: a stiffer contact.

    Returns None if the station has no contact, or does not set the stiffness of its contact.
    """
    del entry  # the remedy is the same for all bodies
    contact = run.config.contact
    # Without the key, the stiffness is that of each shape's file or of Drake: there is no number to multiply.
    if contact is None or contact.stiffness is None:
        return None
    text = message("results.remedy_stiffer_contact", "make the contact stiffer")
    return Remedy(text, key="contact.stiffness", value=_readable(_STIFFER * contact.stiffness))


def more_grip(run: RecordedRun, entry: WorstValue) -> Remedy:
    """Remedy of a foot that slides over the ground."""
    del run, entry  # the remedy is the same for all feet
    return Remedy(
        message(
            "results.remedy_more_grip",
            "take shorter steps, or raise the friction of sole and floor",
        )
    )


def firmer_grip(run: RecordedRun, entry: WorstValue) -> Remedy:
    """Remedy of a piece that slipped out of fingers."""
    del run, entry  # the remedy is the same for all pieces
    text = message(
        "results.remedy_firmer_grip",
        "grip with more force, or raise the friction of the fingers and of the piece",
    )
    return Remedy(text)


def other_solver(run: RecordedRun, entry: WorstValue) -> Remedy:
    """Remedy of a solver that retries its steps too often."""
    del run, entry  # the remedy is the same for all stations
    text = message(
        "results.remedy_other_solver",
        "choose another solver scheme, or smaller gains and stiffnesses",
    )
    return Remedy(text, key="solver.scheme")


def rest_for_motor(run: RecordedRun, entry: WorstValue) -> Remedy:
    """Remedy of a motor that becomes too hot."""
    del run, entry  # the remedy is the same for all motors
    return Remedy(
        message("results.remedy_cooler_motor", "add pauses between the moves, or reduce the load")
    )


def robot_of(run: RecordedRun, subject: str) -> StationRobot | None:
    """Find the robot that a value belongs to.

    Args:
        run: the run.
        subject: name of an axis, such as ``left.joint_2``; of a robot; or of its tool, such as ``tool of left``.

    Returns:
        the only robot of a station, whatever the subject is; of several robots the one that the subject belongs to, or
        None if it belongs to none.
    """
    if len(run.plant.robots) == 1:
        return next(iter(run.plant.robots.values()))
    for name, robot in run.plant.robots.items():
        # In a station of several robots, the names of axes begin with that of their robot.
        if subject in (name, f"tool of {name}") or subject.startswith(robot.prefix):
            return robot
    return None


def _moves_at_end(run: RecordedRun, robot: StationRobot) -> bool:
    """Whether an axis of a robot still moves at the end of the run, faster than 1 % of its speed limit."""
    speeds = np.abs(run.axes("v", robot.name)[-1]) / robot.speed_limits
    return bool(speeds.max(initial=0.0) > _AT_REST)


def _rests_away(run: RecordedRun, robot: StationRobot, subject: str) -> bool:
    """Whether at least half of the largest error of an axis is left at the end of the run.

    Args:
        run: the run.
        robot: the robot that the axis belongs to.
        subject: name of the axis, such as ``left.joint_2``. For another subject, such as a tool, the axis with the
            largest error counts.
    """
    errors = np.abs(run.axes("q_ref", robot.name) - run.axes("q", robot.name))
    names = [f"{robot.prefix}{axis}" for axis in robot.axes]
    axis = names.index(subject) if subject in names else int(errors.max(axis=0).argmax())
    return bool(errors[-1, axis] >= _SHARE_OF_SAG * errors[:, axis].max())


def _damping_of_swing(run: RecordedRun, robot: StationRobot) -> Remedy | None:
    """Remedy of a servo that swings about its reference without end: more damping. Returns None if none swings."""
    for index, axis in enumerate(robot.axes):
        # An axis without kp, such as a pendulum's, swings by itself.
        if robot.gains.passive[index] or robot.gains.kp[index] == 0:
            continue
        if not _swings(run, robot, index):
            continue
        text = message(
            "results.remedy_swing",
            "the servo of {axis} swings about its reference: raise kd, or reduce kp",
            axis=f"{robot.prefix}{axis}",
        )
        return Remedy(text, key=_servo_key(run, robot, "kd"))
    return None


def _swings(run: RecordedRun, robot: StationRobot, index: int) -> bool:
    """Whether an axis swings about its reference, which rests, and does not calm down.

    It does not if, since the reference last moved, more than four swings reach at least half as far as the farthest
    one. Swings of less than 1e-3 (rad or m) do not count.

    Args:
        run: the run.
        robot: the robot.
        index: index of the axis.
    """
    reference = run.axes("q_ref", robot.name)[:, index]
    position = run.axes("q", robot.name)[:, index]
    # The last stretch of the run in which the reference rests.
    moves = np.flatnonzero(np.diff(reference))
    rest = slice(moves[-1] + 1 if len(moves) else 0, None)
    error = (reference - position)[rest]
    # Between two crossings of the reference, the error has one sign.
    swings = np.split(error, np.flatnonzero(np.diff(np.sign(error))) + 1)
    peaks = np.array([np.abs(swing).max(initial=0.0) for swing in swings])
    if peaks.max(initial=0.0) < _SMALLEST_SWING:
        return False
    counted = peaks >= _SHARE_OF_SWING * peaks.max()
    return int(np.count_nonzero(counted)) > _MOST_SWINGS


def _takes_feedforward(run: RecordedRun, robot: StationRobot) -> bool:
    """Whether gravity feedforward may be turned on: for a robot with a fixed base that has no feedforward yet.

    The model of a robot with a floating base lacks the contact forces that carry it. Servos with the law
    ``computed_torque`` compensate gravity anyway.
    """
    servo = run.config.servo_of(robot.name)
    return (
        servo.law != "computed_torque"
        and servo.feedforward == "none"
        and robot.model.base != "floating"
    )


def _may_be_implicit(run: RecordedRun, robot: StationRobot) -> bool:
    """Whether the servos of a robot may become part of the solver (the realization ``implicit``).

    Servos whose law uses a model, or that yield to forces (an admittance), may not; nor may those of a station that
    prescribes the motion of some joints.
    """
    servo = run.config.servo_of(robot.name)
    return servo.law == "pid" and not servo.admittance_gain and not run.config.prescribed


def _saturated_at_end(run: RecordedRun, robot: StationRobot) -> npt.NDArray[np.bool_]:
    """Whether each motor is at its torque limit at the last sample, so that more time would not help, shape (n,)."""
    return np.asarray(torque_shares(run, robot)[-1] >= AT_LIMIT)


def _presses_on_something(
    run: RecordedRun, robot: StationRobot, saturated: npt.NDArray[np.bool_]
) -> bool:
    """Whether, at the end of a run, none of the saturated motors acts against gravity.

    A motor that carries a load acts against gravity. One that acts with gravity, or across it, presses on something.

    Args:
        run: the run.
        robot: the robot. The result is False if its base floats, since its motors then act against the ground; if it
            still moves, since its motors may then accelerate it; and in a kinematic station.
        saturated: whether each motor is at its limit, shape (n,).
    """
    if (
        not run.config.engine.moves_by_forces
        or robot.model.base == "floating"
        or _moves_at_end(run, robot)
    ):
        return False
    plant = run.plant.plant
    context = plant.CreateDefaultContext()
    (positions,) = run.positions_at(run.times[-1:])
    plant.SetPositions(context, positions)
    gravity = robot.axis_map.efforts(plant.CalcGravityGeneralizedForces(context))
    torque = run.axes("tau", robot.name)[-1]
    # Against gravity, the product is negative. Rounding leaves a tiny torque of gravity about a vertical axis.
    against_gravity = -gravity * torque > _ANY_GRAVITY * torque**2
    return not bool(against_gravity[saturated].any())


def _round_position(value: float) -> float:
    """Round a position of an axis to six significant digits, without a negative zero."""
    # Adding zero turns -0.0 into 0.0.
    return float(f"{value:.6g}") + 0.0


def _servo_key(run: RecordedRun, robot: StationRobot, key: str) -> str:
    """Dotted key of an entry of the servo section that a robot uses: its own one, or the station's."""
    has_own_section = run.config.robots[robot.name].servo is not None
    return f"{run.config.robot_key(robot.name)}.servo.{key}" if has_own_section else f"servo.{key}"


def _with_longer_reference(
    run: RecordedRun, robot: StationRobot, text: str, factor: float
) -> Remedy:
    """Remedy that makes the motion longer: with a key if the station's file gives a reference with a duration.

    The key has a value only if the longer motion ends within the run.

    Args:
        run: the run.
        robot: the robot that moves.
        text: the remedy in words.
        factor: by how much the motion is to last longer.
    """
    reference = run.config.reference_of(robot.name)
    duration = getattr(reference, "duration", None)
    if duration is None or run.references.get(robot.name) is not None or run.did:
        return Remedy(text)  # a program, or Python code, decides how the robot moves
    has_own_section = run.config.robots[robot.name].reference is not None
    section = f"{run.config.robot_key(robot.name)}." if has_own_section else ""
    longer = _readable(factor * duration)
    # A motion that outlasts the run would not reach its target: then the user chooses both durations.
    fits = getattr(reference, "start", 0.0) + longer <= run.config.duration
    return Remedy(text, key=f"{section}reference.duration", value=longer if fits else None)


def _readable(value: float) -> float:
    """Round a positive value up to two significant digits."""
    # Without the small number, an error of the arithmetic would round 0.30000000000000004 up to 0.31.
    scale = 10.0 ** (floor(log10(value)) - 1)
    return float(f"{ceil(value / scale - 1e-9) * scale:.2g}")
