"""A station as a unit: stepped from outside, and the file that Simulink, OpenModelica, FMPy and others load."""

import shutil
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pydrake.systems.analysis import Simulator, SimulatorStatus
from pydrake.systems.framework import DiagramBuilder

from simrob_drake import add_station, apply_solver
from simrob_drake.arguments import as_path
from simrob_drake.errors import InvalidParameter, OutputError
from simrob_drake.extras import needed
from simrob_drake.folders import replaced_at_once, writing
from simrob_drake.frames import Vector
from simrob_drake.results.record.state import State
from simrob_drake.simulink.writing.urdf import plain
from simrob_drake.stations.carried import FILES, carried
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.load import load_station, station_yaml
from simrob_drake.stations.solver_config import ContinuousSolver

POSE = ("x", "y", "z", "qw", "qx", "qy", "qz")
"""Elements of a pose."""
_ELEMENTS = {
    "pose": (POSE, ("m", "m", "m", "1", "1", "1", "1")),
    "velocity": (("vx", "vy", "vz", "wx", "wy", "wz"), ("m/s",) * 3 + ("rad/s",) * 3),
    "force": (("x", "y", "z"), ("N",) * 3),
    "moment": (("x", "y", "z"), ("N.m",) * 3),
    "distance": (("distance",), ("m",)),
}


class StepFailed(RuntimeError):
    """A step that the station could not take: why, in words."""


@dataclass(frozen=True)
class Element:
    """One number of a port.

    Attributes:
        name: ``<port>.<element>``.
        port, index: where it is.
        unit: of SI.
    """

    name: str
    port: str
    index: int
    unit: str


class SteppedStation:
    """A station whose inputs the caller sets and whose time the caller advances.

    Attributes:
        config: the station.
        inputs, outputs: their elements, in order.
        stopped: why a monitor ended the run; empty while it goes on.
    """

    def __init__(self, station: str | Path) -> None:
        """Build a station.

        Raises:
            SimrobError: as :func:`load_station`.
            InvalidParameter: a kinematic station, which has nothing to step.
        """
        self.config = load_station(station)
        if self.config.mode == "kinematic":
            raise InvalidParameter("mode", "kinematic", "dynamic: a kinematic station has no motion of its own")
        builder = DiagramBuilder()
        ports = add_station(builder, self.config)
        for name, port in ports.inputs.items():
            builder.ExportInput(port, name)
        for name, output in ports.outputs.items():
            builder.ExportOutput(output, name)
        self._diagram = builder.Build()
        self._simulator = Simulator(self._diagram)
        apply_solver(self._simulator, self.config)
        self._context = self._simulator.get_mutable_context()
        robots = ports.plant.robots.values()
        axes = {robot.prefix: list(zip(robot.axes, robot.model.units, strict=True)) for robot in robots}
        begun = State.at_start_of(self.config)
        references = {robot.name: robot.initial for robot in robots} | (begun.references if begun else {})
        starts = {f"{robot.prefix}reference": np.array(references[robot.name], dtype=float) for robot in robots}
        self.inputs = [element for name, port in ports.inputs.items() for element in _elements(name, port.size(), axes)]
        self.outputs = [
            element for name, output in ports.outputs.items() for element in _elements(name, output.size(), axes)
        ]
        self._inputs = {name: starts.get(name, np.zeros(port.size())) for name, port in ports.inputs.items()}
        self._fixed = {
            name: self._diagram.GetInputPort(name).FixValue(self._context, values)
            for name, values in self._inputs.items()
        }
        if begun is not None:
            begun.put(self._diagram, ports, self._context)
        self._outputs = {name: self._diagram.GetOutputPort(name) for name in ports.outputs}
        self._values: dict[str, Vector] = {}
        self._begun = False
        self.stopped = ""

    def get(self, element: Element) -> float:
        """Return an element of an input or output now."""
        if element.port in self._fixed:
            return float(self._inputs[element.port][element.index])
        if element.port not in self._values:
            self._values[element.port] = self._outputs[element.port].Eval(self._context)
        return float(self._values[element.port][element.index])

    def set(self, element: Element, value: float) -> None:
        """Set an element of an input; it holds until it is set again.

        Raises:
            InvalidParameter: a value that is not finite.
        """
        if not np.isfinite(value):
            raise InvalidParameter(element.name, value, f"a finite number [{element.unit}]")
        self._inputs[element.port][element.index] = value
        self._fixed[element.port].GetMutableData().get_mutable_value().SetAtIndex(element.index, value)
        self._values.clear()

    def advance(self, time: float) -> None:
        """Go on to a time [s].

        Raises:
            StepFailed: the simulation diverged, or a monitor has ended it before.
        """
        if self.stopped:
            raise StepFailed(f"{self.config.name} was ended: {self.stopped}")
        self._values.clear()
        try:
            if not self._begun:
                self._simulator.Initialize()
                self._begun = True
            status = self._simulator.AdvanceTo(time)
        except (RuntimeError, SystemExit) as problem:  # Drake's failed assertions come as SystemExit
            raise StepFailed(f"{self.config.name} diverged before {time:.6g} s: {_sentence(problem)}") from problem
        if status.reason() == SimulatorStatus.ReturnReason.kReachedTerminationCondition:
            self.stopped = status.message()

    def state(self) -> dict[str, Any]:
        """Return where the station is, as plain numbers."""
        context = self._context
        groups = context.get_discrete_state()
        return {
            "time": context.get_time(),
            "continuous": context.get_continuous_state_vector().CopyToVector().tolist(),
            "discrete": [groups.value(index).tolist() for index in range(groups.num_groups())],
            "inputs": {name: values.tolist() for name, values in self._inputs.items()},
            "stopped": self.stopped,
        }

    def put(self, state: dict[str, Any]) -> None:
        """Go back to where the station was when ``state`` was returned."""
        context = self._context
        context.SetTime(state["time"])
        context.SetContinuousState(np.array(state["continuous"]))
        for index, values in enumerate(state["discrete"]):
            context.SetDiscreteState(index, np.array(values))
        for name, values in state["inputs"].items():
            self._inputs[name] = np.array(values)
            self._fixed[name].GetMutableData().get_mutable_value().SetFromVector(self._inputs[name])
        self.stopped = state["stopped"]
        self._values.clear()
        self._simulator.Initialize()
        self._begun = True


def _elements(port: str, size: int, axes: dict[str, list[tuple[str, Any]]]) -> list[Element]:
    """Return the elements of a port with names and units: by axis, or by what kind of quantity it is."""
    for prefix, named in sorted(axes.items(), key=lambda entry: -len(entry[0])):
        own = port.removeprefix(prefix)
        if port.startswith(prefix) and size == len(named) and own.partition(".")[0] in _PER_AXIS:
            return [
                Element(f"{port}.{axis}", port, index, _PER_AXIS[own.partition(".")[0]](unit))
                for index, (axis, unit) in enumerate(named)
            ]
    for kind, (names, units) in _ELEMENTS.items():
        if kind in port and len(names) == size:
            return [
                Element(port if size == 1 else f"{port}.{name}", port, index, unit)
                for index, (name, unit) in enumerate(zip(names, units, strict=True))
            ]
    return [Element(f"{port}.{index}", port, index, "1") for index in range(size)]


def _effort(unit: Any) -> str:
    return str(unit.effort).replace("·", ".")


_PER_AXIS = {
    "reference": lambda unit: unit.si,
    "position": lambda unit: unit.si,
    "velocity": lambda unit: f"{unit.si}/s",
    "reference_velocity": lambda unit: f"{unit.si}/s",
    "reference_acceleration": lambda unit: f"{unit.si}/s2",
    "torque": _effort,
    "feedforward": _effort,
    "joint_torque": _effort,
    "external_torque": _effort,
    "felt_torque": _effort,
}


def _sentence(problem: BaseException) -> str:
    return " ".join(str(problem).split()).split(". ")[0][:200]


_SCRIPT = '''"""A station as a unit; simrob_drake must be importable where it runs."""

from simrob_drake.simulink.fmi.slave import StationSlave, keep

keep(globals())


class {name}(StationSlave):
    pass
'''


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
        raise InvalidParameter("--step", step, "a time of at most 0.1 s")
    servos = [config.servo_of(robot) for robot in config.robots]
    if any(servo.admittance_gain or servo.law != "pid" for servo in servos):
        raise InvalidParameter(
            "--step", step, "left out with servos that yield or are no PID: they need their own blocks"
        )
    solver = ContinuousSolver(kind="continuous", scheme="cenic", max_step=step, error_control=False)
    servo = config.servo.model_copy(update={"realization": "implicit"})
    robots = {
        name: robot.model_copy(update={"servo": robot.servo.model_copy(update={"realization": "implicit"})})
        if robot.servo
        else robot
        for name, robot in config.robots.items()
    }
    return config.model_copy(update={"solver": solver, "servo": servo, "robots": robots})


def write_fmu(config: StationConfig, target: Path | str, *, force: bool = False) -> Path:
    """Write a station as an FMI 2.0 co-simulation unit.

    Where the unit runs, this package must be importable by the Python it finds there. The files that the station
    names, such as those of robots and pieces, are in the unit.

    Args:
        config: the station.
        target: the file, ending in ``.fmu``.
        force: replace a file that is there.

    Raises:
        InvalidParameter: a kinematic station, a target of another ending, or pythonfmu is not installed.
        OutputError: the file is there, or the disk does not take it.
    """
    with needed("simrob fmu", "fmi"):
        from pythonfmu import FmuBuilder
    target = as_path(target, "target")
    if target.suffix != ".fmu":
        raise InvalidParameter("--out", str(target), "a file that ends in .fmu")
    if target.exists() and not force:
        raise OutputError(f"{target} exists already; choose another file or replace it with --force")
    name = f"{plain(config.name)}_unit"
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        script, station = work / f"{name}.py", work / "station.yaml"
        station.write_text(station_yaml(carried(config, work)), encoding="utf-8")
        SteppedStation(station)  # what cannot be stepped is told here, in our words
        script.write_text(_SCRIPT.format(name=name), encoding="utf-8")
        before = list(sys.path)
        try:
            made = FmuBuilder.build_FMU(
                script,
                dest=work / "made",
                project_files=[station, *work.glob(FILES)],
                canGetAndSetFMUstate="true",
                canSerializeFMUstate="true",
            )
        finally:
            sys.path[:] = before
            sys.modules.pop(name, None)
        with writing(target):
            target.parent.mkdir(parents=True, exist_ok=True)
        with replaced_at_once(target) as whole:
            shutil.copyfile(made, whole)
    return target
