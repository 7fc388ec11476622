"""Forces over time on bodies of a station: the sections of ``forces`` and the blocks that apply them.

A *source* is a block of Drake whose first output depends on time alone. For most kinds of force it is the force itself,
along the axes of the frame at which the force acts. A kind whose force also depends on how the body moves, such as
`Drag`, adds a second block, which computes the force from the output of the source.
"""

import weakref
from abc import ABC, abstractmethod
from typing import Annotated, Literal, NamedTuple

import numpy as np
from pydantic import Field
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Frame
from pydrake.systems.framework import DiagramBuilder, LeafSystem, OutputPort
from pydrake.systems.primitives import Sine, TrajectorySource
from pydrake.trajectories import PiecewisePolynomial, Trajectory

from simrob_drake.base.constants import STANDARD_GRAVITY
from simrob_drake.base.errors import Unsuitable, one_of
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import message
from simrob_drake.base.sections import (
    Duration,
    Frequency,
    Instant,
    Number,
    Positive,
    Strict,
    Triple,
)
from simrob_drake.base.signals import applied_signal
from simrob_drake.blocks.block import add_and_connect
from simrob_drake.blocks.passive_joints import add_external_force
from simrob_drake.blocks.sampled import Changes, Named, SampledBlock
from simrob_drake.parts.kinds import Kinds
from simrob_drake.parts.resolved import WORLD, StationContents, name_or_only
from simrob_drake.parts.site import Site
from simrob_drake.parts.station_plant import StationPlant
from simrob_drake.parts.targets import frame_names, frame_of


class ForcePoint(NamedTuple):
    """Point of a body at which a force acts.

    Attributes:
        frame: frame of the body in whose axes the force is given.
        point: the point in that frame, shape (3,) [m].
    """

    frame: Frame
    point: Vector


class ForceSection(Strict, ABC):
    """A section of ``forces``: a force on a body over time. A subclass is a kind of force."""

    kind: str
    at: str | None = None
    """Body on which the force acts: a robot (at the centre of mass of its root link, along that link's axes), or a
    tool, link or piece (at its origin, along its axes). If it is left out, the only robot: its tool, or its root link
    if it floats."""

    @property
    def offset(self) -> Vector:
        """Distance of the point at which the force acts from the one that `at` names, in its axes, shape (3,) [m]."""
        return np.zeros(3)

    @property
    def edges(self) -> tuple[float, ...]:
        """Times at which a solver's step must end [s], since the force jumps there.

        There are none if the force is smooth, or if it is sampled: Drake ends steps at samples anyway.
        """
        return ()

    def trajectory(self) -> Trajectory | None:
        """Trajectory that the source plays, or None if the source is another block."""
        return None

    def source(self) -> LeafSystem:
        """Create the source. Its first output is the force (3) [N]. A kind without a trajectory overrides this method.

        For a kind with its own `add_force_law`, such as `Drag`, it is another signal over time, from which the block of
        that method computes the force.
        """
        return TrajectorySource(self.trajectory())

    @abstractmethod
    def caption(self) -> str:
        """Short description of the force for labels, such as "20 N at 1 s"."""

    def add_force_law(
        self,
        builder: DiagramBuilder,
        site: Site,
        name: str,
        frame: Frame,
        point: Vector,
        source: OutputPort,
    ) -> OutputPort:
        """Add the block that computes the force from the source, if the kind needs one. Here none is added.

        Args:
            builder: builder of the diagram.
            site: the station under construction.
            name: prefix of the block's name.
            frame: frame in whose axes the force is given.
            point: point of the frame at which the force acts, shape (3,) [m].
            source: first output of the source.

        Returns:
            The port of the force, size 3 [N], along the axes of the frame: here the source's own port.
        """
        return source

    def check(self, key: str, station: StationContents) -> None:
        """Check that forces move the station, and that the body at which the force acts exists.

        Args:
            key: key of the section, for errors.
            station: contents of the station.

        Raises:
            Unsuitable: the station is kinematic.
            SimrobError: `at` names nothing or the world, or it is left out in a station with several robots or none.
        """
        if not station.engine.moves_by_forces:
            raise Unsuitable(
                key,
                message("parts.no_forces", "a kinematic station has no forces"),
                message("parts.leave_out_or_dynamic", "leave it out, or set mode: dynamic"),
            )
        if self.at is not None:
            # The world is a frame, too, but a force on it would move nothing.
            movable_frames = [name for name in frame_names(station) if name != WORLD]
            known = [*station.robots, *movable_frames]
            kind = message(
                "parts.place_of_force", "robot, tool, link or piece for {key}.at", key=key
            )
            one_of(kind, self.at, known)
        # It raises an error if `at` is left out and there is no only robot.
        self.place_name(key, station)

    def place_name(self, key: str, station: StationContents) -> str:
        """Name of the robot, tool, link or piece on which the force acts.

        A force at a tool acts at the origin of the tool's own frame, without the offset of a tool centre point.

        Args:
            key: key of the section, for errors.
            station: contents of the station.

        Raises:
            InvalidParameter: `at` is left out, and the station has several robots, or none.
        """
        if self.at is not None:
            return self.at
        robot = station.robots[name_or_only(None, list(station.robots), key=f"{key}.at")]
        # An arm is pushed at its tool, a robot on legs as a whole.
        return robot.name if robot.floats or not robot.tcp else f"{robot.prefix}{robot.tcp}"


def add_force(
    builder: DiagramBuilder,
    site: Site,
    name: str,
    section: ForceSection,
    source: LeafSystem,
    caption: str,
) -> None:
    """Apply a force to the plant, and declare it as the output ``applied_force.<name>`` of the station.

    The blocks that apply forces have outputs for the plant's only port of spatial forces: they are appended to
    ``site.spatial_forces``, to be connected together at the end.

    Args:
        builder: builder of the diagram.
        site: the station under construction.
        name: name of the force.
        section: section of the force.
        source: the section's source, which is added to the diagram here.
        caption: short description of the force for the picture of the station.
    """
    block_name = f"force.{name}"
    # The section's place is a name: here it becomes a point of a body of the plant.
    place = section.place_name(f"forces.{name}", site.station)
    frame, origin = place_of(site.plant, place)
    point = origin + section.offset

    source_port = builder.AddNamedSystem(f"{block_name}.source", source).get_output_port(0)
    force = section.add_force_law(builder, site, block_name, frame, point, source_port)
    block = add_external_force(builder, site.plant.plant_block, frame, name=block_name, point=point)
    builder.Connect(force, block.get_command_input_port())
    site.spatial_forces.append(block.get_spatial_forces_output_port())

    label = message(
        "parts.block_force",
        "Force '{name}'\n{caption}\nat {place}",
        name=name,
        caption=caption,
        place=place,
    )
    # All systems of a force share one block of the picture.
    for system in (block_name, f"{block_name}.source"):
        site.picture.draw(system, "force", label, key=block_name)
    output = f"applied_force.{name}"
    title = message(
        "parts.applied_force",
        "applied force '{name}' at {place}, in its axes",
        name=name,
        place=place,
    )
    site.outputs.add(output, force, applied_signal(output, "N", title, part=name))


def place_of(plant: StationPlant, place: str) -> ForcePoint:
    """Find the point at which a force acts on a robot, tool, link or piece, by its name.

    On a robot it is the centre of mass of the root link, with all links and pieces that are fixed to it, and the frame
    is that of the root link. Otherwise it is the origin of the frame of the tool, link or piece.
    """
    if place not in plant.robots:
        return ForcePoint(frame_of(plant, place), np.zeros(3))
    root = plant.robots[place].root
    # Drake gives the centre of mass in the axes of the body, of which the root link may be only a fixed frame.
    body_from_root = root.GetFixedPoseInBodyFrame()
    return ForcePoint(root, np.asarray(body_from_root.inverse() @ root.body().default_com()))


# Distance of the end of a step before an edge of a push from the edge [s], see `Push.edges`.
_JUST_BEFORE = 1e-11


class Push(ForceSection):
    """A constant force for a while."""

    kind: Literal["push"]
    start: Instant = 0.0
    """Time at which the force begins [s]."""
    duration: Duration = 0.1
    """Time for which the force acts [s]."""
    force: Triple
    """Force along x, y and z of the frame at which it acts [N]."""

    @property
    def end(self) -> float:
        """Time at which the force ends [s]."""
        return self.start + self.duration

    @property
    def edges(self) -> tuple[float, ...]:
        """Times at which a solver's step must end [s]: begin and end of the push, and just before each of them.

        There is no time before a push that begins at 0.

        An integration scheme that keeps its inputs constant during a step would miss a part of a push that begins
        within the step. A scheme that evaluates the force at the end of a step would take the force after the edge for
        the whole step that ends there: so this step is as short as possible.
        """
        edges = (self.start - _JUST_BEFORE, self.start, self.end - _JUST_BEFORE, self.end)
        return tuple(edge for edge in edges if edge >= 0)

    def trajectory(self) -> Trajectory:
        """Force over time, shape (3, 1) [N]: zero, the force from `start` on, and zero again from `end` on."""
        force = np.array(self.force)
        zero = np.zeros(3)
        # A hold keeps each value until the next time, and the last value from the last time on. It needs a value at the
        # last time, so the zero after the push is given twice.
        times = [self.start, self.end, self.end + 1.0]
        values = [force, zero, zero]
        # A hold has its first value also before its first time: a later push needs a zero in front.
        if self.start > 0:
            times.insert(0, 0.0)
            values.insert(0, zero)
        return PiecewisePolynomial.ZeroOrderHold(times, np.array(values).T)

    def caption(self) -> str:
        """Short description of the force for labels: its size and its begin."""
        size = float(np.linalg.norm(self.force))
        return message(
            "parts.force_push", "{size:.3g} N at {start:g} s", size=size, start=self.start
        )


class SineForce(ForceSection):
    """A force that swings about zero."""

    kind: Literal["sine"]
    amplitude: Triple
    """Largest force along x, y and z of the frame at which it acts [N]."""
    frequency: Frequency
    """Oscillations per second [Hz]."""
    phase_deg: Number = 0.0
    """Phase angle at the start of a run [deg]."""

    def source(self) -> Sine:
        """Create the source: amplitude sin(2 pi frequency t + phase), size 3 [N]."""
        omega = np.full(3, 2 * np.pi * self.frequency)
        phase = np.full(3, np.deg2rad(self.phase_deg))
        return Sine(np.array(self.amplitude), omega, phase)

    def caption(self) -> str:
        """Short description of the force for labels: its amplitude and its frequency."""
        return message(
            "parts.force_sine",
            "sine ±{size:g} N, {frequency:.3g} Hz",
            size=float(np.linalg.norm(self.amplitude)),
            frequency=self.frequency,
        )


# Time between two samples of a drag [s].
_DRAG_PERIOD = 0.01
# Distance of a target for which the default spring pulls as strongly as the weight of the robot or piece [m].
_WEIGHT_DISTANCE = 0.25
# Smallest mass for which the default spring and damper are computed [kg]: bodies may be massless.
_SMALLEST_MASS = 1e-3
# Delay of the changes of targets [s]. However their times are rounded, a sample at the time of a change has the target
# of before the change.
_CHANGE_DELAY = 1e-9


class Drag(ForceSection):
    """A spring that pulls a point of a body after a target that moves; sampled at 100 Hz.

    Its damping is that of a body that swings with a damping ratio of one half.
    """

    kind: Literal["drag"]
    point: Triple = (0.0, 0.0, 0.0)
    """Point at which the spring pulls, in the frame that `at` names [m]."""
    start: Instant = 0.0
    """Time at which the first target begins to pull [s]."""
    targets: Annotated[tuple[Triple, ...], Field(min_length=1)]
    """Positions in the world to which the spring pulls, one after the other [m]."""
    each: Duration = 0.05
    """Time for which each target pulls [s]."""
    stiffness: Positive | None = None
    """Stiffness of the spring [N/m]; if it is left out, a target 0.25 m away pulls with the weight of the robot or
    piece."""

    @property
    def end(self) -> float:
        """Time at which the last target ceases to pull [s]."""
        return self.start + self.each * len(self.targets)

    @property
    def offset(self) -> Vector:
        """Distance of the point at which the spring pulls from the one that `at` names, in its axes, shape (3,) [m]."""
        return np.array(self.point)

    def trajectory(self) -> Trajectory:
        """Targets over time, shape (4, 1): 1 while a target pulls, otherwise 0; then its position in the world [m]."""
        count = len(self.targets)
        with_target = np.column_stack([np.ones(count), np.array(self.targets)])
        before = np.zeros(4)
        # A hold needs a value at its last time, too, so the zeros after the last target are given twice.
        after = np.zeros((2, 4))
        # Each target begins a little late, see `_CHANGE_DELAY`. The last change is the end of the last target.
        changes = self.start + _CHANGE_DELAY + self.each * np.arange(count + 1)
        times = [0.0, *changes, changes[-1] + 1.0]
        values = np.vstack([before, with_target, after])
        return PiecewisePolynomial.ZeroOrderHold(times, values.T)

    def add_force_law(
        self,
        builder: DiagramBuilder,
        site: Site,
        name: str,
        frame: Frame,
        point: Vector,
        source: OutputPort,
    ) -> OutputPort:
        """Add the spring, which computes the force from the target and the state of the plant.

        Args:
            builder: builder of the diagram.
            site: the station under construction.
            name: prefix of the block's name.
            frame: frame in whose axes the force is given.
            point: point of the frame at which the spring pulls, shape (3,) [m].
            source: port of the target, size 4: 1 while a target pulls and otherwise 0, then its position in the world
                [m].

        Returns:
            The port of the force, size 3 [N], along the axes of the frame.
        """
        plant = site.plant.plant
        body = frame.body()
        # Without gravity there is no weight to compare with: the default spring is then that of standard gravity.
        gravity = float(np.linalg.norm(plant.gravity_field().gravity_vector())) or STANDARD_GRAVITY
        # The default stiffness fits the mass of the whole robot or piece. The damping fits the pulled body alone,
        # c = 2 zeta sqrt(k m) with the damping ratio zeta = 1/2: on a light link, a sampled damper that fits a larger
        # mass could be unstable.
        total_mass = plant.CalcTotalMass(plant.CreateDefaultContext(), [body.model_instance()])
        stiffness = self.stiffness or max(total_mass, _SMALLEST_MASS) * gravity / _WEIGHT_DISTANCE
        damping = float(np.sqrt(stiffness * max(body.default_mass(), _SMALLEST_MASS)))
        spring = DragSpring(
            period=_DRAG_PERIOD,
            plant=plant,
            frame=frame,
            point=point,
            stiffness=stiffness,
            damping=damping,
        )
        return add_and_connect(builder, f"{name}.spring", spring, source, site.state)

    def caption(self) -> str:
        """Short description of the force for labels: its begin and its end."""
        return message(
            "parts.force_drag", "drag from {start:g} to {end:g} s", start=self.start, end=self.end
        )


class DragSpring(SampledBlock):
    r"""Spring and damper between a point of a body and a target, sampled and held. Without a target the force is zero.

    .. math:: f = k (p_t - p) - c \dot{p},

    with the position p of the point, the target :math:`p_t`, the stiffness k and the damping c.

    Ports:
        in  ``target`` (4): 1 if there is a target and otherwise 0, then its position p_t in the world [m]; ``state``
        (nq + nv): positions and velocities of the whole plant.
        out ``force`` (3) [N]: in the axes of the frame.
    """

    def __init__(
        self,
        *,
        period: float,
        plant: MultibodyPlant,
        frame: Frame,
        point: Vector,
        stiffness: float,
        damping: float,
    ) -> None:
        """Create the block.

        Args:
            period: time between two samples [s].
            plant: the finalized plant, which need not be part of the diagram.
            frame: frame of the body.
            point: point of that frame, shape (3,) [m].
            stiffness: stiffness k [N/m].
            damping: damping c [N·s/m].
        """
        self.units = {"force": "N"}
        reads = {"target": 4, "state": plant.num_multibody_states()}
        super().__init__(period=period, reads=reads, memory={"force": np.zeros(3)}, gives=["force"])
        # The station owns the plant: a block must not keep it in memory. A frame would, an index does not.
        self._plant = weakref.proxy(plant)
        self._frame = frame.index()
        self._point = point
        self._stiffness = stiffness
        self._damping = damping
        # Work space: every evaluation sets its state anew.
        self._scratch = plant.CreateDefaultContext()

    def sample(self, memory: Named, read: Named) -> Changes:
        """Compute the force at this sample.

        Args:
            memory: memory before the sample, which has no effect.
            read: target and state of the plant.

        Returns:
            The new force in the axes of the frame, shape (3,) [N].
        """
        has_target = read["target"][0]
        if not has_target:
            return {"force": np.zeros(3)}
        plant = self._plant
        context = self._scratch
        plant.SetPositionsAndVelocities(context, read["state"])
        frame = plant.get_frame(self._frame)
        pose = frame.CalcPoseInWorld(context)
        motion = frame.CalcSpatialVelocityInWorld(context)

        # dp/dt = v + omega x r, with the velocity v of the frame's origin and the arm r from there to the point.
        rotation = pose.rotation()
        arm = rotation @ self._point
        velocity = motion.translational() + np.cross(motion.rotational(), arm)
        # f = k (p_t - p) - c dp/dt, in the world, then in the axes of the frame.
        distance = read["target"][1:] - pose @ self._point
        force = self._stiffness * distance - self._damping * velocity
        return {"force": rotation.inverse() @ force}


KINDS = Kinds(
    __name__,
    {"push": "Push", "drag": "Drag", "sine": "SineForce"},
    base=ForceSection,
    point="forces",
)
ForceConfig = Annotated[ForceSection, KINDS]
"""A section of ``forces`` in a station file, of the class of its kind."""
Forces = Annotated[dict[str, ForceConfig], KINDS.names_are_kinds]
"""Sections of ``forces`` by name. A section without a kind has the kind that is its name, such as ``push``."""
