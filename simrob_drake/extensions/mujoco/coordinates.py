"""Between a station's plant and its MuJoCo model: positions and velocities, and what bodies and joints are called."""

from collections import Counter
from collections.abc import Collection
from dataclasses import dataclass
from itertools import count

import mujoco
import numpy as np
import numpy.typing as npt
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import BodyIndex, Joint, RigidBody

from simrob_drake.base.frames import Vector, rotate_vectors


class Names:
    """The names of a plant's bodies and joints: their own, and ``<model>.<own>`` where several have the same."""

    def __init__(self, plant: MultibodyPlant) -> None:
        self._plant = plant
        self._bodies = Counter(
            plant.get_body(BodyIndex(index)).name() for index in range(plant.num_bodies())
        )
        self._joints = Counter(plant.get_joint(index).name() for index in plant.GetJointIndices())

    def body(self, body: RigidBody) -> str:
        """Return the name of a body."""
        return self._unique(body, self._bodies)

    def joint(self, joint: Joint) -> str:
        """Return the name of a joint."""
        return self._unique(joint, self._joints)

    def _unique(self, element: RigidBody | Joint, counted: Counter[str]) -> str:
        name: str = element.name()
        if counted[name] == 1:
            return name
        instance: str = self._plant.GetModelInstanceName(element.model_instance())
        return f"{instance.partition('::')[0]}.{name}"


def free_name(own: str, taken: Collection[str]) -> str:
    """Return a name that none has yet: its own, with a number behind where that is taken."""
    return (
        own
        if own not in taken
        else next(name for n in count(1) if (name := f"{own}.{n}") not in taken)
    )


Places = npt.NDArray[np.intp]


@dataclass(frozen=True)
class Coordinates:
    """Where the coordinates of a plant are in those of a model; each time positions, then velocities (nq + nv).

    A free body's angular velocity is about its own axes in MuJoCo, about the world's in Drake.
    """

    nq: int  # how many of them are positions
    there: Places  # of each of the plant's coordinates, its place in MuJoCo's, shape (nq + nv,)
    back: Places  # of each of MuJoCo's, its place in the plant's, shape (nq + nv,)
    # of each free body the places of quaternion (4) and angular velocity (3) in MuJoCo's
    free: tuple[tuple[slice, slice], ...]

    @property
    def velocities(self) -> Places:
        """Of each of the plant's velocities its place in MuJoCo's, shape (nv,)."""
        return self.there[self.nq :] - self.nq

    @classmethod
    def of(cls, plant: MultibodyPlant, model: mujoco.MjModel, names: Names) -> "Coordinates":
        """Return those of a finalized plant and the model that was made of it."""
        nq, free = plant.num_positions(), []
        there = np.zeros(nq + plant.num_velocities(), np.intp)
        for index in plant.GetJointIndices():
            joint = plant.get_joint(index)
            q, v, count = (
                joint.position_start(),
                nq + joint.velocity_start(),
                joint.num_velocities(),
            )
            if not count:
                continue
            own = model.joint(names.joint(joint))
            position, speed = int(own.qposadr[0]), nq + int(own.dofadr[0])
            if count == 1:
                there[q], there[v] = position, speed
                continue
            # Drake has the quaternion first
            there[q : q + 7] = position + np.array([3, 4, 5, 6, 0, 1, 2])
            there[v : v + 6] = speed + np.array([3, 4, 5, 0, 1, 2])
            free.append((slice(position + 3, position + 7), slice(speed + 3, speed + 6)))
        return cls(nq, there, np.argsort(there), tuple(free))

    def to_drake(self, states: Vector) -> Vector:
        """Return the plant's coordinates (m, nq + nv) of MuJoCo's."""
        states = states.copy() if self.free else states
        for quaternion, turning in self.free:
            states[:, turning] = rotate_vectors(states[:, quaternion], states[:, turning])
        return np.asarray(states[:, self.there])

    def to_mujoco(self, state: Vector) -> Vector:
        """Return MuJoCo's coordinates (nq + nv,) of the plant's; forces at velocities may stand in their place."""
        there = state[self.back]
        for quaternion, turning in self.free:
            there[turning] = _turned(there[quaternion], there[turning], -1.0)
        return np.asarray(there)

    def put(self, data: mujoco.MjData, state: Vector) -> None:
        """Let MuJoCo's data stand where the plant does (nq + nv,)."""
        there = self.to_mujoco(state)
        data.qpos[:], data.qvel[:] = there[: self.nq], there[self.nq :]

    def state(self, there: Vector) -> Vector:
        """Return the plant's coordinates of MuJoCo's (nq + nv,), which change."""
        for quaternion, turning in self.free:
            there[turning] = _turned(there[quaternion], there[turning], 1.0)
        return np.asarray(there[self.there])


def _turned(quaternion: Vector, vector: Vector, sense: float) -> tuple[float, float, float]:
    """Rotate one vector as :func:`simrob_drake.base.frames.rotate_vectors`, with plain numbers, which is quicker."""
    w, x, y, z = quaternion.tolist()
    a, b, c = vector.tolist()
    x, y, z = sense * x, sense * y, sense * z
    p, q, r = 2 * (y * c - z * b), 2 * (z * a - x * c), 2 * (x * b - y * a)
    return a + w * p + y * r - z * q, b + w * q + z * p - x * r, c + w * r + x * q - y * p
