"""What several tests share: stations with little in them, and how the tool moved."""

import numpy as np
import pytest

from simrob_drake import Arm, load_station

DOWN = (0.0, 0.0, np.pi)
HOME = (0.0, 0.0, 0.0, 0.0, np.pi / 2, 0.0)
BARE = {
    "robot.initial_deg": {"joint_5": 90},
    "pieces.table": {"model": "inclined_table", "parent": "world"},
    "pieces.weight": {
        "model": "half_die",
        "parent": "world",
        "pose": [0.3, 0.1, 0.2, 0.3, 0.4, 0.5],
        "mass": 1.0,
    },
}


@pytest.fixture
def kinematic():
    """An arm at its home posture, with gripper and pencil, a table and a die of 1 kg."""
    return Arm(load_station("irb120_kinematic", BARE))


@pytest.fixture
def dynamic():
    """The same, moved by joint torque."""
    return Arm(load_station("irb120_dynamic", BARE))


def positions_between(result, samples=2000, robot=None):
    """Return where the robot's axes were, at many times between the samples too, shape (k, n)."""
    own = result.plant.robots[robot or next(iter(result.plant.robots))]
    rows = result.positions_at(np.linspace(0, result.stop_time, samples))
    return own.axis_map.positions(rows)
