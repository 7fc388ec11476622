"""The feet of a robot seen in walking direction: where each touches the floor, and which axes move it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from simrob_drake.errors import InvalidParameter
from simrob_drake.frames import Vector
from simrob_drake.programs.gaits.skeleton import Skeleton, rotations_about

UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class Foot:
    """A foot, in the frame in which the robot walks along x and has y at its left.

    Attributes:
        name: such as left_foot.
        link: the frame of its link.
        axes: of the leg, the hip first.
        point: middle of the contact, in the link [m]: of the spheres' middles, or of a sole's top and bottom.
        over: height of the point over the floor when the foot stands [m].
        upright: rotation of the link when the foot stands flat and looks ahead, shape (3, 3).
        home: the point when all axes are zero, seen from the root [m].
        half: half of the contact's length and width, from the middle [m]; zeros for a ball.
    """

    name: str
    link: str
    axes: tuple[int, ...]
    point: Vector
    over: float
    upright: Vector
    home: Vector
    half: Vector

    @property
    def side(self) -> float:
        """1 for a left foot, -1 for a right one."""
        return float(np.sign(self.home[1]))


def facing_rotation(facing_deg: float) -> Vector:
    """Return the rotation of a root that looks along the world's x, shape (3, 3).

    Args:
        facing_deg: where the robot looks if its root is not turned, counterclockwise from x [deg].
    """
    return np.asarray(rotations_about(UP, np.array([-np.deg2rad(facing_deg)]))[0])


def feet_of(skeleton: Skeleton, facing_deg: float, kind: str | None = None) -> list[Foot]:
    """Return the feet of a robot.

    Args:
        skeleton: of the robot.
        facing_deg: as in :func:`facing_rotation`.
        kind: of its feet; the default one unless given.

    Raises:
        InvalidParameter: a robot without feet.
        UnknownName: no such kind.
    """
    model = skeleton.model
    if model.feet is None:
        raise InvalidParameter(f"robot {model.name}", "one without feet", "a legged one, to walk")
    contact = model.feet.kind(kind)
    turn = facing_rotation(facing_deg)
    names = {frame: tool for tool, frame in model.tools.items()}
    zero = skeleton.poses((turn[np.newaxis], np.zeros((1, 3))), np.zeros((1, len(model.axes))))
    feet = []
    for link in contact.links:
        body, rotation, position = skeleton.frames[link]
        upright = zero.rotation[body, 0] @ rotation
        if link in contact.boxes:
            point, over = np.array(contact.boxes[link].centre), contact.boxes[link].size[2] / 2
        else:
            around = np.array(contact.points[link]) @ upright.T
            middle = (around.min(axis=0) + around.max(axis=0)) / 2
            point, over = upright.T @ middle, contact.radius
        spread = (contact.support_points(link) - point) @ upright.T
        home = zero.position[body, 0] + zero.rotation[body, 0] @ position + upright @ point
        sole = next((names[f] for f in names if skeleton.frames[f][0] == body and names[f].endswith("foot")), link)
        feet.append(
            Foot(
                name=sole,
                link=link,
                axes=tuple(skeleton.path(link)),
                point=point,
                over=over,
                upright=upright,
                home=home,
                half=np.ptp(spread[:, :2], axis=0) / 2,
            )
        )
    return feet
