"""Ejercicio 9, un lazo externo: nadie da ángulos; el humanoide se agacha a una altura y luego levanta los brazos."""

import numpy as np

from simrob_drake import load_station, simulate
from simrob_drake.blocks.sampled import SampledBlock
from simrob_drake.robots.catalog import load_robot

AXES = list(load_robot("humanoid").axes)  # en el orden de todos los vectores
ARMS = [AXES.index(name) for name in ("right_shoulder_pitch", "left_shoulder_pitch")]
PERIOD = 0.01  # s


def weights():
    """Devuelve cuánto gira cada eje de las piernas por un grado de las rodillas, como {"left_knee": 1, ...}."""
    raise NotImplementedError


class Height(SampledBlock):
    """Lleva la cadera a una altura [m], y levanta los brazos 90 grados cuando está a menos de 5 mm."""

    def __init__(self, height):
        """Lee la pose de la base, x y z qw qx qy qz; recuerda lo que haga falta."""
        super().__init__(
            period=PERIOD,
            reads={"base_pose": 7},
            memory={"reference": np.zeros(len(AXES))},
            gives=("reference",),
        )
        self.parameters = {"height": height}

    def sample(self, memory, read):
        """Devuelve lo que cambia, como {"reference": ...} [rad]."""
        raise NotImplementedError


def run(height, **changes):
    """Deja que el humanoide se agache durante ocho segundos."""
    station = load_station("humanoid_dynamic", changes)
    return simulate(station, blocks=[Height(height)], duration=8.0, progress=False)


if __name__ == "__main__":
    result = run(0.40)
    print(result.message, "- la cadera está a", result["base.z"][-1], "m")
