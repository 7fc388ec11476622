"""What a walk remembers: numbers and back, and from one foot to the other."""

from dataclasses import fields

import numpy as np
import pytest

from simrob_drake.walking.stride import NUMBERS, Stride, eased


@pytest.fixture
def stride() -> Stride:
    values = np.random.default_rng(1).normal(size=(len(fields(Stride)), 2))
    told = {
        field.name: complex(*pair) if isinstance(field.default, complex) else float(pair[0])
        for field, pair in zip(fields(Stride), values, strict=True)
    }
    return Stride(**{**told, "standing": 0.0})


def test_numbers_and_back(stride: Stride) -> None:
    numbers = stride.numbers()
    assert numbers.shape == (NUMBERS,)
    assert Stride.of(numbers) == stride


def test_there_and_back_on_the_other_foot(stride: Stride) -> None:
    back = stride.on_the_other_foot().on_the_other_foot()
    for name in (
        "com",
        "zmp",
        "foot",
        "foot_yaw",
        "heading",
        "height",
        "rise",
        "slope",
        "tilt",
        "foot_tilt",
        "sag",
        "trim",
    ):
        assert getattr(back, name) == pytest.approx(getattr(stride, name)), name
    assert stride.on_the_other_foot().standing == 1.0


def test_what_is_fixed_to_the_ground_stays(stride: Stride) -> None:
    """The distance between centre of mass and foot is the same, seen from either foot."""
    other = stride.on_the_other_foot()
    assert abs(stride.com - stride.foot) == pytest.approx(abs(other.com))
    assert abs(stride.com) == pytest.approx(abs(other.com - other.foot))
    assert other.rise + other.height == pytest.approx(stride.rise - 2 * stride.height)


def test_a_swing_is_at_rest_at_both_ends() -> None:
    near = 1e-4
    assert (eased(0.0), eased(0.5), eased(1.0)) == (0.0, pytest.approx(0.5), pytest.approx(1.0))
    assert eased(near) < near**2
    assert 1 - eased(1 - near) < near**2
