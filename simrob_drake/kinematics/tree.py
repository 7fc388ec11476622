"""The way from one frame of a plant to another: which joints lie on it."""

from __future__ import annotations

from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Frame, Joint


def joints_between(plant: MultibodyPlant, base: Frame, tool: Frame) -> list[tuple[Joint, float]]:
    """Return the joints that can move ``tool`` against ``base``, in order from the base.

    Args:
        plant: finalized.
        base: where the way begins.
        tool: where it ends, on the same branch of the tree or another.

    Returns:
        each joint with 1 where the way leads outward through it, or -1 where it leads back towards the world.
    """
    inboard = {}
    for index in plant.GetJointIndices():
        joint = plant.get_joint(index)
        inboard[joint.child_body().index()] = joint
    back, out = _to_world(inboard, base), _to_world(inboard, tool)
    while back and out and back[-1].index() == out[-1].index():  # what carries both does not count
        back.pop()
        out.pop()
    way = [(joint, -1.0) for joint in back] + [(joint, 1.0) for joint in reversed(out)]
    return [(joint, sense) for joint, sense in way if joint.num_positions() > 0]


def _to_world(inboard: dict[int, Joint], frame: Frame) -> list[Joint]:
    joints, body = [], frame.body()
    while body.index() in inboard:
        joints.append(inboard[body.index()])
        body = joints[-1].parent_body()
    return joints
