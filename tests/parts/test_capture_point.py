"""Capture point: against its definition, by differences of positions and a convex hull."""

from typing import NamedTuple

import numpy as np
import pytest
from pydrake.multibody.plant import MultibodyPlant
from scipy.spatial import ConvexHull

from simrob_drake import Station
from simrob_drake.base.errors import InvalidParameter
from simrob_drake.base.frames import Vector
from simrob_drake.parts.controllers.postures import CapturePoint
from simrob_drake.parts.station_plant import StationRobot


class Standing(NamedTuple):
    """A humanoid in its plant."""

    plant: MultibodyPlant
    robot: StationRobot


@pytest.fixture(scope="module")
def standing():
    plant = Station("humanoid_dynamic").ports.plant
    return Standing(plant=plant.plant, robot=next(iter(plant.robots.values())))


class Reference(NamedTuple):
    """Capture point and contact points of the feet, computed by differences of positions.

    Attributes:
        capture_point: capture point, shape (2,) [m].
        feet: contact points of both feet, shape (k, 2) [m].
    """

    capture_point: Vector
    feet: Vector


def compute_reference(standing, state):
    """Compute the capture point from positions of the centre of mass a little before and after."""
    plant, robot = standing
    context = plant.CreateDefaultContext()
    plant.SetPositionsAndVelocities(context, state)
    positions = state[: plant.num_positions()]
    rates = plant.MapVelocityToQDot(context, state[plant.num_positions() :])
    step = 1e-6

    def com_at(time):
        plant.SetPositions(context, positions + time * rates)
        return plant.CalcCenterOfMassPositionInWorld(context, [robot.instance])

    velocity = (com_at(step) - com_at(-step)) / (2 * step)
    com = com_at(0.0)
    soles = []
    for foot in ("left_foot", "right_foot"):
        pose = plant.GetFrameByName(foot).CalcPoseInWorld(context)
        soles.append((pose @ robot.feet.support_points(foot).T).T)
    points = np.vstack(soles)
    height = com[2] - points[:, 2].min()
    capture_point = com[:2] + velocity[:2] * np.sqrt(height / 9.80665)
    return Reference(capture_point=capture_point, feet=points[:, :2])


def distance_from_edges(point, corners):
    """Distance of a point (2,) from the edges of a polygon, given by its corners (k, 2) in order [m]."""
    edges = np.roll(corners, -1, axis=0) - corners
    # The nearest point of each edge, as a part of the edge.
    parts = np.clip(((point - corners) * edges).sum(1) / (edges**2).sum(1), 0, 1)
    nearest = corners + parts[:, np.newaxis] * edges
    return np.linalg.norm(point - nearest, axis=1).min()


@pytest.mark.parametrize(("speed", "is_inside"), [(0.2, True), (0.9, False), (1.5, False)])
def test_the_distance_of_the_capture_point_from_the_area_of_the_feet(standing, speed, is_inside):
    plant, robot = standing
    state = plant.GetPositionsAndVelocities(plant.CreateDefaultContext())
    trunk_velocity = plant.num_positions() + np.array([3, 4, 5])
    state[trunk_velocity] = [0.7 * speed, -speed, -0.2]

    distance = CapturePoint(plant, robot, "guard").distance_from_feet(state)

    reference = compute_reference(standing, state)
    hull = ConvexHull(reference.feet)
    assert (hull.equations @ [*reference.capture_point, 1] < 0).all() == is_inside
    assert (distance < 0) == is_inside
    if not is_inside:
        corners = reference.feet[hull.vertices]
        expected = distance_from_edges(reference.capture_point, corners)
        assert distance == pytest.approx(expected, rel=0.0014)


def test_a_robot_without_feet_has_no_capture_point():
    ports = Station("irb120_dynamic").ports
    with pytest.raises(
        InvalidParameter, match=r"guard\.capture_point: irb120 has no feet; leave it out"
    ):
        CapturePoint(ports.plant.plant, ports.plant.robots["robot"], "guard.capture_point")
