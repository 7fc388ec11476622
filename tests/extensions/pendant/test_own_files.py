"""Files of a user's own: kept where no path leads out of, and the right one of them opened."""

import time
import zipfile
from io import BytesIO

import pytest
from fake_runs import CountingRun

from simrob_drake.base.errors import InvalidParameter, SimrobError
from simrob_drake.base.files import models_root
from simrob_drake.extensions.pendant.own_files import FOLDER, keep, report_of
from simrob_drake.extensions.pendant.pages.words import words
from simrob_drake.extensions.pendant.session import Session


def archive(files):
    packed = BytesIO()
    with zipfile.ZipFile(packed, "w") as made:
        for name, content in files.items():
            made.writestr(name, content)
    return packed.getvalue()


def test_the_same_files_are_kept_once_and_others_beside_them(tmp_path):
    first = keep({"arm.urdf": b"<robot/>"}, tmp_path)
    assert (first.name, first.read_bytes()) == ("arm.urdf", b"<robot/>")
    assert keep({"arm.urdf": b"<robot/>"}, tmp_path) == first
    assert keep({"arm.urdf": b"<robot />"}, tmp_path) != first
    assert len(list((tmp_path / FOLDER).iterdir())) == 2


def test_a_station_goes_before_its_robot_and_a_robot_before_its_meshes(tmp_path):
    files = {"arm.urdf": b"1", "base.obj": b"2"}
    assert keep(files, tmp_path).name == "arm.urdf"
    assert keep({**files, "cell.yaml": b"3"}, tmp_path).name == "cell.yaml"
    packed = archive({"arm/urdf/arm.urdf": b"1", "arm/meshes/more/other.urdf": b"2"})
    found = keep({"arm.zip": packed}, tmp_path)
    assert found.parts[-3:] == ("arm", "urdf", "arm.urdf")
    assert (found.parents[1] / "meshes" / "more" / "other.urdf").is_file()


@pytest.mark.parametrize(
    "name",
    ["../../out.urdf", "/etc/out.urdf", "..\\..\\out.urdf", "a/../../out.urdf", ".. /out.urdf"],
)
def test_no_name_leads_out_of_the_folder(tmp_path, name):
    for files in ({name: b"x"}, {"a.zip": archive({name: b"x"})}):
        found = keep(files, tmp_path / "taught").resolve()
        assert found.is_relative_to((tmp_path / "taught" / FOLDER).resolve())
    assert [path.name for path in tmp_path.iterdir()] == ["taught"]


def test_what_holds_nothing_to_open_is_refused_in_a_line(tmp_path):
    for files, what in (
        ({"photo.png": b""}, "photo.png"),
        ({"arm.zip": b"no archive"}, "not a zip file"),
        ({"arm.zip": archive({})}, "nothing"),
    ):
        with pytest.raises(InvalidParameter, match=what) as refused:
            keep(files, tmp_path)
        assert "\n" not in str(refused.value)
    assert not (tmp_path / FOLDER).exists()


def refused_in_a_line(files, folder, message):
    """Check that files are refused within 3 s [processor time], and that nothing is written."""
    began = time.process_time()
    with pytest.raises(SimrobError, match=message) as refused:
        keep(files, folder)
    assert time.process_time() - began < 3
    assert "\n" not in str(refused.value)
    assert str(refused.value).isprintable()
    assert not (folder / FOLDER).exists()


def test_a_file_in_thousands_of_folders_is_refused(tmp_path):
    deep = "a/" * 3000 + "arm.urdf"
    for files in ({"arm.zip": archive({deep: b"<robot/>"})}, {deep: b"<robot/>"}):
        refused_in_a_line(files, tmp_path, "is in 3000 folders; it must be in at most 50 folders")


@pytest.mark.parametrize(
    "name", [f"{'n' * 300}.urdf", "/".join(["n" * 190] * 10) + "/arm.urdf", "ñ" * 120 + ".urdf"]
)
def test_names_that_no_disk_takes_are_refused(tmp_path, name):
    for files in ({"arm.zip": archive({name: b"<robot/>"})}, {name: b"<robot/>"}):
        refused_in_a_line(files, tmp_path, "at most 200 bytes each, 1000 together")


@pytest.mark.parametrize("name", ["arm\ud800.urdf", "\udfff/arm.urdf"])
def test_half_a_surrogate_in_a_name_is_refused(tmp_path, name):
    refused_in_a_line({name: b"<robot/>"}, tmp_path, "text of whole characters")


def test_tens_of_thousands_of_entries_are_refused_at_once(tmp_path):
    packed = archive({f"{number}.txt": b"" for number in range(20_000)} | {"arm.urdf": b"<robot/>"})
    refused_in_a_line(
        {"arm.zip": packed},
        tmp_path,
        "too many files; it must be an archive of at most 10000 files",
    )


def test_a_damaged_archive_is_refused_whatever_byte_is_wrong(tmp_path):
    packed = archive({"arm.urdf": b"<robot/>" * 50})
    with zipfile.ZipFile(compressed := BytesIO(), "w", zipfile.ZIP_DEFLATED) as made:
        made.writestr("arm.urdf", b"<robot/>" * 50)
    for content in (packed, compressed.getvalue()):
        for place in range(len(content)):
            damaged = bytearray(content)
            damaged[place] ^= 0xFF
            try:
                keep({"arm.zip": bytes(damaged)}, tmp_path)
            except SimrobError as problem:
                assert "\n" not in str(problem)  # noqa: PT017


def test_what_the_import_did_is_told(tmp_path):
    """Of the pendulum's file alone, without the mesh of its base."""
    source = models_root() / "double_pendulum" / "double_pendulum.urdf"
    file = keep({source.name: source.read_bytes()}, tmp_path)

    session = Session.open(file, tmp_path, live=CountingRun)
    report = report_of(session.book.model.urdf_path)
    session.close()
    assert str(report).startswith(
        "double_pendulum.urdf was imported. Its file leaves these things open"
    )
    (lost,) = (
        remark for remark in report.remarks if "'base.obj' there is no such file" in remark.text
    )
    assert lost.severity == "warning", "the base is not shown"
    assert {remark.severity for remark in report.remarks} == {"note", "warning"}
    assert report_of(source) is None
    render = words("es").render
    assert render(lost.text).startswith("descartado: eslabón 'base_link' <visual> 1: ")
    assert "no existe ese fichero" in render(lost.text)
    assert [remark.text for remark in report.remarks if render(remark.text) == remark.text] == []


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("<robot name='a'/>", "a.urdf: no tiene ningún eslabón"),
        (
            "<robot name='a'><link name='b'/></robot>",
            "a.urdf: no tiene ninguna articulación que se mueva",
        ),
        (
            "<robot name='a'><link name='b'/><link name='c'/></robot>",
            "a.urdf: tiene 2 eslabones raíz (b, c); únalos",
        ),
        ("nothing", "a.urdf: no es XML: syntax error"),
    ],
)
def test_what_cannot_be_imported_is_told_in_spanish(tmp_path, content, said):
    file = keep({"a.urdf": content.encode()}, tmp_path)
    with pytest.raises(SimrobError) as refused:
        Session.open(file, tmp_path / "taught")
    assert said in words("es").render(str(refused.value))
