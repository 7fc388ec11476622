"""The solvers of inverse kinematics by the names that moves call them by."""

from __future__ import annotations

from typing import Any, Literal, TypeAlias, get_args

from simrob_drake.errors import InvalidParameter, UnknownName
from simrob_drake.kinematics import Chain, NoClosedForm, Solver, make_solver

SolverName = Literal["auto", "numeric", "constrained", "analytic", "incremental"]
"""``auto``: analytic where the arm has a closed form, else numeric."""
SolverLike: TypeAlias = SolverName | Solver
"""A solver's name, or one made for the arm's chain, with settings of its own."""

_FINE: dict[str, float] = {"position_tolerance": 1e-8, "rotation_tolerance": 1e-8}
_OPTIONS: dict[str, dict[str, Any]] = {"numeric": _FINE, "incremental": _FINE}
"""How near searches come on a path [m and rad]: a step or two more, since they converge quadratically."""


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
    if wanted not in get_args(SolverName):
        raise UnknownName("solver", str(wanted), get_args(SolverName))
    if wanted != "auto":
        return make_solver(wanted, chain, **_OPTIONS.get(wanted, {}))
    try:
        return make_solver("analytic", chain)
    except NoClosedForm:
        return make_solver("numeric", chain, **_FINE)
