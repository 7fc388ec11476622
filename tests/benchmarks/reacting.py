"""What walks that are made while they go can do: tables of docs/results/walking.md.

Run it with ``python -m tests.benchmarks.reacting [ROBOT [WHAT | FILE]...]``. WHAT is among the keys of :func:`tasks`,
or ``falls``; ``WHAT:20`` does it with 20 draws of robot and floor. A FILE of settings, such as
examples/loops/on_sensors.yaml, changes the stations. It takes all processors.
"""

import sys
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np

from simrob_drake import SimulationResult, load_station, simulate
from simrob_drake.base.frames import Vector
from simrob_drake.base.yaml_files import read_yaml
from simrob_drake.extensions.tuning.doubts import drawn
from simrob_drake.extensions.tuning.processes import Processes
from simrob_drake.results.record.walks import locomotion
from simrob_drake.robots.catalog import load_robot
from simrob_drake.stations.load import ONLY_ROBOT
from simrob_drake.walking import path
from tests.benchmarks.walking_falls import GUARDS, Outcome

SPEEDS = {"zjudancer": 0.25, "roid1": 0.2, "humanoid": 0.15, "yobotics": 0.5}  # m/s
LONG = {"zjudancer": 600, "roid1": 600, "humanoid": 600, "yobotics": 300}  # s
FACING = {"zjudancer": 90, "roid1": 0, "humanoid": -90, "yobotics": 0}
EIGHT = {"zjudancer": 0.15, "roid1": 0.1, "yobotics": 0.25}  # m/s
LOADS = {
    "zjudancer": 0.7,
    "roid1": 0.2,
    "humanoid": 0.3,
    "yobotics": 1.4,
}  # kg on the trunk, 0.15 of its mass
FELLS = {"zjudancer": 50.0, "roid1": 22.0}  # N, for 0.1 s: surely
HARD, MILD = (1.0, 1.5), (0.3, 0.45)  # times that; mild pushes are mostly withstood
COMMANDS, GAIT, PATH = "controllers.walk.commands", "controllers.walk.gait", "controllers.walk.path"
STEPS = {"kind": "steps", "height": 0.01, "size": 0.1, "length": 3}
FAR, FARTHEST = 0.5, 0.8  # of the way: at least, and in a long walk
BESIDE, TURNED = 0.15, (90.0, 10.0)  # from the path [m]; turned, and how far off that [deg]


def ahead(speed: float) -> list[dict[str, float]]:
    """Return commands to go ahead after a second."""
    return [{"time": 1.0, "ahead": speed}]


def tasks(robot: str) -> dict[str, dict[str, Any]]:
    """Return what is tried, as settings of a station, by name."""
    speed, facing = SPEEDS[robot], FACING[robot]
    slow = {COMMANDS: ahead(0.6 * speed), "duration": 20}
    burden = {
        "model": "parcel",
        "mass": LOADS[robot],
        "parent": ONLY_ROBOT,
        "frame": load_robot(robot).root,
    }
    found = {
        "long": {COMMANDS: ahead(speed), "duration": LONG[robot], "floor.size": 400},
        "blind": {COMMANDS: ahead(speed), GAIT: {"feedback": None}, "duration": 20},
        "finer": {COMMANDS: ahead(speed), "solver.max_step": 0.005, "duration": 20},
        "turn": {COMMANDS: [{"time": 1.0, "turn_deg": 20}, {"time": 5.5}], "duration": 8},
        "load": {COMMANDS: ahead(speed), "pieces.burden": burden, "duration": 20},
        "up": {**slow, "floor.incline_deg": 6, "floor.heading_deg": facing},
        "down": {**slow, "floor.incline_deg": 6, "floor.heading_deg": facing + 180},
        "across": {**slow, "floor.incline_deg": 6, "floor.heading_deg": facing + 90},
        "steps": {
            **slow,
            "floor.terrain": STEPS,
            "floor.size": 20,
            "contact": {"model": "hydroelastic_with_fallback"},
        },
    }
    if robot in EIGHT:
        way = eight(robot)
        length = path.Path(way.corners, way.rounding).length
        found["eight"] = {
            COMMANDS: [],
            PATH: way.model_dump(),
            "duration": float(np.ceil(length / way.speed + 6.0)),
        }
    return found


def eight(robot: str, long: float = 2.0) -> path.Waypoints:
    """Return the way round an eight that begins at its crossing, half as wide as it is long [m]."""
    angles = np.linspace(0.0, 2.0 * np.pi, 40, endpoint=False)
    turned = (
        np.exp(1j * np.deg2rad(FACING[robot] - 90))
        * long
        * (0.25 * np.sin(2.0 * angles) + 0.5j * np.sin(angles))
    )
    points = np.column_stack([turned.real, turned.imag]).tolist()
    return path.Waypoints.model_validate({"points": points, "laps": 1, "speed": EIGHT[robot]})


@dataclass(frozen=True)
class Walked:
    """How a robot walked.

    Attributes:
        holds: whether it did to the end what was asked for: half of the way ahead (0.8 of a long one), the turn
            within 10°, or the whole path within 0.15 m.
        figures: in words.
    """

    holds: bool
    figures: str

    @classmethod
    def of(cls, task: "Task", result: SimulationResult, seconds: float) -> "Walked":
        """Look at a run that took some time of a processor [s]."""
        robot, name = task.robot, task.name
        told, settings = locomotion(result), tasks(robot)[name]
        yaw, place, duration = (
            np.rad2deg(told.yaw),
            result.pose("base")[::20, :2] @ [1, 1j],
            settings["duration"],
        )
        way = float(np.abs(np.diff(place[::5])).sum())
        words = ["as thought" if task.seed is None else f"draw {task.seed}", result.message]
        words += [f"{told.ahead:.2f} m ahead", f"{told.drift:.2f} m aside", f"way {way:.1f} m"]
        if name == "turn":
            fits = abs(yaw - TURNED[0]) <= TURNED[1]
        elif name == "eight":
            curve = curve_of(eight(robot))
            whole = (
                way > FARTHEST * np.abs(np.diff(curve)).sum()
                and abs(place[-1] - curve[-1]) < BESIDE
            )
            off = float(np.abs(place[:, np.newaxis] - curve).min(axis=1).max())
            words.append(f"{off:.3f} m beside the path")
            fits = whole and off <= BESIDE
        else:
            (command,) = settings[COMMANDS]
            far = FARTHEST if name == "long" else FAR
            fits = told.ahead >= far * command["ahead"] * (duration - command["time"])
        words += [f"turned {yaw:.0f} deg", f"tilt {np.rad2deg(told.tilt):.1f} deg"]
        words.append(f"{result.times[-1] / seconds:.1f} x real time")
        return cls(bool(fits) and result.ending == "completed", " | ".join(words))


def curve_of(way: path.Waypoints) -> Vector:
    """Return places all along a path, shape (2000,), complex [m]."""
    line = path.Path(way.corners, way.rounding)
    return np.array([line.at(along).place for along in np.linspace(0.0, line.length, 2000)])


@dataclass(frozen=True)
class Task:
    """What one process is to do: a robot, what, of which draw, and what is changed."""

    robot: str
    name: str
    seed: int | None
    changes: Mapping[str, Any]

    def walked(self) -> Walked:
        """Walk."""
        config = load_station(
            f"{self.robot}_walking", settings := {**tasks(self.robot)[self.name], **self.changes}
        )
        if self.seed is not None:
            config = load_station(f"{self.robot}_walking", {**settings, **drawn(config, self.seed)})
        began = process_time()
        result = simulate(config, progress=False)
        return Walked.of(self, result, process_time() - began)

    def fallen(self) -> Outcome:
        """Walk, and be pushed, hard or mildly, with or without guards, as the name says."""
        assert self.seed is not None
        guards = GUARDS[self.robot] if "guards" in self.name else {}
        part = MILD if "mildly" in self.name else HARD
        draw = np.random.default_rng(self.seed)
        size, turn = FELLS[self.robot] * draw.uniform(*part), draw.uniform(-np.pi, np.pi)
        start = 3.0 + draw.uniform(0.0, 0.6)
        settings = {
            **{f"controllers.{name}": guard for name, guard in guards.items()},
            "forces.push": {
                "kind": "push",
                "start": start,
                "force": [size * np.cos(turn), size * np.sin(turn), 0.0],
            },
            "sensors.head": {"kind": "distance", "body": load_robot(self.robot).tools["head"]},
            "monitors": {},
            "duration": start + 3.0,
            "sample_rate": 500,
            **self.changes,
        }
        config = load_station(f"{self.robot}_walking", settings)
        config = load_station(f"{self.robot}_walking", {**settings, **drawn(config, self.seed)})
        return Outcome.of(simulate(config, progress=False), guards)

    def alarmed(self) -> bool | None:
        """Return whether a guard acts after a push that is withstood without it; None after one that is not."""
        return (
            None
            if self.fallen().fell
            else replace(self, name=f"{self.name}, with guards").fallen().acts
        )


def died(task: Task) -> Any:
    """Tell of a process that died."""
    raise RuntimeError(f"the process of {task} died")


def falls(pool: Processes, robot: str, seeds: int, changes: Mapping[str, Any]) -> None:
    """Print in how many falls the head meets the floor, without guards and with those of examples/loops.

    And after how many pushes that are withstood these act.
    """
    for label in ("without", "with guards"):
        asked = [Task(robot, label, seed, changes) for seed in range(seeds)]
        fell = [each for each in pool.outcomes(Task.fallen, asked, died) if each.fell]
        touches = sum(each.blow is not None for each in fell)
        print(
            robot, label, f"{len(fell)} of {seeds} fall, the head touches in {touches}", flush=True
        )
    mild = [Task(robot, "mildly", seed, changes) for seed in range(seeds)]
    acts = [act for act in pool.outcomes(Task.alarmed, mild, died) if act is not None]
    print(
        robot, f"guards act after {sum(acts)} of {len(acts)} pushes that are withstood", flush=True
    )


def walks(pool: Processes, robot: str, name: str, seeds: int, changes: Mapping[str, Any]) -> None:
    """Print how a robot walks, and how many of its draws hold."""
    asked = [Task(robot, name, seed, changes) for seed in range(seeds)] or [
        Task(robot, name, None, changes)
    ]
    holds = 0
    for told in pool.outcomes(Task.walked, asked, died):
        print(robot, name, told.figures + ("" if told.holds else " | fails"), flush=True)
        holds += told.holds
    print(f"{robot} {name}: {holds} of {len(asked)} hold", flush=True)


def main(robot: str = "zjudancer", *wanted: str) -> None:
    """Walk and print."""
    changes: dict[str, Any] = {}
    for file in [each for each in wanted if each.endswith(".yaml")]:
        changes |= read_yaml(Path(file))
    with Processes() as pool:
        for asked in [each for each in wanted if not each.endswith(".yaml")] or tasks(robot):
            name, _, seeds = asked.partition(":")
            if name == "falls":
                falls(pool, robot, int(seeds or 20), changes)
            else:
                walks(pool, robot, name, int(seeds or 0), changes)


if __name__ == "__main__":
    main(*sys.argv[1:])
