"""What a robot holds: the frame that pieces hang on, and the tool whose centre point counts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence


def tool_in_use(own: Mapping[str, str], carried: Sequence[str], tcp: str | None) -> str:
    """Return the tool that a robot's tool centre point belongs to; empty without any.

    Args:
        own: frames of the robot's own tools by name.
        carried: the pieces that it carries, outward.
        tcp: the tool that its station names.

    Returns:
        the named one, else the outermost piece, else the robot's first tool.
    """
    return tcp or [*carried[-1:], *own, ""][0]


def flange(own: Mapping[str, str], root: str, tool: str | None = None) -> str:
    """Return the frame that what a robot carries hangs on: of the tool that is named, else of its first, else its root.

    Args:
        own: frames of the robot's own tools by name.
        root: the frame of its root link.
        tool: the one that a piece names.
    """
    return own[tool] if tool is not None and tool in own else next(iter(own.values()), root)
