"""Ejercicio 6, guiado con la mano: un brazo cuyos servos ceden ante lo que su modelo no explica.

par = kp (q_ref - q) - kd v + x, y x' = gain (par que sostendría el brazo - par). kp es 1000, kd 10.
Las fuerzas van en los ejes de la herramienta: en HOME su eje y es el x del mundo, y su z apunta hacia abajo.
"""

import numpy as np

from simrob_drake import Arm, as_transform, load_station, simulate

STATION = "irb120_cobot"
HOME = np.deg2rad([0, 0, 0, 0, 90, 0])
FINE = {"solver.accuracy": 1e-3, "solver.max_step": 0.02}

arm = Arm(
    load_station(STATION)
)  # arm.jacobian(q), arm.pose(q), arm.dynamics.gravity(q): lo que hace falta está
axes = as_transform(arm.pose(HOME)).rotation().matrix()  # los de la herramienta, en HOME


def run(gain, force, seconds, kd=10):
    """Empuja la herramienta con una fuerza [N] durante esos segundos desde 0,5 s, y espera dos más."""
    push = {"kind": "push", "start": 0.5, "duration": seconds, "force": list(force)}
    servo = {"servo.admittance_gain": gain, "servo.kd": kd}
    station = load_station(STATION, {**FINE, **servo, "forces": {"hand": push}})
    return simulate(station, duration=seconds + 2.5, progress=False)


def hand_force(q, torque):
    """Devuelve la fuerza [N], en los ejes de la herramienta, de una mano sobre un brazo rígido en reposo."""
    raise NotImplementedError


def speed(gain, force):
    """Devuelve la velocidad (3) [m/s], en los ejes del mundo, con que una fuerza constante la mueve en HOME."""
    raise NotImplementedError


def gain_for(asked):
    """Devuelve la ganancia con la que 3 N en el eje y de la herramienta la mueven a una velocidad [m/s] en x."""
    raise NotImplementedError


def stiffest():
    """Devuelve la dirección (3), en los ejes de la herramienta, en que una mano la mueve menos en HOME."""
    raise NotImplementedError


def settings():
    """Devuelve (gain, kd): 2 N en y durante 0,5 s la mueven 40 mm o más; al soltarla sigue 10 como mucho."""
    raise NotImplementedError


if __name__ == "__main__":
    result = run(300, [0, 2, 0], 0.5)
    tool = result.pose("tcp")[:, :3]
    print(
        "el empujón movió la herramienta",
        1e3 * (tool[100] - tool[50]),
        "mm, y luego",
        1e3 * (tool[-1] - tool[100]),
    )
