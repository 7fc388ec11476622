"""Strides over stairs, gaps and thresholds: where soles go, what they clear, and that a robot gets over."""

import numpy as np
import pytest
import yaml

from simrob_drake import LeggedRobot, load_station
from simrob_drake.base.errors import SimrobError
from simrob_drake.base.interpolation import stack_poses
from simrob_drake.programs.gaits.climb import Climb
from simrob_drake.programs.gaits.climb_footholds import (
    BallFootholds,
    SoleMargins,
    is_at_goal,
    profile_ahead,
)
from simrob_drake.programs.gaits.walker import Walker, facing_rotation
from simrob_drake.programs.legged_gait import planned_gait

SOLE = SoleMargins(half=0.07, margin=0.02, overhang=0.03)
SOLES = {
    "controllers": {},
    "robot.feet": "soles",
    "contact.model": "hydroelastic_with_fallback",
    "floor.size": 8,
}
STAIRS = {
    "kind": "stairs",
    "height": 0.025,
    "size": 0.25,
    "length": 0.25,
    "start": 0.12,
    "heading_deg": 90,
}


def way(*edges, distance=2.0):
    """Return a way with the heights behind places along it, ``(place, height)``, on both sides of it."""
    places, heights = (
        np.array([place for place, _ in edges]),
        np.array([0.0, *(height for _, height in edges)]),
    )
    return profile_ahead(
        lambda at: heights[np.searchsorted(places, at[:, 0], side="right")],
        distance,
        np.array([-0.1, 0.1]),
    )


def strides(ground, longest=0.1, distance=2.0):
    """Return the strides from 0 to a distance."""
    place, found = 0.0, []
    while (stride := ground.next_stride(place, SOLE, longest, distance)) is not None:
        found.append(stride)
        place = stride.position
    return found


def places(found):
    return [round(each.position, 2) for each in found]


def test_treads_are_the_level_stretches():
    found = way((0.2, 0.03), (0.5, 0.0)).treads

    assert [round(each.height, 3) for each in found] == [0.0, 0.03, 0.0]
    np.testing.assert_allclose(
        [(each.begin, each.end) for each in found[:2]], [(-0.3, 0.2), (0.2, 0.5)], atol=0.003
    )

    inclined = profile_ahead(lambda at: 0.1 * at[:, 0], 1.0, np.array([-0.1, 0.1]))
    assert inclined.next_stride(0.0, SOLE, 0.1, 1.0) is None

    across = profile_ahead(lambda at: 0.1 * at[:, 1], 1.0, np.array([-0.1, 0.1]))
    assert across.treads == []


def test_toes_keep_from_what_rises_and_heels_hang_over_what_is_lower():
    up = strides(way((0.2, 0.03)), distance=0.6)

    # toes up to 0.18, then heels at 0.17 on the tread
    assert places(up) == [0.1, 0.24, 0.34, 0.44, 0.54, 0.6]

    rising = next(each for each in up if each.height > 0)
    assert rising.position - SOLE.half == pytest.approx(0.2 - SOLE.overhang, abs=0.004)
    assert max(each.position for each in up if not each.height) + SOLE.half == pytest.approx(
        0.2 - SOLE.margin, abs=0.015
    )

    down = strides(way((-0.2, 0.03), (0.2, 0.0)), distance=0.6)
    falling = next(each for each in down if each.height < 0.01)

    assert falling.position - SOLE.half == pytest.approx(0.2 + SOLE.margin, abs=0.004)
    before = max(each.position for each in down if each.height > 0.01)
    assert before + SOLE.half == pytest.approx(0.2 + SOLE.overhang, abs=0.004)


def test_gaps_and_thresholds_are_stepped_over():
    gap = strides(way((0.2, -0.05), (0.26, 0.0)), distance=0.6)

    assert not any(each.height < 0 for each in gap)

    over = next(each for each in gap if each.position - SOLE.half > 0.2)
    assert over.position - SOLE.half == pytest.approx(0.26 - SOLE.overhang, abs=0.004)
    assert over.over == 0.0

    bar = strides(way((0.2, 0.04), (0.25, 0.0)), distance=0.6)
    over = next(each for each in bar if each.position > 0.2)

    assert over.over == pytest.approx(0.04)
    assert over.position - SOLE.half == pytest.approx(0.25 + SOLE.margin, abs=0.004)
    assert all(
        each.position + SOLE.half < 0.2 - SOLE.margin + 0.004 for each in bar if each.position < 0.2
    )


def test_what_is_too_short_for_a_sole_is_no_foothold():
    narrow = way((0.2, 0.03), (0.28, 0.06), distance=1.0)

    assert 0.03 not in [round(each.height, 2) for each in strides(narrow, distance=1.0)]

    pits = way(
        *[(0.2 + 0.05 * number, -0.05 * (number % 2 == 0)) for number in range(40)], distance=1.0
    )
    assert places(strides(pits, distance=1.0))[-1] < 0.25
    assert not is_at_goal(0.2, 1.0)


def soles_of(motion, walker, kind):
    """Return the poses of the soles' middles of a motion, in walking direction, by foot; and the feet."""
    facing = facing_rotation(walker.gaits.facing_deg)
    roots = stack_poses(motion.root[:, :3, 3] @ facing.T, facing @ motion.root[:, :3, :3])
    feet = {foot.name: foot for foot in walker.feet(kind)}
    return {name: foot.poses(motion.positions, roots) for name, foot in feet.items()}, feet


@pytest.mark.parametrize("rise", [0.025, -0.025, 0.0])
def test_soles_clear_the_edge_and_the_weight_is_over_the_one_that_stands(rise):
    walker, half = Walker.of("zjudancer"), 0.0735
    left = {foot.name: foot.home[1] for foot in walker.feet("soles")}
    edge = half + (0.02 if rise >= 0 else -0.035)
    ahead = edge + half + (-0.035 if rise >= 0 else 0.02)
    motion = Climb.plan_by_name(
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
            assert (
                (sole > ground - 1e-6) | (stands & (abs(middle[:, 0] + end - edge) < 0.036))
            ).all()
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


def test_four_feet_roll_on_their_heights_with_the_weight_between_the_three_that_stand():
    walker, rises = Walker.of("yobotics"), {"front_left_foot": 0.04, "front_right_foot": 0.04}
    feet = {foot.name: foot for foot in walker.feet(None)}
    start = {
        name: (foot.home[0], foot.home[1], 0.04 * name.startswith("front"), 0.0)
        for name, foot in feet.items()
    }
    goals = {
        name: (x + 0.12, y, z + rises.get(name, 0.04), 0.0) for name, (x, y, z, _) in start.items()
    }
    motion = Climb.plan_by_name("yobotics", 0, "climb", start=start, goals=goals, over=0.08)
    poses, _ = soles_of(motion, walker, None)

    step, points = (
        motion.times[1],
        walker.skeleton.mass_points(walker.skeleton.frames(motion.positions, motion.root)),
    )

    com = np.einsum("k,mkx->mx", walker.skeleton.point_masses, points) / walker.skeleton.mass
    assert motion.root[-1, 2, 3] - motion.root[0, 2, 3] == pytest.approx(0.04, abs=1e-6)
    assert motion.root[0, 2, 3] == pytest.approx(0.30 + 0.02)
    for name, pose in poses.items():
        height = pose[:, 2, 3] - feet[name].over
        low, high = start[name][2], goals[name][2]
        assert (height[0], height[-1]) == pytest.approx((low, high), abs=1e-6)
        assert height.max() == pytest.approx(0.08 + Climb.of(walker, "climb", {}).lift, abs=1e-3)
        # while it stands, the point that touches is at rest: v + ω × (-r e_z) = 0
        turned = pose[1:, :3, :3] @ pose[:-1, :3, :3].transpose(0, 2, 1)
        spin = np.stack(
            [turned[:, 2, 1] - turned[:, 1, 2], turned[:, 0, 2] - turned[:, 2, 0]], axis=1
        ) / (2 * step)
        touching = np.diff(pose[:, :2, 3], axis=0) / step - feet[name].over * np.column_stack(
            [spin[:, 1], -spin[:, 0]]
        )
        up = (
            (height > min(low, high) + 1e-9)
            & (abs(height - high) > 1e-9)
            & (abs(height - low) > 1e-9)
        )
        stands = ~up[1:] & ~up[:-1] & ~np.roll(up[1:], 2) & ~np.roll(up[1:], -2)
        assert np.linalg.norm(touching[stands], axis=1).max() < 0.01
        others = np.array([poses[each][:, :2, 3] for each in poses if each != name])[:, up]
        for corners, weight in zip(others.transpose(1, 0, 2), com[up, :2], strict=True):
            sides = np.roll(corners, -1, axis=0) - corners
            turns = sides[:, 0] * (weight - corners)[:, 1] - sides[:, 1] * (weight - corners)[:, 0]
            assert (turns > 0).all() or (turns < 0).all()


def four_feet(height, **changes):
    """Return the footholds of yobotics on a ground ``height(places)`` for 2 m, and where its feet stand at first."""
    walker = Walker.of("yobotics")
    feet = {foot.name: foot for foot in walker.feet(None)}
    middle = np.mean([foot.home[:2] for foot in feet.values()], axis=0)
    places = {name: np.array([*(foot.home[:2] - middle), 0.0]) for name, foot in feet.items()}
    return BallFootholds(Climb.of(walker, "climb", changes), feet, height, 2.0), places


def all_of(footholds, places):
    """Return all strides from places on."""
    found = []
    while (stride := footholds.next(places)) is not None:
        found.append(stride)
        places = stride.goals
    return found


def test_each_of_four_feet_finds_even_ground_near_its_place():
    def pits(at):  # of 60 mm, between 0.25 m
        return np.where((at[:, 0] % 0.31 > 0.25) & (at[:, 0] > 0.25), -0.1, 0.0)

    footholds, places = four_feet(pits)
    found = all_of(footholds, places)
    for stride in found:
        for name, goal in stride.goals.items():
            corners = goal[:2] + np.array(
                [[x, y] for x in (-0.014, 0.014) for y in (-0.014, 0.014)]
            )
            assert (pits(corners) == 0.0).all(), name
            assert np.hypot(*(goal - places[name])[:2]) < 0.12 + 2 * 0.06
        assert set(stride.heights.values()) == {0.0}
        places = stride.goals
    middles = [np.mean([place[0] for place in stride.goals.values()]) for stride in found]
    assert np.diff(middles).min() > 0.02
    assert middles[-1] == pytest.approx(2.0, abs=0.03)

    level, places = four_feet(lambda at: 0.0 * at[:, 0])
    stride = level.next(places)
    for name, goal in stride.goals.items():
        assert goal - places[name] == pytest.approx([0.12, 0, 0], abs=1e-9)
    for aside, left in ((0.015, 0.0), (-0.05, -0.03)):
        stride = level.next(
            {name: place + np.array([0, aside, 0]) for name, place in places.items()}
        )
        assert np.mean([goal[1] for goal in stride.goals.values()]) == pytest.approx(left)
    with pytest.raises(SimrobError, match="no even place for"):
        all_of(four_feet(lambda at: 0.7 * np.clip(at[:, 0] - 0.5, 0.0, 0.5))[0], places)
    # pits as far apart as the feet: with short strides all come back to where they were
    apart = places["front_left_foot"][0] - places["rear_left_foot"][0]
    ditches = four_feet(
        lambda at: np.where(((at[:, 0] - 0.25) % apart < 0.06) & (at[:, 0] > -0.15), -0.1, 0.0),
        stride=0.05,
    )
    with pytest.raises(SimrobError, match="no even places for the feet farther ahead"):
        all_of(ditches[0], places)
    wall = four_feet(lambda at: np.where(at[:, 0] > 0.5, 0.1, 0.0))[0]
    with pytest.raises(
        SimrobError, match=r"no even place for front_\w+_foot within 0.085 m of height"
    ):
        all_of(wall, places)
    over = four_feet(lambda at: 0.03 * ((at[:, 0] > 0.24) & (at[:, 0] < 0.26)))
    assert over[0].next(over[1]).over == 0.03


@pytest.mark.long
def test_a_robot_on_four_legs_crosses_gaps():
    gaps = {
        "kind": "gaps",
        "height": 0.1,
        "size": 0.25,
        "gap": 0.06,
        "length": 0.6,
        "start": 0.3,
        "seed": 4,
    }
    robot = LeggedRobot(
        load_station("yobotics_walking", {"controllers": {}, "floor.terrain": gaps})
    )

    result = robot.do({"climb": {"distance": 0.7}})

    assert result.ending == "completed"
    assert robot.base_pose.translation() == pytest.approx([0.7, 0.0, 0.3], abs=0.02)
    assert result["base.z"].min() > 0.28


@pytest.mark.long
def test_a_robot_climbs_a_step_and_comes_down_again():
    robot = LeggedRobot(load_station("zjudancer_walking", {**SOLES, "floor.terrain": STAIRS}))
    result = robot.do({"climb": {"distance": 0.55}})

    assert (result.ending, result.did) == ("completed", "climb 0.55 m")
    assert robot.base_pose.translation() == pytest.approx([0.0, 0.55, 0.48], abs=0.012)
    on_top = np.abs(result["base.y"] - 0.245) < 0.01
    assert np.median(result["base.z"][on_top]) == pytest.approx(0.505, abs=0.005)


@pytest.mark.long
def test_hips_come_down_where_a_stride_is_long():
    robot = LeggedRobot(load_station("zjudancer_walking", SOLES))
    heights = [
        planned_gait(robot, "climb", {"stride": way}, bends=True).root[0, 2, 3]
        for way in (0.15, 0.16)
    ]

    assert heights == pytest.approx([0.48, 0.48 * 0.97])
    with pytest.raises(SimrobError, match=r"left_foot is 3\.\d+ mm too short"):
        planned_gait(robot, "climb", {"stride": 0.16})
    # as high as it goes, too, it is out of reach: that is told
    with pytest.raises(SimrobError, match=r"left_foot is 6\.\d+ mm too short"):
        planned_gait(robot, "climb", {"stride": 0.18}, bends=True)


@pytest.mark.parametrize("move", [{"act": "climb"}, {"climb": {"distance": 0.06}}], ids=str)
def test_a_climb_on_spheres_is_refused_as_an_act_and_as_a_move(move):
    robot = LeggedRobot(load_station("zjudancer_dynamic"))
    with pytest.raises(SimrobError, match=r"it must be box soles, .*: --set robot\.feet=soles$"):
        robot.do(move)
    assert robot.runs == []


def test_the_feet_of_a_climber_among_others_are_chosen_in_its_own_section(tmp_path):
    both = {
        name: {"model": "zjudancer", "base": [x, 0, 0.538, 0, 0, 0]}
        for name, x in (("a", 0.0), ("b", 1.0))
    }
    file = tmp_path / "two.yaml"

    file.write_text(
        yaml.safe_dump({"robots": both, "floor": {"size": 3}, "contact": {"model": "point"}})
    )

    with pytest.raises(SimrobError, match=r": --set robots\.b\.feet=soles$"):
        planned_gait(LeggedRobot(load_station(file), "b"), "climb", {})


@pytest.mark.parametrize(
    ("changes", "move", "message"),
    [
        (
            {"robot.feet": "spheres"},
            {},
            "kind of feet of zjudancer is spheres; it must be box soles",
        ),
        ({"floor.terrain": {**STAIRS, "height": 0.08}}, {}, r"the move: 0\.\d\d m ahead: .*"),
        (
            {"floor.terrain": {**STAIRS, "size": 0.1, "length": 1.0}},
            {"distance": 1.2},
            r"distance is 1\.2 m; .*0\.147 m",
        ),
        (
            {"floor.terrain": None, "floor.incline_deg": 5},
            {},
            "the ground beyond has no level place",
        ),
        ({}, {"distance": 101}, "at most 100 m"),
        ({}, {"margins": 0.1}, "'margins'; did you mean 'margin'"),
        ({}, {"gait": "clim"}, "act of zjudancer 'clim'"),
    ],
)
def test_what_cannot_be_climbed_is_told_before_anything_moves(changes, move, message):
    robot = LeggedRobot(
        load_station("zjudancer_walking", {**SOLES, "floor.terrain": STAIRS, **changes})
    )
    with pytest.raises(SimrobError, match=message):
        robot.do({"climb": {"distance": 0.55, **move}})
    assert robot.cell.timeline.now == 0.0
