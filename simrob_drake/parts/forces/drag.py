"""A spring that pulls a point of a body after a target that somebody moves, as a hand or a mouse does."""

import weakref
from typing import Annotated, Literal

import numpy as np
from pydantic import Field
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Frame
from pydrake.systems.framework import DiagramBuilder, OutputPort
from pydrake.systems.primitives import TrajectorySource
from pydrake.trajectories import PiecewisePolynomial, Trajectory

from simrob_drake.blocks.sampled import Changes, Named, SampledBlock
from simrob_drake.blocks.wiring import fed
from simrob_drake.constants import STANDARD_GRAVITY
from simrob_drake.frames import Vector
from simrob_drake.parts.forces.force import ForceSection
from simrob_drake.parts.site import Site
from simrob_drake.sections import Duration, Instant, Positive, Triple

_PERIOD = 0.01  # s between samples
_LIFT = 0.25
"""How far a target must be for a pull as strong as the weight of all that hangs together [m]."""
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
    def edges(self) -> tuple[float, ...]:
        """It has none: its samples are ends of steps."""
        return ()

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

    def source(self) -> TrajectorySource:
        """Return the block that gives what :meth:`trajectory` does."""
        return TrajectorySource(self.trajectory())

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
        return fed(builder, f"{name}.spring", spring, applied, site.state)

    def caption(self) -> str:
        """Return it in words."""
        return f"drag from {self.start:g} to {self.end:g} s"


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
        """Make the block.

        Args:
            period: between samples [s].
            plant: finalized; it need not be part of the diagram.
            frame: of the body.
            point: p in the frame, shape (3,) [m].
            gains: k [N/m] and c [N·s/m].
        """
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
