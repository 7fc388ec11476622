"""Run a Diagram of the user's own that contains a station.

The *ports* of a station are its inputs, its outputs and its state in a diagram. A *root* is the context of the whole
diagram. A *context* of Drake has time, state and parameters of a system.
"""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import get_args

from pydrake.systems.framework import Context, Diagram, LeafSystem, OutputPort, PortDataType, System

from simrob_drake.base.arguments import drake_asserts, instance
from simrob_drake.base.errors import InvalidParameter, one_of, quote_value
from simrob_drake.base.messages import message
from simrob_drake.parts.controllers.own import declare_output
from simrob_drake.results.record.state import State
from simrob_drake.results.result import SimulationResult
from simrob_drake.simulation.run import OnStep, Run, with_duration
from simrob_drake.simulation.runner import StartTime, check_callback, check_state
from simrob_drake.simulation.stepping import Stepper
from simrob_drake.stations.closed import ClosedStation
from simrob_drake.stations.open_inputs import check_inputs
from simrob_drake.stations.ports import StationPorts

_NOT_OWN = ("pydrake", "simrob_drake")
"""Packages whose blocks are not the user's own."""


@drake_asserts()
def simulate_diagram(
    diagram: Diagram,
    ports: StationPorts,
    *,
    duration: float | None = None,
    context: Context | None = None,
    start: State | None = None,
    start_time: StartTime = "zero",
    signals: Mapping[str, OutputPort] | None = None,
    progress: bool = True,
    on_step: OnStep | None = None,
) -> SimulationResult:
    """Run a Diagram of your own that contains a station, and return the same result as :func:`simulate` does.

    Args:
        diagram: the diagram, all of whose inputs are connected.
        ports: the return value of :func:`add_station`, or ``station.ports`` of :func:`build_station`.
        duration: length of the run, in place of that of the station's configuration [s].
        context: context of the diagram in which the run begins, at the time of the context. The run advances it, as
            ``Simulator(diagram, context)`` does: afterwards it is at the end of the run, and contains the logs of your
            log sinks, as in ``sink.FindLog(context)``. Without a context and a start, the run begins in a default
            context. ``result.context()`` returns a copy of the context at the end of the run.
        start: state in which the run begins, in place of a context: the ``final_state`` of a result of this diagram,
            which may come from another process, by pickle.
        start_time: ``keep`` begins at the time of ``start``, and ``zero`` at 0 s.
        signals: output ports of your own blocks that become columns of the result, by a name ``<block>.<output>``, such
            as ``{"planner.target": planner.GetOutputPort("target")}``. A block may have an attribute ``units``, a
            mapping of the names of its ports to units.
        progress: show a bar on a terminal.
        on_step: callback with the time [s] and the positions of the whole plant (nq,): once at the start, and after
            each accepted step.

    Returns:
        the result; its times are those of the diagram's clock. Saved, its ``station.yaml`` is the station alone, with
        the recorded reference and the state in which the run began: a run of this file repeats the motion if the
        diagram gave the station nothing but its reference.

    Raises:
        SimrobError: the ports are those of another diagram, the context, the start or a signal does not fit, inputs are
            open, or the solver cannot run the station in this diagram.
    """
    _check_diagram(diagram, ports)
    # An open input would be an error of Drake in the first step, which does not name the station's inputs.
    check_inputs(diagram, ports.inputs, may_be_exported=False)
    check_callback(on_step)
    config = with_duration(ports.config, duration)
    ports = _with_signals(diagram, ports, signals)
    # The whole diagram of the user takes the place of the diagram that a Runner would build.
    built = ClosedStation(diagram, ports)
    root = _context_at_begin(diagram, ports, context=context, start=start, start_time=start_time)
    # A context at rest is the usual start of a run, for which the solver chooses its first steps as usual. Otherwise
    # the first step may be long, as in a run that continues another one.
    begins_in_motion = start is not None or (context is not None and _is_moving(ports, root))
    has_start = context is not None or start is not None
    # The state is copied now, because the run advances the context.
    first_state = State.of(diagram, ports, root) if has_start else None
    # The diagram is the same at all times. Robots with the same reference have the same edges, which are stepped once.
    stepper = Stepper(
        config,
        lambda time: built,
        sorted(set(ports.edges)),
        blocks=_own_blocks(diagram),
        begin=root.get_time(),
        begins_in_motion=begins_in_motion,
        context=root,
    )
    run = Run(config, built, stepper, begin=root.get_time(), in_own_diagram=True)
    return run.result(progress=progress, on_step=on_step, references={}, start=first_state)


def _check_diagram(diagram: Diagram, ports: StationPorts) -> None:
    """Check the diagram of a run, and that it contains the station of the ports.

    Raises:
        InvalidParameter: a value is no diagram or no ports, or the station is in another diagram.
    """
    expected = message(
        "simulation.diagram_with_station", "a Diagram of Drake that contains a station"
    )
    instance(diagram, "diagram", Diagram, expected)
    expected = message(
        "simulation.station_ports", "the return value of add_station(), or station.ports"
    )
    instance(ports, "ports", StationPorts, expected)
    # The station's plant may be in a diagram within the user's diagram.
    if not _contains(diagram, ports.state.get_system()):
        raise InvalidParameter(
            "ports",
            message(
                "simulation.ports_of_other_diagram", "the ports of a station in another diagram"
            ),
            message(
                "simulation.ports_of_this_diagram",
                "the ports that add_station() returned for the builder of this diagram, or "
                "station.ports of a station in it",
            ),
        )


def _contains(diagram: Diagram, system: System) -> bool:
    """Whether a system is in a diagram, or in a diagram within it, or is the diagram itself."""
    return any(system is known for known in _systems(diagram))


def _systems(diagram: Diagram) -> Iterator[System]:
    """Yield a diagram and, depth first, all systems in it."""
    yield diagram
    for system in diagram.GetSystems():
        if isinstance(system, Diagram):
            yield from _systems(system)
        else:
            yield system


def _own_blocks(diagram: Diagram, prefix: str = "") -> dict[str, LeafSystem]:
    """Blocks in a diagram, and in diagrams within it, whose classes are the user's own, by name.

    These are classes from other packages than Drake and this one. The name of a block in an inner diagram begins with
    the names of the diagrams around it, as in ``box::filter``.

    Args:
        diagram: the diagram.
        prefix: beginning of all names: empty, or ending with ``::``.
    """
    own = dict[str, LeafSystem]()
    for system in diagram.GetSystems():
        name = prefix + system.get_name()
        if isinstance(system, Diagram):
            own.update(_own_blocks(system, f"{name}::"))
        elif type(system).__module__.split(".")[0] not in _NOT_OWN:
            own[name] = system
    return own


def _context_at_begin(
    diagram: Diagram,
    ports: StationPorts,
    *,
    context: Context | None,
    start: State | None,
    start_time: StartTime,
) -> Context:
    """Find the context in which a run begins: the user's own, or a new one, perhaps in a state of the user's.

    Args:
        diagram: the diagram of the run.
        ports: ports of the station in it.
        context: the user's context; None if there is none.
        start: the user's state; None if there is none.
        start_time: ``keep`` or ``zero``, as in :func:`simulate_diagram`. With a context it must be ``zero``, and has no
            effect: the run begins at the time of the context.

    Returns:
        The context of the user itself, which the run advances, or a new one.

    Raises:
        InvalidParameter: there are a context and a state, or one that does not fit the diagram, or ``start_time`` is
            ``keep`` without a state.
        UnknownName: ``start_time`` has another value.
    """
    keeps_time = one_of("start_time", start_time, get_args(StartTime)) == "keep"
    # A context is at its own time in any case, so only the time of a state can be kept.
    if keeps_time and start is None:
        raise InvalidParameter(
            "start_time",
            quote_value("keep"),
            message(
                "simulation.diagram_keep_needs_start",
                "used with a start whose time is kept, such as start=result.final_state; a "
                "context has its own time",
            ),
        )
    if context is not None:
        if start is not None:
            raise InvalidParameter(
                "start",
                message("simulation.start_and_context", "given together with a context"),
                message(
                    "simulation.start_or_context",
                    "one of the two: a run begins in a state or in a context",
                ),
            )
        _check_context(diagram, context)
        return context
    if start is None:
        return diagram.CreateDefaultContext()
    check_state(start)
    root = start.context_of(diagram, ports)
    if not keeps_time:
        root.SetTime(0.0)
    return root


def _check_context(diagram: Diagram, context: Context) -> None:
    """Check the user's context.

    Raises:
        InvalidParameter: the value is no Context of Drake, or that of another system.
    """
    expected = message(
        "simulation.context_of_diagram",
        "a Context of the diagram, such as diagram.CreateDefaultContext() returns, or "
        "result.context() of an earlier run",
    )
    instance(context, "context", Context, expected)
    try:
        # Drake compares the identifiers of the systems, and raises a RuntimeError if they differ.
        diagram.ValidateContext(context)
    except RuntimeError as problem:
        found = message("simulation.context_of_other_system", "the context of another system")
        raise InvalidParameter("context", found, expected) from problem


def _is_moving(ports: StationPorts, context: Context) -> bool:
    """Whether any axis of a station's robots has a velocity in ``context``, a context of the whole diagram."""
    velocities = [
        ports.outputs.value(f"{robot.prefix}velocity", context)
        for robot in ports.plant.robots.values()
    ]
    return any(velocity.any() for velocity in velocities)


def _with_signals(
    diagram: Diagram, ports: StationPorts, signals: Mapping[str, OutputPort] | None
) -> StationPorts:
    """Copy the ports of a station, with outputs of the user's own blocks among the signals.

    Args:
        diagram: the diagram of the run.
        ports: ports of the station, which stay as they are. They are returned if there are no signals.
        signals: the outputs by their names in the result, ``<block>.<output>``; None if there are none.

    Raises:
        InvalidParameter: a name has another form or is taken, or a port is none of a vector in the diagram.
    """
    if not signals:
        return ports
    expected = message(
        "simulation.signals_by_name", "a mapping of names, such as planner.target, to output ports"
    )
    instance(signals, "signals", Mapping, expected)
    # The caller may run the same ports again without these signals.
    extended = replace(ports, outputs=ports.outputs.make_copy())
    for name, port in signals.items():
        place = message("simulation.signal_called", "signals: {name}", name=name)
        # Both the part before the last dot and the part behind it have at least one character. The slice leaves out
        # the dot itself, the second of the three parts.
        is_name = isinstance(name, str) and all(name.rpartition(".")[::2])
        if not is_name:
            example = message(
                "simulation.block_and_output", "<block>.<output>, such as planner.target"
            )
            raise InvalidParameter(place, quote_value(name), example)
        if name in extended.outputs:
            found = message("simulation.signal_taken", "the name of another output")
            raise InvalidParameter(place, found, message("simulation.other_name", "another name"))
        expected = message(
            "simulation.vector_port", "a vector-valued output port of a system in the diagram"
        )
        instance(port, place, OutputPort, expected)
        is_vector = port.get_data_type() == PortDataType.kVectorValued
        if not is_vector or not _contains(diagram, port.get_system()):
            found = message("simulation.port_called", "the port {port}", port=port.get_name())
            raise InvalidParameter(place, found, expected)
        block, _, output = name.rpartition(".")
        # Drake's own systems have no units for their ports.
        units = getattr(port.get_system(), "units", {})
        declare_output(extended, block, port, str(units.get(port.get_name()) or "1"), called=output)
        # The summary of the result describes each block once, although it may have several signals.
        extended.outputs.notes.setdefault(block, {"kind": type(port.get_system()).__name__})
    return extended
