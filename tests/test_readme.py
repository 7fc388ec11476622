"""What README and docs say is so: their scripts, stations, commands and links.

Every block of Python is a script of its own. Every block of YAML tells in its first line what it is: ``station.yaml``,
``robot.yaml``, ``piece.yaml``, ``program.yaml``, ``study.yaml``, ``task.yaml`` or ``lesson.yaml``, or what is changed
in a station of the package: ``# irb120_dynamic.yaml, changed``. The commands of a block run one after the other.
"""

import re
import shlex
import shutil
import tomllib
from collections.abc import Callable
from pathlib import Path

import pytest

from simrob_drake import Program, load_station, station_names
from simrob_drake.base.folders import CACHE_VARIABLE
from simrob_drake.base.yaml_files import parse_yaml
from simrob_drake.cli.app import run_command, whole_command
from simrob_drake.extensions.pendant.tours import tours
from simrob_drake.extensions.rapid.signals import Signals
from simrob_drake.extensions.tuning.study import Study
from simrob_drake.results.animation.robot_view import RobotView
from simrob_drake.robots.catalog import load_robot_file, robot_names
from simrob_drake.robots.pieces import described_piece, with_mass_properties
from simrob_drake.stations.checks import check_station

ROOT = Path(__file__).parent.parent
READMES = sorted(ROOT.glob("README*.md"))
TEXTS = [*READMES, ROOT / "CONTRIBUTING.md", *sorted(ROOT.glob("docs/**/*.md"))]
PAGES = {str(page.relative_to(ROOT)): page.read_text() for page in TEXTS}

LONG = (
    "README.md 2",  # the command line in one block, half a minute of it
    "docs/walking.md 2",  # climbs stairs as tests/programs/gaits/test_climb.py does
    "docs/parts.md 5",
    "docs/legged_robots.md 2",  # as tests/programs/test_automatic.py
    "docs/arms.md 8",  # as tests/programs/test_grip.py
    "docs/standing.md 2",  # as tests/test_loop_stations.py
    "docs/legged_robots.md 1",  # as tests/programs/test_legged_robot.py
)
"""Blocks that take seconds, and do what other tests do."""

each_page = pytest.mark.parametrize("page", PAGES)
each_readme = pytest.mark.parametrize("page", [page.name for page in READMES])


def fenced(language):
    """Return the blocks in a language, each after a name for it."""
    found = {
        f"{page} {number}": block
        for page, text in PAGES.items()
        for number, block in enumerate(
            re.findall(rf"^```{language}\n(.*?)^```", text, re.DOTALL | re.MULTILINE), 1
        )
    }
    return [pytest.param(block, id=name, marks=marks_of(name)) for name, block in found.items()]


def marks_of(name):
    """What takes long runs with the long; so do blocks of Spanish pages, which are those of their English twins."""
    return [pytest.mark.long] if name.startswith(("README.es", "docs/es/")) or name in LONG else []


@pytest.fixture(scope="module")
def cache(tmp_path_factory):
    """A folder of imports for all blocks: each names files of its own."""
    return tmp_path_factory.mktemp("cache")


@pytest.fixture
def folder(tmp_path, cache, monkeypatch, one_joint_urdf):
    """Go to a folder that is empty but for a URDF with a defect and the scenes of Drake among the examples."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv(CACHE_VARIABLE, str(cache))
    (tmp_path / "downloads").mkdir()
    without_motor = re.sub(r"<transmission.*</transmission>", "", one_joint_urdf, flags=re.DOTALL)
    (tmp_path / "downloads" / "arm.urdf").write_text(without_motor)
    scenes = Path("examples", "drake", "scenes")
    shutil.copytree(ROOT / scenes, tmp_path / scenes)
    return tmp_path


SHOWN = {
    "automatic=True).cells)": r"4\.07, 8\.15.*\n.*7\.76, 15\.51",
    "print(result.message, arm.pose())": r"ran to its end",
    'arm.simulate("irb120_dynamic")': r"^\d\.\d* (deg|grados) ",
    "np.rad2deg(result[": r" 44\.9[89]\d* (deg|grados)\n",
    "walk(4, amplitude=0.8)": r"ran to its end at 5 s .*\n0\.(0[5-9]|[12])\d* m ",
    '"right_hand", [-0.1, -0.1, -0.15]': r"\[-0\.1 +-0\.1 +-0\.15 ",
    "for force in (10, 20)": r"10 N .* ran to its end at 5 s\n20 N .* (fell|fallen|low|lean)",
    "again.values == second.values": r"True",
    "monitors.stop": r"the force on tip reached the limit of 20 N, at 1\.2\d* s\n.* 20\.[0-4]\d* N",
    "Sine(amplitudes": r"(nods by|se mueve) (29\.9|30).*\n.* 30\.1\d* ",
    'f"{name}.target"': r"earth (needs|necesita) 25\.5 .*\nmoon (needs|necesita) 4\.1 ",
    "again = simulate_diagram": r"True",
    "FindLog(context)": r" 31 .* 0\.3 s\n.*-2\.92",
    '"controllers.height.target": 0.38': r"0\.3(79\d|80\d) m",
    "class KeepHeight(SampledBlock)": r" -?0\.(0\d|1\d) mm",
    'motor={"joint_2": motor}': r"off by 0\.00[01]\d* rad",
    "MomentumObserver(plant=": r"\[ ?-?0\. +-?0\. +2\. ",
    "add_contact_sensor(": r"up to 14\d N, at rest 9\.[78]\d N and 9\.8\d m/s",
    "add_monitor(": r"kReachedTerminationCondition at 0\.[67]\d s: the pendulum is at 1\.",
    "plan = walk(": r"it went \[-?0\.0\d +0\.[56]\d? ",
    "class Nod(LeafSystem)": r"(nods by|se mueve) (29\.9|30).* rad\n",
}
"""What a script with these words in it prints, as far as a page says it."""


@pytest.mark.usefixtures("no_plots")
@pytest.mark.parametrize("script", fenced("python"))
def test_a_script_runs(script, folder, capsys):
    exec(compile(script, "a page", "exec"), {})
    shown = capsys.readouterr().out
    for words, output in SHOWN.items():
        assert words not in script or re.search(output, shown), shown


def test_every_expected_output_belongs_to_a_script():
    scripts = [case.values[0] for case in fenced("python")]
    assert all(any(words in script for script in scripts) for words in SHOWN)


def task_of(file):
    pytest.importorskip("gymnasium")
    from simrob_drake.extensions.learning.task import load_task

    return load_task(file)


LOADERS: dict[str, Callable] = {
    "station.yaml": lambda file: check_station(load_station(file)),
    "robot.yaml": lambda file: load_robot_file(file).element,
    "piece.yaml": lambda file: with_mass_properties(described_piece(file)),
    "program.yaml": Program.load,
    "study.yaml": Study.read,
    "task.yaml": task_of,
    "signals.yaml": Signals.load,
    "lesson.yaml": lambda file: tours(file.parent)[-1].steps,
}


@pytest.mark.parametrize("block", fenced("yaml"))
def test_a_yaml_file_is_what_it_claims(block, folder):
    claim, _, rest = block.partition("\n")[0].removeprefix("# ").partition(",")
    if rest.strip() == "changed":
        assert check_station(load_station(claim.removesuffix(".yaml"), parse_yaml(block, claim)))
        return

    (folder / claim).write_text(block)

    assert LOADERS[claim](folder / claim) is not None


def commands(text):
    return [
        line.split("#")[0].split()[1:] for line in text.splitlines() if line.startswith("simrob ")
    ]


def draws(command):
    return command[-1].endswith(".svg")


def different_commands():
    """Return the blocks that hold commands, one of those that differ in their comments only."""
    blocks = {str(commands(case.values[0])): case for case in reversed(fenced("sh"))}
    return [case for shown, case in blocks.items() if shown != "[]"]


SHORTER = {
    "run": ["--duration", "0.1", "--no-recording"],
    "walk": ["--no-recording"],
    "pushes": ["--phases", "1", "--directions", "1", "--seeds", "1"],
}


COMMANDS_RUN = set()
"""Commands that have been run, as texts. The pages of two languages share most of them, and some take half a minute."""


def runs_again(command):
    """Tell whether a command is to be run although it has been: its files may be read by the next commands."""
    return "--out" in command or str(command) not in COMMANDS_RUN


@pytest.mark.usefixtures("no_plots")
@pytest.mark.parametrize("block", different_commands())
def test_commands_do_their_work(block, folder, monkeypatch):
    monkeypatch.setattr(RobotView, "run", lambda view: None)  # else it would wait for its user
    if any(command[0] == "teach" for command in commands(block)):
        pytest.importorskip("nicegui", reason="needs the extra gui")
        monkeypatch.setattr(
            "simrob_drake.extensions.pendant.server.serve", lambda *given, **how: None
        )
    for command in commands(block):
        if not draws(command) and runs_again(command):
            assert run_command([*command, *SHORTER.get(command[0], [])]) == 0, command
            COMMANDS_RUN.add(str(command))


@each_readme
def test_commands_that_draw_do_so(page, folder):
    drawing = [command for command in commands(PAGES[page]) if draws(command)]
    assert drawing
    for command in drawing:
        assert run_command(command) == 0
        assert (folder / command[-1]).is_file()


@each_page
def test_commands_in_the_text_are_commands(page):
    for line in re.findall(r"`simrob ([^-`][^`]*)`", PAGES[page]):
        name, *arguments = shlex.split(line)
        command = whole_command(name)
        if arguments:
            command.make_context(name, arguments)


@each_page
def test_links_lead_somewhere(page):
    for link in re.findall(r"\]\((?!http)([^)]+)\)", PAGES[page]):
        target, _, anchor = link.partition("#")
        place = (ROOT / page).parent / target if target else ROOT / page
        assert place.exists(), link
        assert not anchor or anchor in anchors(place.read_text()), link


def test_the_source_archive_holds_what_the_pages_link_to_and_what_tests_need():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    archive = project["tool"]["hatch"]["build"]["targets"]["sdist"]["include"]

    linked = {
        ((ROOT / page).parent / link.partition("#")[0]).resolve().relative_to(ROOT).parts[0]
        for page, text in PAGES.items()
        for link in re.findall(r"\]\((?!http|#)([^)]+)\)", text)
    }

    assert linked | {page.name for page in READMES} | {".ci", "Makefile", "tests"} <= {
        *archive,
        "README.md",
        "LICENSE",
    }
    assert all((ROOT / place).exists() for place in archive)


def anchors(text):
    """Return the anchors of a page's headings, as GitHub makes them."""
    without_code = re.sub(r"^```.*?^```", "", text, flags=re.DOTALL | re.MULTILINE)
    headings = re.findall(r"^#+ (.*)", without_code, flags=re.MULTILINE)
    return {
        re.sub(r"[^\w\- ]", "", heading).strip().lower().replace(" ", "-") for heading in headings
    }


def test_every_page_can_be_reached():
    linked = {
        ((ROOT / page).parent / link.partition("#")[0]).resolve()
        for page, text in PAGES.items()
        for link in re.findall(r"\]\((?!http)([^)]+)\)", text)
    }
    assert {ROOT / page for page in PAGES} - linked <= {ROOT / "docs" / "README.md"}


@each_page
def test_make_targets_and_modules_exist(page):
    makefile = (ROOT / "Makefile").read_text()
    for target in re.findall(r"(?:^|`)make (\w+)", PAGES[page], flags=re.MULTILINE):
        assert re.search(rf"^{target}:", makefile, flags=re.MULTILINE), target
    for module in re.findall(r"python -m (tests[\w.]+)", PAGES[page]):
        assert (ROOT / module.replace(".", "/")).with_suffix(".py").is_file(), module


@each_readme
def test_a_readme_names_all_stations_and_robots(page):
    assert {*station_names(), *robot_names()} <= set(re.findall(r"`(\w+)`", PAGES[page]))


@pytest.mark.parametrize("page", ["docs/stations.md", "docs/es/stations.md"])
def test_a_table_of_stations_names_them_all(page):
    rows = re.findall(
        r"^\| \[`(\w+)`\]\([./]+/diagrams/\1\.yaml\) .*/diagrams/\1\.svg\)\) \|$",
        PAGES[page],
        re.MULTILINE,
    )
    assert sorted(rows) == station_names()
