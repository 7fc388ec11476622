r"""A loop that keeps a standing robot on its feet, by its centre of mass and its speed: ankles, hips, arms, and steps.

With the centre of mass c, from where the feet had it at the start, and its velocity, a robot that gives way to its
ankles alone comes to rest over its **capture point**, and falls once that leaves the area of its feet:

.. math:: \xi = c + \frac{\dot c}{\omega}, \qquad \omega = \sqrt{g/h} .

A *strategy* moves axes by the error e in one direction, with a lead :math:`T` (:math:`1/\omega` unless given), nothing
at its threshold b and as far as it can at :math:`e_1`; so a trunk or an arm that swings takes up the rest:

.. math:: e = c + T \dot c, \qquad
    \Delta q_i = a_i \,\mathrm{sign}(e)\, \mathrm{clip}\Bigl(\frac{|e| - b}{e_1 - b}, 0, 1\Bigr) .
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

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
from simrob_drake.parts.controllers.support import Balanced, Direction, Support
from simrob_drake.parts.resolved import ResolvedRobot, Surroundings
from simrob_drake.parts.site import Site
from simrob_drake.parts.station_plant import StationRobot

_TOUCHES = 0.003
"""How high above the lowest foot another still touches the floor, since servos and contacts give way [m]."""
_REACHED = 0.7  # part of a step after which the foot is as far as it goes, and only comes down


class CaptureStep(Strict):
    """Set a foot where the robot falls, once its capture point leaves the feet, and stand there."""

    measures: Direction
    """Where the error counts, as in a strategy: ahead, behind, or to one side."""
    foot: str
    """Link of the foot that is lifted."""
    beyond: Positive
    """The error from which on it steps [m]."""
    full: Positive
    """The error for which it reaches as far as ``reach_deg``; for less by so much less [m]."""
    least: NotNegative = 0.0
    """The least part of that that it reaches."""
    lead: NotNegative | None = None
    """What the velocity counts for [s]; 1/ω unless given, which makes the error that of the capture point."""
    duration: Positive
    """How long the foot is in the air [s]."""
    settle: Positive = 0.3
    """How long the legs then take to their new posture [s]."""
    stance: Annotated[Number, Field(ge=0, le=1)] = 1.0
    """Part of its reach that the leg which stands takes while the foot is in the air; the rest as they settle."""
    lift_deg: dict[str, Number] = Field(min_length=1)
    """How far axes are moved in the middle of the step, to lift the foot, by name [deg]."""
    reach_deg: dict[str, Number] = Field(min_length=1)
    """How far axes are moved once the foot is down, by name [deg]."""


@dataclass(frozen=True)
class Stepping:
    """A step with the place of its foot among the feet, and its moves in radians, shape (n,)."""

    section: CaptureStep
    foot: int
    lift: Vector
    reach: Vector

    def part(self, balanced: Balanced) -> float:
        """Return what part of its reach is called for."""
        section = self.section
        return min(max(balanced.error(section.measures, section.lead) / section.full, section.least), 1.0)

    def swung(self, time: float, part: float) -> Vector:
        """Return how far the axes are moved at a time of the step, of which it takes one."""
        ahead = min(time / _REACHED, 1.0)
        return (
            math.sin(math.pi * time) * self.lift
            + part * ahead * ahead * (3 - 2 * ahead) * np.where(self.lift, 1.0, self.section.stance) * self.reach
        )


class StepChooser:
    """Which of several steps a robot takes: one, and it stays there."""

    def __init__(self, steps: Sequence[Stepping], period: float) -> None:
        """Take the steps that it may take, and the time between samples [s]."""
        self._steps, self._period = steps, period

    def next(self, state: Vector, moved: Vector, balanced: Balanced) -> tuple[Vector, Vector]:
        """Return what follows of a step's state and of how far axes are moved, (n,) [rad].

        The state (3,) is which step it is (from 1, 0 for none), its time (1 once the foot is down) and its part.
        """
        which, time, part = int(state[0]), float(state[1]), float(state[2])
        if not which:
            sections = [step.section for step in self._steps]
            errors = (balanced.error(own.measures, own.lead) > own.beyond for own in sections)
            which = next((number for number, far in enumerate(errors, 1) if far), 0)
            if not which:
                return state, moved
        step = self._steps[which - 1]
        if time < 1:
            time, part = min(time + self._period / step.section.duration, 1.0), max(part, step.part(balanced))
            moved = step.swung(time, part)
            if time > 0.5 and balanced.lifted[step.foot] < _TOUCHES:
                time = 1.0  # what is lifted still is let down slowly, or the leg would kick
        else:
            moved = moved + min(self._period / step.section.settle, 1.0) * (part * step.reach - moved)
        return np.array([which, time, part]), moved


class Strategy(Strict):
    """How some axes answer when the robot tips in one direction."""

    measures: Direction
    """Where the error counts: ahead (negative behind), to the left (negative to the right), or on one side alone."""
    moves_deg: dict[str, Number] = Field(min_length=1)
    """How far each axis moves at most, by name [deg, or m where it slides]."""
    beyond: NotNegative = 0.0
    """The error that is ignored [m]."""
    full: Positive
    """The error from which on the axes are moved as far as that [m]."""
    lead: NotNegative | None = None
    """What the velocity counts for [s]; 1/ω unless given, which makes the error that of the capture point."""
    rise: NotNegative = 0.05
    """The least time from no answer to a full one [s]."""
    release: NotNegative = 0.05
    """The least time back [s]."""

    @model_validator(mode="after")
    def _grows(self) -> "Strategy":
        if self.full <= self.beyond:
            raise ValueError(
                message(
                    "parts.full_beyond",
                    "full, {full:g} m, must be beyond the {beyond:g} m that are let be",
                    full=self.full,
                    beyond=self.beyond,
                )
            )
        if not any(self.moves_deg.values()):
            raise ValueError(message("parts.moves_all_zero", "moves_deg are all zero: no axis would move"))
        return self


class Balance(LoopSection):
    """Answer pushes to a robot that stands: by strategies for ankles, hips, arms and knees, added up, and by a step."""

    label: ClassVar[str] = message("parts.loop_balance", "balance")
    stages: ClassVar[tuple[str, ...]] = (
        message("parts.stage_capture_point", "Capture point"),
        message("parts.stage_strategies", "Strategies\nankles, hips, arms"),
        message("parts.stage_step", "Step\nif they fail"),
    )

    kind: Literal["balance"]
    facing_deg: Number = 0.0
    """Where the robot looks at the start: 0 along the world's x axis, 90 along y."""
    strategies: dict[str, Strategy] = Field(default_factory=dict)
    """Those that act, by name."""
    steps: dict[str, CaptureStep] = Field(default_factory=dict)
    """Those that it may take, by name: the first that is called for, and then the strategies rest."""

    @model_validator(mode="after")
    def _acts(self) -> "Balance":
        if not self.strategies and not self.steps:
            raise ValueError(
                message("parts.nothing_would_move", "balance needs strategies or steps: nothing would move")
            )
        return self

    def axes(self, robot: ResolvedRobot) -> Sequence[str]:
        """Return the axes that strategies and steps move."""
        parts = {"moves_deg": [strategy.moves_deg for strategy in self.strategies.values()]}
        parts |= {key: [getattr(step, key) for step in self.steps.values()] for key in ("lift_deg", "reach_deg")}
        found = [robot.model.axis_index(axis, key) for key, moves in parts.items() for each in moves for axis in each]
        return [robot.axes[index] for index in dict.fromkeys(found)]

    def check(self, key: str, station: Surroundings) -> None:
        """Check that the robot stands on feet; raises SimrobError: it does not, or what every loop checks."""
        super().check(key, station)
        robot = self.on_feet(key, station)
        assert robot.feet is not None  # on_feet() has asked
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

    def source(self, builder: DiagramBuilder, name: str, robot: StationRobot, site: Site, key: str) -> OutputPort:
        """Return what an input reads: of how the base turns, the plant's state unless a sensor is named."""
        parts = {"orientation": ("base_pose", slice(3, 7)), "angular_velocity": ("base_velocity", slice(3, 6))}
        output, part = parts.get(name, ("", slice(0)))
        known = site.outputs.of_state.get(f"{robot.prefix}{output}")
        if name in self.reads or known is None:
            return super().source(builder, name, robot, site, key)
        site.picture.draw_nothing(f"{key}.{name}")
        return add_matrix_gain(builder, f"{key}.{name}", known.matrix(site.state.size())[part], site.state)

    def _block(self, key: str, robot: StationRobot, site: Site) -> SampledBlock:
        assert robot.feet is not None  # check() has asked
        feet = list(robot.feet.links)

        def moves(name: str, degrees: dict[str, float]) -> Vector:
            """Return the moves of a strategy or a step, in radians for all axes."""
            return robot.model.user_units * robot.model.axis_vector(dict(degrees), f"{key}.{name}")

        answers = [
            Answer(each, moves(f"strategies.{name}.moves_deg", each.moves_deg))
            for name, each in self.strategies.items()
        ]
        steps = []
        for name, each in self.steps.items():
            lift, reach = (moves(f"steps.{name}.{part}", getattr(each, part)) for part in ("lift_deg", "reach_deg"))
            steps.append(Stepping(each, feet.index(each.foot), lift, reach))
        return StandingBalance(
            period=1 / self.rate,
            support=Support(robot, math.radians(self.facing_deg)),
            answers=answers,
            steps=steps,
            size=len(robot.axes),
            gyroscope="angular_velocity" in self.reads,
        )


@dataclass(frozen=True)
class Answer:
    """A strategy, with how far the axes move in radians, shape (n,)."""

    section: Strategy
    moves: Vector

    def part(self, balanced: Balanced) -> float:
        """Return what part of the full answer is called for, -1 to 1."""
        section = self.section
        along = balanced.error(section.measures, section.lead)
        beyond = max(abs(along) - section.beyond, 0.0)
        return math.copysign(min(beyond / (section.full - section.beyond), 1.0), along)

    def next(self, before: float, desired: float, period: float) -> float:
        """Return the part a period [s] after another, as near to what is wanted as it can be by then."""
        duration = self.section.rise if abs(desired) > abs(before) else self.section.release
        step = period / duration if duration > 0 else math.inf
        return min(max(desired, before - step), before + step)


class StandingBalance(SampledBlock):
    """Move axes by how a robot stands on its feet.

    Ports:
        in  ``position``, ``velocity`` (n) [rad and rad/s]; ``orientation`` (4): of the root link, qw qx qy qz;
        ``angular_velocity`` (3) [rad/s]: of that, in the world's axes or as a gyroscope tells it.
        out ``offset`` (n) [rad]: to be added to the reference; ``com`` (2) and ``capture_point`` (2): ahead and to the
        left of where the feet had the centre of mass at the start [m].
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
        """Make the block for a robot of ``size`` axes: how it stands, its answers, added up, and the steps it may take.

        A ``gyroscope`` gives the angular velocity in the axes of the root link.
        """
        self.units = {"offset": "rad", "com": "m", "capture_point": "m"}
        self.components = dict.fromkeys(("com", "capture_point"), ("ahead", "left"))
        self._support, self._answers, self._gyroscope = support, answers, gyroscope
        self._stepper = StepChooser(steps, period)
        reads = {"position": size, "velocity": size, "orientation": 4, "angular_velocity": 3}
        outputs = {"offset": np.zeros(size), "com": np.zeros(2), "capture_point": np.zeros(2)}
        memory = {**outputs, "parts": np.zeros(len(answers)), "step": np.zeros(3), "stepped": np.zeros(size)}
        super().__init__(period=period, reads=reads, memory=memory, gives=tuple(outputs))

    def sample(self, memory: Named, read: Named) -> Changes:
        """Return how far the axes are to be moved now."""
        turned, spin = rotation_of(read["orientation"]), read["angular_velocity"]
        spin = turned @ spin if self._gyroscope else spin
        balanced = self._support.balanced(read["position"], read["velocity"], turned, spin)
        stepping = memory["step"][0] > 0  # then strategies rest: the rocking on new feet is not a push
        desired = [0.0 if stepping else answer.part(balanced) for answer in self._answers]
        before = zip(self._answers, memory["parts"].tolist(), desired, strict=True)
        parts = [answer.next(part, now, self.period) for answer, part, now in before]
        step, offset = self._stepper.next(memory["step"], memory["stepped"], balanced)
        now = {"com": balanced.com, "capture_point": balanced.capture_point, "step": step, "stepped": offset}
        for part, answer in zip(parts, self._answers, strict=True):
            offset = offset + part * answer.moves
        return {"offset": offset, "parts": np.array(parts), **now}
