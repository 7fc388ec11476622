"""Xacro files: expanded with packages found as for meshes, and with nothing that an expression could do to anyone."""

import importlib.util
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest
from typer.testing import CliRunner

from simrob_drake.base.errors import InvalidModel
from simrob_drake.base.folders import CACHE_VARIABLE
from simrob_drake.cli.app import app
from simrob_drake.importer.importing import robot_from_file
from simrob_drake.importer.reading import child, xacro
from simrob_drake.importer.reading.source import read_source
from simrob_drake.robots.imports import ImportOptions, ImportReport
from simrob_drake.simulation import simulate
from simrob_drake.stations.load import load_station

installed = pytest.mark.skipif(
    importlib.util.find_spec("xacro") is None, reason="needs the extra xacro"
)

HEAD = '<robot name="arm" xmlns:xacro="http://www.ros.org/wiki/xacro">'
BAR = f"""{HEAD}
  <xacro:property name="length" value="0.3"/>
  <xacro:macro name="bar" params="name mass">
    <link name="${{name}}"><inertial><mass value="${{mass}}"/>
      <inertia ixx="${{mass * length**2 / 12}}" iyy="${{mass * length**2 / 12}}" izz="1e-3"/></inertial></link>
  </xacro:macro>
</robot>"""
ARM = f"""{HEAD}
  <xacro:arg name="mass" default="2"/>
  <xacro:include filename="$(find bars)/bar.xacro"/>
  <link name="base"/>
  <xacro:bar name="upper" mass="$(arg mass)"/>
  <xacro:bar name="lower" mass="1"/>
  <joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/>
    <limit lower="${{-pi / 2}}" upper="${{radians(90)}}" effort="50" velocity="3"/></joint>
  <joint name="elbow" type="revolute"><parent link="upper"/><child link="lower"/><axis xyz="0 1 0"/>
    <origin xyz="0 0 ${{length}}"/><limit lower="-1" upper="1" effort="20" velocity="3"/></joint>
</robot>"""


def packages(folder: Path) -> Path:
    """Write an arm in one package that includes a macro from another, and return its file."""
    for name, file, text in (
        ("arm_support", "urdf/arm.urdf.xacro", ARM),
        ("bars", "bar.xacro", BAR),
    ):
        path = folder / name / file
        path.parent.mkdir(parents=True)
        path.write_text(text)
        (folder / name / "package.xml").write_text(f"<package><name>{name}</name></package>")
    return folder / "arm_support" / "urdf" / "arm.urdf.xacro"


def alone(folder: Path, body: str) -> Path:
    path = folder / "arm" / "a.xacro"
    path.parent.mkdir(exist_ok=True)
    path.write_text(f'{HEAD}<link name="base"/>{body}</robot>')
    return path


def refusal(path: Path, **options) -> str:
    with pytest.raises(InvalidModel) as caught:
        read_source(path, ImportReport(path), ImportOptions(**options))
    assert "\n" not in str(caught.value)
    return str(caught.value)


@installed
def test_a_comment_before_the_declaration_does_no_harm(tmp_path):
    path = packages(tmp_path)
    for file in (path, tmp_path / "bars" / "bar.xacro"):
        file.write_text(f'<!-- licence -->\n<?xml version="1.0"?>\n{file.read_text()}')
    assert len(read_source(path, ImportReport(path)).findall("link")) == 3


@installed
def test_macros_of_other_packages_are_found_and_computed(tmp_path):
    path = packages(tmp_path)
    robot = read_source(path, report := ImportReport(path))

    assert [link.get("name") for link in robot.iterfind("link")] == ["base", "upper", "lower"]

    inertia = robot.find("link[@name='upper']/inertial/inertia")
    assert inertia is not None
    assert float(inertia.attrib["ixx"]) == pytest.approx(2 * 0.3**2 / 12)

    told = [
        "arguments, which --xacro-arg NAME:=VALUE sets: mass:=2",
        "the macros of the xacro file are expanded",
    ]
    assert [entry.text for entry in report.entries] == told


@pytest.mark.long
@installed
def test_packages_are_found_below_a_mesh_path_and_told_where_they_are_not(tmp_path):
    path = packages(tmp_path / "here")
    (tmp_path / "there" / "deep").mkdir(parents=True)

    (path.parents[2] / "bars").rename(tmp_path / "there" / "deep" / "bars")

    assert "package 'bars' is not found; give its folder with --mesh-path DIR" in refusal(path)

    read_source(path, ImportReport(path), ImportOptions(mesh_path=(tmp_path / "there",)))


@pytest.mark.long
@installed
def test_a_station_runs_a_xacro_and_notices_what_it_includes(tmp_path, monkeypatch):
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path / "cache"))
    path = packages(tmp_path)

    assert robot_from_file(path).axes.keys() == {"shoulder", "elbow"}

    bar = tmp_path / "bars" / "bar.xacro"
    bar.write_text(bar.read_text().replace("0.3", "0.6"))

    [origin] = robot_from_file(path).element.findall("joint[@name='elbow']/origin")

    assert origin.get("xyz") == "0 0 0.6"

    station = tmp_path / "arm.yaml"
    station.write_text(
        f"robot: {{urdf: {path}, import_options: {{xacro_arg: ['mass:=3']}}}}\nmode: dynamic\n"
    )

    result = simulate(load_station(station), duration=0.02)

    assert result.stopped_by is None


@installed
def test_an_import_takes_arguments_and_keeps_the_name(tmp_path):
    path = packages(tmp_path)
    done = CliRunner().invoke(
        app, ["import", str(path), "--out", str(tmp_path / "out"), "--xacro-arg", "mass:=5"]
    )

    assert done.exit_code == 0, done.output
    assert 'mass value="5"' in (tmp_path / "out" / "arm.urdf").read_text()
    assert "'mass=5' is not of the form NAME:=VALUE" in refusal(path, xacro_arg=("mass=5",))


@pytest.mark.parametrize("text", [ARM, '<robot name="${name}"/>'])
def test_without_xacro_one_line_says_how(tmp_path, monkeypatch, text):
    monkeypatch.setattr(xacro.importlib.util, "find_spec", lambda name: None)
    path = tmp_path / "arm.xacro"

    path.write_text(text)

    assert refusal(path).endswith(
        'is a xacro file, which needs the extra xacro: pip install "xacro>=2.1"'
    )


def test_a_folder_called_xacro_is_not_taken_for_the_package(tmp_path):
    (tmp_path / "xacro").mkdir()
    code = "import sys; sys.path = [p for p in sys.path if 'site-packages' not in p]; import importlib.util as u\n"
    code += "found = u.find_spec('xacro'); print(found is not None and found.origin is not None)"

    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, check=True
    )

    assert done.stdout.decode().strip() == "False"


@installed
@pytest.mark.parametrize(
    ("body", "words"),
    [
        ("<xacro:lost/>", "xacro cannot expand the file: unknown macro name: xacro:lost"),
        (
            '<link name="$(arg kind)"/>',
            "argument kind; arguments, which --xacro-arg NAME:=VALUE sets: kind (required)",
        ),
        ('<link name="${1 / 0}"/>', "division by zero"),
        ('<link name="${1 +}"/>', "invalid syntax"),
        ('<link name="${[0] * 10**10}"/>', "xacro cannot expand the file"),
        ('<xacro:include filename="lost.xacro"/>', "lost.xacro: No such file or directory"),
        (
            '<xacro:macro name="m"><xacro:m/></xacro:macro><xacro:m/>',
            "maximum recursion depth exceeded",
        ),
        ("<link name=\"${'x' * 1000000}\"/>" * 21, "the result is larger than 20 MB"),
        ("<xacro:element xacro:name=\"${'xacro' + ':late'}\"/>", "xacro"),
    ],
)
def test_what_cannot_be_expanded_is_told_in_one_line(tmp_path, body, words):
    assert words in refusal(alone(tmp_path, body))


@installed
def test_a_xacro_without_end_is_stopped(tmp_path, monkeypatch):
    monkeypatch.setattr(xacro, "TIME_LIMIT", 1.5)
    path = alone(
        tmp_path, '<link name="${[len([0 for i in range(90000)]) for k in range(90000)]}"/>'
    )

    start = time.monotonic()

    assert "the process does not end within 1.5 s" in refusal(path)
    assert time.monotonic() - start < 15


@installed
@pytest.mark.parametrize(
    "reading",
    [
        '<xacro:include filename="../secret.xacro"/>',
        '<xacro:include filename="link.xacro"/>',
        '<xacro:include filename="../*.xacro"/>',
        "<xacro:property name='p' value=\"${xacro.load_yaml('../secret.xacro')}\"/><link name='${p}'/>",
        "<xacro:property name='p' value=\"${xacro.load_yaml('SECRET')}\"/><link name='${p}'/>",
    ],
)
def test_nothing_is_read_outside_of_the_folders_of_meshes(tmp_path, reading):
    secret = tmp_path / "secret.xacro"
    secret.write_text(f"{HEAD}<link name='secret'/></robot>")
    path = alone(tmp_path, reading.replace("SECRET", str(secret)))
    os.symlink(secret, path.parent / "link.xacro")

    told = refusal(path)

    assert "is outside the allowed folders" in told
    assert f"allow it with --mesh-path {tmp_path}" in told


@installed
def test_several_files_of_a_folder_are_included_by_a_pattern(tmp_path):
    path = alone(tmp_path, '<xacro:include filename="part_*.xacro"/>')
    for name in ("part_b", "part_a", "other"):
        (path.parent / f"{name}.xacro").write_text(f'{HEAD}<link name="{name}"/></robot>')
    assert [link.get("name") for link in read_source(path, ImportReport(path))] == [
        "base",
        "part_a",
        "part_b",
    ]


@pytest.mark.long
@installed
def test_what_is_mended_in_an_included_file_is_told_with_its_name(tmp_path):
    path = alone(
        tmp_path,
        '<xacro:include filename="part.xacro"/><xacro:include filename="none.xacro" optional="1"/>',
    )
    (path.parent / "part.xacro").write_text(
        f'\ufeff<!-- a -- b -->{HEAD}<link name="part"/></robot>'
    )

    robot = read_source(path, report := ImportReport(path))

    assert [link.get("name") for link in robot] == ["base", "part"]
    assert [entry.element for entry in report.of("repaired")] == ["part.xacro", "part.xacro"]

    (path.parent / "part.xacro").write_text(
        f'<!DOCTYPE robot [<!ENTITY a "b">]>{HEAD}<link name="&a;"/></robot>'
    )
    assert "part.xacro declares a document type or entities" in refusal(path)


@installed
def test_yaml_has_keys_units_and_dates(tmp_path):
    (tmp_path / "arm").mkdir()
    content = (
        "arm: {turn: !degrees 180, long: !inches 2 * 5, when: 2001-02-03, keys: [a, {items: 7}]}"
    )
    (tmp_path / "arm" / "figures.yaml").write_text(content)
    value = "${f.arm.turn / pi} ${f['arm'].long} ${f.arm.when} ${f.arm['keys'][1].items}"
    body = f"<xacro:property name='f' value=\"${{load_yaml('figures.yaml')}}\"/><link name=\"{value}\"/>"

    [_, link] = read_source(path := alone(tmp_path, body), ImportReport(path))

    assert link.get("name") == "1.0 0.254 2001-02-03 7"


@installed
def test_what_the_file_says_and_what_the_system_lacks_is_in_the_report(tmp_path, monkeypatch):
    path = alone(tmp_path, "<link name=\"a${xacro.warning('old', 'names')}\"/>")
    read_source(path, report := ImportReport(path))

    assert [entry.text for entry in report.of("read")] == [
        "message of the file: old names",
        "the macros of the xacro file are expanded",
    ]

    end = {"urdf": HEAD + "</robot>", "messages": [], "unconfined": ["Landlock"]}
    monkeypatch.setattr(child, "_exchange", lambda *_: end)

    read_source(path, report := ImportReport(path))

    assert "read in a process without the protection of Landlock" in report.of("read")[0].text


@pytest.mark.long
@installed
def test_sets_are_in_the_same_order_each_time(tmp_path):
    path = alone(
        tmp_path,
        "<link name=\"${'_'.join(python.set('arm leg hand foot head tail toe'.split()))}\"/>",
    )
    first, second = (
        read_source(path, ImportReport(path)).findall("link")[1].get("name") for _ in range(2)
    )
    assert first == second


@pytest.mark.long
@installed
def test_the_environment_is_not_there_to_read(tmp_path, monkeypatch):
    monkeypatch.setenv("SECRET_OF_MINE", "4711")

    assert "SECRET_OF_MINE" in refusal(alone(tmp_path, '<link name="$(env SECRET_OF_MINE)"/>'))

    path = alone(tmp_path, '<link name="$(optenv SECRET_OF_MINE none)"/>')
    assert [link.get("name") for link in read_source(path, ImportReport(path))] == ["base", "none"]


@pytest.mark.long
@installed
def test_a_file_of_macros_alone_is_told_with_them_and_with_what_calls_them(tmp_path):
    path = packages(tmp_path)
    told = refusal(tmp_path / "bars" / "bar.xacro")

    assert told.endswith(
        "bar.xacro: contains no robot, only macros for other files: bar(name, mass)"
    )

    (path.parent / "bar.xacro").write_text(BAR)
    assert told + "; files that call these macros: urdf/arm.urdf.xacro" == refusal(
        path.parent / "bar.xacro"
    ).replace("arm_support/urdf", "bars")


@pytest.mark.long
@installed
def test_arguments_are_told_with_what_is_known_of_them(tmp_path):
    (tmp_path / "arm" / "kinds" / "long").mkdir(parents=True)
    (tmp_path / "arm" / "kinds" / "long" / "figures.yaml").write_text("length: 2")
    (tmp_path / "arm" / "package.xml").write_text("<package><name>arm</name></package>")
    body = (
        "<xacro:arg name='kind' default='short'/><xacro:arg name='hand' default='none'/>"
        "<xacro:property name='gripper' value='$(arg hand)'/><!-- ${gripper == 'hook'} -->"
        "<xacro:if value=\"${gripper in ['two', 'three'] or gripper == 'none'}\"><link name='tip'/></xacro:if>"
        "<xacro:property name='f' value=\"${load_yaml('$(find arm)/kinds/$(arg kind)/figures.yaml')}\"/>"
        "<link name='l${f.length}'/>"
    )
    path = alone(tmp_path, body)

    told = refusal(path)

    assert "kinds/short/figures.yaml: No such file or directory; arguments" in told
    assert "kind:=short (known values: long); hand:=none (known values: none, three, two)" in told

    robot = read_source(
        path, report := ImportReport(path), ImportOptions(xacro_arg=("kind:=long",))
    )
    assert [link.get("name") for link in robot] == ["base", "tip", "l2"]
    assert "hand:=none (known values: none, three, two)" in report.of("read")[0].text


@pytest.mark.long
@installed
def test_an_argument_that_is_used_before_its_declaration_has_its_value(tmp_path):
    path = alone(tmp_path, '<link name="$(arg kind)"/><xacro:arg name="kind" default="short"/>')
    robot = read_source(path, report := ImportReport(path))

    assert [link.get("name") for link in robot] == ["base", "short"]
    assert [entry.text for entry in report.of("defaulted")] == [
        "kind:=short; the file declares this default after the first use of the argument"
    ]
