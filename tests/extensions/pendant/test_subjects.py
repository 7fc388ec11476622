"""What stations robots get that have none, when they are taught."""

from simrob_drake import load_station
from simrob_drake.base.yaml_files import parse_yaml
from simrob_drake.extensions.pendant.subjects import station_for
from simrob_drake.robots.catalog import load_robot
from simrob_drake.stations.draft import draft_station


def test_a_robot_of_the_package_begins_where_its_draft_is_clear(tmp_path):
    """Outstretched, as it is at home, it would be singular; its gains are its own."""
    name, file = station_for("tx40", tmp_path)
    drafted = parse_yaml(draft_station(load_robot("tx40").urdf_path), "tx40")
    config = load_station(file)
    assert name == "tx40"
    assert drafted["robot"]["initial_deg"]
    assert config.robots["robot"].initial_deg == drafted["robot"]["initial_deg"]
    assert config.servo_of("robot").realization == drafted["servo"]["realization"]
    assert config.servo_of("robot").kp is None
    assert config.reference.kind == "hold"
