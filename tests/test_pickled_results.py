"""Results travel between processes by pickle: configuration, arrays and states; the plant is built again."""

import multiprocessing
import pickle

import cloudpickle
import numpy as np
import pytest
from pydrake.systems.framework import DiagramBuilder, LeafSystem
from pydrake.systems.primitives import ConstantVectorSource

from simrob_drake import Arm, Runner, add_station, load_station, simulate, simulate_diagram
from simrob_drake.base.errors import SimrobError
from simrob_drake.results.record import rebuilt

pytestmark = pytest.mark.usefixtures("no_plots")


def travelled(result):
    """Return a result after pickling."""
    return pickle.loads(pickle.dumps(result))


def forces(contacts):
    """Contact forces of contact results, shape (k, 3) [N]."""
    infos = [
        contacts.point_pair_contact_info(index)
        for index in range(contacts.num_point_pair_contacts())
    ]
    return np.array([info.contact_force() for info in infos]).reshape(-1, 3)


@pytest.mark.parametrize(
    "station",
    ["humanoid_dynamic", "bouncing_ball", "irb120_force_stop", "irb120_kinematic", "roid1_walking"],
)
def test_what_a_result_computes_is_equal(station):
    result = simulate(load_station(station), duration=0.25, progress=False)
    other = travelled(result)

    np.testing.assert_array_equal(other.values, result.values)
    times = np.linspace(0.0, result.stop_time, 23)
    np.testing.assert_array_equal(other.positions_at(times), result.positions_at(times))
    assert (other.contacts_at is None) == (result.contacts_at is None)
    if result.contacts_at is not None:
        for ours, theirs in zip(result.contacts_at(times), other.contacts_at(times), strict=True):
            np.testing.assert_array_equal(forces(ours), forces(theirs))
    assert other.verdict == result.verdict
    assert other.summary() == result.summary()
    assert (other.units, repr(other)) == (result.units, repr(result))


def test_the_plant_is_built_when_it_is_asked_for():
    other = travelled(simulate(load_station("bouncing_ball"), duration=0.1, progress=False))

    assert other["force.ball.z" if "force.ball.z" in other.names else other.names[0]].size == 11
    assert "plant" not in vars(other)
    assert other.plant.plant.num_positions() == 7
    assert "plant" in vars(other)


def test_a_result_is_small_and_goes_on():
    runner = Runner(load_station("humanoid_dynamic"))
    result = runner.run(duration=0.5)

    content = pickle.dumps(result)

    assert len(content) < 100_000  # at this rate, 10 s are below 2 MB

    again = Runner(load_station("humanoid_dynamic")).resume(pickle.loads(content), until=0.8)
    np.testing.assert_array_equal(again.values, runner.run(duration=0.8).values)


@pytest.mark.long
def test_ten_seconds_of_humanoids_are_below_two_megabytes():
    for station in ("humanoid_dynamic", "zjudancer_walking"):
        result = simulate(load_station(station), duration=10.0, progress=False)
        assert len(pickle.dumps(result)) < 2_000_000


def run_for(duration):
    """Work of another process: a run of a given length [s]."""
    return Runner(load_station("bouncing_ball")).run(duration=duration)


def test_other_processes_return_results():
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        (result,) = pool.map(run_for, [0.2])
    here = run_for(0.2)

    np.testing.assert_array_equal(result.values, here.values)
    # joblib's processes and those of Dask use cloudpickle
    assert cloudpickle.loads(cloudpickle.dumps(here)).summary()["stop_time"] == 0.2


def test_a_runner_itself_is_sent_to_processes():
    runner = pickle.loads(pickle.dumps(Runner(load_station("bouncing_ball"))))
    np.testing.assert_array_equal(runner.run(duration=0.2).values, run_for(0.2).values)


def test_a_result_is_saved_after_it_travelled(tmp_path):
    result = simulate(load_station("irb120_dynamic"), duration=0.2, progress=False)
    folder = result.save(tmp_path / "here", recording=False)

    other = travelled(result).save(tmp_path / "there", recording=False)

    assert (folder / "signals.csv").read_bytes() == (other / "signals.csv").read_bytes()
    assert (folder / "station.yaml").read_bytes() == (other / "station.yaml").read_bytes()


def test_moves_and_programs_travel():
    arm = Arm("irb120_workcell", tool="pencil")
    arm.record()
    arm.move_abs_j([0, 0, 0, 0, np.pi / 2, 0], duration=0.3)
    arm.move_abs_j([0.1, 0, 0, 0, np.pi / 2, 0], duration=0.3)
    program = arm.result()

    other = travelled(program)

    assert other.verdict == program.verdict
    times = np.linspace(0.0, program.stop_time, 11)
    np.testing.assert_array_equal(other.positions_at(times), program.positions_at(times))
    assert [run.verdict for run in other.runs] == [run.verdict for run in program.runs]


class Still(LeafSystem):
    """A block that cannot be made again: its constructor takes what is nowhere recorded."""

    def __init__(self, value):
        super().__init__()
        self._value = value
        self.DeclareContinuousState(1)
        self.DeclareVectorOutputPort(
            "reference", 6, lambda _, output: output.SetFromVector(np.full(6, value))
        )


def test_a_run_whose_diagram_cannot_be_built_again_keeps_its_motion():
    result = simulate(
        load_station("irb120_dynamic"), blocks={"still": Still(0.1)}, duration=0.1, progress=False
    )
    other = travelled(result)

    np.testing.assert_allclose(
        other.positions_at(result.times), result.positions_at(result.times), atol=1e-12
    )
    assert other.verdict == result.verdict


def test_a_run_in_a_diagram_of_ones_own_keeps_its_motion():
    builder = DiagramBuilder()
    ports = add_station(builder, "irb120_dynamic")
    source = builder.AddSystem(ConstantVectorSource(np.full(6, 0.1)))
    builder.Connect(source.get_output_port(), ports.inputs["reference"])
    result = simulate_diagram(builder.Build(), ports, duration=0.2, progress=False)

    other = travelled(result)

    np.testing.assert_allclose(
        other.positions_at(result.times), result.positions_at(result.times), atol=1e-12
    )
    assert other.summary() == result.summary()


def test_a_result_of_another_version_is_refused(monkeypatch):
    result = simulate(load_station("bouncing_ball"), duration=0.05, progress=False)
    content = pickle.dumps(result)

    monkeypatch.setattr("simrob_drake.results.record.rebuilt.FORMAT", rebuilt.FORMAT + 1)

    with pytest.raises(
        SimrobError,
        match=r"another version of simrob_drake .*\(format 1; this version reads format 2\)\. Run the station",
    ):
        pickle.loads(content)
