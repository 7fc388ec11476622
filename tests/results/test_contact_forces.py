"""Motion of a piece from which its contact forces are computed, against a flight without forces."""

from types import SimpleNamespace

import numpy as np
import pytest
from pydrake.math import RigidTransform, RotationMatrix

from simrob_drake import simulate
from simrob_drake.base.frames import xyz_quaternion_from_transform
from simrob_drake.results.verdict.contact_forces import _velocity_of_centre

CENTRE = np.array([0.1, -0.05, 0.2])  # m, in the axes of the piece
FLIGHT = np.array([0.3, -0.4, 0.5])  # m/s, of the centre


@pytest.mark.parametrize("rate", [-3.0, 0.0, 3.0])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_the_centre_of_a_piece_that_turns_in_flight_moves_evenly(axis: int, rate: float) -> None:
    """The origin of the piece circles its centre of mass, so its own velocity changes all the time."""
    spin = np.zeros(3)
    spin[axis] = rate  # rad/s
    poses = []
    velocities = []
    for time in np.linspace(0.0, 1.0, 7):
        angle = rate * time
        rotations = (
            RotationMatrix.MakeXRotation(angle),
            RotationMatrix.MakeYRotation(angle),
            RotationMatrix.MakeZRotation(angle),
        )
        arm = rotations[axis] @ CENTRE
        pose = RigidTransform(rotations[axis], FLIGHT * time - arm)
        poses.append(xyz_quaternion_from_transform(pose))
        velocities.append([*(FLIGHT - np.cross(spin, arm)), *spin])
    body = SimpleNamespace(default_com=lambda: CENTRE)
    run = SimpleNamespace(
        plant=SimpleNamespace(free_pieces={"stone": body}),
        piece_pose=lambda piece: np.array(poses),
        piece_velocity=lambda piece: np.array(velocities),
    )

    found = _velocity_of_centre(run, "stone")

    assert found == pytest.approx(np.tile(FLIGHT, (7, 1)), abs=1e-12)


def test_bodies_that_touch_at_the_start_of_a_run_do_not_begin_to_touch():
    fallen = simulate("box_on_floor", duration=0.3, progress=False)

    resting = simulate("box_on_floor", start=fallen.final_state, duration=0.05, progress=False)

    assert [event.text for event in fallen.onsets] == ["box touches the ground"]
    assert resting.onsets == []
