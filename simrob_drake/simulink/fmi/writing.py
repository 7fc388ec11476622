"""Write a station as a unit: a file that Simulink, OpenModelica, FMPy and others load."""

import shutil
import sys
import tempfile
from pathlib import Path

from simrob_drake.arguments import as_path
from simrob_drake.errors import InvalidParameter, OutputError
from simrob_drake.extras import needed
from simrob_drake.folders import replaced_at_once, writing
from simrob_drake.simulink.fmi.unit import SteppedStation
from simrob_drake.simulink.writing.names import plain
from simrob_drake.stations.carried import FILES, carried
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.load import station_yaml
from simrob_drake.stations.solver_config import ContinuousSolver

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
