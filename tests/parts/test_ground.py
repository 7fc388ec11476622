"""The ground against Drake's own distances, and what stands, walks and falls on an incline."""

import numpy as np
import pytest
from pydrake.math import RigidTransform, RotationMatrix

from simrob_drake import load_station, simulate
from simrob_drake.base.frames import transform_from_pose
from simrob_drake.parts.ground import Ground
from simrob_drake.results.animation.camera import walked_displacement
from simrob_drake.results.record.walks import locomotion
from simrob_drake.stations.checks import check_station
from simrob_drake.stations.posed import PosedStation
from simrob_drake.stations.resolve import resolve

PLATE = {"model": "board", "parent": "world", "pose": [0.3, 0.1, 0.2, 0.4, 0.2, 0.3]}
SLOPE = {"floor.incline_deg": 5.0, "floor.heading_deg": 30.0}


def test_the_floor_rises_where_it_is_headed():
    ground = Ground(np.deg2rad(10), np.deg2rad(90))
    points = np.array([[0.0, 2.0, 0.0], [3.0, 0.0, 5.0], [0.0, -1.0, 0.0]])
    np.testing.assert_allclose(
        ground.beneath(points), np.tan(np.deg2rad(10)) * np.array([2.0, 0.0, -1.0]), atol=1e-15
    )
    np.testing.assert_allclose(
        ground.floor_pose.rotation().matrix() @ [0, 1, 0],
        [0, np.cos(np.pi / 18), np.sin(np.pi / 18)],
        atol=1e-15,
    )
    assert not ground.is_level_plane


def test_a_level_floor_changes_nothing():
    np.testing.assert_array_equal(Ground().floor_pose.GetAsMatrix4(), np.eye(4))
    assert Ground().is_level_plane


def test_tops_of_boxes_are_where_drake_has_their_surfaces():
    """On the surface, the distance to what is there is zero; just above, it is not, and there is no box between."""
    station = load_station("humanoid_dynamic", {"pieces.plate": PLATE, **SLOPE, "sensors": {}})
    ground = resolve(station).ground
    posed = PosedStation(station)
    rng = np.random.default_rng(3)
    points = np.column_stack([rng.uniform(-0.3, 0.7, (300, 2)), np.full(300, 2.0)])
    heights, floor = ground.beneath(points), ground.floor_heights(points)
    on = points[heights > floor + 1e-6] * [1, 1, 0] + np.outer(
        heights[heights > floor + 1e-6], [0, 0, 1]
    )
    assert 20 < len(on) < 280
    inspector = posed.station.scene_graph.model_inspector()
    for point in on:
        near = posed.query().ComputeSignedDistanceToPoint(point, threshold=1e-9)
        assert any("plate" in inspector.GetName(found.id_G) for found in near)
        above = posed.query().ComputeSignedDistanceToPoint(
            point + np.array([0, 0, 1e-4]), threshold=0.0
        )
        assert above == []


def test_boxes_above_a_point_are_not_beneath_it():
    beam = (RigidTransform([0, 0, 1.0]), np.array([0.5, 0.5, 0.1]))
    ground = Ground(boxes=(beam,))
    np.testing.assert_allclose(
        ground.beneath(np.array([[0, 0, 0.5], [0, 0, 1.4], [0.6, 0, 1.4]])), [0, 1.1, 0]
    )
    assert Ground(has_floor=False, boxes=(beam,)).carries(np.array([[0.4, 0, 1.1]]), 0.05)
    assert not Ground(has_floor=False, boxes=(beam,)).carries(
        np.array([[0.4, 0, 1.1], [0.6, 0, 1.1]]), 0.05
    )
    assert not Ground(has_floor=False, boxes=(beam,)).carries(np.array([[0.4, 0, 0.8]]), 0.05)


def test_a_piece_that_hangs_on_a_fixed_one_is_ground_and_a_free_or_carried_one_is_not():
    pieces = {
        "pieces.plate": PLATE,
        "pieces.on_it": {"model": "box", "parent": "plate", "frame": "tcp"},
        "pieces.loose": {
            "model": "box",
            "parent": "world",
            "free": True,
            "pose": [2, 0, 1, 0, 0, 0],
        },
        "pieces.held": {"model": "box", "parent": "robot"},
    }
    station = resolve(load_station("humanoid_dynamic", pieces))
    shapes = {
        name: sum(shape.box is not None for shape in piece.model.shapes)
        for name, piece in station.pieces.items()
    }
    assert len(station.ground.boxes) == shapes["plate"] + shapes["on_it"]
    place, _ = station.ground.boxes[-1]
    tcp = transform_from_pose(PLATE["pose"]) @ transform_from_pose(
        station.pieces["plate"].model.tcp
    )
    own = transform_from_pose(station.pieces["on_it"].model.shapes[-1].pose)
    assert place.IsNearlyEqualTo(tcp @ own, 1e-12)


@pytest.mark.parametrize("name", ["humanoid", "roid1", "zjudancer", "yobotics"])
def test_robots_stand_on_a_slope_as_they_begin(name):
    station = load_station(f"{name}_dynamic", SLOPE)
    assert not [finding for finding in check_station(station) if finding.level == "warning"]
    result = simulate(station, duration=1.0, progress=False)
    assert result.ending == "completed"
    start, end = result.pose("base")[[0, -1], :3]
    assert np.linalg.norm(end - start) < 0.01
    ground = result.plant.ground
    flat = locomotion(
        simulate(load_station(f"{name}_dynamic"), duration=0.1, progress=False)
    ).smallest_height
    assert locomotion(result).smallest_height == pytest.approx(
        flat / np.cos(ground.incline), abs=3e-3
    )


def test_a_fall_is_told_by_the_height_over_the_slope():
    """Carried up the slope the same robot is as high over the ground; sunk by half its height it has fallen."""
    station = load_station("humanoid_dynamic", SLOPE)
    fall = station.monitors["fall"].condition("fall", resolve(station))
    turn = RotationMatrix(resolve(station).robots["robot"].base.rotation()).ToQuaternion().wxyz()
    up, down = np.array([1.0, 0.5, 0.0]), np.array([-1.0, -0.5, 0.0])
    for place in (up, down):
        height = Ground(np.deg2rad(5), np.deg2rad(30)).floor_heights(place[np.newaxis])[0]
        assert fall.excess(np.array([*place[:2], height + 0.23, *turn])) < 0
        assert fall.excess(np.array([*place[:2], height + 0.21, *turn])) > 0


def test_the_camera_climbs_with_the_robot():
    station = load_station("yobotics_dynamic", {"floor.incline_deg": 10.0})
    result = simulate(station, duration=0.05, progress=False)
    values = result.values.copy()
    values[:, result.names.index("base.x")] = np.linspace(0, 1.0, len(values))
    way = walked_displacement(type(result)(**{**result.__dict__, "values": values}))
    assert way is not None
    gone = way(np.array([result.stop_time]))
    np.testing.assert_allclose(gone[0, 2], np.tan(np.deg2rad(10)) * gone[0, 0])


def test_a_point_is_on_a_box_if_it_is_pressed_in_by_less_than_contacts_give_way():
    # its top is at 0.1 m
    box = (
        RigidTransform(np.array([0.0, 0.0, 0.05])),
        np.array([0.5, 0.5, 0.05]),
    )
    pressed_in = np.array([0.0, 0.0, 0.096])
    inside = np.array([0.0, 0.0, 0.08])

    heights = Ground(boxes=(box,)).beneath(np.array([pressed_in, inside]))

    np.testing.assert_allclose(heights, [0.1, 0.0], atol=1e-12)
