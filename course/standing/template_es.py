"""Ejercicio 7, de pie sobre dos pies: cuánto se puede empujar a un humanoide antes de que vuelque.

Mira hacia -y: un empujón hacia delante va en -y. Se le empuja en el centro de masas de su tronco.
"""

from simrob_drake import load_station, simulate

MASS, GRAVITY = 2.292, 9.80665  # kg, m/s^2
COM_HEIGHT, PUSH_HEIGHT, ANKLE_HEIGHT = 0.228, 0.319, 0.030  # m sobre el suelo
INERTIA = 0.037  # kg m^2 respecto al centro de masas, al volcar hacia delante o atrás
TOES = {"spheres_B": 0.079, "spheres_C": 0.132}  # m, del centro de masas a la punta de los pies
HEELS = {"spheres_B": 0.030, "spheres_C": 0.049}  # m, al talón


def stands(force, seconds, feet="spheres_B", lean=0.0):
    """Dice si sigue en pie tras un empujón [N] en y (delante es negativo), con los tobillos girados [deg]."""
    ankles = {"right_ankle_pitch": lean, "left_ankle_pitch": lean}
    push = {"kind": "push", "start": 2.0, "duration": seconds, "force": [0, force, 0]}
    changes = {
        "robot.feet": feet,
        "reference": {"kind": "move", "target_deg": ankles, "duration": 1.0},
    }
    station = load_station("humanoid_dynamic", {**changes, "forces.push": push})
    return simulate(station, duration=2.0 + seconds + 2.0, progress=False).ending == "completed"


def steady_push(ahead, feet):
    """Devuelve la fuerza [N] que justo lo vuelca si dura; ahead: True o False (hacia atrás)."""
    raise NotImplementedError


def short_push(seconds, feet):
    """Devuelve la fuerza [N] hacia atrás que justo lo vuelca si dura esos segundos."""
    raise NotImplementedError


def lean():
    """Devuelve el ángulo de ambos tobillos [deg] con el que aguanta igual hacia delante y atrás (spheres_B)."""
    raise NotImplementedError


if __name__ == "__main__":
    print("1 N hacia atrás durante 3 s:", "en pie" if stands(1.0, 3.0) else "se cae")
