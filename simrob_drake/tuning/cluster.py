"""Work on a Dask cluster: other machines, with the same versions of what counts."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from importlib.metadata import version
from itertools import islice
from platform import python_version
from typing import TYPE_CHECKING, TypeVar

from simrob_drake.errors import InvalidParameter, SimrobError

if TYPE_CHECKING:
    from distributed import Client

Task = TypeVar("Task")
Outcome = TypeVar("Outcome")
_PACKAGES = ("simrob-drake", "drake", "numpy")
_AHEAD = 2  # tasks for each thread of the cluster, so that none is idle
_PATIENCE = 10  # s for the scheduler to answer


def outcomes_on_cluster(
    work: Callable[[Task], Outcome], tasks: Iterable[Task], died: Callable[[Task], Outcome], *, scheduler: str
) -> Iterator[Outcome]:
    """Yield what becomes of each task, as it comes.

    Dask gives the tasks of a worker that is gone to others; one that several were working on when they died counts as
    what killed them.

    Args:
        work: a function of a module that the workers can import.
        tasks: what it is given.
        died: what becomes of a task whose workers died.
        scheduler: the address of Dask's scheduler, such as ``tcp://10.0.0.1:8786``.

    Raises:
        SimrobError: the extra ``tune`` is missing.
        InvalidParameter: no scheduler there, one without workers, or workers with other versions.
    """
    try:
        from distributed import Client, KilledWorker, as_completed
    except ImportError as problem:
        raise SimrobError('a cluster needs other packages: pip install "simrob-drake[tune]"') from problem
    try:
        client = Client(scheduler, timeout=_PATIENCE)
    except (OSError, ValueError) as problem:
        raise InvalidParameter("--scheduler", scheduler, "the address of a Dask scheduler that answers") from problem
    with client:
        waiting, many = iter(tasks), _AHEAD * _threads(client, scheduler)
        under_way = {client.submit(work, task, pure=False): task for task in islice(waiting, many)}
        done = as_completed(list(under_way))
        for future in done:
            task = under_way.pop(future)
            for one in islice(waiting, 1):
                more = client.submit(work, one, pure=False)
                under_way[more] = one
                done.add(more)
            try:
                yield future.result()
            except KilledWorker:
                yield died(task)


def versions() -> dict[str, str]:
    """Return the versions that make two computers give the same result."""
    return {"Python": python_version(), **{package: version(package) for package in _PACKAGES}}


def _threads(client: Client, scheduler: str) -> int:
    """Return how many tasks a cluster works on at a time, after a look at the versions of its workers."""
    threads: int = sum(client.nthreads().values())
    if not threads:
        raise InvalidParameter("--scheduler", f"{scheduler}, without workers", "a scheduler that has some")
    here = versions()
    for worker, there in client.run(versions).items():
        for package, own in here.items():
            if there[package] != own:
                found = f"{scheduler}, whose worker {worker} has {package} {there[package]}"
                raise InvalidParameter("--scheduler", found, f"one whose workers have {package} {own}")
    return threads
