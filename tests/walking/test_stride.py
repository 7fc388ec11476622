"""What a walk remembers: numbers and back, and from one foot to the other."""

import numpy as np
import pytest

from simrob_drake.walking.stride import NUMBERS, Stride, smoothstep


@pytest.fixture
def stride() -> Stride:
    random = np.random.default_rng(1)

    def drawn(value: complex) -> complex:
        pair = random.normal(size=2).tolist()
        return complex(*pair) if isinstance(value, complex) else pair[0]

    groups = [type(group)._make(map(drawn, group)) for group in Stride()]
    return Stride(*groups)._replace(step=groups[0]._replace(standing=0.0))


def test_numbers_and_back(stride: Stride) -> None:
    numbers = stride.numbers()
    assert numbers.shape == (NUMBERS,)
    assert Stride.of(numbers) == stride


def test_there_and_back_on_the_other_foot(stride: Stride) -> None:
    back = stride.on_the_other_foot().on_the_other_foot()
    for group, names in {
        "step": ("standing", "speed"),
        "swing": ("place", "yaw"),
        "trunk": ("com", "zmp", "heading", "rise"),
        "ground": ("height", "slope", "tilt", "foot_tilt"),
        "corrections": ("lean_integral", "com_offset", "speed_trim", "turn_back"),
    }.items():
        for name in names:
            assert getattr(getattr(back, group), name) == pytest.approx(getattr(getattr(stride, group), name)), name
    assert stride.on_the_other_foot().step.standing == 1.0


def test_what_is_fixed_to_the_ground_stays(stride: Stride) -> None:
    """The distance between centre of mass and foot is the same, seen from either foot."""
    other = stride.on_the_other_foot()
    assert abs(stride.trunk.com - stride.swing.place) == pytest.approx(abs(other.trunk.com))
    assert abs(stride.trunk.com) == pytest.approx(abs(other.trunk.com - other.swing.place))
    assert other.trunk.rise + other.ground.height == pytest.approx(stride.trunk.rise - 2 * stride.ground.height)


def test_a_swing_is_at_rest_at_both_ends() -> None:
    near = 1e-4
    assert (smoothstep(0.0), smoothstep(0.5), smoothstep(1.0)) == (0.0, pytest.approx(0.5), pytest.approx(1.0))
    assert smoothstep(near) < near**2
    assert 1 - smoothstep(1 - near) < near**2
