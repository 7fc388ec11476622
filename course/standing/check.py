"""Points of exercise 7: a humanoid is pushed a little less, and a little more, than the answer says it withstands."""

from __future__ import annotations

from types import ModuleType

from simrob_drake import load_station, simulate
from simrob_drake.extensions.course.measuring import Reading, at_least, number

LASTING = 2.0  # s, of a push that is as good as steady


def stands(force: float, seconds: float, feet: str, lean: float = 0.0) -> bool:
    """Tell whether the robot stands after a push along y [N], with its ankles turned [deg]."""
    ankles = {"right_ankle_pitch": lean, "left_ankle_pitch": lean}
    push = {"kind": "push", "start": 2.0, "duration": seconds, "force": [0, force, 0]}
    changes = {
        "robot.feet": feet,
        "reference": {"kind": "move", "target_deg": ankles, "duration": 1.0},
    }
    station = load_station("humanoid_dynamic", {**changes, "forces.push": push})
    return simulate(station, duration=4.0 + seconds, progress=False).ending == "completed"


def brackets(force: float, margin: float, seconds: float, feet: str) -> int:
    """Return how many of two runs end as they should: one with less force stands, one with more falls."""
    less, more = force * (1 - margin), force * (1 + margin)
    return int(stands(less, seconds, feet)) + int(not stands(more, seconds, feet))


def steady(answer: ModuleType) -> Reading:
    """Push for two seconds."""
    held = 0
    for ahead, feet in ((True, "spheres_B"), (True, "spheres_C"), (False, "spheres_C")):
        force = abs(number(answer, "steady_push", ahead, feet)) * (-1 if ahead else 1)
        held += brackets(force, 0.2, LASTING, feet)
    return at_least(held, 6)


def short(answer: ModuleType) -> Reading:
    """Push back for a moment."""
    cases = ((0.1, "spheres_B"), (0.2, "spheres_C"))
    return at_least(
        sum(
            brackets(abs(number(answer, "short_push", time, feet)), 0.12, time, feet)
            for time, feet in cases
        ),
        4,
    )


def lean(answer: ModuleType) -> Reading:
    """Push in both directions, less than it withstands."""
    angle = number(answer, "lean")
    return at_least(sum(stands(force, LASTING, "spheres_B", angle) for force in (-2.9, 2.9)), 2)


def even(answer: ModuleType) -> Reading:
    """Push in both directions, more than it withstands."""
    angle = number(answer, "lean")
    return at_least(sum(not stands(force, LASTING, "spheres_B", angle) for force in (-3.7, 3.7)), 2)
