"""Where runs are made: processes of this machine, or a Dask cluster of others; what dies takes only what killed it."""

import logging
import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from itertools import islice
from multiprocessing import active_children, get_context, parent_process
from multiprocessing.connection import wait as wait_for
from signal import SIG_BLOCK, SIG_SETMASK, SIGINT, pthread_sigmask
from threading import Thread
from typing import Any, Self, TypeVar

from simrob_drake.base.errors import InvalidParameter, SimrobError
from simrob_drake.base.extras import importing_extra
from simrob_drake.base.messages import compound, join_texts, message

Task = TypeVar("Task")
Outcome = TypeVar("Outcome")
_PACKAGES = (
    "python",
    "simrob-drake",
    "drake",
    "numpy",
    "mujoco",
    "dask",
    "distributed",
    "cloudpickle",
)
_AHEAD = 2  # tasks for each process of the cluster, so that none is idle
_PATIENCE = 10  # s for the scheduler to answer


class Cluster:
    """The workers of a Dask cluster; to be used in a ``with``."""

    def __init__(self, scheduler: str) -> None:
        """Look for a cluster by its address, such as ``tcp://10.0.0.1:8786``, and at the versions of all there.

        Raises SimrobError: the extra ``tune`` is missing, or versions differ from those here; InvalidParameter: no
        scheduler there, or one without workers.
        """
        self._scheduler = scheduler
        with importing_extra(message("tuning.a_cluster", "a cluster"), "tune"):
            from distributed import Client
        for name in (
            "distributed",
            "distributed.client",
        ):  # of a scheduler that is lost one line is said
            logging.getLogger(name).setLevel(logging.CRITICAL)
        try:
            self._client = Client(scheduler, timeout=_PATIENCE)
            found: Any = self._client.get_versions(packages=_PACKAGES[1:])
        except (OSError, ValueError) as problem:
            raise InvalidParameter(
                "--scheduler",
                scheduler,
                message("tuning.address_of_dask", "the address of a Dask that answers"),
            ) from problem
        try:
            _check(scheduler, found)
        except SimrobError:
            self._client.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        """Leave the cluster to others."""
        self._client.close()

    def outcomes(
        self,
        work: Callable[[Task], Outcome],
        tasks: Iterable[Task],
        died: Callable[[Task], Outcome],
    ) -> Iterator[Outcome]:
        """Yield what becomes of each task, as it comes; as :meth:`Processes.outcomes` does.

        Dask gives the tasks of a worker that is gone to others; one that several were working on when they died counts
        as what killed them. Raises SimrobError: the scheduler went away.
        """
        from distributed import KilledWorker, as_completed
        from distributed.client import ClosedClientError
        from distributed.comm.core import CommClosedError

        waiting, under_way, done = iter(tasks), dict[Any, Task](), as_completed()

        def submit() -> None:
            for task in islice(
                waiting, max(_AHEAD * len(self._client.nthreads()) - len(under_way), 1)
            ):
                future = self._client.submit(work, task, pure=False)
                under_way[future] = task
                done.add(future)

        try:
            submit()
            for future in done:
                task = under_way.pop(future)
                try:
                    outcome = future.result()
                except KilledWorker:
                    outcome = died(task)
                submit()
                yield outcome
        except (CancelledError, ClosedClientError, CommClosedError) as problem:
            text = message(
                "tuning.scheduler_is_gone",
                "the scheduler {scheduler} is gone; what is done is kept, go on with another one",
                scheduler=self._scheduler,
            )
            raise SimrobError(text) from problem


def _check(scheduler: str, found: Any) -> None:
    """Check a cluster's workers and all versions there; raises InvalidParameter: no workers; SimrobError: a version."""
    if not found["workers"]:
        raise InvalidParameter(
            "--scheduler",
            message("tuning.without_workers", "{scheduler}, without workers", scheduler=scheduler),
            message("tuning.scheduler_with_workers", "a scheduler that has some"),
        )
    here = {
        name: version
        for name, version in found["client"]["packages"].items()
        if name in _PACKAGES and version
    }
    others = {"scheduler": found["scheduler"]} | {
        message("tuning.worker", "worker {name}", name=name): one
        for name, one in found["workers"].items()
    }
    for who, one in others.items():
        off = [name for name, version in here.items() if one["packages"][name] != version]
        if off:
            absent = message("tuning.not_at_all", "not at all")
            has = join_texts(
                compound("{name} {version}", name=name, version=one["packages"][name] or absent)
                for name in off
            )
            due = ", ".join(f"{name} {here[name]}" for name in off)
            raise SimrobError(
                message(
                    "tuning.other_versions",
                    "the {who} of {scheduler} has {has}; it must have {due}, as this computer",
                    who=who,
                    scheduler=scheduler,
                    has=has,
                    due=due,
                )
            )


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
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        """Let the processes end; what they have not begun is not done, and after an interrupt nothing is finished."""
        self._pool.shutdown(wait=False, cancel_futures=True)
        for process in active_children() if kind is not None else ():
            process.terminate()

    def outcomes(
        self,
        work: Callable[[Task], Outcome],
        tasks: Iterable[Task],
        died: Callable[[Task], Outcome],
    ) -> Iterator[Outcome]:
        """Yield what becomes of each task, as it comes; no more are under way than there are processes.

        Where a process dies, all that was under way is tried again, one after the other in processes of their own.
        ``work`` is a function of a module, for another process to import; ``died`` gives what becomes of a task whose
        own process died.
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

    def _alone(
        self, work: Callable[[Task], Outcome], task: Task, died: Callable[[Task], Outcome]
    ) -> Outcome:
        with self._fresh(1) as pool:
            try:
                return pool.submit(work, task).result()
            except BrokenProcessPool:
                return died(task)

    @staticmethod
    def _fresh(workers: int) -> ProcessPoolExecutor:
        context = get_context("spawn")
        return ProcessPoolExecutor(
            workers, context, initializer=_die_with_parent, max_tasks_per_child=_TASKS
        )


@contextmanager
def _unheard() -> Iterator[None]:
    """Start processes that hear no Ctrl-C: it is for this one, which ends them; till then it waits for the user's."""
    # which they inherit, and the thread that starts more of them
    before = pthread_sigmask(SIG_BLOCK, {SIGINT})
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


Engine = Processes | Cluster


def engine(*, workers: int | None = None, scheduler: str | None = None) -> Engine:
    """Return a Dask scheduler's workers, else ``workers`` processes, one a processor; raises SimrobError: none."""
    return Cluster(scheduler) if scheduler else Processes(workers)
