"""Where a station begins that moves at once, as the state of a run."""

from collections.abc import Mapping

import numpy as np
from pydrake.math import RigidTransform

from simrob_drake.frames import Vector
from simrob_drake.results.record.state import JointState, State
from simrob_drake.simulink.mechanics.trees import Tree
from simrob_drake.simulink.writing.contact_sections import StationFiles


def start_state(files: StationFiles, starts: Mapping[str, Mapping[str, float]], turn: RigidTransform) -> State | None:
    """Return how a station begins; None where everything is at rest.

    Args:
        files: what is written of it.
        starts: positions by robot and axis [rad or m].
        turn: places the model's world in ours.
    """
    several = len(files.robots) > 1
    trees = {name: robot.tree for name, robot in files.robots.items()}
    speeds = {
        name: np.array([freedom.start_speed or 0.0 for freedom in robot.axes]) for name, robot in files.robots.items()
    }
    joints = {
        f"{name if several else 'robot'}::{name}/{files.robots[name].links[tree.root]}": _free(tree, turn)
        for name, tree in trees.items()
        if not tree.root.grounded
    }
    joints |= {f"{name}::{name}/{name}": _free(tree, turn) for tree, name in files.free.items()}
    if not any(speed.any() for speed in (*speeds.values(), *(joint.velocity for joint in joints.values()))):
        return None
    called = {name: name if several else "robot" for name in trees}
    positions = {called[name]: np.array(list(axes.values()), dtype=float) for name, axes in starts.items()}
    return State(positions, {called[name]: speed for name, speed in speeds.items()}, positions, joints)


def _free(tree: Tree, turn: RigidTransform) -> JointState:
    """Return position and velocity of a free body as Drake has them: orientation and turning rate first."""
    pose, (linear, rate) = turn @ tree.base, (turn.rotation() @ part for part in np.split(tree.speed, 2))
    position: Vector = np.concatenate([pose.rotation().ToQuaternion().wxyz(), pose.translation()])
    return JointState(position, np.concatenate([rate, linear]))
