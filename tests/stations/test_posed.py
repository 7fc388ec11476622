"""A station for geometry queries: its shapes follow the postures that its robots are set to."""

from types import SimpleNamespace

import numpy as np
import pytest

from simrob_drake import load_station
from simrob_drake.kinematics import Chain
from simrob_drake.parts.station_plant import StationRobot
from simrob_drake.stations.posed import PosedStation, posture_range


def assert_shapes_are_at(posed: PosedStation, robot: StationRobot, posture: np.ndarray) -> None:
    """Check that the shapes of a robot's last link are where forward kinematics puts them in a posture (n,) [rad]."""
    plant = posed.plant
    body = robot.tools[robot.tcp].body()
    chain = Chain.of_plant(
        plant, joints=robot.joints, base=plant.world_frame(), tool=body.body_frame()
    )
    pose = posed.query().GetPoseInWorld(plant.GetBodyFrameIdOrThrow(body.index()))
    np.testing.assert_allclose(pose.GetAsMatrix4(), chain.forward(posture)[0], atol=1e-12)


@pytest.mark.parametrize("mode", ["kinematic", "dynamic"])
def test_shapes_follow_the_robot(mode: str) -> None:
    """Shapes move with the posture of a robot, and back with the positions of the whole plant."""
    posed = PosedStation(load_station(f"irb120_{mode}"))
    robot = posed.station.robots["robot"]
    posture = np.array([0.3, -0.2, 0.4, 0.1, 0.7, -0.5])

    posed.place_robots({"robot": posture})
    assert_shapes_are_at(posed, robot, posture)

    posed.place(posed.initial)
    assert_shapes_are_at(posed, robot, robot.initial)
    np.testing.assert_allclose(robot.axis_map.positions(posed.initial), robot.initial, atol=1e-15)


def test_robots_that_are_not_placed_stay() -> None:
    """A robot stays in its posture while another one is moved."""
    posed = PosedStation(load_station("two_irb120"))
    first, second = posed.station.robots.values()

    posed.place_robots({first.name: first.initial + 0.1})
    posed.place_robots({second.name: second.initial - 0.1})

    assert_shapes_are_at(posed, first, first.initial + 0.1)
    assert_shapes_are_at(posed, second, second.initial - 0.1)


@pytest.mark.parametrize(
    ("limits", "bounds"),
    [
        ((-1.0, 2.0), (-1.0, 2.0)),
        ((-np.inf, np.inf), (-np.pi, np.pi)),
        ((4.0, 5.0), (4.0, 5.0)),
        ((4.0, np.inf), (4.0, 4.0 + 2 * np.pi)),
        ((-np.inf, -4.0), (-4.0 - 2 * np.pi, -4.0)),
    ],
)
def test_random_postures_are_within_limits_that_are_far_from_zero(limits, bounds) -> None:
    """Bounds are the limits of an axis, cut to a window of one turn that is as near to zero as they allow."""
    lower, upper = np.array(limits)[:, np.newaxis]
    robot = SimpleNamespace(model=SimpleNamespace(prismatic=(False,), axis_limits=(lower, upper)))

    found = posture_range(robot)

    assert (float(found[0][0]), float(found[1][0])) == bounds
