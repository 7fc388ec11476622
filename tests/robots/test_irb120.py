"""The IRB120 against its published figures: masses, kinematics, limits and holding torques."""

import runpy
import shutil
from pathlib import Path

import numpy as np
import pytest
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import MultibodyPlant

from simrob_drake.base.files import models_root
from simrob_drake.base.frames import pose_from_transform
from simrob_drake.robots.catalog import load_robot
from simrob_drake.stations.checks import holding_torque
from simrob_drake.stations.load import load_station
from simrob_drake.stations.station import build_station

# URDF of SimRob's IRB120 (as in abb_experimental): mass [kg], centre of mass [m] and moments Ixx Iyy Izz [kg m^2].
LINKS = {
    "base_link": (6.215, (-0.04204, 8.01e-05, 0.07964), (0.0247272, 0.0491285, 0.0472376)),
    "link_1": (3.067, (9.77e-05, -0.00012, 0.23841), (0.0142175, 0.0144041, 0.0104533)),
    "link_2": (3.909, (0.00078, -0.00212, 0.10124), (0.0603111, 0.041569, 0.0259548)),
    "link_3": (2.944, (0.02281, 0.00106, 0.05791), (0.00835606, 0.016713, 0.0126984)),
    "link_4": (1.328, (0.2247, 0.00015, 0.00041), (0.00284661, 0.00401346, 0.0052535)),
    "link_5": (0.546, (-0.00109, 3.68e-05, 6.22e-05), (0.000404891, 0.000892825, 0.000815468)),
    "link_6": (0.137, (-0.00706, -0.00017, -1.32e-06), (0.001, 0.001, 0.001)),
}
LOWER = [-2.87979, -1.91986, -1.91986, -2.79253, -2.094395, -6.98132]  # rad
UPPER = [2.87979, 1.91986, 1.22173, 2.79253, 2.094395, 6.98132]
VELOCITY = [4.36332, 4.36332, 4.36332, 5.58505, 5.58505, 7.33038]  # rad/s
HOME = np.deg2rad([0, 0, 0, 0, 90, 0])

# Classical DH table of SimRob's ABB_irb120_DH: offset of theta [deg], d [m], a [m], alpha [deg].
DH = [
    (0, 0.290, 0, -90),
    (-90, 0, 0.270, 0),
    (0, 0, 0.070, -90),
    (0, 0.302, 0, 90),
    (0, 0, 0, -90),
    (180, 0.072, 0, 0),
]

# Torques that hold 30 deg on all joints [N m], computed apart from this package from the same inertias.
HOLDING = {
    (): [0, -13.98, -5.46, 0.01, 0.00, 0],
    ("gripper",): [0, -17.37, -7.52, 0.08, 0.08, 0.01],
    ("gripper", "pencil"): [0, -20.79, -9.61, 0.24, 0.20, 0.02],
}


def tool_pose(plant: MultibodyPlant, q: np.ndarray) -> RigidTransform:
    context = plant.CreateDefaultContext()
    plant.SetPositions(context, q)
    return plant.GetFrameByName("tool0").CalcPoseInWorld(context)


def dh_product(q: np.ndarray) -> RigidTransform:
    pose = RigidTransform()
    for angle, (offset, d, a, alpha) in zip(q, DH, strict=True):
        pose = pose @ RigidTransform(
            RotationMatrix.MakeZRotation(angle + np.deg2rad(offset)), [0, 0, 0]
        )
        pose = pose @ RigidTransform(RotationMatrix.MakeXRotation(np.deg2rad(alpha)), [a, 0, d])
    return pose


def obj_figures(path: Path) -> tuple[np.ndarray, float]:
    """Return the bounding box [m], shape (2, 3), and the enclosed volume [m^3] of an OBJ file of triangles."""
    rows = [line.split() for line in path.read_text().splitlines()]
    vertices = np.array([[float(x) for x in row[1:]] for row in rows if row[0] == "v"])
    faces = np.array(
        [[int(corner.split("/")[0]) - 1 for corner in row[1:]] for row in rows if row[0] == "f"]
    )
    a, b, c = vertices[faces].transpose(1, 0, 2)
    volume = float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)
    return np.array([vertices.min(axis=0), vertices.max(axis=0)]), volume


@pytest.mark.parametrize("link", LINKS)
def test_each_link_has_its_published_inertia(irb120: MultibodyPlant, link: str) -> None:
    irb120.Finalize()
    mass, com, moments = LINKS[link]

    inertia = irb120.GetBodyByName(link).default_spatial_inertia()

    assert inertia.get_mass() == pytest.approx(mass)
    np.testing.assert_allclose(inertia.get_com(), com, atol=1e-15)

    about_com = inertia.Shift(inertia.get_com()).CalcRotationalInertia().CopyToFullMatrix3()
    np.testing.assert_allclose(np.diag(about_com), moments, rtol=1e-9)


def test_the_arm_weighs_what_its_links_weigh(irb120: MultibodyPlant) -> None:
    irb120.Finalize()
    assert irb120.CalcTotalMass(irb120.CreateDefaultContext()) == pytest.approx(18.146)


def test_limits_are_the_published_ones(irb120: MultibodyPlant) -> None:
    irb120.Finalize()

    np.testing.assert_array_equal(load_robot("irb120").axis_limits, [LOWER, UPPER])
    np.testing.assert_array_equal(irb120.GetPositionLowerLimits(), LOWER)
    np.testing.assert_array_equal(irb120.GetPositionUpperLimits(), UPPER)
    np.testing.assert_array_equal(irb120.GetVelocityUpperLimits(), VELOCITY)


def test_at_zero_the_flange_points_forward(irb120: MultibodyPlant) -> None:
    irb120.Finalize()
    expected = [0.374, 0, 0.630, 0, np.pi / 2, 0]
    np.testing.assert_allclose(
        pose_from_transform(tool_pose(irb120, np.zeros(6))), expected, atol=1e-7
    )


def test_at_home_the_flange_points_down(irb120: MultibodyPlant) -> None:
    irb120.Finalize()
    pose = tool_pose(irb120, HOME)

    np.testing.assert_allclose(pose.translation(), [0.302, 0, 0.558], atol=1e-12)
    np.testing.assert_allclose(pose.rotation().matrix(), np.diag([-1, 1, -1]), atol=1e-12)


def test_home_is_what_the_robot_says(irb120: MultibodyPlant) -> None:
    robot = load_robot("irb120")
    np.testing.assert_allclose(np.deg2rad(robot.axis_vector(robot.home_deg, "home_deg")), HOME)


def test_the_dh_table_gives_the_same_flange_pose(irb120: MultibodyPlant) -> None:
    irb120.Finalize()
    random = np.random.default_rng(120)
    for q in random.uniform(LOWER, UPPER, (200, 6)):
        difference = tool_pose(irb120, q).GetAsMatrix4() - dh_product(q).GetAsMatrix4()
        assert np.abs(difference).max() < 1e-9


def test_the_mass_matrix_at_zero_has_the_known_diagonal(irb120: MultibodyPlant) -> None:
    irb120.Finalize()
    matrix = irb120.CalcMassMatrix(irb120.CreateDefaultContext())

    known = [0.193, 0.790, 0.179, 0.0043, 0.0025, 0.001]

    # the last digit of 0.0043 and 0.0025
    np.testing.assert_allclose(np.diag(matrix), known, rtol=0.015)


@pytest.mark.parametrize("carried", HOLDING)
def test_holding_30_degrees_takes_the_known_torques(carried: tuple[str, ...]) -> None:
    overrides = {"pieces": {}, **{f"pieces.{name}.parent": "robot" for name in carried[:1]}}
    if carried:
        # the gripper is turned by 90 deg
        overrides["pieces.gripper.pose"] = [
            0,
            0,
            0,
            np.pi / 2,
            0,
            0,
        ]
    if len(carried) > 1:
        overrides |= {"pieces.load.model": "pencil", "pieces.load.parent": "gripper"}
    station = build_station(load_station("irb120_dynamic", overrides)).ports.plant
    position = np.full(6, np.deg2rad(30))

    torque = holding_torque(station, station.robots["robot"], position)

    np.testing.assert_allclose(torque, HOLDING[carried], atol=0.01)


@pytest.mark.long
def test_the_meshes_are_what_the_script_makes(tmp_path: Path) -> None:
    # Boxes and volumes, not bytes: convex hulls may list their faces in another order in another version of scipy.
    folder = models_root() / "irb120"
    script = shutil.copy(folder / "make_meshes.py", tmp_path)
    runpy.run_path(str(script), run_name="__main__")

    committed = sorted(file.name for file in (folder / "meshes").glob("*.obj"))

    assert sorted(file.name for file in (tmp_path / "meshes").glob("*.obj")) == committed
    for name in committed:
        box, volume = obj_figures(folder / "meshes" / name)
        box_made, volume_made = obj_figures(tmp_path / "meshes" / name)
        np.testing.assert_allclose(box_made, box, atol=1e-4)  # coordinates are written to 0.1 mm
        assert volume_made == pytest.approx(volume, rel=1e-3)
        assert volume > 0, f"the faces of {name} look inwards"


def test_every_mesh_of_the_urdf_is_there_and_none_is_left_over() -> None:
    robot = load_robot("irb120")
    used = {mesh.get("filename") for mesh in robot.element.iter("mesh")}
    assert used == {f"meshes/{file.name}" for file in (robot.folder / "meshes").iterdir()}
