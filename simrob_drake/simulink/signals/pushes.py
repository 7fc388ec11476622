"""What External Force and Torque blocks apply to bodies, from signals."""

from dataclasses import dataclass

import numpy as np
from pydrake.math import RigidTransform

from simrob_drake.simulink.mechanics.bodies import PUSH, Bodies, RigidPart
from simrob_drake.simulink.model.nodes import Node
from simrob_drake.simulink.signals.forms import Signal, Value, closure, widened
from simrob_drake.simulink.signals.frame_sensing import orientation
from simrob_drake.simulink.signals.tracing import Tracer


@dataclass(frozen=True, eq=False)
class ExternalForce:
    """What one block applies.

    Attributes:
        node: the block.
        body, pose: on which it acts, and its frame in the first one of that.
        force, torque: along the axes of its frame, each of 3 [N, N·m].
        senses: whether it acts along the axes of the world, so that the orientation of its frame is measured.
    """

    node: Node
    body: RigidPart
    pose: RigidTransform
    force: list[Value]
    torque: list[Value]
    senses: bool


def read_pushes(tracer: Tracer, bodies: Bodies) -> list[ExternalForce]:
    """Return what blocks apply from signals; those that inputs of the model drive alone stay ports of the station."""
    pushes = []
    for body in bodies.bodies:
        for node, pose in [mark for mark in body.marks if mark[0].kind == PUSH]:
            push = _push(tracer, node, body, pose)
            if any(term.kind != "input" for terms in closure([*push.force, *push.torque]) for term in terms):
                pushes.append(push)
                body.marks.remove((node, pose))
            else:
                message = "it is the port external_force or external_torque of the station, at this frame"
                node.findings.report.add("read", node.path, message)
    return pushes


def _push(tracer: Tracer, node: Node, body: RigidPart, pose: RigidTransform) -> ExternalForce:
    """Read the ports of one block, of the force and then of the torque: for each axis that is on, then a vector."""
    port, senses, parts = 0, False, []
    for what in ("Force", "Torque"):
        vector: Signal = np.zeros(3).astype(object)
        for axis in ("X", "Y", "Z", ""):
            if not node.is_on(f"Enable{what}{axis}"):
                continue
            port += 1
            values = tracer.physical(node, "lconn", port)
            if values is not None and axis:
                vector["XYZ".index(axis)] += values.ravel()[0]
            elif values is not None:
                vector = vector + widened(values.ravel(), 3)
        if node.text(f"{what}ResolutionFrame", "AttachedFrame") == "World" and any(vector):
            senses, vector = True, orientation(node).T.dot(vector)
        parts.append(list(vector))
    return ExternalForce(node, body, pose, parts[0], parts[1], senses)
