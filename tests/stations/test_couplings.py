"""Gears, rods, welds and springs of a station against motions that are computed without it."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from simrob_drake import load_station, simulate
from simrob_drake.base.errors import SimrobError
from simrob_drake.parts.couplings import KINDS

LINK = """<link name="{name}"><inertial><origin xyz="{com}"/><mass value="{mass}"/>
<inertia ixx="{i}" iyy="{i}" izz="{i}" ixy="0" ixz="0" iyz="0"/></inertial></link>"""
JOINT = """<joint name="{name}_joint" type="{type}"><parent link="base"/><child link="{name}"/><origin xyz="{at}"/>
<axis xyz="{axis}"/><limit lower="-100" upper="100" effort="1000" velocity="100"/></joint>"""
TIGHT = {"kind": "discrete", "scheme": "sap", "time_step": 1e-4}
STIFF = {"kind": "continuous", "scheme": "radau3", "accuracy": 1e-4, "max_step": 0.01}
FREE = {"kp": 0.0, "ki": 0.0, "kd": 0.0}


def station(folder, parts, **sections):
    """Return a station of bodies on a base: for each name, its joint's type, place and axis, its mass, com, inertia."""
    links = ["<link name='base'/>"]
    for name, (kind, at, axis, mass, com, inertia) in parts.items():
        links += [LINK.format(name=name, com=com, mass=mass, i=inertia)]
        links += [JOINT.format(name=name, type=kind, at=at, axis=axis)]
    (folder / "robot.urdf").write_text(f"<robot name='pair'>{''.join(links)}</robot>")
    robot = {"urdf": str(folder / "robot.urdf"), **sections.pop("robot", {})}
    content = {
        "robot": robot,
        "servo": FREE,
        "duration": 1.0,
        "gravity": 9.81,
        "solver": TIGHT,
        **sections,
    }
    import yaml

    (folder / "station.yaml").write_text(yaml.safe_dump(content))
    return load_station(folder / "station.yaml")


ARM, WHEEL = (
    ("revolute", "0 0 0", "0 1 0", 2.0, "0.3 0 0", 0.05),
    ("revolute", "1 0 0", "0 1 0", 1.0, "0 0 0", 0.02),
)


CENIC = {"kind": "continuous", "scheme": "cenic", "accuracy": 1e-4, "max_step": 1e-3}


@pytest.mark.parametrize(("solver", "within"), [(TIGHT, 1e-3), (STIFF, 1e-5), (CENIC, 5e-3)])
def test_a_geared_pair_turns_as_one_inertia(tmp_path, solver, within):
    """An arm that falls drives a wheel of half its radius: (I1 + 4 I2) q1'' = m g c cos q1, and q2 = -2 q1."""
    gears = {"mesh": {"kind": "gear", "ratios": {"arm_joint": 2, "wheel_joint": 1}}}
    config = station(tmp_path, {"arm": ARM, "wheel": WHEEL}, couplings=gears, solver=solver)
    result = simulate(config, progress=False)
    inertia = 0.05 + 2.0 * 0.3**2 + 4 * 0.02

    def motion(_, state):
        return [state[1], 2.0 * 9.81 * 0.3 * np.cos(state[0]) / inertia]

    expected = solve_ivp(motion, (0, 1), [0, 0], rtol=1e-10, atol=1e-12, t_eval=result.times).y[0]
    np.testing.assert_allclose(result["q.arm_joint"], expected, atol=within)
    np.testing.assert_allclose(result["q.wheel_joint"], -2 * result["q.arm_joint"], atol=1e-4)


def test_a_gear_keeps_the_posture_in_which_it_starts(tmp_path):
    gears = {"gear": {"ratios": {"arm_joint": 1, "wheel_joint": 1}}}
    start = {"initial_deg": {"arm_joint": 90, "wheel_joint": 30}}
    config = station(
        tmp_path, {"arm": ARM, "wheel": WHEEL}, couplings=gears, robot=start, duration=0.2
    )

    result = simulate(config, progress=False)

    assert result["q.arm_joint"] + result["q.wheel_joint"] == pytest.approx(
        np.full(21, np.deg2rad(120)), abs=1e-5
    )


SLIDER = ("prismatic", "0 0 1", "0 0 1", 1.0, "0 0 0", 0.01)


@pytest.mark.parametrize(
    "solver", [TIGHT, {"kind": "continuous", "scheme": "radau3", "accuracy": 1e-5}]
)
def test_two_bodies_on_a_spring(tmp_path, solver):
    """Two masses with a spring and a damper between them are pulled together by k (x - l) + d x' of the distance x."""
    length = 0.8  # [m]
    stiffness = 200.0  # [N/m]
    damping = 3.0  # [N·s/m]
    low_mass, high_mass = 2.0, 1.0  # [kg]
    distance_at_zero = 1.0  # [m]
    spring = {
        "body": "low",
        "other": "high",
        "length": length,
        "stiffness": stiffness,
        "damping": damping,
    }
    low = ("prismatic", "0 0 0", "0 0 1", low_mass, "0 0 0", 0.01)
    parts = {"low": low, "high": SLIDER}
    config = station(tmp_path, parts, couplings={"spring": spring}, gravity=0.0, solver=solver)

    result = simulate(config, progress=False)

    def motion(_, state):
        """Derivatives of the positions and velocities (4,) of the low and the high mass."""
        low_position, high_position, low_speed, high_speed = state
        extension = high_position - low_position + distance_at_zero - length
        pull = stiffness * extension + damping * (high_speed - low_speed)
        return [low_speed, high_speed, pull / low_mass, -pull / high_mass]

    expected = solve_ivp(motion, (0, 1), [0.0] * 4, rtol=1e-10, atol=1e-12, t_eval=result.times).y
    np.testing.assert_allclose(result["q.low_joint"], expected[0], atol=2e-4)
    np.testing.assert_allclose(result["q.high_joint"], expected[1], atol=2e-4)
    # it may be any length
    assert "coupling_gap" not in {measure.criterion.name for measure in result.verdict.measures}


@pytest.mark.long
def test_rods_and_welds_hold(tmp_path):
    """A wheel drives a slider by a rod of 1 m; a second wheel is welded to the first one."""
    parts = {
        "wheel": ("revolute", "0 0 0", "0 1 0", 1.0, "0.1 0 0", 0.05), "slider": SLIDER,
        "twin": ("revolute", "0 0.5 0", "0 1 0", 1.0, "0 0 0", 0.05),
    }  # fmt: skip
    held = {
        "link": {"kind": "rod", "body": "wheel", "point": [0.3, 0, 0], "other": "slider",
                 "length": float(np.hypot(0.3, 1.0))},
        "shaft": {"kind": "weld", "body": "wheel", "other": "twin", "other_pose": [0, -0.5, 0, 0, 0, 0]},
    }  # fmt: skip

    result = simulate(station(tmp_path, parts, couplings=held, duration=0.6), progress=False)

    angle, height = result["q.wheel_joint"], 1 + result["q.slider_joint"]
    assert np.ptp(angle) > 0.5
    ends = np.column_stack([0.3 * np.cos(angle), -0.3 * np.sin(angle)])
    apart = np.hypot(ends[:, 0], ends[:, 1] - height)
    np.testing.assert_allclose(apart, np.hypot(0.3, 1.0), atol=2e-4)
    np.testing.assert_allclose(result["q.twin_joint"], angle, atol=1e-4)


@pytest.mark.parametrize(
    "held",
    [
        {"kind": "ball", "body": "arm", "point": [0.3, 0, 0], "other_point": [0.3, 0, 0]},
        {
            "kind": "ball",
            "body": "world",
            "point": [0.3, 0, 0],
            "other": "arm",
            "other_point": [0.3, 0, 0],
        },
        {
            "kind": "rod",
            "body": "arm",
            "point": [0.3, 0, 0],
            "other_point": [0.3, 0, 0.5],
            "length": 0.5,
        },
        {"kind": "weld", "body": "arm"},
        {"kind": "hinge", "body": "arm"},
    ],
)
@pytest.mark.parametrize("solver", [TIGHT, STIFF])
def test_what_is_held_by_the_world_stays(tmp_path, held, solver):
    """An arm that is coupled to the world does not fall."""
    if held["kind"] in ("rod", "ball") and solver is STIFF:
        pytest.skip("rods and balls are held by discrete solvers alone")
    config = station(
        tmp_path, {"arm": ARM, "wheel": WHEEL}, couplings={"tie": held}, solver=solver, duration=0.2
    )

    result = simulate(config, progress=False)

    np.testing.assert_allclose(result["q.arm_joint"], 0.0, atol=1e-3)


@pytest.mark.parametrize(
    ("coupling", "more", "told"),
    [
        ({"kind": "gear", "ratios": {"arm_joint": 1, "wheel_jiont": 1}}, {}, "wheel_joint"),
        ({"kind": "gear", "ratios": {"arm_joint": 1, "wheel_joint": 1}},
         {"solver": {"kind": "continuous", "scheme": "runge_kutta3"}},
         "discrete with scheme: sap, which can simulate couplings.tie"),
        ({"kind": "rod", "body": "arm", "length": 0.5}, {},
         r"gap of couplings\.tie at the start .* is 0\.5; it must be at most 0\.001"),
        ({"kind": "ball", "body": "arm", "other": "wheel"}, {},
         r"gap of couplings\.tie at the start \[m or rad\] is 1; it must"),
        ({"kind": "ball", "body": "arm", "other": "arm"}, {}, "different from couplings.tie.body"),
        ({"kind": "spring", "body": "leg", "stiffness": 1.0}, {}, "leg"),
        ({"kind": "spring", "body": "arm", "stiffness": 1.0}, {"mode": "kinematic"}, "kinematic"),
    ],
)  # fmt: skip
def test_couplings_that_cannot_be(tmp_path, coupling, more, told):
    with pytest.raises(SimrobError, match=told):
        simulate(
            station(tmp_path, {"arm": ARM, "wheel": WHEEL}, couplings={"tie": coupling}, **more),
            duration=0.01,
        )


@pytest.mark.parametrize(("gravity", "warned"), [(9.81, False), (1e4, True)])
def test_a_coupling_that_its_load_opens_is_told(tmp_path, gravity, warned):
    """A body on a weld that is a spring of 2000 rad/s: it opens by g over the square of that."""
    tie = {"tie": {"kind": "weld", "body": "slider", "other_pose": [0, 0, 1, 0, 0, 0]}}
    own = {"solver": STIFF, "gravity": gravity, "duration": 0.1, "verdict": {"coupling_gap": 0.001}}

    result = simulate(station(tmp_path, {"slider": SLIDER}, couplings=tie, **own), progress=False)

    worst = result.verdict["coupling_gap"].worst
    assert worst.subject == "tie"
    assert worst.value == pytest.approx(gravity / 2000.0**2, rel=0.1)
    assert (
        any(
            f"coupling tie opened by {1e3 * worst.value:.3g} mm (or mrad)" in told
            for told in result.warnings
        )
        == warned
    )


@pytest.mark.parametrize(
    ("section", "words"),
    [
        ({"kind": "ball"}, "a ball joint between slider and wheel"),
        ({"kind": "rod", "length": 0.25}, "a rod of 0.25 m from slider to wheel"),
        ({"kind": "weld"}, "slider welded to wheel"),
        ({"kind": "hinge"}, "a hinge between slider and wheel"),
        ({"kind": "spring", "stiffness": 40.0}, "a spring of 40 N/m from slider to wheel"),
    ],
)
def test_a_coupling_says_what_it_is(section, words):
    made = KINDS.model(section["kind"]).model_validate(
        {"body": "slider", "other": "wheel", **section}
    )
    assert made.caption() == words
