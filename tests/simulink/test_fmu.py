"""Units in FMPy: the signals of `simulate`, states kept and put back, two at once, and failures in words."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from simrob_drake import load_station, simulate
from simrob_drake.errors import InvalidParameter, OutputError
from simrob_drake.simulink.fmi.unit import StepFailed, SteppedStation, with_fixed_steps, write_fmu

pytest.importorskip("pythonfmu")
fmpy = pytest.importorskip("fmpy")
STEP = 1e-3


class Unit:
    """An instance of a unit, its variables by name."""

    def __init__(self, folder, description, heard=None):
        from fmpy.simulation import instantiate_fmu

        self.heard = []
        self._references = {variable.name: variable.valueReference for variable in description.modelVariables}
        logger = lambda *arguments: self.heard.append(arguments[-1].decode())  # noqa: E731
        self.fmu = instantiate_fmu(folder, description, "CoSimulation", debug_logging=True, logger=logger)
        self.fmu.setupExperiment(startTime=0.0)
        self.fmu.enterInitializationMode()
        self.fmu.exitInitializationMode()

    def set(self, **values):
        names = [name.replace("__", ".") for name in values]
        self.fmu.setReal([self._references[name] for name in names], list(values.values()))

    def get(self, *names):
        return np.array(self.fmu.getReal([self._references[name] for name in names]))

    def run(self, first, last):
        for step in range(first, last):
            self.fmu.doStep(step * STEP, STEP)


@pytest.fixture(scope="module")
def unit_of(tmp_path_factory):
    def made(config):
        file = write_fmu(config, tmp_path_factory.mktemp("fmu") / "station.fmu")
        return fmpy.extract(str(file)), fmpy.read_model_description(str(file))

    return made


@pytest.fixture(scope="module")
def pendulum(unit_of):
    return unit_of(with_fixed_steps(load_station("double_pendulum"), STEP))


def test_the_description_is_valid_and_tells_units(tmp_path):
    from fmpy.validation import validate_fmu

    file = write_fmu(load_station("irb120_dynamic"), tmp_path / "arm.fmu")
    assert validate_fmu(str(file)) == []
    variables = {variable.name: variable for variable in fmpy.read_model_description(str(file)).modelVariables}
    assert (variables["reference.joint_2"].causality, variables["reference.joint_2"].unit) == ("input", "rad")
    assert (variables["torque.joint_6"].causality, variables["torque.joint_6"].unit) == ("output", "N.m")
    assert variables["tcp_pose.x"].unit == "m"


def test_signals_are_those_of_simulate(unit_of):
    """Both take the same steps of 1 ms to a constant reference."""
    config = with_fixed_steps(load_station("double_pendulum"), STEP)
    unit = Unit(*unit_of(config))
    unit.set(reference__joint_1=0.9, reference__joint_2=0.3)
    names = ["position.joint_1", "position.joint_2", "torque.joint_1", "velocity.joint_2", "tcp_pose.z"]
    rows = [unit.get(*names)]
    for step in range(500):
        unit.run(step, step + 1)
        rows.append(unit.get(*names))
    target = np.array([[0.0, 0.9, 0.3], [10.0, 0.9, 0.3]])
    config = config.model_copy(update={"sample_rate": 1000.0})
    result = simulate(config, reference=target, duration=0.5, progress=False)
    expected = [
        result["q.joint_1"],
        result["q.joint_2"],
        result["tau.joint_1"],
        result["v.joint_2"],
        result.pose("tcp")[:, 2],
    ]
    np.testing.assert_allclose(np.array(rows), np.transpose(expected), atol=1e-6)


def test_a_state_is_kept_and_put_back(pendulum):
    unit = Unit(*pendulum)
    unit.set(reference__joint_1=1.0)
    unit.run(0, 100)
    state = unit.fmu.getFMUState()
    kept = unit.fmu.serializeFMUState(state)
    unit.run(100, 200)
    expected = unit.get("position.joint_1", "velocity.joint_2")
    unit.fmu.setFMUState(state)
    unit.run(100, 200)
    np.testing.assert_array_equal(unit.get("position.joint_1", "velocity.joint_2"), expected)
    unit.fmu.setFMUState(unit.fmu.deSerializeFMUstate(kept, state))
    unit.run(100, 200)
    np.testing.assert_array_equal(unit.get("position.joint_1", "velocity.joint_2"), expected)


def test_two_instances_do_not_touch_each_other(pendulum):
    one, other = Unit(*pendulum), Unit(*pendulum)
    one.set(reference__joint_1=1.2)
    before = other.get("position.joint_1")
    one.run(0, 200)
    assert one.get("position.joint_1") > before + 0.05
    np.testing.assert_array_equal(other.get("position.joint_1"), before)


def test_a_step_that_cannot_be_is_told_in_words(unit_of):
    from fmpy.fmi1 import FMICallException

    config = load_station("double_pendulum", {"monitors": {"settled": {"hold": 0.05, "speed_deg": 100}}})
    unit = Unit(*unit_of(config))
    with pytest.raises(FMICallException):
        unit.run(0, 1000)
    assert any("was ended: the robot has stood still" in words for words in unit.heard)


def test_an_input_that_is_no_number_fails_the_step_and_can_be_mended(pendulum):
    from fmpy.fmi1 import FMICallException

    unit = Unit(*pendulum)
    unit.set(reference__joint_1=float("nan"))
    with pytest.raises(FMICallException):
        unit.run(0, 1)
    assert any("reference.joint_1 is nan; it must be a finite number [rad]" in words for words in unit.heard)
    unit.set(reference__joint_1=0.7)
    unit.run(0, 10)
    assert np.isfinite(unit.get("position.joint_1"))


ARM = """<robot name="arm"><link name="base"/>
  <link name="tip"><inertial><origin xyz="0.1 0 0"/><mass value="1"/>
    <inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>
    <visual><geometry><mesh filename="wedge.obj"/></geometry></visual></link>
  <joint name="j" type="revolute"><parent link="base"/><child link="tip"/><axis xyz="0 1 0"/>
    <limit lower="-1" upper="1" effort="9" velocity="2"/></joint></robot>"""


def test_a_unit_carries_the_files_of_its_station(tmp_path):
    own = tmp_path / "own"
    own.mkdir()
    (own / "arm.urdf").write_text(ARM)
    (own / "wedge.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n")
    (own / "table.csv").write_text("time,j\n0,0\n1,0.5\n")
    reference = "reference: {kind: table, file: table.csv}"
    (own / "station.yaml").write_text(f"mode: dynamic\nrobot: {{urdf: arm.urdf}}\n{reference}\n")
    file = write_fmu(load_station(own / "station.yaml"), tmp_path / "arm.fmu")
    shutil.rmtree(own)
    station = SteppedStation(Path(fmpy.extract(str(file), str(tmp_path / "unit"))) / "resources" / "station.yaml")
    station.advance(0.1)
    [angle] = [element for element in station.outputs if element.name == "position.j"]
    assert np.isfinite(station.get(angle))
    shown = [path.name for path in (tmp_path / "unit" / "resources" / "files").rglob("*") if path.is_file()]
    assert "arm.urdf" in shown
    assert "table.csv" in shown
    assert any(name.endswith(".obj") for name in shown)


def test_stepping_fails_in_words():
    station = SteppedStation("double_pendulum")
    (element, *_) = station.inputs
    with pytest.raises(InvalidParameter, match=r"reference\.joint_1 is nan"):
        station.set(element, float("nan"))
    station.stopped = "the arm stands"
    with pytest.raises(StepFailed, match="was ended: the arm stands"):
        station.advance(1.0)


def test_what_cannot_be_written(tmp_path):
    with pytest.raises(InvalidParameter, match="kinematic"):
        write_fmu(load_station("irb120_kinematic"), tmp_path / "a.fmu")
    with pytest.raises(InvalidParameter, match=r"\.fmu"):
        write_fmu(load_station("double_pendulum"), tmp_path / "a.zip")
    (tmp_path / "b.fmu").touch()
    with pytest.raises(OutputError, match="--force"):
        write_fmu(load_station("double_pendulum"), tmp_path / "b.fmu")
    with pytest.raises(InvalidParameter, match="--step"):
        with_fixed_steps(load_station("double_pendulum"), 0.0)
    with pytest.raises(InvalidParameter, match="servos that yield"):
        with_fixed_steps(load_station("irb120_cobot"), STEP)
