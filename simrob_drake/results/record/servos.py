"""Servo gains of a run, as its summary and the subtitles of its plots show them."""

from collections.abc import Mapping, Sequence
from typing import Any

from simrob_drake.base.messages import compound, join_texts, message
from simrob_drake.results.record.run import RecordedRun

_NAMES = ("kp", "ki", "kd")
"""Names of the gains, in the order in which they are shown."""


def servos_of(run: RecordedRun) -> dict[str, dict[str, Any]]:
    """Gains of the servos by robot: ``kp``, ``ki`` and ``kd`` by axis, and ``feedforward``.

    Empty for a kinematic station, whose joints are prescribed.
    """
    if not run.config.engine.moves_by_forces:
        return {}
    found = dict[str, dict[str, Any]]()
    for name, robot in run.plant.robots.items():
        servo: dict[str, Any] = {}
        for gain in _NAMES:
            # Plain numbers, since the gains are written to a JSON file.
            values = getattr(robot.gains, gain).tolist()
            servo[gain] = dict(zip(robot.axes, values, strict=True))
        servo["feedforward"] = run.config.servo_of(name).feedforward
        found[name] = servo
    return found


def servo_in_words(servo: Mapping[str, Any]) -> str:
    """Write the gains of one robot, such as ``kp 1000, kd 10, feedforward gravity``. Gains that are zero are left out.

    Args:
        servo: an entry of :func:`servos_of`.
    """
    parts = list[str]()
    for name in _NAMES:
        values = list(servo[name].values())
        if any(values):  # most robots have no integral gain
            parts.append(compound("{name} {values}", name=name, values=_range(values)))
    if servo["feedforward"] != "none":
        # Names of kinds are keys of YAML, with underscores.
        kind = servo["feedforward"].replace("_", " ")
        parts.append(message("results.feedforward", "feedforward {kind}", kind=kind))
    return join_texts(parts)


def _range(values: Sequence[float]) -> str:
    """Write the smallest and the largest of some values, or the only value if all are equal."""
    least = min(values)
    largest = max(values)
    if least == largest:
        return compound("{value:g}", value=least)
    return message("results.range", "{least:g} to {largest:g}", least=least, largest=largest)
