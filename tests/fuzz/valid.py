"""Files that are right, to be damaged: those that ship, and what the package writes."""

import io
import re
import tempfile
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from unittest.mock import patch

import numpy as np
import trimesh
from scipy.io import savemat

import simrob_drake
from simrob_drake.base.files import diagrams_root, models_root
from simrob_drake.base.yaml_files import parse_yaml
from simrob_drake.extensions.learning.writing import write_network
from simrob_drake.extensions.tuning.journal import made
from simrob_drake.extensions.tuning.study import Study
from simrob_drake.extensions.tuning.study_folder import StudyFolder
from simrob_drake.extensions.tuning.sweep import Sweep
from simrob_drake.extensions.tuning.sweep_folder import SweepFolder
from simrob_drake.simulation import simulate
from simrob_drake.stations.load import load_station
from tests.extensions.tuning.here import Here

Files = Mapping[str, bytes | Path]
"""Contents by name; a path is linked to."""
EXAMPLES = Path(simrob_drake.__file__).parents[1] / "examples"
SHORT = {"duration": 0.02, "reference.duration": 0.01}
URDF = b"""<?xml version="1.0"?><robot name="arm"><link name="base"/><link name="upper"><inertial><mass value="1"/>
<inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial><!-- a link --><visual><geometry>
<mesh filename="part.stl"/></geometry></visual><collision><geometry><box size="1 1 1"/></geometry></collision></link>
<joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/>
<limit lower="-1" upper="2" effort="10" velocity="3"/></joint></robot>"""
XACRO = b"""<?xml version="1.0"?><robot name="arm" xmlns:xacro="http://www.ros.org/wiki/xacro">
<xacro:arg name="mass" default="2"/><xacro:property name="half" value="${$(arg mass) / 2}"/>
<xacro:include filename="limits.xacro"/>
<xacro:property name="sizes" value="${dict(long=[1, 2, 3], short=0.1)}"/>
<xacro:macro name="segment" params="name parent:=base *origin">
  <link name="${name}"><inertial><mass value="${half if half &lt; 5 else 5}"/>
    <inertia ixx="${half**2 / 12}" ixy="0" ixz="0" iyy="${sizes['short']}" iyz="0" izz="${max(sizes['long']) * 0.04}"/>
  </inertial></link>
  <joint name="to_${name}" type="revolute"><parent link="${parent}"/><child link="${name}"/>
    <xacro:insert_block name="origin"/><axis xyz="0 1 0"/>
    <limit lower="${-pi / 2}" upper="${radians(90)}" effort="${effort}" velocity="3"/></joint>
</xacro:macro>
<link name="base"/>
<xacro:segment name="upper"><origin xyz="0 0 ${sin(0.1)}"/></xacro:segment>
<xacro:if value="${half > 0}"><xacro:segment name="lower" parent="upper"><origin xyz="0 0 1"/></xacro:segment>
</xacro:if>
<xacro:unless value="${len(sizes) == 2}"><link name="never"/></xacro:unless></robot>"""
LIMITS = b"""<robot xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:property name="effort" value="10"/></robot>"""
PROGRAM = b"""description: a wave
station: humanoid_fixed
moves:
  - {target_deg: {left_elbow: -30}, duration: 0.5}
  - {act: bow}
  - {wait: 0.1}
references:
  - {target_deg: {left_elbow: 10}}
"""
ARM_PROGRAM = b"""station: two_arms
robot: left
moves:
  - {target_deg: {joint_1: -10}, duration: 0.5}
  - {move_j: {targets_deg: [0, 0, 0.1, 0, 0, 180], wobj: bar, solver: auto, check: limits}}
  - {move_l: {targets: [0, 0, -0.02], wobj: bar, speed: 0.3, points: 9}}
  - {attach: {piece: bar, tool: left_gripper}}
  - {tool: {pose: [0, 0, 0.01, 0, 0, 0]}}
  - {move_l: {targets: [[0, 0, -0.1], [0, 0, -0.02]], wobj: left, times: [0.5, 1.2]}}
  - {together: [{move_abs_j: [0, 0, 0, 0, 1.5, 0]}, {move_abs_j: {targets: [0, 0, 0, 0, 1.5, 0], robot: right}}]}
  - {wait: 0.1}
  - {release: {piece: bar, parent: world, fixed: true}}
"""
STUDY = b"""station: double_pendulum
overrides: {duration: 0.02, reference.duration: 0.01}
vary: {servo.kp: {low: 10, high: 1000, start: 50, log: true}, servo.kd: {low: 1, high: 100}}
cost: {tracking_error: 1}
limits: {peak_torque: 0.9}
failure: 50
method: random
trials: 2
together: 2
seed: 3
search: {cases: [{}, {gravity: 1.62}], seeds: [0]}
proof: {cases: [{gravity: 3.7}], seeds: [7], drawn: false}
"""
TABLE = b"time,joint_1,joint_2,v.joint_1,v.joint_2\n" + b"".join(
    b"%g,%g,%g,0.2,-0.2\n" % (step / 10, step / 50, -step / 50) for step in range(20)
)
LOG = b"time,q.joint_1,q_ref.joint_1,q_ref.joint_2,yout.1\n" + b"".join(
    b"%g,0.7,0.7,0.5,0.7\n" % (step / 100) for step in range(5)
)
POLICY = b"""robot: {model: double_pendulum}
servo: {kp: 100, kd: 100}
reference: {kind: hold}
controllers:
  policy: {kind: policy, network: net.onnx, rate: 100, moves_deg: 5, observes: [position, velocity, action]}
duration: 0.02
"""


def station(name: str) -> bytes:
    """Return the file of a station that ships."""
    return (diagrams_root() / f"{name}.yaml").read_bytes()


@cache
def mesh(kind: str) -> bytes:
    """Return a mesh file."""
    data = trimesh.creation.icosphere(subdivisions=1).export(file_type=kind)
    return data if isinstance(data, bytes) else str(data).encode()


@cache
def robot(name: str) -> Files:
    """Return the folder of a robot, without meshes, and stations and a program on it."""
    folder = models_root() / name
    files = {
        f"robot/{file}.yaml": (folder / f"{file}.yaml").read_bytes() for file in ("robot", "gaits")
    }
    files[f"robot/{name}.urdf"] = re.sub(
        rb"(?s)<visual.*?</visual>", b"", (folder / f"{name}.urdf").read_bytes()
    )
    texts = {kind: station(f"{name}_{kind}").replace(f"model: {name}".encode(), b"model: robot/robot.yaml") for kind in
             ("dynamic", "walking")}  # fmt: skip
    walk = b"station: dynamic.yaml\nmoves:\n  - {walk: {steps: 1}}\n"
    return {
        **files,
        "dynamic.yaml": texts["dynamic"],
        "walking.yaml": texts["walking"],
        "walk.yaml": walk,
    }


def _made(write: Callable[[Path], object]) -> Files:
    with tempfile.TemporaryDirectory() as place:
        write(Path(place))
        return {
            str(file.relative_to(place)): file.read_bytes()
            for file in Path(place).rglob("*")
            if file.is_file()
        }


@cache
def sweep() -> Files:
    """Return the folder of a sweep that has ended."""

    def write(place: Path) -> None:
        whole = SweepFolder(
            place / "sweep",
            Sweep(station="double_pendulum", vary={"servo.kp": "20,40"}, overrides=SHORT),
        )
        with whole.journal.adding() as add:
            for case in whole.cases:
                add(made(case))

    return _made(write)


@cache
def study() -> Files:
    """Return the folder of a study that has ended, and the study."""

    def write(place: Path) -> None:
        (place / "study.yaml").write_bytes(STUDY)
        asked = Study(**parse_yaml(STUDY.decode(), "study"))
        with patch("simrob_drake.extensions.tuning.study_folder.engine", lambda **_: Here()):
            StudyFolder(place / "study", asked).run(progress=False)

    return _made(write)


@cache
def start(name: str, **overrides: float) -> Files:
    """Return the state at the end of a short run of a station."""
    changed = {key.replace("__", "."): value for key, value in overrides.items()}
    state = simulate(load_station(name, changed), duration=0.01, progress=False).final_state
    return {"start.json": state.to_json().encode()}


@cache
def network() -> Files:
    """Return a station with a policy, and its network."""
    draw = np.random.default_rng(1)
    layers = [(draw.normal(size=(8, 6)), np.zeros(8)), (draw.normal(size=(2, 8)), np.zeros(2))]
    return {**_made(lambda place: write_network(place / "net.onnx", layers)), "case.yaml": POLICY}


def mat(*, compressed: bool = False) -> bytes:
    """Return a log of MATLAB, with more in it than signals."""
    content = {
        "tout": np.arange(5)[:, np.newaxis] / 100,
        "yout": np.zeros((5, 2)),
        "name": "x",
        "z": np.array([[1j]]),
    }
    content |= {
        "gains": {"kp": 3.0, "names": np.array(["a", "b"], dtype=object)},
        "none": np.zeros((0, 0)),
    }
    file = io.BytesIO()
    savemat(file, content, do_compression=compressed)
    return file.getvalue()
