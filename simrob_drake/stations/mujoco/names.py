"""What the bodies and joints of a station's plant are called in MJCF, where each name stands once."""

from collections import Counter
from collections.abc import Collection
from itertools import count

from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import BodyIndex, Joint, RigidBody


class Names:
    """The names of a plant's bodies and joints: their own, and ``<model>.<own>`` where several have the same."""

    def __init__(self, plant: MultibodyPlant) -> None:
        """Count the names."""
        self._plant = plant
        self._bodies = Counter(plant.get_body(BodyIndex(index)).name() for index in range(plant.num_bodies()))
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
    return own if own not in taken else next(name for n in count(1) if (name := f"{own}.{n}") not in taken)
