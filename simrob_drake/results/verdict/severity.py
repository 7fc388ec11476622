"""How severe each remark about a run is. This is the only module that decides it."""

from simrob_drake.base.remarks import Severity
from simrob_drake.results.record.run import RecordedRun, robot_that_fell

_OF_ENDINGS: dict[str, Severity] = {
    "completed": "success",
    "monitor": "success",  # a monitor is set to end the run there, except for a fall
    "interrupted": "note",
    "diverged": "failure",
    "failed": "failure",
}
"""Severity of each ending of a run, if no robot fell."""

VIOLATION: Severity = "warning"
"""Severity of a value that violates its bound, and of a solver's doubt about the result."""

CONTROLLER_REMARK: Severity = "note"
"""Severity of what a controller reports, such as a walk that was asked for too high a speed and went slower."""


def severity_of_end(run: RecordedRun) -> Severity:
    """Severity of how a run ended."""
    # A monitor of falls ends a run because the robot failed. All others are goals or limits that the user has
    # set.
    if run.ending == "monitor" and robot_that_fell(run) is not None:
        return "failure"
    return _OF_ENDINGS[run.ending]


def severity_of_value(*, is_violation: bool, has_bound: bool) -> Severity:
    """Severity of a value: a note if it has no bound, otherwise a success or, if it violates its bound, a warning."""
    if is_violation:
        return VIOLATION
    return "success" if has_bound else "note"
