"""A station that is put into configurations: its frames and shapes follow."""

from types import SimpleNamespace

import numpy as np
import pytest

from simrob_drake import load_station
from simrob_drake.kinematics import Chain
from simrob_drake.stations.posed import PosedStation, posture_range


@pytest.mark.parametrize("mode", ["kinematic", "dynamic"])
def test_shapes_follow_the_robot(mode: str) -> None:
    posed = PosedStation(load_station(f"irb120_{mode}"))
    q = np.array([0.3, -0.2, 0.4, 0.1, 0.7, -0.5])
    robot = posed.station.robots["robot"]
    posed.place_robots({"robot": q})
    body = robot.tools[robot.tcp].body()
    shown = posed.query().GetPoseInWorld(posed.plant.GetBodyFrameIdOrThrow(body.index()))
    chain = Chain.of_plant(posed.plant, joints=robot.joints, base=posed.plant.world_frame(), tool=body.body_frame())
    np.testing.assert_allclose(shown.GetAsMatrix4(), chain.forward(q)[0], atol=1e-12)
    posed.place(posed.initial)
    np.testing.assert_allclose(robot.axis_map.positions(posed.initial), robot.initial, atol=1e-15)
    again = posed.query().GetPoseInWorld(posed.plant.GetBodyFrameIdOrThrow(body.index()))
    np.testing.assert_allclose(again.GetAsMatrix4(), chain.forward(robot.initial)[0], atol=1e-12)


def test_robots_that_are_not_placed_stay() -> None:
    posed = PosedStation(load_station("two_irb120"))
    one, other = posed.station.robots.values()
    posed.place_robots({one.name: one.initial + 0.1})
    posed.place_robots({other.name: other.initial - 0.1})
    for robot, wanted in ((one, one.initial + 0.1), (other, other.initial - 0.1)):
        frame = robot.tools[robot.tcp].body()
        chain = Chain.of_plant(
            posed.plant, joints=robot.joints, base=posed.plant.world_frame(), tool=frame.body_frame()
        )
        shown = posed.query().GetPoseInWorld(posed.plant.GetBodyFrameIdOrThrow(frame.index()))
        np.testing.assert_allclose(shown.GetAsMatrix4(), chain.forward(wanted)[0], atol=1e-12)


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
    lower, upper = np.array(limits)[:, np.newaxis]
    robot = SimpleNamespace(model=SimpleNamespace(prismatic=(False,), axis_limits=(lower, upper)))
    found = posture_range(robot)
    assert (float(found[0][0]), float(found[1][0])) == bounds
