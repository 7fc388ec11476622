"""Forces stand in the block picture, each with its source and its figures, and with where it acts."""

from simrob_drake.results.block_diagram.picture import station_dot
from simrob_drake.stations.load import load_station


def test_a_force_is_a_source_with_its_figures_and_where_it_acts():
    forces = {
        "push": {"start": 1, "force": [0, -10, 0]},
        "ahead": {"kind": "push", "start": 2.5, "force": [3, 4, 0]},
    }
    dot = station_dot(load_station("humanoid_dynamic", {"forces": forces}))

    assert '"force.push" [label="Force \'push\'\\n10 N at 1 s\\nat robot"' in dot
    assert '"force.ahead" [label="Force \'ahead\'\\n5 N at 2.5 s\\nat robot"' in dot
    assert '"force.ahead" -> "plant" [label=" F "];' in dot
