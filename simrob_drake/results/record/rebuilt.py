"""The station of a run that comes from another process, built again when it is needed.

Drake's plants and diagrams cannot be pickled. A result is pickled by its configuration, its arrays and its states, see
`pickled_fields`. The plant, and everything that is computed from it, is made again by a `RebuiltRun`.

Recorded states can be evaluated again if the station can be built again with states of the same layout. Otherwise only
the *recorded motion* remains: the positions of the plant at the samples and at the solver's steps.
"""

from collections.abc import Callable, Iterator
from dataclasses import fields
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

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


class RecordedMotion(NamedTuple):
    """Positions of a plant at some times of a run, from which other positions are interpolated.

    Attributes:
        times: the times, rising, shape (k,) [s].
        positions: positions of the plant, shape (k, nq).
    """

    times: Vector
    positions: Vector


def pickled_fields(run: Run) -> dict[str, Any]:
    """Content of a pickled run.

    Args:
        run: the run.

    Returns:
        the fields of the run but for those of REBUILT, by name, and further entries: ``has_contacts`` and
        ``has_context``, whether these fields were not None; ``motion``, the recorded motion, or None if the recorded
        states or the parts of a program replace it.
    """
    names = [field.name for field in fields(run) if field.name not in REBUILT]
    content = {name: getattr(run, name) for name in names}
    content["has_contacts"] = run.contacts_at is not None
    content["has_context"] = run.context is not None
    # The class of a user's block may be unknown where the result is read.
    has_own_blocks = any(section.runs_code for section in run.config.controllers.values())
    has_states = has_layout_of_station(run) and not has_own_blocks
    is_program = bool(run.runs)  # each of its runs is pickled with its own motion
    content["motion"] = None if is_program or has_states else _recorded_motion(run)
    return content


def has_layout_of_station(run: Run) -> bool:
    """Whether the recorded states of a run may be those of a diagram of its station alone.

    Programs and other engines record no states. A diagram of the user's own has states of further blocks.
    """
    return run.trace is not None and not run.in_own_diagram


def _recorded_motion(run: Run) -> RecordedMotion:
    """Positions of the plant at the samples and at the ends of the steps of a run, for the plant that is rebuilt."""
    # Positions are then exact at all samples and steps, and interpolated between them.
    times = np.union1d(run.times, run.step_times)
    is_inside = (times >= run.start_time) & (times <= run.stop_time)
    times = times[is_inside]
    if run.plant.is_shared:
        # The plant that is built again contains the station alone.
        station = PosedStation(run.config).station
        return RecordedMotion(times, positions_in(station, run, times))
    # The rebuilt plant has the same joints in the same order, so positions need no conversion.
    return RecordedMotion(times, run.positions_at(times))


class RebuiltRun:
    """The plant of a run, and what is computed from it."""

    def __init__(self, run: Run, *, has_contacts: bool, motion: RecordedMotion | None) -> None:
        """Prepare to build the station of a run again.

        Args:
            run: the run.
            has_contacts: whether contacts were evaluated in the run.
            motion: the recorded motion; None if the recorded states contain it.
        """
        self._run = run
        self._has_contacts = has_contacts
        self._motion = motion

    @property
    def plant(self) -> StationPlant:
        """The station's plant with its robots."""
        return self._station.ports.plant

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
                    "{station}: a pickled result does not contain the context of a diagram of your own. Build "
                    "the diagram again, and continue with simulate_diagram(diagram, ports, "
                    'start=result.final_state, start_time="keep")',
                    station=self._run.config.name,
                )
            )
        # The diagram was built again, so the state is put into a new context of it.
        return self._run.final_state.context_of(self._station.diagram, self._station.ports)

    def context_of_plant(self) -> Context:
        """A new default context of the diagram with the plant and its shapes."""
        return self._station.diagram.CreateDefaultContext()

    def positions_at(self, times: Vector) -> Vector:
        """Positions of the plant (k, nq) at times (k,) [s] of the run.

        They are the original ones to the last bit if the run has recorded states that fit the diagram that was built
        again. Otherwise they are interpolated linearly between the times of the recorded motion.

        Raises:
            SimrobError: the run has no recorded motion, and its states do not fit the diagram that was built again.
        """
        # The recorded states, or else the recorded motion.
        sampler = self._sampler
        if sampler is not None:
            ports = self._station.ports
            states: Vector = sampler.sample([ports.state], times)[0]
            return states[:, : ports.plant.plant.num_positions()]
        if self._motion is None:
            # A run is pickled without a motion if its states suffice. They do not if the station has changed
            # since, as with another version of the package.
            raise self._error_of_lost(message("results.positions_of_pickled", "positions"))
        # Only samples and steps were pickled; a straight line between two of them is the best that is left.
        columns = [
            np.interp(times, self._motion.times, column) for column in self._motion.positions.T
        ]
        return np.column_stack(columns)

    def _contacts_at(self, times: Vector) -> Iterator[ContactResults]:
        """Yield Drake's contact results at times (k,) [s] of the run.

        Raises:
            SimrobError: the run has no recorded states that fit the diagram that was built again.
        """
        if self._sampler is None:
            raise self._error_of_lost(message("results.contacts_of_pickled", "contact forces"))
        yield from self._sampler.contact_results(times)

    def _error_of_lost(self, lost: str) -> SimrobError:
        """Make the error about values that a pickled run does not contain, such as "positions"."""
        return SimrobError(
            message(
                "results.lost_by_pickle",
                "{station}: a pickled result contains no {lost} if its diagram cannot be built again, as with "
                "blocks or a diagram of your own; evaluate them before you pickle the result",
                station=self._run.config.name,
                lost=lost,
            )
        )

    @cached_property
    def _sampler(self) -> "Sampler | None":
        """Evaluates the station at the recorded states. It is None if these do not fit the rebuilt diagram."""
        # Imported here: a result that is only read, for its signals and its verdict, needs no sampler.
        from simrob_drake.results.record.signals import Sampler

        trace = self._run.trace
        if (
            not has_layout_of_station(self._run)
            or trace is None
            or not fits(trace.history, self._station)
        ):
            return None
        # Tolerant, since a block that failed in the run fails again at the states after that.
        return Sampler(self._station.diagram, self._station.ports, trace.history, tolerant=True)

    @cached_property
    def _station(self) -> "ClosedStation":
        """The station, built again with the references of the run, when it is first used.

        It has no blocks of the user's own if one of these cannot be made.

        Raises:
            SimrobError: the station cannot be built again even so.
        """
        config = self._run.config
        try:
            return _build_again(self._run, config)
        except SimrobError:
            own_code = [name for name, section in config.controllers.items() if section.runs_code]
            # The class of a user's block may be unknown here, or its file gone.
            if not own_code:  # the error has another cause
                raise
            # Its plant does not depend on the user's blocks: pictures and contacts of the recorded motion need
            # no more than that.
            others = {
                name: section
                for name, section in config.controllers.items()
                if name not in own_code
            }
            return _build_again(self._run, config.model_copy(update={"controllers": others}))


def _build_again(run: Run, config: StationConfig) -> "ClosedStation":
    """Build the diagram in which the signals of a run are evaluated.

    Args:
        run: the run.
        config: configuration of the run, perhaps without blocks of the user's own that cannot be made.
    """
    # Imported here: building a station loads every block and the importers of robots, which plots of a result
    # do not need.
    from simrob_drake.parts.controllers import own_blocks
    from simrob_drake.parts.controllers.own import with_driven
    from simrob_drake.stations.closed import closed_station, station_references
    from simrob_drake.stations.resolve import resolve

    blocks = own_blocks(config.controllers)
    # the user's blocks drive inputs that the station does not list
    inputs = with_driven(config.inputs, blocks)
    station = resolve(config.model_copy(update={"inputs": inputs}))
    # The final state keeps the positions at which the references of this run began.
    references = station_references(station, run.references, run.final_state.origins or None)
    # Lean: outputs that are computed from the states need no blocks.
    built = closed_station(
        station, references, sensors=list(station.sensors), blocks=blocks, monitors=False, lean=True
    )
    built.play_forces(config.forces)
    return built


def fits(history: StateHistory, built: "ClosedStation") -> bool:
    """Whether recorded states have the sizes of the states of a diagram.

    Args:
        history: the recorded states.
        built: the station with the diagram.
    """
    context = built.diagram.CreateDefaultContext()
    # Sizes are a necessary condition only: Drake's states have no names that could be compared.
    if history.continuous.shape[1] != context.num_continuous_states():
        return False
    group_count = context.num_discrete_state_groups()
    sizes = [context.get_discrete_state(group).size() for group in range(group_count)]
    recorded_sizes = [group.shape[1] for group in history.discrete]
    if recorded_sizes != sizes:
        return False
    # A history without abstract values fits any diagram: these then keep the values that they declare.
    return not history.abstract or len(history.abstract[0]) == context.num_abstract_states()


def check_format(found: object) -> None:
    """Check the format of a pickled result.

    Args:
        found: number of the format, as it was pickled.

    Raises:
        SimrobError: another version of the package has pickled the result.
    """
    if found != FORMAT:
        raise SimrobError(
            message(
                "results.pickled_by_other_version",
                "another version of simrob_drake has pickled the result (format {found}; this version reads "
                "format {known}). Run the station again, or read the result with that version",
                found=found,
                known=FORMAT,
            )
        )
