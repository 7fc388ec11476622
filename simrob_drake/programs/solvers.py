"""The solvers of inverse kinematics by the names that moves call them by."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Literal, TypeAlias, get_args

from simrob_drake.errors import InvalidParameter, UnknownName
from simrob_drake.programs.kinematics.analytic import AnalyticSolver
from simrob_drake.programs.kinematics.chain import Chain
from simrob_drake.programs.kinematics.constrained import ConstrainedSolver
from simrob_drake.programs.kinematics.errors import NoClosedForm
from simrob_drake.programs.kinematics.incremental import IncrementalSolver
from simrob_drake.programs.kinematics.numeric import NumericSolver
from simrob_drake.programs.kinematics.solver import Solver

SolverName = Literal["auto", "numeric", "constrained", "analytic", "incremental"]
"""``auto``: analytic where the arm has a closed form, else numeric."""
SolverLike: TypeAlias = SolverName | Solver
"""A solver's name, or one made for the arm's chain, with settings of its own."""

_FINE = 1e-8
"""How near searches come [m and rad]: a step or two more, since they converge quadratically."""
_SOLVERS: dict[str, Callable[[Chain], Solver]] = {
    "numeric": partial(NumericSolver, position_tolerance=_FINE, rotation_tolerance=_FINE),
    "constrained": ConstrainedSolver,
    "analytic": AnalyticSolver,
    "incremental": partial(IncrementalSolver, position_tolerance=_FINE, rotation_tolerance=_FINE),
}


def solver_for(chain: Chain, wanted: SolverLike) -> Solver:
    """Return the solver that a move asks for.

    Raises:
        UnknownName: no such solver.
        NoClosedForm: the analytic one, for an arm without.
        InvalidParameter: a solver that was made for another robot or tool.
    """
    if isinstance(wanted, Solver):
        if wanted.chain.names != chain.names or not (wanted.chain.home == chain.home).all():
            raise InvalidParameter("solver", type(wanted).__name__, "one made for arm.chain with the tool it has now")
        return wanted
    if wanted == "auto":
        try:
            return AnalyticSolver(chain)
        except NoClosedForm:
            return solver_for(chain, "numeric")
    if wanted not in _SOLVERS:
        raise UnknownName("solver", str(wanted), get_args(SolverName))
    return _SOLVERS[wanted](chain)
