"""The parse of imported robots in processes that begin with Drake loaded: it is loaded once, not for every import."""

import multiprocessing
from multiprocessing.connection import Connection
from pathlib import Path

from simrob_drake.base.errors import SimrobError
from simrob_drake.importer import probe

_CONTEXT = multiprocessing.get_context("forkserver")
_CONTEXT.set_forkserver_preload(["pydrake.multibody.plant", "simrob_drake.robots.parse", __name__])
_SECONDS = 120.0


def complaint(file: Path) -> str | None:
    """Do what the importer's own function of this name does: return what Drake says against a robot, or None."""
    here, there = _CONTEXT.Pipe(duplex=False)
    child = _CONTEXT.Process(target=_build, args=(file, there))
    child.start()
    there.close()
    child.join(_SECONDS)
    with here:
        said = here.recv() if here.poll() else f"the process ended with code {child.exitcode}"
    child.kill()
    return said


def _build(file: Path, connection: Connection) -> None:
    """Send what Drake says against a robot, or None: what the importer runs as a script of its own."""
    try:
        probe._build(file)
    except (SimrobError, RuntimeError) as problem:
        connection.send((str(problem).splitlines() or [""])[-1].removeprefix(f"{file}: "))
    else:
        connection.send(None)
