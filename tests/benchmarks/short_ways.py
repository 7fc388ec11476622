"""Ways around obstacles, optimised and rounded alone: ``python -m tests.benchmarks.short_ways [QUERIES] [SEED]``.

Looked at are the queries, of those in three cells, whose way has corners; the others are straight in the joints.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path
from unittest.mock import patch

import numpy as np
from rich.console import Console
from rich.table import Table

from simrob_drake import Workcell
from simrob_drake.programs.moves import move_free
from simrob_drake.programs.moves.move_free import MoveFree, plan_together
from tests.benchmarks.around_obstacles import begin_at, cells, free

QUERIES, PROFILES = 50, ("smooth", "s_curve", "time_optimal")


def measured(cell: Workcell, queries: int, seed: int) -> list[str]:
    """Return how many ways have corners, how many were optimised, and the medians of the part of the time they take."""
    robots, draw, optimised = list(cell.config.robots), np.random.default_rng(seed), list[bool]()
    space, chains = cell.free_space(robots), {robot: cell.arm(robot).chain for robot in robots}
    parts: dict[str, list[float]] = {profile: [] for profile in PROFILES}
    known = move_free.shortened

    def shortened(*arguments: object) -> object:
        optimised.append((found := known(*arguments)) is not None)
        return found

    def duration(profile: str, by: object) -> float:
        moves = [MoveFree(joints=tuple(end[robot]), profile=profile) for robot in robots]
        with patch.object(move_free, "shortened", by):
            return plan_together(moves, [cell.planning(robot) for robot in robots])[0].duration

    for _ in range(queries):
        start, end = free(space, chains, draw), free(space, chains, draw)
        begin_at(cell, start)
        for profile in PROFILES:
            before, short = len(optimised), duration(profile, shortened)
            if len(optimised) > before:
                parts[profile].append(short / duration(profile, lambda *_: None))
    counts = len(optimised) // len(PROFILES), sum(optimised) // len(PROFILES)
    return [*map(str, counts), *(f"{np.median(own):.2f}" for own in parts.values())]


def short_ways(queries: int = QUERIES, seed: int = 0) -> Table:
    """Parts of the time of rounded ways that optimised ones take."""
    table = Table(
        "cell",
        "with corners",
        "optimised",
        *PROFILES,
        title=f"part of the time, of {queries} queries",
    )
    with tempfile.TemporaryDirectory() as folder:
        for name, cell in cells(Path(folder)).items():
            table.add_row(name, *measured(cell, queries, seed))
    return table


if __name__ == "__main__":
    Console().print(short_ways(*map(int, sys.argv[1:])))
