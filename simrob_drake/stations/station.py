"""Compose a station: plant, servos, poses, sensors, forces, controllers, monitors.

A *station* is given by its configuration; *resolved*, it also has the robots and pieces that the configuration names.
To *wire* a station means to add its systems to a diagram and to connect them. Its *ports* are its inputs and outputs by
name. *Loops* are controllers around the servos that the package offers, *signal flows* are controllers that are written
as nets of blocks, and *own blocks* are systems that the user has written.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeAlias

from pydrake.geometry import SceneGraph
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import ExternallyAppliedSpatialForceMultiplexer, MultibodyPlant
from pydrake.systems.framework import Diagram, DiagramBuilder, InputPort, LeafSystem, OutputPort

from simrob_drake.base.arguments import drake_asserts, instance
from simrob_drake.base.errors import InvalidParameter, SimrobError, quote_value
from simrob_drake.base.lifetime import release
from simrob_drake.base.messages import message
from simrob_drake.base.renaming import former_argument
from simrob_drake.blocks.block import add_and_connect, add_sum
from simrob_drake.blocks.monitor import EventTimes, Trigger
from simrob_drake.parts.controllers import flows_of, loops_of, own_blocks
from simrob_drake.parts.controllers.loop import add_loops
from simrob_drake.parts.controllers.own import add_own_blocks, wire_own_blocks, with_driven
from simrob_drake.parts.forces import add_force
from simrob_drake.parts.inputs import InputPorts
from simrob_drake.parts.monitors.monitor import add_monitor
from simrob_drake.parts.outputs import OutputRegistry
from simrob_drake.parts.station_plant import StationPlant
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.dynamic import (
    add_dynamic_robots,
    add_kinematic_robots,
    add_motion_inputs,
    check_servo_steps,
)
from simrob_drake.stations.load import load_station, with_settings
from simrob_drake.stations.plant import (
    BuilderHook,
    ParserHook,
    PlantHooks,
    StationModels,
    add_empty_plant,
    add_models,
    add_plant,
    check_steps_plant,
    complete_plant,
)
from simrob_drake.stations.ports import StationPorts, draw_plant
from simrob_drake.stations.poses import add_free_pieces, add_poses
from simrob_drake.stations.resolve import ResolvedStation, resolve
from simrob_drake.stations.shared_plant import (
    check_builder,
    check_plant,
    scene_graph_in,
    shared_plant,
)


def config_of(station: StationLike, overrides: Mapping[str, Any] | None = None) -> StationConfig:
    """Find the configuration of a station, in whatever form a user gives the station.

    Args:
        station: a station's name, its YAML file, the content of such a file as a mapping, its configuration, or a built
            station.
        overrides: new values, as :func:`load_station` takes them; None if there are none.

    Raises:
        SimrobError: as :func:`load_station`.
        InvalidParameter: ``station`` is no station, or ``overrides`` no mapping.
    """
    if overrides is not None:
        expected = message(
            "stations.overrides_by_key", "a mapping of keys to values, as load_station() takes it"
        )
        instance(overrides, "overrides", Mapping, expected)
    if isinstance(station, (str, Path, Mapping)):
        return load_station(station, overrides)
    if isinstance(station, (Station, StationConfig)):
        config = station.config if isinstance(station, Station) else station
        return with_settings(config, overrides or {}, "overrides")
    known = message(
        "stations.a_station",
        "a name of `simrob list`, a YAML file, a mapping with the keys of such a file, a configuration from "
        "load_station(), or a built station",
    )
    raise InvalidParameter("station", quote_value(station), known)


@former_argument("config", "station")
@drake_asserts()
def add_station(
    builder: DiagramBuilder,
    station: StationLike,
    *,
    name: str = "",
    overrides: Mapping[str, Any] | None = None,
    plant: MultibodyPlant | None = None,
    scene_graph: SceneGraph | None = None,
    parser_preload: ParserHook | None = None,
    prefinalize: ParserHook | None = None,
) -> StationPorts:
    """Add a station's systems to a diagram under construction, flat.

    This is the primitive, as ``AddMultibodyPlantSceneGraph`` is: it leaves the inputs open, so the caller connects or
    exports each of them. A plant that is made here is named ``plant``, or ``<name>.plant``; your own keeps its name.

    Args:
        builder: builder of the diagram. For the scheme ``cenic`` it is that of the root diagram, without other plants.
        station: the station: its name, its file, its configuration, or a built one, whose configuration is taken.
        name: prefix of the names of all systems that are added, with a dot after it. Each of several stations in one
            builder needs another one. It is no part of the names of ports and signals.
        overrides: new values of the station, as :func:`load_station` takes them.
        plant: plant of your own in this builder, in which the station shall stand. It is finalized here, after
            ``prefinalize``. To finalize it yourself, or for several stations in one plant, see :func:`place_station`.
            Without it the station gets a plant of its own.
        scene_graph: scene graph of ``plant``; by default the one in the builder.
        parser_preload: callback with a Parser of the plant, before the robots are added to it.
        prefinalize: callback with the same Parser, after robots and pieces are added and before the plant is finalized.
            What it adds, such as tables, is part of the world but not of the station.

    Returns:
        the station's ports, with its plant.

    Raises:
        SimrobError: there is no such station, the builder has systems of the same names, or the plant does not suit
            the station.
    """
    instance(
        builder,
        "builder",
        DiagramBuilder,
        message("stations.diagram_builder", "a DiagramBuilder of Drake"),
    )
    _check_name(name)
    hooks = PlantHooks(parser_preload, prefinalize)
    resolved = resolve(config_of(station, overrides))
    if plant is None:
        if scene_graph is not None:
            needed = message(
                "stations.plant_with_scene_graph", "given together with the plant of your own"
            )
            raise InvalidParameter("scene_graph", quote_value(scene_graph), needed)
        # Checked before anything is added: a builder cannot take systems out again.
        known = [system.get_name() for system in builder.GetSystems()]
        _check_clash(known, [_with_prefix(name, own) for own in _ALWAYS_THERE], name)
        return _add_named(
            builder, name, lambda: _compose_with_edges(builder, resolved, hooks=hooks)
        )
    expected = message("stations.drakes_plant", "a MultibodyPlant of Drake")
    instance(plant, "plant", MultibodyPlant, expected)
    scene_graph = scene_graph_in(builder, plant) if scene_graph is None else scene_graph
    check_builder(builder, [plant, scene_graph])
    # The user's bodies come before and after the station's, as in a station with its own plant.
    parser = Parser(plant)
    hooks.preload(parser)
    placed = place_station(plant, resolved.config, scene_graph=scene_graph, name=name)
    hooks.finish(parser)
    # Ports for actuators and states have their sizes only after this call, so that wiring comes last.
    plant.Finalize()
    return placed.wire(builder)


@drake_asserts()
def place_station(
    plant: MultibodyPlant,
    station: StationLike,
    *,
    scene_graph: SceneGraph,
    name: str = "",
    overrides: Mapping[str, Any] | None = None,
) -> PlacedStation:
    """Put a station's robots, pieces and floor into a plant of your own, so that several stations share one world.

    Add everything that shall stand in the world, call ``plant.Finalize()``, and then :meth:`PlacedStation.wire` of each
    station, which adds its servos, sensors and monitors to the diagram. The plant must have the station's gravity, time
    step and contact model; :func:`add_world` makes such a plant. The plant gets the station's speed of stiction and,
    for a discrete solver, output ports that are computed anew from each state.

    Args:
        plant: the plant, not finalized.
        station: the station: its name, its file, its configuration, or a built one, whose configuration is taken.
        scene_graph: the scene graph of the plant.
        name: prefix of the names of the station's model instances and systems, with a dot after it. Each of several
            stations in one plant needs another one. It is no part of the names of ports and signals.
        overrides: new values of the station, as :func:`load_station` takes them.

    Raises:
        SimrobError: there is no such station, or the plant does not suit it: it is finalized, belongs to another scene
            graph, differs in gravity, time step or contact model, or has a station of this name, or one with another
            solver, contact or floor.
    """
    _check_name(name)
    scope = f"{name}." if name else ""
    # The names of model instances must differ in one plant, hence the scope as their prefix.
    resolved = replace(resolve(config_of(station, overrides)), scope=scope)
    # Before the first change of the plant: a refused station must leave nothing in it.
    check_plant(plant, scene_graph, resolved, name)
    contents = shared_plant(plant)
    if resolved.config.contact is not None:
        plant.set_stiction_tolerance(resolved.config.contact.stiction_speed)
    if resolved.engine.has_discrete_states:
        # Otherwise signals could not be evaluated again from a recorded state.
        plant.SetUseSampledOutputPorts(False)
    # Whether to add the floor: only one station does, or bodies would rest on two surfaces at once.
    floor = contents.needs_floor(resolved)
    models = add_models(plant, scene_graph, resolved, floor=floor, is_shared=True)
    contents.add(name, resolved, models.points)
    return PlacedStation(name, models)


class PlacedStation:
    """A station whose robots and pieces are in a plant that the user makes; :func:`place_station` returns it.

    Attributes:
        name: name of the station in the plant and in the diagram; it may be empty.
        robots: model instance of each robot in the plant, by the name of the robot.
    """

    def __init__(self, name: str, models: StationModels) -> None:
        """Keep the station's models until the plant is finalized."""
        self.name = name
        self.robots = {robot.name: robot.instance for robot in models.plant.robots.values()}
        self._models = models
        self._is_wired = False

    def __repr__(self) -> str:
        """Describe the placed station in one line."""
        return f"<PlacedStation {self.name or self._models.resolved.config.name}>"

    @drake_asserts()
    def wire(self, builder: DiagramBuilder) -> StationPorts:
        """Add the station's servos, sensors, forces and monitors to the diagram of its plant.

        Forces of the station are added to those that are connected to the plant already. Connect forces of your own to
        ``get_applied_spatial_force_input_port`` and ``get_applied_generalized_force_input_port`` before this call.

        Args:
            builder: the builder that has the plant.

        Returns:
            the station's ports, as :func:`add_station` returns them.

        Raises:
            SimrobError: the plant is not finalized or in another builder, the station is wired already, the builder has
                systems of the same names, or a part of the station does not fit the others.
        """
        instance(
            builder,
            "builder",
            DiagramBuilder,
            message("stations.diagram_builder", "a DiagramBuilder of Drake"),
        )
        station = self._models.plant
        if not station.plant.is_finalized():
            raise SimrobError(
                message(
                    "stations.plant_not_finalized",
                    "the plant is not finalized; call plant.Finalize() before wire(builder)",
                )
            )
        check_builder(builder, [station.plant, station.scene_graph])
        if self._is_wired:
            raise SimrobError(
                message("stations.wired_already", "this station is wired already; wire it once")
            )
        # Before the work, since a failed attempt has added systems already, and cannot be repeated.
        self._is_wired = True
        # Once for all stations of the plant; the first one that is wired sets the filters.
        pairs = shared_plant(station.plant).filter_contact_points(station.scene_graph)
        complete = replace(complete_plant(self._models), replaced_pairs=pairs)
        resolved = self._models.resolved
        return _add_named(
            builder, self.name, lambda: _compose_with_edges(builder, resolved, plant=complete)
        )


@drake_asserts()
def add_world(
    builder: DiagramBuilder,
    station: StationLike,
    *,
    overrides: Mapping[str, Any] | None = None,
) -> tuple[MultibodyPlant, SceneGraph]:
    """Add an empty plant and its scene graph to a diagram, with the time step, gravity and contact model of a station.

    Place stations and bodies of your own in the plant, and finalize it: see :func:`place_station`.

    Args:
        builder: builder of the diagram. The systems are named ``plant`` and ``scene_graph``.
        station: the station whose settings are taken: its name, its file, its configuration, or a built one.
        overrides: new values of the station, as :func:`load_station` takes them.

    Raises:
        SimrobError: there is no such station, it is kinematic, its solver does not step Drake's plant, or the names are
            taken.
    """
    instance(
        builder,
        "builder",
        DiagramBuilder,
        message("stations.diagram_builder", "a DiagramBuilder of Drake"),
    )
    config = config_of(station, overrides)
    check_steps_plant(config)
    _check_clash([system.get_name() for system in builder.GetSystems()], _ALWAYS_THERE, "")
    return add_empty_plant(builder, config)


def _compose_with_edges(
    builder: DiagramBuilder,
    station: ResolvedStation,
    **how: Any,
) -> StationPorts:
    """Add a station's systems, and a block that ends steps at the times at which pushes and signal flows need it.

    Args:
        builder: builder of the diagram.
        station: the station.
        **how: arguments of `compose`.
    """
    ports = compose(builder, station, **how)
    # Without such times a solver is free to choose its steps.
    if ports.edges:
        builder.AddNamedSystem("edges", EventTimes(ports.edges))
    return ports


def _add_named(
    builder: DiagramBuilder,
    name: str,
    add: Callable[[], StationPorts],
) -> StationPorts:
    """Add a station's systems to a builder, with the name of the station before their names.

    Args:
        builder: builder of the diagram.
        name: name of the station in the diagram, or an empty text.
        add: adds the systems, and returns the ports of the station.

    Returns:
        the ports, with the name of the station.

    Raises:
        SimrobError: the builder has systems of the same names. The station's systems have been added all the same.
    """
    # The builder may have other stations and blocks of the user, which keep their names.
    known = list(builder.GetSystems())
    names = [system.get_name() for system in known]
    # While the station is composed, its blocks are looked up by their names without the prefix. Temporary names of all
    # other systems make sure that no other system is found.
    for index, system in enumerate(known):
        system.set_name(f"{_HIDDEN}{index}")
    try:
        ports = add()
    finally:
        for system, own_name in zip(known, names, strict=True):
            system.set_name(own_name)
    added = builder.GetSystems()[len(known) :]
    for system in added:
        system.set_name(_with_prefix(name, system.get_name()))
    _check_clash(names, [system.get_name() for system in added], name)
    return replace(ports, name=name)


_ALWAYS_THERE = ("plant", "scene_graph")
"""Names of systems that most stations have. They are checked before anything is added to the builder."""

_HIDDEN = "another system "
"""Prefix of the temporary names that other systems of the builder have while a station is added."""


def _with_prefix(name: str, system: str) -> str:
    """Name of a system of a station in the diagram.

    Args:
        name: name of the station in the diagram, or an empty text.
        system: name of the system in the station.
    """
    return f"{name}.{system}" if name else system


def _check_name(name: object) -> None:
    """Check the name of a station in a diagram, which becomes a prefix of names.

    Raises:
        InvalidParameter: the name is no text, does not begin with a letter from a to z or A to Z or with ``_``, or has
            other characters than letters, digits, ``_`` and ``-``. An empty name is allowed.
    """
    is_name = isinstance(name, str) and (not name or re.fullmatch(r"[A-Za-z_][\w-]*", name))
    if not is_name:
        expected = message(
            "stations.name_of_letters",
            "a name of letters, digits, _ and - that begins with a letter from a to z or with _, such as arm",
        )
        raise InvalidParameter("name", quote_value(name), expected)


def _check_clash(known: Sequence[str], added: Sequence[str], name: str) -> None:
    """Check that a station's systems have other names than those in the builder.

    Args:
        known: names of the systems in the builder.
        added: names of the station's systems.
        name: name of the station in the diagram, or an empty text.

    Raises:
        SimrobError: a name is taken; the message lists such names.
    """
    taken = sorted(set(known) & set(added))
    if not taken:
        return
    # An error with hundreds of names would hide its remedy.
    listed = ", ".join(taken[:_MOST_NAMES]) + (" ..." if len(taken) > _MOST_NAMES else "")
    raise SimrobError(
        message(
            "stations.names_taken",
            "the diagram already has {count:a system|systems} named {names}; give this station another name, as in "
            'add_station(builder, station, name="{example}")',
            count=len(taken),
            names=listed,
            example=f"{name}_2" if name else "second",
        )
    )


_MOST_NAMES = 6  # count of names that an error lists


def compose(
    builder: DiagramBuilder,
    station: ResolvedStation,
    *,
    sensors: Collection[str] | None = None,
    forces: bool = True,
    monitors: bool = True,
    blocks: Mapping[str, LeafSystem] | None = None,
    sources: Mapping[str, OutputPort] | None = None,
    lean: bool = False,
    closed: bool = False,
    plant: StationPlant | None = None,
    hooks: PlantHooks | None = None,
) -> StationPorts:
    """Add the systems of a station to a diagram, or some of them.

    Args:
        builder: builder of the diagram.
        station: the station.
        sensors: names of the sensors that are added; all sensors by default.
        forces: whether the forces of the configuration act.
        monitors: whether monitors are blocks of the diagram. Otherwise only the ports list them, and the recorder of
            the run evaluates them.
        blocks: blocks that the user has written, by name; by default those of the configuration (controllers of the
            kind ``own``). Its controllers of other kinds are added in any case.
        sources: output ports that drive inputs of a dynamic station, by the name of the input, which is then no input
            of the station.
        lean: whether blocks that only report, such as poses, are left out unless another block reads them. Their
            values can be computed from the recorded states.
        closed: whether no system with continuous states is added to the diagram later.
        plant: a finalized plant that contains the station's robots and pieces already. By default the station gets a
            plant of its own.
        hooks: callbacks that may add bodies to that plant of its own.

    Returns:
        the station's ports.

    Raises:
        SimrobError: a part of the station does not fit the others, or the solver.
    """
    own = own_blocks(station.config.controllers) if blocks is None else blocks
    # Blocks of the user may drive inputs that the station's file does not list.
    config = station.config.model_copy(update={"inputs": with_driven(station.config.inputs, own)})
    plant = add_plant(builder, station, hooks) if plant is None else plant
    # Another engine computes servos made of blocks explicitly, with its fixed step.
    if plant.stand_in is not None:
        check_servo_steps(config, plant)
    if not station.engine.moves_by_forces:
        inputs, state = add_motion_inputs(builder, plant)
        outputs = OutputRegistry(state, plant.plant, defers_reports=lean)
        ports = StationPorts(
            station=station,
            plant=plant,
            state=state,
            outputs=outputs,
            inputs=inputs,
            config=config,
        )
        add_kinematic_robots(builder, ports)
    else:
        # `plant_block` is what the simulation steps: Drake's plant, or the block of another engine.
        state = plant.plant_block.get_state_output_port()
        driven = sources or {}
        outputs = OutputRegistry(state, plant.plant, defers_reports=lean)
        ports = StationPorts(
            station=station,
            plant=plant,
            state=state,
            outputs=outputs,
            inputs=InputPorts(robot.prefix for robot in plant.robots.values()),
            config=config,
            sources=driven,
        )
        add_dynamic_robots(builder, ports)
    draw_plant(ports)
    add_poses(builder, ports)
    _sort_by_robot(ports)
    add_free_pieces(builder, ports)
    for name, sensor in station.sensors.items():
        if sensors is None or name in sensors:
            ports.outputs.notes[name] = {"kind": sensor.kind}
            sensor.wire(builder, ports, name)
    for name, force in config.forces.items() if forces else ():
        add_force(builder, ports, name, force, force.source(), force.caption())
        ports.edges.extend(force.edges)
    flows = flows_of(config.controllers)
    if flows:
        # Loaded only if there is a flow, as the module is large.
        from simrob_drake.parts.controllers.signal_flow import add_flows

        # Drake integrates a diagram with continuous states, and then asks the blocks of flows for derivatives, too. If
        # the diagram is not closed, the user may still add such a system.
        systems = [*builder.GetSystems(), *own.values()]
        integrated = any(system.num_continuous_states() for system in systems)
        add_flows(builder, ports, flows, monitors=monitors, integrated=integrated or not closed)
    # After all that adds forces, since an input of the plant takes one connection.
    gather_forces(builder, ports)
    # Blocks first, then loops, then wires: blocks and loops may read each other's outputs.
    add_own_blocks(builder, ports, own)
    add_loops(builder, ports, loops_of(config.controllers))
    wire_own_blocks(builder, ports, own)
    for name, monitor in config.monitors.items():
        # Monitors last: they may watch any signal.
        trigger = Trigger(monitor.condition(name, station), monitor.hold, monitor.after)
        add_monitor(builder if monitors else None, ports, name, trigger, monitor.robot)
    return ports


def _sort_by_robot(ports: StationPorts) -> None:
    """Sort the signals of a station's results by robots, in place; those of one robot keep their order.

    Call it before signals of pieces and sensors are added: their names do not begin with a robot's prefix.
    """
    # Outputs are declared part by part, so that the columns of several robots alternate.
    robots = list(ports.plant.robots.values())
    if len(robots) > 1:
        order = {robot.prefix: index for index, robot in enumerate(robots)}
        # The columns of a signal begin with the prefix of its robot: `arm.q.joint_1` belongs to the prefix `arm.`.
        ports.outputs.signals.sort(
            key=lambda signal: order[f"{signal.names[0].partition('.')[0]}."]
        )


def gather_forces(builder: DiagramBuilder, ports: StationPorts) -> None:
    """Connect all external and generalized forces of a station to the inputs of its plant.

    External forces act on bodies, generalized forces on joints. Forces that are connected to these inputs already, by
    another station in the plant or by the user, act as well.
    """
    found = ports.spatial_forces
    if found:
        joined = ExternallyAppliedSpatialForceMultiplexer(len(found))
        forces = add_and_connect(builder, "external_forces", joined, *found)
        ports.picture.draw_nothing("external_forces")
        port = ports.plant.plant_block.get_applied_spatial_force_input_port()
        before = _disconnect(builder, port)
        if before is not None:
            # The lists of forces are joined: another station in the plant, or the user, has
            # connected its own.
            both = ExternallyAppliedSpatialForceMultiplexer(2)
            forces = add_and_connect(builder, "all_external_forces", both, before, forces)
            ports.picture.draw_nothing("all_external_forces")
        builder.Connect(forces, port)
    if ports.generalized_forces:
        joints = add_sum(builder, "joint_forces", *ports.generalized_forces)
        ports.picture.draw_nothing("joint_forces")
        port = ports.plant.plant_block.get_applied_generalized_force_input_port()
        before = _disconnect(builder, port)
        if before is not None:  # forces of others, which are added to those of the station
            joints = add_sum(builder, "all_joint_forces", before, joints)
            ports.picture.draw_nothing("all_joint_forces")
        builder.Connect(joints, port)


def _disconnect(builder: DiagramBuilder, port: InputPort) -> OutputPort | None:
    """Disconnect an input of a plant that others may feed already, such as another station in the plant.

    Args:
        builder: builder of the diagram.
        port: the input.

    Returns:
        the output that was connected to it; None if there was none.

    Raises:
        SimrobError: the input is exported, so that nothing can be added to it.
    """
    if not builder.IsConnectedOrExported(port):
        return None
    # An exported input is in no connection of this builder.
    source = builder.connection_map().get((port.get_system(), port.get_index()))
    if source is None:
        raise SimrobError(
            message(
                "stations.exported_force_port",
                "the port {port} of the plant is exported, but the station has forces for it too; connect a "
                "PassThrough to the port and export the input of the PassThrough",
                port=port.get_name(),
            )
        )
    system, index = source
    output = system.get_output_port(index)
    builder.Disconnect(output, port)
    return output


class Station(Diagram):
    """A station as one box: the systems of :func:`add_station` with every port exported under its name.

    Attributes:
        config: the station's configuration.
        ports: the ports inside; the box exports each under the same name.
    """

    @former_argument("config", "station")
    def __init__(
        self,
        station: StationLike,
        *,
        overrides: Mapping[str, Any] | None = None,
        parser_preload: ParserHook | None = None,
        prefinalize: ParserHook | None = None,
        prebuild: BuilderHook | None = None,
    ) -> None:
        """Build a station; arguments and errors are those of :func:`build_station`.

        Inputs that the callback ``prebuild`` connects are not exported.
        """
        super().__init__()
        self.config = config_of(station, overrides)
        builder = DiagramBuilder()
        self.ports = add_station(
            builder, self.config, parser_preload=parser_preload, prefinalize=prefinalize
        )
        if prebuild is not None:
            prebuild(builder)
        for name, port in self.ports.inputs.items():
            # What a callback of the user has connected is no input of the box any more.
            if not builder.IsConnectedOrExported(port):
                builder.ExportInput(port, name)
        for name, output in self.ports.outputs.items():
            builder.ExportOutput(output, name)
        # Nothing can be exported after the diagram is built.
        builder.BuildInto(self)
        release(builder, self)
        self.set_name(self.config.name)

    def __repr__(self) -> str:
        """Describe the station in one line."""
        return f"<Station of {self.config!r}>"


StationLike: TypeAlias = str | Path | Mapping[str, Any] | StationConfig | Station
"""Ways in which users name a station: its name, its YAML file, its configuration, or a built station."""


@former_argument("config", "station")
def build_station(
    station: StationLike,
    *,
    overrides: Mapping[str, Any] | None = None,
    parser_preload: ParserHook | None = None,
    prefinalize: ParserHook | None = None,
    prebuild: BuilderHook | None = None,
) -> Station:
    """Build a station as one Diagram, with its ports exported by name.

    Args:
        station: the station: its name, its file, its configuration, or a built one, whose configuration is taken.
        overrides: new values of the station, as :func:`load_station` takes them.
        parser_preload: callback with a Parser of the plant, before the robots are added to it.
        prefinalize: callback with the same Parser, after robots and pieces are added and before the plant is finalized.
        prebuild: callback with the builder, before the diagram is built: it may add systems, connect them to the
            station's, and export their ports.

    Raises:
        SimrobError: there is no such station, or it cannot be built.
    """
    return Station(
        station,
        overrides=overrides,
        parser_preload=parser_preload,
        prefinalize=prefinalize,
        prebuild=prebuild,
    )
