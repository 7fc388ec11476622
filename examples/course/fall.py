"""Solution of exercise 10 of the course, a fall, with a figure of the head over the floor."""

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
MASS, GRAVITY, COM_HEIGHT, TOES, INERTIA = 2.292, 9.80665, 0.228, 0.079, 0.037
TOO_FAR = np.deg2rad(15)  # of leaning
CATCH = {1: np.deg2rad(110), -1: np.deg2rad(-90)}  # where the arms go, ahead and back


def run(force: float, blocks: Any = ()) -> SimulationResult:
    """Push the trunk with a force [N] along y for 0.2 s."""
    station = load_station(
        "humanoid_fall_forward", {"controllers": {}, "forces.shove.force": [0, force, 0]}
    )
    return simulate(station, blocks=blocks, duration=3.0, progress=False)


def tips(lean: float, rate: float) -> bool:
    """Tell whether the energy is enough to lift the centre of mass over the toes."""
    inertia = INERTIA + MASS * (TOES**2 + COM_HEIGHT**2)
    height = COM_HEIGHT * np.cos(lean) + TOES * np.sin(lean)
    top = np.hypot(TOES, COM_HEIGHT)
    beyond = lean > np.arctan2(TOES, COM_HEIGHT)
    return bool(beyond or (rate > 0 and inertia * rate**2 / 2 > MASS * GRAVITY * (top - height)))


class Guard(SampledBlock):
    """Puts the arms ahead, or back, once the trunk leans too far, and leaves them there."""

    def __init__(self) -> None:
        """Sample 100 times a second."""
        super().__init__(
            period=0.01,
            reads={"base_pose": 7},
            memory={"reference": np.zeros(len(AXES)), "way": np.zeros(1)},
            gives=("reference",),
        )

    def sample(self, memory: Any, read: Any) -> dict[str, Any]:
        """Look at the lean; the way that was taken first stays."""
        pose, way = read["base_pose"], float(memory["way"][0])
        lean = 2 * np.arctan2(pose[4], pose[3])
        if way == 0 and abs(lean) > TOO_FAR:
            way = float(np.sign(lean))
        reference = np.zeros(len(AXES))
        reference[ARMS] = CATCH.get(int(way), 0.0)
        return {"reference": reference, "way": way}


def picture(file: Path) -> Path:
    """Draw the head's height with and without the guard."""
    figure, ((axes,),) = panels("The head over the floor, pushed by 12 N", size=(7, 3.5))
    for words, blocks in (("without a guard", []), ("with the guard", [Guard()])):
        result = run(-12.0, blocks)
        axes.plot(result.times, 1e3 * result["distance.head"], label=words)
    axes.set_xlabel("time [s], the push from 0.5 to 0.7 s")
    axes.set_ylabel("distance [mm]")
    return save_figure(figure, file)


def main() -> None:
    """Print how near the head comes to the floor, and draw."""
    for force in (-12.0, -6.0, 8.0):
        near = [1e3 * run(force, blocks)["distance.head"].min() for blocks in ([], [Guard()])]
        print(
            f"pushed by {force:g} N along y: {near[0]:.0f} mm without, {near[1]:.0f} mm with the guard"
        )
    print(picture(Path("runs/course/fall.png")))


if __name__ == "__main__":
    main()
