"""What holds up a run that hardly gets on, found by trials: its state is stepped for a moment without a suspect.

Trials have contexts of their own and leave the run as it is. Blocks of the user's own may remember more than Drake
knows of, so that a run with such is only looked at.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from math import inf, nextafter
from time import perf_counter

from pydrake.geometry import CollisionFilterDeclaration, GeometrySet, Role
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, EventStatus

from simrob_drake.blocks.sampled import SampledBlock
from simrob_drake.errors import SimrobError
from simrob_drake.parts.targets import owner_of_shape
from simrob_drake.results.record.state import State
from simrob_drake.stations.closed import ClosedStation, closed_station
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.resolve import resolve
from simrob_drake.stations.solver_config import ContinuousSolver, DiscreteSolver, FixedSteps
from simrob_drake.stations.steps import DISCRETE, apply_solver, controlled_by, stiffest

_TRIAL = 0.3  # s of a clock, each
_GAIN = 3.0
"""So many times as far a trial without a suspect must get in its time: then that is to blame."""
_MOST = 4  # pairs that are tried without, one by one
_SHORT = 0.1
"""Part of ``max_step`` below which steps are short; longer ones are dear."""
_LOOKS = 3  # at what a step costs
_HALF = 0.5  # of what a step costs: then a part is to blame
_LONGEST = 1e3  # s of simulated time

Pair = frozenset[str]
"""The names of two bodies."""


@dataclass(frozen=True)
class Slow:
    """A run that hardly gets on, at the moment when that is found.

    Attributes:
        config: the station.
        built: what is stepped.
        context: where it is.
        step: mean length of its last steps [s].
        cost: of each, by a clock [s].
        own_blocks: whether there are blocks of the user's own.
    """

    config: StationConfig
    built: ClosedStation
    context: Context
    step: float
    cost: float
    own_blocks: bool

    def cause(self) -> str:
        """Return what holds it up and what to set, in words."""
        solver = controlled_by(self.config)
        if solver is None or self.step > _SHORT * solver.max_step:
            return f"each step of {self.step:.2g} s takes {self.cost:.2g} s{self._dear(solver)}"
        pair, plant = self._blamed_pair(), self.built.ports.plant
        if pair is None:
            what = f"{stiffest(self.config, plant, plant.plant.GetMyContextFromRoot(self.context))}, which makes"
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
    simulator: Simulator,
    config: StationConfig,
    step: float,
    look: Callable[[Context], object] = lambda context: None,
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
