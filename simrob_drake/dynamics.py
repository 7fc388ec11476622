r"""Equations of motion of a robot, and the payloads that its motors can hold.

The torques of the motors are

.. math:: \tau = M(q)\,a + C(q, v)\,v + g(q) + d\,v + c\,\mathrm{sat}(v / v_s)

with the inertia M of the links and of the motors' rotors, centrifugal and Coriolis terms C v, the weight g, viscous
friction d v, and Coulomb friction with the torque c, which changes its sign over the speed :math:`v_s`. Drake computes
M, C v, g and Jacobians.
"""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Literal

import numpy as np
import numpy.typing as npt
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Frame, JacobianWrtVariable, Joint, MultibodyForces

from simrob_drake.base.errors import InvalidParameter, one_of, quoted
from simrob_drake.base.frames import Vector, finite
from simrob_drake.base.messages import message
from simrob_drake.importer.named_robots import read_robot
from simrob_drake.robots.axis_map import AxisMap
from simrob_drake.robots.catalog import RobotModel
from simrob_drake.robots.parse import held_robot

_SPEEDS = JacobianWrtVariable.kV
"""Drake's name for Jacobians that are multiplied by the velocities v, not by the rates of the positions."""

_PARTS = {"all": slice(0, 6), "translation": slice(0, 3), "rotation": slice(3, 6)}
"""Rows of the Jacobian for each part of the tool's velocity."""

_RANDOM_POSTURES = 500
"""Count of the random postures with which the search for the weakest posture begins."""

_CANDIDATES = 3
"""Count of the weakest of these postures from which the search continues."""

_SWEEPS = 3
"""Number of times that the search goes through all axes."""

_ANGLES = 25
"""Count of the positions at which each axis is tried."""

_ROUNDING = 1e-9
"""Excess of a limit that is due to rounding [rad or m]."""

_NOTHING = 1e-9
"""Load of a joint by one kilogram at the tool below which the joint carries nothing of the payload [N·m or N]."""


class Dynamics:
    """Dynamics of a robot whose root is fixed. All joints of its plant that are no axes of the robot are at rest.

    Positions ``q``, velocities ``v``, accelerations ``a`` and torques are arrays (n,), or (k, n) for k postures, which
    give k results. They are in the order and the sense of the axes, in SI units. Everything but the positions may be a
    single number for all axes.

    Attributes:
        name: name of the robot.
        axes: names of the axes, in order.
        torque_limit: largest torques of the motors, shape (n,) [N·m or N].
        friction: torque c of the Coulomb friction, shape (n,) [N·m or N].
        friction_speed: speed v_s at which the Coulomb friction has its full torque [rad/s or m/s].
    """

    def __init__(
        self,
        model: RobotModel,
        plant: MultibodyPlant,
        joints: Sequence[Joint],
        *,
        tool: Frame | None = None,
        torque_limit: Vector | None = None,
        positions: Vector | None = None,
    ) -> None:
        """Make the dynamics of a robot in a finalized plant.

        Args:
            model: the robot's model.
            plant: the plant, with the robot and the pieces that it carries.
            joints: the joints of its axes, in order.
            tool: the frame of the tool, for Jacobians and payloads; None if the robot has no tool.
            torque_limit: largest torques of the motors, shape (n,) [N·m or N]. If it is None, they are the efforts of
                the URDF.
            positions: positions of the whole plant, shape (nq,), for the bodies around the robot. If it is None, they
                are the default positions of the plant.
        """
        self.name = model.name
        self.axes = list(model.axes)
        self.torque_limit = model.efforts if torque_limit is None else torque_limit
        self.friction = model.friction
        self.friction_speed = model.drives.friction_speed
        self._model = model
        self._fingers = model.fingers
        self._range = model.axis_limits
        self._plant = plant
        self._tool = tool
        self._map = AxisMap.of_joints(plant, joints, model.signs)
        self._context = plant.CreateDefaultContext()
        if positions is not None:
            plant.SetPositions(self._context, positions)

    @classmethod
    def of_robot(cls, robot: str | Path | RobotModel, tool: str | None = None) -> "Dynamics":
        """Make the dynamics of a robot without anything around it.

        Args:
            robot: a name of ``simrob list``, the path of a `robot.yaml` or of any URDF, or a robot that was read.
            tool: name of the tool. If it is None, it is the robot's first tool, if the robot has one.

        Raises:
            SimrobError: there is no such robot or tool, the file cannot be read, or a moving link has no inertia.
        """
        model = robot if isinstance(robot, RobotModel) else read_robot(robot)
        if tool is not None:
            one_of(message("base.tool_of", "tool of {model}", model=model.name), tool, model.tools)
        # The mass matrix of such a robot is singular, or belongs to another robot than the real one.
        if model.links_without_inertia:
            lacking = ", ".join(model.links_without_inertia)
            raise InvalidParameter(
                "robot",
                model.name,
                message(
                    "dynamics.links_with_inertia",
                    "a robot whose moving links have inertia; {lacking} have none",
                    lacking=lacking,
                ),
            )
        plant, _ = held_robot(model)
        joints = [plant.GetJointByName(axis.joint) for axis in model.axes.values()]
        name = next(iter(model.tools), None) if tool is None else tool
        return cls(
            model,
            plant,
            joints,
            tool=None if name is None else plant.GetFrameByName(model.tools[name]),
        )

    def __repr__(self) -> str:
        tool = "no tool" if self._tool is None else f"tool {self._tool.name()}"
        return f"<{type(self).__name__} of {self.name}: {len(self.axes)} axes, {tool}>"

    def inertia(self, q: npt.ArrayLike) -> Vector:
        """Compute the inertia matrix M, shape (n, n), with the inertia of the rotors."""
        return self._each(self._inertia, q)

    def coriolis(self, q: npt.ArrayLike, v: npt.ArrayLike) -> Vector:
        """Compute the matrix C of centrifugal and Coriolis terms, shape (n, n), from Christoffel symbols.

        With this choice of C, dM/dt - 2 C is skew-symmetric. Drake computes only the vector b(v) = C(q, v) v, which is
        a quadratic form of the velocities. The difference of two of its values gives a column of C without an error of
        truncation: 4 C e_j = b(v + e_j) - b(v - e_j), where e_j is the unit vector of the axis j.
        """

        def matrix(velocity: Vector) -> Vector:
            """Compute C in the present posture of the plant."""
            columns = []
            for unit in np.eye(len(self.axes)):
                difference = self._bias(velocity + unit) - self._bias(velocity - unit)
                columns.append(difference / 4)
            return np.column_stack(columns)

        return self._each(matrix, q, v=v)

    def gravity(self, q: npt.ArrayLike) -> Vector:
        """Compute the torques g that hold the robot against its weight, shape (n,)."""
        return self._each(self._gravity, q)

    def inverse_dynamics(
        self, q: npt.ArrayLike, v: npt.ArrayLike = 0.0, a: npt.ArrayLike = 0.0
    ) -> Vector:
        """Compute the torques that a motion needs, shape (n,), friction included."""
        return self._each(self._torques, q, v=v, a=a)

    def forward_dynamics(
        self, q: npt.ArrayLike, v: npt.ArrayLike = 0.0, torque: npt.ArrayLike = 0.0
    ) -> Vector:
        """Compute the accelerations that torques of the motors cause, shape (n,)."""

        def accelerations(velocity: Vector, torque: Vector) -> Vector:
            """Solve M a = torque - (torque at zero acceleration) in the present posture of the plant."""
            rest = torque - self._torques(velocity, np.zeros_like(velocity))
            return np.asarray(np.linalg.solve(self._inertia(), rest))

        return self._each(accelerations, q, v=v, torque=torque)

    def jacobian(self, q: npt.ArrayLike) -> Vector:
        """Compute the Jacobian of the tool, shape (6, n): the tool's velocity is the Jacobian times the axes' speeds.

        The rows are the velocity of the tool centre point along x, y and z of the world, then the angular velocity
        about x, y and z.

        Raises:
            InvalidParameter: the robot has no tool.
        """
        return self._each(self._jacobian, q)

    def manipulability(
        self, q: npt.ArrayLike, part: Literal["all", "translation", "rotation"] = "all"
    ) -> Vector | float:
        """Compute Yoshikawa's manipulability: the volume of the ellipsoid of the tool's velocities, up to a factor.

        It is the product of the Jacobian's singular values, which is sqrt(det(J J')) for an arm with at least six axes.
        It is zero in a singularity.

        Args:
            q: positions of the axes.
            part: which rows of the Jacobian count: all, or only those of the tool's translation or rotation.

        Raises:
            InvalidParameter: the robot has no tool.
        """
        rows = _PARTS[one_of(message("dynamics.part", "part"), part, _PARTS)]
        values = np.linalg.svd(self.jacobian(q)[..., rows, :], compute_uv=False).prod(axis=-1)
        return values if np.ndim(values) else float(values)

    def torque_margin(
        self, q: npt.ArrayLike, v: npt.ArrayLike = 0.0, a: npt.ArrayLike = 0.0
    ) -> Vector:
        """Compute the part of each motor's limit that a motion leaves, shape (n,) [N·m or N].

        It is negative if the motion needs more torque than the motor has.
        """
        return np.asarray(self.torque_limit - np.abs(self.inverse_dynamics(q, v, a)))

    def payload(self, q: npt.ArrayLike, v: npt.ArrayLike = 0.0, a: npt.ArrayLike = 0.0) -> Vector:
        """Compute the additional point mass at the tool centre point that each motor could carry, shape (n,) [kg].

        The payload of the robot is the least of these masses. A mass is infinite if the load does not act on the joint,
        or if the axis is passive. It is 0 if the motor is too weak even without a load.

        Args:
            q: positions of the axes.
            v: velocities of the axes. By default the robot is at rest.
            a: accelerations of the axes.

        Raises:
            InvalidParameter: the robot has no tool.
        """
        return self._each(self._payload, q, v=v, a=a)

    def weakest_posture(self) -> Vector:
        """Search the posture within the limits in which the robot holds the least payload at rest (n,) [rad or m].

        The search begins with random postures, and improves the worst of them along one axis after the other. It is the
        same each time. Followers, and the fingers of a gripper, are where their gears take them.
        """
        # An axis may turn several times; one turn contains all different postures.
        lower, upper = np.clip(self._range, -np.pi, np.pi)
        random = np.random.default_rng(0)
        first = self._with_gears(random.uniform(lower, upper, (_RANDOM_POSTURES, len(self.axes))))
        worst = first[np.argsort(self._least_payload(first))[:_CANDIDATES]]
        for _ in range(_SWEEPS):
            for axis in range(len(self.axes)):
                # Entry 0 remains the posture itself, so that no step of the search finds a larger payload.
                trials = np.repeat(worst[:, np.newaxis], _ANGLES + 1, axis=1)
                trials[:, 1:, axis] = np.linspace(lower[axis], upper[axis], _ANGLES)
                trials = self._with_gears(trials)
                payloads = self._least_payload(trials.reshape(-1, len(self.axes)))
                best_of_each = payloads.reshape(len(worst), -1).argmin(axis=1)
                worst = trials[np.arange(len(worst)), best_of_each]
        # Adding 0.0 turns -0.0 into 0.0.
        return np.asarray(worst[self._least_payload(worst).argmin()]) + 0.0

    def _with_gears(self, postures: Vector) -> Vector:
        """Move fingers and followers in postures (..., n) [rad or m] to where their gears take them.

        All fingers are open by the same share of their range as the first one.
        """
        if not (self._fingers or self._model.followers):
            return postures
        geared = postures.copy()
        openness: Vector | None = None
        for axis, (closed, opened) in self._fingers.items():
            # The first finger decides how far all fingers are open.
            if openness is None:
                openness = (postures[..., axis] - closed) / (opened - closed)
            geared[..., axis] = closed + openness * (opened - closed)
        return self._model.with_followers(geared)

    def _least_payload(self, postures: Vector) -> Vector:
        """Least payload of all motors in each of k postures (k, n), shape (k,) [kg].

        It is infinite in a posture that gears take beyond the limits of a joint, which no search should choose.
        """
        least = self.payload(postures).min(axis=1)
        lower, upper = self._range
        is_within = ((postures >= lower - _ROUNDING) & (postures <= upper + _ROUNDING)).all(axis=1)
        return np.where(is_within, least, np.inf)

    def _each(
        self, compute: Callable[..., Vector], q: npt.ArrayLike, **others: npt.ArrayLike
    ) -> Vector:
        """Compute a quantity for each posture.

        Args:
            compute: function that computes the quantity in the present posture of the plant. Its arguments are one row
                of each of ``others``, in their order.
            q: positions of the axes, shape (n,) or (k, n).
            **others: velocities, accelerations or torques by name: a number, or shape (n,) or that of ``q``.

        Returns:
            the quantity, or an array with the quantity of each of the k postures.

        Raises:
            InvalidParameter: positions or other values have another shape, or are not finite.
        """
        rows = finite(q)
        count = len(self.axes)
        if not rows.size or rows.ndim not in (1, 2) or rows.shape[-1] != count:
            raise InvalidParameter(
                "q",
                quoted(q),
                message(
                    "base.finite_numbers_for_axes",
                    "{count} finite numbers, one for each axis, or rows of them",
                    count=count,
                ),
            )
        # One row of values for each posture.
        spread = []
        for name, values in others.items():
            found = finite(values)
            if found.shape not in ((), (count,), rows.shape):
                raise InvalidParameter(
                    name,
                    quoted(values),
                    message(
                        "dynamics.number_or_as_many",
                        "one finite number, or an array of the shape of q: {shape}",
                        shape=rows.shape,
                    ),
                )
            spread.append(np.broadcast_to(found, np.atleast_2d(rows).shape))
        results = []
        for posture, *arguments in zip(np.atleast_2d(rows), *spread, strict=True):
            self._map.set_positions(self._plant, self._context, posture)
            results.append(compute(*arguments))
        return np.array(results) if rows.ndim > 1 else np.asarray(results[0])

    def _set_velocities(self, velocity: Vector) -> None:
        """Set the velocities of the axes (n,) in the plant."""
        self._plant.SetVelocities(self._context, self._map.spread_velocities(velocity))

    def _inertia(self) -> Vector:
        """Inertia matrix of the axes (n, n) in the present posture."""
        # The map takes the entries of the axes out of each row. The transpose has the columns as rows.
        columns = self._map.efforts(self._plant.CalcMassMatrix(self._context))
        return self._map.efforts(columns.T)

    def _bias(self, velocity: Vector) -> Vector:
        """Centrifugal and Coriolis torques C v (n,) in the present posture."""
        self._set_velocities(velocity)
        return self._map.efforts(self._plant.CalcBiasTerm(self._context))

    def _gravity(self) -> Vector:
        """Torques g (n,) that hold the weight in the present posture."""
        # Drake's generalized forces are those of gravity itself, which the motors must balance.
        return -self._map.efforts(self._plant.CalcGravityGeneralizedForces(self._context))

    def _torques(self, velocity: Vector, acceleration: Vector) -> Vector:
        """Torques (n,) of a motion in the present posture: the equation at the top of this module."""
        plant = self._plant
        context = self._context
        self._set_velocities(velocity)
        # Weight and viscous friction are forces of the plant. Coulomb friction is not, and is added below.
        forces = MultibodyForces(plant)
        plant.CalcForceElementsContribution(context, forces)
        torque = plant.CalcInverseDynamics(
            context, self._map.spread_velocities(acceleration), forces
        )
        return self._map.efforts(torque) + self.friction * np.clip(
            velocity / self.friction_speed, -1.0, 1.0
        )

    def _jacobian(self) -> Vector:
        """Jacobian of the tool (6, n) in the present posture."""
        world = self._plant.world_frame()
        jacobian = self._plant.CalcJacobianSpatialVelocity(
            self._context, _SPEEDS, self._tcp, np.zeros(3), world, world
        )
        # Drake has the angular part first.
        return self._map.velocities(np.roll(jacobian, 3, axis=0))

    def _payload(self, velocity: Vector, acceleration: Vector) -> Vector:
        """Mass at the tool (n,) [kg] that each motor can carry in the present posture.

        A point mass m at the tool needs the additional torques m J' (p'' - g), with the Jacobian J of the tool centre
        point, its acceleration p'' = J a + dJ/dt v, and the gravity vector g.
        """
        plant = self._plant
        world = plant.world_frame()
        torque = self._torques(velocity, acceleration)
        jacobian = self._jacobian()[:3]
        # dJ/dt v, which is not zero at constant speeds: the tool moves on a curve.
        curve_acceleration = plant.CalcBiasTranslationalAcceleration(
            self._context, _SPEEDS, self._tcp, np.zeros(3), world, world
        )
        force_of_kilogram = (
            jacobian @ acceleration
            + np.ravel(curve_acceleration)
            - plant.gravity_field().gravity_vector()
        )
        torque_of_kilogram = jacobian.T @ force_of_kilogram
        # A motor whose torque has the opposite sign is relieved by the load first, and then loaded up to its limit.
        remaining = self.torque_limit - np.sign(torque_of_kilogram) * torque
        has_motor = self.torque_limit > 0
        is_loaded = (np.abs(torque_of_kilogram) > _NOTHING) & has_motor
        masses = np.divide(
            remaining,
            np.abs(torque_of_kilogram),
            out=np.full_like(remaining, np.inf),
            where=is_loaded,
        )
        is_too_weak = (np.abs(torque) > self.torque_limit) & has_motor
        return np.where(is_too_weak, 0.0, np.maximum(masses, 0.0))

    @property
    def _tcp(self) -> Frame:
        """Frame of the tool. Raises InvalidParameter if the robot has no tool."""
        if self._tool is None:
            raise InvalidParameter(
                "robot",
                self.name,
                message(
                    "dynamics.robot_with_tool",
                    "a robot with a tool frame, under tools: in its robot.yaml",
                ),
            )
        return self._tool
