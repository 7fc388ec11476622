"""Whole imports: what is written, what is told, and that the robot stays the same."""

import json
import os
from pathlib import Path

import numpy as np
import pytest

from simrob_drake.base.errors import InvalidModel, OutputError
from simrob_drake.importer.importing import default_folder, examine_robot, import_robot
from simrob_drake.robots.catalog import load_robot
from simrob_drake.robots.imports import ImportOptions
from simrob_drake.robots.parse import LoneRobot, lone_robot


@pytest.fixture
def imported(published_irb120, tmp_path):
    return import_robot(published_irb120, tmp_path / "out")


def files_below(folder: Path) -> dict[str, bytes]:
    return {
        str(file.relative_to(folder)): file.read_bytes()
        for file in folder.rglob("*")
        if file.is_file()
    }


def test_an_import_writes_urdf_meshes_description_and_report(imported, tmp_path):
    files = files_below(tmp_path / "out")

    assert {"irb120.urdf", "robot.yaml", "report.json"} <= set(files)
    assert sum(name.startswith("meshes/") for name in files) == 17
    report = json.loads(files["report.json"])
    assert report["summary"] == imported.report.summary()
    assert {"kind", "element", "text", "messages"} == set(report["entries"][0])


def test_defaults_are_told_joint_by_joint(imported):
    told = {entry.element: entry.text for entry in imported.report.of("defaulted")}
    for joint in load_robot("irb120").axes:
        assert any(joint in element and "effort" in text for element, text in told.items())


def test_the_imported_arm_has_a_base_axes_and_its_flange_as_first_tool(imported):
    assert imported.model.base == "fixed"
    assert list(imported.model.axes) == [f"joint_{number}" for number in range(1, 7)]
    assert next(iter(imported.model.tools)) == "tool0"
    assert (imported.model.efforts > 0).all()


def test_masses_and_motion_are_those_of_the_source(imported):
    ours, theirs = lone_robot(load_robot("irb120")), lone_robot(imported.model)
    for posture in np.random.default_rng(3).uniform(-1, 1, (5, 6)):
        contexts = [robot.plant.CreateDefaultContext() for robot in (ours, theirs)]
        for robot, context in zip((ours, theirs), contexts, strict=True):
            robot.axes.set_positions(robot.plant, context, posture)
        np.testing.assert_allclose(*map(_mass_matrix, (ours, theirs), contexts), atol=1e-12)
        np.testing.assert_allclose(*map(_centre_of_mass, (ours, theirs), contexts), atol=1e-12)
    assert ours.plant.CalcTotalMass(contexts[0]) == pytest.approx(
        theirs.plant.CalcTotalMass(contexts[1]), abs=1e-12
    )


def _mass_matrix(robot: LoneRobot, context) -> np.ndarray:
    return robot.plant.CalcMassMatrix(context)


def _centre_of_mass(robot: LoneRobot, context) -> np.ndarray:
    return robot.plant.CalcCenterOfMassPositionInWorld(context)


@pytest.mark.long
def test_importing_the_imported_robot_changes_nothing(imported, tmp_path):
    again = import_robot(imported.model.urdf_path, tmp_path / "again")

    assert not again.report.has_changes

    first, second = files_below(tmp_path / "out"), files_below(tmp_path / "again")
    assert set(first) == set(second)
    different = [name for name in first if first[name] != second[name]]
    assert different == ["report.json"]


def test_examining_writes_nothing(published_irb120, tmp_path):
    before = files_below(tmp_path)
    examined = examine_robot(published_irb120)

    assert examined.report.of("defaulted")
    assert files_below(tmp_path) == before


def test_a_refusal_leaves_nothing_behind(published_irb120, tmp_path):
    text = published_irb120.read_text().replace('type="revolute"', 'type="planar"', 1)
    published_irb120.write_text(text)

    with pytest.raises(InvalidModel, match=r"joint_1.*planar"):
        import_robot(published_irb120, tmp_path / "new" / "out")
    assert not (tmp_path / "new").exists()
    assert not list(tmp_path.glob(".*"))


@pytest.mark.parametrize("place", ["", "out", "../arm_support/urdf/out", ".."])
def test_an_output_within_the_source_is_refused(published_irb120, place):
    package = published_irb120.parent.parent
    before = files_below(package)

    with pytest.raises(OutputError, match="overlaps the source"):
        import_robot(published_irb120, package / place)
    assert files_below(package) == before


def test_an_import_goes_here_or_beside_a_source_in_which_one_is(
    published_irb120, tmp_path, monkeypatch
):
    package, folder = published_irb120.parent.parent, f"{published_irb120.stem}_imported"
    monkeypatch.chdir(tmp_path)

    assert default_folder(published_irb120) == Path(folder)

    monkeypatch.chdir(published_irb120.parent)
    beside = default_folder(Path(published_irb120.name))

    assert beside == package.parent / folder

    import_robot(published_irb120.name, beside)
    assert [file.suffix for file in beside.glob("*.urdf")] == [".urdf"]


@pytest.mark.long
def test_only_an_import_is_replaced_and_only_by_force(imported, published_irb120, tmp_path):
    with pytest.raises(OutputError, match="exists already"):
        import_robot(published_irb120, tmp_path / "out")

    import_robot(published_irb120, tmp_path / "out", force=True)
    (tmp_path / "mine").mkdir()

    (tmp_path / "mine" / "thesis.tex").write_text("years of work")

    with pytest.raises(OutputError, match="files that are not a result"):
        import_robot(published_irb120, tmp_path / "mine", force=True)
    assert (tmp_path / "mine" / "thesis.tex").exists()


def test_a_full_disk_is_told_and_leaves_nothing(published_irb120, tmp_path, monkeypatch):
    def full(*_args, **_kwargs):
        raise OSError(28, os.strerror(28))

    monkeypatch.setattr(Path, "write_text", full)
    with pytest.raises(OutputError, match="No space left on device"):
        import_robot(published_irb120, tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("name", "file"),
    [("../x y", "x_y.urdf"), ("n" * 300, f"{'n' * 100}.urdf"), ("..", "robot.urdf")],
)
def test_the_file_is_named_as_the_robot_as_far_as_files_can_be(
    published_irb120, tmp_path, name, file
):
    published_irb120.write_text(
        published_irb120.read_text().replace('name="irb120"', f'name="{name}"', 1)
    )
    done = import_robot(published_irb120, tmp_path / "out", isolated=False)
    assert done.model.urdf_path == tmp_path / "out" / file


def test_the_base_can_be_chosen(published_irb120, tmp_path):
    floating = import_robot(published_irb120, tmp_path / "out", ImportOptions(base="floating"))

    assert floating.model.base == "floating"

    lone = lone_robot(floating.model, floating=True)
    assert lone.plant.num_positions() == 6 + 7
