"""From a station to its linear model about a rest."""

from collections.abc import Iterator, Mapping
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt
from pydrake.systems.framework import Diagram, DiagramBuilder, System
from pydrake.systems.primitives import AffineSystem, Demultiplexer, FirstOrderTaylorApproximation

from simrob_drake.base.errors import InvalidParameter, SimrobError, Unsuitable, one_of, quote_value
from simrob_drake.base.frames import Vector, finite
from simrob_drake.base.lifetime import build_diagram
from simrob_drake.base.messages import message
from simrob_drake.blocks.block import add_multiplexer
from simrob_drake.dynamics import Dynamics
from simrob_drake.extensions.linear.model import LinearModel
from simrob_drake.parts.outputs import OutputRegistry
from simrob_drake.parts.resolved import name_or_only
from simrob_drake.robots.motors import Drives
from simrob_drake.stations.checks import holding_torque
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.dynamic import add_dynamic_robots
from simrob_drake.stations.plant import add_plant
from simrob_drake.stations.ports import StationPorts
from simrob_drake.stations.resolve import resolve
from simrob_drake.stations.solver_config import ContinuousSolver
from simrob_drake.stations.station import Station, StationLike, config_of, gather_forces

Posture = npt.ArrayLike | Mapping[str, npt.ArrayLike]
"""Positions (n,) [rad or m] of the only robot, or of several by name."""

LinearizedStation: TypeAlias = "StationLike | StationPorts"
"""A station, or the ports of one in a diagram of the user's own."""

_OUTPUTS = {"position": "q", "velocity": "v", "torque": "tau"}
_TOOL = ("x", "y", "z", "rx", "ry", "rz")
_SHIFT_DEG = 1.0
"""Farthest that a passive axis may rest from where it is asked to [deg]: servos that sag shift the equilibrium."""
_SHIFT_METRES = 1e-3  # the same for a passive axis that slides [m]
_MOST_STEPS = 30
_AT_REST = 1e-9  # what is left of accelerations where a station rests [rad/s²]
_ROUNDING = 1e-12  # and what part of the terms that they are made of
_LONGEST = 0.2  # of a step on the way to the rest [rad or m]


class NoRest(SimrobError):
    """A posture that a station's servos cannot hold."""


def linearize(
    station: LinearizedStation,
    at: Posture | None = None,
    *,
    overrides: Mapping[str, Any] | None = None,
) -> LinearModel:
    """Return how a station moves near a rest, by Drake's first-order Taylor expansion of its equations.

    It rests where its references are ``at``: with the sag of its servos, but exactly there where a robot takes a
    ``feedforward``, which then holds it. The equations are those of continuous time, whatever the solver: servos inside
    of actuators are the same law as blocks. What is no part of the model, its ``notes`` say.

    Inputs are ``reference.<axis>`` and what the station lists under ``inputs``; outputs ``q``, ``v``, ``tau`` of each
    axis, and ``tcp.x`` ... ``tcp.rz``, small moves and turns of the tool in the world [m, rad]. Names carry the robot's
    where there are several.

    Args:
        station: a name, a file, a configuration, a built station, or the ports that :func:`add_station` returned, which
            stand for their station; dynamic, with robots on fixed bases. Blocks of the diagram around are not part of
            the model.
        at: the references, as :data:`Posture`; the initial postures unless given.
        overrides: new values of the station, as :func:`simrob_drake.load_station` takes them.

    Raises:
        InvalidParameter: a kinematic station, a robot or piece that only contact holds, or a wrong posture.
        NoRest: the motors are too weak for the posture.
    """
    config, notes = _smooth(_config_of(station, overrides))
    builder, resolved = DiagramBuilder(), resolve(config)
    for name, robot in resolved.robots.items():
        if robot.floats:
            raise InvalidParameter(
                f"robots.{name}",
                robot.model.name,
                message(
                    "linear.robot_on_fixed_base", "one on a fixed base: only contact holds this one"
                ),
            )
    plant = add_plant(builder, resolved)
    state = plant.plant.get_state_output_port()
    registry = OutputRegistry(state, plant.plant)
    ports = StationPorts(
        station=resolved, plant=plant, state=state, outputs=registry, config=config
    )
    add_dynamic_robots(builder, ports)
    gather_forces(builder, ports)
    outputs = [
        ports.outputs[f"{robot.prefix}{name}"]
        for robot in plant.robots.values()
        for name in _OUTPUTS
    ]
    split = builder.AddNamedSystem(
        "inputs", Demultiplexer([port.size() for port in ports.inputs.values()])
    )
    for place, port in enumerate(ports.inputs.values()):
        builder.Connect(split.get_output_port(place), port)
    builder.ExportInput(split.get_input_port(), "inputs")
    builder.ExportOutput(add_multiplexer(builder, "outputs", *outputs), "outputs")
    rest = _Rest(build_diagram(builder), ports)
    rest.find(_postures(ports, at))
    return rest.model(tuple(notes))


def _config_of(station: LinearizedStation, overrides: Mapping[str, Any] | None) -> StationConfig:
    """Find the configuration of what a user means by a station, which may be the ports of one in a diagram.

    Args:
        station: the station, as in :func:`linearize`.
        overrides: new values of the station; None if there are none.

    Raises:
        Unsuitable: a Diagram of the user's own, which is more than a station.
        SimrobError: as :func:`simrob_drake.load_station`.
    """
    if isinstance(station, StationPorts):
        return config_of(station.config, overrides)
    if isinstance(station, Diagram) and not isinstance(station, Station):
        problem = message(
            "linear.diagram_of_own",
            "it is a Diagram, and linearize() makes the model of a station alone",
        )
        remedy = message(
            "linear.pass_ports",
            "pass the ports that add_station() returned, as in linearize(ports)",
        )
        raise Unsuitable("station", problem, remedy)
    return config_of(station, overrides)


def _smooth(config: StationConfig) -> tuple[StationConfig, list[str]]:
    """Return what of a station has a slope, in continuous time, and in words what has not."""
    if not config.engine.moves_by_forces or not config.robots:
        raise InvalidParameter(
            "station",
            config.name,
            message(
                "linear.dynamic_with_robots",
                "a dynamic one with robots: others have no motion of their own",
            ),
        )
    if config.free_pieces:
        listed, first = ", ".join(config.free_pieces), config.free_pieces[0]
        raise InvalidParameter(
            "pieces",
            message("linear.pieces_free", "{pieces} free", pieces=listed),
            message(
                "linear.all_held",
                "all held: set pieces.{first}.free to false, or leave it out",
                first=first,
            ),
        )
    left_out = {
        "contact": message("linear.contact_left_out", "contact: things pass through each other"),
        "controllers": message(
            "linear.controllers_left_out",
            "controllers: they are not part of the model, whose input is the reference that they would drive",
        ),
        "forces": message("linear.forces_left_out", "forces that act at given times"),
    }
    notes: list[str] = [note for section, note in left_out.items() if getattr(config, section)]
    if config.engine.has_discrete_states:
        notes.append(
            message(
                "linear.steps_left_out",
                "the solver's steps of {step:g} s: this is the motion in continuous time",
                step=config.engine.time_step,
            )
        )
    robots = {}
    for name, entry in config.robots.items():
        servo = config.servo_of(name)
        if servo.realization == "implicit":
            servo = servo.model_copy(update={"realization": "vector"})
        drives = (entry.drives or Drives()).model_copy(
            update={"friction": 0.0, "backlash_deg": 0.0}
        )
        robots[name] = entry.model_copy(update={"servo": servo, "drives": drives})
    models = [robot.model for robot in resolve(config).robots.values()]
    if any(model.friction.any() for model in models):
        notes.append(
            message(
                "linear.friction_left_out",
                "Coulomb friction, whose slope at rest tells nothing of motion",
            )
        )
    if any(model.play.any() for model in models):
        notes.append(message("linear.backlash_left_out", "backlash: gears do not let go"))
    changes: dict[str, object] = {
        key: {} for key in ("sensors", "monitors", "forces", "controllers")
    }
    changes |= {
        "contact": None,
        "floor": None,
        "robots": robots,
        "solver": ContinuousSolver(kind="continuous"),
    }
    return config.model_copy(update=changes), notes


def _postures(ports: StationPorts, at: Posture | None) -> dict[str, Vector]:
    """Return the references by robot, shape (n,) each [rad or m]."""
    robots = ports.plant.robots
    postures = {name: robot.initial for name, robot in robots.items()}
    if at is None:
        return postures
    if not isinstance(at, Mapping):
        at = {name_or_only(None, list(robots), key="at"): at}
    for name, posture in at.items():
        robot, found = robots[one_of(message("base.robot", "robot"), name, robots)], finite(posture)
        limits = robot.model.limits
        if found.shape != limits.lower.shape or not limits.are_within(found):
            expected = message(
                "linear.operating_point",
                "{count} finite numbers within the joint limits, one an axis of {name}",
                count=len(robot.axes),
                name=name,
            )
            raise InvalidParameter("at", quote_value(posture), expected)
        postures[name] = limits.clamp(
            found, message("linear.operating_point_of", "the operating point of {name}", name=name)
        )
    return postures


class _Rest:
    """A station's diagram of one input and one output, and the rest that was found in it."""

    def __init__(self, diagram: Diagram, ports: StationPorts) -> None:
        self._diagram, self._ports = diagram, ports
        self._plant, self._robots = ports.plant.plant, list(ports.plant.robots.values())
        self._context = diagram.CreateDefaultContext()
        self._own = self._plant.GetMyMutableContextFromRoot(self._context)
        self._inputs = np.zeros(diagram.get_input_port().size())
        self._starts, count = dict[str, int](), 0
        for system in diagram.GetSystems():
            self._starts[system.get_name()] = count
            count += self._states_of(system)

    def _states_of(self, system: System) -> int:
        return int(system.GetMyContextFromRoot(self._context).num_continuous_states())

    def find(self, postures: Mapping[str, Vector]) -> None:
        """Put the diagram to rest with references (n,) by robot, by Newton's method; raises NoRest: none is near."""
        state = self._context.get_continuous_state_vector().CopyToVector()
        free = np.append(np.ones(len(state), dtype=bool), np.zeros(len(self._inputs), dtype=bool))
        start, count = self._starts["plant"], self._plant.num_positions()
        free[start + count : start + self._plant.num_multibody_states()] = False  # nothing moves
        for robot in self._robots:
            robot.axis_map.set_positions(self._plant, self._own, postures[robot.name])
            self._inputs[self._input(f"{robot.prefix}reference")] = postures[robot.name]
            if f"{robot.prefix}feedforward" in self._ports.inputs:
                driven = ~robot.gains.passive  # no feedforward holds a passive axis
                free[start + robot.axis_map.position_places[driven]] = False
                free[
                    len(state)
                    + np.arange(len(self._inputs))[self._input(f"{robot.prefix}feedforward")]
                ] = True
        for _ in range(_MOST_STEPS):
            state = self._context.get_continuous_state_vector().CopyToVector()
            taylor = self._expanded()
            parts = [taylor.A() @ state, taylor.B() @ self._inputs, taylor.f0()]
            rate, size = sum(parts), np.abs(parts).max()
            if np.abs(rate).max() <= _AT_REST + _ROUNDING * size and self._holds():
                if self._passive_axes_stay(postures):
                    return
                break
            step = np.zeros(len(free))
            step[free] = np.linalg.lstsq(
                np.hstack([taylor.A(), taylor.B()])[:, free], -rate, rcond=None
            )[0]
            step[: len(state)] *= min(
                1.0, _LONGEST / max(np.abs(step[start : start + count]).max(), 1e-300)
            )
            self._context.SetContinuousState(state + step[: len(state)])
            self._inputs += step[len(state) :]
        raise NoRest(self._why(postures))

    def model(self, notes: tuple[str, ...]) -> LinearModel:
        """Return the model about the rest, in the axes' order and senses."""
        taylor = self._expanded()
        names, turn = self._names()
        state = self._context.get_continuous_state_vector().CopyToVector()
        rows, values, outputs = (
            [taylor.C() @ turn.T],
            [self._diagram.get_output_port().Eval(self._context)],
            [],
        )
        for robot in self._robots:
            outputs += [
                f"{robot.prefix}{column}.{axis}"
                for column in _OUTPUTS.values()
                for axis in robot.axes
            ]
        for robot in self._robots:
            if robot.tcp:
                tool, columns = (
                    robot.tools[robot.tcp],
                    [names.index(f"{robot.prefix}q.{axis}") for axis in robot.axes],
                )
                dynamics = Dynamics(robot.model, self._plant, robot.joints, tool=tool)
                jacobian = np.zeros((6, len(names)))
                jacobian[:, columns] = dynamics.jacobian(
                    robot.axis_map.positions(self._plant.GetPositions(self._own))
                )
                rows, outputs = (
                    [*rows, jacobian],
                    [*outputs, *(f"{robot.prefix}tcp.{part}" for part in _TOOL)],
                )
                values += [tool.CalcPoseInWorld(self._own).translation(), np.zeros(3)]
        through = np.zeros((len(outputs), len(self._inputs)))
        through[: len(taylor.D())] = taylor.D()
        return LinearModel(
            name=self._ports.config.name,
            A=turn @ taylor.A() @ turn.T,
            B=turn @ taylor.B(),
            C=np.vstack(rows),
            D=through,
            states=tuple(names),
            inputs=tuple(self._input_names()),
            outputs=tuple(outputs),
            x0=turn @ state,
            u0=self._inputs.copy(),
            y0=np.concatenate(values),
            notes=notes,
        )

    def _expanded(self) -> AffineSystem:
        port = self._diagram.get_input_port()
        port.FixValue(self._context, self._inputs)
        output = self._diagram.get_output_port().get_index()
        return FirstOrderTaylorApproximation(self._diagram, self._context, port.get_index(), output)

    def _holds(self) -> bool:
        """Tell whether no motor is at its limit."""
        names = [f"{robot.prefix}torque" for robot in self._robots]
        ports = [self._ports.outputs[name] for name in names]
        torques = [
            port.Eval(port.get_system().GetMyContextFromRoot(self._context)) for port in ports
        ]
        limits = [robot.gains.judged_limit for robot in self._robots]
        return all(
            (np.abs(torque) < limit).all() for torque, limit in zip(torques, limits, strict=True)
        )

    def _passive_axes_stay(self, postures: Mapping[str, Vector]) -> bool:
        """Whether passive axes rest where they are asked to, and not in another equilibrium that is far away.

        Couplings hold passive axes of closed loops, so these are not compared.
        """
        if self._ports.config.couplings:
            return True
        found = self._plant.GetPositions(self._own)
        for robot in self._robots:
            shift = np.abs(robot.axis_map.positions(found) - postures[robot.name])
            allowed = robot.model.bounds(_SHIFT_DEG, _SHIFT_METRES)
            if (shift > allowed)[robot.gains.passive].any():
                return False
        return True

    def _input(self, name: str) -> slice:
        """Return where an input lies in the one of the diagram."""
        start = 0
        for other, port in self._ports.inputs.items():
            if other == name:
                return slice(start, start + port.size())
            start += port.size()
        raise KeyError(name)

    def _input_names(self) -> Iterator[str]:
        for name, port in self._ports.inputs.items():
            robot = next(robot for robot in self._robots if name.startswith(robot.prefix))
            parts = (
                robot.axes if port.size() == len(robot.axes) and "external" not in name else "xyz"
            )
            yield from (f"{name}.{part}" for part in parts)

    def _names(self) -> tuple[list[str], Vector]:
        """Return the names of the states, axes first, and the matrix that makes them of the diagram's."""
        plant, start = self._plant, self._starts["plant"]
        count, found = plant.num_positions(), dict[int, tuple[str, float]]()
        for letter, first in (("q", start), ("v", start + count)):
            for robot in self._robots:
                own = robot.axis_map
                places = own.position_places if letter == "q" else own.velocity_places
                names = [f"{robot.prefix}{letter}.{axis}" for axis in robot.axes]
                found |= zip(
                    (first + places).tolist(),
                    zip(names, own.signs.tolist(), strict=True),
                    strict=True,
                )
        others = [f"q.{name}" for name in plant.GetPositionNames()] + [
            f"v.{name}" for name in plant.GetVelocityNames()
        ]
        for system in self._diagram.GetSystems():
            size, name = self._states_of(system), system.get_name()
            parts = (
                others
                if name == "plant"
                else [name]
                if size == 1
                else [f"{name}.{part}" for part in range(size)]
            )
            for part in range(size):
                found.setdefault(self._starts[name] + part, (parts[part], 1.0))
        turn = np.zeros((len(found), len(found)))
        for row, (place, (_, sign)) in enumerate(found.items()):
            turn[row, place] = sign
        return [name for name, _ in found.values()], turn

    def _why(self, postures: Mapping[str, Vector]) -> str:
        name = self._ports.config.name
        for robot in self._robots:
            torque = holding_torque(self._ports.plant, robot, postures[robot.name])
            shares = robot.gains.holding_shares(torque)
            worst = int(np.argmax(shares))
            limit, unit = robot.gains.limit_at_rest[worst], robot.model.effort_units[worst]
            axis = f"{robot.prefix}{robot.axes[worst]}"
            if robot.gains.passive[worst] and shares[worst] > 1.0:
                return message(
                    "linear.passive_does_not_rest",
                    "{name} does not rest there: {axis} has no motor, and would take {torque:.4g} {unit}",
                    name=name,
                    axis=axis,
                    torque=abs(torque[worst]),
                    unit=unit,
                )
            if shares[worst] > 1.0:
                return message(
                    "linear.does_not_rest",
                    "{name} does not rest there: {axis} takes {torque:.4g} {unit}, and has {limit:g}",
                    name=name,
                    axis=axis,
                    torque=abs(torque[worst]),
                    unit=unit,
                    limit=limit,
                )
        return message(
            "linear.servos_too_soft",
            "{name} does not rest there: its servos are too soft; raise servo.kp, or list feedforward under inputs",
            name=name,
        )
