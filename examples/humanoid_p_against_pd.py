"""P against PD: where the base of the humanoid goes during the step, by both controllers (thesis, Gráfica 4-5, p. 79).

The joints push with 100 N·m/rad towards their references. Alone (P), that makes the robot sway; with 100 N·m·s/rad
against their speed (PD) it moves smoothly, and lags a second behind.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from simrob_drake import SimulationResult, load_station, simulate
from simrob_drake.base.frames import Vector, pose_from_transform, transform_from_xyz_quaternion
from simrob_drake.programs.gaits.registry import load_gaits
from simrob_drake.results.colours import COLOURS
from simrob_drake.results.plots.own import panels, save_figure
from simrob_drake.results.record.walks import locomotion

CONTROLLERS = {"P": 0.0, "PD": 100.0}  # gain against the speed of the joints [N·m·s/rad]
PANELS = (
    "x: to the left",
    "y: backward (it walks to -y)",
    "z: up",
    "Rz: turned left",
    "Ry: leaning left",
    "Rx: leaning forward",
)


def run(duration: float = 10.0) -> dict[str, SimulationResult]:
    """Take the step of the thesis with each controller and return the runs."""
    targets = [target.model_dump() for target in load_gaits("humanoid").sequences["step"].targets]
    overrides = {
        "reference": {"kind": "sequence", "targets": targets},
        "servo.kp": 100.0,
        "solver.max_step": 0.005,
    }
    stations = {
        name: load_station("humanoid_dynamic", {**overrides, "servo.kd": kd})
        for name, kd in CONTROLLERS.items()
    }
    return {
        name: simulate(station, duration=duration, progress=False)
        for name, station in stations.items()
    }


def base_moves(result: SimulationResult) -> Vector:
    """Return how far the base is from where it began: x y z [mm] Rz Ry Rx [deg], shape (m, 6)."""
    poses = np.array(
        [pose_from_transform(transform_from_xyz_quaternion(pose)) for pose in result.pose("base")]
    )
    poses[:, 3:] = np.rad2deg(np.unwrap(poses[:, 3:], axis=0))
    poses[:, :3] *= 1e3
    return np.asarray(poses - poses[0])


def picture(results: dict[str, SimulationResult], file: Path) -> Path:
    """Draw the position in the upper row and the orientation below, a panel for each direction."""
    title = "the step of the thesis with a P and with a PD controller: how the base moves from its start"
    figure, frames = panels(title, 2, 3, size=(12, 6.5), titles=PANELS, sharex=True, sharey="row")
    for (name, result), style in zip(results.items(), COLOURS[1::-1], strict=True):
        for axes, values in zip(frames.flat, base_moves(result).T, strict=True):
            axes.plot(
                result.times, values, color=style, label=f"{name}: kp 100, kd {CONTROLLERS[name]:g}"
            )
    for axes, label in zip(
        frames[:, 0], ("position of the base [mm]", "orientation of the base [deg]"), strict=True
    ):
        axes.set_ylabel(label)
    figure.supxlabel("time [s]", fontsize=10)
    return save_figure(figure, file)


def main() -> None:
    """Print how far each controller brings the base, and draw it."""
    results = run()
    for name, result in results.items():
        found = locomotion(result)
        rate = np.sqrt(
            np.mean(np.gradient(base_moves(result)[:, 3:], result.times, axis=0) ** 2, axis=0).sum()
        )
        yaw, tilt = np.rad2deg([found.yaw, found.tilt])
        way = f"{1e3 * found.ahead:5.1f} mm ahead, turned by {yaw:5.1f} deg"
        print(
            f"{name:2}: {way}, tilted by {tilt:4.1f} deg at most, turning at {rate:4.1f} deg/s (rms)"
        )
    print(picture(results, Path("runs/humanoid_p_against_pd.png")))


if __name__ == "__main__":
    main()
