"""Feedback loops that a user can add to a station: those of the package's stations with the same robot."""

from simrob_drake import load_station
from simrob_drake.robots.catalog import load_robot
from simrob_drake.stations.feedback_loops import loops_known


def test_a_robot_of_a_urdf_gets_no_loops_of_other_robots(tmp_path):
    """Stations of several robots name no model under `robot`, and neither does a robot of a URDF."""
    by_model = load_station("irb120_dynamic")

    assert loops_known(by_model)

    urdf = load_robot("irb120").urdf_path
    file = tmp_path / "station.yaml"

    file.write_text(f"robot: {{urdf: {urdf}}}\nduration: 0.1\n")

    assert loops_known(load_station(file)) == {}
