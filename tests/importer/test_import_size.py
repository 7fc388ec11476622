"""Large robots: the work of an import grows as they do, up to a limit that is told."""

import sys
import xml.etree.ElementTree as ET
from functools import partial

import pytest
from repair_stages import joint, repair

from simrob_drake.base.errors import InvalidModel
from simrob_drake.robots import urdf_check
from simrob_drake.robots.imports import ImportOptions, ImportReport
from simrob_drake.robots.urdf_check import check_urdf

BODY = '<inertial><mass value="0.1"/><inertia ixx="1e-3" iyy="1e-3" izz="1e-3"/></inertial>'
LOOK = '<visual><geometry><sphere radius="1"/></geometry><material name="m"><color rgba="0 0 1 1"/></material></visual>'
LIMIT = '<axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="9" velocity="1"/>'
DRIVE = '<transmission name="t"><type>SimpleTransmission</type><joint name="{0}"/><actuator name="a"/></transmission>'


def robot(links: int, *, star: bool = False, name: str = "j{}") -> ET.Element:
    parts = ['<link name="l0"/>']
    for number in range(1, links):
        parent, called = "l0" if star else f"l{number - 1}", name.format(number)
        moved = joint(called, parent, f"l{number}", "revolute", LIMIT)
        parts += [f'<link name="l{number}">{BODY}{LOOK}</link>', moved, DRIVE.format(called)]
    return ET.fromstring(f'<robot name="r">{"".join(parts)}</robot>')


def calls(element: ET.Element, folder) -> int:
    """Return how many functions, and steps of generators, are called to repair a robot."""
    count = 0

    def called(*_) -> None:
        nonlocal count
        count += 1

    before = sys.getprofile()
    sys.setprofile(called)
    try:
        repair(element, folder, ImportOptions(), ImportReport(folder / "a.urdf"))
    finally:
        sys.setprofile(before)
    return count


@pytest.mark.parametrize(
    "shape",
    [partial(robot), partial(robot, star=True), partial(robot, name="j")],
    ids=["chain", "star", "one name"],
)
def test_twice_the_links_are_twice_the_work(tmp_path, shape):
    calls(shape(10), tmp_path)  # what is cached later
    assert calls(shape(200), tmp_path) == pytest.approx(2 * calls(shape(100), tmp_path), rel=0.1)


def test_more_links_than_drake_has_memory_for_are_refused_at_once(tmp_path, monkeypatch):
    monkeypatch.setattr(urdf_check, "MOST_LINKS", 20)
    check_urdf(robot(20), tmp_path / "a.urdf")

    repair(robot(20), tmp_path, ImportOptions(), ImportReport(tmp_path / "a.urdf"))

    for check in (
        check_urdf,
        lambda *_: repair(robot(21), tmp_path, ImportOptions(), ImportReport(tmp_path)),
    ):
        with pytest.raises(InvalidModel, match="has 21 links; at most 20 are accepted"):
            check(robot(21), tmp_path / "a.urdf")
