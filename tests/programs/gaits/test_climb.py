"""Strides over stairs, gaps and thresholds: where soles go, what they clear, and that a robot gets over."""

import numpy as np
import pytest

from simrob_drake import LeggedRobot, load_station
from simrob_drake.errors import SimrobError
from simrob_drake.interpolation import stacked
from simrob_drake.programs.gaits.climb import Climb
from simrob_drake.programs.gaits.feet import facing_rotation
from simrob_drake.programs.gaits.treads import SoleMargins, profile_ahead
from simrob_drake.programs.gaits.walker import Walker

SOLE = SoleMargins(half=0.07, margin=0.02, overhang=0.03)
SOLES = {"controllers": {}, "robot.feet": "soles", "contact.model": "hydroelastic_with_fallback", "floor.size": 8}
STAIRS = {"kind": "stairs", "height": 0.025, "size": 0.25, "length": 0.25, "start": 0.12, "heading_deg": 90}


def way(*edges, distance=2.0):
    """Return a way with the heights behind places along it, ``(place, height)``, on both sides of it."""
    places, heights = np.array([place for place, _ in edges]), np.array([0.0, *(height for _, height in edges)])
    return profile_ahead(
        lambda at: heights[np.searchsorted(places, at[:, 0], side="right")], distance, np.array([-0.1, 0.1])
    )


def strides(ground, longest=0.1, distance=2.0):
    """Return the strides from 0 to a distance."""
    place, found = 0.0, []
    while (stride := ground.next_stride(place, SOLE, longest, distance)) is not None:
        found.append(stride)
        place = stride.place
    return found


def places(found):
    return [round(each.place, 2) for each in found]


def test_treads_are_the_level_stretches():
    found = way((0.2, 0.03), (0.5, 0.0)).treads
    assert [round(each.height, 3) for each in found] == [0.0, 0.03, 0.0]
    np.testing.assert_allclose([(each.begin, each.end) for each in found[:2]], [(-0.3, 0.2), (0.2, 0.5)], atol=0.003)
    inclined = profile_ahead(lambda at: 0.1 * at[:, 0], 1.0, np.array([-0.1, 0.1]))
    assert inclined.next_stride(0.0, SOLE, 0.1, 1.0) is None
    across = profile_ahead(lambda at: 0.1 * at[:, 1], 1.0, np.array([-0.1, 0.1]))
    assert across.treads == []


def test_toes_keep_from_what_rises_and_heels_hang_over_what_is_lower():
    up = strides(way((0.2, 0.03)), distance=0.6)
    # toes up to 0.18, then heels at 0.17 on the tread
    assert places(up) == [0.1, 0.24, 0.34, 0.44, 0.54, 0.6]
    rising = next(each for each in up if each.height > 0)
    assert rising.place - SOLE.half == pytest.approx(0.2 - SOLE.overhang, abs=0.004)
    assert max(each.place for each in up if not each.height) + SOLE.half == pytest.approx(0.2 - SOLE.margin, abs=0.015)
    down = strides(way((-0.2, 0.03), (0.2, 0.0)), distance=0.6)
    falling = next(each for each in down if each.height < 0.01)
    assert falling.place - SOLE.half == pytest.approx(0.2 + SOLE.margin, abs=0.004)
    before = max(each.place for each in down if each.height > 0.01)
    assert before + SOLE.half == pytest.approx(0.2 + SOLE.overhang, abs=0.004)


def test_gaps_and_thresholds_are_stepped_over():
    gap = strides(way((0.2, -0.05), (0.26, 0.0)), distance=0.6)
    assert not any(each.height < 0 for each in gap)
    over = next(each for each in gap if each.place - SOLE.half > 0.2)
    assert over.place - SOLE.half == pytest.approx(0.26 - SOLE.overhang, abs=0.004)
    assert over.over == 0.0
    bar = strides(way((0.2, 0.04), (0.25, 0.0)), distance=0.6)
    over = next(each for each in bar if each.place > 0.2)
    assert over.over == pytest.approx(0.04)
    assert over.place - SOLE.half == pytest.approx(0.25 + SOLE.margin, abs=0.004)
    assert all(each.place + SOLE.half < 0.2 - SOLE.margin + 0.004 for each in bar if each.place < 0.2)


def test_what_is_too_short_for_a_sole_is_no_foothold():
    narrow = way((0.2, 0.03), (0.28, 0.06), distance=1.0)
    assert 0.03 not in [round(each.height, 2) for each in strides(narrow, distance=1.0)]
    pits = way(*[(0.2 + 0.05 * number, -0.05 * (number % 2 == 0)) for number in range(40)], distance=1.0)
    assert places(strides(pits, distance=1.0))[-1] < 0.25
    assert not pits.reaches(0.2, 1.0)


def soles_of(motion, walker, kind):
    """Return the poses of the soles' middles of a motion, in walking direction, by foot; and the feet."""
    facing = facing_rotation(walker.gaits.facing_deg)
    roots = stacked(motion.root[:, :3, 3] @ facing.T, facing @ motion.root[:, :3, :3])
    feet = {foot.name: foot for foot in walker.feet(kind)}
    return {name: foot.poses(motion.positions, roots) for name, foot in feet.items()}, feet


@pytest.mark.parametrize("rise", [0.025, -0.025, 0.0])
def test_soles_clear_the_edge_and_the_weight_is_over_the_one_that_stands(rise):
    walker, half = Walker.of("zjudancer"), 0.0735
    left = {foot.name: foot.home[1] for foot in walker.feet("soles")}
    edge = half + (0.02 if rise >= 0 else -0.035)
    ahead = edge + half + (-0.035 if rise >= 0 else 0.02)
    motion = Climb.planned(
        "zjudancer", 0, "climb",
        start={name: (0.0, at, 0.0, 0.0) for name, at in left.items()},
        goals={name: (ahead, at, rise, 0.0) for name, at in left.items()},
    )  # fmt: skip
    poses, feet = soles_of(motion, walker, "soles")
    origin = poses["left_foot"][0, :3, 3] - [0.0, left["left_foot"], feet["left_foot"].over]
    masses, points = (
        walker.skeleton.point_masses,
        walker.skeleton.mass_points(walker.skeleton.frames(motion.positions, motion.root)),
    )
    for name, pose in poses.items():
        (other,) = (each for each in poses if each != name)
        middle = pose[:, :3, 3] - origin
        sole = middle[:, 2] - feet[name].over
        for end in (-half, half):
            ground = rise * (middle[:, 0] + end > edge)
            stands = abs(sole - rise) < 1e-6 if end < 0 else abs(sole) < 1e-6
            assert ((sole > ground - 1e-6) | (stands & (abs(middle[:, 0] + end - edge) < 0.036))).all()
        swings = sole > max(rise, 0.0) + 0.02
        assert swings.any()
        standing = poses[other][swings, :3, 3] - origin
        com = np.einsum("k,mkx->mx", masses, points[swings]) / masses.sum()
        facing = facing_rotation(walker.gaits.facing_deg)
        com = com @ facing.T - origin
        assert (abs(com[:, 0] - standing[:, 0]) < feet[other].half[0]).all()
        assert (abs(com[:, 1] - standing[:, 1]) < feet[other].half[1]).all()
    for pose in poses.values():
        assert pose[-1, 2, 3] - pose[0, 2, 3] == pytest.approx(rise, abs=1e-6)
        assert pose[-1, 0, 3] - pose[0, 0, 3] == pytest.approx(ahead, abs=1e-6)
    assert motion.root[-1, 2, 3] - motion.root[0, 2, 3] == pytest.approx(rise, abs=2e-3)


def test_a_robot_climbs_a_step_and_comes_down_again():
    robot = LeggedRobot(load_station("zjudancer_walking", {**SOLES, "floor.terrain": STAIRS}))
    result = robot.do({"climb": {"distance": 0.55}})
    assert (result.ending, result.did) == ("completed", "climb 0.55 m")
    assert robot.base_pose.translation() == pytest.approx([0.0, 0.55, 0.48], abs=0.012)
    on_top = np.abs(result["base.y"] - 0.245) < 0.01
    assert np.median(result["base.z"][on_top]) == pytest.approx(0.505, abs=0.005)


@pytest.mark.parametrize(
    ("changes", "move", "message"),
    [
        ({"robot.feet": "spheres"}, {}, "feet of zjudancer is spheres; it must be soles with edges"),
        ({"floor.terrain": {**STAIRS, "height": 0.08}}, {}, r"the move: 0\.\d\d m ahead: .*"),
        (
            {"floor.terrain": {**STAIRS, "size": 0.1, "length": 1.0}},
            {"distance": 1.2},
            r"distance is 1\.2 m; .*0\.147 m",
        ),
        ({"floor.terrain": None, "floor.incline_deg": 5}, {}, "the ground beyond has no level place"),
        ({}, {"distance": 101}, "at most 100 m"),
        ({}, {"margins": 0.1}, "'margins'; did you mean 'margin'"),
        ({}, {"gait": "clim"}, "act of zjudancer 'clim'"),
    ],
)
def test_what_cannot_be_climbed_is_told_before_anything_moves(changes, move, message):
    robot = LeggedRobot(load_station("zjudancer_walking", {**SOLES, "floor.terrain": STAIRS, **changes}))
    with pytest.raises(SimrobError, match=message):
        robot.do({"climb": {"distance": 0.55, **move}})
    assert robot.cell.timeline.now == 0.0
