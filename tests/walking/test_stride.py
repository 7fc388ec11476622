"""State of a walk: conversion to a vector and back, change of the stance foot, and rest-to-rest motions."""

from cmath import exp

import numpy as np
import pytest

from simrob_drake.walking.stride import (
    NUMBERS,
    Corrections,
    Stride,
    Swing,
    progress_since,
    smoothstep,
)

# Fields that do not change when the robot goes over to the other foot and back.
RESTORED = {
    "step": ("standing", "speed"),
    "swing": ("place", "yaw"),
    "trunk": ("com", "zmp", "heading", "rise"),
    "ground": ("height", "slope", "tilt", "foot_tilt"),
    "corrections": ("lean_integral", "com_offset", "speed_trim", "turn_back"),
}


@pytest.fixture
def stride() -> Stride:
    """A state with random values, which stands on the right foot."""
    random = np.random.default_rng(1)

    def draw(value: complex) -> complex:
        pair = random.normal(size=2).tolist()
        return complex(*pair) if isinstance(value, complex) else pair[0]

    groups = [type(group)._make(map(draw, group)) for group in Stride()]
    drawn = Stride(*groups)
    return drawn._replace(step=drawn.step._replace(standing=0.0))


def test_a_stride_is_equal_after_the_conversion_to_a_vector_and_back(stride: Stride) -> None:
    numbers = stride.numbers()

    assert numbers.shape == (NUMBERS,)
    assert Stride.of(numbers) == stride


@pytest.mark.parametrize(
    ("group", "field"), [(group, field) for group in RESTORED for field in RESTORED[group]]
)
def test_two_changes_of_the_stance_foot_restore_the_stride(
    stride: Stride, group: str, field: str
) -> None:
    restored = stride.on_the_other_foot().on_the_other_foot()

    before = getattr(getattr(stride, group), field)
    after = getattr(getattr(restored, group), field)
    assert after == pytest.approx(before)


def test_the_foot_that_has_landed_becomes_the_stance_foot(stride: Stride) -> None:
    other = stride.on_the_other_foot()

    assert other.step.standing == 1.0
    assert other.step.sides == (1, 0)
    assert other.step.time == 0.0
    assert other.swing.share == 0.0


def test_distances_between_points_stay_the_same(stride: Stride) -> None:
    """A position p from one foot is (p - u) exp(-i yaw) from the other one, so distances are equal."""
    other = stride.on_the_other_foot()

    com_to_swing_foot = abs(stride.trunk.com - stride.swing.place)
    com_to_stance_foot = abs(stride.trunk.com)
    assert abs(other.trunk.com) == pytest.approx(com_to_swing_foot)
    assert abs(other.trunk.com - other.swing.place) == pytest.approx(com_to_stance_foot)
    assert abs(other.trunk.com - other.trunk.zmp) == pytest.approx(
        abs(stride.trunk.com - stride.trunk.zmp)
    )


def test_the_root_keeps_its_height_in_the_world(stride: Stride) -> None:
    """The stance foot of afterwards is higher by the ground's height, and the root is lower over it by as much."""
    other = stride.on_the_other_foot()

    assert other.ground.height == -stride.ground.height
    assert other.trunk.rise == pytest.approx(stride.trunk.rise - stride.ground.height)


@pytest.mark.parametrize("yaw", [0.4, -0.7])
def test_directions_are_the_same_in_the_world(yaw: float) -> None:
    """The foot that has landed is turned by yaw: a direction in the world is d exp(i yaw), with d from that foot."""
    corrections = Corrections(speed_trim=0.03 + 0.01j)
    stride = Stride(swing=Swing(place=0.1j, yaw=yaw), corrections=corrections)
    ground = stride.ground._replace(slope=0.05 - 0.02j, tilt=0.01j, foot_tilt=0.02 + 0j)
    stride = stride._replace(ground=ground)

    other = stride.on_the_other_foot()

    to_world = exp(1j * yaw)
    assert other.corrections.speed_trim * to_world == pytest.approx(0.03 + 0.01j)
    assert other.ground.slope * to_world == pytest.approx(0.05 - 0.02j)
    # The stance pair and the swing pair have changed places.
    assert other.ground.tilt * to_world == pytest.approx(0.02 + 0j)
    assert other.ground.foot_tilt * to_world == pytest.approx(0.01j)


@pytest.mark.parametrize("yaw", [0.0, 0.5])
def test_an_offset_of_the_legs_is_mirrored_not_turned(yaw: float) -> None:
    corrections = Corrections(com_offset=0.02 + 0.01j)
    stride = Stride(swing=Swing(yaw=yaw), corrections=corrections)

    assert stride.on_the_other_foot().corrections.com_offset == 0.02 - 0.01j


@pytest.mark.parametrize("peak", [1.5, 1.7, 1.875])
def test_a_motion_begins_and_ends_at_rest_with_its_peak_in_the_middle(peak: float) -> None:
    shares = np.linspace(0.0, 1.0, 2001)

    places = np.array([smoothstep(share, peak) for share in shares.tolist()])

    speeds = np.gradient(places, shares)
    assert places[[0, 1000, 2000]] == pytest.approx([0.0, 0.5, 1.0])
    assert speeds[[0, -1]] == pytest.approx([0.0, 0.0], abs=2e-3)
    assert speeds.max() == pytest.approx(peak, rel=1e-4)
    assert speeds.argmax() == 1000
    assert (np.diff(places) >= 0).all()


def test_the_softest_motion_is_the_quintic_and_the_most_even_one_the_cubic() -> None:
    share = 0.3

    assert smoothstep(share) == pytest.approx(10 * share**3 - 15 * share**4 + 6 * share**5)
    assert smoothstep(share, 1.5) == pytest.approx(3 * share**2 - 2 * share**3)


@pytest.mark.parametrize("peak", [1.5, 1.875])
def test_parts_of_the_remaining_motion_add_up_to_the_motion(peak: float) -> None:
    """A motion to a fixed goal, made of parts of what remains, is the smooth motion itself."""
    place = 0.0

    for before, now in ((0.0, 0.2), (0.2, 0.5), (0.5, 0.8)):
        place += progress_since(before, now, peak) * (1.0 - place)
        assert place == pytest.approx(smoothstep(now, peak))

    place += progress_since(0.8, 1.3, peak) * (1.0 - place)
    assert place == pytest.approx(1.0)
