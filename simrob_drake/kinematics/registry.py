"""The solvers by name."""

from __future__ import annotations

import inspect
from typing import Any

from simrob_drake.errors import UnknownName
from simrob_drake.kinematics.analytic import AnalyticSolver
from simrob_drake.kinematics.chain import Chain
from simrob_drake.kinematics.constrained import ConstrainedSolver
from simrob_drake.kinematics.incremental import IncrementalSolver
from simrob_drake.kinematics.numeric import NumericSolver
from simrob_drake.kinematics.solver import Solver

SOLVERS: dict[str, type[Solver]] = {
    "numeric": NumericSolver,
    "constrained": ConstrainedSolver,
    "analytic": AnalyticSolver,
    "incremental": IncrementalSolver,
}


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
    if name not in SOLVERS:
        raise UnknownName("solver of inverse kinematics", str(name), SOLVERS)
    known = list(inspect.signature(SOLVERS[name]).parameters)[1:]
    for option in options:
        if option not in known:
            raise UnknownName(f"option of the {name} solver", option, known)
    return SOLVERS[name](chain, **options)
