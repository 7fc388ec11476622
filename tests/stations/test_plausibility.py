"""Doubts about implausible numbers in robots of every format and in a station's keys; published robots raise none."""

import re

import numpy as np
import pytest
import trimesh
import yaml

from simrob_drake import load_station, simulate
from simrob_drake.base.errors import SimrobError
from simrob_drake.importer.importing import examine_robot
from simrob_drake.robots.catalog import load_robot, robot_names
from simrob_drake.robots.plausibility import (
    MassProperties,
    doubts_by_shapes,
    payload_doubt,
    robot_doubts,
)
from simrob_drake.stations.checks import check_station
from simrob_drake.stations.draft import draft_station
from simrob_drake.stations.load import station_names
from simrob_drake.stations.plausibility import plausibility_findings
from simrob_drake.stations.resolve import resolve

URDF = """<robot name="flap"><link name="post"/><link name="rod"><inertial><origin xyz="{com} 0 0"/><mass value="1"/>
<inertia ixx="{moment}" iyy="{moment}" izz="{moment}" ixy="0" ixz="0" iyz="0"/></inertial>{shape}</link>
<joint name="hinge" type="revolute"><parent link="post"/><child link="rod"/><origin xyz="0 0 0.4"/><axis xyz="0 1 0"/>
<limit lower="-0.5" upper="0.4" effort="{effort}" velocity="20"/></joint></robot>"""
BOX = "<visual><geometry><box size='0.4 0.05 0.05'/></geometry></visual>"
SDF = """<sdf version="1.9"><model name="flap"><link name="post"/><link name="rod"><pose>0 0 0.4 0 0 0</pose><inertial>
<pose>{com} 0 0 0 0 0</pose><mass>1</mass><inertia><ixx>{moment}</ixx><iyy>{moment}</iyy><izz>{moment}</izz></inertia>
</inertial></link><joint name="weld" type="fixed"><parent>world</parent><child>post</child></joint>
<joint name="hinge" type="revolute"><parent>post</parent><child>rod</child><axis><xyz>0 1 0</xyz><limit>
<lower>-1</lower><upper>1</upper><effort>{effort}</effort><velocity>3</velocity></limit></axis></joint></model></sdf>"""
MJCF = """<mujoco><worldbody><body pos="0 0 0.4"><joint name="hinge" axis="0 1 0" range="-60 60"/>
<inertial pos="{com} 0 0" mass="1" diaginertia="{moment} {moment} {moment}"/></body></worldbody></mujoco>"""
DH = """name: flap
dh: {{convention: classical, rows: [{{a: 0.4, limit_deg: [-60, 60], effort: {effort}, mass: 1, com: [{com}, 0, 0],
  inertia: [{moment}, {moment}, {moment}]}}]}}
"""
GOOD = {"com": 0.1, "moment": 0.01, "effort": 100}


def doubts(file):
    """Collect the doubts about the numbers of a robot that is imported or described."""
    if file.suffix == ".yaml":
        content = {"robot": {"model": str(file)}, "duration": 0.01}
        (file.parent / "station.yaml").write_text(yaml.safe_dump(content))
        station = resolve(load_station(file.parent / "station.yaml"))
        return [finding.text for finding in plausibility_findings(station.config, station)]
    return [entry.text for entry in examine_robot(file).report.entries]


@pytest.mark.parametrize(
    ("text", "name"),
    [(URDF, "flap.urdf"), (SDF, "flap.sdf"), (MJCF, "flap.xml"), (DH, "flap/robot.yaml")],
)
@pytest.mark.parametrize(
    ("wrong", "told"),
    [({}, None), ({"com": 20.0}, "centre of mass is"), ({"moment": 1e4}, "moments are")],
)
def test_all_formats_pass_the_same_list(tmp_path, text, name, wrong, told):
    if name.endswith(".xml"):
        pytest.importorskip("mujoco")
    file = tmp_path / name
    file.parent.mkdir(exist_ok=True)
    file.write_text(text.format(**{**GOOD, **wrong}, shape=""))

    found = [
        doubt
        for doubt in doubts(file)
        if "millimetres meant" in doubt or "moments are" in doubt or "kg mm²" in doubt
    ]

    assert any(told in doubt for doubt in found) if told else not found, found


@pytest.mark.parametrize("shape", ["", BOX])
def test_a_centre_of_mass_in_millimetres_is_told_by_every_command(tmp_path, shape):
    file = tmp_path / "flap.urdf"
    file.write_text(URDF.format(**{**GOOD, "com": 200}, shape=shape))

    text = draft_station(file, folder=tmp_path)

    assert "link 'rod' <inertial>: its centre of mass is 200 m from" in text

    (tmp_path / "first.yaml").write_text(text)
    config = load_station(
        tmp_path / "first.yaml", {"duration": 0.01, "solver": {"kind": "discrete"}}
    )

    checked = [finding.text for finding in check_station(config) if finding.level == "warning"]

    for told in (checked, simulate(config, progress=False).warnings):
        assert any("its centre of mass is 200 m from" in each for each in told), told


def test_bodies_against_their_shapes():
    """A cube of 0.1 m: volume 1e-3 m³, moments 2 * m s² / 12 each."""
    cube = MassProperties(1e-3, np.zeros(3), 3e-3 * 0.01 / 6)
    steel = MassProperties(7.85, np.zeros(3), 7.85 * 3 * 0.01 / 6)

    assert doubts_by_shapes(steel, cube) == []
    assert (
        "grams" in doubts_by_shapes(steel._replace(mass=7850.0, trace=7850 * 3 * 0.01 / 6), cube)[0]
    )
    assert (
        "middle of its shapes"
        in doubts_by_shapes(steel._replace(centre=np.array([0, -50.0, 0])), cube)[0]
    )
    assert "1e+06 times" in doubts_by_shapes(steel._replace(trace=steel.trace * 1e6), cube)[0]
    assert doubts_by_shapes(steel._replace(trace=0.0), cube) == []  # a point mass is meant


@pytest.mark.parametrize(
    ("payload", "mass", "told"),
    [(0.0, 20, "cannot hold"), (7620.0, 25, "305 times"), (30, 25, ""), (90, 1, "")],
)
def test_payloads(payload, mass, told):
    assert (told in payload_doubt(payload, mass)) if told else payload_doubt(payload, mass) == ""


def box(**keys):
    return {
        "pieces": {
            "crate": {
                "free": True,
                "mass": 2.0,
                "box": [0.2, 0.2, 0.2],
                "pose": [0, 0, 0.1, 0, 0, 0],
                **keys,
            }
        }
    }


@pytest.mark.parametrize(
    ("content", "told"),
    [
        (
            box(box=[100, 100, 100], mass=1e9),
            "pieces.crate: a side of 100 m; were millimetres meant?",
        ),
        (box(pose=[500, 0, 0.1, 0, 0, 0]), "pieces.crate.pose: a coordinate of 500 m"),
        (
            box(pose=[0, 0, 0.1, 90, 0, 0]),
            r"crate.pose: an angle of 90 rad is 14.3 turns; .* 90° are 1.5708 rad",
        ),
        (box(pose=[0, 0, 0.1, 0, 0, -45]), "an angle of -45 rad"),
        (box(mass=2000.0), "2.5e.05 kg/m³; were grams"),
        (box(mass=1e-4), "0.0125 kg/m³; were grams"),
        (box(com=[25, 0, 0]), "centre of mass is 25 m from"),
        (box(inertia=[0.01e6] * 3), "moments are .* times"),
        ({**box(), "gravity": -9.81}, "gravity: -9.81 m/s² points up"),
        ({**box(), "gravity": 9810}, "gravity: 9810 m/s² is 1e.03 times"),
        (
            {**box(), "contact": {"friction": {"static": 50, "dynamic": 40}}},
            "friction.static: a coefficient .* of 50",
        ),
        (
            {"robot": {"model": "irb120", "base": [0, 0, 0, 180, 0, 0]}},
            r"robots.robot.base: an angle of 180 rad",
        ),
        (
            {"robot": {"model": "irb120", "tcp_offset": [0, 0, 120, 0, 0, 0]}},
            "tcp_offset: a coordinate of 120 m",
        ),
        (
            {"robot": {"model": "irb120", "mass_factors": {"link_1": 50}}},
            "mass_factors.link_1: the mass is 50 times",
        ),
    ],
)
def test_a_stations_own_keys_are_doubted(tmp_path, content, told):
    (tmp_path / "station.yaml").write_text(
        yaml.safe_dump({"solver": {"kind": "discrete"}, "duration": 0.01, **content})
    )
    config = load_station(tmp_path / "station.yaml")
    for texts in (
        [finding.text for finding in check_station(config) if finding.level == "warning"],
        simulate(config, progress=False).warnings,
    ):
        assert any(re.search(told, text) for text in texts), texts


@pytest.mark.parametrize("ending", [".obj", ".stl"])
def test_meshes_are_judged_by_the_sizes_of_boxes(tmp_path, ending):
    """A mesh of 40 m is doubted as a box of 40 m is, although its scale was given."""
    trimesh.creation.box([40.0, 20.0, 10.0]).export(tmp_path / f"large{ending}")
    content = {
        "pieces": {"crate": {"mesh": f"large{ending}", "scale": 1, "mass": 8e6, "parent": "world"}}
    }
    content["robot"] = {"model": "irb120"}
    (tmp_path / "station.yaml").write_text(yaml.safe_dump(content))

    config = load_station(tmp_path / "station.yaml")

    texts = [finding.text for finding in check_station(config) if finding.level == "warning"]
    assert "pieces.crate: a side of 40 m; were millimetres meant? lengths are in metres" in texts


@pytest.mark.parametrize(
    "reference",
    [
        {"kind": "move", "target_deg": {"joint_1": 400}, "duration": 1000},
        {"kind": "hold", "target_deg": {"joint_1": -400}},
        {"kind": "sequence", "targets": [{"time": 900, "target_deg": {"joint_1": 400}}]},
    ],
)
def test_targets_beyond_limits_are_refused_though_no_run_reaches_them(tmp_path, reference):
    content = {"robot": {"model": "irb120"}, "reference": reference, "duration": 0.1}
    (tmp_path / "station.yaml").write_text(yaml.safe_dump(content))
    with pytest.raises(
        SimrobError, match=r"reference of joint_1 is -?400 deg; .* limits of -165 to 165 deg"
    ):
        load_station(tmp_path / "station.yaml")


@pytest.mark.parametrize("name", robot_names())
def test_no_shipped_robot_is_doubted(name):
    robot = load_robot(name)
    assert robot_doubts(robot.element, robot.folder) == []


def test_no_shipped_station_is_doubted():
    for name in station_names():
        station = resolve(load_station(name, allow_code=True))
        assert plausibility_findings(station.config, station) == [], name


def test_a_warning_names_its_subject_once(tmp_path):
    content = {
        "solver": {"kind": "discrete"},
        "duration": 0.01,
        **box(box=[100, 100, 100], mass=1e9),
    }
    (tmp_path / "station.yaml").write_text(yaml.safe_dump(content))

    (finding,) = (
        one
        for one in check_station(load_station(tmp_path / "station.yaml"))
        if "a side of" in one.text
    )

    assert f"{finding.subject}: {finding.text}".count("pieces.crate") == 1
