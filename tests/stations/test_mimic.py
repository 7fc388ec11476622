"""Joints that mimic others, under every solver: the couplings, references and starts that stations make of them."""

import json

import numpy as np
import pytest
import yaml

from simrob_drake import load_station, simulate
from simrob_drake.base.errors import SimrobError
from simrob_drake.importer.importing import examine_robot, robot_from_file
from simrob_drake.stations.checks import check_station
from simrob_drake.stations.draft import draft_station
from simrob_drake.stations.resolve import resolve

LINK = """<link name="{name}"><inertial><origin xyz="0.1 0 0"/><mass value="1"/>
<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>"""
JOINT = """<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{name}_link"/>
<origin xyz="0 0 0.2"/><axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="200" velocity="5"/>{mimic}</joint>"""

# c follows b, which follows a and comes later in the file; d slides by a; e stands alone.
CHAIN = {
    "c": ("revolute", "b_link", '<mimic joint="b" multiplier="-2" offset="0.1"/>'),
    "a": ("revolute", "base", ""),
    "b": ("revolute", "a_link", '<mimic joint="a" multiplier="0.5" offset="0.2"/>'),
    "d": ("prismatic", "base", '<mimic joint="a" multiplier="-0.3"/>'),
    "e": ("revolute", "d_link", ""),
}
SOLVERS = {
    "radau3": {"kind": "continuous", "scheme": "radau3", "accuracy": 1e-3, "max_step": 0.02},
    "cenic": {"kind": "continuous", "scheme": "cenic", "max_step": 0.01},
    "sap": {"kind": "discrete", "scheme": "sap", "time_step": 1e-3},
    "lagged": {"kind": "discrete", "scheme": "lagged", "time_step": 1e-3},
    "similar": {"kind": "discrete", "scheme": "similar", "time_step": 1e-3},
    "mujoco": {"kind": "mujoco"},
}


def urdf(folder, joints):
    """Write a robot of joints with kind, parent link and ``mimic``, and return its file."""
    parts = ["<link name='base'/>"]
    for name, (kind, parent, mimic) in joints.items():
        parts.append(LINK.format(name=f"{name}_link"))
        parts.append(JOINT.format(name=name, kind=kind, parent=parent, mimic=mimic))
    file = folder / "robot.urdf"
    file.write_text(f"<robot name='coupled'>{''.join(parts)}</robot>")
    return file


def station(folder, joints, **sections):
    """Return the station of a robot of joints."""
    robot = {"urdf": str(urdf(folder, joints)), **sections.pop("robot", {})}
    servo = {"realization": "implicit", "kp": 400.0, "kd": 40.0}
    content = {"robot": robot, "servo": servo, "duration": 0.6, **sections}
    (folder / "station.yaml").write_text(yaml.safe_dump(content))
    return load_station(folder / "station.yaml")


def assert_chain_is_held(result, within):
    a, b, c, d = (result[f"q.{axis}"] for axis in "abcd")
    np.testing.assert_allclose(b, 0.5 * a + 0.2, atol=within)
    np.testing.assert_allclose(c, -2 * b + 0.1, atol=within)
    np.testing.assert_allclose(d, -0.3 * a, atol=within)


@pytest.mark.parametrize("solver", SOLVERS)
def test_a_chain_of_mimics_is_held_under_load(tmp_path, solver):
    if solver == "mujoco":
        pytest.importorskip("mujoco")
    move = {"kind": "move", "target_deg": {"a": 30}, "duration": 0.4}

    result = simulate(
        station(tmp_path, CHAIN, solver=SOLVERS[solver], reference=move), progress=False
    )

    assert result.ending == "completed"
    assert result["q.a"][-1] > np.deg2rad(10)
    assert_chain_is_held(result, within=2e-3)
    np.testing.assert_allclose(result["q_ref.b"], 0.5 * result["q_ref.a"] + 0.2, atol=1e-9)
    assert not any("coupling" in warning or "lost" in warning for warning in result.warnings)


def test_a_scheme_that_holds_no_coupling_is_told(tmp_path):
    solver = {"kind": "continuous", "scheme": "runge_kutta3"}
    move = {"kind": "move", "target_deg": {"a": 10}, "duration": 0.1}
    config = station(tmp_path, CHAIN, solver=solver, reference=move, duration=0.1, gravity=0.0)

    result = simulate(config, progress=False)

    told = [
        warning
        for warning in result.warnings
        if "runge_kutta3 does not support couplings" in warning
    ]
    assert [warning.split(" follows ")[0] for warning in told] == ["c", "b", "d"]
    np.testing.assert_allclose(result["q_ref.b"], 0.5 * result["q_ref.a"] + 0.2, atol=1e-9)


@pytest.mark.parametrize(
    ("reference", "a_at_end"),
    [
        ({"kind": "move", "target_deg": {"a": 20}, "duration": 0.4}, np.deg2rad(20)),
        ({"kind": "move", "target_deg": 20, "duration": 0.4}, np.deg2rad(20)),
        ({"kind": "ramp", "target_deg": {"b": -5}, "duration": 0.4}, 2 * (np.deg2rad(-5) - 0.2)),
        ({"kind": "ramp", "target_deg": {"d": 0.1}, "duration": 0.4, "blend": 0.1}, -0.1 / 0.3),
        ({"kind": "hold", "target_deg": {"c": -20}}, 2 * ((np.deg2rad(-20) - 0.1) / -2 - 0.2)),
        ({"kind": "sine", "amplitude_deg": {"a": 20}, "frequency": 1.0, "phase_deg": 30}, None),
        ({"kind": "trapezoid", "target_deg": {"a": 20}, "acceleration_deg": {"a": 1000}}, np.deg2rad(20)),
        ({"kind": "sequence", "targets": [{"time": 0.2, "target_deg": {"a": 20}},
                                          {"time": 0.5, "target_deg": {"e": 5}}]}, np.deg2rad(20)),
    ],
)  # fmt: skip
def test_in_a_kinematic_station_any_axis_moves_its_partners(tmp_path, reference, a_at_end):
    result = simulate(
        station(tmp_path, CHAIN, mode="kinematic", reference=reference), progress=False
    )

    assert_chain_is_held(result, within=1e-9)
    if a_at_end is not None:
        assert result["q.a"][-1] == pytest.approx(a_at_end, abs=1e-9)

    speeds = np.gradient(result["q.b"], result.times)
    smooth = slice(2, 35)  # references end, and ramps have corners, at later samples

    np.testing.assert_allclose(result["v.b"][smooth], speeds[smooth], atol=0.1)
    np.testing.assert_allclose(result["v.c"], -2 * result["v.b"], atol=1e-9)


def test_a_contradiction_names_both_with_the_right_value(tmp_path):
    move = {"kind": "move", "target_deg": {"a": 20, "b": 0}, "duration": 0.4}
    config = station(tmp_path, CHAIN, mode="kinematic", reference=move)

    right = np.rad2deg(0.5 * np.deg2rad(20) + 0.2)
    expected = rf"reference of b is 0 deg .* must be {right:.5g} deg to satisfy couplings.b_follows .* a at 20 deg"
    with pytest.raises(SimrobError, match=expected):
        simulate(config, progress=False)
    with pytest.raises(SimrobError, match="reference of b"):
        check_station(config)
    agreeing = {"kind": "move", "target_deg": {"a": 20, "b": float(right)}, "duration": 0.4}
    assert_chain_is_held(
        simulate(config.model_copy(update={"reference": type(config.reference)(**agreeing)})), 1e-5
    )


def test_samples_that_contradict_are_refused(tmp_path):
    config = station(tmp_path, CHAIN, mode="kinematic")
    start = resolve(config).robots["robot"].initial

    ends = np.array([start, start])
    assert simulate(config, reference=([0.0, 0.5], ends), progress=False).ending == "completed"

    ends[1, 1] += 0.3  # the axis a alone
    with pytest.raises(SimrobError, match=r"reference of [bcd]"):
        simulate(config, reference=([0.0, 0.5], ends), progress=False)


def test_the_start_obeys_couplings_or_is_refused(tmp_path):
    initial = resolve(station(tmp_path, CHAIN)).robots["robot"].initial

    # in the order c, a, b, d, e
    np.testing.assert_allclose(initial, [-0.3, 0, 0.2, 0, 0], atol=1e-12)

    by_d = (
        resolve(station(tmp_path, CHAIN, robot={"initial_deg": {"d": 0.03}}))
        .robots["robot"]
        .initial
    )
    np.testing.assert_allclose(by_d, [-0.2, -0.1, 0.15, 0.03, 0], atol=1e-12)
    with pytest.raises(
        SimrobError,
        match=r"initial_deg of b is 0 deg; it must be 14.32\d? deg.*couplings.b_follows",
    ):
        station(tmp_path, CHAIN, robot={"initial_deg": {"a": 5.7295779513, "b": 0}})


def test_mimics_can_be_left_out_or_replaced(tmp_path):
    assert not resolve(station(tmp_path, CHAIN, robot={"mimic": False})).config.couplings

    own = {"mine": {"kind": "gear", "ratios": {"b": 1, "a": -1}}}
    couplings = resolve(
        station(tmp_path, CHAIN, couplings=own, solver=SOLVERS["sap"])
    ).config.couplings

    assert [*couplings] == ["mine", "c_follows", "d_follows"]


@pytest.mark.parametrize(
    ("joints", "axes", "told"),
    [
        ({"a": ("fixed", "base", ""), "b": ("revolute", "a_link", '<mimic joint="a" offset="0.3"/>'),
          "c": ("revolute", "b_link", "")}, ["c"], "follows 'a', which does not move; fixed at 0.3"),
        ({"a": ("revolute", "base", ""), "b": ("revolute", "a_link", '<mimic joint="a" multiplier="0" offset="0.3"/>')},
         ["a"], "follows with a multiplier of 0; fixed at 0.3"),
        ({"a": ("revolute", "base", ""), "b": ("revolute", "a_link", '<mimic joint="A"/>')},
         ["a", "b"], "mimics 'A', which is no joint"),
        ({"a": ("revolute", "base", '<mimic joint="b"/>'), "b": ("revolute", "a_link", '<mimic joint="a"/>')},
         ["a", "b"], "mimics 'b', which itself follows this joint"),
        ({"a": ("revolute", "base", '<mimic joint="a"/>'), "b": ("revolute", "a_link", "")},
         ["a", "b"], "mimics 'a', which itself follows this joint"),
    ],
)  # fmt: skip
def test_mimics_without_a_leader_that_moves(tmp_path, joints, axes, told):
    made = examine_robot(urdf(tmp_path, joints))
    assert list(made.model.axes) == axes
    assert any(told in entry.text for entry in made.report.entries), made.report.entries


SDF = """<sdf version="1.11"><model name="claw"><link name="palm"/>{links}
<joint name="weld" type="fixed"><parent>world</parent><child>palm</child></joint>{joints}</model></sdf>"""
SDF_JOINT = """<joint name="{name}" type="revolute"><parent>palm</parent><child>{name}_link</child><axis>
<xyz>1 0 0</xyz><limit><lower>-1</lower><upper>1</upper><effort>5</effort><velocity>3</velocity></limit>{mimic}</axis>
</joint>"""


def test_sdf_counts_the_leader_from_a_reference(tmp_path):
    mimic = "<mimic joint='j1'><multiplier>-2</multiplier><offset>0.3</offset><reference>0.1</reference></mimic>"
    joints = SDF_JOINT.format(name="j2", mimic=mimic) + SDF_JOINT.format(name="j1", mimic="")
    links = "<link name='j1_link'/><link name='j2_link'/>"
    file = tmp_path / "claw.sdf"
    file.write_text(SDF.format(links=links, joints=joints))

    follower = robot_from_file(file).followers["j2"]

    assert follower.leader == "j1"
    assert (follower.factor, follower.offset) == pytest.approx((-2.0, 0.3 + 2 * 0.1))


def test_mjcf_equalities_keep_slope_and_offset(tmp_path):
    mujoco = pytest.importorskip("mujoco")
    text = """<mujoco><worldbody><body><joint name="a" axis="0 1 0" ref="20"/><geom size="0.1"/>
      <body><joint name="b" axis="0 1 0"/><geom size="0.1"/></body></body>
      <body><joint name="c" axis="0 1 0"/><geom size="0.1"/></body></worldbody>
      <equality><joint joint1="b" joint2="a" polycoef="0.1 -2 0 0 0"/>
      <joint joint1="c" joint2="b" polycoef="0 1 3 0 0"/>
      </equality></mujoco>"""
    file = tmp_path / "arm.xml"
    file.write_text(text)
    zero = mujoco.MjModel.from_xml_string(text).qpos0[0]

    made = examine_robot(file)

    follower = made.model.followers["b"]
    # In MuJoCo's own coordinates b = 0.1 - 2 (a - ref).
    assert (follower.factor, follower.offset) == pytest.approx((-2.0, 0.1 + 2 * zero))
    assert any("polynomial of higher degree" in entry.text for entry in made.report.of("lost"))


def test_the_first_station_couples_all_followers(tmp_path):
    file = urdf(tmp_path, CHAIN)
    text = draft_station(file, folder=tmp_path)

    content = yaml.safe_load(text)
    assert {name: gear["total"] for name, gear in content["couplings"].items()} == {
        "c_follows": 0.1, "b_follows": 0.2, "d_follows": 0.0
    }  # fmt: skip
    assert (
        "# In the robot's file these axes follow others; see the section couplings: c, b, d."
        in text
    )

    (tmp_path / "first.yaml").write_text(text)
    result = simulate(load_station(tmp_path / "first.yaml"), progress=False)

    assert_chain_is_held(result, within=2e-3)
    assert abs(result["q.a"][-1] - result["q.a"][0]) > 0.05


def test_losses_of_an_import_are_told_by_every_command(tmp_path):
    joints = {"a": ("revolute", "base", ""), "b": ("revolute", "a_link", '<mimic joint="nobody"/>')}
    file = urdf(tmp_path, joints)

    text = draft_station(file, folder=tmp_path)

    assert (
        "# Warning: lost in the import of robot.urdf: joint 'b': mimics 'nobody', which is no joint"
        in text
    )

    (tmp_path / "first.yaml").write_text(text)
    config = load_station(
        tmp_path / "first.yaml", {"duration": 0.01, "reference": {"kind": "hold"}}
    )
    checked = [finding.text for finding in check_station(config) if finding.level == "warning"]

    result = simulate(config, progress=False)

    for told in (checked, result.warnings):
        assert any("joint 'b': mimics 'nobody'" in text for text in told), told

    summary = json.loads(json.dumps(result.summary()))
    assert any("mimics 'nobody'" in warning for warning in summary["warnings"])


def test_friction_is_a_loss_unless_the_station_brings_it_back(tmp_path):
    """A run warns of the friction that the import left out, until the station gives the axis its friction."""
    robot_file = urdf(tmp_path, {"a": ("revolute", "base", "<dynamics friction='0.5'/>")})
    station_file = tmp_path / "station.yaml"
    station_file.write_text(yaml.safe_dump({"robot": {"urdf": str(robot_file)}, "duration": 0.01}))
    friction = {"robot.drives": {"friction": {"a": 0.5}}}

    without_friction = simulate(load_station(station_file), progress=False)
    with_friction = simulate(load_station(station_file, friction), progress=False)

    assert any(
        "joint friction" in text and "a 0.5 N·m" in text for text in without_friction.warnings
    )
    assert any("--set robot.drives.friction.a=0.5" in text for text in without_friction.warnings)
    assert not any("friction" in text for text in with_friction.warnings)
