"""Frames, solids, joints and contacts against their definitions."""

import re

import numpy as np
import pytest
import trimesh
from pydrake.math import RotationMatrix
from slx_files import BRICK, INERTIA, REVOLUTE, TRANSFORM, WORLD, Level, write_model

from simrob_drake import build_station, load_station, simulate
from simrob_drake.base.errors import InvalidModel
from simrob_drake.extensions.simulink.importing import import_simulink
from simrob_drake.extensions.simulink.mechanics.joints import rigid_transform
from simrob_drake.extensions.simulink.mechanics.shapes import READ, MeshFiles, load_mesh
from simrob_drake.extensions.simulink.mechanics.solids import moved, read_solid, together
from simrob_drake.extensions.simulink.mechanics.trees import body_poses
from simrob_drake.extensions.simulink.model.nodes import Findings, Node
from simrob_drake.extensions.simulink.reading.graph import SimulinkBlock
from simrob_drake.extensions.simulink.simulink_model import read_simulink
from simrob_drake.extensions.simulink.values.workspace import Variables
from simrob_drake.importer.meshes.checks import MESH_FORMATS
from simrob_drake.results.animation.pictures import save_film_strip
from simrob_drake.robots.imports import ImportReport


def node(kind="x", path="block", **parameters):
    from pathlib import Path

    block = SimulinkBlock("1", path, f"sm_lib/Group/{kind}", linked=True, parameters=parameters)
    return Node(path, block, Variables(), Findings(ImportReport(Path("model.slx"))))


def turn(axis, degrees):
    return getattr(RotationMatrix, f"Make{axis}Rotation")(np.deg2rad(degrees)).matrix()


ANGLES = {
    "RotationSequenceAngles": "[10 20 30]",
    "RotationSequenceAnglesUnits": "deg",
    "RotationSequence": "ZYX",
}


@pytest.mark.parametrize(
    ("parameters", "expected"),
    [
        (
            {"RotationMethod": "StandardAxis", "RotationStandardAxis": "-Y", "RotationAngle": "0.5"},
            turn("Y", -np.rad2deg(0.5)),
        ),
        (
            {"RotationMethod": "ArbitraryAxis", "RotationArbitraryAxis": "[0 0 2]", "RotationAngle": "90",
             "RotationAngleUnits": "deg"}, turn("Z", 90),
        ),
        ({"RotationMethod": "RotationSequence", **ANGLES}, turn("Z", 10) @ turn("Y", 20) @ turn("X", 30)),
        (
            {"RotationMethod": "RotationSequence", "RotationSequenceAxes": "BaseAxes", **ANGLES},
            turn("X", 30) @ turn("Y", 20) @ turn("Z", 10),
        ),
        ({"RotationMethod": "RotationMatrix", "RotationMatrix": "[0 -1 0; 1 0 0; 0 0 1]"}, turn("Z", 90)),
        ({"RotationMethod": "Quaternion", "Quaternion": "[1 1 0 0]"}, turn("X", 90)),
        (
            {"RotationMethod": "AlignedAxes", "FollAlignAxisA": "+Z", "BaseAlignAxisA": "-Y", "FollAlignAxisB": "+Y",
             "BaseAlignAxisB": "+X"}, [[0, 1, 0], [0, 0, -1], [-1, 0, 0]],
        ),
    ],
)  # fmt: skip
def test_rotations(parameters, expected):
    pose = rigid_transform(node(**parameters))
    np.testing.assert_allclose(pose.rotation().matrix(), expected, atol=1e-12)


@pytest.mark.parametrize(
    ("parameters", "expected"),
    [
        (
            {"TranslationMethod": "Cartesian", "TranslationCartesianOffset": "[1 2 3]",
             "TranslationCartesianOffsetUnits": "mm"}, [0.001, 0.002, 0.003],
        ),
        (
            {"TranslationMethod": "StandardAxis", "TranslationStandardOffset": "2", "TranslationStandardAxis": "-X"},
            [-2, 0, 0],
        ),
        (
            {"TranslationMethod": "StandardAxis", "TranslationStandardOffset": "2", "TranslationStandardAxis": "+Y",
             "TranslationLengthUnit": "mm"}, [0, 0.002, 0],  # as the first releases write it
        ),
        (
            {"TranslationMethod": "Cylindrical", "TranslationROffset": "2", "TranslationThetaOffset": "90",
             "TranslationThetaOffsetUnits": "deg", "TranslationZOffset": "1"}, [0, 2, 1],
        ),
    ],
)  # fmt: skip
def test_translations(parameters, expected):
    np.testing.assert_allclose(
        rigid_transform(node(**parameters)).translation(), expected, atol=1e-12
    )


@pytest.mark.parametrize(
    "parameters",
    [
        {"RotationMethod": "Magic"},
        {"TranslationMethod": "Magic"},
        {"RotationMethod": "RotationMatrix", "RotationMatrix": "[1 0 0; 0 1 0; 0 0 2]"},
        {"RotationMethod": "Quaternion", "Quaternion": "[0 0 0 0]"},
        {
            "RotationMethod": "ArbitraryAxis",
            "RotationArbitraryAxis": "[0 0 0]",
            "RotationAngle": "90",
        },
        {"RotationMethod": "AlignedAxes", "FollAlignAxisA": "+Z", "FollAlignAxisB": "-Z"},
        {"RotationMethod": "RotationSequence", "RotationSequence": "XYQ"},
        {"TranslationMethod": "Cartesian", "TranslationCartesianOffset": "[1 2]"},
        {"TranslationMethod": "Cartesian", "TranslationCartesianOffset": "[1 2 inf]"},
        {
            "TranslationMethod": "Cartesian",
            "TranslationCartesianOffset": "[1 2 3]",
            "TranslationCartesianOffsetUnits": "kg",
        },
    ],
)
def test_frames_that_cannot_be(parameters):
    with pytest.raises(InvalidModel, match=r"model\.slx: block: "):
        rigid_transform(node(**parameters))


def weight_of(kind, **parameters):
    return read_solid(node(kind, **parameters), MeshFiles([])).weight


def as_mesh(solid):
    return trimesh.Trimesh(solid.shape.mesh.vertices, solid.shape.mesh.faces, process=True)


def test_primitives_weigh_what_their_formulas_say():
    ball = weight_of("Spherical Solid", SphereRadius="60", SphereRadiusUnits="mm", Density="1000")
    assert ball.mass == pytest.approx(0.904779, rel=1e-6)
    np.testing.assert_allclose(ball.inertia, np.eye(3) * 0.4 * ball.mass * 0.06**2)
    rod = weight_of(
        "Cylindrical Solid", CylinderRadius="0.1", CylinderLength="2", BasedOnType="Mass", Mass="3"
    )
    np.testing.assert_allclose(np.diag(rod.inertia), [3 * (0.03 + 4) / 12] * 2 + [3 * 0.01 / 2])
    egg = weight_of("Ellipsoidal Solid", EllipsoidRadii="[1 2 3]", BasedOnType="Mass", Mass="5")
    np.testing.assert_allclose(np.diag(egg.inertia), [13, 10, 5])
    point = weight_of("Inertia", InertiaType="PointMass", Mass="2")
    assert (point.mass, point.inertia.max()) == (2, 0)


def test_products_of_inertia_stand_as_simscape_orders_them():
    weight = weight_of(
        "Inertia",
        InertiaType="Custom",
        Mass="1",
        MomentsOfInertia="[3 4 5]",
        ProductsOfInertia="[0.1 0.2 0.3]",
    )
    np.testing.assert_array_equal(weight.inertia, [[3, 0.3, 0.2], [0.3, 4, 0.1], [0.2, 0.1, 5]])


L_SHAPE = "[0 0; 3 0; 3 1; 1 1; 1 2; 0 2]"


def test_extrusions_weigh_as_their_closed_meshes():
    solid = read_solid(
        node(
            "Extruded Solid",
            ExtrusionType="General",
            ExtrusionCrossSection=L_SHAPE,
            ExtrusionLength="0.5",
            Density="2",
        ),
        MeshFiles([]),
    )
    mesh = as_mesh(solid)
    mesh.density = 2.0
    assert mesh.is_watertight
    assert solid.weight.mass == pytest.approx(2 * 4 * 0.5)
    np.testing.assert_allclose(solid.weight.com, mesh.center_mass, atol=1e-9)
    np.testing.assert_allclose(solid.weight.inertia, mesh.moment_inertia, atol=1e-9)
    other_way = node(
        "Extruded Solid",
        ExtrusionCrossSection="flipud(" + L_SHAPE + ")",
        ExtrusionLength="0.5",
        Density="2",
    )
    np.testing.assert_allclose(
        read_solid(other_way, MeshFiles([])).weight.inertia, solid.weight.inertia, atol=1e-12
    )


@pytest.mark.parametrize("angle", [360, 90])
def test_revolutions_weigh_as_fine_meshes(angle):
    solid = read_solid(
        node("Revolved Solid", RevolutionCrossSection="[1 0; 2 0; 2 1]", RevolutionExtent="Custom",
             RevolutionAngle=str(angle), RevolutionAngleUnits="deg", Density="1"),
        MeshFiles([]),
    )  # fmt: skip
    mesh = as_mesh(solid)
    # Pappus: area times the way of its middle
    assert solid.weight.mass == pytest.approx(np.deg2rad(angle) * 0.5 * 5 / 3)
    np.testing.assert_allclose(mesh.volume, solid.weight.mass, rtol=4e-3)  # of 48 segments a turn
    np.testing.assert_allclose(mesh.center_mass, solid.weight.com, atol=5e-3)
    np.testing.assert_allclose(
        mesh.moment_inertia, solid.weight.inertia, atol=2e-2 * np.abs(solid.weight.inertia).max()
    )


def test_a_body_weighs_as_its_parts_together():
    half = weight_of("Brick Solid", BrickDimensions="[1 2 3]", BasedOnType="Mass", Mass="4")
    from pydrake.math import RigidTransform

    pair = together([moved(half, RigidTransform([x, 0, 0])) for x in (-0.5, 0.5)])
    whole = weight_of("Brick Solid", BrickDimensions="[2 2 3]", BasedOnType="Mass", Mass="8")
    np.testing.assert_allclose(pair.inertia, whole.inertia)


@pytest.mark.parametrize(
    ("kind", "parameters", "told"),
    [
        ("Brick Solid", {"BrickDimensions": "[1 0 1]"}, "lengths are positive"),
        ("Brick Solid", {"Density": "-1"}, "negative"),
        ("Inertia", {"Mass": "-1"}, "negative"),
        ("Extruded Solid", {"ExtrusionCrossSection": "[0 0; 1 1]"}, "no outline"),
        ("Extruded Solid", {"ExtrusionCrossSection": "[0 0; 1 1; 2 2]"}, "no area"),
        ("Extruded Solid", {"ExtrusionType": "Regular", "PolygonNumSides": "2"}, "2 sides"),
        ("Revolved Solid", {"RevolutionCrossSection": "[-1 0; 2 0; 2 1]"}, "crosses the axis"),
        ("File Solid", {"ExtGeomFileName": "none.stl"}, r"none\.stl"),
        ("Solid", {"GeometryShape": "Blob"}, "Blob"),
    ],
)
def test_solids_that_cannot_be(kind, parameters, told):
    with pytest.raises(InvalidModel, match=told):
        weight_of(kind, **parameters)


def test_meshes_are_found_and_weighed_but_only_below_given_folders(tmp_path):
    box = trimesh.creation.box((1, 2, 3))
    (tmp_path / "model" / "Library").mkdir(parents=True)
    box.export(tmp_path / "model" / "Library" / "Part.STL")
    box.export(tmp_path / "secret.stl")
    meshes = MeshFiles([tmp_path / "model"])
    solid = read_solid(
        node(
            "File Solid",
            ExtGeomFileName="C:\\work\\library\\part.stl",
            ExtGeomFileUnits="cm",
            Density="1000",
        ),
        meshes,
    )
    assert solid.weight.mass == pytest.approx(6e-6 * 1000)
    with pytest.raises(InvalidModel, match="cannot be read"):
        read_solid(node("File Solid", ExtGeomFileName="../secret.stl"), meshes)
    (tmp_path / "model" / "cut.stl").write_bytes((tmp_path / "secret.stl").read_bytes()[:200])
    with pytest.raises(
        InvalidModel, match=r"the mesh cut\.stl, which is cut off: it contains 2 of its 12 faces"
    ):
        read_solid(node("File Solid", ExtGeomFileName="cut.stl"), meshes)


def frame_xml(feature, primary="+Z", along="+Z"):
    source = "<Source>ReferenceFrame</Source><SourceDirection>{2}</SourceDirection>"
    axis = "<{0}><DefinedDirection>{1}</DefinedDirection>" + source + "</{0}>"
    axes = axis.format("PrimaryAxis", primary, along) + axis.format("SecondaryAxis", "+X", "+X")
    origin = (
        f"<Origin><Source>GeometricFeature</Source><FeatureName>{feature}</FeatureName></Origin>"
    )
    return f"<Frame><Id>F</Id><Value><Name>F</Name>{origin}{axes}</Value></Frame>"


def test_bodies_joined_at_frames_of_solids(tmp_path):
    """Two boxes, side on side: the second one's middle is where both halves add up."""
    level = Level()
    world = level.block(WORLD, "World")
    joint = level.block(REVOLUTE, "Hinge")
    frames = "<Frames>" + frame_xml("-x surface") + frame_xml("+x surface") + "</Frames>"
    one = level.block(
        BRICK,
        "One",
        BrickDimensions="[2 1 1]",
        SerializedFrames=frames,
        DoExposeReferenceFrame="off",
    )
    other = level.block(
        BRICK,
        "Other",
        BrickDimensions="[4 1 1]",
        SerializedFrames=frames,
        DoExposeReferenceFrame="on",
    )
    level.connect(f"{world}#rconn:1", f"{joint}#lconn:1")
    level.connect(f"{joint}#rconn:1", f"{one}#lconn:1")
    level.connect(f"{one}#rconn:1", f"{other}#lconn:1")
    model = read_simulink(write_model(tmp_path / "a.slx", level))
    (tree,) = model.trees
    (branch,) = tree.branches
    places = {solid.node.path: solid.pose.translation() for solid in branch.body.solids}
    to_joint = branch.in_body.inverse()
    np.testing.assert_allclose(to_joint.multiply(places["One"]), [1, 0, 0], atol=1e-12)
    np.testing.assert_allclose(to_joint.multiply(places["Other"]), [4, 0, 0], atol=1e-12)


def mechanism():
    """Return the level of two bars on hinges in a row, and its blocks."""
    level = Level()
    blocks = {"world": level.block(WORLD, "World")}
    before = f"{blocks['world']}#rconn:1"
    for number in (1, 2):
        joint = level.block(REVOLUTE, f"Joint{number}")
        rod = level.block(
            INERTIA, f"Rod{number}", Mass="1", MomentsOfInertia="[1 1 1]", CenterOfMass="[0.5 0 0]"
        )
        end = level.block(
            TRANSFORM,
            f"End{number}",
            TranslationMethod="Cartesian",
            TranslationCartesianOffset="[1 0 0]",
        )
        level.connect(before, f"{joint}#lconn:1")
        level.connect(f"{joint}#rconn:1", f"{rod}#rconn:1", f"{end}#lconn:1")
        before = f"{end}#rconn:1"
    blocks["end"] = before
    return level, blocks


def test_a_joint_the_other_way_round_turns_the_other_way(tmp_path):
    level = Level()
    world = level.block(WORLD, "World")
    start = {
        "PositionTargetSpecify": "on",
        "PositionTargetValue": "30",
        "PositionTargetValueUnits": "deg",
    }
    joint = level.block(REVOLUTE, "J", **start)
    rod = level.block(
        INERTIA, "Rod", Mass="1", MomentsOfInertia="[1 1 1]", CenterOfMass="[0.5 0 0]"
    )
    tip = level.block("sm_lib/Frames and Transforms/Reference Frame", "Tip")
    off = level.block(
        TRANSFORM, "Off", TranslationMethod="Cartesian", TranslationCartesianOffset="[1 0 0]"
    )
    level.connect(f"{world}#rconn:1", f"{joint}#rconn:1")  # the world is its follower
    level.connect(f"{joint}#lconn:1", f"{rod}#rconn:1", f"{off}#lconn:1")
    level.connect(f"{off}#rconn:1", f"{tip}#rconn:1")
    station = import_simulink(write_model(tmp_path / "a.slx", level), tmp_path / "out").station
    result = simulate(load_station(station, {"mode": "kinematic"}), duration=0.1, progress=False)
    angle = np.deg2rad(-30)
    np.testing.assert_allclose(
        result.pose("tcp")[0, :3], [np.cos(angle), np.sin(angle), 0], atol=1e-12
    )


def four_bar(closing=REVOLUTE, start="80", bars=3, asked=None, **parameters):
    """Bars of 1 m between hinges 1.2 m apart, the last hinge closing the loop; ``asked`` starts of others [deg]."""
    starts = {1: start, **(asked or {})}
    level = Level()
    world = level.block(WORLD, "World")
    ground = level.block(
        TRANSFORM, "Ground", TranslationMethod="Cartesian", TranslationCartesianOffset="[1.2 0 0]"
    )
    stand = level.block(
        TRANSFORM, "Stand", RotationMethod="StandardAxis", RotationStandardAxis="+X", RotationAngle="90",
        RotationAngleUnits="deg",
    )  # fmt: skip
    level.connect(f"{world}#rconn:1", f"{stand}#lconn:1")
    before = f"{stand}#rconn:1"
    level.connect(f"{stand}#rconn:1", f"{ground}#lconn:1")
    for number in range(1, bars + 1):
        given = {"PositionTargetSpecify": "on", "PositionTargetValueUnits": "deg"}
        given["PositionTargetValue"] = str(starts.get(number))
        joint = level.block(REVOLUTE, f"Joint{number}", **(given if number in starts else {}))
        rod = level.block(
            INERTIA,
            f"Rod{number}",
            Mass="1",
            MomentsOfInertia="[0.1 0.1 0.1]",
            CenterOfMass="[0.5 0 0]",
        )
        end = level.block(
            TRANSFORM,
            f"End{number}",
            TranslationMethod="Cartesian",
            TranslationCartesianOffset="[1 0 0]",
        )
        level.connect(before, f"{joint}#lconn:1")
        level.connect(f"{joint}#rconn:1", f"{rod}#rconn:1", f"{end}#lconn:1")
        before = f"{end}#rconn:1"
    last = level.block(closing, "Closing", **parameters)
    level.connect(before, f"{last}#rconn:1")
    level.connect(f"{ground}#rconn:1", f"{last}#lconn:1")
    return level


@pytest.mark.parametrize(
    ("first", "way"), [(80, 1), (80, -1), (-60, 1), (-60, -1), (100, 1), (100, -1)]
)
def test_a_loop_starts_on_the_side_that_its_joints_ask_for(tmp_path, first, way):
    """The second hinge, which asks for nothing, stands far from 0: bars 2 and 3 are equal sides over the rest."""
    rest = np.hypot(1.2 - np.cos(np.deg2rad(first)), np.sin(np.deg2rad(first)))
    bend = way * 2 * np.rad2deg(np.arccos(rest / 2))
    level = four_bar(start=str(first), asked={3: bend})
    imported = import_simulink(write_model(tmp_path / "a.slx", level), tmp_path / "out")
    assert not [
        entry.text for entry in imported.report.entries if "so its loop closes" in entry.text
    ]
    (robot,) = imported.files.robots.values()
    starts = {axis: freedom.start for freedom, axis in robot.axes.items()}
    assert np.rad2deg(starts["Joint3"]) == pytest.approx(bend, abs=1e-3)
    poses = body_poses(robot.tree, np.array(list(starts.values())))
    assert max(np.abs(closing.gap(poses)).max() for closing in robot.tree.closings) < 1e-6


def test_a_loop_is_cut_at_a_hinge_and_not_at_its_slider(tmp_path):
    """A crank of 0.3 m that turns moves a slider by a rod of 1 m: s = 0.3 cos a + sqrt(1 - 0.09 sin² a)."""
    level = Level()
    world = level.block(WORLD, "World")
    before = f"{world}#rconn:1"
    spin = {
        "VelocityTargetSpecify": "on",
        "VelocityTargetValue": "3",
        "VelocityTargetValueUnits": "rad/s",
    }
    for name, length, given in (("Crank", "0.3", spin), ("Rod", "1", {}), ("Pin", "0", {})):
        joint = level.block(REVOLUTE, name, **given)
        body = level.block(INERTIA, f"{name} body", Mass="1", MomentsOfInertia="[0.1 0.1 0.1]")
        end = level.block(TRANSFORM, f"{name} end", TranslationMethod="Cartesian",
                          TranslationCartesianOffset=f"[{length} 0 0]")  # fmt: skip
        level.connect(before, f"{joint}#lconn:1")
        level.connect(f"{joint}#rconn:1", f"{body}#rconn:1", f"{end}#lconn:1")
        before = f"{end}#rconn:1"
    along = {
        "RotationMethod": "StandardAxis",
        "RotationStandardAxis": "+Y",
        "RotationAngle": "pi/2",
    }
    turned = [level.block(TRANSFORM, name, **along) for name in ("Rail", "Carriage")]
    slider = level.block("sm_lib/Joints/Prismatic Joint", "Slider")
    level.connect(f"{world}#rconn:1", f"{turned[0]}#lconn:1")
    level.connect(f"{turned[0]}#rconn:1", f"{slider}#lconn:1")
    level.connect(before, f"{turned[1]}#lconn:1")
    level.connect(f"{turned[1]}#rconn:1", f"{slider}#rconn:1")
    imported = import_simulink(write_model(tmp_path / "a.slx", level), tmp_path / "out")
    result = simulate(load_station(imported.station), duration=1.0, progress=False)
    angle = result["q.Crank"]
    assert np.ptp(angle) > 2
    np.testing.assert_allclose(result["v.Crank"][0], 3, rtol=1e-4)
    place = 0.3 * np.cos(angle) + np.sqrt(1 - (0.3 * np.sin(angle)) ** 2)
    np.testing.assert_allclose(result["q.Slider"], place, atol=1e-3)


@pytest.mark.long
def test_loops_that_cannot_close_are_told(tmp_path):
    level = four_bar()
    level.blocks = [block.replace("[1.2 0 0]", "[9 0 0]") for block in level.blocks]
    imported = import_simulink(write_model(tmp_path / "a.slx", level), tmp_path / "out")
    assert imported.fidelity.endswith(" lost")
    assert "mm (or mrad) are left" in imported.report.of("lost")[0].text
    assert not load_station(imported.station).couplings


def test_no_turn_needs_no_axis():
    """As data files of imported assemblies have it."""
    figures = {"RotationMethod": "ArbitraryAxis", "RotationArbitraryAxis": "[0 0 0]"}
    assert rigid_transform(node(**figures, RotationAngle="0")).IsExactlyIdentity()


def test_a_physical_bus_joins_its_elements_by_name(tmp_path):
    """A hinge hangs on the world, and its body behind it, through a bus whose two ends list them in other orders."""
    level = Level()
    world, hinge, rod = (
        level.block(WORLD, "World"),
        level.block(REVOLUTE, "Hinge"),
        level.block(INERTIA, "Rod"),
    )
    near = level.block("SimscapeBus", "Near", HierarchyStrings="Stand;Rod")
    far = level.block("SimscapeBus", "Far", HierarchyStrings="Rod;Stand")
    level.connect(f"{near}#rconn:1", f"{far}#rconn:1")
    level.connect(f"{world}#rconn:1", f"{near}#lconn:1")
    weighing = level.block("sm_lib/Body Elements/Inertia Sensor", "Weighing")  # which moves nothing
    level.connect(f"{rod}#rconn:1", f"{near}#lconn:2", f"{weighing}#lconn:1")
    level.connect(f"{far}#lconn:2", f"{hinge}#lconn:1")
    level.connect(f"{far}#lconn:1", f"{hinge}#rconn:1")
    imported = import_simulink(write_model(tmp_path / "a.slx", level), tmp_path / "out")
    (link,) = imported.model.bodies.links
    assert link.base.grounded
    assert [solid.node.path for solid in link.follower.solids] == ["Rod"]
    assert imported.fidelity == "mechanics complete"


def test_rigid_loops_must_fit(tmp_path):
    level, _ = mechanism()
    wrong = level.block(
        TRANSFORM, "Wrong", TranslationMethod="Cartesian", TranslationCartesianOffset="[1 0.1 0]"
    )
    level.connect("4#lconn:1", f"{wrong}#lconn:1")
    level.connect("4#rconn:1", f"{wrong}#rconn:1")
    report = read_simulink(write_model(tmp_path / "a.slx", level)).report
    assert any(
        entry.element == "Wrong" and "does not fit" in entry.text for entry in report.of("lost")
    )


def test_a_ball_on_a_floor(tmp_path):
    """Drop a ball on a plate: it rests where the spring of the contact carries it."""
    level = Level()
    level.block(WORLD, "World")
    plate = level.block(BRICK, "Plate", BrickDimensions="[1 1 0.1]", ExportEntireGeometry="on")
    high = level.block(
        TRANSFORM, "High", TranslationMethod="Cartesian", TranslationCartesianOffset="[0 0 0.1]"
    )
    ball = level.block(
        "sm_lib/Body Elements/Spherical Solid",
        "Ball",
        SphereRadius="0.05",
        Density="1000",
        ExportEntireGeometry="on",
    )
    start = level.block("sm_lib/Frames and Transforms/Reference Frame", "Start")
    touch = level.block(
        "sm_lib/Forces and\nTorques/Spatial\nContact Force", "Touch", NormalStiffness="1e4", NormalDamping="50",
        CoefficientOfStaticFriction="0.5", CoefficientOfDynamicFriction="0.3", FrictionalCriticalVelocity="1e-3",
        SenseSeparationDistance="on",
    )  # fmt: skip
    level.connect("1#rconn:1", f"{plate}#rconn:1")
    level.connect(f"{start}#rconn:1", f"{high}#lconn:1")
    level.connect(f"{high}#rconn:1", f"{ball}#rconn:1")
    level.connect(f"{ball}#lconn:1", f"{touch}#lconn:1")
    level.connect(f"{plate}#lconn:1", f"{touch}#rconn:1")
    station = import_simulink(write_model(tmp_path / "a.slx", level), tmp_path / "out").station
    config = load_station(station)
    assert config.contact.stiffness == 1e4
    assert (config.contact.friction.static, config.contact.friction.dynamic) == (0.5, 0.3)
    result = simulate(config, duration=3.0, progress=False)
    mass = 4 / 3 * np.pi * 0.05**3 * 1000
    sink = mass * 9.80665 / 1e4
    np.testing.assert_allclose(result.piece_pose("Ball")[-1, 2], 0.1 - sink, atol=2e-5)
    np.testing.assert_allclose(result["distance.Touch"][-1], -sink, atol=2e-5)


TOUCH = "sm_lib/Forces and\nTorques/Spatial\nContact Force"
FIGURES = {"NormalStiffness": "1e4", "NormalDamping": "50", "SenseSeparationDistance": "on"}


def ball_on(level, world, name, start, touched, **figures):
    """Let a ball of 50 mm fall from a place onto what its geometry port is given of; return the ball's SID."""
    joint = level.block("sm_lib/Joints/6-DOF Joint", f"{name} free")
    put = level.block(
        TRANSFORM, f"{name} put", TranslationMethod="Cartesian", TranslationCartesianOffset=start
    )
    ball = level.block("sm_lib/Body Elements/Spherical Solid", name, SphereRadius="0.05", Density="1000",
                       ExportEntireGeometry="on")  # fmt: skip
    touch = level.block(TOUCH, f"{name} touches", **FIGURES | figures)
    level.connect(f"{world}#rconn:1", f"{put}#lconn:1")
    level.connect(f"{put}#rconn:1", f"{joint}#lconn:1")
    level.connect(f"{joint}#rconn:1", f"{ball}#rconn:1")
    level.connect(f"{ball}#lconn:1", f"{touch}#lconn:1")
    level.connect(f"{touched}#rconn:1", f"{touch}#rconn:1")


SINK = 4 / 3 * np.pi * 0.05**3 * 1000 * 9.80665 / 1e4  # m, of that ball at rest


def test_planes_and_disks_carry_where_they_are(tmp_path):
    """One ball rests on a plane at 0.3 m, one on a disk above it, and one falls past the disk's edge."""
    level = Level()
    world = level.block(WORLD, "World")
    places = {"Plane": "[0 0 0.3]", "Disk": "[0 0 0.6]"}
    grounds = {"Plane": "Infinite Plane", "Disk": "Disk"}
    made = {}
    for name, place in places.items():
        high = level.block(
            TRANSFORM,
            f"{name} high",
            TranslationMethod="Cartesian",
            TranslationCartesianOffset=place,
        )
        made[name] = level.block(f"sm_lib/Curves and Surfaces/{grounds[name]}", name, Radius="0.2")
        level.connect(f"{world}#rconn:1", f"{high}#lconn:1")
        level.connect(f"{high}#rconn:1", f"{made[name]}#lconn:1")
    for name, start, touched in (("On plane", "[1 0 0.36]", "Plane"), ("On disk", "[0.1 0 0.66]", "Disk"),
                                 ("Beside", "[0.5 0 0.66]", "Disk")):  # fmt: skip
        ball_on(level, world, name, start, made[touched])
    station = import_simulink(write_model(tmp_path / "a.slx", level), tmp_path / "out").station
    result = simulate(station, duration=1.0, progress=False)
    for name, height in (("On_plane", 0.35), ("On_disk", 0.65), ("Beside", 0.35)):
        assert result.piece_pose(name)[-1, 2] == pytest.approx(height - SINK, abs=2e-4)
    assert result["distance.On_disk_touches"][-1] == pytest.approx(-SINK, abs=1e-4)


def test_a_contact_without_stiffness_is_lost(tmp_path):
    level = Level()
    world, plane = (
        level.block(WORLD, "World"),
        level.block("sm_lib/Curves and Surfaces/Infinite Plane", "Plane"),
    )
    level.connect(f"{world}#rconn:1", f"{plane}#lconn:1")
    ball_on(level, world, "Ball", "[0 0 1]", plane, NormalStiffness="0")
    imported = import_simulink(write_model(tmp_path / "a.slx", level), tmp_path / "out")
    assert imported.fidelity == "1 Spatial Contact Force lost"


def test_a_contact_without_lines_is_no_loss(tmp_path):
    level = Level()
    level.block(INERTIA, "Ball")
    level.block("sm_lib/Forces and Torques/Spatial Contact Force", "Contact")
    imported = import_simulink(write_model(tmp_path / "a.slx", level), tmp_path / "out")
    assert imported.fidelity == "mechanics complete"
    assert [entry.text for entry in imported.report.of("dropped")] == [
        "the contact: it is not connected"
    ]


def grid_model(path, *, tilt="0", heights="[0.1 0.1 0.3 0.3]' * [1 1 1]"):
    """A grid over x = -1 ... 2 and y = 0 ... 2 of a frame 0.2 m up, a quarter turn round; three balls."""
    level = Level()
    world = level.block(WORLD, "World")
    turned = {
        "RotationMethod": "RotationSequence",
        "RotationSequence": "ZXY",
        "RotationSequenceAngles": f"[pi/2 {tilt} 0]",
    }
    there = level.block(
        TRANSFORM,
        "There",
        TranslationMethod="Cartesian",
        TranslationCartesianOffset="[0 0 0.2]",
        **turned,
    )
    ground = level.block("sm_lib/Curves and Surfaces/Grid Surface", "Hills", XGridVector="[-1 0 1 2]",
                         YGridVector="[0 1 2]", ZHeights=heights)  # fmt: skip
    level.connect(f"{world}#rconn:1", f"{there}#lconn:1")
    level.connect(f"{there}#rconn:1", f"{ground}#lconn:1")
    for name, start in (
        ("Low", "[-0.5 -0.6 0.37]"),
        ("High", "[-0.5 1.6 0.57]"),
        ("Beside", "[0.5 1.6 0.07]"),
    ):
        ball_on(level, world, name, start, ground)
    return write_model(path, level)


def test_a_grid_of_heights_becomes_the_terrain(tmp_path):
    """Its frame's x is the world's y: one ball rests at 0.3 m, one at 0.5 m, and one on the ground beside it."""
    imported = import_simulink(grid_model(tmp_path / "a.slx"), tmp_path / "out")
    assert imported.fidelity == "mechanics complete"
    result = simulate(imported.station, duration=0.6, progress=False)
    for name, height in (("Low", 0.3), ("High", 0.5), ("Beside", 0.0)):
        assert result.piece_pose(name)[-1, 2] == pytest.approx(height + 0.05 - SINK, abs=5e-4), name
    assert result["distance.High_touches"][-1] == pytest.approx(-SINK, abs=5e-4)


@pytest.mark.parametrize("wrong", [{"tilt": "0.1"}, {"heights": "[0 0; 0 0]"}])
def test_a_grid_that_no_terrain_can_be_is_lost(tmp_path, wrong):
    imported = import_simulink(grid_model(tmp_path / "a.slx", **wrong), tmp_path / "out")
    assert imported.fidelity == "1 Grid Surface lost"


CYLINDER = {"CylinderRadius": "0.1", "CylinderLength": "0.1"}


PART = {"ExtGeomFileName": "part.stl", "ExtGeomFileUnits": "cm"}


@pytest.mark.parametrize(
    ("kind", "sizes", "words", "mesh"),
    [
        (BRICK, {"BrickDimensions": "[0.2 0.3 0.1]"}, "in its corners", None),
        (BRICK.replace("Brick", "Cylindrical"), CYLINDER, "on its rims", None),
        pytest.param(
            BRICK.replace("Brick", "File"),
            PART,
            "its convex hull",
            trimesh.creation.box((20, 30, 10)),
            marks=pytest.mark.long,
        ),
        (BRICK.replace("Brick", "File"), PART, "nearly a ball", trimesh.creation.icosphere(3, 5)),
    ],
)
def test_a_robot_may_stand_on_many_shapes(tmp_path, kind, sizes, words, mesh):
    """Spheres in four corners, eight of a rim, or a ball carry it, with the spring of the model between them."""
    if mesh is not None:
        mesh.export(tmp_path / "part.stl")
    level = Level()
    world, joint = level.block(WORLD, "World"), level.block("sm_lib/Joints/6-DOF Joint", "Free",
        PzPositionTargetSpecify="on", PzPositionTargetValue="0.055")  # fmt: skip
    foot = level.block(
        kind, "Foot", BasedOnType="Mass", Mass="2", ExportEntireGeometry="on", **sizes
    )
    hinge, arm = (
        level.block(REVOLUTE, "Hinge"),
        level.block(INERTIA, "Arm", Mass="1", MomentsOfInertia="[1 1 1]"),
    )
    ground = level.block("sm_lib/Curves and Surfaces/Infinite Plane", "Ground")
    touch = level.block(TOUCH, "Touch", **FIGURES)
    level.connect(f"{world}#rconn:1", f"{joint}#lconn:1", f"{ground}#lconn:1")
    level.connect(f"{joint}#rconn:1", f"{foot}#rconn:1", f"{hinge}#lconn:1")
    level.connect(f"{hinge}#rconn:1", f"{arm}#rconn:1")
    level.connect(f"{foot}#lconn:1", f"{touch}#lconn:1")
    level.connect(f"{ground}#rconn:1", f"{touch}#rconn:1")
    imported = import_simulink(write_model(tmp_path / "a.slx", level), tmp_path / "out")
    result = simulate(imported.station, duration=1.0, progress=False)
    sink = 3 * 9.80665 / 1e4
    assert result.pose("base")[-1, 2] == pytest.approx(0.05 - sink, abs=1e-4)
    assert result["distance.Touch"][-1] == pytest.approx(-sink, abs=1e-4)
    assert any(words in entry.text for entry in imported.report.of("approximated"))
    if mesh is not None:
        # a mesh without normals is none for a renderer
        save_film_strip(result, tmp_path / "strip.png")


def test_a_robot_may_stand_on_a_disk(tmp_path):
    """Its rim, 1 mm thick to each side, carries 3 kg with the spring of the model."""
    level = Level()
    world, joint = level.block(WORLD, "World"), level.block("sm_lib/Joints/6-DOF Joint", "Free",
        PzPositionTargetSpecify="on", PzPositionTargetValue="0.005")  # fmt: skip
    foot = level.block(INERTIA, "Foot", Mass="2", MomentsOfInertia="[0.1 0.1 0.1]")
    disk, ground = (level.block(f"sm_lib/Curves and Surfaces/{kind}", kind, Radius="0.2") for kind in
                    ("Disk", "Infinite Plane"))  # fmt: skip
    hinge, arm = (
        level.block(REVOLUTE, "Hinge"),
        level.block(INERTIA, "Arm", Mass="1", MomentsOfInertia="[1 1 1]"),
    )
    touch = level.block(TOUCH, "Touch", **FIGURES)
    level.connect(f"{world}#rconn:1", f"{joint}#lconn:1", f"{ground}#lconn:1")
    level.connect(f"{joint}#rconn:1", f"{foot}#rconn:1", f"{hinge}#lconn:1", f"{disk}#lconn:1")
    level.connect(f"{hinge}#rconn:1", f"{arm}#rconn:1")
    level.connect(f"{disk}#rconn:1", f"{touch}#lconn:1")
    level.connect(f"{ground}#rconn:1", f"{touch}#rconn:1")
    imported = import_simulink(write_model(tmp_path / "a.slx", level), tmp_path / "out")
    assert imported.fidelity == "mechanics complete"
    result = simulate(imported.station, duration=1.0, progress=False)
    assert result.pose("base")[-1, 2] == pytest.approx(0.001 - 3 * 9.80665 / 1e4, abs=1e-4)
    assert result["distance.Touch"][-1] == pytest.approx(-3 * 9.80665 / 1e4, abs=1e-4)


@pytest.mark.parametrize(
    "gravity",
    # of first releases
    [
        {"GravityVector": "[0 -9.81 0]"},
        {"GravityVector": "[0 -981 0]", "GravityUnits": "cm/s^2"},
    ],
)
def test_gravity_to_the_side_turns_the_world(tmp_path, gravity):
    level = Level()
    world = level.block(WORLD, "World")
    gravity = level.block("sm_lib/Utilities/Mechanism Configuration", "G", **gravity)
    joint = level.block("sm_lib/Joints/6-DOF Joint", "Free")
    ball = level.block(
        "sm_lib/Body Elements/Spherical Solid", "Ball", SphereRadius="0.05", Density="1000"
    )
    level.connect(f"{world}#rconn:1", f"{gravity}#rconn:1", f"{joint}#lconn:1")
    level.connect(f"{joint}#rconn:1", f"{ball}#rconn:1")
    imported = import_simulink(write_model(tmp_path / "a.slx", level), tmp_path / "out")
    result = simulate(imported.station, duration=0.5, progress=False)
    np.testing.assert_allclose(result.piece_pose("Ball")[-1, :3], [0, 0, -9.81 * 0.125], atol=1e-6)
    assert any("the world is turned" in entry.text for entry in imported.report.entries)


@pytest.mark.parametrize(("how", "kind", "falls", "told"), [
    ("absent", "Model", False, "none: no Mechanism Configuration tells it"),
    ("loose", "Model", False, "it is connected with no body"),
    ("commented", "Model", False, "none: no Mechanism Configuration tells it"),
    ("absent", "Subsystem", True, "the earth's: what it is put into tells it"),
    ("by a signal", "Model", True, "its gravity comes from a signal"),
])  # fmt: skip
def test_nothing_falls_where_no_gravity_is_told(tmp_path, how, kind, falls, told):
    level = Level()
    world, joint = level.block(WORLD, "World"), level.block("sm_lib/Joints/6-DOF Joint", "Free")
    ball = level.block(
        "sm_lib/Body Elements/Spherical Solid", "Ball", SphereRadius="0.05", Density="1000"
    )
    level.connect(f"{world}#rconn:1", f"{joint}#lconn:1")
    level.connect(f"{joint}#rconn:1", f"{ball}#rconn:1")
    if how != "absent":
        figures = {
            "commented": {"Commented": "on"},
            "by a signal": {"UniformGravity": "TimeVarying"},
        }.get(how, {})
        gravity = level.block("sm_lib/Utilities/Mechanism Configuration", "G", **figures)
        if how != "loose":
            level.connect(f"{world}#rconn:1", f"{gravity}#rconn:1")
    imported = import_simulink(
        write_model(tmp_path / "a.slx", level, kind=kind, falls=False), tmp_path / "out"
    )
    result = simulate(imported.station, duration=0.5, progress=False)
    drop = 9.80665 * 0.125 if falls else 0.0
    np.testing.assert_allclose(result.piece_pose("Ball")[-1, 2], -drop, atol=1e-6)
    assert any(told in entry.text for entry in imported.report.entries)
    assert ("lost" in imported.fidelity) == (how == "by a signal")


def test_a_joint_of_three_freedoms_is_three_joints(tmp_path):
    level = Level()
    world, joint = level.block(WORLD, "World"), level.block("sm_lib/Joints/Planar Joint", "Plane")
    rod = level.block(INERTIA, "Rod", Mass="1", MomentsOfInertia="[1 1 1]")
    level.connect(f"{world}#rconn:1", f"{joint}#lconn:1")
    level.connect(f"{joint}#rconn:1", f"{rod}#rconn:1")
    imported = import_simulink(write_model(tmp_path / "a.slx", level), tmp_path / "out")
    (robot,) = imported.files.robots.values()
    assert list(robot.axes.values()) == ["Plane_Px", "Plane_Py", "Plane_Rz"]
    assert [freedom.turns for freedom in robot.axes] == [False, False, True]


def test_a_ball_joint_tells_of_its_limits_and_of_a_spring_that_is_slack_elsewhere(tmp_path):
    level = Level()
    given = {
        "UpperLimitSpecify": "on",
        "SpringStiffness": "3",
        "EquilibriumRotationMethod": "StandardAxis",
    }
    world, joint = (
        level.block(WORLD, "World"),
        level.block("sm_lib/Joints/Spherical Joint", "Ball", **given),
    )
    rod = level.block(INERTIA, "Rod", Mass="1", MomentsOfInertia="[1 1 1]")
    level.connect(f"{world}#rconn:1", f"{joint}#lconn:1")
    level.connect(f"{joint}#rconn:1", f"{rod}#rconn:1")
    model = read_simulink(write_model(tmp_path / "a.slx", level))
    assert model.bodies.links[0].joint.pulls == []
    assert sorted(entry.text for entry in model.report.of("lost")) == [
        "its spring against turning: only one that is slack where both frames are one is read",
        "the limits of a ball joint",
    ]


@pytest.mark.parametrize(
    ("kind", "counted"),
    [
        ("sm_lib/Body Elements/Variable Mass/General\nVariable Mass", "1 variable mass lost"),
        ("sm_lib/Constraints/Point on Curve\nConstraint", "1 constraint lost"),
    ],
)
def test_what_has_no_likeness_is_lost_by_name(tmp_path, kind, counted):
    level, _ = mechanism()
    level.block(kind, "Strange")
    imported = import_simulink(write_model(tmp_path / "a.slx", level), tmp_path / "out")
    assert imported.fidelity == counted
    assert imported.station is not None


def test_a_block_whose_figures_cannot_be_is_lost_and_the_rest_stands(tmp_path):
    level, _ = mechanism()
    level.block(BRICK, "Bad", BrickDimensions="[1 -1 1]")
    imported = import_simulink(write_model(tmp_path / "a.slx", level), tmp_path / "out")
    assert imported.fidelity == "1 Brick Solid lost"
    assert any("lengths are positive" in entry.text for entry in imported.report.of("lost"))


def test_frames_on_the_centre_of_mass_and_on_old_solids(tmp_path):
    """A wedge's centre of mass is a third of its sides from the corner; a corner of a brick is half its sides away."""
    from simrob_drake.extensions.simulink.mechanics.solids import frame_pose
    from simrob_drake.extensions.simulink.reading.graph import parse_part

    outline = {"ExtrusionCrossSection": "[0 0; 3 0; 0 1.5]", "ExtrusionLength": "1"}
    wedge = node("Extruded Solid", **outline)
    middle = frame_xml("").replace("GeometricFeature", "CenterOfMassFrame")
    pose = frame_pose(wedge, parse_part(middle.encode()), weight_of("Extruded Solid", **outline))
    np.testing.assert_allclose(pose.translation(), [1, 0.5, 0], atol=1e-12)
    old = node("Solid", GeometryShape="Brick", BrickDimensions="[2 4 6]")
    np.testing.assert_allclose(
        frame_pose(old, parse_part(frame_xml("+x -y -z point").encode())).translation(), [1, -2, -3]
    )
    half = {
        "RevolutionCrossSection": "[1 0; 2 0; 2 1; 1 1]",
        "RevolutionExtent": "Custom",
        "RevolutionAngle": "pi",
    }
    for kind, shape in (("Revolved Solid", ""), ("Solid", "GeneralSolidOfRevolution")):
        turned = node(kind, GeometryShape=shape, **half)
        front = frame_pose(turned, parse_part(frame_xml("front surface").encode()))
        np.testing.assert_allclose(front.translation(), [0, 1.5, 0.5], atol=1e-12)
    with pytest.raises(InvalidModel, match="'circular curve 9', whose place is not known here"):
        frame_pose(wedge, parse_part(frame_xml("circular curve 9").encode()))


@pytest.mark.parametrize("hung", ["sm_lib/Frames and Transforms/Reference Frame", INERTIA])
def test_a_frame_on_an_unknown_feature_loses_nothing_where_nothing_weighs(tmp_path, hung):
    level, blocks = mechanism()
    frames = "<Frames>" + frame_xml("-x surface") + frame_xml("circular curve 9") + "</Frames>"
    brick = level.block(BRICK, "Brick", SerializedFrames=frames, DoExposeReferenceFrame="off")
    beyond, mark = (
        level.block(TRANSFORM, "Beyond"),
        level.block(hung, "Mark", MomentsOfInertia="[1 1 1]"),
    )
    level.connect(blocks["end"], f"{brick}#lconn:1")
    level.connect(f"{brick}#rconn:1", f"{beyond}#lconn:1")
    level.connect(f"{beyond}#rconn:1", f"{mark}#rconn:1")
    imported = import_simulink(write_model(tmp_path / "a.slx", level), tmp_path / "out")
    assert imported.fidelity == ("1 Brick Solid lost" if hung == INERTIA else "mechanics complete")
    (told,) = imported.report.of("lost" if hung == INERTIA else "approximated")
    assert told.text.startswith(
        "a frame is on 'circular curve 9', whose place is not known here; taken at its ref"
    )


@pytest.mark.parametrize(
    ("kind", "feature", "along", "looks"),
    [
        ("Cylindrical Solid", "top surface", "+Z", [0, 0, 1]),
        ("Extruded Solid", "bottom surface", "+Z", [0, 0, -1]),
        ("Brick Solid", "+x surface", "-Z", [-1, 0, 0]),
        ("Brick Solid", "+x surface", "+X", None),
        ("Cylindrical Solid", "top curve", "+Z", None),
    ],
)
def test_a_frame_looks_where_a_flat_side_of_its_solid_does(kind, feature, along, looks):
    """Its z along what the side's own z is, its x along the reference frame's y."""
    from simrob_drake.extensions.simulink.mechanics.solids import frame_pose
    from simrob_drake.extensions.simulink.reading.graph import parse_part

    follows = f"<Source>GeometricFeature</Source><SourceDirection>{along}</SourceDirection><FeatureName>{feature}"
    text = frame_xml("").replace("GeometricFeature", "ReferenceFrame")
    text = text.replace(
        "<Source>ReferenceFrame</Source><SourceDirection>+Z</SourceDirection>",
        follows + "</FeatureName>",
    )
    frame = parse_part(text.replace("<SourceDirection>+X<", "<SourceDirection>+Y<").encode())
    if looks is None:
        with pytest.raises(
            InvalidModel, match=f"follows '{re.escape(feature)}', which is not known here"
        ):
            frame_pose(node(kind), frame)
        return
    turn = frame_pose(node(kind), frame).rotation().matrix()
    np.testing.assert_allclose(turn @ [0, 0, 1], looks, atol=1e-12)
    np.testing.assert_allclose(turn @ [1, 0, 0], [0, 1, 0], atol=1e-12)


@pytest.mark.parametrize(
    ("applied", "ports"),
    [
        (["EnableForceZ"], ("external_force",)),
        (["EnableTorqueX"], ("external_torque",)),
        (["EnableForce", "EnableTorque"], ("external_force", "external_torque")),
    ],
)
def test_an_external_force_is_a_port_at_its_frame(tmp_path, applied, ports):
    level, blocks = mechanism()
    push = level.block(
        "sm_lib/Forces and\nTorques/External Force\nand Torque",
        "Push",
        **dict.fromkeys(applied, "on"),
    )
    level.connect(blocks["end"], f"{push}#rconn:1")
    station = import_simulink(write_model(tmp_path / "a.slx", level), tmp_path / "out").station
    config = load_station(station)
    assert config.inputs == ports
    assert config.robots["robot"].tcp == "Push"
    assert set(ports) <= set(build_station(config).ports.inputs)


@pytest.mark.parametrize(
    "ending", [kind for kind in MESH_FORMATS if kind != ".gltf"]
)  # which is several files
def test_a_file_solid_reads_the_meshes_that_robots_and_pieces_have(ending, tmp_path):
    """Before, an OFF file was left out, although the import of robots reads it."""
    trimesh.creation.box([1.0, 2.0, 3.0]).export(tmp_path / f"part{ending}")

    assert {ending, ".gltf"} <= {*READ}
    assert load_mesh(tmp_path / f"part{ending}").vertices.max() == pytest.approx(1.5)


def test_a_quaternion_of_another_norm_is_noted():
    """As for SDF and RAPID; before, it was normalised without a word."""
    block = node(RotationMethod="Quaternion", Quaternion="[1 1 0 0]")
    rounded = node(RotationMethod="Quaternion", Quaternion="[0.707 0.707 0 0]")

    rigid_transform(block)
    rigid_transform(rounded)

    notes = [entry.text for entry in block.findings.report.entries]
    assert notes == ["its Quaternion has a norm of 1.41421; it is normalised"]
    assert not rounded.findings.report.entries
