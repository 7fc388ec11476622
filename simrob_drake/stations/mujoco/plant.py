r"""The block that stands where a station's plant stands, with the same ports, and is stepped by MuJoCo.

Servos in the plant's actuators are taken at the end of a step h, as Drake's discrete solvers take them:

.. math:: \tau = \mathrm{clip}\bigl(k_p\,(q_r - q^+) - k_d\,v^+ + u\bigr).

MuJoCo's integrator ``discrete`` solves that together with the contacts, but for the limit, which it minds at the start
of a step: a light joint at its limit then chatters. So its servos have no limits here. After a step those beyond theirs
give just that, as a constant torque, and the step is made again, until servos and limits agree: an active-set method
(Nocedal and Wright, Numerical Optimization, ch. 16.5). It takes 2 to 6 rounds, and one where no limit is reached.
A motor beyond its line gives the torque at rest and brakes with the line's slope D, in place of its own gains.
Meanwhile contacts stay as they are: MuJoCo softens each by what its bodies feel of the servos, so that without them it
is given a stiffer one.
"""

from __future__ import annotations

import weakref
from dataclasses import dataclass
from functools import partial

import mujoco
import numpy as np
import numpy.typing as npt
from pydrake.common.value import AbstractValue, Value
from pydrake.math import RigidTransform
from pydrake.multibody.plant import ExternallyAppliedSpatialForce
from pydrake.multibody.tree import BodyIndex, JointActuatorIndex, ModelInstanceIndex
from pydrake.systems.framework import (
    BasicVector,
    Context,
    DiscreteValues,
    EventStatus,
    InputPort,
    OutputPort,
    ValueProducer,
)

from simrob_drake.blocks.block import Block
from simrob_drake.blocks.contacts import Contacts
from simrob_drake.frames import Vector
from simrob_drake.lifetime import weakly
from simrob_drake.parts.site import StationPlant
from simrob_drake.stations.mujoco.coordinates import Coordinates
from simrob_drake.stations.mujoco.model import mujoco_model
from simrob_drake.stations.mujoco.names import Names
from simrob_drake.stations.resolve import ResolvedStation

_TOGETHER, _ROUNDS = 5, 100
"""So often all motors that are on a wrong side change together; then the first of them alone, which cannot go on for
ever where torques turn joints their way (Murty's least-index rule for linear complementarity)."""
_LINE = 2.0
"""The side, to either hand, of a motor at the line of its torque over its speed; 1 is at its limit."""


@dataclass(frozen=True)
class Step:
    """What a step does.

    Attributes:
        state: positions and velocities of the plant at its end, shape (nq + nv,).
        warm: accelerations with which MuJoCo's solver begins the next one, shape (nv,).
        torque: of each motor, shape (m,) [N·m or N].
    """

    state: Vector
    warm: Vector
    torque: Vector


class MujocoPlant(Block):
    """A station's plant in MuJoCo, with the ports and the state of Drake's discrete plant, under the same names.

    Ports, for each model instance with m motors:
        in  ``actuation.<instance>`` (m): torques beside those of the servos [N·m or N].
        in  ``desired_state.<instance>`` (2 m): positions, then velocities, for servos in its motors.
        in  ``applied_spatial_force``, ``applied_generalized_force`` (nv): from outside.
        out ``state`` (nq + nv): positions and velocities of the whole plant.
        out ``net_actuation.<instance>`` (m): torques of the motors [N·m or N].
        out ``contact_results``: :class:`~simrob_drake.blocks.contacts.Contacts`.
        out ``body_poses``: of all bodies, by their indices.
    """

    def __init__(self, station: ResolvedStation, plant: StationPlant) -> None:
        """Make the model of a station whose plant is finalized.

        Raises:
            InvalidParameter: something that MuJoCo does not know.
        """
        super().__init__()
        self.set_name("plant")
        own, made = plant.plant, mujoco_model(station, plant, step=station.time_step, driver="diagram")
        self._plant, self._model, self._data = weakref.proxy(own), made.model, mujoco.MjData(made.model)
        self._scratch, names = own.CreateDefaultContext(), Names(own)
        self._coordinates = Coordinates.of(own, made.model, names)
        self._geoms = [made.shapes.get(made.model.geom(index).name) for index in range(made.model.ngeom)]
        bodies = [own.get_body(BodyIndex(index)) for index in range(own.num_bodies())]
        self._bodies = [0, *(made.model.body(names.body(body)).id for body in bodies[1:])]
        self._motors = _Motors(plant, made.model, self._data, names)
        self._qpos, self._qvel, self._guess = self._data.qpos, self._data.qvel, self._data.qacc_warmstart
        self._nq, self._nv = own.num_positions(), own.num_velocities()
        self._motion = self.DeclareDiscreteState(own.GetPositionsAndVelocities(self._scratch))
        self._latest: Step | None = None
        self._warm = self.DeclareDiscreteState(self._nv)
        self._declare_ports()
        self.DeclarePeriodicDiscreteUpdateEvent(station.time_step, 0.0, weakly(self._update))

    def _declare_ports(self) -> None:
        self._actuation: dict[int, InputPort] = {}
        self._desired: dict[int, InputPort] = {}
        self._applied: dict[int, OutputPort] = {}
        self._spatial = self.DeclareAbstractInputPort(
            "applied_spatial_force", Value[list[ExternallyAppliedSpatialForce]]()
        )
        self._generalized = self.DeclareVectorInputPort("applied_generalized_force", self._nv)
        for instance, places in self._motors.instances.items():
            name = self._plant.GetModelInstanceName(ModelInstanceIndex(instance))
            self._actuation[instance] = self.DeclareVectorInputPort(f"actuation.{name}", len(places))
            self._desired[instance] = self.DeclareVectorInputPort(f"desired_state.{name}", 2 * len(places))
        calc = ValueProducer(allocate=Value[object]().Clone, calc=weakly(self._calc_step))
        tickets = {self.xd_ticket(), self.all_input_ports_ticket()}
        self._step = self.DeclareCacheEntry("step", calc, tickets)
        self._state_port = self.DeclareStateOutputPort("state", self._motion)
        for instance, places in self._motors.instances.items():
            name = self._plant.GetModelInstanceName(ModelInstanceIndex(instance))
            tell = partial(weakly(self._tell_torque), places)
            self._applied[instance] = self.DeclareVectorOutputPort(
                f"net_actuation.{name}", len(places), tell, {self._step.ticket()}
            )
        self._contacts = self.DeclareAbstractOutputPort(
            "contact_results", Value[object], weakly(self._tell_contacts), {self._step.ticket()}
        )
        self._poses = self.DeclareAbstractOutputPort(
            "body_poses", Value[list[RigidTransform]], weakly(self._tell_poses), {self.xd_ticket()}
        )

    def get_state_output_port(self) -> OutputPort:
        """Return ``state``."""
        return self._state_port

    def get_actuation_input_port(self, instance: ModelInstanceIndex) -> InputPort:
        """Return ``actuation.<instance>``."""
        return self._actuation[int(instance)]

    def get_desired_state_input_port(self, instance: ModelInstanceIndex) -> InputPort:
        """Return ``desired_state.<instance>``."""
        return self._desired[int(instance)]

    def get_net_actuation_output_port(self, instance: ModelInstanceIndex) -> OutputPort:
        """Return ``net_actuation.<instance>``."""
        return self._applied[int(instance)]

    def get_applied_spatial_force_input_port(self) -> InputPort:
        """Return ``applied_spatial_force``."""
        return self._spatial

    def get_applied_generalized_force_input_port(self) -> InputPort:
        """Return ``applied_generalized_force``."""
        return self._generalized

    def get_contact_results_output_port(self) -> OutputPort:
        """Return ``contact_results``."""
        return self._contacts

    def get_body_poses_output_port(self) -> OutputPort:
        """Return ``body_poses``."""
        return self._poses

    def GetPositions(self, context: Context) -> Vector:
        """Return the plant's positions, shape (nq,), in a context of this block."""
        return self._state(context)[: self._nq]

    def GetVelocities(self, context: Context) -> Vector:
        """Return the plant's velocities, shape (nv,)."""
        return self._state(context)[self._nq :]

    def GetPositionsAndVelocities(self, context: Context) -> Vector:
        """Return both, shape (nq + nv,)."""
        return self._state(context)

    def SetPositions(self, context: Context, q: Vector) -> None:
        """Set the plant's positions, shape (nq,)."""
        context.SetDiscreteState(self._motion, np.concatenate([q, self.GetVelocities(context)]))

    def SetVelocities(self, context: Context, v: Vector) -> None:
        """Set the plant's velocities, shape (nv,)."""
        context.SetDiscreteState(self._motion, np.concatenate([self.GetPositions(context), v]))

    def _state(self, context: Context) -> Vector:
        return np.array(context.get_discrete_state(self._motion).value())

    def _update(self, context: Context, values: DiscreteValues) -> EventStatus:
        step: Step = self._step.Eval(context)
        values.get_mutable_vector(self._motion).SetFromVector(step.state)
        values.get_mutable_vector(self._warm).SetFromVector(step.warm)
        return EventStatus.Succeeded()

    def _tell_torque(self, places: npt.NDArray[np.intp], context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._step.Eval(context).torque[places])

    def _tell_contacts(self, context: Context, output: AbstractValue) -> None:
        if self._step.Eval(context) is not self._latest:  # what touches is in the data of the step made last
            self._made(context)
        output.set_value(self._touching())

    def _tell_poses(self, context: Context, output: AbstractValue) -> None:
        self._plant.SetPositions(self._scratch, self.GetPositions(context))
        output.set_value(self._plant.get_body_poses_output_port().Eval(self._scratch))

    def _calc_step(self, context: Context, value: AbstractValue) -> None:
        value.set_value(self._made(context))

    def _made(self, context: Context) -> Step:
        """Make a step from the state of a context, and return what it does."""
        data, motors = self._data, self._motors
        qpos, qvel = self._coordinates.to_mujoco(*np.split(self._state(context), [self._nq]))
        self._guess[:] = context.get_discrete_state(self._warm).value()
        data.time, self._qpos[:], self._qvel[:] = 0.0, qpos, qvel
        mujoco.mj_step1(self._model, data)
        self._put_forces(context)
        desired, extra = self._asked(context)
        sides = np.zeros(motors.count)
        motors.drive(desired, extra, sides)
        mujoco.mj_step2(self._model, data)
        torque, found = motors.torques(desired, extra, sides)
        if found.any():  # what contacts are with all servos
            contact, felt, softness = data.contact, self._inverse_masses(), data.contact.solref.copy()
        for again in range(_ROUNDS):
            if (found == sides).all():
                end = self._coordinates.state(self._qpos, self._qvel)
                self._latest = Step(end, data.qacc.copy(), torque)
                return self._latest
            sides = found if again < _TOGETHER else _first_changed(sides, found)
            motors.drive(desired, extra, sides)
            for _ in range(2):
                self._qpos[:], self._qvel[:] = qpos, qvel
                mujoco.mj_step2(self._model, data)
                contact.solref[:] = softness * (self._inverse_masses() / felt)[:, np.newaxis]
            torque, found = motors.torques(desired, extra, sides)
        raise RuntimeError("servos at their torque limits and MuJoCo's contacts do not settle within a step")

    def _inverse_masses(self) -> Vector:
        """Return what MuJoCo takes for the inverse mass of each contact, times one minus its impedance."""
        contact, step = self._data.contact, self._model.opt.timestep
        if not self._data.nefc:
            return np.ones(self._data.ncon)
        part = contact.solimp[:, 0] - step * contact.solref[:, 1] - step**2 * contact.solref[:, 0]
        return np.asarray(self._data.efc_R[contact.efc_address] * part)

    def _asked(self, context: Context) -> tuple[Vector, Vector]:
        """Return the desired positions of all motors, and their torques beside those of servos, shape (m,) each."""
        asked = np.zeros((2, self._motors.count))
        for ports, row in zip((self._desired, self._actuation), asked, strict=True):
            for instance, places in self._motors.instances.items():
                if ports[instance].HasValue(context):
                    row[places] = ports[instance].Eval(context)[: len(places)]
        return asked[0], asked[1]

    def _put_forces(self, context: Context) -> None:
        """Put the forces from outside into MuJoCo's data: on its velocities, and on the centres of bodies."""
        data, motors = self._data, self._motors
        motors.forces[:] = 0.0
        if self._generalized.HasValue(context):
            _, motors.forces[:] = self._coordinates.to_mujoco(
                self.GetPositions(context), self._generalized.Eval(context)
            )
        if not self._spatial.HasValue(context):
            return
        data.xfrc_applied[:] = 0.0
        for applied in self._spatial.Eval(context):
            body, force = self._bodies[int(applied.body_index)], applied.F_Bq_W.translational()
            point = data.xpos[body] + data.xmat[body].reshape(3, 3) @ applied.p_BoBq_B
            data.xfrc_applied[body, :3] += force
            data.xfrc_applied[body, 3:] += applied.F_Bq_W.rotational() + np.cross(point - data.xipos[body], force)

    def _touching(self) -> Contacts:
        """Return the contacts of the step made last: MuJoCo's normals point out of the first shape, to the second."""
        touching = np.flatnonzero(self._data.contact.efc_address >= 0)
        contact, shapes = self._data.contact, self._geoms
        frames, first = contact.frame[touching].reshape(-1, 3, 3), contact.efc_address[touching]
        sizes = np.minimum(contact.dim[touching], 3)  # of elliptic cones: along the normal, then across
        force = np.zeros((len(touching), 3))
        for across in range(3):
            rows = sizes > across
            force[rows, across] = self._data.efc_force[first[rows] + across]
        pairs = [(shapes[second], shapes[first]) for first, second in contact.geom[touching].tolist()]
        forces = np.einsum("ki,kij->kj", force, frames)
        return Contacts(pairs, contact.pos[touching], forces, np.zeros_like(forces), frames[:, 0])


def _first_changed(sides: Vector, found: Vector) -> Vector:
    place = int(np.argmax(sides != found))
    return np.concatenate([sides[:place], found[place : place + 1], sides[place + 1 :]])


class _Motors:
    """The m motors of a plant, in its order.

    Attributes:
        count: m.
        instances: the places of each model instance's motors, by its number.
        forces: on MuJoCo's velocities from elsewhere, shape (nv,), to be set before each step.
    """

    def __init__(self, station: StationPlant, model: mujoco.MjModel, data: mujoco.MjData, names: Names) -> None:
        """Find the motors of a station's plant in the model that was made of it."""
        plant = station.plant
        motors = [plant.get_joint_actuator(JointActuatorIndex(index)) for index in range(plant.num_actuators())]
        gains = [motor.get_controller_gains() if motor.has_controller() else None for motor in motors]
        joints = [model.joint(names.joint(motor.joint())) for motor in motors]
        owners = np.array([int(motor.model_instance()) for motor in motors], np.intp)
        self.count, self.forces = len(motors), np.zeros(model.nv)
        self.instances = {owner: np.flatnonzero(owners == owner) for owner in dict.fromkeys(owners.tolist())}
        limits = [motor.effort_limit() if own else np.inf for motor, own in zip(motors, gains, strict=True)]
        self._limits, self._slopes = np.array(limits, dtype=float), np.zeros(self.count)
        self._stalls, places = np.full(self.count, np.inf), {motor.joint().index(): k for k, motor in enumerate(motors)}
        for robot in station.robots.values():
            of_joints = [places[joint.index()] for joint in robot.joints]
            if (line := robot.gains.line) is not None and all(gains[place] for place in of_joints):  # else blocks do it
                self._stalls[of_joints], self._slopes[of_joints] = line.stall, line.slope
                self._limits[of_joints] = robot.gains.cap
        self._kp, self._kd = (np.array([getattr(own, key) if own else 0.0 for own in gains]) for key in "pd")
        self._servos = np.flatnonzero([own is not None for own in gains])
        self._angles = np.array([joint.qposadr[0] for joint in joints], np.intp)
        self._speeds = np.array([joint.dofadr[0] for joint in joints], np.intp)
        self._model, self._control, self._applied = model, data.ctrl, data.qfrc_applied
        self._qpos, self._qvel, self._sides = data.qpos, data.qvel, np.zeros(self.count)

    def drive(self, desired: Vector, extra: Vector, sides: Vector) -> None:
        """Let servos within their limits follow their gains, and the others give what they can."""
        if (sides != self._sides).any():
            self._sides, model = sides.copy(), self._model
            kp = np.where(sides == 0, self._kp, 0.0)[self._servos]
            kd = np.where(sides == 0, self._kd, np.where(abs(sides) == _LINE, self._slopes, 0.0))[self._servos]
            model.actuator_gainprm[:, 0], model.actuator_biasprm[:, 1], model.actuator_biasprm[:, 2] = kp, -kp, -kd
        self._control[:] = desired[self._servos]
        self._applied[:] = self.forces
        if sides.any() or extra.any():
            beyond = sides != 0
            np.add.at(self._applied, self._speeds[~beyond], extra[~beyond])
            np.add.at(self._applied, self._speeds[beyond], self._ends(sides)[beyond])

    def torques(self, desired: Vector, extra: Vector, sides: Vector) -> tuple[Vector, Vector]:
        """Return what each motor gives at the end of a step, shape (m,), and on which side of its limit it is."""
        speed = self._qvel[self._speeds]
        asked = self._kp * (desired - self._qpos[self._angles]) - self._kd * speed + extra
        brake, side = self._slopes * speed, np.sign(sides)
        above = np.minimum(np.maximum(self._stalls - brake, -self._limits), self._limits)
        below = np.minimum(np.maximum(-self._stalls - brake, -self._limits), self._limits)
        torque = np.where(sides == 0, asked, self._ends(sides) - np.where(abs(sides) == _LINE, brake, 0.0))
        found = np.where(asked > above, 1.0, np.where(asked < below, -1.0, 0.0))
        found[found == -side] = 0.0  # from one limit the way to the other leads between them
        bound = np.where(found > 0, above, below)
        return torque, found * np.where(abs(bound) < self._limits, _LINE, 1.0)

    def _ends(self, sides: Vector) -> Vector:
        """Return the torques that do not change within a step, (m,), of motors on these sides of what they can."""
        ends = np.where(abs(sides) == _LINE, self._stalls, self._limits)
        return np.where(sides == 0, 0.0, np.sign(sides) * np.where(sides == 0, 0.0, ends))
