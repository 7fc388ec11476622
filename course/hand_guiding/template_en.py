"""Exercise 6, guided by hand: an arm whose servos give in to what its model does not explain.

torque = kp (q_ref - q) - kd v + x, and x' = gain (torque that would hold the arm - torque). kp is 1000, kd 10.
Forces are in the axes of the tool: at HOME its y axis is x of the world, and its z axis points down.
"""

import numpy as np

from simrob_drake import Arm, as_transform, load_station, simulate

STATION = "irb120_cobot"
HOME = np.deg2rad([0, 0, 0, 0, 90, 0])
FINE = {"solver.accuracy": 1e-3, "solver.max_step": 0.02}

arm = Arm(
    load_station(STATION)
)  # arm.jacobian(q), arm.pose(q), arm.dynamics.gravity(q): what it takes is there
axes = as_transform(arm.pose(HOME)).rotation().matrix()  # the tool's, at HOME


def run(gain, force, seconds, kd=10):
    """Push the tool with a force [N] for so many seconds from 0.5 s on, and wait for two more."""
    push = {"kind": "push", "start": 0.5, "duration": seconds, "force": list(force)}
    servo = {"servo.admittance_gain": gain, "servo.kd": kd}
    station = load_station(STATION, {**FINE, **servo, "forces": {"hand": push}})
    return simulate(station, duration=seconds + 2.5, progress=False)


def hand_force(q, torque):
    """Return the force [N], in the tool's axes, that a hand gives a stiff arm at rest with these joints and torques."""
    raise NotImplementedError


def speed(gain, force):
    """Return the velocity (3) [m/s], in the world's axes, with which a steady force moves the tool at HOME."""
    raise NotImplementedError


def gain_for(asked):
    """Return the gain with which 3 N along the tool's y axis move it at a speed [m/s] along x of the world."""
    raise NotImplementedError


def stiffest():
    """Return the direction (3), in the tool's axes, in which a hand at HOME moves the tool least."""
    raise NotImplementedError


def settings():
    """Return (gain, kd): 2 N along y for 0.5 s move the tool by 40 mm or more; let go, it goes on by 10 at most."""
    raise NotImplementedError


if __name__ == "__main__":
    result = run(300, [0, 2, 0], 0.5)
    tool = result.pose("tcp")[:, :3]
    print(
        "the push moved the tool by",
        1e3 * (tool[100] - tool[50]),
        "mm, and then by",
        1e3 * (tool[-1] - tool[100]),
    )
