"""Pushes stand in the block picture as one block with their figures."""

from simrob_drake.results.block_diagram.picture import station_dot
from simrob_drake.stations.load import load_station


def test_pushes_are_one_block_with_force_and_time():
    pushes = [{"start": 1, "force": [0, -10, 0]}, {"start": 2.5, "force": [3, 4, 0]}]
    dot = station_dot(load_station("humanoid_dynamic", {"robot.pushes": pushes}))
    assert '"pushes" [label="Pushes on the base\\n10 N at 1 s\\n5 N at 2.5 s"' in dot
    assert '"pushes.course" [' not in dot
