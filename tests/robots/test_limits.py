"""Limits of axes: rounding is clamped, real violations are refused with numbers that differ."""

import warnings

import numpy as np
import pytest

from simrob_drake.base.errors import SimrobError
from simrob_drake.programs.errors import JointLimitExceeded
from simrob_drake.programs.moves.joints import targets_on
from simrob_drake.robots.catalog import load_robot
from simrob_drake.robots.limits import (
    ANGLE_TOLERANCE,
    LENGTH_TOLERANCE,
    AxisLimits,
    ClampedPosition,
    distinct_texts,
    middles,
)
from simrob_drake.stations.load import bare_station
from simrob_drake.stations.resolve import resolve


def limits() -> AxisLimits:
    """A turning axis of -1 to 2 rad and a sliding one of 0 to 0.04 m."""
    return AxisLimits(
        names=("turn", "slide"),
        lower=np.array([-1.0, 0.0]),
        upper=np.array([2.0, 0.04]),
        revolute=np.array([True, False]),
    )


@pytest.mark.parametrize("side", [-1, 1])
def test_rounding_is_clamped_and_said_once(side: int) -> None:
    own = limits()

    end = own.upper if side > 0 else own.lower
    rounded = end + 0.9 * side * np.array([ANGLE_TOLERANCE, LENGTH_TOLERANCE])
    assert own.find_violation(rounded[np.newaxis]) is None

    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("default", ClampedPosition)
        for _ in range(3):
            np.testing.assert_array_equal(own.clamp(rounded, f"the start {side}"), end)
    assert [str(one.message).split(" is ")[0] for one in caught] == [
        f"the start {side}: turn",
        f"the start {side}: slide",
    ]


@pytest.mark.parametrize("side", [-1, 1])
@pytest.mark.parametrize("axis", [0, 1])
def test_more_than_rounding_is_a_violation(axis: int, side: int) -> None:
    own = limits()
    position = np.array([0.5, 0.02])
    end = (own.upper if side > 0 else own.lower)[axis]
    position[axis] = end + 1.1 * side * own.tolerances[axis]

    violation = own.find_violation(position[np.newaxis])

    assert violation is not None
    assert violation.axis == axis
    assert violation.value != violation.limit
    assert violation.unit == ("deg", "m")[axis]


def test_no_number_is_within_no_limits() -> None:
    assert not limits().are_within(np.array([np.nan, 0.0]))


@pytest.mark.parametrize(
    ("value", "limit", "texts"),
    [
        (0.04002, 0.04, ("0.04002", "0.04")),
        (0.0400001, 0.04, ("0.0400001", "0.04")),
        (400.0, 110.0, ("400", "110")),
    ],
)
def test_texts_differ_where_numbers_do(value: float, limit: float, texts: tuple[str, str]) -> None:
    assert distinct_texts(value, limit) == texts


@pytest.mark.parametrize("name", ["irb120_gripper", "ur5", "tx40"])
def test_postures_at_the_limits_are_starts_in_spite_of_rounding(name: str) -> None:
    """A posture that a run reports may be beyond a limit by the rounding of its solver: 5e-5 rad, 5e-6 m here."""
    model = load_robot(name)
    lower, upper = model.axis_limits
    for limit, side in ((lower, -1.0), (upper, 1.0)):
        posture = limit + 0.5 * side * model.limits.tolerances
        values = dict(zip(model.axes, (posture / model.user_units).tolist(), strict=True))
        start = resolve(bare_station(name, {"robot.initial_deg": values})).robots["robot"].initial
        np.testing.assert_array_equal(start, limit)


def test_a_finger_beyond_its_limit_is_refused_with_different_numbers() -> None:
    model = load_robot("irb120_gripper")

    finger = list(model.axes).index("left_finger")
    opened = model.axis_limits[1][finger]
    with pytest.raises(
        SimrobError, match=rf"left_finger is {opened + 2e-5:g}; it must be within 0 to {opened:g} m"
    ):
        bare_station("irb120_gripper", {"robot.initial_deg": {"left_finger": opened + 2e-5}})


def test_targets_of_moves_share_the_tolerance() -> None:
    model = load_robot("irb120")

    upper = float(model.axis_limits[1][0])
    rounded = np.rad2deg(upper + 0.5 * ANGLE_TOLERANCE)
    with pytest.warns(ClampedPosition, match="joint_1 is beyond its limit by less than 0.0001 rad"):
        assert targets_on(model, {"joint_1": rounded}, "the target") == {0: upper}
    with pytest.raises(
        JointLimitExceeded, match=r"165\.01 deg, 0\.01\d* deg beyond its limit of 165 deg"
    ):
        targets_on(model, {"joint_1": np.rad2deg(upper) + 0.01}, "the target")


@pytest.mark.parametrize("kind", ["hold", "move"])
def test_references_share_the_tolerance(kind: str) -> None:
    upper = float(np.rad2deg(load_robot("irb120").axis_limits[1][0]))
    bare_station("irb120", {"reference": {"kind": kind, "target_deg": {"joint_1": upper + 0.005}}})
    with pytest.raises(
        SimrobError, match=r"joint_1 is 165\.01 deg; it must be within .* -165 to 165 deg"
    ):
        bare_station(
            "irb120", {"reference": {"kind": kind, "target_deg": {"joint_1": upper + 0.01}}}
        )


@pytest.mark.parametrize(
    ("lower", "upper", "position"),
    [
        (-90.0, 45.0, 0.0),
        (10.0, 50.0, 30.0),
        (-80.0, -20.0, -50.0),
        (1e-13, 50.0, 0.0),
        (-np.inf, np.inf, 0.0),
    ],
)
def test_an_axis_begins_at_zero_or_in_the_middle_of_a_range_without_zero(lower, upper, position):
    axis = AxisLimits(
        names=("turn",),
        lower=np.deg2rad([lower]),
        upper=np.deg2rad([upper]),
        revolute=np.array([True]),
    )

    np.testing.assert_allclose(middles(axis, np.deg2rad([1.0])), [position], atol=1e-9)
