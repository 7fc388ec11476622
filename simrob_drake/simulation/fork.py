"""A run that goes on from one moment again and again, each time under other pushes."""

from collections.abc import Mapping
from typing import Any

from pydrake.systems.framework import LeafSystem

from simrob_drake.arguments import drake_asserts
from simrob_drake.results.record.state import State
from simrob_drake.simulation.arguments import with_pushes
from simrob_drake.simulation.built import StationDiagrams
from simrob_drake.simulation.run import watched
from simrob_drake.simulation.stepping import Outcome, Stepper
from simrob_drake.stations.config import StationConfig


class Fork:
    """What a run came to at a moment, and how it ends under these pushes or those: what came before is stepped once.

    Each ends as the whole run does, to the last bit under ``cenic`` and discrete solvers; others begin anew at the
    moment with the steps that their error control chooses. No signals are computed.

    Attributes:
        begun: how the run ended that far: completed, if nothing ended it.
    """

    def __init__(
        self,
        config: StationConfig,
        at: float,
        diagrams: StationDiagrams,
        blocks: Mapping[str, LeafSystem],
        start: State | None,
    ) -> None:
        """Step a station up to a moment ``at`` [s]; its diagrams play its references and pushes."""
        self._config, self._diagrams, self._blocks = config, diagrams, blocks
        self._references = diagrams.references
        self._stepper = self._stepping(config.model_copy(update={"duration": at}))
        if start is not None:
            start.put(
                self._stepper.built.diagram, self._stepper.built.ports, self._stepper.simulator.get_mutable_context()
            )
        self.begun = self._outcome(self._stepper)

    @drake_asserts()
    def outcome(self, pushes: Mapping[str, Any]) -> Outcome:
        """Return how the run ends that goes on under pushes, by name, as ``Runner.run`` takes them; at the same places.

        Raises:
            InvalidParameter: a push that cannot be.
        """
        if self.begun.ending != "completed":
            return self.begun
        config = with_pushes(self._config, pushes)
        self._diagrams.play(self._references, config.forces)
        return self._outcome(self._stepping(config, reached=self._stepper.simulator.get_context()))

    def _stepping(self, config: StationConfig, **more: Any) -> Stepper:
        return Stepper(config, self._diagrams.stepped, self._diagrams.edges, blocks=self._blocks, **more)

    def _outcome(self, stepper: Stepper) -> Outcome:
        return stepper.run(*watched(stepper, self._diagrams.whole))
