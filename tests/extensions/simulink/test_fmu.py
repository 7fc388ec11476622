"""Units in FMPy: the signals of `simulate`, parameters, states put back, several at once, and failures in words."""

import shutil
from zipfile import ZipFile

import numpy as np
import pytest

from simrob_drake import load_station, simulate
from simrob_drake.base.errors import InvalidParameter, OutputError
from simrob_drake.cli.app import run_command
from simrob_drake.extensions.simulink.fmi.unit import write_fmu
from simrob_drake.extensions.simulink.stepping.station import with_fixed_steps

pytest.importorskip("pythonfmu")
pytest.importorskip("pythonfmu3")
fmpy = pytest.importorskip("fmpy")
STEP = 1e-3
VERSIONS = (2, 3)
EIGHT = ("double_pendulum", "irb120_force_control", "irb120_cobot", "two_irb120", "zjudancer_walking",
         "yobotics_walking", "roid1_balance", "bouncing_ball")  # fmt: skip


class Unit:
    """An instance of a unit, its variables by name."""

    def __init__(self, folder, description, **parameters):
        from fmpy.simulation import instantiate_fmu

        self.heard, self._description = [], description
        self._references = {
            variable.name: variable.valueReference for variable in description.modelVariables
        }
        logger = lambda *arguments: self.heard.append(arguments[-1].decode())  # noqa: E731
        self.fmu = instantiate_fmu(
            folder, description, "CoSimulation", debug_logging=True, logger=logger
        )
        self._real = "Float64" if description.fmiVersion == "3.0" else "Real"
        self.begin(**parameters)

    def begin(self, **parameters):
        if self._real == "Real":
            self.fmu.setupExperiment(startTime=0.0)
        self.fmu.enterInitializationMode()
        if parameters:
            self.set(**parameters)
        self.fmu.exitInitializationMode()

    def set(self, **values):
        names = [name.replace("__", ".") for name in values]
        getattr(self.fmu, f"set{self._real}")(
            [self._references[name] for name in names], list(values.values())
        )

    def get(self, *names):
        return np.array(
            getattr(self.fmu, f"get{self._real}")([self._references[name] for name in names])
        )

    def run(self, first, last):
        for step in range(first, last):
            self.fmu.doStep(step * STEP, STEP)


@pytest.fixture(scope="module")
def unit_of(tmp_path_factory):
    def made(config, version=2):
        file = write_fmu(config, tmp_path_factory.mktemp("fmu") / "station.fmu", version=version)
        return fmpy.extract(str(file)), fmpy.read_model_description(str(file))

    return made


@pytest.fixture(scope="module", params=VERSIONS)
def pendulum(unit_of, request):
    return unit_of(with_fixed_steps(load_station("double_pendulum"), STEP), request.param)


@pytest.mark.parametrize("version", VERSIONS)
def test_the_description_is_valid_and_tells_units(tmp_path, version):
    from fmpy.validation import validate_fmu

    push = {"kind": "push", "at": "robot", "force": [1.0, 0.0, 0.0]}
    file = write_fmu(
        load_station("double_pendulum", {"forces.push": push}), tmp_path / "a.fmu", version=version
    )
    assert validate_fmu(str(file)) == []
    description = fmpy.read_model_description(str(file))
    assert description.fmiVersion == f"{version}.0"
    told = {
        variable.name: (variable.causality, variable.unit)
        for variable in description.modelVariables
    }
    assert told["reference.joint_2"] == ("input", "rad")
    assert told["torque.joint_2"] == ("output", "N.m")
    assert told["tcp_pose.x"] == ("output", "m")
    assert told["servo.kd.joint_1"] == ("parameter", "N.m.s/rad")
    assert told["forces.push.force[3]"] == ("parameter", "N")
    bases = {unit.name: unit.baseUnit for unit in description.unitDefinitions}
    assert (bases["N.m/rad"].kg, bases["N.m/rad"].m, bases["N.m/rad"].s, bases["N.m/rad"].rad) == (
        1,
        2,
        -2,
        -1,
    )


def test_a_unit_holds_no_library_that_cannot_work(tmp_path):
    """There is no Drake for Windows. The libraries' licence goes with them."""
    for version in VERSIONS:
        names = ZipFile(
            write_fmu(load_station("double_pendulum"), tmp_path / f"{version}.fmu", version=version)
        ).namelist()
        assert [name for name in names if name.endswith((".so", ".dll"))] == [
            f"binaries/{'linux64' if version == 2 else 'x86_64-linux'}/double_pendulum_unit.so"
        ]
        assert any(name.startswith("documentation/licenses/pythonfmu") for name in names)


@pytest.mark.long
@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("name", EIGHT)
def test_eight_stations(unit_of, tmp_path, name, version):
    """Valid; two instances of which one has less gravity; after a reset the first steps are as they were."""
    from fmpy.validation import validate_fmu

    assert (
        validate_fmu(str(write_fmu(load_station(name), tmp_path / "a.fmu", version=version))) == []
    )
    made = unit_of(load_station(name), version)
    watched = [
        v.name
        for v in made[1].modelVariables
        if v.causality == "output" and v.type in ("Real", "Float64")
    ]
    one, light = Unit(*made), Unit(*made, gravity=1.0)
    rows = []
    for unit in (one, light, one):
        if rows and unit is one:
            one.fmu.reset()
            one.begin()
        unit.run(0, 20)
        rows.append(unit.get(*watched))
    assert np.isfinite(rows).all()
    np.testing.assert_array_equal(rows[2], rows[0])
    assert not np.array_equal(rows[1], rows[0])


def test_signals_are_those_of_simulate(unit_of):
    """Both take the same steps of 1 ms to a constant reference."""
    config = with_fixed_steps(load_station("double_pendulum"), STEP)
    unit = Unit(*unit_of(config))
    unit.set(reference__joint_1=0.9, reference__joint_2=0.3)
    names = [
        "position.joint_1",
        "position.joint_2",
        "torque.joint_1",
        "velocity.joint_2",
        "tcp_pose.z",
    ]
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


def test_parameters_are_set_before_the_first_step(pendulum):
    """A weaker servo lags; `simulate` with the same gain says by how much. Nothing of it is left after a reset."""
    weak = Unit(*pendulum, servo__kp__joint_1=40.0, gravity=5.0)
    assert list(weak.get("servo.kp.joint_1", "servo.kp.joint_2", "gravity")) == [40, 100, 5]
    weak.set(reference__joint_1=0.9)
    weak.run(0, 300)
    config = load_station(
        "double_pendulum", {"servo.kp.joint_1": 40, "gravity": 5, "sample_rate": 1000}
    )
    target = np.array(
        [[0.0, 0.9, weak.get("reference.joint_2")[0]], [9.0, 0.9, weak.get("reference.joint_2")[0]]]
    )
    result = simulate(
        with_fixed_steps(config, STEP), reference=target, duration=0.3, progress=False
    )
    assert weak.get("position.joint_1")[0] == pytest.approx(result["q.joint_1"][-1], abs=1e-6)
    weak.fmu.reset()
    weak.begin()
    assert list(weak.get("servo.kp.joint_1", "gravity")) == [100, 9.81]


@pytest.mark.parametrize(
    ("values", "told"),
    [
        ({"gravity": 1e6}, "parameters: gravity: must be at most 10000"),
        ({"servo__kp__joint_1": -3.0}, "a gain must be between 0 and"),
    ],
)
def test_a_parameter_that_cannot_be_is_told_by_the_first_step(pendulum, values, told):
    from fmpy.fmi1 import FMICallException

    unit = Unit(*pendulum, **values)
    with pytest.raises(FMICallException):
        unit.run(0, 1)
    assert any(told in words for words in unit.heard), unit.heard
    late = Unit(*pendulum)
    late.run(0, 1)
    late.set(gravity=2.0)
    with pytest.raises(FMICallException):
        late.run(1, 2)
    assert any("set before the first step" in words for words in late.heard)


def test_a_state_is_kept_and_put_back(pendulum):
    unit = Unit(*pendulum, gravity=5.0)
    unit.set(reference__joint_1=1.0)
    unit.run(0, 100)
    state = unit.fmu.getFMUState()
    kept = unit.fmu.serializeFMUState(state)
    unit.run(100, 200)
    expected = unit.get("position.joint_1", "velocity.joint_2", "time")
    unit.fmu.setFMUState(state)
    unit.run(100, 200)
    np.testing.assert_array_equal(
        unit.get("position.joint_1", "velocity.joint_2", "time"), expected
    )
    other = Unit(*pendulum)  # with other parameters
    deserialize = getattr(other.fmu, "deSerializeFMUstate", None) or other.fmu.deserializeFMUState
    other.fmu.setFMUState(deserialize(kept, state))
    other.run(100, 200)
    np.testing.assert_array_equal(
        other.get("position.joint_1", "velocity.joint_2", "time"), expected
    )


def test_instances_do_not_touch_each_other(pendulum):
    """A unit of pythonfmu lost its module with the second instance."""
    one, other = Unit(*pendulum), Unit(*pendulum)
    one.set(reference__joint_1=1.2)
    before = other.get("position.joint_1")
    one.run(0, 200)
    assert one.get("position.joint_1") > before + 0.05
    np.testing.assert_array_equal(other.get("position.joint_1"), before)
    for _ in range(8):
        gone = Unit(*pendulum)
        gone.run(0, 1)
        gone.fmu.terminate()
        gone.fmu.freeInstance()
    other.run(0, 1)


def test_a_step_that_cannot_be_is_told_in_words(unit_of):
    from fmpy.fmi1 import FMICallException

    config = load_station(
        "double_pendulum", {"monitors": {"settled": {"hold": 0.05, "speed_deg": 100}}}
    )
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
    assert any(
        "reference.joint_1 is nan; it must be a finite number [rad]" in words
        for words in unit.heard
    )
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
    """A robot, a mesh, a table, a piece and the start that lie elsewhere; it runs when they are gone."""
    own = tmp_path / "own"
    own.mkdir()
    (own / "arm.urdf").write_text(ARM)
    (own / "wedge.obj").write_text(
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n"
    )
    (own / "table.csv").write_text("time,j\n0,0\n1,0.5\n")
    (own / "stone.yaml").write_text("mass: 0.3\nshapes: [{box: [0.1, 0.1, 0.1]}]\n")
    (own / "first.yaml").write_text("mode: dynamic\nrobot: {urdf: arm.urdf}\n")
    begun = simulate(own / "first.yaml", duration=0.1, progress=False)
    (own / "start.json").write_text(begun.final_state.to_json())
    (own / "station.yaml").write_text(
        "mode: dynamic\nrobot: {urdf: arm.urdf}\nreference: {kind: table, file: table.csv}\n"
        "pieces: {stone: {model: stone.yaml, parent: robot}}\nstart: start.json\n"
    )
    start = simulate(own / "station.yaml", duration=0.01, progress=False)["q.j"][0]
    file = write_fmu(load_station(own / "station.yaml"), tmp_path / "arm.fmu", version=3)
    shutil.rmtree(own)
    unit = Unit(fmpy.extract(str(file)), fmpy.read_model_description(str(file)))
    np.testing.assert_allclose(unit.get("position.j", "pieces.stone.mass"), [start, 0.3], atol=1e-9)
    unit.run(0, 10)
    assert np.isfinite(unit.get("position.j"))
    names = ZipFile(file).namelist()
    for carried in ("arm.urdf", "table.csv", "stone.yaml", "start.json", ".obj"):
        assert any(
            name.startswith("resources/files/") and name.endswith(carried) for name in names
        ), carried


def test_what_cannot_be_written(tmp_path, capsys):
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
    assert (
        run_command(["fmu", "double_pendulum", "--fmi", "1", "--out", str(tmp_path / "c.fmu")]) == 2
    )
    assert "--fmi is 1; it must be 2 or 3" in capsys.readouterr().err
