"""Work on a Dask cluster: other machines, with the same versions of what counts."""

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import CancelledError
from importlib.metadata import version
from itertools import islice
from platform import python_version
from typing import Self, TypeVar

from simrob_drake.errors import InvalidParameter, SimrobError
from simrob_drake.extras import needed

Task = TypeVar("Task")
Outcome = TypeVar("Outcome")
_PACKAGES = ("simrob-drake", "drake", "numpy")
_AHEAD = 2  # tasks for each thread of the cluster, so that none is idle
_PATIENCE = 10  # s for the scheduler to answer


class Cluster:
    """The workers of a Dask cluster; to be used in a ``with``."""

    def __init__(self, scheduler: str) -> None:
        """Look for a cluster, and at the versions of its workers.

        Args:
            scheduler: the address of Dask's scheduler, such as ``tcp://10.0.0.1:8786``.

        Raises:
            SimrobError: the extra ``tune`` is missing.
            InvalidParameter: no scheduler there, one without workers, or workers with other versions.
        """
        self._scheduler = scheduler
        with needed("a cluster", "tune"):
            from distributed import Client
        try:
            self._client = Client(scheduler, timeout=_PATIENCE)
        except (OSError, ValueError) as problem:
            raise InvalidParameter("--scheduler", scheduler, "the address of a Dask that answers") from problem
        try:
            self._threads = self._checked_threads(scheduler)
        except InvalidParameter:
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

        waiting, submit = iter(tasks), self._client.submit
        under_way = {submit(work, task, pure=False): task for task in islice(waiting, _AHEAD * self._threads)}
        done = as_completed(list(under_way))
        for future in done:
            task = under_way.pop(future)
            try:
                outcome = future.result()
            except KilledWorker:
                outcome = died(task)
            except CancelledError as problem:
                message = f"the scheduler {self._scheduler} is gone; what is done is kept, go on with another one"
                raise SimrobError(message) from problem
            for one in islice(waiting, 1):
                more = submit(work, one, pure=False)
                under_way[more] = one
                done.add(more)
            yield outcome

    def _checked_threads(self, scheduler: str) -> int:
        """Return how many tasks the cluster works on at a time."""
        threads: int = sum(self._client.nthreads().values())
        if not threads:
            raise InvalidParameter("--scheduler", f"{scheduler}, without workers", "a scheduler that has some")
        here = versions()
        for worker, there in self._client.run(versions).items():
            for package, own in here.items():
                if there[package] != own:
                    found = f"{scheduler}, whose worker {worker} has {package} {there[package]}"
                    raise InvalidParameter("--scheduler", found, f"one whose workers have {package} {own}")
        return threads


def versions() -> dict[str, str]:
    """Return the versions that make two computers give the same result."""
    return {"Python": python_version(), **{package: version(package) for package in _PACKAGES}}
