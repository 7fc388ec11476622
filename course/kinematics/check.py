"""Points of exercise 1: the answer's kinematics against those of the robot in a station."""

from __future__ import annotations

from functools import cache
from types import ModuleType

import numpy as np

from simrob_drake import Arm, as_transform, load_station, simulate
from simrob_drake.extensions.course.measuring import Reading, at_least, at_most, numbers

BARE = {"pieces.gripper": None, "pieces.load": None}
LOWER = np.deg2rad([-160, -80, -80, -150, -110, -180])
UPPER = np.deg2rad([160, 80, 60, 150, 110, 180])


@cache
def arm() -> Arm:
    """Return the arm without tools; its flange is the tool."""
    return Arm(load_station("irb120_kinematic", BARE))


def postures(count: int, seed: int) -> np.ndarray:
    """Return postures (count, 6) [rad] within the limits, joint 5 away from its singular zero."""
    drawn = np.random.default_rng(seed).uniform(LOWER, UPPER, (count, 6))
    drawn[:, 4] = np.sign(drawn[:, 4]) * (0.3 + 0.8 * np.abs(drawn[:, 4]))
    return drawn


def tool_position(answer: ModuleType) -> Reading:
    """Compare places with the robot's."""
    misses = [
        numbers(answer, "tool_position", q, shape=(3,)) - arm().pose(q)[:3] for q in postures(20, 1)
    ]
    return at_most(1e3 * np.linalg.norm(misses, axis=1).max(), 0.01, "mm")


def velocity(answer: ModuleType) -> Reading:
    """Move all joints in the station, and compare speeds."""
    start, end = postures(2, 2)
    run = simulate(
        load_station("irb120_kinematic", BARE),
        reference=([0, 2], [start, end]),
        duration=2,
        progress=False,
    )
    places = run.pose("tcp")[:, :3]
    measured = (places[2:] - places[:-2]) / (run.times[2:] - run.times[:-2])[:, None]
    chosen = range(20, len(measured), 30)
    q, v = run.axes("q")[1:-1], run.axes("v")[1:-1]
    misses = [numbers(answer, "jacobian", q[k], shape=(3, 6)) @ v[k] - measured[k] for k in chosen]
    return at_most(1e3 * np.linalg.norm(misses, axis=1).max(), 1.0, "mm/s")


def inverse(answer: ModuleType) -> Reading:
    """Let the station's arm go where the answer sends it."""
    missed = []
    for q in postures(10, 3):
        place = arm().pose(q)[:3]
        near = np.clip(q + 0.2, LOWER, UPPER)
        found = numbers(answer, "posture", place, near, shape=(6,))
        moving = {**BARE, "reference": {"kind": "hold", "target_deg": list(np.rad2deg(found))}}
        run = simulate(load_station("irb120_kinematic", moving), duration=0.02, progress=False)
        missed.append(np.linalg.norm(run.pose("tcp")[-1, :3] - place))
    return at_most(1e3 * max(missed), 0.1, "mm")


def flipped(answer: ModuleType) -> Reading:
    """Compare both poses: places in m, and axes by their vectors."""
    pairs = [(q, numbers(answer, "flipped", q, shape=(6,))) for q in postures(5, 4)]
    poses = [[as_transform(arm().pose(q)).GetAsMatrix34() for q in pair] for pair in pairs]
    return at_most(max(np.abs(one - other).max() for one, other in poses), 1e-4)


def flipped_differs(answer: ModuleType) -> Reading:
    """Look how far joint 5 turns from one posture to the other."""
    turns = [abs(q[4] - numbers(answer, "flipped", q, shape=(6,))[4]) for q in postures(5, 4)]
    return at_least(np.rad2deg(min(turns)), 10, "deg")


def singular(answer: ModuleType) -> Reading:
    """Look at the robot's own Jacobian there; a posture beyond the joint limits is refused."""
    q = numbers(answer, "singular", shape=(6,))
    hold = {"reference": {"kind": "hold", "target_deg": list(np.rad2deg(q))}}
    load_station("irb120_kinematic", {**BARE, **hold})
    values = np.linalg.svd(arm().jacobian(q)[:3], compute_uv=False)
    return at_most(values[-1] / values[0], 0.01)
