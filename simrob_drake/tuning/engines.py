"""Where runs are made: processes of this machine, or a cluster."""

from simrob_drake.tuning.cluster import Cluster
from simrob_drake.tuning.processes import Processes

Engine = Processes | Cluster


def engine(*, workers: int | None = None, scheduler: str | None = None) -> Engine:
    """Return the workers of a Dask scheduler, or so many processes of this machine.

    Args:
        workers: how many processes; as many as there are processors unless given.
        scheduler: the address of a Dask scheduler to use instead.

    Raises:
        SimrobError: no such scheduler, or one that cannot be used.
    """
    return Cluster(scheduler) if scheduler else Processes(workers)
