"""Forces over time on a station's bodies: where they act, the blocks that apply them, and the kinds that there are."""

import weakref
from abc import ABC, abstractmethod
from typing import Annotated, Literal

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
from simrob_drake.base.sections import Duration, Frequency, Instant, Number, Positive, Strict, Triple
from simrob_drake.base.signals import applied_signal
from simrob_drake.blocks.block import add_and_connect
from simrob_drake.blocks.passive_joints import add_external_force
from simrob_drake.blocks.sampled import Changes, Named, SampledBlock
from simrob_drake.parts.kinds import Kinds
from simrob_drake.parts.resolved import StationContents, name_or_only
from simrob_drake.parts.site import Site
from simrob_drake.parts.station_plant import StationPlant
from simrob_drake.parts.targets import frame_names, frame_of


class ForceSection(Strict, ABC):
    """A section of ``forces``: a force on a body over time."""

    kind: str
    at: str | None = None
    """Where it acts: a robot (at the centre of mass of its root link, along that link's axes), or a tool, link or piece
    (at its origin, along its axes). The only robot unless given: its tool, or its root link if it floats."""

    @property
    def offset(self) -> Vector:
        """Where it acts beside that, along those axes, shape (3,) [m]."""
        return np.zeros(3)

    @property
    def edges(self) -> tuple[float, ...]:
        """Times that no step goes across [s]; none of what is smooth, or samples."""
        return ()

    def trajectory(self) -> Trajectory | None:
        """Return what its source plays over time; None where that is no trajectory."""
        return None

    def source(self) -> LeafSystem:
        """Return the block whose first output is the force (3) [N], or what :meth:`shaped` makes one of."""
        return TrajectorySource(self.trajectory())

    @abstractmethod
    def caption(self) -> str:
        """Return it in words."""

    def shaped(
        self, builder: DiagramBuilder, site: Site, name: str, frame: Frame, point: Vector, force: OutputPort
    ) -> OutputPort:
        """Return the force (3) [N] at a point (3,) [m] of a frame, along its axes, made of what the source gives."""
        return force

    def check(self, key: str, station: StationContents) -> None:
        """Check that forces count in the station, and that there is what it acts on."""
        if not station.engine.moves_by_forces:
            raise Unsuitable(
                key,
                message("parts.no_forces", "a kinematic station has no forces"),
                message("parts.leave_out_or_dynamic", "leave it out, or set mode: dynamic"),
            )
        known = [*station.robots, *(name for name in frame_names(station) if name != "world")]
        if self.at is not None:
            one_of(message("parts.place_of_force", "robot, tool, link or piece for {key}.at", key=key), self.at, known)
        self.place_name(key, station)

    def place_name(self, key: str, station: StationContents) -> str:
        """Return the name of what it acts on."""
        if self.at is not None:
            return self.at
        robot = station.robots[name_or_only(None, list(station.robots), key=f"{key}.at")]
        return robot.name if robot.floats or not robot.tcp else f"{robot.prefix}{robot.tcp}"


def add_force(
    builder: DiagramBuilder, site: Site, name: str, section: ForceSection, source: LeafSystem, caption: str
) -> None:
    """Apply a force (3) [N] that a source gives, and that is ``caption`` in words; ``applied_force.<name>`` shows it.

    The ports of the blocks that apply it are gathered in the site, for the plant.
    """
    place = section.place_name(f"forces.{name}", site.station)
    frame, point = place_of(site.plant, place)
    output_port = builder.AddNamedSystem(f"force.{name}.source", source).get_output_port(0)
    point = point + section.offset
    force = section.shaped(builder, site, f"force.{name}", frame, point, output_port)
    block = add_external_force(builder, site.plant.plant_block, frame, name=f"force.{name}", point=point)
    builder.Connect(force, block.get_command_input_port())
    label = message(
        "parts.block_force", "Force '{name}'\n{caption}\nat {place}", name=name, caption=caption, place=place
    )
    for system in (f"force.{name}", f"force.{name}.source"):
        site.picture.draw(system, "force", label, key=f"force.{name}")
    site.spatial_forces.append(block.get_spatial_forces_output_port())
    output = f"applied_force.{name}"
    title = message("parts.applied_force", "applied force '{name}' at {place}, in its axes", name=name, place=place)
    site.outputs.add(output, force, applied_signal(output, "N", title, part=name))


def place_of(plant: StationPlant, place: str) -> tuple[Frame, Vector]:
    """Return the frame in which a force is given, and the point (3,) [m] in it where it acts."""
    if place in plant.robots:
        root = plant.robots[place].root
        return root, np.asarray(root.GetFixedPoseInBodyFrame().inverse() @ root.body().default_com())
    return frame_of(plant, place), np.zeros(3)


_JUST_BEFORE = 1e-11  # [s]


class Push(ForceSection):
    """A constant force for a while."""

    kind: Literal["push"]
    start: Instant = 0.0
    """When it begins [s]."""
    duration: Duration = 0.1
    """How long it lasts [s]."""
    force: Triple
    """Along x, y and z of what is pushed [N]."""

    @property
    def end(self) -> float:
        """When it ends [s]."""
        return self.start + self.duration

    @property
    def edges(self) -> tuple[float, ...]:
        """When it begins and ends, and just before [s]; no step goes across.

        A scheme that freezes its inputs would miss a part of it, and one with a stage at a step's end finds there what
        comes after the edge: that step is as short as can be.
        """
        edges = self.start - _JUST_BEFORE, self.start, self.end - _JUST_BEFORE, self.end
        return tuple(edge for edge in edges if edge >= 0)

    def trajectory(self) -> Trajectory:
        """Return the force over time, shape (3, 1) [N]."""
        force, nothing = np.array(self.force), np.zeros(3)
        times, values = [0.0, self.start, self.end, self.end + 1.0], [nothing, force, nothing, nothing]  # a hold ends
        known = slice(self.start == 0, None)
        return PiecewisePolynomial.ZeroOrderHold(times[known], np.array(values[known]).T)

    def caption(self) -> str:
        """Return it in words."""
        size = float(np.linalg.norm(self.force))
        return message("parts.force_push", "{size:.3g} N at {start:g} s", size=size, start=self.start)


class SineForce(ForceSection):
    """A force that swings about zero."""

    kind: Literal["sine"]
    amplitude: Triple
    """Largest force along x, y and z of what it acts on [N]."""
    frequency: Frequency
    """Swings a second [Hz]."""
    phase_deg: Number = 0.0
    """Angle at the start."""

    def source(self) -> Sine:
        """Return the block that gives the force (3) [N]."""
        frequency, phase = np.full(3, 2 * np.pi * self.frequency), np.full(3, np.deg2rad(self.phase_deg))
        return Sine(np.array(self.amplitude), frequency, phase)

    def caption(self) -> str:
        """Return it in words."""
        return message(
            "parts.force_sine",
            "sine ±{size:g} N, {frequency:.3g} Hz",
            size=float(np.linalg.norm(self.amplitude)),
            frequency=self.frequency,
        )


_PERIOD = 0.01  # s between samples
_LIFT = 0.25  # how far a target must be for a pull as strong as the weight of all that hangs together [m]
_LIGHTEST = 1e-3  # kg
_JUST_AFTER = 1e-9
"""A sample at the time of a target's change is one of the target before, however both times are rounded [s]."""


class Drag(ForceSection):
    """A spring that pulls a point of a body after a target that moves; sampled at 100 Hz.

    Its damping is that of a body that swings with a damping ratio of one half.
    """

    kind: Literal["drag"]
    point: Triple = (0.0, 0.0, 0.0)
    """Where it pulls, in the frame of what it acts on [m]."""
    start: Instant = 0.0
    """When it begins [s]."""
    targets: Annotated[tuple[Triple, ...], Field(min_length=1)]
    """Where to, in the world, one after the other [m]."""
    each: Duration = 0.05
    """How long each target pulls [s]."""
    stiffness: Positive | None = None
    """Of the spring [N/m]; unless given, a target 0.25 m away pulls with the weight of the robot or piece."""

    @property
    def end(self) -> float:
        """When it ends [s]."""
        return self.start + self.each * len(self.targets)

    @property
    def offset(self) -> Vector:
        """Where it acts beside the place that it names, shape (3,) [m]."""
        return np.array(self.point)

    def trajectory(self) -> Trajectory:
        """Return whether it pulls, 1 or 0, and where to, over time: shape (4, 1)."""
        count = len(self.targets)
        rows = np.column_stack([np.ones(count), np.array(self.targets)])
        changes = self.start + _JUST_AFTER + self.each * np.arange(count + 1)
        values = np.vstack([np.zeros(4), rows, np.zeros((2, 4))])
        return PiecewisePolynomial.ZeroOrderHold([0.0, *changes, changes[-1] + 1.0], values.T)

    def shaped(
        self, builder: DiagramBuilder, site: Site, name: str, frame: Frame, point: Vector, applied: OutputPort
    ) -> OutputPort:
        """Add the spring, and return its force (3) [N]."""
        plant, body = site.plant.plant, frame.body()
        whole = plant.CalcTotalMass(plant.CreateDefaultContext(), [body.model_instance()])
        gravity = float(np.linalg.norm(plant.gravity_field().gravity_vector())) or STANDARD_GRAVITY
        stiffness = self.stiffness or max(whole, _LIGHTEST) * gravity / _LIFT
        gains = stiffness, float(np.sqrt(stiffness * max(body.default_mass(), _LIGHTEST)))
        spring = DragSpring(period=_PERIOD, plant=plant, frame=frame, point=point, gains=gains)
        return add_and_connect(builder, f"{name}.spring", spring, applied, site.state)

    def caption(self) -> str:
        """Return it in words."""
        return message("parts.force_drag", "drag from {start:g} to {end:g} s", start=self.start, end=self.end)


class DragSpring(SampledBlock):
    r"""The force :math:`f = k (p_t - p) - c \dot{p}` of a target on a point, sampled and held; zero without a target.

    Ports:
        in  ``target`` (4): whether there is one, 1 or 0, and where in the world, p_t [m]; ``state`` (nq + nv): of the
            whole plant.
        out ``force`` (3) [N]: in the axes of the frame.
    """

    def __init__(
        self, *, period: float, plant: MultibodyPlant, frame: Frame, point: Vector, gains: tuple[float, float]
    ) -> None:
        """Make the block for a point p (3,) [m] of a body of any finalized plant, with gains k [N/m] and c [N·s/m]."""
        self.units = {"force": "N"}
        reads = {"target": 4, "state": plant.num_multibody_states()}
        super().__init__(period=period, reads=reads, memory={"force": np.zeros(3)}, gives=["force"])
        self._plant, self._frame, self._point, self._gains = weakref.proxy(plant), frame.index(), point, gains
        self._scratch = plant.CreateDefaultContext()  # nothing is remembered in it: every evaluation sets it anew

    def sample(self, memory: Named, read: Named) -> Changes:
        """Return the force now."""
        pulls, *target = read["target"]
        if not pulls:
            return {"force": np.zeros(3)}
        plant, context = self._plant, self._scratch
        plant.SetPositionsAndVelocities(context, read["state"])
        frame = plant.get_frame(self._frame)
        pose, motion = frame.CalcPoseInWorld(context), frame.CalcSpatialVelocityInWorld(context)
        speed = motion.translational() + np.cross(motion.rotational(), pose.rotation() @ self._point)
        stiffness, damping = self._gains
        force = stiffness * (np.array(target) - pose @ self._point) - damping * speed
        return {"force": pose.rotation().inverse() @ force}


KINDS = Kinds(
    __name__,
    {"push": "Push", "drag": "Drag", "sine": "SineForce"},
    base=ForceSection,
    point="forces",
)
ForceConfig = Annotated[ForceSection, KINDS]
Forces = Annotated[dict[str, ForceConfig], KINDS.names_are_kinds]
