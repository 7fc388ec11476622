"""The base of all couplings of a station: what a section ``couplings`` says of itself, and which solvers hold it."""

from abc import ABC, abstractmethod
from typing import ClassVar, Protocol

from pydrake.systems.framework import Context, DiagramBuilder

from simrob_drake.errors import InvalidParameter
from simrob_drake.parts.site import Site, StationPlant, Surroundings
from simrob_drake.sections import Strict

# Stiffness of a coupling that is a spring, by the inertia that it holds [1/s²], and the time by which its damper
# follows from the stiffness [s].
STIFFNESS = 2000.0**2
RELAXES = 2e-4
_CLOSED = 1e-3  # how far apart at the start what is held together may be [m or rad]


class SolverDescription(Protocol):
    """The solver of a station, as far as couplings must know it."""

    @property
    def mode(self) -> str:
        """``dynamic`` or ``kinematic``."""

    @property
    def scheme(self) -> str:
        """Name of the scheme, such as ``cenic``; empty in a kinematic station."""

    @property
    def time_step(self) -> float:
        """Step of a discrete solver [s]; 0 for other solvers."""


class CouplingSection(Strict, ABC):
    """A section of ``couplings``."""

    constrains: ClassVar[bool] = True  # whether it is a constraint, or so stiff a spring that it counts as one
    schemes: ClassVar[tuple[str, ...]] = ("radau3", "radau1", "implicit_euler", "velocity_implicit_euler")
    """Continuous schemes that hold it."""
    engines: ClassVar[tuple[str, ...]] = ()
    """Other engines than Drake's plant that hold it."""
    guides_references: ClassVar[bool] = False
    """Whether references obey the coupling, so that a kinematic station can have it, too."""
    words: ClassVar[str]  # what it is, with its own figures
    kind: str

    @abstractmethod
    def add(self, plant: StationPlant) -> None:
        """Add it to a plant that is not finalized."""

    def caption(self) -> str:
        """The coupling in words."""
        return self.words.format(it=self)

    def check(self, key: str, station: Surroundings) -> None:
        """Check that the station can have the coupling: its mode, its solver, and the names of axes and bodies.

        Args:
            key: of the coupling in the station, such as ``couplings.mesh``.
            station: in which it is.

        Raises:
            SimrobError: the station cannot have it; the message names the key.
        """
        if station.mode == "kinematic" and not self.guides_references:
            value = f"a coupling of kind {self.kind} in a kinematic station"
            raise InvalidParameter(key, value, "left out: the reference moves all joints, and no force acts")
        if not self.is_held(station):
            expected = f"{'radau3, or ' if self.schemes else ''}kind: discrete with scheme: sap, which hold {key}"
            raise InvalidParameter("solver", station.scheme, expected)

    def is_held(self, station: SolverDescription) -> bool:
        """Whether the solver of a station holds this coupling."""
        if station.mode == "kinematic" or not self.constrains:
            return True
        if station.scheme == "mujoco":
            return "mujoco" in self.engines
        return station.time_step > 0 or station.scheme in self.schemes

    def add_forces(self, builder: DiagramBuilder, site: Site, key: str) -> None:
        """Add the forces that hold the coupling where the plant has no constraint for it; most couplings add none."""

    def gap(self, plant: StationPlant, context: Context) -> float:
        """Distance of the parts that the coupling holds together, in a context [m or rad]; 0 if it leaves them free."""
        return 0.0

    def check_start(self, key: str, plant: StationPlant, context: Context) -> None:
        """Check that the station starts in a posture that it allows; raises InvalidParameter: it does not."""
        if (gap := self.gap(plant, context)) > _CLOSED:
            raise InvalidParameter(key, f"{gap:.4g} m (or rad) off at the start", f"at most {_CLOSED:g} off")
