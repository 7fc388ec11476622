"""Forces on a plant that need no motor: at points of bodies, Coulomb friction of joints, and end stops of joints.

All are made of C++ blocks of Drake, which take little time.
"""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import MultibodyPlant, Propeller, PropellerInfo
from pydrake.multibody.tree import (
    Frame,
    Joint,
    JointActuator,
    JointActuatorIndex,
    JointIndex,
    PdControllerGains,
)
from pydrake.systems.framework import DiagramBuilder, OutputPort
from pydrake.systems.primitives import Saturation

from simrob_drake.base.frames import Vector
from simrob_drake.blocks.block import add_and_connect, add_matrix_gain, add_multiplexer

# Rotations of a frame after which its z axis is the x, y and z axis of the frame before.
_Z_TO_AXES = (
    RotationMatrix.MakeYRotation(np.pi / 2),
    RotationMatrix.MakeXRotation(-np.pi / 2),
    RotationMatrix.Identity(),
)


def add_external_force(
    builder: DiagramBuilder,
    plant: MultibodyPlant,
    frame: Frame,
    *,
    name: str,
    point: npt.ArrayLike = (0.0, 0.0, 0.0),
    turns: bool = False,
) -> Propeller:
    """Add a force or a torque in the three axes of a frame.

    Drake's Propeller pushes along the z axis of a frame fixed to a body, or turns the body about it. Three of them,
    without drag, make a vector.

    Args:
        builder: builder of the diagram.
        plant: the finalized plant, or the block of another engine that stands for it.
        frame: frame in whose axes the force acts.
        name: name of the block.
        point: point of the frame at which the force acts, shape (3,) [m].
        turns: whether the vector is a torque; otherwise it is a force. A torque does not depend on the point.

    Returns:
        The block. Its input ``command`` (3) is the force [N] or torque [N·m], and its output ``spatial_forces`` is to
        be connected to the plant.
    """
    body = frame.body()
    pose = frame.GetFixedPoseInBodyFrame() @ RigidTransform(np.asarray(point, dtype=float))
    propellers = [
        PropellerInfo(
            body_index=body.index(),
            X_BP=RigidTransform(pose.rotation() @ rotation, pose.translation()),
            # The propeller's force is thrust_ratio u, its moment moment_ratio u: u is in N or N·m.
            thrust_ratio=float(not turns),
            moment_ratio=float(turns),
        )
        for rotation in _Z_TO_AXES
    ]
    block = builder.AddNamedSystem(name, Propeller(propellers))
    builder.Connect(plant.get_body_poses_output_port(), block.get_body_poses_input_port())
    return block


def set_friction(
    plant: MultibodyPlant,
    joints: Sequence[Joint],
    friction: Vector,
    speed: float,
) -> None:
    r"""Add Coulomb friction to joints of a plant that is not yet finalized.

    .. math:: \tau = -c \,\mathrm{sat}(v / v_s), \qquad \mathrm{sat}(x) = \max(-1, \min(1, x))

    This is the law of a servo that holds the joint at rest without stiffness, with the damping :math:`c / v_s` and the
    effort limit c. So each joint gets a further actuator. If it has a motor, the rotor inertia of the motor's actuator
    moves to the further one. Every scheme of Drake treats the law alike, and the implicit schemes need no small steps
    for it. Static friction is not larger than sliding friction, and a load below c moves the joint by at most
    :math:`v_s`.

    The caller must connect the desired state of the model instance, which then contains the further actuators.

    Args:
        plant: the plant.
        joints: n joints with one axis each.
        friction: friction c of each joint, shape (n,) [N·m or N], not negative; 0 adds nothing.
        speed: speed :math:`v_s` below which the friction fades [rad/s or m/s].
    """
    # The first actuator of each joint.
    motor_of_joint = dict[JointIndex, JointActuator]()
    for index in range(plant.num_actuators()):
        motor = plant.get_joint_actuator(JointActuatorIndex(index))
        motor_of_joint.setdefault(motor.joint().index(), motor)

    for joint, effort_limit in zip(joints, friction.tolist(), strict=True):
        # Drake refuses an actuator whose effort limit is not positive.
        if effort_limit <= 0:
            continue
        brake = plant.AddJointActuator(f"{joint.name()}_friction", joint, effort_limit)
        # The actuator's torque clip(d (0 - v), -c, c) with d = c / v_s is the equation above.
        brake.set_controller_gains(PdControllerGains(p=0.0, d=effort_limit / speed))
        joint_motor = motor_of_joint.get(joint.index())
        if joint_motor is not None:
            # Drake uses the rotor inertia of a joint's last actuator only, so the brake takes over the motor's rotor.
            brake.set_default_gear_ratio(joint_motor.default_gear_ratio())
            brake.set_default_rotor_inertia(joint_motor.default_rotor_inertia())
            joint_motor.set_default_rotor_inertia(0.0)


def add_joint_stops(
    builder: DiagramBuilder,
    plant: MultibodyPlant,
    *,
    stiffness: npt.ArrayLike,
    damping: npt.ArrayLike,
    joints: Sequence[Joint] | None = None,
) -> OutputPort | None:
    r"""Add elastic stops at all finite limits of a plant's one-axis joints.

    They are for schemes that do not know joint limits: springs with dampers, which only push. With
    :math:`w = q + (d/k)\,v`,

    .. math:: \tau = -k\,\bigl(w - \mathrm{clip}(w, q_{lower}, q_{upper})\bigr).

    Within its range a joint feels nothing, except that the damper acts d/k (about 1 ms) before the limit is reached.

    The joints of the Simulink models have 1e4 N·m/deg and 10 N·m·s/deg, with a transition of 0.1 deg at the limit.

    Args:
        builder: builder of the diagram.
        plant: the finalized plant.
        stiffness: stiffness k, positive [N·m/rad, or N/m for prismatic joints]: one value for all joints, or one for
            each velocity of the plant, shape (nv,).
        damping: damping d, not negative [N·m·s/rad, or N·s/m], of the same shapes.
        joints: the joints that get stops if they have limits, or None for all joints of the plant.

    Returns:
        The generalized forces, size nv. Returns None if no joint has a limit.
    """
    if joints is None:
        joints = [plant.get_joint(JointIndex(index)) for index in range(plant.num_joints())]
    one_axis_joints = [joint for joint in joints if joint.num_velocities() == 1]
    limited = [joint for joint in one_axis_joints if _has_limit(joint)]
    if not limited:
        return None
    count = len(limited)
    rows = np.arange(count)
    position_columns = [joint.position_start() for joint in limited]
    velocities = [joint.velocity_start() for joint in limited]
    k = np.broadcast_to(stiffness, plant.num_velocities())[velocities]
    d = np.broadcast_to(damping, plant.num_velocities())[velocities]

    # w = q + (d/k) v of each of the joints (row), from the positions and velocities of the plant (columns).
    to_damped_position = np.zeros((count, plant.num_multibody_states()))
    to_damped_position[rows, position_columns] = 1.0
    to_damped_position[rows, [plant.num_positions() + velocity for velocity in velocities]] = d / k
    # tau = -k w + k clip(w), from w and its clipped value. Joints without stops get zero.
    to_force = np.zeros((plant.num_velocities(), 2 * count))
    to_force[velocities, rows] = -k
    to_force[velocities, count + rows] = k

    damped_position = add_matrix_gain(
        builder, "stops.position_ahead", to_damped_position, plant.get_state_output_port()
    )
    # A joint with one limit has an infinite other one, which never clips.
    lower = np.array([joint.position_lower_limit() for joint in limited])
    upper = np.array([joint.position_upper_limit() for joint in limited])
    clipped = add_and_connect(builder, "stops.range", Saturation(lower, upper), damped_position)
    both = add_multiplexer(builder, "stops.penetration", damped_position, clipped)
    return add_matrix_gain(builder, "stops.force", to_force, both)


def _has_limit(joint: Joint) -> bool:
    """Whether a joint with one axis has a finite limit."""
    limits = [joint.position_lower_limit(), joint.position_upper_limit()]
    return bool(np.isfinite(limits).any())
