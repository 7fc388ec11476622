"""The base class of all couplings of a station, with the checks of which solvers hold a coupling.

A station is a closed diagram of robots, pieces and controllers, described by a file. A coupling holds two of its bodies
or axes together in addition to their joints, such as a gear. A solver holds a coupling if it can simulate the
constraint, or the stiff spring in its place. The types of a station in this module:

- `StationContents` describes the station before anything is built.
- `StationPlant` is its multibody plant, with the robots in it.
- `Site` is the station under construction: the plant, and the ports that its blocks have added so far.
"""

from abc import ABC, abstractmethod
from typing import ClassVar

from pydrake.systems.framework import Context, DiagramBuilder

from simrob_drake.base.errors import InvalidParameter, Unsuitable
from simrob_drake.base.messages import compound, message
from simrob_drake.base.sections import Strict
from simrob_drake.parts.engine import Engine
from simrob_drake.parts.resolved import StationContents
from simrob_drake.parts.site import Site
from simrob_drake.parts.station_plant import StationPlant

STIFFNESS_PER_INERTIA = 2000.0**2
"""Stiffness of a coupling for each unit of the mass or inertia that it holds [1/s²].

Under continuous schemes a coupling is a spring and a damper, and the parts that it holds vibrate at the square root of
this value: 2000 rad/s."""
DAMPING_TIME = 2e-4
"""Ratio of a coupling's damping to its stiffness [s]. With the frequency 2000 rad/s the damping ratio is 0.2."""
# A larger gap at the start is a mistake in the station. A smaller one comes from a rounded pose, and closes by itself
# [m or rad].
_LARGEST_GAP_AT_START = 1e-3


class CouplingSection(Strict, ABC):
    """A section of ``couplings``: the base class of all couplings."""

    constrains: ClassVar[bool] = True
    """Whether the coupling is a constraint, or a spring that is stiff enough to count as one. Such a coupling needs a
    solver that can hold it; a soft spring needs none."""
    has_springs: ClassVar[bool] = True
    """Whether stiff springs can hold the coupling where the engine has no constraint for it."""
    guides_references: ClassVar[bool] = False
    """Whether references obey the coupling, so that a kinematic station can have it, too."""
    words: ClassVar[str] = ""
    """Template of the caption, unless the kind has a method `caption` of its own. The coupling is named ``it`` there,
    so "{it.length:g}" is its field `length`."""
    kind: str

    @abstractmethod
    def add(self, plant: StationPlant) -> None:
        """Add the coupling to a plant that is not finalized, as a constraint or as force elements."""

    def caption(self) -> str:
        """Describe the coupling in words."""
        return self.words.format(it=self)

    def check(self, key: str, station: StationContents) -> None:
        """Check that the coupling fits the station: here that a solver, or the references, can hold it.

        The kinds of couplings add the checks of their axes and bodies.

        Args:
            key: key of the coupling in the station, such as ``couplings.mesh``.
            station: the station with the coupling.

        Raises:
            SimrobError: the station is kinematic and its references do not obey the coupling, or its solver cannot hold
                the coupling; the message names the key.
        """
        # In a kinematic station only the references can hold a coupling.
        if not station.engine.moves_by_forces and not self.guides_references:
            raise Unsuitable(
                key,
                message(
                    "parts.kinematic_coupling",
                    "the reference of a kinematic station moves all joints, and no force acts",
                ),
            )
        if not self.is_held(station.engine):
            # Stiff springs need an implicit integrator, or its steps are tiny.
            continuous = message("parts.radau_or", "radau3, or ") if self.has_springs else ""
            expected = message(
                "parts.discrete_sap",
                "{continuous}kind: discrete with scheme: sap, which can simulate {key}",
                continuous=continuous,
                key=key,
            )
            raise InvalidParameter("solver", station.engine.name, expected)

    def is_held(self, engine: Engine) -> bool:
        """Whether the engine (solver) of a station can hold this coupling, by a constraint or by stiff springs.

        It is True, too, for a soft spring, which holds nothing together. In a kinematic station, where no engine holds
        anything, it is always True; `check` finds couplings that references do not obey.
        """
        # A coupling that is no constraint is a soft spring, which needs no solver that holds constraints. Engines
        # without such springs are refused when the station is resolved.
        if not engine.moves_by_forces or not self.constrains:
            return True
        is_held_by_springs = self.has_springs and engine.holds_stiff_springs
        return is_held_by_springs or self.is_constrained(engine)

    def is_constrained(self, engine: Engine) -> bool:
        """Whether the engine of a station has a constraint for this coupling."""
        return engine.constrains_bodies

    def add_forces(self, builder: DiagramBuilder, site: Site, key: str) -> None:
        """Add the forces that hold the coupling if the plant has no constraint for it: by default, no forces.

        Args:
            builder: builder of the station's diagram.
            site: the station under construction, to which the forces' port is added.
            key: key of the coupling in the station, which begins the names of the added blocks.
        """

    def gap(self, plant: StationPlant, context: Context) -> float:
        """Compute the gap between the parts that the coupling holds together, in a context of the plant [m or rad].

        It is not negative. A coupling that holds nothing together, such as a spring, has the gap 0.
        """
        return 0.0

    def check_start(self, key: str, plant: StationPlant, context: Context) -> None:
        """Check that the station starts in a posture that the coupling allows.

        Args:
            key: key of the coupling in the station, for the error message.
            plant: plant of the station.
            context: context of the plant at the start.

        Raises:
            InvalidParameter: the gap of the coupling at the start is more than a rounded pose explains (1 mm, 1 mrad).
        """
        # A constraint that is violated at the start would be closed within one step, by an enormous force.
        gap = self.gap(plant, context)
        if gap > _LARGEST_GAP_AT_START:
            raise InvalidParameter(
                message("parts.gap_at_start", "the gap of {key} at the start [m or rad]", key=key),
                compound("{gap:.4g}", gap=gap),
                message("parts.largest_gap", "at most {gap:g}", gap=_LARGEST_GAP_AT_START),
            )
