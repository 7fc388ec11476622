"""Ejercicio 5, parar ante una fuerza: una bola en un lápiz baja al suelo. ¿Con cuánto aprieta, y quién la para?"""

import numpy as np

from simrob_drake import Arm, load_station, simulate

STATION = "irb120_force_stop"
STRONG = {
    "servo.torque_limit": 500,
    "servo.kd": 50,
    "contact.friction": {"static": 0, "dynamic": 0},
}
FLOOR = 1e5  # N/m, y 1 s/m de disipación
HOME = np.deg2rad([0, 0, 26.1, 0, 63.9, 0])
RADIUS = 0.01  # m, de la bola

arm = Arm(load_station(STATION))


def below(depth):
    """Devuelve los ángulos [deg] que llevan el punto más bajo de la bola una profundidad [m] bajo el suelo."""
    pose = arm.pose(HOME).copy()
    pose[2] = RADIUS - depth
    return list(np.rad2deg(arm.joint(pose)))


def run(depth, seconds=2.0, **changes):
    """Baja la referencia a una profundidad [m] en esos segundos, y espera uno."""
    moves = {"reference.target_deg": below(depth), "reference.duration": seconds}
    station = load_station(STATION, {**moves, "monitors": {}, **changes})
    return simulate(station, duration=seconds + 1, progress=False)


def stiffness(kp):
    """Devuelve cuántos N más aprieta la punta por cada m que baja la referencia, con motores STRONG."""
    raise NotImplementedError


def depth(force):
    """Devuelve cuánto debe bajar la referencia [m] para apretar con una fuerza [N] en reposo; kp 1000, STRONG."""
    raise NotImplementedError


def monitors(limit):
    """Devuelve la sección `monitors` de la estación que la termina cuando la punta aprieta con el límite [N]."""
    raise NotImplementedError


def force_after(speed, delay):
    """Devuelve la fuerza [N] un tiempo [s] después de tocar el suelo con una velocidad [m/s]."""
    raise NotImplementedError


def shortest(limit):
    """Devuelve el menor tiempo [s] para bajar a 0,06 m con como mucho el límite [N] 4 ms después de tocar."""
    raise NotImplementedError


if __name__ == "__main__":
    result = run(0.01, **STRONG)
    print("la punta aprieta con", result["force.touch.z"][-1], "N")
