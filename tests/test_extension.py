"""Extensions of other packages: what is found, and why one is left out while everything else works."""

import re
import sys
import textwrap
from importlib.metadata import PathDistribution
from pathlib import Path

import pytest

from simrob_drake.base import extension as extensions
from simrob_drake.base.errors import InvalidConfig
from simrob_drake.base.extension import BrokenExtension, additions, installed_extensions, load_addition
from simrob_drake.base.files import models_root, robot_files
from simrob_drake.cli.app import run_command
from simrob_drake.parts import sensors
from simrob_drake.programs.gaits import registry as gaits
from simrob_drake.programs.moves.kinds import check_move
from simrob_drake.robots.gaits_file import GaitsFile
from simrob_drake.stations.load import load_station

SENSOR = """
from typing import Literal
from simrob_drake.parts.sensors.sensor import Sensor
class Warmth(Sensor):
    kind: Literal["warmth"]
    def wire(self, builder, site, name):
        pass
"""
PARTS = "simrob_drake.parts.sensors.sensor.Sensor"


@pytest.fixture
def install(tmp_path, monkeypatch):
    """Install packages that announce an extension each: a name, the arguments of `Extension`, and modules."""
    monkeypatch.syspath_prepend(tmp_path)
    distributions = []

    def found(*, group):
        entries = [entry for distribution in distributions for entry in distribution.entry_points]
        return [entry for entry in entries if entry.group == group]

    monkeypatch.setattr(extensions, "entry_points", found)

    def install_one(name, arguments, **modules):
        module = name.replace("-", "_")
        monkeypatch.delitem(sys.modules, module, raising=False)
        text = f"from simrob_drake import Extension\nEXTENSION = Extension({arguments})\n"
        package = tmp_path / module
        package.mkdir()
        (package / "__init__.py").write_text(text)
        for file, content in modules.items():
            (package / f"{file}.py").write_text(textwrap.dedent(content))
        information = tmp_path / f"{module}-1.0.dist-info"
        information.mkdir()
        (information / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
        entry = f"[simrob_drake.extensions]\n{module} = {module}:EXTENSION\n"
        (information / "entry_points.txt").write_text(entry)
        distributions.append(PathDistribution(information))
        installed_extensions.cache_clear()
        sensors.KINDS.forget_extensions()

    yield install_one
    installed_extensions.cache_clear()
    sensors.KINDS.forget_extensions()


def problem_of(package):
    (found,) = [entry for entry in installed_extensions() if entry.package == package]
    return found.problem


def test_a_sensor_of_another_package_is_a_kind_of_sensor(install):
    install("warm-kit", "core='>=0', sensors={'warmth': 'warm_kit.parts:Warmth'}", parts=SENSOR)
    assert "warmth" in sensors.KINDS
    assert sensors.KINDS.model("warmth").__name__ == "Warmth"
    station = load_station("box_on_floor", {"sensors": {"warmth": {}}})
    assert type(station.sensors["warmth"]).__name__ == "Warmth"


def test_nothing_of_a_package_is_imported_before_it_is_used(install):
    install("late-kit", "core='>=0', moves={'wave': 'late_kit.moves:Wave'}", moves="raise RuntimeError('too early')")
    assert set(additions("moves")) == {"wave"}
    assert "late_kit.moves" not in sys.modules


def test_an_unknown_kind_lists_those_of_extensions_too(install):
    install("warm-kit", "core='>=0', sensors={'warmth': 'warm_kit.parts:Warmth'}", parts=SENSOR)
    with pytest.raises(InvalidConfig, match="warmth"):
        load_station("box_on_floor", {"sensors": {"a": {"kind": "warmht"}}})


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        ("core='>=99'", "it works with simrob_drake >=99, and this is 0.1.0"),
        ("core='soon'", "core is 'soon'; it must be a version specifier such as '>=0.1,<0.3'"),
        (
            "core='>=0', sensors={'warmth': 'kit.a'}",
            "kind of sensor 'warmth' is 'kit.a'; it must be an import string 'package.module:Name'",
        ),
        ("core='>=0', odours={}", "cannot be imported: TypeError: Extension.__init__() got an unexpected keyword"),
        ("1/0", "cannot be imported: ZeroDivisionError"),
        ("core='>=0', sensors=['warmth']", "TypeError: sensors is ['warmth']; it must be a mapping of names to import"),
        ("core=1", "TypeError: core is 1; it must be a version specifier"),
        ("core=exit()", "cannot be imported: SystemExit"),
    ],
)
def test_an_extension_that_cannot_be_used_is_left_out_with_the_reason(install, arguments, problem):
    install("odd-kit", arguments)
    assert problem in problem_of("odd-kit")
    assert "\n" not in problem_of("odd-kit")
    assert load_station("box_on_floor").name == "box_on_floor"  # all else works


@pytest.mark.parametrize(
    ("point", "name", "described"),
    [
        ("commands", "run", "the command 'run'"),
        ("sensors", "force", "the kind of sensor 'force'"),
        ("monitors", "fall", "the kind of monitor 'fall'"),
        ("references", "hold", "the kind of reference 'hold'"),
        ("forces", "push", "the kind of force 'push'"),
        ("couplings", "gear", "the kind of coupling 'gear'"),
        ("controllers", "balance", "the kind of controller 'balance'"),
        ("moves", "walk", "the kind of move 'walk'"),
        ("gaits", "trots", "the kind of gait 'trots'"),
        ("inverse_kinematics", "auto", "the solver of inverse kinematics 'auto'"),
    ],
)
def test_a_name_of_the_core_stays_the_cores_and_the_list_says_so(install, capsys, point, name, described):
    install("odd-kit", f"core='>=0', {point}={{'{name}': 'odd_kit.parts:Mine'}}")
    assert run_command(["extensions"]) == 0
    shown = " ".join(capsys.readouterr().out.split())
    assert f"broken: {described} is one of simrob-drake already; choose another name" in shown
    assert name not in additions(point)


def test_a_name_that_two_packages_have_names_both(install):
    install("a-kit", "core='>=0', sensors={'warmth': 'a_kit.parts:Warmth'}", parts=SENSOR)
    install("b-kit", "core='>=0', sensors={'warmth': 'b_kit.parts:Warmth'}", parts=SENSOR)
    assert problem_of("a-kit") == ""
    assert problem_of("b-kit") == "the kind of sensor 'warmth' is also one of package a-kit, extension a_kit"


def test_a_part_that_cannot_be_imported_is_blamed_on_its_package(install):
    install("odd-kit", "core='>=0', sensors={'warmth': 'odd_kit.parts:Warmth'}", parts="import nothing_like_it")
    with pytest.raises(BrokenExtension, match=r"extension odd_kit: odd_kit.parts:Warmth cannot be imported \(Module"):
        load_addition(additions("sensors")["warmth"])
    with pytest.raises(InvalidConfig, match=r"sensors.warmth: package odd-kit, extension odd_kit: odd_kit.parts:W"):
        load_station("box_on_floor", {"sensors": {"warmth": {}}})


def test_a_part_of_a_wrong_class_is_refused(install):
    install("odd-kit", "core='>=0', sensors={'warmth': 'odd_kit.parts:Warmth'}", parts="Warmth = dict")
    with pytest.raises(InvalidConfig, match=rf"must be a subclass of {re.escape(PARTS)}"):
        load_station("box_on_floor", {"sensors": {"warmth": {}}})


def test_a_station_names_the_packages_that_it_needs(install):
    with pytest.raises(InvalidConfig, match="extensions: the station needs the package warm-kit, which is not instal"):
        load_station("box_on_floor", {"extensions": ["warm-kit"], "sensors": {"warmth": {}}})
    install("warm-kit", "core='>=99', sensors={'warmth': 'warm_kit.parts:Warmth'}", parts=SENSOR)
    with pytest.raises(InvalidConfig, match="and the extension warm_kit of warm-kit is left out: it works"):
        load_station("box_on_floor", {"extensions": ["warm-kit"], "sensors": {"warmth": {}}})


def test_the_command_lists_them_and_checks_what_they_add(install, capsys):
    assert run_command(["extensions"]) == 0
    assert "no extensions are installed" in capsys.readouterr().out
    install("warm-kit", "core='>=0', sensors={'warmth': 'warm_kit.parts:Warmth'}", parts=SENSOR)
    assert run_command(["extensions", "--check"]) == 0
    assert "sensors: warmth" in capsys.readouterr().out
    install("odd-kit", "core='>=0', robots={'a': 'odd_kit:robots'}, moves={'b': 'odd_kit.b:B'}")
    assert run_command(["extensions"]) == 0
    assert "broken" not in capsys.readouterr().out  # nothing is imported for a list
    assert run_command(["extensions", "--check"]) == 2
    shown = " ".join(capsys.readouterr().out.split())
    assert "broken: package odd-kit, extension odd_kit: there is no folder odd_kit:robots" in shown
    assert "broken: package odd-kit, extension odd_kit: odd_kit.b:B cannot be imported" in shown


def test_a_move_and_a_gait_that_cannot_be_imported_are_blamed_on_their_package(install, monkeypatch):
    install("odd-kit", "core='>=0', moves={'hover': 'odd_kit.gone:Hover'}, gaits={'hovers': 'odd_kit.gone:Hover'}")
    with pytest.raises(BrokenExtension, match=r"extension odd_kit: odd_kit.gone:Hover cannot be imported"):
        check_move({"hover": {"height": 1}})
    file = GaitsFile(Path("gaits.yaml"), 0.0, {"facing_deg": 0, "hovers": {"high": {}}})
    monkeypatch.setattr(gaits, "gaits_file", lambda _: file)
    with pytest.raises(BrokenExtension, match=r"extension odd_kit: odd_kit.gone:Hover cannot be imported"):
        gaits.load_gaits("roid1")


def test_a_move_whose_key_is_not_its_announced_name_is_refused(install):
    waits = "from simrob_drake.programs.moves.wait import WaitMove as Hover"
    install("odd-kit", "core='>=0', moves={'hover': 'odd_kit.moves:Hover'}", moves=waits)
    with pytest.raises(BrokenExtension, match=r"has the key 'wait', and is announced as 'hover'"):
        check_move({"hover": {"duration": 1}})


def test_a_robot_whose_name_is_taken_is_reported_and_the_cores_is_used(install, tmp_path, capsys):
    install("odd-kit", "core='>=0', robots={'mine': 'odd_kit:robots'}")
    for name in ("irb120", "irb12000"):
        folder = tmp_path / "odd_kit" / "robots" / name
        folder.mkdir(parents=True)
        (folder / "robot.yaml").write_text("description: mine")
    assert run_command(["extensions"]) == 0
    assert "broken: 'irb120' of its robots is hidden by another one of this name" in capsys.readouterr().out
    assert robot_files()["irb120"].is_relative_to(models_root())
    assert robot_files()["irb12000"].is_relative_to(tmp_path)
    assert list(robot_files()) == sorted(robot_files())


def test_a_folder_in_a_package_that_is_missing_is_no_folder(install, capsys):
    install("odd-kit", "core='>=0', stations={'a': 'nothing.like_it:stations'}")
    assert load_station("box_on_floor").name == "box_on_floor"
    assert run_command(["extensions", "--check"]) == 2
    assert "there is no folder nothing.like_it:stations" in " ".join(capsys.readouterr().out.split())


def test_two_extensions_of_one_package_have_a_row_each(install, tmp_path, capsys):
    install("warm-kit", "core='>=0', sensors={'warmth': 'warm_kit.parts:Warmth'}", parts=SENSOR)
    install("cold-kit", "core='>=99'")
    for package in ("warm", "cold"):  # both entries as of one distribution
        file = tmp_path / f"{package}_kit-1.0.dist-info" / "METADATA"
        file.write_text("Metadata-Version: 2.1\nName: kits\nVersion: 1.0\n")
    installed_extensions.cache_clear()
    assert run_command(["extensions"]) == 0
    shown = capsys.readouterr().out
    assert shown.count("kits ") == 2
    assert "sensors: warmth" in shown
    assert shown.count("left out: it works with simrob_drake >=99") == 1
