"""The collision policy, by geometry worked by hand: what is left out, and tolerances."""

from pathlib import Path

import numpy as np
import pytest

from simrob_drake.programs.model import StationModel
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.piece_config import PieceConfig
from tests.stations.conftest import joint, link

BASE = link("base", "0.1 0.1 0.1", "0 0 0.05")
BAR = "0.4 0.05 0.05", "0.2 0 0"  # a bar of 0.4 m along x


def model_of(urdf: Path, **robot: object) -> StationModel:
    """Make a station of one robot with collision shapes."""
    config = StationConfig(
        name="alone", mode="kinematic", robots={"robot": {"urdf": urdf, **robot}}
    )
    return StationModel(config, collision=True)


@pytest.fixture
def folding(robot_of):
    """Two bars that fold in a plane over a base, so that the second reaches the base."""
    return robot_of(
        BASE,
        link("upper", *BAR),
        link("lower", *BAR),
        joint("upper", "base", "0 0 0.25", "0 0 1"),
        joint("lower", "upper", "0.4 0 0", "0 1 0", span=(-3.2, 3.2)),
    )


def overlaps_at(model: StationModel, *posture: float):
    model.place_robots({"robot": np.array(posture)})
    return model.policy.overlaps()


def test_links_that_are_no_neighbours_collide_and_neighbours_do_not(folding):
    """The lower bar turns down by a about (0.4, 0, 0.25).

    At a = 180 deg it lies in the upper bar, its neighbour. At 155 deg its tip is at
    0.4 - 0.4 cos 25 deg = 0.037 m and 0.25 - 0.4 sin 25 deg = 0.081 m: in the base,
    which is 0.1 m wide and high.
    """
    model = model_of(folding)

    assert overlaps_at(model, 0.0, 0.0) == []
    assert overlaps_at(model, 0.0, np.pi) == []

    (found,) = overlaps_at(model, 0.0, np.deg2rad(155))
    assert (found.bodies, found.robot) == (("base", "lower"), "robot")


@pytest.mark.parametrize(("gap", "collides"), [(-0.0045, False), (-0.0055, True)])
def test_the_tolerance_within_a_robot_is_5_mm(robot_of, gap, collides):
    """A slide lowers a plate on the base's top at 0.1 m, past a link without shapes."""
    carriage = link("carriage", "0.01 0.01 0.01", "0 0 0.5", mass=0.1)
    slide = joint("carriage", "base", "0 0 0", "0 0 1")
    lift = joint("plate", "carriage", "0 0 0.2", "0 0 1", span=(-0.2, 0.2))
    lift = lift.replace('type="revolute"', 'type="prismatic"')
    urdf = robot_of(BASE, carriage, link("plate", "0.1 0.1 0.02"), slide, lift)

    # The plate's lower face is at 0.2 + z - 0.01.
    found = overlaps_at(model_of(urdf), 0.0, gap + 0.11 - 0.2)

    assert [overlap.depth for overlap in found] == pytest.approx([0.0055] * collides)


def test_links_that_touch_at_home_are_left_out_and_others_are_not(robot_of):
    """Two fingers on one base, 13 mm apart and 20 mm thick, touch at home; a third not."""
    fingers = [link(name, "0.02 0.02 0.2", "0 0 0.1") for name in ("one", "two", "three")]
    places = {"one": 0.0, "two": 0.013, "three": 0.06}
    hinges = [joint(name, "base", f"0 {y} 0.4", "1 0 0") for name, y in places.items()]

    model = model_of(robot_of(BASE, *fingers, *hinges))

    assert dict(model.policy.home_contacts) == {("one", "two"): "robot"}
    assert overlaps_at(model, -0.2, 0.2, 0.0) == []

    found = overlaps_at(model, 0.0, 0.0, 0.4)  # about x: towards the other two
    assert {overlap.bodies for overlap in found} == {("one", "three"), ("three", "two")}


def test_a_carried_piece_collides_with_the_links_of_its_robot():
    """A bar of 0.3 m on the flange reaches the shoulder; the bare arm does not."""
    posture = np.deg2rad([0, 0, 40, 0, 100, 0])
    bar = PieceConfig(model="bar_30", parent="robot")
    robots = {"robot": {"model": "irb120"}}
    config = StationConfig(name="bar", mode="kinematic", robots=robots, pieces={"bar": bar})

    found = overlaps_at(StationModel(config, collision=True), *posture)

    bodies = {overlap.bodies for overlap in found}
    assert ("bar", "link_1") in bodies
    assert all("bar" in pair for pair in bodies)
    assert all(overlap.robot == "robot" for overlap in found)


def ring_obj(inner: float, outer: float, height: float, count: int = 32) -> str:
    """Return the OBJ file of a ring about z."""
    angles = np.linspace(0, 2 * np.pi, count, endpoint=False)
    corners = [
        (radius * np.cos(angle), radius * np.sin(angle), z)
        for angle in angles
        for radius in (inner, outer)
        for z in (-height / 2, height / 2)
    ]
    lines = ["v {:.9f} {:.9f} {:.9f}".format(*corner) for corner in corners]
    around = ((0, 1), (1, 3), (3, 2), (2, 0))  # inner wall, top, outer wall, bottom
    for index in range(count):
        here = 4 * index + 1
        there = 4 * ((index + 1) % count) + 1
        for first, second in around:
            one, two = here + first, here + second
            three, four = there + second, there + first
            lines += [f"f {one} {two} {three}", f"f {one} {three} {four}"]
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize(("offset", "collides"), [(0.0, False), (0.09, True)])
def test_a_rod_through_a_ring_lies_in_its_hull_and_not_in_the_ring(robot_of, offset, collides):
    """A ring of 0.08 to 0.1 m; the rod of 20 mm goes through its middle, or its wall."""
    ring = link("ring", "1 1 1").replace('<box size="1 1 1"/>', '<mesh filename="ring.obj"/>')
    carriage = link("carriage", "0.01 0.01 0.01", "0 0 1", mass=0.1)
    slide = joint("rod", "carriage", "0 0 0", "1 0 0", span=(-1, 1))
    slide = slide.replace('type="revolute"', 'type="prismatic"')
    urdf = robot_of(
        BASE,
        ring,
        carriage,
        link("rod", "0.02 0.02 0.5"),
        joint("ring", "base", "0 0 0.5", "0 0 1"),
        joint("carriage", "base", "0 0 0.5", "0 0 1"),
        slide,
    )
    (urdf.parent / "ring.obj").write_text(ring_obj(0.08, 0.1, 0.1))

    found = overlaps_at(model_of(urdf), 0.0, 0.0, offset)

    assert [overlap.bodies for overlap in found] == [("ring", "rod")] * collides
