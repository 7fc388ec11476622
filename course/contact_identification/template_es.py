"""Ejercicio 4, un suelo a partir de un bote: una pelota de 0,9048 kg cae 0,1 m; halla la rigidez y la disipación.

El suelo empuja con k x (1 + d x') mientras la pelota está hundida x, y nunca tira.
"""

MASS = 0.9048  # kg
GRAVITY = 9.80665  # m/s^2


def sink(k):
    """Devuelve cuánto se hunde la pelota en reposo [m] con una rigidez k [N/m]."""
    raise NotImplementedError


def contact_time(k):
    """Devuelve cuánto dura el contacto si cae 0,1 m sin disipación [s]; basta un 5 %."""
    raise NotImplementedError


def identify(times, heights):
    """Devuelve (k [N/m], d [s/m]) de un bote medido.

    times, heights: 150 muestras del punto más bajo [s], [m], con 0,5 mm de ruido; se suelta en el instante 0.
    """
    raise NotImplementedError


def dissipation_for(height):
    """Devuelve d [s/m] con la que la pelota sube a una altura [m] tras el primer bote, en un suelo de 4000 N/m."""
    raise NotImplementedError


if __name__ == "__main__":
    print(
        "con 1000 N/m la pelota se hunde",
        sink(1000),
        "m y toca el suelo durante",
        contact_time(1000),
        "s",
    )
