"""Ground: heights against Drake's distances, and robots that stand, walk and fall on an incline."""

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


def test_the_floor_rises_in_the_direction_of_its_heading():
    incline = np.deg2rad(10)
    ground = Ground(incline=incline, heading=np.deg2rad(90))
    points = np.array([[0.0, 2.0, 0.0], [3.0, 0.0, 5.0], [0.0, -1.0, 0.0]])

    heights = ground.beneath(points)

    np.testing.assert_allclose(heights, np.tan(incline) * np.array([2.0, 0.0, -1.0]), atol=1e-15)
    uphill = ground.floor_pose.rotation().matrix() @ [0, 1, 0]
    np.testing.assert_allclose(uphill, [0, np.cos(incline), np.sin(incline)], atol=1e-15)
    assert not ground.is_level_plane


def test_a_level_floor_is_the_plane_of_the_world():
    ground = Ground()

    np.testing.assert_array_equal(ground.floor_pose.GetAsMatrix4(), np.eye(4))
    assert ground.is_level_plane


@pytest.mark.parametrize("boxes", [(), ((RigidTransform(), np.ones(3)),)])
@pytest.mark.parametrize("has_floor", [True, False])
def test_without_points_there_are_no_heights_and_nothing_stands_without_a_floor(boxes, has_floor):
    """A robot without feet has no points that could stand."""
    ground = Ground(has_floor=has_floor, boxes=boxes)
    no_points = np.zeros((0, 3))

    assert ground.beneath(no_points).shape == (0,)
    assert ground.carries(no_points, 0.05) is has_floor


def test_tops_of_boxes_are_where_drake_has_their_surfaces():
    """The distance to the plate is zero on its surface; just above the surface, no shape overlaps the point."""
    station = load_station("humanoid_dynamic", {"pieces.plate": PLATE, **SLOPE, "sensors": {}})
    ground = resolve(station).ground
    posed = PosedStation(station)
    random = np.random.default_rng(3)
    points = np.column_stack([random.uniform(-0.3, 0.7, (300, 2)), np.full(300, 2.0)])

    heights = ground.beneath(points)

    is_on_plate = heights > ground.floor_heights(points) + 1e-6
    surface_points = np.column_stack([points[is_on_plate, :2], heights[is_on_plate]])
    assert 20 < len(surface_points) < 280
    inspector = posed.station.scene_graph.model_inspector()
    for point in surface_points:
        touching = posed.query().ComputeSignedDistanceToPoint(point, threshold=1e-9)
        assert any("plate" in inspector.GetName(found.id_G) for found in touching)
        above = point + np.array([0, 0, 1e-4])
        assert posed.query().ComputeSignedDistanceToPoint(above, threshold=0.0) == []


@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize("axis", [0, 1])
def test_the_edge_of_a_box_belongs_to_it_on_all_sides(axis, side):
    """On one side of an upright box the height was that of the floor, and below a box in the air there was none."""
    for height in (0.1, 1.0):
        box = (RigidTransform([0, 0, height]), np.array([0.5, 0.4, 0.1]))
        point = np.zeros((1, 3))
        point[0, axis] = side * box[1][axis]
        point[0, 2] = 2.0

        ground = Ground(boxes=[box], has_floor=True)

        assert ground.beneath(point) == pytest.approx([height + 0.1])
        assert ground.beneath(point * [1.01, 1.01, 1.0]) == pytest.approx([0.0])


# A beam whose top is 1.1 m high.
BEAM = (RigidTransform([0, 0, 1.0]), np.array([0.5, 0.5, 0.1]))


def test_boxes_above_a_point_are_not_beneath_it():
    points = np.array([[0, 0, 0.5], [0, 0, 1.4], [0.6, 0, 1.4]])

    heights = Ground(boxes=(BEAM,)).beneath(points)

    np.testing.assert_allclose(heights, [0, 1.1, 0])


@pytest.mark.parametrize(
    ("points", "is_carried"),
    [
        ([[0.4, 0, 1.1]], True),
        # One of the two points is not over the beam.
        ([[0.4, 0, 1.1], [0.6, 0, 1.1]], False),
        # The point is below the beam.
        ([[0.4, 0, 0.8]], False),
    ],
)
def test_without_a_floor_only_boxes_carry(points, is_carried):
    ground = Ground(has_floor=False, boxes=(BEAM,))

    assert ground.carries(np.array(points), 0.05) == is_carried


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

    box_counts = {
        name: sum(shape.box is not None for shape in piece.model.shapes)
        for name, piece in station.pieces.items()
    }
    assert len(station.ground.boxes) == box_counts["plate"] + box_counts["on_it"]
    last_box_pose, _ = station.ground.boxes[-1]
    plate_pose = transform_from_pose(PLATE["pose"])
    tcp_in_plate = transform_from_pose(station.pieces["plate"].model.tcp)
    shape_in_piece = transform_from_pose(station.pieces["on_it"].model.shapes[-1].pose)
    assert last_box_pose.IsNearlyEqualTo(plate_pose @ tcp_in_plate @ shape_in_piece, 1e-12)


@pytest.mark.parametrize("name", ["humanoid", "roid1", "zjudancer", "yobotics"])
def test_robots_stand_on_a_slope_as_they_begin(name):
    station = load_station(f"{name}_dynamic", SLOPE)

    result = simulate(station, duration=1.0, progress=False)
    on_level_floor = simulate(load_station(f"{name}_dynamic"), duration=0.1, progress=False)

    assert not [finding for finding in check_station(station) if finding.level == "warning"]
    assert result.ending == "completed"
    start, end = result.pose("base")[[0, -1], :3]
    assert np.linalg.norm(end - start) < 0.01
    # A robot that stands perpendicular to the slope is higher over it by 1 / cos, measured along the vertical.
    level_height = locomotion(on_level_floor).smallest_height
    expected = level_height / np.cos(result.plant.ground.incline)
    assert locomotion(result).smallest_height == pytest.approx(expected, abs=3e-3)


@pytest.mark.parametrize("place", [(1.0, 0.5), (-1.0, -0.5)], ids=["uphill", "downhill"])
def test_a_fall_depends_on_the_height_over_the_slope(place):
    """The robot has fallen below 0.22 m over the ground, wherever it is on the slope."""
    station = load_station("humanoid_dynamic", SLOPE)
    contents = resolve(station)
    rotation = RotationMatrix(contents.robots["robot"].base.rotation()).ToQuaternion().wxyz()
    point = np.array([*place, 0.0])
    slope = Ground(incline=np.deg2rad(5), heading=np.deg2rad(30))
    floor = slope.floor_heights(point[np.newaxis])[0]

    fall = station.monitors["fall"].condition("fall", contents)

    assert fall.excess(np.array([*place, floor + 0.23, *rotation])) < 0
    assert fall.excess(np.array([*place, floor + 0.21, *rotation])) > 0


def test_the_camera_climbs_with_the_robot():
    """A run in which the robot's base moves ahead by 1 m along a slope of 10 degrees."""
    station = load_station("yobotics_dynamic", {"floor.incline_deg": 10.0})
    result = simulate(station, duration=0.05, progress=False)
    values = result.values.copy()
    values[:, result.names.index("base.x")] = np.linspace(0, 1.0, len(values))
    moved = type(result)(**{**result.__dict__, "values": values})

    displacement = walked_displacement(moved)

    assert displacement is not None
    at_end = displacement(np.array([result.stop_time]))[0]
    np.testing.assert_allclose(at_end[2], np.tan(np.deg2rad(10)) * at_end[0])


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
