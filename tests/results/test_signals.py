"""Signals between steps: what was applied, and poses that the state holds."""

from __future__ import annotations

import numpy as np
import pytest
from pydrake.multibody.tree import MultibodyForces
from pydrake.trajectories import PiecewisePolynomial

from simrob_drake import SimulationResult, load_station, simulate
from simrob_drake.base.frames import transform_from_xyz_quaternion
from simrob_drake.blocks.contacts import Contacts

STEP, KD, SPEEDING = 0.02, 5.0, 5.0


def inverse_dynamics(result: SimulationResult, row: int) -> np.ndarray:
    """Return the torques (n,) that move the joints as they moved around a row [N·m]."""
    plant, speeds, times = result.plant.plant, result.axes("v"), result.times
    context = plant.CreateDefaultContext()
    plant.SetPositions(context, result.axes("q")[row])
    plant.SetVelocities(context, speeds[row])
    forces = MultibodyForces(plant)
    plant.CalcForceElementsContribution(context, forces)
    rates = (speeds[row + 4] - speeds[row - 4]) / (times[row + 4] - times[row - 4])
    return plant.CalcInverseDynamics(context, rates, forces)


@pytest.mark.parametrize("realization", ["implicit", "vector"])
def test_under_cenic_the_torque_is_what_was_applied_while_the_reference_stood_still(
    realization: str,
) -> None:
    """Recorded torques agree with the inverse dynamics of the recorded motion, although servos act once a step."""
    overrides = {
        "servo": {"realization": realization, "kp": 1e-3, "kd": KD},
        "inputs": ["reference_velocity"],
        "gravity": 0.0,
        "solver": {"kind": "continuous", "scheme": "cenic", "accuracy": 1e-3, "max_step": STEP},
        "duration": 0.5,
    }
    times = np.linspace(0, 1, 101)
    way, speed = SPEEDING * times**2 / 2, SPEEDING * times
    faster = PiecewisePolynomial.CubicHermite(times, np.outer([1, 1], way), np.outer([1, 1], speed))

    result = simulate(load_station("double_pendulum", overrides), reference=faster)

    # What the law says at a step's end of a reference that has gone on. What is told acted in the second half of a
    # step, in which the joints have nearly caught up; the mean is a few hundredths of that more.
    unheld = KD * SPEEDING * STEP
    for row in (20, 30, 40):
        told = result.axes("tau")[row]
        np.testing.assert_allclose(told, inverse_dynamics(result, row), atol=0.03 * unheld)


def test_the_pose_of_a_free_base_is_that_of_its_frame() -> None:
    """The pose signal, which is read from the state, equals the pose that the plant computes."""
    overrides = {"robot.base": [0.1, 0.2, 1.0, 2.5, 0.3, -0.4], "duration": 0.2, "monitors": {}}
    result = simulate(load_station("humanoid_dynamic", overrides))
    plant, root = result.plant.plant, result.plant.robots["robot"].root
    context = plant.CreateDefaultContext()
    plant.SetPositions(context, result.positions_at(result.times[-1:])[0])

    told = transform_from_xyz_quaternion(result.pose("base")[-1])

    np.testing.assert_allclose(
        told.GetAsMatrix4(), root.CalcPoseInWorld(context).GetAsMatrix4(), atol=1e-12
    )
    assert (result.pose("base")[:, 3] >= 0).all()


def test_contacts_of_many_times_are_those_of_each() -> None:
    """Contact results of several times in one call equal those of one call for each time."""
    # which falls, lands and lies
    result = simulate(load_station("box_on_floor", {"duration": 0.5}))

    def pressing(times: np.ndarray) -> list[float]:
        return [Contacts.of(found).forces[:, 2].sum() for found in result.contacts_at(times)]

    times = np.linspace(0, 0.5, 11)
    together = pressing(times)
    np.testing.assert_array_equal(
        together, [pressing(times[row : row + 1])[0] for row in range(len(times))]
    )
    assert together[0] == 0
    assert together[-1] != 0
