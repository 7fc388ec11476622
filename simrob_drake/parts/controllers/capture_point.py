r"""Where a robot would have to step to come to rest: the capture point of a linear inverted pendulum.

With the centre of mass c and its velocity at height z over the feet,

.. math:: \xi = c_{xy} + \dot c_{xy} \sqrt{z / g}

(Pratt and others, 2006). While it lies between the feet, they can still stop the robot.
"""

import weakref

import numpy as np
from pydrake.multibody.plant import MultibodyPlant

from simrob_drake.errors import InvalidParameter
from simrob_drake.frames import Vector
from simrob_drake.parts.site import StationRobot

_ANGLES = np.linspace(0, 2 * np.pi, 64, endpoint=False)
_DIRECTIONS = np.column_stack([np.cos(_ANGLES), np.sin(_ANGLES)])
"""Along which a support is measured: distances from it come out at most 0.13 % short."""


class CapturePoint:
    """Tells how far the capture point of a robot is outside of the area that its feet span."""

    def __init__(self, plant: MultibodyPlant, robot: StationRobot, key: str) -> None:
        """Take a robot of a finalized plant, which need not be part of a diagram.

        Raises:
            InvalidParameter: a robot without feet; names the ``key`` that asks for it.
        """
        if robot.feet is None:
            raise InvalidParameter(key, f"asked of {robot.model.name}", "left out: it has no feet")
        self._plant, self._robot = weakref.proxy(plant), [robot.instance]
        self._soles = {link: robot.feet.support_points(link).T for link in robot.feet.links}
        self._gravity = np.linalg.norm(plant.gravity_field().gravity_vector())
        self._scratch = plant.CreateDefaultContext()  # nothing is remembered in it: every evaluation sets it anew

    def outside(self, state: Vector) -> float:
        """Return how far from the feet it is [m], negative between them, by positions and velocities (nq + nv).

        Feet that are lifted count as well.
        """
        plant, scratch, robot = self._plant, self._scratch, self._robot
        plant.SetPositionsAndVelocities(scratch, state)
        mass = plant.CalcCenterOfMassPositionInWorld(scratch, robot)
        speed = plant.CalcCenterOfMassTranslationalVelocityInWorld(scratch, robot)
        world, frames = plant.world_frame(), [plant.GetFrameByName(link, robot[0]) for link in self._soles]
        soles = zip(frames, self._soles.values(), strict=True)
        points = np.hstack([plant.CalcPointsPositions(scratch, frame, sole, world) for frame, sole in soles])
        place = mass[:2] + speed[:2] * np.sqrt(max(mass[2] - points[2].min(), 0.0) / self._gravity)
        return float(-(_DIRECTIONS @ (points[:2] - place[:, np.newaxis])).max(axis=1).min())
