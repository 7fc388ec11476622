"""Inverse kinematics as a nonlinear program of Drake, with constraints and wishes (GIK in SimRob)."""

from collections.abc import Callable, Sequence
from typing import Any, Literal, get_args

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.inverse_kinematics import InverseKinematics, OrientationCost, PositionCost
from pydrake.solvers import Constraint, IpoptSolver, MathematicalProgram, SnoptSolver, Solve, SolverOptions

from simrob_drake.base.errors import InvalidParameter, one_of
from simrob_drake.base.frames import Vector, pose_errors, within
from simrob_drake.base.messages import message
from simrob_drake.kinematics.chain import Chain
from simrob_drake.kinematics.goals import ORIGIN, Goal, JointBounds, Setting, point_in_box
from simrob_drake.kinematics.numeric import random_postures
from simrob_drake.kinematics.solver import Solutions, Solver

TargetKind = Literal["pose", "position", "free"]

_FEASIBLE = 1e-8  # by which the program's constraints may be missed, in their own units
_TOLERANCE = np.array([1e-5, 1e-4])  # m, rad: what counts as reached; the program ends well below
_VIOLATED = 1e-6  # by which a constraint counts as missed
_LEVER = 1.0  # m from the tool centre point to the points that hold its orientation


class ConstrainedSolver(Solver):
    """Solves one nonlinear program a target: pose, goals, joint limits (SimRob's GIK with its constraints).

    The target pose and every goal without a weight are constraints. Those with weights are costs; goals that cannot
    all hold then come to the best compromise, as in SimRob, where every constraint is such a cost. Of all postures that
    serve, the one nearest to the start is sought.
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
            chain: whose axes it moves; all other joints of its plant keep their default positions.
            goals: what else is asked.
            target: what of the target poses counts: ``"pose"``, ``"position"``, or nothing (``"free"``; then they
                only say how many postures are wanted).
            target_weights: of the squared position and rotation errors to the target, to make it a wish.
            nearness: weight of the squared distance from the start [1/rad² or 1/m²].
            restarts: how many random postures are tried where the start does not lead to a solution.
            seed: of the random postures.

        Raises:
            InvalidParameter: a goal or a setting that makes no sense.
            UnknownName: a goal with an unknown axis or frame.
        """
        super().__init__(chain)
        one_of(message("kinematics.kind_of_target", "kind of target"), target, get_args(TargetKind))
        weights = np.asarray((1.0, 1.0) if target_weights is None else target_weights, dtype=float)
        if weights.shape != (2,) or not np.isfinite(weights).all() or (weights < 0).any():
            raise InvalidParameter(
                "target_weights",
                target_weights,
                message("kinematics.two_tolerances", "two numbers, of position and rotation, not negative"),
            )
        if not nearness >= 0:
            raise InvalidParameter("nearness", nearness, message("kinematics.zero_or_more", "0 or more"))
        if restarts < 0:
            raise InvalidParameter("restarts", restarts, message("kinematics.zero_or_more", "0 or more"))
        bad = [goal for goal in goals if not isinstance(goal, Goal)]
        if bad:
            raise InvalidParameter(
                "goals", bad[0], message("kinematics.goals", "goals such as PositionBounds or JointBounds")
            )
        self._goals, self._kind = tuple(goals), target
        self._weights = None if target_weights is None else weights
        self._nearness = nearness
        self._seeds = random_postures(chain, restarts, seed)
        self._program(np.eye(4), np.zeros(chain.size))  # so that a wrong goal is told of at once

    def _solve_each(self, targets: Vector, starts: Vector) -> Solutions:
        return Solutions.joined([*map(self._solve_one, targets, starts)])

    def _solve_one(self, target: Vector, start: Vector) -> Solutions:
        start = np.clip(start, self.chain.lower, self.chain.upper)
        program = self._program(target, start)
        best, misses, steps = start, [("", np.inf)], 0
        for guess in (start, *self._seeds):
            found = program.solve(guess)
            steps += 1
            missed = program.missed(found)
            if sum(by for _, by in missed) < sum(by for _, by in misses):
                best, misses = found, missed
            if not misses:
                break
        positions = np.clip(best, self.chain.lower, self.chain.upper)
        errors = self._errors(target, positions)
        reached = (within(errors, np.ones(6), _TOLERANCE) | (self._weights is not None)) & (not misses)
        names = ", ".join(dict.fromkeys(name for name, _ in misses)) or message(
            "kinematics.target_pose", "the target pose"
        )
        why = message(
            "kinematics.no_posture_satisfies",
            "no posture found within the joint limits that satisfies {names}",
            names=names,
        )
        return Solutions.found(positions[np.newaxis], errors, reached, np.array([steps]), lambda _: why)

    def _errors(self, target: Vector, positions: Vector) -> Vector:
        errors = pose_errors(target[np.newaxis], self.chain.forward(positions))
        mask = {"pose": [1.0] * 6, "position": [1.0] * 3 + [0.0] * 3, "free": [0.0] * 6}[self._kind]
        part: Vector = errors * mask
        return part

    def _program(self, target: Vector, start: Vector) -> "_Program":
        program = _Program(self.chain, start, self._nearness)
        if self._weights is None:
            program.require_target(target, self._kind)
        else:
            program.wish_target(target, self._kind, *self._weights)
        for goal in self._goals:
            program.add(goal)
        return program


class _Program:
    """A nonlinear program over the positions of a chain's plant."""

    def __init__(self, chain: Chain, start: Vector, nearness: float) -> None:
        place = chain.in_plant
        self._chain = chain
        self._ik = InverseKinematics(place.plant)
        self._prog: MathematicalProgram = self._ik.prog()
        self._setting = Setting(chain, self._ik.context())
        self._axes = place.axes
        self._rest = place.plant.GetPositions(place.plant.CreateDefaultContext())
        q = self._ik.q()
        others = np.setdiff1d(np.arange(len(q)), place.axes.position_places)
        if others.size:
            self._prog.AddBoundingBoxConstraint(self._rest[others], self._rest[others], q[others])
        own = q[place.axes.position_places]
        self._prog.AddQuadraticErrorCost(nearness * np.eye(chain.size), place.axes.signs * start, own)

    def solve(self, guess: Vector) -> Vector:
        """Return the positions (n,) that the solver finds from a guess."""
        options = SolverOptions()
        options.SetOption(SnoptSolver.id(), "Major feasibility tolerance", _FEASIBLE)
        options.SetOption(IpoptSolver.id(), "constr_viol_tol", _FEASIBLE)
        result = Solve(self._prog, self._axes.spread_positions(guess, self._rest), options)
        return self._axes.positions(result.GetSolution(self._ik.q()))

    def missed(self, found: Vector) -> list[tuple[str, float]]:
        """Return the constraints that the last solution misses, and by how much."""
        full = self._axes.spread_positions(found, self._rest)
        missed = []
        for binding in self._prog.GetAllConstraints():
            evaluator = binding.evaluator()
            value = evaluator.Eval(full[self._prog.FindDecisionVariableIndices(binding.variables())])
            by = np.maximum(value - evaluator.upper_bound(), evaluator.lower_bound() - value).max(initial=0.0)
            if not by <= _VIOLATED:
                missed.append(
                    (evaluator.get_description() or message("kinematics.joint_limits", "the joint limits"), float(by))
                )
        return missed

    def require_target(self, target: Vector, kind: TargetKind) -> None:
        """Demand the place of the tool, and its orientation by the places of two more points of it."""
        if kind == "free":
            return
        box, free = RigidTransform(_rigid(target), target[:3, 3]), np.inf
        points = {message("kinematics.target_position", "the target position"): (ORIGIN, ORIGIN, ORIGIN)}
        if kind == "pose":
            half = 0.5 * _LEVER  # keeps out the postures in which the tool is turned over
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

    def wish_target(self, target: Vector, kind: TargetKind, position: float, rotation: float) -> None:
        """Add the costs position·(distance)² and rotation·2(1 - cos(angle)), which is about the angle squared."""
        place, context = self._chain.in_plant, self._setting.context
        tool, tcp = self._setting.frame("tool")
        if kind != "free" and position > 0:
            centre = tcp.translation()
            cost = PositionCost(place.plant, place.base, target[:3, 3], tool, centre, position * np.eye(3), context)
            self._prog.AddCost(cost, self._ik.q())
        if kind == "pose" and rotation > 0:
            turn = _rigid(target)
            cost = OrientationCost(place.plant, place.base, turn, tool, tcp.rotation(), 2.0 * rotation, context)
            self._prog.AddCost(cost, self._ik.q())

    def add(self, goal: Goal) -> None:
        """Add a goal, as a constraint or, with weights, as a cost."""
        constraint = goal.constraint(self._setting)
        q = self._ik.q()
        if isinstance(goal, JointBounds):
            q = q[self._axes.position_places[[self._chain.axis_index(goal.axis)]]]
        weights = goal.weights(constraint.num_constraints())
        if weights is not None:
            self._prog.AddCost(_wish(constraint, weights), vars=q)
            return
        constraint.set_description(type(goal).__name__)
        self._prog.AddConstraint(constraint, q)


def _wish(constraint: Constraint, weights: Vector) -> Callable[[Any], Any]:
    """Return the cost Σ w·(distance outside the bounds)², for numbers and for Drake's differentiable scalars."""
    lower, upper = constraint.lower_bound(), constraint.upper_bound()

    def cost(positions: Any) -> Any:
        total = 0.0 * positions[0]
        for value, low, high, weight in zip(constraint.Eval(positions), lower, upper, weights, strict=True):
            if weight > 0 and value < low:
                total = total + weight * (value - low) * (value - low)
            elif weight > 0 and value > high:
                total = total + weight * (value - high) * (value - high)
        return total

    return cost


def _rigid(target: Vector) -> RotationMatrix:
    return RotationMatrix.ProjectToRotationMatrix(target[:3, :3])
