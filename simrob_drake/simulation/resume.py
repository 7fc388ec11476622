"""Continue a run that has ended, as if it had never been stopped.

The end of a run cuts the last step of the solver short. A run that was not stopped would not have this step. So a run
that continues another one begins some recorded steps before the end, steps again up to there, and goes on. A solver may
also keep values from step to step that belong to no state, such as the length of the next step. It finds them again
within the repeated steps: `RepeatedSteps` compares these with the recorded ones, to the last bit.

The *trace* of a run has its recorded states, its *history*: one *row* for the start and one for the end of each step.
A *restart* is a row from which stepping begins again.
"""

import numpy as np

from simrob_drake.base.errors import InvalidParameter
from simrob_drake.base.messages import Message, message
from simrob_drake.results.record.history import FlightCheck, Recorder, StateHistory
from simrob_drake.results.record.run import INTERRUPTED, RecordedRun
from simrob_drake.results.record.state import Trace
from simrob_drake.simulation.stepping import Restart
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.steps import controlled_by

_REPEATED = 10
"""Least count of steps that are repeated. Within so many, a solver that adapts its steps finds their lengths again."""

_STRETCH = 1.02
"""Drake's solvers may exceed the length of a step by 1 % to reach the end of the run."""


def last_free_row(history: StateHistory, config: StationConfig) -> int:
    """Find the last recorded step that does not depend on when the run ended.

    A solver that chooses the lengths of its steps tries no step beyond the end of the run, and a failed try determines
    the next one. So the end may change all steps that begin within the largest length of a step before it. Other
    solvers only shorten the last step.

    Args:
        history: the recorded states.
        config: configuration of the station.

    Returns:
        the row of the end of the step, or 0, the start of the run, if there is none.
    """
    # Times at which the steps begin that end at the rows 1, 2, ...
    begins = history.times[:-1]
    solver = controlled_by(config)
    # Steps of a fixed length: only the last one was shortened to end with the run.
    if solver is None:
        return max(len(begins) - 1, 0)
    # Count of the steps that begin early enough: it is the row at which the last of them ends.
    return int(np.searchsorted(begins, history.end - _STRETCH * solver.max_step, side="right"))


class StepsDiffer(Exception):
    """Raised by `RepeatedSteps` in a run whose repeated steps are not the recorded ones."""


def restarts_of(trace: Trace, config: StationConfig) -> list[Restart]:
    """Find recorded steps from which a run may be continued, in the order in which they should be tried.

    Args:
        trace: the recorded run, or its last steps.
        config: configuration of the station.

    Returns:
        the restarts; empty if too few steps are recorded, or if none of the recorded checks of flight is early enough.
    """
    history = trace.history
    # At least so many steps before `free_row`, the last row that does not depend on when the run ended, are repeated.
    row = trace.free_row - _REPEATED
    check = None
    if trace.flight_checks:
        # `cenic` takes other steps while a body flies, that is, touches nothing. This is checked now and then, so a run
        # begins at such a check.
        known = [
            (_row_of(history, known_check), known_check) for known_check in trace.flight_checks
        ]
        # Those whose step is recorded, and early enough.
        early = [
            (found, known_check)
            for found, known_check in known
            if found is not None and found <= row
        ]
        if not early:
            return []
        # The latest of them, so that as few steps as possible are repeated.
        row, check = early[-1]
    # The run is shorter than the steps that would be repeated.
    if row < 0:
        return []
    # A solver with steps of a fixed length keeps nothing but the state.
    if controlled_by(config) is None:
        return [Restart(history, row, check=check)]
    # The length that the solver would try next is not recorded. Usually it is the largest one, for which infinity
    # stands, or that of the step that followed.
    length_of_step = float(history.times[row + 1] - history.times[row])
    return [Restart(history, row, length, check) for length in (np.inf, length_of_step)]


def _row_of(history: StateHistory, check: FlightCheck) -> int | None:
    """Row of the step at whose end flight was checked, or None if the history does not contain it."""
    row = int(np.searchsorted(history.times, check.time))
    # Times are copied, never computed again, so they are equal to the last bit or belong to other steps.
    is_found = row < len(history.times) and history.times[row] == check.time
    return row if is_found else None


class RepeatedSteps:
    """Compares the repeated steps of a continued run with the recorded ones, to the last bit."""

    def __init__(self, trace: Trace, begin: float) -> None:
        """Prepare to compare.

        Args:
            trace: the earlier run.
            begin: time at which stepping begins [s].
        """
        self._end = trace.history.end
        first_row = int(np.searchsorted(trace.history.times, begin))
        self._expected = trace.history.rows(slice(first_row, trace.free_row + 1))
        self._is_compared = False

    def compare(self, recorder: Recorder) -> None:
        """Compare the steps, once all of them are repeated. Call it after each step; it compares in one of the calls.

        Args:
            recorder: records the new run.

        Raises:
            StepsDiffer: a step differs.
        """
        # The compared steps end a little before the earlier run did, at `free_row`. They are compared when the new run
        # has reached the end of the earlier one, so that all of them are recorded.
        if self._is_compared or recorder.times[-1] < self._end:
            return
        self._is_compared = True
        recorded = recorder.history()
        first_row = int(np.searchsorted(recorded.times, self._expected.times[0]))
        repeated = recorded.rows(slice(first_row, first_row + len(self._expected.times)))
        if not _are_equal(self._expected, repeated):
            raise StepsDiffer


def _are_equal(history: StateHistory, other: StateHistory) -> bool:
    """Whether two histories of a diagram have the same times, continuous and discrete states, to the last bit.

    NaN is equal to nothing. Abstract values are not compared.
    """
    pairs = [(history.times, other.times), (history.continuous, other.continuous)]
    pairs += list(zip(history.discrete, other.discrete, strict=True))
    # A tolerance would hide a difference that grows later: contacts amplify the smallest one.
    return all(np.array_equal(expected, found) for expected, found in pairs)


def is_same_motion(first: StationConfig, second: StationConfig) -> bool:
    """Whether two configurations describe the same motion, apart from duration, sample rate, name and description."""
    # Names do not move anything, and neither does when signals are sampled, or when the run ends.
    ignored = {"duration": 0.0, "sample_rate": 0.0, "name": "", "description": ""}
    return first.model_copy(update=ignored) == second.model_copy(update=ignored)


def other_station(config: StationConfig) -> tuple[Message, Message]:
    """Texts of an error for a run that is no run of a station: what it is, and what is expected."""
    found = message("simulation.run_of_other_station", "a run of a station with a different motion")
    return found, message(
        "simulation.run_of_this_station", "a run of this station, {name}", name=config.name
    )


def continuable_trace(result: RecordedRun) -> Trace:
    """Recorded states of a run that can be continued.

    It can be if its states were recorded, it was not in a diagram of the user's own, and it was completed or the user
    interrupted it.

    Args:
        result: the run.

    Raises:
        InvalidParameter: the run cannot be continued, with the reason.
    """
    if (
        result.trace is not None
        and not result.in_own_diagram
        and result.ending in ("completed", INTERRUPTED)
    ):
        return result.trace
    # The most particular reason comes first, so that the message gives the remedy for it.
    if result.runs:
        found = message(
            "simulation.program_of_runs", "a program of {count} runs", count=len(result.runs)
        )
        expected = message("simulation.resume_last_run", "a single run, such as result.runs[-1]")
    elif result.in_own_diagram:
        found = message("simulation.run_in_own_diagram", "a run in a diagram of your own")
        expected = message(
            "simulation.resume_own_diagram",
            "a run of simulate() or Runner; a diagram of your own is continued by "
            "simulate_diagram(diagram, ports, context=result.context()), or after pickling by "
            'simulate_diagram(diagram, ports, start=result.final_state, start_time="keep")',
        )
    elif result.ending not in ("completed", INTERRUPTED):
        found = message(
            "simulation.run_that_ended", "a run that ended early ({ending})", ending=result.ending
        )
        expected = message(
            "simulation.complete_run", "a run that was completed, or that the user interrupted"
        )
    else:
        found = message(
            "simulation.run_without_states", "a run of another engine, without recorded states"
        )
        expected = message("simulation.run_of_runner", "a run of simulate() or Runner")
    raise InvalidParameter("result", found, expected)
