"""Trials of a drafted station: short simulations that show whether a solver is quick enough or a robot stands.

A trial decides between alternatives while a first station is drafted, see :mod:`simrob_drake.stations.draft`.
"""

from typing import NamedTuple

import numpy as np
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, EventStatus

from simrob_drake.base.frames import lean, xyz_quaternion_from_transform
from simrob_drake.base.messages import message
from simrob_drake.stations.closed import closed_station
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.resolve import resolve
from simrob_drake.stations.steps import set_solver, step_findings

# A robot that leans or sinks more than this during a trial does not stand.
_LEANS_DEG = 10.0  # [deg]
_SINKS_SHARE = 0.1  # as a share of the height of its root
_LEAST_HEIGHT = 0.1  # lower roots count as if they were at this height [m]

_MOST_EVALUATIONS = 10_000
"""Count of evaluations of the dynamics that a trial may take: about the cost of 3 s in discrete steps of 1 ms."""


def gets_through(config: StationConfig) -> bool:
    """Whether a continuous solver brings a station to its end before its evaluations of the dynamics run out.

    A run that Drake breaks off with an error does not get through. A station with a warning about its steps, such as a
    joint stop that is too stiff for the solver, is not tried, and does not get through: the run might reach its end
    with wrong results.
    """
    closed = closed_station(resolve(config), sensors=(), monitors=False)
    findings = step_findings(config, closed.ports.plant, closed.references)
    if any(finding.level == "warning" for finding in findings):
        return False
    simulator = Simulator(closed.diagram)
    set_solver(simulator, config)
    integrator = simulator.get_integrator()

    def stop_if_expensive(_: Context) -> EventStatus:
        """End the simulation when too many evaluations of the dynamics have been made."""
        # Evaluations, not wall-clock time: the draft must be the same on a slow computer.
        if integrator.get_num_derivative_evaluations() > _MOST_EVALUATIONS:
            return EventStatus.ReachedTermination(
                closed.diagram, message("stations.too_much_work", "too much work")
            )
        return EventStatus.DidNothing()

    simulator.set_monitor(stop_if_expensive)
    # The monitor ends the simulation early without an error, which only the time shows.
    return (
        _advances(simulator, config.duration)
        and simulator.get_context().get_time() >= config.duration
    )


def _advances(simulator: Simulator, time: float) -> bool:
    """Simulate up to a time [s], or to where a monitor stops the run. Returns False if Drake fails before that."""
    try:
        simulator.AdvanceTo(time)
    except (RuntimeError, SystemExit):  # failed assertions come as SystemExit
        return False
    return True


class StandingTrial(NamedTuple):
    """Result of a trial of standing.

    Attributes:
        is_standing: whether the robot stood until the end.
        outcome: what happened, as a part of a sentence.
    """

    is_standing: bool
    outcome: str


def stands(config: StationConfig, duration: float = 2.0) -> StandingTrial:
    """Simulate for a time [s] whether the only robot of a station stands on its own feet.

    It does not if the run diverges, if the station's monitor detects a fall and ends the run, or if the robot leans or
    has sunk too much at the end.
    """
    # Without sensors: only the motion counts here.
    closed = closed_station(resolve(config), sensors=())
    station = closed.ports.plant
    (robot,) = station.robots.values()
    simulator = Simulator(closed.diagram)
    set_solver(simulator, config)
    context = station.plant.GetMyContextFromRoot(simulator.get_context())
    before = robot.root.CalcPoseInWorld(context)
    if not _advances(simulator, duration):
        return StandingTrial(False, message("stations.it_diverged", "the simulation diverged"))
    time = simulator.get_context().get_time()
    if time < duration:  # the station's monitor has ended the run
        return StandingTrial(
            False, message("stations.it_fell", "the robot fell at {time:.2f} s", time=time)
        )

    after = robot.root.CalcPoseInWorld(context)
    # The direction of the root that pointed up at the start, in the root's frame.
    up = before.rotation().inverse().matrix()[:, 2].tolist()
    quaternion = xyz_quaternion_from_transform(after)[3:].tolist()
    # The angle of this direction with the vertical at the end.
    leaning_deg = float(np.rad2deg(lean(up, *quaternion)))
    position = before.translation()
    sunk = float((position - after.translation())[2])  # positive downward [m]
    # Height of the root over the ground at the start.
    height = float(position[2] - station.ground.beneath(position[np.newaxis])[0])
    # Servos sag, so that a small lean or sinking is not a fall.
    is_upright = leaning_deg < _LEANS_DEG and sunk < _SINKS_SHARE * max(height, _LEAST_HEIGHT)

    side = message("stations.lower", "lower") if sunk >= 0 else message("stations.higher", "higher")
    outcome = message(
        "stations.stood_after",
        "after {duration:g} s the robot leans by {lean:.1f} deg, and its root is {height:.0f} mm "
        "{side} than at the start",
        duration=duration,
        lean=leaning_deg,
        height=abs(sunk) * 1e3,
        side=side,
    )
    return StandingTrial(is_upright, outcome)
