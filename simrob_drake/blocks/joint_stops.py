r"""Elastic end stops, for the schemes that know no joint limits.

A stop is a spring and a damper that only push: with :math:`w = q + (d/k)\,v`,

.. math:: \tau = -k\,\bigl(w - \mathrm{clip}(w, q_{lower}, q_{upper})\bigr).

Inside its range a joint feels nothing, but that the damper already acts d/k (1 ms) before the limit is reached.
Figures: the joints of the Simulink models, 1e4 N·m/deg and 10 N·m·s/deg, whose transition of 0.1 deg takes the same
place. Only C++ primitives are used.
"""

import numpy as np
import numpy.typing as npt
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import JointIndex
from pydrake.systems.framework import DiagramBuilder, OutputPort
from pydrake.systems.primitives import Saturation

from simrob_drake.blocks.wiring import fed, joined, mapped


def add_joint_stops(
    builder: DiagramBuilder, plant: MultibodyPlant, *, stiffness: npt.ArrayLike, damping: npt.ArrayLike
) -> OutputPort | None:
    """Return the generalized forces (nv) of stops at every finite limit of a plant's one-axis joints; None without any.

    They have the stiffness k [N·m/rad, and N/m of joints that slide], positive, and the damping d [N·m·s/rad, and
    N·s/m], not negative: one figure for all joints, or one for each of the plant's velocities (nv,).
    """
    joints = [plant.get_joint(JointIndex(index)) for index in range(plant.num_joints())]
    limited = [
        joint
        for joint in joints
        if joint.num_velocities() == 1
        and np.isfinite([joint.position_lower_limit(), joint.position_upper_limit()]).any()
    ]
    if not limited:
        return None
    count, rows = len(limited), np.arange(len(limited))
    velocities = [joint.velocity_start() for joint in limited]
    k, d = (np.broadcast_to(values, plant.num_velocities())[velocities] for values in (stiffness, damping))
    pick = np.zeros((count, plant.num_multibody_states()))
    pick[rows, [joint.position_start() for joint in limited]] = 1.0
    pick[rows, [plant.num_positions() + velocity for velocity in velocities]] = d / k
    push = np.zeros((plant.num_velocities(), 2 * count))
    push[velocities, rows] = -k
    push[velocities, count + rows] = k

    ahead = mapped(builder, "stops.position_ahead", pick, plant.get_state_output_port())
    lower = np.array([joint.position_lower_limit() for joint in limited])
    upper = np.array([joint.position_upper_limit() for joint in limited])
    clip = fed(builder, "stops.range", Saturation(lower, upper), ahead)
    return mapped(builder, "stops.force", push, joined(builder, "stops.penetration", ahead, clip))
