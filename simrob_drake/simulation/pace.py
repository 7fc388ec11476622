"""Pace of a run: how fast it is stepped, what makes it slow, and shorter steps while something flies.

A run *creeps* if its solver takes extremely small steps. `PaceWatch` measures the pace after each step, and warns once
if the run is slow. `Slow` then finds the cause by *trials*: it copies the state of the run and steps the copy for a
fraction of a second with one suspect removed, such as a contact. A trial that gets much further in this time shows the
cause. `Flight` limits the steps of the scheme ``cenic`` while a body touches nothing.

Times of a run are simulated time; times by a clock are wall-clock time. Both are in seconds. ``cenic`` is a scheme of
Drake that chooses the length of its steps and takes long ones in contact.
"""

import warnings
import weakref
from collections import Counter, deque
from collections.abc import Callable, Collection, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from math import inf, nextafter
from time import monotonic, perf_counter, process_time
from typing import NamedTuple

import numpy as np
from pydrake.geometry import CollisionFilterDeclaration, GeometryId, GeometrySet, Role
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, EventStatus

from simrob_drake.base.errors import SimrobError
from simrob_drake.base.messages import join_texts, message
from simrob_drake.base.progress import Advance
from simrob_drake.blocks.sampled import SampledBlock
from simrob_drake.parts.targets import owner_of_shape
from simrob_drake.results.record.history import FlightCheck
from simrob_drake.results.record.state import State
from simrob_drake.stations.closed import ClosedStation, closed_station
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.resolve import resolve
from simrob_drake.stations.solver_config import ContinuousSolver, DiscreteSolver
from simrob_drake.stations.steps import DISCRETE, bound_steps, controlled_by, set_solver, stiffest

_TRIAL = 0.3
"""Duration of a trial, by a clock [s]."""

_GAIN = 3.0
"""A suspect is to blame if a trial without it gets at least so many times as far [1]."""

_MOST = 4
"""Largest count of pairs of bodies for which there is a trial of their own."""

# A run with longer steps is slow for another reason than their length.
_SHORT = 0.1
"""Steps are short below this share of ``max_step`` [1]."""

# Other processes can only make a measurement longer, so the smallest one counts.
_LOOKS = 3
"""Count of the measurements of a cost."""

_HALF = 0.5
"""A part is to blame if it takes more than this share of the cost of a step. Steps shorter than this share of the
largest length are limited by the accuracy [1]."""

_LONGEST = 1e3
"""Limit of a trial, in simulated time [s]."""

Pair = frozenset[str]
"""Names of two bodies that touch; one name if two shapes of a body do."""


class FasterStation(NamedTuple):
    """A change of settings that may make a run faster."""

    text: str
    """The settings in words."""
    config: StationConfig
    """The station with these settings."""


class Expense(NamedTuple):
    """A part of the work in each step."""

    name: str
    cost: float
    """Duration by a clock [s]."""
    remedy: str
    """How to reduce the cost, in words."""


@dataclass(frozen=True)
class Slow:
    """A slow run, at the time at which this was noticed. It finds the cause.

    Trials have contexts of their own, so they do not change the run. Blocks of the user's own may keep values that are
    not in the context, so there are no trials if a run has such blocks.

    Attributes:
        config: configuration of the station.
        built: the diagram that is stepped, with the station.
        context: its context, with the present state.
        step: mean length of the last steps [s].
        cost: mean duration of each of these steps, by a clock [s].
        own_blocks: whether there are blocks of the user's own.
    """

    config: StationConfig
    built: ClosedStation
    context: Context
    step: float
    cost: float
    own_blocks: bool

    def cause(self) -> str:
        """Find what makes the run slow. Returns the cause and the remedy, in words. Trials take up to some seconds."""
        # Settings of the solver if it chooses the length of its steps; None if they have a fixed length.
        solver = controlled_by(self.config)
        # Steps of a fixed length, or long ones: the run is slow because each step takes long.
        if solver is None or self.step > _SHORT * solver.max_step:
            return message(
                "simulation.slow_steps",
                "each step of {step:.2g} s takes {cost:.2g} s{expense}",
                step=self.step,
                cost=self.cost,
                expense=self._largest_expense(solver),
            )
        # The steps are short: either a contact or a stiff spring forces the solver to take them.
        pair = self._blamed_pair()
        if pair is not None:
            problem = message(
                "simulation.contact_makes",
                "the contact of {pair} makes",
                pair=join_texts(sorted(pair), message("base.and", " and ")),
            )
        else:
            # The stiffest spring or servo in words, or an empty text if there is none.
            plant = self.built.ports.plant
            spring = stiffest(self.config, plant, plant.plant.GetMyContextFromRoot(self.context))
            problem = message(
                "simulation.stiff_forces_make",
                "forces that are too stiff for the bodies on which they act make",
            )
            if spring:
                problem = message(
                    "simulation.stiff_spring_makes",
                    "{spring} is so stiff that it makes",
                    spring=spring,
                )
        # The scheme cenic takes long steps in any contact. Stiff springs and servos need a discrete solver.
        is_cenic_better = pair is not None and not solver.engine.takes_any_contact_stiffness
        remedy = _cenic(self.config) if is_cenic_better else _discrete(self.config)
        return message(
            "simulation.small_steps",
            "{problem} {scheme} take steps of {step:.2g} s; {remedy}",
            problem=problem,
            scheme=solver.scheme,
            step=self.step,
            remedy=self._with_trial(remedy),
        )

    def _blamed_pair(self) -> Pair | None:
        """Find the two bodies whose contact makes the run slow. Returns None if no contact does.

        Of the pairs, only the four that touch in most steps of a trial are examined one by one. If no trials are
        possible, because of blocks of the user's own, any two bodies that touch now are returned, or None.
        """
        if self.config.contact is None:
            return None
        if self.own_blocks:
            return next(iter(self._touching_pairs(self.context)), None)
        # A first trial with all contacts, in which the steps are counted in which each pair touches.
        counts = Counter[Pair]()
        baseline = self._distance_reached(
            (), lambda context: counts.update(self._touching_pairs(context))
        )
        if not counts or self._distance_reached(counts) < _GAIN * baseline:
            return None
        # Without all contacts the run is fast. To blame is, of the most frequent pairs, that whose removal helps most.
        most_frequent = [pair for pair, _ in counts.most_common(_MOST)]
        reached = {pair: self._distance_reached([pair]) for pair in most_frequent}
        return max(reached, key=reached.__getitem__)

    def _touching_pairs(self, root: Context) -> set[Pair]:
        """Pairs of bodies that overlap in a context of the diagram, by the names of the bodies."""
        plant = self.built.ports.plant
        touching = set()
        for pair in plant.query(root).ComputePointPairPenetration():
            names = [owner_of_shape(plant, shape) for shape in (pair.id_A, pair.id_B)]
            touching.add(frozenset(names))
        return touching

    def _distance_reached(
        self, without: Collection[Pair], look: Callable[[Context], object] = lambda context: None
    ) -> float:
        """Measure how far a trial gets in which some pairs of bodies pass through each other [s of simulated time].

        Args:
            without: the pairs; if it is empty, all contacts stay.
            look: callback after each step of the trial, with the context of the diagram.
        """
        plant = self.built.ports.plant
        # The collision filters are in the copied context, so they do not change the run.
        root = self.context.Clone()
        shapes = plant.scene_graph.model_inspector().GetAllGeometryIds(Role.kProximity)
        filters = plant.scene_graph.collision_filter_manager(
            plant.scene_graph.GetMyMutableContextFromRoot(root)
        )
        for pair in without:
            sets = []
            for name in pair:
                own_shapes = [shape for shape in shapes if owner_of_shape(plant, shape) == name]
                sets.append(GeometrySet(own_shapes))
            # A pair with one name is a body that touches itself: then both sets are the same.
            filters.Apply(CollisionFilterDeclaration().ExcludeBetween(sets[0], sets[-1]))
        return _time_reached(Simulator(self.built.diagram, root), self.config, self.step, look)

    def _with_trial(self, remedy: FasterStation) -> str:
        """Text of a remedy, with the pace of a trial of the station that has its settings, if a trial is possible.

        Args:
            remedy: the remedy, with the changed station.
        """
        if self.own_blocks:
            return remedy.text
        # The settings may be impossible for this station. The remedy is then shown without a trial.
        with suppress(SimrobError, RuntimeError, SystemExit):
            other = closed_station(resolve(remedy.config), self.built.references, monitors=False)
            simulator = Simulator(other.diagram)
            root = simulator.get_mutable_context()
            # The other solver has other states, such as discrete ones, so the quantities are set instead of the states.
            State.of(self.built.diagram, self.built.ports, self.context).put(
                other.diagram, other.ports, root
            )
            root.SetTime(self.context.get_time())
            rate = _time_reached(simulator, remedy.config, self.step) / _TRIAL
            return message(
                "simulation.remedy_in_trial",
                "{remedy} ({rate:.2g} × real time in a trial)",
                remedy=remedy.text,
                rate=rate,
            )
        return remedy.text

    def _largest_expense(self, controlled: ContinuousSolver | None) -> str:
        """Find the part that takes most of the time of each step. Returns the end of a sentence, with a remedy.

        If no part takes more than half of the time, the remedy is longer steps.

        Args:
            controlled: solver of the station if it chooses the length of its steps; None otherwise.
        """
        largest = max(self._expenses(), key=lambda expense: expense.cost, default=None)
        if largest is not None and largest.cost > _HALF * self.cost:
            return message(
                "simulation.largest_expense",
                ", of which {name} takes {cost:.2g} s; {remedy}",
                name=largest.name,
                cost=largest.cost,
                remedy=largest.remedy,
            )
        # Nothing dominates: only fewer, longer steps help.
        if controlled is not None and self.step < _HALF * controlled.max_step:
            # The steps are much shorter than allowed, so the accuracy limits them.
            key = "accuracy"
        else:
            key = self.config.solver.step_key
        return message(
            "simulation.take_longer_steps", "; take longer steps (solver.{key})", key=key
        )

    def _expenses(self) -> list[Expense]:
        """Measure the costs of finding contacts, if contact forces act, and of each block that samples, as a camera."""
        expenses = []
        if self.config.contact is not None and self.config.engine.moves_by_forces:
            has_surfaces = self.config.contact.model != "point"
            cost = _seconds(partial(self._find_contacts, self.context.Clone(), has_surfaces))
            remedy = message("simulation.fewer_shapes", "give bodies fewer collision shapes")
            if has_surfaces:
                remedy = message(
                    "simulation.point_contact",
                    "set contact.model=point or a coarser contact.resolution",
                )
            expenses.append(
                Expense(message("simulation.finding_contacts", "finding contacts"), cost, remedy)
            )
        for block in self.built.diagram.GetSystems():
            if isinstance(block, SampledBlock):
                name = block.get_name()
                cost = _seconds(partial(_sample, block, self.context.Clone()))
                remedy = message(
                    "simulation.lower_rate",
                    "lower {name}.rate",
                    name=name.replace("controller.", "controllers."),
                )
                expenses.append(
                    Expense(
                        message("simulation.the_block", "the block {name}", name=name), cost, remedy
                    )
                )
        return expenses

    def _find_contacts(self, root: Context, surfaces: bool) -> None:
        """Compute the contacts once, to measure its cost.

        Args:
            root: a context of the diagram. Its cache is cleared.
            surfaces: whether to compute hydroelastic surfaces instead of points.
        """
        plant = self.built.ports.plant
        positions = plant.plant_block.GetPositions(plant.plant_block.GetMyContextFromRoot(root))
        # Setting positions clears Drake's cache, so that contacts are computed again.
        plant.set_positions(root, positions)
        query = plant.query(root)
        if surfaces:
            query.ComputeContactSurfacesWithFallback(
                plant.plant.get_contact_surface_representation()
            )
        else:
            query.ComputePointPairPenetration()


def _time_reached(
    simulator: Simulator,
    config: StationConfig,
    step: float,
    look: Callable[[Context], object] = lambda context: None,
) -> float:
    """Measure how far a simulator gets within the duration of a trial [s of simulated time].

    Args:
        simulator: the simulator, with the state from which it starts.
        config: configuration of the station, whose solver is applied.
        step: length of the first step [s], if the solver chooses the length of its steps.
        look: callback after each step, with the context of the diagram.
    """
    set_solver(simulator, config)
    begin = simulator.get_context().get_time()
    if controlled_by(config) is not None:
        # The run was at this length. A solver that begins with its own choice would spend the trial on finding it.
        simulator.get_mutable_integrator().request_initial_step_size_target(step)
    end = perf_counter() + _TRIAL

    def watch(context: Context) -> EventStatus:
        """Monitor of the simulator, which ends the trial when its time is over."""
        look(context)
        if perf_counter() > end:
            return EventStatus.ReachedTermination(simulator.get_system(), "")
        return EventStatus.DidNothing()

    simulator.set_monitor(watch)
    # A trial may diverge: how far it got counts all the same. Drake's failed assertions come as SystemExit.
    with suppress(RuntimeError, SystemExit):
        # The monitor ends the trial by the clock, long before this time is reached.
        simulator.AdvanceTo(begin + _LONGEST)
    simulator.clear_monitor()
    return float(simulator.get_context().get_time() - begin)


def _sample(block: SampledBlock, root: Context) -> None:
    """Evaluate the sampling of a block once, to measure its cost.

    Args:
        block: the block, such as a camera.
        root: a context of the diagram. Its time is changed by the smallest possible amount.
    """
    # Another time clears Drake's cache. The next number of float64 changes nothing else.
    root.SetTime(nextafter(root.get_time(), inf))
    block.EvalUniquePeriodicDiscreteUpdate(block.GetMyContextFromRoot(root))


def _seconds(work: Callable[[], object]) -> float:
    """Measure how long a function takes: the shortest duration of three calls, by a clock [s]."""
    times = []
    for _ in range(_LOOKS):
        begin = perf_counter()
        work()
        times.append(perf_counter() - begin)
    return min(times)


def _cenic(config: StationConfig) -> FasterStation:
    """Remedy: the scheme ``cenic``, which takes long steps in contact."""
    solver = ContinuousSolver(kind="continuous", scheme="cenic", accuracy=1e-3, max_step=0.01)
    text = message(
        "simulation.use_cenic",
        "set solver.scheme=cenic and solver.max_step={step:g}",
        step=solver.max_step,
    )
    return FasterStation(text, config.model_copy(update={"solver": solver}))


def _discrete(config: StationConfig) -> FasterStation:
    """Remedy: a discrete solver, with servos that are evaluated implicitly within its steps.

    The servos of the station are changed, and those of robots that have servo settings of their own.
    """
    implicit = {"realization": "implicit"}
    robots = {}
    for name, robot in config.robots.items():
        servo = None if robot.servo is None else robot.servo.model_copy(update=implicit)
        robots[name] = robot.model_copy(update={"servo": servo})
    changes = {
        "solver": DiscreteSolver(kind="discrete"),
        "servo": config.servo.model_copy(update=implicit),
        "robots": robots,
    }
    return FasterStation(DISCRETE, config.model_copy(update=changes))


_OVER = 100
"""Count of the last steps whose mean length is compared with `_CREEPING`."""

_CREEPING = 1e-5
"""A run creeps below this mean length of a step [s]: it needs 100000 steps per simulated second."""

_PATIENCE = 5.0
"""Time over which the pace is measured, by a clock [s]."""

_SLOWEST = 0.02
"""A run is slow below this pace, in simulated seconds per second by a clock [1]."""

# Its time by a clock says little about the work of the station.
_BUSY = 0.5
"""A process that gets a smaller share of a processor than this waits for other processes [1]."""

# Reading the processor's time is slow on some machines.
_OFTEN = 0.02
"""Shortest time between two readings of the processor's time [s]."""

# A run is paused, such as by a debugger, if one step takes long by a clock, and the process hardly works in this time.
# The time of a pause does not count.
_PAUSE = 0.5
"""Least duration of the step of a pause, by a clock [s]."""

_IDLE = 0.01
"""Largest share of this duration in which the process works [1]."""


class SlowRunWarning(RuntimeWarning):
    """Warning about a slow run, with the cause."""


def creeping(config: StationConfig, times: Sequence[float], end: float) -> str:
    """Describe that a run creeps, in words. Returns an empty text if it does not.

    A run creeps if the mean length of its last hundred steps is below 1e-5 s. It does not if its solver has steps of a
    fixed length, or before it has made a hundred steps.

    Args:
        config: configuration of the station.
        times: start of the run and ends of the steps so far, or at least the last 101 of these times [s].
        end: planned end of the run [s], only for the time that is left in the text.
    """
    if controlled_by(config) is None or len(times) <= _OVER:
        return ""
    # The mean of many steps: after an impact, a few short ones are normal.
    step = (times[-1] - times[-1 - _OVER]) / _OVER
    if step >= _CREEPING:
        return ""
    left = end - times[-1]
    return message(
        "simulation.creeping_steps",
        "its steps are only {step:.2g} s long, with {left:.3g} s left; {remedy}",
        step=step,
        left=left,
        remedy=DISCRETE,
    )


class _Clocks(NamedTuple):
    """A reading of both clocks."""

    wall: float
    """Wall-clock time [s]."""
    processor: float
    """Time for which the process has worked [s]."""


class PaceWatch:
    """Callback after each step of a run. It measures the pace, reports progress, and warns once if the run is slow.

    The pace is measured in periods of at least five seconds by a clock, without pauses such as those of a debugger.
    """

    def __init__(
        self,
        config: StationConfig,
        built: Callable[[], ClosedStation],
        *,
        own_blocks: bool,
        show: Advance | None,
        begin: float = 0.0,
        end: float | None = None,
    ) -> None:
        """Prepare to watch a run.

        Args:
            config: configuration of the station.
            built: returns the diagram that is stepped now.
            own_blocks: whether there are blocks of the user's own.
            show: shows the progress: it is called with the time since ``begin`` [s] and a remark, which is empty unless
                the run creeps. None to show nothing.
            begin: start of the run [s].
            end: planned end of the run [s]; None if it is the configuration's duration.
        """
        self.config = config
        self._begin = begin
        self._end = config.duration if end is None else end
        self._built = built
        self._own_blocks = own_blocks
        self._show = show
        # Ends of the last steps [s].
        self._ends: deque[float] = deque(maxlen=_OVER + 1)
        self._clocks = _Clocks(monotonic(), process_time())
        self._has_warned = False
        self._begin_period(0.0)

    def _begin_period(self, time: float) -> None:
        """Begin a new period of measurement at a time of the run [s]."""
        self._since = time
        # Wall-clock time of the period, without pauses [s].
        self._wall_time = 0.0
        # Time for which the process has worked in the period, without pauses [s].
        self._processor_time = 0.0
        self._steps = 0

    def __call__(self, context: Context) -> None:
        """Evaluate the step that has just ended: show the progress, and warn once if the run is slow.

        The first call, at the start of the run, begins the first period. It is counted like a step.

        Args:
            context: context of the diagram that is stepped.
        """
        time = context.get_time()
        if not self._ends:
            self._clocks = _Clocks(monotonic(), process_time())
            self._begin_period(time)
        self._ends.append(time)
        if self._show is not None:
            self._show(time - self._begin, creeping(self.config, self._ends, self._end))
        self._count_step()
        # Without any progress of time, as at an event, there is no pace yet.
        if self._wall_time < _PATIENCE or self._has_warned or time == self._since:
            return
        if time - self._since < _SLOWEST * self._wall_time:
            self._has_warned = True
            warnings.warn(self._slow_run_message(context), SlowRunWarning, stacklevel=2)
        self._begin_period(time)

    def _slow_run_message(self, context: Context) -> str:
        """Describe how slow the run is and why.

        A process that waits for others is slow through no fault of its own. So the pace on a whole processor decides:
        if that would be fast enough, the machine is busy; otherwise something in the station makes the run slow.

        Args:
            context: context of the diagram, at the end of the last step.
        """
        advanced = context.get_time() - self._since
        left = self._end - context.get_time()
        # Share of a processor that the process got in the period, pauses left out [1].
        share = self._processor_time / self._wall_time
        rate: str = message(
            "simulation.times_real_time", "{rate:.2g} × real time", rate=advanced / self._wall_time
        )
        # The pace that the run would have on a whole processor.
        rate_alone = advanced / self._processor_time if self._processor_time > 0 else np.inf
        is_machine_busy = share < _BUSY
        if is_machine_busy:
            rate += message(
                "simulation.on_share_of_processor",
                " with {share:.0f} % of a processor ({rate:.2g} × with a whole processor)",
                share=100 * share,
                rate=rate_alone,
            )
        if is_machine_busy and rate_alone >= _SLOWEST:
            cause: str = message(
                "simulation.machine_is_busy", "the machine is busy with other work"
            )
        else:
            step = advanced / self._steps
            cost = self._processor_time / self._steps
            cause = Slow(self.config, self._built(), context, step, cost, self._own_blocks).cause()
        return message(
            "simulation.rate_with_time_left",
            "{station} runs at {rate} with {left:.3g} s left: {cause}",
            station=self.config.name,
            rate=rate,
            left=left,
            cause=cause,
        )

    def _count_step(self) -> None:
        """Count a step. Once 20 ms have passed, add the elapsed times to those of the period, unless it was a pause."""
        # Steps are counted always. The processor's time is read seldom: reading it takes as long as a step of a small
        # station.
        self._steps += 1
        now = monotonic()
        if now - self._clocks.wall < _OFTEN:
            return
        before = self._clocks
        self._clocks = _Clocks(now, process_time())
        wall_time = self._clocks.wall - before.wall
        processor_time = self._clocks.processor - before.processor
        # The process also works a little while it is paused, such as in the debugger's own code.
        is_pause = wall_time >= _PAUSE and processor_time <= _IDLE * wall_time + _OFTEN
        if not is_pause:
            self._wall_time += wall_time
            self._processor_time += processor_time


_FLIGHT_STEP = 1e-3
"""Longest step while something flies [s]."""

_FLIGHT_ACCURACY = 1e-3
"""Coarsest accuracy while something flies: a humanoid that moves its legs then keeps its momentum within 0.1 %."""

_LOOK_EVERY = 5
"""Steps between two checks."""

CHECKS_KEPT = 12
"""Count of the last checks of a run that are kept, for a run that continues it."""

# Contacts push only where shapes overlap, and a robot that is placed on the floor does not overlap it yet.
_JUST_OVER = 1e-3
"""A floating body that is this far above a body that does not float counts as touching it at the start [m]."""

_FALLS = 0.3
"""While nothing flies, all shapes are checked only if a body gains downward speed at this share of gravity [1]."""


class Flight:
    """Limits the steps of ``cenic`` while a *floating* body touches nothing but itself.

    A floating body is a free piece, or a robot on a free base with all of its links. The steps of ``cenic`` are
    first-order: while something flies, nothing else limits their error.
    """

    def __init__(
        self, plant: MultibodyPlant, solver: ContinuousSolver, simulator: Simulator
    ) -> None:
        """Prepare to check all floating bodies of a plant.

        Args:
            plant: the plant.
            solver: settings of ``cenic`` that apply while nothing flies.
            simulator: the simulator that steps the plant.
        """
        self._plant = plant
        self._solver = solver
        # A weak reference, since the monitor of the simulator holds this object.
        self._simulator = weakref.ref(simulator)
        joints = [plant.get_joint(index) for index in plant.GetJointIndices()]
        floating = [joint for joint in joints if joint.type_name() == "quaternion_floating"]
        # The collision shapes of each floating body and of all bodies that joints connect to it.
        self._shapes_of_bodies = list[set[GeometryId]]()
        for joint in floating:
            shapes = set[GeometryId]()
            # A robot on a free base falls as a whole: a contact of any of its links holds all of it.
            for body in plant.GetBodiesKinematicallyAffectedBy([joint.index()]):
                shapes.update(plant.GetCollisionGeometriesForBody(plant.get_body(body)))
            self._shapes_of_bodies.append(shapes)
        # Indices of the vertical velocity and of the height of each floating body, after angular velocity and
        # quaternion.
        self._vertical_velocities = [joint.velocity_start() + 5 for joint in floating]
        self._heights = [joint.position_start() + 6 for joint in floating]
        self._gravity = float(np.linalg.norm(plant.gravity_field().gravity_vector()))
        self._steps = 0
        self._is_flying = False
        # Time of the last check [s], and the vertical velocities at this time [m/s].
        self._last_time = -np.inf
        self._last_speeds = np.zeros(len(floating))
        # There is nothing to check up to this time [s].
        self._resumed_at = -np.inf
        self.checks: deque[FlightCheck] = deque(maxlen=CHECKS_KEPT)
        """The last checks, in order, for a run that continues this one."""

    def resume(self, check: FlightCheck) -> None:
        """Continue after a check of another run: take over its result, and the limits of the steps that follow from it.

        Args:
            check: the check, at the step from which the run continues.
        """
        self._steps = check.steps
        self._is_flying = check.is_flying
        self._last_time = check.time
        self._last_speeds = check.speeds
        self._resumed_at = check.time
        simulator = self._simulator()
        if check.is_flying and simulator is not None:
            bound_steps(simulator, self._solver, longest=_FLIGHT_STEP, accuracy=_FLIGHT_ACCURACY)

    def look(self, root: Context) -> None:
        """Check, every few steps, whether something flies, and change the limits of the steps if that has changed.

        Call it at the start and after each step.

        Args:
            root: context of the simulator's diagram.
        """
        if root.get_time() <= self._resumed_at:
            return
        self._steps += 1
        # The first call, at the start, is one of those that check.
        if self._steps % _LOOK_EVERY != 1 or not self._shapes_of_bodies:
            return
        is_flying = self._may_fly(root) and self._is_one_free(root)
        self.checks.append(FlightCheck(self._last_time, self._steps, is_flying, self._last_speeds))
        simulator = self._simulator()
        if is_flying == self._is_flying or simulator is None:
            return
        self._is_flying = is_flying
        if is_flying:
            bound_steps(simulator, self._solver, longest=_FLIGHT_STEP, accuracy=_FLIGHT_ACCURACY)
        # Back to the limits of the station.
        else:
            bound_steps(simulator, self._solver)

    def _may_fly(self, root: Context) -> bool:
        """Whether something may fly.

        It may if anything flew at the last check, or if a floating body has gained at least 0.3 of the downward speed
        of a free fall since then. A first check that does not continue another run has no speeds to compare with, and
        returns True. This test is quick, and the test of all shapes is slow. Time and speeds are kept for the next
        check.
        """
        time = root.get_time()
        last_time = self._last_time
        # Vertical velocities of the floating bodies, upward, shape (k,) [m/s].
        speeds = self._plant.GetVelocities(self._plant.GetMyContextFromRoot(root))[
            self._vertical_velocities
        ]
        # Gain of downward speed since the last check [m/s].
        gain = (self._last_speeds - speeds).max()
        self._last_time = time
        self._last_speeds = speeds
        if self._is_flying or np.isinf(last_time):
            return True
        return bool(gain >= _FALLS * self._gravity * (time - last_time))

    def _is_one_free(self, root: Context) -> bool:
        """Whether a floating body touches nothing but itself.

        At the first check, unless it continues another run, a floating body that is less than 1 mm above a body that
        does not float counts as touching it.
        If the plant has no collision shapes at all, the answer is True.
        """
        plant = self._plant
        context = plant.GetMyMutableContextFromRoot(root)
        # Without shapes nothing can touch.
        if not plant.num_collision_geometries():
            return True
        if self._steps > 1:
            return self._is_apart(context)
        # All floating bodies are lowered for the test, then put back to the last bit.
        positions = plant.GetPositions(context)
        lowered = positions.copy()
        lowered[self._heights] -= _JUST_OVER
        plant.SetPositions(context, lowered)
        is_free = self._is_apart(context)
        plant.SetPositions(context, positions)
        return is_free

    def _is_apart(self, context: Context) -> bool:
        """Whether, in a context of the plant, a floating body exists that touches nothing but itself."""
        query = self._plant.get_geometry_query_input_port().Eval(context)
        # Whether there are collisions at all is found faster than the pairs.
        pairs = query.ComputePointPairPenetration() if query.HasCollisions() else []
        touching = [(pair.id_A, pair.id_B) for pair in pairs]
        for shapes in self._shapes_of_bodies:
            # A contact with another body has exactly one of its two shapes among those of this body.
            has_contact = any((first in shapes) != (second in shapes) for first, second in touching)
            if not has_contact:
                return True
        return False
