r"""Torques from outside, as a momentum observer estimates them from motion and motor torques alone.

The generalized momentum :math:`p = M v` of a robot changes by

.. math:: \dot p = \tau + \tau_{ext} + \dot M v - C v + g ,

with the servos' torques :math:`\tau`, Coriolis and damping forces :math:`C v` and gravity :math:`g`. Over a sample of
length h the mean external torque is :math:`\bar\tau_k = (p_k - p_{k-1})/h - (f_k + f_{k-1})/2` where f is all but the
unknown; it passes a first-order filter, :math:`r_k = r_{k-1} + (1 - e^{-K h})(\bar\tau_k - r_{k-1})`.

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

_EPSILON = 1e-5  # s: how far along the motion the mass matrix is looked at for its rate


class MomentumObserver(Block):
    """Estimate the torques from outside at the joints of a robot, and the force at its tool that would cause them.

    Ports:
        in  ``state`` (nq + nv): positions and velocities of the whole plant.
        in  ``torque`` (n): of the servos, in axis order [N·m].
        out ``external_torque`` (n): the estimate r [N·m].
        out ``external_force`` (3): the force at the tool's origin, in its axes, that explains r best [N]; with a tool.
    """

    def __init__(
        self, *, plant: MultibodyPlant, axes: AxisMap, gain: float, period: float, tool: Frame | None = None
    ) -> None:
        """Make the block for the axes of a robot in a finalized plant, which need not be part of the diagram.

        Its gain is K [1/s], by which the estimate lags 1/K, its period h, between samples [s]; the tool is where the
        force is thought to act.
        """
        super().__init__()
        for name, value in (("gain", gain), ("period", period)):
            if not (np.isfinite(value) and value > 0):
                raise InvalidParameter(name, value, message("blocks.positive_and_finite", "positive and finite"))
        count = len(axes.signs)
        self._plant, self._axes, self.period = weakref.proxy(plant), axes, period
        self._tool = None if tool is None else tool.index()
        self._share = 1 - np.exp(-gain * period)
        self._scratch = plant.CreateDefaultContext()  # nothing is remembered in it: every evaluation sets it anew
        self._state = self.DeclareVectorInputPort("state", plant.num_multibody_states())
        self._torque = self.DeclareVectorInputPort("torque", count)
        self._memory = self.DeclareDiscreteState(np.full(3 * count, np.inf))  # r, p, f; unknown before the first sample
        self.DeclareVectorOutputPort("external_torque", count, weakly(self._calc_torque))
        if tool is not None:
            self.DeclareVectorOutputPort("external_force", 3, weakly(self._calc_force))
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._update)

    def next_state(self, memory: Vector, state: Vector, torque: Vector) -> Vector:
        """Return what is remembered after a sample: r, p and f, shape (3n,); ``memory`` is infinite at the first one.

        It follows from the state of the plant, shape (nq + nv,), and the torques of the servos, shape (n,) [N·m].
        """
        momentum, rate = self._momentum_and_rate(state)
        known = torque + rate
        estimate, last_momentum, last_known = np.split(memory, 3)
        if np.isinf(memory).any():
            return np.concatenate([np.zeros_like(momentum), momentum, known])
        mean = (momentum - last_momentum) / self.period - (known + last_known) / 2
        return np.concatenate([estimate + self._share * (mean - estimate), momentum, known])

    def force(self, state: Vector, torque: Vector) -> Vector:
        """Return the force at the tool, shape (3,) [N] in its axes, that explains torques (n,) [N·m] best."""
        assert self._tool is not None
        plant, nothing = self._plant, np.zeros(3)
        tool = plant.get_frame(self._tool)
        plant.SetPositionsAndVelocities(self._scratch, state)
        jacobian = plant.CalcJacobianTranslationalVelocity(
            self._scratch, JacobianWrtVariable.kV, tool, nothing, plant.world_frame(), tool
        )
        return np.asarray(np.linalg.lstsq(self._axes.velocities(jacobian).T, torque, rcond=1e-6)[0])

    def _momentum_and_rate(self, state: Vector) -> tuple[Vector, Vector]:
        """Return p and what the model knows of its rate, but for the torques, each (n,) in axis order."""
        plant, context = self._plant, self._scratch
        positions, velocities = np.split(state, [plant.num_positions()])
        plant.SetPositionsAndVelocities(context, state)
        step = _EPSILON * plant.MapVelocityToQDot(context, velocities)
        forces = MultibodyForces(nb=plant.num_bodies(), nv=plant.num_velocities())
        plant.CalcForceElementsContribution(context, forces)
        known = -plant.CalcInverseDynamics(context, np.zeros_like(velocities), forces)
        momentum = plant.CalcMassMatrix(context) @ velocities
        ahead, behind = (self._momentum(positions + sign * step, velocities) for sign in (1, -1))
        known += (ahead - behind) / (2 * _EPSILON)
        return self._axes.efforts(momentum), self._axes.efforts(known)

    def _momentum(self, positions: Vector, velocities: Vector) -> Vector:
        self._plant.SetPositions(self._scratch, positions)
        return np.asarray(self._plant.CalcMassMatrix(self._scratch) @ velocities)

    def _update(self, context: Context, discrete: DiscreteValues) -> None:
        memory = context.get_discrete_state(self._memory).value()
        after = self.next_state(memory, self._state.Eval(context), self._torque.Eval(context))
        discrete.set_value(self._memory, after)

    def estimate(self, context: Context) -> Vector:
        """Return r (n,) [N·m]; zero before the first sample."""
        memory = context.get_discrete_state(self._memory).value()
        estimate = memory[: len(memory) // 3]
        return np.where(np.isinf(estimate), 0.0, estimate)

    def _calc_torque(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self.estimate(context))

    def _calc_force(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self.force(self._state.Eval(context), self.estimate(context)))
