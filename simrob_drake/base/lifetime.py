"""Release of diagrams that are no longer used, although some of their blocks are written in Python.

An object *holds* another one if it has a reference to it. Drake's diagrams hold their Python blocks in C++, where
Python's garbage collector does not see the reference. If a block in turn holds its diagram, neither is ever deleted.
There are three such cases, and each has its remedy here or in the block:

* Drake for Python 3.11 lets each block hold its builder, which holds the diagram: :func:`release`.
* A callback of an output port is held in C++, and with it its block: :func:`weakly`.
* A block that holds its plant, or one of its frames, bodies and joints, holds the plant's diagram. So blocks keep
  indices of these, and a ``weakref.proxy`` of the plant. The diagram holds the plant; if the plant is in no diagram,
  its owner must hold it.

Drake for Python 3.11 also hides references from the collector that objects of Python subclasses of Drake's classes
hold. There, a block's references must be removed before it can be deleted. A diagram whose class is such a subclass, as
a station in a box, is never deleted.
"""

import gc
import weakref
from collections.abc import Callable, Iterable
from time import monotonic
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar

from pydrake.systems.framework import Diagram, DiagramBuilder, InputPort, OutputPort, System

from simrob_drake.base.drake_versions import KEEPS_PYTHON_BLOCKS
from simrob_drake.base.renaming import former_names_of

P = ParamSpec("P")
R = TypeVar("R")

_PEERS = "_pydrake_internal_ref_cycle_peers"
"""Attribute in which Drake stores objects that must live as long as another one: ports, callbacks, builders."""

_MOST_WAITING = 4
"""Count of unused diagrams that may wait for the garbage collector. Each has about 2 MB."""

_PAUSE = 4
"""Least time between two collections, as a multiple of the time that one takes: long in a large process, short in a
small one."""


def release(builder: DiagramBuilder, diagram: Diagram) -> None:
    """Make sure that a diagram is deleted when nothing holds it, together with the objects that its blocks hold.

    It is called once, right after the diagram was built. As long as something holds the diagram, its builder, or one of
    its plants or other C++ blocks, nothing is deleted. A Python block alone no longer holds its diagram.

    Args:
        builder: the builder of the diagram.
        diagram: the diagram.
    """
    _COLLECTOR.watch(diagram)
    if not KEEPS_PYTHON_BLOCKS:
        return
    # Blocks of classes in Python; the others are Drake's own.
    blocks = [
        block for block in diagram.GetSystems() if not type(block).__module__.startswith("pydrake.")
    ]
    # The circle block - builder - diagram - block is opened at its first link.
    for block in blocks:
        vars(block).get(_PEERS, set()).discard(builder)
    # At the end of the process, nothing needs to be deleted, and Drake's modules may be gone already.
    weakref.finalize(diagram, _empty, blocks).atexit = False


def release_with(owner: object, block: System) -> None:
    """Make sure that a Python block that is in no diagram is deleted with its owner.

    Args:
        owner: the owner, such as the plant that the block evaluates.
        block: the block.
    """
    if KEEPS_PYTHON_BLOCKS:
        weakref.finalize(owner, _empty, [block]).atexit = False


def build_diagram(builder: DiagramBuilder) -> Diagram:
    """Build a diagram that is deleted when nothing holds it any more, see :func:`release`."""
    diagram = builder.Build()
    release(builder, diagram)
    return diagram


def weakly(method: Callable[P, R]) -> Callable[P, R]:
    """Make a callback of a block's method that does not hold the block. It can be called while the block exists."""
    reference = weakref.WeakMethod(method)

    def call(*args: P.args, **kwargs: P.kwargs) -> R:
        bound_method = reference()
        # A block's ports are evaluated by its diagram, which holds the block.
        assert bound_method is not None
        return bound_method(*args, **kwargs)

    return call


class _Collector:
    """Starts Python's garbage collector when there are several unused diagrams.

    The collector starts by itself only after many new Python objects. A diagram is a single one, with megabytes in C++.
    """

    def __init__(self) -> None:
        """Begin with no diagram."""
        # Diagrams that were not deleted yet.
        self._living: weakref.WeakSet[Diagram] = weakref.WeakSet()
        # Count of living diagrams above which a collection starts.
        self._bound = _MOST_WAITING
        # Time before which no collection starts, of the monotonic clock [s].
        self._not_before = 0.0

    def watch(self, diagram: Diagram) -> None:
        """Count a diagram, and start a collection if there are several more than after the last collection.

        None is started soon after another one (see `_PAUSE`), or while the garbage collector is switched off.
        """
        self._living.add(diagram)
        began = monotonic()
        if len(self._living) > self._bound and began >= self._not_before and gc.isenabled():
            gc.collect()
            ended = monotonic()
            self._not_before = ended + _PAUSE * (ended - began)
            # The diagrams that a collection leaves are in use, and do not count as waiting.
            self._bound = len(self._living) + _MOST_WAITING


_COLLECTOR = _Collector()


def _empty(blocks: Iterable[System]) -> None:
    """Remove the references of blocks that lead back to them: ports, and callbacks of events.

    Args:
        blocks: blocks whose diagram was deleted.
    """
    for block in blocks:
        # The names are collected first: a dict must not change while it is iterated.
        ports = [name for name, value in vars(block).items() if _has_ports(value)]
        for name in (_PEERS, *ports):
            vars(block).pop(name, None)


def _has_ports(value: Any) -> bool:
    """Whether a value is a port, or a dict or list with ports.

    Only its type is examined: any use of a weak proxy whose object was deleted raises an error.
    """
    kind = type(value)
    content = [value]
    if kind is dict:
        content = list(value.values())
    elif kind is list:
        content = value
    return any(issubclass(type(entry), InputPort | OutputPort) for entry in content)


if not TYPE_CHECKING:
    # The type checker does not see the former names, so that this package cannot use them.
    __getattr__ = former_names_of(__name__, {"built": "build_diagram"})
