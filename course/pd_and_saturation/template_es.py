"""Ejercicio 2, servos PD y su saturación: la estación irb120_dynamic gira todas las articulaciones 30 grados en 1 s.

par = kp (referencia - posición) - kd velocidad, cortado en el límite. Pruebe con run() y luego escriba las funciones.
"""

from simrob_drake import load_station, simulate


def run(**settings):
    """Mueve el brazo con ajustes, como kp=500, kd=20 o torque_limit={"joint_2": 30}."""
    station = load_station(
        "irb120_dynamic", {f"servo.{key}": value for key, value in settings.items()}
    )
    return simulate(station, duration=3.0, progress=False)


def sag(kp):
    """Devuelve cuántos grados pasa de 30 la articulación 2 al final con kp [N·m/rad]. Aquí dentro no simule nada."""
    raise NotImplementedError


def gains():
    """Devuelve (kp, kd) de todas: poco error, apenas sobreoscilación, y no más de 45 N·m en la articulación 2."""
    raise NotImplementedError


def torque_limit():
    """Devuelve un límite [N·m] de la articulación 2: acaba a menos de 1.5 grados, y a más con un 5 % menos."""
    raise NotImplementedError


def disturbed():
    """Devuelve el nombre de la articulación, aparte de joint_2, que más se desvía si todos los límites son 10 N·m."""
    raise NotImplementedError


if __name__ == "__main__":
    result = run(kp=1000, kd=10)
    print(
        "la articulación 2 acaba en",
        result["q.joint_2"][-1],
        "rad y da",
        result["tau.joint_2"][-1],
        "N·m",
    )
