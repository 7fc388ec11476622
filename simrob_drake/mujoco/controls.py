"""What a MuJoCo model is given over a run: references of the axes, and forces from outside."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from simrob_drake.blocks.references import Reference, reference_values
from simrob_drake.frames import Vector
from simrob_drake.parts.forces import ForceConfig, Push, SineForce
from simrob_drake.parts.site import StationPlant


def controls(
    plant: StationPlant,
    references: Mapping[str, Reference],
    forces: Mapping[str, ForceConfig | None],
    *,
    with_speeds: bool,
    step: float,
    count: int,
) -> Vector:
    """Return the controls of each of ``count`` steps, shape (count, nu).

    References are those of a step's end, where servos act that are treated implicitly; forces are their means over it,
    so that a push gives its whole impulse whatever the step. A servo with_speeds minds the reference's speed, too:
    k_p (q_r - q) + k_d (v_r - v) is the law of a servo without that asks for q_r + v_r k_d / k_p.

    Args:
        plant: of the station.
        references: of its robots, by name.
        forces: at the places that the model knows, in its order; None for one that does not act.
        with_speeds: whether references are followed in their speed, too.
        step: length of a step [s].
        count: of the steps.
    """
    ends = np.asarray(step * np.arange(1, count + 1), dtype=float)
    columns = []
    for name, robot in plant.robots.items():
        positions, gains = reference_values(references[name], ends), robot.gains
        if with_speeds:
            ahead = np.divide(gains.kd, gains.kp, out=np.zeros_like(gains.kd), where=gains.kp > 0)
            positions = positions + ahead * reference_values(references[name], ends, 1)
        columns.append(positions)
    columns += [force_values(force, ends - step, ends) for force in forces.values()]
    return np.hstack([np.zeros((count, 0)), *columns])


def force_values(force: ForceConfig | None, starts: Vector, ends: Vector) -> Vector:
    """Return the mean of a force over stretches of time (m,) [s], shape (m, 3) [N]; of a sine its value midway."""
    if force is None:
        return np.zeros((len(ends), 3))
    if isinstance(force, Push):
        inside = np.clip(np.minimum(ends, force.end) - np.maximum(starts, force.start), 0.0, None)
        return np.outer(inside / (ends - starts), force.force)
    assert isinstance(force, SineForce)  # which MJCF can say
    angles = 2 * np.pi * force.frequency * (starts + ends) / 2 + np.deg2rad(force.phase_deg)
    return np.outer(np.sin(angles), force.amplitude)
