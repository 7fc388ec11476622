r"""Admittance: servos that give in to forces from outside; the law of the Simulink station ``D30S2_Irb120_qLC_Fext``.

To the torque of a servo comes the integral of what the model of the arm does not explain,

.. math::
    \tau = k_p (q_r - q) - k_d v + \tau_{ff} + x, \qquad \dot x = K_t\,(\mathrm{ID}(q, v) - \tau),

with ID the torque that would keep the arm's velocity as it is (inverse dynamics without acceleration, without any
external force). So below :math:`K_t` [rad/s] the servo's stiffness fades: what is left of it is a damping
:math:`k_p/K_t`, gravity is balanced, and the arm yields to a hand. With :math:`K_t = 0` it is the servo alone.

Here x has the form :math:`\dot x = K_t\,(\mathrm{ID} - k_p (q_r - q) + k_d v - \tau_{ff}) - K_t\,x`, the same as long
as the servo is not saturated; when it is, x does not wind up. Only C++ primitives are used.
"""

import numpy as np
from pydrake.systems.framework import DiagramBuilder, OutputPort
from pydrake.systems.primitives import LinearSystem

from simrob_drake.blocks.servo import ServoGains, ServoSignals
from simrob_drake.blocks.wiring import fed, joined


def add_admittance(
    builder: DiagramBuilder, signals: ServoSignals, gains: ServoGains, model: OutputPort, *, gain: float, prefix: str
) -> OutputPort:
    """Add the integrator of a gain K_t [1/s], positive, that gives a robot's servos their admittance.

    It reads what the servos read, and the torque of the arm's model, size n [N·m].

    Returns:
        x, size n [N·m], which belongs into the sum before the saturation.
    """
    count = len(gains.kp)
    each, stiffness, damping = np.eye(count), np.diag(gains.kp), np.diag(gains.kd)
    parts, columns = [model, signals.reference, signals.state], [each, -stiffness, stiffness, damping]
    if signals.reference_velocity is not None:
        parts, columns = [*parts, signals.reference_velocity], [*columns, -damping]
    if signals.feedforward is not None:
        parts, columns = [*parts, signals.feedforward], [*columns, -each]
    inputs = gain * np.hstack(columns)
    block = LinearSystem(A=-gain * each, B=inputs, C=each, D=np.zeros_like(inputs))
    return fed(builder, f"{prefix}admittance", block, joined(builder, f"{prefix}admittance.bus", *parts))
