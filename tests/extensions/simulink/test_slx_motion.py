"""How models begin to move, what holds their joints at the limits, and laws that read frames."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from slx_files import (
    FROM_PHYSICS,
    INERTIA,
    REVOLUTE,
    TO_PHYSICS,
    TRANSFORM,
    WORLD,
    Level,
    write_model,
)
from test_mechanics import four_bar, mechanism

from simrob_drake import load_station, simulate
from simrob_drake.extensions.simulink.importing import import_simulink
from simrob_drake.extensions.simulink.mechanics.trees import body_poses
from simrob_drake.extensions.simulink.stepping.station import SteppedStation

TIGHT = {"solver.accuracy": 1e-6, "solver.max_step": 0.01}
SENSOR = "sm_lib/Frames and\nTransforms/Transform\nSensor"


def hinges(level, *given):
    """Add hinges about the world's z with an inertia of 1 kg m² each, and return their SIDs."""
    world = level.block(WORLD, "World")
    joints = [
        level.block(REVOLUTE, "AB"[index], **parameters) for index, parameters in enumerate(given)
    ]
    for joint in joints:
        rod = level.block(INERTIA, f"Rod {joint}", Mass="1", MomentsOfInertia="[1 1 1]")
        level.connect(f"{world}#rconn:1", f"{joint}#lconn:1")
        level.connect(f"{joint}#rconn:1", f"{rod}#rconn:1")
    return world, joints


def target(kind, value, unit, priority="High"):
    name = f"{kind}Target"
    return {
        f"{name}Specify": "on",
        f"{name}Value": value,
        f"{name}ValueUnits": unit,
        f"{name}Priority": priority,
    }


def test_joints_begin_at_their_speeds(tmp_path):
    """Against a damper of 2 N·m·s/rad an inertia of 1 kg m² comes to v/2 (1 - exp(-2 t))."""
    level = Level()
    damped = {"DampingCoefficient": "2", "DampingCoefficientUnits": "N*m*s/rad"}
    hinges(
        level,
        {**damped, **target("Velocity", "90", "deg/s"), **target("Position", "0.25", "rad")},
        {},
    )
    station = import_simulink(write_model(tmp_path / "a.slx", level), tmp_path / "out").station
    result = simulate(load_station(station, TIGHT), duration=1.0, progress=False)
    exact = 0.25 + np.pi / 4 * (1 - np.exp(-2 * result.times))
    np.testing.assert_allclose(result["q.A"], exact, atol=1e-5)
    np.testing.assert_allclose(result["q.B"], 0.0, atol=1e-12)
    unit = SteppedStation(station)
    unit.advance(0.5)
    assert unit.get("position.A") == pytest.approx(0.25 + np.pi / 4 * (1 - np.exp(-1)), abs=1e-3)


def test_a_free_body_is_thrown(tmp_path):
    """Its joint's follower is 0.1 m below the ball, so the ball's speed has a part of its spin."""
    level = Level()
    world = level.block(WORLD, "World")
    spin = {"SphVelocityTargetSpecify": "on", "SphVelocityTargetValue": "[0 3 0]",
            "SphVelocityTargetValueUnits": "rad/s", "SphVelocityTargetInFollowerFrame": "on"}  # fmt: skip
    free = level.block("sm_lib/Joints/6-DOF Joint", "Free", PxVelocityTargetSpecify="on", PxVelocityTargetValue="2",
                       SphPositionTargetSpecify="on", SphPositionTargetRotationMethod="StandardAxis",
                       SphPositionTargetRotationAngle="pi/2", **spin)  # fmt: skip
    up = level.block(
        TRANSFORM, "Up", TranslationMethod="Cartesian", TranslationCartesianOffset="[0 0 0.1]"
    )
    ball = level.block(
        "sm_lib/Body Elements/Spherical Solid", "Ball", SphereRadius="0.05", Density="1000"
    )
    level.connect(f"{world}#rconn:1", f"{free}#lconn:1")
    level.connect(f"{free}#rconn:1", f"{up}#lconn:1")
    level.connect(f"{up}#rconn:1", f"{ball}#rconn:1")
    station = import_simulink(write_model(tmp_path / "a.slx", level), tmp_path / "out").station
    result = simulate(station, duration=0.4, progress=False)
    velocity = result.piece_velocity("Ball")
    np.testing.assert_allclose(velocity[0, 3:], [-3, 0, 0], atol=1e-9)  # 90° about z put y along -x
    np.testing.assert_allclose(velocity[0, :3], [2, 0.3, 0], atol=1e-9)
    end = result.piece_pose("Ball")[-1, :3]
    np.testing.assert_allclose(end, [0.8, 0.12, 0.1 - 9.80665 * 0.08], atol=1e-5)


@pytest.mark.parametrize(("priority", "kept"), [("High", True), ("Low", False)])
def test_a_loop_begins_at_speeds_that_keep_it_closed(tmp_path, priority, kept):
    """One of two asked speeds can be had: that of the first hinge, or, where it is of low priority, of the second."""
    level = four_bar()
    for joint, speed, urgency in (
        ("Joint1", "1", priority),
        ("Joint2", "1", "Low" if kept else "High"),
    ):
        place = next(place for place, text in enumerate(level.blocks) if f'Name="{joint}"' in text)
        asked = "".join(
            f'<P Name="{key}">{text}</P>'
            for key, text in target("Velocity", speed, "rad/s", urgency).items()
        )
        level.blocks[place] = level.blocks[place].replace(
            "<InstanceData>", f"<InstanceData>{asked}"
        )
    imported = import_simulink(write_model(tmp_path / "a.slx", level), tmp_path / "out")
    (robot,) = imported.files.robots.values()
    tree = robot.tree
    starts = np.array([freedom.start for freedom in tree.freedoms])
    speeds = np.array([freedom.start_speed for freedom in tree.freedoms])

    def gap(q):
        poses = body_poses(tree, q)
        return np.array([closing.gap(poses) for closing in tree.closings])

    rate = (np.array(gap(starts + 1e-6 * speeds)) - gap(starts - 1e-6 * speeds)) / 2e-6
    np.testing.assert_allclose(rate, 0.0, atol=1e-6)
    assert speeds[0 if kept else 1] == pytest.approx(1.0, abs=0.02)
    assert any("so its loop closes" in entry.text for entry in imported.report.of("approximated"))
    result = simulate(imported.station, duration=0.01, progress=False)
    np.testing.assert_allclose(result.axes("v")[0], speeds, atol=1e-9)


def test_a_hinge_that_asks_for_a_start_is_no_place_to_cut_a_loop(tmp_path):
    """The hinge that closes the loop asks for a speed, and has it; the first one's angle stays what it asks for."""
    model = write_model(tmp_path / "a.slx", four_bar(**target("Velocity", "-1", "rad/s")))
    result = simulate(
        import_simulink(model, tmp_path / "out").station, duration=0.01, progress=False
    )
    assert result["v.Closing"][0] == pytest.approx(-1.0, abs=1e-5)
    assert result["q.Joint1"][0] == pytest.approx(np.deg2rad(80), abs=1e-5)


def test_a_loop_begins_where_a_motion_holds_its_crank(tmp_path):
    """The next hinge asks for an angle many turns away that it cannot have: the crank does not give way for that."""
    level = four_bar()
    driven = {"MotionActuationMode": "InputMotion", "TorqueActuationMode": "ComputedTorque"}
    for joint, given in (("Joint1", driven), ("Joint2", target("Position", "40", "rad", "High"))):
        place = next(place for place, text in enumerate(level.blocks) if f'Name="{joint}"' in text)
        figures = "".join(f'<P Name="{key}">{text}</P>' for key, text in given.items())
        level.blocks[place] = level.blocks[place].replace(
            "<InstanceData>", f"<InstanceData>{figures}"
        )
    angle, into = (
        level.block("Constant", "Angle", Value="1.1"),
        level.block(TO_PHYSICS, "In", Unit="rad"),
    )
    crank = (
        next(text for text in level.blocks if 'Name="Joint1"' in text)
        .partition('SID="')[2]
        .partition('"')[0]
    )
    level.wire(f"{angle}#out:1", f"{into}#in:1")
    level.connect(f"{into}#rconn:1", f"{crank}#lconn:2")
    imported = import_simulink(write_model(tmp_path / "a.slx", level), tmp_path / "out")
    (robot,) = imported.files.robots.values()
    starts = np.array([freedom.start for freedom in robot.tree.freedoms])
    assert starts[0] == 1.1
    assert abs(starts[1] - 40) < np.pi
    assert (
        max(
            np.abs(closing.gap(body_poses(robot.tree, starts))).max()
            for closing in robot.tree.closings
        )
        < 1e-9
    )


def test_each_joint_has_the_stops_of_its_own(tmp_path):
    """Into a spring of k an inertia of 1 kg m² at 1 rad/s goes 1/sqrt(k) deep."""
    level = Level()

    def stop(stiffness):
        figures = {"UpperLimitSpecify": "on", "UpperLimitBound": "0.1", "UpperLimitBoundUnits": "rad",
                   "UpperLimitStiffness": stiffness, "UpperLimitStiffnessUnits": "N*m/rad", "UpperLimitDamping": "0",
                   "UpperLimitDampingUnits": "N*m*s/rad"}  # fmt: skip
        return {**target("Velocity", "1", "rad/s"), **figures}

    hinges(level, stop("400"), stop("10000"))
    imported = import_simulink(write_model(tmp_path / "a.slx", level), tmp_path / "out")
    config = load_station(imported.station, {**TIGHT, "sample_rate": 5000})
    assert config.joint_stops.stiffness == {"A": 400.0, "B": 10000.0}
    result = simulate(config, duration=0.2, progress=False)
    assert result["q.A"].max() == pytest.approx(0.1 + 1 / 20, abs=1e-4)
    assert result["q.B"].max() == pytest.approx(0.1 + 1 / 100, abs=1e-4)
    assert imported.report.of("repaired") + imported.report.of("dropped") == []


def test_a_stop_as_hard_as_no_steel_is_run_through(tmp_path):
    """A slide of 0.2 kg falls 1 cm onto a stop of 1e10 N/m, and rests there after sqrt(2 h / g)."""
    level = Level()
    figures = {"LowerLimitSpecify": "on", "LowerLimitStiffness": "1e10", "LowerLimitDamping": "1e9"}
    world, slide = level.block(WORLD, "World"), level.block("sm_lib/Joints/Prismatic Joint", "Slide",
                                                            **target("Position", "0.01", "m"), **figures)  # fmt: skip
    load = level.block(INERTIA, "Load", Mass="0.2", MomentsOfInertia="[1 1 1]")
    level.connect(f"{world}#rconn:1", f"{slide}#lconn:1")
    level.connect(f"{slide}#rconn:1", f"{load}#rconn:1")
    imported = import_simulink(write_model(tmp_path / "a.slx", level), tmp_path / "out")
    config = load_station(imported.station)
    assert (config.joint_stops.stiffness, config.joint_stops.damping) == (1e8, 1e5)
    assert "its stop of 1e+10 N/m is one of 1e+08" in [
        one.text for one in imported.report.of("approximated")
    ]
    result = simulate(config, duration=0.5, progress=False)
    before = result.times < 0.95 * np.sqrt(0.02 / 9.80665)
    fall = 0.01 - 0.5 * 9.80665 * result.times[before] ** 2
    np.testing.assert_allclose(result["q.Slide"][before], fall, atol=1e-5)
    assert np.abs(result["q.Slide"][result.times > 0.2]).max() < 1e-5


def test_laws_may_read_a_rotation_matrix(tmp_path):
    """The angle of a hinge is atan2 of two entries of its frame's rotation matrix: T = -9 angle."""
    level = Level()
    driven = {"TorqueActuationMode": "InputTorque"}
    world, (joint,) = hinges(level, {**driven, **target("Position", "0.5", "rad")})
    sensor = level.block(SENSOR, "Sensor", SenseR="on", MeasurementFrame="World")
    out = level.block(FROM_PHYSICS, "out", Unit="1")
    parts = [
        level.block(
            "Selector",
            f"R{row}1",
            NumberOfDimensions="2",
            Indices=f"[{row}],1",
            IndexMode="One-based",
        )
        for row in (2, 1)
    ]
    angle = level.block("Trigonometry", "Angle", Operator="atan2")
    gain, into = level.block("Gain", "k", Gain="-9"), level.block(TO_PHYSICS, "in", Unit="1")
    level.connect(f"{world}#rconn:1", f"{sensor}#lconn:1")
    level.connect(f"{joint}#rconn:1", f"{sensor}#rconn:1")
    level.connect(f"{sensor}#rconn:2", f"{out}#lconn:1")
    level.wire(f"{out}#out:1", *(f"{part}#in:1" for part in parts))
    for number, part in enumerate(parts):
        level.wire(f"{part}#out:1", f"{angle}#in:{number + 1}")
    level.wire(f"{angle}#out:1", f"{gain}#in:1")
    level.wire(f"{gain}#out:1", f"{into}#in:1")
    level.connect(f"{into}#rconn:1", f"{joint}#lconn:2")
    imported = import_simulink(write_model(tmp_path / "a.slx", level), tmp_path / "out")
    result = simulate(load_station(imported.station, TIGHT), duration=1.5, progress=False)
    np.testing.assert_allclose(result["q.A"], 0.5 * np.cos(3 * result.times), atol=2e-4)
    assert not imported.report.of("dropped")


def test_laws_may_read_where_frames_are(tmp_path):
    """A is turned by the azimuth of its tip in the world, B by where its tip is in the frame of A."""
    level = Level()
    driven = {"TorqueActuationMode": "InputTorque"}
    world, joints = hinges(
        level,
        {**driven, **target("Position", "0.5", "rad")},
        {**driven, **target("Velocity", "1", "rad/s")},
    )
    sensed = [
        {"SenseAzim": "on", "SenseAzimDot": "on", "SenseDist": "on", "SenseR": "on"},
        {"SenseY": "on", "SenseYDot": "on"},
    ]
    bases, axes = (f"{world}#rconn:1", f"{joints[0]}#rconn:1"), ("World", "Base")
    gains = (("4", "0.5", "1"), ("9", "2"))
    for index, joint in enumerate(joints):
        tip = level.block(
            TRANSFORM,
            f"Tip {index}",
            TranslationMethod="Cartesian",
            TranslationCartesianOffset="[2 0 0]",
        )
        sensor = level.block(
            SENSOR, f"Sensor {index}", MeasurementFrame=axes[index], **sensed[index]
        )
        level.connect(f"{joint}#rconn:1", f"{tip}#lconn:1")
        level.connect(f"{tip}#rconn:1", f"{sensor}#rconn:1")
        level.connect(bases[index], f"{sensor}#lconn:1")
        law = level.block("Sum", f"Law {index}", Inputs="-" * len(gains[index]))
        skipped = index == 0  # the rotation matrix is the first of the first sensor's ports
        for number, gain in enumerate(gains[index]):
            out = level.block(FROM_PHYSICS, f"out {index} {number}", Unit="inherit")
            level.connect(f"{sensor}#rconn:{number + 2 + skipped}", f"{out}#lconn:1")
            amplified = level.block("Gain", f"k {index} {number}", Gain=gain)
            level.wire(f"{out}#out:1", f"{amplified}#in:1")
            level.wire(f"{amplified}#out:1", f"{law}#in:{number + 1}")
        into = level.block(TO_PHYSICS, f"in {index}", Unit="1")
        level.wire(f"{law}#out:1", f"{into}#in:1")
        level.connect(f"{into}#rconn:1", f"{joint}#lconn:2")
    imported = import_simulink(write_model(tmp_path / "a.slx", level), tmp_path / "out")
    result = simulate(
        load_station(imported.station, {**TIGHT, "solver.accuracy": 1e-5}),
        duration=1.0,
        progress=False,
    )

    def motion(_, y):
        qa, wa, qb, wb = y
        seen, rate = 2 * np.sin(qb - qa), 2 * np.cos(qb - qa) * (wb - wa)
        return wa, -4 * qa - wa - 0.5 * 2, wb, -9 * seen - 2 * rate

    exact = solve_ivp(motion, (0, 1), [0.5, 0, 0, 1], rtol=1e-9, atol=1e-9, t_eval=result.times)
    np.testing.assert_allclose(result["q.A"], exact.y[0], atol=2e-4)
    np.testing.assert_allclose(result["q.B"], exact.y[2], atol=2e-4)
    np.testing.assert_allclose(
        result["frame.Sensor_1.y"], 2 * np.sin(result["q.B"] - result["q.A"]), atol=1e-9
    )


def test_a_motion_beside_a_passive_joint_is_prescribed(tmp_path):
    """A crank goes as its sine says, while the rod that hangs on it swings by forces: nothing is frozen."""
    level, _ = mechanism()
    level.blocks = [
        block.replace(
            "<InstanceData>", '<InstanceData><P Name="MotionActuationMode">InputMotion</P>', 1
        )
        if 'Name="Joint1"' in block
        else block
        for block in level.blocks
    ]
    wave = level.block("Sin", "Wave", Amplitude="0.5", Frequency="3")
    into = level.block(TO_PHYSICS, "In", Unit="rad")
    joint = (
        next(block for block in level.blocks if 'Name="Joint1"' in block)
        .partition('SID="')[2]
        .partition('"')[0]
    )
    level.wire(f"{wave}#out:1", f"{into}#in:1")
    level.connect(f"{into}#rconn:1", f"{joint}#lconn:2")
    imported = import_simulink(write_model(tmp_path / "a.slx", level), tmp_path / "out")
    assert imported.fidelity == "mechanics complete; 1 joint prescribed"
    config = load_station(imported.station)
    assert config.mode == "dynamic"
    result = simulate(config, duration=1.0, progress=False)
    np.testing.assert_allclose(result["q.Joint1"], 0.5 * np.sin(3 * result.times), atol=1e-4)
    assert np.ptp(result["q.Joint2"]) > 0.1
    told = next(
        one.text for one in imported.report.of("read") if one.text.startswith("axis Joint1 ")
    )
    assert told.endswith("its motion is prescribed for 1 s, and holds then")


@pytest.mark.long
def test_a_long_motion_is_no_table_too_long_to_run(tmp_path, monkeypatch):
    """A sine of one turn in 100 s, for 360 s: at 200 rows a second its table would be refused.

    Tables hold a tenth of what they may elsewhere, or the motion would have to last an hour.
    """
    for module in ("simulink.writing.references", "parts.references"):
        monkeypatch.setattr(f"simrob_drake.{module}.MOST_VALUES", 50_000)
    level = Level()
    _, (joint, _) = hinges(level, {"MotionActuationMode": "InputMotion"}, {})
    wave = level.block("Sin", "Wave", Amplitude="1", Frequency="2*pi/100")
    into = level.block(TO_PHYSICS, "In", Unit="rad")
    level.wire(f"{wave}#out:1", f"{into}#in:1")
    level.connect(f"{into}#rconn:1", f"{joint}#lconn:2")
    station = import_simulink(
        write_model(tmp_path / "a.slx", level, stop="360"), tmp_path / "out"
    ).station
    result = simulate(station, duration=0.5, progress=False)
    np.testing.assert_allclose(result["q.A"], np.sin(2e-2 * np.pi * result.times), atol=1e-6)


def test_a_motion_that_cannot_be_computed_is_lost_and_no_other(tmp_path):
    """The arc cosine of a ramp is none after a second; the other joint goes as its sine says."""
    level = Level()
    moved = {"MotionActuationMode": "InputMotion"}
    _, joints = hinges(level, moved, moved)
    rest, rod = (
        level.block(REVOLUTE, "Passive"),
        level.block(INERTIA, "Rest", Mass="1", MomentsOfInertia="[1 1 1]"),
    )
    level.connect("1#rconn:1", f"{rest}#lconn:1")
    level.connect(f"{rest}#rconn:1", f"{rod}#rconn:1")
    ramp, wave = level.block("Ramp", "Ramp"), level.block("Sin", "Wave", Frequency="3")
    bent = level.block("Trigonometry", "Bent", Operator="acos")
    level.wire(f"{ramp}#out:1", f"{bent}#in:1")
    for source, joint in zip((bent, wave), joints, strict=True):
        into = level.block(TO_PHYSICS, f"In {joint}", Unit="rad")
        level.wire(f"{source}#out:1", f"{into}#in:1")
        level.connect(f"{into}#rconn:1", f"{joint}#lconn:2")
    imported = import_simulink(write_model(tmp_path / "a.slx", level, stop="2"), tmp_path / "out")
    assert imported.fidelity == "1 Revolute Joint lost; 2 joints prescribed"
    (lost,) = imported.report.of("lost")
    assert (lost.element, lost.text[:37]) == ("A", "its motion is not there, it is held: ")
    result = simulate(imported.station, duration=0.5, progress=False)
    np.testing.assert_allclose(result["q.B"], np.sin(3 * result.times), atol=1e-4)
    assert np.ptp(result["q.A"]) < 1e-6


@pytest.mark.parametrize("bias", [0.0, 0.7])
def test_a_motion_begins_where_its_filter_does(tmp_path, bias):
    """A sine behind a converter's filter of 0.5 s, which begins at its input: 0.5 q' = sin(2 t) + bias - q."""
    level = Level()
    _, (joint, _) = hinges(
        level, {"MotionActuationMode": "InputMotion"}, {"TorqueActuationMode": "NoTorque"}
    )
    wave = level.block("Sin", "Wave", Amplitude="1", Frequency="2", Bias=str(bias))
    into = level.block(
        TO_PHYSICS,
        "In",
        Unit="rad",
        FilteringAndDerivatives="filter",
        InputFilterTimeConstant="0.5",
    )
    level.wire(f"{wave}#out:1", f"{into}#in:1")
    level.connect(f"{into}#rconn:1", f"{joint}#lconn:2")
    station = import_simulink(write_model(tmp_path / "a.slx", level), tmp_path / "out").station
    result = simulate(station, duration=1.0, progress=False)
    t = result.times
    exact = bias + (np.sin(2 * t) - np.cos(2 * t) + np.exp(-2 * t)) / 2
    np.testing.assert_allclose(result["q.A"], exact, atol=1e-3)


def test_motions_may_follow_motions_their_own_included(tmp_path):
    """A's: 0.5 s q' + q = q/2 + sin 2t, through a filter that forgets it, and B's is twice A's."""
    level = Level()
    moved = {"MotionActuationMode": "InputMotion", "SensePosition": "on"}
    _, (a, b) = hinges(level, moved, moved)
    wave, out = level.block("Sin", "Wave", Frequency="2"), level.block(FROM_PHYSICS, "Out")
    half, twice = (
        level.block("Gain", name, Gain=gain) for name, gain in (("Half", "0.5"), ("Twice", "2"))
    )
    both = level.block("Sum", "Both", Inputs="++")
    slow = {"FilteringAndDerivatives": "filter", "InputFilterTimeConstant": "0.5"}
    into, other = (
        level.block(TO_PHYSICS, "In", Unit="rad", **slow),
        level.block(TO_PHYSICS, "Other", Unit="rad"),
    )
    level.connect(f"{a}#rconn:2", f"{out}#lconn:1")
    level.wire(f"{out}#out:1", f"{half}#in:1", f"{twice}#in:1")
    level.wire(f"{wave}#out:1", f"{both}#in:1")
    level.wire(f"{half}#out:1", f"{both}#in:2")
    level.wire(f"{both}#out:1", f"{into}#in:1")
    level.wire(f"{twice}#out:1", f"{other}#in:1")
    level.connect(f"{into}#rconn:1", f"{a}#lconn:2")
    level.connect(f"{other}#rconn:1", f"{b}#lconn:2")
    imported = import_simulink(write_model(tmp_path / "a.slx", level), tmp_path / "out")
    assert imported.fidelity.startswith("mechanics complete")
    result = simulate(imported.station, duration=1.0, progress=False)
    t = result.times
    exact = (2 * np.sin(2 * t) - 4 * np.cos(2 * t) + 4 * np.exp(-t)) / 5
    np.testing.assert_allclose(result["q.A"], exact, atol=1e-3)
    np.testing.assert_allclose(result["q.B"], 2 * exact, atol=2e-3)


def test_a_motion_that_follows_what_is_measured_is_lost(tmp_path):
    """Only motions over time can be prescribed: what B's angle says of A's motion would be held in silence."""
    level = Level()
    _, (joint, other) = hinges(
        level, {"MotionActuationMode": "InputMotion"}, {"SensePosition": "on"}
    )
    out, half, into = (
        level.block(FROM_PHYSICS, "Out"),
        level.block("Gain", "Half", Gain="0.5"),
        level.block(TO_PHYSICS, "In"),
    )
    level.connect(f"{other}#rconn:2", f"{out}#lconn:1")
    level.wire(f"{out}#out:1", f"{half}#in:1")
    level.wire(f"{half}#out:1", f"{into}#in:1")
    level.connect(f"{into}#rconn:1", f"{joint}#lconn:2")
    imported = import_simulink(write_model(tmp_path / "a.slx", level), tmp_path / "out")
    assert imported.fidelity.startswith("1 drive lost")
    (lost,) = (one for one in imported.outcomes if one.fate == "lost")
    assert lost.path == "A"
    assert "follows what is measured (B)" in lost.text


def test_functions_of_files_beside_the_model_are_translated(tmp_path):
    """An Interpreted MATLAB Function of a file, which calls others, of which one calls one: q = 2 sin(3 t)."""
    (tmp_path / "wanted.m").write_text(
        "function q = wanted(t)\nq = much(t) - waving(t);\nend\n", encoding="utf-8"
    )
    (tmp_path / "much.m").write_text(
        "function y = much(x)\ny = 3 * waving(x);\nend\n", encoding="utf-8"
    )
    (tmp_path / "waving.m").write_text(
        "function y = waving(x)\nw = 3;\ny = sin(w * x);\n", encoding="utf-8"
    )
    level = Level()
    _, (joint, _) = hinges(level, {"MotionActuationMode": "InputMotion"}, {})
    clock, shape = (
        level.block("Clock", "Clock"),
        level.block("MATLABFcn", "Shape", MATLABFcn="wanted"),
    )
    into = level.block(TO_PHYSICS, "In", Unit="rad")
    level.wire(f"{clock}#out:1", f"{shape}#in:1")
    level.wire(f"{shape}#out:1", f"{into}#in:1")
    level.connect(f"{into}#rconn:1", f"{joint}#lconn:2")
    station = import_simulink(write_model(tmp_path / "a.slx", level), tmp_path / "out").station
    result = simulate(station, duration=1.0, progress=False)
    np.testing.assert_allclose(result["q.A"], 2 * np.sin(3 * result.times), atol=1e-3)


def test_a_link_without_mass_between_joints_moves_by_forces(tmp_path):
    """A body that turns alike about all axes, on two crossing hinges, keeps the speed of the first."""
    level = Level()
    about = {
        "RotationMethod": "StandardAxis",
        "RotationStandardAxis": "+X",
        "RotationAngle": "pi/2",
    }
    world, across = level.block(WORLD, "World"), level.block(TRANSFORM, "Across", **about)
    first = level.block(REVOLUTE, "A", **target("Velocity", "2", "rad/s"))
    second, body = (
        level.block(REVOLUTE, "B"),
        level.block(INERTIA, "Body", Mass="1", MomentsOfInertia="[1 1 1]"),
    )
    for one, other in ((world, first), (first, across), (across, second)):
        level.connect(f"{one}#rconn:1", f"{other}#lconn:1")
    level.connect(f"{second}#rconn:1", f"{body}#rconn:1")
    imported = import_simulink(write_model(tmp_path / "a.slx", level), tmp_path / "out")
    assert load_station(imported.station).mode == "dynamic"
    result = simulate(load_station(imported.station, TIGHT), duration=1.0, progress=False)
    np.testing.assert_allclose(result["q.A"], 2 * result.times, atol=1e-5)
    np.testing.assert_allclose(result["q.B"], 0.0, atol=1e-6)


def test_a_filter_begins_at_its_output(tmp_path):
    """From 0.3 rad to 1 rad by 1 / (0.5 s + 1): 1 - 0.7 exp(-2 t); beside it a joint is locked at 0.2 rad."""
    level = Level()
    locked = {"JointMode": "Locked", **target("Position", "0.2", "rad")}
    _, (joint, _) = hinges(level, {"MotionActuationMode": "InputMotion"}, locked)
    wanted = level.block("Constant", "Wanted", Value="1")
    smooth = level.block("simulink_extras/Additional Linear/Transfer Fcn (with initial outputs)", "Smooth", N="1",
                         D="[0.5 1]", Y0="0.3", U0="0.3")  # fmt: skip
    into = level.block(TO_PHYSICS, "In", Unit="rad")
    level.wire(f"{wanted}#out:1", f"{smooth}#in:1")
    level.wire(f"{smooth}#out:1", f"{into}#in:1")
    level.connect(f"{into}#rconn:1", f"{joint}#lconn:2")
    imported = import_simulink(write_model(tmp_path / "a.slx", level), tmp_path / "out")
    result = simulate(imported.station, duration=1.0, progress=False)
    np.testing.assert_allclose(result["q.A"], 1 - 0.7 * np.exp(-2 * result.times), atol=1e-3)
    world = imported.model.world
    (solid,) = (one for one in world.solids if one.node.path.startswith("Rod"))
    assert solid.pose.rotation().ToAngleAxis().angle() == pytest.approx(0.2)


def test_a_motion_that_is_given_heeds_no_limits(tmp_path):
    """Beside a passive joint it was refused in the run: the limits of such a joint push at nothing."""
    level = Level()
    limits = {
        "LowerLimitSpecify": "on",
        "LowerLimitBound": "0.1",
        "UpperLimitSpecify": "on",
        "UpperLimitBound": "0.2",
    }
    _, joints = hinges(level, {"MotionActuationMode": "InputMotion", **limits}, {})
    move, into = (
        level.block("Sin", "Move", Amplitude="0.5"),
        level.block(TO_PHYSICS, "In", Unit="rad"),
    )
    level.wire(f"{move}#out:1", f"{into}#in:1")
    level.connect(f"{into}#rconn:1", f"{joints[0]}#lconn:2")
    imported = import_simulink(write_model(tmp_path / "a.slx", level), tmp_path / "out")
    result = simulate(imported.station, duration=0.5, progress=False)
    np.testing.assert_allclose(result["q.A"], 0.5 * np.sin(result.times), atol=1e-4)
