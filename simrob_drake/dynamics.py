r"""The equations of motion of a robot, and what its motors can hold.

.. math:: \tau = M(q)\,a + C(q, v)\,v + g(q) + d\,v + c\,\mathrm{sat}(v / v_s)

are the torques of the motors: inertia with that of their rotors, centrifugal and Coriolis terms, weight, viscous and
Coulomb friction. Drake computes M, C v, g and Jacobians.
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
_PARTS = {"all": slice(0, 6), "translation": slice(0, 3), "rotation": slice(3, 6)}
_FIRST_LOOKS, _SWEEPS, _ANGLES = 500, 3, 25
"""Postures that are tried for the weakest one, and how often and how finely each axis is searched from there."""
_ROUNDING = 1e-9  # excess of a limit that is due to rounding [rad or m]
_NOTHING = 1e-9  # a joint that a kilogram loads by less does not feel it [N·m or N]


class Dynamics:
    """A robot's dynamics, its root held; every other joint of its plant rests.

    ``q``, ``v``, ``a`` and torques are of shape (n,), or (k, n) for rows of postures, which give rows of results; in
    axis order and sense, SI units. All but postures may be one number for all axes.

    Attributes:
        name: of the robot.
        axes: their names, in order.
        torque_limit: of the motors, shape (n,) [N·m or N].
        friction: Coulomb's c, shape (n,) [N·m or N]; ``friction_speed`` is v_s [rad/s or m/s].
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
        """Look at a robot in a finalized plant.

        Args:
            model: what it is.
            plant: where it stands, with what it carries.
            joints: of its axes, in order.
            tool: the frame of the tool, for Jacobians and payloads.
            torque_limit: shape (n,); the URDF's efforts unless given.
            positions: of the whole plant, shape (nq,); for what stands around. Its default ones unless given.
        """
        self.name, self.axes = model.name, list(model.axes)
        self.torque_limit = model.efforts if torque_limit is None else torque_limit
        self.friction, self.friction_speed = model.friction, model.drives.friction_speed
        self._model = model
        self._fingers = model.fingers
        self._range = model.axis_limits
        self._plant, self._tool = plant, tool
        self._map = AxisMap.of_joints(plant, joints, model.signs)
        self._context = plant.CreateDefaultContext()
        if positions is not None:
            plant.SetPositions(self._context, positions)

    @classmethod
    def of_robot(cls, robot: str | Path | RobotModel, tool: str | None = None) -> "Dynamics":
        """Return the dynamics of a robot alone.

        Args:
            robot: a name of ``simrob list``, the path of a `robot.yaml` or of any URDF, or a robot that was read.
            tool: which of its tools; the first unless given.

        Raises:
            SimrobError: no such robot or tool, or a file that cannot be read.
        """
        model = robot if isinstance(robot, RobotModel) else read_robot(robot)
        if tool is not None:
            one_of(message("base.tool_of", "tool of {model}", model=model.name), tool, model.tools)
        if model.links_without_inertia:
            lacking = ", ".join(model.links_without_inertia)
            raise InvalidParameter(
                "robot",
                model.name,
                message(
                    "dynamics.links_with_inertia",
                    "one whose moving links have inertia; {lacking} have none",
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
        """Return the inertia matrix M, shape (n, n), with the inertia of the rotors."""
        return self._each(self._inertia, q)

    def coriolis(self, q: npt.ArrayLike, v: npt.ArrayLike) -> Vector:
        """Return the matrix C of centrifugal and Coriolis terms, shape (n, n), by the symbols of Christoffel.

        So dM/dt - 2 C is skew. Twice the entries of a quadratic form follow from two of its values, without error:
        4 C e_j = b(v + e_j) - b(v - e_j) with b(v) = C v.
        """

        def matrix(velocity: Vector) -> Vector:
            pairs = [
                (self._bias(velocity + e) - self._bias(velocity - e)) / 4
                for e in np.eye(len(self.axes))
            ]
            return np.column_stack(pairs)

        return self._each(matrix, q, v=v)

    def gravity(self, q: npt.ArrayLike) -> Vector:
        """Return the torques g that hold the robot against its weight, shape (n,)."""
        return self._each(self._gravity, q)

    def inverse_dynamics(
        self, q: npt.ArrayLike, v: npt.ArrayLike = 0.0, a: npt.ArrayLike = 0.0
    ) -> Vector:
        """Return the torques of a motion, shape (n,), friction included."""
        return self._each(self._torques, q, v=v, a=a)

    def forward_dynamics(
        self, q: npt.ArrayLike, v: npt.ArrayLike = 0.0, torque: npt.ArrayLike = 0.0
    ) -> Vector:
        """Return the accelerations that torques of the motors give, shape (n,)."""

        def accelerations(velocity: Vector, torque: Vector) -> Vector:
            rest = torque - self._torques(velocity, np.zeros_like(velocity))
            return np.asarray(np.linalg.solve(self._inertia(), rest))

        return self._each(accelerations, q, v=v, torque=torque)

    def jacobian(self, q: npt.ArrayLike) -> Vector:
        """Return what the axes' speeds give of the tool's, shape (6, n).

        Rows: velocity of the tool centre point along x, y, z of the world, then angular velocity about them.

        Raises:
            InvalidParameter: a robot without a tool.
        """
        return self._each(self._jacobian, q)

    def manipulability(
        self, q: npt.ArrayLike, part: Literal["all", "translation", "rotation"] = "all"
    ) -> Vector | float:
        """Return Yoshikawa's measure of a posture, the volume of the ellipsoid of its tool's velocities.

        It is the product of the Jacobian's singular values, sqrt(det(J J')) of an arm with six axes or more; of the
        tool's ``translation`` or ``rotation`` alone, too. Zero is a singularity.
        """
        rows = _PARTS[one_of(message("dynamics.part", "part"), part, _PARTS)]
        values = np.linalg.svd(self.jacobian(q)[..., rows, :], compute_uv=False).prod(axis=-1)
        return values if np.ndim(values) else float(values)

    def torque_margin(
        self, q: npt.ArrayLike, v: npt.ArrayLike = 0.0, a: npt.ArrayLike = 0.0
    ) -> Vector:
        """Return what a motion leaves of each motor's limit, shape (n,) [N·m or N]; negative where it asks for more."""
        return np.asarray(self.torque_limit - np.abs(self.inverse_dynamics(q, v, a)))

    def payload(self, q: npt.ArrayLike, v: npt.ArrayLike = 0.0, a: npt.ArrayLike = 0.0) -> Vector:
        """Return the mass that each motor could carry at the tool centre point besides, shape (n,) [kg].

        The least is what the robot can: as a point mass, at rest unless there is motion. It is infinite where a load
        does not act on the joint or the axis is passive, and 0 where the motor is too weak without one.
        """
        return self._each(self._payload, q, v=v, a=a)

    def weakest_posture(self) -> Vector:
        """Return where within its limits the robot holds the least payload at rest, shape (n,) [rad or m].

        Joints that follow others, and the fingers of a gripper, are where their gears take them. A search: five
        hundred postures of chance, and from the worst three along one axis after the other.
        """
        lower, upper = np.clip(self._range, -np.pi, np.pi)
        random = np.random.default_rng(0)
        looks = self._with_gears(random.uniform(lower, upper, (_FIRST_LOOKS, len(self.axes))))
        worst = looks[np.argsort(self._least_payload(looks))[:3]]
        for _ in range(_SWEEPS):
            for axis in range(len(self.axes)):
                rows = np.repeat(worst[:, np.newaxis], _ANGLES + 1, axis=1)
                rows[:, 1:, axis] = np.linspace(lower[axis], upper[axis], _ANGLES)
                rows = self._with_gears(rows)
                found = self._least_payload(rows.reshape(-1, len(self.axes))).reshape(
                    len(worst), -1
                )
                worst = rows[np.arange(len(worst)), found.argmin(axis=1)]
        return np.asarray(worst[self._least_payload(worst).argmin()]) + 0.0  # no -0

    def _with_gears(self, postures: Vector) -> Vector:
        """Move fingers and followers in postures (..., n) [rad or m] to where their gears take them.

        All fingers are open by the same share of their range as the first one.
        """
        if not (self._fingers or self._model.followers):
            return postures
        geared = postures.copy()
        openness: Vector | None = None
        for axis, (closed, opened) in self._fingers.items():
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
        """Compute for each posture, with the plant in it, from the other rows."""
        rows = finite(q)
        count = len(self.axes)
        if not rows.size or rows.ndim not in (1, 2) or rows.shape[-1] != count:
            raise InvalidParameter(
                "q",
                quoted(q),
                message(
                    "base.finite_numbers_for_axes",
                    "{count} finite numbers, or rows of as many, one an axis",
                    count=count,
                ),
            )
        spread = []
        for name, values in others.items():
            found = finite(values)
            if found.shape not in ((), (count,), rows.shape):
                raise InvalidParameter(
                    name,
                    quoted(values),
                    message(
                        "dynamics.number_or_as_many",
                        "a finite number, or as many as q has: {shape}",
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
        self._plant.SetVelocities(self._context, self._map.spread_velocities(velocity))

    def _inertia(self) -> Vector:
        columns = self._map.efforts(self._plant.CalcMassMatrix(self._context))
        return self._map.efforts(columns.T)

    def _bias(self, velocity: Vector) -> Vector:
        self._set_velocities(velocity)
        return self._map.efforts(self._plant.CalcBiasTerm(self._context))

    def _gravity(self) -> Vector:
        return -self._map.efforts(self._plant.CalcGravityGeneralizedForces(self._context))

    def _torques(self, velocity: Vector, acceleration: Vector) -> Vector:
        plant, context = self._plant, self._context
        self._set_velocities(velocity)
        forces = MultibodyForces(plant)
        plant.CalcForceElementsContribution(context, forces)  # weight and viscous friction
        torque = plant.CalcInverseDynamics(
            context, self._map.spread_velocities(acceleration), forces
        )
        return self._map.efforts(torque) + self.friction * np.clip(
            velocity / self.friction_speed, -1.0, 1.0
        )

    def _jacobian(self) -> Vector:
        plant, world = self._plant, self._plant.world_frame()
        jacobian = plant.CalcJacobianSpatialVelocity(
            self._context, _SPEEDS, self._tcp, np.zeros(3), world, world
        )
        # Drake has the angular part first
        return self._map.velocities(np.roll(jacobian, 3, axis=0))

    def _payload(self, velocity: Vector, acceleration: Vector) -> Vector:
        plant, context, world, nothing = (
            self._plant,
            self._context,
            self._plant.world_frame(),
            np.zeros(3),
        )
        torque, to_tool = self._torques(velocity, acceleration), self._jacobian()[:3]
        curved = plant.CalcBiasTranslationalAcceleration(
            context, _SPEEDS, self._tcp, nothing, world, world
        )
        felt = to_tool @ acceleration + np.ravel(curved) - plant.gravity_field().gravity_vector()
        of_a_kilogram = to_tool.T @ felt
        room = self.torque_limit - np.sign(of_a_kilogram) * torque
        has_motor = self.torque_limit > 0
        loaded = (np.abs(of_a_kilogram) > _NOTHING) & has_motor
        masses = np.divide(
            room, np.abs(of_a_kilogram), out=np.full_like(room, np.inf), where=loaded
        )
        is_too_weak = (np.abs(torque) > self.torque_limit) & has_motor
        return np.where(is_too_weak, 0.0, np.maximum(masses, 0.0))

    @property
    def _tcp(self) -> Frame:
        if self._tool is None:
            raise InvalidParameter(
                "robot",
                self.name,
                message(
                    "dynamics.robot_with_tool",
                    "one with a tool frame, under tools: in its robot.yaml",
                ),
            )
        return self._tool
