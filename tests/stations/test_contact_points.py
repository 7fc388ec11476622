"""Flat bodies in point contact, against Coulomb's law and statics, under every solver."""

from itertools import product

import numpy as np
import pytest
from pydrake.geometry import Box, HalfSpace, Role, Sphere
from pydrake.systems.framework import DiagramBuilder

from simrob_drake import load_station, simulate
from simrob_drake.base.errors import InvalidParameter
from simrob_drake.stations.checks import check_station
from simrob_drake.stations.contact_points import (
    LARGEST_RADIUS,
    SMALLEST_PROTRUSION,
    ContactBall,
    Edge,
    balls_at_corners,
    balls_of_cylinder,
    balls_on_edges,
)
from simrob_drake.stations.plant import add_plant
from simrob_drake.stations.resolve import resolve

G = 9.80665
SOLVERS = {
    "sap": {"kind": "discrete", "scheme": "sap", "time_step": 2e-3},
    "lagged": {"kind": "discrete", "scheme": "lagged", "time_step": 2e-3},
    "similar": {"kind": "discrete", "scheme": "similar", "time_step": 2e-3},
    "cenic": {"kind": "continuous", "scheme": "cenic", "accuracy": 1e-3, "max_step": 0.01},
    "radau3": {"kind": "continuous", "scheme": "radau3"},
}
every_solver = pytest.mark.parametrize("solver", SOLVERS)


def run(write_station, pieces, solver, **changes):
    friction = changes.pop("friction", 0.5)
    content = {
        "pieces": pieces,
        "floor": {"size": 20},
        "contact": {"friction": {"static": friction, "dynamic": friction}},
        "solver": SOLVERS[solver],
        "duration": 1.0,
        **changes,
    }
    return simulate(load_station(write_station(content)), progress=False)


def on_slope(size, degrees):
    """Pose of a box that lies on a floor that rises towards x by an angle."""
    angle = float(np.deg2rad(degrees))
    height = size[2] / 2
    return [float(-np.sin(angle) * height), 0.0, float(np.cos(angle) * height), 0.0, -angle, 0.0]


def way(result, piece):
    """Distance that a piece has moved, in the plane of x and z [m]."""
    ends = result.piece_pose(piece)[[0, -1], :3]
    return float(np.linalg.norm(ends[1] - ends[0]))


@every_solver
@pytest.mark.parametrize("side", [1, -1])
def test_a_pushed_crate_slides_as_coulombs_law_says(write_station, solver, side):
    """The push accelerates the crate by F / m - mu g, then friction stops it: v t / 2 + v² / (2 mu g)."""
    mass = 2
    friction = 0.4
    push_force = 15
    push_time = 0.8
    crate = {"box": [0.3, 0.2, 0.15], "mass": mass, "free": True, "pose": [0, 0, 0.075, 0, 0, 0]}
    push = {
        "kind": "push",
        "at": "crate",
        "start": 0.1,
        "duration": push_time,
        "force": [side * push_force, 0, 0],
    }

    result = run(
        write_station,
        {"crate": crate},
        solver,
        friction=friction,
        forces={"shove": push},
        duration=1.8,
    )

    speed = (push_force / mass - friction * G) * push_time
    distance = speed * push_time / 2 + speed**2 / (2 * friction * G)
    assert result["piece.crate.x"][-1] == pytest.approx(side * distance, rel=0.01)
    assert result.warnings == []


@every_solver
def test_a_box_at_rest_presses_with_its_weight(write_station, solver):
    box = {"box": [0.2, 0.2, 0.2], "mass": 3, "free": True, "pose": [0, 0, 0.1, 0, 0, 0]}
    result = run(
        write_station, {"box": box}, solver, sensors={"felt": {"kind": "force", "body": "box"}}
    )

    late = result.times > 0.5
    assert result["force.felt.z"][late] == pytest.approx(3 * G, rel=0.001)
    assert np.abs(result["force.felt.x"]).max() < 0.1
    assert result.verdict.summary()["figures"]["resting_force"]["value"] < 0.001


CUBE = [0.2, 0.2, 0.2]  # sides [m]


@every_solver
def test_a_box_slides_down_a_steep_slope(write_station, solver):
    """The box has the acceleration g (sin a - mu cos a); sap and similar let what slides lift off a little."""
    slope_deg = 35
    friction = 0.5
    duration = 1.2
    box = {"box": CUBE, "mass": 3, "free": True, "pose": on_slope(CUBE, slope_deg)}
    floor = {"size": 40, "incline_deg": slope_deg}

    result = run(write_station, {"box": box}, solver, floor=floor, duration=duration)

    slope = np.deg2rad(slope_deg)
    acceleration = G * (np.sin(slope) - friction * np.cos(slope))
    assert way(result, "box") == pytest.approx(acceleration * duration**2 / 2, rel=0.025)


@every_solver
def test_a_box_holds_on_a_gentle_slope(write_station, solver):
    """Stiction gives way by at most contact.stiction_speed, 1 mm/s, for a second."""
    slope_deg = 20
    box = {"box": CUBE, "mass": 3, "free": True, "pose": on_slope(CUBE, slope_deg)}

    result = run(write_station, {"box": box}, solver, floor={"size": 40, "incline_deg": slope_deg})

    assert way(result, "box") < 1.2e-3


@pytest.mark.parametrize("solver", ["lagged", "cenic"])
@pytest.mark.parametrize(("degrees", "tips"), [(25, False), (28, True)])
def test_a_tall_box_tips_where_its_centre_leaves_its_base(write_station, solver, degrees, tips):
    size = [0.1, 0.1, 0.2]  # it tips at arctan(0.1 / 0.2) = 26.6 degrees
    box = {"box": size, "mass": 3, "free": True, "pose": on_slope(size, degrees)}
    floor = {"size": 20, "incline_deg": degrees}

    result = run(write_station, {"box": box}, solver, floor=floor, friction=1.0, duration=1.5)

    assert (way(result, "box") > 0.05) == tips


@pytest.mark.parametrize("solver", ["sap", "lagged", "cenic"])
def test_turned_boxes_stack_and_crossed_beams_carry_each_other(write_station, solver):
    """No corner of the turned box lies on the other one: edges carry it."""
    boxes = {
        "low": {"box": [0.2, 0.2, 0.2], "mass": 3, "free": True, "pose": [0, 0, 0.1, 0, 0, 0]},
        "high": {
            "box": [0.2, 0.2, 0.2],
            "mass": 3,
            "free": True,
            "pose": [0.03, 0, 0.3, 0.3, 0, 0],
        },
        "beam": {"box": [0.4, 0.05, 0.05], "mass": 1, "free": True, "pose": [1, 0, 0.025, 0, 0, 0]},
        "cross": {
            "box": [0.4, 0.05, 0.05],
            "mass": 1,
            "free": True,
            "pose": [1, 0, 0.075, np.pi / 2, 0, 0],
        },
    }
    sensors = {name: {"kind": "force", "body": name} for name in ("high", "cross")}
    sensors["floor"] = {"kind": "force", "body": "low", "other": "floor"}

    result = run(write_station, boxes, solver, sensors=sensors)

    late = result.times > 0.5
    for name, load in (("high", 3), ("cross", 1), ("floor", 6)):
        assert result[f"force.{name}.z"][late] == pytest.approx(load * G, rel=0.02)
    for name, height in (("high", 0.3), ("cross", 0.075)):
        assert result[f"piece.{name}.z"][-1] == pytest.approx(height, abs=3e-4)
    assert result.warnings == []


@pytest.mark.parametrize("solver", ["sap", "cenic"])
def test_a_pushed_box_slides_on_a_table(write_station, solver):
    """A push of 25 N for 0.3 s gives the box a speed, which friction then takes away: v t / 2 + v² / (2 mu g)."""
    mass = 3
    friction = 0.5
    push_force = 25
    push_time = 0.3
    table = {"box": [1.6, 0.6, 0.1], "parent": "world", "pose": [0, 0, 0.4, 0, 0, 0]}
    box = {"box": CUBE, "mass": mass, "free": True, "pose": [0, 0, 0.55, 0, 0, 0]}
    push = {
        "kind": "push",
        "at": "box",
        "start": 0.1,
        "duration": push_time,
        "force": [-push_force, 0, 0],
    }

    result = run(write_station, {"table": table, "box": box}, solver, forces={"shove": push})

    speed = (push_force / mass - friction * G) * push_time
    distance = speed * push_time / 2 + speed**2 / (2 * friction * G)
    assert result["piece.box.x"][-1] == pytest.approx(-distance, rel=0.01)


@pytest.mark.parametrize("solver", ["sap", "cenic"])
def test_a_cylinder_rolls_down_a_slope(write_station, solver):
    """A full cylinder rolls with the acceleration 2/3 g sin a, so it goes half of that in 1 s."""
    slope_deg = 10
    position = on_slope(CUBE, slope_deg)[:3]  # the cylinder is as wide as the cube
    roller = {"cylinder": [0.1, 0.4], "mass": 3, "free": True, "pose": [*position, 0, 0, np.pi / 2]}

    result = run(
        write_station, {"roller": roller}, solver, floor={"size": 20, "incline_deg": slope_deg}
    )

    acceleration = 2 / 3 * G * np.sin(np.deg2rad(slope_deg))
    assert way(result, "roller") == pytest.approx(acceleration / 2, rel=0.01)


def test_a_single_point_is_still_to_be_had_and_its_verdict_says_what_is_wrong(write_station):
    crate = {"box": [0.3, 0.2, 0.15], "mass": 2, "free": True, "pose": [0, 0, 0.075, 0, 0, 0]}
    push = {"kind": "push", "at": "crate", "start": 0.1, "duration": 0.8, "force": [15, 0, 0]}
    contact = {"friction": {"static": 0.4, "dynamic": 0.4}, "corners": False}

    result = run(write_station, {"crate": crate}, "lagged", contact=contact, forces={"shove": push})

    assert abs(result["piece.crate.x"][-1]) < 0.01  # it sticks, against Coulomb's law
    assert any("set contact.corners to true" in warning for warning in result.warnings)
    assert any(
        warning.startswith("the friction between crate and floor is 1")
        for warning in result.warnings
    )


def shapes_of(overrides, name):
    """Inspector of a station's scene graph, its shapes with a text in their names, and the pairs that can touch."""
    station = add_plant(DiagramBuilder(), resolve(load_station("box_on_floor", overrides)))
    inspector = station.scene_graph.model_inspector()
    pairs = inspector.GetCollisionCandidates()
    shapes = [
        shape
        for shape in inspector.GetAllGeometryIds(Role.kProximity)
        if name in inspector.GetName(shape)
    ]
    return inspector, shapes, pairs


BARE = {"pieces.box.model": "box"}


def test_only_corners_touch_the_floor():
    """A box has balls at its corners and edges, of which only the eight at the corners can touch a plane."""
    inspector, shapes, pairs = shapes_of(BARE, "box.")

    kinds = [type(inspector.GetShape(shape)) for shape in shapes]
    assert kinds.count(Box) == 1
    assert kinds.count(Sphere) > 8
    all_shapes = inspector.GetAllGeometryIds(Role.kProximity)
    (floor,) = [shape for shape in all_shapes if inspector.GetName(shape) == "floor"]
    assert isinstance(inspector.GetShape(floor), HalfSpace)
    touching = set()
    for pair in pairs:
        if floor in pair:
            touching |= {inspector.GetName(shape) for shape in pair if shape != floor}
    assert len(touching) == 8
    assert all(".corner_" in name for name in touching)


@pytest.mark.parametrize(
    "overrides",
    [
        {"contact.corners": False},
        {"contact.model": "hydroelastic"},
        {"solver": {"kind": "mujoco", "time_step": 0.002}},
        {
            "pieces.box.model": "ball",
            "pieces.box.mass": 1,
        },
    ],
)
def test_no_balls_where_they_are_not_needed(overrides):
    _, shapes, _ = shapes_of({**BARE, **overrides}, "box.")
    assert len(shapes) == 1


# A tall box with the corners 0 and 1 at the ends of an upright edge.
LOWEST = np.array([-0.1, -0.2, 0.0])
HIGHEST = np.array([0.1, 0.2, 0.6])
CORNERS = np.array([*product(*np.column_stack([LOWEST, HIGHEST]))])


def centres_of(balls):
    """Centres of balls, shape (k, 3) [m]."""
    return np.array([ball.centre for ball in balls])


def test_balls_touch_the_faces_from_inside():
    """Balls at the corners of a large box have the largest radius, and reach exactly to its faces."""
    balls = balls_at_corners(CORNERS)

    assert all(ball.radius == LARGEST_RADIUS for ball in balls)
    centres = centres_of(balls)
    np.testing.assert_allclose(centres.max(axis=0) + LARGEST_RADIUS, HIGHEST, atol=1e-12)
    np.testing.assert_allclose(centres.min(axis=0) - LARGEST_RADIUS, LOWEST, atol=1e-12)


def test_balls_may_protrude_from_the_faces():
    """A protrusion moves the balls outward along x, y and z."""
    protrusion = 1e-4

    centres = centres_of(balls_at_corners(CORNERS, protrusion=protrusion))

    flush = centres_of(balls_at_corners(CORNERS))
    np.testing.assert_allclose(centres.max(axis=0) - flush.max(axis=0), protrusion, atol=1e-12)


def test_balls_are_evenly_spaced_along_an_edge():
    """The shortest side between the centres is 0.198 m, so parts of 0.6 m are at most 0.099 m long: seven."""
    balls = balls_at_corners(CORNERS)

    on_edge = [*balls_on_edges(balls, [Edge(0, 1)])]

    assert len(on_edge) == 6
    heights = centres_of([balls[0], *on_edge, balls[1]])[:, 2]
    np.testing.assert_allclose(np.diff(heights), 0.598 / 7, atol=1e-12)


def test_a_small_shape_has_small_balls():
    corners = np.array([*product((-0.001, 0.001), repeat=3)])
    assert {ball.radius for ball in balls_at_corners(corners)} == {1e-4}


def test_balls_of_a_long_cylinder_let_it_roll():
    """A long cylinder rolls on two wide balls; the small ones at its rims protrude from its ends only."""
    radius = 0.05
    half_length = 0.2

    balls = balls_of_cylinder(radius, half_length, SMALLEST_PROTRUSION)

    wide = [ball for ball in balls if ball.radius > 0.04]
    assert [ball.centre[2] for ball in wide] == pytest.approx([-0.15, 0.15])
    rim = [ball for ball in balls if ball.radius <= 0.04]
    assert len(rim) == 24
    for ball in rim:
        assert np.hypot(*ball.centre[:2]) + ball.radius < radius
        assert abs(ball.centre[2]) + ball.radius == pytest.approx(half_length + SMALLEST_PROTRUSION)


def test_a_disc_has_small_balls_only():
    """A cylinder that is wider than long does not roll, and gets no wide balls."""
    balls = balls_of_cylinder(0.1, 0.01, SMALLEST_PROTRUSION)

    assert all(isinstance(ball, ContactBall) and ball.radius <= LARGEST_RADIUS for ball in balls)


def test_bodies_that_are_deep_in_each_other_do_not_start(write_station):
    """Under radau3 such a run would take steps of 2e-7 s for minutes."""
    pieces = {
        "low": {"box": [0.2, 0.2, 0.2], "parent": "world", "pose": [0, 0, 0.1, 0, 0, 0]},
        "high": {"box": [0.2, 0.2, 0.2], "mass": 3, "free": True, "pose": [0, 0, 0.26, 0, 0, 0]},
    }

    with pytest.raises(
        InvalidParameter, match=r"overlap of high and low is 40\.0 mm; it must be at most 10 mm"
    ):
        run(write_station, pieces, "radau3")

    config = load_station(
        write_station({"pieces": pieces, "floor": {"size": 1}, "contact": {}, "duration": 1.0})
    )
    (finding,) = [one for one in check_station(config) if one.subject == "contact"]

    assert finding.level == "warning"
    assert finding.text.startswith(
        "high and low overlap by 40.0 mm at the start, so a run does not begin"
    )

    pieces["high"]["pose"][2] = 0.299
    assert run(write_station, pieces, "cenic", duration=0.1).ending == "completed"


@pytest.mark.parametrize("solver", ["lagged", "cenic"])
def test_aligned_boxes_stack_on_soft_contacts(write_station, solver):
    """Corners and edges of both boxes coincide: sixteen balls, four at corners and four on edges of each, carry 30 kg.

    They are larger than usual, since four of them would sink in by m g / (4 k) = 7.4 mm.
    """
    boxes = {
        "low": {"box": [0.2, 0.2, 0.2], "parent": "world", "pose": [0, 0, 0.1, 0, 0, 0]},
        "high": {"box": [0.2, 0.2, 0.2], "mass": 30, "free": True, "pose": [0, 0, 0.3, 0, 0, 0]},
    }
    friction = {"static": 0.5, "dynamic": 0.5}
    contact = {"stiffness": 1e4, "dissipation": 10, "friction": friction}
    verdict = {"penetration": 0.02}
    result = run(write_station, boxes, solver, contact=contact, verdict=verdict, duration=1.5)

    x, y, z = result.piece_pose("high")[-1, :3]

    assert abs(x) < 1e-3
    assert abs(y) < 1e-3
    assert z == pytest.approx(0.3 - 30 * G / (16 * 1e4), abs=2e-5)
    assert result.warnings == []
