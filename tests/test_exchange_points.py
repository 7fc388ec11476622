"""Engines, importers and exporters of other packages: what they can do, and what is said of those that are wrong."""

import re
import sys

import pytest

from simrob_drake import load_station, simulate
from simrob_drake.base.errors import InvalidConfig, SimrobError
from simrob_drake.base.extension import BrokenExtension, additions
from simrob_drake.cli.app import run_command
from simrob_drake.importer.importing import import_robot, robot_from_file
from tests.test_extension import install  # noqa: F401  # a fixture

ENGINE = """
from typing import ClassVar, Literal
import numpy as np
from pydrake.common.value import Value
from pydrake.math import RigidTransform
from pydrake.multibody.plant import ExternallyAppliedSpatialForce
from pydrake.systems.framework import LeafSystem
from simrob_drake.parts.engine import Engine
from simrob_drake.stations.other_engine import OtherEngine

class Falling(OtherEngine):
    answers: ClassVar[Engine] = Engine(name="", holds_joint_limits=True, puts_friction_in_actuators=False,
        has_friction_of_joints=True)
    kind: Literal["falling"]
    def plant_block(self, station, plant):
        return Block(station, plant)

class Block(LeafSystem):
    '''One free body that falls: symplectic Euler.'''
    def __init__(self, station, plant):
        super().__init__()
        self.set_name("plant")
        self.plant = plant.plant
        self.step, self.gravity = station.engine.time_step, station.config.gravity
        start = self.plant.GetPositionsAndVelocities(self.plant.CreateDefaultContext())
        self.nq = self.plant.num_positions()
        motion = self.DeclareDiscreteState(start)
        self.outputs = {"state": int(motion)}
        self.DeclareStateOutputPort("state", motion)
        self.DeclareAbstractOutputPort("poses", Value[list[RigidTransform]], lambda context, output: None)
        self.DeclareAbstractInputPort("spatial", Value[list[ExternallyAppliedSpatialForce]]())
        self.DeclareVectorInputPort("generalized", self.plant.num_velocities())
        self.DeclarePeriodicDiscreteUpdateEvent(self.step, 0.0, self.update)

    def update(self, context, values):
        state = context.get_discrete_state(0).value().copy()
        state[-1] -= self.gravity * self.step
        state[self.nq - 1] += state[-1] * self.step
        values.set_value(0, state)

    def get_state_output_port(self): return self.GetOutputPort("state")
    def get_body_poses_output_port(self): return self.GetOutputPort("poses")
    def get_contact_results_output_port(self): raise NotImplementedError
    def get_actuation_input_port(self, instance): raise NotImplementedError
    def get_desired_state_input_port(self, instance): raise NotImplementedError
    def get_net_actuation_output_port(self, instance): raise NotImplementedError
    def get_applied_spatial_force_input_port(self): return self.GetInputPort("spatial")
    def get_applied_generalized_force_input_port(self): return self.GetInputPort("generalized")
    def GetPositions(self, context): return context.get_discrete_state(0).value()[: self.nq]
    def GetVelocities(self, context): return context.get_discrete_state(0).value()[self.nq :]
    def SetPositions(self, context, q): context.SetDiscreteState(0, np.concatenate([q, self.GetVelocities(context)]))
    def SetVelocities(self, context, v): context.SetDiscreteState(0, np.concatenate([self.GetPositions(context), v]))
"""
BALL = """
name: falling_ball
pieces: {ball: {free: true, pose: [0, 0, 0.16, 0, 0, 0]}}
solver: {kind: falling, time_step: 0.01}
"""


@pytest.fixture
def announce(install):  # noqa: F811
    """Install a package whose modules may have the names of another test's."""

    def announce_one(name, arguments, **modules):
        for known in [
            module for module in sys.modules if module.startswith(f"{name.replace('-', '_')}.")
        ]:
            del sys.modules[known]  # of another test
        install(name, f"core='>=0', {arguments}", **modules)

    return announce_one


@pytest.fixture
def ball(tmp_path):
    """File of a station with one free ball, which the engine `falling` moves."""
    file = tmp_path / "falling_ball.yaml"
    file.write_text(BALL)
    return file


def test_an_engine_of_another_package_moves_a_station(announce, ball):
    """Symplectic Euler of a fall from rest: after n steps of h, v = -g n h and z falls by g h² n (n + 1) / 2."""
    announce("fall-kit", "engines={'falling': 'fall_kit.engine:Falling'}", engine=ENGINE)
    station = load_station(ball)

    assert station.engine.name == "falling"
    assert station.engine.time_step == 0.01
    assert not station.engine.steps_drakes_plant

    result = simulate(station, duration=0.2, progress=False)
    fallen = result.piece_pose("ball")[:, 2]

    count = 20

    assert fallen[0] - fallen[-1] == pytest.approx(
        9.80665 * 0.01**2 * count * (count + 1) / 2, rel=1e-9
    )


@pytest.mark.parametrize(
    ("module", "message"),
    [
        (
            ENGINE.replace("    def plant_block", "    def block"),
            r"fall_kit.engine:Falling lacks plant_block",
        ),
        ("Falling = dict", r"must be a subclass of simrob_drake.stations.other_engine.OtherEngine"),
        ("1 / 0", r"fall_kit.engine:Falling cannot be imported \(ZeroDivisionError"),
    ],
)
def test_an_engine_that_cannot_be_used_is_one_line_about_its_package(
    announce, ball, module, message
):
    announce("fall-kit", "engines={'falling': 'fall_kit.engine:Falling'}", engine=module)

    with pytest.raises(SimrobError, match=message) as raised:
        load_station(ball)
    assert "package fall-kit" in str(raised.value)
    assert "\n" not in str(raised.value)


def test_a_block_that_lacks_a_method_of_the_plant_is_named(announce, ball):
    lacking = ENGINE.replace("def GetVelocities", "def Velocities").replace(
        "def SetPositions", "def Positions"
    )
    announce("fall-kit", "engines={'falling': 'fall_kit.engine:Falling'}", engine=lacking)
    with pytest.raises(
        BrokenExtension,
        match="falling: the block Block lacks GetVelocities, SetPositions, see PlantBlock",
    ):
        simulate(load_station(ball), duration=0.1, progress=False)


def test_the_engine_of_a_missing_extension_is_named(announce):
    """Only the fake packages are installed here, so that ours are missing."""
    announce("fall-kit", "engines={}")
    with pytest.raises(
        InvalidConfig, match=r"solver.* needs the extension mujoco, which is not installed"
    ):
        load_station("bouncing_ball", {"solver": {"kind": "mujoco"}})
    with pytest.raises(InvalidConfig, match=r"solver.kind: there is no 'mujok'"):
        load_station("bouncing_ball", {"solver": {"kind": "mujok"}})


@pytest.mark.parametrize(
    ("name", "text", "provider"),
    [
        ("arm.xml", "<!-- a comment --><mujoco model='arm'/>", "mujoco"),
        ("arm.mjcf", "<mujoco/>", "mujoco"),
        ("model.slx", "PK", "simulink"),
        ("assembly.xml", "<SimscapeMultibodyImportXML/>", "simulink"),
        ("Module.mod", "MODULE A ENDMODULE", "rapid"),
    ],
)
def test_a_file_of_a_missing_extension_says_which(announce, tmp_path, capsys, name, text, provider):
    announce("fall-kit", "engines={}")
    file = tmp_path / name

    file.write_text(text)

    for command in (["import", str(file)], ["check", str(file)]):
        assert run_command(command) == 2
        line = capsys.readouterr().err
        assert f"needs the extension {provider}, which is not installed" in line
        assert line.count("\n") == 1


def test_a_format_of_a_missing_extension_says_which(announce, tmp_path, capsys):
    announce("fall-kit", "engines={}")

    assert run_command(["export", "box_on_floor", "--mjcf", str(tmp_path / "box.xml")]) == 2
    line = capsys.readouterr().err
    assert "the format mjcf needs the extension mujoco, which is not installed" in line
    assert line.count("\n") == 1


ROBOT_IMPORTER = """
import xml.etree.ElementTree as ET
from simrob_drake.importer.importer import RobotImporter

class Sticks(RobotImporter):
    '''Files <sticks><stick length=""/>...</sticks>: a chain of sticks that turn about y.'''
    title = "a file of sticks"
    def robot_element(self, root, path, options, report):
        robot = ET.Element("robot", name="sticks")
        ET.SubElement(robot, "link", name="base")
        parent, height = "base", 0.0
        for number, stick in enumerate(root.iter("stick")):
            length = float(stick.get("length", 1.0))
            link = ET.SubElement(robot, "link", name=f"stick_{number}")
            inertial = ET.SubElement(link, "inertial")
            ET.SubElement(inertial, "origin", xyz=f"0 0 {length / 2}")
            ET.SubElement(inertial, "mass", value=str(length))
            moment = str(length**3 / 12)
            ET.SubElement(inertial, "inertia", ixx=moment, iyy=moment, izz="1e-3", ixy="0", ixz="0", iyz="0")
            joint = ET.SubElement(robot, "joint", name=f"joint_{number}", type="revolute")
            ET.SubElement(joint, "parent", link=parent)
            ET.SubElement(joint, "child", link=f"stick_{number}")
            ET.SubElement(joint, "origin", xyz=f"0 0 {height}")
            ET.SubElement(joint, "axis", xyz="0 1 0")
            ET.SubElement(joint, "limit", lower="-1", upper="1", effort="10", velocity="3")
            parent, height = f"stick_{number}", length
        report.add("approximated", "", "sticks are thin")
        return robot
"""


def test_a_robot_importer_serves_import_check_and_stations(announce, tmp_path, capsys):
    keys = dict.fromkeys(("<sticks>", ".sticks"), "stick_kit.a:Sticks")
    announce("stick-kit", f"importers={keys}", a=ROBOT_IMPORTER)
    file = tmp_path / "source" / "two.sticks"
    file.parent.mkdir()
    file.write_text("<sticks><stick length='0.5'/><stick length='0.25'/></sticks>")

    imported = import_robot(file, tmp_path / "robot")
    assert list(imported.model.axes) == ["joint_0", "joint_1"]
    assert imported.report.of("approximated")[0].text == "sticks are thin"
    assert list(robot_from_file(file).axes) == ["joint_0", "joint_1"]

    assert run_command(["check", str(file)]) == 0
    assert "joint_1" in capsys.readouterr().out
    assert run_command(["import", str(file), "--out", str(tmp_path / "again")]) == 0
    assert (tmp_path / "again" / "robot.yaml").is_file()


FILE_IMPORTER = """
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated
import typer
from simrob_drake.importer.importer import FileImporter, ImportOutcome

@dataclass(frozen=True)
class Options:
    colour: Annotated[str, typer.Option(help="A colour.")] = "red"

class Lists(FileImporter):
    title = "a list"
    options_class = Options
    def import_file(self, file, request):
        {body}
"""


def test_a_file_importer_has_own_options_and_losses_give_four(
    announce, tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    body = "return ImportOutcome(lines=(f'colour {request.options.colour}, {request.out}',), losses=('a', 'b'))"
    announce(
        "list-kit", "importers={'.lst': 'list_kit.a:Lists'}", a=FILE_IMPORTER.format(body=body)
    )
    (tmp_path / "my.lst").write_text("")

    (tmp_path / "arm.urdf").write_text("<robot/>")

    assert run_command(["import", "my.lst", "--colour", "blue", "--out", "there"]) == 4
    shown = capsys.readouterr()
    assert "colour blue, there" in shown.out
    assert "lost: a\nlost: b\n" in shown.err
    assert run_command(["import", "my.lst", "--allow-losses"]) == 0

    capsys.readouterr()
    for command, message in (
        (
            ["import", "arm.urdf", "--colour", "blue"],
            "--colour: the option belongs to a list; leave it out",
        ),
        (
            ["import", "my.lst", "--base", "fixed"],
            "--base: the option has no effect on a list; leave it out",
        ),
        (
            ["import", "my.lst", "--set", "a=1"],
            "--set: the option has no effect on a list; leave it out",
        ),
        (
            ["import", "my.lst", "--cycles", "2"],
            "--cycles: the option belongs to RAPID modules; leave it out",
        ),
        (
            ["check", "my.lst"],
            "my.lst: is a list, which `simrob check` cannot read; use `simrob import`",
        ),
    ):
        assert run_command(command) == 2
        line = capsys.readouterr().err
        assert message in line
        assert line.count("\n") == 1


def test_importers_of_equal_title_have_their_own_options(announce, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    coloured = FILE_IMPORTER.format(body="return ImportOutcome(lines=(request.options.colour,))")
    sized = coloured.replace("colour", "size").replace("red", "small")
    keys = {".lst": "list_kit.a:Lists", ".lis": "list_kit.b:Lists"}

    announce("list-kit", f"importers={keys}", a=coloured, b=sized)

    for name, option, other in (("my.lst", "--colour", "--size"), ("my.lis", "--size", "--colour")):
        (tmp_path / name).write_text("")
        assert run_command(["import", name, option, "new"]) == 0
        assert capsys.readouterr().out == "new\n"
        assert run_command(["import", name, other, "new"]) == 2
        assert f"{other}: the option belongs to a list; leave it out" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("module", "message"),
    [
        (
            FILE_IMPORTER.format(body="return 1 / 0"),
            "list_kit: the importer of .lst fails (ZeroDivisionError",
        ),
        (
            FILE_IMPORTER.format(body="raise SystemExit(3)"),
            "list_kit: the importer of .lst fails (SystemExit: 3)",
        ),
        (
            FILE_IMPORTER.replace("import_file", "importing").format(body="pass"),
            "lacks import_file, which Importer requires",
        ),
        ("class Lists: pass", "it must be a subclass of simrob_drake.importer.importer.Importer"),
    ],
)
def test_a_wrong_importer_is_one_line_about_its_package(
    announce, tmp_path, monkeypatch, capsys, module, message
):
    monkeypatch.chdir(tmp_path)
    announce("list-kit", "importers={'.lst': 'list_kit.a:Lists'}", a=module)

    (tmp_path / "my.lst").write_text("")

    assert run_command(["import", "my.lst"]) == 2
    line = capsys.readouterr().err
    assert message in line
    assert "package list-kit" in line
    assert line.count("\n") == 1


@pytest.mark.parametrize(
    ("point", "name", "described"),
    [
        ("importers", ".urdf", "the importer of '.urdf'"),
        ("importers", "<robot>", "the importer of '<robot>'"),
        ("engines", "discrete", "the engine 'discrete'"),
        ("exporters", "force", "the exporter to 'force'"),
    ],
)
def test_a_name_of_the_core_stays_the_cores(announce, capsys, point, name, described):
    announce("odd-kit", f"{point}={{'{name}': 'odd_kit.parts:Mine'}}")

    assert run_command(["extensions"]) == 0

    shown = " ".join(capsys.readouterr().out.split())
    assert f"broken: {described} already exists in simrob-drake; choose another name" in shown
    assert name not in additions(point)


EXPORTERS = """
from simrob_drake.programs.exporter import ExportedTexts, ProgramExporter, StationExporter

class Names(StationExporter):
    help = "Names of axes, FILE.txt."
    suffix = ".txt"
    def export_station(self, config, file, options, *, force):
        file.write_text(config.name)
        return [file]

class Fails(StationExporter):
    def export_station(self, config, file, options, *, force):
        raise KeyError("speed")

class Lacks(StationExporter):
    def export(self): pass

class Counts(ProgramExporter):
    def program_texts(self, program, config, file, options, *, source):
        return ExportedTexts({file: f"{len(program.moves)} moves of {source}"}, ("no speeds",))
"""


def test_exporters_of_another_package_write_stations_and_programs(
    announce, tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    added = {
        name: f"text_kit.a:{name.capitalize()}" for name in ("names", "fails", "lacks", "counts")
    }

    announce("text-kit", f"exporters={added}", a=EXPORTERS)

    assert run_command(["export", "box_on_floor", "--names", "box.txt"]) == 0
    assert (tmp_path / "box.txt").read_text() == "box_on_floor"

    program = tmp_path / "two.yaml"
    program.write_text(
        "station: irb120_kinematic\nmoves: [{wait: {duration: 0.1}}, {wait: {duration: 0.1}}]\n"
    )

    assert run_command(["export", "two.yaml", "--counts", "two.out"]) == 0
    assert (tmp_path / "two.out").read_text() == "2 moves of two.yaml"
    assert "no speeds" in capsys.readouterr().out
    for command, message in (
        (
            ["box_on_floor", "--names", "box.txt"],
            "box.txt exists already; choose another file or",
        ),
        (
            ["box_on_floor", "--names", "box.csv"],
            "--names is box.csv; it must be a file that ends in .txt",
        ),
        (
            ["box_on_floor", "--fails", "a"],
            "extension text_kit: the exporter fails fails (KeyError: 'speed')",
        ),
        (
            ["box_on_floor", "--lacks", "a"],
            "text_kit.a:Lacks lacks export_station, which Exporter requires",
        ),
        (
            ["box_on_floor", "--counts", "a"],
            "box_on_floor: is not a program; only programs can be exported with --counts",
        ),
        (
            ["box_on_floor"],
            "called without a format; it must be called with --names or --fails, or --counts",
        ),
        (
            ["box_on_floor", "--names", "a.txt", "--counts", "b"],
            "called with formats of stations and formats of programs",
        ),
    ):
        assert run_command(["export", *command]) == 2
        line = capsys.readouterr().err
        assert message in line
        assert line.count("\n") == 1


TAGGED = (
    EXPORTERS
    + """
from dataclasses import dataclass
from typing import Annotated
import typer

@dataclass(frozen=True)
class Options:
    first_line: Annotated[str, typer.Option(help="The first line.")] = ""

class Tagged(Names):
    options_class = Options
"""
)


def test_a_refused_option_of_an_exporter_names_the_format_as_it_is_typed(
    announce, tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    announce(
        "text-kit",
        "exporters={'with_tag': 'text_kit.a:Tagged', 'names': 'text_kit.a:Names'}",
        a=TAGGED,
    )
    for options, message in (
        (
            ["--names", "box.txt", "--first-line", "a"],
            "--first-line: the option belongs to --with-tag; leave it out",
        ),
        (["--with-tag", "box.csv"], "--with-tag is box.csv; it must be a file that ends in .txt"),
        ([], "it must be called with --with-tag or --names"),
    ):
        assert run_command(["export", "box_on_floor", *options]) == 2
        assert message in capsys.readouterr().err


def test_the_help_of_export_lists_the_formats_of_installed_extensions(announce, capsys):
    announce(
        "text-kit",
        "exporters={'names': 'text_kit.a:Names', 'lacks': 'text_kit.a:Lacks'}",
        a=EXPORTERS,
    )

    assert run_command(["export", "--help"]) == 0

    shown = " ".join(re.sub("[│╭╮╰╯─]", " ", capsys.readouterr().out).split())
    assert "--names FILE Names of axes, FILE.txt." in shown
    assert "Cannot be used: package text-kit, extension text_kit: text_kit.a:Lacks" in shown
