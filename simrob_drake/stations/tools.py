"""What a robot holds: the frame that pieces hang on, and the tool whose centre point counts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence


def tool_in_use(own: Mapping[str, str], carried: Sequence[str], tcp: str | None) -> str:
    """Return the tool that a robot's tool centre point belongs to; empty without any.

    That is the one that its station names as ``tcp``, else the outermost piece of those that it carries, in this order,
    else the first of its own, of which the frames are given by name.
    """
    return tcp or [*carried[-1:], *own, ""][0]


def flange(own: Mapping[str, str], root: str, tool: str | None = None) -> str:
    """Return the frame that what a robot carries hangs on: of the tool that is named, else of its first, else its root.

    ``own`` are the frames of its tools by name, ``root`` is that of its root link.
    """
    return own[tool] if tool is not None and tool in own else next(iter(own.values()), root)
