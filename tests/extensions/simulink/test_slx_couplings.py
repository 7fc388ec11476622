"""Gears, screws, springs and rods of a model, and loops that any joint closes, against independent motions."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from slx_files import INERTIA, MECHANISM, REVOLUTE, TO_PHYSICS, TRANSFORM, WORLD, Level, write_model

from simrob_drake import load_station, simulate
from simrob_drake.base.errors import InvalidParameter
from simrob_drake.extensions.simulink.importing import import_simulink
from simrob_drake.extensions.simulink.mechanics import loops
from simrob_drake.extensions.simulink.mechanics.trees import body_motions, body_poses
from simrob_drake.extensions.simulink.simulink_model import read_simulink

GEARS = "sm_lib/Gears and\nCouplings/Gears/"
FORCES = "sm_lib/Forces and Torques/"
UP = {"RotationMethod": "StandardAxis", "RotationStandardAxis": "+X", "RotationAngle": "pi/2"}


class Shop(Level):
    """A world with gravity along -z, whose frames `stand` have their z along the world's -y."""

    def __init__(self):
        super().__init__()
        self.world = self.block(WORLD, "World")
        gravity = self.block(
            MECHANISM, "Gravity", GravityVector="[0 0 -9.81]", GravityVectorUnits="m/s^2"
        )
        self.connect(f"{self.world}#rconn:1", f"{gravity}#rconn:1")

    def placed(self, name, at="[0 0 0]", base=None, **turn):
        """Return a port of a frame at a place."""
        frame = self.block(
            TRANSFORM, name, TranslationMethod="Cartesian", TranslationCartesianOffset=at, **turn
        )
        self.connect(base or f"{self.world}#rconn:1", f"{frame}#lconn:1")
        return f"{frame}#rconn:1"

    def body(self, name, base, kind=REVOLUTE, *, mass="1", inertia="0.02", com="[0 0 0]", **joint):
        """Return a port of a body on a joint."""
        block = self.block(kind, name, **joint)
        weight = self.block(INERTIA, f"{name} body", Mass=mass, CenterOfMass=com,
                            MomentsOfInertia=f"[{inertia} {inertia} {inertia}]")  # fmt: skip
        self.connect(base, f"{block}#lconn:1")
        self.connect(f"{block}#rconn:1", f"{weight}#rconn:1")
        return f"{block}#rconn:1"

    def couple(self, kind, one, other, **figures):
        block = self.block(kind, "Coupling", **figures)
        self.connect(one, f"{block}#lconn:1")
        self.connect(other, f"{block}#rconn:1")
        return block


def ran(tmp_path, level, **options):
    imported = import_simulink(write_model(tmp_path / "a.slx", level, **options), tmp_path / "out")
    return imported, simulate(imported.station, progress=False)


def expected(times, rate, start):
    return solve_ivp(
        lambda _, state: rate(state), (0, times[-1]), start, rtol=1e-10, atol=1e-12, t_eval=times
    ).y


def test_a_geared_pair(tmp_path):
    """An arm falls and drives a wheel of half its radius the other way round."""
    shop = Shop()
    arm = shop.body("Arm", shop.placed("Stand", **UP), mass="2", inertia="0.05", com="[0.3 0 0]")
    wheel = shop.body("Wheel", shop.placed("Other", "[0.3 0 0]", **UP))
    shop.couple(f"{GEARS}Common Gear\nConstraint", arm, wheel, BaseGearRadius="20", BaseGearRadiusUnits="cm",
                FollGearRadius="0.1", FollGearRadiusUnits="m")  # fmt: skip
    imported, result = ran(tmp_path, shop)
    assert imported.fidelity == "mechanics complete"
    inertia = 0.05 + 2 * 0.09 + 4 * 0.02
    angle, _ = expected(
        result.times, lambda s: [s[1], -2 * 9.81 * 0.3 * np.cos(s[0]) / inertia], [0, 0]
    )
    assert angle[-1] < -1
    np.testing.assert_allclose(result["q.Arm"], angle, atol=1e-3)
    np.testing.assert_allclose(result["q.Wheel"], -2 * angle, atol=2e-3)


def test_a_rack_and_its_pinion(tmp_path):
    """A rack of 1 kg that falls turns a pinion of 0.1 m: a = g m / (m + I / r²)."""
    shop = Shop()
    pinion = shop.body("Pinion", shop.placed("Stand", **UP))
    rack = shop.body("Rack", shop.placed("Rail", "[0.1 0 0]"), "sm_lib/Joints/Prismatic Joint")
    shop.couple(f"{GEARS}Rack and Pinion\nConstraint", pinion, rack, PinionRadius="0.1")
    _, result = ran(tmp_path, shop)
    fall = -0.5 * 9.81 / (1 + 0.02 / 0.01) * result.times**2
    np.testing.assert_allclose(result["q.Rack"], fall, atol=1e-3)
    np.testing.assert_allclose(result["q.Pinion"], fall / 0.1, atol=0.05)  # about -y


def test_a_lead_screw(tmp_path):
    """A nut of 1 kg on a screw of 0.2 m a turn: its weight turns it."""
    shop = Shop()
    shop.body(
        "Screw",
        shop.placed("Stand"),
        "sm_lib/Joints/Lead Screw\nJoint",
        Lead="200",
        LeadUnits="mm/rev",
    )
    _, result = ran(tmp_path, shop)
    lead = 0.2 / (2 * np.pi)
    fall = -0.5 * 9.81 / (1 + 0.02 / lead**2) * result.times**2
    np.testing.assert_allclose(result["q.Screw_Pz"], fall, atol=1e-3 * abs(fall[-1]))
    np.testing.assert_allclose(result["q.Screw_Rz"], fall / lead, atol=1e-3 * abs(fall[-1]) / lead)


def test_a_lead_screw_in_a_loop_starts_whole_turns_away(tmp_path):
    """A screw of 10 mm a turn between a pin and a ball is 52 mm, more than five turns, out."""
    shop = Shop()
    foot = shop.body("Foot", shop.placed("Below", "[0.3 0 -0.5]", **UP))
    upright = {**UP, "RotationAngle": "-pi/2"}
    nut = shop.body("Nut", shop.placed("Thread", "[0 0.448 0]", foot, **upright), "sm_lib/Joints/Lead Screw\nJoint",
                    Lead="10", LeadUnits="mm/rev")  # fmt: skip
    pin = shop.block("sm_lib/Joints/Spherical Joint", "Pin")
    shop.connect(shop.placed("Tip", "[0.3 0 0]", **UP), f"{pin}#lconn:1")
    shop.connect(shop.placed("Head", "[0 0 0]", nut, **UP), f"{pin}#rconn:1")
    imported = import_simulink(write_model(tmp_path / "a.slx", shop), tmp_path / "out")
    assert imported.fidelity == "mechanics complete"
    result = simulate(imported.station, duration=0.01, progress=False)
    assert abs(result["q.Nut_Pz"][0]) == pytest.approx(0.052, abs=1e-4)
    assert abs(result["q.Nut_Rz"][0]) == pytest.approx(5.2 * 2 * np.pi, abs=0.1)


@pytest.mark.long
def test_a_loop_that_does_not_close_is_told_of_where_it_is_open(tmp_path):
    shop = Shop()
    base = shop.body("Base", shop.placed("Stand", **UP))
    for name, there in (("Held", "[0.3 0 0]"), ("Short", "[5 0 0]")):
        arm = shop.body(name, base)
        pin = shop.block(REVOLUTE, f"{name} pin")
        shop.connect(shop.placed(f"{name} tip", "[0.3 0 0]", arm), f"{pin}#lconn:1")
        shop.connect(shop.placed(f"{name} there", there, **UP), f"{pin}#rconn:1")
    lost = import_simulink(write_model(tmp_path / "a.slx", shop), tmp_path / "out").report.of(
        "lost"
    )
    assert [(one.element, one.text) for one in lost] == [
        (
            "Short pin",
            "closes a loop that does not close: 4.7e+03 mm (or mrad) are left; give starts",
        )
    ]


RATIOS = [  # kind, figures, pose of the follower's joint, how much base and follower count
    ("Common Gear\nConstraint", {"GearType": "Internal", "BaseGearRadius": "0.1", "FollGearRadius": "0.4"},
     {"at": "[0.3 0 0]"}, (0.1, -0.4)),
    ("Bevel Gear\nConstraint", {"BaseGearRadius": "0.1", "FollGearRadius": "0.2"},
     {"at": "[0.1 0 0.2]", "RotationMethod": "StandardAxis", "RotationStandardAxis": "+Y", "RotationAngle": "pi/2"},
     (0.1, 0.2)),
    ("Worm and Gear\nConstraint", {"WormRadius": "0.01", "GearRadius": "0.05", "WormLeadAngle": "atan(0.1)"},
     {"at": "[0.06 0 0]", **UP}, (0.001, 0.05)),
]  # fmt: skip


@pytest.mark.parametrize(("kind", "figures", "place", "counts"), RATIOS)
def test_ratios(tmp_path, kind, figures, place, counts):
    """What the base turns by one, the follower turns by minus the ratio of what they count, but for the worm's hand."""
    shop = Shop()
    base, follower = (
        shop.body("Base", shop.placed("Stand")),
        shop.body("Follower", shop.placed("Other", **place)),
    )
    shop.couple(f"{GEARS}{kind}", base, follower, **figures)
    (tree,) = read_simulink(write_model(tmp_path / "a.slx", shop)).trees
    (ratios,) = tree.gears.values()
    one, other = ratios.values()
    assert abs(one / other) == pytest.approx(abs(counts[0] / counts[1]), rel=1e-6)
    if "Worm" not in kind:
        assert one / other == pytest.approx(counts[0] / counts[1], rel=1e-6) or "Bevel" in kind


def test_a_planetary_gear_couples_three_joints(tmp_path):
    """A planet that rolls in a ring of 0.3 m, on a carrier, about a sun of 0.1 m."""
    shop = Shop()
    sun, carrier = (
        shop.body("Sun", shop.placed("Middle")),
        shop.body("Carrier", shop.placed("Centre")),
    )
    planet = shop.body("Planet", shop.placed("Pin", "[0.2 0 0]", carrier))
    shop.couple(
        f"{GEARS}Common Gear\nConstraint", sun, planet, BaseGearRadius="0.1", FollGearRadius="0.1"
    )
    (tree,) = read_simulink(write_model(tmp_path / "a.slx", shop)).trees
    (ratios,) = tree.gears.values()
    by_name = {freedom.name: ratio / 0.1 for freedom, ratio in ratios.items()}
    # all together about the middle: the planet stays on its pin
    turned = by_name["Sun"] * 1.0 + by_name["Carrier"] * 1.0
    assert turned == pytest.approx(0, abs=1e-6)
    assert by_name["Planet"] / by_name["Sun"] == pytest.approx(1.0)


def test_a_spring_between_two_bodies(tmp_path):
    shop = Shop()
    slide = "sm_lib/Joints/Prismatic Joint"
    low, high = (
        shop.body("Low", shop.placed("Down"), slide),
        shop.body("High", shop.placed("Above", "[0 0 1]"), slide),
    )
    shop.couple(f"{FORCES}Spring and\nDamper Force", low, high, NaturalLength="80", NaturalLengthUnits="cm",
                SpringStiffness="200", SpringStiffnessUnits="N/m", DampingCoefficient="3")  # fmt: skip
    imported, result = ran(tmp_path, shop)
    assert imported.fidelity == "mechanics complete"

    def rate(state):
        pull = 200 * (state[1] - state[0] + 0.2) + 3 * (state[3] - state[2])
        return [state[2], state[3], pull - 9.81, -pull - 9.81]

    low, high, *_ = expected(result.times, rate, [0.0] * 4)
    np.testing.assert_allclose(result["q.Low"], low, atol=1e-3)
    np.testing.assert_allclose(result["q.High"], high, atol=1e-3)


def crank(closing, **given):
    """A crank of 0.3 m, a rod of 1 m and a slider, which the joint between slider and rail closes."""
    shop = Shop()
    joint = {
        "VelocityTargetSpecify": "on",
        "VelocityTargetValue": "3",
        "VelocityTargetValueUnits": "rad/s",
    }
    before = shop.placed("Stand", **UP)
    for name, length in (("Crank", "0.3"), ("Rod", "1"), ("Pin", "0")):
        before = shop.body(name, before, **joint)
        before, joint = shop.placed(f"{name} end", f"[{length} 0 0]", before), {}
    along = {
        "RotationMethod": "StandardAxis",
        "RotationStandardAxis": "+Y",
        "RotationAngle": "pi/2",
    }
    rail, carriage = shop.placed("Rail", **along), shop.placed("Carriage", "[0 0 0]", shop.placed(
        "Back", "[0 0 0]", before, RotationMethod="StandardAxis", RotationStandardAxis="-X", RotationAngle="pi/2"),
        **along)  # fmt: skip
    slider = shop.block(closing, "Slider", **given)
    shop.connect(rail, f"{slider}#lconn:1")
    shop.connect(carriage, f"{slider}#rconn:1")
    return shop, slider


def test_a_slider_that_is_driven_closes_a_loop(tmp_path):
    """All hinges are sensed, so the loop is closed by halves of a body that are welded together."""
    shop, _ = crank("sm_lib/Joints/Prismatic Joint", DampingCoefficient="0.5")
    shop.blocks = [block.replace("<InstanceData>", '<InstanceData><P Name="DampingCoefficient">1e-9</P>')
                   if "Revolute" in block else block for block in shop.blocks]  # fmt: skip
    imported, result = ran(tmp_path, shop)
    assert any("two halves" in entry.text for entry in imported.report.of("read"))
    angle = result["q.Crank"]
    assert np.ptp(angle) > 1
    place = 0.3 * np.cos(angle) + np.sqrt(1 - (0.3 * np.sin(angle)) ** 2)
    np.testing.assert_allclose(result["q.Slider"], place, atol=1e-3)
    (robot,) = imported.files.robots.values()
    poses = body_poses(robot.tree, [result[f"q.{axis}"][-1] for axis in robot.axes.values()])
    assert max(np.abs(closing.gap(poses)).max() for closing in robot.tree.closings) < 5e-4


@pytest.mark.parametrize("kind", ["weld", "hinge", "ball", "rod"])
def test_gaps_change_with_positions_as_differences_say(tmp_path, kind):
    shop, _ = crank("sm_lib/Joints/Prismatic Joint", DampingCoefficient="0.5")
    (robot,) = import_simulink(
        write_model(tmp_path / "a.slx", shop), tmp_path / "out"
    ).files.robots.values()
    tree, positions = robot.tree, np.random.default_rng(0).uniform(-1, 1, len(robot.axes))
    closing = replace(tree.closings[0], kind=kind, length=0.3)
    ways = 1e-6 * np.eye(positions.size)
    opened = [
        [closing.gap(body_poses(tree, positions + sign * way)) for sign in (1, -1)] for way in ways
    ]
    slopes = closing.slopes(*body_motions(tree, positions))
    assert np.abs(slopes).max() > 0.1
    np.testing.assert_allclose(
        slopes, np.transpose([after - before for after, before in opened]) / 2e-6, atol=1e-7
    )


@pytest.mark.parametrize("start", ["0", "pi"])
def test_a_loop_of_many_joints_is_closed_near_where_it_starts(tmp_path, monkeypatch, start):
    """A hinge that is turned over is open, and moved a little it turns back: as of hundreds of joints."""
    monkeypatch.setattr(loops, "_MANY", 0)
    shop = Shop()
    arm = shop.body("Arm", shop.placed("Stand", **UP))
    ball = shop.body("Ball", shop.placed("Tip", "[0.3 0 0]", arm, RotationMethod="StandardAxis",
                     RotationStandardAxis="+X", RotationAngle=start), "sm_lib/Joints/Spherical Joint")  # fmt: skip
    hinge = shop.block(REVOLUTE, "Hinge")
    shop.connect(shop.placed("There", "[0.3 0 0]", **UP), f"{hinge}#lconn:1")
    shop.connect(shop.placed("Held", "[0 0 0]", ball), f"{hinge}#rconn:1")
    assert (
        import_simulink(write_model(tmp_path / "a.slx", shop), tmp_path / "out").fidelity
        == "mechanics complete"
    )


@pytest.mark.long
def test_a_rod_of_constant_length(tmp_path):
    shop = Shop()
    arm = shop.body("Arm", shop.placed("Stand", **UP), com="[0.3 0 0]")
    weight = shop.body("Weight", shop.placed("Rail", "[0.3 0 -1]"), "sm_lib/Joints/Prismatic Joint")
    shop.couple(
        "sm_lib/Constraints/Distance\nConstraint",
        shop.placed("Tip", "[0.3 0 0]", arm),
        weight,
        Distance="1",
    )
    imported, result = ran(tmp_path, shop)
    assert imported.fidelity == "mechanics complete"
    angle, height = result["q.Arm"], result["q.Weight"] - 1
    apart = np.hypot(0.3 * np.cos(angle) - 0.3, 0.3 * np.sin(angle) - height)
    assert np.ptp(angle) > 1
    np.testing.assert_allclose(apart, 1.0, atol=5e-4)


@pytest.mark.parametrize(
    ("kind", "about", "by"),
    [
        pytest.param("Parallel", "+Y", 0, marks=pytest.mark.long),
        ("Antiparallel", "+X", 180),
        pytest.param("Perpendicular", "+Y", 90, marks=pytest.mark.long),
        ("General", "+Y", 60),
    ],
)
def test_a_tray_that_an_angle_keeps_level(tmp_path, kind, about, by):
    """An arm falls with a tray on a ball at its end: kept level, that weighs there as a point, where its mass is."""
    shop = Shop()
    arm = shop.body("Arm", shop.placed("Stand", **UP), mass="2", inertia="0.05", com="[0.3 0 0]")
    end = shop.placed("End", "[0.6 0 0]", arm, **{**UP, "RotationAngle": "-pi/2"})
    tray = shop.body("Tray", end, "sm_lib/Joints/Spherical Joint", mass="1.5", com="[0 0 -0.2]",
                     PositionTargetSpecify="on")  # fmt: skip
    turn = {
        "RotationMethod": "StandardAxis",
        "RotationStandardAxis": about,
        "RotationAngle": f"{by}*pi/180",
    }
    shop.couple("sm_lib/Constraints/Angle\nConstraint", shop.placed("Level", **turn), tray, ConstraintType=kind,
                Angle="60", AngleUnits="deg")  # fmt: skip
    imported, result = ran(tmp_path, shop, stop="0.8")
    assert imported.fidelity == "mechanics complete"
    inertia, moment = 0.05 + 2 * 0.09 + 1.5 * 0.36, 9.81 * (2 * 0.3 + 1.5 * 0.6)
    angle, _ = expected(result.times, lambda s: [s[1], -moment * np.cos(s[0]) / inertia], [0, 0])
    assert angle[-1] < -2
    np.testing.assert_allclose(result["q.Tray_Ry"], angle, atol=1e-3 * abs(angle[-1]))


def test_a_force_between_two_bodies(tmp_path):
    """2 N push two sliders apart."""
    shop = Shop()
    slide = "sm_lib/Joints/Prismatic Joint"
    low, high = (
        shop.body("Low", shop.placed("Down"), slide),
        shop.body("High", shop.placed("Above", "[0 0 1]"), slide),
    )
    block = shop.couple(f"{FORCES}Internal Force", low, high)
    force = shop.block("fl_lib/Physical Signals/Sources/PS Constant", "Push", constant="2")
    shop.connect(f"{force}#rconn:1", f"{block}#lconn:2")
    imported, result = ran(tmp_path, shop)
    assert imported.fidelity == "mechanics complete"
    for name, force in (("Low", -2), ("High", 2)):
        np.testing.assert_allclose(
            result[f"q.{name}"], (force - 9.81) / 2 * result.times**2, atol=1e-3
        )


def test_six_degrees_of_freedom_on_springs(tmp_path):
    """A mass on a spring along z swings, pushed along x by a signal, held along y by a stop."""
    shop = Shop()
    given = {"PzSpringStiffness": "100", "PzDampingCoefficient": "1", "PzSensePosition": "on",
             "PxTorqueActuationMode": "InputTorque", "PyLowerLimitSpecify": "on", "PyLowerLimitBound": "0.01",
             "PyLowerLimitStiffness": "50"}  # fmt: skip
    shop.body("Body", shop.placed("Stand"), "sm_lib/Joints/6-DOF Joint", **given)
    joint = next(place + 1 for place, text in enumerate(shop.blocks) if 'Name="Body"' in text)
    force = shop.block("fl_lib/Physical Signals/Sources/PS Constant", "Push", constant="2")
    shop.connect(f"{force}#rconn:1", f"{joint}#lconn:2")
    imported, result = ran(tmp_path, shop)
    assert imported.fidelity == "mechanics complete"
    height, _ = expected(result.times, lambda s: [s[1], -100 * s[0] - s[1] - 9.81], [0, 0])
    aside, _ = expected(result.times, lambda s: [s[1], 50 * max(0.01 - s[0], 0)], [0, 0])
    x, y, z = (result[f"frame.Body.{axis}"] for axis in "xyz")
    np.testing.assert_allclose(z, height, atol=2e-3)
    np.testing.assert_allclose(x, result.times**2, atol=2e-3)
    np.testing.assert_allclose(y, aside, atol=2e-3)


def driven_crank(slope, spring="0"):
    """A crank whose angle is 1 + slope t moves the slider of its loop, whose other hinges have springs [N·m/deg]."""
    shop, _ = crank("sm_lib/Joints/Prismatic Joint")
    driven = '<P Name="MotionActuationMode">InputMotion</P><P Name="TorqueActuationMode">ComputedTorque</P>'
    sprung = f'<P Name="SpringStiffness">{spring}</P><P Name="SpringStiffnessUnits">N*m/deg</P>'
    for place, text in enumerate(shop.blocks):
        for name, more in (("Crank", driven), ("Rod", sprung), ("Pin", sprung)):
            if f'Name="{name}"' in text:
                shop.blocks[place] = text.replace("<InstanceData>", f"<InstanceData>{more}")
    joint = next(place for place, text in enumerate(shop.blocks, start=1) if 'Name="Crank"' in text)
    motion = shop.block("Ramp", "Motion", slope=slope, start="0", InitialOutput="1")
    into = shop.block(TO_PHYSICS, "In", Unit="rad")
    shop.wire(f"{motion}#out:1", f"{into}#in:1")
    shop.connect(f"{into}#rconn:1", f"{joint}#lconn:2")
    return shop


@pytest.mark.long
@pytest.mark.parametrize("slope", [2, 300])
def test_couplings_too_soft_for_what_they_hold_become_constraints(tmp_path, slope):
    """At 300 rad/s a pin of 0.3 m is held against 27 km/s²: springs of 2000 rad/s would open by some 7 mm."""
    imported, result = ran(tmp_path, driven_crank(str(slope)), stop="0.1" if slope == 300 else "1")
    told = any("couplings were too soft" in entry.text for entry in imported.report.entries)
    assert told == (load_station(imported.station).solver.kind == "discrete") == (slope == 300)
    angle = result["q.Crank"]
    np.testing.assert_allclose(angle, 1 + slope * result.times, atol=1e-3 * slope)
    exact = 0.3 * np.cos(angle) + np.sqrt(1 - (0.3 * np.sin(angle)) ** 2)
    np.testing.assert_allclose(result["q.Slider"], exact, atol=2e-3)


@pytest.mark.long
def test_couplings_that_short_steps_do_not_hold_get_shorter_ones(tmp_path):
    """At 3000 rad/s a crank turns by 0.3 rad within 0.1 ms; by steps of a tenth the slider stays within 20 mm."""
    station = import_simulink(
        write_model(tmp_path / "a.slx", driven_crank("3000")), tmp_path / "out"
    ).station
    far = []
    for override in ({"solver.time_step": 1e-4}, {}):
        result = simulate(load_station(station, override), duration=0.01, progress=False)
        angle = result["q.Crank"]
        exact = 0.3 * np.cos(angle) + np.sqrt(1 - (0.3 * np.sin(angle)) ** 2)
        far.append(np.abs(result["q.Slider"] - exact).max())
    assert far[1] < 0.02
    assert far[0] > 4 * far[1]


@pytest.mark.long
def test_a_loop_that_comes_apart_is_lost(tmp_path):
    """A crank longer than its rod is driven past where that can reach."""
    shop = driven_crank("10")
    shop.blocks = [one.replace("0.3", "1.2").replace(">1<", ">0.5<") if "Motion" in one or "0.3" in one else one
                   for one in shop.blocks]  # fmt: skip
    imported = import_simulink(write_model(tmp_path / "a.slx", shop), tmp_path / "out")
    assert imported.fidelity == "1 closed loop lost; 1 joint prescribed"


@pytest.mark.parametrize("spring", ["0", "2500"])
def test_a_crank_that_is_driven_starts_on_its_motion(tmp_path, spring):
    """A crank whose angle is 1 + 2 t moves the slider of its loop, which starts where and as fast as that asks for.

    Stiff springs in its hinges change what that takes, and do not tear the loop, which is a constraint then; by the
    solver of other loops the slider would be 8 mm off.
    """
    imported, result = ran(
        tmp_path, driven_crank("2", spring), stop="0.5" if spring == "2500" else "1"
    )
    assert imported.fidelity == "mechanics complete; 1 joint prescribed"
    # a spring is not asked to be at rest
    assert not any("asked" in warning for warning in result.warnings)
    angle = 1 + 2 * result.times
    np.testing.assert_allclose(result["q.Crank"], angle, atol=2e-3)
    assert result["v.Crank"][0] == pytest.approx(2, rel=1e-3)
    reach = np.sqrt(1 - (0.3 * np.sin(angle)) ** 2)
    np.testing.assert_allclose(result["q.Slider"], 0.3 * np.cos(angle) + reach, atol=2e-3)
    assert result["v.Slider"][0] == pytest.approx(
        -0.6 * np.sin(1) * (1 + 0.3 * np.cos(1) / reach[0]), rel=1e-2
    )


def test_a_floating_robot_whose_joints_are_moved_falls(tmp_path):
    """It is no held puppet: it falls by its weight, and its joint goes along its motion."""
    shop = Shop()
    body = shop.body(
        "Body", shop.placed("Stand"), "sm_lib/Joints/6-DOF Joint", mass="5", inertia="0.5"
    )
    motion = {"MotionActuationMode": "InputMotion", "TorqueActuationMode": "ComputedTorque"}
    arm = shop.body("Arm", shop.placed("Shoulder", "[0 0 0.2]", body), **motion)
    wanted, into = (
        shop.block("Sin", "Wave", Amplitude="0.3", Frequency="4"),
        shop.block(TO_PHYSICS, "In", Unit="rad"),
    )
    shop.wire(f"{wanted}#out:1", f"{into}#in:1")
    joint = next(place + 1 for place, text in enumerate(shop.blocks) if 'Name="Arm"' in text)
    shop.connect(f"{into}#rconn:1", f"{joint}#lconn:2")
    assert arm
    imported, result = ran(tmp_path, shop)
    assert imported.fidelity == "mechanics complete; 1 joint prescribed"
    np.testing.assert_allclose(result["q.Arm"], 0.3 * np.sin(4 * result.times), atol=2e-3)
    np.testing.assert_allclose(
        result["base.z"] - result["base.z"][0], -9.81 / 2 * result.times**2, atol=5e-3
    )


def test_a_spherical_pendulum_starts_at_the_speed_that_it_is_asked_for(tmp_path):
    """A point of 2 kg hangs 0.5 m from a ball joint that is turned by 30° about y, and swings aside at 2 rad/s."""
    shop = Shop()
    given = {"PositionTargetSpecify": "on", "PositionTargetRotationMethod": "StandardAxis",
             "PositionTargetRotationStandardAxis": "+Y", "PositionTargetRotationAngle": "30",
             "PositionTargetRotationAngleUnits": "deg", "VelocityTargetSpecify": "on",
             "VelocityTargetValue": "[2 0 0]", "VelocityTargetInFollowerFrame": "off"}  # fmt: skip
    body = shop.body("Ball", shop.placed("Stand"), "sm_lib/Joints/Spherical Joint", mass="2", inertia="1e-4",
                     com="[0 0 -0.5]", **given)  # fmt: skip
    tip = shop.block("sm_lib/Frames and Transforms/Reference Frame", "Tip")
    shop.connect(shop.placed("End", "[0 0 -0.5]", body), f"{tip}#rconn:1")
    imported, result = ran(tmp_path, shop)
    assert imported.fidelity == "mechanics complete"
    place = 0.5 * np.array([-np.sin(np.pi / 6), 0.0, -np.cos(np.pi / 6)])

    def rate(state):
        p, v = state[:3], state[3:]
        free = np.array([0.0, 0.0, -9.81])
        return np.concatenate([v, free - (free @ p + v @ v) / (p @ p) * p])

    path = expected(result.times, rate, np.concatenate([place, np.cross([2.0, 0, 0], place)]))[:3]
    found = np.array([result[f"tcp.{axis}"] for axis in "xyz"])
    np.testing.assert_allclose(found, path, atol=2e-3)


@pytest.mark.long
@pytest.mark.parametrize("held", [True, False])
def test_a_ball_joint_springs_back_by_its_angle_and_is_damped_in_all_directions(tmp_path, held):
    """A body of 1.5 kg, 60° aside about an oblique axis; by Euler's equations of its quaternion."""
    from scipy.spatial.transform import Rotation

    shop, spring, damping = Shop(), 8.0 * held, 0.1
    given = {"PositionTargetSpecify": "on", "PositionTargetRotationMethod": "ArbitraryAxis",
             "PositionTargetRotationArbitraryAxis": "[1 2 -1]", "PositionTargetRotationAngle": "pi/3",
             "SpringStiffness": str(spring), "DampingCoefficient": str(damping)}  # fmt: skip
    shop.body("Ball", shop.placed("Stand"), "sm_lib/Joints/Spherical Joint", mass="1.5", inertia="0.05",
              com="[0.1 0 -0.2]", **given)  # fmt: skip
    imported, result = ran(tmp_path, shop)
    assert imported.fidelity == "mechanics complete"
    arm = np.array([0.1, 0.0, -0.2])
    inertia = 0.05 * np.eye(3) + 1.5 * (arm @ arm * np.eye(3) - np.outer(arm, arm))

    def rate(state):
        turn, speed = Rotation.from_quat(state[:4]), state[4:]
        moment = (
            np.cross(arm, turn.inv().apply([0, 0, -1.5 * 9.81]))
            - spring * turn.as_rotvec()
            - damping * speed
        )
        x, y, z, w = state[:4]
        moving = 0.5 * np.array([[w, -z, y], [z, w, -x], [-y, x, w], [-x, -y, -z]]) @ speed
        return np.concatenate(
            [moving, np.linalg.solve(inertia, moment - np.cross(speed, inertia @ speed))]
        )

    axis = np.array([1, 2, -1]) / np.sqrt(6)
    begun = np.concatenate([Rotation.from_rotvec(np.pi / 3 * axis).as_quat(), np.zeros(3)])
    path = Rotation.from_quat(expected(result.times, rate, begun)[:4].T)
    found = Rotation.from_euler(
        "XYZ", np.column_stack([result[f"q.Ball_R{axis}"] for axis in "xyz"])
    )
    assert (path[0].inv() * path).magnitude().max() > 0.8
    assert (path.inv() * found).magnitude().max() < 2e-3


CONTACT = "sm_lib/Forces and\nTorques/Spatial\nContact Force"


def table_on_points(many, stiffness="1e4", points=""):
    """A mass of 4 kg on the corners of a square, each as many springs [N/m]."""
    shop = Shop()
    free = shop.block(
        "sm_lib/Joints/6-DOF Joint",
        "Free",
        PzPositionTargetSpecify="on",
        PzPositionTargetValue="0.5",
    )
    weight = shop.block(INERTIA, "Table", Mass="4", MomentsOfInertia="[0.1 0.1 0.1]")
    corners = "[0.2 0.2 -0.5; -0.2 0.2 -0.5; 0.2 -0.2 -0.5; -0.2 -0.2 -0.5]"
    cloud = shop.block(
        "sm_lib/Curves and Surfaces/Point Cloud",
        "Legs",
        CoordinatesMatrix=points or f"repmat({corners}, {many}, 1)",
    )
    plane = shop.block("sm_lib/Curves and Surfaces/Infinite Plane", "Floor")
    touch = shop.block(CONTACT, "Touch", NormalStiffness=stiffness, NormalDamping="100")
    shop.connect(f"{shop.world}#rconn:1", f"{free}#lconn:1", f"{plane}#lconn:1")
    shop.connect(f"{free}#rconn:1", f"{weight}#rconn:1", f"{cloud}#lconn:1")
    shop.connect(f"{cloud}#rconn:1", f"{touch}#lconn:1")
    shop.connect(f"{plane}#rconn:1", f"{touch}#rconn:1")
    return shop


@pytest.mark.parametrize(
    ("points", "why"),
    [("[]", "empty"), ("[1 2]", "reshape"), ("ones(3)*{1}", "CoordinatesMatrix = ones(3)*{1}")],
)
def test_a_cloud_that_cannot_be_read_loses_its_contact_alone(tmp_path, points, why):
    imported = import_simulink(
        write_model(tmp_path / "a.slx", table_on_points(1, points=points)), tmp_path / "out"
    )
    (entry,) = (entry for entry in imported.report.of("lost") if entry.element == "Touch")
    assert "its point cloud is not read" in entry.text
    assert why in entry.text


@pytest.mark.parametrize("shop", [driven_crank("2"), driven_crank("2", "2500"), table_on_points(1)])
def test_a_station_that_does_not_run_is_told(tmp_path, monkeypatch, shop):
    def off(*_, **__):
        raise InvalidParameter("couplings.Pin", "0.01 m off at the start", "at most 0.001 m off")

    file = write_model(tmp_path / "a.slx", shop)
    monkeypatch.setattr("simrob_drake.extensions.simulink.importing.simulate", off)
    (entry,) = import_simulink(file, tmp_path / "out").report.of("lost")
    assert "does not run as it is: couplings.Pin is 0.01 m off at the start" in entry.text


@pytest.mark.parametrize("ending", ["diverged", "interrupted"])
def test_a_trial_that_diverges_is_told_and_ctrl_c_ends_the_import(tmp_path, monkeypatch, ending):
    real = simulate

    def ends_so(*arguments, **options):
        return replace(real(*arguments, **options), ending=ending, message="diverged at 0.1 s")

    file = write_model(tmp_path / "a.slx", driven_crank("2"))
    monkeypatch.setattr("simrob_drake.extensions.simulink.importing.simulate", ends_so)
    if ending == "interrupted":  # before the steps that a trial may take
        with pytest.raises(KeyboardInterrupt):
            import_simulink(file, tmp_path / "out")
        assert not (tmp_path / "out").exists()
        return
    (entry,) = import_simulink(file, tmp_path / "out").report.of("lost")
    assert entry.text == "the station does not run as it is: diverged at 0.1 s"


@pytest.mark.parametrize("many", [1, 60])
def test_a_table_on_a_cloud_of_points(tmp_path, many):
    """A mass of 4 kg stands on its corners; of many at one place one holds for all."""
    imported, result = ran(tmp_path, table_on_points(many))
    assert imported.fidelity == "mechanics complete"
    (piece,) = (name for name in imported.files.free.values())
    height = result.piece_pose(piece)[-1, 2]
    assert height == pytest.approx(0.5 + 1e-3 - 9.81 / 1e4 / many, abs=1e-4)
