"""How long diagrams live: until nobody holds them, though some of their blocks are written in Python.

Drake's diagrams hold their Python blocks in C++, where Python's garbage collector does not see it. What a block holds
in turn can therefore keep its diagram for ever, in three ways, and each has its remedy here or in the block:

* Drake for Python 3.11 lets each block hold its builder, which holds the diagram: :func:`release`.
* A callback of an output port is held in C++, and with it its block: :func:`weakly`.
* A block that keeps its plant, or one of its frames, bodies and joints, keeps the plant's diagram: blocks keep indices,
  and the plant by ``weakref.proxy``. The diagram keeps the plant; one that is in no diagram is its owner's to keep.

Drake for Python 3.11 also hides from the collector what an object of a Python class derived from one of its own holds:
a block must be emptied to go, and a diagram of such a class, as a station in a box is, stays.
"""

import gc
import weakref
from collections.abc import Callable, Iterable
from time import monotonic
from typing import Any, ParamSpec, TypeVar

from pydrake.systems.framework import Diagram, DiagramBuilder, InputPort, OutputPort, System

from simrob_drake.base.drake_versions import KEEPS_PYTHON_BLOCKS

P = ParamSpec("P")
R = TypeVar("R")

_PEERS = "_pydrake_internal_ref_cycle_peers"
"""Where Drake keeps what must live as long as an object: ports, callbacks of events, builders."""

_FEW = 4  # diagrams that may wait to be collected, of about 2 MB each
_PAUSE = 4
"""Times as long as a collection took the next one waits: it is quick in a small process, and slow in a large one."""


def release(builder: DiagramBuilder, diagram: Diagram) -> None:
    """Let a diagram go once nobody holds it, and what its Python blocks remember with it.

    To be called once, right after it was built. Nothing changes while something holds the diagram, its builder, or one
    of its plants or other C++ blocks; a Python block alone no longer keeps it.
    """
    _COLLECTOR.watch(diagram)
    if not KEEPS_PYTHON_BLOCKS:
        return
    blocks = [block for block in diagram.GetSystems() if not type(block).__module__.startswith("pydrake.")]
    for block in blocks:
        vars(block).get(_PEERS, set()).discard(builder)
    weakref.finalize(diagram, _empty, blocks).atexit = False


def release_with(owner: object, block: System) -> None:
    """Let a Python block that stands in no diagram go with its owner, such as the plant that it looks at."""
    if KEEPS_PYTHON_BLOCKS:
        weakref.finalize(owner, _empty, [block]).atexit = False


def built(builder: DiagramBuilder) -> Diagram:
    """Return the diagram of a builder; it goes when nobody holds it any more, see :func:`release`."""
    diagram = builder.Build()
    release(builder, diagram)
    return diagram


def weakly(method: Callable[P, R]) -> Callable[P, R]:
    """Return a method of a block as a callback that does not keep the block; it is called while the block lives."""
    reference = weakref.WeakMethod(method)

    def call(*args: P.args, **kwargs: P.kwargs) -> R:
        alive = reference()
        assert alive is not None  # a block's ports are evaluated by its diagram, which holds it
        return alive(*args, **kwargs)

    return call


class _Collector:
    """Have unheld diagrams collected: Python counts the objects that it made, not the megabytes behind them."""

    def __init__(self) -> None:
        self._living: weakref.WeakSet[Diagram] = weakref.WeakSet()
        self._bound = _FEW
        self._not_before = 0.0

    def watch(self, diagram: Diagram) -> None:
        """Count a diagram, and collect once there are a few more than the last collection left."""
        self._living.add(diagram)
        began = monotonic()
        if len(self._living) > self._bound and began >= self._not_before and gc.isenabled():
            gc.collect()
            ended = monotonic()
            self._not_before = ended + _PAUSE * (ended - began)
            self._bound = len(self._living) + _FEW


_COLLECTOR = _Collector()


def _empty(blocks: Iterable[System]) -> None:
    """Take from blocks whose diagram is gone what leads back to them: ports, and callbacks of events."""
    for block in blocks:
        ports = [name for name, value in vars(block).items() if _is_of_ports(value)]
        for name in (_PEERS, *ports):
            vars(block).pop(name, None)


def _is_of_ports(value: Any) -> bool:
    """Tell whether a value is a port, or holds some, by its type: a proxy of what is gone answers nothing else."""
    kind = type(value)
    held = value.values() if kind is dict else value if kind is list else [value]
    return any(issubclass(type(each), InputPort | OutputPort) for each in held)
