"""Every posture that brings the tool to a pose: in closed form if that covers all axes of the arm, else by a search.

A pose of the tool has a finite number of postures if six axes move the tool. Each of them is a *branch*. The search
starts from many random postures. It takes the postures of a target as complete if each of them was found several times
and their number is even: they are the real roots of a polynomial of degree 16, whose complex roots come in pairs
(Raghavan & Roth, 1993).

At a singular posture, such as that of a straight wrist, axes can turn against each other without moving the tool. The
postures are then a *family*, a curve of postures with the same pose of the tool.
"""

from collections.abc import Mapping
from dataclasses import replace
from math import ceil

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

_MOST_MOVING_AXES = 6
"""Largest count of axes with which a pose has a finite number of postures."""

_STARTS_PER_ROUND = 100
"""Count of random postures from which one round of the search starts, for each target."""

_MOST_STARTS = 600
"""Largest count of random postures from which the search starts, for each target."""

_TARGETS_AT_ONCE = 200
"""Count of targets that are searched side by side. More take more memory and are not faster."""

_LEAST_HITS = 6
"""How often the search must find each posture before it takes the postures as complete."""

_STEPS = 25
"""Largest count of steps from one start. Starts that need more seldom lead to a target at all."""

_EXACT = np.array([1e-10, 1e-10])
"""Distance [m] and angle [rad] from the target within which a search from one start ends."""

_REACHED = np.array([1e-8, 1e-8])
"""Distance [m] and angle [rad] from the target up to which a posture counts as one of the target."""

_SAME = 1e-3
"""Largest difference of axes between two results that are one posture [rad or m]. Where two roots meet, a search loses
half of the digits."""

_SINGULAR = 1e-6
"""Singular value of the Jacobian below which a motion of the axes does not move the tool [m/rad or 1]."""

_MOST_FAMILY_STEPS = 40
"""Largest count of steps along a family of postures."""

_SHORTEST_FAMILY_STEP = _SAME / 10
"""Longest step of one axis at which a posture has come as close to the start as its family allows [rad or m]."""

_LONGEST_FAMILY_STEP = 0.3
"""Longest step of one axis along a family of postures [rad or m]."""

_ALL_ERRORS = np.ones(6)
"""Weights of the errors along and about x, y, z: all are parts of the distance and the angle from a target."""


def branches(
    chain: Chain, targets: Targets, start: npt.ArrayLike, held: Mapping[str, float] | None = None
) -> list[Vector]:
    """Find all postures for each of k targets, whether or not within the limits of revolute axes.

    Prismatic axes keep their limits.

    Args:
        chain: the axes.
        targets: poses of the tool in the base.
        start: posture, shape (n,) [rad or m]. Whole turns of revolute axes are chosen close to this posture. If axes
            can turn against each other without moving the tool, as those of a straight wrist, the postures are a
            family; one posture close to the start stands for the family.
        held: positions [rad or m] of axes that do not move, by the name of the axis. If more than six of the other axes
            move the tool, the surplus ones stay as in the start: prismatic axes first, then the third axis, which turns
            the elbow of arms with seven axes.

    Returns:
        the postures of each target, shape (b, n); empty if no posture reaches it. Axes are turned into their limits if
        whole turns can do that.

    Raises:
        InvalidParameter: targets or a start of wrong shape, or positions that are not finite numbers.
        UnknownName: there is no axis of a name in ``held``.
    """
    matrices = pose_matrices(targets)
    # The first row: `postures` returns an array of postures (1, n).
    begin = chain.postures(start, "start")[0]
    free_chain, moving = _with_held_axes(chain, begin, {} if held is None else held)
    try:
        starts = _closed_form_postures(chain, matrices, begin, moving)
    except NoClosedForm:
        # In parts, since the arrays of the search grow with the count of targets times that of starts.
        parts = np.array_split(matrices, ceil(len(matrices) / _TARGETS_AT_ONCE))
        found = [
            postures for part in parts for postures in _search(free_chain, part, begin, moving)
        ]
    else:
        found = _refine(free_chain, matrices, starts)
    # The searches ignore the limits of revolute axes, so that the turns are chosen at the end.
    return [
        nearest_turns(chain, postures, np.broadcast_to(begin, postures.shape))[0]
        for postures in found
    ]


def goal_postures(chain: Chain, targets: Vector, start: Vector, seed: int = 0) -> Vector:
    """Find different postures within the limits that bring the tool to any of the targets, for a motion planner.

    For an arm with a closed form these are all postures. For other arms they are the postures that a hundred searches
    or a few more find, with at least one search for each target. One search begins at the start, and the others at
    random postures.

    Args:
        chain: the axes.
        targets: poses of the tool, shape (k, 4, 4).
        start: posture close to which whole turns of revolute axes are chosen, shape (n,) [rad or m].
        seed: seed of the random postures.

    Returns:
        the postures, shape (m, n) [rad or m]; m is 0 if none is found.
    """
    try:
        postures, is_good = AnalyticSolver(chain).postures(targets, start)
    except NoClosedForm:
        # The planner needs a posture of any one of the targets, so it is enough to share one round of searches among
        # all targets.
        starts_per_target = ceil(_STARTS_PER_ROUND / len(targets))
        starts = random_postures(chain, starts_per_target * len(targets), seed)
        # The first search, for the first target, begins at the start of the motion.
        starts[0] = start
        # Axes that do not move the tool stay as they are.
        idle_axes = np.setdiff1d(np.arange(chain.size), chain.order)
        starts[:, idle_axes] = start[idle_axes]
        postures, is_good = _fit_from(
            chain, targets, starts.reshape(len(targets), starts_per_target, -1)
        )
    good_postures = postures[is_good]
    turned, beyond = nearest_turns(
        chain, good_postures, np.broadcast_to(start, good_postures.shape)
    )
    # Limits are rounded: a posture beyond one by rounding counts, and the planner gets it at the limit itself.
    is_within_limits = (beyond <= chain.limits.tolerances).all(axis=-1)
    clipped = np.clip(turned[is_within_limits], chain.lower, chain.upper)
    return _distinct(chain, clipped)[0]


def _with_held_axes(
    chain: Chain, start: Vector, held: Mapping[str, float]
) -> tuple[Chain, Indices]:
    """Fix the axes of a chain that do not move, and remove the limits of the revolute axes that do.

    Args:
        chain: the axes.
        start: posture of the axes that stay without being named, shape (n,) [rad or m].
        held: positions of the named axes that stay, by name [rad or m].

    Returns:
        the chain with the new limits, and the indices of at most six axes that move the tool.

    Raises:
        InvalidParameter: a position that is not a finite number.
        UnknownName: there is no axis of such a name.
    """
    values = start.copy()
    fixed = set(range(chain.size)) - set(chain.order)
    for name, value in held.items():
        axis = chain.axis_index(name)
        # `finite` keeps the shape of a finite number, which is (). It makes an empty array of other values.
        if np.shape(finite(value)):
            raise InvalidParameter(
                message("kinematics.held_axis", "held: {name}", name=name),
                value,
                message("kinematics.finite_position", "a finite number [rad or m]"),
            )
        values[axis] = value
        fixed.add(axis)

    # With more than six axes a pose has infinitely many postures. A prismatic axis, such as a rail below an arm, is
    # held first, since the arm keeps its six axes then.
    moving = [axis for axis in chain.order if axis not in fixed]
    while len(moving) > _MOST_MOVING_AXES:
        prismatic = [axis for axis in moving if not chain.revolute[axis]]
        third = moving[2]
        moving.remove(prismatic[0] if prismatic else third)

    # Without limits of revolute axes, searches are not stopped on their way to a posture that lies within the limits
    # after a whole turn. Axes that are held get equal limits, which the searches cannot leave.
    lower = np.where(chain.revolute, -np.inf, chain.lower)
    upper = np.where(chain.revolute, np.inf, chain.upper)
    still = np.setdiff1d(np.arange(chain.size), moving)
    lower[still] = values[still]
    upper[still] = values[still]
    return replace(chain, lower=lower, upper=upper), np.array(moving, dtype=np.intp)


def _closed_form_postures(chain: Chain, targets: Vector, start: Vector, moving: Indices) -> Vector:
    """Compute the postures of targets (k, 4, 4) in closed form, shape (k, 8, n) [rad], whether or not in reach.

    Args:
        chain: the axes, with their limits.
        targets: poses of the tool, shape (k, 4, 4).
        start: posture close to which whole turns are chosen, shape (n,) [rad].
        moving: indices of the axes that move.

    Raises:
        NoClosedForm: the arm has no closed form, or some of its axes do not move.
    """
    # The closed form moves all six axes, so that it cannot keep one of them where it is.
    if len(moving) < chain.size:
        raise NoClosedForm(message("kinematics.axes_are_held", "some of its axes are held"))
    return AnalyticSolver(chain).postures(targets, start)[0]


def _refine(chain: Chain, targets: Vector, starts: Vector) -> list[Vector]:
    """Refine postures from the closed form by a search, and keep those that reach their targets.

    The closed form ignores small deviations of an arm from its ideal geometry. It also gives postures for targets that
    are out of reach. These are not kept.

    Args:
        chain: the axes.
        targets: poses of the tool, shape (k, 4, 4).
        starts: postures from the closed form for each target, shape (k, s, n) [rad or m].

    Returns:
        for each target the different postures that reach it, shape (b, n).
    """
    postures, is_good = _fit_from(chain, targets, starts)
    return [_distinct(chain, own[good])[0] for own, good in zip(postures, is_good, strict=True)]


def _fit_from(chain: Chain, targets: Vector, starts: Vector) -> tuple[Vector, Flags]:
    """Search a posture for each target from each of its starts.

    Args:
        chain: the axes.
        targets: poses of the tool, shape (k, 4, 4).
        starts: postures from which the searches of each target start, shape (k, s, n) [rad or m].

    Returns:
        the postures at which the searches end, shape (k, s, n), and whether each of them reaches its target as closely
        as :data:`_REACHED`, shape (k, s).
    """
    starts_per_target = starts.shape[1]
    # COARSE ends a search whose step takes away less than 1 % of the cost. Near a target the steps take away almost
    # all of it, so such a search most likely does not lead there.
    fit = fit_postures(
        chain,
        np.repeat(targets, starts_per_target, axis=0),
        starts.reshape(-1, chain.size),
        weights=_ALL_ERRORS,
        tolerance=_EXACT,
        iterations=_STEPS,
        flat=COARSE,
    )
    is_good = within(fit.errors, _ALL_ERRORS, _REACHED)
    return fit.postures.reshape(starts.shape), is_good.reshape(starts.shape[:2])


def _search(chain: Chain, targets: Vector, start: Vector, moving: Indices) -> list[Vector]:
    """Search all postures of targets from random postures.

    Args:
        chain: the axes, without limits of the revolute ones.
        targets: poses of the tool, shape (k, 4, 4).
        start: posture to which a family of postures is followed, shape (n,) [rad or m].
        moving: indices of the axes that move.

    Returns:
        for each target the different postures that were found, shape (b, n).
    """
    seeds = random_postures(chain, _MOST_STARTS, 0)
    # For each target, its postures so far, and how often each of them was found.
    found = [np.empty((0, chain.size))] * len(targets)
    hits = [np.empty(0)] * len(targets)
    # Indices of the targets whose postures are not complete.
    open_targets = list(range(len(targets)))
    for first in range(0, _MOST_STARTS, _STARTS_PER_ROUND):
        seeds_of_round = seeds[first : first + _STARTS_PER_ROUND]
        starts = np.broadcast_to(seeds_of_round, (len(open_targets), _STARTS_PER_ROUND, chain.size))
        postures, is_good = _fit_from(chain, targets[open_targets], starts)
        for target, own, good in zip(open_targets, postures, is_good, strict=True):
            # All members of a family have to become the same posture, or each would count as a posture of its own.
            new = _follow_families(chain, targets[target], own[good], start, moving)
            all_found = np.vstack([found[target], new])
            all_hits = np.append(hits[target], np.ones(len(new)))
            found[target], hits[target] = _distinct(chain, all_found, all_hits)
        open_targets = [target for target in open_targets if not _is_complete(hits[target])]
        if not open_targets:
            break
    return found


def _is_complete(hits: Vector) -> bool:
    """Whether the postures found so far are probably all postures of a target; see the docstring of the module.

    Args:
        hits: how often each posture was found, shape (b,).
    """
    # No posture after a whole round of searches means that the target is out of reach, and this is complete as well:
    # zero is even, and the least of no hits is set to infinity.
    has_even_number = len(hits) % 2 == 0
    return has_even_number and bool(hits.min(initial=np.inf) >= _LEAST_HITS)


def _follow_families(
    chain: Chain, target: Vector, postures: Vector, start: Vector, moving: Indices
) -> Vector:
    """Move postures that belong to a family along it, to the member closest to the start.

    At a singular posture some motions of the axes do not move the tool. Steps go along these motions only, towards the
    start, and a fit corrects what the curvature of the family adds.

    Args:
        chain: the axes.
        target: pose of the tool, shape (4, 4).
        postures: postures that reach the target, shape (b, n) [rad or m]. They are changed in place.
        start: the start, shape (n,) [rad or m].
        moving: indices of the axes that move.

    Returns:
        the postures. Isolated ones stay as they are.
    """
    rows = np.arange(len(postures))  # indices of the postures that still move
    for _ in range(_MOST_FAMILY_STEPS):
        if not rows.size:
            break
        steps = _steps_in_null_space(chain, postures[rows], start, moving)
        longest = np.abs(steps).max(axis=1, keepdims=True)
        is_moving = longest[:, 0] > _SHORTEST_FAMILY_STEP
        if not is_moving.any():
            break

        # The null space is only tangent to the family: after a long step, the correction could end on another branch.
        limited_steps = steps * (_LONGEST_FAMILY_STEP / np.maximum(longest, _LONGEST_FAMILY_STEP))
        rows = rows[is_moving]
        moved = postures[rows]
        moved[:, moving] += limited_steps[is_moving]
        corrected, is_good = _fit_from(chain, target[np.newaxis], moved[np.newaxis])
        # A posture whose correction fails stays where it is.
        rows = rows[is_good[0]]
        postures[rows] = corrected[0, is_good[0]]
    return postures


def _steps_in_null_space(chain: Chain, postures: Vector, start: Vector, moving: Indices) -> Vector:
    """Project the differences to the start on the motions that do not move the tool.

    With the singular value decomposition J = U S V', the rows of V' whose singular value is 0 are an orthonormal basis
    N of these motions. The step is N' N (start - posture).

    Args:
        chain: the axes.
        postures: postures, shape (b, n) [rad or m].
        start: the start, shape (n,) [rad or m].
        moving: indices of the m axes that move.

    Returns:
        the steps of the moving axes, shape (b, m) [rad or m].
    """
    _, values, directions = np.linalg.svd(chain.jacobian(postures)[..., moving])
    # For each row of V', whether its singular value is 0. J has at most six columns, so each row has one.
    is_null = np.zeros(directions.shape[:2], dtype=bool)
    is_null[:, : values.shape[1]] = values < _SINGULAR
    # The rows outside the null space become zero, so that all postures have arrays of one shape.
    directions *= is_null[..., np.newaxis]

    # The sine of a difference within half a turn has its sign, and whole turns do not count.
    difference = start - postures
    towards_start = np.where(chain.revolute, np.sin(difference), difference)
    moving_towards_start = towards_start[:, moving, np.newaxis]

    # N' (N d), the orthogonal projection on the null space.
    components = directions @ moving_towards_start
    steps: Vector = (directions.transpose(0, 2, 1) @ components)[..., 0]
    return steps


def _distinct(chain: Chain, postures: Vector, hits: Vector | None = None) -> tuple[Vector, Vector]:
    """Remove repeated postures: those whose axes all differ by less than `_SAME`, whole turns aside.

    Args:
        chain: the axes.
        postures: postures, shape (r, n) [rad or m].
        hits: how often each posture was found, shape (r,); once unless given.

    Returns:
        the different postures, shape (b, n), and how often each was found, shape (b,).
    """
    hits = np.ones(len(postures)) if hits is None else hits
    # The first posture of the rest stays and takes the hits of all postures equal to it, until no posture is left.
    kept = []
    counts = []
    while len(postures):
        is_same = (np.abs(_shortest_difference(chain, postures, postures[0])) < _SAME).all(axis=1)
        kept.append(postures[0])
        counts.append(hits[is_same].sum())
        postures = postures[~is_same]
        hits = hits[~is_same]
    return np.reshape(kept, (-1, chain.size)), np.array(counts)


def _shortest_difference(chain: Chain, ends: Vector, begins: Vector) -> Vector:
    """Subtract postures (b, n) or (n,) [rad or m]. Whole turns do not count: for revolute axes, it is -π to π."""
    difference = ends - begins
    return difference - np.where(chain.revolute, TURN * np.rint(difference / TURN), 0.0)
