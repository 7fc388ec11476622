"""How a run gets on: whether its solver creeps, or hardly gets on, with what holds it up; shorter steps in flight."""

import warnings
import weakref
from collections import deque
from collections.abc import Callable, Sequence
from time import monotonic, process_time

import numpy as np
from pydrake.geometry import GeometryId
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Joint
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context

from simrob_drake.progress import Advance
from simrob_drake.simulation.slow import Slow
from simrob_drake.stations.closed import ClosedStation
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.solver_config import ContinuousSolver
from simrob_drake.stations.steps import DISCRETE, bound_steps, controlled_by

_OVER = 100  # steps
_CREEPING = 1e-5
"""A mean step as small creeps: a hundred thousand steps a simulated second [s]."""
_PATIENCE = 5.0  # s of a clock
_SLOWEST = 0.02
"""Part of real time that a run should make at least."""
_BUSY = 0.5
"""Part of a processor: a process that gets less has to wait for others."""
_OFTEN = 0.02  # s of a clock; a look at the processor's takes long on some machines
_PAUSE, _IDLE = 0.5, 0.01
"""Where a step takes so long [s], and a processor works so small a part of that, somebody has paused the run."""


class SlowRunWarning(RuntimeWarning):
    """A run hardly gets on; the message says what holds it up."""


def creeping(config: StationConfig, times: Sequence[float]) -> str:
    """Tell in words that a run crept in its last steps, whose ends are given [s]; empty if it did not."""
    if controlled_by(config) is None or len(times) <= _OVER:
        return ""
    step = (times[-1] - times[-1 - _OVER]) / _OVER
    left = config.duration - times[-1]
    return f"it creeps in steps of {step:.2g} s with {left:.3g} s left; {DISCRETE}" if step < _CREEPING else ""


class PaceWatch:
    """Looks after each step how fast a run gets on, shows that, and warns once if it hardly does.

    Attributes:
        config: the station.
    """

    def __init__(
        self, config: StationConfig, built: Callable[[], ClosedStation], *, own_blocks: bool, show: Advance | None
    ) -> None:
        """Watch a run.

        Args:
            config: the station.
            built: gives what is stepped now.
            own_blocks: whether there are blocks of the user's own in it.
            show: shows how far it is.
        """
        self.config, self._built, self._own_blocks, self._show = config, built, own_blocks, show
        self._ends: deque[float] = deque(maxlen=_OVER + 1)
        self._clocks, self._warned = (monotonic(), process_time()), False
        self._begin(0.0)

    def _begin(self, time: float) -> None:
        self._since, self._waited, self._worked, self._steps = time, 0.0, 0.0, 0

    def __call__(self, context: Context) -> None:
        """Look at the step that has just ended; at the very first, what went before was no step."""
        time = context.get_time()
        if not self._ends:
            self._clocks = monotonic(), process_time()
            self._begin(time)
        self._ends.append(time)
        if self._show is not None:
            self._show(time, creeping(self.config, self._ends))
        self._count()
        if self._waited < _PATIENCE or self._warned or time == self._since:
            return
        if time - self._since < _SLOWEST * self._waited:
            self._warned = True
            self._warn(context)
        self._begin(time)

    def _count(self) -> None:
        """Count the step, and now and then the time of clock and processor, but for that of a pause before it."""
        self._steps += 1
        now = monotonic()
        if now - self._clocks[0] < _OFTEN:
            return
        clocks = now, process_time()
        waited, worked = (now - before for now, before in zip(clocks, self._clocks, strict=True))
        self._clocks = clocks
        if waited < _PAUSE or worked > _IDLE * waited + _OFTEN:
            self._waited, self._worked = self._waited + waited, self._worked + worked

    def _warn(self, context: Context) -> None:
        made, share = context.get_time() - self._since, self._worked / self._waited
        if share < _BUSY:
            cause = f"the machine is busy with other work, this gets {100 * share:.0f} % of a processor"
        else:
            means = made / self._steps, self._waited / self._steps
            cause = Slow(self.config, self._built(), context, *means, self._own_blocks).cause()
        left = self.config.duration - context.get_time()
        message = f"{self.config.name} makes {made / self._waited:.2g} × real time with {left:.3g} s left: {cause}"
        warnings.warn(message, SlowRunWarning, stacklevel=2)


_IN_FLIGHT = (1e-3, 1e-3)
"""Longest step [s] and coarsest accuracy: a humanoid that moves its legs then keeps its momentum within 0.1 %."""
_LOOK_EVERY = 5  # steps
_JUST_OVER = 1e-3  # m
_FALLS = 0.3
"""Part of gravity by which a body must gain speed downward before that is done."""


class Flight:
    """Looks whether a robot or a free piece touches nothing but itself, and sets the length of steps by that.

    The steps of ``cenic`` are first-order: while something flies, nothing else bounds their error.
    """

    def __init__(self, plant: MultibodyPlant, solver: ContinuousSolver, simulator: Simulator) -> None:
        """Look after all floating bodies of a plant that a simulator steps by ``cenic``."""
        self._plant, self._solver = plant, solver
        self._simulator = weakref.ref(simulator)  # whose monitor holds this
        joints = [plant.get_joint(index) for index in plant.GetJointIndices()]
        floating = [joint for joint in joints if joint.type_name() == "quaternion_floating"]
        self._bodies = [_shapes(plant, joint) for joint in floating]
        self._upward = [joint.velocity_start() + 5 for joint in floating]  # after the angular part
        self._heights = [joint.position_start() + 6 for joint in floating]  # after the quaternion
        self._gravity = float(np.linalg.norm(plant.gravity_field().gravity_vector()))
        self._steps, self._flies = 0, False
        self._time, self._speeds = -np.inf, np.zeros(len(floating))

    def look(self, root: Context) -> None:
        """Look at the state that a step has reached, now and then; to be called at the start and after each step."""
        self._steps += 1
        if self._steps % _LOOK_EVERY != 1 or not self._bodies:
            return
        flies = self._is_suspect(root) and self._is_one_free(root)
        if flies != self._flies and (simulator := self._simulator()) is not None:
            self._flies = flies
            bound_steps(simulator, self._solver, *(_IN_FLIGHT if flies else ()))

    def _is_suspect(self, root: Context) -> bool:
        """Tell whether something may fly: it did, or falls ever faster; to look at all shapes takes much longer."""
        time, before = root.get_time(), self._time
        speeds = self._plant.GetVelocities(self._plant.GetMyContextFromRoot(root))[self._upward]
        faster = (self._speeds - speeds).max()
        self._time, self._speeds = time, speeds
        return bool(self._flies or np.isinf(before) or faster >= _FALLS * self._gravity * (time - before))

    def _is_one_free(self, root: Context) -> bool:
        """Tell whether one touches nothing but itself; at the start, what stands just over something touches it."""
        plant, context = self._plant, self._plant.GetMyMutableContextFromRoot(root)
        if not plant.num_collision_geometries():
            return True
        if self._steps > 1:
            return self._is_apart(context)
        positions = plant.GetPositions(context)
        lower = positions.copy()
        lower[self._heights] -= _JUST_OVER
        plant.SetPositions(context, lower)
        free = self._is_apart(context)
        plant.SetPositions(context, positions)
        return free

    def _is_apart(self, context: Context) -> bool:
        query = self._plant.get_geometry_query_input_port().Eval(context)
        pairs = query.ComputePointPairPenetration() if query.HasCollisions() else []
        touched = [(pair.id_A, pair.id_B) for pair in pairs]
        return any(all((a in shapes) == (b in shapes) for a, b in touched) for shapes in self._bodies)


def _shapes(plant: MultibodyPlant, joint: Joint) -> set[GeometryId]:
    """Return the collision shapes of a joint's body and of all that hangs on it."""
    bodies = plant.GetBodiesKinematicallyAffectedBy([joint.index()])
    return {shape for body in bodies for shape in plant.GetCollisionGeometriesForBody(plant.get_body(body))}
