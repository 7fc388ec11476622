"""What is not quite XML is read and told; what could harm, or is something else, is refused in one line."""

import os
from pathlib import Path

import pytest
from repair_stages import ARM

from simrob_drake.base.errors import InvalidModel
from simrob_drake.importer.reading import xml_file
from simrob_drake.importer.reading.source import read_source
from simrob_drake.robots.imports import ImportReport
from simrob_drake.robots.urdf import DRAKE, movable_joints

BOMB = '<!DOCTYPE r [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;&a;&a;">]><robot name="&b;"><link name="l"/></robot>'


def read(path: Path, content: bytes):
    path.write_bytes(content)
    report = ImportReport(path)
    return read_source(path, report), report


def told(report: ImportReport) -> list[tuple[str, str]]:
    return [(entry.kind, f"{entry.element} {entry.text}".strip()) for entry in report.entries]


def refusal(path: Path) -> str:
    with pytest.raises(InvalidModel) as problem:
        read_source(path, ImportReport(path))
    message = str(problem.value)
    assert message.startswith(f"{path}: ")
    assert "\n" not in message
    return message


def test_a_clean_file_is_read_without_a_word(tmp_path):
    robot, report = read(tmp_path / "a.urdf", ARM.encode())
    assert movable_joints(robot) == ["shoulder"]
    assert report.entries == []


@pytest.mark.parametrize(
    ("content", "words"),
    [
        pytest.param(b"", "is empty", id="empty"),
        pytest.param(b" \n ", "is empty", id="blank"),
        pytest.param(b"solid cube", "is not XML: syntax error at line 1, column 1", id="text"),
        pytest.param(
            b"<robot>\n <link></robot>", "mismatched tag at line 2, column 10", id="mismatch"
        ),
        pytest.param(
            b"\n\n<robot>\n <link></robot>", "at line 4, column 10", id="line numbers hold"
        ),
        pytest.param(b"\x7fELF\0\0\0\1", "is a binary file", id="binary"),
        pytest.param(b"<robot/><robot/>", "junk after document element at line 1", id="two robots"),
        pytest.param(b'<robot a="1" a="2"/>', "duplicate attribute", id="attribute twice"),
        pytest.param(b"<robot>&nbsp;</robot>", "undefined entity", id="unknown entity"),
        pytest.param(BOMB.encode(), "declares a document type or entities", id="entity bomb"),
        pytest.param(
            b'<!DOCTYPE robot SYSTEM "file:///etc/passwd"><robot/>', "document type", id="doctype"
        ),
        pytest.param(b"<a>" * 500 + b"</a>" * 500, "in more than 60 levels", id="deep"),
        pytest.param(b'<sdf version="1.9"/>', "contains no model", id="sdf"),
        pytest.param(
            b"<mujocoinclude/>", "<mujocoinclude>: this is a part of an MJCF file", id="mjcf"
        ),
        pytest.param(b"<COLLADA/>", "<COLLADA>: this is a COLLADA mesh", id="dae"),
        pytest.param(
            b"<cube/>", "<cube>: the outermost element of a URDF must be <robot>", id="else"
        ),
        pytest.param(b"\xff\xfea", "cannot be decoded as UTF-16-LE", id="half a character"),
    ],
)
def test_what_is_no_urdf_is_refused(tmp_path, content, words):
    path = tmp_path / "a.urdf"
    path.write_bytes(content)
    assert words in refusal(path)


def test_files_that_are_none_are_refused(tmp_path):
    assert "there is no such file" in refusal(tmp_path / "none.urdf")
    assert "is a folder" in refusal(tmp_path)

    pipe = tmp_path / "pipe.urdf"
    os.mkfifo(pipe)

    assert "is not a regular file" in refusal(pipe)
    assert "there is no such file" in refusal(tmp_path / ("a" * 300))


def test_a_file_of_unusual_size_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(xml_file, "LARGEST_URDF", 1_000_000)
    path = tmp_path / "a.urdf"

    path.write_bytes(b"<robot>" + b" " * 1_000_001 + b"</robot>")

    assert "is larger than 1 MB" in refusal(path)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        pytest.param(
            b"\xef\xbb\xbf" + ARM.encode(), "begins with a byte order mark (UTF-8)", id="mark"
        ),
        pytest.param(
            ARM.encode("utf-16"), "begins with a byte order mark (UTF-16-LE)", id="utf-16"
        ),
        pytest.param(
            b'<?xml version="1.0" encoding="utf-8"?>' + ARM.replace("base", "pié").encode("cp1252"),
            "cannot be decoded as utf-8; read as cp1252",
            id="not the encoding it claims",
        ),
        pytest.param(
            b'<?xml version="1.0" encoding="klingon"?>' + ARM.encode(),
            "cannot be decoded as klingon; read as utf-8",
            id="unknown encoding",
        ),
        pytest.param(
            b' \n<?xml version="1.0"?>' + ARM.encode(),
            "<?xml ...?> is not at the",
            id="late declaration",
        ),
        pytest.param(
            b'<!-- licence -->\n<?xml version="1.0" encoding="utf-8"?>' + ARM.encode(),
            "the declaration <?xml ...?> is not at the beginning",
            id="comment before it",
        ),
        pytest.param(
            b"<!-- a -- b -->" + ARM.encode(), "1 comment contains --", id="dashes in a comment"
        ),
    ],
)
def test_what_readers_do_not_mind_is_mended_and_told(tmp_path, content, words):
    robot, report = read(tmp_path / "a.urdf", content)

    assert movable_joints(robot) == ["shoulder"]

    [(kind, text)] = told(report)
    assert kind == "repaired"
    assert words in text


def test_an_encoding_is_heeded(tmp_path):
    text = '<?xml version="1.0" encoding="iso-8859-1"?><robot name="cañón"/>'
    robot, report = read(tmp_path / "a.urdf", text.encode("latin-1"))

    assert robot.get("name") == "cañón"
    assert report.entries == []


def test_an_encoding_after_a_comment_is_heeded(tmp_path):
    text = '<!-- licence --><?xml version="1.0" encoding="iso-8859-1"?><robot name="cañón"/>'
    assert read(tmp_path / "a.urdf", text.encode("latin-1"))[0].get("name") == "cañón"


def test_undeclared_prefixes_are_no_error(tmp_path):
    text = ARM.replace("<link ", '<gazebo:plugin ros:speed="3"/><link ros:mass="1" ', 1)
    robot, report = read(tmp_path / "a.urdf", text.encode())

    assert told(report) == [
        ("dropped", "<gazebo:plugin> 1 ×: belongs to a namespace of another program"),
        ("dropped", "attribute ros:mass 1 ×: belongs to a namespace of another program"),
    ]
    assert all(":" not in element.tag for element in robot.iter())


@pytest.mark.parametrize(
    ("declared", "prefix"),
    [
        ("", "drake"),
        (' xmlns:drake="elsewhere"', "drake"),
        (' xmlns:d="http://drake.mit.edu"', "d"),
    ],
)
def test_elements_of_drake_stay_however_they_are_declared(tmp_path, declared, prefix):
    text = ARM.replace('velocity="3"', f'velocity="3" {prefix}:acceleration="7"').replace(
        "<robot", f"<robot{declared}"
    )
    robot, report = read(tmp_path / "a.urdf", text.encode())

    limit = robot.find("joint/limit")

    assert limit is not None
    assert limit.get(f"{DRAKE}acceleration") == "7"
    assert report.entries == []


def test_a_default_namespace_changes_no_name(tmp_path):
    robot, report = read(
        tmp_path / "a.urdf", ARM.replace("<robot", '<robot xmlns="http://ros.org"').encode()
    )
    assert (robot.tag, report.entries) == ("robot", [])


def test_comments_that_hide_elements_are_told_once(tmp_path):
    hidden = '<!-- <visual><geometry><mesh filename="old.dae"/></geometry></visual> --><!-- <joint name="x"> -->'
    _, report = read(
        tmp_path / "a.urdf", ARM.replace("<link ", f"{hidden}<!-- by <a@b.c> --><link ", 1).encode()
    )

    [(kind, text)] = told(report)

    assert kind == "read"
    assert text.startswith("2 comments contain elements (")
    assert "1 <visual>" in text
    assert "1 <joint>" in text


def test_a_mere_declaration_of_xacro_is_no_xacro(tmp_path):
    text = ARM.replace("<robot", '<robot xmlns:xacro="http://www.ros.org/wiki/xacro"')
    for name in ("a.urdf", "a.xacro"):
        robot, report = read(tmp_path / name, text.encode())
        assert movable_joints(robot) == ["shoulder"]
        assert report.entries == []
