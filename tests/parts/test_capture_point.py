"""The capture point against its definition, by other means: differences of places, and a convex hull."""

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from simrob_drake import Station
from simrob_drake.base.errors import InvalidParameter
from simrob_drake.parts.controllers.postures import CapturePoint


@pytest.fixture(scope="module")
def standing():
    """The humanoid's plant, a context of it, and the robot."""
    ports = Station("humanoid_dynamic").ports
    plant = ports.plant.plant
    return plant, plant.CreateDefaultContext(), next(iter(ports.plant.robots.values()))


def capture_point(plant, context, robot, state):
    """Return place and velocity of the mass by differences of a small time, and what follows."""
    q, v = state[: plant.num_positions()], state[plant.num_positions() :]
    step, places = 1e-6, []
    for sign in (-1, 1):
        plant.SetPositions(context, q + sign * step * plant.MapVelocityToQDot(context, v))
        places.append(plant.CalcCenterOfMassPositionInWorld(context, [robot.instance]))
    plant.SetPositions(context, q)
    mass = plant.CalcCenterOfMassPositionInWorld(context, [robot.instance])
    points = np.vstack(
        [
            (
                plant.GetFrameByName(foot).CalcPoseInWorld(context)
                @ robot.feet.support_points(foot).T
            ).T
            for foot in ("left_foot", "right_foot")
        ]
    )
    speed = (places[1] - places[0]) / (2 * step)
    return mass[:2] + speed[:2] * np.sqrt((mass[2] - points[:, 2].min()) / 9.80665), points[:, :2]


@pytest.mark.parametrize("ahead", [0.2, 0.9, 1.5])
def test_how_far_the_capture_point_is_outside_of_the_feet(standing, ahead):
    plant, context, robot = standing
    state = plant.GetPositionsAndVelocities(plant.CreateDefaultContext())
    # of the trunk [m/s]
    state[plant.num_positions() + np.array([3, 4, 5])] = [
        0.7 * ahead,
        -ahead,
        -0.2,
    ]
    plant.SetPositionsAndVelocities(context, state)
    place, points = capture_point(plant, context, robot, state)
    hull = points[ConvexHull(points).vertices]
    starts, ways = hull, np.roll(hull, -1, axis=0) - hull
    along = np.clip(((place - starts) * ways).sum(1) / (ways**2).sum(1), 0, 1)
    distance = np.linalg.norm(place - starts - along[:, np.newaxis] * ways, axis=1).min()
    inside = (ConvexHull(points).equations @ [*place, 1] < 0).all()
    found = CapturePoint(plant, robot, "guard").distance_from_feet(state)
    assert inside == (found < 0)
    assert inside == (ahead == 0.2)
    if not inside:
        assert found == pytest.approx(distance, rel=0.0014)


def test_a_robot_without_feet_has_none():
    ports = Station("irb120_dynamic").ports
    with pytest.raises(
        InvalidParameter, match=r"guard\.capture_point: irb120 has no feet; leave it out"
    ):
        CapturePoint(ports.plant.plant, ports.plant.robots["robot"], "guard.capture_point")
