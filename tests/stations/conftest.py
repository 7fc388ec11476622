"""Fixtures for tests of stations: files of stations, and robots made of boxes, written link by link."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pytest
import yaml

from simrob_drake.robots.catalog import load_robot_from_urdf
from simrob_drake.stations.clearance import Clearance
from simrob_drake.stations.config import StationConfig

LINK = """<link name="{name}">
  <inertial><origin xyz="{at}"/><mass value="{mass}"/>
    <inertia ixx="{i}" ixy="0" ixz="0" iyy="{i}" iyz="0" izz="{i}"/></inertial>
  <collision><origin xyz="{at}"/><geometry><box size="{size}"/></geometry></collision></link>"""
JOINT = """<joint name="{child}_joint" type="revolute"><parent link="{parent}"/><child link="{child}"/>
  <origin xyz="{at}"/><axis xyz="{axis}"/>
  <limit lower="{lower}" upper="{upper}" effort="{effort}" velocity="5"/></joint>
<transmission name="{child}_drive"><type>transmission_interface/SimpleTransmission</type>
  <joint name="{child}_joint"/><actuator name="{child}_motor"/></transmission>"""


def link(name: str, size: str, at: str = "0 0 0", mass: float = 1.0) -> str:
    """URDF of a link that is a box, with its size and the position of its centre in the link's frame [m]."""
    return LINK.format(name=name, size=size, at=at, mass=mass, i=2e-3 * mass)


def joint(
    child: str,
    parent: str,
    at: str,
    axis: str = "0 1 0",
    span: tuple[float, float] = (-2, 2),
    effort=100.0,
):
    """URDF of the joint ``<child>_joint``, which turns a link about an axis within a span [rad]."""
    lower, upper = span
    return JOINT.format(
        child=child, parent=parent, at=at, axis=axis, lower=lower, upper=upper, effort=effort
    )


@pytest.fixture
def write_station(tmp_path: Path) -> Callable[[Mapping[str, Any]], Path]:
    """A function that writes the content of a station to a YAML file, and returns the file."""

    def write(content: Mapping[str, Any]) -> Path:
        file = tmp_path / "station.yaml"
        file.write_text(yaml.safe_dump(content))
        return file

    return write


@pytest.fixture
def robot_of(tmp_path: Path) -> Callable[..., Path]:
    """A function that writes a robot of URDF parts, with a description if it floats, and returns its URDF."""

    def write(*parts: str, **description: Any) -> Path:
        (folder := tmp_path / "robot").mkdir(exist_ok=True)
        (urdf := folder / "robot.urdf").write_text(
            '<robot name="robot">' + "".join(parts) + "</robot>"
        )
        if description:
            content = {"urdf": urdf.name, "root": "trunk", **description}
            (folder / "robot.yaml").write_text(yaml.safe_dump(content))
        return urdf

    return write


@pytest.fixture
def clearance_of() -> Callable[..., Clearance]:
    """A function that puts a robot on a floor, with sections of the station, and returns its clearance."""

    def look(urdf: Path, robot: Mapping[str, Any] | None = None, **sections: Any) -> Clearance:
        entry = {"urdf": urdf, "initial_deg": load_robot_from_urdf(urdf).home_deg, **(robot or {})}
        config = StationConfig(name="first", robots={"robot": entry}, floor={"size": 3}, **sections)
        return Clearance(config, trusts_home=False)

    return look


@pytest.fixture
def quadruped(robot_of: Callable[..., Path]) -> Callable[..., Path]:
    """A function that writes a trunk on four legs of two links of 0.2 m, whose knees bend one way only.

    Its arguments are the home position of the knees, the count of legs, and the upper limit of the knees.
    """

    def write(knees_deg: float = -97.0, legs: int = 4, most_deg: float = -45.0) -> Path:
        parts = [link("trunk", "0.4 0.2 0.1", mass=5.0)]
        axes = []
        hips = [(0.18, 0.1), (0.18, -0.1), (-0.18, 0.1), (-0.18, -0.1)]
        for number, (x, y) in enumerate(hips[:legs]):
            thigh = f"thigh{number}"
            shank = f"shank{number}"
            largest_angle = most_deg * 3.14159 / 180
            parts.append(link(thigh, "0.03 0.03 0.18", "0 0 -0.1", 0.3))
            parts.append(link(shank, "0.02 0.02 0.2", "0 0 -0.1", 0.1))
            parts.append(joint(thigh, "trunk", f"{x} {y} 0", span=(-1.5, 1.5)))
            parts.append(joint(shank, thigh, "0 0 -0.2", span=(-2.6, largest_angle)))
            axes += [f"{thigh}_joint", f"{shank}_joint"]
        home = {axis: knees_deg for axis in axes if axis.startswith("shank")}
        return robot_of(*parts, base="floating", axes=axes, home_deg=home)

    return write
