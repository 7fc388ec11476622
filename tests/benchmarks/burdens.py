"""How planned walks bear slopes, loads and bars that they are planned with: tables of docs/results/walking.md.

Run it with ``python -m tests.benchmarks.burdens [slopes|loads|bars]...``; it takes some minutes. A walk holds if
nothing ends it.
"""

import math
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from simrob_drake import LeggedRobot, SimrobError, SimulationResult, load_station, simulate
from simrob_drake.results.record.walks import locomotion

ROBOTS = ("humanoid", "roid1", "zjudancer", "yobotics")
FACING = {"humanoid": -90, "roid1": 0, "zjudancer": 90, "yobotics": 0}  # [deg]
WAYS = {
    "up": 0,
    "down": 180,
    "across": 90,
}  # where the slope rises, from where the robot looks [deg]
STEP_DEG, STEEPEST_DEG = 2, 30
HAND = {"parent": "robot", "pose": [0.0, 0.0, -0.05, 0.0, 0.0, 0.0]}
BEHIND = {"parent": "robot", "frame": "head", "pose": [0.0, 0.1, 0.0, 0.0, 0.0, 0.0]}
LOADS: dict[str, tuple[str, str, Mapping[str, Any], tuple[float, ...]]] = {
    "humanoid walk, in the hand": ("humanoid", "walk", HAND, (0.1, 0.2, 0.3)),
    "humanoid laden, in the hand": ("humanoid", "laden", HAND, (0.3, 0.6, 0.8)),
    "humanoid walk, behind the head": ("humanoid", "walk", BEHIND, (1.0,)),
    "zjudancer walk, in the hand": ("zjudancer", "walk", HAND, (1.0, 2.0)),
}
"""Robot, gait, where the load hangs, and its masses [kg]."""
BARS = {"humanoid": (0.02, 0.03, 0.04), "zjudancer": (0.04, 0.05), "roid1": (0.025,)}
"""Clearances of the feet [m]."""
AWAY = (0.30, 0.33, 0.36, 0.39)  # of a bar of 10 by 20 mm, before the robot [m]


def walked(
    robot: str, changes: Mapping[str, Any], steps: int, **gait: Any
) -> SimulationResult | None:
    """Return a walk on a changed station, and nothing where it is refused."""
    try:
        return LeggedRobot(load_station(f"{robot}_dynamic", changes)).walk(steps, **gait)
    except SimrobError:
        return None


def came(result: SimulationResult | None) -> str:
    """Return in words what became of a walk."""
    if result is None:
        return "refused"
    way = locomotion(result)
    fell = "" if result.stopped_by is None else f"falls at {result.stop_time:.1f} s, "
    return f"{fell}{way.ahead:.2f} m, turned by {math.degrees(way.yaw):.1f}°, tilt {math.degrees(way.tilt):.0f}°"


def steepest(holds: Callable[[float], bool]) -> int:
    """Return the steepest slope that holds, of those before the first that does not [deg]."""
    slopes = range(STEP_DEG, STEEPEST_DEG + 1, STEP_DEG)
    return next((slope - STEP_DEG for slope in slopes if not holds(slope)), STEEPEST_DEG)


def slopes() -> None:
    """Print the steepest slopes on which each robot stands for 4 s, and walks 12 steps."""
    for robot in ROBOTS:
        for way, turn in WAYS.items():
            heading = FACING[robot] + turn

            def stands(slope: float, robot: str = robot, heading: float = heading) -> bool:
                changes = {"floor.incline_deg": slope, "floor.heading_deg": heading}
                return (
                    simulate(
                        load_station(f"{robot}_dynamic", changes), duration=4, progress=False
                    ).stopped_by
                    is None
                )

            def walks(slope: float, robot: str = robot, heading: float = heading) -> bool:
                run = walked(robot, {"floor.incline_deg": slope, "floor.heading_deg": heading}, 12)
                return run is not None and run.stopped_by is None

            print(
                f"{robot}, {way}: stands {steepest(stands)}°, walks {steepest(walks)}°", flush=True
            )


def loads() -> None:
    """Print what becomes of 20 steps with each load."""
    for name, (robot, gait, place, masses) in LOADS.items():
        for mass in masses:
            result = walked(robot, {"pieces.parcel": {**place, "mass": mass}}, 20, gait=gait)
            print(f"{name}, {mass:g} kg: {came(result)}", flush=True)


def bars() -> None:
    """Print what becomes of 16 steps over a bar, for each clearance and distance."""
    with TemporaryDirectory() as folder:
        bar = Path(folder) / "bar.yaml"
        bar.write_text("density: 1000\nshapes:\n- {box: [0.02, 0.5, 0.01]}\n", encoding="utf-8")
        for robot, clearances in BARS.items():
            facing = math.radians(FACING[robot])
            for lift in clearances:
                for away in AWAY:
                    pose = [away * math.cos(facing), away * math.sin(facing), 0.005, facing, 0, 0]
                    changes = {"pieces.bar": {"parent": "world", "model": str(bar), "pose": pose}}
                    print(
                        f"{robot}, {lift:g} m, bar at {away:g} m: {came(walked(robot, changes, 16, lift=lift))}",
                        flush=True,
                    )


if __name__ == "__main__":
    for table in sys.argv[1:] or ("slopes", "loads", "bars"):
        {"slopes": slopes, "loads": loads, "bars": bars}[table]()
