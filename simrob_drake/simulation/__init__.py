"""Run stations: build their diagrams, step them, and make results of what was recorded."""

from simrob_drake.simulation.built import Hands
from simrob_drake.simulation.own_diagram import simulate_diagram
from simrob_drake.simulation.run import OnStep, ReferenceLike
from simrob_drake.simulation.runner import RunBranch, Runner, simulate
from simrob_drake.simulation.stepping import Moment, Ticks

__all__ = ["Hands", "Moment", "OnStep", "ReferenceLike", "RunBranch", "Runner", "Ticks", "simulate", "simulate_diagram"]
