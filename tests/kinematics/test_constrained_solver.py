"""The nonlinear program: each goal as a constraint and as a wish, measured on the forward kinematics."""

import numpy as np
import pytest

from simrob_drake.base.errors import InvalidParameter, UnknownName
from simrob_drake.base.frames import transform_from_pose
from simrob_drake.kinematics import (
    Aiming,
    Chain,
    ConstrainedSolver,
    DistanceBounds,
    JointBounds,
    OrientationCone,
    PositionBounds,
    Unreachable,
    require,
)

MET = 1e-5  # m: what the program's tolerance of 1e-8 gives, in whatever unit the constraint has


@pytest.fixture
def chain(irb120_chain):
    """The irb120 with a gripper's tool centre point, turned by 90°."""
    return irb120_chain.with_tool([0, 0, 0.07, np.pi / 2, 0, 0])


@pytest.fixture
def target(chain, home):
    return chain.forward(home + np.array([0.3, 0.2, -0.1, 0.1, -0.2, 0.1]))


def _angle(one, other):
    return np.arccos(np.clip(one @ other, -1, 1))


def test_pose(chain, random_postures, home):
    targets = chain.forward(random_postures(chain, 40))
    solutions = ConstrainedSolver(chain).solve(targets, np.tile(home, (40, 1)))

    assert solutions.reached.mean() > 0.9
    reached = solutions.reached
    np.testing.assert_allclose(
        chain.forward(solutions.positions)[reached], targets[reached], atol=1e-4
    )
    assert (solutions.positions >= chain.lower).all()
    assert (solutions.positions <= chain.upper).all()


def test_the_posture_near_the_start_is_found(chain, random_postures):
    postures = 0.6 * random_postures(chain, 20)
    found = require(ConstrainedSolver(chain).solve(chain.forward(postures), postures))
    np.testing.assert_allclose(found, postures, atol=1e-3)


def test_position_only(chain, target, home):
    solutions = ConstrainedSolver(chain, target="position").solve(target, home)
    np.testing.assert_allclose(
        chain.forward(require(solutions))[0, :3, 3], target[0, :3, 3], atol=MET
    )


def test_position_bounds_in_a_frame(chain, home):
    frame = np.array([0.4, 0.133, 0.0, -2.0, 0.1, 0.2])
    box = PositionBounds(lower=(0.1, 0.05, 0.2), upper=(0.2, 0.1, 0.25), frame=frame)
    found = require(ConstrainedSolver(chain, [box], target="free").solve(np.zeros(6), home))

    inside = transform_from_pose(frame).inverse() @ chain.forward(found)[0, :3, 3]

    assert (inside >= np.array(box.lower) - MET).all()
    assert (inside <= np.array(box.upper) + MET).all()


def test_orientation_cone(chain, target, home):
    cone = OrientationCone(direction=(0, 0, -1), angle=0.1)
    found = chain.forward(
        require(ConstrainedSolver(chain, [cone], target="position").solve(target, home))
    )[0]

    assert _angle(found[:3, 2], np.array([0, 0, -1])) <= 0.1 + 1e-6
    np.testing.assert_allclose(found[:3, 3], target[0, :3, 3], atol=MET)


def test_aiming(chain, target, home):
    lamp = np.array([0.5, 0.5, 0.0])
    aim = Aiming(target=tuple(lamp), axis=(0.0, 0.0, 1.0))

    found = chain.forward(
        require(ConstrainedSolver(chain, [aim], target="position").solve(target, home))
    )[0]

    ray = lamp - found[:3, 3]
    assert _angle(found[:3, 2], ray / np.linalg.norm(ray)) < 1e-4  # the cone's figures are squares


@pytest.mark.parametrize("aside", [-0.1, 0.1])
def test_a_tool_beside_the_flange_aims_from_its_own_centre_point(irb120_chain, target, home, aside):
    chain = irb120_chain.with_tool([aside, 0.0, 0.07, 0.0, 0.0, 0.0])
    lamp = np.array([0.5, 0.5, 0.0])
    aim = Aiming(target=tuple(lamp), axis=(0.0, 0.0, 1.0))

    solutions = ConstrainedSolver(chain, [aim], target="position").solve(target, home)

    found = chain.forward(require(solutions))[0]
    ray = lamp - found[:3, 3]
    assert _angle(found[:3, 2], ray / np.linalg.norm(ray)) < 1e-4  # the cone's figures are squares


def test_joint_bounds_and_fixed_joints(chain, target, home):
    goals = [
        JointBounds.at_position("joint_2", 0.0),
        JointBounds(axis="joint_4", lower=0.2, upper=0.3),
    ]
    found = require(ConstrainedSolver(chain, goals, target="position").solve(target, home))[0]

    assert found[1] == pytest.approx(0.0, abs=1e-8)
    assert 0.2 - 1e-8 <= found[3] <= 0.3 + 1e-8


def test_axes_with_signs(irb120_chain, home):
    place = irb120_chain.in_plant
    signs = np.array([1, -1, 1, 1, -1, 1])
    turned = Chain.of_plant(
        place.plant, joints=place.joints, base=place.base, tool=place.tool, signs=signs
    )
    goal = JointBounds(axis="joint_2", lower=0.2, upper=0.4)
    target = turned.forward(signs * home)

    found = require(
        ConstrainedSolver(turned, [goal], target="position").solve(target, signs * home)
    )

    assert 0.2 - 1e-8 <= found[0, 1] <= 0.4 + 1e-8
    np.testing.assert_allclose(turned.forward(found)[0, :3, 3], target[0, :3, 3], atol=MET)


def test_distance_between_bodies(chain, target, home):
    goal = DistanceBounds(frames=("tool", "link_2"), lower=0.5, upper=0.52)
    found = require(ConstrainedSolver(chain, [goal], target="free").solve(target, home))
    place = chain.in_plant
    shoulder = Chain.of_plant(
        place.plant, joints=place.joints, base=place.base, tool=place.plant.GetFrameByName("link_2")
    )

    away = np.linalg.norm((chain.forward(found) - shoulder.forward(found))[0, :3, 3])

    assert 0.5 - MET <= away <= 0.52 + MET


def test_low_target_against_a_floor_is_weighed(chain, home):
    """SimRob's example: the tool is sent to z = 50 mm and wished above 100 mm with ten times the weight."""
    target = chain.forward(home)
    target[0, 2, 3] = 0.05
    floor = PositionBounds(lower=(-np.inf, -np.inf, 0.1), weight=(0.0, 0.0, 10.0))

    solutions = ConstrainedSolver(chain, [floor], target_weights=(1.0, 1.0)).solve(target, home)

    assert solutions.reached[0]  # a wish is met as well as can be

    height = chain.forward(solutions.positions)[0, 2, 3]
    # minimum of (z-.05)² + 10 (z-.1)²
    assert height == pytest.approx((1 * 0.05 + 10 * 0.1) / 11, abs=2e-5)
    assert solutions.position_error[0] == pytest.approx(height - 0.05, abs=1e-4)


def test_fixed_joint_against_the_pose_is_weighed(chain, target, home):
    """SimRob's other example: joint 2 wished at 0 with weight 10, which the pose cannot have."""
    loose, firm = (
        ConstrainedSolver(
            chain,
            [JointBounds.at_position("joint_2", 0.0, weight=weight)],
            target_weights=(1.0, 1.0),
        )
        .solve(target, home)
        .positions[0, 1]
        for weight in (1e-3, 10.0)
    )
    assert abs(firm) < 0.02 < abs(loose)


@pytest.mark.parametrize(
    "goal",
    [
        OrientationCone(direction=(0, 0, -1), angle=0.1, weight=1.0),
        Aiming(target=(0.5, 0.5, 0.0), weight=1.0),
        DistanceBounds(frames=("tool", "base"), upper=0.3, weight=1.0),
    ],
)
def test_wishes_give_way_to_constraints(chain, target, home, goal):
    found = require(ConstrainedSolver(chain, [goal]).solve(target, home))
    np.testing.assert_allclose(chain.forward(found), target, atol=1e-4)


def test_incompatible_constraints_are_named(chain, target, home):
    goals = [PositionBounds(lower=(2.0, -np.inf, -np.inf))]
    with pytest.raises(Unreachable, match=r"satisfies .*(PositionBounds|target position)"):
        require(ConstrainedSolver(chain, goals, restarts=2).solve(target, home))


def test_other_joints_of_the_plant_stay(irb120_chain, home):
    place = irb120_chain.in_plant
    elbow = place.plant.GetFrameByName("link_3")
    short = Chain.of_plant(place.plant, joints=place.joints[:3], base=place.base, tool=elbow)
    target = short.forward([0.3, 0.4, -0.2])

    found = require(ConstrainedSolver(short, target="position").solve(target, [0.2, 0.3, 0.0]))

    np.testing.assert_allclose(found[0, :2], [0.3, 0.4], atol=1e-4)


@pytest.mark.parametrize(
    ("goal", "error", "said"),
    [
        (JointBounds.at_position("joint2", 0.0), UnknownName, "did you mean 'joint_2'"),
        (DistanceBounds(frames=("tool", "link2")), UnknownName, "did you mean 'link_2'"),
        (DistanceBounds(frames=("tool", "base"), lower=-1.0), InvalidParameter, "0 or more"),
        (JointBounds(axis="joint_1", lower=1.0, upper=0.0), InvalidParameter, "not smaller"),
        (PositionBounds(lower=(0.0, 0.0)), InvalidParameter, "3 numbers"),
        (PositionBounds(weight=(1.0, 1.0)), InvalidParameter, "weight of PositionBounds"),
        (PositionBounds(weight=-1.0), InvalidParameter, "weight of PositionBounds"),
        (PositionBounds(frame=np.zeros((2, 6))), InvalidParameter, "one pose"),
        (OrientationCone(direction=(0, 0, 0), angle=0.1), InvalidParameter, "other than zero"),
        (OrientationCone(direction=(0, 0, 1), angle=4.0), InvalidParameter, "angle"),
        (Aiming(target=(0, 0, np.nan)), InvalidParameter, "three finite"),
        (Aiming(target=(0, 0, 0), angle=2.0), InvalidParameter, "angle"),
        ("keep level", InvalidParameter, "goals"),
    ],
)
def test_bad_goals(chain, goal, error, said):
    with pytest.raises(error, match=said):
        ConstrainedSolver(chain, [goal])


@pytest.mark.parametrize(
    ("options", "error"),
    [
        ({"target": "poses"}, UnknownName),
        ({"target_weights": (1.0,)}, InvalidParameter),
        ({"target_weights": (1.0, -1.0)}, InvalidParameter),
        ({"nearness": -1.0}, InvalidParameter),
        ({"restarts": -1}, InvalidParameter),
    ],
)
def test_bad_settings(chain, options, error):
    with pytest.raises(error):
        ConstrainedSolver(chain, **options)


@pytest.mark.parametrize("axis", [(0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.0, -1.0, 0.0)])
def test_the_axis_of_a_cone_is_one_of_the_tool_however_that_is_mounted(
    irb120_chain, target, home, axis
):
    chain = irb120_chain.with_tool([0.0, 0.0, 0.07, 0.4, -0.7, 0.3])
    down = np.array([0.0, 0.0, -1.0])
    cone = OrientationCone(direction=tuple(down), angle=0.1, axis=axis)

    found = chain.forward(
        require(ConstrainedSolver(chain, [cone], target="position").solve(target, home))
    )[0]

    assert _angle(found[:3, :3] @ axis, down) <= 0.1 + 1e-6
