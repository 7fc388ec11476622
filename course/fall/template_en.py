"""Exercise 10, a fall: a humanoid is pushed over, and must not hit the floor with its head.

It looks along -y, and rolls about x: an angle about x that is positive leans it ahead.
"""

import numpy as np

from simrob_drake import load_station, simulate
from simrob_drake.blocks.sampled import SampledBlock
from simrob_drake.robots.catalog import load_robot

AXES = list(load_robot("humanoid").axes)  # in the order of every vector
ARMS = [AXES.index(name) for name in ("right_shoulder_pitch", "left_shoulder_pitch")]
MASS, GRAVITY, COM_HEIGHT, TOES, INERTIA = 2.292, 9.80665, 0.228, 0.079, 0.037  # as in exercise 7


def run(force, blocks=()):
    """Push the trunk with a force [N] along y for 0.2 s (ahead is negative); the station's own guards are left out."""
    station = load_station(
        "humanoid_fall_forward", {"controllers": {}, "forces.shove.force": [0, force, 0]}
    )
    return simulate(station, blocks=blocks, duration=3.0, progress=False)


def lean_of(pose):
    """Return by how much the trunk leans ahead [rad]; pose: x y z qw qx qy qz."""
    return 2 * np.arctan2(pose[4], pose[3])


def tips(lean, rate):
    """Tell whether a robot falls ahead that leans so far [rad] and leans further at a rate [rad/s]."""
    raise NotImplementedError


class Guard(SampledBlock):
    """Raises the arms to where they catch the body, once it falls."""

    def __init__(self):
        """Sample 100 times a second; what it remembers is a posture, and which way it falls (0 if it does not)."""
        super().__init__(
            period=0.01,
            reads={"base_pose": 7},
            memory={"reference": np.zeros(len(AXES)), "way": np.zeros(1)},
            gives=("reference",),
        )

    def sample(self, memory, read):
        """Return what changes: {"reference": ..., "way": ...}."""
        raise NotImplementedError


if __name__ == "__main__":
    print("the head comes as near to the floor as", run(-12.0)["distance.head"].min(), "m")
