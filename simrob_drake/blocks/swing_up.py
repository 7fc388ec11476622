r"""Swing an underactuated robot up by its energy, and balance it there by a linear quadratic regulator.

The robot has one passive axis p and driven axes a. Its equations of motion are

.. math:: M(q)\,\ddot q + h(q, \dot q) = (0, u), \qquad h = C(q, \dot q)\,\dot q + D\,\dot q - \tau_g(q) .

Far from the upright posture, the motors accelerate the driven axes by

.. math:: \ddot q_a = k_E\,(E - E^*)\,M_{ap}\,\dot q_p - k_p\,(q_a - q_a^*) - k_d\,\dot q_a, \qquad
    E = \tfrac12 \dot q^T M(q)\,\dot q + U(q), \quad E^* = U(q^*) .

An acceleration of the driven axes changes the energy of the passive axis by :math:`-\dot q_p M_{pa} \ddot q_a`, so
the first term makes its error fade; the others keep the driven axes near their posture. E is the energy of the whole
robot, as for Spong's acrobot, or that of the passive axis as seen from the driven ones,
:math:`\tfrac12 M_{pp} \dot q_p^2 + U`, as the textbook has it for a pole on a cart. The torques that give this
acceleration follow from the equations of motion, solved for the passive axis first (collocated partial feedback
linearisation):

.. math:: u = (M_{aa} - M_{ap} M_{pp}^{-1} M_{pa})\,\ddot q_a + h_a - M_{ap} M_{pp}^{-1} h_p .

Near the upright posture, :math:`u = u^* - K x`, where x are the errors of positions and velocities, and K is the gain
of the regulator that minimises :math:`\int x^T Q\,x + u^T R\,u\,dt` for the motion linearised there.

Sources: M. W. Spong, "The swing up control problem for the acrobot", IEEE Control Systems 15(1), 1995;
R. Tedrake, "Underactuated Robotics", chapter 3.
"""

import weakref
from typing import NamedTuple

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import JointIndex, MultibodyForces
from pydrake.systems.controllers import LinearQuadraticRegulator
from pydrake.systems.framework import Context

from simrob_drake.base.errors import InvalidParameter, quote_value
from simrob_drake.base.frames import Flags, Vector
from simrob_drake.base.messages import message
from simrob_drake.blocks.sampled import Changes, Named, SampledBlock
from simrob_drake.robots.axis_map import AxisMap

_ANGLE_STEP = 1e-5
"""Step of the central differences of holding torques [rad or m]: their error is 1e-10 of these torques, and that of
rounding 1e-11."""
_BALANCED = 1e-6
"""Largest torque on the passive axis in an equilibrium, as a share of the largest holding torque or stiffness."""
_LEAST_SPEED = 0.05
"""Speed [rad/s or m/s] that a slower passive axis is taken to have, so that the law moves a robot that hangs still."""
_RELEASE = 2.0
"""Cost above which the regulator gives up, in multiples of the cost below which it takes over."""


class LqrWeights(NamedTuple):
    """Weights of the regulator's cost, in the order of the axes.

    Attributes:
        position: weight of each position's squared error, shape (n,) [1/rad² or 1/m²].
        velocity: weight of each squared velocity, shape (n,) [s²/rad² or s²/m²].
        torque: weight of each squared torque, shape (n,) [1/(N·m)² or 1/N²]. Those of passive axes are not used.
    """

    position: Vector
    velocity: Vector
    torque: Vector


class SwingUpGains(NamedTuple):
    """Gains of the acceleration of the driven axes, and the energy that it brings to the upright one.

    Attributes:
        energy: acceleration for an error of the energy, k_E in the module's equation.
        position: acceleration for an error of the position, k_p [1/s²].
        velocity: acceleration for a velocity, k_d [1/s].
        of_passive_axis: whether the energy is that of the passive axis alone, and not that of the whole robot.
    """

    energy: float
    position: float
    velocity: float
    of_passive_axis: bool = False


class EquationTerms(NamedTuple):
    """Terms of the equations of motion in one state of a robot with n axes.

    Attributes:
        mass: mass matrix M, shape (n, n) [kg m² or kg].
        bias: Coriolis terms, damping and weights h, shape (n,) [N·m or N].
    """

    mass: Vector
    bias: Vector


class AxisDynamics:
    """Equations of motion of the axes of a robot that is in a finalized plant. The rest of the plant stands still."""

    def __init__(self, plant: MultibodyPlant, axes: AxisMap) -> None:
        """Create the model.

        Args:
            plant: finalized plant, which is held weakly. It need not be part of a diagram.
            axes: the robot's axes in the plant.
        """
        self._plant = weakref.proxy(plant)
        self._axes = axes
        # Nothing is remembered in the context: each method sets the whole state of the robot.
        self._context: Context = plant.CreateDefaultContext()
        self._rest = plant.GetPositions(self._context)
        # The bias h contains D v already, but the regulator's linear model needs D itself.
        damping = np.zeros(plant.num_velocities())
        for index in range(plant.num_joints()):
            joint = plant.get_joint(JointIndex(index))
            start = joint.velocity_start()
            damping[start : start + joint.num_velocities()] = joint.default_damping_vector()
        self.damping: Vector = damping[axes.velocity_places]
        """Damping of the joints, shape (n,) [N·m·s/rad or N·s/m]."""

    def terms(self, positions: Vector, velocities: Vector) -> EquationTerms:
        """Compute mass matrix and bias at positions (n,) [rad or m] and velocities (n,) [rad/s or m/s]."""
        self._set_state(positions, velocities)
        places = self._axes.velocity_places
        signs = self._axes.signs
        # M of the axes: rows and columns of their joints, with the signs s of the axes: s_i M_ij s_j.
        plant_mass = self._plant.CalcMassMatrix(self._context)
        mass = plant_mass[np.ix_(places, places)] * np.outer(signs, signs)

        # Inverse dynamics without acceleration: Coriolis terms, less the forces of weight, springs and damping.
        forces = MultibodyForces(self._plant.num_bodies(), self._plant.num_velocities())
        self._plant.CalcForceElementsContribution(self._context, forces)
        no_acceleration = np.zeros(self._plant.num_velocities())
        effort = self._plant.CalcInverseDynamics(self._context, no_acceleration, forces)
        return EquationTerms(mass=mass, bias=self._axes.efforts(effort))

    def potential_energy(self, positions: Vector) -> float:
        """Compute the potential energy of the plant [J] at positions (n,) of the robot."""
        self._set_state(positions, np.zeros(len(positions)))
        return float(self._plant.CalcPotentialEnergy(self._context))

    def weights(self, positions: Vector) -> Vector:
        """Compute the torques (n,) [N·m or N] that hold the robot at positions (n,), against gravity and springs."""
        return self.terms(positions, np.zeros(len(positions))).bias

    def stiffness(self, positions: Vector) -> Vector:
        """Compute the derivatives of the holding torques (:meth:`weights`) by the positions (n,).

        Returns:
            the derivatives, shape (n, n) [N·m/rad or N/m]: one row for each torque, one column for each position.
        """
        # dh/dq_j = (h(q + e_j) - h(q - e_j)) / (2 eps) at rest: one column for each position.
        columns = []
        for step in _ANGLE_STEP * np.eye(len(positions)):
            difference = self.weights(positions + step) - self.weights(positions - step)
            columns.append(difference / (2.0 * _ANGLE_STEP))
        return np.column_stack(columns)

    def _set_state(self, positions: Vector, velocities: Vector) -> None:
        """Set positions (n,) and velocities (n,) of the axes in the context; all else stands as at the start."""
        self._plant.SetPositions(self._context, self._axes.spread_positions(positions, self._rest))
        self._plant.SetVelocities(self._context, self._axes.spread_velocities(velocities))


class Regulator(NamedTuple):
    """A linear quadratic regulator about an equilibrium, for n axes of which m are driven.

    Attributes:
        dynamics_matrix: A of x' = A x + B (u - u*), shape (2n, 2n). x are position errors, then velocities.
        input_matrix: B, shape (2n, m).
        gain: K of u = u* - K x, shape (m, 2n).
        cost: S, shape (2n, 2n): x' S x is the cost of the way from x to the equilibrium.
        torque: torques u* in the equilibrium, shape (m,) [N·m or N].
    """

    dynamics_matrix: Vector
    input_matrix: Vector
    gain: Vector
    cost: Vector
    torque: Vector

    def largest_cost(self, torque_limit: Vector) -> float:
        r"""Compute the largest cost r for which no motor saturates on the way to the equilibrium.

        On the set :math:`x^T S x \le r` the largest torque of a motor with the row k of the gain is
        :math:`\sqrt{r\,k S^{-1} k^T}`. The regulator does not leave the set as long as the motion is linear.

        Args:
            torque_limit: torque limits of the driven axes, shape (m,) [N·m or N].
        """
        # k S^-1 k' for each row k of the gain: the motor's largest squared torque on the set x' S x = 1.
        spread = np.einsum("ij,ji->i", self.gain, np.linalg.solve(self.cost, self.gain.T))
        # Holding the posture takes the part u* of each limit. The square of the remaining part bounds r k S^-1 k'.
        remaining = np.maximum(torque_limit - np.abs(self.torque), 0.0)
        return float(np.min(remaining**2 / spread))


def balance_regulator(
    dynamics: AxisDynamics,
    driven: Flags,
    upright: Vector,
    weights: LqrWeights,
    *,
    key: str = "upright",
) -> Regulator:
    """Design the regulator that balances a robot, by Drake's solver of the Riccati equation.

    Args:
        dynamics: the robot.
        driven: whether each axis has a motor, shape (n,).
        upright: posture to be balanced, shape (n,) [rad or m].
        weights: weights of the cost that the regulator minimises.
        key: name of the posture, for errors.

    Returns:
        the regulator, with the linear model for which it is designed.

    Raises:
        InvalidParameter: the robot is not in equilibrium there, or its motors cannot balance it.
    """
    # Torques of all axes that hold the robot there. A passive axis has no motor, so it rests only if its torque is 0.
    holding = dynamics.weights(upright)
    stiffness = dynamics.stiffness(upright)
    passive_weight = float(np.abs(holding[~driven]).max(initial=0.0))
    # The scale of the holding torques: those of an upright posture may all be zero, their derivatives are not.
    scale = max(float(np.abs(stiffness).max()), float(np.abs(holding).max()))
    if passive_weight > _BALANCED * scale:
        expected = message(
            "blocks.an_equilibrium",
            "an equilibrium of the passive axis, on which gravity acts with {torque:.3g} N·m there",
            torque=passive_weight,
        )
        raise InvalidParameter(key, quote_value(upright), expected)

    # The linear model x' = A x + B (u - u*): M q'' = -K q - D q' + u, with the stiffness K.
    count = len(upright)
    mass = dynamics.terms(upright, np.zeros(count)).mass
    accelerations = np.linalg.solve(mass, np.hstack([-stiffness, -np.diag(dynamics.damping)]))
    # The rates of the position errors in x are the velocities in x.
    position_rates = np.hstack([np.zeros((count, count)), np.eye(count)])
    dynamics_matrix = np.vstack([position_rates, accelerations])
    # Columns of the identity: the torques of the motors among those of all axes.
    torques = np.eye(count)[:, driven]
    input_matrix = np.vstack([np.zeros_like(torques), np.linalg.solve(mass, torques)])
    state_weights = np.diag(np.concatenate([weights.position, weights.velocity]))
    torque_weights = np.diag(weights.torque[driven])
    try:
        gain, cost = LinearQuadraticRegulator(
            dynamics_matrix, input_matrix, state_weights, torque_weights
        )
    except RuntimeError as problem:
        expected = message(
            "blocks.a_posture_to_balance",
            "a posture that the motors can balance ({problem})",
            problem=problem,
        )
        raise InvalidParameter(key, quote_value(upright), expected) from problem
    return Regulator(
        dynamics_matrix=dynamics_matrix,
        input_matrix=input_matrix,
        gain=gain,
        cost=cost,
        torque=holding[driven],
    )


def nearest_error(error: Vector, turns: Flags) -> Vector:
    """Errors of positions to the nearest turn: from -pi to pi for axes that turn, unchanged for axes that slide.

    Args:
        error: errors, shape (n,) [rad or m].
        turns: whether each axis turns, shape (n,).
    """
    # An axis may have turned several times while it swung: a whole turn is no error.
    nearest = (error + np.pi) % (2.0 * np.pi) - np.pi
    return np.where(turns, nearest, error)


class SwingUp(SampledBlock):
    r"""Swing a robot with one passive axis up, and balance it: the equations of the module.

    The regulator takes over where the cost of its way is below ``catch`` times the largest one that no motor's limit
    disturbs, and gives up above twice that cost. Errors of axes that turn are taken to the nearest turn.

    Ports:
        in  ``position``, ``velocity`` (n) [rad or m, rad/s or m/s]: measured.
        out ``feedforward`` (n) [N·m or N]: torques of the motors, before their limits; 0 of the passive axis.
            ``energy`` (1) [J]: E - E*. ``balancing`` (1): 1 while the regulator acts, 0 while the robot swings.
    """

    def __init__(
        self,
        *,
        plant: MultibodyPlant,
        axes: AxisMap,
        torque_limit: Vector,
        turns: Flags,
        upright: Vector,
        weights: LqrWeights,
        gains: SwingUpGains,
        catch: float = 1.0,
        period: float = 0.005,
        key: str = "upright",
    ) -> None:
        """Create the block.

        Args:
            plant: finalized plant, which is held weakly. It need not be part of the diagram.
            axes: the robot's axes in the plant.
            torque_limit: torque limits, shape (n,) [N·m or N]. The axis with the limit 0 is passive.
            turns: whether each axis turns, and does not slide, shape (n,).
            upright: posture to be balanced, shape (n,) [rad or m].
            weights: weights of the regulator.
            gains: gains of the swing-up.
            catch: cost below which the regulator takes over, as a part of `Regulator.largest_cost`.
            period: time between two samples [s].
            key: name of the posture, for errors.

        Raises:
            InvalidParameter: no axis is passive, several are, or no axis is driven; the robot is not in equilibrium in
                the posture `upright`, or its motors cannot balance it there.
        """
        count = len(upright)
        self._driven = torque_limit > 0
        if int(self._driven.sum()) != count - 1 or count < 2:
            expected = message(
                "blocks.one_passive_axis",
                "0 for one axis, which is passive, and positive for the others",
            )
            raise InvalidParameter("torque_limit", quote_value(torque_limit), expected)
        self.units = {"feedforward": "N·m", "energy": "J"}
        zero = np.zeros(1)
        super().__init__(
            period=period,
            reads={"position": count, "velocity": count},
            memory={"feedforward": np.zeros(count), "energy": zero, "balancing": zero},
            gives=("feedforward", "energy", "balancing"),
        )
        self._dynamics = AxisDynamics(plant, axes)
        self._turns = turns
        self._upright = upright
        self._gains = gains
        self._upright_energy = self._dynamics.potential_energy(upright)
        self.regulator = balance_regulator(self._dynamics, self._driven, upright, weights, key=key)
        self._catch_cost = catch * self.regulator.largest_cost(torque_limit[self._driven])

    def sample(self, memory: Named, read: Named) -> Changes:
        """Compute the torques: those of the regulator near the upright posture, else those of the swing-up.

        Args:
            memory: the outputs of the last sample, by name. ``balancing`` decides when the regulator gives up.
            read: ``position`` and ``velocity`` of the axes.

        Returns:
            the new outputs, by name.
        """
        position = read["position"]
        velocity = read["velocity"]

        # The regulator acts where the cost of its way is small. It gives up later than it takes over, so that the two
        # laws do not alternate.
        error = nearest_error(position - self._upright, self._turns)
        state = np.concatenate([error, velocity])
        cost = float(state @ self.regulator.cost @ state)
        largest_cost = self._catch_cost * (_RELEASE if memory["balancing"][0] else 1.0)
        is_balancing = cost < largest_cost

        terms = self._dynamics.terms(position, velocity)
        energy = self.energy_error(terms, position, velocity)
        if is_balancing:
            # u = u* - K x.
            torque = self.regulator.torque - self.regulator.gain @ state
        else:
            torque = self.swing_torque(terms, error, velocity, energy)
        feedforward = np.zeros(len(position))
        feedforward[self._driven] = torque
        return {"feedforward": feedforward, "energy": energy, "balancing": float(is_balancing)}

    def energy_error(
        self,
        terms: EquationTerms,
        position: Vector,
        velocity: Vector,
    ) -> float:
        """Compute the energy E, less the one at rest upright [J].

        Args:
            terms: terms of the equations of motion in this state.
            position: positions, shape (n,) [rad or m].
            velocity: velocities, shape (n,) [rad/s or m/s].
        """
        # E = v' M v / 2 + U(q). For the energy of the passive axis alone, the velocities of the driven axes are
        # replaced by 0, which leaves M_pp v_p² / 2.
        counted = np.where(self._driven, 0.0, velocity) if self._gains.of_passive_axis else velocity
        kinetic = 0.5 * float(counted @ terms.mass @ counted)
        return kinetic + self._dynamics.potential_energy(position) - self._upright_energy

    def swing_torque(
        self,
        terms: EquationTerms,
        error: Vector,
        velocity: Vector,
        energy: float,
    ) -> Vector:
        """Compute the torques (m,) [N·m or N] of the motors that drive the energy's error to zero.

        Args:
            terms: terms of the equations of motion in this state.
            error: positions less the upright ones, shape (n,) [rad or m].
            velocity: velocities, shape (n,) [rad/s or m/s].
            energy: energy less the one at rest upright, from :meth:`energy_error` [J].
        """
        driven = self._driven
        passive = ~driven
        passive_inertia = terms.mass[np.ix_(passive, passive)]
        coupling = terms.mass[np.ix_(driven, passive)]

        # A robot that hangs still would not move by the law, since its speed is 0.
        speed = velocity[passive]
        least_speed = np.copysign(_LEAST_SPEED, speed)
        speed = np.where(np.abs(speed) < _LEAST_SPEED, least_speed, speed)

        # The acceleration of the driven axes: the first equation of the module.
        acceleration = self._gains.energy * energy * (coupling @ speed)
        acceleration -= self._gains.position * error[driven]
        acceleration -= self._gains.velocity * velocity[driven]

        # Partial feedback linearisation: eliminate the acceleration of the passive axis. With
        # share = M_ap M_pp^-1, u = (M_aa - share M_pa) ddq_a + h_a - share h_p.
        share = np.linalg.solve(passive_inertia, coupling.T).T
        inertia = terms.mass[np.ix_(driven, driven)] - share @ coupling.T
        return np.asarray(inertia @ acceleration + terms.bias[driven] - share @ terms.bias[passive])
