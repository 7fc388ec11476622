"""Every posture for a pose: each reaches it, the one that it was made of is among them, and two ways find the same."""

import numpy as np
import pytest

from simrob_drake.base.errors import InvalidParameter, UnknownName
from simrob_drake.kinematics import Chain, NoClosedForm, branches
from simrob_drake.kinematics.every_branch import goal_postures

REACHED = 1e-8  # m and rad
SEARCH = "simrob_drake.kinematics.every_branch.AnalyticSolver"


def _apart(postures, posture):
    """How far postures are from another one, whole turns apart or not."""
    return np.abs(np.exp(1j * postures) - np.exp(1j * posture)).max(axis=-1)


def _check(
    chain, found, targets, postures, within=1e-5
):  # near singular ones half of the digits go
    for rows, target, posture in zip(found, targets, postures, strict=True):
        assert np.abs(chain.forward(rows) - target).max() < REACHED
        assert _apart(rows, posture).min() < within
        assert len(rows) % 2 == 0
        apart = _apart(rows[:, np.newaxis], rows)
        assert apart[~np.eye(len(rows), dtype=bool)].min() > 1e-4


@pytest.fixture
def without_closed_forms(monkeypatch):
    def refuse(chain):
        raise NoClosedForm("left out")

    monkeypatch.setattr(SEARCH, refuse)


@pytest.mark.parametrize("name", ["ur5", "irb120", "kr6"])
def test_a_thousand_poses_in_closed_form(name, dh_chain, random_postures, tables):
    chain = dh_chain(tables[name])
    postures = random_postures(chain, 1000)
    targets = chain.forward(postures)
    found = branches(chain, targets, np.zeros(6))

    _check(chain, found, targets, postures)

    counts = {len(rows) for rows in found}
    assert counts == {"ur5": {2, 4, 6, 8}, "kr6": {4, 8}}.get(name, {8})


@pytest.mark.long
def test_seven_axes_with_one_held_at_each_angle(dh_chain, random_postures, tables):
    chain = dh_chain(tables["iiwa"], limit=2.9)
    for held in (0, 2):  # the foot, or what swings the elbow
        for angle in (-2.5, -0.8, 0.3, 1.7):
            postures = random_postures(chain, 15)
            postures[:, held] = angle
            targets = chain.forward(postures)
            found = branches(chain, targets, np.zeros(7), {chain.names[held]: angle})
            _check(chain, found, targets, postures)
            assert all((rows[:, held] == angle).all() for rows in found)


def test_seven_axes_hold_the_third_of_the_start_unless_told(dh_chain, tables):
    chain = dh_chain(tables["iiwa"], limit=2.9)
    start = np.array([0.3, 0.5, 0.4, -1.2, 0.2, 0.9, -0.1])

    found = branches(chain, chain.forward(start), start)[0]

    assert (found[:, 2] == 0.4).all()
    assert _apart(found, start).min() < 1e-8
    assert len(found) == 8


def test_a_slide_is_held_and_the_arm_on_it_as_alone(dh_chain, random_postures, tables, belt):
    chain, alone = dh_chain(tables["irb120"], slide=belt), dh_chain(tables["irb120"])
    posture = np.concatenate([[0.3], random_postures(alone, 1)[0]])
    found = branches(chain, chain.forward(posture), posture)[0]

    expected = branches(alone, alone.forward(posture[1:]), posture[1:])[0]

    assert (found[:, 0] == 0.3).all()
    assert len(found) == len(expected) == 8
    assert all(_apart(found[:, 1:], row).min() < 1e-6 for row in expected)


def test_any_six_axes(dh_chain, random_postures, tables):
    chain = dh_chain(tables["odd"])
    postures = random_postures(chain, 40)
    targets = chain.forward(postures)
    found = branches(chain, targets, np.zeros(6))

    _check(chain, found, targets, postures)

    assert max(map(len, found)) > 8


@pytest.mark.parametrize("name", ["ur5", "kr6"])
def test_search_and_closed_form_find_the_same(name, dh_chain, random_postures, tables, request):
    chain = dh_chain(tables[name])
    targets = chain.forward(np.vstack([random_postures(chain, 30), np.zeros((1, 6))]))
    start = np.full(6, 0.1)
    expected = branches(chain, targets, start)
    request.getfixturevalue("without_closed_forms")

    found = branches(chain, targets, start)

    assert [len(rows) for rows in found] == [len(rows) for rows in expected]
    for rows, truth in zip(
        found[:-1], expected[:-1], strict=True
    ):  # at zero a straight wrist has endless ones
        assert all(_apart(rows, row).min() < 1e-5 for row in truth)


def test_a_straight_wrist_gives_the_posture_of_the_family_that_is_nearest(
    irb120_chain, home, without_closed_forms
):
    posture = home + np.array([0.2, 0.1, -0.3, 0.5, -np.pi / 2, 0.4])
    start = posture + np.array([0.0, 0.0, 0.0, 0.3, 0.0, 0.1])
    found = branches(irb120_chain, irb120_chain.forward(posture), start)[0]

    same = found[_apart(found[:, :3], posture[:3]) < 1e-3]

    assert len(same) == 1  # not a hundred of the family
    # the sum of axes 4 and 6 is given: 0.9
    np.testing.assert_allclose(same[0, 3:], [0.6, 0.0, 0.3], atol=1e-3)


def test_beyond_limits_too_and_whole_turns_near_the_start(irb120_chain, home):
    found = branches(
        irb120_chain, irb120_chain.forward(home), home + np.array([0, 0, 0, 0, 0, 2 * np.pi])
    )[0]

    assert _apart(found, home).min() < 1e-9
    assert (found < irb120_chain.lower).any() or (found > irb120_chain.upper).any()
    assert np.abs(found[:, 5] - 2 * np.pi).max() <= np.pi + 1e-9


def test_nothing_where_nothing_reaches(irb120_chain, dh_chain, tables, home):
    far = irb120_chain.forward(home)
    far[0, 0, 3] += 2.0

    assert branches(irb120_chain, far, home)[0].shape == (0, 6)
    assert branches(dh_chain(tables["odd"]), far, home)[0].shape == (0, 6)


def test_bad_holds(irb120_chain, home):
    with pytest.raises(UnknownName, match="did you mean 'joint_3'"):
        branches(irb120_chain, irb120_chain.forward(home), home, {"joint3": 0.1})
    with pytest.raises(InvalidParameter, match="held: joint_3 is nan; it must be a finite number"):
        branches(irb120_chain, irb120_chain.forward(home), home, {"joint_3": np.nan})


def test_axes_that_do_not_move_the_tool_stay_in_all_goals_of_a_planner(irb120_chain):
    """With a tool at the elbow, the three axes of the wrist move nothing of it."""
    place = irb120_chain.in_plant
    elbow = place.plant.GetFrameByName("link_3")
    chain = Chain.of_plant(place.plant, joints=place.joints, base=place.base, tool=elbow)
    start = np.array([0.1, 0.0, 0.0, 0.7, -0.5, 0.3])
    targets = chain.forward([[0.3, 0.4, -0.2, 0.0, 0.0, 0.0], [-0.4, 0.2, 0.1, 0.0, 0.0, 0.0]])

    found = goal_postures(chain, targets, start)

    assert len(found) >= 2  # one of each target at least
    assert found[:, 3:] == pytest.approx(np.tile(start[3:], (len(found), 1)), abs=1e-9)
