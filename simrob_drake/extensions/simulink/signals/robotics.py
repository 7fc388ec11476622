"""Paths and trajectories that blocks for robots make: trapezoids of speed, polynomials, the pursuit of a path."""

from __future__ import annotations

import math
import operator
from collections.abc import Callable
from functools import reduce
from typing import Any, TypeAlias

import numpy as np

from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import message
from simrob_drake.extensions.simulink.model.nodes import Node
from simrob_drake.extensions.simulink.signals.arithmetic import (
    applied,
    chosen,
    compared,
    joined,
    limited,
    looked_up,
)
from simrob_drake.extensions.simulink.signals.dynamics import period_of
from simrob_drake.extensions.simulink.signals.forms import (
    Form,
    Primitive,
    Rule,
    Signal,
    Tracer,
    Value,
    added,
    flat,
    signal,
)

_Change: TypeAlias = tuple[float, int, float]
"""Where a derivative jumps: when [s], which one, and by how much."""

_MOST_SEGMENTS = 200  # of a path, each a dozen blocks
_LOOKS = 0.01  # s between a pursuer's looks at its path, where nothing says how often it looks
_FAR = 1e12  # m


def _of_changes(time: Value, start: float, changes: list[_Change], derivative: int) -> Value:
    """Return a piecewise polynomial of a time that begins at rest, or a derivative of it."""
    parts: list[tuple[float, Value]] = [(1.0 if derivative == 0 else 0.0, start)]
    for when, order, jump in changes:
        power = order - derivative
        if jump and power >= 0:
            since = (
                compared(">=", time, when)
                if power == 0
                else limited(added((1.0, time), (-when, 1.0)), 0.0, np.inf)
            )
            value = reduce(operator.mul, [since] * max(power, 1))
            parts.append((jump / math.factorial(power), value))
    return added(*parts)


def _trajectory(reader: Tracer, node: Node, number: int) -> Signal | None:
    """Return positions, speeds or accelerations along waypoints, which lie in columns."""
    if "External" in (node.text("WaypointSource"), node.text("ParameterSource")) or number > 3:
        return None
    points = node.matrix("Waypoints", "[]")
    try:
        made = (
            _trapezoids(node, points) if "Trapezoidal" in node.kind else _polynomials(node, points)
        )
    except (ArithmeticError, LookupError, np.linalg.LinAlgError) as problem:
        raise node.refusal(
            message(
                "simulink.no_trajectory",
                "no trajectory follows from its figures: {problem}",
                problem=problem,
            )
        ) from problem
    (time,) = flat(reader.input(node))
    return signal(
        _of_changes(time, float(row[0]), one, number - 1)
        for row, one in zip(points, made, strict=True)
    )


def _trapezoids(node: Node, points: Vector) -> list[list[_Change]]:
    """Return how each coordinate speeds up, goes on evenly and slows down, from each waypoint to the next."""
    sides = {"End Time": "EndTime", "Peak Velocity": "PeakVelocity", "Acceleration": "Acceleration",
             "Acceleration Time": "AccelTime"}  # fmt: skip
    choices = [
        node.text(f"Parameter{place}") for place in range(1, int(node.number("NumParams", "0")) + 1)
    ]
    steps = np.diff(points, axis=1)
    shaped = {choice: _as_wide(node, sides[choice], steps) for choice in choices}
    if len(choices) < 2:
        node.note(
            "approximated",
            message(
                "simulink.speed_choice",
                "its figures leave a choice: its speed rises for a third of the time",
            ),
        )
    now, found = np.zeros(len(points)), [list[_Change]() for _ in points]
    for (row, place), way in np.ndenumerate(steps):
        known = {name: float(one[row, place]) for name, one in shaped.items()}
        lasts, rising = _profile(node, abs(float(way)), known)
        rate = way / (lasts - rising) / rising  # of the speed
        for late, sign in ((0.0, 1), (rising, -1), (lasts - rising, -1), (lasts, 1)):
            found[row].append((float(now[row]) + late, 2, sign * rate))
        now[row] += lasts
    return found


_PROFILES: dict[tuple[str, ...], Callable[..., tuple[float, float]]] = {
    (): lambda way: (1.0, 1 / 3),
    ("End Time",): lambda way, lasts: (lasts, lasts / 3),
    ("Peak Velocity",): lambda way, peak: (1.5 * way / peak, 0.5 * way / peak),
    ("Acceleration Time", "End Time"): lambda way, rising, lasts: (lasts, rising),
    ("End Time", "Peak Velocity"): lambda way, lasts, peak: (lasts, lasts - way / peak),
    ("Acceleration", "End Time"): lambda way, rate, lasts: (
        lasts, (lasts - math.sqrt(max(lasts**2 - 4 * way / rate, 0.0))) / 2,
    ),
    ("Acceleration", "Peak Velocity"): lambda way, rate, peak: (way / peak + peak / rate, peak / rate),
    ("Acceleration Time", "Peak Velocity"): lambda way, rising, peak: (way / peak + rising, rising),
    ("Acceleration", "Acceleration Time"): lambda way, rate, rising: (way / (rate * rising) + rising, rising),
}  # fmt: skip
"""How long a trapezoid of speed lasts and its speed rises [s], by the figures that are known.

Where one figure leaves a choice to MATLAB, its speed rises for a third of the time.
"""


def _profile(node: Node, way: float, known: dict[str, float]) -> tuple[float, float]:
    """Return how long a trapezoid of speed lasts, and how long its speed rises [s]."""
    names = tuple(sorted(known))
    if names not in _PROFILES or not (way or "End Time" in known):
        raise node.refusal(
            message(
                "simulink.part_duration_open", "its figures leave open how long a part of it lasts"
            )
        )
    lasts = known.get("End Time", 0.0)
    lasts, rising = (
        _PROFILES[names](way, *(known[name] for name in names)) if way else (lasts, lasts / 3)
    )
    if not 0 < rising <= lasts / 2 * (1 + 1e-9):
        raise node.refusal(
            message(
                "simulink.speed_cannot_rise",
                "its speed cannot rise and fall within {seconds:g} s",
                seconds=lasts,
            )
        )
    return lasts, rising


def _as_wide(node: Node, name: str, like: Vector) -> Vector:
    """Return a parameter for each coordinate and segment or waypoint (raises InvalidModel: it has another shape)."""
    known = node.matrix(name, "0")
    if known.shape not in ((1, 1), (len(like), 1), like.shape):
        raise node.refusal(
            message(
                "simulink.coordinates_of",
                "{name} is {rows} × {columns} for {coordinates} coordinates",
                name=name,
                rows=known.shape[0],
                columns=known.shape[1],
                coordinates=len(like),
            )
        )
    return np.broadcast_to(known, like.shape)


def _polynomials(node: Node, points: Vector) -> list[list[_Change]]:
    """Return the jumps of derivatives of cubic or quintic polynomials from each waypoint to the next."""
    method = node.text("Method", "Cubic Polynomial")
    if "Spline" in method:
        raise node.refusal(
            message("simulink.b_spline", "a B-spline, which this import does not read")
        )
    times = node.numbers("TimePoints", "[0 1]", size=points.shape[1])
    names = [
        "VelocityBoundaryCondition",
        *(["AccelerationBoundaryCondition"] if "Quintic" in method else []),
    ]
    ends = [points, *(_as_wide(node, name, points) for name in names)]
    orders = range(2 * len(ends))

    def at(late: float) -> Vector:
        """Return the derivatives [order, coefficient] at a time after a segment begins."""
        return np.array([[math.perm(power, order) * late ** max(power - order, 0) for power in orders]
                         for order in orders])  # fmt: skip

    found = []
    for row in range(len(points)):
        before, jumps = np.zeros(len(orders)), []
        for place, lasts in enumerate(np.diff(times)):
            known = [end[row, place + side] for side in (0, 1) for end in ends]
            begun, ended = at(0.0), at(float(lasts))
            coefficients = np.linalg.solve(
                np.vstack([begun[: len(ends)], ended[: len(ends)]]), known
            )
            jumps.append(begun @ coefficients - before)
            before = ended @ coefficients
        jumps.append(-before)
        found.append([(float(when), order, float(jump)) for when, by in zip(times, jumps, strict=True)
                      for order, jump in enumerate(by) if order])  # fmt: skip
    return found


def _pure_pursuit(reader: Tracer, node: Node, number: int) -> Signal | None:
    """Return the speed, the turn rate, or where to look, of what pursues a point ahead on a path."""
    pose, path = flat(reader.input(node)), reader.input(node, 2)
    ports = iter((3, 4))
    speed, ahead = (
        flat(reader.input(node, next(ports)))[0]
        if node.is_on(f"{name}Port")
        else node.number(name, default)
        for name, default in (("DesiredLinearVelocity", "0.1"), ("LookaheadDistance", "1"))
    )
    if any(isinstance(one, Form) for one in path.flat) or path.shape[1:] != (2,) or len(pose) != 3:
        return None
    if not isinstance(ahead, Form) and ahead <= 0:
        raise node.refusal(
            message("simulink.lookahead_distance", "its lookahead distance is not above 0")
        )
    if number == 1:
        return signal([speed])
    x, y, heading = pose
    points = path.astype(float)
    # of the path, up to each waypoint
    lengths = np.append(0.0, np.cumsum(np.hypot(*np.diff(points, axis=0).T)))
    points, lengths = points[np.append(True, np.diff(lengths) > 0)], np.unique(lengths)
    if not 2 <= len(points) <= _MOST_SEGMENTS:
        return None
    (nearest,) = reader.once(
        node, lambda: [signal([_nearest(reader, node, (x, y), (points, lengths), ahead)])]
    )
    there = added((1.0, nearest[0]), (1.0, ahead))
    to_x, to_y = (looked_up(there, lengths, points[:, axis], clip=True) for axis in (0, 1))
    aside = applied("atan2", to_y - y, to_x - x) - heading
    if number == 3:
        return signal([applied("atan2", applied("sin", aside), applied("cos", aside))])
    most = node.number("MaxAngularVelocity", "1")
    return signal([limited(2.0 * applied("sin", aside) / ahead, -most, most)])


def _nearest(
    reader: Tracer,
    node: Node,
    place: tuple[Value, Value],
    path: tuple[Vector, Vector],
    ahead: Value,
) -> Value:
    """Return how far along the path the nearest point is: at first of all of it, then ahead of where it was before.

    The place is x and y, the path waypoints and how far along it each is, ``ahead`` how far a pursuer looks [m].
    """
    period = period_of(reader, node) or _LOOKS
    node.note(
        "approximated",
        message(
            "simulink.nearest_point_of_path",
            "looks for the nearest point of its path each {period:g} s, and only ahead",
            period=period,
        ),
    )
    parameters: dict[str, Any] = {"period": period, "initial": -1.0}
    before = Primitive("delay", parameters, lambda: [nearest], node).outputs[0]
    begun = compared(">=", before, 0.0)
    sight = chosen(begun, added((1.0, before), (1.0, ahead)), _FAR)
    least: Value = _FAR
    nearest: Value = 0.0
    for start, end, first, last in zip(path[0], path[0][1:], path[1], path[1][1:], strict=False):
        to_x, to_y = (end - start) / (last - first)
        along = to_x * (place[0] - start[0]) + to_y * (place[1] - start[1])
        reached = applied("max", before - float(first), along)  # never back
        here = limited(reached, 0.0, float(last - first))
        off_x, off_y = (
            one - float(own) - by * here
            for one, own, by in zip(place, start, (to_x, to_y), strict=True)
        )
        distance = off_x * off_x + off_y * off_y
        seen = joined(
            "and", compared("<=", before, float(last)), compared(">=", sight, float(first))
        )
        closer = joined("and", seen, compared("<", distance, least))
        least, nearest = (
            chosen(closer, distance, least),
            chosen(closer, here + float(first), nearest),
        )
    return nearest


ROBOTICS: dict[str, Rule] = {
    **dict.fromkeys(
        ("Trapezoidal Velocity Profile Trajectory", "Polynomial Trajectory"), _trajectory
    ),
    "Pure Pursuit": _pure_pursuit,
}
