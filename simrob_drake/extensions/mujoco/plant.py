"""The block that stands where a station's plant stands, with the same ports, and is stepped by MuJoCo."""

import weakref
from dataclasses import dataclass
from functools import partialmethod
from typing import NamedTuple

import mujoco
import numpy as np
from pydrake.common.value import AbstractValue, Value
from pydrake.math import RigidTransform
from pydrake.multibody.plant import ExternallyAppliedSpatialForce
from pydrake.multibody.tree import BodyIndex, ModelInstanceIndex
from pydrake.systems.framework import (
    Context,
    DiscreteValues,
    EventStatus,
    InputPort,
    OutputPort,
    ValueProducer,
)

from simrob_drake.base.frames import Vector
from simrob_drake.base.lifetime import weakly
from simrob_drake.blocks.block import Block
from simrob_drake.blocks.contacts import Contacts
from simrob_drake.extensions.mujoco.coordinates import Coordinates, Names, Places
from simrob_drake.extensions.mujoco.model import mujoco_model
from simrob_drake.extensions.mujoco.servos import Servos
from simrob_drake.parts.station_plant import StationPlant
from simrob_drake.robots.axis_map import in_a_row
from simrob_drake.stations.resolve import ResolvedStation

_NOT_YET = np.inf  # in place of accelerations, before the first step


class Step(NamedTuple):
    """What a step does."""

    state: Vector  # positions and velocities of the plant at its end, shape (nq + nv,)
    warm: Vector  # accelerations with which MuJoCo's solver begins the next one, shape (nv,)
    torque: Vector  # of each motor, shape (m,) [N·m or N]


class MujocoPlant(Block):
    """A station's plant in MuJoCo, with the ports and the state of Drake's discrete plant, under the same names.

    Ports, for each model instance with m motors:
        in  ``actuation.<instance>`` (m): torques beside those of the servos [N·m or N].
        in  ``desired_state.<instance>`` (2 m): positions, then velocities, for servos in its motors.
        in  ``applied_spatial_force``, ``applied_generalized_force`` (nv): from outside.
        out ``state`` (nq + nv): positions and velocities of the whole plant.
        out ``net_actuation.<instance>`` (m): torques of the motors in the step that ended, as the state [N·m or N].
        out ``contact_results``: :class:`~simrob_drake.blocks.contacts.Contacts`, of the step that begins.
        out ``body_poses``: of all bodies, by their indices.
    """

    def __init__(self, station: ResolvedStation, plant: StationPlant) -> None:
        """Make the model of a station whose plant is finalized.

        Raises InvalidParameter: a part that has no place in MuJoCo; names the key.
        """
        super().__init__()
        self.set_name("plant")
        own, made = (
            plant.plant,
            mujoco_model(station, plant, step=station.engine.time_step, driver="diagram"),
        )
        self._plant, self._model, self._data = (
            weakref.proxy(own),
            made.model,
            mujoco.MjData(made.model),
        )
        self._scratch, names = own.CreateDefaultContext(), Names(own)
        self._coordinates = Coordinates.of(own, made.model, names)
        self._geoms = [
            made.shapes.get(made.model.geom(index).name) for index in range(made.model.ngeom)
        ]
        bodies = [own.get_body(BodyIndex(index)) for index in range(own.num_bodies())]
        self._bodies = [0, *(made.model.body(names.body(body)).id for body in bodies[1:])]
        self._servos = Servos(plant, made.model, self._data, names)
        self._qpos, self._qvel, self._guess = (
            self._data.qpos,
            self._data.qvel,
            self._data.qacc_warmstart,
        )
        self._nq, self._nv = own.num_positions(), own.num_velocities()
        self._motion = self.DeclareDiscreteState(own.GetPositionsAndVelocities(self._scratch))
        self._warm = self.DeclareDiscreteState(np.full(self._nv, _NOT_YET))
        self._latest: Step | None = None
        self._declare_ports()
        self.DeclarePeriodicDiscreteUpdateEvent(station.engine.time_step, 0.0, self._update)
        self.DeclareInitializationDiscreteUpdateEvent(self._begin)

    def _declare_ports(self) -> None:
        self._spatial = self.DeclareAbstractInputPort(
            "applied_spatial_force", Value[list[ExternallyAppliedSpatialForce]]()
        )
        self._generalized = self.DeclareVectorInputPort("applied_generalized_force", self._nv)
        self.DeclareStateOutputPort("state", self._motion)
        self.outputs = {"state": int(self._motion)}
        """The discrete group of its own that each output hands on, by the output's name."""
        self._motors: dict[int, _Motors] = {}
        for instance, places in self._servos.instances.items():
            name, count = (
                self._plant.GetModelInstanceName(ModelInstanceIndex(instance)),
                len(places),
            )
            actuation = self.DeclareVectorInputPort(f"actuation.{name}", count).get_index()
            desired = self.DeclareVectorInputPort(f"desired_state.{name}", 2 * count).get_index()
            torque = self.DeclareDiscreteState(count)
            self.outputs[f"net_actuation.{name}"] = int(torque)
            applied = self.DeclareStateOutputPort(f"net_actuation.{name}", torque).get_index()
            self._motors[instance] = _Motors(
                in_a_row(places), count, actuation, desired, applied, torque
            )
        tickets = {self.xd_ticket(), self.all_input_ports_ticket()}
        step = ValueProducer(allocate=Value[object]().Clone, calc=weakly(self._calc_step))
        self._step = self.DeclareCacheEntry(
            "step", step, tickets
        ).cache_index()  # the entry would keep the block
        self.DeclareAbstractOutputPort(
            "contact_results",
            Value[object],
            weakly(self._tell_contacts),
            {self.get_cache_entry(self._step).ticket()},
        )
        self.DeclareAbstractOutputPort(
            "body_poses", Value[list[RigidTransform]], weakly(self._tell_poses), {self.xd_ticket()}
        )

    @property
    def optional_inputs(self) -> tuple[str, ...]:
        """Names of its inputs: what is not connected does not act, as with Drake's plant."""
        return tuple(
            self.get_input_port(index).get_name() for index in range(self.num_input_ports())
        )

    get_state_output_port = partialmethod(Block.GetOutputPort, "state")
    get_contact_results_output_port = partialmethod(Block.GetOutputPort, "contact_results")
    get_body_poses_output_port = partialmethod(Block.GetOutputPort, "body_poses")
    get_applied_spatial_force_input_port = partialmethod(
        Block.GetInputPort, "applied_spatial_force"
    )
    get_applied_generalized_force_input_port = partialmethod(
        Block.GetInputPort, "applied_generalized_force"
    )

    def get_actuation_input_port(self, instance: ModelInstanceIndex) -> InputPort:
        """Return ``actuation.<instance>``."""
        return self.get_input_port(self._motors[int(instance)].actuation)

    def get_desired_state_input_port(self, instance: ModelInstanceIndex) -> InputPort:
        """Return ``desired_state.<instance>``."""
        return self.get_input_port(self._motors[int(instance)].desired)

    def get_net_actuation_output_port(self, instance: ModelInstanceIndex) -> OutputPort:
        """Return ``net_actuation.<instance>``."""
        return self.get_output_port(self._motors[int(instance)].applied)

    def GetPositions(self, context: Context) -> Vector:
        """Return the plant's positions, shape (nq,), in a context of this block."""
        return self.GetPositionsAndVelocities(context)[: self._nq]

    def GetVelocities(self, context: Context) -> Vector:
        """Return the plant's velocities, shape (nv,)."""
        return self.GetPositionsAndVelocities(context)[self._nq :]

    def GetPositionsAndVelocities(self, context: Context) -> Vector:
        """Return both, shape (nq + nv,)."""
        return np.array(context.get_discrete_state(self._motion).value())

    def SetPositions(self, context: Context, q: Vector) -> None:
        """Set the plant's positions, shape (nq,)."""
        context.SetDiscreteState(self._motion, np.concatenate([q, self.GetVelocities(context)]))

    def SetVelocities(self, context: Context, v: Vector) -> None:
        """Set the plant's velocities, shape (nv,)."""
        context.SetDiscreteState(self._motion, np.concatenate([self.GetPositions(context), v]))

    def _begin(self, context: Context, values: DiscreteValues) -> EventStatus:
        if not np.isinf(context.get_discrete_state(self._warm).value()).any():
            return EventStatus.DidNothing()
        self._coordinates.put(self._data, self.GetPositionsAndVelocities(context))
        self._put_torques(values, self._servos.limited(self._servos.torques(*self._asked(context))))
        return EventStatus.Succeeded()

    def _update(self, context: Context, values: DiscreteValues) -> None:
        entry = self.get_cache_entry(self._step)
        step = self._made(context) if entry.is_out_of_date(context) else entry.Eval(context)
        values.set_value(self._motion, step.state)
        values.set_value(self._warm, step.warm)
        self._put_torques(values, step.torque)

    def _put_torques(self, values: DiscreteValues, torques: Vector) -> None:
        for motors in self._motors.values():
            values.set_value(motors.torque, torques[motors.places])

    def _tell_contacts(self, context: Context, output: AbstractValue) -> None:
        # what touches is in the data of the step made last
        if self.get_cache_entry(self._step).Eval(context) is not self._latest:
            self._made(context)
        touching = np.flatnonzero(self._data.contact.efc_address >= 0)
        contact, shapes = self._data.contact, self._geoms
        frames, first = contact.frame[touching].reshape(-1, 3, 3), contact.efc_address[touching]
        # of elliptic cones: along the normal, then across
        sizes = np.minimum(contact.dim[touching], 3)
        force = np.zeros((len(touching), 3))
        for across in range(3):
            rows = sizes > across
            force[rows, across] = self._data.efc_force[first[rows] + across]
        pairs = [
            (shapes[second], shapes[first]) for first, second in contact.geom[touching].tolist()
        ]
        forces = np.einsum("ki,kij->kj", force, frames)
        output.set_value(
            Contacts(pairs, contact.pos[touching], forces, np.zeros_like(forces), frames[:, 0])
        )

    def _tell_poses(self, context: Context, output: AbstractValue) -> None:
        self._plant.SetPositions(self._scratch, self.GetPositions(context))
        output.set_value(self._plant.get_body_poses_output_port().Eval(self._scratch))

    def _calc_step(self, context: Context, value: AbstractValue) -> None:
        value.set_value(self._made(context))

    def _made(self, context: Context) -> Step:
        """Make a step from the state of a context, and return what it does."""
        kept, nq = context.get_discrete_state(), self._nq
        there = self._coordinates.to_mujoco(kept.value(self._motion))
        self._qpos[:], self._qvel[:], warm = there[:nq], there[nq:], kept.value(self._warm)
        self._guess[:] = 0.0 if warm.size and warm[0] == _NOT_YET else warm
        desired, extra = self._asked(context)
        spatial, data = self.EvalAbstractInput(context, self._spatial.get_index()), self._data
        if spatial is not None:
            mujoco.mj_step1(self._model, data)
            data.xfrc_applied[:] = 0.0
            for applied in spatial.get_value():
                body, force = self._bodies[int(applied.body_index)], applied.F_Bq_W.translational()
                point = data.xpos[body] + data.xmat[body].reshape(3, 3) @ applied.p_BoBq_B
                data.xfrc_applied[body, :3] += force
                data.xfrc_applied[body, 3:] += applied.F_Bq_W.rotational() + np.cross(
                    point - data.xipos[body], force
                )
        forces: Vector | float = 0.0
        if (
            generalized := self.EvalVectorInput(context, self._generalized.get_index())
        ) is not None:
            turned = np.concatenate([kept.value(self._motion)[:nq], generalized.value()])
            forces = self._coordinates.to_mujoco(turned)[nq:]
        torque = self._servos.step(desired, extra, forces, begun=spatial is not None)
        there[:nq], there[nq:] = self._qpos, self._qvel
        self._latest = Step(self._coordinates.state(there), self._data.qacc.copy(), torque)
        return self._latest

    def _asked(self, context: Context) -> tuple[Vector, Vector | None]:
        """Return the desired positions of all motors, and their torques beside those of servos, shape (m,) each."""
        desired, extra = np.zeros(self._servos.count), None
        for motors in self._motors.values():
            if (asked := self.EvalVectorInput(context, motors.desired)) is not None:
                desired[motors.places] = asked.value()[: motors.count]
            if (more := self.EvalVectorInput(context, motors.actuation)) is not None:
                extra = np.zeros(self._servos.count) if extra is None else extra
                extra[motors.places] = more.value()
        return desired, extra


@dataclass(frozen=True)
class _Motors:
    """Of a model instance: where its motors are among the plant's, how many, its ports, the torques' discrete group."""

    places: Places | slice
    count: int
    actuation: int
    desired: int
    applied: int
    torque: int
