"""Inverse kinematics in closed form for six-axis arms (AIK in SimRob).

A pose of the tool has up to eight postures: two shoulders, with two elbows each, with two wrists each. The index of a
posture among the eight is 4·shoulder + 2·elbow + wrist. Each axis has an angle only up to whole turns; those turns are
chosen that bring it into its limits and close to a start.
"""

import numpy as np
import numpy.typing as npt

from simrob_drake.base.errors import UnknownName, angle
from simrob_drake.base.frames import Targets, Vector, pose_errors, pose_matrices, within
from simrob_drake.base.messages import message
from simrob_drake.kinematics.chain import Chain, Indices
from simrob_drake.kinematics.closed_form import (
    BRANCHES,
    ELBOWS,
    SHOULDERS,
    WRISTS,
    ClosedForm,
    SixAxisArm,
    all_postures,
)
from simrob_drake.kinematics.numeric import Flags, fit_postures, settle_at_limits
from simrob_drake.kinematics.solver import (
    POSITION_TOLERANCE,
    ROTATION_TOLERANCE,
    TURN,
    Solutions,
    Solver,
    nearest_turns,
)

_ROUNDING = 1e-9
"""Distance beyond the reach or a limit that counts as a rounding error [m or rad]."""

_EXACT = 1e-10
"""Errors of a closed-form posture above this [m or rad] come from rounded dimensions of the arm. A few steps of numeric
search remove them."""

_POLISHING = 10
"""Largest count of these steps."""

_FAR = 1e6
"""Penalty of a posture that misses its target or a limit [rad²]. It is larger than any squared distance from the
start, so such a posture is chosen only if there is no other."""

_ROUNDED = 1.0
"""Penalty of a posture that is beyond a limit by rounding [rad²]: a posture within the limits is preferred, unless it
is much farther from the start."""


class AnalyticSolver(Solver):
    """Computes all up to eight postures of a :class:`SixAxisArm`, and takes one of them (SimRob's AIK).

    Of the postures that reach the target within the joint limits, the closest to the start is taken, by the sum of
    squared angles. Joints are turned by whole turns into their limits and, if more than one turn lies within them, to
    the one closest to the start. Three flags narrow the choice:

    * ``shoulder``: with ``"right"``, the wrist centre is ahead of axis 1 and the upper arm is on the right of axis 1,
      seen from axis 1 towards the wrist. If the arm is not offset to a side, ``"right"`` is the side of axis 1 on which
      the wrist is at zero. With ``"left"``, the arm is turned round and bent backwards.
    * ``elbow``: with ``"up"``, axis 3 is above the line from axis 2 to the wrist centre, or to a parallel axis 4.
    * ``wrist``: with ``"no_flip"``, axis 5 is on the positive side of the position in which axes 4 and 6 are parallel
      (positive angles of the irb120); with ``"flip"``, it is on the negative side.

    If axes 4 and 6 are parallel, axis 4 stays as in the start. Of an arm with a parallel wrist, the sum of axes 2 to 4
    stays, or comes as close as the arm reaches. Axis 1 stays as in the start if the wrist centre lies on it.
    """

    def __init__(
        self,
        chain: Chain,
        *,
        shoulder: str | None = None,
        elbow: str | None = None,
        wrist: str | None = None,
    ) -> None:
        """Make the solver, and recognise the geometry of the arm.

        Args:
            chain: six revolute axes. Further axes that do not move the tool, such as fingers, stay as they are.
            shoulder: ``"right"`` or ``"left"``; both unless given.
            elbow: ``"up"`` or ``"down"``; both unless given.
            wrist: ``"no_flip"`` or ``"flip"``; both unless given.

        Raises:
            NoClosedForm: the arm has another geometry; the message says what it lacks.
            UnknownName: there is no such flag.
        """
        super().__init__(chain)
        self.arm = SixAxisArm.of(chain)
        # For each combination of shoulder, elbow and wrist, whether the flags allow it.
        is_allowed = np.ones((2, 2, 2), dtype=bool)
        flags = (
            ("shoulder", SHOULDERS, shoulder),
            ("elbow", ELBOWS, elbow),
            ("wrist", WRISTS, wrist),
        )
        for dimension, (kind, names, flag) in enumerate(flags):
            if flag is None:
                continue
            if flag not in names:
                raise UnknownName(
                    message("kinematics.flag_for", "flag for the {kind}", kind=kind),
                    str(flag),
                    names,
                )
            # A view with the flag's dimension first, so that one assignment forbids the other value of the flag.
            forbidden = 1 - names.index(flag)
            np.moveaxis(is_allowed, dimension, 0)[forbidden] = False
        # The flat index of the array is the index of a posture, 4·shoulder + 2·elbow + wrist.
        self._allowed = np.flatnonzero(is_allowed)
        self._order = list(chain.order)
        # Axes that can do a whole turn, with their limits: (index, lower, upper). Any other axis has only one position
        # within its limits for an angle, so that a path has no turns to choose from.
        wide = np.flatnonzero(chain.upper - chain.lower >= TURN)
        self._wide = [
            (axis, chain.lower[axis] - _ROUNDING, chain.upper[axis] + _ROUNDING) for axis in wide
        ]

    def postures(self, targets: Targets, start: npt.ArrayLike) -> tuple[Vector, Flags]:
        """Compute all postures for each of k targets. The flags of the solver have no effect.

        Args:
            targets: poses of the tool in the base.
            start: one posture (n,) or k postures (k, n) [rad]; whole turns are chosen near to it. Axes that may have
                any position, or do not move the tool, take theirs from it.

        Returns:
            the postures in axis order, shape (k, 8, n) [rad], and whether each reaches the target within the joint
            limits, up to rounding, shape (k, 8). The index of a posture is 4·(left) + 2·(elbow down) + (flip), where
            each of the three flags counts 0 or 1.

        Raises:
            InvalidParameter: targets or a start of wrong shape, or not finite.
        """
        matrices = pose_matrices(targets)
        starts = np.broadcast_to(
            self.chain.postures(start, "start"), (len(matrices), self.chain.size)
        )
        form, postures, beyond = self._branches(matrices, starts, np.arange(BRANCHES))
        is_in_reach = (form.out_of_reach <= _ROUNDING) & (form.missed_turn == 0.0)
        return postures, is_in_reach & self._fits(beyond)

    def _fits(self, beyond: Vector) -> Flags:
        """Whether postures are within the limits, up to a tolerance, since the limits of robots are rounded.

        Args:
            beyond: distance of each axis beyond its limits, 0 if it is within them, shape (..., n) [rad].

        Returns:
            a boolean for each posture, shape (...).
        """
        return np.asarray((beyond <= self.chain.limits.tolerances).all(axis=-1))

    def _branches(
        self, targets: Vector, starts: Vector, allowed: Indices
    ) -> tuple[ClosedForm, Vector, Vector]:
        """Compute the postures of targets, with whole turns close to the starts.

        Args:
            targets: poses of the tool, shape (k, 4, 4).
            starts: postures, shape (k, n) [rad].
            allowed: indices of the b wanted postures among the eight.

        Returns:
            the closed form with all eight postures, how far each misses the target [m and rad], and whether a target
            leaves an axis free (`is_singular`); the wanted postures in axis order, shape (k, b, n) [rad]; and the
            distance of each of their axes beyond its limits, shape (k, b, n) [rad].
        """
        form = all_postures(self.arm, targets, starts[:, self._order])
        # Axes that do not move the tool, such as fingers, stay as in the start.
        postures = np.repeat(starts[:, np.newaxis], len(allowed), axis=1)
        postures[..., self._order] = form.postures[:, allowed]
        turned, beyond = nearest_turns(self.chain, postures, starts[:, np.newaxis])
        return form, turned, beyond

    def _solve_each(self, targets: Vector, starts: Vector) -> Solutions:
        """Choose the posture of each target that is closest to the target's own start.

        Postures that reach the target within the limits come before all others, by penalties.

        Args:
            targets: poses of the tool, shape (k, 4, 4).
            starts: postures, shape (k, n) [rad].
        """
        form, postures, beyond = self._branches(targets, starts, self._allowed)
        difference = postures - starts[:, np.newaxis]
        squared_distance = np.square(difference).sum(axis=-1)
        choices = np.argmin(squared_distance + self._penalty(form, beyond), axis=1)
        # A choice is an index among the allowed postures, but `form` has all eight: the allowed ones are taken first.
        rows = np.arange(len(targets))
        out_of_reach = form.out_of_reach[:, self._allowed]
        return self._check_solutions(
            targets,
            postures[rows, choices],
            out_of_reach[rows, choices],
            beyond[rows, choices],
        )

    def _solve_in_order(self, targets: Vector, start: Vector) -> Solutions:
        """Choose the posture of each target that is closest to the posture of the target before.

        Postures that reach the target within the limits come before all others, by penalties.

        Args:
            targets: poses of the tool, shape (k, 4, 4).
            start: posture to which that of the first target is the closest, shape (n,) [rad].
        """
        # The postures of all targets in one call, since only the choice between them depends on the order. Without the
        # posture before, axes that may have any position get the wrong one; those targets are computed again below.
        all_starts = np.tile(start, (len(targets), 1))
        form, postures, beyond = self._branches(targets, all_starts, self._allowed)
        penalty = self._penalty(form, beyond)
        choices = np.zeros(len(targets), dtype=np.intp)
        last = start
        # `branches` are the allowed postures of one target: a view, through which `postures` changes.
        for row, branches in enumerate(postures):
            if form.is_singular[row]:
                # An axis that may have any position takes it from the posture before.
                form_of_row, again, beyond_again = self._branches(
                    targets[row : row + 1], last[np.newaxis], self._allowed
                )
                branches[:] = again[0]
                beyond[row] = beyond_again[0]
                penalty[row] = self._penalty(form_of_row, beyond_again)[0]
            # Whole turns were chosen close to the start; a path that turns on and on needs them close to the posture
            # before. `angles` is a view, too. Each axis stays within its limits.
            for axis, lower, upper in self._wide:
                angles = branches[:, axis]
                angles -= TURN * np.rint((angles - last[axis]) / TURN)
                angles -= TURN * (angles > upper)
                angles += TURN * (angles < lower)
            difference = branches - last
            choice = (np.vecdot(difference, difference) + penalty[row]).argmin()
            choices[row] = choice
            last = branches[choice]
        rows = np.arange(len(targets))
        out_of_reach = form.out_of_reach[:, self._allowed]
        return self._check_solutions(
            targets,
            postures[rows, choices],
            out_of_reach[rows, choices],
            beyond[rows, choices],
        )

    def _penalty(self, form: ClosedForm, beyond: Vector) -> Vector:
        """Compute penalties that rank the postures of each target.

        A penalty is added to a posture's squared distance from the start [rad²], and the smallest sum is chosen. It is
        0 for a posture that reaches its target within the limits, small for one that is beyond a limit by rounding, and
        large, and growing with the miss, for one that misses the target or a limit.

        Args:
            form: closed-form postures of k targets.
            beyond: distance of each axis beyond its limits, for the b allowed postures, shape (k, b, n) [rad].

        Returns:
            the penalties, shape (k, b).
        """
        out_of_reach = form.out_of_reach[:, self._allowed]
        # A sum of metres and radians has no meaning of its own: it only ranks the postures.
        missed_turn = form.missed_turn[:, self._allowed]
        miss = out_of_reach + missed_turn + beyond.max(axis=-1)
        is_rounded = self._fits(beyond) & (out_of_reach <= _ROUNDING) & (missed_turn == 0.0)
        penalty = np.where(is_rounded, _ROUNDED, _FAR * (1.0 + miss))
        return np.where(miss > _ROUNDING, penalty, 0.0)

    def _check_solutions(
        self, targets: Vector, chosen: Vector, out_of_reach: Vector, beyond: Vector
    ) -> Solutions:
        """Clamp the chosen postures to the limits, remove small errors by numeric search, and check the targets.

        A target that is reached only beyond a rounded limit counts as reached, with a warning that names the axis.

        Args:
            targets: poses of the tool, shape (k, 4, 4).
            chosen: the chosen posture for each target, shape (k, n) [rad].
            out_of_reach: distance of the wrist centre beyond what the arm reaches, shape (k,) [m].
            beyond: distance of each axis beyond its limits, shape (k, n) [rad].

        Returns:
            the postures within the limits, with their errors, and for each target whether it is reached or why not.
        """
        positions = np.clip(chosen, self.chain.lower, self.chain.upper)
        errors = pose_errors(targets, self.chain.forward(positions))
        weights = np.ones(6)
        is_in_range = (out_of_reach <= _ROUNDING) & self._fits(beyond)

        # Errors from rounded dimensions of the arm. Postures out of reach or beyond a limit miss their targets anyway,
        # so that they need no steps.
        is_rough = (np.abs(errors).max(axis=1) > _EXACT) & is_in_range
        if is_rough.any():
            fit = fit_postures(
                self.chain,
                targets[is_rough],
                positions[is_rough],
                weights=weights,
                tolerance=np.array([_EXACT, _EXACT]),
                iterations=_POLISHING,
            )
            positions[is_rough] = fit.postures
            errors[is_rough] = fit.errors

        # Targets that are out of reach only because limits are rounded. Indexing by rows copies, so the changed
        # postures and errors are written back.
        tolerance = np.array([POSITION_TOLERANCE, ROTATION_TOLERANCE])
        is_reached = within(errors, weights, tolerance)
        rows = np.flatnonzero(~is_reached & is_in_range)
        if rows.size:
            own_positions = positions[rows]
            own_errors = errors[rows]
            is_reached[rows] = settle_at_limits(
                self.chain,
                targets[rows],
                own_positions,
                own_errors,
                weights=weights,
                tolerance=tolerance,
            )
            positions[rows] = own_positions
            errors[rows] = own_errors

        def why(row: int) -> str:
            """Reason why a target is not reached, in words."""
            return self._reason(out_of_reach[row], beyond[row])

        # A closed form takes no iterations; the few steps against rounding are not counted.
        no_iterations = np.zeros(len(targets), dtype=np.int64)
        return Solutions.from_errors(positions, errors, is_reached, no_iterations, why)

    def _reason(self, out_of_reach: float, beyond: Vector) -> str:
        """Write why a target is not reached.

        Args:
            out_of_reach: distance of the wrist centre beyond what the arm reaches, 0 if it is in reach [m].
            beyond: distance of each axis of the chosen posture beyond its limits, 0 if it is within, shape (n,) [rad].
        """
        if out_of_reach > _ROUNDING:
            return message(
                "kinematics.wrist_out_of_reach",
                "out of reach: the wrist centre is {distance:.3g} m beyond the reach of the arm",
                distance=out_of_reach,
            )
        if not self._fits(beyond):
            postures = message("kinematics.all_postures", "all postures")
            if len(self._allowed) < BRANCHES:
                postures += message("kinematics.with_these_flags", " with these flags")
            axis = int(np.argmax(beyond))
            more = message(
                "kinematics.beyond_its_limit",
                "{angle} beyond its limit",
                angle=angle(beyond[axis]),
            )
            return message(
                "kinematics.postures_beyond_limits",
                "joint limit: {postures} exceed a limit; in the best posture, {axis} is {more}",
                postures=postures,
                axis=self.chain.names[axis],
                more=more,
            )
        # In reach and within the limits, yet with an error: the spherical triangle of the wrist does not close.
        return message(
            "kinematics.no_wrist_orientation",
            "the wrist cannot turn the tool to this orientation: its axes are not at right angles",
        )
