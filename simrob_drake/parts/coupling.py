"""The base class of all couplings of a station, with the checks of which solvers hold a coupling."""

from abc import ABC, abstractmethod
from typing import ClassVar, Protocol

from pydrake.systems.framework import Context, DiagramBuilder

from simrob_drake.errors import InvalidParameter
from simrob_drake.parts.site import Site, StationPlant, Surroundings
from simrob_drake.sections import Strict

# Under continuous schemes a coupling is a spring and a damper: its stiffness for each unit of the inertia that it holds
# [1/s²], and the ratio of damping to stiffness [s].
STIFFNESS = 2000.0**2
RELAXES = 2e-4
_CLOSED = 1e-3  # largest gap of a coupling at the start [m or rad]


class SolverDescription(Protocol):
    """Properties of a station's solver on which it depends which couplings the solver can hold."""

    @property
    def mode(self) -> str:
        """``dynamic`` or ``kinematic``."""

    @property
    def scheme(self) -> str:
        """Name of the scheme, such as ``cenic``; an empty text in a kinematic station."""

    @property
    def time_step(self) -> float:
        """Step of a discrete solver [s]; 0 for other solvers."""


class CouplingSection(Strict, ABC):
    """A section of ``couplings``: the base class of all couplings."""

    constrains: ClassVar[bool] = True  # whether the coupling is a constraint, or a spring stiff enough to count as one
    schemes: ClassVar[tuple[str, ...]] = ("radau3", "radau1", "implicit_euler", "velocity_implicit_euler")
    """Continuous schemes that hold the coupling."""
    engines: ClassVar[tuple[str, ...]] = ()
    """Engines other than Drake's plant that hold the coupling."""
    guides_references: ClassVar[bool] = False
    """Whether references obey the coupling, so that a kinematic station can have it, too."""
    words: ClassVar[str]  # description for people, with fields of the coupling such as "{it.length:g}"
    kind: str

    @abstractmethod
    def add(self, plant: StationPlant) -> None:
        """Add the coupling to a plant that is not finalized."""

    def caption(self) -> str:
        """Describe the coupling in words."""
        return self.words.format(it=self)

    def check(self, key: str, station: Surroundings) -> None:
        """Check that the coupling fits the station: its mode, its solver, and its axes and bodies.

        Args:
            key: key of the coupling in the station, such as ``couplings.mesh``.
            station: the station with the coupling.

        Raises:
            SimrobError: the coupling does not fit the station; the message names the key.
        """
        if station.mode == "kinematic" and not self.guides_references:
            value = f"a coupling of kind {self.kind} in a kinematic station"
            raise InvalidParameter(key, value, "left out: the reference moves all joints, and no force acts")
        if not self.is_held(station):
            expected = f"{'radau3, or ' if self.schemes else ''}kind: discrete with scheme: sap, which hold {key}"
            raise InvalidParameter("solver", station.scheme, expected)

    def is_held(self, station: SolverDescription) -> bool:
        """Whether the solver of a station can hold this coupling."""
        # In a kinematic station the references obey couplings, and soft springs need no particular solver.
        if station.mode == "kinematic" or not self.constrains:
            return True
        if station.scheme == "mujoco":
            return "mujoco" in self.engines
        # Drake's discrete solvers, the only ones with a time step here, hold every coupling as a constraint.
        return station.time_step > 0 or station.scheme in self.schemes

    def add_forces(self, builder: DiagramBuilder, site: Site, key: str) -> None:
        """Add the forces that hold the coupling where the plant has no constraint for it; most couplings add none."""

    def gap(self, plant: StationPlant, context: Context) -> float:
        """Compute the gap between the parts that the coupling holds together, in a context of the plant [m or rad].

        A coupling that holds nothing together, such as a spring, has the gap 0.
        """
        return 0.0

    def check_start(self, key: str, plant: StationPlant, context: Context) -> None:
        """Check that the station starts in a posture that the coupling allows.

        Args:
            key: key of the coupling in the station, for the error message.
            plant: plant of the station.
            context: context of the plant at the start.

        Raises:
            InvalidParameter: the gap of the coupling at the start is too large.
        """
        if (gap := self.gap(plant, context)) > _CLOSED:
            raise InvalidParameter(key, f"{gap:.4g} m (or rad) off at the start", f"at most {_CLOSED:g} off")
