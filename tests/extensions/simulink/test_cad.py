"""Assemblies that CAD tools export for Simscape Multibody."""

import os

import numpy as np
import pytest
import trimesh
from cad_files import constraint, instance, joint, part, write_cad, write_step_box
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix
from scipy.integrate import solve_ivp

from simrob_drake import load_station, simulate
from simrob_drake.base.errors import InvalidModel
from simrob_drake.cli.app import run_command
from simrob_drake.extensions.simulink.cad.assembly import End, Instance, Tie, is_export
from simrob_drake.extensions.simulink.cad.model import joint_of
from simrob_drake.extensions.simulink.importing import import_simulink
from simrob_drake.extensions.simulink.mechanics.shapes import load_mesh
from simrob_drake.extensions.simulink.mechanics.trees import body_poses
from simrob_drake.extensions.simulink.simulink_model import read_simulink

PLACE, TURN = np.array([0.3, -0.2, 0.5]), RotationMatrix(RollPitchYaw(0.4, -0.7, 1.1))
X, Y, Z = TURN.matrix().T


def end(kind, place, axis=(0, 0, 1)):
    turn = RotationMatrix.MakeFromOneVector(np.asarray(axis, dtype=float), 2)
    return End(Instance(kind, RigidTransform()), kind, RigidTransform(turn, PLACE + place))


def tie(kind, one, other):
    return Tie(kind, kind, end(*one), end(*other), False)


def lines(kind="Concentric", shape="cylinder", to="line", far=0.0):
    return tie(kind, (shape, 0.1 * Z, Z), (to, -0.2 * Z + far * X, -Z))


def planes(kind="Coincident", normal=None, far=0.0):
    normal = Z if normal is None else normal
    return tie(kind, ("plane", 0.1 * X, normal), ("plane", 0.3 * Y + far * normal, -normal))


@pytest.mark.parametrize(
    ("ties", "kind"),
    [
        ([lines(), planes()], "Revolute Joint"),
        ([lines(), planes("Distance", far=0.1), planes("Parallel")], "Revolute Joint"),
        ([lines(), tie("Coincident", ("point", 0 * X), ("plane", 0.2 * Y, Z))], "Revolute Joint"),
        ([lines()], "Cylindrical Joint"),
        ([lines("Coincident", "line", "circle"), planes("Angle", X)], "Prismatic Joint"),
        ([planes(normal=X), planes(normal=Y)], "Prismatic Joint"),
        ([planes()], "Planar Joint"),
        (
            [planes(), tie("Perpendicular", ("line", 0 * X, X), ("line", 0 * X, Y))],
            "Rectangular Joint",
        ),
        ([planes("Parallel"), planes("Parallel", X)], "Cartesian Joint"),
        ([tie("Coincident", ("point", 0 * X), ("sphere", 0 * X))], "Spherical Joint"),
        ([lines(), planes(), planes("Angle", X)], "Weld Joint"),
        ([tie("Fixed", ("point", 0 * X), ("plane", 0 * X, Z))], "Weld Joint"),
        ([lines(), lines("Distance", far=0.2)], "Cylindrical Joint"),
        ([lines("Distance", far=0.2)], None),  # it turns about one axis, and goes round the other
        ([tie("Coincident", ("point", 0 * X), ("plane", 0.2 * Y, Z))], None),
        ([tie("Distance", ("point", 0 * X), ("point", 0.2 * Y))], None),
        ([tie("Tangent", ("cylinder", 0.1 * Z, X), ("plane", 0 * X, Z))], None),
        ([tie("Parallel", ("line", 0 * X, X), ("plane", 0 * X, Z))], None),
    ],
)
def test_constraints_leave_joints(ties, kind):
    found = joint_of(ties)
    assert (found[0] if found else None) == kind
    if found is None or kind in ("Weld Joint", "Cartesian Joint"):
        return
    axis, place = found[1].rotation().matrix()[:, 2], found[1].translation() - PLACE
    if kind != "Spherical Joint":
        np.testing.assert_allclose(abs(axis @ Z), 1, atol=1e-9)
    if kind in ("Revolute Joint", "Cylindrical Joint"):
        np.testing.assert_allclose(np.cross(place, Z), 0, atol=1e-9)
    if kind == "Spherical Joint":
        np.testing.assert_allclose(place, 0, atol=1e-9)


AXIS_Y = RotationMatrix.MakeXRotation(-np.pi / 2)
"""Its z is the y of what it is in."""


def pendulum(tmp_path, **changes):
    """A rod of 2000 g that hangs from a stand, in grams and millimetres, 30° from the vertical in the assembly."""
    turned = RigidTransform(RotationMatrix.MakeYRotation(np.deg2rad(30)), [100, 0, 500])
    trimesh.creation.box((20, 20, 400)).export(tmp_path / "rod.stl")
    rod = part("rod", mass=2000, com=(0, 0, -200), inertia=(3e7, 3e7, 2e5, 0, 0, 0), file="rod.stl")
    stand = instance("stand-1", "stand", RigidTransform([100, 0, 0]), grounded="true")
    pivot = [
        (["stand-1"], RigidTransform(AXIS_Y, [0, 0, 500])),
        (["rod-1"], RigidTransform(AXIS_Y, [0, 0, 0])),
    ]
    content = {
        "instances": stand + instance("rod-1", "rod", turned), "parts": part("stand") + rod,
        "joints": joint("Revolute", "pivot", *pivot), "mass": "gram", "length": "millimeter",
    }  # fmt: skip
    return write_cad(tmp_path / "swing.xml", **{**content, **changes})


def swing(times, start, mass=2.0, arm=0.2, inertia=0.03):
    """Return the angle of a pendulum at times."""

    def motion(_, y):
        return y[1], -mass * 9.80665 * arm * np.sin(y[0]) / (inertia + mass * arm**2)

    return solve_ivp(motion, (0, times[-1]), [start, 0], rtol=1e-9, atol=1e-9, t_eval=times).y[0]


def test_a_pendulum_of_joints_swings_as_its_figures_say(tmp_path):
    imported = import_simulink(pendulum(tmp_path), tmp_path / "out")
    (robot,) = imported.files.robots.values()
    assert robot.mass == pytest.approx(2.0)
    tight = {"solver.accuracy": 1e-6, "solver.max_step": 0.01}
    result = simulate(load_station(imported.station, tight), duration=1.0, progress=False)
    np.testing.assert_allclose(result["q.pivot"], swing(result.times, np.deg2rad(30)), atol=1e-5)
    text = (imported.station.parent / "swing" / "swing.urdf").read_text()
    mesh = load_mesh(imported.station.parent / "swing" / "meshes" / "rod.obj")
    np.testing.assert_allclose(np.ptp(mesh.vertices, axis=0), [0.02, 0.02, 0.4], atol=1e-9)
    assert 'rgba="1' in text


TURN_X, TURN_Y, TURN_Z = (
    RotationMatrix.MakeXRotation,
    RotationMatrix.MakeYRotation,
    RotationMatrix.MakeZRotation,
)


@pytest.mark.parametrize(
    ("kind", "pose"),
    [
        ("Revolute", RigidTransform(TURN_Z(2.5), [0, 0, 0])),
        ("Prismatic", RigidTransform([0, 0, -0.3])),
        ("Cylindrical", RigidTransform(TURN_Z(-0.7), [0, 0, 0.2])),
        ("Planar", RigidTransform(TURN_Z(0.7), [0.1, 0.2, 0])),
        ("PinSlot", RigidTransform(TURN_Z(0.4), [0.1, 0, 0])),
        ("Cartesian", RigidTransform([0.1, -0.2, 0.3])),
        ("Universal", RigidTransform(TURN_X(0.3) @ TURN_Y(-0.8), [0, 0, 0])),
        ("Spherical", RigidTransform(TURN, [0, 0, 0])),
        ("Gimbal", RigidTransform(TURN, [0, 0, 0])),
        ("Bushing", RigidTransform(TURN, [0.1, 0.2, 0.3])),
        ("Telescoping", RigidTransform(TURN, [0, 0, 0.3])),
    ],
)
def test_joints_begin_where_the_assembly_is(tmp_path, kind, pose):
    base, follower = RigidTransform(TURN, PLACE), RigidTransform(TURN_X(1.2), [0.4, 0.1, -0.2])
    place = base @ pose @ follower.inverse()
    file = write_cad(
        tmp_path / "a.xml", parts=part("block"), joints=joint(kind, "j", (["a"], base), (["b"], follower)),
        instances=instance("a", "block", grounded="true") + instance("b", "block", place),
    )  # fmt: skip
    model = read_simulink(file)
    (tree,) = model.trees
    poses = body_poses(tree, np.array([freedom.start for freedom in tree.freedoms]))
    body = tree.branches[-1].body
    assert (poses[body] @ body.solids[0].pose).IsNearlyEqualTo(place, 1e-9)
    assert all(
        entry.kind == "approximated" and "ball joint" in entry.text
        for entry in model.report.entries
    )


def test_constraints_make_the_same_pendulum(tmp_path):
    about = (["rod-1"], "cylinder", (0, 7, 0), (0, 1, 0))
    ties = constraint("Concentric", "pin", (["stand-1"], "cylinder", (0, 0, 500), (0, 1, 0)), about)
    ties += constraint(
        "Coincident",
        "side",
        (["stand-1"], "plane", (0, 0, 9), (0, 1, 0)),
        (["rod-1"], "plane", (0, 0, 0), (0, -1, 0)),
    )
    file = pendulum(tmp_path, joints="", constraints=ties)
    result = simulate(import_simulink(file, tmp_path / "out").station, duration=0.5, progress=False)
    # the joint is at zero where the assembly is
    angle = swing(result.times, np.deg2rad(30)) - np.deg2rad(30)
    np.testing.assert_allclose(np.abs(result["q.pin"]), np.abs(angle), atol=1e-3)


def test_assemblies_bring_their_joints_once_for_each_instance(tmp_path):
    """Two flexible arms on a rigid frame of two parts; what stands in an assembly is held by it."""
    pin = joint("Revolute", "pin", (["hub"], RigidTransform()), (["bar"], RigidTransform()))
    inner = instance("hub", "block", grounded="true") + instance(
        "bar", "block", RigidTransform([0, 0.5, 0])
    )
    frame = instance("a", "block") + instance("b", "block", RigidTransform([0, 0, 1]))
    arms = "".join(
        instance(f"arm{n}", "arm", RigidTransform([n, 0, 0]), inner, grounded="true") for n in (1, 2)
    )  # fmt: skip
    whole = instance("frame", "frame", None, frame, rigid="true")
    weld = joint(
        "Weld", "foot", (["frame", "a"], RigidTransform()), (["arm1", "hub"], RigidTransform())
    )
    group = "".join(
        instance(f"g{n}", "block", RigidTransform([0, 0, 5 + n]), rigidGroup="G") for n in (1, 2)
    )
    kinds = f'<Assembly uid="arm"><Joints>{pin}</Joints></Assembly><Assembly uid="frame"/>'
    content = {"parts": part("block"), "joints": weld, "assemblies": kinds}
    file = write_cad(tmp_path / "a.xml", instances=arms + whole + group, **content)
    model = read_simulink(file)
    assert [len(body.solids) for body in model.bodies.bodies if not body.grounded] == [2, 1, 1]
    assert len(model.world.solids) == 4  # both hubs, and the frame that is welded to one
    assert sorted(link.joint.node.path for link in model.bodies.links) == [
        "arm1/pin",
        "arm2/pin",
        "g1 free",
    ]
    result = simulate(import_simulink(file, tmp_path / "out").station, duration=0.5, progress=False)
    np.testing.assert_allclose(result.piece_pose("g1")[[0, -1], 2], [6, 6 - 9.80665 / 8], atol=1e-4)


def test_parts_that_are_joined_and_not_held_are_free_as_one(tmp_path):
    far = RigidTransform([1.0, 0.0, 0.0])
    parts = [instance("one", "bar"), instance("other", "bar", far), instance("alone", "bar", far)]
    pin = joint("Revolute", "pin", (["one"], far), (["other"], RigidTransform()))
    file = write_cad(tmp_path / "a.xml", instances="".join(parts), joints=pin, parts=part("bar"))
    model = read_simulink(file)
    assert sorted(link.joint.node.path for link in model.bodies.links) == [
        "alone free",
        "one free",
        "pin",
    ]


@pytest.mark.long
def test_step_geometry_is_seen_in_its_own_units(tmp_path):
    pytest.importorskip("cascadio")
    write_step_box(tmp_path / "rod.step", (20, 30, 40))
    rod = '<Part name="rod" uid="rod"><GeometryFile name="rod.step" type="STEP"/></Part>'  # no mass: water
    imported = import_simulink(pendulum(tmp_path, parts=part("stand") + rod), tmp_path / "out")
    mesh = load_mesh(imported.station.parent / "swing" / "meshes" / "rod.obj")
    np.testing.assert_allclose(
        [mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)],
        [[0] * 3, [0.02, 0.03, 0.04]],
        atol=1e-8,
    )
    (robot,) = imported.files.robots.values()
    assert robot.mass == pytest.approx(0.024, rel=1e-6)
    (tmp_path / "rod.step").write_text("ISO-10303-21;\nHEADER;")
    lost = import_simulink(
        pendulum(tmp_path, parts=part("stand") + rod), tmp_path / "bad"
    ).report.of("lost")
    assert ["rod.step, which holds no solid" in entry.text for entry in lost] == [True, False]
    assert lost[-1].element == "motion by forces"  # for it was the only one with a weight


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ('version="2.0"', "<", "is not XML"),
        ("SimscapeMultibodyImportXML", "PhysicalModelingXMLFile", "first generation"),
        ("SimscapeMultibodyImportXML", "robot", "robot: is no export"),
        ("RootAssembly", "Assembly", "has no RootAssembly"),
        ('length="millimeter"/>\n<Root', 'length="cubit"/>\n<Root', "units: length: 'cubit'"),
        ("<Mass>2000</Mass>", "<Mass>two</Mass>", "rod: Mass: is 'two'; it must be a number"),
        ('entityUid="rod"', 'entityUid="bar"', "rod-1: is an instance of 'bar'"),
        (
            "<Uid>rod-1</Uid>",
            "<Uid>rod-2</Uid>",
            "pivot: joins 'rod-2', which is not in the assembly: stand-1, rod-1",
        ),
        ('uid="rod-1"', 'uid="stand-1"', "has the uid 'stand-1' of stand-1"),
        ("<Revolute ", "<Gearing ", "is not XML"),
        ("Revolute", "Gearing", "pivot: a joint Gearing is not known here; Weld, Revolute, "),
        ("<Rotation>1.0", "<Rotation>2.0", "its Rotation is none"),
        ("<Rotation>1.0 0.0 0.0", "<Rotation>-1.0 0.0 0.0", "mirrored"),
        ("FollowerFrame", "Other", "a Revolute has 1 ends"),
        ("<Parts>", '<!DOCTYPE a [<!ENTITY b "c">]><Parts>', "is not XML"),
    ],
)
def test_what_is_wrong_is_told(tmp_path, old, new, told):
    file = pendulum(tmp_path)
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new))
    with pytest.raises(InvalidModel, match=told):
        import_simulink(file, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_part_of_negative_mass_is_lost(tmp_path):
    file = pendulum(tmp_path)
    file.write_text(file.read_text().replace("<Mass>2000</Mass>", "<Mass>-1</Mass>"))
    lost, motion = import_simulink(file, tmp_path / "out").report.of("lost")
    assert motion.element == "motion by forces"
    assert "Mass is -0.001; it must not be negative" in lost.text


def test_constraints_without_a_joint_are_refused_by_name(tmp_path):
    ties = constraint(
        "Coincident",
        "on table",
        (["stand-1"], "plane", (0, 0, 0), (0, 0, 1)),
        (["rod-1"], "point", (0, 0, 0), (0, 0, 1)),
    )
    file = pendulum(tmp_path, joints="", constraints=ties)
    with pytest.raises(
        InvalidModel, match=r"on table: its constraints \(on table\) leave freedoms"
    ):
        import_simulink(file, tmp_path / "out")
    unknown = pendulum(tmp_path, joints="", constraints=ties.replace("Coincident", "Gear"))
    with pytest.raises(InvalidModel, match="a constraint Gear is not known here; Angle, "):
        read_simulink(unknown)


def test_the_command_line_takes_them(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    pendulum(tmp_path)
    assert run_command(["check", "swing.xml"]) == 0
    assert "swing.xml:" in capsys.readouterr().out
    assert run_command(["import", "swing.xml", "--out", "out"]) == 0
    assert "simrob run out/swing.yaml" in capsys.readouterr().out
    (tmp_path / "arm.xml").write_text("<robot name='a'><link name='b'/></robot>")
    run_command(["check", "arm.xml"])
    # an XML file of another kind is a robot's
    assert "no joint that moves" in capsys.readouterr().err


def test_a_pipe_is_no_export_and_is_not_waited_for(tmp_path):
    pipe = tmp_path / "pipe.xml"
    os.mkfifo(pipe)
    assert not is_export(pipe)
