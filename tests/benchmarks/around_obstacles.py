"""Moves around obstacles, 100 seeded queries in each of three cells: ``python -m tests.benchmarks.around_obstacles``.

Ends are free postures of chance. Every motion is looked at densely, its timing included, by signed distances of a plant
of its own. Seconds are those of processor time, the search, goals and timing together.
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from simrob_drake import Workcell, load_station
from simrob_drake.base.errors import SimrobError
from simrob_drake.kinematics.chain import Chain
from simrob_drake.parts.targets import owner_and_robot
from simrob_drake.programs.free_path import FreeSpace
from simrob_drake.programs.model import StationModel
from simrob_drake.programs.moves.move_free import MoveFree, plan_together
from simrob_drake.results.record.state import State

QUERIES, LOOKS, LOW = 100, 500, 0.05
SHELF = [
    *({"box": [0.3, 0.8, 0.02], "pose": [0, 0, z, 0, 0, 0]} for z in (0.15, 0.45, 0.75)),
    *({"box": [0.3, 0.02, 0.75], "pose": [0, y, 0.375, 0, 0, 0]} for y in (-0.4, 0.0, 0.4)),
]
POSTS = [{"cylinder": [0.02, 0.5], "pose": [0, 0, 0.25, 0, 0, 0]}]
GRIPPER = {"model": "gripper", "pose": [0, 0, 0, np.pi / 2, 0, 0]}
ARM = {"model": "irb120", "initial_deg": {"joint_5": 90}}


def cells(folder: Path) -> dict[str, Workcell]:
    """An arm before a shelf, one among posts, and two that share their space."""
    for name, shapes in (("shelf", SHELF), ("post", POSTS)):
        (folder / name).mkdir()
        (folder / name / "piece.yaml").write_text(f"shapes: {shapes}")

    def cell(robots: dict[str, object], pieces: dict[str, object]) -> Workcell:
        grippers = {f"{robot}_gripper": {**GRIPPER, "parent": robot} for robot in robots}
        station = {
            "mode": "kinematic",
            "robots": robots,
            "pieces": {**grippers, **pieces},
            "floor": {"size": 3},
        }
        (file := folder / "station.yaml").write_text(str(station))
        return Workcell(load_station(file))

    def standing(piece: str, x: float, y: float) -> dict[str, object]:
        return {
            "model": str(folder / piece / "piece.yaml"),
            "parent": "world",
            "pose": [x, y, 0, 0, 0, 0],
        }

    places = (0.3, 0.2), (0.4, -0.15), (0.1, 0.4), (0.1, -0.4)
    posts = {f"post_{number}": standing("post", *place) for number, place in enumerate(places)}
    left, right = (
        {**ARM, "base": [x, 0, 0, turn, 0, 0]} for x, turn in ((-0.35, 0.0), (0.35, np.pi))
    )
    return {
        "shelf": cell({"arm": ARM}, {"shelf": standing("shelf", 0.55, 0)}),
        "table with posts": cell({"arm": ARM}, posts),
        "two arms": cell({"left": left, "right": right}, {}),
    }


def deepest(
    model: StationModel, rows: dict[str, np.ndarray], made_so: set[tuple[str, str]]
) -> tuple[float, float]:
    """Return how deep things are in each other on a way [m]: of different owners, and links of one robot."""
    apart, own = 0.0, 0.0
    for look in range(len(next(iter(rows.values())))):
        model.place_robots({robot: row[look] for robot, row in rows.items()})
        for pair in model.query().ComputeSignedDistancePairwiseClosestPoints(0.0):
            (one, first), (two, second) = sorted(
                owner_and_robot(model.station, s) for s in (pair.id_A, pair.id_B)
            )
            if (first or second) and first != second:
                apart = max(apart, -pair.distance)
            elif first and (one, two) not in made_so:
                own = max(own, -pair.distance)
    return apart, own


def free(
    space: FreeSpace, chains: dict[str, Chain], draw: np.random.Generator
) -> dict[str, np.ndarray]:
    """Return free postures of chance, the tools over the floor."""
    while True:
        rows = {robot: draw.uniform(chain.lower, chain.upper) for robot, chain in chains.items()}
        low = min(chain.forward(rows[robot])[0, 2, 3] for robot, chain in chains.items())
        if low > LOW and not space.collisions(np.concatenate(list(rows.values())), 0.5):
            return rows


def begin_at(cell: Workcell, start: dict[str, np.ndarray]) -> None:
    """Have robots stand in postures."""
    cell.state = State(start, {robot: np.zeros_like(q) for robot, q in start.items()}, start)


def measured(cell: Workcell, queries: int) -> list[str]:
    """Return what came of queries: how many were solved, seconds, and the deepest of all looks."""
    robots, draw = list(cell.config.robots), np.random.default_rng(0)
    space, chains = cell.free_space(robots), {robot: cell.arm(robot).chain for robot in robots}
    looker, seconds, deep = StationModel(cell.config, collision=True), list[float](), [(0.0, 0.0)]

    for _ in range(queries):
        start, end = free(space, chains, draw), free(space, chains, draw)
        begin_at(cell, start)
        begin = time.process_time()
        try:
            moves = [MoveFree(joints=tuple(end[robot])) for robot in robots]
            plans = plan_together(moves, [cell.planning(robot) for robot in robots])
        except SimrobError as problem:
            print(problem)
            continue
        seconds.append(time.process_time() - begin)
        times = np.linspace(0, plans[0].duration, LOOKS)
        rows = {plan.robot: plan.postures(times) for plan in plans}
        deep.append(deepest(looker, rows, set(space.model.policy.excluded_pairs)))
    apart, own = 1e3 * np.max(deep, axis=0)
    quantiles = (f"{value:.2f}" for value in np.quantile(seconds, [0.5, 0.9, 1.0]))
    return [f"{len(seconds)} of {queries}", *quantiles, f"{apart:.2f}", f"{own:.2f}"]


def around_obstacles(queries: int = QUERIES) -> Table:
    """Share that is solved, seconds, and how deep anything was in anything."""
    headings = (
        "solved",
        "median [s]",
        "9 of 10 [s]",
        "worst [s]",
        "deepest [mm]",
        "of one robot [mm]",
    )
    table = Table("cell", *headings, title="moves around obstacles")
    with tempfile.TemporaryDirectory() as folder:
        for name, cell in cells(Path(folder)).items():
            table.add_row(name, *measured(cell, queries))
    return table


if __name__ == "__main__":
    Console().print(around_obstacles(*map(int, sys.argv[1:])))
