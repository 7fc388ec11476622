"""Stand on three legs: the quadruped lifts one foot after the other (thesis, Simulación 24, p. 116)."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from simrob_drake import SimulationResult, simulate
from simrob_drake.base.frames import Vector
from simrob_drake.kinematics.skeleton import skeleton_of
from simrob_drake.programs.gaits.quadruped import CRAWL_ORDER, three_legs
from simrob_drake.programs.gaits.walker import feet_of
from simrob_drake.results.colours import COLOURS
from simrob_drake.results.plots.own import panels, save_figure
from simrob_drake.results.record.walks import locomotion

ASKED = 0.02  # m; how high a foot has to be


def run(seconds: float = 5.0) -> dict[str, SimulationResult]:
    """Lift each foot in turn, each run going on where the one before ended, and return the runs by the lifted foot."""
    results, state = {}, None
    for foot in CRAWL_ORDER:
        motion = three_legs("yobotics", foot=foot, seconds=seconds)
        results[foot] = simulate(
            motion.station(), reference=motion.trajectory(), start=state, progress=False
        )
        state = results[foot].final_state
    return results


def foot_heights(result: SimulationResult, times: Vector) -> dict[str, Vector]:
    """Return how high every foot is over where it stands at times (k,), shape (k,) each [m]."""
    plant = result.plant.plant
    context = plant.CreateDefaultContext()
    feet = {foot.name: foot for foot in feet_of(skeleton_of("yobotics"), 0.0)}
    heights: dict[str, list[float]] = {foot: [] for foot in CRAWL_ORDER}
    for positions in result.positions_at(times):
        plant.SetPositions(context, positions)
        for name, over in heights.items():
            pose = plant.GetFrameByName(feet[name].link).CalcPoseInWorld(context)
            over.append((pose @ feet[name].point)[2] - feet[name].over)
    return {name: np.array(over) for name, over in heights.items()}


def picture(results: dict[str, SimulationResult], file: Path) -> Path:
    """Draw the heights of the feet, and below how the base shifts over the three that stand."""
    title = "the quadruped stands on three legs, each foot up in turn"
    figure, ((upper,), (lower,)) = panels(title, 2, size=(12, 6.5), sharex=True)
    times, heights = [], {foot: [] for foot in results}
    base = np.vstack([1e3 * result.pose("base")[:, :2] for result in results.values()])
    for number, result in enumerate(results.values()):
        times.append(result.times + number * result.stop_time)  # all take as long
        for foot, height in foot_heights(result, result.times).items():
            heights[foot].append(1e3 * height)
    for (foot, height), colour in zip(heights.items(), COLOURS, strict=False):
        upper.plot(np.hstack(times), np.hstack(height), color=colour, label=foot.replace("_", " "))
    upper.axhline(
        1e3 * ASKED, color="0.4", linestyle="--", linewidth=0.9, label="asked for: 20 mm for 5 s"
    )
    upper.set_ylabel("foot over where it stands [mm]")
    for way, style, label in zip(base.T, ("-", "--"), ("x: ahead", "y: to the left"), strict=True):
        lower.plot(np.hstack(times), way, style, color="0.3", label=label)
    lower.set(xlabel="time [s]", ylabel="position of the base [mm]")
    return save_figure(figure, file, beside=True)


def main() -> None:
    """Print how high and how long each foot was up, and draw it."""
    results = run()
    for foot, result in results.items():
        height, found = (
            foot_heights(result, np.arange(0.0, result.stop_time, 0.01))[foot],
            locomotion(result),
        )
        held = f"up to {1e3 * height.max():.0f} mm, over 20 mm for {0.01 * (height > ASKED).sum():.1f} s"
        effort = f"torque {found.peak_torque['ratio']:.0%} of its limit"
        print(f"{foot}: {held}, tilt {np.rad2deg(found.tilt):.1f} deg, {effort}")
    print(picture(results, Path("runs/yobotics_three_legs.png")))


if __name__ == "__main__":
    main()
