"""Uneven ground: its boxes against Drake's own distances, its seed, and what is soft of it."""

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
    ground, posed = resolve(config).ground, PosedStation(config)
    rng = np.random.default_rng(5)
    points = np.column_stack([rng.uniform((0.0, -0.8), (1.8, 0.8), (60, 2)), np.full(60, 2.0)])
    heights = ground.beneath(points)
    rough = heights - ground.floor_heights(points)
    assert rough.max() > 0.005
    assert -0.031 < rough.min() < (-0.005 if kind == "steps" else 1e-9)
    assert rough.max() < 0.035
    for point, height in zip(points, heights, strict=True):
        on = np.array([*point[:2], height])
        near = posed.query().ComputeSignedDistanceToPoint(on, threshold=1e-9)
        assert min(abs(found.distance) for found in near) < 1e-9
        assert (
            posed.query().ComputeSignedDistanceToPoint(on + np.array([0, 0, 1e-4]), threshold=0.0)
            == []
        )


@pytest.fixture
def grids(tmp_path):
    """Two files of the same grid: the far left tile high, the near right one low."""
    (tmp_path / "grid.csv").write_text("0.02,0\n0.04,0.02\n")
    Image.fromarray(np.array([[255, 128], [128, 0]], np.uint8)).save(tmp_path / "grid.png")
    return {kind: tmp_path / f"grid.{kind}" for kind in ("csv", "png")}


def known(grids):
    """Fields whose heights are told, with points [m] and their heights."""
    stairs = {"kind": "stairs", "height": 0.03, "size": 0.2, "length": 1.0}
    gaps = {"kind": "gaps", "height": 0.1, "size": 0.25, "length": 1.0, "gap": 0.06}
    tiles = {
        (0.5, -0.1): 0.0,
        (0.5, 0.1): 0.02,
        (0.7, -0.1): 0.02,
        (0.7, 0.1): 0.04,
        (0.9, 0.1): 0.0,
        (0.5, 0.3): 0.0,
    }
    return [
        (
            stairs,
            {(0.3, 0.0): 0.0, **{(0.5 + 0.2 * n, 0.3): 0.03 * min(n + 1, 5 - n) for n in range(5)}},
        ),
        (
            gaps,
            {
                (0.49, 0.0): 0.0,
                (0.5, 0.0): -0.1,
                (0.55, 0.0): -0.1,
                (0.56, 0.0): 0.0,
                (1.275, 0.0): -0.1,
            },
        ),
        ({"kind": "grid", "size": 0.2, "file": str(grids["csv"])}, tiles),
        ({"kind": "grid", "size": 0.2, "height": 0.04, "file": str(grids["png"])}, tiles),
    ]


def test_stairs_gaps_and_grids_are_where_they_are_told(grids):
    for field, heights in known(grids):
        config = load_station(
            "yobotics_terrain", {**PLAIN, "floor.terrain": {"width": 0.8, **field}}
        )
        ground, posed = resolve(config).ground, PosedStation(config)
        points = np.array([(*place, 2.0) for place in heights])
        tops = ground.beneath(points)
        np.testing.assert_allclose(tops, [*heights.values()], atol=2e-4)  # 128 of 255 is no half
        for point, top in zip(points, tops, strict=True):
            near = posed.query().ComputeSignedDistanceToPoint(
                np.array([*point[:2], top]), threshold=1e-9
            )
            assert min(abs(found.distance) for found in near) < 1e-9


@pytest.mark.long
def test_what_is_no_grid_is_refused(tmp_path, grids):
    (tmp_path / "words.csv").write_text("0.1,high\n")
    (tmp_path / "empty.png").write_text("")
    (tmp_path / "ragged.csv").write_text("0.1,0.2\n0.1\n")
    Image.new("L", (1000, 1000)).save(tmp_path / "large.png")
    Image.fromarray((np.arange(2000) % 251).astype(np.uint8).reshape(40, 50)).save(
        tmp_path / "rough.png"
    )
    messages = {
        "words.csv": "line 1: holds something that is no number",
        "ragged.csv": "line 2: has 1 cells, and the first line 2",
        "no.csv": "cannot be read",
        "empty.png": "cannot be read as an image",
        "large.png": "more than 100000",
        "rough.png": "needs 2000 boxes",
    }
    for file, message in messages.items():
        field = {"kind": "grid", "file": str(tmp_path / file)}
        with pytest.raises(SimrobError, match=message):
            resolve(load_station("yobotics_terrain", {**PLAIN, "floor.terrain": field}))


def test_the_seed_alone_makes_the_field_and_the_floor_s_size_does_not():
    field = Terrain(kind="rubble", seed=3)

    def stones(terrain, size):
        return np.array([block.pose.GetAsMatrix34() for block in terrain.blocks(size)][5:])

    np.testing.assert_array_equal(stones(field, 3.0), stones(Terrain(kind="rubble", seed=3), 30.0))
    assert abs(stones(field, 3.0) - stones(Terrain(kind="rubble", seed=4), 3.0)).max() > 0.01


def test_no_half_space_stands_among_many_boxes():
    """Drake 1.58 crashes now and then when it copies one among a hundred."""
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
    depths = []
    for x in (-1.0, 0.7):
        made = load_station("yobotics_terrain", {**config, "robot.base": [x, 0, 0.31546, 0, 0, 0]})
        result = simulate(made, duration=1.0, progress=False)
        plant, robot = result.plant.plant, result.plant.robots["robot"]
        context = plant.CreateDefaultContext()
        plant.SetPositions(context, result.positions_at(np.array([1.0]))[0])
        links = {foot: plant.GetFrameByName(foot, robot.instance) for foot in robot.feet.links}
        poses = {
            foot: link.CalcPoseInWorld(context).GetAsMatrix4()[np.newaxis]
            for foot, link in links.items()
        }
        depths.append(
            -np.mean(
                [robot.feet.lowest_points(foot, pose)[0, 0, 2] for foot, pose in poses.items()]
            )
        )
    weight = plant.CalcTotalMass(context, [robot.instance]) * made.gravity / 4
    # the ball is a mesh of edges of 12.5 mm, which lie up to 0.8 mm inside of it
    assert depths[0] < 1e-3
    assert depths[1] == pytest.approx(np.sqrt(weight * 0.07 / (np.pi * 1e6 * 0.025)), rel=0.15)


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
def test_what_cannot_be_is_refused(overrides, message):
    with pytest.raises(SimrobError, match=message):
        resolve(load_station("yobotics_terrain", overrides))
