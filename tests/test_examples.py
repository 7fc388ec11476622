"""Every example runs, and says what it promises."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest

from simrob_drake import load_station, simulate

EXAMPLES = sorted((Path(__file__).parent.parent / "examples").glob("*.py"))


def loaded(file):
    spec = importlib.util.spec_from_file_location(file.stem, file)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("file", EXAMPLES, ids=lambda file: file.stem)
def test_an_example_runs(file, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    loaded(file).main()
    assert capsys.readouterr().out.strip()


def example(name):
    return loaded(next(file for file in EXAMPLES if file.stem == name))


def test_the_station_wired_by_hand_is_the_station():
    by_hand = example("irb120_by_hand").run(duration=0.5)
    station = simulate(load_station("irb120_dynamic", {"pieces": {}}), duration=0.5)
    np.testing.assert_array_equal(by_hand, station.axes("q")[-1])


def test_a_block_of_ones_own_moves_the_arm():
    times, positions = example("irb120_in_a_diagram").run()
    np.testing.assert_allclose(positions[times > 0.5, 4], 0.3 * np.sin(2 * times[times > 0.5]), atol=0.02)


def test_weaker_motors_hold_less():
    results = example("irb120_overload").run(limits=(150.0, 10.0))
    ends = {limit: np.rad2deg(result["q.joint_2"][-1]) for limit, result in results.items()}
    assert ends[150.0] == pytest.approx(31.2, abs=0.1)
    assert ends[10.0] == pytest.approx(110, abs=0.1)
