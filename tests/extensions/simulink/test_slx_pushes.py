"""Forces and torques that a model's signals apply to bodies, against the equations of motion."""

import numpy as np
import pytest
import yaml
from scipy.integrate import solve_ivp
from slx_files import (
    BRICK,
    FROM_PHYSICS,
    INERTIA,
    MECHANISM,
    TO_PHYSICS,
    TRANSFORM,
    WORLD,
    Level,
    write_model,
)

from simrob_drake import load_station, simulate
from simrob_drake.extensions.simulink.importing import import_simulink

PUSH = "sm_lib/Forces and\nTorques/External Force\nand Torque"
CONTACT = "sm_lib/Forces and Torques/Spatial Contact Force"
FREE = "sm_lib/Joints/6-DOF Joint"
SENSOR = "sm_lib/Frames and Transforms/Transform Sensor"


class Body(Level):
    """A body that nothing holds; what senses it and what pushes it is added."""

    def __init__(self, kind=BRICK, *, gravity="[0 0 0]", at="[0 0 0]", turn="0", **figures):
        super().__init__()
        self.world, put = self.block(WORLD, "World"), self.transform("Put", at, turn)
        joint, self.body = self.block(FREE, "Free"), self.block(kind, "Body", **figures)
        self.connect(
            f"{self.world}#rconn:1",
            f"{self.block(MECHANISM, 'G', GravityVector=gravity)}#rconn:1",
            f"{put}#lconn:1",
        )
        self.connect(f"{put}#rconn:1", f"{joint}#lconn:1")
        self.connect(f"{joint}#rconn:1", f"{self.body}#rconn:1")
        self.frame = f"{joint}#rconn:1"

    def transform(self, name, place, turn="0"):
        return self.block(
            TRANSFORM, name, TranslationMethod="Cartesian", TranslationCartesianOffset=place,
            RotationMethod="StandardAxis", RotationStandardAxis="+X", RotationAngle=turn, RotationAngleUnits="deg",
        )  # fmt: skip

    def chain(self, kind, name, *sources, **parameters):
        sid = self.block(kind, name, **parameters)
        for number, source in enumerate(sources):
            self.wire(source, f"{sid}#in:{number + 1}")
        return f"{sid}#out:1"

    def sense(self, *signals):
        """Return what a sensor from the world to the body measures."""
        sensor = self.block(
            SENSOR, "Sensor", MeasurementFrame="World", **{f"Sense{name}": "on" for name in signals}
        )
        self.connect(f"{self.world}#rconn:1", f"{sensor}#lconn:1")
        self.connect(self.frame, f"{sensor}#rconn:1")
        outputs = []
        for number, name in enumerate(signals):
            out = self.block(FROM_PHYSICS, name, Unit="inherit")
            self.connect(f"{sensor}#rconn:{number + 2}", f"{out}#lconn:1")
            outputs.append(f"{out}#out:1")
        return outputs

    def push(self, frame, *signals, name="Push", **parameters):
        push = self.block(PUSH, name, **parameters)
        self.connect(frame, f"{push}#rconn:1")
        for number, signal in enumerate(signals, start=1):
            into = self.block(TO_PHYSICS, f"{name} {number}", Unit="1")
            self.wire(signal, f"{into}#in:1")
            self.connect(f"{into}#rconn:1", f"{push}#lconn:{number}")

    def imported(self, tmp_path, stop):
        return import_simulink(write_model(tmp_path / "a.slx", self, stop=stop), tmp_path / "out")


@pytest.mark.long
def test_a_ball_bounces_by_the_forces_that_the_model_computes(tmp_path):
    """A spring and a damper below z = 0, along the axes of the world, on a body that lies on its side."""
    mass, stiffness, damping = 2.0, 4e3, 12.0
    body = Body(
        INERTIA,
        Mass=mass,
        MomentsOfInertia="[1 1 1]",
        gravity="[0 0 -9.81]",
        at="[0 0 0.2]",
        turn="90",
    )
    z, speed = body.sense("Z", "ZDot")
    depth = body.chain("Gain", "Depth", z, Gain="-1")
    spring = body.chain("Gain", "k", depth, Gain=str(stiffness))
    damper = body.chain("Gain", "b", speed, Gain=str(damping))
    both = body.chain("Sum", "Both", spring, damper, Inputs="+-")
    touching = body.chain(
        "Switch", "Touching", both, depth, body.chain("Constant", "None", Value="0"), Criteria="u2 > Threshold",
        Threshold="0",
    )  # fmt: skip
    body.push(body.frame, touching, EnableForceZ="on", ForceResolutionFrame="World")
    imported = body.imported(tmp_path, "1.6")
    assert imported.fidelity == "mechanics complete"
    result = simulate(imported.station, progress=False)

    def motion(t, y):
        force = -stiffness * y[0] - damping * y[1] if y[0] < 0 else 0.0
        return y[1], force / mass - 9.81

    exact = solve_ivp(
        motion, (0, 1.6), [0.2, 0], rtol=1e-9, atol=1e-10, max_step=1e-3, t_eval=result.times
    )
    height = result.piece_pose("Body")[:, 2]
    for begin, end in ((0.25, 0.6), (0.6, 0.95), (0.95, 1.25)):  # the first three rebounds
        during = (begin < result.times) & (result.times < end)
        assert height[during].max() == pytest.approx(exact.y[0][during].max(), rel=0.01)
    assert 0.02 < height[(result.times > 0.3) & (result.times < 0.6)].max() < 0.15
    assert np.abs(result["applied_force.Push.y"]).max() > 100  # its own y is the world's z


@pytest.mark.long
def test_a_contact_that_blocks_draw_is_merged_and_split_by_its_parts(tmp_path):
    """A ball bounces where an If lets one of two subsystems act; ports that no parameter counts are counted."""
    mass, stiffness, damping = 2.0, 4e3, 12.0
    body = Body(
        INERTIA, Mass=mass, MomentsOfInertia="[1 1 1]", gravity="[0 0 -9.81]", at="[0 0 0.2]"
    )
    sensed = body.sense("Z", "ZDot")
    contact, none = Level(first=100), Level(first=200)
    depth, speed = (
        contact.block("Inport", name, Port=str(place)) for place, name in enumerate(("z", "vz"), 1)
    )
    pressed = contact.block("Sum", "Fz", Inputs="--")
    for place, (source, gain) in enumerate(((depth, stiffness), (speed, damping)), start=1):
        factor = contact.block("Gain", f"k{place}", Gain=str(gain))
        contact.wire(f"{source}#out:1", f"{factor}#in:1")
        contact.wire(f"{factor}#out:1", f"{pressed}#in:{place}")
    zero, torque = (
        contact.block("Constant", "0", Value="0"),
        contact.block("Constant", "T", Value="[0 0 0.5]"),
    )
    mux = contact.block("Mux", "Mux", ports='<PortCounts in="4" out="1"/>')
    for place, part in enumerate((zero, zero, pressed, torque), start=1):
        contact.wire(f"{part}#out:1", f"{mux}#in:{place}")
    nothing = none.block("Constant", "Zeros", Value="zeros(1, 6)")
    for level, source in ((contact, mux), (none, nothing)):
        level.block("ActionPort", "Action")
        level.wire(f"{source}#out:1", f"{level.block('Outport', 'F')}#in:1")
    test = body.block("If", "If", IfExpression="u1 < 0", NumInputs="1")
    body.wire(sensed[0], f"{test}#in:1")
    ways = [
        body.block("SubSystem", name, inner=level.xml())
        for name, level in (("Forces", contact), ("No", none))
    ]
    for place, way in enumerate(ways, start=1):
        body.wire(f"{test}#out:{place}", f"{way}#ifaction")
        body.wire(sensed[place - 1], f"{ways[0]}#in:{place}")
    merged = body.chain("Merge", "Merge", *(f"{way}#out:1" for way in ways))
    split = body.block("Demux", "Demux", ports='<PortCounts in="1" out="4"/>')
    body.wire(merged, f"{split}#in:1")
    axes = {f"EnableForce{axis}": "on" for axis in "XYZ"}
    outputs = [f"{split}#out:{place}" for place in range(1, 5)]
    body.push(body.frame, *outputs, **axes, EnableTorque="on", ForceResolutionFrame="World")
    made = body.imported(tmp_path, stop="0.6")
    assert made.fidelity == "mechanics complete"
    assert yaml.safe_load(made.station.read_text())["solver"]["kind"] == "discrete"  # for it jumps
    result = simulate(made.station, progress=False)

    def motion(t, y):
        return (
            y[1],
            -9.81 - (stiffness * y[0] + damping * y[1]) / mass * (y[0] < 0),
            0.5 * (y[0] < 0),
        )

    exact = solve_ivp(
        motion, (0, 0.6), [0.2, 0.0, 0.0], rtol=1e-9, atol=1e-9, max_step=1e-3, t_eval=result.times
    )
    np.testing.assert_allclose(result["frame.Sensor.z"], exact.y[0], atol=2e-3)
    np.testing.assert_allclose(result["frame.Sensor.wz"], exact.y[2], atol=2e-3)


def test_a_force_off_the_centre_turns_a_body_that_carries_its_axes_along(tmp_path):
    body = Body(BRICK, BrickDimensions="[0.3 0.3 0.1]", BasedOnType="Mass", Mass="3")
    edge = body.transform("Edge", "[0 0.1 0]", "90")
    body.connect(body.frame, f"{edge}#lconn:1")
    size = body.chain("Step", "Size", Time="0.25", After="6")
    body.push(f"{edge}#rconn:1", size, body.chain("Constant", "Twist", Value="0.05"), EnableForceX="on",
              EnableTorqueY="on")  # fmt: skip
    imported = body.imported(tmp_path, "1")
    result = simulate(imported.station, progress=False)
    inertia = 3 * (0.3**2 + 0.3**2) / 12

    def motion(t, y):
        force = 6.0 * (t >= 0.25)
        return (
            *y[3:],
            force * np.cos(y[2]) / 3,
            force * np.sin(y[2]) / 3,
            (0.05 - 0.1 * force) / inertia,
        )

    exact = solve_ivp(
        motion, (0, 1), np.zeros(6), rtol=1e-9, atol=1e-9, max_step=1e-3, t_eval=result.times
    )
    np.testing.assert_allclose(result.piece_pose("Body")[:, :2].T, exact.y[:2], atol=2e-4)
    assert abs(exact.y[2][-1]) > 1


def test_a_force_on_the_world_moves_nothing_and_one_from_an_input_is_a_port(tmp_path):
    body = Body(INERTIA, Mass="1", MomentsOfInertia="[1 1 1]")
    one = body.chain("Constant", "One", Value="1")
    body.push(f"{body.world}#rconn:1", one, name="Fixed", EnableForceX="on")
    body.push(
        body.frame,
        one,
        body.chain("Constant", "Vector", Value="[0 2 0]"),
        EnableForceX="on",
        EnableForce="on",
    )
    imported = body.imported(tmp_path, "0.5")
    assert [entry.text for entry in imported.report.of("dropped") if entry.element == "Fixed"]
    (section,) = yaml.safe_load(imported.station.read_text())["controllers"]["law"][
        "forces"
    ].values()
    assert (section["at"], section["force"]) == ("Body", [{"one": 1.0}, {"one": 2.0}, {}])
    np.testing.assert_allclose(
        simulate(imported.station, progress=False).piece_pose("Body")[-1, :3],
        [0.125, 0.25, 0],
        atol=1e-6,
    )


def test_a_force_of_too_many_elements_is_lost_and_told(tmp_path):
    body = Body(INERTIA, Mass="1", MomentsOfInertia="[1 1 1]")
    body.push(body.frame, body.chain("Constant", "Nine", Value="ones(9, 1)"), EnableForce="on")
    imported = body.imported(tmp_path, "0.5")
    assert ["has 9 elements, not 3" in entry.text for entry in imported.report.of("lost")] == [True]


def on_a_plane(tmp_path, *, friction, height, speed="0"):
    """Return a ball of 2 kg and 0.1 m radius above a plane, by Simscape's law."""
    level = Body("sm_lib/Body Elements/Spherical Solid", gravity="[0 0 -9.81]", at=f"[0 0 {height}]", turn="90",
                 SphereRadius="0.1", InertiaType="CalculateFromGeometry", BasedOnType="Mass", Mass="2",
                 ExportEntireGeometry="on")  # fmt: skip
    plane = level.block("sm_lib/Curves and Surfaces/Infinite Plane", "Plane")
    figures = {"NormalStiffness": "4e3", "NormalDamping": "12", "NormalTransitionRegionWidth": "5e-3",
               "CoefficientOfStaticFriction": "0.5", "CoefficientOfDynamicFriction": "0.3",
               "FrictionalCriticalVelocity": "1e-2"}  # fmt: skip
    contact = level.block(CONTACT, "Contact", FrictionType=friction, **figures)
    level.connect(f"{level.world}#rconn:1", f"{plane}#lconn:1")
    level.connect(f"{plane}#rconn:1", f"{contact}#lconn:1")
    level.connect(f"{level.body}#lconn:1", f"{contact}#rconn:1")
    given = f'<P Name="PxVelocityTargetSpecify">on</P><P Name="PxVelocityTargetValue">{speed}</P></InstanceData>'
    level.blocks = [
        block.replace("</InstanceData>", given) if 'Name="Free"' in block else block
        for block in level.blocks
    ]
    file = write_model(tmp_path / "a.slx", level, stop="1.6")
    return import_simulink(file, tmp_path / "out", contact_law=True)


def test_a_ball_bounces_by_the_law_of_simscape(tmp_path):
    """The first three rebounds are within 1 % of those of its equation."""
    imported = on_a_plane(tmp_path, friction="None", height=0.3)
    assert "contact" not in imported.files.content
    result = simulate(load_station(imported.station), progress=False)

    def motion(_, state):
        depth = 0.1 - state[0]
        share = np.clip(depth / 5e-3, 0.0, 1.0)
        force = max(0.0, share**2 * (3 - 2 * share) * (4e3 * depth - 12 * state[1]))
        return state[1], force / 2.0 - 9.81

    exact = solve_ivp(
        motion, (0, 1.6), [0.3, 0], rtol=1e-9, atol=1e-10, max_step=1e-3, t_eval=result.times
    )
    height = result.piece_pose("Body")[:, 2]
    for begin, end in ((0.25, 0.6), (0.6, 0.95), (0.95, 1.25)):
        during = (begin < result.times) & (result.times < end)
        assert height[during].max() - 0.1 == pytest.approx(exact.y[0][during].max() - 0.1, rel=0.01)


def test_a_ball_that_slides_begins_to_roll_by_the_law_of_simscape(tmp_path):
    """Friction brakes it by 0.3 g, until it rolls at 5/7 of its speed."""
    imported = on_a_plane(tmp_path, friction="SmoothStickSlip", height=0.0951, speed="1")
    result = simulate(load_station(imported.station), duration=0.3, progress=False)
    place = result.piece_pose("Body")[:, 0]
    early, late = result.times < 0.08, result.times > 0.15
    np.testing.assert_allclose(
        place[early], (result.times - 0.15 * 9.81 * result.times**2)[early], atol=2e-4
    )
    np.testing.assert_allclose(np.gradient(place, result.times)[late][1:-1], 5 / 7, rtol=0.01)
