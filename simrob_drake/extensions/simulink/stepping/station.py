"""A station that is stepped from outside, inputs held over a step, states put back."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from pydrake.systems.analysis import Simulator, SimulatorStatus

from simrob_drake import apply_solver, build_station
from simrob_drake.base.errors import InvalidParameter, UnknownName, Unsuitable
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import message
from simrob_drake.extensions.simulink.stepping.parameters import (
    elements,
    parameters_of,
    with_parameters,
)
from simrob_drake.results.record.state import State
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.solver_config import ContinuousSolver
from simrob_drake.stations.station import StationLike, config_of


class StepFailed(RuntimeError):
    """A step that the station could not take: why, in words."""


class SteppedStation:
    """A station whose inputs the caller sets and whose time the caller advances.

    Attributes:
        config: the station, as it is without parameters that are set.
        parameters: what can be set before the first step, by name; the station is then built anew.
        inputs, outputs: numbers of its ports, by name, in order.
        stopped: why a monitor ended the run; empty while it goes on.
    """

    def __init__(self, station: StationLike) -> None:
        """Build a station.

        Raises:
            SimrobError: as :func:`load_station`.
            InvalidParameter: a kinematic station, which has nothing to step.
        """
        self.config = config_of(station)
        if not self.config.engine.moves_by_forces:
            raise InvalidParameter(
                "mode",
                "kinematic",
                message(
                    "simulink.dynamic_only", "dynamic: a kinematic station has no motion of its own"
                ),
            )
        self.parameters = parameters_of(self.config)
        self.reset()

    def reset(self, parameters: Mapping[str, float] | None = None) -> None:
        """Begin anew: time 0, inputs as at the start, and no parameters but those that are given, if they can be.

        Raises:
            UnknownName: no such parameter.
            InvalidConfig: a value that it cannot have.
        """
        for name in parameters or ():
            if name not in self.parameters:
                raise UnknownName(message("simulink.parameter", "parameter"), name, self.parameters)
        config = self._with(parameters or {})
        self._changed = dict(parameters or {})
        self._held: dict[str, float] = {}
        self._build(config)

    def _with(self, parameters: Mapping[str, float]) -> StationConfig:
        return with_parameters(
            self.config, {self.parameters[name]: value for name, value in parameters.items()}
        )

    def _build(self, config: StationConfig) -> None:
        self._diagram = build_station(config)
        ports = self._diagram.ports
        self.inputs, self.outputs = elements(ports)
        self._simulator = Simulator(self._diagram)
        apply_solver(self._simulator, config)
        self._context = self._simulator.get_mutable_context()
        begun = State.at_start_of(config)
        robots = ports.plant.robots.values()
        references = {robot.name: robot.initial for robot in robots} | (
            begun.references if begun else {}
        )
        starts = {
            f"{robot.prefix}reference": np.array(references[robot.name], dtype=float)
            for robot in robots
        }
        self._inputs = {
            name: starts.get(name, np.zeros(port.size())) for name, port in ports.inputs.items()
        }
        self._fixed = {
            name: self._diagram.GetInputPort(name).FixValue(self._context, values)
            for name, values in self._inputs.items()
        }
        if begun is not None:
            begun.put(self._diagram, ports, self._context)
        self._ports = {name: self._diagram.GetOutputPort(name) for name in ports.outputs}
        self._values: dict[str, Vector] = {}
        self._stale = self._begun = False
        self.stopped = ""
        for name, value in self._held.items():
            self._hold(name, value)

    def _ready(self) -> None:
        if self._stale:
            self._build(self._with(self._changed))

    @property
    def time(self) -> float:
        """Where it is [s]."""
        return float(self._context.get_time())

    def get(self, name: str) -> float:
        """Return an input, an output or a parameter now.

        Raises:
            UnknownName: there is none of this name.
            InvalidConfig: a parameter was set to what it cannot be.
        """
        if name in self.parameters:
            return self._changed.get(name, self.parameters[name].start)
        self._ready()
        if name in self.inputs:
            element = self.inputs[name]
            return float(self._inputs[element.port][element.index])
        if name not in self.outputs:
            raise UnknownName(
                message("simulink.variable", "variable"),
                name,
                [*self.inputs, *self.outputs, *self.parameters],
            )
        element = self.outputs[name]
        if element.port not in self._values:
            self._values[element.port] = self._ports[element.port].Eval(self._context)
        return float(self._values[element.port][element.index])

    def set(self, name: str, value: float) -> None:
        """Set an input, which holds until it is set again, or before the first step a parameter.

        Raises:
            UnknownName: there is none of this name.
            InvalidParameter: a value that is not finite, or a parameter after the first step.
        """
        if name not in self.inputs and name not in self.parameters:
            raise UnknownName(
                message("simulink.input_or_parameter", "input or parameter"),
                name,
                [*self.inputs, *self.parameters],
            )
        if not np.isfinite(value):
            unit = self.inputs[name].unit if name in self.inputs else self.parameters[name].unit
            raise InvalidParameter(
                name,
                value,
                message("simulink.finite_number_in", "a finite number [{unit}]", unit=unit),
            )
        if name in self.inputs:
            self._held[name] = value
            if not self._stale:
                self._hold(name, value)
        elif self._begun:
            raise InvalidParameter(
                name,
                value,
                message(
                    "simulink.before_first_step",
                    "set before the first step: parameters stay as they are then",
                ),
            )
        else:
            self._changed[name] = value
            self._stale = True

    def _hold(self, name: str, value: float) -> None:
        element = self.inputs[name]
        self._inputs[element.port][element.index] = value
        self._fixed[element.port].GetMutableData().get_mutable_value().SetAtIndex(
            element.index, value
        )
        self._values.clear()

    def advance(self, time: float) -> None:
        """Go on to a time [s].

        Raises:
            InvalidConfig: a parameter was set to what it cannot be.
            StepFailed: the simulation diverged, or a monitor has ended it before.
        """
        self._ready()
        if self.stopped:
            raise StepFailed(
                message(
                    "simulink.was_ended",
                    "{station} was ended: {reason}",
                    station=self.config.name,
                    reason=self.stopped,
                )
            )
        self._values.clear()
        try:
            if not self._begun:
                self._simulator.Initialize()
                self._begun = True
            status = self._simulator.AdvanceTo(time)
        except (
            RuntimeError,
            SystemExit,
        ) as problem:  # Drake's failed assertions come as SystemExit
            sentence = " ".join(str(problem).split()).split(". ")[0][:200]
            raise StepFailed(
                message(
                    "simulink.diverged_before",
                    "{station} diverged before {time:.6g} s: {problem}",
                    station=self.config.name,
                    time=time,
                    problem=sentence,
                )
            ) from problem
        if status.reason() == SimulatorStatus.ReturnReason.kReachedTerminationCondition:
            self.stopped = status.message()

    def state(self) -> dict[str, Any]:
        """Return where the station is, as plain numbers."""
        self._ready()
        groups = self._context.get_discrete_state()
        return {
            "time": self.time,
            "continuous": self._context.get_continuous_state_vector().CopyToVector().tolist(),
            "discrete": [groups.value(index).tolist() for index in range(groups.num_groups())],
            "inputs": {name: self.get(name) for name in self.inputs},
            "parameters": dict(self._changed),
            "stopped": self.stopped,
        }

    def put(self, state: Mapping[str, Any]) -> None:
        """Go back to where the station was when ``state`` was returned."""
        if state["parameters"] != self._changed or self._stale:
            self.reset(state["parameters"])
        self._context.SetTime(state["time"])
        self._context.SetContinuousState(np.array(state["continuous"]))
        for index, values in enumerate(state["discrete"]):
            self._context.SetDiscreteState(index, np.array(values))
        for name, value in state["inputs"].items():
            self.set(name, value)
        self.stopped = state["stopped"]
        self._values.clear()
        self._simulator.Initialize()
        self._begun = True


def with_fixed_steps(config: StationConfig, step: float) -> StationConfig:
    """Return a station that takes steps of one length, its servos in the plant's actuators.

    Error control and the blocks of a servo are wasted on steps as short as those between two units: 2 × real time at
    1 ms on an arm become 7 ×, at a first-order error of the step's length.

    Args:
        config: a dynamic station.
        step: [s].

    Raises:
        InvalidParameter: a step that is not positive, or servos that yield to forces or are no PID.
    """
    if not 0 < step <= 0.1:
        raise InvalidParameter(
            "--step", step, message("simulink.time_at_most", "a time of at most 0.1 s")
        )
    servos = [config.servo_of(robot) for robot in config.robots]
    if any(servo.admittance_gain or servo.law != "pid" for servo in servos):
        expected = message(
            "simulink.yielding_servos",
            "servos that yield, or whose law is not pid, cannot be stepped at a fixed rate",
        )
        raise Unsuitable("--step", expected)
    solver = ContinuousSolver(kind="continuous", scheme="cenic", max_step=step, error_control=False)
    implicit = {"realization": "implicit"}
    robots = {
        name: robot.model_copy(
            update={"servo": robot.servo and robot.servo.model_copy(update=implicit)}
        )
        for name, robot in config.robots.items()
    }
    servo = config.servo.model_copy(update=implicit)
    return config.model_copy(update={"solver": solver, "servo": servo, "robots": robots})
