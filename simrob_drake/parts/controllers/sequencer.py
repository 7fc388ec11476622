"""A loop that goes from posture to posture, each as soon as the robot has reached the one before.

The thesis's automatic controller of joint positions (p. 98 to 102): the robot sets the time, not the program.
"""

from collections.abc import Sequence
from typing import ClassVar, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from simrob_drake.blocks.sampled import Changes, Named, RunEnds, SampledBlock
from simrob_drake.errors import InvalidParameter
from simrob_drake.frames import Vector
from simrob_drake.parts.controllers.loop import LoopSection
from simrob_drake.parts.site import ResolvedRobot, Site, StationRobot
from simrob_drake.robots.catalog import RobotModel
from simrob_drake.sections import NotNegative, Number, Positive, Strict

REACHED = "reached"
"""What the block remembers last: when each cell was reached [s], -1 until then."""


class Cell(Strict):
    """Targets that are approached at the same time; other axes stay where they were asked to be."""

    targets_deg: dict[str, Number] = Field(min_length=1)
    """Positions to go to, by axis."""
    duration: NotNegative = 1.0
    """How long the way there is [s]; the cell itself lasts until the robot has followed."""


class Pace(Strict):
    """What counts as a cell that is reached."""

    tolerance_deg: Positive = 2.0
    """How near the measured joints must come to a cell's targets [deg, or m where they slide]."""
    speed_deg: Positive = 10.0
    """How slow they must have become there, all axes [deg/s, or m/s]."""
    timeout: Positive | None = None
    """How long a cell may take [s]; for ever unless given."""
    on_timeout: Literal["stop", "go_on"] = "stop"
    """What happens then: the run ends with the names of the joints that are late, or the next cell begins."""

    @model_validator(mode="after")
    def _can_time_out(self) -> Self:
        if self.on_timeout == "go_on" and self.timeout is None:
            raise ValueError("on_timeout: go_on needs a timeout [s]")
        return self


class Sequencer(Pace, LoopSection):
    """Go through cells of joint targets; to the next one when the measured joints have reached the last.

    It drives all axes of its robot.
    """

    stages: ClassVar[tuple[str, ...]] = ("Cell\nreached, or too late", "Ramp to the next cell")

    kind: Literal["sequencer"]
    cells: list[Cell] = Field(min_length=1)
    """What to do, one after the other."""
    ends: bool = False
    """Whether the run ends as soon as the last cell is done."""

    @model_validator(mode="after")
    def _has_time_for_its_ways(self) -> Self:
        for number, cell in enumerate(self.cells):
            if self.timeout is not None and cell.duration >= self.timeout:
                raise ValueError(f"cells[{number}] has a duration of {cell.duration:g} s, which leaves no timeout")
        return self

    def axes(self, robot: ResolvedRobot) -> Sequence[str]:
        """Return all axes; the targets are checked."""
        lower, upper = robot.model.axis_limits
        for number, cell in enumerate(self.cells):
            for axis, target in cell.targets_deg.items():
                index = robot.model.axis_index(axis, f"cells[{number}].targets_deg")
                unit, name = robot.model.user_units[index], robot.model.unit_names[index]
                if not lower[index] - 1e-9 <= target * unit <= upper[index] + 1e-9:
                    limits = f"{lower[index] / unit:.5g} to {upper[index] / unit:.5g} {name}"
                    raise InvalidParameter(f"cells[{number}].targets_deg.{axis}", target, f"within {limits}")
        return robot.axes

    def block(self, key: str, robot: StationRobot, site: Site) -> SampledBlock:
        """Return the loop."""
        model = robot.model
        targets, units = [_targets(cell, model) for cell in self.cells], model.user_units
        return CellSequence(self, targets, units * self.tolerance_deg, units * self.speed_deg, robot.axes)


def _targets(cell: Cell, model: RobotModel) -> Vector:
    """Return the targets of all axes, shape (n,) [rad or m]; nan where the cell has none."""
    return model.user_units * model.axis_vector(dict(cell.targets_deg), "targets_deg", np.nan)


class CellSequence(SampledBlock):
    """Ramp from cell to cell, each when the one before is reached.

    Ports:
        in  ``position``, ``velocity`` (n) [rad, rad/s]: measured; ``reference`` (n): where the first ramp begins.
        out ``target`` (n) [rad]; ``cell`` (1): the number of the cell, counted from 0; ``done`` (1): 1 once the last is
        reached.
    """

    def __init__(
        self, section: Sequencer, targets: Sequence[Vector], tolerance: Vector, speed: Vector, names: Sequence[str]
    ) -> None:
        """Make the block.

        Args:
            section: its parameters.
            targets: of each cell, shape (n,) [rad]; nan where an axis stays.
            tolerance: how near each axis must come to its target, shape (n,) [rad].
            speed: below which all axes must be, shape (n,) [rad/s].
            names: of the axes, for the reason of an end.
        """
        size = len(tolerance)
        self.units = {"target": "rad"}
        self._targets, self._durations = targets, [cell.duration for cell in section.cells]
        self._tolerance, self._speed, self._section, self._names = tolerance, speed, section, names
        self._timeout = np.inf if section.timeout is None else section.timeout
        super().__init__(
            period=1 / section.rate,
            reads={"position": size, "velocity": size, "reference": size},
            memory={
                "target": np.zeros(size),
                "active": np.zeros(1),
                "cell": np.zeros(1),
                "done": np.zeros(1),
                "elapsed": np.zeros(1),
                "origin": np.zeros(size),
                "clock": np.zeros(1),  # since the first sample [s]
                REACHED: np.full(len(targets), -1.0),  # by that clock; results look for it at the end
            },
            gives=("target", "active", "cell", "done"),
        )

    def sample(self, memory: Named, read: Named) -> Changes:
        """Return the next point of the ramp, or the beginning of the next cell."""
        if not memory["active"][0]:
            return {"active": 1.0, "target": read["reference"], "origin": read["reference"]}
        if memory["done"][0] and self._section.ends:
            raise RunEnds(f"the last of {len(self._targets)} cells is done")
        number, elapsed = int(memory["cell"][0]), memory["elapsed"][0] + self.period
        goal, duration, clock = self._targets[number], self._durations[number], memory["clock"][0] + self.period
        part = min(elapsed / duration, 1.0) if duration > 0 else 1.0
        full = np.where(np.isnan(goal), memory["origin"], goal)
        target = memory["origin"] + part * (full - memory["origin"])
        changed: dict[str, Vector | float] = {"target": target, "elapsed": elapsed, "clock": clock}
        if memory["done"][0]:
            return changed
        late = ~np.isnan(goal) & (abs(read["position"] - goal) > self._tolerance) | (
            abs(read["velocity"]) > self._speed
        )
        if part == 1.0 and not late.any():
            changed[REACHED] = np.where(np.arange(len(self._targets)) == number, clock, memory[REACHED])
        elif elapsed < self._timeout:
            return changed
        elif self._section.on_timeout == "stop":
            who = ", ".join(self._names[index] for index in np.flatnonzero(late).tolist()) or "its ramp"
            raise RunEnds(f"cell {number} was not reached within {self._timeout:g} s: {who} is late")
        if number + 1 < len(self._targets):
            return {**changed, "cell": number + 1, "elapsed": 0.0, "origin": full}
        return {**changed, "done": 1.0}
