"""Work on a Dask cluster: other machines, with the same versions of what counts."""

import logging
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import CancelledError
from itertools import islice
from typing import Any, Self, TypeVar

from simrob_drake.errors import InvalidParameter, SimrobError
from simrob_drake.extras import needed

Task = TypeVar("Task")
Outcome = TypeVar("Outcome")
_PACKAGES = ("python", "simrob-drake", "drake", "numpy", "mujoco", "dask", "distributed", "cloudpickle")
_AHEAD = 2  # tasks for each process of the cluster, so that none is idle
_PATIENCE = 10  # s for the scheduler to answer


class Cluster:
    """The workers of a Dask cluster; to be used in a ``with``."""

    def __init__(self, scheduler: str) -> None:
        """Look for a cluster, and at the versions of its scheduler and its workers.

        Args:
            scheduler: the address of Dask's scheduler, such as ``tcp://10.0.0.1:8786``.

        Raises:
            SimrobError: the extra ``tune`` is missing, or versions differ from those here.
            InvalidParameter: no scheduler there, or one without workers.
        """
        self._scheduler = scheduler
        with needed("a cluster", "tune"):
            from distributed import Client
        for name in ("distributed", "distributed.client"):  # of a scheduler that is lost one line is said
            logging.getLogger(name).setLevel(logging.CRITICAL)
        try:
            self._client = Client(scheduler, timeout=_PATIENCE)
            found: Any = self._client.get_versions(packages=_PACKAGES[1:])
        except (OSError, ValueError) as problem:
            raise InvalidParameter("--scheduler", scheduler, "the address of a Dask that answers") from problem
        try:
            _check(scheduler, found)
        except SimrobError:
            self._client.close()
            raise

    def __enter__(self) -> Self:
        """Return itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """Leave the cluster to others."""
        self._client.close()

    def outcomes(
        self, work: Callable[[Task], Outcome], tasks: Iterable[Task], died: Callable[[Task], Outcome]
    ) -> Iterator[Outcome]:
        """Yield what becomes of each task, as it comes; as :meth:`Processes.outcomes` does.

        Dask gives the tasks of a worker that is gone to others; one that several were working on when they died counts
        as what killed them.

        Raises:
            SimrobError: the scheduler went away.
        """
        from distributed import KilledWorker, as_completed
        from distributed.client import ClosedClientError
        from distributed.comm.core import CommClosedError

        waiting, under_way, done = iter(tasks), dict[Any, Task](), as_completed()

        def submit() -> None:
            for task in islice(waiting, max(_AHEAD * len(self._client.nthreads()) - len(under_way), 1)):
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
            message = f"the scheduler {self._scheduler} is gone; what is done is kept, go on with another one"
            raise SimrobError(message) from problem


def _check(scheduler: str, found: Any) -> None:
    """Check that a cluster has workers, and that they and its scheduler have the versions of this computer.

    Args:
        scheduler: its address.
        found: what Dask tells of the versions of all.

    Raises:
        InvalidParameter: it has no workers.
        SimrobError: another version.
    """
    if not found["workers"]:
        raise InvalidParameter("--scheduler", f"{scheduler}, without workers", "a scheduler that has some")
    here = {name: version for name, version in found["client"]["packages"].items() if name in _PACKAGES and version}
    others = {"scheduler": found["scheduler"]} | {f"worker {name}": one for name, one in found["workers"].items()}
    for who, one in others.items():
        off = [name for name, version in here.items() if one["packages"][name] != version]
        if off:
            has = ", ".join(f"{name} {one['packages'][name] or 'not at all'}" for name in off)
            due = ", ".join(f"{name} {here[name]}" for name in off)
            raise SimrobError(f"the {who} of {scheduler} has {has}; it must have {due}, as this computer")
