"""Solution of exercise 9 of the course, an outer loop, with a figure of crouches to two heights."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from simrob_drake import SimulationResult, load_station, simulate
from simrob_drake.blocks.sampled import SampledBlock
from simrob_drake.results.plots.own import panels, save_figure
from simrob_drake.robots.catalog import load_robot

AXES = list(load_robot("humanoid").axes)
ARMS = [AXES.index(name) for name in ("right_shoulder_pitch", "left_shoulder_pitch")]
PERIOD = 0.01  # s
START = 0.446  # m
SPEED = 0.03  # m/s, of what is asked for
PROPORTIONAL, INTEGRAL = (
    20.0,
    20.0,
)  # rad/m, rad/(m·s): their ratio is the lag of the joints, kd / kp = 1 s
THERE = 0.005  # m


def weights() -> dict[str, float]:
    """Return half a degree of hip and ankle for one of the knee: thigh and shank are as long as each other."""
    legs = {"hip_pitch": 0.5, "knee": 1.0, "ankle_pitch": -0.5}
    return {f"{side}_{axis}": weight for side in ("right", "left") for axis, weight in legs.items()}


class Height(SampledBlock):
    """A PI controller of the hip's height that bends the legs."""

    def __init__(self, height: float) -> None:
        """Remember what is asked for by now, the integral, and whether the hip has been there."""
        super().__init__(
            period=PERIOD,
            reads={"base_pose": 7},
            memory={
                "reference": np.zeros(len(AXES)),
                "asked": np.array([START]),
                "integral": np.zeros(1),
                "there": np.zeros(1),
            },
            gives=("reference", "asked"),
        )
        self.parameters = {"height": height}
        self.weights = np.array([weights().get(axis, 0.0) for axis in AXES])

    def sample(self, memory: Any, read: Any) -> dict[str, Any]:
        """Move what is asked for slowly to the height, and bend by the error and its integral."""
        height, measured = self.parameters["height"], read["base_pose"][2]
        step = SPEED * PERIOD
        asked = memory["asked"] + np.clip(height - memory["asked"], -step, step)
        error = measured - asked
        integral = memory["integral"] + INTEGRAL * PERIOD * error
        bend = max(float((PROPORTIONAL * error + integral)[0]), 0.0)  # knees bend one way only
        there = max(float(memory["there"][0]), float(abs(measured - height) < THERE))
        reference = bend * self.weights
        reference[ARMS] = there * np.pi / 2
        return {"reference": reference, "asked": asked, "integral": integral, "there": there}


def run(height: float, **changes: Any) -> SimulationResult:
    """Let the humanoid crouch for eight seconds."""
    station = load_station("humanoid_dynamic", changes)
    return simulate(station, blocks=[Height(height)], duration=8.0, progress=False)


def picture(file: Path) -> Path:
    """Draw heights, and what was asked for."""
    figure, ((axes,),) = panels("The hip of a humanoid that crouches by itself", size=(7, 3.5))
    for height in (0.40, 0.37):
        result = run(height)
        (line,) = axes.plot(result.times, result["base.z"], label=f"to {height:g} m")
        axes.plot(
            result.times, result["height.asked"], "--", color=line.get_color(), label="asked for"
        )
    axes.set_xlabel("time [s]")
    axes.set_ylabel("height of the hip [m]")
    return save_figure(figure, file)


def main() -> None:
    """Print where the hip ends, and draw."""
    for height in (0.40, 0.37):
        result = run(height)
        low = 1e3 * (height - result["base.z"].min())
        print(
            f"asked for {height} m: ends at {result['base.z'][-1]:.4f} m, at most {low:.1f} mm too low"
        )
    print(picture(Path("runs/course/outer_loops.png")))


if __name__ == "__main__":
    main()
