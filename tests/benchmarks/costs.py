"""What a station's parts cost while it is stepped, and what a runner saves: ``python -m tests.benchmarks.costs``.

The humanoid stands for 3 s (``cenic``, servos in the actuators): solver and plant are then at their cheapest, so what
comes on top shows most.
"""

from __future__ import annotations

from time import perf_counter

import numpy as np
from rich.console import Console
from rich.table import Table

from simrob_drake import Runner, load_station, simulate
from tests.benchmarks.turns import in_turn

PARTS = {
    "feedforward": {"inputs": ["feedforward"]},
    "reference_velocity": {"inputs": ["reference_velocity"]},
    "ki 1e-9, the same motion": {"servo.ki": 1e-9},
    "ki 10": {"servo.ki": 10},
    "a fall monitor": {"monitors": {"fall": {"height": 0.2}}},
    "a push of 0.1 s, 0.1 N": {"forces": {"push": {"start": 1.0, "force": [0.1, 0, 0]}}},
}
GUARD = {
    "kind": "fall_guard",
    "height": 0.2,
    "posture_deg": {"HomDF": 90, "HomIF": 90},
    "priority": 1,
}
OBJECTIVE = {
    "kind": "objective",
    "measures": "base.z",
    "target": 0.446,
    "weights": {"RodD": -1, "RodI": -1},
    "kp": 1,
}
LOOPS = {
    "fall_guard": {"controllers": {"guard": GUARD}},
    "fall_guard at 50 Hz": {"controllers": {"guard": {**GUARD, "rate": 50}}},
    "objective": {"controllers": {"height": OBJECTIVE}},
    "both": {"controllers": {"height": OBJECTIVE, "guard": GUARD}},
}
SERVOS = {
    "feedforward: gravity": {"servo.feedforward": "gravity"},
    "feedforward: inverse_dynamics": {"servo.feedforward": "inverse_dynamics"},
    "law: cascade": {"servo.law": "cascade"},
    "law: computed_torque": {"servo.law": "computed_torque", "servo.kp": 400, "servo.kd": 40},
}
ARM = (
    {"solver.scheme": "radau3", "reference.kind": "move"},
    {"solver.scheme": "cenic", "solver.max_step": 0.01},
)
RUNS, SHORT = 100, 0.5  # s


def costs(
    parts: dict[str, dict] = PARTS,
    title: str = "what parts cost, standing",
    station: str = "humanoid_dynamic",
    **common: object,
) -> Table:
    """Stepping time with each part against that without."""
    table = Table(f"part of {station}", "ratio of stepping time", title=f"{title}, for 3 s")
    common = {"duration": 3.0, **common}
    runners = {
        name: Runner(load_station(station, common | part))
        for name, part in {"": {}, **parts}.items()
    }
    times = in_turn(
        {
            name: lambda runner=runner: runner.run().stepping_time
            for name, runner in runners.items()
        },
        25,
    )
    for name in parts:
        table.add_row(name, f"{np.median(times[name] / times['']):.3f}")
    return table


def runner() -> Table:
    """Runs of 0.5 s through a runner against as many calls of simulate()."""
    config = load_station("humanoid_dynamic", {"duration": SHORT})
    began = perf_counter()
    for _ in range(RUNS):
        simulate(config, progress=False)
    anew, once = perf_counter() - began, perf_counter()
    own = Runner(config)
    for _ in range(RUNS):
        own.run()
    table = Table(f"{RUNS} runs of {SHORT:g} s", "s", "ratio")
    table.add_row("simulate()", f"{anew:.2f}", "")
    table.add_row(
        "a runner", f"{perf_counter() - once:.2f}", f"{anew / (perf_counter() - once):.1f}"
    )
    return table


if __name__ == "__main__":
    console = Console(markup=False)
    console.print(costs())
    console.print(
        costs(
            LOOPS, "what loops cost, standing, against steps of 10 ms", **{"solver.max_step": 0.01}
        )
    )
    for solver in ARM:
        told = f"what servos cost that know the arm's model, under {solver['solver.scheme']}"
        console.print(costs(SERVOS, told, "irb120_dynamic", **{**ARM[0], **solver}))
    console.print(runner())
