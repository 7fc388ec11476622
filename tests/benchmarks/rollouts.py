"""Roll-outs a second of sweeps and searches, side by side, and the memory of a worker: for docs/results/search.md.

Run it with ``python -m tests.benchmarks.rollouts [RUNS]``. Beside the time on the clock stands the processors' own, of
all processes that work: on a machine that others use, too, the clock tells more of them than of this.
"""

import sys
from collections.abc import Callable
from contextlib import ExitStack
from time import perf_counter

import psutil
from distributed import LocalCluster
from rich.console import Console
from rich.table import Table

from simrob_drake.extensions.tuning import scene
from simrob_drake.extensions.tuning.journal import killed, made
from simrob_drake.extensions.tuning.processes import Cluster, Engine, Processes
from simrob_drake.extensions.tuning.rollout import Case

STATION, SHORT = "humanoid_dynamic", {"duration": 0.5}
ROUNDS = 3
MANY = 2000  # roll-outs of a worker whose memory is looked at


def cases(count: int, first: int = 1) -> list[Case]:
    """Return runs that differ in a push alone, as those of a study under pushes do."""
    push = {"kind": "push", "start": 0.1}
    return [
        Case(number, STATION, {**SHORT, "forces.shove": {**push, "force": [1e-3 * number, 0, 0]}})
        for number in range(first, first + count)
    ]


def rebuilding(case: Case) -> object:
    """Make a run without what was built before."""
    scene._KEPT.clear()
    return made(case)


def processor_time() -> float:
    """Return the processors' time of this process and all that it has begun and that live [s]."""
    me = psutil.Process()
    times = [process.cpu_times() for process in [me, *me.children(recursive=True)]]
    return sum(time.user + time.system for time in times)


def timed(work: Callable[[], object]) -> tuple[float, float]:
    """Return the time on the clock and the processors' time that work takes [s]."""
    began, used = perf_counter(), processor_time()
    work()
    return perf_counter() - began, processor_time() - used


def rates(count: int) -> Table:
    """Return the runs a second of each way, all in turn."""
    with ExitStack() as stack:
        local = LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None)
        engines: dict[str, Engine] = {
            "one process": Processes(1),
            "two processes": Processes(2),
            "a Dask cluster of two": Cluster(stack.enter_context(local).scheduler_address),
        }
        for engine in engines.values():
            stack.enter_context(engine)

        def made_by(engine: Engine) -> Callable[[], object]:
            return lambda: list(engine.outcomes(made, cases(count), killed))

        ways: dict[str, Callable[[], object]] = {
            "rebuilding, in this process": lambda: [rebuilding(case) for case in cases(count // 4)],
            "a runner, in this process": lambda: [made(case) for case in cases(count // 4)],
            **{name: made_by(engine) for name, engine in engines.items()},
        }
        counts = {name: count // 4 if "this" in name else count for name in ways}
        for work in ways.values():  # processes begin, and build
            work()
        found: dict[str, list[tuple[float, float]]] = {name: [] for name in ways}
        for _ in range(ROUNDS):
            for name, work in ways.items():
                found[name].append(timed(work))
    table = Table(
        "runs of 0.5 s of the humanoid", "a second", "a second of a processor", title="roll-outs"
    )
    for name, times in found.items():
        clock, used = (min(column) for column in zip(*times, strict=True))
        table.add_row(name, f"{counts[name] / clock:.1f}", f"{counts[name] / used:.1f}")
    return table


def memory() -> Table:
    """Return what a process holds after many runs: with one station, and with another one each time."""
    table = Table(f"memory of a process after {MANY} roll-outs", "MB at first", "MB then")
    me = psutil.Process()
    gains = [
        Case(n, "irb120_dynamic", {"duration": 0.05, "servo.kp": 500.0 + n}) for n in range(MANY)
    ]
    for name, all_of_them in {"other pushes": cases(MANY), "other gains": gains}.items():
        for case in all_of_them[:50]:
            made(case)
        before = me.memory_info().rss
        for case in all_of_them[50:]:
            made(case)
        table.add_row(name, f"{before / 1e6:.0f}", f"{me.memory_info().rss / 1e6:.0f}")
    return table


if __name__ == "__main__":
    console = Console(markup=False)
    console.print(rates(int(sys.argv[1]) if len(sys.argv) > 1 else 200))
    console.print(memory())
