"""Inverse kinematics point by point with the damped Jacobian (JacIK in SimRob)."""

import numpy as np

from simrob_drake.base.errors import InvalidParameter, angle
from simrob_drake.base.frames import Vector, pose_errors, within
from simrob_drake.base.messages import message
from simrob_drake.kinematics.chain import Chain
from simrob_drake.kinematics.numeric import Flags, settle_at_limits
from simrob_drake.kinematics.solver import Solutions, Solver, check_search, why_unreached

_NEAR_SINGULAR = 0.02  # smallest singular value [m, rad] below which damping begins
_MOST_DAMPING = 0.04  # at a singular posture
_LONGEST_STEP = 0.5  # rad or m of one axis, where damping alone does not hold it back


class IncrementalSolver(Solver):
    """Follows a path from point to point: dq = Jᵀ(JJᵀ + λ²I)⁻¹·e, with the error e to the next point (SimRob's JacIK).

    e is the way to the point and the rotation vector to it, so that no angle jumps at ±π, and the positions grow
    steadily from those of the start. λ is 0 away from singular postures and grows as the smallest singular value of the
    Jacobian falls under 0.02 (Nakamura & Hanafusa, 1986), so that the arm passes them. Joints stop at their limits.

    Attributes:
        stray: how far the points of a move may be from its line or arc [m].

    As in SimRob the rotation of a step counts only up to a limit: a point that turns the tool by more is gone to
    with the tool kept as it is. (SimRob compares with the sine of that angle, so a half turn passed there.)
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
            chain: whose axes it moves.
            rotation_limit: largest turn of the tool from one point to the next that is followed [rad]. 0 follows
                positions only and never turns the tool; a negative number sets no limit. (In SimRob a negative number
                turned JacIK off altogether: choose another solver for that.)
            iterations: most steps for a point; 1 is SimRob's.
            position_tolerance: distance at which a point counts as reached [m].
            rotation_tolerance: angle at which it does [rad].
            stray: how far the points of a move may be from its line or arc, past singular postures [m].

        Raises:
            InvalidParameter: a setting that makes no sense.
        """
        super().__init__(chain)
        if np.isnan(rotation_limit):
            raise InvalidParameter(
                "rotation_limit", rotation_limit, message("kinematics.an_angle", "an angle [rad]; 0 for positions only")
            )
        tolerances = {"position_tolerance": position_tolerance, "rotation_tolerance": rotation_tolerance}
        self._iterations, self._tolerance = iterations, check_search(iterations, tolerances)
        if not 0.0 <= stray < np.inf:
            raise InvalidParameter("stray", stray, message("kinematics.a_distance", "a distance [m], 0 or more"))
        self.stray = stray
        self._limit = np.inf if rotation_limit < 0 else rotation_limit

    def _solve_each(self, targets: Vector, starts: Vector) -> Solutions:
        positions = np.clip(starts, self.chain.lower, self.chain.upper)
        errors = pose_errors(targets, self.chain.forward(positions))
        turned = np.linalg.norm(errors[:, 3:], axis=1) <= self._limit
        turned &= self._limit > 0
        goals = targets.copy()
        goals[~turned, :3, :3] = self.chain.forward(positions)[~turned, :3, :3]
        steps = np.zeros(len(targets), dtype=np.int64)
        for _ in range(self._iterations):
            frames = self.chain.frames(positions)
            poses = self.chain.tool_poses(frames)
            errors = pose_errors(goals, poses)
            rows = np.flatnonzero(~self._within(errors))
            if not rows.size:
                break
            jacobians = self.chain.jacobian_at(frames, poses[:, :3, 3])[rows]
            moved = positions[rows] + _damped_steps(jacobians, errors[rows])
            positions[rows] = np.clip(moved, self.chain.lower, self.chain.upper)
            steps[rows] += 1
        errors = pose_errors(targets, self.chain.forward(positions))
        rows = np.flatnonzero(~self._within(errors) & turned)
        accepted = np.zeros(len(targets), dtype=bool)
        at_limit = (positions <= self.chain.lower) | (positions >= self.chain.upper)
        rows = rows[at_limit[rows].any(axis=1)]
        if rows.size:
            postures, left = positions[rows], errors[rows]
            accepted[rows] = settle_at_limits(
                self.chain, targets[rows], postures, left, weights=np.ones(6), tolerance=self._tolerance
            )
            positions[rows], errors[rows] = postures, left
        if self._limit == 0:
            errors[:, 3:] = 0.0

        def why(row: int) -> str:
            return self._reason(targets[row], positions[row], errors[row], bool(turned[row]))

        return Solutions.found(positions, errors, self._within(errors) | accepted, steps, why)

    def _within(self, errors: Vector) -> Flags:
        return within(errors, np.ones(6), self._tolerance)

    def _reason(self, target: Vector, positions: Vector, error: Vector, turned: bool) -> str:
        if not turned and np.linalg.norm(error[:3]) <= self._tolerance[0]:
            turn = angle(float(np.linalg.norm(error[3:])))
            return message(
                "kinematics.rotation_limit",
                "rotation limit: the tool would turn by {turn} at once, and the limit is {limit}",
                turn=turn,
                limit=angle(self._limit),
            )
        weights = np.array([1.0, 1.0, 1.0, *[float(turned)] * 3])
        return why_unreached(self.chain, target, positions, error * weights, weights)


def _damped_steps(jacobians: Vector, errors: Vector) -> Vector:
    """Return the steps (k, n) by singular values: each direction is damped by the same λ."""
    left, values, right = np.linalg.svd(jacobians, full_matrices=False)
    lowest = values[:, -1:]
    damping = np.where(lowest < _NEAR_SINGULAR, _MOST_DAMPING**2 * (1.0 - (lowest / _NEAR_SINGULAR) ** 2), 0.0)
    along = (left.transpose(0, 2, 1) @ errors[..., np.newaxis])[..., 0]
    gains = values / np.maximum(values**2 + damping, 1e-12)
    steps = (right.transpose(0, 2, 1) @ (gains * along)[..., np.newaxis])[..., 0]
    longest = np.abs(steps).max(axis=1, keepdims=True)
    limited: Vector = steps * np.minimum(1.0, _LONGEST_STEP / np.maximum(longest, _LONGEST_STEP))
    return limited
