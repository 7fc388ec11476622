"""The diagrams of a station: built when they are needed, and used again for other references and pushes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from pydrake.systems.framework import Diagram, DiagramBuilder, LeafSystem
from pydrake.systems.primitives import TrajectorySource
from pydrake.trajectories import Trajectory

from simrob_drake.blocks.references import Course, ReferenceSource, SineCourse, corner_times
from simrob_drake.errors import SimrobError
from simrob_drake.lifetime import built
from simrob_drake.parts.controllers.own import DRIVABLE, driven_inputs
from simrob_drake.parts.forces import ForceConfig
from simrob_drake.parts.forces.push import Push
from simrob_drake.stations.closed import add_closed_station
from simrob_drake.stations.ports import StationPorts
from simrob_drake.stations.resolve import ResolvedStation


@dataclass(frozen=True)
class Built:
    """A diagram that holds a station whose inputs all have sources.

    Attributes:
        diagram: that is run.
        ports: of the station.
        sources: of the references that are played, by robot.
    """

    diagram: Diagram
    ports: StationPorts
    sources: Mapping[str, ReferenceSource]

    def play(self, courses: Mapping[str, Course], forces: Mapping[str, ForceConfig]) -> None:
        """Let the sources give other references and pushes."""
        for robot, source in self.sources.items():
            course = courses[robot]
            if source.player is not None and isinstance(course, Trajectory):
                source.player.UpdateTrajectory(course)
        for name, force in forces.items():
            place = f"force.{name}.source"
            if isinstance(force, Push) and self.diagram.HasSubsystemNamed(place):
                source = self.diagram.GetSubsystemByName(place)
                assert isinstance(source, TrajectorySource)
                source.UpdateTrajectory(force.course())


class StationDiagrams:
    """The diagrams of a station of given robots, pieces, parts and places of forces.

    Several, because what nothing reads still costs a solver time: one with everything, in which signals are evaluated
    after a run, and leaner ones to be stepped, without monitors, without sensors that only report and, under ``cenic``,
    without the forces of pushes while nothing pushes. A user's own block stands in one diagram only, so with any there
    is just the first. All have the same states in the same order.
    """

    def __init__(
        self, station: ResolvedStation, courses: Mapping[str, Course], blocks: Mapping[str, LeafSystem]
    ) -> None:
        """Prepare the diagrams; they are built when they are needed.

        Args:
            station: resolved.
            courses: what each robot is asked.
            blocks: the station's controllers and other blocks of the user's own, by name.
        """
        self._station, self._blocks = station, blocks
        self.courses, self.forces = dict(courses), dict(station.config.forces)

    def fits(self, courses: Mapping[str, Course]) -> bool:
        """Tell whether these references can be played: those that are sines stay as they are."""
        return all(_same_kind(self.courses[robot], course) for robot, course in courses.items())

    def play(self, courses: Mapping[str, Course], forces: Mapping[str, ForceConfig]) -> None:
        """Let all diagrams give other references, and other pushes at the same places."""
        self.courses, self.forces = dict(courses), dict(forces)
        for name in ("whole", "_lean", "_unpushed"):
            if name in self.__dict__:
                self.__dict__[name].play(courses, forces)

    @property
    def edges(self) -> list[float]:
        """Times at which a step must end: corners of references, edges of pushes [s]."""
        driven = driven_inputs(self._blocks)
        robots = self._station.robots.values()
        asked = [self.courses[robot.name] for robot in robots if f"{robot.prefix}reference" not in driven]
        corners = {time for course in asked for time in corner_times(course)}
        return sorted(corners | {edge for force in self.forces.values() for edge in force.edges})

    def stepped(self, time: float) -> Built:
        """Return the diagram to be stepped from a time on [s], up to the next edge."""
        if self._blocks:
            return self.whole
        pushes = [force for force in self.forces.values() if isinstance(force, Push)]
        only_pushes = self._station.scheme == "cenic" and pushes and len(pushes) == len(self.forces)
        if only_pushes and not any(push.edges[0] <= time < push.edges[1] for push in pushes):
            return self._unpushed
        return self._lean

    @cached_property
    def whole(self) -> Built:
        """The diagram with everything but monitors."""
        return self._built(sensors=list(self._station.sensors))

    @cached_property
    def _lean(self) -> Built:
        """The diagram without sensors that only report."""
        return self.whole if len(self._stepped_sensors) == len(self._station.sensors) else self._built()

    @cached_property
    def _unpushed(self) -> Built:
        """The diagram without forces, too."""
        return self._built(forces=False)

    @property
    def _stepped_sensors(self) -> list[str]:
        return [name for name, sensor in self._station.sensors.items() if sensor.stepped]

    def _built(self, *, sensors: list[str] | None = None, forces: bool = True) -> Built:
        builder = DiagramBuilder()
        kept = self._stepped_sensors if sensors is None else sensors
        closed = add_closed_station(
            builder,
            self._station,
            self.courses,
            sensors=kept,
            forces=forces,
            monitors=False,
            blocks=self._blocks,
        )
        try:
            diagram = built(builder)
        except RuntimeError as problem:
            if not self._blocks:
                raise
            used = "been built into a different Diagram" in str(problem)
            told = "a block serves one diagram; make it anew" if used else "signals must not go around in a circle"
            raise SimrobError(
                f"the blocks {', '.join(self._blocks)} cannot be wired so; {told} ({problem})"
            ) from problem
        return Built(diagram, closed.ports, closed.sources)


def needed_inputs(blocks: Mapping[str, LeafSystem]) -> list[str]:
    """Return the inputs of robots that blocks drive, and that a station has only where they are asked for."""
    names = {output.rpartition(".")[2] for output in driven_inputs(blocks)}
    return [name for name in DRIVABLE if name in names and name not in ("reference", "reference_acceleration")]


def _same_kind(old: Course, new: Course) -> bool:
    if isinstance(old, SineCourse) or isinstance(new, SineCourse):
        return (
            isinstance(old, SineCourse)
            and isinstance(new, SineCourse)
            and old.frequency == new.frequency
            and all(np.array_equal(getattr(old, key), getattr(new, key)) for key in ("centre", "amplitude", "phase"))
        )
    return True
