"""Stations in Drake's RobotDiagramBuilder and ModelVisualizer, and in several threads."""

import gc
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from pydrake.geometry import Meshcat, MeshcatParams
from pydrake.planning import RobotDiagramBuilder
from pydrake.systems.analysis import Simulator
from pydrake.systems.primitives import ConstantVectorSource
from pydrake.visualization import ModelVisualizer

from simrob_drake import (
    Runner,
    build_station,
    load_station,
    place_station,
    simulate,
    simulate_diagram,
)
from simrob_drake.base.errors import SimrobError


def own_gravity(plant, config):
    plant.mutable_gravity_field().set_gravity_vector([0, 0, -config.gravity])


def test_a_station_in_a_robot_diagram():
    config = load_station("irb120_dynamic")
    robot_builder = RobotDiagramBuilder(time_step=0.0)
    plant = robot_builder.plant()
    own_gravity(plant, config)
    placed = place_station(plant, config, scene_graph=robot_builder.scene_graph())
    plant.Finalize()
    builder = robot_builder.builder()
    ports = placed.wire(builder)
    source = builder.AddSystem(ConstantVectorSource(np.full(6, 0.2)))
    builder.Connect(source.get_output_port(), ports.inputs["reference"])
    diagram = robot_builder.Build()
    result = simulate_diagram(diagram, ports, duration=0.2, progress=False)

    expected = simulate(
        config, reference=([0.0, 1.0], np.full((2, 6), 0.2)), duration=0.2, progress=False
    )

    np.testing.assert_allclose(result.values, expected.values, atol=1e-12)

    context = diagram.CreateDefaultContext()
    assert diagram.plant_context(context).num_continuous_states() == 12


def test_a_station_in_a_model_visualizer():
    visualizer = ModelVisualizer(
        meshcat=Meshcat(MeshcatParams(host="localhost")), publish_contacts=False
    )
    plant = visualizer.parser().plant()
    # The plant of a ModelVisualizer is discrete.
    solver = {"kind": "discrete", "scheme": "lagged", "time_step": plant.time_step()}
    config = load_station("irb120_dynamic", {"solver": solver, "servo.realization": "implicit"})
    own_gravity(plant, config)
    place_station(plant, config, scene_graph=visualizer.parser().scene_graph())
    visualizer.Finalize()

    visualizer.Run(loop_once=True, position=np.full(6, 0.1))

    assert plant.num_positions() == 6

    # Drake ends the process if a Meshcat is destroyed in another thread, as by its garbage collection.
    del visualizer, plant
    gc.collect()


@pytest.mark.parametrize("station", ["irb120_dynamic", "bouncing_ball"])
def test_each_thread_has_a_runner_of_its_own(station):
    """The configuration is shared: it does not change. Results are those of one thread, to the last bit."""
    config = load_station(station)
    expected = simulate(config, duration=0.3, progress=False).values

    with ThreadPoolExecutor(4) as pool:
        results = list(pool.map(lambda _: Runner(config).run(duration=0.3).values, range(8)))

    for values in results:
        np.testing.assert_array_equal(values, expected)


def test_results_are_read_by_several_threads():
    result = simulate("irb120_dynamic", duration=0.2, progress=False)
    with ThreadPoolExecutor(4) as pool:
        verdicts = list(pool.map(lambda _: str(result.verdict), range(8)))
        columns = list(pool.map(lambda name: result[name].sum(), result.names))

    assert len(set(verdicts)) == 1
    np.testing.assert_allclose(columns, result.values.sum(axis=0))


def test_a_built_station_has_a_context_for_each_thread():
    """A station of Drake's own blocks alone: threads share the diagram, and each has a context."""
    station = build_station("irb120_dynamic")

    def step(angle):
        simulator = Simulator(station)
        station.GetInputPort("reference").FixValue(
            simulator.get_mutable_context(), np.full(6, angle)
        )
        simulator.AdvanceTo(0.05)
        return simulator.get_context().get_continuous_state_vector().CopyToVector()

    angles = [0.1, 0.2, 0.3, 0.4]
    alone = [step(angle) for angle in angles]
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(step, angles))
    np.testing.assert_array_equal(together, alone)


def test_a_runner_serves_one_thread_at_a_time():
    runner = Runner("irb120_dynamic")

    def run_again(time, positions):
        runner.run(duration=0.1)

    with pytest.raises(
        SimrobError, match="a Runner makes one run at a time; create a Runner for each thread"
    ):
        runner.run(duration=0.1, on_step=run_again)
    assert runner.run(duration=0.1).ending == "completed"
    first = runner.run(duration=0.1)
    assert runner.resume(first, until=0.2).ending == "completed"
