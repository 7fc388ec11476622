"""How a run gets on: whether its solver creeps, or hardly gets on, with what holds it up; shorter steps in flight."""

import warnings
import weakref
from collections import Counter, deque
from collections.abc import Callable, Collection, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from math import inf, nextafter
from time import monotonic, perf_counter, process_time

import numpy as np
from pydrake.geometry import CollisionFilterDeclaration, GeometrySet, Role
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, EventStatus

from simrob_drake.blocks.sampled import SampledBlock
from simrob_drake.errors import SimrobError
from simrob_drake.parts.targets import owner_of_shape
from simrob_drake.progress import Advance
from simrob_drake.results.record.state import State
from simrob_drake.stations.closed import ClosedStation, closed_station
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.resolve import resolve
from simrob_drake.stations.solver_config import ContinuousSolver, DiscreteSolver, FixedSteps
from simrob_drake.stations.steps import DISCRETE, apply_solver, bound_steps, controlled_by, stiffest

_TRIAL = 0.3  # s of a clock, each
_GAIN = 3.0  # so many times as far a trial without a suspect must get in its time: then that is to blame
_MOST = 4  # pairs that are tried without, one by one
_SHORT = 0.1  # part of ``max_step`` below which steps are short; longer ones are dear
_LOOKS = 3  # at what a step costs
_HALF = 0.5  # of what a step costs: then a part is to blame
_LONGEST = 1e3  # s of simulated time

Pair = frozenset[str]  # the names of two bodies


@dataclass(frozen=True)
class Slow:
    """A run that hardly gets on, at the moment when that is found; what holds it up is found by trials.

    Its state is stepped for a moment without a suspect. Trials have contexts of their own and leave the run as it is.
    Blocks of the user's own may remember more than Drake knows of, so that a run with such is only looked at.
    """

    config: StationConfig  # the station
    built: ClosedStation  # what is stepped
    context: Context  # where it is
    step: float  # mean length of its last steps [s]
    cost: float  # of each, by a clock [s]
    own_blocks: bool  # whether there are blocks of the user's own

    def cause(self) -> str:
        """Return what holds it up and what to set, in words."""
        solver = controlled_by(self.config)
        if solver is None or self.step > _SHORT * solver.max_step:
            return f"each step of {self.step:.2g} s takes {self.cost:.2g} s{self._dear(solver)}"
        pair, plant = self._blamed_pair(), self.built.ports.plant
        if pair is None:
            spring = stiffest(self.config, plant, plant.plant.GetMyContextFromRoot(self.context))
            what = f"{spring}, which makes" if spring else "forces that are stiff for what they move make"
        else:
            what = f"the contact of {' and '.join(sorted(pair))} makes"
        remedy = _discrete if pair is None or solver.scheme == "cenic" else _cenic
        return f"{what} {solver.scheme} take steps of {self.step:.2g} s; {self._tried(*remedy(self.config))}"

    def _blamed_pair(self) -> Pair | None:
        """Return the two bodies whose contact holds the run up; None if no contact does."""
        if self.config.contact is None:
            return None
        if self.own_blocks:
            return next(iter(self._touching(self.context)), None)
        seen = Counter[Pair]()
        baseline = self._reach((), lambda context: seen.update(self._touching(context)))
        if not seen or self._reach(seen) < _GAIN * baseline:
            return None
        reached = {pair: self._reach([pair]) for pair, _ in seen.most_common(_MOST)}
        return max(reached, key=reached.__getitem__)

    def _touching(self, root: Context) -> set[Pair]:
        plant = self.built.ports.plant
        pairs = plant.query(root).ComputePointPairPenetration()
        return {frozenset(owner_of_shape(plant, shape) for shape in (pair.id_A, pair.id_B)) for pair in pairs}

    def _reach(self, without: Collection[Pair], look: Callable[[Context], object] = lambda context: None) -> float:
        """Return how far a trial gets in its time [s] if some pairs of bodies pass through each other."""
        root, plant = self.context.Clone(), self.built.ports.plant
        shapes = plant.scene_graph.model_inspector().GetAllGeometryIds(Role.kProximity)
        filters = plant.scene_graph.collision_filter_manager(plant.scene_graph.GetMyMutableContextFromRoot(root))
        for pair in without:
            sides = [GeometrySet([s for s in shapes if owner_of_shape(plant, s) == name]) for name in pair]
            filters.Apply(CollisionFilterDeclaration().ExcludeBetween(sides[0], sides[-1]))
        return _reached(Simulator(self.built.diagram, root), self.config, self.step, look)

    def _tried(self, settings: str, config: StationConfig) -> str:
        """Return settings, with how fast a trial of the station that has them is."""
        if self.own_blocks:
            return settings
        with suppress(SimrobError, RuntimeError, SystemExit):
            other = closed_station(resolve(config), self.built.references, monitors=False)
            simulator = Simulator(other.diagram)
            root = simulator.get_mutable_context()
            State.of(self.built.diagram, self.built.ports, self.context).put(other.diagram, other.ports, root)
            root.SetTime(self.context.get_time())
            rate = _reached(simulator, config, self.step) / _TRIAL
            return f"{settings} ({rate:.2g} × real time in a trial)"
        return settings

    def _dear(self, controlled: ContinuousSolver | None) -> str:
        """Return what steps that are long enough are spent on, and what would be cheaper."""
        parts = dict[str, tuple[float, str]]()
        if self.config.contact is not None and self.config.mode == "dynamic":
            surfaces = self.config.contact.model != "point"
            coarser = "set contact.model=point or a coarser contact.resolution"
            cost = _seconds(partial(self._find_contacts, self.context.Clone(), surfaces))
            parts["finding contacts"] = cost, coarser if surfaces else "give bodies fewer collision shapes"
        for block in self.built.diagram.GetSystems():
            if isinstance(block, SampledBlock):
                name, cost = block.get_name(), _seconds(partial(_sample, block, self.context.Clone()))
                parts[f"the block {name}"] = cost, f"lower {name.replace('controller.', 'controllers.')}.rate"
        what, (cost, remedy) = max(parts.items(), key=lambda part: part[1][0], default=("", (0.0, "")))
        if cost > _HALF * self.cost:
            return f", of it {what} {cost:.2g} s; {remedy}"
        short = controlled is not None and self.step < _HALF * controlled.max_step
        key = "accuracy" if short else "time_step" if isinstance(self.config.solver, FixedSteps) else "max_step"
        return f"; take longer ones (solver.{key})"

    def _find_contacts(self, root: Context, surfaces: bool) -> None:
        plant = self.built.ports.plant
        positions = plant.stepped.GetPositions(plant.stepped.GetMyContextFromRoot(root))
        plant.place(root, positions)  # so that nothing is known of it
        query = plant.query(root)
        if surfaces:
            query.ComputeContactSurfacesWithFallback(plant.plant.get_contact_surface_representation())
        else:
            query.ComputePointPairPenetration()


def _reached(
    simulator: Simulator, config: StationConfig, step: float, look: Callable[[Context], object] = lambda context: None
) -> float:
    """Return how far a simulator gets in the time of a trial [s]; it begins with steps of a length [s]."""
    apply_solver(simulator, config)
    begin = simulator.get_context().get_time()
    if controlled_by(config) is not None:
        simulator.get_mutable_integrator().request_initial_step_size_target(step)
    end = perf_counter() + _TRIAL

    def watch(context: Context) -> EventStatus:
        look(context)
        over = perf_counter() > end
        return EventStatus.ReachedTermination(simulator.get_system(), "") if over else EventStatus.DidNothing()

    simulator.set_monitor(watch)
    with suppress(RuntimeError, SystemExit):  # it diverged; Drake's failed assertions come as SystemExit
        simulator.AdvanceTo(begin + _LONGEST)
    simulator.clear_monitor()
    return float(simulator.get_context().get_time() - begin)


def _sample(block: SampledBlock, root: Context) -> None:
    root.SetTime(nextafter(root.get_time(), inf))  # so that nothing is known of it
    block.EvalUniquePeriodicDiscreteUpdate(block.GetMyContextFromRoot(root))


def _seconds(work: Callable[[], object]) -> float:
    """Return what work takes by a clock, the least of some times [s]."""
    times = []
    for _ in range(_LOOKS):
        began = perf_counter()
        work()
        times.append(perf_counter() - began)
    return min(times)


def _cenic(config: StationConfig) -> tuple[str, StationConfig]:
    solver = ContinuousSolver(kind="continuous", scheme="cenic", accuracy=1e-3, max_step=0.01)
    text = f"set solver.scheme=cenic and solver.max_step={solver.max_step:g}"
    return text, config.model_copy(update={"solver": solver})


def _discrete(config: StationConfig) -> tuple[str, StationConfig]:
    """Return what DISCRETE says, and a station that has it."""
    implicit = {"realization": "implicit"}
    robots = {
        name: robot.model_copy(update={"servo": robot.servo and robot.servo.model_copy(update=implicit)})
        for name, robot in config.robots.items()
    }
    changes = {"solver": DiscreteSolver(kind="discrete"), "servo": config.servo.model_copy(update=implicit)}
    return DISCRETE, config.model_copy(update={**changes, "robots": robots})


_OVER = 100  # steps
_CREEPING = 1e-5  # a mean step as small creeps: a hundred thousand steps a simulated second [s]
_PATIENCE = 5.0  # s of a clock
_SLOWEST = 0.02  # part of real time that a run should make at least
_BUSY = 0.5  # part of a processor: a process that gets less has to wait for others
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
    """Looks after each step how fast a run gets on, shows that, and warns once if it hardly does."""

    def __init__(
        self, config: StationConfig, built: Callable[[], ClosedStation], *, own_blocks: bool, show: Advance | None
    ) -> None:
        """Watch a run; ``built`` gives what is stepped now, ``show`` shows how far it is."""
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
            warnings.warn(self._complaint(context), SlowRunWarning, stacklevel=2)
        self._begin(time)

    def _complaint(self, context: Context) -> str:
        """Describe how slow the run is and why.

        A process that waits for others is slow through no fault of its own. So the rate on a whole processor decides:
        if that would be fast enough, the machine is busy; otherwise something in the station holds the run up.
        """
        made = context.get_time() - self._since
        left = self.config.duration - context.get_time()
        share = self._worked / self._waited
        rate = f"{made / self._waited:.2g} × real time"
        alone = made / self._worked if self._worked > 0 else np.inf
        if share < _BUSY:
            rate += f" on {100 * share:.0f} % of a processor ({alone:.2g} × on a whole one)"
        if share < _BUSY and alone >= _SLOWEST:
            cause = "the machine is busy with other work"
        else:
            step = made / self._steps
            cost = self._worked / self._steps
            cause = Slow(self.config, self._built(), context, step, cost, self._own_blocks).cause()
        return f"{self.config.name} makes {rate} with {left:.3g} s left: {cause}"

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


_IN_FLIGHT = (1e-3, 1e-3)
"""Longest step [s] and coarsest accuracy: a humanoid that moves its legs then keeps its momentum within 0.1 %."""
_LOOK_EVERY = 5  # steps
_JUST_OVER = 1e-3  # m
_FALLS = 0.3  # part of gravity by which a body must gain speed downward before that is done


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
        hanging = [plant.GetBodiesKinematicallyAffectedBy([joint.index()]) for joint in floating]
        collision_shapes = plant.GetCollisionGeometriesForBody
        self._bodies = [{one for body in own for one in collision_shapes(plant.get_body(body))} for own in hanging]
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
