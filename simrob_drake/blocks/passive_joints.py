"""Forces on a plant, of C++ primitives alone: at points of bodies, Coulomb friction and end stops of joints."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import MultibodyPlant, Propeller, PropellerInfo
from pydrake.multibody.tree import Frame, Joint, JointActuatorIndex, JointIndex, PdControllerGains
from pydrake.systems.framework import DiagramBuilder, OutputPort
from pydrake.systems.primitives import Saturation

from simrob_drake.base.frames import Vector
from simrob_drake.blocks.block import fed, joined, mapped


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


def set_friction(plant: MultibodyPlant, joints: Sequence[Joint], friction: Vector, speed: float) -> None:
    r"""Add Coulomb friction c (n,) [N·m or N] to joints, not negative, before their plant is finalized.

    .. math:: \tau = -c \,\mathrm{sat}(v / v_s), \qquad \mathrm{sat}(x) = \max(-1, \min(1, x))

    is a servo that wants the joint to rest, with no stiffness, the damping c / v_s and the effort limit c. So it is an
    actuator of the plant beside the motor's, which every scheme of Drake treats alike: the implicit ones without a
    limit of steps. Stiction is not more than sliding friction, and a load below c creeps by at most v_s, the speed
    below which it fades [rad/s or m/s]. Whoever wires the plant gives the robot's desired state.
    """
    motors = [plant.get_joint_actuator(JointActuatorIndex(index)) for index in range(plant.num_actuators())]
    for joint, most in zip(joints, friction.tolist(), strict=True):
        if most > 0:
            brake = plant.AddJointActuator(f"{joint.name()}_friction", joint, most)
            brake.set_controller_gains(PdControllerGains(p=0.0, d=most / speed))
            motor = next((motor for motor in motors if motor.joint().index() == joint.index()), None)
            if motor is None:
                continue  # a passive joint: it has no rotor that Drake could count twice
            brake.set_default_gear_ratio(motor.default_gear_ratio())
            brake.set_default_rotor_inertia(motor.default_rotor_inertia())
            motor.set_default_rotor_inertia(0.0)  # Drake counts the rotor of a joint's last actuator alone


def add_joint_stops(
    builder: DiagramBuilder,
    plant: MultibodyPlant,
    *,
    stiffness: npt.ArrayLike,
    damping: npt.ArrayLike,
    joints: Sequence[Joint] | None = None,
) -> OutputPort | None:
    r"""Return the generalized forces (nv) of stops at all finite limits of a plant's one-axis joints; None without any.

    They are for schemes that know no joint limits: springs and dampers that only push, with :math:`w = q + (d/k)\,v`,

    .. math:: \tau = -k\,\bigl(w - \mathrm{clip}(w, q_{lower}, q_{upper})\bigr).

    Inside its range a joint feels nothing, but that the damper already acts d/k (1 ms) before the limit is reached.
    Figures: the joints of the Simulink models, 1e4 N·m/deg and 10 N·m·s/deg, whose transition of 0.1 deg takes the same
    place. They have the stiffness k [N·m/rad, and N/m of joints that slide], positive, and the damping d [N·m·s/rad,
    and N·s/m], not negative: one figure for all joints, or one for each of the plant's velocities (nv,). ``joints`` are
    the joints that get stops if they have limits; None means all joints of the plant.
    """
    if joints is None:
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
