"""Language of the output: plots, comments of first stations, and messages from the process that reads xacro."""

import importlib.util
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.text import Text

from simrob_drake import SimulationResult, load_station, simulate
from simrob_drake.base.errors import InvalidModel
from simrob_drake.base.files import models_root
from simrob_drake.base.messages import as_data, from_data, in_language, message, set_output_language
from simrob_drake.importer.importing import robot_from_file
from simrob_drake.results.plots.grid import grid_figure
from simrob_drake.results.plots.joint_plots import position_stacks, torque_stacks
from simrob_drake.results.plots.overlay import SavedSignals, overlay_figure
from simrob_drake.results.plots.panel_plots import panel_sheets
from simrob_drake.stations.draft import draft_station

needs_xacro = pytest.mark.skipif(
    importlib.util.find_spec("xacro") is None, reason="needs the extra xacro"
)


@pytest.fixture
def spanish() -> Iterator[None]:
    set_output_language("es")
    yield
    set_output_language("en")


@pytest.fixture(scope="module")
def result() -> SimulationResult:
    return simulate(load_station("irb120_force_stop", {"duration": 0.1}), progress=False)


def texts_of(figure: Figure) -> set[str]:
    """All texts of a figure, as they are drawn."""
    figure.draw_without_rendering()
    return {text.get_text() for text in figure.findobj(Text)}


@pytest.mark.usefixtures("spanish")
def test_plots_of_joints_are_in_the_language(result: SimulationResult) -> None:
    (robot,) = result.plant.robots.values()
    positions = texts_of(grid_figure(result, "", position_stacks(result, robot)))

    assert {
        "posición [deg]",
        "error [deg]",
        "referencia",
        "error: referencia - posición",
        "tiempo [s]",
    } <= positions
    assert "0,05" in positions  # a time at the axis
    assert not any("." in text for text in positions if text.replace(".", "").isdigit())

    torques = texts_of(grid_figure(result, "", torque_stacks(result, robot)))
    assert {"par [N·m]", "límite ±150 N·m"} <= torques


@pytest.mark.usefixtures("spanish")
def test_plots_of_sensors_are_in_the_language(result: SimulationResult) -> None:
    (sheet,) = [sheet for sheet in panel_sheets(result) if sheet.name == "sensors"]
    shown = texts_of(grid_figure(result, sheet.title, sheet.stacks, **sheet.layout))

    assert "fuerza [N]" in shown
    assert any(text.startswith("fuerza de contacto de '") for text in shown)


def test_the_same_plots_are_english_otherwise(result: SimulationResult) -> None:
    (robot,) = result.plant.robots.values()
    positions = texts_of(grid_figure(result, "", position_stacks(result, robot)))
    assert {"position [deg]", "reference", "time [s]", "0.05"} <= positions


@pytest.mark.usefixtures("spanish")
def test_results_over_each_other_are_in_the_language() -> None:
    times = np.linspace(0, 1, 5)
    saved = SavedSignals("a", times, {"q.joint_1": times}, {"q.joint_1": "rad"})

    figure = overlay_figure([saved, saved], ["q.joint_1"])

    assert figure.get_label() == "resultados superpuestos"
    assert {"posición [deg]", "tiempo [s]"} <= texts_of(figure)


@pytest.mark.usefixtures("spanish")
def test_the_comments_of_a_first_station_are_in_the_language(tmp_path: Path) -> None:
    text = draft_station(models_root() / "irb120" / "irb120.urdf", folder=tmp_path)

    comments = [line for line in text.splitlines() if line.startswith("#")]
    assert comments[0].startswith("# Primera estación de un robot importado")
    assert any("sin colisiones con el suelo ni entre eslabones" in comment for comment in comments)
    assert "reference:" in text  # keys are the same in each language


@needs_xacro
def test_messages_of_the_process_that_reads_xacro_keep_their_ids(tmp_path: Path) -> None:
    file = tmp_path / "arm.xacro"
    head = '<robot name="arm" xmlns:xacro="http://www.ros.org/wiki/xacro">'

    file.write_text(f'{head}<link name="base"/><link name="$(env HOME)"/></robot>')

    with pytest.raises(InvalidModel) as raised:
        robot_from_file(file)
    assert "a xacro file may not read the environment variable HOME" in str(raised.value)
    assert "un fichero xacro no puede leer la variable de entorno HOME" in in_language(
        raised.value.message, "es"
    )


@pytest.mark.parametrize(
    "template", ["{a:999999999}", "{a.__class__}", "{a[0]}", "{a!r}", "{0}", "{a:{a}}", "{a:.999f}"]
)
def test_a_template_of_data_has_plain_fields_only(template: str) -> None:
    """It may come from a file or a process that is not trusted: a width would make a text of a gigabyte."""
    with pytest.raises(ValueError, match="none of a message"):
        from_data({"id": "", "template": template, "fields": {"a": 1.0}})


@needs_xacro
def test_a_package_that_is_missing_keeps_its_message_over_both_borders(tmp_path: Path) -> None:
    """The question goes to the process of the import, its answer back, and out again as the problem."""
    file = tmp_path / "arm.xacro"
    head = '<robot name="arm" xmlns:xacro="http://www.ros.org/wiki/xacro">'

    file.write_text(
        f'{head}<xacro:include filename="$(find nowhere)/a.xacro"/><link name="base"/></robot>'
    )

    with pytest.raises(InvalidModel) as raised:
        robot_from_file(file)
    assert "package" in str(raised.value)
    assert "paquete" in in_language(raised.value.message, "es")


def test_data_keep_a_message() -> None:
    template = "ran to its end at {time:.6g} s"
    end = message("results.ran_to_its_end", template, time=np.float64(2.5))

    assert in_language(end, "es") == "llegó al final a los 2,5 s"
    assert in_language(from_data(as_data(end)), "es") == in_language(end, "es")

    steps = message("results.steps", "{count} {count:step|steps}", count=2)
    assert in_language(steps, "es") == "2 pasos"
    assert in_language(from_data(as_data(steps)), "es") == "2 pasos"


@pytest.mark.parametrize(
    ("fields", "error"),
    [([1.0], TypeError), ({"b": 1.0}, ValueError)],
    ids=["a list", "a value is missing"],
)
def test_damaged_fields_of_a_message_are_an_error_of_data(
    fields: object, error: type[Exception]
) -> None:
    with pytest.raises(error):
        from_data({"id": "", "template": "{a}", "fields": fields})
