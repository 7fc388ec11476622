"""A shape belongs to the body for which it was made, even if another shape has the same name."""

import pytest
from pydrake.systems.framework import DiagramBuilder

from simrob_drake import load_station
from simrob_drake.parts.targets import piece_of_shape, shapes_of
from simrob_drake.stations.plant import add_plant
from simrob_drake.stations.resolve import resolve

OWN, PIECES = 3e4, 5e4  # N/m: stiffness of the station's surfaces, and of its pieces


@pytest.fixture
def shapes(one_joint_urdf, write_urdf, tmp_path):
    """Names of the shapes of a body, in a station whose arm has a shape with the name of a piece's shape."""
    named = one_joint_urdf.replace("<collision>", '<collision name="foot.left">')
    tip = '<link name="tip"><collision name="floor"><geometry><sphere radius="0.01"/></geometry></collision></link>'
    (file := tmp_path / "station.yaml").write_text(
        f"""
robot: {{urdf: {write_urdf(named.replace('<link name="tip"/>', tip))}}}
pieces:
  foot: {{model: ball, parent: world, pose: [1, 0, 1, 0, 0, 0], contact: {{stiffness: {PIECES}}}}}
  hand: {{model: ball, parent: robot, contact: {{stiffness: {PIECES}}}}}
reference: {{kind: hold}}
floor: {{}}
contact: {{stiffness: {OWN}}}
"""
    )
    config, builder = resolve(load_station(file)), DiagramBuilder()
    station = add_plant(builder, config)
    inspector = station.scene_graph.model_inspector()

    def told(body):
        """Name, piece and stiffness of each shape."""
        found = shapes_of(station, config, body)
        stiff = [
            inspector.GetProximityProperties(s).GetProperty("material", "point_contact_stiffness")
            for s in found
        ]
        pieces = [piece_of_shape(config, inspector, shape) for shape in found]
        return sorted(
            zip(
                [inspector.GetName(s) for s in found],
                pieces,
                [value / 2 for value in stiff],
                strict=True,
            )
        )

    yield told
    del builder


def test_a_robots_shape_that_is_called_as_one_of_a_piece_is_the_robots(shapes):
    assert shapes("base") == [("robot::arm::foot.left", None, OWN)]
    assert shapes("foot") == [("foot::foot::foot.0", "foot", PIECES)]
    assert shapes("foot.0") == shapes("foot")


def test_a_carried_piece_has_its_own_shapes(shapes):
    assert shapes("hand") == [("robot::arm::hand.0", "hand", PIECES)]
    assert ("robot::arm::hand.0", "hand", PIECES) in shapes("robot")


def test_the_floor_is_what_the_station_has(shapes):
    assert [name for name, _, _ in shapes("floor")] == ["floor"]
