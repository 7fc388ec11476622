"""The legged robots against their published figures: masses, kinematics, limits, symmetry, senses of the axes."""

import runpy
from pathlib import Path

import numpy as np
import pytest
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import BodyIndex
from pydrake.systems.framework import Context

from simrob_drake.base.files import models_root
from simrob_drake.robots.catalog import RobotModel, load_robot
from simrob_drake.robots.parse import add_urdf
from simrob_drake.robots.urdf import with_absolute_meshes

HUMANOIDS = ("humanoid", "roid1", "zjudancer")
LEGGED = (*HUMANOIDS, "yobotics")

# robot: links with mass, joints, mass [kg]. facts: sm_humanoid; roid1 of Ninagawa123; the ZJUDancer team's code
# (3.0 kg and 0.85 kg a leg); yobotics_description with its sensors.
FIGURES = {
    "humanoid": (22, 18, 2.292),
    "roid1": (23, 22, 1.4585),
    "zjudancer": (19, 18, 4.7),
    "yobotics": (20, 12, 9.443),
}

# robot: forward, left in the frame of its root at zero.
DIRECTIONS = {
    "humanoid": ((0, -1, 0), (1, 0, 0)),
    "roid1": ((1, 0, 0), (0, 1, 0)),
    "zjudancer": ((0, 1, 0), (-1, 0, 0)),
    "yobotics": ((1, 0, 0), (0, 1, 0)),
}

# robot, frame: its place while all joints are at zero, from the root [m]; facts of each robot.
PLACES = {
    ("humanoid", "right_shoulder"): (-0.06413, 0, -0.0399),
    ("humanoid", "left_lower_arm"): (0.08318, 0, -0.1288),
    ("humanoid", "left_hand"): (0.08318, 0, -0.2050),
    ("humanoid", "neck"): (0, 0, -0.02974),
    ("humanoid", "head"): (0, 0, 0.0344),
    ("humanoid", "waistline"): (0, 0, -0.1487),
    ("humanoid", "right_upper_leg"): (-0.01905, 0, -0.20776),
    ("humanoid", "left_lower_leg"): (0.04442, 0, -0.31186),
    ("humanoid", "right_foot"): (-0.04442, 0, -0.41600),
    ("humanoid", "right_sole"): (-0.04442, 0, -0.44496),
    ("roid1", "c_chest"): (0, 0, 0.06519),
    ("roid1", "c_head"): (0, 0, 0.10469),
    ("roid1", "r_shoulder"): (0, -0.07438, 0.06519),
    ("roid1", "l_lowerarm"): (0.00915, 0.07438, -0.02232),
    ("roid1", "r_hipjointlower"): (0, -0.01703, -0.04494),
    ("roid1", "l_upperleg"): (0.00405, 0.02853, -0.08342),
    ("roid1", "r_lowerleg"): (0.00405, -0.02853, -0.14842),
    ("roid1", "l_foot"): (0.00405, 0.01713, -0.25218),
    ("roid1", "r_sole"): (0.00405, -0.01713, -0.27811),
    ("zjudancer", "right_leg_pitch"): (0.045, 0.0134, -0.225),
    ("zjudancer", "left_leg_knee"): (-0.045, 0.0134, -0.348),
    ("zjudancer", "right_leg_ankle"): (0.045, 0.0134, -0.478),
    ("zjudancer", "left_sole"): (-0.061, 0.0134, -0.538),
    ("yobotics", "RL_hip"): (-0.196, 0.049664, 0),
    ("yobotics", "FR_thigh"): (0.196, -0.12714, 0),
    ("yobotics", "FL_foot"): (0.196, 0.12714, -0.44189),
    ("yobotics", "hokuyo_frame"): (0, 0, 0.093),
}

# What a positive angle does to the tip of the limb: where it goes, in forward / outward (to the limb's own side) / up;
# yaws of the head and the trunk turn what is in front to the left. An elbow may bend forward or outward, but it lifts.
EFFECTS = {
    "shoulder_pitch": ("hand", "forward", 1),
    "shoulder_roll": ("hand", "outward", 1),
    "elbow": ("hand", "up", 1),
    "wrist": ("hand", "outward", 1),
    "hip_yaw": ("toe", "left", 1),
    "hip_roll": ("foot", "outward", 1),
    "hip_pitch": ("foot", "forward", 1),
    "knee": ("foot", "forward", -1),
    "ankle_pitch": ("toe", "up", -1),
    "ankle_roll": ("foot", "outward", -1),
    "elbow_yaw": ("finger", "left", 1),
}


class Pose:
    """A robot with its root in the world's origin, put into postures."""

    def __init__(self, name: str) -> None:
        self.model: RobotModel = load_robot(name)
        self.plant = MultibodyPlant(0.0)
        robot = with_absolute_meshes(self.model.element, self.model.folder)
        add_urdf(self.plant, robot, name="robot", where=name, collision=False)
        self.plant.WeldFrames(self.plant.world_frame(), self.plant.GetFrameByName(self.model.root))
        self.plant.Finalize()
        self.forward, self.left = (np.array(direction, float) for direction in DIRECTIONS[name])

    def at(self, **degrees: float) -> Context:
        context = self.plant.CreateDefaultContext()
        for axis, angle in degrees.items():
            entry = list(self.model.axes.values())[self.model.axis_index(axis)]
            self.plant.GetJointByName(entry.joint).set_angle(
                context, entry.sign * np.deg2rad(angle)
            )
        return context

    def point(self, context: Context, frame: str, offset: np.ndarray | None = None) -> np.ndarray:
        pose = self.plant.GetFrameByName(frame).CalcPoseInWorld(context)
        if offset is None:
            return pose.translation()
        zero = self.plant.GetFrameByName(frame).CalcPoseInWorld(self.at())
        return pose @ (zero.rotation().inverse() @ offset)


@pytest.fixture(scope="module")
def poses() -> dict[str, Pose]:
    return {name: Pose(name) for name in LEGGED}


@pytest.mark.parametrize("name", LEGGED)
def test_links_joints_and_mass_are_the_published_ones(poses: dict[str, Pose], name: str) -> None:
    robot = poses[name]

    links, joints, mass = FIGURES[name]
    assert (
        sum(link.find("inertial") is not None for link in robot.model.element.iterfind("link"))
        == links
    )
    assert (
        robot.plant.num_positions()
        == robot.plant.num_actuators()
        == len(robot.model.axes)
        == joints
    )
    assert robot.plant.CalcTotalMass(robot.plant.CreateDefaultContext()) == pytest.approx(
        mass, abs=2e-4
    )


@pytest.mark.parametrize(("name", "frame"), PLACES)
def test_at_zero_every_frame_is_in_its_place(poses: dict[str, Pose], name: str, frame: str) -> None:
    robot = poses[name]
    np.testing.assert_allclose(robot.point(robot.at(), frame), PLACES[name, frame], atol=1.5e-5)


def test_the_humanoids_centre_of_mass_and_inertia_at_zero(poses: dict[str, Pose]) -> None:
    plant, context = poses["humanoid"].plant, poses["humanoid"].at()

    np.testing.assert_allclose(
        plant.CalcCenterOfMassPositionInWorld(context), [0, -0.0015, -0.2179], atol=6e-5
    )

    neck = plant.GetJointByName("shoulder_neck").velocity_start()
    # facts: 1.37e-5 of neck, head and cover about the vertical, with the free base, which changes nothing here
    assert plant.CalcMassMatrix(context)[neck, neck] == pytest.approx(1.37e-5, rel=0.005)


@pytest.mark.parametrize(
    ("angle", "height", "shift"),
    [(0.6, 0.3647, 0.0107), (0.8, 0.3079, 0.0136), (1.0, 0.2388, 0.0159)],
)
def test_the_quadruped_stands_as_high_as_its_legs_say(
    poses: dict[str, Pose], angle: float, height: float, shift: float
) -> None:
    robot, degrees = poses["yobotics"], np.rad2deg(angle)
    context = robot.at(front_left_hip_pitch=-degrees, front_left_knee=2 * degrees)

    expected = [0.196 + shift, 0.12714, -height]
    np.testing.assert_allclose(robot.point(context, "FL_foot"), expected, atol=1e-4)


@pytest.mark.parametrize(
    ("name", "efforts"),
    [
        ("humanoid", {"": 3}),
        ("roid1", {"": 1.5}),
        ("zjudancer", {"": 10, "shoulder": 7, "elbow": 3, "neck": 3}),
        ("yobotics", {"": 20}),
    ],
)
def test_efforts_are_those_of_the_motors(name: str, efforts: dict[str, float]) -> None:
    robot = load_robot(name)
    for axis, effort in zip(robot.axes, robot.efforts, strict=True):
        assert effort == next(value for part, value in reversed(efforts.items()) if part in axis), (
            axis
        )


@pytest.mark.parametrize("name", LEGGED)
def test_left_and_right_have_the_same_ranges_and_the_home_posture_is_inside(name: str) -> None:
    robot = load_robot(name)

    limits = np.rad2deg(robot.axis_limits).T
    ranges = dict(zip(robot.axes, limits, strict=True))
    for axis, (low, high) in ranges.items():
        assert -226 < low < 0 < high < 226, axis
        if "right" in axis:
            other = ranges[axis.replace("right", "left")]
            turned = -other[::-1] if axis.endswith("yaw") else other  # yaws turn left on both sides
            np.testing.assert_allclose((low, high), turned, atol=1e-9)

    home = robot.axis_vector(robot.home_deg, "home_deg")
    assert ((limits[:, 0] <= home) & (home <= limits[:, 1])).all()


@pytest.mark.parametrize("name", LEGGED)
def test_left_and_right_links_are_mirror_images(poses: dict[str, Pose], name: str) -> None:
    robot = poses[name]
    context = robot.at()
    pairs = {"right_": "left_", "r_": "l_", "RL": "RR", "FL": "FR"}
    found = {}
    for index in range(1, robot.plant.num_bodies()):
        body = robot.plant.get_body(BodyIndex(index))
        com = body.EvalPoseInWorld(context) @ body.CalcCenterOfMassInBodyFrame(context)
        found[body.name()] = np.append(body.get_mass(context), com)
    flip = np.array([1, *(1 - 2 * np.abs(robot.left))])
    matched = 0

    for link, figures in found.items():
        for start, other in pairs.items():
            if link.startswith(start):
                np.testing.assert_allclose(
                    found[other + link.removeprefix(start)], flip * figures, atol=2e-5
                )
                matched += 1

    assert matched >= 6


def shared_axes(name: str) -> list[str]:
    return [axis for axis in load_robot(name).axes if axis.split("_", 1)[0] in ("left", "right")]


@pytest.mark.parametrize(
    ("name", "axis"), [(name, axis) for name in HUMANOIDS for axis in shared_axes(name)]
)
def test_a_positive_angle_has_the_same_visible_effect(
    poses: dict[str, Pose], name: str, axis: str
) -> None:
    """The tip of the limb goes the same way on every humanoid; tips lie far enough from the joints to tell."""
    robot = poses[name]
    side, motion = axis.split("_", 1)
    part, way, sense = EFFECTS[motion]
    tip = robot.model.tools[f"{side}_hand" if part in ("hand", "finger") else f"{side}_foot"]
    offset = {"toe": 0.06 * robot.forward, "finger": 0.03 * robot.forward}.get(part)

    moved = robot.point(robot.at(**{axis: 20}), tip, offset) - robot.point(robot.at(), tip, offset)

    ways = {"forward": robot.forward, "left": robot.left, "up": np.array([0, 0, 1])}
    ways["outward"] = robot.left if side == "left" else -robot.left
    along = sense * float(ways[way] @ moved)
    # 20 degrees lift a limb by a twelfth of what they move it aside; anything else goes mostly the way that is said.
    assert along > (0.1 if way == "up" else 0.75) * np.linalg.norm(moved)
    assert np.linalg.norm(moved) > 0.005


@pytest.mark.parametrize("name", HUMANOIDS)
def test_heads_and_trunks_turn_left_and_nod_forward(poses: dict[str, Pose], name: str) -> None:
    robot = poses[name]

    head = robot.model.tools["head"]
    for axis in ("neck_yaw", "torso_yaw"):
        if axis in robot.model.axes:
            nose = 0.03 * robot.forward
            moved = robot.point(robot.at(**{axis: 20}), head, nose) - robot.point(
                robot.at(), head, nose
            )
            assert robot.left @ moved > 0.9 * np.linalg.norm(moved) > 0
    if "neck_pitch" in robot.model.axes:
        top = np.array([0, 0, 0.05])
        moved = robot.point(robot.at(neck_pitch=20), head, top) - robot.point(robot.at(), head, top)
        assert robot.forward @ moved > 0.9 * np.linalg.norm(moved) > 0


@pytest.mark.parametrize("leg", ["front_left", "front_right", "rear_left", "rear_right"])
def test_the_quadrupeds_legs_go_outward_forward_and_fold(poses: dict[str, Pose], leg: str) -> None:
    robot = poses["yobotics"]
    foot = robot.model.tools[f"{leg}_foot"]
    outward = robot.left if "left" in leg else -robot.left

    start = robot.point(robot.at(), foot)

    assert outward @ (robot.point(robot.at(**{f"{leg}_hip_roll": 20}), foot) - start) > 0.1
    assert robot.forward @ (robot.point(robot.at(**{f"{leg}_hip_pitch": 20}), foot) - start) > 0.1

    home = {f"{leg}_hip_pitch": -45.8, f"{leg}_knee": 91.7}
    folded = robot.point(robot.at(**{**home, f"{leg}_knee": 111.7}), foot)

    assert (folded - robot.point(robot.at(**home), foot))[2] > 0.02


@pytest.mark.parametrize("name", HUMANOIDS)
def test_every_axis_has_its_simrob_name(name: str) -> None:
    robot = load_robot(name)
    names = {
        axis.removeprefix("right_"): alias
        for axis, (alias,) in ((a, e.aliases) for a, e in robot.axes.items())
    }

    known = {
        "shoulder_pitch": "HomDF",
        "hip_pitch": "CadDF",
        "knee": "RodD",
        "ankle_pitch": "TobD",
        "neck_yaw": "CuelL",
    }

    assert known.items() <= names.items()
    assert robot.axis_index("CadIF") == robot.axis_index("left_hip_pitch")


@pytest.mark.long
@pytest.mark.parametrize("name", LEGGED)
def test_the_script_makes_the_urdf_and_every_mesh_is_used(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, making = models_root() / name, models_root() / "making"
    monkeypatch.syspath_prepend(making)  # as it is for a script

    runpy.run_path(str(making / f"{name}.py"))["make"](tmp_path)

    assert (tmp_path / f"{name}.urdf").read_text() == (folder / f"{name}.urdf").read_text()

    used = {Path(mesh.get("filename", "")).name for mesh in load_robot(name).element.iter("mesh")}
    assert (
        used
        == {file.name for file in (folder / "meshes").iterdir()}
        == {f.name for f in (tmp_path / "meshes").iterdir()}
    )
    # Boxes, not bytes: another version of scipy may list the faces of convex hulls in another order.
    for mesh in used:
        boxes = [bounds(root / "meshes" / mesh) for root in (folder, tmp_path)]
        np.testing.assert_allclose(*boxes, atol=1e-4)


def bounds(path: Path) -> np.ndarray:
    points = np.array(
        [line.split()[1:] for line in path.read_text().splitlines() if line.startswith("v ")], float
    )
    return np.array([points.min(axis=0), points.max(axis=0)])
