"""Ways around obstacles in the least time beside S-curves on the same ways: ``python -m tests.benchmarks.least_time``.

The S-curve is that of ``profile: s_curve``, as quick as the limits of speed and acceleration let it; and the same made
quicker or slower until it takes all of one limit of speed, acceleration or torque. Torques are by inverse dynamics.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from simrob_drake import Arm, Workcell
from simrob_drake.programs.moves.move_free import MoveFree, plan_together
from simrob_drake.programs.plan import Plan
from tests.benchmarks.around_obstacles import begin_at, cells, free

QUERIES, LOOKS, HALVINGS = 50, 1000, 30


def share(arm: Arm, plan: Plan, slower: float = 1.0) -> float:
    """Return the largest part of a limit of speed, acceleration or torque that a plan takes, done so much slower."""
    robot = arm.cell.robot(arm.name)
    q, v, a = plan.motion(np.linspace(0, plan.duration, LOOKS))
    v, a = v / slower, a / slower**2
    limits = robot.model.speed_limits, robot.model.accelerations, robot.gains.torque_limit
    taken = v, a, arm.inverse_dynamics(q, v, a)
    return max(float(np.abs(rows / limit).max()) for rows, limit in zip(taken, limits, strict=True))


def shortest(arm: Arm, plan: Plan) -> float:
    """Return the least time in which a plan's profile can be done within all limits [s]."""
    low, high = 1e-2, 1e2
    for _ in range(HALVINGS):
        middle = float(np.sqrt(low * high))
        low, high = (low, middle) if share(arm, plan, middle) <= 1 else (middle, high)
    return plan.duration * high


def measured(cell: Workcell, queries: int) -> list[str]:
    """Return the medians of the parts of both S-curves' times that ways take, and the most of a limit that is taken."""
    (robot,), draw = cell.config.robots, np.random.default_rng(0)
    arm, space, parts, most = (
        cell.arm(robot),
        cell.free_space([robot]),
        list[tuple[float, float]](),
        0.0,
    )
    for _ in range(queries):
        start, end = (free(space, {robot: arm.chain}, draw) for _ in range(2))
        begin_at(cell, start)
        moves = [
            MoveFree(joints=tuple(end[robot]), profile=profile)
            for profile in ("time_optimal", "s_curve")
        ]
        quick, curve = (plan_together([move], [cell.planning(robot)])[0] for move in moves)
        parts.append((quick.duration / curve.duration, quick.duration / shortest(arm, curve)))
        most = max(most, share(arm, quick))
    return [*(f"{part:.2f}" for part in np.median(parts, axis=0)), f"{most:.4f}"]


def least_time(queries: int = QUERIES) -> Table:
    """Parts of the time of S-curves that ways in the least time take."""
    headings = "part of the S-curve", "of one at the limit", "most of a limit"
    table = Table("cell", *headings, title=f"least time, medians of {queries} ways")
    with tempfile.TemporaryDirectory() as folder:
        for name, cell in cells(Path(folder)).items():
            if len(cell.config.robots) == 1:
                table.add_row(name, *measured(cell, queries))
    return table


if __name__ == "__main__":
    Console().print(least_time(*map(int, sys.argv[1:])))
