"""Notebooks and scripts: stations as mappings, signals by name, saved results, figures of several results."""

import json
import sys
import types
from io import BytesIO

import numpy as np
import pytest
from PIL import Image
from pydrake.systems.framework import LeafSystem

import simrob_drake as sd
from simrob_drake.base.errors import InvalidConfig, InvalidParameter, UnknownName
from simrob_drake.extensions.tuning.sweep import Sweep
from simrob_drake.parts.controllers.own import OwnController
from simrob_drake.results.plots.own import save_figure

ONE_ARM = {"robot": {"model": "irb120"}, "reference": {"kind": "hold"}, "duration": 0.05}


@pytest.fixture(scope="module")
def result():
    """A short run of the double pendulum."""
    return sd.simulate("double_pendulum", duration=0.2, progress=False)


@pytest.fixture(scope="module")
def folder(result, tmp_path_factory):
    """Folder to which the run was saved."""
    return result.save(tmp_path_factory.mktemp("saved") / "run", recording=False)


def test_a_mapping_is_loaded_as_the_file_with_the_same_content(tmp_path):
    file = tmp_path / "station.yaml"
    file.write_text(json.dumps(ONE_ARM))

    from_mapping = sd.load_station(ONE_ARM)

    assert from_mapping == sd.load_station(file)
    assert sd.simulate(ONE_ARM, progress=False).times[-1] == pytest.approx(0.05)


def test_a_mapping_stays_as_the_user_wrote_it():
    station = {**ONE_ARM, "servo": {"kp": np.full(6, 300.0)}}

    config = sd.load_station(station, {"servo.kd": 7})

    assert config.servo.kp == [300.0] * 6
    assert set(station["servo"]) == {"kp"}


def test_relative_paths_of_a_mapping_start_at_the_current_folder(
    tmp_path, monkeypatch, one_joint_urdf
):
    (tmp_path / "arm.urdf").write_text(one_joint_urdf)
    monkeypatch.chdir(tmp_path)

    config = sd.load_station({"robot": {"urdf": "arm.urdf"}, "reference": {"kind": "hold"}})

    assert config.robots["robot"].urdf == tmp_path / "arm.urdf"


@pytest.mark.parametrize(
    ("station", "words"),
    [
        ({"robt": {"model": "irb120"}}, "robt: unknown key; did you mean 'robots'?"),
        ({"robot": {"model": "irb12"}}, "there is no robot 'irb12'; did you mean 'irb120'?"),
        ({}, "needs something that moves"),
    ],
)
def test_a_wrong_mapping_is_refused_with_the_key(station, words):
    with pytest.raises(InvalidConfig, match=r"^station: ") as caught:
        sd.load_station(station)

    assert words in str(caught.value)


def test_a_configuration_is_written_as_yaml_that_loads_again(tmp_path):
    config = sd.load_station(ONE_ARM)
    file = tmp_path / "again.yaml"

    file.write_text(config.to_yaml())

    assert sd.load_station(file) == config
    assert "<pre>" in config._repr_html_()


def test_a_result_is_read_as_a_mapping_of_its_columns(result):
    signals = dict(result)

    assert list(signals) == list(result) == result.keys() == list(result.names)
    assert np.array_equal(signals["q.joint_1"], result["q.joint_1"])
    assert "q.joint_1" in result
    assert "q.jont_1" not in result
    assert 3 not in result


def test_a_loaded_result_has_the_signals_that_were_saved(result, folder):
    loaded = sd.load_result(folder)

    # signals.csv has nine significant digits
    assert np.allclose(loaded.times, result.times, rtol=1e-8)
    for name in result:
        assert np.allclose(loaded[name], result[name], rtol=1e-6, atol=1e-8), name
    assert set(dict(loaded)) == set(result)
    assert loaded.units == result.units
    assert loaded.message == result.message
    assert "samples" in repr(loaded)


def test_a_folder_without_a_result_and_an_unknown_signal_are_refused(folder, tmp_path):
    with pytest.raises(InvalidConfig, match=r"signals\.csv"):
        sd.load_result(tmp_path)
    with pytest.raises(UnknownName, match=r"did you mean 'q\.joint_1'"):
        sd.load_result(folder)["q.jont_1"]


@pytest.mark.parametrize(
    ("summary", "words"),
    [
        (None, "cannot be read"),
        ("[]", "must contain a mapping"),
        ("{", "is not JSON"),
        ('{"servos": []}', "servos: must contain a mapping"),
        ('{"units": 1}', "units: must contain a mapping"),
    ],
)
def test_a_result_with_a_missing_or_damaged_summary_is_refused(summary, words, tmp_path):
    (tmp_path / "signals.csv").write_text("time,q.joint_1\n0,1\n")
    if summary is not None:
        (tmp_path / "summary.json").write_text(summary)

    with pytest.raises(InvalidConfig, match=rf"summary\.json: {words}"):
        sd.load_result(tmp_path)


def test_results_of_one_name_are_numbered_in_the_legend(result):
    figure = sd.plot_results(result, result, signals="q.joint_1")

    first, second = (line.get_label() for line in figure.axes[0].get_lines())
    assert first.endswith(" (1)")
    assert second == first.replace(" (1)", " (2)")


def test_labels_name_the_results_in_the_legend(result):
    figure = sd.plot_results(result, result, signals="q.joint_1", labels=["slow", "fast"])

    assert [line.get_label() for line in figure.axes[0].get_lines()] == ["slow", "fast"]
    with pytest.raises(InvalidParameter, match="it must be one label for each of 2 results"):
        sd.plot_results(result, result, labels=["slow"])


def test_a_table_without_times_is_refused(tmp_path):
    (tmp_path / "signals.csv").write_text("q.joint_1\n1\n")
    (tmp_path / "summary.json").write_text("{}")

    with pytest.raises(InvalidConfig, match="time"):
        sd.load_result(tmp_path)


def test_results_and_folders_are_drawn_over_each_other(result, folder):
    figure = sd.plot_results(result, folder, sd.load_result(folder), signals="q.joint_1")

    (frame,) = figure.axes
    curves = [line.get_ydata() for line in frame.get_lines()]
    assert len(curves) == 3
    for curve in curves:
        assert np.allclose(curve, np.degrees(result["q.joint_1"]), atol=1e-5)


def test_a_figure_of_a_notebook_has_one_legend_also_after_it_is_saved(result, tmp_path):
    figure = result.plot("q.*")

    picture = figure._repr_png_()
    file = save_figure(figure, tmp_path / "figure.png")

    assert len(figure.legends) == 1
    assert Image.open(BytesIO(picture)).size == Image.open(file).size


@pytest.mark.parametrize("results", [(), (3,), (None,)])
def test_only_results_are_drawn(results):
    with pytest.raises(InvalidParameter, match=r"^results is"):
        sd.plot_results(*results)


@pytest.mark.parametrize(
    "values", [[300, 500], (300, 500), range(300, 501, 200), np.array([300, 500])]
)
def test_values_of_a_sweep_may_be_listed_in_python(values):
    sweep = Sweep(station="irb120_dynamic", vary={"servo.kp": values})

    assert [case["servo.kp"] for case, _ in sweep.combinations] == [300, 500]
    assert all(type(case["servo.kp"]) is int for case, _ in sweep.combinations)


class _Failing(LeafSystem):
    """Block that fails after a tenth of a second."""

    def __init__(self) -> None:
        """Create the block with one output."""
        super().__init__()
        self.DeclareVectorOutputPort("y", 1, self._compute)

    def _compute(self, context, output) -> None:
        if context.get_time() > 0.1:
            raise RuntimeError("a sensor is broken")
        output.SetAtIndex(0, 0.0)


def test_a_run_in_which_a_block_fails_warns_the_script():
    with pytest.warns(sd.FailedRunWarning, match="a sensor is broken"):
        result = sd.simulate("double_pendulum", duration=0.3, blocks=[_Failing()], progress=False)

    assert result.ending == "failed"


def test_a_block_of_a_notebook_is_named_by_its_class_in_main(monkeypatch):
    # Jupyter runs cells in the module __main__, with names of files that do not exist.
    notebook = types.ModuleType("__main__")
    code = (
        "from pydrake.systems.framework import LeafSystem\n"
        "class Cell(LeafSystem):\n    def __init__(self):\n        LeafSystem.__init__(self)\n"
    )
    exec(compile(code, "/tmp/ipykernel_1/123.py", "exec"), notebook.__dict__)
    monkeypatch.setitem(sys.modules, "__main__", notebook)

    section = OwnController.of(notebook.Cell())

    assert section.class_ == "__main__:Cell"
    assert isinstance(section.block("controllers.cell"), notebook.Cell)
