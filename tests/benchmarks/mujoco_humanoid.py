"""The humanoid's step sequence in MuJoCo beside our station: ``python -m tests.benchmarks.mujoco_humanoid``.

Both are given their fastest settings that stay within the same error of a converged run of their own: ours of a few
that stations use, MuJoCo's of some hundreds that are tried here. MuJoCo's stepping runs in C from the first step to the
last, and keeps the state of every step. Its converged run has contacts as stiff as ours, and steps of 10 µs.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from rich.console import Console
from rich.table import Table

from tests.benchmarks.stepping import SAMPLES, Motion, run_station, stepping_station
from tests.benchmarks.turns import in_turn

if TYPE_CHECKING:
    from tests.benchmarks.mujoco_rollout import Settings

CONVERGED = {"solver.max_step": 5e-4, "solver.accuracy": 1e-5}
OURS = {
    "humanoid_dynamic (cenic 20 ms)": {},
    "the same, vector": {"servo.realization": "vector"},
    "the same, per_joint": {"servo.realization": "per_joint"},
    "cenic 25 ms": {"solver.max_step": 0.025},
    "cenic 10 ms": {"solver.max_step": 0.01},
    "cenic, fixed steps of 12.5 ms": {"solver.max_step": 0.0125, "solver.error_control": False},
    "lagged 5 ms": {"solver": {"kind": "discrete", "scheme": "lagged", "time_step": 5e-3}},
    "lagged 10 ms": {"solver": {"kind": "discrete", "scheme": "lagged", "time_step": 1e-2}},
}
FINALISTS = 3  # of MuJoCo's settings, timed in turn with ours
TURN = 0.1  # s: about what ours takes; shorter runs of MuJoCo are repeated as long
ROUNDS = 7
FALLEN = 0.1  # m: no run on its feet is so far from the converged one


def beside_mujoco() -> Table:
    """Return speeds and errors of both simulators, or a table that says that MuJoCo is missing."""
    title = "step sequence of the humanoid, 6 s, within 2 mm and 0.01 rad"
    if importlib.util.find_spec("mujoco") is None:
        missing = Table(title=title)
        missing.add_row("mujoco is not installed; the extra dev brings it")
        return missing
    # only now: it imports mujoco
    from tests.benchmarks.mujoco_rollout import (
        MujocoHumanoid,
        Settings,
        candidates,
    )

    humanoid = MujocoHumanoid(stepping_station())
    ours = run_station(stepping_station(CONVERGED))
    contacts = [humanoid.contact_like_drake(impedance) for impedance in (0.9, 0.5, 0.99)]
    theirs = humanoid.run(Settings(1e-5, contacts[0], 30.0, integrator="implicitfast"))
    tried = [(settings, humanoid.run(settings)) for settings in candidates(contacts)]
    runs = {
        name: (ours, partial(run_station, stepping_station(overrides)))
        for name, overrides in OURS.items()
    }
    for settings, motion in _finalists(tried, theirs):
        repeats = max(1, round(TURN / motion.stepping))
        runs[f"MuJoCo {settings}"] = theirs, partial(humanoid.run, settings, repeats)
    table = Table(
        *_HEADINGS, title=title, caption=_caption(ours, theirs, [motion for _, motion in tried])
    )
    motions = _timed({name: run for name, (_, run) in runs.items()})
    first = motions[next(iter(OURS))]
    for name, (converged, _) in runs.items():
        table.add_row(name, *_figures(motions[name], first, converged))
    return table


_HEADINGS = ("settings", "× real time", "with signals", "ratio", "base, mm", "joints, rad")


def _finalists(
    tried: list[tuple[Settings, Motion]], converged: Motion
) -> list[tuple[Settings, Motion]]:
    """Return the fastest settings within the bounds, then the fastest such of every other integrator."""
    within = sorted(
        (pair for pair in tried if pair[1].within(converged)), key=lambda pair: pair[1].stepping
    )
    first = {pair[0].integrator: pair for pair in reversed(within)}
    chosen = within[:FINALISTS]
    return chosen + [
        pair for pair in first.values() if pair[0] not in [settings for settings, _ in chosen]
    ]


def _timed(runs: dict[str, Callable[[], Motion]]) -> dict[str, list[Motion]]:
    """Run all in turn and return the motions of each."""
    motions: dict[str, list[Motion]] = {name: [] for name in runs}

    def kept(name: str) -> float:
        motions[name].append(runs[name]())
        return motions[name][-1].stepping

    in_turn({name: partial(kept, name) for name in runs}, ROUNDS)
    return {name: counted for name, (_, *counted) in motions.items()}


def _figures(motions: list[Motion], first: list[Motion], converged: Motion) -> list[str]:
    stepping, with_signals = (
        SAMPLES[-1] / np.median([getattr(motion, part) for motion in motions])
        for part in ("stepping", "with_signals")
    )
    ratio = np.median(
        [one.stepping / other.stepping for one, other in zip(first, motions, strict=True)]
    )
    base, joints = motions[-1].off(converged)
    far = "" if motions[-1].within(converged) else ", too far"
    signals = "" if stepping == with_signals else f"{with_signals:.1f}"
    return [f"{stepping:.1f}", signals, f"{ratio:.2f}", f"{1e3 * base:.2f}", f"{joints:.4f}{far}"]


def _caption(ours: Motion, theirs: Motion, tried: list[Motion]) -> str:
    base, joints = ours.off(theirs)
    within = sum(motion.within(theirs) for motion in tried)
    fallen = sum(not motion.off(theirs)[0] < FALLEN for motion in tried)
    ends = ", ".join(
        f"{name} y {motion.base[-1, 1]:.4f} m, tilt {motion.tilt_deg:.2f}°"
        for name, motion in (("ours", ours), ("MuJoCo's", theirs))
    )
    return (
        f"Converged runs end at {ends}; they are up to {1e3 * base:.2f} mm and {joints:.4f} rad apart. Of {len(tried)} "
        f"settings of MuJoCo {within} are within the bounds, {fallen} fall."
    )


def main() -> None:
    """Print the table."""
    Console(markup=False).print(beside_mujoco())


if __name__ == "__main__":
    main()
