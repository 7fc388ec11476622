"""Inverse kinematics as a nonlinear program of Drake, with constraints and wishes (GIK in SimRob)."""

from collections.abc import Callable, Sequence
from typing import Any, Literal, get_args

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


class ConstrainedSolver(Solver):
    """Solves a nonlinear program for each target: pose, goals, joint limits (SimRob's GIK with its constraints).

    The target pose and every goal without a weight are constraints. Goals with a weight are costs. If costs cannot all
    be zero, their sum is minimised, as in SimRob, where every constraint is such a cost. Of all postures that satisfy
    the constraints, the closest to the start is sought.
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
                    "two numbers, of position and rotation, not negative",
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
        self._program(np.eye(4), np.zeros(chain.size))  # raises the errors of wrong goals at once

    def _solve_each(self, targets: Vector, starts: Vector) -> Solutions:
        """Solve the program of each target (k, 4, 4) from its own start (k, n)."""
        return Solutions.joined([*map(self._solve_one, targets, starts)])

    def _solve_one(self, target: Vector, start: Vector) -> Solutions:
        """Solve the program of one target (4, 4) from a start (n,), then from random postures."""
        start = np.clip(start, self.chain.lower, self.chain.upper)
        program = self._program(target, start)
        best = start
        misses = [("", np.inf)]  # constraints that the best solution misses, and by how much
        steps = 0
        for guess in (start, *self._seeds):
            solution = program.solve(guess)
            steps += 1
            new_misses = program.missed(solution)
            if sum(violation for _, violation in new_misses) < sum(
                violation for _, violation in misses
            ):
                best = solution
                misses = new_misses
            if not misses:
                break

        positions = np.clip(best, self.chain.lower, self.chain.upper)
        errors = self._errors(target, positions)
        is_target_a_cost = self._weights is not None
        is_reached = (within(errors, np.ones(6), _TOLERANCE) | is_target_a_cost) & (not misses)
        names = ", ".join(dict.fromkeys(name for name, _ in misses)) or message(
            "kinematics.target_pose", "the target pose"
        )
        why = message(
            "kinematics.no_posture_satisfies",
            "no posture found within the joint limits that satisfies {names}",
            names=names,
        )
        return Solutions.found(
            positions[np.newaxis], errors, is_reached, np.array([steps]), lambda _: why
        )

    def _errors(self, target: Vector, positions: Vector) -> Vector:
        """Errors of a posture (n,) that count, shape (1, 6) [m, rad]; the others are 0."""
        errors = pose_errors(target[np.newaxis], self.chain.forward(positions))
        mask = {"pose": [1.0] * 6, "position": [1.0] * 3 + [0.0] * 3, "free": [0.0] * 6}[self._kind]
        counted: Vector = errors * mask
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
        """Make a program with the joint limits, and a cost for the distance from a start (n,) with its weight."""
        in_plant = chain.in_plant
        self._chain = chain
        self._ik = InverseKinematics(in_plant.plant)
        self._prog: MathematicalProgram = self._ik.prog()
        self._setting = Setting(chain, self._ik.context())
        self._axes = in_plant.axes
        self._default_positions = in_plant.plant.GetPositions(in_plant.plant.CreateDefaultContext())
        q = self._ik.q()
        others = np.setdiff1d(np.arange(len(q)), in_plant.axes.position_places)
        if others.size:
            fixed = self._default_positions[others]
            self._prog.AddBoundingBoxConstraint(fixed, fixed, q[others])
        own = q[in_plant.axes.position_places]
        self._prog.AddQuadraticErrorCost(
            nearness * np.eye(chain.size), in_plant.axes.signs * start, own
        )

    def solve(self, guess: Vector) -> Vector:
        """Solve the program from a guess (n,). Returns the positions (n,), whether or not all constraints hold."""
        options = SolverOptions()
        options.SetOption(SnoptSolver.id(), "Major feasibility tolerance", _FEASIBLE)
        options.SetOption(IpoptSolver.id(), "constr_viol_tol", _FEASIBLE)
        full_guess = self._axes.spread_positions(guess, self._default_positions)
        result = Solve(self._prog, full_guess, options)
        return self._axes.positions(result.GetSolution(self._ik.q()))

    def missed(self, positions: Vector) -> list[tuple[str, float]]:
        """Find the constraints that positions (n,) miss. Returns the name and the violation of each."""
        full = self._axes.spread_positions(positions, self._default_positions)
        misses = []
        for binding in self._prog.GetAllConstraints():
            evaluator = binding.evaluator()
            value = evaluator.Eval(
                full[self._prog.FindDecisionVariableIndices(binding.variables())]
            )
            above = value - evaluator.upper_bound()
            below = evaluator.lower_bound() - value
            violation = np.maximum(above, below).max(initial=0.0)
            if not violation <= _VIOLATED:  # also if it is not a number
                name = evaluator.get_description() or message(
                    "kinematics.joint_limits", "the joint limits"
                )
                misses.append((name, float(violation)))
        return misses

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
        box = RigidTransform(_rotation(target), target[:3, 3])
        free = np.inf
        points = {
            message("kinematics.target_position", "the target position"): (ORIGIN, ORIGIN, ORIGIN)
        }
        if kind == "pose":
            half = 0.5 * _LEVER  # excludes the postures in which the tool points the other way
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
        if kind != "free" and position_weight > 0:
            weights = position_weight * np.eye(3)
            cost = PositionCost(
                plant, base, target[:3, 3], tool, tcp.translation(), weights, context
            )
            self._prog.AddCost(cost, self._ik.q())
        if kind == "pose" and rotation_weight > 0:
            rotation = _rotation(target)
            cost = OrientationCost(
                plant, base, rotation, tool, tcp.rotation(), 2.0 * rotation_weight, context
            )
            self._prog.AddCost(cost, self._ik.q())

    def add(self, goal: Goal) -> None:
        """Add a goal, as a constraint or, with weights, as a cost."""
        constraint = goal.constraint(self._setting)
        q = self._ik.q()
        if isinstance(goal, JointBounds):
            q = q[self._axes.position_places[[self._chain.axis_index(goal.axis)]]]
        weights = goal.weights(constraint.num_constraints())
        if weights is not None:
            self._prog.AddCost(_violation_cost(constraint, weights), vars=q)
            return
        constraint.set_description(type(goal).__name__)
        self._prog.AddConstraint(constraint, q)


def _violation_cost(constraint: Constraint, weights: Vector) -> Callable[[Any], Any]:
    """Make the cost Σ w·(distance outside the bounds)², for numbers and for Drake's differentiable scalars."""
    lower = constraint.lower_bound()
    upper = constraint.upper_bound()

    def cost(positions: Any) -> Any:
        total = 0.0 * positions[0]
        for value, low, high, weight in zip(
            constraint.Eval(positions), lower, upper, weights, strict=True
        ):
            if weight > 0 and value < low:
                total = total + weight * (value - low) * (value - low)
            elif weight > 0 and value > high:
                total = total + weight * (value - high) * (value - high)
        return total

    return cost


def _rotation(target: Vector) -> RotationMatrix:
    """Rotation of a pose (4, 4), without its rounding errors."""
    return RotationMatrix.ProjectToRotationMatrix(target[:3, :3])
