"""Arms from tables of Denavit-Hartenberg parameters: kinematics, inertia, shapes, and what is refused."""

import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydrake.geometry import SceneGraph
from pydrake.multibody.plant import MultibodyPlant

from simrob_drake import Arm
from simrob_drake.base.errors import InvalidConfig, InvalidModel
from simrob_drake.base.frames import transform_from_pose
from simrob_drake.base.sections import validate_section
from simrob_drake.robots.catalog import load_robot, load_robot_file, robot_names
from simrob_drake.robots.dh import DhTable, dh_robot
from simrob_drake.robots.parse import add_urdf
from simrob_drake.robots.urdf import with_absolute_meshes
from simrob_drake.robots.urdf_check import check_urdf
from simrob_drake.simulation import simulate
from simrob_drake.stations.checks import check_station
from simrob_drake.stations.load import load_station, station_yaml

IRB120 = [  # theta [deg], d [m], a [m], alpha [deg]: facts of the IRB120, section 4
    (0, 0.290, 0, -90),
    (-90, 0, 0.270, 0),
    (0, 0, 0.070, -90),
    (0, 0.302, 0, 90),
    (0, 0, 0, -90),
    (180, 0.072, 0, 0),
]
SPIN = {"limit_deg": [-180, 180], "effort": 10.0}
SLIDE = {"type": "prismatic", "limit": [-0.5, 0.7], "effort": 10.0}


def table(rows: list[dict[str, Any]], convention: str = "classical", **more: Any) -> DhTable:
    return validate_section(DhTable, {"convention": convention, "rows": rows, **more}, "table")


def product(dh: DhTable, q: np.ndarray) -> np.ndarray:
    """Multiply a table out, as the textbooks have it: poses (m, 4, 4) of the tool for positions (m, n)."""
    result = np.broadcast_to(transform_from_pose(dh.base).GetAsMatrix4(), (len(q), 4, 4))
    for row, value in zip(dh.rows, q.T, strict=True):
        turns = row.type == "revolute"
        about_z = turning("z", np.deg2rad(row.offset_deg) + (value if turns else 0 * value))
        along_z = sliding(2, row.d + (0 * value if turns else value))
        about_x = turning("x", np.full_like(value, np.deg2rad(row.alpha_deg)))
        along_x = sliding(0, np.full_like(value, row.a))
        before, after = (
            (about_z @ along_z, along_x @ about_x),
            (about_x @ along_x, about_z @ along_z),
        )
        first, second = before if dh.convention == "classical" else after
        result = result @ first @ second
    return result @ transform_from_pose(dh.tool).GetAsMatrix4()


def turning(axis: str, angle: np.ndarray) -> np.ndarray:
    c, s, o, i = np.cos(angle), np.sin(angle), np.zeros_like(angle), np.ones_like(angle)
    rows = [[c, -s, o, o], [s, c, o, o], [o, o, i, o], [o, o, o, i]]
    if axis == "x":
        rows = [[i, o, o, o], [o, c, -s, o], [o, s, c, o], [o, o, o, i]]
    return np.moveaxis(np.array(rows), -1, 0)


def sliding(axis: int, way: np.ndarray) -> np.ndarray:
    matrix = np.tile(np.eye(4), (len(way), 1, 1))
    matrix[:, axis, 3] = way
    return matrix


def plant_of(element: ET.Element, scene_graph: SceneGraph | None = None) -> MultibodyPlant:
    plant = MultibodyPlant(0.0)
    if scene_graph is not None:
        plant.RegisterAsSourceForSceneGraph(scene_graph)
    instance = add_urdf(
        plant, element, name="arm", where="table", collision=scene_graph is not None
    )
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("base_link", instance))
    plant.Finalize()
    return plant


def tool_poses(plant: MultibodyPlant, postures: np.ndarray) -> np.ndarray:
    context, tool = plant.CreateDefaultContext(), plant.GetFrameByName("tool0")
    poses = np.empty((len(postures), 4, 4))
    for index, posture in enumerate(postures):
        plant.SetPositions(context, posture)
        poses[index] = tool.CalcPoseInWorld(context).GetAsMatrix4()
    return poses


@pytest.mark.parametrize("convention", ["classical", "modified"])
@pytest.mark.parametrize("seed", range(10))
def test_the_urdf_of_a_random_table_multiplies_to_the_same_pose(convention: str, seed: int) -> None:
    random = np.random.default_rng(seed)
    rows = []
    for _ in range(random.integers(1, 9)):
        kind = SPIN if random.random() < 0.7 else SLIDE
        a, d = random.uniform(-1, 1, 2) * random.integers(0, 2, 2)
        alpha, offset = random.choice([-180.0, -90.0, 0.0, 90.0, 33.3], 2)
        rows.append(
            {
                **kind,
                "a": float(a),
                "d": float(d),
                "alpha_deg": float(alpha),
                "offset_deg": float(offset),
            }
        )
    base, tool = (
        [*random.uniform(-1, 1, 3), 0.3, np.pi / 2, 0.2],
        [*random.uniform(-1, 1, 3), *random.uniform(-3, 3, 3)],
    )
    dh = table(rows, convention, base=base, tool=tool)
    postures = random.uniform(-0.5, 0.5, (20, len(rows)))
    element = dh_robot("arm", dh)

    check_urdf(element, Path("table"))

    np.testing.assert_allclose(
        tool_poses(plant_of(element), postures), product(dh, postures), atol=1e-12
    )


def test_the_table_of_the_irb120_is_its_urdf() -> None:
    keys = ("offset_deg", "d", "a", "alpha_deg")
    dh = table([{**SPIN, **dict(zip(keys, map(float, row), strict=True))} for row in IRB120])
    model = load_robot("irb120")
    lower, upper = model.axis_limits
    postures = np.random.default_rng(0).uniform(lower, upper, (10_000, 6))

    by_urdf = tool_poses(plant_of(with_absolute_meshes(model.element, model.folder)), postures)

    np.testing.assert_allclose(by_urdf, product(dh, postures), atol=1e-9)
    np.testing.assert_allclose(
        tool_poses(plant_of(dh_robot("arm", dh)), postures), by_urdf, atol=1e-9
    )


@pytest.mark.parametrize("convention", ["classical", "modified"])
def test_mass_centre_and_inertia_are_those_of_the_rows_frame(convention: str) -> None:
    figures = {
        "mass": 2.0,
        "com": [0.1, 0.2, 0.3],
        "inertia": [0.02, 0.03, 0.04, 0.001, -0.002, 0.003],
    }
    row = {**SPIN, "a": 0.5, "d": 0.2, "alpha_deg": 70.0, "offset_deg": 40.0}
    dh = table([{**row, **figures}], convention)
    plant = plant_of(dh_robot("arm", dh))
    body = plant.GetBodyByName("link_1")
    inertia = body.default_spatial_inertia()

    if convention == "classical":  # the row's frame is at the link's end
        frame = product(dh, np.zeros((1, 1)))[0]
    else:  # at its joint
        frame = (turning("z", np.array([np.deg2rad(40.0)])) @ sliding(2, np.array([0.2])))[0]

    assert inertia.get_mass() == 2.0
    np.testing.assert_allclose(
        inertia.get_com(), frame[:3, :3] @ figures["com"] + frame[:3, 3], atol=1e-12
    )

    about_com = inertia.Shift(inertia.get_com()).CalcRotationalInertia().CopyToFullMatrix3()
    own = np.array([[0.02, 0.001, -0.002], [0.001, 0.03, 0.003], [-0.002, 0.003, 0.04]])
    np.testing.assert_allclose(about_com, frame[:3, :3] @ own @ frame[:3, :3].T, atol=1e-12)


def test_what_is_not_given_of_an_inertia_is_that_of_the_shape() -> None:
    row = {**SPIN, "d": 2.0, "mass": 3.0}
    plant = plant_of(dh_robot("arm", table([row], thickness=1e-3)))

    inertia = plant.GetBodyByName("link_1").default_spatial_inertia()

    np.testing.assert_allclose(inertia.get_com(), [0, 0, 1.0], atol=0.01)  # a rod along z

    about_com = inertia.Shift(inertia.get_com()).CalcRotationalInertia().get_moments()
    np.testing.assert_allclose(about_com, [3.0 * 2.0**2 / 12] * 2 + [0.0], rtol=0.02, atol=1e-4)

    moved = plant_of(dh_robot("arm", table([{**row, "com": [0, 0, 0.5]}], thickness=1e-3)))
    np.testing.assert_allclose(moved.GetBodyByName("link_1").default_com(), [0, 0, 2.5], atol=1e-12)


def test_limits_speeds_and_efforts_reach_the_plant() -> None:
    rows = [
        {
            "limit_deg": [-90, 45],
            "velocity_deg": 180,
            "effort": 12.0,
            "damping": 0.5,
            "joint": "waist",
        },
        {"type": "prismatic", "limit": [0.0, 0.3], "velocity": 0.2, "effort": 30.0},
    ]
    plant = plant_of(dh_robot("arm", table(rows)))

    waist, slide = plant.GetJointByName("waist"), plant.GetJointByName("joint_2")

    np.testing.assert_allclose(
        [waist.position_lower_limit(), waist.position_upper_limit()], np.deg2rad([-90, 45])
    )
    np.testing.assert_allclose(
        [slide.position_lower_limit(), slide.position_upper_limit()], [0.0, 0.3]
    )
    assert waist.velocity_upper_limit() == pytest.approx(np.pi)
    assert slide.velocity_upper_limit() == 0.2
    assert waist.default_damping() == 0.5

    efforts = [plant.get_joint_actuator(i).effort_limit() for i in plant.GetJointActuatorIndices()]
    assert efforts == [12.0, 30.0]


@pytest.mark.parametrize("convention", ["classical", "modified"])
def test_links_have_shapes_that_reach_from_joint_to_joint(convention: str) -> None:
    row = {**SPIN, "a": 0.4, "d": 0.3, "alpha_deg": -90.0}
    element = dh_robot("arm", table([row] * 3, convention, base=[0, 0, 0.5, 0, 0, 0]))
    scene_graph = SceneGraph()

    plant = plant_of(element, scene_graph)

    for name in ("link_1", "link_2", "link_3"):
        body = plant.GetBodyByName(name)
        assert len(plant.GetVisualGeometriesForBody(body)) >= 2
        assert len(plant.GetCollisionGeometriesForBody(body)) == len(
            plant.GetVisualGeometriesForBody(body)
        )

    lengths = [
        float(c.get("length", 0))
        for c in element.iterfind("link[@name='link_1']/visual/geometry/cylinder")
    ]
    assert 0.3 in [round(length, 12) for length in lengths]
    assert 0.4 in [round(length, 12) for length in lengths]


def test_colours_and_thickness_can_be_chosen() -> None:
    dh = table([{**SPIN, "d": 0.5}], thickness=0.2, colour=[1, 0, 0, 1], joint_colour=[0, 1, 0, 1])
    element = dh_robot("arm", dh)

    assert max(float(c.get("radius", 0)) for c in element.iter("cylinder")) == pytest.approx(
        1.8 * 0.2
    )
    assert {c.get("rgba") for c in element.iter("color")} >= {"1 0 0 1", "0 1 0 1"}


DH_ROBOTS = [name for name in robot_names() if load_robot(name).dh is not None]


def test_the_classic_arms_are_there() -> None:
    assert DH_ROBOTS == ["puma560", "tx40", "ur10", "ur3", "ur5"]
    assert all(load_robot(name).source for name in DH_ROBOTS)


# Zero postures by hand from the lengths: UR arms lie along -x, the TX40 stands, the Puma's forearm points up.
@pytest.mark.parametrize(
    ("name", "place"),
    [
        ("ur3", [-0.24365 - 0.21325, -0.11235 - 0.0819, 0.1519 - 0.08535]),
        ("ur5", [-0.425 - 0.39225, -0.10915 - 0.0823, 0.089159 - 0.09465]),
        ("ur10", [-0.612 - 0.5723, -0.163941 - 0.0922, 0.1273 - 0.1157]),
        ("tx40", [0.0, 0.035, 0.32 + 0.225 + 0.225 + 0.065]),
        ("puma560", [0.4318 + 0.0203, -0.15005, 0.67183 + 0.4318]),
    ],
)
def test_an_arm_at_zero_is_where_its_lengths_say(name: str, place: list[float]) -> None:
    pose = tool_poses(plant_of(load_robot(name).element), np.zeros((1, 6)))[0]
    np.testing.assert_allclose(pose[:3, 3], place, atol=1e-12)


@pytest.mark.parametrize("name", DH_ROBOTS)
def test_an_arm_at_home_points_its_tool_down(name: str) -> None:
    model = load_robot(name)
    home = np.deg2rad(model.axis_vector(model.home_deg, "home_deg"))

    pose = tool_poses(plant_of(model.element), home[np.newaxis])[0]

    np.testing.assert_allclose(pose[:3, 2], [0, 0, -1], atol=1e-9)


@pytest.mark.parametrize("name", DH_ROBOTS)
def test_an_arm_holds_its_home_and_does_a_small_move_within_its_torques(
    name: str, tmp_path: Path
) -> None:
    model = load_robot(name)
    home = model.axis_vector(model.home_deg, "home_deg")
    (tmp_path / "arm.yaml").write_text(f"""
robot: {{model: {name}, initial_deg: {home.tolist()}}}
reference: {{kind: move, target_deg: {(home + 10).tolist()}, duration: 0.6}}
monitors: {{torque_limit: {{}}, joint_limit: {{}}}}
solver: {{kind: continuous, scheme: radau3, accuracy: 1.0e-2, max_step: 0.1}}
duration: 1.0
""")

    station = load_station(tmp_path / "arm.yaml")

    assert "warning" not in {finding.level for finding in check_station(station)}

    result = simulate(station, progress=False)
    assert result.stopped_by is None
    for axis, goal, effort in zip(model.axes, np.deg2rad(home + 10), model.efforts, strict=True):
        assert abs(result[f"q.{axis}"][-1] - goal) < 0.02
        assert abs(result[f"q.{axis}"][0] - goal) == pytest.approx(np.deg2rad(10), abs=1e-9)
        assert abs(result[f"tau.{axis}"]).max() < effort


SCARA = """
description: a SCARA of one's own
dh:
  convention: classical
  rows:
    - {a: 0.3, d: 0.4, limit_deg: [-130, 130], effort: 50, mass: 5}
    - {a: 0.25, alpha_deg: 180, limit_deg: [-140, 140], effort: 30, mass: 3, joint: elbow}
    - {type: prismatic, limit: [0, 0.2], effort: 100, mass: 1}
    - {limit_deg: [-360, 360], d: 0.02, effort: 5, mass: 0.5}
servo: {kp: [500, 500, 5000, 50], kd: [20, 20, 200, 1]}
"""


def test_four_postures_of_four_axes_are_no_matrix_of_a_pose(tmp_path: Path) -> None:
    (tmp_path / "scara.yaml").write_text(SCARA)
    (tmp_path / "cell.yaml").write_text("robot: {model: scara.yaml}\nmode: kinematic\n")
    arm = Arm(tmp_path / "cell.yaml")
    postures = [[0.1 * number, 0.2, 0.1, 0.0] for number in range(1, 5)]

    plan = arm.plan.move_abs_j(postures)

    assert plan.entry is not None
    assert plan.entry["move_abs_j"]["targets"] == postures
    np.testing.assert_allclose(plan.end, postures[-1], rtol=0, atol=1e-12)


def test_a_robot_of_ones_own_is_one_file(tmp_path: Path) -> None:
    (tmp_path / "robots").mkdir()
    (tmp_path / "robots" / "scara.yaml").write_text(SCARA)
    (tmp_path / "cell.yaml").write_text(
        "robot: {model: robots/scara.yaml}\npieces: {gripper: {parent: robot}}\nduration: 0.5\n"
    )

    station = load_station(tmp_path / "cell.yaml")
    assert station.robots["robot"].model == str(tmp_path / "robots" / "scara.yaml")

    (tmp_path / "resolved").mkdir()
    (tmp_path / "resolved" / "cell.yaml").write_text(station_yaml(station))
    assert (
        load_station(tmp_path / "resolved" / "cell.yaml", mesh_path=[tmp_path / "robots"])
        == station
    )

    result = simulate(station, progress=False)
    assert result.stopped_by is None
    assert result["q.elbow"][-1] == pytest.approx(0.0, abs=1e-6)

    # rod, wrist and gripper hang on the rod, which slides down
    sag = (1.0 + 0.5 + 1.0) * 9.80665 / 5000
    assert result["q.joint_3"][-1] == pytest.approx(sag, rel=0.05)


def test_a_robot_is_called_as_its_file_or_its_folder(tmp_path: Path) -> None:
    (tmp_path / "crane").mkdir()
    for file, name in (
        (tmp_path / "crane" / "robot.yaml", "crane"),
        (tmp_path / "lift.yaml", "lift"),
    ):
        file.write_text(SCARA)
        model = load_robot_file(file)
        assert model.name == name
        assert list(model.axes) == ["joint_1", "elbow", "joint_3", "joint_4"]
        assert (model.root, model.tools) == ("base_link", {"tool0": "tool0"})


def test_axes_of_a_table_can_be_renamed(tmp_path: Path) -> None:
    (tmp_path / "own.yaml").write_text(SCARA + "axes: {turn: {joint: elbow, sign: -1}}\n")
    assert list(load_robot_file(tmp_path / "own.yaml").axes) == ["turn"]


ROW = "{a: 0.3, limit_deg: [-130, 130], effort: 50}"
WRONG = [
    ("rows: []", r"dh\.rows: .*at least 1"),
    ("{}", r"dh\.(convention|rows): this key is required"),
    (
        f"convention: classic, rows: [{ROW}]",
        r"dh\.convention: there is no 'classic'; did you mean 'classical'",
    ),
    ("rows: [{limit_deg: [-1, 1]}]", r"dh\.rows\[\d\]\.effort: this key is required"),
    ("rows: [{limit_deg: [-1, 1], effort: 0}]", r"dh\.rows\[\d\]\.effort: .*greater than 0"),
    ("rows: [{effort: 1}]", r"dh\.rows\[0\]: a revolute joint needs limit_deg"),
    (
        "rows: [{type: prismatic, effort: 1, limit_deg: [0, 1]}]",
        r"dh\.rows\[0\]: a prismatic joint needs limit",
    ),
    (
        "rows: [{limit_deg: [0, 1], limit: [0, 1], effort: 1}]",
        r"a revolute joint has the keys limit_deg and velocity_deg",
    ),
    (
        "rows: [{limit_deg: [0, 1], velocity: 1, effort: 1}]",
        r"a revolute joint has the keys limit_deg and velocity_deg",
    ),
    (
        "rows: [{limit_deg: [1, 1], effort: 1}]",
        r"limit_deg must be a lower limit and a higher limit; it is 1, 1",
    ),
    (
        "rows: [{limit_deg: [0, 1], effort: 1, type: helical}]",
        r"dh\.rows\[\d\]\.type: there is no 'helical'",
    ),
    (
        "rows: [{limit_deg: [0, 1], effort: 1, alpha: 90}]",
        r"dh\.rows\[\d\]\.alpha: unknown key; did you mean .alpha",
    ),
    ("rows: [{limit_deg: [0, 1], effort: 1, mass: -1}]", r"dh\.rows\[\d\]\.mass: .*at least 0"),
    (
        "rows: [{limit_deg: [0, 1], effort: 1, inertia: [1, 1, 3]}]",
        r"dh\.rows\[\d\]\.inertia: no body can have this inertia: a principal moment is .* larger than",
    ),
    # The three moments are right, but the products make one of the principal moments negative.
    (
        "rows: [{limit_deg: [0, 1], effort: 1, inertia: [1, 1, 1, 2, 0, 0]}]",
        r"dh\.rows\[\d\]\.inertia: no body can have this inertia: a principal moment is negative",
    ),
    ("rows: [{limit_deg: [0, 1], effort: 1, com: [1]}]", r"dh\.rows\[\d\]\.com: needs 3 values"),
    ("rows: [1]", r"dh\.rows"),
    (f"rows: [{ROW}], thickness: 0", r"dh\.thickness: .*greater than 0"),
    (f"rows: [{ROW}], tool: [0, 0, 0]", r"dh\.tool: needs 6 values"),
]


@pytest.mark.parametrize(("entries", "message"), WRONG, ids=[entries for entries, _ in WRONG])
def test_a_table_that_cannot_be_is_named(tmp_path: Path, entries: str, message: str) -> None:
    convention = "" if "convention" in entries or entries == "{}" else "convention: classical, "
    text = "dh: {}" if entries == "{}" else f"dh: {{{convention}{entries}}}"

    (tmp_path / "own.yaml").write_text(text)

    with pytest.raises(InvalidConfig, match=rf"own\.yaml: .*{message}"):
        load_robot_file(tmp_path / "own.yaml")


@pytest.mark.parametrize(
    "text", ["root: a\naxes: [b]\n", f"urdf: a.urdf\ndh: {{convention: classical, rows: [{ROW}]}}"]
)
def test_a_robot_has_either_a_urdf_or_a_table(tmp_path: Path, text: str) -> None:
    (tmp_path / "own.yaml").write_text(text)
    with pytest.raises(InvalidConfig, match="either a urdf or a dh table"):
        load_robot_file(tmp_path / "own.yaml")


def test_joints_of_one_name_are_refused(tmp_path: Path) -> None:
    row = "{limit_deg: [0, 1], effort: 1, joint: a}"
    (tmp_path / "own.yaml").write_text(f"dh: {{convention: classical, rows: [{row}, {row}]}}")
    with pytest.raises(InvalidModel, match="joint 'a': is defined twice"):
        _ = load_robot_file(tmp_path / "own.yaml").element


def test_a_station_names_a_robot_file_that_is_not_there(tmp_path: Path) -> None:
    (tmp_path / "cell.yaml").write_text("robot: {model: none.yaml}\n")
    with pytest.raises(InvalidConfig, match=r"none\.yaml: cannot be read"):
        load_station(tmp_path / "cell.yaml")
