"""References of coupled axes: partners move along, contradictions are errors; and what the verdict leaves out."""

import json

import numpy as np
import pytest
import yaml
from pydrake.trajectories import PiecewisePolynomial

from simrob_drake import Arm, load_station, simulate
from simrob_drake.base.drake_versions import TENDONS
from simrob_drake.base.errors import SimrobError
from simrob_drake.blocks.combined_references import combine_references
from simrob_drake.blocks.references import (
    SineReference,
    hermite,
    hold,
    move,
    ramp,
    reference_values,
)
from simrob_drake.programs.program import Program
from simrob_drake.robots.coupled_axes import CoupledAxes, Equation, Firmness

LINK = """<link name="{name}_link"><inertial><mass value="1"/>
<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>"""
JOINT = """<joint name="{name}" type="{kind}"><parent link="base"/><child link="{name}_link"/><origin xyz="0 {y} 0"/>
<axis xyz="0 1 0"/><limit lower="-3" upper="3" effort="50" velocity="5"/></joint>
<transmission name="{name}_drive"><type>transmission_interface/SimpleTransmission</type><joint name="{name}"/>
<actuator name="{name}_motor"/></transmission>"""
SAP = {"kind": "discrete", "scheme": "sap", "time_step": 1e-3}


def station(folder, axes, **sections):
    """Return a station of robots whose axes turn or slide side by side: names of axes, or these by robot."""
    by_robot = axes if isinstance(axes, dict) else {"": axes}
    robots = {}
    for robot, names in by_robot.items():
        parts = ["<link name='base'/>"]
        for number, name in enumerate(names):
            kind = "prismatic" if name.startswith("slide") else "revolute"
            parts += [LINK.format(name=name), JOINT.format(name=name, kind=kind, y=number)]
        file = folder / f"robot{robot}.urdf"
        file.write_text(f"<robot name='side_by_side'>{''.join(parts)}</robot>")
        robots[robot] = {"urdf": str(file), **sections.pop(robot, {})}
    content = {"robots": robots} if "" not in robots else {"robot": robots[""]}
    servo = {"realization": "implicit", "kp": 200.0, "kd": 20.0}
    content |= {"servo": servo, "duration": 1.0, "gravity": 0.0, "solver": SAP, **sections}
    (folder / "station.yaml").write_text(yaml.safe_dump(content))
    return load_station(folder / "station.yaml")


def moving(**targets):
    return {"kind": "move", "target_deg": targets, "duration": 0.3}


def gear(*, total=None, **ratios):
    return {"kind": "gear", "ratios": ratios, **({} if total is None else {"total": total})}


@pytest.mark.parametrize("asked", ["a", "b"])
def test_either_axis_of_a_pair_moves_the_other(tmp_path, asked):
    couplings = {"mesh": gear(a=2, b=1)}
    result = simulate(
        station(tmp_path, "ab", couplings=couplings, reference=moving(**{asked: 20})),
        progress=False,
    )

    np.testing.assert_allclose(2 * result["q_ref.a"] + result["q_ref.b"], 0.0, atol=1e-12)
    np.testing.assert_allclose(2 * result["q.a"] + result["q.b"], 0.0, atol=1e-5)
    assert result[f"q.{asked}"][-1] == pytest.approx(np.deg2rad(20), abs=2e-3)
    # Motors that fought each other would hold torque at rest.
    assert np.abs(result.axes("tau")[-1]).max() < 0.1


@pytest.mark.long
def test_two_motors_no_longer_press_against_each_other(tmp_path):
    couplings = {"mesh": gear(slide_r=1, slide_l=-1)}
    start = {"initial_deg": {"slide_l": 0.04, "slide_r": 0.04}}
    config = station(
        tmp_path,
        ["slide_l", "slide_r"],
        couplings=couplings,
        reference=moving(slide_l=0.0),
        **{"": start},
    )

    result = simulate(config, progress=False)

    np.testing.assert_allclose(result.axes("q")[-1], 0.0, atol=1e-3)
    assert result.verdict["torque_share"].worst.value < 0.5


def test_two_leaders_move_independently(tmp_path):
    couplings = {"left": gear(b=1, a=-1), "right": gear(d=1, c=2)}
    config = station(
        tmp_path, "abcd", mode="kinematic", couplings=couplings, reference=moving(a=20, c=10)
    )

    end = simulate(config, progress=False).axes("q")[-1]

    np.testing.assert_allclose(np.rad2deg(end), [20, 20, 10, -20], atol=1e-9)


@pytest.mark.skipif(not TENDONS.is_there, reason="older Drake couples two axes at most")
def test_a_planetary_gear_needs_two_of_three(tmp_path):
    couplings = {"planets": gear(sun=1, ring=2, carrier=-3)}

    with pytest.raises(
        SimrobError, match=r"no value for carrier and ring.*coupled by couplings.planets"
    ):
        simulate(
            station(
                tmp_path, ["sun", "ring", "carrier"], couplings=couplings, reference=moving(sun=30)
            )
        )

    both = moving(sun=30, ring=-9)
    config = station(tmp_path, ["sun", "ring", "carrier"], couplings=couplings, reference=both)

    result = simulate(config, progress=False)

    np.testing.assert_allclose(np.rad2deg(result.axes("q_ref")[-1]), [30, -9, 4], atol=1e-9)
    np.testing.assert_allclose(np.rad2deg(result.axes("q")[-1]), [30, -9, 4], atol=0.1)
    with pytest.raises(
        SimrobError,
        match=r"reference of carrier is 10 deg .* be 4 deg to satisfy couplings.planets",
    ):
        simulate(station(tmp_path, ["sun", "ring", "carrier"], couplings=couplings,
                         reference=moving(sun=30, ring=-9, carrier=10)))  # fmt: skip


def test_an_axis_of_another_robot_follows_in_time(tmp_path):
    couplings = {"belt": {"kind": "gear", "ratios": {"two.b": 1, "one.a": -1}}}
    references = {"one": {"reference": moving(a=20)}, "two": {"reference": {"kind": "hold"}}}
    config = station(tmp_path, {"one": "ac", "two": "bd"}, couplings=couplings, **references)

    result = simulate(config, progress=False)

    np.testing.assert_allclose(result["two.q_ref.b"], result["one.q_ref.a"], atol=1e-12)
    assert result["two.q.b"][-1] == pytest.approx(np.deg2rad(20), abs=3e-3)
    assert np.ptp(result["two.q_ref.d"]) == 0


def test_an_axis_without_a_motor_gives_way(tmp_path):
    couplings = {"mesh": gear(a=2, b=1)}
    servo = {"realization": "implicit", "kp": {"a": 200}, "kd": {"a": 20}}
    servo = {
        key: {"a": value["a"], "b": 0} if isinstance(value, dict) else value
        for key, value in servo.items()
    }
    config = station(tmp_path, "ab", couplings=couplings, servo=servo, reference=moving(a=20, b=0))

    result = simulate(config, progress=False)

    assert np.ptp(result["q_ref.b"]) == 0  # nobody heeds it

    summary = result.verdict["final_error"].summary()
    assert summary["each"]["b"] is None
    assert summary["left_out"] == {"b": "no motor drives it"}
    assert summary["each"]["a"] > 0


def test_couplings_that_contradict_each_other_are_refused(tmp_path):
    couplings = {"one": gear(a=1, b=-1, total=0), "other": gear(a=1, b=-1, total=0.5)}
    with pytest.raises(
        SimrobError, match=r"couplings\.other is in contradiction with couplings\.one"
    ):
        station(tmp_path, "ab", couplings=couplings)


GRIPPER = """<robot name="grip"><link name="rail"/>
<link name="carriage"><inertial><mass value="2"/><inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/>
</inertial></link>{fingers}
<joint name="axis" type="prismatic"><parent link="rail"/><child link="carriage"/><axis xyz="1 0 0"/>
<limit lower="0" upper="0.8" effort="200" velocity="1"/></joint></robot>"""
FINGER = """<link name="finger_{name}"><inertial><mass value="0.1"/>
<inertia ixx="1e-4" iyy="1e-4" izz="1e-4" ixy="0" ixz="0" iyz="0"/></inertial>
<collision><geometry><box size="0.02 0.01 0.08"/></geometry></collision></link>
<joint name="{name}" type="prismatic"><parent link="carriage"/><child link="finger_{name}"/>
<origin xyz="0 {y} -0.065"/><axis xyz="0 {way} 0"/><limit lower="0" upper="0.04" effort="20" velocity="0.2"/>{mimic}
</joint>"""


@pytest.fixture
def gripper(tmp_path):
    """A station of a carriage with two fingers, of which the right one mimics the left one."""
    fingers = FINGER.format(name="left", y=0.005, way=1, mimic="")
    fingers += FINGER.format(name="right", y=-0.005, way=-1, mimic='<mimic joint="left"/>')
    (tmp_path / "grip.urdf").write_text(GRIPPER.format(fingers=fingers))
    content = {
        "robot": {"urdf": "grip.urdf", "initial_deg": {"left": 0.04}},
        "servo": {"realization": "implicit", "kp": 2000.0, "kd": 100.0},
        "reference": {"kind": "move", "target_deg": {"left": 0}, "duration": 0.3},
        "solver": SAP, "duration": 0.5, "gravity": 0.0,
    }  # fmt: skip
    (tmp_path / "grip.yaml").write_text(yaml.safe_dump(content))
    return load_station(tmp_path / "grip.yaml")


def test_fingers_close_together_and_are_not_reported_as_zero(gripper):
    result = simulate(gripper, progress=False)

    np.testing.assert_allclose(result.axes("q")[-1], 0.0, atol=1e-3)

    figures = json.loads(json.dumps(result.verdict.summary()))["figures"]
    for name in ("final_error", "largest_error", "torque_share", "torque_time"):
        assert figures[name]["each"]["left"] is None
        assert figures[name]["each"]["axis"] is not None
        assert "a finger, which grips with its full torque" in figures[name]["left_out"]["right"]


def test_programs_move_partners(gripper):
    arm = Arm(gripper)
    arm.open()

    np.testing.assert_allclose(arm.position[:2], 0.04, atol=1e-3)

    arm.cell.perform(Program(moves=[{"target_deg": {"left": 0.02}, "duration": 0.5}]))
    np.testing.assert_allclose(arm.position[:2], 0.02, atol=2e-3)


@pytest.mark.parametrize("order", [0, 1, 2])
def test_polynomials_are_combined_exactly(order):
    """A combination of piecewise polynomials is one, with the derivatives M q and the offset in the positions alone."""
    smooth_move = move([0, 1], [1, 3], duration=1.0)
    straight_ramp = ramp([2], [5], duration=0.7, start_time=0.2)
    matrix = np.array([[1.0, -2.0, 0.5], [0.0, 0.0, 3.0]])
    offset = np.array([0.1, -0.2])

    combination = combine_references([smooth_move, straight_ramp], matrix, offset)

    assert isinstance(combination, PiecewisePolynomial)
    times = np.linspace(-0.2, 1.3, 301)
    stacked = [
        reference_values(reference, times, order) for reference in (smooth_move, straight_ramp)
    ]
    expected = np.hstack(stacked) @ matrix.T
    if order == 0:
        expected += offset
    # At the ends of a motion, derivatives jump: the side that counts is a matter of rounding.
    is_smooth = (times > 0) & (times < 1)
    for corner in (0.2, 0.9):
        is_smooth &= np.abs(times - corner) > 0.01
    found = reference_values(combination, times, order)
    np.testing.assert_allclose(found[is_smooth], expected[is_smooth], atol=1e-10)


SINE = SineReference(
    centre=np.array([0.1, 0.2]),
    amplitude=np.array([1.0, -2.0]),
    frequency=0.5,
    phase=np.array([0.3, 1.0]),
)


def test_sines_are_combined_exactly():
    """A combination of a sine and a reference at rest is the sum M q + d at all times."""
    resting_at = 0.7
    matrix = np.array([[1.0, 0.5, 2.0], [0.0, -1.0, 0.0]])
    offset = np.array([0.0, 1.0])

    combination = combine_references([SINE, hold([resting_at])], matrix, offset)

    times = np.linspace(0, 3, 100)
    positions = np.hstack([SINE.values(times), np.full((100, 1), resting_at)])
    np.testing.assert_allclose(combination.values(times), positions @ matrix.T + offset, atol=1e-12)


def test_samples_are_combined_with_a_reference_at_rest():
    """A constant has no start and no end, so the samples of the sum are those of the reference that moves."""
    resting_at = 0.7
    moving = hermite([0.5, 1.0, 2.0], [[0.0], [1.0], [0.5]], [[0.0], [0.3], [0.0]])
    matrix = np.array([[1.0, 2.0], [0.0, -1.0]])
    offset = np.array([0.1, 0.0])

    combination = combine_references([hold([resting_at]), moving], matrix, offset)

    times = np.linspace(0, 3, 61)
    stacked = np.hstack([np.full((61, 1), resting_at), reference_values(moving, times)])
    expected = stacked @ matrix.T + offset
    np.testing.assert_allclose(reference_values(combination, times), expected, atol=1e-9)


def test_sines_of_two_frequencies_are_not_combined():
    """The sum of two sines of different frequencies is no sine."""
    other = SineReference(
        centre=np.zeros(1), amplitude=np.ones(1), frequency=0.7, phase=np.zeros(1)
    )

    with pytest.raises(SimrobError, match="one frequency"):
        combine_references([SINE, other], np.eye(3), np.zeros(3))


@pytest.fixture
def chain_of_axes():
    """Axes with the couplings b = 2 a and c + b = 0.5; d is free."""
    equations = [Equation("ab", {"b": 1, "a": -2}, 0.0), Equation("bc", {"c": 1, "b": 1}, 0.5)]
    return CoupledAxes("abcd", equations)


def test_the_axes_that_are_asked_least_give_way(chain_of_axes):
    """If only c is named, a and b follow it: c = 0.3 demands b = 0.5 - 0.3 and a = b / 2."""
    firmness = [Firmness.UNNAMED, Firmness.UNNAMED, Firmness.NAMED, Firmness.UNNAMED]

    solution = chain_of_axes.solve(firmness, chain_of_axes.totals(np.zeros(4)))

    positions = solution.matrix @ [9, 9, 0.3, 7] + solution.offset
    np.testing.assert_allclose(positions, [0.1, 0.2, 0.3, 7], atol=1e-12)
    assert solution.conditions == ()


def test_couplings_between_named_axes_are_conditions(chain_of_axes):
    """If all axes are named, none gives way, and each coupling has to hold by itself."""
    solution = chain_of_axes.solve([Firmness.NAMED] * 4, chain_of_axes.totals(np.zeros(4)))

    assert [condition.labels for condition in solution.conditions] == [("ab",), ("bc",)]


def test_a_condition_joins_the_couplings_of_an_axis_that_gives_way(chain_of_axes):
    """If b alone gives way, both couplings together are one condition on a and c: c = 0.5 - 2 a."""
    firmness = [Firmness.NAMED, Firmness.UNNAMED, Firmness.NAMED, Firmness.NAMED]
    tolerance = np.full(4, 1e-9)

    (condition,) = chain_of_axes.solve(firmness, chain_of_axes.totals(np.zeros(4))).conditions

    assert set(condition.labels) == {"ab", "bc"}
    obeyed = np.array([[0.1, 0, 0.3, 0]])
    assert chain_of_axes.find_violation(condition, obeyed, tolerance) is None
    violated = np.array([[0.1, 0, 0.4, 0]])
    violation = chain_of_axes.find_violation(condition, violated, tolerance)
    assert violation.position == pytest.approx(0.3)
