"""Pushes: forces of given length on a frame, whose edges no step of a simulation goes across."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Frame
from pydrake.systems.framework import DiagramBuilder, OutputPort
from pydrake.trajectories import PiecewisePolynomial, Trajectory

from simrob_drake.blocks.external_force import add_external_force
from simrob_drake.blocks.references import add_trajectory
from simrob_drake.errors import InvalidParameter
from simrob_drake.frames import Vector


@dataclass(frozen=True)
class Push:
    """A force (3,) [N] from ``start`` on for ``duration`` [s]."""

    start: float
    duration: float
    force: Vector

    def __post_init__(self) -> None:
        """Check the figures.

        Raises:
            InvalidParameter: a start that is negative, a duration that is not positive, or a force that is not finite.
        """
        if not (np.isfinite(self.start) and self.start >= 0):
            raise InvalidParameter("start of a push", self.start, "finite and not negative [s]")
        if not (np.isfinite(self.duration) and self.duration > 0):
            raise InvalidParameter("duration of a push", self.duration, "positive [s]")
        if np.shape(self.force) != (3,) or not np.isfinite(self.force).all():
            raise InvalidParameter("force of a push", self.force, "three finite numbers [N]")

    @property
    def end(self) -> float:
        """When it is over [s]."""
        return self.start + self.duration


def force_over_time(pushes: Sequence[Push]) -> Trajectory:
    """Return the force of at least one push, shape (3, 1) [N]; where pushes overlap, they add up."""
    edges = sorted({0.0, *(push.start for push in pushes), *(push.end for push in pushes)})
    forces = [sum((p.force for p in pushes if p.start <= edge < p.end), np.zeros(3)) for edge in edges]
    breaks = [*edges, edges[-1] + 1.0]  # a zero-order hold needs an end; after it a source repeats the last value
    return PiecewisePolynomial.ZeroOrderHold(breaks, np.array([*forces, np.zeros(3)]).T)


def add_pushes(
    builder: DiagramBuilder, plant: MultibodyPlant, frame: Frame, pushes: Sequence[Push], *, name: str
) -> OutputPort:
    """Add forces at the centre of mass of a frame's body, along the frame's axes.

    Args:
        builder: the diagram under construction.
        plant: the finalized plant of the frame.
        frame: of the body that is pushed.
        pushes: at least one.
        name: of the block.

    Returns:
        the spatial forces for the plant's ``applied_spatial_force``.
    """
    source = add_trajectory(builder, force_over_time(pushes), name=f"{name}.course")
    centre = frame.GetFixedPoseInBodyFrame().inverse() @ frame.body().default_com()
    block = add_external_force(builder, plant, frame, name=name, point=centre)
    builder.Connect(source.position, block.get_command_input_port())
    return block.get_spatial_forces_output_port()
