r"""The stiffest contact that a station's solver can hold.

* Error-controlled schemes follow any spring with steps that are short enough, :math:`h = 2.5 \sqrt{m/k}` for explicit
  ones at rest. Steps shorter than 10 µs are not worth waiting for, so :math:`k \le m\,(2.5/h)^2`.
* Schemes of fixed steps need ten of them for a contact, which lasts :math:`\pi\sqrt{m/k}`.
* ``sap`` never lets a contact be stiffer than :math:`k = 4\pi^2 m / (3.3\,h\,(h + 0.1\,\mathrm{s}))`, whatever it is
  told (measured within 5 % on a ball at rest, for steps of 1 and 5 ms): a stiffer one would be softened silently.
* ``lagged``, ``similar`` and ``cenic`` treat the spring implicitly and hold any.
"""

from __future__ import annotations

import numpy as np
from pydrake.multibody.tree import RigidBody

from simrob_drake.errors import InvalidParameter
from simrob_drake.stations.solver_config import DiscreteSolver, SolverConfig

_FINEST_STEP = 1e-5  # s
_STABLE = 2.5  # h ω of a third-order Runge-Kutta scheme on an undamped spring is below 1.7, on a damped one 2.5
_STEPS_A_CONTACT = 10
_SAP_FACTOR = 3.3
_SAP_RELAXATION = 0.1  # s, Drake's default


def largest_stiffness(solver: SolverConfig, mass: float) -> float:
    """Return the stiffest contact [N/m] of a body of ``mass`` [kg] that a solver can hold; inf if any."""
    if isinstance(solver, DiscreteSolver):
        step = solver.time_step
        softened = 4 * np.pi**2 * mass / (_SAP_FACTOR * step * (step + _SAP_RELAXATION))
        return float(softened) if solver.scheme == "sap" else np.inf
    if solver.scheme == "cenic":
        return np.inf
    if solver.fixed_steps:
        return float(mass * (np.pi / (_STEPS_A_CONTACT * solver.max_step)) ** 2)
    return mass * (_STABLE / _FINEST_STEP) ** 2


def check_stiffness(solver: SolverConfig, body: RigidBody, stiffness: float) -> None:
    """Check that a solver can hold the contacts of a body.

    Raises:
        InvalidParameter: names the body and the largest stiffness.
    """
    largest = largest_stiffness(solver, body.default_mass())
    if stiffness > largest:
        step = f"steps of {solver.time_step:g} s" if isinstance(solver, DiscreteSolver) else solver.kind
        allowed = f"at most {largest:.3g} N/m for {body.name()} ({body.default_mass():.3g} kg) with the solver"
        raise InvalidParameter("contact.stiffness", stiffness, f"{allowed} {solver.scheme}, {step}")
