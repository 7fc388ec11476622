"""Work on many processes of this machine; one that dies takes nothing with it but what killed it."""

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import get_context
from typing import TypeVar

Task = TypeVar("Task")
Outcome = TypeVar("Outcome")
_TASKS = 200
"""After how many a process is replaced by a fresh one: whatever it keeps goes with it."""


def usable_processors() -> int:
    """Return how many processors this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def outcomes(
    work: Callable[[Task], Outcome], tasks: Iterable[Task], died: Callable[[Task], Outcome], *, workers: int
) -> Iterator[Outcome]:
    """Yield what becomes of each task, as it comes; at any time there is no more under way than there are processes.

    Where a process dies, all that was under way is tried again, one after the other in processes of their own.

    Args:
        work: a function of a module, for another process to import.
        tasks: what it is given.
        died: what becomes of a task whose own process died.
        workers: how many processes.
    """
    waiting, suspects = deque(tasks), deque[Task]()
    while waiting or suspects:
        alone = bool(suspects)
        source, together = (suspects, 1) if alone else (waiting, workers)
        under_way: dict[Future[Outcome], Task] = {}
        with ProcessPoolExecutor(together, mp_context=get_context("spawn"), max_tasks_per_child=_TASKS) as pool:
            try:
                while source or under_way:
                    while source and len(under_way) < together:
                        task = source.popleft()
                        under_way[pool.submit(work, task)] = task
                    done, _ = wait(under_way, return_when=FIRST_COMPLETED)
                    for future in done:
                        outcome = future.result()
                        del under_way[future]
                        yield outcome
            except BrokenProcessPool:
                if alone:
                    yield from map(died, under_way.values())
                else:
                    suspects.extend(under_way.values())
            finally:
                pool.shutdown(wait=False, cancel_futures=True)
