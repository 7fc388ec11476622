"""What flies keeps its momentum, whatever the solver's accuracy and steps."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context

from simrob_drake import SimulationResult, load_station, simulate, simulate_diagram
from simrob_drake.base.frames import Vector
from simrob_drake.stations.closed import closed_station
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.resolve import resolve
from simrob_drake.stations.steps import apply_solver

GRAVITY = np.array([0.0, 0.0, -9.80665])
SPIN = [1.0, 2.0, 0.5]  # rad/s
DURATION = 0.6
MOVE = {
    "kind": "sequence",
    "targets": [
        {"time": 0.3, "target_deg": {"CadIF": 60, "RodI": 60, "HomDF": 40}},
        {"time": 0.6, "target_deg": {"CadIF": 0, "RodI": 0, "HomDF": 0}},
    ],
}
IN_THE_AIR = {
    "robot.base": [0, 0, 5, 0, 0, 0],
    "monitors": {},
    "reference": MOVE,
    "duration": DURATION,
    "servo.kd": 10,
}


def momentum(plant: MultibodyPlant, context: Context) -> tuple[Vector, Vector, Vector]:
    """Return the centre of mass, the linear momentum, and the angular one about the centre of mass."""
    centre = plant.CalcCenterOfMassPositionInWorld(context)
    spatial = plant.CalcSpatialMomentumInWorldAboutPoint(context, centre)
    return centre, spatial.translational().copy(), spatial.rotational().copy()


def spinning(config: StationConfig) -> tuple[Any, Context, Context]:
    """Return a closed station whose robot turns, its context and its plant's."""
    closed = closed_station(resolve(config))
    root, plant = closed.diagram.CreateDefaultContext(), closed.ports.plant.plant
    context = plant.GetMyMutableContextFromRoot(root)
    velocities = plant.GetVelocities(context)
    velocities[:3] = SPIN
    plant.SetVelocities(context, velocities)
    return closed, root, context


def lost(
    before: tuple[Vector, Vector, Vector], after: tuple[Vector, Vector, Vector], mass: float
) -> list[float]:
    """Return how far the fall, the linear and the angular momentum are off, each as a part of what it should be."""
    (place, linear, angular), (there, later, turned) = before, after
    fall, impulse = GRAVITY * DURATION**2 / 2, mass * GRAVITY * DURATION
    off = (
        there - place - linear / mass * DURATION - fall,
        later - linear - impulse,
        turned - angular,
    )
    return [
        float(np.linalg.norm(a) / np.linalg.norm(b))
        for a, b in zip(off, (fall, impulse, angular), strict=True)
    ]


@pytest.mark.parametrize(
    "solver",
    [
        {},
        {"accuracy": 1e-5},
        {"accuracy": 1e-1, "max_step": 0.1},
        {"accuracy": 1e-6, "max_step": 0.002},
        {"error_control": False, "max_step": 0.02},
        {"error_control": False, "max_step": 0.001},
    ],
    ids=str,
)
def test_a_humanoid_in_the_air_moves_its_legs_and_keeps_its_momentum(
    solver: dict[str, Any],
) -> None:
    config = load_station(
        "humanoid_dynamic", {**IN_THE_AIR, **{f"solver.{key}": v for key, v in solver.items()}}
    )
    closed, root, context = spinning(config)
    plant = closed.ports.plant.plant
    before = momentum(plant, context)

    result = simulate_diagram(closed.diagram, closed.ports, context=root, progress=False)

    assert np.ptp(result["q.left_knee"]) > 0.6

    positions, velocities = result.final_state.of_plant(result.plant)
    plant.SetPositions(context, positions)
    plant.SetVelocities(context, velocities)

    fall, linear, angular = lost(before, momentum(plant, context), plant.CalcTotalMass(context))

    assert max(linear, angular) < 1e-3
    assert fall < 2e-3


@pytest.mark.parametrize(("accuracy", "step"), [(1e-5, 0.02), (1e-5, 5e-4)])
def test_finer_steps_of_the_scheme_itself_lose_less(accuracy: float, step: float) -> None:
    """With ``apply_solver`` alone nobody shortens the steps; what is lost shrinks as their length does."""
    fine = {"solver.accuracy": accuracy, "solver.max_step": step}
    config = load_station("humanoid_dynamic", {**IN_THE_AIR, **fine})
    closed, root, _ = spinning(config)
    simulator, plant = Simulator(closed.diagram, root), closed.ports.plant.plant
    apply_solver(simulator, config)
    context = plant.GetMyContextFromRoot(simulator.get_context())
    before = momentum(plant, context)
    simulator.AdvanceTo(DURATION)

    _, linear, angular = lost(before, momentum(plant, context), plant.CalcTotalMass(context))

    assert linear < 2e-4
    assert angular < 1e-3


def flight_and_landing(**solver: Any) -> SimulationResult:
    overrides = {"robot.base": [0, 0, 0.55, 0, 0, 0], "duration": 0.5, "monitors": {}}
    return simulate(
        load_station(
            "humanoid_dynamic", {**overrides, **{f"solver.{key}": v for key, v in solver.items()}}
        ),
        progress=False,
    )


def test_it_falls_as_a_stone_and_lands() -> None:
    shipped, fine = flight_and_landing(), flight_and_landing(accuracy=1e-5, max_step=0.002)

    flying = shipped.times < np.sqrt(2 * 0.104 / 9.80665)
    fall = 0.55 - 9.80665 * shipped.times**2 / 2
    np.testing.assert_allclose(shipped["base.z"][flying], fall[flying], atol=5e-4)
    np.testing.assert_allclose(shipped["base.z"][-1], fine["base.z"][-1], atol=1e-5)


def test_pieces_fly_beside_a_robot_that_stands() -> None:
    pieces = {"weight": {"model": "ball", "free": True, "pose": [1, 0, 1, 0, 0, 0]}}
    result = simulate(
        load_station("humanoid_dynamic", {"pieces": pieces}), duration=0.3, progress=False
    )

    np.testing.assert_allclose(
        result.piece_pose("weight")[:, 2], 1 - 9.80665 * result.times**2 / 2, atol=1e-3
    )
    assert np.abs(result["base.z"] - 0.446).max() < 1e-3


def test_a_run_goes_on_after_a_push_in_flight() -> None:
    """Before and after it, another diagram is stepped; the push adds its impulse, and nothing else does."""
    push = {"kind": "push", "start": 0.2, "duration": 0.1, "force": [2.0, 0.0, 0.0]}
    config = load_station("humanoid_dynamic", {**IN_THE_AIR, "forces": {"shove": push}})

    result = simulate(config, progress=False)

    assert result.ending == "completed"

    plant = result.plant.plant
    context = plant.CreateDefaultContext()
    positions, velocities = result.final_state.of_plant(result.plant)
    plant.SetPositions(context, positions)
    plant.SetVelocities(context, velocities)
    _, linear, _ = momentum(plant, context)

    weight = plant.CalcTotalMass(context) * GRAVITY * DURATION

    # pushed along the trunk, which turns
    assert np.linalg.norm(linear - weight) == pytest.approx(0.2, rel=0.02)


def test_a_ball_that_rolls_off_a_ramp_falls_as_a_stone_from_there(tmp_path: Path) -> None:
    """It begins in contact, so that its flight is found later; with steps of 10 ms it would fall 14 mm too far."""
    slope = 0.3  # rad, down towards x
    radius = 0.03  # m
    half = np.array([0.2, 0.1, 0.01])  # m, of the ramp
    middle = np.array([np.sin(slope), 0.0, np.cos(slope)]) * (half[2] + radius)
    pieces = {
        "ramp": {"box": (2 * half).tolist(), "parent": "world", "pose": [0, 0, 1, 0, slope, 0]},
        "ball": {
            "sphere": radius,
            "mass": 0.5,
            "free": True,
            "pose": [float(middle[0]), 0, float(1 + middle[2]), 0, 0, 0],
        },
    }
    content = {
        "pieces": pieces,
        "floor": {"size": 20},
        "contact": {"friction": {"static": 0.5, "dynamic": 0.5}},
        "solver": {
            "kind": "continuous",
            "scheme": "cenic",
            "error_control": False,
            "max_step": 0.01,
        },
        "duration": 0.8,
    }
    file = tmp_path / "station.yaml"
    file.write_text(yaml.safe_dump(content))

    result = simulate(load_station(file), progress=False)

    x = result["piece.ball.x"]
    z = result["piece.ball.z"]
    is_flying = (x > half[0] + 2 * radius) & (z > 2 * radius)
    begin, end = np.flatnonzero(is_flying)[[0, -1]]
    time = result.times[end] - result.times[begin]
    speed = result.piece_velocity("ball")[begin, 2]
    assert time > 0.25  # s
    assert z[end] - z[begin] == pytest.approx(speed * time + GRAVITY[2] * time**2 / 2, abs=3e-3)
