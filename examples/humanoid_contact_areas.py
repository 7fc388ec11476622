"""The same step on contact areas A, B and C: three spacings of the spheres of a foot (thesis, Simulación 13, p. 82).

B is the real sole, on which one foot cannot carry the robot unless it leans; A and C reach under the whole body.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from simrob_drake import SimulationResult, simulate
from simrob_drake.base.frames import Vector
from simrob_drake.kinematics.skeleton import skeleton_of
from simrob_drake.programs.gaits.sequences import posing, standing_height
from simrob_drake.results.colours import COLOURS
from simrob_drake.results.plots.own import panels, save_figure
from simrob_drake.results.record.walks import locomotion

AREAS = ("A", "B", "C")
LINES = {"A": (COLOURS[0], "-", 1.5), "B": (COLOURS[1], "-", 1.5), "C": (COLOURS[2], "--", 2.5)}


def run(areas: Sequence[str] = AREAS, duration: float | None = None) -> dict[str, SimulationResult]:
    """Take the step on each area and return the runs; a step takes 6 s, unless the robot falls."""
    motion, results = posing("humanoid", "step"), {}
    station = {"inputs": [], "monitors.fall.kind": "fall", "monitors.fall.tilt_deg": 50}
    for area in areas:
        height = standing_height(skeleton_of("humanoid"), motion.positions[0], f"spheres_{area}")
        feet = {"robot.feet": f"spheres_{area}", "robot.base": [0, 0, height, 0, 0, 0]}
        config = motion.station({**station, **feet})
        results[area] = simulate(
            config, duration=duration, reference=motion.trajectory(), progress=False
        )
    return results


def sole(result: SimulationResult) -> Vector:
    """Return how wide and how long the area under a foot is [mm]."""
    (robot,) = result.plant.robots.values()
    points = np.array(robot.model.feet.kind(result.config.robots["robot"].feet).points["left_foot"])
    return np.asarray(1e3 * np.ptp(points[:, :2], axis=0))


def picture(results: dict[str, SimulationResult], file: Path) -> Path:
    """Draw tilt, height and way of the base on every area, at the scale of those that stay upright."""
    title = "the step of the thesis on the three contact areas"
    figure, frames = panels(title, 2, 2, size=(11, 6.5), sharex=True)
    labels = (
        "tilt of the base [deg]",
        "height over its start [mm]",
        "distance forward [mm]",
        "distance to the left [mm]",
    )
    for axes, label in zip(frames.flat, labels, strict=True):
        axes.set(ylabel=label, xlabel="time [s]")
    for area, result in sorted(results.items(), key=lambda item: item[1].ending == "monitor"):
        (width, length), (colour, style, thick), pose = (
            sole(result),
            LINES[area],
            result.pose("base"),
        )
        (x, y, z), (qx, qy) = 1e3 * (pose[:, :3] - pose[0, :3]).T, pose[:, 4:6].T
        end = f"falls, {result.stop_time:.2f} s" if result.ending == "monitor" else "stays upright"
        for axes, values in zip(
            frames.flat, (np.rad2deg(np.arccos(1 - 2 * (qx**2 + qy**2))), z, -y, x), strict=True
        ):
            label = f"{area}: {width:.0f} × {length:.0f} mm a foot, {end}"
            if result.ending == "monitor":
                axes.set_ylim(axes.get_ylim())  # who falls leaves the panel
            axes.plot(result.times, values, style, color=colour, linewidth=thick, label=label)
    return save_figure(figure, file)


def main() -> None:
    """Print a table of the areas, and draw them."""
    results = run()
    print("area   foot [mm]  ahead [mm]  left [mm]  turned [deg]  largest tilt [deg]  ending")
    for area, result in results.items():
        (width, length), found = sole(result), locomotion(result)
        yaw, tilt = np.rad2deg([found.yaw, found.tilt])
        way = f"{1e3 * found.ahead:10.1f} {1e3 * found.drift:10.1f} {yaw:13.1f} {tilt:19.1f}"
        print(f"{area:4} {width:5.0f} × {length:<3.0f} {way}  {result.message}")
    print(picture(results, Path("runs/humanoid_contact_areas.png")))


if __name__ == "__main__":
    main()
