"""Speed of programs: planning a line, taking a piece on a dynamic station, the cost of looking for collisions."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
from rich.table import Table

from simrob_drake import Arm, load_station

ROUNDS = 15
DOWN = [0.0, 0.0, np.pi]
HOME = [0.0, 0.0, 0.0, 0.0, np.pi / 2, 0.0]


def planning() -> Table:
    """A line of 200 points on the inclined table, with every solver, and what looking for collisions adds."""
    arm = Arm("irb120_workcell", tool="pencil")
    arm.move_j([0.05, 0.05, 0.02, *DOWN], wobj="inclined_table")
    goal, plan = [0.25, 0.2, 0.05], arm.plan
    table = Table(
        "a line of 200 points", "wall [ms]", "processor [ms]", title="planning, checks included"
    )
    for solver, check in (
        ("analytic", "limits"),
        ("numeric", "limits"),
        ("incremental", "limits"),
        ("analytic", "collision"),
    ):
        wall, processor = _times(
            lambda solver=solver, check=check: plan.move_l(
                goal, wobj="inclined_table", points=200, solver=solver, check=check
            )
        )
        table.add_row(f"{solver}, check {check}", f"{wall:.1f}", f"{processor:.1f}")
    return table


def attaching() -> Table:
    """To take a piece: the change itself, and until the first step of the next run, against the same run without."""
    table = Table(
        "station",
        "attach, wall [ms]",
        "processor [ms]",
        "a run of one step [ms]",
        title="attach, dynamic",
    )
    weight = {"model": "half_die", "parent": "world", "pose": [0.3, 0.0, 0.2, 0, 0, 0], "mass": 1.0}
    for name in ("irb120_dynamic", "irb120_workcell"):
        arm = Arm(load_station(name, {"mode": "dynamic", "pieces.weight": weight}))
        arm.wait(0.01)
        parents = iter(["robot", "world"] * (ROUNDS + 1))
        wall, processor = _times(
            lambda arm=arm, parents=parents: arm.cell.attach(
                "weight", next(parents), pose=[0.0] * 6
            )
        )
        step, _ = _times(lambda arm=arm: arm.wait(1e-3))
        table.add_row(name, f"{wall:.1f}", f"{processor:.1f}", f"{step:.1f}")
    return table


def _times(job: Callable[[], object]) -> tuple[float, float]:
    """Return the medians of wall-clock and processor time of a job [ms], after one that does not count."""
    figures = []
    for _ in range(ROUNDS + 1):
        wall, processor = time.perf_counter(), time.process_time()
        job()
        figures.append((time.perf_counter() - wall, time.process_time() - processor))
    medians = 1e3 * np.median(figures[1:], axis=0)
    return float(medians[0]), float(medians[1])
