"""Every posture that brings the tool to a pose: in closed form where the arm has one, else searched from many starts.

The search takes a generic pose of six axes as found out when each posture was met several times and their number is
even, as that of the real roots of the polynomial of degree 16 behind them is (Raghavan & Roth, 1993).
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from simrob_drake.base.errors import InvalidParameter
from simrob_drake.base.frames import Targets, Vector, finite, pose_matrices, within
from simrob_drake.base.messages import message
from simrob_drake.kinematics.analytic import AnalyticSolver
from simrob_drake.kinematics.chain import Chain, Indices
from simrob_drake.kinematics.closed_form import NoClosedForm
from simrob_drake.kinematics.numeric import COARSE, Flags, fit_postures, random_postures
from simrob_drake.kinematics.solver import TURN, nearest_turns

_SIX = 6  # axes reach a pose in a finite number of ways
_AT_ONCE, _MOST = 100, 600  # starts for a target in one round, and in all
_TOGETHER = 200  # targets that are searched for side by side
_OFTEN = 6  # how often each posture must be met
_STEPS = 25  # from one start
_EXACT, _REACHED = np.array([1e-10, 1e-10]), np.array([1e-8, 1e-8])  # m and rad
_SAME = 1e-3  # rad or m that one posture is met apart: where two roots meet, half of the digits go
_FREE = 1e-6  # smallest singular value below which a posture moves on without moving the tool
_SLIDES, _SLIDE = 40, 0.3  # steps to the start, and the longest of one axis [rad or m]
_EVEN = np.ones(6)


def branches(
    chain: Chain, targets: Targets, start: npt.ArrayLike, held: Mapping[str, float] | None = None
) -> list[Vector]:
    """Return all postures for each of k targets, whether or not within the joint limits.

    Args:
        chain: the axes.
        targets: poses of the tool in the base.
        start: posture (n,) near to which whole turns are chosen; where axes may turn against each other without
            moving the tool, as those of a straight wrist, one posture near to it stands for the family.
        held: axes that stay at a position [rad or m], by name. Of more than six axes that move the tool the others hold
            those of the start: prismatic ones first, then the third, which turns the elbow of arms with seven.

    Returns:
        for each target shape (b, n); empty where nothing reaches it. Turned into the limits where whole turns do.

    Raises:
        InvalidParameter: targets or a start of wrong shape; positions that are no numbers.
        UnknownName: no such axis.
    """
    matrices, begin = pose_matrices(targets), chain.postures(start, "start")[0]
    freed, moving = _freed(chain, begin, {} if held is None else held)
    try:
        found = _reached(freed, matrices, _closed_form(chain, matrices, begin, moving))
    except NoClosedForm:
        parts = np.array_split(matrices, -(-len(matrices) // _TOGETHER))
        found = [rows for part in parts for rows in _search(freed, part, begin, moving)]
    return [nearest_turns(chain, rows, np.broadcast_to(begin, rows.shape))[0] for rows in found]


def goal_postures(chain: Chain, targets: Vector, start: Vector, seed: int = 0) -> Vector:
    """Return different postures (m, n) within limits that bring the tool to any of targets (k, 4, 4), for a planner.

    All of them of arms with a closed form; of others those to which a hundred searches lead, elbows turned at will.
    Whole turns are chosen near to the start (n,).
    """
    try:
        found, good = AnalyticSolver(chain).postures(targets, start)
    except NoClosedForm:
        each, still = -(-_AT_ONCE // len(targets)), np.setdiff1d(np.arange(chain.size), chain.order)
        seeds = random_postures(chain, each * len(targets), seed)
        seeds[0], seeds[:, still] = start, start[still]
        found, good = _led(chain, targets, seeds.reshape(len(targets), each, -1))
    rows, beyond = nearest_turns(chain, found[good], np.broadcast_to(start, found[good].shape))
    within_limits = (beyond <= chain.limits.tolerances).all(axis=-1)
    return _merged(chain, np.clip(rows[within_limits], chain.lower, chain.upper))[0]


def _freed(chain: Chain, start: Vector, held: Mapping[str, float]) -> tuple[Chain, Indices]:
    """Return the chain without the limits of revolute axes, fixed where axes are held, and the axes that are not."""
    values, fixed = start.copy(), set(range(chain.size)) - set(chain.order)
    for name, value in held.items():
        axis = chain.axis_index(name)
        if np.shape(finite(value)):
            raise InvalidParameter(
                message("kinematics.held_axis", "held: {name}", name=name),
                value,
                message("kinematics.finite_position", "a finite number [rad or m]"),
            )
        values[axis] = value
        fixed.add(axis)
    moving = [axis for axis in chain.order if axis not in fixed]
    while len(moving) > _SIX:
        moving.remove(next((axis for axis in moving if not chain.revolute[axis]), moving[2]))
    lower, upper = (
        np.where(chain.revolute, far, limit) for far, limit in ((-np.inf, chain.lower), (np.inf, chain.upper))
    )
    still = np.setdiff1d(np.arange(chain.size), moving)
    lower[still] = upper[still] = values[still]
    return replace(chain, lower=lower, upper=upper), np.array(moving, dtype=np.intp)


def _closed_form(chain: Chain, targets: Vector, start: Vector, moving: Indices) -> Vector:
    if len(moving) < chain.size:
        raise NoClosedForm(message("kinematics.axes_are_held", "axes of it are held"))
    return AnalyticSolver(chain).postures(targets, start)[0]


def _reached(chain: Chain, targets: Vector, starts: Vector) -> list[Vector]:
    """Return the different postures (b, n) for each of k targets to which starts (k, s, n) lead."""
    return [_merged(chain, rows[good])[0] for rows, good in zip(*_led(chain, targets, starts), strict=True)]


def _led(chain: Chain, targets: Vector, starts: Vector) -> tuple[Vector, Flags]:
    """Return where starts (k, s, n) lead, (k, s, n), and which of them to their target, (k, s)."""
    fit = fit_postures(
        chain,
        np.repeat(targets, starts.shape[1], axis=0),
        starts.reshape(-1, chain.size),
        weights=_EVEN,
        tolerance=_EXACT,
        iterations=_STEPS,
        flat=COARSE,
    )
    good = within(fit.errors, _EVEN, _REACHED)
    return fit.postures.reshape(starts.shape), good.reshape(starts.shape[:2])


def _search(chain: Chain, targets: Vector, start: Vector, moving: Indices) -> list[Vector]:
    seeds = random_postures(chain, _MOST, 0)
    found = [np.empty((0, chain.size))] * len(targets)
    met = [np.empty(0)] * len(targets)
    left = list(range(len(targets)))
    for first in range(0, _MOST, _AT_ONCE):
        batch = np.broadcast_to(seeds[first : first + _AT_ONCE], (len(left), _AT_ONCE, chain.size))
        for place, rows, good in zip(left, *_led(chain, targets[left], batch), strict=True):
            new = _slid(chain, targets[place], rows[good], start, moving)
            both = np.vstack([found[place], new]), np.append(met[place], np.ones(len(new)))
            found[place], met[place] = _merged(chain, *both)
        left = [place for place in left if len(met[place]) % 2 or met[place].min(initial=np.inf) < _OFTEN]
        if not left:
            break
    return found


def _slid(chain: Chain, target: Vector, postures: Vector, start: Vector, moving: Indices) -> Vector:
    """Return postures (b, n), those that are not isolated moved along their families to the nearest to the start."""
    rows = np.arange(len(postures))
    for _ in range(_SLIDES if len(rows) else 0):
        _, values, ways = np.linalg.svd(chain.jacobian(postures[rows])[..., moving])
        loose = np.zeros(ways.shape[:2], dtype=bool)
        loose[:, : values.shape[1]] = values < _FREE
        ways *= loose[..., np.newaxis]
        back = np.where(chain.revolute, np.sin(start - postures[rows]), start - postures[rows])[:, moving, np.newaxis]
        steps = (ways.transpose(0, 2, 1) @ (ways @ back))[..., 0]
        longest = np.abs(steps).max(axis=1, keepdims=True)
        going = longest[:, 0] > _SAME / 10
        if not going.any():
            break
        rows, moved = rows[going], postures[rows[going]]
        moved[:, moving] += (steps * np.minimum(1.0, _SLIDE / np.maximum(longest, _SLIDE)))[going]
        led, good = _led(chain, target[np.newaxis], moved[np.newaxis])
        rows = rows[good[0]]
        postures[rows] = led[0, good[0]]
        if not rows.size:
            break
    return postures


def _merged(chain: Chain, postures: Vector, met: Vector | None = None) -> tuple[Vector, Vector]:
    """Return each of postures (b, n) once, and how often they were met, from how often each row was."""
    met = np.ones(len(postures)) if met is None else met
    kept, counts = [], []
    while len(postures):
        same = (np.abs(_way(chain, postures, postures[0])) < _SAME).all(axis=1)
        kept.append(postures[0])
        counts.append(met[same].sum())
        postures, met = postures[~same], met[~same]
    return np.reshape(kept, (-1, chain.size)), np.array(counts)


def _way(chain: Chain, ends: Vector, begins: Vector) -> Vector:
    """Return the shortest way from postures to others; whole turns of revolute axes do not count."""
    way = ends - begins
    return way - np.where(chain.revolute, TURN * np.rint(way / TURN), 0.0)
