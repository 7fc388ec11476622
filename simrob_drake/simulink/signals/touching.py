r"""Contact by Simscape's own law, of spheres on planes that stand: forces that a signal flow computes.

.. math:: f_n = s(d / w) (k d + b \dot d), \qquad f_t = -\mu(|v|) f_n v / |v|

of the depth d, with :math:`s(x) = 3 x^2 - 2 x^3` over the transition region w, and never pulling. The coefficient of
friction rises in this way to the static one at the critical speed, and falls to the dynamic one at 1.5 times that.
"""

from collections.abc import Iterable

import numpy as np

from simrob_drake.simulink.mechanics.bodies import Bodies, ContactPair, ContactParameters
from simrob_drake.simulink.model.nodes import Node
from simrob_drake.simulink.signals.arithmetic import applied, limited, table_of
from simrob_drake.simulink.signals.forms import Form, Term, Value, computed, signal
from simrob_drake.simulink.signals.frame_sensing import PARTS, orientation
from simrob_drake.simulink.signals.laws import ExternalForce

_SLOWEST = 1e-9  # m/s


def forces_of_contacts(contacts: Iterable[ContactPair], bodies: Bodies) -> dict[ContactPair, ExternalForce]:
    """Return what contacts of spheres with planes of the world do to the spheres; others are not there."""
    found: dict[ContactPair, ExternalForce] = {}
    for contact in contacts:
        bodies_of = {solid.node: (body, solid) for body in bodies.bodies for solid in body.solids}
        plane, sphere = sorted(contact.pair, key=lambda node: node in bodies_of)
        body, solid = bodies_of.get(sphere, (None, None))
        stands = plane.kind == "Infinite Plane" and plane in bodies.standing
        if body is None or solid is None or not stands or body.grounded or contact.senses_distance:
            continue
        if solid.shape is None or solid.shape.kind != "sphere":
            continue
        force, torque = _wrench(contact.node, contact.surface, solid.shape.size[0])
        found[contact] = ExternalForce(contact.node, body, solid.pose, force, torque, True, (sphere, plane))
        contact.node.note("read", "by its own law, as forces on the sphere")
    return found


def _wrench(node: Node, surface: ContactParameters, radius: float) -> tuple[list[Value], list[Value]]:
    """Return force and torque on a sphere in its own axes, from where it is seen from the plane."""
    seen = {part: Form({Term("sensed", node, index): 1.0}) for index, part in enumerate(PARTS)}
    width = node.number("NormalTransitionRegionWidth", "1e-4", unit="m")
    depth = radius - seen["z"]
    share = limited(depth * (1.0 / width), 0.0, 1.0)
    pressed = surface.stiffness * depth - surface.damping * seen["vz"]
    normal = applied("max", 0.0, share * share * (3.0 - 2.0 * share) * pressed)
    sliding = seen["vx"] - radius * seen["wy"], seen["vy"] + radius * seen["wx"]
    speed = applied("sqrt", sliding[0] * sliding[0] + sliding[1] * sliding[1])
    across: list[Value] = [0.0, 0.0]
    if surface.static:
        coefficient = computed("lookup", speed, **_friction(surface))
        grip = coefficient * normal / applied("max", speed, _SLOWEST)
        across = [-1.0 * (grip * one) for one in sliding]
    turn = orientation(node).T
    force, torque = signal([*across, normal]), signal([radius * across[1], -radius * across[0], 0.0])
    return list(turn.dot(force)), list(turn.dot(torque))


def _friction(surface: ContactParameters) -> dict[str, object]:
    part = np.linspace(0.0, 1.0, 11)
    smooth = part * part * (3.0 - 2.0 * part)
    speeds = surface.speed * np.concatenate([part, 1.0 + 0.5 * part[1:]])
    values = [surface.static * smooth, surface.static + (surface.dynamic - surface.static) * smooth[1:]]
    return table_of(speeds, np.concatenate(values), clip=True)
