"""Inverse kinematics point by point with the damped Jacobian (JacIK in SimRob)."""

import numpy as np

from simrob_drake.base.errors import InvalidParameter, angle
from simrob_drake.base.frames import Vector, pose_errors, within
from simrob_drake.base.messages import message
from simrob_drake.kinematics.chain import Chain
from simrob_drake.kinematics.numeric import Counts, Flags, settle_at_limits
from simrob_drake.kinematics.solver import Solutions, Solver, check_search, why_unreached

_NEAR_SINGULAR = 0.02
"""Smallest singular value of the Jacobian below which damping begins [m or 1]."""

_LARGEST_DAMPING = 0.04
"""Damping λ at a singular posture [m or 1]."""

_LEAST_DENOMINATOR = 1e-12
"""Least denominator of a gain, so that nothing is divided by 0."""

_LONGEST_STEP = 0.5
"""Longest step of one axis, in case damping alone does not limit it [rad or m]."""


class IncrementalSolver(Solver):
    """Follows a path from point to point with the damped Jacobian (SimRob's JacIK).

    With the error e to the next point, a step is dq = Jᵀ(JJᵀ + λ²I)⁻¹·e. The error has the distance to the point and
    the rotation vector to it, so that no angle jumps at ±π, and the positions change steadily from those of the start.
    The damping λ is 0 away from singular postures. It grows as the smallest singular value of the Jacobian falls below
    0.02 (Nakamura & Hanafusa, 1986), so that the arm passes singular postures. Joints stop at their limits.

    As in SimRob, the rotation to a point is followed only up to a limit. If a point would turn the tool by more, the
    arm goes to the point without turning the tool. Such a point counts as not reached, unless the limit is 0 and only
    positions count. (SimRob compares with the sine of the angle, so that a half turn passes there.)

    Attributes:
        stray: distance by which points of a move may miss its line or arc [m].
    """

    def __init__(
        self,
        chain: Chain,
        *,
        rotation_limit: float = 0.3,
        iterations: int = 20,
        position_tolerance: float = 1e-5,
        rotation_tolerance: float = 1e-4,
        stray: float = 0.0,
    ) -> None:
        """Make the solver.

        Args:
            chain: the axes.
            rotation_limit: largest turn of the tool from one point to the next that is followed [rad]. With 0 the
                solver follows positions only and never turns the tool. A negative number sets no limit. (In SimRob a
                negative number switches JacIK off; choose another solver for that.)
            iterations: largest count of steps for a point. SimRob does 1.
            position_tolerance: distance at which a point counts as reached [m].
            rotation_tolerance: angle at which a point counts as reached [rad].
            stray: distance by which points of a move may miss its line or arc near singular postures [m].

        Raises:
            InvalidParameter: a limit that is not a number, no iterations, a tolerance that is not positive, or a
                negative distance.
        """
        super().__init__(chain)
        if np.isnan(rotation_limit):
            raise InvalidParameter(
                "rotation_limit",
                rotation_limit,
                message("kinematics.an_angle", "an angle [rad]; 0 for positions only"),
            )
        tolerances = {
            "position_tolerance": position_tolerance,
            "rotation_tolerance": rotation_tolerance,
        }
        self._iterations = iterations
        self._tolerance = check_search(iterations, tolerances)
        if not 0.0 <= stray < np.inf:
            raise InvalidParameter(
                "stray", stray, message("kinematics.a_distance", "a distance [m], 0 or more")
            )
        self.stray = stray
        self._limit = np.inf if rotation_limit < 0 else rotation_limit

    def _solve_each(self, targets: Vector, starts: Vector) -> Solutions:
        """Follow each of k targets from its own start.

        For a target that turns the tool by more than the limit, the tool only goes to its position. The error of
        rotation is left, so such a target counts as not reached, unless the limit is 0: then rotations are no errors. A
        target that is reached only beyond a rounded limit counts as reached, with a warning that names the axis; not if
        the limit of rotations is 0.

        Args:
            targets: poses of the tool, shape (k, 4, 4).
            starts: postures, shape (k, n) [rad or m].
        """
        positions = np.clip(starts, self.chain.lower, self.chain.upper)
        poses_at_start = self.chain.forward(positions)

        # Rotations beyond the limit are not followed: the goal keeps the orientation that the tool has at the start. A
        # limit of 0 follows no rotation at all, not even one of exactly 0.
        rotations = np.linalg.norm(pose_errors(targets, poses_at_start)[:, 3:], axis=1)
        is_rotation_followed = (rotations <= self._limit) & (self._limit > 0)
        goals = targets.copy()
        goals[~is_rotation_followed, :3, :3] = poses_at_start[~is_rotation_followed, :3, :3]
        # This changes `positions` in place.
        steps = self._follow(goals, positions)

        # Errors count against the targets themselves, with their rotations. Targets that are out of reach only because
        # limits are rounded are accepted.
        errors = pose_errors(targets, self.chain.forward(positions))
        is_accepted = np.zeros(len(targets), dtype=bool)
        is_at_limit = (positions <= self.chain.lower) | (positions >= self.chain.upper)
        # Wider limits can only help where an axis is at one.
        rows = np.flatnonzero(
            ~self._within(errors) & is_rotation_followed & is_at_limit.any(axis=1)
        )
        if rows.size:
            # `settle_at_limits` changes both in place. Indexing by rows copies, so they are written back.
            own_positions = positions[rows]
            own_errors = errors[rows]
            is_accepted[rows] = settle_at_limits(
                self.chain,
                targets[rows],
                own_positions,
                own_errors,
                weights=np.ones(6),
                tolerance=self._tolerance,
            )
            positions[rows] = own_positions
            errors[rows] = own_errors
        # With a limit of 0 the solver follows positions only, and rotations do not count as errors.
        if self._limit == 0:
            errors[:, 3:] = 0.0

        def why(row: int) -> str:
            """Reason why a target is not reached, in words."""
            return self._reason(
                targets[row],
                positions[row],
                errors[row],
                is_rotation_followed=bool(is_rotation_followed[row]),
            )

        return Solutions.from_errors(
            positions, errors, self._within(errors) | is_accepted, steps, why
        )

    def _follow(self, goals: Vector, positions: Vector) -> Counts:
        """Do damped steps until the goals are reached or the iterations are used up.

        Args:
            goals: poses of the tool, shape (k, 4, 4).
            positions: postures, shape (k, n) [rad or m]. They are changed in place.

        Returns:
            counts of the steps, shape (k,).
        """
        steps = np.zeros(len(goals), dtype=np.int64)
        for _ in range(self._iterations):
            frames = self.chain.frames(positions)
            poses = self.chain.tool_poses(frames)
            errors = pose_errors(goals, poses)
            rows = np.flatnonzero(~self._within(errors))
            if not rows.size:
                break
            # Only goals that are not reached get a step: one more would move the others by rounding errors, and count.
            jacobians = self.chain.jacobian_at(frames, poses[:, :3, 3])[rows]
            moved = positions[rows] + _damped_steps(jacobians, errors[rows])
            positions[rows] = np.clip(moved, self.chain.lower, self.chain.upper)
            steps[rows] += 1
        return steps

    def _within(self, errors: Vector) -> Flags:
        """Whether errors (k, 6) are within the tolerances, shape (k,)."""
        return within(errors, np.ones(6), self._tolerance)

    def _reason(
        self, target: Vector, positions: Vector, error: Vector, *, is_rotation_followed: bool
    ) -> str:
        """Write why a target is not reached.

        Args:
            target: pose of the tool, shape (4, 4).
            positions: the posture, shape (n,) [rad or m].
            error: error of the posture along and about x, y, z, shape (6,) [m, rad].
            is_rotation_followed: whether the tool was turned towards the target, which the limit of rotation may
                prevent.
        """
        if not is_rotation_followed and np.linalg.norm(error[:3]) <= self._tolerance[0]:
            turn = angle(float(np.linalg.norm(error[3:])))
            return message(
                "kinematics.rotation_limit",
                "rotation limit: the tool would turn by {turn} from one point to the next; the limit is {limit}",
                turn=turn,
                limit=angle(self._limit),
            )
        # A rotation that is not followed cannot be the reason.
        weights = np.array([1.0, 1.0, 1.0, *[float(is_rotation_followed)] * 3])
        return why_unreached(self.chain, target, positions, error * weights, weights)


def _damped_steps(jacobians: Vector, errors: Vector) -> Vector:
    """Compute the damped steps, limited in length.

    With the singular value decomposition J = U S V', the step Jᵀ(JJᵀ + λ²I)⁻¹·e is V diag(s / (s² + λ²)) U' e.

    Args:
        jacobians: Jacobians, shape (k, 6, n).
        errors: errors, shape (k, 6) [m, rad].

    Returns:
        the steps, shape (k, n) [rad or m].
    """
    left, values, right = np.linalg.svd(jacobians, full_matrices=False)
    # Singular values come in descending order. With the smallest one s and the threshold t, the law of Nakamura and
    # Hanafusa is λ² = λ₀² (1 - (s/t)²) below the threshold, and 0 above it.
    least = values[:, -1:]
    closeness = 1.0 - (least / _NEAR_SINGULAR) ** 2
    damping_squared = np.where(least < _NEAR_SINGULAR, _LARGEST_DAMPING**2 * closeness, 0.0)

    # U' e, then the gains s / (s² + λ²), then V. The gain of a direction without motion, s = 0, is 0 and not 1/0.
    projected = (left.transpose(0, 2, 1) @ errors[..., np.newaxis])[..., 0]
    gains = values / np.maximum(values**2 + damping_squared, _LEAST_DENOMINATOR)
    scaled = gains * projected
    steps = (right.transpose(0, 2, 1) @ scaled[..., np.newaxis])[..., 0]

    # All axes are shortened by one factor, so that the step keeps its direction.
    longest = np.abs(steps).max(axis=1, keepdims=True)
    limited: Vector = steps * (_LONGEST_STEP / np.maximum(longest, _LONGEST_STEP))
    return limited
