"""Arms for the tests of kinematics, and their forward kinematics by Drake and by Denavit and Hartenberg."""

import math
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest

from simrob_drake.kinematics.chain import Chain
from simrob_drake.robots.catalog import load_robot, load_robot_from_urdf

Row = tuple[
    float, float, float, float
]  # θ offset [rad], d [m], a [m], alpha [rad]; A = Rz(θ) Tz(d) Tx(a) Rx(alpha)

RIGHT = np.pi / 2
IRB120: tuple[Row, ...] = (
    (0, 0.290, 0, -RIGHT),
    (-RIGHT, 0, 0.270, 0),
    (0, 0, 0.070, -RIGHT),
    (0, 0.302, 0, RIGHT),
    (0, 0, 0, -RIGHT),
    (np.pi, 0.072, 0, 0),
)
PUMA560: tuple[Row, ...] = (
    (0, 0, 0, RIGHT),
    (0, 0, 0.4318, 0),
    (0, 0.15005, 0.0203, -RIGHT),
    (0, 0.4318, 0, RIGHT),
    (0, 0, 0, -RIGHT),
    (0, 0.056, 0, 0),
)
TX40: tuple[Row, ...] = (
    (0, 0.320, 0, -RIGHT),
    (-RIGHT, 0, 0.225, 0),
    (RIGHT, 0.035, 0, RIGHT),
    (0, 0.225, 0, -RIGHT),
    (0, 0, 0, RIGHT),
    (0, 0.065, 0, 0),
)
UR5: tuple[Row, ...] = (
    (0, 0.0892, 0, RIGHT),
    (0, 0, -0.425, 0),
    (0, 0, -0.392, 0),
    (0, 0.1093, 0, RIGHT),
    (0, 0.09475, 0, -RIGHT),
    (0, 0.0825, 0, 0),
)
KR6: tuple[Row, ...] = (  # KR 6 R900 sixx, by its data sheet
    (0, 0.400, 0.025, -RIGHT),
    (0, 0, 0.455, 0),
    (-RIGHT, 0, 0.035, -RIGHT),
    (0, 0.420, 0, RIGHT),
    (0, 0, 0, -RIGHT),
    (0, 0.080, 0, 0),
)
IIWA: tuple[Row, ...] = (  # LBR iiwa 7 R800, likewise
    (0, 0.340, 0, -RIGHT),
    (0, 0, 0, RIGHT),
    (0, 0.400, 0, RIGHT),
    (0, 0, 0, -RIGHT),
    (0, 0.400, 0, -RIGHT),
    (0, 0, 0, RIGHT),
    (0, 0.126, 0, 0),
)
ODD: tuple[Row, ...] = (  # no two axes parallel, none that meet
    (0, 0.3, 0.1, 1.4),
    (0, 0.05, 0.4, 0.2),
    (0, 0.02, 0.05, -1.3),
    (0, 0.35, 0.12, 1.2),
    (0, 0.1, 0.03, -1.1),
    (0, 0.08, 0, 0.3),
)
BELT: Row = (
    0.4,
    0.1,
    0.3,
    -0.7,
)  # the pose of an arm's foot on a slide along z, nowhere at right angles


def dh_poses(rows: Sequence[Row], positions: np.ndarray) -> np.ndarray:
    """Return the poses of the last frame, shape (k, 4, 4), by the textbook's product."""
    poses = np.tile(np.eye(4), (len(positions), 1, 1))
    for column, (offset, d, a, alpha) in enumerate(rows):
        c, s = np.cos(positions[:, column] + offset), np.sin(positions[:, column] + offset)
        step = np.zeros_like(poses)
        step[:, 0] = np.stack([c, -s * np.cos(alpha), s * np.sin(alpha), a * c], axis=1)
        step[:, 1] = np.stack([s, c * np.cos(alpha), -c * np.sin(alpha), a * s], axis=1)
        step[:, 2] = [0, np.sin(alpha), np.cos(alpha), d]
        step[:, 3, 3] = 1
        poses = poses @ step
    return poses


def dh_urdf(rows: Sequence[Row], *, limit: float = 3.0, slide: Row | None = None) -> str:
    """Return a URDF text of joints about z, each frame placed by the row before; optionally on a slide along z."""
    before = [(0.0, 0.0, 0.0, 0.0), *([slide] if slide else []), *rows]
    kinds = [*(["prismatic"] if slide else []), *["revolute"] * len(rows), "fixed"]
    text, names = '<robot name="arm"><link name="base"/>', ["base"]
    for index, ((offset, d, a, alpha), kind) in enumerate(zip(before, kinds, strict=True), start=1):
        names.append(f"link_{index}" if kind != "fixed" else "tool")
        text += f"""<link name="{names[-1]}"/><joint name="axis_{index}" type="{kind}">
          <parent link="{names[-2]}"/><child link="{names[-1]}"/>
          <origin xyz="{a * math.cos(offset)!r} {a * math.sin(offset)!r} {d!r}" rpy="{alpha!r} 0 {offset!r}"/>
          <axis xyz="0 0 1"/><limit lower="{-limit}" upper="{limit}" effort="1" velocity="1"/></joint>"""
        if kind != "fixed":
            text += f"""<transmission name="drive_{index}"><type>transmission_interface/SimpleTransmission</type>
              <joint name="axis_{index}"/><actuator name="motor_{index}"/></transmission>"""
    return text + "</robot>"


@pytest.fixture
def dh_chain(tmp_path: Path) -> Callable[..., Chain]:
    """Make the chain of a DH table by way of a URDF."""

    def make(rows: Sequence[Row], **options: object) -> Chain:
        file = tmp_path / "arm.urdf"
        file.write_text(dh_urdf(rows, **options), encoding="utf-8")
        return Chain.of_robot(load_robot_from_urdf(file))

    return make


@pytest.fixture(scope="session")
def irb120_chain() -> Chain:
    return Chain.of_robot(load_robot("irb120"))


@pytest.fixture
def home() -> np.ndarray:
    """The posture in which the irb120's tool points down."""
    return np.deg2rad([0.0, 0.0, 0.0, 0.0, 90.0, 0.0])


@pytest.fixture
def random_postures() -> Callable[..., np.ndarray]:
    """Draw postures within a chain's limits, always the same."""

    def draw(chain: Chain, count: int) -> np.ndarray:
        return np.random.default_rng(42).uniform(chain.lower, chain.upper, (count, chain.size))

    return draw


@pytest.fixture
def drake_poses() -> Callable[..., np.ndarray]:
    """Ask Drake for the poses of a chain's tool, shape (k, 4, 4)."""

    def poses(chain: Chain, postures: np.ndarray) -> np.ndarray:
        place, result = chain.in_plant, []
        context = place.plant.CreateDefaultContext()
        for posture in postures:
            place.axes.set_positions(place.plant, context, posture)
            result.append(place.tool.CalcPose(context, place.base).GetAsMatrix4() @ place.tcp)
        return np.array(result)

    return poses


@pytest.fixture
def tables() -> dict[str, tuple[Row, ...]]:
    return {
        "irb120": IRB120,
        "puma560": PUMA560,
        "tx40": TX40,
        "ur5": UR5,
        "kr6": KR6,
        "iiwa": IIWA,
        "odd": ODD,
    }


@pytest.fixture
def textbook_poses() -> Callable[..., np.ndarray]:
    return dh_poses


@pytest.fixture
def belt() -> Row:
    return BELT
