"""Predictions of `simrob check`, compared with the runs that follow."""

import json

import numpy as np
import pytest

from simrob_drake import Arm, load_station, simulate
from simrob_drake.base.errors import SimrobError
from simrob_drake.base.frames import transform_from_pose
from simrob_drake.stations import plant
from simrob_drake.stations.checks import check_station
from simrob_drake.stations.plant import add_robot


def findings(overrides=None, station="irb120_dynamic"):
    return check_station(load_station(station, overrides))


def text_of(found, subject):
    return next(finding for finding in found if finding.subject == subject)


@pytest.mark.long
def test_a_sound_station_has_no_warnings():
    for station in (
        "irb120_dynamic",
        "irb120_kinematic",
        "double_pendulum",
        "two_irb120",
        "roid1_balance",
    ):
        assert [
            finding for finding in findings(station=station) if finding.level == "warning"
        ] == []


def test_too_weak_a_motor_is_foretold_with_its_figures():
    finding = text_of(findings({"servo.torque_limit": 10}), "torque of joint_2")

    assert finding.level == "warning"
    assert "-20.79 N·m at the end" in finding.text  # facts of the arm
    assert "the limit is 10 N·m" in finding.text
    assert text_of(findings({"servo.torque_limit": 10}), "torque of joint_1").level == "ok"


def test_too_fast_a_reference_is_foretold():
    found = [
        finding
        for finding in findings({"reference.duration": 0.1})
        if finding.subject == "reference of robot"
    ]

    texts = [finding.text for finding in found if finding.level == "warning"]
    # 300 deg/s is too fast for these axes; those of the wrist may have 320 and 420.
    assert len(texts) == 3
    for axis, text in zip(("joint_1", "joint_2", "joint_3"), texts, strict=True):
        assert text.startswith(f"the reference of {axis} reaches 300 deg/s")
    assert (
        texts[0]
        == "the reference of joint_1 reaches 300 deg/s, but the limit is 250 deg/s; give the motion more time"
    )


def test_a_reference_that_begins_away_from_the_robot_is_foretold():
    away = {
        "reference": {"kind": "hold", "target_deg": 0},
        "robot.initial_deg": {"joint_5": 90, "joint_1": -20},
    }
    (jump,) = [finding for finding in findings(away) if "start of" in finding.subject]

    assert jump.level == "warning"
    assert jump.text.startswith(
        "joint_5 begins at 90 deg, but its reference begins at 0 deg, and 1 other axis jumps too;"
    )
    assert (
        "set robot.initial_deg, or let the reference begin at the robot's initial position"
        in jump.text
    )


@pytest.mark.parametrize("section", ["robot", "robots.left"])
def test_the_start_of_an_only_robot_is_set_under_the_key_of_its_section(section):
    station = {
        "name": "only_one",
        "mode": "dynamic",
        f"{section}.model": "irb120",
        "reference": {"kind": "hold", "target_deg": 0},
    }
    settings = {f"{section}.initial_deg": {"joint_5": 90}}

    checked = check_station(load_station({"name": "only_one"}, station | settings))

    (jump,) = [finding for finding in checked if "start of" in finding.subject]
    assert jump.text.endswith(
        f"; set {section}.initial_deg, or let the reference begin at the robot's initial position"
    )


def test_a_reference_that_begins_where_the_robot_does_is_in_order():
    near = {"reference": {"kind": "hold", "target_deg": 0}, "robot.initial_deg": {"joint_5": 0.5}}
    assert not [finding for finding in findings(near) if "start of" in finding.subject]


def test_too_heavy_a_load_is_foretold():
    finding = text_of(findings({"pieces.load.mass": 60}), "torque of joint_2")
    assert finding.level == "warning"
    assert "the limit is 150 N·m" in finding.text


def test_a_kinematic_arm_too_weak_for_its_load_and_one_that_carries_too_much_are_told():
    found = findings({"pieces.load.mass": 60}, "irb120_kinematic")

    assert "the joint does not hold" in text_of(found, "torque of joint_2").text
    (payload,) = [
        finding
        for finding in found
        if finding.level == "warning" and finding.subject == "payload of robot"
    ]
    assert payload.text.startswith(
        "the robot carries 61 kg (gripper 1 kg + load 60 kg), but its rated payload is 3 kg"
    )

    result = simulate(
        load_station("irb120_kinematic", {"pieces.load.mass": 8, "duration": 0.1}), progress=False
    )
    assert "robot carried 300 % of its rated payload, 9 of 3 kg (bound 100 %)" in result.warnings


def test_gravity_that_pulls_up_and_a_centre_of_mass_in_millimetres_are_told():
    finding = text_of(findings({"gravity": -9.81}), "implausible number")
    assert finding.text == "gravity: -9.81 m/s² points up; write 9.81 for gravity along -z"
    with pytest.raises(
        SimrobError, match=r"pieces\.load\.com.*70 m is too far; lengths are in metres"
    ):
        load_station("irb120_dynamic", {"pieces.load.com": [0, 0, 70]})


@pytest.fixture
def two_dice(tmp_path):
    """File of a station in which two dice fall on a floor."""
    pieces = {
        "a": {"model": "die", "free": True, "pose": [0, 0, 0.1, 0, 0, 0]},
        "b": {"model": "die", "free": True, "pose": [0, 0, 0.2, 0, 0, 0]},
    }
    station = {
        "mode": "dynamic",
        "pieces": pieces,
        "floor": {"size": 1},
        "contact": {"model": "point"},
    }
    file = tmp_path / "stack.yaml"
    file.write_text(json.dumps(station))
    return file


def warnings_of(found):
    """Texts of the warnings among findings."""
    return [finding.text for finding in found if finding.level == "warning"]


def test_a_flat_body_on_a_single_point_is_reported(two_dice):
    """If flat bodies have no balls at their corners, one warning names a body and the remedy."""
    (warning,) = warnings_of(findings({"contact.corners": False}, two_dice))

    assert warning.startswith("a has a single contact point, which jumps from corner to corner")
    assert warning.endswith("set contact.corners to true")


@pytest.mark.parametrize("changes", [{}, {"contact.model": "hydroelastic"}])
def test_a_flat_body_on_several_points_or_a_surface_is_in_order(two_dice, changes):
    """Balls at corners, and contact over surfaces, carry a flat body."""
    assert not warnings_of(findings(changes, two_dice))


@pytest.mark.parametrize(("kp", "level"), [(500, "ok"), (50, "warning")])
def test_the_sag_is_foretold_and_judged_by_the_bound_of_the_verdict(kp, level):
    """The predicted sag is that at the end of a run. At kp = 50 the arm still swings a little after 1.5 s of rest."""
    changes = {"servo.kp": kp, "reference.duration": 0.5, "duration": 2.0}

    finding = text_of(findings(changes), "torque of joint_2")

    assert finding.level == level
    predicted_deg = float(finding.text.partition("sags by ")[2].split()[0])
    result = simulate(load_station("irb120_dynamic", changes), progress=False)
    errors = np.abs(result["q.joint_2"] - result["q_ref.joint_2"])
    assert predicted_deg == pytest.approx(np.rad2deg(errors[-1]), rel=0.03)
    assert any("joint_2 ended" in warning for warning in result.warnings) == (level == "warning")


def test_a_tool_that_sags_below_the_floor_is_foretold():
    found = findings({"servo.kp": 50})
    tool = text_of(found, "tool of robot")

    assert tool.level == "warning"
    assert "after the joints have sagged, load is 112 mm below the floor (bound 5 mm)" in tool.text
    assert not [
        one
        for one in findings({"servo.kp": 50, "servo.feedforward": "gravity"})
        if one.level == "warning"
    ]


def test_without_a_bound_no_sag_is_judged():
    bounds = {"verdict.final_error_deg": "none", "verdict.below_floor": "none"}
    assert not [one for one in findings({"servo.kp": 50, **bounds}) if one.level == "warning"]


def test_explicit_servos_with_long_steps_are_foretold():
    finding = text_of(findings({"solver.kind": "discrete", "solver.time_step": 0.01}), "steps")

    assert finding.level == "warning"
    assert "joint_6" in finding.text
    assert (
        text_of(findings({"solver.kind": "discrete", "solver.time_step": 1e-4}), "steps").level
        == "ok"
    )


def test_the_step_limit_is_where_an_explicit_damper_becomes_unstable():
    """One joint, no spring, explicit Euler: v' = -(kd/M) v is stable up to h = 2 M/kd."""
    finding = text_of(
        findings({"solver.scheme": "explicit_euler", "solver.max_step": 1e-5}), "steps"
    )
    limit = float(finding.text.split("steps below ")[1].split(" s")[0])
    # facts of the arm: M66 = 0.001 kg m² bare; gripper and load add 1e-3 kg m² and their offsets
    assert 2 * 0.001 / 10 < limit < 2 * 0.003 / 10


def test_the_damping_of_an_axis_that_slides_is_told_in_its_units():
    heavy = {
        "mode": "dynamic",
        "servo.kd": {"belt": 1e6},
        "solver": {"kind": "discrete", "time_step": 0.01},
    }
    finding = text_of(findings(heavy, "irb120_on_belt"), "steps")
    assert "the damping of belt (kd 1e+06 N·s/m)" in finding.text


def test_a_reference_beyond_a_limit_is_an_error():
    with pytest.raises(SimrobError, match=r"reference of joint_3 is 80 deg; .* -110 to 70 deg"):
        findings({"reference.target_deg": {"joint_3": 80}})


@pytest.mark.long
def test_bodies_that_penetrate_at_the_start_are_named():
    close = {"contact": {"model": "point"}, "robots.right.base": [0.05, 0.45, 0, 0, 0, 0]}
    finding = text_of(findings(close, "two_irb120"), "contact")

    assert finding.level == "warning"
    assert "mm at the start" in finding.text

    apart = text_of(findings({"contact": {"model": "point"}}, "two_irb120"), "contact")
    assert apart.level == "ok"


def test_a_check_builds_the_station_twice_with_and_without_shapes(monkeypatch):
    built = []
    monkeypatch.setattr(
        plant, "add_robot", lambda *given, **kw: built.append(given) or add_robot(*given, **kw)
    )

    findings(station="irb120_force_stop")

    assert len(built) == 2


def test_a_check_lists_where_each_piece_hangs():
    found = findings(station="irb120_chess")

    assert (
        text_of(found, "pieces.gripper").text
        == "mounted on robot, at frame tool0, with its origin at 0 0 0 m"
    )
    assert (
        text_of(found, "pieces.pencil").text
        == "mounted on gripper, at frame tcp, with its origin at 0 0 0 m; robot carries it"
    )
    assert (
        text_of(found, "pieces.chess_board").text
        == "mounted on world, with its origin at 0.175 -0.2 0.15 m"
    )

    ball = text_of(findings(station="bouncing_ball"), "pieces.ball")
    assert ball.text == "free: only gravity and contact move it"
    assert {finding.level for finding in found if finding.subject.startswith("pieces.")} == {"note"}


@pytest.mark.long
def test_nothing_is_in_order_that_was_not_looked_at():
    found = findings(station="humanoid_walking")

    assert text_of(found, "controllers.walk").level == "note"
    assert "not examined" in text_of(found, "controllers.walk").text
    assert text_of(findings(), "contact").level == "note"

    ok = text_of(findings(), "reference of robot")
    # 30 of 250 deg/s
    assert (
        ok.text
        == "within the joint limits at 501 samples from 0 to 3 s, at most 12% of their speed limits"
    )


LOW = {"reference.target_deg": {"joint_2": 80, "joint_3": 20}}  # the wrist goes through the floor


def test_a_motion_through_the_floor_is_foretold():
    """The warning has the depth of the lowest point of link_6, a disc behind the flange."""
    radius = 0.02  # [m]
    length = 0.013  # [m]
    at_target = {"pieces": {}, "robot.initial_deg": LOW["reference.target_deg"]}

    finding = text_of(findings({"pieces": {}, **LOW}), "floor and robot")

    assert finding.level == "warning"
    assert "the station has no contact" in finding.text
    flange = transform_from_pose(Arm(load_station("irb120_kinematic", at_target)).pose())
    cosine = flange.rotation().matrix()[2, 2]  # of the disc's axis and the vertical
    reach_below_flange = radius * np.sqrt(1 - cosine**2) + max(length * cosine, 0.0)
    depth = reach_below_flange - flange.translation()[2]
    assert finding.text.startswith(f"link_6 is {1e3 * depth:.0f} mm below the ground")


def test_a_motion_through_the_floor_is_only_a_note_with_contact():
    """If the station has contact, the finding is a note: the run itself shows that the floor stops the arm."""
    finding = text_of(findings({"pieces": {}, "contact": {}, **LOW}), "floor and robot")

    assert finding.level == "note"


def test_links_that_run_into_each_other_are_foretold():
    folded = {"pieces": {}, "reference.target_deg": {"joint_1": 120, "joint_2": 90, "joint_3": 60}}
    finding = text_of(findings(folded), "links of robot")

    assert finding.level == "warning"
    assert finding.text.startswith("base_link and link_5 overlap by ")
    assert text_of(findings({"pieces": {}}), "links of robot").level == "ok"


def test_a_robot_in_a_piece_is_foretold():
    box = {"model": "box", "parent": "world", "pose": [0.2, 0, 0.63, 0, 0, 0]}
    finding = text_of(
        findings({"pieces": {"box": box}, "reference.kind": "hold"}), "robots and pieces"
    )

    assert finding.level == "warning"
    assert finding.text.startswith("box and link_")
    away = {**box, "pose": [2, 0, 0.63, 0, 0, 0]}
    assert text_of(findings({"pieces": {"box": away}}), "robots and pieces").level == "ok"


RIGID = """<collision><geometry><box size="0.1 0.1 0.1"/></geometry>
      <drake:proximity_properties><drake:rigid_hydroelastic/></drake:proximity_properties></collision></link>"""


def test_rigid_bodies_that_would_meet_in_points_are_named(one_joint_urdf, write_urdf, tmp_path):
    text = one_joint_urdf.replace('<link name="tip"/>', f'<link name="tip">{RIGID}')
    arm = {"urdf": str(write_urdf(text))}
    contact = {"model": "hydroelastic_with_fallback"}
    overrides = {
        "robots": {"left": arm, "right": {**arm, "base": [1, 0, 0, 0, 0, 0]}},
        "contact": contact,
    }
    (file := tmp_path / "two.yaml").write_text(
        json.dumps({**overrides, "reference": {"kind": "hold"}})
    )

    (warning,) = [
        f.text
        for f in check_station(load_station(file))
        if f.level == "warning" and f.subject == "contact"
    ]

    assert "left::arm::upper and right::arm::upper touch only at points" in warning


def test_a_solver_that_knows_no_dissipation_says_so():
    overrides = {"solver.kind": "discrete", "solver.scheme": "sap"}
    warnings = [
        f.text
        for f in check_station(load_station("bouncing_ball", overrides))
        if f.level == "warning"
    ]
    assert warnings == [
        "the solver scheme sap ignores contact.dissipation; use solver.scheme lagged or similar"
    ]


@pytest.mark.parametrize(("ki", "sags"), [(0.0, True), (10.0, False)])
def test_an_integral_part_removes_the_sag_of_a_robot_that_stands(ki, sags):
    config = load_station("roid1_dynamic", {"servo.ki": ki})

    texts = [finding.text for finding in check_station(config)]

    standing = [text for text in texts if text.startswith("standing requires")]
    assert len(standing) > 10
    assert any("the joint sags by" in text for text in standing) == sags
