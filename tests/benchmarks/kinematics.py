"""Measure the solvers of inverse kinematics on the IRB120: ``python -m tests.benchmarks.kinematics``.

Rates are poses a second of processor time, the median of several rounds in turn. Where robotics-toolbox-python is
installed, its numeric solver (in C++) stands beside ours, on the same poses, starts, limits and tolerance.
"""

from __future__ import annotations

import importlib.util
import time
from collections.abc import Callable

import numpy as np
from rich.console import Console
from rich.table import Table
from scipy.optimize import least_squares

from simrob_drake.kinematics import Chain, make_solver, pose_errors
from simrob_drake.robots.catalog import load_robot

HOME = np.deg2rad([0.0, 0.0, 0.0, 0.0, 90.0, 0.0])
BATCH = 10_000
POINTS = 200
ROUNDS = 7
TOLERANCE = 1e-6  # m; ours asks for 1e-5 rad besides, the toolbox adds both into one figure


def inverse_kinematics() -> Table:
    """Rates of the solvers: in batches, along a line from the last solution, and over random poses one by one."""
    chain = Chain.of_robot(load_robot("irb120"))
    targets = chain.forward(
        np.random.default_rng(0).uniform(chain.lower, chain.upper, (BATCH, chain.size))
    )
    line = np.repeat(chain.forward(HOME), POINTS, axis=0)
    line[:, :3, 3] += np.linspace([0.0, -0.2, 0.0], [0.05, 0.2, -0.1], POINTS)
    homes = np.tile(HOME, (BATCH, 1))
    solvers = {
        name: make_solver(name, chain)
        for name in ("analytic", "numeric", "incremental", "constrained")
    }
    first = solvers["analytic"].solve(line[0], HOME).positions[0]
    jobs: dict[str, tuple[int, Callable[[], float]]] = {}
    for name in ("analytic", "numeric"):
        solver = solvers[name]
        jobs[f"{name}: batch, each from home"] = (
            BATCH,
            lambda s=solver: s.solve(targets, homes).reached.mean(),
        )
    jobs["analytic: batch in order"] = (
        BATCH,
        lambda s=solvers["analytic"]: s.solve(targets, HOME).reached.mean(),
    )
    for name, solver in solvers.items():
        jobs[f"{name}: along a line"] = POINTS, lambda s=solver: s.solve(line, first).reached.mean()
    jobs["scipy least_squares: along a line"] = POINTS, lambda: by_scipy(chain, line, first)
    jobs["numeric: random, one by one"] = (
        500,
        lambda s=solvers["numeric"]: s.solve(targets[:500], HOME).reached.mean(),
    )
    if importlib.util.find_spec("roboticstoolbox"):
        toolbox = toolbox_solver(chain)
        jobs["toolbox ik_LM: along a line"] = POINTS, lambda: toolbox(line, first)
        jobs["toolbox ik_LM: random, one by one"] = 500, lambda: toolbox(targets[:500], HOME)
    table = Table(
        "solver", "poses/s", "µs a pose", "reached", title="inverse kinematics of the irb120"
    )
    seconds: dict[str, list[float]] = {job: [] for job in jobs}
    reached = {}
    for _ in range(ROUNDS):
        for job, (_, run) in jobs.items():
            began = time.process_time()
            reached[job] = run()
            seconds[job].append(time.process_time() - began)
    for job, (count, _) in jobs.items():
        each = float(np.median(seconds[job])) / count
        table.add_row(job, f"{1 / each:.0f}", f"{1e6 * each:.1f}", f"{100 * reached[job]:.2f} %")
    return table


def by_scipy(chain: Chain, targets: np.ndarray, start: np.ndarray) -> float:
    """Solve each target from the last solution with scipy's bounded least squares, and return how many are reached."""
    reached, last = [], start
    for target in targets:
        fit = least_squares(
            lambda q, target=target: pose_errors(target[np.newaxis], chain.forward(q))[0],
            last,
            lambda q: -chain.jacobian(q)[0],
            bounds=(chain.lower, chain.upper),
            method="dogbox",
        )
        reached.append(np.linalg.norm(fit.fun) < TOLERANCE)
        last = fit.x
    return float(np.mean(reached))


def toolbox_solver(chain: Chain) -> Callable[[np.ndarray, np.ndarray], float]:
    """Return the toolbox' numeric solver for the same arm, each target from the last solution."""
    from roboticstoolbox import ET  # not a dependency

    limits = list(zip(chain.lower, chain.upper, strict=True))
    arm = (
        ET.Rz(qlim=limits[0])
        * ET.tz(0.29)
        * ET.Ry(qlim=limits[1])
        * ET.tz(0.27)
        * ET.Ry(qlim=limits[2])
        * ET.tz(0.07)
        * ET.Rx(qlim=limits[3])
        * ET.tx(0.302)
        * ET.Ry(qlim=limits[4])
        * ET.tx(0.072)
        * ET.Rx(qlim=limits[5])
        * ET.Ry(np.pi / 2)
    )
    assert np.abs(arm.fkine(HOME + 0.1).A - chain.forward(HOME + 0.1)[0]).max() < 1e-12

    def solve(targets: np.ndarray, start: np.ndarray) -> float:
        last, reached = start, []
        for target in targets:
            found = arm.ik_LM(target, q0=last, tol=TOLERANCE**2 / 2, joint_limits=True)
            reached.append(found.success)
            last = found.q if found.success else last
        return float(np.mean(reached))

    return solve


def main() -> None:
    """Print the table."""
    Console().print(inverse_kinematics())


if __name__ == "__main__":
    main()
