"""Properties of engines compared with Drake itself; no module compares names of modes and schemes instead."""

import ast
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
from pydrake.systems.analysis import ResetIntegratorFromFlags, Simulator
from pydrake.systems.primitives import Integrator, LinearSystem

import simrob_drake
from simrob_drake import load_station
from simrob_drake.stations.solver_config import (
    CONTINUOUS_SCHEMES,
    DISCRETE_SCHEMES,
    ContinuousScheme,
    ContinuousSolver,
    DiscreteScheme,
    DiscreteSolver,
)

PACKAGE = Path(simrob_drake.__file__).parent


def test_each_scheme_of_the_schema_has_its_answers():
    assert set(CONTINUOUS_SCHEMES) == set(get_args(ContinuousScheme))
    assert set(DISCRETE_SCHEMES) == set(get_args(DiscreteScheme))
    assert all(
        engine.name == name for name, engine in (CONTINUOUS_SCHEMES | DISCRETE_SCHEMES).items()
    )


@pytest.mark.parametrize("scheme", sorted(set(CONTINUOUS_SCHEMES) - {"cenic", "radau1"}))
def test_schemes_without_an_estimate_of_the_error_in_drake_have_fixed_steps(scheme):
    """Drake refuses an accuracy for an integrator that estimates no error.

    `radau1` is left out: Drake takes an accuracy for it, and the toolbox steps it with fixed steps nevertheless.
    """
    simulator = Simulator(Integrator(1))
    integrator = ResetIntegratorFromFlags(simulator, scheme, 0.01)
    if CONTINUOUS_SCHEMES[scheme].has_fixed_steps:
        with pytest.raises(RuntimeError, match="does not support accuracy estimation"):
            integrator.set_target_accuracy(1e-3)
    else:
        integrator.set_target_accuracy(1e-3)


def test_steps_are_those_of_the_section():
    free = ContinuousSolver(kind="continuous", scheme="radau3", max_step=0.02)
    fixed = ContinuousSolver(kind="continuous", scheme="radau3", max_step=0.02, error_control=False)

    discrete = DiscreteSolver(kind="discrete", time_step=0.004)

    assert [solver.engine.has_fixed_steps for solver in (free, fixed, discrete)] == [
        False,
        True,
        True,
    ]
    assert [solver.engine.has_discrete_states for solver in (free, fixed, discrete)] == [
        False,
        False,
        True,
    ]
    assert [solver.step for solver in (free, fixed, discrete)] == [0.02, 0.02, 0.004]
    assert discrete.tighter().engine.time_step == pytest.approx(0.0004)


def test_a_kinematic_station_asks_no_solver():
    station = load_station("irb120_kinematic", {"solver": {"kind": "discrete"}})

    assert not station.engine.moves_by_forces
    assert not station.engine.has_discrete_states
    assert not station.has_contact_forces


def test_no_module_compares_names_of_modes_and_schemes():
    """Modules read `config.engine`, so that a new scheme is one entry. Only the configuration itself reads its mode."""
    names = {"kinematic", "dynamic", "mujoco", *CONTINUOUS_SCHEMES, *DISCRETE_SCHEMES}
    found = []

    for file in PACKAGE.rglob("*.py"):
        text = file.read_text()
        if not any(f'"{name}"' in text for name in names):
            continue  # most modules: they need not be parsed
        for node in ast.walk(ast.parse(text)):
            if not isinstance(node, ast.Compare):
                continue
            asked = {part.attr for part in ast.walk(node) if isinstance(part, ast.Attribute)}
            values = {part.value for part in ast.walk(node) if isinstance(part, ast.Constant)}
            if (
                asked & {"mode", "scheme", "kind"}
                and {value for value in values if isinstance(value, str)} & names
            ):
                found.append(f"{file.relative_to(PACKAGE)}:{node.lineno}")

    assert [place.partition(":")[0] for place in found] == ["stations/config.py"]


@pytest.mark.parametrize("scheme", sorted(CONTINUOUS_SCHEMES))
def test_explicit_schemes_are_those_that_a_stiff_spring_makes_unstable(scheme):
    """A decay with the rate 1000/s, in steps of 10 ms: h λ = 10 is beyond the stable range of every explicit scheme."""
    if (
        scheme == "cenic"
    ):  # it steps plants alone; it is convex and implicit in their contacts and actuators
        assert not CONTINUOUS_SCHEMES[scheme].is_explicit
        return
    decay = LinearSystem(A=[[-1000.0]], B=np.zeros((1, 0)), C=[[1.0]], D=np.zeros((1, 0)))
    simulator = Simulator(decay)
    integrator = ResetIntegratorFromFlags(simulator, scheme, 0.01)
    if not CONTINUOUS_SCHEMES[scheme].has_fixed_steps:
        integrator.set_fixed_step_mode(True)
    simulator.get_mutable_context().SetContinuousState([1.0])
    simulator.AdvanceTo(0.5)

    end = abs(simulator.get_context().get_continuous_state_vector()[0])

    assert (end > 1.0) == CONTINUOUS_SCHEMES[scheme].is_explicit
