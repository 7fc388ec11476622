"""Mechanisms that are imported, against the integration of their own equations."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from slx_files import INERTIA, REVOLUTE, TO_PHYSICS, TRANSFORM, WORLD, Level, write_model
from test_mechanics import four_bar
from test_slx_networks import hinge

from simrob_drake import load_station, simulate
from simrob_drake.extensions.simulink.importing import import_simulink
from simrob_drake.extensions.simulink.mechanics.trees import body_poses

WEIGHT, SPIN = 9.80665, 0.1  # N/kg; kg m² of each bar of 1 kg and 1 m


def solved(motion, start, times):
    return solve_ivp(
        motion, (0, times[-1]), start, method="DOP853", rtol=1e-11, atol=1e-11, t_eval=times
    ).y


def bars_alone(turned, times):
    """Return the angles (n, t) of bars against the horizontal, which begin at rest at these.

    Lagrange's equations with the multipliers of the closed loop, whose accelerations are kept.
    """
    count = len(turned)
    levers = np.tril(np.ones((count, count)), -1) + 0.5 * np.eye(count)
    masses = levers.T @ levers

    def motion(_, state):
        angles, speed = np.split(state, 2)
        apart = angles[:, None] - angles[None, :]
        inertia = masses * np.cos(apart) + SPIN * np.eye(count)
        force = -(masses * np.sin(apart)) @ speed**2 - WEIGHT * levers.sum(axis=0) * np.cos(angles)
        loop = np.array([-np.sin(angles), np.cos(angles)])
        drift = np.array([np.cos(angles), np.sin(angles)]) @ speed**2
        both = np.block([[inertia, -loop.T], [loop, np.zeros((2, 2))]])
        return np.concatenate([speed, np.linalg.solve(both, [*force, *drift])[:count]])

    return solved(motion, [*turned, *np.zeros(count)], times)[:count]


def energies(turned, speed):
    """Return the energy of motion, and of height, of bars at angles and speeds (n, t)."""
    count = len(turned)
    levers = np.tril(np.ones((count, count)), -1) + 0.5 * np.eye(count)
    across, up = levers @ (-np.sin(turned) * speed), levers @ (np.cos(turned) * speed)
    moving = 0.5 * (across**2 + up**2).sum(axis=0) + 0.5 * SPIN * (speed**2).sum(axis=0)
    return moving, WEIGHT * (levers @ np.sin(turned)).sum(axis=0)


@pytest.mark.parametrize(
    ("start", "asked", "bars", "duration", "off"),
    [
        ("40", {}, 3, 1.0, 0.1),
        pytest.param("40", {}, 3, 10.0, 0.15, marks=pytest.mark.long),
        pytest.param("40", {2: "-163"}, 3, 10.0, 0.1, marks=pytest.mark.long),
        pytest.param("-110", {}, 4, 5.0, 0.1, marks=pytest.mark.long),
    ],
    ids=["four-bar", "four-bar for long", "crossed four-bar", "five-bar"],
)
def test_a_free_linkage_moves_as_its_equations_say(tmp_path, start, asked, bars, duration, off):
    """Within 0.1°, or nearly so, over 5 s, and 1 % of its energy over the run, by the solver that the import ships."""
    level = four_bar(start=start, bars=bars, asked=asked)
    imported = import_simulink(write_model(tmp_path / "a.slx", level), tmp_path / "out")
    result = simulate(load_station(imported.station), duration=duration, progress=False)
    names = [f"Joint{number}" for number in range(1, bars + 1)]
    angles, speeds = (
        np.cumsum([result[f"{what}.{name}"] for name in names], axis=0) for what in "qv"
    )
    early = result.times <= 5.0
    expected = bars_alone(angles[:, 0], result.times[early])
    assert np.ptp(expected, axis=1).max() > 0.4
    assert np.abs(angles[:, early] - expected).max() < np.deg2rad(off)
    moving, height = energies(angles, speeds)
    assert np.abs(moving + height - height[0]).max() < 0.01 * np.ptp(height)
    (robot,) = imported.files.robots.values()
    poses = body_poses(robot.tree, np.diff(angles[:, -1], prepend=0.0))
    assert max(np.abs(closing.gap(poses)).max() for closing in robot.tree.closings) < 5e-5


def two_rods(first, second, *, second_turn="0"):
    """A rod of 1 kg and 0.5 m about world z, and at its end one of 0.5 kg and 0.4 m, turned about x by an angle."""
    level = Level()
    world = level.block(WORLD, "World")
    rods = [
        level.block(
            INERTIA, "Arm", Mass="1", MomentsOfInertia="[0.01 0.02 0.02]", CenterOfMass="[0.25 0 0]"
        ),
        level.block(
            INERTIA,
            "Rod",
            Mass="0.5",
            MomentsOfInertia="[0.007 0.001 0.007]",
            CenterOfMass="[0 0.2 0]",
        ),
    ]
    joints = [
        level.block(REVOLUTE, name, **given)
        for name, given in (("First", first), ("Second", second))
    ]
    end = level.block(
        TRANSFORM, "End", TranslationMethod="Cartesian", TranslationCartesianOffset="[0.5 0 0]",
        RotationMethod="StandardAxis", RotationStandardAxis="+Y", RotationAngle=second_turn, RotationAngleUnits="deg",
    )  # fmt: skip
    level.connect(f"{world}#rconn:1", f"{joints[0]}#lconn:1")
    level.connect(f"{joints[0]}#rconn:1", f"{rods[0]}#rconn:1", f"{end}#lconn:1")
    level.connect(f"{end}#rconn:1", f"{joints[1]}#lconn:1")
    level.connect(f"{joints[1]}#rconn:1", f"{rods[1]}#rconn:1")
    return level, joints


def drive(level, joint, kind, name, **source):
    """Drive a joint by a source, in SI."""
    signal, into = (
        level.block(kind, name, **source),
        level.block(TO_PHYSICS, f"{name} in", Unit="1"),
    )
    level.wire(f"{signal}#out:1", f"{into}#in:1")
    level.connect(f"{into}#rconn:1", f"{joint}#lconn:2")


def run(tmp_path, level, duration):
    imported = import_simulink(
        write_model(tmp_path / "a.slx", level, stop=str(duration)), tmp_path / "out"
    )
    assert imported.fidelity.startswith("mechanics complete") or "prescribed" in imported.fidelity
    return simulate(load_station(imported.station), progress=False)


def test_a_furuta_pendulum_moves_as_its_equations_say(tmp_path):
    """An arm that a sine drives about z; at its end a rod that falls about the arm's own direction."""
    start = {
        "PositionTargetSpecify": "on",
        "PositionTargetValue": "100",
        "PositionTargetValueUnits": "deg",
    }
    level, joints = two_rods({"TorqueActuationMode": "InputTorque"}, start, second_turn="90")
    drive(level, joints[0], "Sin", "Torque", Amplitude="0.3", Frequency="4")
    result = run(tmp_path, level, 5)
    mass, arm, middle, spin, along = 0.5, 0.5, 0.2, 0.007, 0.001
    own = 0.02 + 1.0 * 0.25**2  # of the arm about its axis

    def motion(time, state):
        """By the angle b of the rod against y of the arm: its centre is at (arm, l cos b, l sin b)."""
        _, tilt, rate, fall = state
        sine, cosine = np.sin(tilt), np.cos(tilt)
        level_inertia = mass * middle**2 + spin - along
        inertia = np.array(
            [
                [
                    own + mass * arm**2 + level_inertia * cosine**2 + along,
                    -mass * arm * middle * sine,
                ],
                [-mass * arm * middle * sine, mass * middle**2 + spin],
            ]
        )
        torque = 0.3 * np.sin(4 * time)
        push = [
            torque
            + 2 * level_inertia * sine * cosine * rate * fall
            + mass * arm * middle * cosine * fall**2,
            -level_inertia * sine * cosine * rate**2 - mass * WEIGHT * middle * cosine,
        ]
        return np.concatenate([[rate, fall], np.linalg.solve(inertia, push)])

    expected = solved(motion, [0.0, np.deg2rad(100), 0.0, 0.0], result.times)
    np.testing.assert_allclose(result["q.Second"], expected[1], atol=2e-3)
    np.testing.assert_allclose(result["q.First"], expected[0], atol=2e-3)


def test_one_joint_is_moved_and_the_other_one_driven(tmp_path):
    """The first rod follows a sine; the second one, about the same axis, gets a torque and no motor holds it."""
    level, joints = two_rods(
        {"MotionActuationMode": "InputMotion"}, {"TorqueActuationMode": "InputTorque"}
    )
    drive(level, joints[0], "Sin", "Motion", Amplitude="0.5", Frequency="3")
    drive(level, joints[1], "Sin", "Torque", Amplitude="0.05", Frequency="5")
    result = run(tmp_path, level, 5)
    inertia, coupling = 0.007 + 0.5 * 0.2**2, 0.5 * 0.5 * 0.2

    def motion(time, state):
        turn, rate = 0.5 * 3 * np.cos(3 * time), -0.5 * 9 * np.sin(3 * time)
        bent = state[0] + np.pi / 2  # the rod lies along y of its joint
        push = (
            0.05 * np.sin(5 * time)
            - coupling * (rate * np.cos(bent) + turn**2 * np.sin(bent))
            - inertia * rate
        )
        return [state[1], push / inertia]

    expected = solved(motion, [0.0, 0.0], result.times)[0]
    np.testing.assert_allclose(result["q.First"], 0.5 * np.sin(3 * result.times), atol=1e-3)
    np.testing.assert_allclose(result["q.Second"], expected, atol=2e-3)


def test_a_motion_that_a_loop_counts_up(tmp_path):
    """A reference that is its own last value and a bit more has no value that could be asked for at the start."""
    level, joints = two_rods({"MotionActuationMode": "InputMotion"}, {})
    bit, late = (
        level.block("Constant", "Bit", Value="0.01"),
        level.block("UnitDelay", "Late", SampleTime="0.1"),
    )
    count, into = level.block("Sum", "Count", Inputs="++"), level.block(TO_PHYSICS, "In", Unit="1")
    level.wire(f"{bit}#out:1", f"{count}#in:1")
    level.wire(f"{late}#out:1", f"{count}#in:2")
    level.wire(f"{count}#out:1", f"{late}#in:1", f"{into}#in:1")
    level.connect(f"{into}#rconn:1", f"{joints[0]}#lconn:2")
    imported = import_simulink(write_model(tmp_path / "a.slx", level), tmp_path / "out")
    assert imported.fidelity == "mechanics complete; 1 joint prescribed"


def pulled(tmp_path, extend):
    """A hinge of 0.5 kg m² that 3 N·m pull on, with what ``extend`` adds; its import and the speed after 0.5 s."""
    level, joint = hinge()
    torque, into = (
        level.block("Constant", "Torque", Value="3"),
        level.block(TO_PHYSICS, "In", Unit="1"),
    )
    level.wire(f"{torque}#out:1", f"{into}#in:1")
    level.connect(f"{into}#rconn:1", f"{joint}#lconn:2")
    extend(level, joint)
    imported = import_simulink(write_model(tmp_path / "a.slx", level), tmp_path / "out")
    result = simulate(imported.station, duration=0.5, progress=False)
    return imported, result[next(name for name in result.names if f".{name}".endswith(".v.J"))][-1]


def test_a_joint_that_is_not_connected_stops_no_other(tmp_path):
    imported, speed = pulled(tmp_path, lambda level, _: level.block(REVOLUTE, "Alone"))
    assert imported.fidelity == "mechanics complete"
    assert speed == pytest.approx(3.0, rel=1e-3)
    assert [entry.element for entry in imported.report.of("dropped")] == ["Alone"]


@pytest.mark.parametrize("driver", ["", "PMIOPort", "MyLib/Drive"])
def test_an_open_torque_input_is_0_and_one_that_is_not_read_is_lost(tmp_path, driver):
    def extend(level, joint):
        other = level.block(REVOLUTE, "Other", TorqueActuationMode="InputTorque")
        body = level.block(INERTIA, "Disk", Mass="1", MomentsOfInertia="[0.2 0.2 0.2]")
        level.connect(f"{joint}#rconn:1", f"{other}#lconn:1")
        level.connect(f"{other}#rconn:1", f"{body}#rconn:1")
        if driver:
            level.connect(f"{level.block(driver, 'Driver')}#rconn:1", f"{other}#lconn:2")

    imported, _ = pulled(tmp_path, extend)
    kinds = [entry.kind for entry in imported.report.entries if "nothing drives it" in entry.text]
    assert kinds == ["lost" if "/" in driver else "defaulted"]
    assert ("lost" in imported.fidelity) == ("/" in driver)


def test_a_joint_on_which_nothing_weighs_is_held_and_the_others_move(tmp_path):
    def extend(level, joint):
        last = level.block(REVOLUTE, "Last")
        level.connect(f"{joint}#rconn:1", f"{last}#lconn:1")
        level.connect(
            f"{last}#rconn:1",
            f"{level.block('sm_lib/Frames and Transforms/Reference Frame', 'End')}#rconn:1",
        )

    imported, speed = pulled(tmp_path, extend)
    assert imported.fidelity == "1 Revolute Joint lost; 1 joint prescribed"
    assert speed == pytest.approx(3.0, rel=1e-3)


def test_a_group_that_weighs_nothing_is_left_out_and_the_others_move(tmp_path):
    def extend(level, _):
        loose = level.block(REVOLUTE, "Loose")
        for side in ("lconn", "rconn"):
            end = level.block("sm_lib/Frames and Transforms/Reference Frame", side)
            level.connect(f"{loose}#{side}:1", f"{end}#rconn:1")

    imported, speed = pulled(tmp_path, extend)
    assert imported.fidelity == "1 Revolute Joint lost"
    assert speed == pytest.approx(3.0, rel=1e-3)


def test_a_station_that_no_force_moves_says_so_first(tmp_path):
    level = Level()
    world, joint = level.block(WORLD, "World"), level.block(REVOLUTE, "J")
    end = level.block("sm_lib/Frames and Transforms/Reference Frame", "End")
    level.connect(f"{world}#rconn:1", f"{joint}#lconn:1")
    level.connect(f"{joint}#rconn:1", f"{end}#rconn:1")
    imported = import_simulink(write_model(tmp_path / "a.slx", level), tmp_path / "out")
    assert imported.fidelity == "1 motion by forces lost"


def over_a_floor(**actuation):
    """A ball of 1 kg at 0.2 m of a hinge, 0.3 m above a plane that it does not reach, level; and the hinge."""
    level = Level()
    world, joint, plane = level.block(WORLD, "World"), level.block(REVOLUTE, "J", **actuation), level.block(
        "sm_lib/Curves and Surfaces/Infinite Plane", "Floor")  # fmt: skip
    mount = level.block(TRANSFORM, "Mount", TranslationMethod="Cartesian", TranslationCartesianOffset="[0 0 0.3]",
                        RotationMethod="StandardAxis", RotationStandardAxis="+X", RotationAngle="-90",
                        RotationAngleUnits="deg")  # fmt: skip
    arm = level.block(
        TRANSFORM, "Arm", TranslationMethod="Cartesian", TranslationCartesianOffset="[0.2 0 0]"
    )
    ball = level.block("sm_lib/Body Elements/Spherical Solid", "Ball", SphereRadius="0.05", BasedOnType="Mass",
                       Mass="1", ExportEntireGeometry="on")  # fmt: skip
    touch = level.block("sm_lib/Forces and Torques/Spatial Contact Force", "Touch")
    level.connect(f"{world}#rconn:1", f"{mount}#lconn:1", f"{plane}#lconn:1")
    level.connect(f"{mount}#rconn:1", f"{joint}#lconn:1")
    level.connect(f"{joint}#rconn:1", f"{arm}#lconn:1")
    level.connect(f"{arm}#rconn:1", f"{ball}#rconn:1")
    level.connect(f"{ball}#lconn:1", f"{touch}#lconn:1")
    level.connect(f"{plane}#rconn:1", f"{touch}#rconn:1")
    return level, joint


def test_what_could_touch_the_floor_swings_as_exactly(tmp_path):
    level, _ = over_a_floor()
    imported = import_simulink(write_model(tmp_path / "a.slx", level), tmp_path / "out")
    assert load_station(imported.station).contact is not None
    result = simulate(imported.station, duration=0.6, progress=False)
    spin = 0.2**2 + 0.4 * 0.05**2
    angle, _ = solved(
        lambda _, state: [state[1], WEIGHT * 0.2 * np.cos(state[0]) / spin], [0, 0], result.times
    )
    np.testing.assert_allclose(result["q.J"], angle, atol=0.005 * np.ptp(angle))


def test_a_motion_is_in_time_beside_a_floor(tmp_path):
    """A hinge that a sine turns, with another one in the world that nothing drives."""
    level, joint = over_a_floor(MotionActuationMode="InputMotion")
    drive(level, joint, "Sin", "Motion", Amplitude="0.5", Frequency="3")
    free, wheel = (
        level.block(REVOLUTE, "Free"),
        level.block(INERTIA, "Wheel", Mass="1", MomentsOfInertia="[1 1 1]"),
    )
    level.connect("1#rconn:1", f"{free}#lconn:1")
    level.connect(f"{free}#rconn:1", f"{wheel}#rconn:1")
    result = run(tmp_path, level, 2)
    turned = result[next(name for name in result.names if name.endswith("q.J"))]
    np.testing.assert_allclose(turned, 0.5 * np.sin(3 * result.times), atol=1e-3)
