"""The site: a station under construction, as its parts see it while they are wired.

A *part* of a station is a sensor, a monitor, a controller, a force and so on. Its method ``wire`` gets the site. There
it finds the plant and the outputs of other parts, connects its blocks to the station's inputs, and declares its own
outputs.
"""

import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib import import_module
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from pydrake.systems.framework import DiagramBuilder, InputPort, LeafSystem, OutputPort

from simrob_drake.base.messages import message
from simrob_drake.parts.inputs import InputPorts
from simrob_drake.parts.outputs import OutputRegistry
from simrob_drake.parts.picture import PictureLabels
from simrob_drake.parts.resolved import StationContents, name_or_only
from simrob_drake.parts.station_plant import StationPlant, StationRobot


@dataclass(frozen=True, kw_only=True)
class Site:
    """A station under construction, for the parts that are added to it.

    Names of inputs and outputs begin with ``<robot>.`` if the station has several robots.

    Attributes:
        station: contents of the station.
        plant: its multibody plant, scene graph and robots.
        state: positions and velocities of the whole plant, size nq + nv.
        outputs: the registry in which parts declare their outputs, and a mapping of names to output ports.
        picture: the labels of the block picture.
        inputs: input ports by name: ``reference`` (n), and what the station lists under ``inputs``. A part that drives
            an input connects its output to the port, and puts a new port in its place if others can still add to it.
        edges: times at which a run must end a step: corners of references, edges of pushes [s].
        spatial_forces: ports of forces on bodies from outside. They are gathered into one port of the plant at the end,
            since an input of a Drake system can only be connected once.
        generalized_forces: ports of forces on joints in addition to their motors, gathered in the same way.
        blocks: controllers and other blocks of the user's own, by name.
    """

    station: StationContents
    plant: StationPlant
    state: OutputPort
    outputs: OutputRegistry
    picture: PictureLabels = field(default_factory=PictureLabels)
    inputs: dict[str, InputPort] = field(default_factory=InputPorts)
    edges: list[float] = field(default_factory=list)
    spatial_forces: list[OutputPort] = field(default_factory=list)
    generalized_forces: list[OutputPort] = field(default_factory=list)
    blocks: dict[str, LeafSystem] = field(default_factory=dict)

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {', '.join(self.inputs) or 'nothing'} → {', '.join(self.outputs)}>"

    def port(self, builder: DiagramBuilder, output: str) -> OutputPort:
        """Port of an output of the station, for a block to read.

        Args:
            builder: builder of the diagram. The block that gives the output joins it if it has not yet.
            output: name of the output.

        Raises:
            KeyError: there is no such output.
        """
        return self.outputs.port(builder, output)

    def robot(self, name: str | None) -> StationRobot:
        """Find a robot of the station by its name. None means the only one.

        Raises:
            UnknownName: there is no such robot.
            InvalidParameter: the name is None, and there are several robots, or none.
        """
        # Sections have been checked, so the default words of the error do not matter.
        return self.plant.robots[name_or_only(name, list(self.plant.robots))]

    if not TYPE_CHECKING:  # the type checker must not accept the former names

        def __getattr__(self, name: str) -> Any:
            """Value of an attribute that `outputs` or `picture` has now, with a DeprecationWarning. Until 0.2."""
            # Python only calls this for names that the class and the object do not have.
            owner = _FORMER_ATTRIBUTES.get(name)
            if owner is None:
                raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")
            # The level of the warning counts the functions from `_warn` up, so `_warn` must be called from here.
            _warn(
                message(
                    "parts.site_renamed",
                    "Site.{name} is now Site.{owner}.{name}",
                    name=name,
                    owner=owner,
                )
            )
            return getattr(getattr(self, owner), name)


_FORMER_ATTRIBUTES: Mapping[str, str] = MappingProxyType(
    dict.fromkeys(
        (
            "add",
            "add_report",
            "from_state",
            "value",
            "of_state",
            "images",
            "later",
            "signals",
            "monitors",
            "notes",
        ),
        "outputs",
    )
    | dict.fromkeys(("draw", "draw_nothing", "drawn"), "picture")
)
"""Former attributes of a `Site`, and its attribute that has them now. Until 0.2."""

_FORMER_NAMES: Mapping[str, str] = MappingProxyType(
    dict.fromkeys(("WORLD", "ResolvedPiece", "ResolvedRobot"), "resolved")
    | {"FromState": "outputs"}
)
"""Names that this module had, and the module of the same package that has them now. Until 0.2."""


def _warn(renaming: str) -> None:
    """Warn the code that used a former name, two callers above this function."""
    # Level 1 is this function, 2 the lookup of the former name, 3 the code that used it.
    warnings.warn(
        message(
            "parts.former_name_goes",
            "{renaming}; version 0.2 removes the former name",
            renaming=renaming,
        ),
        DeprecationWarning,
        stacklevel=3,
    )


if not TYPE_CHECKING:

    def __getattr__(name: str) -> Any:
        """Find a name that has moved to another module, with a warning. Until 0.2."""
        module = _FORMER_NAMES.get(name)
        if module is None:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        _warn(
            message(
                "parts.moved_to_module",
                "{module}.{name} is now simrob_drake.parts.{new_module}.{name}",
                module=__name__,
                name=name,
                new_module=module,
            )
        )
        return getattr(import_module(f"simrob_drake.parts.{module}"), name)
