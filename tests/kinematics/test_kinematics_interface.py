"""What all four solvers have in common."""

import numpy as np
import pytest
from pydrake.math import RigidTransform

from simrob_drake.base.errors import InvalidParameter, SimrobError, UnknownName
from simrob_drake.base.frames import poses_from_matrices
from simrob_drake.kinematics import (
    NoClosedForm,
    Unreachable,
    UnsupportedChain,
    make_solver,
    require,
)

NAMES = ["numeric", "constrained", "analytic", "incremental"]


@pytest.fixture
def near(irb120_chain, home):
    """Three poses near home."""
    return irb120_chain.forward(home + np.linspace(0, 0.05, 3)[:, np.newaxis])


@pytest.mark.parametrize("name", NAMES)
def test_forms_of_targets(name, irb120_chain, home, near):
    solver = make_solver(name, irb120_chain)
    forms = [near, poses_from_matrices(near), [RigidTransform(matrix) for matrix in near]]

    found = [require(solver.solve(form, home)) for form in forms]

    for positions in found:
        assert positions.shape == (3, 6)
        np.testing.assert_allclose(irb120_chain.forward(positions), near, atol=1e-4)

    single = solver.solve(near[1], home)
    assert single.positions.shape == (1, 6)
    assert single.reached.shape == single.position_error.shape == single.iterations.shape == (1,)


@pytest.mark.parametrize("name", NAMES)
def test_starts_one_by_one_or_each_its_own(name, irb120_chain, home, near):
    solver = make_solver(name, irb120_chain)
    in_order = solver.solve(near, home)

    first, second = solver.solve(near[0], home), solver.solve(near[1], in_order.positions[0])

    np.testing.assert_array_equal(
        in_order.positions[:2], np.concatenate([first.positions, second.positions])
    )

    each = solver.solve(near, np.tile(home, (3, 1)))
    alone = [solver.solve(target, home).positions[0] for target in near]

    np.testing.assert_allclose(each.positions, alone, atol=1e-12)  # batches add in another order


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("start", [[0.0] * 5, np.zeros((2, 6)), [np.nan] * 6, None])
def test_bad_starts(name, irb120_chain, near, start):
    with pytest.raises(InvalidParameter, match="start"):
        make_solver(name, irb120_chain).solve(near, start)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("targets", [[0.0] * 5, np.zeros((4, 3)), [np.inf] * 6, None])
def test_bad_targets(name, irb120_chain, home, targets):
    with pytest.raises(InvalidParameter, match="targets"):
        make_solver(name, irb120_chain).solve(targets, home)


@pytest.mark.parametrize("name", NAMES)
def test_unreachable_names_point_reason_and_nearness(name, irb120_chain, home, near):
    options = {"restarts": 2} if name in ("numeric", "constrained") else {}
    near[2, 0, 3] += 3.0

    solutions = make_solver(name, irb120_chain, **options).solve(near, home)

    assert solutions.reached.tolist() == [True, True, False]
    with pytest.raises(
        Unreachable,
        match=r"^points\[2\] cannot be reached: .+; the error .* m and .* rad \(.* deg\)$",
    ) as caught:
        require(solutions, "points")
    assert caught.value.index == 2
    assert 2.0 < caught.value.position_error < 4.0
    assert "\n" not in str(caught.value)

    place = irb120_chain.forward(caught.value.positions)[0, :3, 3]
    assert np.linalg.norm(place - near[2, :3, 3]) == pytest.approx(caught.value.position_error)


def test_targets_and_start_stay_as_they_are(irb120_chain, home, near):
    for name in NAMES:
        targets, start = near.copy(), home.copy()
        make_solver(name, irb120_chain).solve(targets, start)
        np.testing.assert_array_equal(targets, near)
        np.testing.assert_array_equal(start, home)


def test_unknown_solver_and_option(irb120_chain):
    with pytest.raises(UnknownName, match="did you mean 'numeric'"):
        make_solver("numerical", irb120_chain)
    with pytest.raises(UnknownName, match="did you mean 'weights'"):
        make_solver("numeric", irb120_chain, weight=[1] * 6)


def test_errors_are_simrobs():
    assert all(
        issubclass(error, SimrobError) for error in (Unreachable, NoClosedForm, UnsupportedChain)
    )
