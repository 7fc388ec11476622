"""Loops that take postures: cell by cell as the robot has reached the last, or a protective one once it falls."""

import math
import operator
import weakref
from collections.abc import Callable, Sequence
from typing import ClassVar, Literal, Self

import numpy as np
from pydantic import Field, model_validator
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import DiagramBuilder, OutputPort

from simrob_drake.base.errors import InvalidParameter, Unsuitable
from simrob_drake.base.frames import Vector, lean, vertical
from simrob_drake.base.messages import compound, message
from simrob_drake.base.sections import NotNegative, Number, Positive, Strict
from simrob_drake.blocks.sampled import Changes, Named, RunEnds, SampledBlock
from simrob_drake.parts.controllers.loop import LoopSection
from simrob_drake.parts.ground import Ground
from simrob_drake.parts.resolved import ResolvedRobot
from simrob_drake.parts.site import Site
from simrob_drake.parts.station_plant import StationRobot
from simrob_drake.robots.catalog import RobotModel

REACHED = "reached"  # what the block remembers last: when each cell was reached [s], -1 until then


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
            raise ValueError(message("parts.go_on_needs_timeout", "on_timeout: go_on needs a timeout [s]"))
        return self


class Sequencer(Pace, LoopSection):
    """Go through cells of joint targets; to the next one when the measured joints have reached the last.

    It drives all axes of its robot. The thesis's automatic controller of joint positions (p. 98 to 102): the robot sets
    the time, not the program.
    """

    label: ClassVar[str] = message("parts.loop_sequencer", "sequencer")
    stages: ClassVar[tuple[str, ...]] = (
        message("parts.stage_cell", "Cell\nreached, or too late"),
        message("parts.stage_next_cell", "Ramp to the next cell"),
    )

    kind: Literal["sequencer"]
    cells: list[Cell] = Field(min_length=1)
    """What to do, one after the other."""
    ends: bool = False
    """Whether the run ends as soon as the last cell is done."""

    @model_validator(mode="after")
    def _has_time_for_its_ways(self) -> Self:
        for number, cell in enumerate(self.cells):
            if self.timeout is not None and cell.duration >= self.timeout:
                raise ValueError(
                    message(
                        "parts.cell_without_timeout",
                        "cells[{number}] has a duration of {duration:g} s, which leaves no timeout",
                        number=number,
                        duration=cell.duration,
                    )
                )
        return self

    def axes(self, robot: ResolvedRobot) -> Sequence[str]:
        """Return all axes; the targets are checked."""
        model = robot.model
        for number, cell in enumerate(self.cells):
            for axis, target in cell.targets_deg.items():
                index = model.axis_index(axis, f"cells[{number}].targets_deg")
                position = np.array([[target * model.user_units[index]]])
                violation = model.limits.of_axes([index]).find_violation(position)
                if violation is not None:
                    key = f"cells[{number}].targets_deg.{axis}"
                    raise InvalidParameter(
                        key,
                        compound("{value} {unit}", value=violation.value, unit=violation.unit),
                        message("parts.within", "within {limits}", limits=violation.limits),
                    )
        return robot.axes

    def cell_times(self, groups: Sequence[Vector]) -> list[float | None]:
        """Times at which the cells were reached, for the result of a run.

        Args:
            groups: discrete state of the block at the end of the run, one vector for each group.

        Returns:
            for each cell the time since the sequencer's start [s], or None if the cell was not reached.
        """
        # The block keeps the times at the end of its last group. They are negative for cells that were not reached.
        times = groups[-1][-len(self.cells) :].tolist()
        return [round(time, 9) if time >= 0 else None for time in times]

    def _block(self, key: str, robot: StationRobot, site: Site) -> SampledBlock:
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
        """Make the block of a section, for axes by name; targets of each cell (n,) [rad] are nan where one stays.

        Each axis must come as near as ``tolerance`` (n,) [rad], below ``speed`` (n,) [rad/s].
        """
        size = len(tolerance)
        self.units = {"target": "rad"}
        self._targets, self._durations = targets, [cell.duration for cell in section.cells]
        self._tolerance, self._speed, self._section, self._names = tolerance, speed, section, names
        self._timeout = np.inf if section.timeout is None else section.timeout
        reads, one = {"position": size, "velocity": size, "reference": size}, np.zeros(1)
        outputs = {"target": np.zeros(size), "active": one, "cell": one, "done": one}
        memory = {**outputs, "elapsed": one, "origin": np.zeros(size), "clock": one}  # since the first sample [s]
        memory[REACHED] = np.full(len(targets), -1.0)  # by that clock; results look for it at the end
        super().__init__(period=1 / section.rate, reads=reads, memory=memory, gives=tuple(outputs))

    def sample(self, memory: Named, read: Named) -> Changes:
        """Return the next point of the ramp, or the beginning of the next cell."""
        if not memory["active"][0]:
            return {"active": 1.0, "target": read["reference"], "origin": read["reference"]}
        if memory["done"][0] and self._section.ends:
            raise RunEnds(
                message("parts.last_cell_done", "the last of {count} cells is done", count=len(self._targets))
            )
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
            who = ", ".join(self._names[index] for index in np.flatnonzero(late).tolist()) or message(
                "parts.its_ramp", "its ramp"
            )
            raise RunEnds(
                message(
                    "parts.cell_not_reached",
                    "cell {number} was not reached within {timeout:g} s: {late} is late",
                    number=number,
                    timeout=self._timeout,
                    late=who,
                )
            )
        if number + 1 < len(self._targets):
            return {**changed, "cell": number + 1, "elapsed": 0.0, "origin": full}
        return {**changed, "done": 1.0}


_ANGLES = np.linspace(0, 2 * np.pi, 64, endpoint=False)
_DIRECTIONS = np.column_stack([np.cos(_ANGLES), np.sin(_ANGLES)])
"""Along which a support is measured: distances from it come out at most 0.13 % short."""


class CapturePoint:
    r"""Tells how far the capture point of a robot is outside of the area that its feet span.

    There it would have to step to come to rest, as a linear inverted pendulum with the centre of mass c at height z
    over the feet: :math:`c_{xy} + \dot c_{xy} \sqrt{z / g}` (Pratt and others, 2006). Between them they can stop it.
    """

    def __init__(self, plant: MultibodyPlant, robot: StationRobot, key: str) -> None:
        """Take a robot of a finalized plant, in a diagram or not; raises InvalidParameter, with ``key``: no feet."""
        if robot.feet is None:
            raise Unsuitable(key, message("parts.no_feet", "{model} has no feet", model=robot.model.name))
        self._plant, self._robot = weakref.proxy(plant), [robot.instance]
        self._soles = {link: robot.feet.support_points(link).T for link in robot.feet.links}
        self._gravity = np.linalg.norm(plant.gravity_field().gravity_vector())
        self._scratch = plant.CreateDefaultContext()  # nothing is remembered in it: every evaluation sets it anew

    def outside(self, state: Vector) -> float:
        """Return how far from the feet it is [m], negative between them, by positions and velocities (nq + nv).

        Feet that are lifted count as well.
        """
        plant, scratch, robot = self._plant, self._scratch, self._robot
        plant.SetPositionsAndVelocities(scratch, state)
        mass = plant.CalcCenterOfMassPositionInWorld(scratch, robot)
        speed = plant.CalcCenterOfMassTranslationalVelocityInWorld(scratch, robot)
        world, frames = plant.world_frame(), [plant.GetFrameByName(link, robot[0]) for link in self._soles]
        soles = zip(frames, self._soles.values(), strict=True)
        points = np.hstack([plant.CalcPointsPositions(scratch, frame, sole, world) for frame, sole in soles])
        place = mass[:2] + speed[:2] * np.sqrt(max(mass[2] - points[2].min(), 0.0) / self._gravity)
        return float(-(_DIRECTIONS @ (points[:2] - place[:, np.newaxis])).max(axis=1).min())


class FallGuard(LoopSection):
    """Move axes to a posture, such as arms forward, once the base is too low or leans too far; it stays until reset.

    So does the thesis (p. 108 and 109). It drives the axes of its posture alone. Several, each `toward` another side,
    take another posture for each.
    """

    label: ClassVar[str] = message("parts.loop_fall_guard", "fall guard")
    stages: ClassVar[tuple[str, ...]] = (
        message("parts.stage_height_or_lean", "Height or lean"),
        message("parts.stage_guard", "Guard\nfalls, or stands"),
        message("parts.stage_way_to_posture", "Way to the posture"),
    )

    kind: Literal["fall_guard"]
    height: Positive | None = None
    """Height of the base over the ground beneath, below which it acts [m]."""
    tilt_deg: Positive | None = None
    """Angle from how the base stood at the start beyond which it acts."""
    toward_deg: Number | None = None
    """Where to the base must lean, within 90° to either side: 0 along the world's x axis at the start, 90 along y; it
    turns with the base. Anywhere unless given."""
    capture_point: NotNegative | None = None
    """How far outside of the area between its feet the capture point may come [m]: where it would have to step to stop.
    It is that of the true state."""
    posture_deg: dict[str, Number] = Field(min_length=1)
    """Where axes go then, by name."""
    duration: NotNegative = 0.2
    """How long they take [s]."""
    reset_after: Positive | None = None
    """How long all must be well again before it lets go [s]; never unless given."""

    @model_validator(mode="after")
    def _some_bound(self) -> "FallGuard":
        if self.height is None and self.tilt_deg is None and self.capture_point is None:
            raise ValueError(
                message(
                    "parts.guard_needs_threshold", "a fall guard needs a threshold: height, tilt_deg or capture_point"
                )
            )
        return self

    def axes(self, robot: ResolvedRobot) -> Sequence[str]:
        """Return the axes of the posture."""
        return [robot.axes[robot.model.axis_index(axis, "posture_deg")] for axis in self.posture_deg]

    def source(self, builder: DiagramBuilder, name: str, robot: StationRobot, site: Site, key: str) -> OutputPort:
        """Return what an input reads; ``state`` is that of the whole plant."""
        return site.state if name == "state" else super().source(builder, name, robot, site, key)

    def _block(self, key: str, robot: StationRobot, site: Site) -> SampledBlock:
        plant, step = site.plant.plant, None
        if self.capture_point is not None:
            point, far = CapturePoint(plant, robot, f"{key}.capture_point"), self.capture_point
            step = plant.num_multibody_states(), lambda state: point.outside(state) > far
        upright, toward = robot.base.rotation().inverse(), None
        if self.toward_deg is not None:
            angle = math.radians(self.toward_deg)
            toward = upright @ np.array([math.cos(angle), math.sin(angle), 0.0])
        return ProtectivePosture(
            self,
            posture=robot.model.user_units * robot.model.axis_vector(dict(self.posture_deg), f"{key}.posture_deg"),
            up=upright @ np.array([0.0, 0.0, 1.0]),
            toward=toward,
            ground=site.plant.ground,
            must_step=step,
        )


class ProtectivePosture(SampledBlock):
    """Ramp to a posture from where the robot is asked to be, once the base falls.

    Ports:
        in  ``base_pose`` (7): x y z [m] and a quaternion; ``reference`` (n) [rad]: where the ramp begins; ``state``
        (nq + nv): of the whole plant, where that is asked for.
        out ``target`` (n) [rad]; ``active`` (1): 1 while it acts.
    """

    def __init__(
        self,
        section: FallGuard,
        *,
        posture: Vector,
        up: Vector,
        toward: Vector | None = None,
        ground: Ground | None = None,
        must_step: tuple[int, Callable[[Vector], bool]] | None = None,
    ) -> None:
        """Make the block of a section: where all axes go, shape (n,) [rad].

        ``up`` (3,) of the base points up while it stands; it must lean ``toward`` (3,), anywhere unless given, over the
        ground, z = 0 unless given. ``must_step``: size of a state, and what tells by it that standing will not do.
        """
        self.units = {"target": "rad"}
        self._posture, self._duration, self._up = posture, section.duration, up.tolist()
        self._height = -math.inf if section.height is None else section.height
        self._tilt = math.inf if section.tilt_deg is None else math.radians(section.tilt_deg)
        self._reset_after = math.inf if section.reset_after is None else section.reset_after
        self._ground, self._toward = ground or Ground(), None if toward is None else toward.tolist()
        zero = np.zeros(len(posture))
        memory = {"target": zero, "active": np.zeros(1), "elapsed": np.zeros(1), "origin": zero, "well": np.zeros(1)}
        reads = {"base_pose": 7, "reference": len(posture)}
        self._must_step = None
        if must_step is not None:
            reads["state"], self._must_step = must_step
        super().__init__(period=1 / section.rate, reads=reads, memory=memory, gives=("target", "active"))

    def falls(self, read: Named) -> bool:
        """Tell whether what is read is beyond a threshold, and leans where to it must."""
        pose = read["base_pose"]
        if self._toward is not None and sum(map(operator.mul, vertical(*pose[3:].tolist()), self._toward)) >= 0:
            return False  # its upward direction, seen from the base, goes the other way
        if not math.isinf(self._tilt) and lean(self._up, *pose[3:].tolist()) > self._tilt:
            return True
        low = not math.isinf(self._height) and self._ground.height(pose) < self._height
        return low or (self._must_step is not None and self._must_step(read["state"]))

    def sample(self, memory: Named, read: Named) -> Changes:
        """Return the next point of the way to the posture, if the robot falls or has fallen."""
        falls = self.falls(read)
        if not memory["active"][0]:
            if not falls:
                return {}
            return {"active": 1.0, "target": read["reference"], "origin": read["reference"], "elapsed": 0.0}
        well = 0.0 if falls else memory["well"][0] + self.period
        if well >= self._reset_after:
            return {"active": 0.0, "well": 0.0}
        elapsed = memory["elapsed"][0] + self.period
        part = min(elapsed / self._duration, 1.0) if self._duration > 0 else 1.0
        target = memory["origin"] + part * (self._posture - memory["origin"])
        return {"target": target, "elapsed": elapsed, "well": well}
