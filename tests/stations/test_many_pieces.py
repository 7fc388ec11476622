"""Stations of many pieces: each piece costs the same memory, and the count of pieces is limited."""

import numpy as np
import pytest
import yaml

from simrob_drake import build_station, load_station
from simrob_drake.base.errors import SimrobError
from simrob_drake.base.frames import rotation_of


def pieces_file(folder, free, fixed=0):
    """Write a station of small boxes in a row, and return its file."""
    box = {"box": [0.01, 0.02, 0.03], "density": 500}
    pieces = {
        f"free_{index}": {**box, "free": True, "pose": [0.1 * index, 0, 1, 0, 0, 0]}
        for index in range(free)
    }
    pieces |= {
        f"fixed_{index}": {**box, "parent": "world", "pose": [0, 0.1 * index, 0, 0, 0, 0]}
        for index in range(fixed)
    }
    file = folder / "pieces.yaml"
    file.write_text(yaml.safe_dump({"pieces": pieces}))
    return file


@pytest.mark.long
@pytest.mark.parametrize(
    ("free", "fixed", "message"),
    [
        (3000, 0, "pieces is 3000 free pieces; it must be at most 200 pieces with free: true"),
        (1, 3000, "pieces is 3001 pieces; it must be at most 300"),
    ],
)
def test_thousands_of_pieces_are_refused_by_their_number(tmp_path, free, fixed, message):
    with pytest.raises(SimrobError, match=message):
        load_station(pieces_file(tmp_path, free, fixed))


def test_the_memory_of_a_free_piece_does_not_grow_with_their_number(tmp_path):
    """Outputs of a piece select their entries of the state by indices, and not by a matrix as wide as the state."""
    for count in (2, 20):
        ports = build_station(load_station(pieces_file(tmp_path, count))).ports
        assert ports.outputs.of_state["piece_pose.free_1"].pick.shape == (7,)
        assert ports.outputs.of_state["piece_velocity.free_1"].pick.shape == (6,)


def test_outputs_of_free_pieces_are_poses_and_velocities_of_the_plant(tmp_path):
    """Ports and outputs computed from recorded states agree with Drake's own pose and velocity of each body."""
    station = build_station(load_station(pieces_file(tmp_path, 3)))
    plant = station.ports.plant.plant
    context = station.CreateDefaultContext()
    plant_context = plant.GetMyMutableContextFromRoot(context)
    random = np.random.default_rng(5)
    positions = random.normal(size=plant.num_positions())
    for body in station.ports.plant.free_pieces.values():
        start = body.floating_positions_start()
        quaternion = slice(start, start + 4)
        positions[quaternion] /= np.linalg.norm(positions[quaternion])
    velocities = random.normal(size=plant.num_velocities())
    plant.SetPositionsAndVelocities(plant_context, np.concatenate([positions, velocities]))
    states = plant.GetPositionsAndVelocities(plant_context)[np.newaxis]
    from_state = station.ports.outputs.of_state

    for name, body in station.ports.plant.free_pieces.items():
        velocity = station.GetOutputPort(f"piece_velocity.{name}").Eval(context)
        motion = plant.EvalBodySpatialVelocityInWorld(plant_context, body)
        expected = [*motion.translational(), *motion.rotational()]
        np.testing.assert_allclose(velocity, expected, atol=1e-12)
        np.testing.assert_array_equal(from_state[f"piece_velocity.{name}"].of(states)[0], velocity)

        pose = from_state[f"piece_pose.{name}"].of(states)[0]
        port_pose = station.GetOutputPort(f"piece_pose.{name}").Eval(context)
        np.testing.assert_allclose(pose, port_pose, atol=1e-12)
        transform = plant.EvalBodyPoseInWorld(plant_context, body)
        np.testing.assert_allclose(pose[:3], transform.translation(), atol=1e-12)
        np.testing.assert_allclose(
            rotation_of(pose[3:]).matrix(), transform.rotation().matrix(), atol=1e-12
        )
