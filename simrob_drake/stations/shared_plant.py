"""A plant of the user's own in which stations stand: a record of what they have added, and checks whether one suits it.

A plant has one gravity, one time step and one contact model, and a simulation has one solver. A station that needs
others is refused, with the call that would make the plant suit it. *Contact points* are small balls at the corners and
edges of flat bodies, which touch other shapes in place of the flat shapes themselves.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from weakref import WeakKeyDictionary

import numpy as np
from pydrake.geometry import GeometryId, Role, SceneGraph
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import DiagramBuilder, System

from simrob_drake.base.arguments import instance
from simrob_drake.base.errors import SimrobError
from simrob_drake.base.messages import message
from simrob_drake.parts.targets import FLOOR
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.contact_points import ContactPoints, filter_contact_points
from simrob_drake.stations.plant import check_steps_plant
from simrob_drake.stations.resolve import ResolvedStation

_SAME_GRAVITY = 1e-9  # components of two gravities that differ by less are equal [m/s²]

_CONTACT_MODELS = {
    "point": "kPoint",
    "hydroelastic": "kHydroelastic",
    "hydroelastic_with_fallback": "kHydroelasticWithFallback",
}
"""Names in Drake's enumeration `ContactModel`, by the station's word."""

_APPROXIMATIONS = {"sap": "kSap", "lagged": "kLagged", "similar": "kSimilar"}
"""Names in Drake's enumeration `DiscreteContactApproximation`, by the scheme of a discrete solver."""


@dataclass
class SharedPlant:
    """Record of the stations in a plant that the user makes.

    Attributes:
        stations: the stations by their names in the plant; the name may be empty.
        points: contact points of each station, which may be empty.
        floor: station whose floor is the floor of all; None if there is no floor yet.
        replaced_pairs: pairs of shapes whose contact points touch in their place; None until the plant is finalized
            and collision filters are set.
    """

    stations: dict[str, ResolvedStation] = field(default_factory=dict)
    points: list[ContactPoints] = field(default_factory=list)
    floor: ResolvedStation | None = None
    replaced_pairs: tuple[tuple[GeometryId, GeometryId], ...] | None = None

    def needs_floor(self, station: ResolvedStation) -> bool:
        """Whether a station must add its floor: it has one, and no other station has added it."""
        return station.config.floor is not None and self.floor is None

    def add(self, name: str, station: ResolvedStation, points: ContactPoints) -> None:
        """Record a station that has been added to the plant under a name, with its contact points."""
        self.stations[name] = station
        self.points.append(points)
        # The floor stays that of the first station with one; `_check_floor` compares the others.
        if self.needs_floor(station):
            self.floor = station

    def filter_contact_points(
        self, scene_graph: SceneGraph
    ) -> tuple[tuple[GeometryId, GeometryId], ...]:
        """Set the collision filters of the contact points of all stations, once, after the plant is finalized.

        Args:
            scene_graph: the scene graph of the plant.

        Returns:
            the pairs of shapes that contact points replace.
        """
        if self.replaced_pairs is None:
            # Contact points of one station meet those of the others, so that all are filtered together.
            together = ContactPoints(
                corners=[ball for points in self.points for ball in points.corners],
                edges=[ball for points in self.points for ball in points.edges],
                polyhedra=[shape for points in self.points for shape in points.polyhedra],
            )
            self.replaced_pairs = tuple(filter_contact_points(scene_graph, together))
        return self.replaced_pairs


# The values hold no plant, so that a plant is freed with its diagram.
_SHARED_PLANTS: WeakKeyDictionary[MultibodyPlant, SharedPlant] = WeakKeyDictionary()


def shared_plant(plant: MultibodyPlant) -> SharedPlant:
    """Find the record of the stations in a plant of the user's own. It is made at the first call for a plant."""
    return _SHARED_PLANTS.setdefault(plant, SharedPlant())


def check_plant(
    plant: object,
    scene_graph: object,
    station: ResolvedStation,
    name: str,
) -> None:
    """Check that a station can be added to a plant of the user's own.

    Args:
        plant: the plant.
        scene_graph: the scene graph of the plant.
        station: the station.
        name: name of the station in the plant; it may be empty.

    Raises:
        InvalidParameter: an argument is no plant, or no scene graph.
        SimrobError: the plant is finalized, has another scene graph, or has other settings than the station; the
            station does not step a plant of Drake; its name is taken, or it differs from a station that is already in
            the plant in the solver, the contact or the floor.
    """
    instance(
        plant,
        "plant",
        MultibodyPlant,
        message("stations.drakes_plant", "a MultibodyPlant of Drake"),
    )
    instance(
        scene_graph,
        "scene_graph",
        SceneGraph,
        message("stations.drakes_scene_graph", "a SceneGraph of Drake"),
    )
    assert isinstance(plant, MultibodyPlant)
    assert isinstance(scene_graph, SceneGraph)
    config = station.config
    # Drake refuses bodies after that with an error that does not name the station.
    if plant.is_finalized():
        raise SimrobError(
            message(
                "stations.plant_finalized",
                "the plant is finalized already, so that {station} cannot be added; call plant.Finalize() after all "
                "stations are added",
                station=config.name,
            )
        )
    if not is_scene_graph_of(plant, scene_graph):
        raise SimrobError(
            message(
                "stations.other_scene_graph",
                "the plant is not registered with this scene graph; give the one that "
                "AddMultibodyPlantSceneGraph(builder, ...) returned together with the plant",
            )
        )
    check_steps_plant(config)
    _check_settings(plant, config)
    contents = shared_plant(plant)
    if name in contents.stations:
        raise SimrobError(
            message(
                "stations.name_in_plant",
                "the plant already has a station named {name}; give this one another name, as in "
                'place_station(plant, station, scene_graph=scene_graph, name="{example}")',
                name=repr(name),
                example=f"{name}_2" if name else "second",
            )
        )
    # One plant is stepped by one solver, so that all stations in it must agree.
    for other in contents.stations.values():
        _check_same_solver(config, other.config)
    _check_floor(contents, station, scene_graph)


def is_scene_graph_of(plant: MultibodyPlant, scene_graph: SceneGraph) -> bool:
    """Whether a plant is registered with a scene graph."""
    source = plant.get_source_id()
    # A plant that was never registered has no source.
    return source is not None and bool(scene_graph.model_inspector().SourceIsRegistered(source))


def scene_graph_in(builder: DiagramBuilder, plant: MultibodyPlant) -> SceneGraph:
    """Find the scene graph of a plant among the systems of a builder.

    Raises:
        SimrobError: there is none.
    """
    for system in builder.GetSystems():
        if isinstance(system, SceneGraph) and is_scene_graph_of(plant, system):
            return system
    raise SimrobError(
        message(
            "stations.no_scene_graph",
            "the builder has no scene graph of the plant; make both with AddMultibodyPlantSceneGraph(builder, ...)",
        )
    )


def check_builder(builder: DiagramBuilder, systems: Sequence[System]) -> None:
    """Check that a plant and its scene graph are systems of a builder.

    Raises:
        SimrobError: a system belongs to another builder.
    """
    known = builder.GetSystems()
    for system in systems:
        # By identity: Drake's systems are not compared otherwise.
        if not any(system is each for each in known):
            raise SimrobError(
                message(
                    "stations.other_builder",
                    "the {system} is not in this builder; give the builder in which "
                    "AddMultibodyPlantSceneGraph(builder, ...) put the plant",
                    system=type(system).__name__,
                )
            )


def _check_settings(plant: MultibodyPlant, config: StationConfig) -> None:
    """Check that a plant has the settings of a station, which must be one that Drake's plant simulates.

    They are the time step, the gravity, the contact model if the station has contact and, if its solver is discrete,
    the approximation of contact.

    Raises:
        SimrobError: a setting differs; the message has the call that sets it.
    """
    time_step = config.engine.time_step
    # Exactly equal: a simulation with another step gives other results.
    if plant.time_step() != time_step:
        raise SimrobError(
            message(
                "stations.other_time_step",
                "the time step of the plant is {plant:g} s, and {station} needs {needed:g} s; make the plant with "
                "AddMultibodyPlantSceneGraph(builder, time_step={needed:g}), or change `solver` of the station",
                plant=plant.time_step(),
                station=config.name,
                needed=time_step,
            )
        )
    gravity = np.array([0.0, 0.0, -config.gravity])
    found = plant.gravity_field().gravity_vector()
    if not np.allclose(found, gravity, rtol=0.0, atol=_SAME_GRAVITY):
        raise SimrobError(
            message(
                "stations.other_gravity",
                "the gravity of the plant is {plant} m/s², and that of {station} is [0, 0, {needed}]; "
                "call plant.mutable_gravity_field().set_gravity_vector([0, 0, {needed}]), or change `gravity` of the "
                "station",
                plant=np.array2string(found, separator=", "),
                station=config.name,
                needed=-config.gravity,
            )
        )
    # A station without contact has no shapes that could touch, so any contact model suits it.
    if (
        config.contact is not None
        and plant.get_contact_model().name != _CONTACT_MODELS[config.contact.model]
    ):
        raise SimrobError(
            message(
                "stations.other_contact_model",
                "the contact model of the plant is {plant}, and {station} needs {needed}; call "
                "plant.set_contact_model(ContactModel.{needed}), or change `contact.model` of the station",
                plant=plant.get_contact_model().name,
                station=config.name,
                needed=_CONTACT_MODELS[config.contact.model],
            )
        )
    # A plant in continuous time has no approximation of contacts.
    if not config.engine.has_discrete_states:
        return
    needed = _APPROXIMATIONS[config.engine.name]
    if plant.get_discrete_contact_approximation().name != needed:
        raise SimrobError(
            message(
                "stations.other_approximation",
                "the contact approximation of the plant is {plant}, and {station} needs {needed}; call "
                "plant.set_discrete_contact_approximation(DiscreteContactApproximation.{needed}), or change "
                "`solver.scheme` of the station",
                plant=plant.get_discrete_contact_approximation().name,
                station=config.name,
                needed=needed,
            )
        )


def _check_same_solver(config: StationConfig, other: StationConfig) -> None:
    """Check that two stations in one plant agree on what they share: the solver, and how surfaces touch.

    Contact is compared only if both stations have it.

    Raises:
        SimrobError: they differ; the message names the key.
    """
    # The values of this station and of the other one, by the key that users see.
    shared: dict[str, tuple[object, object]] = {"solver": (config.engine, other.engine)}
    if config.contact is not None and other.contact is not None:
        shared["contact.model"] = (config.contact.model, other.contact.model)
        shared["contact.stiction_speed"] = (
            config.contact.stiction_speed,
            other.contact.stiction_speed,
        )
    for key, (own, others) in shared.items():
        if own != others:
            raise SimrobError(
                message(
                    "stations.other_settings",
                    "{key} of {station} differs from that of {other}, which is in the same plant; make them equal",
                    key=key,
                    station=config.name,
                    other=other.name,
                )
            )


def _check_floor(
    contents: SharedPlant,
    station: ResolvedStation,
    scene_graph: SceneGraph,
) -> None:
    """Check that the floor of a station, if it has one, can be the floor of the plant.

    Args:
        contents: record of the stations that are in the plant.
        station: the station that is to be added.
        scene_graph: the scene graph of the plant.

    Raises:
        SimrobError: the station whose floor is in the plant has another floor or another material of contact, or the
            user has added a shape that is named ``floor``.
    """
    config = station.config
    if config.floor is None:
        return
    first = contents.floor
    if first is None:
        inspector = scene_graph.model_inspector()
        shapes = [
            *inspector.GetAllGeometryIds(Role.kProximity),
            *inspector.GetAllGeometryIds(Role.kIllustration),
        ]
        # Parts find the floor by this name, and would take the user's shape for it.
        if FLOOR in [inspector.GetName(shape) for shape in shapes]:
            raise SimrobError(
                message(
                    "stations.floor_of_user",
                    "the plant already has a shape named floor; give {station} no floor (overrides={{'floor': None}}), "
                    "or the shape another name",
                    station=config.name,
                )
            )
        return
    if _floor_of(config) != _floor_of(first.config):
        raise SimrobError(
            message(
                "stations.other_floor",
                "floor or contact of {station} differs from that of {other}, whose floor is in the plant already; give "
                "both the same, or {station} no floor (overrides={{'floor': None}})",
                station=config.name,
                other=first.config.name,
            )
        )


def _floor_of(config: StationConfig) -> tuple[object, object]:
    """Describe the floor of a station as far as stations in one plant must agree on it.

    Returns:
        the section ``floor``, without the size of an even floor, which is only what pictures show of a plane; and the
        material of the section ``contact``, or None without it.
    """
    floor = config.floor
    assert floor is not None
    if floor.terrain is None:
        # Contact is with a half-space: an even floor of any size is the same.
        floor = floor.model_copy(update={"size": 1.0})
    material = None
    if config.contact is not None:
        # These two keys do not describe surfaces.
        material = config.contact.model_dump(exclude={"corners", "self_collision"})
    return floor, material
