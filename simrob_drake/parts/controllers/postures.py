"""Loops that move a robot to postures: a sequencer, which goes through a list of them, and a guard against falls.

The sequencer's postures are called *cells*: it goes to the next cell when the measured joints have reached the last.
The guard moves axes to a protective posture, such as arms forward, once the robot's base falls. Both drive the
reference of the servos by a *ramp*: a motion at constant speed from the present reference to the posture. Robots have n
axes; their positions are in rad, or in m for prismatic axes.
"""

import math
import weakref
from collections.abc import Callable, Sequence
from typing import ClassVar, Literal, NamedTuple, Self

import numpy as np
import numpy.typing as npt
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

REACHED = "reached"
"""Name of the last vector in the memory of a sequencer's block: when each cell was reached [s], -1 until then."""


class Cell(Strict):
    """Targets that are approached at the same time; other axes keep their last target."""

    targets_deg: dict[str, Number] = Field(min_length=1)
    """Positions to go to, by axis."""
    duration: NotNegative = 1.0
    """Duration of the motion to the targets [s]; the cell itself lasts until the robot has followed."""


class Pace(Strict):
    """Keys that determine when a cell counts as reached, and what happens if it is not."""

    tolerance_deg: Positive = 2.0
    """Largest distance of the measured joints from the targets of a cell that is reached [deg, or m for prismatic
    joints]."""
    speed_deg: Positive = 10.0
    """Largest measured speed of any axis at which a cell is reached [deg/s, or m/s]."""
    timeout: Positive | None = None
    """Longest time for a cell [s]; not limited unless given."""
    on_timeout: Literal["stop", "go_on"] = "stop"
    """Action at the timeout: end the run with the names of the joints that are late, or begin the next cell."""

    @model_validator(mode="after")
    def _check_timeout(self) -> Self:
        """Check that a timeout is given if the next cell is to begin at the timeout.

        Raises:
            ValueError: ``on_timeout`` is "go_on", and no timeout is given.
        """
        if self.on_timeout == "go_on" and self.timeout is None:
            raise ValueError(
                message("parts.go_on_needs_timeout", "on_timeout: go_on needs a timeout [s]")
            )
        return self


class Sequencer(Pace, LoopSection):
    """Go through cells of joint targets; to the next one when the measured joints have reached the last.

    It drives all axes of its robot. It is the thesis's automatic controller of joint positions (p. 98 to 102): the
    robot determines the times of the cells, not the program.
    """

    label: ClassVar[str] = message("parts.loop_sequencer", "sequencer")
    stages: ClassVar[tuple[str, ...]] = (
        message("parts.stage_cell", "Cell\nreached or timed out"),
        message("parts.stage_next_cell", "Ramp to the next cell"),
    )

    kind: Literal["sequencer"]
    cells: list[Cell] = Field(min_length=1)
    """The cells, in the order in which they are done."""
    ends: bool = False
    """Whether the run ends as soon as the last cell is done."""

    @model_validator(mode="after")
    def _check_durations(self) -> Self:
        """Check that each cell's motion ends before the timeout: the cell could not be reached otherwise.

        Raises:
            ValueError: the motion of a cell takes as long as the timeout, or longer.
        """
        if self.timeout is None:
            return self
        for number, cell in enumerate(self.cells):
            if cell.duration >= self.timeout:
                raise ValueError(
                    message(
                        "parts.cell_without_timeout",
                        "cells[{number}].duration is {duration:g} s; it must be less than timeout, {timeout:g} s",
                        number=number,
                        duration=cell.duration,
                        timeout=self.timeout,
                    )
                )
        return self

    def axes(self, robot: ResolvedRobot) -> Sequence[str]:
        """Names of all axes of the robot. It also checks the targets of the cells.

        Raises:
            SimrobError: a cell has a target for an axis that the robot does not have, or beyond the axis's limits.
        """
        for number, cell in enumerate(self.cells):
            for axis, target in cell.targets_deg.items():
                _check_target(robot.model, f"cells[{number}].targets_deg", axis, target)
        return robot.axes

    def cell_times(self, groups: Sequence[Vector]) -> list[float | None]:
        """Times at which the cells were reached, for the result of a run.

        Args:
            groups: discrete state of the block (a `CellSequence`) at the end of the run, one vector for each group.

        Returns:
            For each cell the time since the sequencer's start [s], or None if the cell was not reached.
        """
        # The block keeps the times at the end of its last group, in the vector `REACHED`. They are negative for cells
        # that were not reached. Rounded to 1 ns, they show no errors of adding up the periods.
        times = groups[-1][-len(self.cells) :].tolist()
        return [round(time, 9) if time >= 0 else None for time in times]

    def _block(self, key: str, robot: StationRobot, site: Site) -> SampledBlock:
        """Create the sequencer's block for its robot in the station under construction, the site."""
        # Factors from the units of the section to those of the block: rad per degree, or 1 for metres, shape (n,).
        units = robot.model.user_units
        return CellSequence(
            self,
            targets=[_targets(cell, robot.model) for cell in self.cells],
            tolerance=units * self.tolerance_deg,
            largest_speed=units * self.speed_deg,
            axes=robot.axes,
        )


def _check_target(model: RobotModel, key: str, axis: str, target: float) -> None:
    """Check a target of a cell.

    Args:
        model: model of the robot.
        key: key of the cell's targets, for errors.
        axis: name of the axis.
        target: target of the axis [deg or m].

    Raises:
        SimrobError: the robot has no such axis, or the target is beyond the axis's limits.
    """
    index = model.axis_index(axis, key)
    # A trajectory of one sample and one axis, shape (1, 1) [rad or m].
    position = np.array([[target * model.user_units[index]]])
    violation = model.limits.of_axes([index]).find_violation(position)
    if violation is not None:
        raise InvalidParameter(
            f"{key}.{axis}",
            compound("{value} {unit}", value=violation.value, unit=violation.unit),
            message("parts.within", "within {limits}", limits=violation.limits),
        )


def _targets(cell: Cell, model: RobotModel) -> Vector:
    """Targets of all axes in a cell, shape (n,) [rad or m]. They are nan for axes without a target."""
    return model.user_units * model.axis_vector(dict(cell.targets_deg), "targets_deg", np.nan)


class CellSequence(SampledBlock):
    """Ramp from cell to cell, each when the one before is reached, or has timed out if the section goes on then.

    With the origin o at which a cell's ramp begins, its goal g and its duration T, the target at the time t since the
    beginning of the cell is o + min(t / T, 1) (g - o).

    Ports:
        in  ``position``, ``velocity`` (n) [rad, rad/s]: measured; ``reference`` (n): where the first ramp begins.
        out ``target`` (n) [rad]; ``active`` (1): 1 from the first sample on; ``cell`` (1): the number of the cell,
        counted from 0; ``done`` (1): 1 once the last is over in one of these ways.
    """

    def __init__(
        self,
        section: Sequencer,
        *,
        targets: Sequence[Vector],
        tolerance: Vector,
        largest_speed: Vector,
        axes: Sequence[str],
    ) -> None:
        """Create the block.

        Args:
            section: section of the sequencer.
            targets: targets of each cell, shape (n,) [rad]. They are nan for axes that keep their last target.
            tolerance: largest distance of each axis from its target at which a cell is reached, shape (n,) [rad].
            largest_speed: largest speed of each axis at which a cell is reached, shape (n,) [rad/s].
            axes: names of the axes.
        """
        size = len(axes)
        self.units = {"target": "rad"}
        self._section = section
        self._targets = targets
        self._durations = [cell.duration for cell in section.cells]
        self._tolerance = tolerance
        self._largest_speed = largest_speed
        self._axes = axes
        self._timeout = math.inf if section.timeout is None else section.timeout
        zero = np.zeros(1)
        outputs = {"target": np.zeros(size), "active": zero, "cell": zero, "done": zero}
        memory = {
            **outputs,
            "elapsed": zero,  # time since the beginning of the cell [s]
            "origin": np.zeros(size),  # where the ramp of the cell begins [rad]
            "clock": zero,  # time since the first sample [s]
        }
        # The last vector of the memory: `Sequencer.cell_times` finds it at the end of the discrete state.
        memory[REACHED] = np.full(len(targets), -1.0)
        super().__init__(
            period=1 / section.rate,
            reads={"position": size, "velocity": size, "reference": size},
            memory=memory,
            gives=tuple(outputs),
        )

    def sample(self, memory: Named, read: Named) -> Changes:
        """Compute the next point of the ramp, and begin the next cell if this one is reached or has timed out.

        Args:
            memory: memory before the sample.
            read: inputs of the block.

        Returns:
            The new values of the memory.

        Raises:
            RunEnds: the last cell is done, or a cell has timed out, and the section asks for the end of the run.
        """
        # At the first sample, the first ramp begins where the reference is.
        if not memory["active"][0]:
            return {"active": 1.0, "target": read["reference"], "origin": read["reference"]}
        is_done = bool(memory["done"][0])
        if is_done and self._section.ends:
            raise RunEnds(
                message(
                    "parts.last_cell_done",
                    "the last of {count} {count:cell|cells} is reached",
                    count=len(self._targets),
                )
            )

        number = int(memory["cell"][0])
        elapsed = memory["elapsed"][0] + self.period
        clock = memory["clock"][0] + self.period
        duration = self._durations[number]
        progress = min(elapsed / duration, 1.0) if duration > 0 else 1.0
        targets = self._targets[number]
        origin = memory["origin"]
        # target = o + min(t / T, 1) (g - o). Axes without a target stay at the origin, their goal in the cell before.
        goal = np.where(np.isnan(targets), origin, targets)
        target = origin + progress * (goal - origin)
        changes: dict[str, Vector | float] = {"target": target, "elapsed": elapsed, "clock": clock}
        # The robot stays at the last cell, whose time of arrival is kept already.
        if is_done:
            return changes

        late = self._late_axes(targets, read)
        is_reached = progress == 1.0 and not late.any()
        if is_reached:
            reached_times = memory[REACHED].copy()
            reached_times[number] = clock
            changes[REACHED] = reached_times
        elif elapsed < self._timeout:
            return changes
        elif self._section.on_timeout == "stop":
            raise RunEnds(self._timeout_text(number, late))

        # The cell is reached, or its time is over and the section goes on all the same. The next ramp begins at the
        # goal of this cell, not at the measured position: the target does not jump.
        is_last = number + 1 == len(self._targets)
        if is_last:
            return {**changes, "done": 1.0}
        return {**changes, "cell": number + 1, "elapsed": 0.0, "origin": goal}

    def _late_axes(self, targets: Vector, read: Named) -> npt.NDArray[np.bool_]:
        """Find the axes that are too far from their targets, or too fast, shape (n,).

        An axis without a target is only late if it is too fast.

        Args:
            targets: targets of the cell, shape (n,) [rad]; nan for axes without one.
            read: inputs of the sample: ``position`` [rad] and ``velocity`` [rad/s] are measured, shape (n,) each.
        """
        has_target = ~np.isnan(targets)
        is_far = abs(read["position"] - targets) > self._tolerance
        is_fast = abs(read["velocity"]) > self._largest_speed
        # An axis is late if it has a target that is far, or if it is fast: & binds more tightly than |.
        return np.asarray(has_target & is_far | is_fast)

    def _timeout_text(self, number: int, late: npt.NDArray[np.bool_]) -> str:
        """Write the reason of a run that ends at the timeout of a cell, with the names of the late axes.

        Args:
            number: index of the cell.
            late: whether each axis is late, shape (n,). If none is, the ramp itself has not ended.
        """
        late_names = ", ".join(self._axes[index] for index in np.flatnonzero(late).tolist())
        return message(
            "parts.cell_not_reached",
            "cell {number} was not reached within {timeout:g} s; late: {late}",
            number=number,
            timeout=self._timeout,
            late=late_names or message("parts.its_ramp", "the ramp to the cell"),
        )


# Directions in which the area between the feet is measured: 64 make distances at most 0.13 % too short.
_ANGLES = np.linspace(0, 2 * np.pi, 64, endpoint=False)
# Unit vectors in these directions, shape (64, 2).
_DIRECTIONS = np.column_stack([np.cos(_ANGLES), np.sin(_ANGLES)])


class CapturePoint:
    r"""Distance of a robot's capture point from the area that its feet span.

    A robot that steps onto its capture point comes to rest there, if it is a linear inverted pendulum. With the centre
    of mass c at height z over the feet, the point is :math:`c_{xy} + \dot c_{xy} \sqrt{z / g}` (Pratt and others,
    2006). While the point is between the feet, they can stop the robot.
    """

    def __init__(self, plant: MultibodyPlant, robot: StationRobot, key: str) -> None:
        """Prepare the computation.

        Args:
            plant: the finalized plant, which need not be part of a diagram.
            robot: the robot.
            key: key in the station file, for the error.

        Raises:
            Unsuitable: the robot has no feet.
        """
        if robot.feet is None:
            raise Unsuitable(
                key, message("parts.no_feet", "{model} has no feet", model=robot.model.name)
            )
        # The block in the diagram must not keep the plant in memory.
        self._plant = weakref.proxy(plant)
        self._instance = robot.instance
        # Contact points of each foot in the frame of its link, shape (3, points) [m].
        self._soles = {link: robot.feet.support_points(link).T for link in robot.feet.links}
        # g [m/s²].
        self._gravity = np.linalg.norm(plant.gravity_field().gravity_vector())
        # Work space: every evaluation sets its state anew.
        self._scratch = plant.CreateDefaultContext()

    def distance_from_feet(self, state: Vector) -> float:
        """Compute the distance of the capture point from the area between the feet [m]; negative in the area.

        The area is the convex hull of the contact points of all feet, seen from above. Lifted feet count, too.

        Args:
            state: positions and velocities of the plant, shape (nq + nv,).
        """
        plant = self._plant
        context = self._scratch
        instances = [self._instance]
        plant.SetPositionsAndVelocities(context, state)
        com = plant.CalcCenterOfMassPositionInWorld(context, instances)
        velocity = plant.CalcCenterOfMassTranslationalVelocityInWorld(context, instances)
        # Contact points of all feet in the world, shape (3, points) [m].
        points_of_feet = []
        for link, sole in self._soles.items():
            frame = plant.GetFrameByName(link, self._instance)
            points_of_feet.append(
                plant.CalcPointsPositions(context, frame, sole, plant.world_frame())
            )
        points = np.hstack(points_of_feet)

        # c_xy + c'_xy sqrt(z / g); the height is not negative, since a fallen robot may have its feet above itself.
        height = max(com[2] - points[2].min(), 0.0)
        capture_point = com[:2] + velocity[:2] * np.sqrt(height / self._gravity)
        # With unit directions d and contact points p_i, the distance of the capture point c from their convex hull is
        # max_d (d c - max_i d p_i) = -min_d max_i d (p_i - c), negative within the hull. `edges` has the entry
        # max_i d (p_i - c) for each direction, shape (64,): how far the hull reaches beyond c.
        edges = (_DIRECTIONS @ (points[:2] - capture_point[:, np.newaxis])).max(axis=1)
        return float(-edges.min())


class FallGuard(LoopSection):
    """Move axes to a posture, such as arms forward, once the base is too low or leans too far.

    The axes stay in the posture until the guard is reset. The thesis does the same (p. 108 and 109). A guard only
    drives the axes of its posture. Several guards, each with another `toward_deg`, take another posture for each side.
    """

    label: ClassVar[str] = message("parts.loop_fall_guard", "fall guard")
    stages: ClassVar[tuple[str, ...]] = (
        message("parts.stage_height_or_lean", "Height or lean"),
        message("parts.stage_guard", "Guard\nfalling or standing"),
        message("parts.stage_way_to_posture", "Motion to the posture"),
    )

    kind: Literal["fall_guard"]
    height: Positive | None = None
    """Height of the base over the ground beneath, below which it acts [m]."""
    tilt_deg: Positive | None = None
    """Angle between the direction of the base that is up at the start and the vertical, beyond which it acts."""
    toward_deg: Number | None = None
    """Direction in which the base must lean, within 90° to either side: 0 along the world's x axis at the start, 90
    along y; it turns with the base. Any direction unless given."""
    capture_point: NotNegative | None = None
    """Largest distance of the capture point from the area between the feet [m]: the robot would have to step onto this
    point to stop. It is computed from the true state."""
    posture_deg: dict[str, Number] = Field(min_length=1)
    """Positions to which axes move then, by axis."""
    duration: NotNegative = 0.2
    """Duration of this motion [s]."""
    reset_after: Positive | None = None
    """Time without a fall after which the guard ends [s]; it never does unless given."""

    @model_validator(mode="after")
    def _check_has_bound(self) -> "FallGuard":
        """Check that at least one bound is given.

        Raises:
            ValueError: neither ``height`` nor ``tilt_deg`` nor ``capture_point`` is given.
        """
        if self.height is None and self.tilt_deg is None and self.capture_point is None:
            raise ValueError(
                message(
                    "parts.guard_needs_threshold",
                    "a fall guard needs a threshold: height, tilt_deg or capture_point",
                )
            )
        return self

    def axes(self, robot: ResolvedRobot) -> Sequence[str]:
        """Names of the axes of the posture. The section may write aliases of these names.

        Raises:
            SimrobError: the section names an axis that the robot does not have.
        """
        return [
            robot.axes[robot.model.axis_index(axis, "posture_deg")] for axis in self.posture_deg
        ]

    def source(
        self, builder: DiagramBuilder, name: str, robot: StationRobot, site: Site, key: str
    ) -> OutputPort:
        """Find the output port that an input of the guard's block reads.

        The input ``state``, which the block has if the section sets a bound for the capture point, reads the state of
        the whole plant. All other inputs read outputs of the station, as those of every loop do.

        Args:
            builder: builder of the diagram. Blocks that compute the output may be added.
            name: name of the input.
            robot: robot that the guard drives.
            site: the station under construction.
            key: key of the section, for errors.

        Raises:
            UnknownName: the station has no such output.
        """
        # The plant's state is no output of the station, so the base class cannot find it by its name.
        return site.state if name == "state" else super().source(builder, name, robot, site, key)

    def _block(self, key: str, robot: StationRobot, site: Site) -> SampledBlock:
        """Create the guard's block for its robot in the station under construction, the site. The key is for errors."""
        # From the world to the base, as it stands at the start. Directions are fixed to the base: they turn with it.
        to_base = robot.base.rotation().inverse()
        toward = None
        if self.toward_deg is not None:
            angle = math.radians(self.toward_deg)
            toward = to_base @ np.array([math.cos(angle), math.sin(angle), 0.0])
        posture = robot.model.axis_vector(dict(self.posture_deg), f"{key}.posture_deg")
        return ProtectivePosture(
            self,
            posture=robot.model.user_units * posture,
            up=to_base @ np.array([0.0, 0.0, 1.0]),
            toward=toward,
            ground=site.plant.ground,
            must_step=self._step_condition(key, robot, site),
        )

    def _step_condition(self, key: str, robot: StationRobot, site: Site) -> "StepCondition | None":
        """Make the condition that the capture point is too far from the feet.

        Returns None if the section sets no bound for it.

        Args:
            key: key of the section, for errors.
            robot: robot that the guard drives.
            site: the station under construction.

        Raises:
            Unsuitable: the robot has no feet.
        """
        if self.capture_point is None:
            return None
        plant = site.plant.plant
        point = CapturePoint(plant, robot, f"{key}.capture_point")
        largest_distance = self.capture_point
        return StepCondition(
            state_size=plant.num_multibody_states(),
            holds=lambda state: point.distance_from_feet(state) > largest_distance,
        )


class StepCondition(NamedTuple):
    """Condition in which a robot would have to step to stop its fall.

    Attributes:
        state_size: size of the plant's state, nq + nv.
        holds: whether the condition holds, by the plant's state (nq + nv,).
    """

    state_size: int
    holds: Callable[[Vector], bool]


class ProtectivePosture(SampledBlock):
    """Ramp from the reference to a posture, once the base falls.

    With the reference o at that moment, the posture p and the duration T, the target at the time t since then is
    o + min(t / T, 1) (p - o).

    Ports:
        in  ``base_pose`` (7): x y z [m] and a quaternion; ``reference`` (n) [rad]: where the ramp begins; ``state``
        (nq + nv): of the whole plant, only with a `StepCondition`.
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
        must_step: StepCondition | None = None,
    ) -> None:
        """Create the block.

        Args:
            section: section of the guard.
            posture: the posture of all axes, shape (n,) [rad]. Only the axes that the section names move to it.
            up: direction in the base that points up while the robot stands, shape (3,).
            toward: horizontal direction in the base towards which it must lean, shape (3,). If it is None, any
                direction counts.
            ground: the ground, above which heights are measured. If it is None, it is the plane z = 0.
            must_step: condition in which the guard acts, too. If it is None, the state is not read.
        """
        self.units = {"target": "rad"}
        self._section = section
        self._posture = posture
        # Plain numbers instead of arrays: they are faster for vectors of three entries.
        self._up: list[float] = up.tolist()
        self._toward: list[float] | None = None if toward is None else toward.tolist()
        self._ground = ground or Ground()
        self._must_step = None if must_step is None else must_step.holds
        self._largest_tilt = None if section.tilt_deg is None else math.radians(section.tilt_deg)
        self._reset_after = math.inf if section.reset_after is None else section.reset_after
        zero = np.zeros(len(posture))
        reads = {"base_pose": 7, "reference": len(posture)}
        if must_step is not None:
            reads["state"] = must_step.state_size
        memory = {
            "target": zero,
            "active": np.zeros(1),
            "elapsed": np.zeros(1),  # time since the guard acts [s]
            "origin": zero,  # where the ramp begins [rad]
            # Time for which `falls` has been False while the guard acts [s].
            "well": np.zeros(1),
        }
        super().__init__(
            period=1 / section.rate, reads=reads, memory=memory, gives=("target", "active")
        )

    def falls(self, read: Named) -> bool:
        """Whether a bound is exceeded, and the base leans to the side of the guard's direction, if it has one.

        Bounds are checked in the order of their cost: an input that is not needed is not evaluated.

        Args:
            read: inputs of the sample.
        """
        pose = read["base_pose"]
        quaternion = pose[3:].tolist()
        if self._toward is not None:
            # The vertical in the axes of the base. If the base leans towards a direction, the vertical moves the other
            # way, so its component along this direction is negative.
            up_x, up_y, up_z = vertical(*quaternion)
            toward_x, toward_y, toward_z = self._toward
            component = up_x * toward_x + up_y * toward_y + up_z * toward_z
            if component >= 0:
                return False
        if self._largest_tilt is not None and lean(self._up, *quaternion) > self._largest_tilt:
            return True
        smallest_height = self._section.height
        if smallest_height is not None and self._ground.height(pose) < smallest_height:
            return True
        return self._must_step is not None and self._must_step(read["state"])

    def sample(self, memory: Named, read: Named) -> Changes:
        """Begin to act if the robot falls, compute the next point of the ramp while acting, and end at the reset.

        Args:
            memory: memory before the sample.
            read: inputs of the block.

        Returns:
            The new values of the memory; none while the robot stands.
        """
        falls = self.falls(read)
        if not memory["active"][0]:
            if not falls:
                return {}
            return {
                "active": 1.0,
                "target": read["reference"],
                "origin": read["reference"],
                "elapsed": 0.0,
            }

        # While the robot falls (see `falls`), the time until the reset begins anew.
        well = 0.0 if falls else memory["well"][0] + self.period
        if well >= self._reset_after:
            return {"active": 0.0, "well": 0.0}
        elapsed = memory["elapsed"][0] + self.period
        duration = self._section.duration
        progress = min(elapsed / duration, 1.0) if duration > 0 else 1.0
        # target = o + min(t / T, 1) (p - o)
        origin = memory["origin"]
        target = origin + progress * (self._posture - origin)
        return {"target": target, "elapsed": elapsed, "well": well}
