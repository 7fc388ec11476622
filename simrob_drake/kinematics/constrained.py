"""Inverse kinematics as a nonlinear program of Drake, with constraints and costs (GIK in SimRob).

The variables of a program are the positions of all joints of the chain's plant. Positions and postures here are those
of the chain's n axes, which may count against their joints.
"""

from collections.abc import Callable, Sequence
from typing import Any, Literal, NamedTuple, get_args

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.inverse_kinematics import InverseKinematics, OrientationCost, PositionCost
from pydrake.solvers import (
    Constraint,
    IpoptSolver,
    MathematicalProgram,
    SnoptSolver,
    Solve,
    SolverOptions,
)

from simrob_drake.base.errors import InvalidParameter, one_of
from simrob_drake.base.frames import Vector, pose_errors, within
from simrob_drake.base.messages import message
from simrob_drake.kinematics.chain import Chain
from simrob_drake.kinematics.goals import ORIGIN, Goal, JointBounds, Setting, point_in_box
from simrob_drake.kinematics.numeric import random_postures
from simrob_drake.kinematics.solver import Solutions, Solver

TargetKind = Literal["pose", "position", "free"]

_FEASIBLE = 1e-8
"""Violation that the optimiser allows for a constraint, in the units of the constraint."""

_TOLERANCE = np.array([1e-5, 1e-4])
"""Errors of position [m] and rotation [rad] up to which a target counts as reached. The optimiser ends far below."""

_VIOLATED = 1e-6
"""Violation above which a constraint counts as missed, in the units of the constraint."""

_LEVER = 1.0
"""Distance from the tool centre point to the points that fix the tool's orientation [m]."""


class _Violation(NamedTuple):
    """A constraint that a posture violates.

    Attributes:
        name: name of the constraint in messages.
        amount: distance of its value from its bounds, in the units of the constraint.
    """

    name: str
    amount: float


class ConstrainedSolver(Solver):
    """Solves a nonlinear program for each target: pose, goals, joint limits (SimRob's GIK with its constraints).

    The target pose and every goal without a weight are constraints. Goals with a weight are costs. If costs cannot all
    be zero, their sum is minimised, as in SimRob, where every constraint is such a cost. The squared distance from the
    start is one more cost, with a small weight, so that of equally good postures the closest to the start is sought.
    """

    def __init__(
        self,
        chain: Chain,
        goals: Sequence[Goal] = (),
        *,
        target: TargetKind = "pose",
        target_weights: tuple[float, float] | None = None,
        nearness: float = 1e-5,
        restarts: int = 20,
        seed: int = 0,
    ) -> None:
        """Make the solver.

        Args:
            chain: the axes. All other joints of the plant keep their default positions.
            goals: further conditions.
            target: part of the target poses that counts: ``"pose"``, ``"position"`` or ``"free"``. With ``"free"``,
                the targets only give the count of postures.
            target_weights: weights of the squared position and rotation errors, which make the target a cost; None
                makes the target a constraint.
            nearness: weight of the squared distance from the start [1/rad² or 1/m²].
            restarts: count of random postures that are tried if the start does not lead to a solution.
            seed: seed of the random postures.

        Raises:
            InvalidParameter: a goal that is not one, weights of wrong shape or sign, or a negative setting.
            UnknownName: there is no such part of a target, or a goal names an axis or frame that does not exist.
        """
        super().__init__(chain)
        one_of(message("kinematics.kind_of_target", "kind of target"), target, get_args(TargetKind))
        weights = np.asarray((1.0, 1.0) if target_weights is None else target_weights, dtype=float)
        if weights.shape != (2,) or not np.isfinite(weights).all() or (weights < 0).any():
            raise InvalidParameter(
                "target_weights",
                target_weights,
                message(
                    "kinematics.two_tolerances",
                    "two numbers, for position and rotation, not negative",
                ),
            )
        if not nearness >= 0:
            raise InvalidParameter(
                "nearness", nearness, message("kinematics.zero_or_more", "0 or more")
            )
        if restarts < 0:
            raise InvalidParameter(
                "restarts", restarts, message("kinematics.zero_or_more", "0 or more")
            )
        bad = [goal for goal in goals if not isinstance(goal, Goal)]
        if bad:
            raise InvalidParameter(
                "goals",
                bad[0],
                message("kinematics.goals", "goals such as PositionBounds or JointBounds"),
            )
        self._goals = tuple(goals)
        self._kind = target
        self._weights = None if target_weights is None else weights
        self._nearness = nearness
        self._seeds = random_postures(chain, restarts, seed)
        # Wrong goals raise their errors now, where the user has written them, and not when the first target is solved.
        self._program(np.eye(4), np.zeros(chain.size))

    def _solve_each(self, targets: Vector, starts: Vector) -> Solutions:
        """Solve the program of each target (k, 4, 4) from its own start (k, n)."""
        return Solutions.concatenate([*map(self._solve_one, targets, starts)])

    def _solve_one(self, target: Vector, start: Vector) -> Solutions:
        """Solve the program of one target (4, 4) from a start (n,), then from random postures.

        Returns:
            the first solution without violated constraints, or the one with the smallest sum of violations, clipped to
            the joint limits. Its count of steps is that of the programs that were solved.
        """
        start = np.clip(start, self.chain.lower, self.chain.upper)
        program = self._program(target, start)
        # The start itself remains the best posture if the optimiser never returns finite numbers.
        best = start
        violations = [_Violation("", np.inf)]
        steps = 0
        for guess in (start, *self._seeds):
            solution = program.solve(guess)
            steps += 1
            new_violations = program.violations(solution)
            new_total = sum(violation.amount for violation in new_violations)
            if new_total < sum(violation.amount for violation in violations):
                best = solution
                violations = new_violations
            if not violations:
                break

        # The optimiser keeps limits up to its tolerance only, and a robot must not be sent beyond them.
        positions = np.clip(best, self.chain.lower, self.chain.upper)
        errors = self._errors(target, positions)
        # A target that is a cost may be missed as far as the constraints demand.
        is_target_a_cost = self._weights is not None
        is_reached = (within(errors, np.ones(6), _TOLERANCE) | is_target_a_cost) & (not violations)
        # Several goals of one class have the same name, which is named once. Without violations, only the clipping can
        # have moved the tool away from the target.
        violated_names = dict.fromkeys(violation.name for violation in violations)
        names = ", ".join(violated_names) or message("kinematics.target_pose", "the target pose")
        why = message(
            "kinematics.no_posture_satisfies",
            "no posture found within the joint limits that satisfies {names}",
            names=names,
        )
        return Solutions.from_errors(
            positions[np.newaxis], errors, is_reached, np.array([steps]), lambda _: why
        )

    def _errors(self, target: Vector, positions: Vector) -> Vector:
        """Compute the errors of a posture that count, by the part of the target that is asked for.

        Args:
            target: pose of the tool, shape (4, 4).
            positions: the posture, shape (n,) [rad or m].

        Returns:
            the errors along and about x, y, z, shape (1, 6) [m, rad]. Those that do not count are 0.
        """
        errors = pose_errors(target[np.newaxis], self.chain.forward(positions))
        masks = {
            "pose": [1.0, 1.0, 1.0, 1.0, 1.0, 1.0],
            "position": [1.0, 1.0, 1.0, 0.0, 0.0, 0.0],
            "free": [0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        }
        counted: Vector = errors * masks[self._kind]
        return counted

    def _program(self, target: Vector, start: Vector) -> "_Program":
        """Make the program of one target (4, 4), with a cost for the distance from a start (n,)."""
        program = _Program(self.chain, start, self._nearness)
        if self._weights is None:
            program.require_target(target, self._kind)
        else:
            position_weight, rotation_weight = self._weights
            program.add_target_cost(target, self._kind, position_weight, rotation_weight)
        for goal in self._goals:
            program.add(goal)
        return program


class _Program:
    """A nonlinear program over the positions of a chain's plant."""

    def __init__(self, chain: Chain, start: Vector, nearness: float) -> None:
        """Make a program with the joint limits, and a cost for the distance from a start.

        Args:
            chain: the axes.
            start: the start, shape (n,) [rad or m].
            nearness: weight of the squared distance from the start [1/rad² or 1/m²].
        """
        in_plant = chain.in_plant
        self._chain = chain
        self._ik = InverseKinematics(in_plant.plant)
        self._prog: MathematicalProgram = self._ik.prog()
        self._setting = Setting(chain, self._ik.context())
        self._axes = in_plant.axes
        self._default_positions = in_plant.plant.GetPositions(in_plant.plant.CreateDefaultContext())
        # The plant may have joints that are no axes of the chain, such as those of another robot. They are fixed, or
        # the optimiser would move them.
        q = self._ik.q()
        others = np.setdiff1d(np.arange(len(q)), in_plant.axes.position_places)
        if others.size:
            fixed = self._default_positions[others]
            self._prog.AddBoundingBoxConstraint(fixed, fixed, q[others])
        # nearness · |q - q_start|², in the plant's senses of the joints. It decides between the postures that satisfy
        # the constraints. An arm with more than six axes has infinitely many of them.
        own = q[in_plant.axes.position_places]
        self._prog.AddQuadraticErrorCost(
            nearness * np.eye(chain.size), in_plant.axes.signs * start, own
        )

    def solve(self, guess: Vector) -> Vector:
        """Solve the program from a guess (n,). Returns the positions (n,), whether or not all constraints hold."""
        # Drake takes SNOPT if its build has it, otherwise IPOPT. The solvers name their tolerance differently, and each
        # ignores options of the other.
        options = SolverOptions()
        options.SetOption(SnoptSolver.id(), "Major feasibility tolerance", _FEASIBLE)
        options.SetOption(IpoptSolver.id(), "constr_viol_tol", _FEASIBLE)
        full_guess = self._axes.spread_positions(guess, self._default_positions)
        result = Solve(self._prog, full_guess, options)
        return self._axes.positions(result.GetSolution(self._ik.q()))

    def violations(self, positions: Vector) -> list[_Violation]:
        """Find the constraints that positions (n,) [rad or m] violate, joint limits and target included.

        If positions are not finite, the constraints that depend on them count as violated, by an amount that is NaN.
        """
        full = self._axes.spread_positions(positions, self._default_positions)
        violations = []
        for binding in self._prog.GetAllConstraints():
            # A constraint takes the values of its own variables only.
            evaluator = binding.evaluator()
            value = evaluator.Eval(
                full[self._prog.FindDecisionVariableIndices(binding.variables())]
            )
            above = value - evaluator.upper_bound()
            below = evaluator.lower_bound() - value
            amount = np.maximum(above, below).max(initial=0.0)
            # "Not less or equal" is also true for NaN, with which every comparison is false.
            if not amount <= _VIOLATED:
                # Drake adds the joint limits itself, without a description.
                name = evaluator.get_description() or message(
                    "kinematics.joint_limits", "the joint limits"
                )
                violations.append(_Violation(name, float(amount)))
        return violations

    def require_target(self, target: Vector, kind: TargetKind) -> None:
        """Add constraints for the position of the tool, and for its orientation.

        Two more points of the tool fix the orientation: one on its x axis and one on its y axis, each at _LEVER from
        the tool centre point.

        Args:
            target: pose of the tool, shape (4, 4).
            kind: part of the pose that counts.
        """
        if kind == "free":
            return
        # Bounds are given in the frame of the target. The tool centre point is at its origin.
        box = RigidTransform(_rotation(target), target[:3, 3])
        free = np.inf
        # For each constraint by its name: the point of the tool, and the least and largest coordinates of the point.
        points = {
            message("kinematics.target_position", "the target position"): (ORIGIN, ORIGIN, ORIGIN)
        }
        if kind == "pose":
            # A point of the tool's x axis is on the x axis of the target if y = z = 0, and a point of the tool's y axis
            # is in the target's xy plane if z = 0: three equations for three angles. They also hold for a tool that
            # points the other way, which coordinates of at least half the lever exclude. The coordinates along the
            # levers follow from the others; equations for them would make the optimiser's equations singular.
            half = 0.5 * _LEVER
            points[message("kinematics.target_x_axis", "the target's x axis")] = (
                (_LEVER, 0.0, 0.0),
                (half, 0.0, 0.0),
                (free, 0.0, 0.0),
            )
            points[message("kinematics.target_y_axis", "the target's y axis")] = (
                (0.0, _LEVER, 0.0),
                (-free, half, 0.0),
                (free, free, 0.0),
            )
        for name, (point, lower, upper) in points.items():
            constraint = point_in_box(self._setting, point, box, np.array(lower), np.array(upper))
            constraint.set_description(name)
            self._prog.AddConstraint(constraint, self._ik.q())

    def add_target_cost(
        self, target: Vector, kind: TargetKind, position_weight: float, rotation_weight: float
    ) -> None:
        """Add the costs of a target.

        They are position_weight · distance² and rotation_weight · 2 (1 - cos(angle)), which is about the square of the
        angle.

        Args:
            target: pose of the tool, shape (4, 4).
            kind: part of the pose that counts.
            position_weight: weight of the distance [1/m²].
            rotation_weight: weight of the angle [1/rad²].
        """
        plant = self._chain.in_plant.plant
        base = self._chain.in_plant.base
        context = self._setting.context
        tool, tcp = self._setting.frame("tool")
        # A weight of zero adds no cost: the solver then has nothing to evaluate.
        if kind != "free" and position_weight > 0:
            weights = position_weight * np.eye(3)
            cost = PositionCost(
                plant, base, target[:3, 3], tool, tcp.translation(), weights, context
            )
            self._prog.AddCost(cost, self._ik.q())
        if kind == "pose" and rotation_weight > 0:
            # Drake's cost is c (1 - cos θ), about c θ²/2 for small angles, hence the factor 2.
            rotation = _rotation(target)
            cost = OrientationCost(
                plant, base, rotation, tool, tcp.rotation(), 2.0 * rotation_weight, context
            )
            self._prog.AddCost(cost, self._ik.q())

    def add(self, goal: Goal) -> None:
        """Add a goal, as a constraint or, with weights, as a cost.

        Raises:
            InvalidParameter: the goal has a value that it cannot have.
            UnknownName: the goal names an axis or frame that does not exist.
        """
        constraint = goal.constraint(self._setting)
        # The bounds of a joint are a condition on one variable; all other goals depend on the whole posture.
        q = self._ik.q()
        if isinstance(goal, JointBounds):
            # A list of one index keeps an array, of one variable.
            q = q[self._axes.position_places[[self._chain.axis_index(goal.axis)]]]
        weights = goal.weights(constraint.num_constraints())
        if weights is not None:
            self._prog.AddCost(_violation_cost(constraint, weights), vars=q)
            return
        constraint.set_description(type(goal).__name__)
        self._prog.AddConstraint(constraint, q)


def _violation_cost(constraint: Constraint, weights: Vector) -> Callable[[Any], Any]:
    """Make the cost Σ w·(distance outside the bounds)², for numbers and for Drake's differentiable scalars.

    Args:
        constraint: the constraint, whose values and bounds have the shape (v,).
        weights: weights w of the values, shape (v,).

    Returns:
        a function of the variables of the constraint.
    """
    lower = constraint.lower_bound()
    upper = constraint.upper_bound()

    def cost(positions: Any) -> Any:
        """Sum of the weighted squares of the violations of one vector of variables."""
        # The sum starts with the type of the variables. With Drake's differentiable scalars, a float would lose the
        # derivatives if no bound is violated.
        total = 0.0 * positions[0]
        values = constraint.Eval(positions)
        for value, low, high, weight in zip(values, lower, upper, weights, strict=True):
            # Written as products: they exist for all scalars, and have a continuous derivative at the bounds.
            if weight > 0 and value < low:
                total = total + weight * (value - low) * (value - low)
            elif weight > 0 and value > high:
                total = total + weight * (value - high) * (value - high)
        return total

    return cost


def _rotation(target: Vector) -> RotationMatrix:
    """Rotation of a pose (4, 4), without its rounding errors."""
    return RotationMatrix.ProjectToRotationMatrix(target[:3, :3])
