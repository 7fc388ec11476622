r"""Coulomb friction in joints, which every scheme of Drake treats alike: the implicit ones without a limit of steps.

.. math:: \tau = -c \,\mathrm{sat}(v / v_s), \qquad \mathrm{sat}(x) = \max(-1, \min(1, x))

is a servo that wants the joint to rest, with no stiffness, the damping c / v_s and the effort limit c. So it is an
actuator of the plant beside the motor's. Stiction is not more than sliding friction, and a load below c creeps by at
most v_s.
"""

from collections.abc import Sequence

from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Joint, JointActuatorIndex, PdControllerGains

from simrob_drake.frames import Vector


def set_friction(plant: MultibodyPlant, joints: Sequence[Joint], friction: Vector, speed: float) -> None:
    """Add friction c (n,) [N·m or N] to joints, not negative, before their plant is finalized.

    Its speed v_s is that below which it fades [rad/s or m/s]. Whoever wires the plant gives the robot's desired state.
    """
    motors = [plant.get_joint_actuator(JointActuatorIndex(index)) for index in range(plant.num_actuators())]
    for joint, most in zip(joints, friction.tolist(), strict=True):
        if most > 0:
            brake = plant.AddJointActuator(f"{joint.name()}_friction", joint, most)
            brake.set_controller_gains(PdControllerGains(p=0.0, d=most / speed))
            motor = next(motor for motor in motors if motor.joint().index() == joint.index())
            brake.set_default_gear_ratio(motor.default_gear_ratio())
            brake.set_default_rotor_inertia(motor.default_rotor_inertia())
            motor.set_default_rotor_inertia(0.0)  # Drake counts the rotor of a joint's last actuator alone
