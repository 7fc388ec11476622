"""Axes that follow other axes of their robot, as a ``mimic`` joint in the robot's file demands.

An axis is a joint with a sense: it is positive in the direction of its joint (sign 1) or against it (sign -1).
"""

import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import message
from simrob_drake.robots.axis import Axis
from simrob_drake.robots.coupled_axes import CoupledAxes, Equation, Firmness
from simrob_drake.robots.fingers import FOLLOWS, mimic_line


class MimicFollower(NamedTuple):
    """An axis whose position is ``factor * position of the leader + offset``.

    Attributes:
        leader: name of the axis that it follows.
        factor: ratio of the positions of follower and leader [rad/rad, m/rad, rad/m or m/m].
        offset: position of the follower if the leader is at 0 [rad or m].
    """

    leader: str
    factor: float
    offset: float

    def ratios(self, follower: str) -> dict[str, float]:
        """Ratios of the equation between the follower, by its name, and its leader. Its total is the offset.

        Args:
            follower: name of the axis.
        """
        # q_follower = factor q_leader + offset, written as 1 q_follower - factor q_leader = offset.
        return {follower: 1.0, self.leader: -self.factor}


def followers_among(
    axes: Mapping[str, Axis], joints: Sequence[ET.Element]
) -> dict[str, MimicFollower]:
    """Find the axes that follow other axes.

    Args:
        axes: the axes of a robot, by name.
        joints: the ``joint`` elements of the axes, in the same order. An import has put the ``mimic`` of a joint into
            an element FOLLOWS.

    Returns:
        the followers, by the name of the axis. A joint that follows a joint without an axis is not among them.
    """
    axis_of_joint = {axis.joint: name for name, axis in axes.items()}
    found = {}
    for name, joint in zip(axes, joints, strict=True):
        follows = joint.find(FOLLOWS)
        if follows is None:
            continue
        # A description may have no axis for the leading joint. Its position is then unknown, and nothing is coupled.
        leader = axis_of_joint.get(follows.get("joint", ""))
        if leader is None:
            continue
        # The file gives the line between joints: joint = factor * leader's joint + offset. With axis = sign * joint for
        # both, and sign² = 1: axis = sign * factor * leader's sign * leader's axis + sign * offset.
        line = mimic_line(follows)
        sign = axes[name].sign
        sign_of_leader = axes[leader].sign
        found[name] = MimicFollower(
            leader=leader, factor=sign * line.factor * sign_of_leader, offset=sign * line.offset
        )
    return found


def with_followers(
    axes: Sequence[str], followers: Mapping[str, MimicFollower], positions: Vector
) -> Vector:
    """Move followers to the positions that their leaders demand; all other axes keep their positions.

    Args:
        axes: names of the n axes of a robot.
        followers: the followers among them, by name. A follower may lead other followers.
        positions: positions of the axes, shape (..., n) [rad or m].

    Returns:
        the positions with those of followers replaced, shape (..., n) [rad or m]; ``positions`` itself if there are no
        followers.
    """
    if not followers:
        return positions
    # Followers of followers make this a system of equations. The solver of coupled axes puts them in order.
    equations = []
    for axis, follower in followers.items():
        equations.append(
            Equation(
                message(
                    "robots.axis_follows",
                    "{axis} follows {leader}",
                    axis=axis,
                    leader=follower.leader,
                ),
                follower.ratios(axis),
                follower.offset,
            )
        )
    coupled = CoupledAxes(axes, equations)
    # Axes with the firmness NAMED keep their positions; the UNNAMED ones, the followers, are computed from them.
    firmness = [Firmness.UNNAMED if axis in followers else Firmness.NAMED for axis in axes]
    # All equations have a total, so the positions at the start do not matter.
    totals = coupled.totals(np.zeros(len(axes)))
    # The positions of all axes as an affine function of the given positions: matrix @ q + offset.
    dependence = coupled.solve(firmness, totals)
    # Positions are rows, so that they are multiplied with the transposed matrix.
    return np.asarray(positions @ dependence.matrix.T + dependence.offset)
