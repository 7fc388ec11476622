"""Axes that follow other axes of their robot, as a ``mimic`` of its file says."""

import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from simrob_drake.frames import Vector
from simrob_drake.robots.bodies import FOLLOWS, followed
from simrob_drake.robots.coupled_axes import Firmness, CoupledAxes, Equation


class MimicFollower(NamedTuple):
    """An axis whose position is ``factor * leader + offset``, as the robot's file says."""

    leader: str  # name of the axis that it follows
    factor: float  # positions of the follower by those of the leader [rad/rad, m/rad, rad/m or m/m]
    offset: float  # position of the follower where the leader is at 0 [rad or m]

    def ratios(self, follower: str) -> dict[str, float]:
        """Ratios of a gear between the follower, by its name, and its leader; their total is the offset."""
        return {follower: 1.0, self.leader: -self.factor}


def followers_among(axes: Mapping[str, tuple[str, int]], joints: Sequence[ET.Element]) -> dict[str, MimicFollower]:
    """Find the axes that follow other axes, by name.

    Args:
        axes: by name the joint of each axis, and 1 or -1 where the axis is positive in the other sense.
        joints: the ``joint`` elements of the axes, in order.
    """
    axis_of = {joint: name for name, (joint, _) in axes.items()}
    found = {}
    for name, joint in zip(axes, joints, strict=True):
        follows = joint.find(FOLLOWS)
        leader = None if follows is None else axis_of.get(follows.get("joint", ""))
        if follows is None or leader is None:
            continue
        factor, offset = followed(follows)
        sign, sign_of_leader = axes[name][1], axes[leader][1]
        found[name] = MimicFollower(leader, sign * factor * sign_of_leader, sign * offset)
    return found


def with_followers(axes: Sequence[str], followers: Mapping[str, MimicFollower], positions: Vector) -> Vector:
    """Return positions (..., n) of axes [rad or m] in which each follower is where its leader takes it."""
    if not followers:
        return positions
    equations = [
        Equation(f"{axis} follows {follower.leader}", follower.ratios(axis), follower.offset)
        for axis, follower in followers.items()
    ]
    coupled = CoupledAxes(axes, equations)
    asked = [Firmness.UNNAMED if axis in followers else Firmness.NAMED for axis in axes]
    dependence = coupled.solve(asked, coupled.totals(np.zeros(len(axes))))
    return np.asarray(positions @ dependence.matrix.T + dependence.offset)
