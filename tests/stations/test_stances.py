"""Stances of robots with a free base, compared with geometry and statics, and the results of trials."""

import numpy as np
import pytest

from simrob_drake.parts.station_plant import StationRobot
from simrob_drake.stations import draft
from simrob_drake.stations.checks import check_station
from simrob_drake.stations.clearance import Clearance
from simrob_drake.stations.draft import draft_station
from simrob_drake.stations.draft_trials import StandingTrial, stands
from simrob_drake.stations.load import load_station
from simrob_drake.stations.stances import Stance, Stances
from tests.stations.conftest import joint, link

DYNAMIC = {
    "contact": {"model": "point"},
    "solver": {"kind": "discrete", "scheme": "sap", "time_step": 2e-3},
    "servo": {"realization": "implicit", "kp": 100.0, "kd": 5.0},
}


def first_of(clearance: Clearance) -> tuple[StationRobot, Stance | None]:
    """The robot of a station, and its first good stance, or None if it has none."""
    robot = clearance.station.robots["robot"]
    return robot, next(Stances(clearance, robot).find(), None)


@pytest.mark.long
def test_a_quadruped_whose_home_is_on_its_knees_is_put_on_its_feet(quadruped, clearance_of):
    """Knees at -97 deg bring its shanks level, forward of the knees, which are lowest then."""
    length = 0.2  # of a thigh and of a shank [m]

    robot, stance = first_of(clearance_of(quadruped(), **DYNAMIC))

    assert stance is not None
    thighs = stance.posture[::2]
    shanks = stance.posture[1::2]
    knees = stance.height - length * np.cos(thighs)
    feet = knees - length * np.cos(thighs + shanks)
    assert np.ptp(feet) < 1.5e-3
    # the middle of a shank's end; its corner, up to 14 mm farther, is on the floor
    assert np.abs(feet).max() < 0.02
    assert knees.min() > 0.1
    assert stance.standing.gap == pytest.approx(0.0, abs=1e-9)
    assert set(stance.standing.carrying_links) == {f"shank{number}" for number in range(4)}
    lower, upper = robot.model.axis_limits
    assert ((stance.posture >= lower) & (stance.posture <= upper)).all()
    hips_ahead = np.array([0.18, 0.18, -0.18, -0.18])
    feet_ahead = hips_ahead - length * (np.sin(thighs) + np.sin(thighs + shanks))
    assert np.abs(feet_ahead.mean()) < 0.02  # the trunk's centre of mass is over the feet


@pytest.mark.long
def test_a_robot_that_stands_at_home_stays_as_it_is(quadruped, clearance_of):
    _, stance = first_of(clearance_of(quadruped(knees_deg=0.0, most_deg=10.0), **DYNAMIC))

    assert stance is not None
    assert stance.how == "in the home posture"
    assert stance.height == pytest.approx(0.4)


@pytest.mark.parametrize("effort", [3.0, 1.0])
def test_motors_have_to_hold_what_a_robot_holds_out(robot_of, clearance_of, effort):
    """A level bar of 1 kg, 0.4 m long, takes 1.96 N m; the robot has no legs, and stands on its trunk."""
    parts = link("trunk", "0.2 0.2 1.0", "0 0 0.5", 20.0), link("bar", "0.4 0.05 0.05", "0.2 0 0")
    urdf = robot_of(
        *parts, joint("bar", "trunk", "0 0 0.5", effort=effort), base="floating", axes=["bar_joint"]
    )
    clearance = clearance_of(urdf, **DYNAMIC)
    stances = Stances(clearance, clearance.station.robots["robot"])

    found = list(stances.find())

    if effort > 2.0:
        assert [(stance.how, list(stance.standing.carrying_links)) for stance in found] == [
            ("in the home posture", ["trunk"])
        ]
        assert stances.lacking == ""
        texts = [finding.text for finding in check_station(clearance.config)]
        # though its trunk stands near its own origin
        assert not any("the robot kneels" in text for text in texts)
    else:
        assert found == []
        assert (
            stances.lacking
            == "In the best of 1 tried stance, bar_joint requires 1.96 N·m, but its limit is 1 N·m."
        )


def test_links_that_lie_in_each_other_at_home_are_turned_apart(robot_of, clearance_of):
    """The hand of an arm with a folded elbow overlaps the trunk."""
    parts = (
        link("trunk", "0.5 0.5 0.2", "0 0 0.1", 20.0),
        link("arm", "0.1 0.02 0.02", "0.05 0 0", 0.1),
    )
    parts += (link("hand", "0.2 0.04 0.04", "-0.1 0 0", 0.1), joint("arm", "trunk", "0.2 0 0.22"))
    urdf = robot_of(
        *parts,
        joint("hand", "arm", "0.12 0 -0.03"),
        base="floating",
        axes=["arm_joint", "hand_joint"],
    )

    _, stance = first_of(clearance_of(urdf, **DYNAMIC))

    assert stance is not None
    assert stance.posture.any()
    assert stance.how == "in the home posture, with some links turned apart"


def test_coupled_axes_are_turned_together(robot_of, clearance_of):
    """The hand overlaps the trunk. A flag on top of the trunk follows the hand's joint in the robot's file."""
    parts = (
        link("trunk", "0.5 0.5 0.2", "0 0 0.1", 20.0),
        link("arm", "0.1 0.02 0.02", "0.05 0 0", 0.1),
        link("hand", "0.2 0.04 0.04", "-0.1 0 0", 0.1),
        link("flag", "0.02 0.02 0.02", "0 0 0.01", 0.01),
    )
    follower = joint("flag", "trunk", "-0.2 0.2 0.3").replace(
        "</joint>", '<mimic joint="hand_joint" multiplier="0.5"/></joint>'
    )
    urdf = robot_of(
        *parts,
        joint("arm", "trunk", "0.2 0 0.22"),
        joint("hand", "arm", "0.12 0 -0.03"),
        follower,
        base="floating",
        axes=["arm_joint", "hand_joint", "flag_joint"],
    )

    _, stance = first_of(clearance_of(urdf, **DYNAMIC))

    assert stance is not None
    _, hand, flag = stance.posture
    assert hand != 0.0
    assert flag == pytest.approx(0.5 * hand)


@pytest.mark.long
def test_check_says_that_a_robot_kneels(quadruped, clearance_of):
    urdf = quadruped()
    clearance = clearance_of(urdf, **DYNAMIC)

    kneeling = Stances(clearance, clearance.station.robots["robot"]).as_it_is()

    assert kneeling is not None

    base = {"base": [0.0, 0.0, kneeling.height, 0.0, 0.0, 0.0]}
    texts = [finding.text for finding in check_station(clearance_of(urdf, base, **DYNAMIC).config)]

    assert any(text.startswith("the robot kneels: the contact points of shank0") for text in texts)


@pytest.mark.long
def test_the_draft_of_a_quadruped_was_tried_and_has_a_fall_monitor(quadruped, tmp_path):
    text = draft_station(quadruped(), folder=tmp_path)
    (file := tmp_path / "first.yaml").write_text(text)

    config = load_station(file)

    assert "# The robot stands with its legs bent to 90% of their length, on shank" in text
    assert "# In a trial run, after 2 s the robot leans by 0.0 deg" in text
    fall = config.monitors["fall"]
    assert fall.height == pytest.approx(0.6 * config.robots["robot"].base[2], abs=1e-3)
    assert fall.tilt_deg == 40
    assert [finding.text for finding in check_station(config) if finding.level == "warning"] == []


@pytest.mark.long
def test_a_stance_that_does_not_hold_is_no_stance(quadruped, tmp_path, monkeypatch):
    tried = []

    def fell(config):
        tried.append(config.robots["robot"].initial_deg)
        return StandingTrial(is_standing=False, outcome=f"it fell at {len(tried)} s")

    monkeypatch.setattr(draft, "stands", fell)
    text = draft_station(quadruped(knees_deg=-60.0), folder=tmp_path)
    assert "# By statics, the robot stands " in text
    assert "# But in a trial run, it fell at 1 s." in text  # the first is kept
    assert 1 < len(tried) <= 4
    assert len({str(posture) for posture in tried}) == len(tried)


def test_of_a_robot_that_finds_no_stance_the_draft_says_so(quadruped, tmp_path):
    text = draft_station(quadruped(legs=1), folder=tmp_path)

    assert "# No posture was found in which the robot stands on its feet. In the best of " in text
    assert "the centre of mass is" in text
    assert "in a trial run, the robot fell at 0." in text


def test_a_robot_that_nothing_could_carry_is_held(robot_of, tmp_path):
    bare = [
        part.partition("<collision>")[0] + "</link>"
        for part in (link("trunk", "1 1 1"), link("bar", "1 1 1", "0 0 1"))
    ]
    urdf = robot_of(*bare, joint("bar", "trunk", "0 0 0"), base="floating", axes=["bar_joint"])

    text = draft_station(urdf, folder=tmp_path)

    assert "no collision shapes" in text
    assert "base: fixed" in text


TOP = [link("trunk", "0.1 0.1 0.5", "0 0 0.25", 2.0), link("arm", "0.02 0.02 0.1", "0 0 0.05", 0.1)]


@pytest.mark.parametrize(
    ("tilt", "monitors", "held", "told"),
    [
        (0.0, {}, True, "after 2 s the robot leans by 0.0 deg, and its root is 0 mm lower"),
        (20.0, {}, False, "after 2 s the robot leans by 70.0 deg"),
        (20.0, {"fall": {"tilt_deg": 40.0}}, False, "the robot fell at 0."),
    ],
)
def test_a_trial_tells_what_stands_from_what_falls(
    robot_of, clearance_of, tilt, monitors, held, told
):
    """A box of 0.1 m by 0.5 m tips over beyond 11.3 deg."""
    urdf = robot_of(*TOP, joint("arm", "trunk", "0 0 0.5"), base="floating", axes=["arm_joint"])
    pitch = np.deg2rad(tilt)
    base = {"base": [0.0, 0.0, 0.05 * np.sin(pitch), 0.0, pitch, 0.0]}
    config = clearance_of(urdf, base, monitors=monitors, **DYNAMIC).config

    stood, text = stands(config)

    assert (stood, text.startswith(told)) == (held, True), text
