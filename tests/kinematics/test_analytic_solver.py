"""The closed form: round trips against forward kinematics, all branches, limits, turns and singular postures."""

from types import SimpleNamespace

import numpy as np
import pytest

from simrob_drake.base.errors import UnknownName
from simrob_drake.kinematics import AnalyticSolver, NoClosedForm, Unreachable, require
from simrob_drake.kinematics.closed_form import _closest_total

PROMISED = 1e-9  # m and rad


def _error(chain, postures, targets):
    return np.abs(chain.forward(postures) - targets).max()


def test_round_trip_of_the_irb120(irb120_chain, random_postures, home):
    targets = irb120_chain.forward(random_postures(irb120_chain, 10_000))
    solutions = AnalyticSolver(irb120_chain).solve(targets, np.tile(home, (len(targets), 1)))

    assert solutions.reached.all()
    assert _error(irb120_chain, solutions.positions, targets) < PROMISED
    assert (solutions.positions >= irb120_chain.lower).all()
    assert (solutions.positions <= irb120_chain.upper).all()


@pytest.mark.parametrize("name", ["puma560", "tx40", "ur5"])
def test_round_trip_with_offset_shoulders(name, dh_chain, random_postures, tables):
    chain = dh_chain(tables[name])
    postures = random_postures(chain, 2000)
    targets = chain.forward(postures)

    solutions = AnalyticSolver(chain).solve(targets, postures)

    assert solutions.reached.all()
    assert _error(chain, solutions.positions, targets) < PROMISED
    # near singular ones lose half the digits
    np.testing.assert_allclose(solutions.positions, postures, atol=1e-6)


@pytest.mark.parametrize("name", ["irb120", "puma560", "tx40", "ur5"])
def test_all_eight_postures_reach_the_target(name, dh_chain, random_postures, tables):
    chain = dh_chain(tables[name], limit=2 * np.pi)
    targets = chain.forward(random_postures(chain, 300))

    postures, reach = AnalyticSolver(chain).postures(targets, np.zeros(6))

    if (
        name == "ur5"
    ):  # its wrist bends the way to the shoulder: some poses leave the triangle of axes 2, 3, 4 open
        assert (reach.sum(axis=1) % 2 == 0).all()
        assert reach.any(axis=1).all()
    else:
        assert reach.all()  # every pose has eight, as no limit is in the way
    assert _error(chain, postures[reach], np.repeat(targets, reach.sum(axis=1), axis=0)) < PROMISED
    apart = np.abs(
        np.exp(1j * postures[:, :, np.newaxis]) - np.exp(1j * postures[:, np.newaxis])
    ).max(axis=-1)
    both = reach[:, :, np.newaxis] & reach[:, np.newaxis] & ~np.eye(8, dtype=bool)
    assert (apart[both] > 1e-6).all()


@pytest.mark.parametrize("flipped", [(1,), (2,), (1, 2)])
def test_parallel_axes_may_point_against_each_other(flipped, dh_chain, random_postures, tables):
    rows = [
        (*row[:3], np.pi if index in flipped else row[3]) for index, row in enumerate(tables["ur5"])
    ]
    chain = dh_chain(rows)
    postures = 0.9 * random_postures(chain, 200)
    postures[::4, 4] = 0.0  # a straight wrist keeps the sum of the start
    targets = chain.forward(postures)

    found = require(AnalyticSolver(chain).solve(targets, postures))

    assert _error(chain, found, targets) < PROMISED
    np.testing.assert_allclose(found, postures, atol=1e-6)


def test_limits_are_kept_and_counted(irb120_chain, random_postures):
    targets = irb120_chain.forward(random_postures(irb120_chain, 500))
    postures, reach = AnalyticSolver(irb120_chain).postures(targets, np.zeros(6))

    within = ((postures >= irb120_chain.lower) & (postures <= irb120_chain.upper)).all(axis=-1)
    np.testing.assert_array_equal(reach, within)
    assert reach.any(axis=1).all()


def test_the_nearest_posture_is_taken(irb120_chain, random_postures):
    postures = random_postures(irb120_chain, 2000)
    near = np.clip(postures + 0.01, irb120_chain.lower, irb120_chain.upper)

    solutions = AnalyticSolver(irb120_chain).solve(irb120_chain.forward(postures), near)

    away = np.linalg.norm(solutions.positions - near, axis=1)
    assert (away <= np.linalg.norm(postures - near, axis=1) + 1e-6).all()


def test_whole_turns_of_joint_6(irb120_chain, home):
    solver = AnalyticSolver(irb120_chain)

    for turned in (-6.5, -3.5, 3.5, 6.5):
        posture = home + np.array([0.1, 0.2, -0.3, 0.1, -0.5, turned])
        found = solver.solve(irb120_chain.forward(posture), posture).positions[0]
        np.testing.assert_allclose(found, posture, atol=1e-9)

    beyond = home + np.array([0, 0, 0, 0, 0, 6.9])
    found = solver.solve(
        irb120_chain.forward(beyond + np.array([0, 0, 0, 0, 0, 0.3])), beyond
    ).positions[0]

    np.testing.assert_allclose(found[5], 7.2 - 2 * np.pi, atol=1e-9)  # 412° is too far, 52° is not


def test_in_order_each_from_the_last(irb120_chain, home):
    turns = np.linspace(0, 6.9, 60)[:, np.newaxis] * [0, 0, 0, 0, 0, 1]
    path = home + np.array([0.1, 0.2, -0.3, 0.4, -0.5, 0]) + turns

    found = AnalyticSolver(irb120_chain).solve(irb120_chain.forward(path), path[0]).positions

    np.testing.assert_allclose(found, path, atol=1e-9)


FLAGS = [(s, e, w) for s in ("right", "left") for e in ("up", "down") for w in ("no_flip", "flip")]


@pytest.mark.parametrize("name", ["irb120", "puma560", "tx40", "ur5"])
@pytest.mark.parametrize(("shoulder", "elbow", "wrist"), FLAGS)
def test_flags_are_what_they_say(name, shoulder, elbow, wrist, dh_chain, random_postures, tables):
    """Seen in the plane of the arm, from the places of the joints' frames that Drake reports."""
    chain = dh_chain(tables[name], limit=2 * np.pi)
    place = chain.in_plant
    context = place.plant.CreateDefaultContext()
    targets = chain.forward(random_postures(chain, 20))

    solutions = AnalyticSolver(chain, shoulder=shoulder, elbow=elbow, wrist=wrist).solve(
        targets, np.zeros(6)
    )

    assert solutions.reached.mean() > 0.7
    for posture in solutions.positions[solutions.reached]:
        place.plant.SetPositions(context, posture)
        axes = [joint.frame_on_parent().CalcPose(context, place.base) for joint in place.joints]
        up, second = axes[0].rotation().matrix()[:, 2], axes[1].rotation().matrix()[:, 2]
        centre, end = (axes[place].translation() for place in ((5, 3) if name == "ur5" else (4, 4)))
        ahead = centre - axes[0].translation()
        ahead -= up * (up @ ahead)
        side = second * (second @ ahead)  # along axis 2, where the wrist is offset
        ahead -= side
        ahead /= np.linalg.norm(ahead)
        if np.linalg.norm(side) > 1e-6:
            assert (side @ np.cross(ahead, up) > 0) == (shoulder == "right")
        arm, elbow_at = end - axes[1].translation(), axes[2].translation() - axes[1].translation()
        above = (arm @ ahead) * (elbow_at @ up) - (arm @ up) * (elbow_at @ ahead)
        assert (above > 0) == (elbow == "up")
        assert (np.sin(posture[4]) > 0) == (wrist == "no_flip")


def test_home_is_right_up_no_flip(irb120_chain, home):
    targets = irb120_chain.forward(home)
    flagged = AnalyticSolver(irb120_chain, shoulder="right", elbow="up", wrist="no_flip")
    np.testing.assert_allclose(require(flagged.solve(targets, np.zeros(6)))[0], home, atol=1e-9)


def test_singular_wrist_keeps_joint_4(irb120_chain, random_postures):
    postures = random_postures(irb120_chain, 200)
    postures[:, 4] = 0.0
    postures[:, 5] *= 0.5
    targets = irb120_chain.forward(postures)
    starts = postures + np.array([0, 0, 0, 0.05, 0.1, 0])
    starts[:, 3] = np.clip(starts[:, 3], -2.7, 2.7)
    solver = AnalyticSolver(irb120_chain)

    each = solver.solve(targets, starts)

    assert each.reached.all()
    assert _error(irb120_chain, each.positions, targets) < PROMISED
    straight = np.abs(each.positions[:, 4]) < 1e-9
    assert straight.mean() > 0.9  # for some poses another shoulder or elbow lies nearer
    np.testing.assert_array_equal(each.positions[straight, 3], starts[straight, 3])

    in_order = solver.solve(np.repeat(targets[:1], 3, axis=0), starts[0]).positions
    np.testing.assert_allclose(in_order, np.tile(in_order[0], (3, 1)), atol=1e-9)


@pytest.mark.parametrize("angle", [1e-13, 1e-11, 1e-9, 1e-7, 1e-5])
def test_nearly_singular_wrist_loses_no_digits(irb120_chain, random_postures, angle):
    postures = random_postures(irb120_chain, 200)
    postures[:, 4] = angle
    postures[:, 5] *= 0.5

    targets = irb120_chain.forward(postures)

    assert AnalyticSolver(irb120_chain).solve(targets, postures).reached.all()

    found = AnalyticSolver(irb120_chain).solve(targets, postures).positions
    assert _error(irb120_chain, found, targets) < PROMISED


@pytest.mark.parametrize("angle", [0.0, 1e-13, 1e-11, 1e-9, 1e-7])
def test_a_cobot_with_axis_6_along_axis_4_keeps_the_sum_of_the_parallel_ones(
    angle, dh_chain, random_postures, tables
):
    chain = dh_chain(tables["ur5"])
    postures = 0.5 * random_postures(chain, 200)
    postures[:, 4] = angle
    targets, starts = chain.forward(postures), postures + np.array([0, 0.02, -0.03, 0.05, 0.1, 0])

    found = require(AnalyticSolver(chain).solve(targets, starts))

    assert _error(chain, found, targets) < PROMISED
    if angle < 1e-10:
        kept = np.abs((found - starts)[:, 1:4].sum(axis=1)) < 1e-9
        # some cannot keep it, as stretched arms; for some another posture lies nearer
        assert kept.mean() > 0.8


def test_wrist_above_axis_1_keeps_joint_1(dh_chain, tables):
    chain = dh_chain(tables["irb120"])
    posture = np.array([0.4, -0.5, 0.0, 0.3, 0.6, -0.2])
    elbow, fore = 0.27 * np.sin(posture[1]), np.hypot(0.07, 0.302)
    # so that the wrist is over axis 1
    posture[2] = -posture[1] - np.arctan2(0.302, 0.07) - np.arcsin(elbow / fore)
    targets = chain.forward(posture)

    found = AnalyticSolver(chain).solve(targets, posture + np.array([0.2, 0, 0, 0, 0, 0]))

    assert found.reached.all()
    assert _error(chain, found.positions, targets) < PROMISED
    np.testing.assert_allclose(found.positions[0, 0], 0.6, atol=1e-9)


@pytest.mark.parametrize("name", ["irb120", "ur5"])
def test_rounded_figures_are_polished_away(name, dh_chain, random_postures, tables):
    # alpha = 1.5708, as URDFs have it
    rough = [tuple(round(value, 4) for value in row) for row in tables[name]]
    chain = dh_chain(rough)
    postures = 0.5 * random_postures(chain, 200)
    targets = chain.forward(postures)

    solutions = AnalyticSolver(chain).solve(targets, postures)

    assert solutions.reached.all()
    assert _error(chain, solutions.positions, targets) < PROMISED


def test_a_wrist_without_right_angles_takes_a_posture_that_turns_the_tool(dh_chain, tables):
    """Some postures bring the wrist to its place, but cannot turn the tool: they neither count nor are they taken."""
    rows = list(tables["irb120"])
    offset, d, a, _ = rows[4]
    rows[4] = (offset, d, a, -np.pi / 3)  # axis 6 is 60 degrees from axis 5
    chain = dh_chain(rows)
    targets = chain.forward(np.random.default_rng(1).uniform(-1.5, 1.5, (50, 6)))
    solver = AnalyticSolver(chain)

    postures, is_good = solver.postures(targets, np.zeros(6))

    misses = np.abs(chain.forward(postures.reshape(-1, 6)).reshape(50, 8, 4, 4) - targets[:, None])
    is_near = misses.max(axis=(2, 3)) < 1e-9
    assert (is_near[is_good]).all()
    assert (~is_near).any()
    # Each start is a posture that misses the orientation, so that another posture is farther from it.
    missing = np.argwhere(~is_near & is_good.any(axis=1, keepdims=True))
    starts = postures[missing[:, 0], missing[:, 1]]
    assert solver.solve(targets[missing[:, 0]], starts).reached.all()


def test_other_tools_and_oblique_feet(irb120_chain, random_postures):
    chain = irb120_chain.with_tool([0.02, -0.03, 0.148, 0.5, 0.3, -0.2])
    postures = random_postures(chain, 200)

    targets = chain.forward(postures)

    assert (
        _error(chain, require(AnalyticSolver(chain).solve(targets, postures)), targets) < PROMISED
    )


def test_out_of_reach_says_how_far(irb120_chain, home):
    targets = np.repeat(irb120_chain.forward(home), 3, axis=0)
    targets[1, 0, 3] += 1.0

    solutions = AnalyticSolver(irb120_chain).solve(targets, home)

    assert solutions.reached.tolist() == [True, False, True]
    centre = targets[1, :3, 3] - 0.072 * targets[1, :3, 2]
    short = np.linalg.norm(centre - [0, 0, 0.29]) - (0.27 + np.hypot(0.07, 0.302))
    assert solutions.position_error[1] == pytest.approx(short, abs=1e-9)  # stretched towards it
    with pytest.raises(
        Unreachable, match=rf"points\[1\] .* out of reach: .* {short:.3g} m"
    ) as caught:
        require(solutions, "points")
    assert caught.value.index == 1
    assert caught.value.position_error == solutions.position_error[1]


def test_beyond_limits_names_the_joint(irb120_chain, home):
    turned = home + np.array([3.0, 0, 0, 0, 0, 0])  # 172°, where joint 1 ends at 165°
    solver = AnalyticSolver(irb120_chain, shoulder="right", elbow="up", wrist="no_flip")
    with pytest.raises(
        Unreachable,
        match=r"joint limit: all postures with these flags exceed a limit; "
        r"in the best posture, joint_1 is 0\.12 rad",
    ):
        require(solver.solve(irb120_chain.forward(turned), home))


def test_no_closed_form(dh_chain, tables, belt, irb120_chain):
    for name, row, a, count in (("irb120", 4, 0.01, 3), ("ur5", 4, 0.01, 2)):
        offset = list(tables[name])
        offset[row] = (*offset[row][:2], a, offset[row][3])
        with pytest.raises(
            NoClosedForm,
            match=f"the last {count} axes do not meet in a point: they miss it by 0.00",
        ):
            AnalyticSolver(dh_chain(offset))
    with pytest.raises(NoClosedForm, match="7 axes, revolute or prismatic, move the tool"):
        AnalyticSolver(dh_chain(tables["irb120"], slide=belt))
    skewed = list(tables["irb120"])
    skewed[1] = (skewed[1][0], 0, 0.27, 0.1)
    with pytest.raises(NoClosedForm, match="axis 3 is not parallel to axis 2"):
        AnalyticSolver(dh_chain(skewed))


def test_unknown_flag(irb120_chain):
    with pytest.raises(UnknownName, match="did you mean 'no_flip'"):
        AnalyticSolver(irb120_chain, wrist="noflip")


@pytest.mark.parametrize("distance", [0.2, 0.5, 0.7, 0.9])
def test_the_hand_of_a_parallel_wrist_turns_until_the_forearm_reaches(distance):
    """Axes 2 and 3 reach from |upper| - |fore| to |upper| + |fore|, here 0.1 to 0.7 m, which the hand must leave them.

    The desired sum stays if the way to the hand is in this range.
    """
    arm = SimpleNamespace(upper=0.4 + 0j, fore=0.3 + 0j, hand=0.2 + 0j)
    target = np.full((1, 2, 1, 1), distance + 0j)
    desired = np.array([0.1])

    total = _closest_total(arm, target, desired)

    left_for_arm = np.abs(target - arm.hand * np.exp(1j * total))
    assert (left_for_arm >= 0.1 - 1e-9).all()
    assert (left_for_arm <= 0.7 + 1e-9).all()
    is_in_reach = 0.1 <= abs(distance - 0.2 * np.exp(0.1j)) <= 0.7
    assert np.allclose(total, 0.1) == is_in_reach
