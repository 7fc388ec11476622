"""Exercise 5, stop at a force: a ball on a pencil goes down to the floor. How hard does it press, and who stops it?"""

import numpy as np

from simrob_drake import Arm, load_station, simulate

STATION = "irb120_force_stop"
STRONG = {
    "servo.torque_limit": 500,
    "servo.kd": 50,
    "contact.friction": {"static": 0, "dynamic": 0},
}
FLOOR = 1e5  # N/m, and 1 s/m of dissipation
HOME = np.deg2rad([0, 0, 26.1, 0, 63.9, 0])
RADIUS = 0.01  # m, of the ball

arm = Arm(load_station(STATION))


def below(depth):
    """Return the joint angles [deg] that bring the ball's lowest point below the floor by a depth [m]."""
    pose = arm.pose(HOME).copy()
    pose[2] = RADIUS - depth
    return list(np.rad2deg(arm.joint(pose)))


def run(depth, seconds=2.0, **changes):
    """Let the reference go down to a depth [m] in so many seconds, and wait a second."""
    moves = {"reference.target_deg": below(depth), "reference.duration": seconds}
    station = load_station(STATION, {**moves, "monitors": {}, **changes})
    return simulate(station, duration=seconds + 1, progress=False)


def stiffness(kp):
    """Return how many N more the tip presses for each m that the reference is deeper, with STRONG motors."""
    raise NotImplementedError


def depth(force):
    """Return how deep the reference must go [m] so that the tip presses with a force [N] at rest; kp 1000, STRONG."""
    raise NotImplementedError


def monitors(limit):
    """Return the section `monitors` of the station, with which the run ends when the tip presses with the limit [N]."""
    raise NotImplementedError


def force_after(speed, delay):
    """Return the force [N] a delay [s] after the tip has touched the floor with a speed [m/s]."""
    raise NotImplementedError


def shortest(limit):
    """Return the shortest time [s] for going down to 0.06 m with at most the limit [N] 4 ms after touching."""
    raise NotImplementedError


if __name__ == "__main__":
    result = run(0.01, **STRONG)
    print("the tip presses with", result["force.touch.z"][-1], "N")
