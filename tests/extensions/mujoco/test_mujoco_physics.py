"""What moves in MuJoCo moves as mechanics says: against closed forms, conserved quantities, and Drake."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import ellipk

from simrob_drake import load_station, simulate
from simrob_drake.base.constants import STANDARD_GRAVITY
from simrob_drake.base.errors import VerdictError
from simrob_drake.extensions.mujoco.runner import MujocoRunner, RunRequest
from simrob_drake.results.result import SimulationResult
from simrob_drake.stations.config import StationConfig

STEP = 1e-3


def ran(
    station: str,
    overrides: dict[str, object],
    *,
    step: float = STEP,
    integrator: str = "implicitfast",
    **how,
):
    return MujocoRunner(load_station(station, overrides), step=step, integrator=integrator).run(
        **how
    )


def test_free_fall() -> None:
    """A step changes the velocity first, so the fall is g h t / 2 ahead of g t² / 2, and no more."""
    result = ran("bouncing_ball", {"pieces.ball.pose": [0, 0, 10, 0, 0, 0], "duration": 1.0})
    times = result.times
    fallen = 10 - result["piece.ball.z"]
    np.testing.assert_allclose(fallen, STANDARD_GRAVITY * times * (times + STEP) / 2, atol=1e-9)
    np.testing.assert_allclose(result["piece.ball.vz"], -STANDARD_GRAVITY * times, atol=1e-9)


def test_a_push_gives_its_whole_impulse_whatever_the_steps() -> None:
    push = {"push": {"at": "ball", "start": 0.0103, "duration": 0.0219, "force": [3.0, 0.0, -1.0]}}
    overrides = {
        "forces": push,
        "gravity": 0.0,
        "duration": 0.1,
        "pieces.ball.pose": [0, 0, 5, 0, 0, 0],
    }
    result = ran("bouncing_ball", overrides, step=4e-3)
    speed = np.array([3.0, 0.0, -1.0]) * 0.0219 / 0.9048
    np.testing.assert_allclose(result.piece_velocity("ball")[-1, :3], speed, atol=1e-5)


PENDULUM = """<robot name="pendulum"><link name="base"/>
<link name="bob"><inertial><origin xyz="0 0 -0.5"/><mass value="1"/>
<inertia ixx="1e-9" iyy="1e-9" izz="1e-9" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="hinge" type="revolute"><parent link="base"/><child link="bob"/><axis xyz="0 1 0"/>
<limit lower="-3" upper="3" effort="100" velocity="100"/></joint>
<transmission name="t" type="transmission_interface/SimpleTransmission"><joint name="hinge"/>
<actuator name="a"/></transmission></robot>"""


def test_the_period_of_a_pendulum_is_its_elliptic_integral(tmp_path) -> None:
    (tmp_path / "pendulum.urdf").write_text(PENDULUM)
    start = 1.2
    (tmp_path / "station.yaml").write_text(
        f"robot: {{urdf: pendulum.urdf, initial_deg: {np.rad2deg(start)}}}\n"
        "servo: {kp: 0, kd: 0}\nduration: 4\nsample_rate: 1000\n"
    )
    result = MujocoRunner(tmp_path / "station.yaml", step=5e-4, integrator="RK4").run()
    angle, period = (
        result["q.hinge"],
        4 * np.sqrt(0.5 / STANDARD_GRAVITY) * ellipk(np.sin(start / 2) ** 2),
    )
    crossings = np.flatnonzero((angle[:-1] > 0) & (angle[1:] <= 0))
    parts = angle[crossings] / (angle[crossings] - angle[crossings + 1])
    measured = np.diff(result.times[crossings] + parts * 1e-3).mean()
    # of straight lines between samples 1 ms apart
    assert measured == pytest.approx(period, rel=1e-5)


def test_energy_of_a_double_pendulum_is_kept() -> None:
    """Free joints without friction: RK4 at 0.5 ms loses a millionth of what goes to and fro."""
    loose = {"servo.kp": 0, "servo.kd": 0, "robot.drives": {"damping": 0}, "duration": 3.0}
    result = ran("double_pendulum", loose, step=5e-4, integrator="RK4")
    plant = result.plant.plant
    context = plant.CreateDefaultContext()
    (robot,) = result.plant.robots.values()
    kinetic, potential = [], []
    for q, v in zip(result.axes("q"), result.axes("v"), strict=True):
        robot.axis_map.set_positions(plant, context, q)
        plant.SetVelocities(context, robot.axis_map.spread_velocities(v))
        kinetic.append(plant.CalcKineticEnergy(context))
        potential.append(plant.CalcPotentialEnergy(context))
    assert max(kinetic) > 0.01
    np.testing.assert_allclose(np.add(kinetic, potential), potential[0], atol=1e-6 * max(kinetic))


def test_momentum_in_flight_is_that_of_its_weight() -> None:
    """A humanoid that moves its arms in the air: linear momentum m g t, and none about its centre of mass."""
    reference = {"kind": "move", "target_deg": {"left_shoulder_pitch": 60.0}, "duration": 0.4}
    overrides = {"robot.base": [0, 0, 5.0, 0, 0, 0], "reference": reference, "duration": 0.4}
    result = ran("roid1_dynamic", overrides, step=2e-4)
    assert abs(result["q.left_shoulder_pitch"][-1]) > 0.9
    plant = result.plant.plant
    context = plant.CreateDefaultContext()
    q, v = result.final_state.of_plant(result.plant)
    plant.SetPositions(context, q)
    plant.SetVelocities(context, v)
    centre = plant.CalcCenterOfMassPositionInWorld(context)
    momentum = plant.CalcSpatialMomentumInWorldAboutPoint(context, centre)
    weight = plant.CalcTotalMass(context) * STANDARD_GRAVITY
    np.testing.assert_allclose(momentum.translational(), [0, 0, -0.4 * weight], atol=2e-4 * weight)
    # about what the arm alone has: 0.1 kg at 0.14 m, by 60 deg in 0.4 s
    arm = 0.1 * np.pi / 3 / 0.4 * 0.02
    np.testing.assert_allclose(momentum.rotational(), 0, atol=0.01 * arm)


@pytest.fixture(scope="module")
def box() -> SimulationResult:
    return ran("box_on_floor", {"duration": 1.0})


def test_a_box_at_rest_presses_with_its_weight_and_sinks_in_by_its_springs(
    box: SimulationResult,
) -> None:
    weight = 2.0 * STANDARD_GRAVITY
    assert box["force.floor.z"][-1] == pytest.approx(weight, rel=1e-6)
    assert box["distance.gap"][-1] == pytest.approx(-weight / (4 * 1e5), rel=1e-4)


def apexes(result: SimulationResult) -> np.ndarray:
    height = result["piece.ball.z"]
    top = np.flatnonzero((height[1:-1] > height[:-2]) & (height[1:-1] >= height[2:])) + 1
    return height[top] - 0.06


def test_a_ball_bounces_as_high_as_in_drake() -> None:
    """The damper takes what Hunt and Crossley's law takes, to first order: of 3.3 % of the height within a tenth."""
    config = load_station("bouncing_ball", {"duration": 0.6, "sample_rate": 2000.0})
    drake = apexes(simulate(config, progress=False))[0]
    mujoco = apexes(MujocoRunner(config, step=2e-4).run())[0]
    assert 0.030 < 1 - drake / 0.1 < 0.036
    assert mujoco == pytest.approx(drake, abs=0.1 * (0.1 - drake))


def test_a_block_on_an_incline_slides_as_coulomb_says() -> None:
    """At 20 degrees with a coefficient of 0.2 it slides with g (sin a - 0.2 cos a); with 0.5 it stays."""
    incline = np.deg2rad(20)
    for friction, expected in (
        (0.2, STANDARD_GRAVITY * (np.sin(incline) - 0.2 * np.cos(incline))),
        (0.5, 0.0),
    ):
        overrides = {
            "floor": {"size": 5.0, "incline_deg": 20.0},
            "pieces.box.pose": [0, 0, 0.1 / np.cos(incline), 0, -incline, 0],
            "contact.friction": {"static": friction, "dynamic": friction},
            "contact.dissipation": 50.0,
            "duration": 0.6,
        }
        result = ran("box_on_floor", overrides, step=2e-4)
        speed = np.linalg.norm(result.piece_velocity("box")[:, :3], axis=1)
        gained = (speed[-1] - speed[20]) / (result.times[-1] - result.times[20])
        assert gained == pytest.approx(expected, abs=0.02)


def test_joint_friction_and_rotors_count_as_in_drake() -> None:
    """Tolerance: four times what halving of MuJoCo's step changes, and what radau3 at 1e-4 leaves."""
    drives = {"rotor_inertia": 1e-4, "gear_ratio": 100, "friction": 3.0, "damping": 2.0}
    overrides = {"robot.drives": drives, "duration": 1.0, "solver.accuracy": 1e-3}
    plain, drake = (
        simulate(load_station("irb120_dynamic", own), progress=False)
        for own in ({"duration": 1.0}, overrides)
    )
    assert np.abs(plain.axes("q") - drake.axes("q")).max() > 5e-3
    mujoco = ran("irb120_dynamic", overrides, step=4e-4)
    np.testing.assert_allclose(mujoco.axes("q"), drake.axes("q"), atol=4e-4)


def test_the_integral_part_is_clamped_as_in_drake() -> None:
    overrides = {
        "servo.ki": 3000.0,
        "servo.integral_limit": 5.0,
        "solver.accuracy": 1e-3,
        "duration": 2.0,
    }
    drake = simulate(load_station("irb120_dynamic", overrides), progress=False)
    mujoco = ran("irb120_dynamic", overrides, step=4e-4)
    left = (drake.axes("q_ref") - drake.axes("q"))[-1]
    assert left[1] == pytest.approx(-0.0157, abs=2e-4)  # 5 N·m do not hold joint 2
    np.testing.assert_allclose((mujoco.axes("q_ref") - mujoco.axes("q"))[-1], left, atol=1e-4)


def test_the_humanoid_stands_as_deep_in_the_floor_as_in_drake() -> None:
    config = load_station("humanoid_dynamic", {"duration": 1.0, "solver.max_step": 5e-3})
    drake = simulate(config, progress=False)
    mujoco = MujocoRunner(config).run()
    assert mujoco.ending == "completed"
    # Drake's feet creep apart
    assert mujoco["base.z"][-1] == pytest.approx(drake["base.z"][-1], abs=3e-6)
    assert mujoco["base.z"][-1] < 0.446 - 2e-5  # it sinks in
    np.testing.assert_allclose(mujoco.axes("tau")[-1], drake.axes("tau")[-1], atol=0.01)


def test_a_monitor_ends_a_run_when_it_does_in_drake() -> None:
    config = load_station("irb120_force_stop")
    drake, mujoco = simulate(config, progress=False), MujocoRunner(config, step=5e-4).run()
    assert mujoco.stopped_by == drake.stopped_by == "stop"
    assert mujoco.stop_time == pytest.approx(drake.stop_time, abs=1e-3)
    assert mujoco.final_state.positions["robot"] == pytest.approx(
        drake.final_state.positions["robot"], abs=1e-3
    )


def test_a_run_that_goes_astray_is_told() -> None:
    result = ran(
        "irb120_dynamic",
        {"servo.kd": 0.0, "servo.kp": 1e6},
        step=0.02,
        integrator="Euler",
        duration=2.0,
    )
    assert result.ending == "diverged"
    assert "shorter steps" in result.message
    assert 0 < result.stop_time < 2
    assert np.isfinite(result.values).all()


@pytest.fixture(scope="module")
def walker() -> MujocoRunner:
    return MujocoRunner(
        load_station(
            "yobotics_dynamic", {"forces": {"shove": {"kind": "push", "force": [1.0, 0, 0]}}}
        )
    )


def test_many_runs_at_once_are_the_same_runs(walker: MujocoRunner) -> None:
    wanted = [
        RunRequest(pushes={"shove": {"start": 0.1, "force": [0, size, 0]}})
        for size in (5.0, 20.0, 40.0)
    ]
    together = walker.runs(wanted, duration=0.5, threads=2)
    alone = [walker.run(pushes=one.pushes, duration=0.5) for one in wanted]
    for one, other in zip(together, alone, strict=True):
        np.testing.assert_array_equal(one.values, other.values)
    assert together[0]["base.y"][-1] < together[2]["base.y"][-1]


def test_a_run_goes_on_from_the_end_of_another_also_of_drake(walker: MujocoRunner) -> None:
    whole = walker.run(duration=0.4)
    first = walker.run(duration=0.2)
    second = walker.run(duration=0.2, start=first.final_state)
    np.testing.assert_allclose(second.axes("q")[-1], whole.axes("q")[-1], atol=1e-4)
    drake = simulate(walker.config, duration=0.2, progress=False)
    after = walker.run(duration=0.1, start=drake.final_state)
    np.testing.assert_allclose(after.pose("base")[0], drake.pose("base")[-1], atol=1e-12)


def test_pushes_act_where_the_station_has_them(walker: MujocoRunner) -> None:
    with pytest.raises(ValueError, match="no force 'shov'; did you mean 'shove'"):
        walker.run(pushes={"shov": {"force": [1, 0, 0]}})
    with pytest.raises(ValueError, match=r"pushes: shove\.at is .*as in the station"):
        walker.run(pushes={"shove": {"at": "trunk", "force": [1, 0, 0]}})


def test_references_follow_in_their_speed_where_the_station_says_so() -> None:
    """With it the derivative acts on the error of the speed, and joints lag less."""
    reference = {"kind": "sine", "amplitude_deg": 10.0, "frequency": 0.5}
    config: StationConfig = load_station(
        "irb120_dynamic", {"reference": reference, "duration": 1.0}
    )
    lags = []
    for inputs in ((), ("reference_velocity",)):
        own = config.model_copy(update={"inputs": inputs})
        drake, mujoco = simulate(own, progress=False), MujocoRunner(own, step=5e-4).run()
        np.testing.assert_allclose(mujoco.axes("q"), drake.axes("q"), atol=1e-3)
        assert not mujoco.warnings
        lags.append(np.abs(mujoco.axes("q_ref") - mujoco.axes("q"))[30:, 3:].max())
    assert lags[1] < 0.5 * lags[0]


def test_a_stiff_servo_at_its_limit_is_warned_of() -> None:
    """The humanoid's damping of 100 N·m·s/rad on light links, which MuJoCo treats explicitly at the limit of 3 N·m."""
    reference = {"kind": "move", "target_deg": {"left_knee": 60.0}, "duration": 0.3}
    runner = MujocoRunner(
        load_station("humanoid_dynamic", {"reference": reference, "duration": 0.3})
    )
    (warning,) = runner.run().solver_warnings
    assert "left_knee" in warning
    assert not runner.run(reference=(np.array([0.0, 0.3]), np.zeros((2, 18)))).solver_warnings


def test_a_run_has_the_verdict_that_it_has_in_drake() -> None:
    """The same criteria look at both: a box at rest is pressed in by m g / (4 k) = 49 µm at its corners."""
    config = load_station("box_on_floor", {"duration": 0.5})
    drake, mujoco = simulate(config, progress=False).verdict, MujocoRunner(config).run().verdict
    for verdict in (drake, mujoco):
        assert verdict["penetration"].worst.subject == "box and floor"
        assert verdict["penetration"].worst.value == pytest.approx(2 * 9.80665 / 4e5, rel=0.5)
        assert verdict.warnings == []
    weak = {"servo.torque_limit": 2.0, "reference.duration": 0.1, "duration": 0.3}
    with pytest.raises(VerdictError, match="from its target position"):
        MujocoRunner(load_station("irb120_dynamic", weak)).run(strict=True)
