"""All solvers of inverse kinematics, by the name that moves and functions take under ``solver``.

To add a solver to the core, add a file to this folder and an entry to `_CORE`. Installed extensions add further ones.
"""

import inspect
from typing import Annotated, Any, Literal, TypeAlias, get_args

from pydantic import AfterValidator, WithJsonSchema

from simrob_drake.base.errors import InvalidParameter, one_of
from simrob_drake.base.extension import additions, load_addition_class, register_core_names
from simrob_drake.base.messages import message
from simrob_drake.kinematics.analytic import AnalyticSolver
from simrob_drake.kinematics.chain import Chain
from simrob_drake.kinematics.closed_form import NoClosedForm
from simrob_drake.kinematics.constrained import ConstrainedSolver
from simrob_drake.kinematics.incremental import IncrementalSolver
from simrob_drake.kinematics.numeric import NumericSolver
from simrob_drake.kinematics.solver import Solver

_CORE: dict[str, type[Solver]] = {
    "numeric": NumericSolver,
    "constrained": ConstrainedSolver,
    "analytic": AnalyticSolver,
    "incremental": IncrementalSolver,
}
"""The solvers of the core."""
_AUTO = "auto"
"""Name that selects the analytic solver if the arm has a closed form, else the numeric one."""
_POINT = "inverse_kinematics"
"""Extension point at which extensions add solvers."""
# Additions of extensions under one of these names are left out, so that a file means the same on every machine.
register_core_names(_POINT, lambda: [_AUTO, *_CORE])

CoreSolverName = Literal["auto", "numeric", "constrained", "analytic", "incremental"]
"""Names of the core, for type checkers and editors."""
SolverLike: TypeAlias = CoreSolverName | str | Solver
"""Name of a solver, or a solver that was made for the arm's chain, with settings of its own."""

_FINE: dict[str, float] = {"position_tolerance": 1e-8, "rotation_tolerance": 1e-8}
_OPTIONS: dict[str, dict[str, Any]] = {"numeric": _FINE, "incremental": _FINE}
"""Tolerances of searches on a path [m and rad]. They cost one or two steps: the searches converge quadratically."""


def solver_names() -> list[str]:
    """Return the names of all solvers, ``auto`` first and those of extensions last."""
    return [_AUTO, *_CORE, *additions(_POINT)]


def make_solver(name: str, chain: Chain, **options: Any) -> Solver:
    """Make a solver of inverse kinematics by its name.

    Args:
        name: ``"numeric"`` (SimRob's W), ``"constrained"`` (GIK), ``"analytic"`` (AIK), ``"incremental"`` (JacIK), or
            the name of a solver that an extension adds. ``"auto"`` is refused, as it is no solver of
            its own; :func:`solver_for` takes it.
        chain: chain of joints whose axes the solver moves.
        **options: arguments of the solver's class after the chain, such as tolerances. Those that are left out have the
            class's default values.

    Raises:
        UnknownName: there is no such solver, or the solver has no such option.
        InvalidParameter: an option has a value that it cannot have.
        NoClosedForm: the analytic solver does not cover this arm.
        BrokenExtension: the solver is one of an extension that cannot be imported.
    """
    one_of(
        message("base.solver_of_inverse_kinematics", "solver of inverse kinematics"),
        name,
        [known for known in solver_names() if known != _AUTO],
    )
    solver_class = _solver_class(name)
    # An unknown option would raise Python's TypeError without a suggestion. The first parameter is the chain.
    known_options = list(inspect.signature(solver_class).parameters)[1:]
    for option in options:
        one_of(
            message("kinematics.option_of_solver", "option of the {name} solver", name=name),
            option,
            known_options,
        )
    return solver_class(chain, **options)


def solver_for(chain: Chain, solver: SolverLike) -> Solver:
    """Make the solver that a move names, or return the given solver.

    ``"auto"`` selects the analytic solver or, if the arm has no closed form, the numeric one. A numeric or incremental
    solver that is made here gets the finer tolerances of a path; other solvers get the default values of their options.

    Args:
        chain: chain of joints whose axes the solver moves.
        solver: name of a solver, or a solver that was made for this chain.

    Raises:
        UnknownName: there is no such solver.
        NoClosedForm: the move names the analytic solver, and the arm has no closed form.
        InvalidParameter: the given solver was made for another robot or tool.
        BrokenExtension: the named solver is one of an extension that cannot be imported.
    """
    if isinstance(solver, Solver):
        # The home of a chain is the pose of its tool at zero, which differs between two tools. A solver made for
        # another tool would bring this one to the wrong poses without any error.
        if solver.chain.names != chain.names or not (solver.chain.home == chain.home).all():
            raise InvalidParameter(
                "solver",
                type(solver).__name__,
                message(
                    "kinematics.solver_of_this_arm",
                    "a solver made for arm.chain with its present tool",
                ),
            )
        return solver
    one_of(message("kinematics.solver", "solver"), solver, solver_names())
    if solver != _AUTO:
        return make_solver(solver, chain, **_OPTIONS.get(solver, {}))
    try:
        return make_solver("analytic", chain)
    except NoClosedForm:
        return make_solver("numeric", chain, **_FINE)


def _check_name(name: str) -> str:
    """Check the name of a solver in a program's file.

    Raises:
        UnknownName: there is no such solver.
    """
    return one_of(
        message("base.solver_of_inverse_kinematics", "solver of inverse kinematics"),
        name,
        solver_names(),
    )


SolverName: TypeAlias = Annotated[
    str,
    AfterValidator(_check_name),
    WithJsonSchema({"enum": list(get_args(CoreSolverName)), "type": "string"}),
]
"""Type of a key of a file that names a solver."""


def _solver_class(name: str) -> type[Solver]:
    """Return the class of a solver.

    Raises:
        BrokenExtension: the solver is one of an extension that cannot be imported.
    """
    # The module of an extension is imported only if its solver is used.
    if name in _CORE:
        return _CORE[name]
    added: type[Solver] = load_addition_class(additions(_POINT)[name], Solver)
    return added
