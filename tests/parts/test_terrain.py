"""Uneven ground: its boxes against Drake's own distances, its seed, and what is soft of it."""

import numpy as np
import pytest
from pydrake.geometry import HalfSpace, Role

from simrob_drake import load_station, simulate
from simrob_drake.errors import SimrobError
from simrob_drake.parts.terrain import Terrain
from simrob_drake.stations.clearance import PosedStation
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
        {**PLAIN, "floor.incline_deg": incline, "floor.terrain": {"kind": kind, "heading_deg": 20, **SMALL}},
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
        assert posed.query().ComputeSignedDistanceToPoint(on + np.array([0, 0, 1e-4]), threshold=0.0) == []


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
        "floor.terrain": {"kind": "steps", "height": 0.02, "length": 0.2, "start": 0.0, "soft": soft},
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
        poses = {foot: link.CalcPoseInWorld(context).GetAsMatrix4()[np.newaxis] for foot, link in links.items()}
        depths.append(-np.mean([robot.feet.lowest_points(foot, pose)[0, 0, 2] for foot, pose in poses.items()]))
    weight = plant.CalcTotalMass(context, [robot.instance]) * made.gravity / 4
    assert depths[0] < 1e-3  # the ball is a mesh of edges of 12.5 mm, which lie up to 0.8 mm inside of it
    assert depths[1] == pytest.approx(np.sqrt(weight * 0.07 / (np.pi * 1e6 * 0.025)), rel=0.15)


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        ({"floor.terrain.size": 0.001}, "more than 1000 boxes"),
        ({"floor.terrain.size": 5}, "is not more than length and width"),
        ({"floor.terrain.kind": "hills"}, "rubble"),
        ({"floor.terrain.seed": -1}, "seed"),
        ({"contact.model": "point"}, "floor.terrain.soft"),
    ],
)
def test_what_cannot_be_is_refused(overrides, message):
    with pytest.raises(SimrobError, match=message):
        resolve(load_station("yobotics_terrain", overrides))
