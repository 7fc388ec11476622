"""What is told of signals by the part that gives them."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Panel:
    """What one frame of a plot shows of a run's signals.

    Attributes:
        figure: the file that it belongs to, without suffix: "sensors", "piece_ball", "imu".
        heading: of the figure: "sensors", "the piece 'ball' in the world".
        title: of the panel: "contact force 'tip'".
        label: of its upright axis, with the unit: "force [N]".
        columns: of the result.
    """

    figure: str
    heading: str
    title: str
    label: str
    columns: tuple[str, ...]
