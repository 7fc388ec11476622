r"""Observer that estimates external torques on a robot from its motion and its motor torques alone.

The generalized momentum :math:`p = M v` of a robot changes by

.. math:: \dot p = \tau + f + \tau_{ext}, \qquad f = \dot M v - C v + g ,

with the servos' torques :math:`\tau`, the external torques :math:`\tau_{ext}`, Coriolis and damping forces
:math:`C v` and gravity :math:`g`. The model gives f. Over a sample of length h, the mean external torque is

.. math:: \bar\tau_k = (p_k - p_{k-1})/h - (\tau_k + f_k + \tau_{k-1} + f_{k-1})/2 .

It passes a first-order filter, :math:`r_k = r_{k-1} + (1 - e^{-K h})(\bar\tau_k - r_{k-1})`. For prismatic axes, read
N for N·m.

Source: De Luca, Albu-Schäffer, Haddadin, Hirzinger, "Collision Detection and Safe Reaction with the DLR-III
Lightweight Manipulator Arm", IROS 2006; here in discrete time.
"""

import weakref

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Frame, JacobianWrtVariable, MultibodyForces
from pydrake.systems.framework import BasicVector, Context, DiscreteValues

from simrob_drake.base.errors import InvalidParameter
from simrob_drake.base.frames import Vector
from simrob_drake.base.lifetime import weakly
from simrob_drake.base.messages import message
from simrob_drake.blocks.block import Block
from simrob_drake.robots.axis_map import AxisMap

# Time before and after the present, along the motion, over which the rate of the mass matrix is measured [s].
_EPSILON = 1e-5
# Relative size below which a singular value of the Jacobian counts as zero: the tool cannot move that way [1].
_SINGULAR = 1e-6


class MomentumObserver(Block):
    """Estimate the external torques at a robot's joints, and the force at its tool that would cause them.

    Ports:
        in  ``state`` (nq + nv): positions and velocities of the whole plant.
        in  ``torque`` (n): torques of the servos, in axis order [N·m].
        out ``external_torque`` (n): the estimate r of the module's equation [N·m].
        out ``external_force`` (3): the force at the tool's origin, in the tool's axes, that explains r best [N]. The
            port exists if a tool is given.
    """

    def __init__(
        self,
        *,
        plant: MultibodyPlant,
        axes: AxisMap,
        gain: float,
        period: float,
        tool: Frame | None = None,
    ) -> None:
        """Create the block.

        Args:
            plant: the finalized plant, which need not be part of the diagram.
            axes: the robot's axes in the plant.
            gain: K [1/s]. The estimate lags behind by 1/K.
            period: time h between two samples [s].
            tool: frame at which the external force is assumed to act. If it is None, no force is estimated.

        Raises:
            InvalidParameter: the gain or the period is not positive and finite.
        """
        super().__init__()
        for name, value in (("gain", gain), ("period", period)):
            if not (np.isfinite(value) and value > 0):
                raise InvalidParameter(
                    name, value, message("blocks.positive_and_finite", "positive and finite")
                )
        count = len(axes.signs)
        self._plant = weakref.proxy(plant)
        self._axes = axes
        self.period = period
        self._tool = None if tool is None else tool.index()
        self._filter_share = 1 - np.exp(-gain * period)
        # Work space: every evaluation sets its state anew.
        self._scratch = plant.CreateDefaultContext()
        self._state = self.DeclareVectorInputPort("state", plant.num_multibody_states())
        self._torque = self.DeclareVectorInputPort("torque", count)
        # r, p and the known torque of the last sample; infinite before the first one.
        self._memory = self.DeclareDiscreteState(np.full(3 * count, np.inf))
        # Drake keeps the callbacks of ports. They hold the block weakly, as it would otherwise never be freed.
        self.DeclareVectorOutputPort("external_torque", count, weakly(self._calc_torque))
        if tool is not None:
            self.DeclareVectorOutputPort("external_force", 3, weakly(self._calc_force))
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._update)

    def next_state(self, memory: Vector, state: Vector, torque: Vector) -> Vector:
        """Compute the memory after a sample.

        Args:
            memory: memory before the sample, shape (3n,): the estimate r, the momentum p and the known torque
                tau + f, shape (n,) each. It is infinite at the first sample, which gives no estimate yet.
            state: positions and velocities of the plant, shape (nq + nv,).
            torque: torques of the servos, shape (n,) [N·m].

        Returns:
            The new memory, shape (3n,).
        """
        momentum, model_rate = self._momentum_and_rate(state)
        known = torque + model_rate
        estimate, last_momentum, last_known = np.split(memory, 3)
        if np.isinf(memory).any():
            no_estimate = np.zeros_like(momentum)
            return np.concatenate([no_estimate, momentum, known])
        # The equations of the module: the mean external torque since the last sample, and its filter.
        mean = (momentum - last_momentum) / self.period - (known + last_known) / 2
        filtered = estimate + self._filter_share * (mean - estimate)
        return np.concatenate([filtered, momentum, known])

    def force(self, state: Vector, torque: Vector) -> Vector:
        """Compute the force at the tool, shape (3,) [N] in the tool's axes, that explains torques (n,) [N·m] best.

        Args:
            state: positions and velocities of the plant, shape (nq + nv,).
            torque: external torques in axis order, shape (n,) [N·m].
        """
        # The output port of the force is declared with the tool only.
        assert self._tool is not None
        plant = self._plant
        tool = plant.get_frame(self._tool)
        plant.SetPositionsAndVelocities(self._scratch, state)
        origin = np.zeros(3)
        jacobian = plant.CalcJacobianTranslationalVelocity(
            self._scratch, JacobianWrtVariable.kV, tool, origin, plant.world_frame(), tool
        )
        # Least squares of the virtual work J' F = torque.
        axes_jacobian = self._axes.velocities(jacobian)
        return np.asarray(np.linalg.lstsq(axes_jacobian.T, torque, rcond=_SINGULAR)[0])

    def _momentum_and_rate(self, state: Vector) -> tuple[Vector, Vector]:
        """Compute the momentum p, and the part f of its rate that the model gives, each shape (n,) in axis order.

        Args:
            state: positions and velocities of the plant, shape (nq + nv,).
        """
        plant = self._plant
        context = self._scratch
        positions, velocities = np.split(state, [plant.num_positions()])
        plant.SetPositionsAndVelocities(context, state)
        # Change of the positions along the motion in the time _EPSILON.
        step = _EPSILON * plant.MapVelocityToQDot(context, velocities)

        # -C v + g, with the damping of the joints in C v: inverse dynamics without acceleration give C v - g.
        forces = MultibodyForces(nb=plant.num_bodies(), nv=plant.num_velocities())
        plant.CalcForceElementsContribution(context, forces)
        no_acceleration = np.zeros_like(velocities)
        rate = -plant.CalcInverseDynamics(context, no_acceleration, forces)
        momentum = plant.CalcMassMatrix(context) @ velocities

        # dM/dt v as a central difference along the motion.
        ahead = self._momentum(positions + step, velocities)
        behind = self._momentum(positions - step, velocities)
        rate += (ahead - behind) / (2 * _EPSILON)
        return self._axes.efforts(momentum), self._axes.efforts(rate)

    def _momentum(self, positions: Vector, velocities: Vector) -> Vector:
        """Compute the momentum M(q) v of the plant, shape (nv,)."""
        self._plant.SetPositions(self._scratch, positions)
        return np.asarray(self._plant.CalcMassMatrix(self._scratch) @ velocities)

    def _update(self, context: Context, discrete: DiscreteValues) -> None:
        """Take a sample; writes the new memory to `discrete`."""
        memory = context.get_discrete_state(self._memory).value()
        new_memory = self.next_state(memory, self._state.Eval(context), self._torque.Eval(context))
        discrete.set_value(self._memory, new_memory)

    def estimate(self, context: Context) -> Vector:
        """The estimate r, shape (n,) [N·m]. It is zero until the second sample, as a rate needs two."""
        memory = context.get_discrete_state(self._memory).value()
        count = len(memory) // 3
        estimate = memory[:count]
        return np.where(np.isinf(estimate), 0.0, estimate)

    def _calc_torque(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self.estimate(context))

    def _calc_force(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self.force(self._state.Eval(context), self.estimate(context)))
