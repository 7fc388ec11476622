"""What the kinds of force share: where they act, and the blocks that apply them."""

import numpy as np
from pydrake.multibody.tree import Frame
from pydrake.systems.framework import DiagramBuilder, LeafSystem, OutputPort

from simrob_drake.blocks.external_force import add_external_force
from simrob_drake.errors import InvalidParameter, UnknownName
from simrob_drake.frames import Vector
from simrob_drake.parts.site import Site, StationPlant, Surroundings, named
from simrob_drake.parts.targets import frame_names, frame_of
from simrob_drake.sections import Strict
from simrob_drake.signals import applied_signal


class ForceSection(Strict):
    """A section of ``forces``: a force on a body over time.

    A kind has its key ``kind``, its ``edges``, and the methods ``source()``, which gives a block whose first output is
    the force, or what :meth:`shaped` makes one of, and ``caption()``, which tells it in words.
    """

    at: str | None = None
    """Where it acts: a robot (at the centre of mass of its root link, along that link's axes), or a tool, link or piece
    (at its origin, along its axes). The only robot unless given: its tool, or its root link if it floats."""

    @property
    def offset(self) -> Vector:
        """Where it acts beside that, along those axes, shape (3,) [m]."""
        return np.zeros(3)

    def shaped(
        self, builder: DiagramBuilder, site: Site, name: str, frame: Frame, point: Vector, force: OutputPort
    ) -> OutputPort:
        """Return the force (3) [N] at a point (3,) [m] of a frame, along its axes, made of what the source gives."""
        return force

    def check(self, key: str, station: Surroundings) -> None:
        """Check that forces count in the station, and that there is what it acts on."""
        if station.mode == "kinematic":
            raise InvalidParameter(key, "a force in a kinematic station", "left out: it knows no forces")
        known = [*station.robots, *(name for name in frame_names(station) if name != "world")]
        if self.at is not None and self.at not in known:
            raise UnknownName(f"robot, tool, link or piece for {key}.at", self.at, known)
        self.place_name(key, station)

    def place_name(self, key: str, station: Surroundings) -> str:
        """Return the name of what it acts on."""
        if self.at is not None:
            return self.at
        robot = station.robots[named(None, list(station.robots), key=f"{key}.at")]
        return robot.name if robot.floats or not robot.tcp else f"{robot.prefix}{robot.tcp}"


def add_force(
    builder: DiagramBuilder, site: Site, name: str, section: ForceSection, source: LeafSystem, caption: str
) -> None:
    """Apply a force (3) [N] that a source gives, and that is ``caption`` in words; ``applied_force.<name>`` shows it.

    The ports of the blocks that apply it are gathered in the site, for the plant.
    """
    place = section.place_name(f"forces.{name}", site.station)
    frame, point = place_of(site.plant, place)
    output_port = builder.AddNamedSystem(f"force.{name}.source", source).get_output_port(0)
    point = point + section.offset
    force = section.shaped(builder, site, f"force.{name}", frame, point, output_port)
    block = add_external_force(builder, site.plant.stepped, frame, name=f"force.{name}", point=point)
    builder.Connect(force, block.get_command_input_port())
    label = f"Force '{name}'\n{caption}\nat {place}"
    for system in (f"force.{name}", f"force.{name}.source"):
        site.draw(system, "force", label, key=f"force.{name}")
    site.spatial_forces.append(block.get_spatial_forces_output_port())
    output = f"applied_force.{name}"
    title = f"applied force '{name}' at {place}, in its axes"
    site.add(output, force, applied_signal(output, "N", title, part=name))


def place_of(plant: StationPlant, place: str) -> tuple[Frame, Vector]:
    """Return the frame in which a force is given, and the point (3,) [m] in it where it acts."""
    if place in plant.robots:
        root = plant.robots[place].root
        return root, np.asarray(root.GetFixedPoseInBodyFrame().inverse() @ root.body().default_com())
    return frame_of(plant, place), np.zeros(3)
