"""Ejercicio 8, la marcha: el paso de la memoria, con un pie y con el otro, y por qué es tan lento.

Nombres de SimRob: Cad cadera, Rod rodilla, Tob tobillo, Hom hombro; D derecha, I izquierda; F frontal, L lateral.
"""

from simrob_drake import load_station, simulate

STEP = [
    {"CadIF": 60, "RodI": 60},  # levanta la pierna izquierda
    {"RodD": 30, "TobD": -30},  # dobla la derecha: el cuerpo baja y avanza
    {"CadIF": 0, "RodI": 0},  # apoya el pie izquierdo
    {"RodD": 0, "TobD": 0},  # levantarse
]  # deg


def march(moves, seconds=1.0, kd=100):
    """Hace pasar al humanoide por los movimientos, cada uno en esos segundos; kp es 100 N·m/rad."""
    targets = [{"time": (k + 1) * seconds, "target_deg": move} for k, move in enumerate(moves)]
    changes = {"reference": {"kind": "sequence", "targets": targets}, "servo.kd": kd}
    return simulate(
        load_station("humanoid_dynamic", changes), duration=len(moves) * seconds + 1, progress=False
    )


def mirrored(move):
    """Devuelve un movimiento con izquierda y derecha cambiadas."""
    raise NotImplementedError


def moves(steps):
    """Devuelve los movimientos de una marcha de esos pasos, primero el izquierdo."""
    raise NotImplementedError


def lag(kp, kd):
    """Devuelve cuántos segundos va por detrás de una rampa una articulación lenta."""
    raise NotImplementedError


def quick():
    """Devuelve (kd, segundos) con los que moves(4) va a 45 mm/s o más, en pie, y gira 10 grados como mucho."""
    raise NotImplementedError


if __name__ == "__main__":
    result = march(STEP)
    print(result.message, "- avanza", 1e3 * (result["base.y"][0] - result["base.y"][-1]), "mm")
