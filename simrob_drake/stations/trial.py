"""Try whether a solver gets through a station in bounded time."""

from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, EventStatus

from simrob_drake.stations.closed import closed_station
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.resolve import resolve
from simrob_drake.stations.solve import apply_solver
from simrob_drake.stations.steps import step_findings

_WORK = 10_000
"""Evaluations of the dynamics that a trial may take: about what 3 s in discrete steps of 1 ms cost."""


def gets_through(config: StationConfig) -> bool:
    """Tell whether a continuous solver brings a station to its end before its evaluations of the dynamics run out.

    One that would lean on a stop too stiff for it is not even tried: it may get through, and be wrong.
    """
    closed = closed_station(resolve(config), sensors=(), monitors=False)
    if any(finding.level == "warning" for finding in step_findings(config, closed.ports.plant, closed.courses)):
        return False
    simulator = Simulator(closed.diagram)
    apply_solver(simulator, config)
    integrator = simulator.get_integrator()

    def look(_: Context) -> EventStatus:
        if integrator.get_num_derivative_evaluations() > _WORK:
            return EventStatus.ReachedTermination(closed.diagram, "too much work")
        return EventStatus.DidNothing()

    simulator.set_monitor(look)
    try:
        simulator.AdvanceTo(config.duration)
    except (RuntimeError, SystemExit):  # it diverged; failed assertions come as SystemExit
        return False
    return bool(simulator.get_context().get_time() >= config.duration)
