r"""Loop that keeps a standing robot on its feet, by the motion of its centre of mass: ankles, hips, arms, and steps.

Let c be the centre of mass, measured from its position relative to the feet at the start. A robot that gives way in
its ankles alone comes to rest over its **capture point** :math:`\xi`, and falls once that leaves the area of its feet:

.. math:: \xi = c + \frac{\dot c}{\omega}, \qquad \omega = \sqrt{g/h} .

A *strategy* moves axes by the error e in one direction, with a lead time :math:`T` (:math:`1/\omega` by default). It
does nothing up to its threshold b, and moves the axes by their largest offset :math:`a_i` from the error :math:`e_1`
on. The trunk or an arm that swings then balances the rest:

.. math:: e = c + T \dot c, \qquad
    \Delta q_i = a_i \,\mathrm{sign}(e)\, \mathrm{clip}\Bigl(\frac{|e| - b}{e_1 - b}, 0, 1\Bigr) .

A *capture step* sets one foot where the robot falls. In the code, the *part* of a strategy or of a step is the factor
of its offsets, from 0 to 1; a strategy for both directions has parts from -1 to 1. For prismatic axes, read m for rad.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal, NamedTuple

import numpy as np
from pydantic import Field, model_validator
from pydrake.systems.framework import DiagramBuilder, OutputPort

from simrob_drake.base.errors import one_of
from simrob_drake.base.frames import Vector, rotation_of
from simrob_drake.base.messages import message
from simrob_drake.base.sections import NotNegative, Number, Positive, Strict
from simrob_drake.blocks.block import add_matrix_gain
from simrob_drake.blocks.sampled import Changes, Named, SampledBlock
from simrob_drake.parts.controllers.loop import LoopSection
from simrob_drake.parts.controllers.support import BalanceState, Direction, Support
from simrob_drake.parts.resolved import ResolvedRobot, StationContents
from simrob_drake.parts.site import Site
from simrob_drake.parts.station_plant import StationRobot

# Height above the lowest foot up to which a foot touches the floor, since servos and contacts give way [m].
_TOUCH_HEIGHT = 0.003
# Part of a step's time after which the foot has its full reach, and only comes down [1].
_REACH_TIME = 0.7
# Part of a step's time from which a touch ends the step: before, the foot has not left the floor [1].
_LIFT_TIME = 0.5


class CaptureStep(Strict):
    """Set a foot where the robot falls, once the error is large, and stay standing there."""

    measures: Direction
    """Direction of the error, as in a strategy."""
    foot: str
    """Link of the foot that is lifted."""
    beyond: Positive
    """Error from which on it steps [m]."""
    full: Positive
    """Error for which it reaches as far as ``reach_deg`` [m]; in proportion for smaller errors."""
    least: NotNegative = 0.0
    """Least part of ``reach_deg`` that it reaches."""
    lead: NotNegative | None = None
    """Lead time T of the error [s]; if left out, 1/ω, which makes the error that of the capture point."""
    duration: Positive
    """Time for which the foot is in the air [s]."""
    settle: Positive = 0.3
    """Time constant with which the legs then approach their new posture [s]."""
    stance: Annotated[Number, Field(ge=0, le=1)] = 1.0
    """Part of its reach that the standing leg moves while the foot is in the air; the rest follows as they settle."""
    lift_deg: dict[str, Number] = Field(min_length=1)
    """Offsets of axes in the middle of the step, to lift the foot, by name [deg]."""
    reach_deg: dict[str, Number] = Field(min_length=1)
    """Offsets of axes once the foot is down, by name [deg]."""


@dataclass(frozen=True)
class Stepping:
    """A capture step of a robot with n axes.

    Attributes:
        section: section of the step.
        foot: index of the foot among the robot's feet.
        lift: offsets of the axes in the middle of the step, shape (n,) [rad].
        reach: offsets of the axes once the foot is down, shape (n,) [rad].
    """

    section: CaptureStep
    foot: int
    lift: Vector
    reach: Vector

    def part(self, state: BalanceState) -> float:
        """Part of the reach that answers the robot's deviation from its stance: e / ``full``, from ``least`` to 1.

        The error e is that in the direction of the section.
        """
        section = self.section
        error = state.error(section.measures, section.lead)
        return min(max(error / section.full, section.least), 1.0)

    def offsets(self, time: float, part: float) -> Vector:
        """Compute the offsets of the axes during the step, shape (n,) [rad].

        Args:
            time: part of the step's duration that has passed, 0 to 1.
            part: part of the reach, 0 to 1.
        """
        # The foot is lifted by half a sine. It reaches ahead by the cubic s^2 (3 - 2 s), which begins and ends at rest.
        reach_time = min(time / _REACH_TIME, 1.0)
        smooth_reach = part * reach_time * reach_time * (3 - 2 * reach_time)
        # Axes without a lift are taken to be those of the standing leg. They only move a share of their reach for now.
        share = np.where(self.lift, 1.0, self.section.stance)
        return math.sin(math.pi * time) * self.lift + smooth_reach * share * self.reach


class StepState(NamedTuple):
    """State of the capture steps.

    Attributes:
        step: number of the step that the robot takes, from 1; 0 for none.
        time: part of its duration that has passed; 1 once the foot is down.
        part: part of its reach.
    """

    step: float
    time: float
    part: float


class StepChooser:
    """Chooses one of several capture steps, and computes its offsets. The robot takes one step, and stays there."""

    def __init__(self, steps: Sequence[Stepping], period: float) -> None:
        """Create the chooser.

        Args:
            steps: steps that the robot may take.
            period: time between two samples [s].
        """
        self._steps = steps
        self._period = period

    def next(self, state: Vector, offset: Vector, balance: BalanceState) -> tuple[Vector, Vector]:
        """Compute the state and the offsets of the axes after a sample.

        Args:
            state: state before the sample, shape (3,), see `StepState`.
            offset: offsets of the axes by the step alone before the sample, shape (n,) [rad].
            balance: deviation of the robot from its stance.

        Returns:
            The new state (3,) and the new offsets (n,) [rad]. Both are the old ones if no step has begun or begins.
        """
        before = StepState(*state.tolist())
        number = int(before.step) or self._choose(balance)
        if number == 0:
            return state, offset

        step = self._steps[number - 1]
        if before.time >= 1:
            # The foot is down. The offsets approach those of the reach exponentially, and stay there for good.
            approach = min(self._period / step.section.settle, 1.0)
            goal = before.part * step.reach
            return state, offset + approach * (goal - offset)

        # The time of a step counts as a part of its duration, from 0 to 1.
        time = min(before.time + self._period / step.section.duration, 1.0)
        # The reach may still grow with the error. It never shrinks, or the foot would be pulled back in the air.
        part = max(before.part, step.part(balance))
        new_offset = step.offsets(time, part)
        # A foot that touches the floor early ends the step. What is still lifted then settles slowly, as after any
        # step: a jump of the offsets would make the leg kick.
        if time > _LIFT_TIME and balance.lifted[step.foot] < _TOUCH_HEIGHT:
            time = 1.0
        new_state = StepState(step=number, time=time, part=part)
        return np.array(new_state), new_offset

    def _choose(self, balance: BalanceState) -> int:
        """Find the first step, in the order of the section, whose error exceeds its threshold ``beyond``.

        Args:
            balance: deviation of the robot from its stance.

        Returns:
            The number of the step, from 1. It is 0 if no error does.
        """
        for number, step in enumerate(self._steps, 1):
            if balance.error(step.section.measures, step.section.lead) > step.section.beyond:
                return number
        return 0


class Strategy(Strict):
    """Offsets of some axes in answer to an error in one direction."""

    measures: Direction
    """Direction of the error: ahead (negative behind), to the left (negative to the right), or on one side alone."""
    moves_deg: dict[str, Number] = Field(min_length=1)
    """Largest offset of each axis, by name [deg, or m for a prismatic axis]."""
    beyond: NotNegative = 0.0
    """Error up to which nothing moves [m]."""
    full: Positive
    """Error from which on the axes have their largest offsets [m]."""
    lead: NotNegative | None = None
    """Lead time T of the error [s]; if left out, 1/ω, which makes the error that of the capture point."""
    rise: NotNegative = 0.05
    """Least time from no offset to the largest one [s]."""
    release: NotNegative = 0.05
    """Least time from the largest offset to none [s]."""

    @model_validator(mode="after")
    def _check_offsets(self) -> "Strategy":
        """Check that ``full`` is larger than ``beyond``, and that an axis moves.

        Raises:
            ValueError: ``full`` is not larger than ``beyond``, or all offsets are 0.
        """
        if self.full <= self.beyond:
            raise ValueError(
                message(
                    "parts.full_beyond",
                    "full is {full:g} m; it must be larger than beyond, {beyond:g} m",
                    full=self.full,
                    beyond=self.beyond,
                )
            )
        if not any(self.moves_deg.values()):
            raise ValueError(
                message(
                    "parts.moves_all_zero",
                    "all moves_deg are 0; at least one axis must have an offset",
                )
            )
        return self


class Balance(LoopSection):
    """Answer pushes to a robot that stands: by strategies for ankles, hips, arms and knees, added up, and by a step."""

    label: ClassVar[str] = message("parts.loop_balance", "balance")
    stages: ClassVar[tuple[str, ...]] = (
        message("parts.stage_capture_point", "Capture point"),
        message("parts.stage_strategies", "Strategies\nankles, hips, arms"),
        message("parts.stage_step", "Capture step\nfor large errors"),
    )

    kind: Literal["balance"]
    facing_deg: Number = 0.0
    """Direction in which the robot looks at the start: 0 along the world's x axis, 90 along y."""
    strategies: dict[str, Strategy] = Field(default_factory=dict)
    """Strategies, by name."""
    steps: dict[str, CaptureStep] = Field(default_factory=dict)
    """Steps that it may take, by name: the first whose error is large enough, after which the strategies rest."""

    @model_validator(mode="after")
    def _check_actions(self) -> "Balance":
        """Check that the section has a strategy or a step.

        Raises:
            ValueError: it has neither.
        """
        if not self.strategies and not self.steps:
            raise ValueError(
                message(
                    "parts.nothing_would_move",
                    "balance has neither strategies nor steps; it needs at least one of them",
                )
            )
        return self

    def axes(self, robot: ResolvedRobot) -> Sequence[str]:
        """Names of the axes that strategies and steps move, each once. The section may write aliases of these names.

        Raises:
            SimrobError: the section names an axis that the robot does not have.
        """
        moves_by_key = {
            "moves_deg": [strategy.moves_deg for strategy in self.strategies.values()],
            "lift_deg": [step.lift_deg for step in self.steps.values()],
            "reach_deg": [step.reach_deg for step in self.steps.values()],
        }
        # The keys are each axis once, in the order in which the section names them.
        indices = dict[int, None]()
        for key, all_moves in moves_by_key.items():
            for moves in all_moves:
                for axis in moves:
                    indices[robot.model.axis_index(axis, key)] = None
        return [robot.axes[index] for index in indices]

    def check(self, key: str, station: StationContents) -> None:
        """Check that the robot stands on feet of its own and that the steps' feet exist.

        Args:
            key: key of the section, for errors.
            station: contents of the station.

        Raises:
            SimrobError: the robot does not stand on feet of its own, or a step names a foot that it does not have; or
                by the checks of the base class an axis does not exist, the station has no servos, or the rate is too
                high.
        """
        super().check(key, station)
        robot = self.on_feet(key, station)
        assert robot.feet is not None  # on_feet() has checked it
        for name, step in self.steps.items():
            one_of(
                message(
                    "parts.foot_for_step",
                    "foot of {robot} for {key}.steps.{name}.foot",
                    robot=robot.name,
                    key=key,
                    name=name,
                ),
                step.foot,
                robot.feet.links,
            )

    def source(
        self, builder: DiagramBuilder, name: str, robot: StationRobot, site: Site, key: str
    ) -> OutputPort:
        """Find the port that an input of the loop reads.

        The orientation and the angular velocity of the base are computed from the plant's state, unless the section
        names a sensor for them. All other inputs are found as for every loop.

        Args:
            builder: builder of the diagram, to which a block may be added.
            name: name of the input.
            robot: robot that the loop drives.
            site: the station under construction.
            key: key of the section, ``controllers.<name>``.

        Raises:
            UnknownName: the station has no such output.
        """
        # Output of the station with the values, and its entries: a pose is (position, quaternion), a velocity is
        # (linear, angular).
        output_and_entries = {
            "orientation": ("base_pose", slice(3, 7)),
            "angular_velocity": ("base_velocity", slice(3, 6)),
        }
        if name in self.reads or name not in output_and_entries:
            return super().source(builder, name, robot, site, key)
        output, entries = output_and_entries[name]
        # The rule that computes the output from the plant's state. Without one, the input is looked up like any other.
        rule = site.outputs.of_state.get(f"{robot.prefix}{output}")
        if rule is None:
            return super().source(builder, name, robot, site, key)
        # The rule is a matrix, whose rows pick or combine entries of the state. The block that multiplies by it is no
        # step of the loop that a user should see, so the block picture leaves it out.
        block_name = f"{key}.{name}"
        site.picture.draw_nothing(block_name)
        rows = rule.matrix(site.state.size())[entries]
        return add_matrix_gain(builder, block_name, rows, site.state)

    def _block(self, key: str, robot: StationRobot, site: Site) -> SampledBlock:
        """Create the loop's block for its robot in the station under construction, the site. The key is for errors."""
        assert robot.feet is not None  # check() has checked it
        feet = list(robot.feet.links)

        def offsets(name: str, degrees: dict[str, float]) -> Vector:
            """Convert offsets by axis [deg, or m if prismatic] to offsets of all axes, shape (n,) [rad or m].

            Axes that are not named have the offset 0. The name is that of the key in the section, for errors.
            """
            return robot.model.user_units * robot.model.axis_vector(dict(degrees), f"{key}.{name}")

        answers = []
        for name, strategy in self.strategies.items():
            answers.append(
                Answer(strategy, offsets(f"strategies.{name}.moves_deg", strategy.moves_deg))
            )
        steps = []
        for name, step in self.steps.items():
            stepping = Stepping(
                section=step,
                foot=feet.index(step.foot),
                lift=offsets(f"steps.{name}.lift_deg", step.lift_deg),
                reach=offsets(f"steps.{name}.reach_deg", step.reach_deg),
            )
            steps.append(stepping)
        return StandingBalance(
            period=1 / self.rate,
            support=Support(robot, math.radians(self.facing_deg)),
            answers=answers,
            steps=steps,
            size=len(robot.axes),
            # A sensor measures the angular velocity in its own axes, the plant's state has it in the world's.
            gyroscope="angular_velocity" in self.reads,
        )


@dataclass(frozen=True)
class Answer:
    """A strategy of a robot with n axes.

    Attributes:
        section: section of the strategy.
        moves: largest offsets of the axes, shape (n,) [rad].
    """

    section: Strategy
    moves: Vector

    def part(self, state: BalanceState) -> float:
        """Part of the largest offsets that answers the robot's deviation from its stance, -1 to 1.

        It has the sign of the error in the direction of the section. For a direction that is one side alone, such as
        "left", it is never negative.
        """
        # sign(e) clip((|e| - b) / (e_1 - b), 0, 1)
        section = self.section
        error = state.error(section.measures, section.lead)
        excess = max(abs(error) - section.beyond, 0.0)
        part = min(excess / (section.full - section.beyond), 1.0)
        return math.copysign(part, error)

    def next(self, before: float, desired: float, period: float) -> float:
        """Move a part towards a desired one, no faster than the section's times.

        Args:
            before: part at the last sample, -1 to 1.
            desired: part that the error asks for now, -1 to 1.
            period: time between the two [s].

        Returns:
            The part at this sample.
        """
        # An offset that grows answers a push; one that shrinks only returns, and has a time of its own.
        duration = self.section.rise if abs(desired) > abs(before) else self.section.release
        step = period / duration if duration > 0 else math.inf
        return min(max(desired, before - step), before + step)


class StandingBalance(SampledBlock):
    """Compute offsets of the axes from the balance of a robot that stands on its feet.

    Ports:
        in  ``position``, ``velocity`` (n) [rad and rad/s]; ``orientation`` (4): of the root link, qw qx qy qz;
        ``angular_velocity`` (3) of the root link [rad/s], in the world's axes, or in its own axes from a gyroscope.
        out ``offset`` (n) [rad], added to the reference; ``com`` (2) and ``capture_point`` (2), ahead and to the left
        of the place of the centre of mass relative to the feet at the start [m].
    """

    def __init__(
        self,
        *,
        period: float,
        support: Support,
        answers: Sequence[Answer] = (),
        steps: Sequence[Stepping] = (),
        size: int,
        gyroscope: bool = False,
    ) -> None:
        """Create the block.

        Args:
            period: time between two samples [s].
            support: kinematics of the robot.
            answers: strategies, whose offsets are added up.
            steps: steps that the robot may take.
            size: count n of axes.
            gyroscope: whether the angular velocity is in the axes of the root link; otherwise in those of the world.
        """
        self.units = {"offset": "rad", "com": "m", "capture_point": "m"}
        self.components = dict.fromkeys(("com", "capture_point"), ("ahead", "left"))
        self._support = support
        self._answers = answers
        self._gyroscope = gyroscope
        self._stepper = StepChooser(steps, period)
        # Sizes of the inputs.
        reads = {
            "position": size,
            "velocity": size,
            "orientation": 4,
            "angular_velocity": 3,
        }
        outputs = {"offset": np.zeros(size), "com": np.zeros(2), "capture_point": np.zeros(2)}
        more_memory = {
            "parts": np.zeros(len(answers)),  # part of each strategy's offsets
            "step": np.zeros(3),  # see StepState
            "stepped": np.zeros(size),  # offsets of the step
        }
        super().__init__(
            period=period, reads=reads, memory={**outputs, **more_memory}, gives=tuple(outputs)
        )

    def sample(self, memory: Named, read: Named) -> Changes:
        """Compute the offsets at this sample. Returns the new values of the memory.

        Args:
            memory: memory before the sample: outputs, parts of the strategies, and state of the steps.
            read: inputs of the block.
        """
        # Rotation and angular velocity of the root link, in the world's axes.
        rotation = rotation_of(read["orientation"])
        spin = read["angular_velocity"]
        if self._gyroscope:
            spin = rotation @ spin
        balance = self._support.observe(read["position"], read["velocity"], rotation, spin)

        # Once a step has begun, the strategies return to no offset for good: the rocking on the new feet is no push.
        has_stepped = memory["step"][0] > 0
        parts = list[float]()
        for answer, last_part in zip(self._answers, memory["parts"].tolist(), strict=True):
            desired = 0.0 if has_stepped else answer.part(balance)
            parts.append(answer.next(last_part, desired, self.period))
        # The offsets of the strategies are added to those of the step.
        step, step_offset = self._stepper.next(memory["step"], memory["stepped"], balance)
        offset = step_offset
        for part, answer in zip(parts, self._answers, strict=True):
            offset = offset + part * answer.moves
        return {
            "offset": offset,
            "parts": np.array(parts),
            "com": balance.com,
            "capture_point": balance.capture_point,
            "step": step,
            "stepped": step_offset,
        }
