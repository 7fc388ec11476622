"""Ejercicio 10, una caída: a un humanoide lo tumban de un empujón, y no debe dar con la cabeza en el suelo.

Mira hacia -y y se inclina en torno a x: un ángulo positivo lo inclina hacia delante.
"""

import numpy as np

from simrob_drake import load_station, simulate
from simrob_drake.blocks.sampled import SampledBlock
from simrob_drake.robots.catalog import load_robot

AXES = list(load_robot("humanoid").axes)  # en el orden de todos los vectores
ARMS = [AXES.index(name) for name in ("right_shoulder_pitch", "left_shoulder_pitch")]
MASS, GRAVITY, COM_HEIGHT, TOES, INERTIA = (
    2.292,
    9.80665,
    0.228,
    0.079,
    0.037,
)  # como en el ejercicio 7


def run(force, blocks=()):
    """Empuja el tronco con una fuerza [N] en y durante 0,2 s (delante es negativo), sin los guardas de la estación."""
    station = load_station(
        "humanoid_fall_forward", {"controllers": {}, "forces.shove.force": [0, force, 0]}
    )
    return simulate(station, blocks=blocks, duration=3.0, progress=False)


def lean_of(pose):
    """Devuelve cuánto se inclina el tronco hacia delante [rad]; pose: x y z qw qx qy qz."""
    return 2 * np.arctan2(pose[4], pose[3])


def tips(lean, rate):
    """Dice si cae hacia delante un robot que se inclina tanto [rad] y sigue a esa velocidad [rad/s]."""
    raise NotImplementedError


class Guard(SampledBlock):
    """Lleva los brazos a donde frenan el cuerpo, en cuanto cae."""

    def __init__(self):
        """Muestrea 100 veces por segundo; recuerda una postura y hacia dónde cae (0 si no cae)."""
        super().__init__(
            period=0.01,
            reads={"base_pose": 7},
            memory={"reference": np.zeros(len(AXES)), "way": np.zeros(1)},
            gives=("reference",),
        )

    def sample(self, memory, read):
        """Devuelve lo que cambia: {"reference": ..., "way": ...}."""
        raise NotImplementedError


if __name__ == "__main__":
    print("la cabeza se acerca al suelo hasta", run(-12.0)["distance.head"].min(), "m")
