"""Ejercicio 3, gravedad y cargas: qué dan contra la gravedad las articulaciones 2 y 3 de un IRB120, y qué llevan.

Las demás están en cero. Una carga es un punto 0,05 m delante de la brida. En cero el brazo está de pie y el antebrazo
apunta hacia delante; ambas giran en y, de modo que un ángulo positivo baja lo que tienen delante.
"""

GRAVITY = 9.80665  # m/s^2
# masa [kg], y centro de masas por delante y por encima de la articulación que lleva la parte, en cero [m]
UPPER_ARM = (3.909, 0.00078, 0.10124)  # de la articulación 2; la 3 está 0,270 por encima de la 2
FOREARM = [
    (2.944, 0.02281, 0.05791),
    (1.328, 0.2247, 0.07041),
    (0.546, 0.30091, 0.07006),
    (0.137, 0.36694, 0.07),
]
FLANGE = (0.374, 0.07)  # de la articulación 3


def gravity(q2, q3, load):
    """Devuelve (par de la 2, par de la 3) en N·m que sostienen el brazo con una carga en kg."""
    raise NotImplementedError


def aware(load):
    """Devuelve la masa [kg] que debe creer gravity() para que la 2 acabe medio grado más allá de su referencia."""
    raise NotImplementedError


def weakest(load):
    """Devuelve (q2, q3) en rad donde la 2 tiene que dar más; q3 de -110 a 70 grados."""
    raise NotImplementedError


def payload(limit):
    """Devuelve la mayor carga [kg] que la 2 sostiene con q2 = 90 y q3 = -70 grados, con un límite en N·m."""
    raise NotImplementedError


if __name__ == "__main__":
    print("con 30 grados y sin carga:", gravity(0.5236, 0, 0), "y debe ser unos -14.98 y -6.46 N·m")
