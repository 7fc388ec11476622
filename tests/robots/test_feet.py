"""What a robot stands on is what its station chooses, and nothing else of its feet touches the floor."""

import xml.etree.ElementTree as ET

import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.systems.framework import DiagramBuilder

from simrob_drake.base.errors import InvalidConfig, SimrobError, UnknownName
from simrob_drake.base.sections import validate_section
from simrob_drake.robots.catalog import load_robot
from simrob_drake.robots.feet import Feet, FootContact, put_on_feet
from simrob_drake.stations.load import load_station
from simrob_drake.stations.plant import StationPlant, add_plant
from simrob_drake.stations.resolve import resolve

# The base pattern of the Simulink models [mm], times the scale of each area; facts of the humanoid.
PATTERN = np.array([[35, 30], [-35, 30], [-35, -65], [35, -65], [35, -85], [-35, -85]]) / 1000
AREAS = {
    "spheres_A": (3.15, -0.01575, 1e4),
    "spheres_B": (0.945, -0.020475, 1e4),
    "spheres_C": (1.575, -0.02, 1e5),
}


def station(overrides: dict[str, object]) -> tuple[StationPlant, DiagramBuilder]:
    builder = DiagramBuilder()  # it owns the plant
    return add_plant(builder, resolve(load_station("humanoid_dynamic", overrides))), builder


@pytest.mark.parametrize("area", AREAS)
def test_the_three_areas_are_those_of_the_simulink_models(area: str) -> None:
    scale, height, stiffness = AREAS[area]
    contact = load_robot("humanoid").feet.kind(area)

    for foot in ("right_foot", "left_foot"):
        expected = np.column_stack([scale * PATTERN, np.full(6, height)])
        np.testing.assert_allclose(contact.points[foot], expected, atol=1e-12)
    assert (contact.radius, contact.stiffness, contact.friction) == (0.01, stiffness, (1.0, 0.9))


@pytest.mark.parametrize(("kind", "count"), [("spheres_A", 6), ("spheres_B", 6), ("soles", 1)])
def test_a_station_puts_on_the_feet_that_it_names(kind: str, count: int) -> None:
    found, _builder = station({"robot.feet": kind})
    inspector = found.scene_graph.model_inspector()

    contact = load_robot("humanoid").feet.kind(kind)

    for foot in contact.links:
        # Soles also have balls at their corners, which touch in their place.
        shapes = found.shapes_of_body(found.plant.GetBodyByName(foot))
        assert len(shapes) == count
        properties = inspector.GetProximityProperties(shapes[0])
        assert properties.GetProperty("material", "point_contact_stiffness") == contact.stiffness
        friction = properties.GetProperty("material", "coulomb_friction")
        assert (friction.static_friction(), friction.dynamic_friction()) == contact.friction


def test_feet_pass_through_each_other_even_where_links_do_not() -> None:
    for own, passing in ((False, True), (True, False)):
        found, _builder = station({"contact.self_collision": own})
        inspector, plant = found.scene_graph.model_inspector(), found.plant
        right, left, hand, trunk = (
            plant.GetCollisionGeometriesForBody(plant.GetBodyByName(name))[0]
            for name in ("right_foot", "left_foot", "right_hand", "trunk")
        )
        assert inspector.CollisionFiltered(right, left)
        assert inspector.CollisionFiltered(hand, trunk) == passing
    (floor,) = plant.GetCollisionGeometriesForBody(plant.world_body())
    assert not inspector.CollisionFiltered(right, floor)


def test_the_support_points_of_a_sole_are_its_lower_corners() -> None:
    contact = load_robot("humanoid").feet.kind("soles")
    corners = contact.support_points("left_foot")

    # the bottom of the published mesh
    np.testing.assert_allclose(corners[:, 2], -0.02896, atol=1e-12)
    np.testing.assert_allclose(np.ptp(corners, axis=0), [0.0559, 0.113, 0], atol=1e-12)


def test_wrong_feet_are_named() -> None:
    with pytest.raises(SimrobError, match="no kind of feet 'spheres_D'; did you mean 'spheres_"):
        load_station("humanoid_dynamic", {"robot.feet": "spheres_D"})
    with pytest.raises(SimrobError, match="irb120 has no feet"):
        load_station("irb120_dynamic", {"robot.feet": "soles"})


@pytest.mark.parametrize(
    ("feet", "message"),
    [
        (
            {"default": "a", "contacts": {"b": {"points": {"foot": [[0, 0, 0]]}}}},
            "default is 'a'; it must be one of b",
        ),
        ({"default": "a", "contacts": {"a": {}}}, "either points or boxes, not both"),
        (
            {"default": "a", "contacts": {"a": {"points": {"foot": [[0, 0, 0]]}, "radius": 0}}},
            "radius",
        ),
        (
            {
                "default": "a",
                "contacts": {"a": {"points": {"foot": [[0, 0, 0]]}, "others": {"fot": {}}}},
            },
            "others names fot, which are no feet; the feet are foot",
        ),
    ],
)
def test_a_description_that_makes_no_feet_is_refused(feet: dict[str, object], message: str) -> None:
    with pytest.raises(InvalidConfig, match=message):
        validate_section(Feet, feet, "robot.yaml")


def test_a_foot_that_is_no_link_is_named() -> None:
    robot = ET.fromstring('<robot name="r"><link name="foot"/></robot>')
    with pytest.raises(UnknownName, match=r"no link .* 'fot'; did you mean 'foot'"):
        put_on_feet(robot, FootContact(points={"fot": ((0, 0, 0),)}))


def test_a_foot_that_differs_is_as_the_rest_in_what_it_leaves_out() -> None:
    kind = {
        "points": {"left": ((0, 0, 0),), "right": ((0, 0, 0),)},
        "radius": 0.01,
        "stiffness": 4e4,
    }
    contact = FootContact(**kind, others={"right": {"radius": 0.03}})

    assert [(one.radius, one.stiffness) for one in map(contact.surface, kind["points"])] == [
        (0.01, 4e4),
        (0.03, 4e4),
    ]
    assert contact.support_points("right")[0, 2] == -0.03


@pytest.mark.parametrize(("kind", "under"), [("spheres_C", 0.01), ("soles", 0.0)])
def test_the_lowest_points_follow_the_foot(kind: str, under: float) -> None:
    contact = load_robot("humanoid").feet.kind(kind)
    poses = [
        RigidTransform(RollPitchYaw(0.2, -0.3, 0.4), [1.0, 2.0, 3.0]),
        RigidTransform([0.0, 0.0, 0.5]),
    ]
    found = contact.lowest_points("left_foot", np.array([pose.GetAsMatrix4() for pose in poses]))

    own = (
        contact.points["left_foot"] if kind == "spheres_C" else contact.support_points("left_foot")
    )

    radius = contact.radius if under else 0.0
    wanted = [[pose @ np.array(point) - [0, 0, radius] for point in own] for pose in poses]
    np.testing.assert_allclose(found, wanted, atol=1e-12)
    np.testing.assert_allclose(
        found[1] - np.array([0, 0, 0.5]), contact.support_points("left_foot"), atol=1e-12
    )


@pytest.mark.parametrize("tilt", [-0.4, 0.0, 0.4])
def test_the_lowest_point_of_a_foot_with_a_radius_of_its_own_is_below_by_this_radius(
    tilt: float,
) -> None:
    centre = (0.1, 0.0, 0.05)
    contact = FootContact(
        points={"left": (centre,), "right": (centre,)},
        radius=0.01,
        others={"right": {"radius": 0.03}},
    )
    pose = RigidTransform(RollPitchYaw(0.0, tilt, 0.0), [1.0, 2.0, 3.0])

    left = contact.lowest_points("left", pose.GetAsMatrix4()[np.newaxis])
    right = contact.lowest_points("right", pose.GetAsMatrix4()[np.newaxis])

    middle = pose @ np.array(centre)
    assert left[0, 0] == pytest.approx(middle - [0.0, 0.0, 0.01])
    assert right[0, 0] == pytest.approx(middle - [0.0, 0.0, 0.03])
