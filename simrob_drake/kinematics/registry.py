"""The solvers by name."""

import inspect
from typing import Any, Literal, TypeAlias, get_args

from simrob_drake.errors import InvalidParameter, one_of
from simrob_drake.kinematics.analytic import AnalyticSolver
from simrob_drake.kinematics.chain import Chain
from simrob_drake.kinematics.constrained import ConstrainedSolver
from simrob_drake.kinematics.incremental import IncrementalSolver
from simrob_drake.kinematics.numeric import NumericSolver
from simrob_drake.kinematics.six_axis_arm import NoClosedForm
from simrob_drake.kinematics.solver import Solver

SOLVERS: dict[str, type[Solver]] = {
    "numeric": NumericSolver,
    "constrained": ConstrainedSolver,
    "analytic": AnalyticSolver,
    "incremental": IncrementalSolver,
}

SolverName = Literal["auto", "numeric", "constrained", "analytic", "incremental"]
"""``auto``: analytic where the arm has a closed form, else numeric."""
SolverLike: TypeAlias = SolverName | Solver
"""A solver's name, or one made for the arm's chain, with settings of its own."""

_FINE: dict[str, float] = {"position_tolerance": 1e-8, "rotation_tolerance": 1e-8}
_OPTIONS: dict[str, dict[str, Any]] = {"numeric": _FINE, "incremental": _FINE}
"""How near searches come on a path [m and rad]: a step or two more, since they converge quadratically."""


def make_solver(name: str, chain: Chain, **options: Any) -> Solver:
    """Return a solver of inverse kinematics.

    Args:
        name: ``"numeric"`` (SimRob's W), ``"constrained"`` (GIK), ``"analytic"`` (AIK) or ``"incremental"`` (JacIK).
        chain: whose axes it moves.
        **options: as the solver's class takes them.

    Raises:
        UnknownName: no such solver, or no such option of it.
        InvalidParameter: an option that makes no sense.
        NoClosedForm: the analytic solver does not cover this arm.
    """
    one_of("solver of inverse kinematics", name, SOLVERS)
    known = list(inspect.signature(SOLVERS[name]).parameters)[1:]
    for option in options:
        one_of(f"option of the {name} solver", option, known)
    return SOLVERS[name](chain, **options)


def solver_for(chain: Chain, solver: SolverLike) -> Solver:
    """Return the solver that a move asks for.

    Raises:
        UnknownName: no such solver.
        NoClosedForm: the analytic one, for an arm without.
        InvalidParameter: a solver that was made for another robot or tool.
    """
    if isinstance(solver, Solver):
        if solver.chain.names != chain.names or not (solver.chain.home == chain.home).all():
            raise InvalidParameter("solver", type(solver).__name__, "one made for arm.chain with the tool it has now")
        return solver
    one_of("solver", solver, get_args(SolverName))
    if solver != "auto":
        return make_solver(solver, chain, **_OPTIONS.get(solver, {}))
    try:
        return make_solver("analytic", chain)
    except NoClosedForm:
        return make_solver("numeric", chain, **_FINE)
