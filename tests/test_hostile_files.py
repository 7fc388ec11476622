"""Files that are no files, names that none can have, and outputs that take nothing: one line, at once, and no more."""

import os
import shutil
from pathlib import Path

import numpy as np
import pytest
from pydrake.trajectories import PiecewisePolynomial

from simrob_drake import load_station, simulate
from simrob_drake.base.errors import InvalidConfig, InvalidParameter, SimrobError
from simrob_drake.base.files import (
    NotRead,
    TooLarge,
    content_of,
    models_root,
    read_columns,
    text_of,
)
from simrob_drake.base.packages import MANIFEST, manifest_name
from simrob_drake.base.yaml_files import parse_yaml
from simrob_drake.cli import ExitCode
from simrob_drake.cli.app import run_command
from simrob_drake.importer.importing import REPORT_FILE, import_summary, robot_from_file
from simrob_drake.importer.meshes.checks import UnreadableMesh
from simrob_drake.importer.meshes.places import MeshPlaces
from simrob_drake.importer.meshes.reading import read_mesh
from simrob_drake.importer.reading.source import read_source
from simrob_drake.programs.program import Program
from simrob_drake.robots.imports import ImportOptions, ImportReport
from tests.fuzz.valid import mesh

NONE_TO_READ = {
    "a device without end": ("/dev/zero", "not a regular file"),
    "a file of the system without size": ("/proc/self/pagemap", "larger than 1 MB"),
    "a folder": (".", "is a folder"),
    "a name too long": ("x" * 5000, "name too long"),
    "a name with the character 0": ("a\0b", "no file can have this name"),
    "a name with half a letter": ("\ud800", "no file can have this name"),
    "a pipe that nobody writes to": ("pipe", "not a regular file"),
    "a link to itself": ("circle", "symbolic links"),
    "nothing": ("none", "No such file"),
}


@pytest.fixture
def odd(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder to work in, with a pipe and a link to itself."""
    monkeypatch.chdir(tmp_path)
    os.mkfifo("pipe")
    Path("circle").symlink_to("circle")
    return tmp_path


@pytest.mark.parametrize(("name", "why"), NONE_TO_READ.values(), ids=NONE_TO_READ)
def test_what_is_no_file_is_not_waited_for(odd: Path, name: str, why: str) -> None:
    with pytest.raises(NotRead, match=why):
        content_of(Path(name))


def test_what_looks_into_files_does_not_wait_for_a_pipe(odd: Path) -> None:
    """It would wait for ever for a manifest next to a robot."""
    os.mkfifo(odd / MANIFEST)
    assert manifest_name(odd) == ""


def test_a_file_is_read_to_its_last_byte_and_no_further(tmp_path: Path) -> None:
    file = tmp_path / "a.txt"
    file.write_bytes(b"\xef\xbb\xbfa\r\nb\rc\n")

    assert text_of(file, 10) == "a\nb\nc\n"
    with pytest.raises(TooLarge, match="larger than"):
        text_of(file, 9)


@pytest.mark.parametrize("name", ["pipe", "/dev/zero", "circle"])
@pytest.mark.parametrize(
    "override",
    [
        {"robot.urdf": "{}.urdf"},
        {"robot.model": "{}.yaml"},
        {"start": "{}"},
        {"reference": {"kind": "table", "file": "{}"}},
        {"pieces": {"part": {"mesh": "{}.stl", "free": True}}},
    ],
    ids=lambda override: next(iter(override)),
)
def test_every_file_of_a_station_is_looked_at_first(
    odd: Path, name: str, override: dict[str, object]
) -> None:
    def filled(value: object) -> object:
        if isinstance(value, dict):
            return {key: filled(inner) for key, inner in value.items()}
        return value.format(name) if isinstance(value, str) else value

    for ending in ("urdf", "yaml", "stl"):
        Path(f"{name.strip('/').replace('/', '_')}.{ending}").symlink_to(name)
    changed = {key: filled(value) for key, value in override.items()}
    with pytest.raises(SimrobError):
        simulate(load_station("double_pendulum", changed), duration=0.01, progress=False)
    with pytest.raises(InvalidConfig):
        Program.load(name)


LAUGHS = "\n".join(
    [
        "a0: &a0 [x, x, x, x, x, x, x, x, x]",
        *(f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 9)}]" for n in range(1, 12)),
    ]
)


@pytest.mark.parametrize(
    ("text", "why"),
    [
        (LAUGHS, r"more than 200000 values, counting aliases \(line 6"),
        (LAUGHS.replace("[*", "{<<: [*").replace("*]", "*]}"), "is not YAML"),
        ("a: &a [*a]", "more than 200000 values"),
        ("[" * 100_000, "more than 60 levels"),
        ("a: " + "1:" * 100_000 + "1", r"is not a valid int \(line 1, column 4\)"),
        ("a: !!bool maybe", r"'maybe' is not a valid bool \(line 1, column 4\)"),
        ("a: !!float ''", "'' is not a valid float"),
        ("a: 2001-99-99", "'2001-99-99' is not a valid timestamp"),
        ('a: "\\0"', r"'\\x00' contains a character that is not allowed in text"),
        ('"a\\0b": 1', "contains a character that is not allowed in text"),
        ('a: "\\ud800"', "invalid Unicode character"),
        (f"? {'x' * 5000}\n: 1\n? {'x' * 5000}\n: 2", "occurs twice"),
    ],
)
def test_yaml_that_means_more_than_it_says_is_one_short_line(text: str, why: str) -> None:
    with pytest.raises(InvalidConfig, match=why) as refused:
        parse_yaml(text, "a.yaml")
    assert len(str(refused.value)) < 400


@pytest.mark.long
def test_what_a_user_gives_is_told_back_in_short() -> None:
    for changes in (
        {"x" * 10**6: 1},
        {"duration": "x" * 10**6},
        {"robot": {"model": "x" * 10**6}},
        {"pieces": [1] * 10**5},
    ):
        with pytest.raises(SimrobError) as refused:
            load_station("double_pendulum", changes)
        assert len(str(refused.value)) <= 2000


@pytest.mark.parametrize(
    ("content", "why"),
    [
        ("time,a,a\n0,1,2\n", "line 1: has the column a twice"),
        ("time,a\n0,1\n1,2,3\n", "line 3: has 3 cells, but the table has 2 columns"),
        ("time\ta\n0\t1\n", r"the separator is '\\t', but it must be a comma"),
        ("time,a\n0," + "x" * 10**5 + "\n", "line 2: contains a value that is not a number: 0,xxx"),
    ],
)
def test_a_table_that_can_be_taken_in_two_ways_is_refused(
    tmp_path: Path, content: str, why: str
) -> None:
    (tmp_path / "t.csv").write_text(content)
    with pytest.raises(InvalidConfig, match=why) as refused:
        read_columns(tmp_path / "t.csv", ["time", "a"])
    assert len(str(refused.value)) < 500


def test_empty_cells_behind_a_row_and_columns_that_nobody_needs_do_not_count(
    tmp_path: Path,
) -> None:
    (tmp_path / "t.csv").write_text("note,time,a,note\nx,0,1,y,,\n")
    np.testing.assert_array_equal(read_columns(tmp_path / "t.csv", ["a", "time"])[0], [[1, 0]])


@pytest.mark.parametrize(
    ("rows", "why"),
    [
        ("0,0,0\n1,0,0\n0.5,0,0\n", r"t\.csv: line 4: time 0.5 s follows 1 s; times must increase"),
        (
            "0,0,0\n1e-320,0,0\n1,0,0\n",
            r"t\.csv: line 3: time .* s follows 0 s; times must increase by 1e-06 s",
        ),
        (
            "".join(f"{row},0,0\n" for row in range(170_000)),
            r"has 170000 rows; reduce it to at most 166666",
        ),
    ],
)
def test_a_table_that_no_robot_can_follow_is_named_with_its_line(
    tmp_path: Path, rows: str, why: str
) -> None:
    (tmp_path / "t.csv").write_text(f"time,joint_1,joint_2\n{rows}")
    table = {"reference": {"kind": "table", "file": str(tmp_path / "t.csv")}}
    with pytest.raises(InvalidConfig, match=why):
        simulate(load_station("double_pendulum", table), duration=0.01, progress=False)


def test_a_trajectory_of_no_number_is_refused_in_a_kinematic_station_too() -> None:
    lost = PiecewisePolynomial.FirstOrderHold([0.0, 1.0], np.full((6, 2), np.nan))
    with pytest.raises(InvalidParameter, match=r"is nan at 0\.00 s"):
        simulate("irb120_kinematic", reference=lost, duration=0.1, progress=False)


def test_a_start_that_is_nested_without_end_is_refused(tmp_path: Path) -> None:
    (tmp_path / "start.json").write_text("[" * 100_000)
    with pytest.raises(InvalidConfig, match="is not JSON: too many levels"):
        simulate(
            load_station("double_pendulum", {"start": str(tmp_path / "start.json")}), progress=False
        )


def test_a_binary_stl_that_counts_too_few_faces_is_refused(tmp_path: Path) -> None:
    data = mesh("stl")
    (tmp_path / "a.stl").write_bytes(data[:80] + b"\x03\0\0\0" + data[84:])

    with pytest.raises(UnreadableMesh, match="declares 3 faces, but contains 80"):
        read_mesh(tmp_path / "a.stl", {})

    (tmp_path / "a.stl").write_bytes(data + b"\0" * 50)  # padding
    assert len(read_mesh(tmp_path / "a.stl", {}).parts[0].faces) == 80


@pytest.mark.parametrize("unit", ["0", "-1", "nan", "x", "inf"])
def test_a_dae_of_no_unit_is_refused(tmp_path: Path, unit: str) -> None:
    data = mesh("dae").replace(b"<asset>", f'<asset><unit meter="{unit}"/>'.encode())
    (tmp_path / "a.dae").write_bytes(data)
    with pytest.raises(UnreadableMesh, match=f"has a length unit of {unit} m"):
        read_mesh(tmp_path / "a.dae", {})


def test_faces_at_a_corner_that_is_no_number_are_told(tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_text(
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nv nan 0 0\nf 1 2 3\nf 1 2 4\nf 4 3 2\n"
    )
    assert read_mesh(tmp_path / "a.obj", {}).notes == [
        "has 2 faces with a corner that is not a finite number, which are left out"
    ]


def test_an_obj_that_is_its_own_library_ends(tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_text("mtllib a.obj\nmtllib b.obj\n")
    (tmp_path / "b.obj").write_text("mtllib a.obj\n")

    places = MeshPlaces(tmp_path / "arm.urdf")

    assert set(places.needed_by(tmp_path / "a.obj")[0]) == {"a.obj", "b.obj"}


def test_comments_without_an_end_take_no_time(tmp_path: Path) -> None:
    # was above two minutes
    (tmp_path / "a.urdf").write_text("<robot><!-- a -- b -->" + "<!--" * 1_000_000)

    with pytest.raises(SimrobError, match="has more than 300000 tags"):
        read_source(tmp_path / "a.urdf", ImportReport(tmp_path / "a.urdf"))

    (tmp_path / "a.urdf").write_text("<robot><!-- a -- b -->" + "<!--" * 250_000)
    with pytest.raises(SimrobError, match="is not XML"):
        read_source(tmp_path / "a.urdf", ImportReport(tmp_path / "a.urdf"))


def test_an_empty_report_in_the_cache_is_made_anew(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    source = models_root() / "double_pendulum" / "double_pendulum.urdf"
    options = ImportOptions(base="floating")
    robot = robot_from_file(source, options)
    told = import_summary(robot)

    (robot.folder / REPORT_FILE).write_text("")

    assert import_summary(robot) == ""
    assert import_summary(robot_from_file(source, options)) == told != ""


@pytest.mark.parametrize("command", [["list"], ["diagram", "double_pendulum"]])
def test_an_output_that_is_full_is_told(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], command: list[str]
) -> None:
    with open("/dev/full", "w") as full, monkeypatch.context() as patch:
        patch.setattr("sys.stdout", full)
        assert run_command(command) == ExitCode.BAD_INPUT
        patch.undo()
        # what is left in it goes somewhere
        os.dup2(os.open(os.devnull, os.O_WRONLY), full.fileno())
    assert capsys.readouterr().err == "simrob: No space left on device\n"


def test_a_working_folder_that_is_gone_and_names_of_no_text_are_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_command(["check", os.fsdecode(b"\xff.yaml")]) == ExitCode.BAD_INPUT
    assert capsys.readouterr().err.startswith(
        "simrob: argument is '\\udcff.yaml'; it must be text in UTF-8"
    )

    (tmp_path / "gone").mkdir()
    monkeypatch.chdir(tmp_path / "gone")

    shutil.rmtree(tmp_path / "gone")

    assert run_command(["check", "double_pendulum"]) == ExitCode.BAD_INPUT
    assert "working folder is gone" in capsys.readouterr().err
