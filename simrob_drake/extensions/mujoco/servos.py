r"""MuJoCo's steps with servos that stop at their limits.

Servos in the plant's actuators are taken at the end of a step h, as Drake's discrete solvers take them:

.. math:: \tau = \mathrm{clip}\bigl(k_p\,(q_r - q^+) - k_d\,v^+ + u\bigr).

MuJoCo's integrator ``discrete`` solves that together with the contacts, but for the limit, which it minds at the start
of a step: a light joint at its limit then chatters. So its servos have no limits here. After a step those beyond theirs
give just that, as a constant torque, and the step is made again, until servos and limits agree: an active-set method
(Nocedal and Wright, Numerical Optimization, ch. 16.5). It takes 2 to 6 rounds, and one where no limit is reached. A
motor beyond its line gives its torque at rest, and brakes with the line's slope in place of its own gains. Meanwhile
contacts stay as they are: MuJoCo softens each by what its bodies feel of the servos, so that without them it is given a
stiffer one.
"""

import mujoco
import numpy as np
import numpy.typing as npt
from pydrake.multibody.tree import JointActuatorIndex

from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import message
from simrob_drake.extensions.mujoco.coordinates import Names
from simrob_drake.parts.station_plant import StationPlant
from simrob_drake.robots.axis_map import in_a_row

_TOGETHER, _ROUNDS = 5, 100
"""So often all motors that are on a wrong side change together; then the first of them alone, which cannot go on for
ever where torques turn joints their way (Murty's least-index rule for linear complementarity)."""
_LINE = 2.0  # the side, to either hand, of a motor at the line of its torque over its speed; 1 is at its limit
_NO_LIMIT = np.finfo(float).max  # as good as none, and zero times it is zero


class Servos:
    """The m motors of a plant, in its order, and the steps that they take part in.

    Attributes:
        count: m.
        instances: the places of each model instance's motors, by its number.
    """

    def __init__(
        self, station: StationPlant, model: mujoco.MjModel, data: mujoco.MjData, names: Names
    ) -> None:
        """Find the motors of a station's plant in the model that was made of it."""
        plant = station.plant
        motors = [
            plant.get_joint_actuator(JointActuatorIndex(index))
            for index in range(plant.num_actuators())
        ]
        gains = [
            motor.get_controller_gains() if motor.has_controller() else None for motor in motors
        ]
        joints = [model.joint(names.joint(motor.joint())) for motor in motors]
        owners = np.array([int(motor.model_instance()) for motor in motors], np.intp)
        self.count = len(motors)
        self.instances = {
            owner: np.flatnonzero(owners == owner) for owner in dict.fromkeys(owners.tolist())
        }
        self._servos = in_a_row(np.flatnonzero([own is not None for own in gains]))
        self._angles = in_a_row(np.array([joint.qposadr[0] for joint in joints], np.intp))
        self._driven = np.array([joint.dofadr[0] for joint in joints], np.intp)
        self._speeds = in_a_row(self._driven)
        limits = [
            motor.effort_limit() if own else np.inf
            for motor, own in zip(motors, gains, strict=True)
        ]
        self._limits = np.minimum(limits, _NO_LIMIT)
        self._stalls, self._slopes = np.full(self.count, _NO_LIMIT), np.zeros(self.count)
        places = {motor.joint().index(): place for place, motor in enumerate(motors)}
        for robot in station.robots.values():
            driven = np.flatnonzero(~robot.gains.passive)  # passive axes have no motor
            own = [places[robot.joints[axis].index()] for axis in driven]
            if (line := robot.gains.line) is not None and all(
                gains[place] for place in own
            ):  # else blocks have it
                self._stalls[own] = np.minimum(line.stall[driven], _NO_LIMIT)
                self._slopes[own] = line.slope[driven]
                self._limits[own] = np.minimum(robot.gains.limit_at_any_speed[driven], _NO_LIMIT)
        self._has_lines = bool(self._slopes.any())
        self._kp, self._kd = (
            np.array([getattr(own, key) if own else 0.0 for own in gains]) for key in "pd"
        )
        self._model, self._data, self._step = model, data, model.opt.timestep
        self._gains, self._biases = model.actuator_gainprm[:, 0], model.actuator_biasprm
        self._qpos, self._qvel, self._control, self._applied = (
            data.qpos,
            data.qvel,
            data.ctrl,
            data.qfrc_applied,
        )

    def torques(self, desired: Vector, extra: Vector | None) -> Vector:
        """Return what the law asks of each motor where the data stands (m,), without limits [N·m or N].

        Positions are desired (m,) [rad or m]; ``extra`` (m,) are torques beside those of servos, None for none.
        """
        asked = (
            self._kp * (desired - self._qpos[self._angles]) - self._kd * self._qvel[self._speeds]
        )
        return np.asarray(asked if extra is None else asked + extra)

    def limited(self, torques: Vector) -> Vector:
        """Return torques (m,) within what the motors have at the speeds of the data."""
        return np.minimum(np.maximum(torques, self._bound(-1.0)), self._bound(1.0))

    def _bound(self, side: float | Vector) -> Vector:
        """Return what the motors have at most to a side, shape (m,), at the speeds of the data."""
        line = side * self._stalls - self._slopes * self._qvel[self._speeds]
        return np.asarray(np.minimum(np.maximum(line, -self._limits), self._limits))

    def step(
        self, desired: Vector, extra: Vector | None, forces: Vector | float, *, begun: bool
    ) -> Vector:
        """Step the data, and return what each motor gave (m,) [N·m or N]; arguments as of :meth:`torques`.

        ``forces`` (nv,) act on MuJoCo's velocities from elsewhere; ``begun``: ``mj_step1`` was called. Raises
        RuntimeError: servos at their limits and contacts do not settle.
        """
        start = self._qpos.copy(), self._qvel.copy()
        self._control[:] = desired[self._servos]
        self._applied[:] = forces
        if extra is not None:
            np.add.at(self._applied, self._driven, extra)
        (mujoco.mj_step2 if begun else mujoco.mj_step)(self._model, self._data)
        torque = self.torques(desired, extra)
        found = self._sides(torque)
        return (
            torque if found is None else self._settled(desired, extra, forces, start, torque, found)
        )

    def _settled(
        self,
        desired: Vector,
        extra: Vector | None,
        forces: Vector | float,
        start: tuple[Vector, Vector],
        torque: Vector,
        found: Vector | None,
    ) -> Vector:
        """Make a step again until servos and limits agree; contacts are what they are with all servos."""
        softness, felt = self._data.contact.solref.copy(), self._inverse_masses()
        sides = np.zeros(self.count)
        try:
            for again in range(_ROUNDS):
                found = np.zeros(self.count) if found is None else found
                found[found * sides < 0] = (
                    0.0  # from one limit the way to the other leads between them
                )
                if (found == sides).all():
                    return np.where(sides, self._bound(np.sign(sides)), torque)
                sides = found if again < _TOGETHER else _first_changed(sides, found)
                self._drive(sides, extra, forces)
                for twice in (False, True):
                    if again or twice:
                        self._data.contact.solref[:] = (
                            softness * (self._inverse_masses() / felt)[:, np.newaxis]
                        )
                    self._qpos[:], self._qvel[:] = start
                    mujoco.mj_step2(self._model, self._data)
                torque = self.torques(desired, extra)
                found = self._sides(torque)
        finally:
            self._give_gains(self._kp, self._kd)
        raise RuntimeError(
            message(
                "mujoco.servos_do_not_settle",
                "servos at their torque limits and MuJoCo's contacts do not settle within a step",
            )
        )

    def _sides(self, torque: Vector) -> Vector | None:
        """Return at which limits or lines motors are that ask for torques (m,), 0 for none; None: they all are not."""
        limit = np.abs(torque) - self._limits
        if not self._has_lines:
            return np.where(limit > 0, np.sign(torque), 0.0) if limit.max(initial=0.0) > 0 else None
        braked = torque + self._slopes * self._qvel[self._speeds]
        line = np.abs(braked) - self._stalls
        most = np.maximum(line, limit)
        if not most.max(initial=0.0) > 0:
            return None
        return np.where(
            most > 0, np.where(line > limit, _LINE * np.sign(braked), np.sign(torque)), 0.0
        )

    def _drive(self, sides: Vector, extra: Vector | None, forces: Vector | float) -> None:
        """Let servos within their limits follow their gains, those at lines brake, and the others give their limits."""
        within, lines = sides == 0, np.abs(sides) == _LINE
        self._give_gains(within * self._kp, np.where(within, self._kd, lines * self._slopes))
        self._applied[:] = forces
        ends = np.sign(sides) * np.where(lines, self._stalls, self._limits)
        np.add.at(
            self._applied, self._driven, np.where(within, 0.0 if extra is None else extra, ends)
        )

    def _give_gains(self, kp: Vector, kd: Vector) -> None:
        kp = kp[self._servos]
        self._gains[:], self._biases[:, 1], self._biases[:, 2] = kp, -kp, -kd[self._servos]

    def _inverse_masses(self) -> npt.NDArray[np.float64]:
        """Return what MuJoCo takes for the inverse mass of each contact, times one minus its impedance."""
        contact, step, softness = self._data.contact, self._step, self._data.contact.solref
        if not self._data.nefc:
            return np.ones(self._data.ncon)
        part = contact.solimp[:, 0] - step * softness[:, 1] - step**2 * softness[:, 0]
        return np.asarray(self._data.efc_R[contact.efc_address] * part)


def _first_changed(sides: Vector, found: Vector) -> Vector:
    place = int(np.argmax(sides != found))
    return np.concatenate([sides[:place], found[place : place + 1], sides[place + 1 :]])
