"""Refusals of invalid contacts, sensors and monitors: each message names what would be right."""

import pytest

from simrob_drake import load_station, simulate
from simrob_drake.base.errors import SimrobError
from simrob_drake.parts.monitors.sections import force_limit, quasi_static_limits
from simrob_drake.stations.contact import largest_stiffness
from simrob_drake.stations.solver_config import ContinuousSolver, DiscreteSolver

FORCE = {"kind": "force", "body": "load"}
SAP = {"solver.kind": "discrete", "solver.scheme": "sap"}
EULER = {"solver.scheme": "explicit_euler", "solver.max_step": 1e-3}


@pytest.mark.parametrize(
    ("station", "overrides", "message"),
    [
        (
            "bouncing_ball",
            {"sensors.gap.body": "bal"},
            r"body or shape for sensors\.gap\.body 'bal'.*mean 'ball'",
        ),
        ("bouncing_ball", {"sensors.gap.body": "ball.1"}, r"'ball\.1'; did you mean 'ball\.0'"),
        (
            "bouncing_ball",
            {"sensors.floor.other": "flor"},
            r"sensors\.floor\.other 'flor'; did you mean 'floor'",
        ),
        (
            "bouncing_ball",
            {"sensors.floor.frame": "wrld"},
            r"frame for sensors\.floor\.frame 'wrld'.*'world'",
        ),
        (
            "bouncing_ball",
            {"sensors.gap.kind": "distanc"},
            r"sensors\.gap\.kind: there is no 'distanc'",
        ),
        ("bouncing_ball", {"floor": None}, "the station has no floor; add a section floor"),
        (
            "bouncing_ball",
            {"contact": None},
            "a .* sensor needs the section contact; add contact: {}",
        ),
        ("bouncing_ball", {"sensors.t": {"kind": "joint_torque"}}, r"sensors\.t\.robot"),
        (
            "bouncing_ball",
            {"mode": "kinematic"},
            r"pieces\.ball\.free is True; it must be false in a kinematic",
        ),
        (
            "bouncing_ball",
            {"pieces.ball": {"free": False, "parent": "world"}},
            "a station needs something that moves",
        ),
        (
            "bouncing_ball",
            {"pieces.ball.mass": 0},
            r"pieces\.ball\.free .* the piece must have mass and inertia",
        ),
        ("bouncing_ball", {"pieces.ball.parent": "robot"}, "a free piece has the parent world"),
        ("bouncing_ball", {"contact.stiffness": -1}, r"contact\.stiffness: must be greater than 0"),
        ("bouncing_ball", {"contact.dissipation": -0.1}, r"contact\.dissipation: .* at least 0"),
        (
            "bouncing_ball",
            {"contact.friction.dynamic": 2},
            r"contact\.friction: dynamic friction \(2\) must not be more",
        ),
        (
            "bouncing_ball",
            {"monitors.force_limit": {"limit": 0}},
            r"monitors\.force_limit\.limit: .*greater than 0",
        ),
        ("bouncing_ball", {"monitors.force_limit": {"limit": "hand"}}, "no body region 'hand'"),
        (
            "bouncing_ball",
            {"monitors.contact": {"sensor": "gab"}},
            r"distance sensor .* 'gab'; did you mean 'gap'",
        ),
        ("bouncing_ball", {"monitors.contact": {"distance": -1}}, r"monitors\.contact\.distance: "),
        (
            "bouncing_ball",
            {"monitors.fall": {"height": -1}},
            r"monitors\.fall\.height: .*greater than 0",
        ),
        ("bouncing_ball", {"monitors.fall": {}}, r"monitors\.fall: a fall monitor needs a bound"),
        (
            "bouncing_ball",
            {"monitors.fall": {"piece": "bll", "height": 1}},
            r"free piece .* 'bll'.*mean 'ball'",
        ),
        (
            "bouncing_ball",
            {"monitors.workspace": {"lower": [0, 0, 0], "upper": [1, 1, 0]}},
            "it must be below upper",
        ),
        ("irb120_dynamic", {"monitors.contact": {}}, "there is no distance sensor"),
        (
            "irb120_kinematic",
            {"sensors.touch": FORCE},
            "a kinematic station computes no contact forces",
        ),
        ("irb120_force_stop", {"sensors.gap.body": "link_7"}, r"'link_7'; did you mean 'link_\d'"),
        (
            "irb120_dynamic",
            {"sensors.t": {"kind": "joint_torque"}, "solver.scheme": "cenic"},
            "cenic does not compute the reaction forces of joints",
        ),
        (
            "two_irb120",
            {"sensors.t": {"kind": "external_torque"}},
            r"sensors\.t\.robot .* one of left, right",
        ),
        ("irb120_cobot", {"servo.admittance_gain": -1}, r"servo\.admittance_gain"),
        ("irb120_cobot", {"servo.realization": "implicit"}, "admittance_gain needs realization"),
        ("irb120_cobot", {"servo.yield_gain": 100}, r"servo.*yield_gain is now admittance_gain"),
        (
            "irb120_cobot",
            {"forces.shove": {"kind": "push", "start": 0, "duration": 0, "force": [0, 0, 1]}},
            r"forces\.shove\.duration: must be greater than 0",
        ),
    ],
)
def test_a_station_that_cannot_be_is_refused(station, overrides, message):
    with pytest.raises(SimrobError, match=message):
        load_station(station, overrides)


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        (
            {"contact.stiffness": 1e15},
            r"at most 5\.65e\+10 N/m for ball \(0\.905 kg\) with the solver runge_kutta3",
        ),
        (
            {**SAP, "contact.stiffness": 1e7},
            r"at most 1\.07e\+05 N/m for ball .* sap, steps of 0\.001 s",
        ),
        ({**EULER, "contact.stiffness": 1e6}, r"at most 8\.93e\+04 N/m"),
        (
            {"solver.error_control": False, "solver.max_step": 1e-3, "contact.stiffness": 1e6},
            r"at most 8\.93e\+04 N/m",
        ),
        ({"pieces.ball.contact": {"stiffness": 1e15}}, r"at most 5\.65e\+10 N/m"),
    ],
)
def test_a_contact_stiffer_than_the_solver_can_hold_names_the_largest(overrides, message):
    with pytest.raises(SimrobError, match=message):
        simulate(load_station("bouncing_ball", overrides))


@pytest.mark.parametrize("time_step", [1e-3, 5e-3])
def test_the_solver_holds_the_largest_stiffness_that_is_named(time_step):
    """A ball at rest sinks by its weight over the stiffness; the solver would soften a stiffer contact."""
    stiffness = 0.95 * largest_stiffness(
        DiscreteSolver(kind="discrete", time_step=time_step), 0.9048
    )
    overrides = {**SAP, "solver.time_step": time_step, "contact.stiffness": stiffness}
    overrides["pieces.ball.pose"] = [0, 0, 0.06, 0, 0, 0]

    result = simulate(load_station("bouncing_ball", overrides), duration=1.0)

    assert -result["distance.gap"][-1] == pytest.approx(0.9048 * 9.80665 / stiffness, rel=0.1)


@pytest.mark.parametrize(
    "solver",
    [
        ContinuousSolver(kind="continuous", scheme="cenic"),
        DiscreteSolver(kind="discrete", scheme="lagged"),
        DiscreteSolver(kind="discrete", scheme="similar"),
    ],
)
def test_implicit_contact_solvers_hold_any(solver):
    assert largest_stiffness(solver, 1.0) == float("inf")


def test_a_sensor_between_parts_of_one_robot_says_why_it_cannot_work():
    overrides = {"sensors.gap": {"kind": "distance", "body": "tip", "other": "link_2"}}
    with pytest.raises(SimrobError, match=r"contact\.self_collision: true for parts of one robot"):
        simulate(load_station("irb120_force_stop", overrides))


def test_force_limits_of_body_regions_are_those_of_the_standard():
    regions = quasi_static_limits()

    assert (regions["face"], regions["hands_and_fingers"], regions["thighs_and_knees"]) == (
        65,
        140,
        220,
    )
    assert len(regions) == 12
    assert force_limit("chest") == 140
    assert force_limit(12.5) == 12.5


def test_a_free_piece_may_have_negative_products_of_inertia():
    ball = {"pieces.ball.mass": 1.0, "pieces.ball.inertia": [2e-3, 2e-3, 2e-3, -1e-4, 0, 0]}
    load_station("bouncing_ball", ball)
