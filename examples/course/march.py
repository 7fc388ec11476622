"""Solution of exercise 8 of the course, the march, with a figure of marches by servos that lag more and less."""

from __future__ import annotations

from pathlib import Path

from simrob_drake import SimulationResult, load_station, simulate
from simrob_drake.results.plots.own import panels, save_figure

Move = dict[str, float]
STEP: list[Move] = [
    {"CadIF": 60, "RodI": 60},
    {"RodD": 30, "TobD": -30},
    {"CadIF": 0, "RodI": 0},
    {"RodD": 0, "TobD": 0},
]  # deg
OTHER = {"D": "I", "I": "D"}


def march(moves: list[Move], seconds: float = 1.0, kd: float = 100.0) -> SimulationResult:
    """Let the humanoid go through moves, each in so many seconds."""
    targets = [{"time": (k + 1) * seconds, "target_deg": move} for k, move in enumerate(moves)]
    changes = {"reference": {"kind": "sequence", "targets": targets}, "servo.kd": kd}
    return simulate(
        load_station("humanoid_dynamic", changes), duration=len(moves) * seconds + 1, progress=False
    )


def mirrored(move: Move) -> Move:
    """Exchange the letter of the side: the fourth of CadIF, TobD and the others."""
    return {name[:3] + OTHER[name[3]] + name[4:]: angle for name, angle in move.items()}


def moves(steps: int) -> list[Move]:
    """Return steps with the left and the right leg in turn."""
    return [move if step % 2 == 0 else mirrored(move) for step in range(steps) for move in STEP]


def lag(kp: float, kd: float) -> float:
    """Return kd / kp: on a ramp the spring has to pull against the damper, kp e = kd v."""
    return kd / kp


def quick() -> tuple[float, float]:
    """Return a damping with which joints are late by 0.3 s, and moves that are just longer."""
    return 30.0, 0.35


def picture(file: Path) -> Path:
    """Draw how far marches go."""
    figure, ((axes,),) = panels("Four steps of the thesis", size=(7, 3.5))
    for kd, seconds in ((100.0, 1.0), (100.0, 0.35), (30.0, 1.0), (30.0, 0.35)):
        result = march(moves(4), seconds, kd)
        axes.plot(
            result.times,
            1e3 * (result["base.y"][0] - result["base.y"]),
            label=f"kd {kd:g}, {seconds:g} s a move",
        )
    axes.set_xlabel("time [s]")
    axes.set_ylabel("way ahead [mm]")
    return save_figure(figure, file)


def main() -> None:
    """Print how far it goes, and draw."""
    kd, seconds = quick()
    for result, took in ((march(moves(4)), 16.0), (march(moves(4), seconds, kd), 16 * seconds)):
        ahead = 1e3 * (result["base.y"][0] - result["base.y"][-1])
        print(f"{result.message}: {ahead:.0f} mm ahead, {ahead / took:.0f} mm/s")
    print(picture(Path("runs/course/march.png")))


if __name__ == "__main__":
    main()
