"""Work on many processes of this machine; one that dies takes nothing with it but what killed it."""

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing import active_children, get_context, parent_process
from multiprocessing.connection import wait as wait_for
from signal import SIG_BLOCK, SIG_SETMASK, SIGINT, pthread_sigmask
from threading import Thread
from typing import Self, TypeVar

Task = TypeVar("Task")
Outcome = TypeVar("Outcome")
_TASKS = 2000
"""After how many a process is replaced by a fresh one, which takes as long as some hundred short runs to begin."""


def usable_processors() -> int:
    """Return how many processors this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class Processes:
    """Processes of this machine, started where there is work and kept for more of it; to be used in a ``with``."""

    def __init__(self, workers: int | None = None) -> None:
        """Take so many processes; as many as there are processors unless given."""
        self._workers = workers or usable_processors()
        self._pool = self._fresh(self._workers)

    def __enter__(self) -> Self:
        """Return itself."""
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        """Let the processes end; what they have not begun is not done, and after an interrupt nothing is finished."""
        self._pool.shutdown(wait=False, cancel_futures=True)
        for process in active_children() if kind is not None else ():
            process.terminate()

    def outcomes(
        self, work: Callable[[Task], Outcome], tasks: Iterable[Task], died: Callable[[Task], Outcome]
    ) -> Iterator[Outcome]:
        """Yield what becomes of each task, as it comes; no more are under way than there are processes.

        Where a process dies, all that was under way is tried again, one after the other in processes of their own.

        Args:
            work: a function of a module, for another process to import.
            tasks: what it is given.
            died: what becomes of a task whose own process died.
        """
        waiting = deque(tasks)
        while waiting:
            under_way: dict[Future[Outcome], Task] = {}
            try:
                while waiting or under_way:
                    while waiting and len(under_way) < self._workers:
                        with _unheard():
                            under_way[self._pool.submit(work, waiting[0])] = waiting[0]
                        waiting.popleft()
                    for future in wait(under_way, return_when=FIRST_COMPLETED).done:
                        outcome = future.result()
                        del under_way[future]
                        yield outcome
            except BrokenProcessPool:
                self._pool = self._fresh(self._workers)
                for task in under_way.values():
                    yield self._alone(work, task, died)

    def _alone(self, work: Callable[[Task], Outcome], task: Task, died: Callable[[Task], Outcome]) -> Outcome:
        with self._fresh(1) as pool:
            try:
                return pool.submit(work, task).result()
            except BrokenProcessPool:
                return died(task)

    @staticmethod
    def _fresh(workers: int) -> ProcessPoolExecutor:
        context = get_context("spawn")
        return ProcessPoolExecutor(workers, context, initializer=_die_with_parent, max_tasks_per_child=_TASKS)


@contextmanager
def _unheard() -> Iterator[None]:
    """Start processes that hear no Ctrl-C: it is for this one, which ends them; till then it waits for the user's."""
    before = pthread_sigmask(SIG_BLOCK, {SIGINT})  # which they inherit, and the thread that starts more of them
    try:
        yield
    finally:
        pthread_sigmask(SIG_SETMASK, before)


def _die_with_parent() -> None:
    """End this process once the one that began it is gone, however that ended: nobody else would tell it."""
    parent = parent_process()
    assert parent is not None  # it is a worker

    def watch() -> None:
        wait_for([parent.sentinel])
        os._exit(1)

    Thread(target=watch, daemon=True).start()
