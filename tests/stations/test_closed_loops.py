"""Robots with closed loops: refusals that name the remedy, and first stations compared with closed forms."""

from pathlib import Path

import numpy as np
import pytest
import yaml

from simrob_drake import load_station, simulate
from simrob_drake.base.errors import InvalidModel, SimrobError
from simrob_drake.base.folders import CACHE_VARIABLE
from simrob_drake.importer.importing import examine_robot
from simrob_drake.robots.imports import ImportOptions
from simrob_drake.stations.draft import draft_station
from simrob_drake.stations.resolve import resolve

CRANK, COUPLER, ROCKER, GROUND = 0.1, 0.3, 0.25, 0.3  # lengths of a four-bar linkage [m]

LINK = """
<link name="{name}"><inertial><origin xyz="0.05 0 0"/><mass value="0.3"/>
  <inertia ixx="0.001" iyy="0.001" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial></link>"""
JOINT = """
<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/><origin xyz="{x} 0 0"/>
  <axis xyz="0 1 0"/><limit lower="-3" upper="3" effort="20" velocity="5"/></joint>"""

FOUR_BAR = f"""<robot name="four_bar">
{"".join(LINK.format(name=name) for name in ("ground", "crank", "coupler", "rocker", "tip"))}
{JOINT.format(name="a", parent="ground", child="crank", x=0)}
{JOINT.format(name="b", parent="crank", child="coupler", x=CRANK)}
{JOINT.format(name="c", parent="ground", child="rocker", x=GROUND)}
<joint name="e" type="fixed"><parent link="coupler"/><child link="tip"/><origin xyz="{COUPLER} 0 0"/></joint>
{JOINT.format(name="d", parent="rocker", child="tip", x=ROCKER)}
</robot>"""

BAR = """<mujoco model="bar"><worldbody>
 <body name="crank" pos="0 0 1"><joint name="c" axis="0 1 0"/>
  <geom type="capsule" fromto="0 0 0 0.2 0 0" size="0.01" mass="0.3"/>
  <body name="coupler" pos="0.2 0 0"><joint name="p" axis="0 1 0"/>
   <geom type="capsule" fromto="0 0 0 0.3 0 0.1" size="0.01" mass="0.3"/></body></body>
 <body name="rocker" pos="0.5 0 0.9"><joint name="r" axis="0 1 0"/>
  <geom type="capsule" fromto="0 0 0 0 0 0.2" size="0.01" mass="0.3"/></body></worldbody>
 <equality><connect body1="coupler" body2="rocker" anchor="0.3 0 0.1"/></equality>
 <actuator><motor joint="c"/></actuator></mujoco>"""


@pytest.fixture(autouse=True)
def _own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path / "cache"))


def written(folder: Path, name: str, text: str) -> Path:
    file = folder / name
    file.write_text(text)
    return file


def drafted(file: Path) -> Path:
    """The first station of a robot whose loops become couplings."""
    station = file.parent / "station.yaml"
    station.write_text(draft_station(file, ImportOptions(couple=True), folder=file.parent))
    return station


def plane_point(length: float, angle: float) -> complex:
    """End of a bar in the plane x + i z that a joint about y turns by an angle [m]."""
    return length * np.exp(-1j * angle)


def rocker_angles(
    crank: float, *, start: complex, pivot: complex, rod: float, rocker: float
) -> tuple[float, float]:
    """Both angles of a rocker about y for a crank's end, by the triangle of rod and rocker.

    Angles count from the x axis.
    """
    way = start - pivot
    distance = abs(way)
    cosine = (rocker**2 + distance**2 - rod**2) / (2 * rocker * distance)
    opening = np.arccos(cosine)
    ahead = -np.angle(way)
    return float(ahead + opening), float(ahead - opening)


def angle_between(one: float, other: float) -> float:
    """Smallest turn between two angles, not negative [rad]."""
    return float(abs(np.angle(np.exp(1j * (one - other)))))


def test_a_four_bar_runs_as_its_closed_form_says(tmp_path: Path) -> None:
    """During a run the rocker has one of the two angles that the triangle of coupler and rocker allows."""
    station = drafted(written(tmp_path, "four_bar.urdf", FOUR_BAR))
    content = yaml.safe_load(station.read_text())
    assert content["couplings"]["d"]["kind"] == "hinge"

    result = simulate(load_station(station), duration=2.0, progress=False)

    crank = result["q.a"]
    rocker = result["q.c"]
    assert np.ptp(crank) > np.deg2rad(8)
    assert np.ptp(rocker) > np.deg2rad(1)
    for crank_angle, rocker_angle in zip(crank[::40], rocker[::40], strict=True):
        end = plane_point(CRANK, crank_angle)
        possible = rocker_angles(crank_angle, start=end, pivot=GROUND, rod=COUPLER, rocker=ROCKER)
        assert min(angle_between(rocker_angle, angle) for angle in possible) < 2e-3


@pytest.mark.long
def test_a_connected_bar_of_mjcf_runs_as_its_closed_form_says(tmp_path: Path) -> None:
    """The rocker's bar points up at zero: its angle about y from x is -90 deg there."""
    length = 0.2  # of crank and rocker [m]
    crank_joint = 1j  # in the plane x + i z [m]
    rocker_joint = 0.5 + 0.9j
    rod = float(np.hypot(0.3, 0.1))
    station = drafted(written(tmp_path, "bar.xml", BAR))

    result = simulate(load_station(station), duration=2.0, progress=False)

    crank = result["q.c"]
    rocker = result["q.r"]
    assert np.ptp(crank) > np.deg2rad(8)
    for crank_angle, rocker_angle in zip(crank[::40], rocker[::40], strict=True):
        end = crank_joint + plane_point(length, crank_angle)
        possible = rocker_angles(crank_angle, start=end, pivot=rocker_joint, rod=rod, rocker=length)
        assert min(angle_between(rocker_angle - np.pi / 2, angle) for angle in possible) < 2e-3
    # The file has an actuator for the crank alone; the loop moves the others.
    (robot,) = resolve(load_station(station)).robots.values()
    assert robot.gains.passive.tolist() == [axis != "c" for axis in robot.axes]


def content_of(station: Path) -> dict:
    return yaml.safe_load(station.read_text())


@pytest.mark.parametrize(
    ("name", "text", "line"),
    [
        (
            "four_bar.urdf",
            FOUR_BAR,
            "`d: {kind: hinge, body: rocker, other: tip, pose: [0.25, 0, 0, 0, -1.5708, -1.5708]",
        ),
        (
            "bar.xml",
            BAR,
            "`equality_1: {kind: ball, body: coupler, other: rocker, point: [0.3, 0, 0.1], other_point: [",
        ),
    ],
)
def test_refusals_have_the_line_to_write(tmp_path: Path, name: str, text: str, line: str) -> None:
    with pytest.raises(InvalidModel, match="--couple") as refused:
        examine_robot(written(tmp_path, name, text))
    assert line in str(refused.value)
    assert "--drop-loops" in str(refused.value)


def test_the_line_of_the_refusal_closes_the_loop(tmp_path: Path) -> None:
    file = written(tmp_path, "four_bar.urdf", FOUR_BAR)

    with pytest.raises(InvalidModel) as refused:
        examine_robot(file)

    coupling = yaml.safe_load(str(refused.value).split("`")[1])
    by_hand = examine_robot(file, ImportOptions(drop_loops=True))

    assert any(entry.kind == "lost" for entry in by_hand.report.entries)

    own = content_of(drafted(file))["couplings"]
    assert coupling.keys() == own.keys()
    assert {key: coupling["d"][key] for key in ("kind", "body", "other")} == {
        key: own["d"][key] for key in ("kind", "body", "other")
    }
    np.testing.assert_allclose(coupling["d"]["pose"], own["d"]["pose"], atol=1e-5)
    np.testing.assert_allclose(coupling["d"]["other_pose"], own["d"]["other_pose"], atol=1e-5)


@pytest.mark.long
def test_loops_that_cannot_close_are_refused(tmp_path: Path) -> None:
    short = FOUR_BAR.replace(f'<origin xyz="{ROCKER} 0 0"/>', '<origin xyz="0.01 0 0"/>').replace(
        f'<origin xyz="{COUPLER} 0 0"/>', '<origin xyz="0.02 0 0"/>'
    )
    with pytest.raises(SimrobError, match=r"each kinematic loop is open by .* m or rad at best"):
        drafted(written(tmp_path, "short.urdf", short))
