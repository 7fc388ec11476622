"""Robots on their own feet: they stand, step and are pushed, held by nothing but the contacts of their soles."""

from __future__ import annotations

import numpy as np
import pytest
from pydrake.math import RigidTransform
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, EventStatus

from simrob_drake import SimulationResult, load_station, simulate
from simrob_drake.base.frames import transform_from_xyz_quaternion
from simrob_drake.stations.checks import holding_torque
from simrob_drake.stations.closed import closed_station
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.resolve import resolve
from simrob_drake.stations.steps import apply_solver

LEGGED = ("humanoid_dynamic", "roid1_dynamic", "zjudancer_dynamic", "yobotics_dynamic")

# The thesis's step ("Paso"), a second a posture, in SimRob's names.
STEP = {
    "kind": "sequence",
    "targets": [
        {"time": 1, "target_deg": {"CadIF": 60, "RodI": 60}},
        {"time": 2, "target_deg": {"RodD": 30, "TobD": -30}},
        {"time": 3, "target_deg": {"CadIF": 0, "RodI": 0}},
        {"time": 4, "target_deg": {"RodD": 0, "TobD": 0, "HomDF": 0}},
    ],
}
STEPPING = {"reference": STEP, "duration": 6.0}

# The humanoid with its hips ahead of its ankles, so that its centre of mass is over the middle of its feet [deg], and
# how much lower its trunk then stands [m].
READY = {"hip_pitch": 15, "knee": 45, "ankle_pitch": -30}
LOWER = 0.0175


def base_poses(result: SimulationResult) -> list[RigidTransform]:
    return [transform_from_xyz_quaternion(row) for row in result.pose("base")]


def tilt_deg(result: SimulationResult) -> np.ndarray:
    """Return the angle between the base's z axis and the vertical, shape (m,) [deg]."""
    return np.rad2deg(
        np.arccos(np.clip([pose.rotation().matrix()[2, 2] for pose in base_poses(result)], -1, 1))
    )


def height_by_geometry(result: SimulationResult) -> float:
    """Return how high the base stands if the lowest points of the feet touch the floor, at the end of a run [m]."""
    robot, plant = result.plant.robots["robot"], result.plant.plant
    context = plant.CreateDefaultContext()
    plant.SetFreeBodyPose(
        context, robot.root.body(), RigidTransform(base_poses(result)[-1].rotation())
    )
    for joint, sign, angle in zip(
        robot.joints, robot.axis_map.signs, result.axes("q")[-1], strict=True
    ):
        joint.set_angle(context, sign * angle)
    lowest = []
    for link in robot.feet.links:
        pose = plant.GetFrameByName(link).CalcPoseInWorld(context)
        lowest += [
            (pose @ np.array(point))[2] - robot.feet.radius for point in robot.feet.points[link]
        ]
    return -min(lowest)


@pytest.mark.parametrize("name", LEGGED)
def test_it_stands_ten_seconds(name: str) -> None:
    result = simulate(load_station(name))
    base, robot = result.pose("base")[:, :3], result.plant.robots["robot"]

    assert result.ending == "completed"
    assert result.stop_time == 10.0
    assert np.linalg.norm(base - base[0], axis=1).max() < 0.005
    assert tilt_deg(result).max() < 1.0
    assert (np.abs(result.axes("tau")).max(axis=0) < 0.5 * robot.gains.torque_limit).all()

    # The feet sink in by what they carry over their stiffness: more than nothing, less than all of it on one sphere.
    weight = 9.80665 * result.plant.plant.CalcTotalMass(result.plant.plant.CreateDefaultContext())
    sunk = height_by_geometry(result) - base[-1, 2]

    assert 0 < sunk < weight / robot.feet.stiffness / 2
    # at rest: what it still moves in the last second
    assert np.linalg.norm(base[-1] - base[-100]) < 2e-4


@pytest.mark.parametrize(
    ("feet", "height", "model"),
    [
        ("spheres_A", 0.44175, "point"),
        ("spheres_B", 0.446475, "point"),
        ("soles", 0.44496, "hydroelastic_with_fallback"),
    ],
)
def test_the_humanoid_stands_on_each_kind_of_feet(feet: str, height: float, model: str) -> None:
    overrides = {
        "robot.feet": feet,
        "robot.base": [0, 0, height, 0, 0, 0],
        "contact.model": model,
        "duration": 3.0,
    }
    result = simulate(load_station("humanoid_dynamic", overrides))

    moved = result.pose("base")[:, :3] - (0, 0, height)

    assert np.linalg.norm(moved, axis=1).max() < 0.003
    assert tilt_deg(result).max() < 0.5


@pytest.fixture(scope="module")
def stepped() -> SimulationResult:
    return simulate(load_station("humanoid_dynamic", STEPPING))


def test_the_step_of_the_thesis_goes_forward_and_ends_upright(stepped: SimulationResult) -> None:
    end = stepped.pose("base")[-1]

    assert stepped.ending == "completed"
    assert -0.08 < end[1] < -0.06  # forward is -y
    assert abs(end[0]) < 0.01
    assert tilt_deg(stepped).max() < 2.0
    assert np.abs(stepped.axes("tau")).max() <= 3.0 + 1e-9


@pytest.mark.parametrize("realization", ["per_joint", "vector"])
def test_servos_as_blocks_step_as_those_in_the_actuators(
    stepped: SimulationResult, realization: str
) -> None:
    """Also where a step starts beyond a torque's limit: behind a saturated block `cenic` would be explicit there."""
    blocks = simulate(
        load_station("humanoid_dynamic", {**STEPPING, "servo.realization": realization})
    )

    assert blocks.step_times.tolist() == stepped.step_times.tolist()
    np.testing.assert_allclose(blocks.axes("q"), stepped.axes("q"), atol=1e-5)
    np.testing.assert_allclose(blocks.pose("base"), stepped.pose("base"), atol=1e-5)


@pytest.fixture(scope="module")
def tight() -> SimulationResult:
    config = load_station("humanoid_dynamic", STEPPING)
    return simulate(config.model_copy(update={"solver": config.solver.tighter()}))


@pytest.mark.long
def test_the_step_is_the_same_ten_times_tighter(
    stepped: SimulationResult, tight: SimulationResult
) -> None:
    apart = stepped.pose("base")[:, :3] - tight.pose("base")[:, :3]
    assert np.linalg.norm(apart, axis=1).max() < 0.003
    assert np.abs(stepped.axes("q") - tight.axes("q")).max() < 0.01


@pytest.mark.long
def test_steps_of_one_length_do_it_as_well(tight: SimulationResult) -> None:
    fixed = simulate(
        load_station(
            "humanoid_dynamic",
            {**STEPPING, "solver.error_control": False, "solver.max_step": 0.0125},
        )
    )

    # 6 s of 12.5 ms; the corners of the reference lie on the grid
    assert len(fixed.step_times) == 481

    apart = fixed.pose("base")[:, :3] - tight.pose("base")[:, :3]
    assert np.linalg.norm(apart, axis=1).max() < 0.003
    assert np.abs(fixed.axes("q") - tight.axes("q")).max() < 0.01


def unexplained_impulse(config: StationConfig) -> np.ndarray:
    """Step a humanoid and return, for every second of the run, the momentum that neither contacts nor gravity explain.

    It is a part of the impulse of the weight, shape (k, 3).
    """
    closed = closed_station(resolve(config))
    diagram, ports = closed.diagram, closed.ports
    simulator = Simulator(diagram)
    apply_solver(simulator, config)
    plant = ports.plant.plant
    rows: dict[float, np.ndarray] = {}

    def look(root: Context) -> EventStatus:
        context = plant.GetMyContextFromRoot(root)
        contacts = plant.get_contact_results_output_port().Eval(context)
        count = contacts.num_point_pair_contacts()
        forces = [contacts.point_pair_contact_info(index).contact_force() for index in range(count)]
        momentum = plant.CalcSpatialMomentumInWorldAboutPoint(context, np.zeros(3)).translational()
        rows[root.get_time()] = np.concatenate([np.sum(forces or [np.zeros(3)], axis=0), momentum])
        return EventStatus.DidNothing()

    simulator.set_monitor(look)
    simulator.AdvanceTo(config.duration)
    times, forces, momenta = (
        np.array(list(rows)),
        *np.split(np.array(list(rows.values())), 2, axis=1),
    )
    # What the contacts say at a step's start acts in the step that begins there; which body they push is up to Drake.
    pushes = np.cumsum(forces[:-1] * np.diff(times)[:, np.newaxis], axis=0)
    weight = 9.80665 * plant.CalcTotalMass(plant.CreateDefaultContext())
    balance = np.sign(pushes[-1, 2]) * pushes - np.outer(times[1:], [0, 0, weight]) - momenta[1:]
    even = np.arange(times[1], config.duration, 0.01)
    evenly = np.column_stack([np.interp(even, times[1:], part) for part in balance.T])
    return (evenly[100:] - evenly[:-100]) / weight


@pytest.mark.long
def test_nothing_but_contacts_and_gravity_moves_the_humanoid() -> None:
    discrete = {"solver.kind": "discrete", "solver.time_step": 2e-3}
    unexplained = unexplained_impulse(
        load_station("humanoid_dynamic", {**STEPPING, "duration": 4.0, **discrete})
    )
    assert np.abs(unexplained).max() < 1e-3  # of the weight's impulse; 2 % is asked for


@pytest.mark.long
def test_nothing_else_carries_the_humanoid_with_the_stations_own_scheme() -> None:
    """Upward only: the friction that cenic reports is not what it applies, up to a tenth of the weight."""
    fine = {**STEPPING, "duration": 4.0, "solver.max_step": 0.005}
    unexplained = unexplained_impulse(load_station("humanoid_dynamic", fine))
    assert np.abs(unexplained[:, 2]).max() < 0.01


def test_the_humanoid_held_by_its_trunk_moves_as_told_and_feels_its_weight() -> None:
    result = simulate(load_station("humanoid_fixed"))

    np.testing.assert_array_equal(result.axes("q"), result.axes("q_ref"))
    np.testing.assert_allclose(np.rad2deg(result.axes("q")[-1]), 30, atol=1e-9)
    np.testing.assert_allclose(result.pose("base") - [0, 0, 0.49, 1, 0, 0, 0], 0, atol=1e-12)

    robot = result.plant.robots["robot"]
    expected = holding_torque(result.plant, robot, np.full(18, np.deg2rad(30)))

    np.testing.assert_allclose(result.axes("tau")[-1], expected, atol=1e-9)
    # The hip carries a leg of 0.548 kg that leans: no more than its weight at the length of a leg.
    assert 0.1 < result["tau.left_hip_roll"][-1] < 0.548 * 9.80665 * 0.25
    for axis in ("shoulder_pitch", "knee", "hip_roll"):
        assert result[f"tau.left_{axis}"][-1] == pytest.approx(
            result[f"tau.right_{axis}"][-1], abs=2e-3
        )


def fell(result: SimulationResult) -> bool:
    height = result.pose("base")[:, 2]
    return bool(tilt_deg(result)[-1] > 30 or height[-1] < 0.8 * height[0])


def pushed(
    name: str, force: list[float], overrides: dict[str, object] | None = None
) -> SimulationResult:
    push = {"start": 0.5, "duration": 0.1, "force": force}
    return simulate(load_station(name, {**(overrides or {}), "forces.push": push, "duration": 3.0}))


@pytest.mark.parametrize(
    "direction",
    [
        (1, 0),
        pytest.param((-1, 0), marks=pytest.mark.long),
        pytest.param((0, 1), marks=pytest.mark.long),
        (0, -1),
    ],
)
@pytest.mark.parametrize(
    ("name", "force"),
    [("spheres_C", 10.0), ("spheres_B", 7.0), ("roid1", 4.0), ("yobotics", 80.0)],
)
def test_a_push_is_withstood(name: str, force: float, direction: tuple[float, float]) -> None:
    overrides: dict[str, object] = {}
    if name.startswith("spheres"):
        height = {"spheres_C": 0.446, "spheres_B": 0.446475}[name] - LOWER
        posture = {
            f"{side}_{axis}": angle for side in ("left", "right") for axis, angle in READY.items()
        }
        overrides = {
            "robot.feet": name,
            "robot.initial_deg": posture,
            "robot.base": [0, 0, height, 0, 0, 0],
        }
    station = "humanoid_dynamic" if overrides else f"{name}_dynamic"

    result = pushed(station, [force * direction[0], force * direction[1], 0.0], overrides)

    assert not fell(result)
    assert tilt_deg(result).max() > 0.2  # it was pushed


def test_twice_the_push_is_too_much() -> None:
    assert fell(pushed("humanoid_dynamic", [0, -24.0, 0]))
    assert fell(pushed("roid1_dynamic", [-12.0, 0, 0]))
