"""The palette: its colours lie apart for everybody, whatever kind of colour blindness they have.

Colour blindness is simulated by the matrices of Machado, Oliveira and Fernandes (2009) for full severity, in linear
RGB; distances are CIEDE2000, where 1 is just seen side by side, and lines apart from each other need 10 or more.
"""

from itertools import combinations
from math import atan2, cos, degrees, exp, hypot, radians, sin, sqrt

import numpy as np
import pytest

from simrob_drake.results.colours import (
    BAD,
    COLOURS,
    FORCE,
    GOOD,
    PATHS,
    RED,
    SUM_OF_FORCES,
    looks,
    rgb,
)

EYES = {
    "usual": np.eye(3),
    "protanopia": np.array(
        [
            [0.152286, 1.052583, -0.204868],
            [0.114503, 0.786281, 0.099216],
            [-0.003882, -0.048116, 1.051998],
        ]
    ),
    "deuteranopia": np.array(
        [
            [0.367322, 0.860646, -0.227968],
            [0.280085, 0.672501, 0.047413],
            [-0.011820, 0.042940, 0.968881],
        ]
    ),
    "tritanopia": np.array(
        [
            [1.255528, -0.076749, -0.178779],
            [-0.078411, 0.930809, 0.147602],
            [0.004733, 0.691367, 0.303900],
        ]
    ),
}
TO_XYZ = np.array(
    [
        [0.4124564, 0.3575761, 0.1804375],
        [0.2126729, 0.7151522, 0.0721750],
        [0.0193339, 0.1191920, 0.9503041],
    ]
)
PLATES = {"white": "#ffffff", "dark": "#1b2027"}


@pytest.fixture(params=EYES)
def eyes(request):
    return request.param


def linear(colour):
    values = np.array(rgb(colour))
    return np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)


def luminance(colour):
    return float(TO_XYZ[1] @ linear(colour))


def lab(colour, eyes):
    part = TO_XYZ @ np.clip(EYES[eyes] @ linear(colour), 0, 1) / TO_XYZ.sum(axis=1)
    x, y, z = np.where(part > 216 / 24389, np.cbrt(part), (24389 / 27 * part + 16) / 116)
    return 116 * y - 16, 500 * (x - y), 200 * (y - z)


def apart(one, other):
    """Return the distance CIEDE2000 of two colours in L*, a*, b* (Sharma, Wu and Dalal 2005)."""
    (l1, a1, b1), (l2, a2, b2) = one, other
    seventh = ((hypot(a1, b1) + hypot(a2, b2)) / 2) ** 7
    stretch = 1 + (1 - sqrt(seventh / (seventh + 25**7))) / 2
    a1, a2 = stretch * a1, stretch * a2
    c1, c2, h1, h2 = (
        hypot(a1, b1),
        hypot(a2, b2),
        degrees(atan2(b1, a1)) % 360,
        degrees(atan2(b2, a2)) % 360,
    )
    turn = (h2 - h1 + 180) % 360 - 180 if c1 * c2 else 0.0
    hue = 2 * sqrt(c1 * c2) * sin(radians(turn) / 2)
    light, chroma, middle = (
        (l1 + l2) / 2,
        (c1 + c2) / 2,
        (h1 + turn / 2) % 360 if c1 * c2 else h1 + h2,
    )
    waves = ((-0.17, 1, -30), (0.24, 2, 0), (0.32, 3, 6), (-0.20, 4, -63))
    t = 1 + sum(size * cos(radians(times * middle + begin)) for size, times, begin in waves)
    in_l = (l2 - l1) / (1 + 0.015 * (light - 50) ** 2 / sqrt(20 + (light - 50) ** 2))
    in_c, in_h = (c2 - c1) / (1 + 0.045 * chroma), hue / (1 + 0.015 * chroma * t)
    swing = (
        2
        * sqrt(chroma**7 / (chroma**7 + 25**7))
        * sin(radians(60 * exp(-(((middle - 275) / 25) ** 2))))
    )
    return sqrt(in_l**2 + in_c**2 + in_h**2 - swing * in_c * in_h)


def least(colours, eyes):
    return min(apart(lab(one, eyes), lab(other, eyes)) for one, other in combinations(colours, 2))


def test_the_distance_is_that_of_the_paper():
    """Three pairs of the paper on CIEDE2000 that tell wrong formulas from right ones."""
    assert apart((50, 2.6772, -79.7751), (50, 0, -82.7485)) == pytest.approx(2.0425, abs=1e-4)
    assert apart((50, 2.5, 0), (61, -5, 29)) == pytest.approx(22.8977, abs=1e-4)
    assert apart((2.0776, 0.0795, -1.1350), (0.9033, -0.0636, -0.5514)) == pytest.approx(
        0.9082, abs=1e-4
    )


def test_all_curves_of_a_frame_are_told_apart(eyes):
    assert least(COLOURS, eyes) > 13
    assert least(COLOURS[:4], eyes) > 22


def test_what_was_wrong_is_found(eyes):
    """Orange and green of the palette before were as good as the same to protanopes."""
    before = least(("#e08214", "#4d9221"), eyes)
    assert before < 4 if eyes == "protanopia" else before > 4


def test_what_means_something_is_told_apart(eyes):
    assert least((GOOD, BAD), eyes) > 25
    assert least((*PATHS, FORCE, SUM_OF_FORCES), eyes) > 13
    assert least((COLOURS[0], COLOURS[1], RED), eyes) > 25  # value, reference and limit


@pytest.mark.parametrize("plate", PLATES)
def test_curves_stand_out_from_the_page(plate):
    """At least two to one, as contrast is told, on the page's white and on the pendant's dark."""
    ground = luminance(PLATES[plate])
    for colour in COLOURS:
        low, high = sorted((ground, luminance(colour)))
        assert (high + 0.05) / (low + 0.05) > 2, colour


def test_more_than_four_curves_have_lines_of_other_kinds(eyes):
    shown = looks(32)

    assert len(set(shown)) == 32
    assert {line for _, line in shown[:4]} == {"-"}
    for kind in {line for _, line in shown}:
        for half in (shown[:16], shown[16:]):
            assert least([colour for colour, line in half if line == kind], eyes) > 13
