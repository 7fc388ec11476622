"""An external force or torque at the tool centre point, from C++ blocks alone."""

import numpy as np
import numpy.typing as npt
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import MultibodyPlant, Propeller, PropellerInfo
from pydrake.multibody.tree import Frame
from pydrake.systems.framework import DiagramBuilder


def add_external_force(
    builder: DiagramBuilder,
    plant: MultibodyPlant,
    frame: Frame,
    *,
    name: str,
    point: npt.ArrayLike = (0.0, 0.0, 0.0),
    turns: bool = False,
) -> Propeller:
    """Add a force along the three axes of a frame, as three propellers without drag, at a ``point`` (3,) [m] in it.

    Drake's Propeller pushes along the z axis of a frame fixed to a body, or ``turns`` it about that axis; three of them
    make a vector.

    Returns:
        the block: its ``command`` input (3) is the force [N], or the torque [N·m]; its ``spatial_forces`` output goes
        to the plant.
    """
    body = frame.body()
    pose = frame.GetFixedPoseInBodyFrame() @ RigidTransform(np.asarray(point, dtype=float))
    along_z = {
        "x": RotationMatrix.MakeYRotation(np.pi / 2),
        "y": RotationMatrix.MakeXRotation(-np.pi / 2),
        "z": RotationMatrix.Identity(),
    }
    propellers = [
        PropellerInfo(
            body.index(), RigidTransform(pose.rotation() @ turn, pose.translation()), float(not turns), float(turns)
        )
        for turn in along_z.values()
    ]
    block = builder.AddNamedSystem(name, Propeller(propellers))
    builder.Connect(plant.get_body_poses_output_port(), block.get_body_poses_input_port())
    return block
