"""The port for engines other than Drake: what an extension provides so that a station runs in its engine."""

from abc import abstractmethod
from dataclasses import replace
from typing import Any, ClassVar, Self, cast

from pydrake.systems.framework import DiagramBuilder

from simrob_drake.base.extension import BrokenExtension
from simrob_drake.base.messages import message
from simrob_drake.base.sections import Positive
from simrob_drake.parts.engine import Engine, PlantBlock, missing_methods
from simrob_drake.parts.station_plant import StationPlant
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.resolve import ResolvedStation
from simrob_drake.stations.solver_config import TIGHTER, SolverSection


class OtherEngine(SolverSection):
    """A section ``solver`` whose engine takes the place of Drake's plant in a dynamic station.

    A subclass has the keys of the section as its fields, ``kind`` among them, and gives `answers`, and implements
    `plant_block`. It is announced at the extension point ``engines`` under the name of its kind. Drake's plant is built
    nevertheless, outside of the diagram: it computes poses, masses and signals from the engine's states.
    """

    answers: ClassVar[Engine] = Engine(name="")
    """Properties of the engine, see `Engine`. Its name and its steps are those of the section."""
    time_step: Positive = 1e-3
    """Length of a step [s]."""

    @abstractmethod
    def plant_block(self, station: ResolvedStation, plant: StationPlant) -> PlantBlock:
        """Make the Drake system that takes the place of the plant.

        Args:
            station: the station.
            plant: its plant in Drake, which is finalized.

        Raises:
            SimrobError: the engine is not installed, or has no equivalent of a part of the station.
        """

    @property
    def engine(self) -> Engine:
        """Properties of the engine, with the name and the step length of this section.

        All other properties are those of `answers`, except that the steps are fixed and that Drake's plant is not
        stepped.
        """
        return replace(
            self.answers,
            name=self.kind,
            time_step=self.time_step,
            has_fixed_steps=True,
            steps_drakes_plant=False,
        )

    @property
    def step_key(self) -> str:
        """Key that holds the length of the steps."""
        return "time_step"

    def tighter(self, factor: float = TIGHTER) -> Self:
        """The same engine with its step divided by a factor."""
        return self.model_copy(update={"time_step": self.time_step / factor})


def other_engine(config: StationConfig) -> OtherEngine | None:
    """Section ``solver`` of another engine than Drake. None if Drake's plant or a reference moves the station."""
    solver = config.solver
    # In a kinematic station, the section `solver` has no effect.
    return solver if config.engine.moves_by_forces and isinstance(solver, OtherEngine) else None


def add_plant_block(
    builder: DiagramBuilder,
    engine: OtherEngine,
    station: ResolvedStation,
    plant: StationPlant,
) -> PlantBlock:
    """Add the block of another engine to a diagram, in place of Drake's plant.

    The poses of the plant's shapes in the scene graph then follow from the states of the engine.

    Args:
        builder: builder of the diagram.
        engine: the section ``solver``, which makes the block.
        station: the station.
        plant: its plant in Drake, which is finalized and not in the diagram.

    Raises:
        SimrobError: the engine cannot make the block, see `OtherEngine.plant_block`.
        BrokenExtension: the block lacks a method or a port that a station needs.
    """
    block: Any = engine.plant_block(station, plant)
    # Checked here, as a missing method would only show in the middle of a run.
    missing = missing_methods(block)
    if missing:
        lacking = ", ".join(missing)
        raise BrokenExtension(
            message(
                "stations.engine_lacks_methods",
                "solver.kind {kind}: the block {name} lacks {lacking}, see PlantBlock",
                kind=engine.kind,
                name=type(block).__name__,
                lacking=lacking,
            )
        )
    # The scene graph gets the poses of the shapes from the states of the engine.
    builder.AddSystem(block)
    builder.Connect(block.get_state_output_port(), plant.add_geometry_poses(builder, of_state=True))
    return cast(PlantBlock, block)
