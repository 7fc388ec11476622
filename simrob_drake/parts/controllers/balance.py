r"""A loop that keeps a standing robot on its feet: ankles, hips, arms and crouch by its centre of mass and its speed.

With the centre of mass c, from where the feet had it at the start, and its velocity, a robot that gives way to its
ankles alone comes to rest over its **capture point**, and falls once that leaves the area of its feet:

.. math:: \xi = c + \frac{\dot c}{\omega}, \qquad \omega = \sqrt{g/h} .

A *strategy* moves axes by the error e in one direction, with a lead :math:`T` (:math:`1/\omega` unless given), nothing
at its threshold b and as far as it can at :math:`e_1`; so a trunk or an arm that swings takes up the rest:

.. math:: e = c + T \dot c, \qquad
    \Delta q_i = a_i \,\mathrm{sign}(e)\, \mathrm{clip}\Bigl(\frac{|e| - b}{e_1 - b}, 0, 1\Bigr) .
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from pydantic import Field, model_validator
from pydrake.systems.framework import DiagramBuilder, OutputPort

from simrob_drake.blocks.sampled import Changes, Named, SampledBlock
from simrob_drake.blocks.wiring import mapped
from simrob_drake.errors import InvalidParameter
from simrob_drake.frames import Vector
from simrob_drake.parts.controllers.loop import LoopSection
from simrob_drake.parts.controllers.support import Balanced, Support, rotation_of
from simrob_drake.parts.site import ResolvedRobot, Site, StationRobot, Surroundings
from simrob_drake.quantities import NotNegative, Positive
from simrob_drake.yaml_files import Number, Strict

Direction = Literal["sagittal", "lateral", "forward", "backward", "left", "right"]
_SENSES: dict[Direction, tuple[float, float, float]] = {
    "sagittal": (1, 0, -math.inf),
    "lateral": (0, 1, -math.inf),
    "forward": (1, 0, 0),
    "backward": (-1, 0, 0),
    "left": (0, 1, 0),
    "right": (0, -1, 0),
}
"""Of each direction: its parts ahead and to the left, and the least error that counts."""


class Strategy(Strict):
    """How some axes answer when the robot tips in one direction."""

    measures: Direction
    """Where the error counts: ahead (negative behind), to the left (negative to the right), or on one side alone."""
    moves_deg: dict[str, Number] = Field(min_length=1)
    """How far each axis moves at most, by name [deg, or m where it slides]."""
    beyond: NotNegative = 0.0
    """The error that is let be [m]."""
    full: Positive
    """The error from which on the axes are moved as far as that [m]."""
    lead: NotNegative | None = None
    """What the velocity counts for [s]; 1/ω unless given, which makes the error that of the capture point."""
    rise: NotNegative = 0.05
    """The least time from no answer to a full one [s]."""
    release: NotNegative = 0.05
    """The least time back [s]."""

    @model_validator(mode="after")
    def _grows(self) -> Strategy:
        if self.full <= self.beyond:
            raise ValueError(f"full, {self.full:g} m, must be beyond the {self.beyond:g} m that are let be")
        if not any(self.moves_deg.values()):
            raise ValueError("moves_deg are all zero: no axis would move")
        return self


class Balance(LoopSection):
    """Answer pushes with joints of a robot that stands: by strategies for ankles, hips, arms and knees, added up."""

    kind: Literal["balance"]
    facing_deg: Number = 0.0
    """Where the robot looks at the start: 0 along the world's x axis, 90 along y."""
    strategies: dict[str, Strategy] = Field(min_length=1)
    """Those that act, by name."""

    def axes(self, robot: ResolvedRobot) -> Sequence[str]:
        """Return the axes that strategies move."""
        moved = dict.fromkeys(axis for strategy in self.strategies.values() for axis in strategy.moves_deg)
        return [robot.axes[robot.model.axis_index(axis, "moves_deg")] for axis in moved]

    def check(self, key: str, station: Surroundings) -> None:
        """Check that the robot stands on feet.

        Raises:
            SimrobError: it does not, or what every loop checks.
        """
        super().check(key, station)
        robot = station.robot(self.robot, key)
        if not robot.floats or robot.feet is None:
            raise InvalidParameter(key, f"balance of {robot.name}", "of a robot that stands on feet of its own")

    def source(self, builder: DiagramBuilder, name: str, robot: StationRobot, site: Site, key: str) -> OutputPort:
        """Return what an input reads: of how the base turns, the plant's state unless a sensor is named."""
        parts = {"orientation": ("base_pose", slice(3, 7)), "angular_velocity": ("base_velocity", slice(3, 6))}
        output, part = parts.get(name, ("", slice(0)))
        known = site.of_state.get(f"{robot.prefix}{output}")
        if name in self.reads or known is None:
            return super().source(builder, name, robot, site, key)
        site.draw_nothing(f"{key}.{name}")
        return mapped(builder, f"{key}.{name}", known.matrix[part], site.state)

    def block(self, key: str, robot: StationRobot, site: Site) -> SampledBlock:
        """Return the loop."""
        answers = []
        for name, strategy in self.strategies.items():
            moves = robot.model.axis_vector(dict(strategy.moves_deg), f"{key}.strategies.{name}.moves_deg")
            figures = {key: getattr(strategy, key) for key in ("measures", "beyond", "full", "lead", "rise", "release")}
            answers.append(Answer(moves=robot.model.user_units * moves, **figures))
        return StandingBalance(
            period=1 / self.rate,
            support=Support(robot, math.radians(self.facing_deg)),
            answers=answers,
            gyroscope="angular_velocity" in self.reads,
        )


@dataclass(frozen=True)
class Answer:
    """A strategy in figures: as :class:`Strategy`, with how far the axes move in radians, shape (n,)."""

    measures: Direction
    moves: Vector
    beyond: float
    full: float
    lead: float | None
    rise: float
    release: float

    def part(self, balanced: Balanced) -> float:
        """Return what part of the full answer is called for, -1 to 1."""
        ahead, left, least = _SENSES[self.measures]
        error = balanced.com + (1 / balanced.omega if self.lead is None else self.lead) * balanced.speed
        along = max(ahead * float(error[0]) + left * float(error[1]), least)
        return math.copysign(min(max(abs(along) - self.beyond, 0.0) / (self.full - self.beyond), 1.0), along)

    def next(self, before: float, wanted: float, period: float) -> float:
        """Return the part a period [s] after another, as near to what is wanted as it can be by then."""
        duration = self.rise if abs(wanted) > abs(before) else self.release
        step = period / duration if duration > 0 else math.inf
        return min(max(wanted, before - step), before + step)


class StandingBalance(SampledBlock):
    """Move axes by how a robot stands on its feet.

    Ports:
        in  ``position``, ``velocity`` (n) [rad and rad/s]; ``orientation`` (4): of the root link, qw qx qy qz;
        ``angular_velocity`` (3) [rad/s]: of that, in the world's axes or as a gyroscope tells it.
        out ``offset`` (n) [rad]: to be added to the reference; ``com`` (2) and ``capture_point`` (2): ahead and to the
        left of where the feet had the centre of mass at the start [m].
    """

    def __init__(self, *, period: float, support: Support, answers: Sequence[Answer], gyroscope: bool = False) -> None:
        """Make the block.

        Args:
            period: between samples [s].
            support: tells how the robot stands.
            answers: what moves then, added up.
            gyroscope: the angular velocity is given in the axes of the root link.
        """
        self.units = {"offset": "rad", "com": "m", "capture_point": "m"}
        self._support, self._answers, self._gyroscope = support, answers, gyroscope
        size = len(answers[0].moves)
        super().__init__(
            period=period,
            reads={"position": size, "velocity": size, "orientation": 4, "angular_velocity": 3},
            memory={
                "offset": np.zeros(size),
                "com": np.zeros(2),
                "capture_point": np.zeros(2),
                "parts": np.zeros(len(answers)),
            },
            gives=("offset", "com", "capture_point"),
        )

    def sample(self, memory: Named, read: Named) -> Changes:
        """Return how far the axes are to be moved now."""
        turned, spin = rotation_of(read["orientation"]), read["angular_velocity"]
        spin = turned @ spin if self._gyroscope else spin
        balanced = self._support.balanced(read["position"], read["velocity"], turned, spin)
        before = zip(self._answers, memory["parts"].tolist(), strict=True)
        parts = [answer.next(part, answer.part(balanced), self.period) for answer, part in before]
        offset = np.sum([part * answer.moves for part, answer in zip(parts, self._answers, strict=True)], axis=0)
        now = {"com": balanced.com, "capture_point": balanced.capture_point}
        return {"offset": offset, "parts": np.array(parts), **now}
