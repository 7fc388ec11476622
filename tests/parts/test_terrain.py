"""Uneven ground: its boxes against Drake's distances, its seed, and its soft patch."""

import numpy as np
import pytest
from PIL import Image
from pydrake.geometry import HalfSpace, Role

from simrob_drake import load_station, simulate
from simrob_drake.base.errors import SimrobError
from simrob_drake.parts.terrain import Terrain
from simrob_drake.stations.posed import PosedStation
from simrob_drake.stations.resolve import resolve

PLAIN = {"controllers": {}, "sensors": {}}
SMALL = {"length": 1.0, "width": 0.8, "height": 0.03}


def station(**terrain):
    """Load the quadruped on a small field, with keys of the terrain."""
    return load_station("yobotics_terrain", {**PLAIN, "floor.terrain": {**SMALL, **terrain}})


@pytest.mark.parametrize("incline", [0.0, 5.0])
@pytest.mark.parametrize("kind", ["steps", "slope", "bumps", "rubble"])
def test_heights_are_where_drake_has_the_surfaces(kind, incline):
    config = load_station(
        "yobotics_terrain",
        {
            **PLAIN,
            "floor.incline_deg": incline,
            "floor.terrain": {"kind": kind, "heading_deg": 20, **SMALL},
        },
    )
    ground = resolve(config).ground
    posed = PosedStation(config)
    random = np.random.default_rng(5)
    points = np.column_stack([random.uniform((0.0, -0.8), (1.8, 0.8), (60, 2)), np.full(60, 2.0)])

    heights = ground.beneath(points)

    over_floor = heights - ground.floor_heights(points)
    assert 0.005 < over_floor.max() < 0.035
    # Only tiles of steps may be lower than the ground around the field.
    assert -0.031 < over_floor.min() < (-0.005 if kind == "steps" else 1e-9)
    for point, height in zip(points, heights, strict=True):
        on_surface = np.array([*point[:2], height])
        touching = posed.query().ComputeSignedDistanceToPoint(on_surface, threshold=1e-9)
        assert min(abs(found.distance) for found in touching) < 1e-9
        above = on_surface + np.array([0, 0, 1e-4])
        assert posed.query().ComputeSignedDistanceToPoint(above, threshold=0.0) == []


@pytest.fixture
def grids(tmp_path):
    """Two files of the same grid, by their kind: the far left tile is the highest, the near right one the lowest."""
    (tmp_path / "grid.csv").write_text("0.02,0\n0.04,0.02\n")
    Image.fromarray(np.array([[255, 128], [128, 0]], np.uint8)).save(tmp_path / "grid.png")
    return {kind: tmp_path / f"grid.{kind}" for kind in ("csv", "png")}


def assert_heights(field, heights):
    """Check the heights [m] of a field at points (x, y) [m], and that Drake has surfaces there."""
    config = load_station("yobotics_terrain", {**PLAIN, "floor.terrain": {"width": 0.8, **field}})
    ground = resolve(config).ground
    posed = PosedStation(config)
    points = np.array([(*place, 2.0) for place in heights])

    tops = ground.beneath(points)

    # A pixel of the value 128 of 255 is not quite at half of the height.
    np.testing.assert_allclose(tops, [*heights.values()], atol=2e-4)
    for point, top in zip(points, tops, strict=True):
        on_surface = np.array([*point[:2], top])
        touching = posed.query().ComputeSignedDistanceToPoint(on_surface, threshold=1e-9)
        assert min(abs(found.distance) for found in touching) < 1e-9


def test_stairs_rise_up_to_the_middle_and_fall_again():
    stairs = {"kind": "stairs", "height": 0.03, "size": 0.2, "length": 1.0}

    assert_heights(
        stairs,
        {
            (0.3, 0.0): 0.0,
            (0.5, 0.3): 0.03,
            (0.7, 0.3): 0.06,
            (0.9, 0.3): 0.09,
            (1.1, 0.3): 0.06,
            (1.3, 0.3): 0.03,
        },
    )


def test_gaps_are_in_the_middle_of_each_row():
    gaps = {"kind": "gaps", "height": 0.1, "size": 0.25, "length": 1.0, "gap": 0.06}

    assert_heights(
        gaps,
        {
            (0.49, 0.0): 0.0,
            (0.5, 0.0): -0.1,
            (0.55, 0.0): -0.1,
            (0.56, 0.0): 0.0,
            (1.275, 0.0): -0.1,
        },
    )


@pytest.mark.parametrize("kind", ["csv", "png"])
def test_a_grid_has_the_heights_of_its_file(grids, kind):
    grid = {"kind": "grid", "size": 0.2, "file": str(grids[kind])}
    # The heights of a picture are parts of the key `height`.
    field = {**grid, "height": 0.04} if kind == "png" else grid

    assert_heights(
        field,
        {
            (0.5, -0.1): 0.0,
            (0.5, 0.1): 0.02,
            (0.7, -0.1): 0.02,
            (0.7, 0.1): 0.04,
            (0.9, 0.1): 0.0,
            (0.5, 0.3): 0.0,
        },
    )


@pytest.mark.long
def test_an_invalid_file_of_a_grid_is_refused(tmp_path, grids):
    (tmp_path / "words.csv").write_text("0.1,high\n")
    (tmp_path / "empty.png").write_text("")
    (tmp_path / "ragged.csv").write_text("0.1,0.2\n0.1\n")
    Image.new("L", (1000, 1000)).save(tmp_path / "large.png")
    Image.fromarray((np.arange(2000) % 251).astype(np.uint8).reshape(40, 50)).save(
        tmp_path / "rough.png"
    )

    messages = {
        "words.csv": "line 1: contains a value that is not a number",
        "ragged.csv": "line 2: has 1 cells, but the first line has 2",
        "no.csv": "cannot be read",
        "empty.png": "cannot be read as an image",
        "large.png": "more than 100000",
        "rough.png": "needs 2000 boxes",
    }
    for file, message in messages.items():
        field = {"kind": "grid", "file": str(tmp_path / file)}
        with pytest.raises(SimrobError, match=message):
            resolve(load_station("yobotics_terrain", {**PLAIN, "floor.terrain": field}))


def test_a_field_depends_on_its_seed_and_not_on_the_size_of_the_floor():
    def stones(seed, floor):
        """Poses of the stones, which follow five boxes of level ground, on a floor of a size [m]."""
        boxes = Terrain(kind="rubble", seed=seed).blocks(floor)
        return np.array([box.pose.GetAsMatrix34() for box in boxes[5:]])

    small_floor = stones(seed=3, floor=3.0)
    large_floor = stones(seed=3, floor=30.0)
    other_seed = stones(seed=4, floor=3.0)

    np.testing.assert_array_equal(small_floor, large_floor)
    assert abs(small_floor - other_seed).max() > 0.01


def test_the_floor_of_a_field_is_no_half_space():
    """Drake 1.58 sometimes crashes when it copies a half space among a hundred boxes."""
    posed = PosedStation(station(kind="steps"))
    inspector = posed.station.scene_graph.model_inspector()

    shapes = [inspector.GetShape(shape) for shape in inspector.GetAllGeometryIds(Role.kProximity)]

    assert len(shapes) > 20
    assert not any(isinstance(shape, HalfSpace) for shape in shapes)


def test_a_foot_sinks_into_the_soft_patch_as_its_pressure_says():
    r"""A ball of radius R at depth d in a layer of thickness H and modulus E is pushed by :math:`π E R d² / H`."""
    soft = {"length": 1.0, "hydroelastic_modulus": 1e6}
    config = {
        **PLAIN,
        "floor.terrain": {
            "kind": "steps",
            "height": 0.02,
            "length": 0.2,
            "start": 0.0,
            "soft": soft,
        },
        "contact.hydroelastic_modulus": 1e8,  # of all else
    }

    def stand_at(x):
        """Run the robot at a position along x [m]. Returns the run."""
        pose = [x, 0, 0.31546, 0, 0, 0]
        changes = {**config, "robot.base": pose}
        return simulate(load_station("yobotics_terrain", changes), duration=1.0, progress=False)

    def depth_of_feet(result):
        """Mean depth of the lowest points of the feet below z = 0 at the end [m]."""
        plant = result.plant.plant
        robot = result.plant.robots["robot"]
        context = plant.CreateDefaultContext()
        plant.SetPositions(context, result.positions_at(np.array([1.0]))[0])
        heights = []
        for foot in robot.feet.links:
            pose = plant.GetFrameByName(foot, robot.instance).CalcPoseInWorld(context)
            lowest = robot.feet.lowest_points(foot, pose.GetAsMatrix4()[np.newaxis])
            heights.append(lowest[0, 0, 2])
        return -np.mean(heights)

    on_hard_ground = stand_at(-1.0)
    on_soft_patch = stand_at(0.7)

    plant = on_soft_patch.plant.plant
    robot = on_soft_patch.plant.robots["robot"]
    mass = plant.CalcTotalMass(plant.CreateDefaultContext(), [robot.instance])
    force = mass * np.linalg.norm(plant.gravity_field().gravity_vector()) / 4
    depth = np.sqrt(force * 0.07 / (np.pi * 1e6 * 0.025))
    # The ball is a mesh with edges of 12.5 mm, which are up to 0.8 mm inside of the ball.
    assert depth_of_feet(on_hard_ground) < 1e-3
    assert depth_of_feet(on_soft_patch) == pytest.approx(depth, rel=0.15)


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        ({"floor.terrain.size": 0.001}, "more than 1000 boxes"),
        ({"floor.terrain.size": 5}, "must not exceed length or width"),
        ({"floor.terrain.kind": "hills"}, "rubble"),
        ({"floor.terrain.seed": -1}, "seed"),
        ({"floor.terrain.kind": "grid"}, "grid needs a file"),
        ({"floor.terrain.file": "heights.csv"}, "file is for kind: grid only"),
        (
            {"floor.terrain": {"kind": "gaps", "gap": 0.2, "size": 0.2}},
            "it must be less than size, 0.2 m",
        ),
        ({"contact.model": "point"}, "floor.terrain.soft"),
    ],
)
def test_an_invalid_terrain_is_refused_with_its_cause(overrides, message):
    with pytest.raises(SimrobError, match=message):
        resolve(load_station("yobotics_terrain", overrides))
