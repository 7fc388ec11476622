"""What engines answer, against Drake itself; and that no module compares names of modes and schemes instead."""

import ast
from pathlib import Path
from typing import get_args

import pytest
from pydrake.systems.analysis import ResetIntegratorFromFlags, Simulator
from pydrake.systems.primitives import Integrator

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
    assert all(engine.name == name for name, engine in (CONTINUOUS_SCHEMES | DISCRETE_SCHEMES).items())


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
    assert [solver.engine.has_fixed_steps for solver in (free, fixed, discrete)] == [False, True, True]
    assert [solver.engine.has_discrete_states for solver in (free, fixed, discrete)] == [False, False, True]
    assert [solver.step for solver in (free, fixed, discrete)] == [0.02, 0.02, 0.004]
    assert discrete.tighter().engine.time_step == pytest.approx(0.0004)


def test_a_kinematic_station_asks_no_solver():
    station = load_station("irb120_kinematic", {"solver": {"kind": "discrete"}})
    assert not station.engine.moves_by_forces
    assert not station.engine.has_discrete_states
    assert not station.has_contact_forces


def test_no_module_compares_names_of_modes_and_schemes():
    """`config.engine` answers instead; a new scheme is one entry then. The configuration itself asks for its mode."""
    names = {"kinematic", "dynamic", "mujoco", *CONTINUOUS_SCHEMES, *DISCRETE_SCHEMES}
    found = []
    for file in PACKAGE.rglob("*.py"):
        for node in ast.walk(ast.parse(file.read_text())):
            if not isinstance(node, ast.Compare):
                continue
            asked = {part.attr for part in ast.walk(node) if isinstance(part, ast.Attribute)}
            values = {part.value for part in ast.walk(node) if isinstance(part, ast.Constant)}
            if asked & {"mode", "scheme", "kind"} and {value for value in values if isinstance(value, str)} & names:
                found.append(f"{file.relative_to(PACKAGE)}:{node.lineno}")
    assert [place.partition(":")[0] for place in found] == ["stations/config.py"]
