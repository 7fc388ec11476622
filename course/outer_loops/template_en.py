"""Exercise 9, an outer loop: nobody names an angle, but the humanoid crouches to a height, and then raises its arms."""

import numpy as np

from simrob_drake import load_station, simulate
from simrob_drake.blocks.sampled import SampledBlock
from simrob_drake.robots.catalog import load_robot

AXES = list(load_robot("humanoid").axes)  # in the order of every vector
ARMS = [AXES.index(name) for name in ("right_shoulder_pitch", "left_shoulder_pitch")]
PERIOD = 0.01  # s


def weights():
    """Return by how much each axis of both legs turns for one degree of the knees, as {"left_knee": 1, ...}."""
    raise NotImplementedError


class Height(SampledBlock):
    """Brings the hip to a height [m], and raises the arms by 90 degrees once it is within 5 mm of it."""

    def __init__(self, height):
        """Read the base's pose, x y z qw qx qy qz; remember what you need."""
        super().__init__(
            period=PERIOD,
            reads={"base_pose": 7},
            memory={"reference": np.zeros(len(AXES))},
            gives=("reference",),
        )
        self.parameters = {"height": height}

    def sample(self, memory, read):
        """Return what changes, such as {"reference": ...} [rad]."""
        raise NotImplementedError


def run(height, **changes):
    """Let the humanoid crouch for eight seconds."""
    station = load_station("humanoid_dynamic", changes)
    return simulate(station, blocks=[Height(height)], duration=8.0, progress=False)


if __name__ == "__main__":
    result = run(0.40)
    print(result.message, "- the hip is at", result["base.z"][-1], "m")
