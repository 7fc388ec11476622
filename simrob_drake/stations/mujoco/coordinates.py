"""Between the positions and velocities of a station's plant and those of its MuJoCo model."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
import numpy.typing as npt
from pydrake.multibody.plant import MultibodyPlant

from simrob_drake.frames import Vector
from simrob_drake.stations.mujoco.names import Names

Places = npt.NDArray[np.intp]


@dataclass(frozen=True)
class Coordinates:
    """Where the coordinates of a plant are in those of a model.

    A free body's angular velocity is about its own axes in MuJoCo, about the world's in Drake.

    Attributes:
        positions: of each of the plant's positions, its place in MuJoCo's, shape (nq,).
        velocities: likewise, shape (nv,).
        free: of each free body the places of quaternion (4) and angular velocity (3) in MuJoCo's vectors.
    """

    positions: Places
    velocities: Places
    free: tuple[tuple[Places, Places], ...]

    @classmethod
    def of(cls, plant: MultibodyPlant, model: mujoco.MjModel, names: Names) -> Coordinates:
        """Return those of a finalized plant and the model that was made of it."""
        positions, velocities = np.zeros(plant.num_positions(), np.intp), np.zeros(plant.num_velocities(), np.intp)
        free = []
        for index in plant.GetJointIndices():
            joint = plant.get_joint(index)
            q, v, count = joint.position_start(), joint.velocity_start(), joint.num_velocities()
            if not count:
                continue
            own = model.joint(names.joint(joint))
            there, speeds = int(own.qposadr[0]), int(own.dofadr[0])
            if count == 1:
                positions[q], velocities[v] = there, speeds
                continue
            positions[q : q + 7] = there + np.array([3, 4, 5, 6, 0, 1, 2])  # Drake has the quaternion first
            velocities[v : v + 6] = speeds + np.array([3, 4, 5, 0, 1, 2])
            free.append((there + np.arange(3, 7), speeds + np.arange(3, 6)))
        return cls(positions, velocities, tuple(free))

    def to_drake(self, qpos: Vector, qvel: Vector) -> tuple[Vector, Vector]:
        """Return positions (m, nq) and velocities (m, nv) of the plant, of MuJoCo's."""
        speeds = qvel.copy()
        for quaternion, turning in self.free:
            speeds[:, turning] = turned(qpos[:, quaternion], qvel[:, turning], 1.0)
        return qpos[:, self.positions], speeds[:, self.velocities]

    def to_mujoco(self, q: Vector, v: Vector) -> tuple[Vector, Vector]:
        """Return MuJoCo's positions (nq,) and velocities (nv,), of the plant's."""
        qpos, qvel, back = np.empty_like(q), np.empty_like(v), np.empty(4)
        qpos[self.positions], qvel[self.velocities] = q, v
        for quaternion, turning in self.free:
            mujoco.mju_negQuat(back, qpos[quaternion])
            qvel[turning] = _turned(back, qvel[turning])
        return qpos, qvel

    def state(self, qpos: Vector, qvel: Vector) -> Vector:
        """Return positions and velocities (nq + nv,) of the plant, of MuJoCo's (nq,) and (nv,)."""
        speeds = qvel.copy()
        for quaternion, turning in self.free:
            speeds[turning] = _turned(qpos[quaternion], qvel[turning])
        return np.concatenate([qpos[self.positions], speeds[self.velocities]])


def _turned(quaternion: Vector, vector: Vector) -> Vector:
    turned = np.empty(3)
    mujoco.mju_rotVecQuat(turned, vector, quaternion)
    return turned


def turned(quaternions: Vector, vectors: Vector, sense: float) -> Vector:
    """Return vectors (m, 3) turned by unit quaternions (m, 4) w x y z, or back by them with sense -1."""
    w, axis = quaternions[:, :1], sense * quaternions[:, 1:]
    twice = 2 * np.cross(axis, vectors)
    return np.asarray(vectors + w * twice + np.cross(axis, twice))
