"""What a MuJoCo model is given over a run: references of the axes, and forces from outside."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from simrob_drake.blocks.references import Course, course_values
from simrob_drake.frames import Vector
from simrob_drake.parts.forces import ForceConfig, Push
from simrob_drake.parts.site import StationPlant


def controls(
    plant: StationPlant,
    courses: Mapping[str, Course],
    forces: Mapping[str, ForceConfig | None],
    *,
    step: float,
    count: int,
) -> Vector:
    """Return the controls of each of ``count`` steps, shape (count, nu).

    References are those of a step's end, where servos act that are treated implicitly; forces are their means over it,
    so that a push gives its whole impulse whatever the step.

    Args:
        plant: of the station.
        courses: of its robots, by name.
        forces: at the places that the model knows, in its order; None for one that does not act.
        step: length of a step [s].
        count: of the steps.
    """
    ends = np.asarray(step * np.arange(1, count + 1), dtype=float)
    columns = [course_values(courses[robot], ends) for robot in plant.robots]
    columns += [force_values(force, ends - step, ends) for force in forces.values()]
    return np.hstack([np.zeros((count, 0)), *columns])


def force_values(force: ForceConfig | None, starts: Vector, ends: Vector) -> Vector:
    """Return the mean of a force over stretches of time (m,) [s], shape (m, 3) [N]; of a sine its value midway."""
    if force is None:
        return np.zeros((len(ends), 3))
    if isinstance(force, Push):
        inside = np.clip(np.minimum(ends, force.end) - np.maximum(starts, force.start), 0.0, None)
        return np.outer(inside / (ends - starts), force.force)
    angles = 2 * np.pi * force.frequency * (starts + ends) / 2 + np.deg2rad(force.phase_deg)
    return np.outer(np.sin(angles), force.amplitude)
