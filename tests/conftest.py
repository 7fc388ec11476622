"""What several tests share: a one-joint arm as a URDF text and as a plant, and the plant of the IRB120."""

import gc
import signal
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterator
from contextlib import nullcontext, suppress
from pathlib import Path

import numpy as np
import pytest
import trimesh
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, MultibodyPlant
from pydrake.multibody.tree import RevoluteJoint, RotationalInertia, SpatialInertia
from pydrake.systems.framework import DiagramBuilder

from simrob_drake.base.files import models_root
from simrob_drake.base.messages import SOURCE_LANGUAGE, Message, set_output_language
from simrob_drake.robots.catalog import load_robot
from simrob_drake.robots.parse import add_urdf
from simrob_drake.robots.urdf import with_absolute_meshes
from tests import probing

with suppress(ImportError):  # pytest-xdist, which runs tests in several processes, may be missing
    from execnet.gateway_base import _Serializer

    # Processes of tests send each other the texts of warnings and errors. execnet sends no subclasses of str by itself.
    _Serializer._dispatch[Message] = _Serializer.save_str

ONE_JOINT_URDF = """<robot name="arm">
  <link name="base">
    <collision><geometry><box size="0.1 0.1 0.2"/></geometry></collision>
  </link>
  <link name="upper">
    <inertial>
      <origin xyz="0 0 0.1"/>
      <mass value="1"/>
      <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/>
    </inertial>
    <visual><geometry><cylinder radius="0.02" length="0.3"/></geometry></visual>
  </link>
  <link name="tip"/>
  <joint name="shoulder" type="revolute">
    <parent link="base"/>
    <child link="upper"/>
    <origin xyz="0 0 0.2" rpy="0 0 0"/>
    <axis xyz="0 1 0"/>
    <limit lower="-1" upper="2" effort="10" velocity="3"/>
    <dynamics damping="0.1"/>
  </joint>
  <joint name="flange" type="fixed">
    <parent link="upper"/>
    <child link="tip"/>
  </joint>
  <transmission name="drive">
    <type>transmission_interface/SimpleTransmission</type>
    <joint name="shoulder"/>
    <actuator name="motor"/>
  </transmission>
</robot>
"""

PENDULUM_MASS = 1.0  # kg, a point
PENDULUM_LENGTH = 0.5  # m


_module: Path | None = None  # whose tests are run


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Look for no rubbish in what the modules before have left."""
    global _module  # noqa: PLW0603  # a process runs one test at a time
    if item.path != _module:
        _module = item.path
        gc.collect()
        gc.freeze()  # else a third of the time goes into looking through the imported libraries, again and again
        # objects; by the interpreter's 2000 it looks again after each figure and station
        gc.set_threshold(50_000)


def pytest_unconfigure() -> None:
    """Thaw what `gc.freeze` has frozen, so that the interpreter can collect it at its end.

    Otherwise the bindings of OMPL report all of their types and functions as leaks.
    """
    gc.unfreeze()


BY_THE_CLOCK = (
    "e2e",
    "test_server",
    "test_kills",
    "test_live",
    "test_cli_interrupts",
    "test_study",
    "test_sweep",
)
"""Folders and files whose tests press, kill and await other processes: on a busy machine one may come too late."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with the folders whose files take longest, or at the end one process waits for the other."""
    items.sort(key=lambda item: item.path.parent.name not in ("e2e", "tuning"))
    for item in items:
        if {item.path.stem, item.path.parent.name} & set(BY_THE_CLOCK):
            item.add_marker(pytest.mark.flaky(reruns=1))  # said in the last line as "rerun"


def pytest_configure(config: pytest.Config) -> None:
    """Let commands that tests start hear Ctrl-C: what a script starts in the background would ignore it."""
    config.addinivalue_line(
        "markers", "probe: imported robots are parsed by the importer's own process"
    )
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(autouse=True)
def _quick_probe(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let imports be parsed in processes that need not load Drake, but where a test is marked ``probe``."""
    if request.node.get_closest_marker("probe") is None:
        monkeypatch.setattr("simrob_drake.importer.probe._drake_error", probing.complaint)


@pytest.fixture(autouse=True)
def _english_output() -> None:
    """Begin each test with English output: a command that a test before ran may have set another language."""
    set_output_language(SOURCE_LANGUAGE)


@pytest.fixture
def no_plots(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Save results without plots and with small film strips, but where a test is marked ``plots``.

    Plots and rendered frames take most of the time of saving.
    """
    if request.node.get_closest_marker("plots") is None:
        monkeypatch.setattr("simrob_drake.results.files._save_plots", lambda *_: None)
        monkeypatch.setattr("simrob_drake.results.files.in_background", lambda _: nullcontext())
        for size, pixels in (("_HEIGHT", 60), ("_LOW_HEIGHT", 40), ("_SHADOW_MAP", 64)):
            monkeypatch.setattr(f"simrob_drake.results.animation.pictures.{size}", pixels)


@pytest.fixture
def one_joint_urdf() -> str:
    return ONE_JOINT_URDF


@pytest.fixture
def write_urdf(tmp_path: Path) -> Callable[[str], Path]:
    """Write a text into a robot's folder of its own and return the file."""

    def write(text: str) -> Path:
        path = tmp_path / "robot" / "arm.urdf"
        path.parent.mkdir(exist_ok=True)
        path.write_text(text, encoding="utf-8")
        return path

    return write


@pytest.fixture
def add_pendulum() -> Callable[..., MultibodyPlant]:
    """Add a point mass on a rod, which hangs down at zero and turns about y; not finalized."""

    def add(
        builder: DiagramBuilder,
        *,
        time_step: float = 0.0,
        gravity: float = 9.80665,
        limits: tuple[float, float] = (-np.inf, np.inf),
    ) -> MultibodyPlant:
        plant, _ = AddMultibodyPlantSceneGraph(builder, time_step)
        plant.mutable_gravity_field().set_gravity_vector(np.array([0.0, 0.0, -gravity]))
        place = np.array([0.0, 0.0, -PENDULUM_LENGTH])
        bob = SpatialInertia.MakeFromCentralInertia(
            PENDULUM_MASS, place, RotationalInertia(0.0, 0.0, 0.0)
        )
        body = plant.AddRigidBody("bob", bob)
        hinge = RevoluteJoint(
            "hinge", plant.world_frame(), body.body_frame(), np.array([0.0, 1.0, 0.0]), *limits
        )
        plant.AddJointActuator("hinge", plant.AddJoint(hinge))
        return plant

    return add


@pytest.fixture
def add_irb120() -> Callable[[DiagramBuilder], MultibodyPlant]:
    """Add the bare IRB120 on its foot, with a scene graph; not finalized."""

    def add(builder: DiagramBuilder) -> MultibodyPlant:
        model = load_robot("irb120")
        plant, _ = AddMultibodyPlantSceneGraph(builder, time_step=0.0)
        plant.mutable_gravity_field().set_gravity_vector(np.array([0.0, 0.0, -9.80665]))
        robot = with_absolute_meshes(model.element, model.folder)
        add_urdf(plant, robot, name="robot", where="irb120.urdf", collision=False)
        plant.WeldFrames(plant.world_frame(), plant.GetFrameByName(model.root))
        return plant

    return add


@pytest.fixture
def irb120(add_irb120: Callable[[DiagramBuilder], MultibodyPlant]) -> Iterator[MultibodyPlant]:
    """The plant alone; not finalized."""
    builder = DiagramBuilder()  # it owns the plant and stays until the test is over
    yield add_irb120(builder)  # noqa: PT022


@pytest.fixture
def published_irb120(tmp_path: Path) -> Path:
    """Return the URDF of a ROS package: STL meshes by package://, no transmissions, effort 0, a frame as a leaf."""
    package = tmp_path / "ros" / "arm_support"
    (package / "urdf").mkdir(parents=True)
    (package / "meshes").mkdir()
    (package / "package.xml").write_text("<package format='2'><name>arm_support</name></package>")
    ours = models_root() / "irb120"
    robot = ET.parse(ours / "irb120.urdf").getroot()
    for transmission in robot.findall("transmission"):
        robot.remove(transmission)
    for limit in robot.iter("limit"):
        limit.set("effort", "0")
    for mesh in robot.iter("mesh"):
        file = ours / mesh.get("filename")
        trimesh.load(file, force="mesh").export(package / "meshes" / f"{file.stem}.STL")
        mesh.set("filename", f"package://arm_support/meshes/{file.stem}.stl")
    ET.SubElement(robot, "link", name="base")
    frame = ET.SubElement(robot, "joint", name="base_link-base", type="fixed")
    ET.SubElement(frame, "parent", link="base_link")
    ET.SubElement(frame, "child", link="base")
    file = package / "urdf" / "arm.urdf"
    ET.ElementTree(robot).write(file)
    return file
