r"""Feet that are balls roll while they stand: their middle moves over the floor as the leg turns.

A ball of radius r that turns at :math:`\omega` without slipping moves by :math:`\dot c = \omega \times r e_z`.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import numpy.typing as npt

from simrob_drake.blocks.references import smooth
from simrob_drake.frames import Vector


def rolled(rotation: Vector, standing: npt.NDArray[np.bool_], radius: float) -> Vector:
    """Return how far the middle of a ball has rolled since it landed.

    Args:
        rotation: of the ball at m times, shape (m, 3, 3).
        standing: when it stands, shape (m,) of truth values.
        radius: r [m].

    Returns:
        ahead and to the left, shape (m, 2) [m]; in the air it goes back to zero, where the next landing is planned.
    """
    turned = rotation[1:] @ rotation[:-1].transpose(0, 2, 1)
    about = np.stack([turned[:, 2, 1] - turned[:, 1, 2], turned[:, 0, 2] - turned[:, 2, 0]], axis=1) / 2  # x, y
    move = radius * np.column_stack([about[:, 1], -about[:, 0]])
    both = standing[1:] & standing[:-1]
    way = np.vstack([np.zeros((1, 2)), np.cumsum(move * both[:, np.newaxis], axis=0)])
    changes = np.flatnonzero(np.diff(standing.astype(int))) + 1
    edges = [0, *changes, len(standing)]
    result, last = np.zeros((len(standing), 2)), np.zeros(2)
    for start, end in pairwise(edges):
        if standing[start]:
            result[start:end] = way[start:end] - way[start]
            last = result[end - 1]
        else:
            share = np.arange(1, end - start + 1) / (end - start + 1)
            result[start:end] = np.outer(1.0 - smooth(share), last)
    return result
