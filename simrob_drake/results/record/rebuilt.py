"""The station of a run that comes from another process, built again when it is needed.

Drake's plants and diagrams cannot be pickled. A result is pickled by its configuration, its arrays and its states, see
`pickled_fields`. The plant, and everything that is computed from it, is made again by a `RebuiltRun`.
"""

from collections.abc import Callable, Iterator
from dataclasses import fields
from functools import cached_property
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from pydrake.multibody.plant import ContactResults
from pydrake.systems.framework import Context

from simrob_drake.base.errors import SimrobError
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import message
from simrob_drake.parts.station_plant import StationPlant
from simrob_drake.results.record.history import StateHistory
from simrob_drake.results.record.other_plant import positions_in
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.posed import PosedStation

if TYPE_CHECKING:
    from simrob_drake.results.record.signals import Sampler
    from simrob_drake.stations.closed import ClosedStation

Run: TypeAlias = Any
"""A `RecordedRun`. Its module imports this one, so the class cannot be named here."""

FORMAT = 1
"""Number of the format of pickled results. It changes if older pickled results cannot be read any more."""

REBUILT = ("plant", "positions_at", "contacts_at", "context")
"""Fields of a run that are not pickled, but made again."""


def pickled_fields(run: Run) -> dict[str, Any]:
    """Fields of a run that can be pickled, by name.

    Args:
        run: the run.
    """
    kept = {field.name: getattr(run, field.name) for field in fields(run) if field.name not in REBUILT}
    kept["has_contacts"] = run.contacts_at is not None
    kept["has_context"] = run.context is not None
    # The class of a user's block may be unknown where the result is read.
    has_own_blocks = any(section.runs_code for section in run.config.controllers.values())
    is_motion_recorded = has_layout_of_station(run) and not has_own_blocks
    kept["motion"] = None if run.runs or is_motion_recorded else _motion(run)
    return kept


def has_layout_of_station(run: Run) -> bool:
    """Whether the recorded states of a run may be those of a diagram of its station alone."""
    return run.trace is not None and not run.in_own_diagram


def _motion(run: Run) -> tuple[Vector, Vector]:
    """Positions of the plant at the samples and at the ends of the steps of a run.

    Returns:
        the times (k,) [s] and the positions (k, nq).
    """
    times = np.union1d(run.times, run.step_times)
    times = times[(times >= run.start_time) & (times <= run.stop_time)]
    if run.plant.is_shared:
        # The plant that is built again contains the station alone.
        return times, positions_in(PosedStation(run.config).station, run, times)
    return times, run.positions_at(times)


class RebuiltRun:
    """The plant of a run, and what is computed from it."""

    def __init__(self, run: Run, *, has_contacts: bool, motion: tuple[Vector, Vector] | None) -> None:
        """Prepare to build the station of a run again.

        Args:
            run: the run.
            has_contacts: whether contacts were evaluated in the run.
            motion: recorded times and positions of the plant; None if the recorded states contain them.
        """
        self._run = run
        self._has_contacts = has_contacts
        self._motion = motion

    @property
    def plant(self) -> StationPlant:
        """The station's plant with its robots."""
        return self._closed.ports.plant

    @property
    def contacts_at(self) -> Callable[[Vector], Iterator[ContactResults]] | None:
        """Function that yields contact results at times (k,) [s], or None if the run has none."""
        return self._contacts_at if self._has_contacts else None

    def context(self) -> Context:
        """A new context at the end of the run, of the diagram that was built again.

        Raises:
            SimrobError: the run was one in a diagram of the user's own, which cannot be built again.
        """
        if self._run.in_own_diagram:
            raise SimrobError(
                message(
                    "results.context_lost_by_pickle",
                    "{station}: a result that was pickled has no context of a diagram of your own; build the diagram "
                    "again, and continue with "
                    'simulate_diagram(diagram, ports, start=result.final_state, start_time="keep")',
                    station=self._run.config.name,
                )
            )
        return self._run.final_state.context_of(self._closed.diagram, self._closed.ports)

    def context_of_plant(self) -> Context:
        """A new default context of the diagram with the plant and its shapes."""
        return self._closed.diagram.CreateDefaultContext()

    def positions_at(self, times: Vector) -> Vector:
        """Positions of the plant (k, nq) at times (k,) [s] of the run.

        They are the original ones to the last bit if the diagram of the station could be built again. Otherwise they
        are interpolated linearly between the samples.
        """
        sampler = self._sampler
        if sampler is not None:
            ports = self._closed.ports
            states: Vector = sampler.sample([ports.state], times)[0]
            return states[:, : ports.plant.plant.num_positions()]
        if self._motion is None:
            raise self._lost(message("results.positions_of_pickled", "positions"))
        known_times, positions = self._motion
        return np.column_stack([np.interp(times, known_times, column) for column in positions.T])

    def _contacts_at(self, times: Vector) -> Iterator[ContactResults]:
        """Yield Drake's contact results at times (k,) [s] of the run."""
        if self._sampler is None:
            raise self._lost(message("results.contacts_of_pickled", "contact forces"))
        yield from self._sampler.contact_results(times)

    def _lost(self, lost: str) -> SimrobError:
        """Error about values that a pickled run does not contain."""
        return SimrobError(
            message(
                "results.lost_by_pickle",
                "{station}: a result that was pickled has no {lost} if its diagram cannot be built again "
                "(blocks or a diagram of your own); evaluate them before it is pickled",
                station=self._run.config.name,
                lost=lost,
            )
        )

    @cached_property
    def _sampler(self) -> "Sampler | None":
        """Evaluates the station at the recorded states. It is None if these do not fit the rebuilt diagram."""
        from simrob_drake.results.record.signals import Sampler

        trace = self._run.trace
        if not has_layout_of_station(self._run) or trace is None or not fits(trace.history, self._closed):
            return None
        return Sampler(self._closed.diagram, self._closed.ports, trace.history, tolerant=True)

    @cached_property
    def _closed(self) -> "ClosedStation":
        """The station, closed with the references of the run; without blocks of the user's own that cannot be made."""
        try:
            return _build_again(self._run, self._run.config)
        except SimrobError:
            sections = self._run.config.controllers
            known = {name: section for name, section in sections.items() if not section.runs_code}
            if len(known) == len(sections):
                raise
            return _build_again(self._run, self._run.config.model_copy(update={"controllers": known}))


def _build_again(run: Run, config: StationConfig) -> "ClosedStation":
    """Build the diagram in which the signals of a run are evaluated.

    Args:
        run: the run.
        config: configuration of the run, perhaps without blocks of the user's own that cannot be made.
    """
    from simrob_drake.parts.controllers import own_blocks
    from simrob_drake.parts.controllers.own import with_driven
    from simrob_drake.stations.closed import closed_station, station_references
    from simrob_drake.stations.resolve import resolve

    blocks = own_blocks(config.controllers)
    inputs = with_driven(config.inputs, blocks)  # and those that the user's blocks drive
    station = resolve(config.model_copy(update={"inputs": inputs}))
    # The final state keeps the positions at which the references of this run began.
    references = station_references(station, run.references, run.final_state.origins or None)
    # Lean, as the diagram of the run was: outputs that are computed from the states have no blocks.
    built = closed_station(station, references, sensors=list(station.sensors), blocks=blocks, monitors=False, lean=True)
    built.play_forces(config.forces)
    return built


def fits(history: StateHistory, built: "ClosedStation") -> bool:
    """Whether recorded states have the sizes of the states of a diagram."""
    context = built.diagram.CreateDefaultContext()
    groups = range(context.num_discrete_state_groups())
    sizes = [context.get_discrete_state(group).size() for group in groups]
    has_abstract_values = not history.abstract or len(history.abstract[0]) == context.num_abstract_states()
    return (
        history.continuous.shape[1] == context.num_continuous_states()
        and [group.shape[1] for group in history.discrete] == sizes
        and has_abstract_values
    )


def check_format(found: object) -> None:
    """Check the format of a pickled result; raises SimrobError: another version of the package has pickled it."""
    if found != FORMAT:
        raise SimrobError(
            message(
                "results.pickled_by_other_version",
                "the pickled result is of another version of simrob_drake (format {found}, here {known}); "
                "run the station again, or read the result with that version",
                found=found,
                known=FORMAT,
            )
        )
