"""Ejercicio 1, cinemática de un brazo: dónde está la brida de un ABB IRB120 y cómo llevarla a un lugar.

Longitudes [m]: 0,290 del suelo a la articulación 2, 0,270 a la 3, 0,070 hacia arriba y 0,302 hacia delante a la 5,
0,072 a la brida. En cero el brazo apunta en x; la articulación 1 gira en z, las 2, 3 y 5 en y, las 4 y 6 en x.
"""

import numpy as np


def tool_position(q):
    """Devuelve el lugar de la brida [x, y, z] en m con seis ángulos en rad."""
    raise NotImplementedError


def jacobian(q):
    """Devuelve la matriz de 3 x 6 que da la velocidad de la brida a partir de las velocidades articulares."""
    raise NotImplementedError


def posture(place, q):
    """Devuelve seis ángulos que llevan la brida a un lugar, empezando en q; dentro de los límites articulares."""
    raise NotImplementedError


def flipped(q):
    """Devuelve la otra postura de la muñeca con la misma pose de la brida: lugar y ejes."""
    raise NotImplementedError


def singular():
    """Devuelve una postura, dentro de los límites, en la que la brida no puede moverse en una dirección."""
    raise NotImplementedError


if __name__ == "__main__":
    print("la brida en cero:", tool_position(np.zeros(6)), "y debe ser [0.374 0 0.63]")
