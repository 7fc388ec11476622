"""Every branch of arms, over 1000 random poses each: ``python -m tests.benchmarks.branches``.

Rates are poses a second of processor time. ``missed`` counts poses among whose postures the one that they were made of
is not; of seven axes the third is held at the angle that it had. Where ssik is installed, it stands beside.
"""

from __future__ import annotations

import importlib.util
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from simrob_drake.kinematics import AnalyticSolver, Chain, branches
from simrob_drake.robots.catalog import load_robot, load_robot_from_urdf
from tests.kinematics.conftest import IIWA, KR6, ODD, dh_urdf

POSES, BATCH, ANGLES = 1000, 10_000, 20
Found = list[np.ndarray]


def chains() -> dict[str, Chain]:
    """The arms: of the package, and of tables."""
    found = {
        name: Chain.of_robot(load_robot(name))
        for name in ("ur3", "ur5", "ur10", "irb120", "puma560")
    }
    with tempfile.TemporaryDirectory() as folder:
        for name, rows in (("kr6", KR6), ("iiwa", IIWA), ("odd", ODD)):
            (file := Path(folder) / f"{name}.urdf").write_text(dh_urdf(rows), encoding="utf-8")
            found[name] = Chain.of_robot(load_robot_from_urdf(file))
    return found


def every_branch() -> Table:
    """Rates, completeness and errors of our closed forms and search, and of ssik."""
    table = Table(
        "arm", "way", "poses/s", "postures a pose", "missed", "largest error", title="every branch"
    )
    draw = np.random.default_rng(0)
    for name, chain in chains().items():
        postures = draw.uniform(
            np.maximum(chain.lower, -np.pi), np.minimum(chain.upper, np.pi), (POSES, chain.size)
        )
        held = chain.names[2] if chain.size == 7 else None
        if held:
            postures[:, 2] = np.repeat(postures[:ANGLES, 2], POSES // ANGLES)
        targets = chain.forward(postures)

        def ours(chain=chain, targets=targets, postures=postures, held=held) -> Found:
            start = np.zeros(chain.size)
            if not held:
                return branches(chain, targets, start)
            groups = zip(*(np.split(rows, ANGLES) for rows in (targets, postures)), strict=True)
            return [
                rows
                for group, own in groups
                for rows in branches(chain, group, start, {held: own[0, 2]})
            ]

        _measure(table, name, "branches()", chain, targets, postures, ours)
        if importlib.util.find_spec("ssik") and name != "odd":  # it prepares that one for minutes
            _measure(
                table, name, "ssik", chain, targets, postures, _of_ssik(chain, targets, postures)
            )
        if chain.size == 6 and name != "odd":
            solver, many = AnalyticSolver(chain), np.tile(targets, (BATCH // POSES, 1, 1))
            began = time.process_time()
            solver.postures(many, np.zeros(6))
            rate = len(many) / (time.process_time() - began)
            table.add_row(name, "AnalyticSolver.postures()", f"{rate:.0f}", "", "", "")
    return table


def _measure(
    table: Table,
    name: str,
    way: str,
    chain: Chain,
    targets: np.ndarray,
    postures: np.ndarray,
    run: Callable[[], Found],
) -> None:
    began = time.process_time()
    found = run()
    seconds = time.process_time() - began
    near = [
        np.abs(np.exp(1j * rows) - np.exp(1j * q)).max(axis=1)
        for rows, q in zip(found, postures, strict=True)
    ]
    missed = sum(not (apart < 1e-4).any() for apart in near)
    error = max(
        np.abs(chain.forward(rows) - t).max()
        for rows, t in zip(found, targets, strict=True)
        if len(rows)
    )
    count = sum(map(len, found)) / len(found)
    table.add_row(
        name, way, f"{len(found) / seconds:.0f}", f"{count:.2f}", str(missed), f"{error:.0e}"
    )


def _of_ssik(chain: Chain, targets: np.ndarray, postures: np.ndarray) -> Callable[[], Found]:
    from ssik import Manipulator
    from ssik.solvers.jointlock import seven_r

    ways = np.vstack(
        [chain.points[:1], np.diff(chain.points, axis=0), chain.home[:3, 3] - chain.points[-1]]
    )
    arm = Manipulator.from_axes(chain.axes, ways)
    goals = targets.copy()
    goals[:, :3, :3] = targets[:, :3, :3] @ chain.home[:3, :3].T

    def solve(goal: np.ndarray, posture: np.ndarray) -> np.ndarray:
        if chain.size == 7:
            found = seven_r.solve(arm.kinbody, goal, lock_idx=2, lock_samples=[posture[2]])[0]
        else:
            found = arm.solve(goal, respect_limits=False, enumerate_windings=False)
        return np.reshape([solution.q for solution in found], (-1, chain.size))

    return lambda: [solve(goal, posture) for goal, posture in zip(goals, postures, strict=True)]


if __name__ == "__main__":
    Console().print(every_branch())
