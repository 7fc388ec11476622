"""Run stations: build their diagrams, step them, and make results of what was recorded."""

from simrob_drake.base.renaming import former_names_of
from simrob_drake.simulation.built import CommandFunctions
from simrob_drake.simulation.own_diagram import simulate_diagram
from simrob_drake.simulation.run import OnStep, ReferenceLike
from simrob_drake.simulation.runner import FailedRunWarning, RunBranch, Runner, simulate
from simrob_drake.simulation.stepping import Moment, Ticks

__all__ = [
    "CommandFunctions",
    "FailedRunWarning",
    "Moment",
    "OnStep",
    "ReferenceLike",
    "RunBranch",
    "Runner",
    "Ticks",
    "simulate",
    "simulate_diagram",
]

__getattr__ = former_names_of(__name__, {"Hands": "CommandFunctions"})
