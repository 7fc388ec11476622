"""Predictions about robots that stand on their own feet, compared with statics by hand."""

from pathlib import Path

import numpy as np
import pytest
from pydrake.systems.framework import DiagramBuilder

from simrob_drake import load_station
from simrob_drake.base.errors import SimrobError
from simrob_drake.stations.checks import check_station
from simrob_drake.stations.clearance import Standing, standing
from simrob_drake.stations.findings import Finding
from simrob_drake.stations.plant import add_plant
from simrob_drake.stations.resolve import resolve

LEGGED = ("humanoid_dynamic", "roid1_dynamic", "zjudancer_dynamic", "yobotics_dynamic")


def stands(name: str, overrides: dict[str, object] | None = None) -> Standing:
    builder = DiagramBuilder()
    plant = add_plant(builder, resolve(load_station(name, overrides)))
    found = standing(plant, plant.robots["robot"])
    assert found is not None
    return found


def findings(name: str, overrides: dict[str, object] | None = None) -> list[Finding]:
    return check_station(load_station(name, overrides))


@pytest.mark.parametrize("name", LEGGED)
def test_every_legged_station_begins_on_the_floor_and_balanced(name: str) -> None:
    assert [finding for finding in findings(name) if finding.level != "ok"] == []

    found = stands(name)
    assert abs(found.gap) < 1e-4
    assert found.margin > 0.03


def test_the_humanoids_balance_is_that_of_its_figures() -> None:
    found = stands("humanoid_dynamic")

    assert found.mass == pytest.approx(2.292, abs=1e-6)
    assert found.contacts == 12
    # heel of area C, centre of mass; facts
    assert found.margin == pytest.approx(0.04725 + 0.0015, abs=1e-4)

    # the ankles lie 25.4 mm outside of the hips, and each carries half the weight
    hips = found.torque[[4, 12]]
    # kg m, outside of the hip's axis
    own_legs = 0.085 * 0.004 + 0.176 * 0.025 + (0.161 + 0.126) * 0.02537

    expected = 9.80665 * (2.292 / 2 * 0.02537 - own_legs)
    np.testing.assert_allclose(np.abs(hips), expected, rtol=0.02)


def test_the_quadrupeds_knees_carry_the_weight() -> None:
    """The centre of mass divides the weight between rear and front feet; each knee holds it at its lever."""
    found = stands("yobotics_dynamic")

    knee_to_foot = 0.23039 * np.sin(0.8) - 0.025 * np.sin(0.8)  # the ball touches under its middle
    assert found.contacts == 4
    knees = found.torque[[2, 5, 8, 11]]
    total = 9.80665 * (9.443 - 4 * (0.15 + 0.064 * 0.061 / 0.23039)) * knee_to_foot
    assert np.abs(knees).sum() == pytest.approx(total, rel=0.03)
    assert (np.sign(knees) == np.sign(knees[0])).all()


def test_leaning_too_far_is_foretold() -> None:
    found = findings("humanoid_dynamic", {"robot.initial_deg": {"CadDF": -40, "CadIF": -40}})
    assert any(
        f.level == "warning" and "the robot tips over" in f.text
        for f in found
        if f.subject == "base"
    )


def test_a_robot_on_two_points_is_no_robot_that_stands(tmp_path: Path) -> None:
    """A foot of 4 mm under a centre of mass at 0.22 m: its edges are 0.5 deg away."""
    sole = '<box size="0.004 0.1 0.04"/>'
    (tmp_path / "leg.urdf").write_text(
        LEG.format(turn="0 0 0", shape=sole).replace('xyz="0.02 0 -0.01"', 'xyz="0 0 0"')
    )
    (tmp_path / "leg.yaml").write_text(
        "robot: {urdf: leg.urdf, base: [0, 0, 0.22, 0, 0, 0], import_options: {base: floating}}\n"
        "servo: {realization: implicit, kp: 10, kd: 1}\nfloor: {}\ncontact: {}\n"
        "solver: {kind: discrete, scheme: sap, time_step: 0.002}\n"
    )
    (text,) = [
        f.text
        for f in findings(str(tmp_path / "leg.yaml"))
        if f.level == "warning" and f.subject == "base"
    ]

    height = (2 * (0.22 + 0.1) + 1 * 0.02) / 3

    assert stands(str(tmp_path / "leg.yaml")).height == pytest.approx(height, abs=1e-9)
    lean = np.rad2deg(0.002 / height)
    assert (
        f"2 mm inside the support area: the robot tips over if it leans by {lean:.1f} deg" in text
    )


def test_a_drop_and_a_penetration_are_foretold() -> None:
    high = findings("humanoid_dynamic", {"robot.base": [0, 0, 0.5, 0, 0, 0]})

    assert any(f.level == "warning" and "54.00 mm above the floor" in f.text for f in high)

    low = findings("humanoid_dynamic", {"robot.base": [0, 0, 0.44, 0, 0, 0]})
    # The original starts 6 mm too low.
    assert any(f.level == "warning" and "overlap by 6.0 mm" in f.text for f in low)
    assert any(
        f.level == "warning" and "the lowest point of the feet is 6.00 mm below the floor" in f.text
        for f in low
    )


@pytest.mark.parametrize("missing", ["floor", "contact"])
def test_nothing_to_stand_on_is_foretold(missing: str) -> None:
    (finding,) = [f for f in findings("humanoid_dynamic", {missing: None}) if f.level == "warning"]
    assert f"without {missing}, the robot falls" in finding.text


def test_box_soles_want_hydroelastic_contact() -> None:
    overrides = {"robot.feet": "soles", "robot.base": [0, 0, 0.44496, 0, 0, 0]}
    (finding,) = [f for f in findings("humanoid_dynamic", overrides) if f.level == "warning"]

    assert "contact.model to hydroelastic_with_fallback" in finding.text

    overrides["contact.model"] = "hydroelastic_with_fallback"
    assert [f for f in findings("humanoid_dynamic", overrides) if f.level == "warning"] == []


def test_too_weak_a_knee_is_foretold() -> None:
    weak = {"servo.torque_limit": {"rear_left_knee": 2}}
    (finding,) = [f for f in findings("yobotics_dynamic", weak) if f.level == "warning"]
    assert finding.subject == "torque of rear_left_knee"


def test_a_kinematic_station_takes_no_pushes() -> None:
    with pytest.raises(
        SimrobError, match="a kinematic station has no forces; leave it out, or set mode: dynamic"
    ):
        load_station("humanoid_fixed", {"forces.push": {"start": 1, "force": [1, 0, 0]}})


LEG = """<robot name="leg">
  <link name="trunk">
    <inertial>
      <origin xyz="0 0 0.1"/><mass value="2"/><inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/>
    </inertial>
  </link>
  <link name="foot">
    <inertial><mass value="1"/><inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial>
    <collision><origin xyz="0.02 0 -0.01" rpy="{turn}"/><geometry>{shape}</geometry></collision>
  </link>
  <joint name="knee" type="revolute">
    <origin xyz="0 0 -0.2"/><parent link="trunk"/><child link="foot"/><axis xyz="0 1 0"/>
    <limit lower="-1" upper="1" effort="10" velocity="5"/>
  </joint>
</robot>
"""
SHAPES = {  # how far it reaches below its middle, how many points it stands on, and how far they go back from there
    '<box size="0.2 0.1 0.04"/>': ("0 0 0", 0.02, 4, 0.1),
    '<cylinder radius="0.1" length="0.06"/>': ("0 0 0", 0.03, 16, 0.1),
    '<cylinder radius="0.1" length="0.08"/>': ("1.5707963267948966 0 0", 0.1, 2, None),
    '<sphere radius="0.05"/>': ("0 0 0", 0.05, 1, None),
    '<capsule radius="0.03" length="0.1"/>': ("0 1.5707963267948966 0", 0.03, 2, None),
    '<ellipsoid a="0.1" b="0.1" c="0.05"/>': (
        "0.5 0 0",
        np.hypot(0.1 * np.sin(0.5), 0.05 * np.cos(0.5)),
        1,
        None,
    ),
}


@pytest.mark.parametrize("shape", SHAPES)
def test_a_robot_without_feet_stands_on_its_collision_shapes(shape: str, tmp_path: Path) -> None:
    turn, reach, points, back = SHAPES[shape]
    text = (
        LEG.format(shape=shape, turn=turn)
        .replace("<ellipsoid", "<drake:ellipsoid")
        .replace("<capsule", "<drake:capsule")
    )
    (tmp_path / "leg.urdf").write_text(
        text.replace("<robot ", '<robot xmlns:drake="http://drake.mit.edu" ')
    )
    (tmp_path / "leg.yaml").write_text(
        "robot: {urdf: leg.urdf, base: [0, 0, 0.5, 0, 0, 0], import_options: {base: floating}}\n"
        "servo: {realization: implicit, kp: 10, kd: 1}\nfloor: {}\ncontact: {}\n"
        "solver: {kind: discrete, scheme: sap, time_step: 0.002}\n"
    )

    found = stands(str(tmp_path / "leg.yaml"))

    assert found.gap == pytest.approx(0.5 - 0.21 - reach, abs=1e-9)
    assert found.contacts == points
    assert found.margin == pytest.approx(
        0.0 if back is None else min(back - 0.02, 0.05 if points == 4 else 1), abs=2e-3
    )


def test_without_feet_and_collision_shapes_it_falls(tmp_path: Path) -> None:
    (tmp_path / "leg.urdf").write_text(LEG.format(turn="0 0 0", shape='<sphere radius="0.05"/>'))
    (tmp_path / "leg.yaml").write_text(
        "robot: {urdf: leg.urdf, import_options: {base: floating, collision: none}}\n"
        "servo: {kp: 10, kd: 1}\nfloor: {}\ncontact: {}\n"
    )

    texts = [
        finding.text
        for finding in findings(str(tmp_path / "leg.yaml"))
        if finding.level == "warning"
    ]

    assert texts == ["the base is free: without collision shapes, the robot falls"]
