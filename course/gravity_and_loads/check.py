"""Points of exercise 3: the arm without a tool holds postures, with loads, limits and the answer's feedforward."""

from __future__ import annotations

from types import ModuleType
from typing import Any

import numpy as np

from simrob_drake import SimulationResult, load_station, simulate
from simrob_drake.blocks.sampled import SampledBlock
from simrob_drake.extensions.course.measuring import (
    Reading,
    at_least,
    at_most,
    near,
    number,
    numbers,
)

LOAD = 3.0  # kg
STRETCHED = np.deg2rad([90.0, -70.0])
WEAKEST = 2.0  # kg with which weakest() is asked


class Feedforward(SampledBlock):
    """Adds what the answer says to the servos of joints 2 and 3."""

    def __init__(self, answer: ModuleType, load: float) -> None:
        """Read positions 200 times a second."""
        memory = {"feedforward": np.zeros(6)}
        super().__init__(period=0.005, reads={"position": 6}, memory=memory, gives=("feedforward",))
        self.answer, self.load = answer, load

    def sample(self, memory: Any, read: Any) -> dict[str, Any]:
        """Ask the answer."""
        torque = np.zeros(6)
        torque[1:3] = numbers(self.answer, "gravity", *read["position"][1:3], self.load, shape=(2,))
        return {"feedforward": torque}


def held(q2: float, q3: float, load: float, blocks: Any = (), **servo: Any) -> SimulationResult:
    """Let the servos hold a posture with a load."""
    posture = {"joint_2": float(np.rad2deg(q2)), "joint_3": float(np.rad2deg(q3))}
    carried = (
        {"model": "pencil", "parent": "robot", "mass": load, "com": [0, 0, 0.05]} if load else None
    )
    changes = {
        "pieces.gripper": None,
        "pieces.load": carried,
        "robot.initial_deg": posture,
        "reference": {"kind": "hold", "target_deg": posture},
        **{f"servo.{key}": value for key, value in servo.items()},
    }
    return simulate(
        load_station("irb120_dynamic", changes), blocks=blocks, duration=1.5, progress=False
    )


def torques(answer: ModuleType) -> Reading:
    """Hold with stiff servos, and compare."""
    missed = []
    for q2, q3, load in (
        (0, 0, 0),
        (30, 0, 0),
        (60, -50, 0),
        (30, 20, 2),
        (-40, 10, 2),
        (80, -60, 4),
    ):
        q = np.deg2rad([q2, q3])
        measured = held(*q, load, kp=20000, kd=200).axes("tau")[-1, 1:3]
        missed.append(numbers(answer, "gravity", *q, load, shape=(2,)) - measured)
    return at_most(np.abs(missed).max(), 0.1, "N·m")


def error(answer: ModuleType, load: float) -> np.ndarray:
    """Return the errors of joints 2 and 3 [deg] under 3 kg with a feedforward that believes in a load."""
    result = held(*np.deg2rad([40.0, -20.0]), LOAD, [Feedforward(answer, load)], kp=1000, kd=50)
    if result.ending != "completed":  # a block that fails ends a run
        raise RuntimeError(result.message)
    return np.rad2deg(result.axes("q")[-1] - result.axes("q_ref")[-1])[1:3]


def feedforward(answer: ModuleType) -> Reading:
    """Hold with the answer's feedforward."""
    return at_most(np.abs(error(answer, LOAD)).max(), 0.02, "deg")


def unaware(answer: ModuleType) -> Reading:
    """Hold with a wrong load."""
    return near(error(answer, number(answer, "aware", LOAD))[0], 0.5, 0.02, "deg")


def weakest(answer: ModuleType) -> Reading:
    """Hold there, and compare with the largest torque on a grid of postures."""
    q2, q3 = numbers(answer, "weakest", WEAKEST, shape=(2,))
    measured = abs(held(q2, q3, WEAKEST, kp=20000, kd=200)["tau.joint_2"][-1])
    return at_least(100 * measured / LARGEST, 99.5, "%")


LARGEST = 36.99  # N·m of joint 2 with 2 kg, over q2 and q3


def dropped(answer: ModuleType, part: float) -> list[float]:
    """Return the errors of joint 2 [deg] with a part of the payload, for two limits."""
    errors = []
    for limit in (30.0, 60.0):
        result = held(
            *STRETCHED,
            part * number(answer, "payload", limit),
            kp=20000,
            kd=200,
            torque_limit={"joint_2": limit},
        )
        errors.append(
            float(np.rad2deg(np.abs(result["q.joint_2"] - result["q_ref.joint_2"]).max()))
        )
    return errors


def holds(answer: ModuleType) -> Reading:
    """Hold a little less."""
    return at_most(max(dropped(answer, 0.95)), 2, "deg")


def falls(answer: ModuleType) -> Reading:
    """Try to hold a little more."""
    return at_least(min(dropped(answer, 1.04)), 2, "deg")
