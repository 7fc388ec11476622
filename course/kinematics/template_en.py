"""Exercise 1, kinematics of an arm: where the flange of an ABB IRB120 is, and how to bring it somewhere.

Lengths [m]: 0.290 from the floor to joint 2, 0.270 to joint 3, 0.070 up and 0.302 ahead to joint 5, 0.072 to the
flange. At zero the arm points along x; joint 1 turns about z, joints 2, 3 and 5 about y, joints 4 and 6 about x.
"""

import numpy as np


def tool_position(q):
    """Return the flange's place [x, y, z] in m at six joint angles in rad."""
    raise NotImplementedError


def jacobian(q):
    """Return the 3 x 6 matrix that turns joint speeds into the flange's speed."""
    raise NotImplementedError


def posture(place, q):
    """Return six joint angles that bring the flange to a place, found from the start q; within the joint limits."""
    raise NotImplementedError


def flipped(q):
    """Return the other posture of the wrist with the same pose of the flange: place and axes."""
    raise NotImplementedError


def singular():
    """Return a posture within the joint limits in which the flange cannot move one way at all."""
    raise NotImplementedError


if __name__ == "__main__":
    print("the flange at zero:", tool_position(np.zeros(6)), "and it should be [0.374 0 0.63]")
