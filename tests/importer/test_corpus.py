"""Every broken robot is mended, which is told, or refused in one line; so is every pair of defects."""

import itertools
import random
import re
from pathlib import Path

import numpy as np
import pytest
from broken_robots import ARM, DEFECTS, LEGS, Absent, Defect, Package, Swap

from simrob_drake.base.errors import InvalidModel, OutputError
from simrob_drake.importer.importing import ImportedRobot, import_robot
from simrob_drake.importer.probe import probe
from simrob_drake.robots.imports import ImportOptions, ImportReport
from simrob_drake.robots.parse import lone_robot

PAIRS, FEW = 150, 30
LONGEST = 400
"""Of a refusal, without the path of the file."""


def told(report: ImportReport) -> list[str]:
    return [f"{entry.kind}: {entry.element}: {entry.text}" for entry in report.entries]


def below(folder: Path) -> dict[str, bytes]:
    files = (file for file in folder.rglob("*") if file.is_file())
    return {str(file.relative_to(folder)): file.read_bytes() for file in files}


def entries(folder: Path) -> set[str]:
    return {str(path) for path in folder.rglob("*")}


def check_refusal(problem: Exception, source: Path) -> None:
    """Check that a refusal is one line that names the file."""
    message = str(problem)
    assert "\n" not in message
    assert message.startswith(f"{source}: ")
    assert len(message.replace(str(source.parents[3]), "")) < LONGEST


def check_robot(imported: ImportedRobot) -> None:
    """Check that Drake builds what was imported, and can move it if it has inertias."""
    model = imported.model
    lone = lone_robot(model, floating=model.base == "floating")
    assert lone.plant.num_actuators() == np.count_nonzero(~model.passive) > 0
    assert ((model.efforts > 0) == ~model.passive).all()
    if not model.links_without_inertia:
        matrix = lone.plant.CalcMassMatrix(lone.plant.CreateDefaultContext())
        assert np.isfinite(matrix).all()
        assert np.linalg.cond(matrix) < 1e12
        assert (np.linalg.eigvalsh(matrix) > 0).all()


def check_round_trip(imported: ImportedRobot, folder: Path) -> None:
    """Check that importing what was imported changes nothing."""
    again = import_robot(imported.model.urdf_path, folder, isolated=False)
    assert not again.report.has_changes, told(again.report)
    first, second = below(imported.model.folder), below(folder)
    assert first.keys() == second.keys()
    assert [name for name in first if first[name] != second[name]] == ["report.json"]


def imported_or_refused(
    package: Package, folder: Path, options: ImportOptions
) -> ImportedRobot | str:
    """Import a robot in this very process; return why not if it is refused, when nothing may be left behind."""
    source = package.write(folder)
    before = entries(folder)
    try:
        return import_robot(source, folder / "new" / "out", options, isolated=False)
    except (InvalidModel, OutputError) as problem:
        check_refusal(problem, source)
        assert entries(folder) == before
        return str(problem)


@pytest.mark.parametrize("text", [ARM, LEGS], ids=["arm", "legs"])
def test_the_sound_robots_need_no_repair_but_of_their_meshes(tmp_path, text):
    imported = imported_or_refused(Package(text), tmp_path, ImportOptions())

    assert isinstance(imported, ImportedRobot), imported
    mended = [entry for entry in imported.report.entries if entry.kind not in ("read", "defaulted")]
    assert all("becomes meshes/" in entry.text for entry in mended)
    assert [entry.text for entry in imported.report.of("defaulted")] == [
        "servo gains from the mass matrix"
    ]

    check_robot(imported)
    check_round_trip(imported, tmp_path / "again")


def test_the_corpus_is_large_and_its_names_differ():
    assert len(DEFECTS) >= 60
    assert len({defect.name for defect in DEFECTS}) == len(DEFECTS)


SOME_DEFECTS = [
    pytest.param(defect, marks=pytest.mark.long if number % 3 else (), id=defect.name)
    for number, defect in enumerate(DEFECTS)
]
"""Every third one is quick enough for each run of the tests; the others are left to the long ones."""


@pytest.mark.parametrize("defect", SOME_DEFECTS)
def test_a_broken_robot_is_mended_or_refused(tmp_path, defect: Defect):
    kind, words = defect.expected.split(": ", 1)
    result = imported_or_refused(defect.package(), tmp_path, defect.options)
    if isinstance(result, str):
        assert kind == "error", result
        assert words in result
        return

    lines = told(result.report)

    assert any(line.startswith(f"{kind}: ") and words in line for line in lines), lines

    check_robot(result)
    check_round_trip(result, tmp_path / "again")


def applied(pair: tuple[Defect, Defect]) -> Package | None:
    package = Package()
    try:
        for defect in pair:
            defect.harm(package)
    except Absent:
        return None
    return package


def pairs() -> list[tuple[Defect, Defect]]:
    """Return a sample of the pairs of defects in the text of the arm that can stand together."""
    texts = [defect for defect in DEFECTS if isinstance(defect.harm, Swap) and defect.sound is ARM]
    together = [pair for pair in itertools.combinations(texts, 2) if applied(pair)]
    return random.Random(0).sample(together, PAIRS)


@pytest.mark.parametrize(
    "pair",
    [
        pytest.param(
            pair,
            id=f"{pair[0].name} + {pair[1].name}",
            marks=[pytest.mark.long] if number >= FEW else [],
        )
        for number, pair in enumerate(pairs())
    ],
)
def test_two_defects_are_mended_or_refused(tmp_path, pair):
    package = applied(pair)

    assert package is not None

    result = imported_or_refused(package, tmp_path, ImportOptions(estimate_inertia=True))
    if isinstance(result, ImportedRobot):
        check_robot(result)
        check_round_trip(result, tmp_path / "again")


UPSETTING = [
    pytest.param(
        'size="0.1 0.1 0.2"',
        'size="0 0 0"',
        "link 'base' <collision>: Drake",
        id="box of size zero",
        marks=pytest.mark.probe,
    ),
    pytest.param(
        'lower="-1" upper="2"',
        'lower="2" upper="-1"',
        "joint 'shoulder' <limit>: Drake",
        id="limits",
    ),
]


@pytest.mark.long
@pytest.mark.parametrize(("good", "bad", "words"), UPSETTING)
def test_the_probe_names_what_upsets_drake(one_joint_urdf, write_urdf, good, bad, words):
    assert good in one_joint_urdf

    # less to search
    short = re.sub(
        "<(inertial|visual)>.*?</\\1>|<dynamics.*?>", "", one_joint_urdf, flags=re.DOTALL
    )
    file = write_urdf(short.replace(good, bad, 1))

    with pytest.raises(InvalidModel) as problem:
        probe(file, ImportReport(file))
    assert words in str(problem.value)
    assert "\n" not in str(problem.value)
    assert [path.name for path in file.parent.iterdir()] == [file.name]


@pytest.mark.long
@pytest.mark.probe
@pytest.mark.parametrize("name", ["scale mirrors", "box of size zero"])
def test_what_is_mended_stands_the_probe(tmp_path, name):
    defect = next(defect for defect in DEFECTS if defect.name == name)
    import_robot(defect.package().write(tmp_path), tmp_path / "out", isolated=True)
