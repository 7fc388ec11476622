"""Extensions of other packages: what is found, and why one is left out while everything else works."""

import ast
import importlib
import re
import subprocess
import sys
import textwrap
from importlib.metadata import PathDistribution
from pathlib import Path

import numpy as np
import pytest

from simrob_drake import simulate
from simrob_drake.base import extension as extensions
from simrob_drake.base import messages
from simrob_drake.base.errors import InvalidConfig
from simrob_drake.base.extension import (
    BrokenExtension,
    ExtensionWarning,
    MissingExtension,
    additions,
    installed_extensions,
    load_addition,
    needed_extension,
)
from simrob_drake.base.extras import DISTRIBUTION
from simrob_drake.base.files import models_root, robot_files
from simrob_drake.base.sections import _schema_of
from simrob_drake.cli.app import load as load_command
from simrob_drake.cli.app import run_command
from simrob_drake.cli.command_table import _command_table, all_commands
from simrob_drake.parts import controllers, couplings, forces, monitors, references, sensors
from simrob_drake.programs.gaits import registry as gaits
from simrob_drake.programs.moves.kinds import check_move
from simrob_drake.results.plots.own import save_plots
from simrob_drake.robots.gaits_file import GaitsFile
from simrob_drake.stations.load import load_station, station_yaml
from simrob_drake.stations.schema import station_schema
from simrob_drake.stations.solver_config import SOLVERS

SENSOR = """
from typing import Literal
from simrob_drake.parts.sensors.sensor import Sensor
class Warmth(Sensor):
    kind: Literal["warmth"]
    def wire(self, builder, site, name):
        pass
"""
PARTS = "simrob_drake.parts.sensors.sensor.Sensor"


FAMILIES = (sensors, monitors, references, forces, couplings, controllers)


def forget_extensions():
    """Look for extensions anew, and forget all that was made of those found before."""
    installed_extensions.cache_clear()
    all_commands.cache_clear()
    for family in FAMILIES:
        family.KINDS.forget_extensions()
    SOLVERS.forget_extensions()
    for module in (
        "robots",
        "checking",
        "exporting",
    ):  # their commands have options of importers and exporters
        sys.modules.pop(f"simrob_drake.cli.{module}", None)
    _schema_of.cache_clear()


@pytest.fixture
def install(tmp_path, monkeypatch):
    """Install extensions: a name, the arguments of `Extension`, and modules.

    Each is announced by a package of its own name, or by the ``package`` that is named.
    """
    monkeypatch.syspath_prepend(tmp_path)
    distributions = []

    def found(*, group):
        entries = [entry for distribution in distributions for entry in distribution.entry_points]
        return [entry for entry in entries if entry.group == group]

    monkeypatch.setattr(extensions, "entry_points", found)

    def install_one(name, arguments, package="", **modules):
        module = name.replace("-", "_")
        for loaded in (module, *(f"{module}.{file}" for file in modules)):
            monkeypatch.delitem(sys.modules, loaded, raising=False)
        text = f"from simrob_drake import Extension\nEXTENSION = Extension({arguments})\n"
        folder = tmp_path / module
        folder.mkdir()
        (folder / "__init__.py").write_text(text)
        for file, content in modules.items():
            (folder / f"{file}.py").write_text(textwrap.dedent(content))
        information = tmp_path / f"{module}-1.0.dist-info"
        information.mkdir()
        (information / "METADATA").write_text(
            f"Metadata-Version: 2.1\nName: {package or name}\nVersion: 1.0\n"
        )
        entry = f"[simrob_drake.extensions]\n{module} = {module}:EXTENSION\n"
        (information / "entry_points.txt").write_text(entry)
        distributions.append(PathDistribution(information))
        forget_extensions()

    yield install_one
    forget_extensions()


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
    install(
        "late-kit",
        "core='>=0', moves={'wave': 'late_kit.moves:Wave'}",
        moves="raise RuntimeError('too early')",
    )
    assert set(additions("moves")) == {"wave"}
    assert "late_kit.moves" not in sys.modules


def test_an_unknown_kind_lists_those_of_extensions_too(install):
    install("warm-kit", "core='>=0', sensors={'warmth': 'warm_kit.parts:Warmth'}", parts=SENSOR)
    with pytest.raises(InvalidConfig, match="warmth"):
        load_station("box_on_floor", {"sensors": {"a": {"kind": "warmht"}}})


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        ("core='>=99'", "it needs simrob_drake >=99, but version 0.1.0 is installed"),
        ("core='soon'", "core is 'soon'; it must be a version specifier such as '>=0.1,<0.3'"),
        (
            "core='>=0', sensors={'warmth': 'kit.a'}",
            "kind of sensor 'warmth' is 'kit.a'; it must be an import string 'package.module:Name'",
        ),
        (
            "core='>=0', odours={}",
            "cannot be imported: TypeError: Extension.__init__() got an unexpected keyword",
        ),
        ("1/0", "cannot be imported: ZeroDivisionError"),
        (
            "core='>=0', sensors=['warmth']",
            "TypeError: sensors is ['warmth']; it must be a mapping of names to import",
        ),
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
def test_a_name_of_the_core_stays_the_cores_and_the_list_says_so(
    install, capsys, point, name, described
):
    install("odd-kit", f"core='>=0', {point}={{'{name}': 'odd_kit.parts:Mine'}}")

    assert run_command(["extensions"]) == 0

    shown = " ".join(capsys.readouterr().out.split())
    assert f"broken: {described} already exists in simrob-drake; choose another name" in shown
    assert name not in additions(point)


def test_a_name_that_two_packages_have_names_both(install):
    install("a-kit", "core='>=0', sensors={'warmth': 'a_kit.parts:Warmth'}", parts=SENSOR)
    install("b-kit", "core='>=0', sensors={'warmth': 'b_kit.parts:Warmth'}", parts=SENSOR)

    assert problem_of("a-kit") == ""
    assert (
        problem_of("b-kit")
        == "the kind of sensor 'warmth' already belongs to package a-kit, extension a_kit"
    )


def test_a_part_that_cannot_be_imported_is_blamed_on_its_package(install):
    install(
        "odd-kit",
        "core='>=0', sensors={'warmth': 'odd_kit.parts:Warmth'}",
        parts="import nothing_like_it",
    )
    with pytest.raises(
        BrokenExtension,
        match=r"extension odd_kit: odd_kit.parts:Warmth cannot be imported \(Module",
    ):
        load_addition(additions("sensors")["warmth"])
    with pytest.raises(
        InvalidConfig, match=r"sensors.warmth: package odd-kit, extension odd_kit: odd_kit.parts:W"
    ):
        load_station("box_on_floor", {"sensors": {"warmth": {}}})


def test_a_part_of_a_wrong_class_is_refused(install):
    install(
        "odd-kit", "core='>=0', sensors={'warmth': 'odd_kit.parts:Warmth'}", parts="Warmth = dict"
    )
    with pytest.raises(InvalidConfig, match=rf"must be a subclass of {re.escape(PARTS)}"):
        load_station("box_on_floor", {"sensors": {"warmth": {}}})


def test_a_station_names_the_packages_that_it_needs(install):
    with pytest.raises(
        InvalidConfig,
        match="extensions: the station needs the package warm-kit, which is not instal",
    ):
        load_station("box_on_floor", {"extensions": ["warm-kit"], "sensors": {"warmth": {}}})
    install("warm-kit", "core='>=99', sensors={'warmth': 'warm_kit.parts:Warmth'}", parts=SENSOR)
    with pytest.raises(
        InvalidConfig, match="but the extension warm_kit of warm-kit is not used: it needs"
    ):
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
    assert (
        "broken: package odd-kit, extension odd_kit: the folder odd_kit:robots does not exist"
        in shown
    )
    assert "broken: package odd-kit, extension odd_kit: odd_kit.b:B cannot be imported" in shown


def test_data_of_the_wrong_kind_are_not_called_missing(install, tmp_path, capsys):
    install(
        "odd-kit",
        "core='>=0', robots={'a': 'odd_kit:data.txt'}, other_files={'b': 'odd_kit:folder'}",
    )
    (tmp_path / "odd_kit" / "data.txt").write_text("")

    (tmp_path / "odd_kit" / "folder").mkdir()

    assert run_command(["extensions", "--check"]) == 2

    shown = " ".join(capsys.readouterr().out.split())
    assert "odd_kit:data.txt is a file; it must be a folder" in shown
    assert "odd_kit:folder is a folder; it must be a file" in shown


@pytest.mark.parametrize("assignment", ["COMMANDS", "COMMANDS: dict[str, object]"])
def test_the_table_of_commands_is_read_with_and_without_a_type(assignment):
    tree = ast.parse(f"{assignment} = {{'run': run_it, 'list': list_all}}")
    assert _command_table(tree) == {"run": "run_it", "list": "list_all"}


def test_a_table_of_commands_that_takes_in_another_one_is_refused():
    """The names in the other table are not in the source: they would be missing in the help."""
    with pytest.raises(
        ValueError, match=r"COMMANDS contains \*\*; each command must be written in the table"
    ):
        _command_table(ast.parse("COMMANDS = {'run': run_it, **OTHER}"))


def test_a_move_and_a_gait_that_cannot_be_imported_are_blamed_on_their_package(
    install, monkeypatch
):
    install(
        "odd-kit",
        "core='>=0', moves={'hover': 'odd_kit.gone:Hover'}, gaits={'hovers': 'odd_kit.gone:Hover'}",
    )

    with pytest.raises(
        BrokenExtension, match=r"extension odd_kit: odd_kit.gone:Hover cannot be imported"
    ):
        check_move({"hover": {"height": 1}})

    file = GaitsFile(Path("gaits.yaml"), 0.0, {"facing_deg": 0, "hovers": {"high": {}}})
    monkeypatch.setattr(gaits, "gaits_file", lambda _: file)

    with pytest.raises(
        BrokenExtension, match=r"extension odd_kit: odd_kit.gone:Hover cannot be imported"
    ):
        gaits.load_gaits("roid1")


def test_a_move_whose_key_is_not_its_announced_name_is_refused(install):
    waits = "from simrob_drake.programs.moves.wait import WaitMove as Hover"
    install("odd-kit", "core='>=0', moves={'hover': 'odd_kit.moves:Hover'}", moves=waits)
    with pytest.raises(BrokenExtension, match=r"has the key 'wait', but is announced as 'hover'"):
        check_move({"hover": {"duration": 1}})


def test_a_robot_whose_name_is_taken_is_reported_and_the_cores_is_used(install, tmp_path, capsys):
    install("odd-kit", "core='>=0', robots={'mine': 'odd_kit:robots'}")
    for name in ("irb120", "irb12000"):
        folder = tmp_path / "odd_kit" / "robots" / name
        folder.mkdir(parents=True)
        (folder / "robot.yaml").write_text("description: mine")

    assert run_command(["extensions"]) == 0

    shown = " ".join(capsys.readouterr().out.split())
    assert "broken: 'irb120' of its robots cannot be used: another one has this name" in shown
    assert robot_files()["irb120"].is_relative_to(models_root())
    assert robot_files()["irb12000"].is_relative_to(tmp_path)
    assert list(robot_files()) == sorted(robot_files())


def test_a_folder_in_a_package_that_is_missing_is_no_folder(install, capsys):
    install("odd-kit", "core='>=0', stations={'a': 'nothing.like_it:stations'}")

    assert load_station("box_on_floor").name == "box_on_floor"
    assert run_command(["extensions", "--check"]) == 2
    assert "the folder nothing.like_it:stations does not exist" in " ".join(
        capsys.readouterr().out.split()
    )


WOBBLE = """
import numpy as np
from simrob_drake.results.verdict.verdict import Criterion, Measured
def _wobble(run):
    heights = run["piece.box.z"] if "piece.box.z" in run.names else None
    if heights is None:
        return None
    return Measured(["box"], np.array([np.ptp(heights)]))
WOBBLE = Criterion("wobble", "m", "wobble", "{of} wobbled by {value}", _wobble, default_bound=1e-9)
"""


def test_a_measure_of_an_extension_is_judged_by_its_own_bound_or_that_of_the_station(install):
    install(
        "wobble-kit", "core='>=0', measures={'wobble': 'wobble_kit.verdict:WOBBLE'}", verdict=WOBBLE
    )
    station = load_station("box_on_floor", {"duration": 0.1})

    measure = simulate(station, progress=False).verdict["wobble"]

    assert measure.worst.subject == "box"
    assert measure.worst.bound == 1e-9

    bounded = simulate(
        load_station("box_on_floor", {"duration": 0.1, "verdict.wobble": 0.05}), progress=False
    )
    assert bounded.verdict["wobble"].worst.bound == 0.05
    assert bounded.verdict["wobble"].worst.value == np.ptp(bounded["piece.box.z"])
    assert "wobble: 0.05" in station_yaml(bounded.config)
    assert "wobble" in station_schema()["$defs"]["VerdictConfig"]["properties"]
    with pytest.raises(InvalidConfig, match=r"verdict.woble: unknown key; did you mean 'wobble'"):
        load_station("box_on_floor", {"verdict": {"woble": 1.0}})


def test_a_measure_of_an_extension_has_words_in_other_languages(install, tmp_path):
    messages._catalogue_file.cache_clear()
    content = WOBBLE.replace("default_bound=1e-9", "default_bound=1e-9, catalogue='wobble_kit'")
    announced = "measures={'wobble': 'wobble_kit.verdict:WOBBLE'}, messages={'wobble_kit': 'wobble_kit:languages'}"
    install("wobble-kit", f"core='>=0', {announced}", verdict=content)
    folder = tmp_path / "wobble_kit" / "languages"
    folder.mkdir()
    (folder / "es.yaml").write_text(
        "wobble_kit.title_wobble: oscilación\nwobble_kit.beyond_wobble: '{of} osciló {value}'\n"
    )

    verdict = simulate(load_station("box_on_floor", {"duration": 0.1}), progress=False).verdict

    assert messages.in_language(verdict["wobble"].criterion.title_message, "es") == "oscilación"
    assert messages.in_language(verdict["wobble"].warning, "es").startswith("box osciló ")
    assert messages.in_language(verdict["wobble"].warning, "en").startswith("box wobbled by ")

    messages._catalogue_file.cache_clear()


def test_without_the_extension_the_bound_of_its_measure_is_an_unknown_key():
    with pytest.raises(InvalidConfig, match=r"verdict.wobble: unknown key"):
        load_station("box_on_floor", {"verdict": {"wobble": 1.0}})


@pytest.mark.parametrize(
    ("content", "warning"),
    [
        (
            "WOBBLE = 3",
            "extension wobble_kit: wobble_kit.verdict:WOBBLE is 3; it must be an instance of",
        ),
        (
            WOBBLE.replace('"wobble", "m"', '"wabble", "m"'),
            "has the name 'wabble', but is announced as 'wobble'",
        ),
        (
            WOBBLE.replace("np.ptp(heights)", "1 / 0"),
            "the run is not judged by wobble: ZeroDivisionError",
        ),
    ],
)
def test_a_broken_measure_warns_and_the_others_judge(install, content, warning):
    install(
        "wobble-kit",
        "core='>=0', measures={'wobble': 'wobble_kit.verdict:WOBBLE'}",
        verdict=content,
    )

    with pytest.warns(ExtensionWarning, match=re.escape(warning)):
        verdict = simulate(load_station("box_on_floor", {"duration": 0.1}), progress=False).verdict
    assert "penetration" in {measure.criterion.name for measure in verdict.measures}
    assert "wobble" not in {measure.criterion.name for measure in verdict.measures}


PLOTS = """
from simrob_drake.results.plots.own import panels
def height(run):
    figure, frames = panels("height of the box", size=(4, 3))
    frames[0, 0].plot(run.times, run["piece.box.z"], label="z [m]")
    return figure
def nothing(run):
    return None
def broken(run):
    return run["no such column"]
"""


def test_plots_of_an_extension_are_saved_with_those_of_the_run(install, tmp_path):
    added = "{'height': 'plot_kit.plots:height', 'nothing': 'plot_kit.plots:nothing'}"
    install("plot-kit", f"core='>=0', plots={added}", plots=PLOTS)
    result = simulate(load_station("box_on_floor", {"duration": 0.1}), progress=False)

    written = [file.name for file in save_plots(result, tmp_path / "plots", "svg")]

    assert written[-1] == "height.svg"
    assert "nothing.svg" not in written
    assert "height of the box" in (tmp_path / "plots/height.svg").read_text()


@pytest.mark.parametrize(
    ("name", "target", "warning"),
    [
        ("height", "plot_kit.plots:broken", "the plot height of an extension is left out"),
        (
            "height",
            "plot_kit.plots:missing",
            "extension plot_kit: plot_kit.plots:missing cannot be imported",
        ),
        (
            "piece_box",
            "plot_kit.plots:height",
            "the run has a plot of this name already: piece_box.svg",
        ),
    ],
)
def test_a_broken_plot_warns_and_the_others_are_saved(install, tmp_path, name, target, warning):
    install("plot-kit", f"core='>=0', plots={{'{name}': '{target}'}}", plots=PLOTS)
    result = simulate(load_station("box_on_floor", {"duration": 0.1}), progress=False)

    with pytest.warns(ExtensionWarning, match=re.escape(warning)):
        written = save_plots(result, tmp_path / "plots", "svg")
    assert [file.name for file in written] == ["piece_box.svg", "sensors.svg"]


def test_two_extensions_of_one_package_have_a_row_each(install, capsys):
    install(
        "warm-kit",
        "core='>=0', sensors={'warmth': 'warm_kit.parts:Warmth'}",
        package="kits",
        parts=SENSOR,
    )
    install("cold-kit", "core='>=99'", package="kits")

    assert [(found.name, found.package) for found in installed_extensions()] == [
        ("cold_kit", "kits"),
        ("warm_kit", "kits"),
    ]
    assert run_command(["extensions"]) == 0

    shown = " ".join(capsys.readouterr().out.split())
    assert (
        "cold_kit kits 1.0 left out: it needs simrob_drake >=99, but version 0.1.0 is installed"
        in shown
    )
    assert "warm_kit kits 1.0 sensors: warmth" in shown


def test_a_station_may_name_one_extension_of_a_package(install):
    install(
        "warm-kit",
        "core='>=0', sensors={'warmth': 'warm_kit.parts:Warmth'}",
        package="kits",
        parts=SENSOR,
    )
    install("cold-kit", "core='>=99'", package="kits")

    assert load_station(
        "box_on_floor", {"extensions": ["warm_kit"], "sensors": {"warmth": {}}}
    ).sensors
    with pytest.raises(
        InvalidConfig,
        match="station needs kits, but the extension cold_kit of kits is not used: it n",
    ):
        load_station("box_on_floor", {"extensions": ["kits"], "sensors": {"warmth": {}}})


COMMAND = """
def warm():
    '''Warm something.'''
    print("warm")
"""


def test_no_other_package_takes_a_name_of_ours(install):
    """Ours come first, although the name of the other package comes first in the alphabet."""
    install("a-kit", "core='>=0', commands={'warm': 'a_kit.commands:warm'}", commands=COMMAND)
    install(
        "our-kit",
        "core='>=0', commands={'warm': 'our_kit.commands:warm'}",
        package=DISTRIBUTION,
        commands=COMMAND,
    )

    assert problem_of(DISTRIBUTION) == ""
    assert (
        problem_of("a-kit")
        == "the command 'warm' already belongs to package simrob-drake, extension our_kit"
    )


def test_a_name_of_an_extension_stands_for_one_extension(install, tmp_path):
    install("warm-kit", "core='>=0'", package="b-kits")
    install("other-kit", "core='>=0'", package="c-kits")
    entry = tmp_path / "other_kit-1.0.dist-info" / "entry_points.txt"
    entry.write_text("[simrob_drake.extensions]\nwarm_kit = other_kit:EXTENSION\n")

    installed_extensions.cache_clear()

    assert problem_of("c-kits") == "package b-kits already has an extension of this name"


def test_versions_of_our_own_extensions_are_not_compared():
    """To load the package `packaging` takes a tenth of a second."""
    code = (
        "import sys; from simrob_drake.base.extension import installed_extensions; "
        "print({found.package for found in installed_extensions()}, 'packaging' in sys.modules)"
    )
    shown = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    ).stdout

    packages, is_loaded = shown.rsplit(maxsplit=1)

    assert is_loaded == str(packages != "{'simrob-drake'}")


def test_an_extension_is_left_out_where_one_that_it_needs_is_missing(install):
    install("a-kit", "core='>=0', needs=['b_kit']")
    install("b-kit", "core='>=0', needs=['c_kit']")

    assert problem_of("b-kit") == "it needs the extension c_kit, which is not installed"
    assert problem_of("a-kit") == "it needs the extension b_kit, which is left out"

    install("c-kit", "core='>=0'")
    assert [found.problem for found in installed_extensions()] == ["", "", ""]


def test_a_conflict_of_names_leaves_those_out_that_need_the_extension(install):
    install("a-kit", "core='>=0', sensors={'warmth': 'a_kit.parts:Warmth'}", parts=SENSOR)
    install("b-kit", "core='>=0', sensors={'warmth': 'b_kit.parts:Warmth'}", parts=SENSOR)

    install("c-kit", "core='>=0', needs=['b_kit']")

    assert problem_of("c-kit") == "it needs the extension b_kit, which is left out"


def test_a_function_that_needs_another_extension_says_so(install):
    install("cold-kit", "core='>=99'")

    with pytest.raises(
        MissingExtension, match=r"^simrob warm needs the extension hot_kit, which is not installed$"
    ):
        import_with_needed("hot_kit")
    with pytest.raises(
        MissingExtension,
        match="needs the extension cold_kit, which is left out: it needs simrob",
    ):
        import_with_needed("cold_kit")

    install("hot-kit", "core='>=0'")
    import_with_needed("hot_kit")


def import_with_needed(name):
    """Import an extension of another one as its commands do."""
    with needed_extension(name, "simrob warm"):
        importlib.import_module(name)


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        (
            "core='>=0', needs='b_kit'",
            "TypeError: needs is 'b_kit'; it must be a list of names of extensions",
        ),
        (
            "core='>=0', uses=[3]",
            "TypeError: uses is [3]; it must be a list of names of extensions",
        ),
        ("core='>=0', title=3", "TypeError: title is 3; it must be a text"),
        (
            "core='>=0', commands={'kit show': 'odd_kit.commands:show'}",
            "the command 'kit show' needs the command 'kit', which the extension does not have",
        ),
    ],
)
def test_a_wrong_announcement_is_left_out_with_the_reason(install, arguments, problem):
    install("odd-kit", arguments)
    assert problem in problem_of("odd-kit")


def test_an_extension_has_commands_below_a_command_under_a_title_of_its_own(install, capsys):
    commands = '''
    def kit():
        """Do things with kits."""

    def show(times: int = 1):
        """Show a kit."""
        print("kit" * times)
    '''
    announced = "{'kit': 'odd_kit.commands:kit', 'kit show': 'odd_kit.commands:show'}"

    install("odd-kit", f"core='>=0', title='Kits', commands={announced}", commands=commands)

    assert run_command(["--help"]) == 0

    shown = capsys.readouterr().out
    titles = re.findall(r"^╭─ ([\w ]+) ─", shown, re.MULTILINE)

    assert titles[-2:] == ["Kits", "Extensions"]
    assert "Do things with kits." in shown
    assert "Show a kit." not in shown
    assert run_command(["kit", "show", "--times", "2"]) == 0
    assert capsys.readouterr().out == "kitkit\n"
    assert run_command(["kit", "hide"]) == 2
    assert "there is no command 'hide'; known: show" in capsys.readouterr().err


def test_a_command_that_cannot_be_imported_is_blamed_on_its_extension(install, capsys):
    install("odd-kit", "core='>=0', commands={'warm': 'odd_kit.gone:warm'}")
    load_command(["warm"])  # the problem is reported when the command is run

    assert run_command(["warm"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(
        "simrob: package odd-kit, extension odd_kit: odd_kit.gone:warm cannot be imported (ModuleN"
    )
    assert run_command(["--help"]) == 0
    assert "A command of odd-kit, which cannot be read" in capsys.readouterr().out


@pytest.mark.parametrize("broken", ["raise RuntimeError('no card')", "raise SystemExit(3)"])
def test_a_package_above_a_command_that_raises_anything_does_not_end_the_help(
    install, tmp_path, capsys, broken
):
    install("odd-kit", "core='>=0', commands={'warm': 'odd_kit.tools.commands:warm'}")
    tools = tmp_path / "odd_kit" / "tools"
    tools.mkdir()
    (tools / "__init__.py").write_text(broken)
    (tools / "commands.py").write_text("def warm(): ...")

    load_command(["warm"])

    assert run_command(["--help"]) == 0
    assert "A command of odd-kit, which cannot be read" in capsys.readouterr().out
    assert run_command(["warm"]) == 2
    assert "odd_kit.tools.commands:warm cannot be imported" in capsys.readouterr().err


def test_an_unknown_command_may_be_one_of_an_extension_that_is_left_out(install, capsys):
    install("odd-kit", "core='>=99', commands={'warm': 'odd_kit.commands:warm'}")

    assert run_command(["warm"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("simrob: there is no command 'warm'; known: act, check, ")
    assert line.endswith(
        ". Extensions that are left out: odd_kit; simrob extensions lists the reasons."
    )


def test_an_extension_says_what_takes_its_files(install, tmp_path, capsys):
    install("odd-kit", "core='>=0', other_files={'odd': 'odd_kit:other_files.yaml'}")
    descriptions = tmp_path / "odd_kit" / "other_files.yaml"
    descriptions.write_text(
        "keys: [[[warmth], 'a kit: simrob warm {file}']]\nendings: {.kit: 'a kit: {name}'}"
    )
    kit = tmp_path / "kit.yaml"

    kit.write_text("warmth: 3")

    assert run_command(["check", str(kit)]) == 2
    assert f"{kit}: is not a station, but a kit: simrob warm {kit}\n" in capsys.readouterr().err

    (tmp_path / "a.kit").write_text("")
    assert run_command(["run", str(tmp_path / "a.kit")]) == 2
    assert "a.kit: is not a station, but a kit: a.kit\n" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("ends: {}", "ends: unknown key"),
        ("keys: 3", "keys: "),
        ("[", "other_files.yaml"),
        (None, "does not exist"),
    ],
)
def test_descriptions_of_files_that_cannot_be_read_disturb_nothing(
    install, tmp_path, capsys, text, problem
):
    install("odd-kit", "core='>=0', other_files={'odd': 'odd_kit:other_files.yaml'}")
    if text is not None:
        (tmp_path / "odd_kit" / "other_files.yaml").write_text(text)

    (tmp_path / "kit.yaml").write_text("warmth: 3")

    assert run_command(["check", str(tmp_path / "kit.yaml")]) == 2
    assert "warmth: unknown key" in capsys.readouterr().err
    assert run_command(["extensions", "--check"]) == 2

    shown = "".join(capsys.readouterr().out.split())  # a long path goes on in the next line
    assert problem.replace(" ", "") in shown


def test_an_extension_has_messages_in_other_languages(install, tmp_path, capsys):
    messages._catalogue_file.cache_clear()
    install(
        "warm-kit",
        "core='>=0', messages={'warm': 'warm_kit:languages', 'robots': 'warm_kit:languages'}",
    )
    folder = tmp_path / "warm_kit" / "languages"
    folder.mkdir()
    (folder / "es.yaml").write_text("warm.too_hot: demasiado caliente ({celsius:.1f} °C)")

    hot = messages.message("warm.too_hot", "too hot ({celsius:.1f} deg C)", celsius=80.25)

    assert messages.in_language(hot, "es") == "demasiado caliente (80,2 °C)"
    assert "robots" not in additions("messages")  # ids of the core are the core's
    assert run_command(["extensions", "--check"]) == 2
    assert "folder of messages 'robots' already exists in simrob-drake" in " ".join(
        capsys.readouterr().out.split()
    )

    install("hot-kit", "core='>=0', messages={'warm': 'hot_kit:languages'}")
    left_out = next(found for found in installed_extensions() if found.name == "warm_kit")

    assert (
        left_out.problem
        == "the folder of messages 'warm' already belongs to package hot-kit, extension hot_kit"
    )

    messages._catalogue_file.cache_clear()
