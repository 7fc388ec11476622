"""Every block of a model is in the report, and what is lost is counted in its first line."""

import json
import re
import zipfile

import pytest
from slx_files import REVOLUTE, TRANSFORM, WORLD, Level, pendulum, write_model
from test_mechanics import mechanism
from test_slx_signals import Plant

from simrob_drake.base.messages import in_language
from simrob_drake.cli import ExitCode
from simrob_drake.cli.app import run_command
from simrob_drake.extensions.simulink.importing import (
    FATES,
    BlockOutcome,
    block_types,
    fidelity,
    import_simulink,
)

GEAR = "sm_lib/Gears and Couplings/Gears/Worm and Gear Constraint"


def blocks_of(folder):
    return {
        block["path"]: block for block in json.loads((folder / "report.json").read_text())["blocks"]
    }


def test_the_table_holds_known_fates_only():
    assert {row.fate for row in block_types().values()} <= set(FATES)
    assert block_types()["Revolute Joint"].fate == "exact"


def test_every_block_in_the_file_is_in_the_report(tmp_path):
    """Of what is drawn on all levels, also what is commented out, and what feeds a scope alone."""
    file = pendulum(tmp_path / "a.slx")
    level, _ = mechanism()
    level.block("Scope", "Look")
    level.block(
        "SubSystem",
        "Old",
        Commented="on",
        inner='<System><Block BlockType="Gain" Name="G" SID="9"/></System>',
    )
    level.block("MadeUp", "Alone")
    for number, model in enumerate((file, write_model(tmp_path / "b.slx", level))):
        import_simulink(model, tmp_path / str(number))
        with zipfile.ZipFile(model) as archive:
            text = "".join(
                archive.read(name).decode() for name in archive.namelist() if "systems" in name
            )
        names = re.findall(r'<Block [^>]*Name="([^"]*)"', text)
        assert sorted(names) == sorted(
            path.rpartition("/")[2] for path in blocks_of(tmp_path / str(number))
        )
    blocks = blocks_of(tmp_path / "1")
    assert [blocks[name]["fate"] for name in ("Look", "Old", "Old/G", "Alone", "Joint1")] == [
        "ignored"
    ] * 4 + ["exact"]


def lossy(tmp_path):
    level, blocks = mechanism()
    for name in ("Worm", "Screw"):
        gear = level.block(GEAR, name)
        level.connect(f"{blocks['world']}#rconn:1", f"{gear}#lconn:1")
        level.connect(blocks["end"], f"{gear}#rconn:1")
    thing = level.block("sm_lib/New/Thing of Next Year", "Thing")
    level.connect(blocks["end"], f"{thing}#rconn:1")
    return write_model(tmp_path / "a.slx", level)


def test_losses_stand_in_the_first_line_and_in_the_exit_code(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert run_command(["import", str(lossy(tmp_path)), "--out", "out"]) == ExitCode.BEYOND
    shown = capsys.readouterr()
    assert shown.out.splitlines()[0] == "2 Worm and Gear Constraints and 1 Thing of Next Year lost"
    told = [line.split(": ")[:2] for line in shown.err.splitlines()]
    assert told[:3] == [["lost", "Worm"], ["lost", "Screw"], ["lost", "Thing"]]
    assert (tmp_path / "out" / "a.yaml").is_file()
    assert (
        json.loads((tmp_path / "out" / "report.json").read_text())["fidelity"]
        == shown.out.splitlines()[0]
    )
    again = ["import", str(tmp_path / "a.slx"), "--out", "out", "--force", "--allow-losses"]
    assert run_command(again) == ExitCode.DONE


def test_a_complete_import_says_so(tmp_path):
    assert (
        import_simulink(pendulum(tmp_path / "a.slx"), tmp_path / "out").fidelity
        == "mechanics complete"
    )


@pytest.mark.parametrize(
    ("kind", "side"), [(REVOLUTE, "lconn:9"), (TRANSFORM, "rconn:2"), (WORLD, "lconn:3")]
)
def test_a_physical_port_that_nothing_reads_is_a_loss(tmp_path, kind, side):
    level, blocks = mechanism()
    extra = level.block(kind, "Extra")
    level.connect(blocks["end"], f"{extra}#{side}")
    outcomes = import_simulink(write_model(tmp_path / "a.slx", level), tmp_path / "out").outcomes
    (extra_one,) = (outcome for outcome in outcomes if outcome.path == "Extra")
    assert extra_one.fate == "lost"
    assert extra_one.text == f"nothing reads its port {side.replace(':', ' ')}"


def test_an_open_block_that_drives_a_joint_is_a_lost_drive(tmp_path):
    plant = Plant()
    brain = plant.chain("Stateflow Chart", "Brain", plant.positions[0])
    plant.chain("Scope", "Look", plant.chain("Stateflow Chart", "Idle", plant.positions[0]))
    plant.drive(
        plant.chain("Gain", "k", brain, Gain="3"),
        plant.chain("Gain", "own", plant.positions[1], Gain="-1"),
    )
    imported = import_simulink(write_model(tmp_path / "a.slx", plant), tmp_path / "out")
    assert imported.fidelity == "1 drive lost; 1 control block left open"
    drives = {
        name: block
        for name, block in blocks_of(tmp_path / "out").items()
        if block["type"] == "Revolute Joint"
    }
    assert [drives[name]["fate"] for name in "AB"] == ["lost", "exact"]
    assert drives["A"]["text"].startswith("what drives it comes from Brain, left open")


@pytest.mark.parametrize(("port", "side"), [("TriggerPort", "trigger"), ("ResetPort", "Reset")])
def test_a_trigger_that_is_not_read_is_told_where_something_moves_by_it(tmp_path, port, side):
    plant = Plant()
    for number, name in enumerate(("Fast", "Shown")):
        inner = Level(first=100 * (number + 1))
        inner.block(port, "When")
        source, gain, out = (
            inner.block("Inport", "u"),
            inner.block("Gain", "k"),
            inner.block("Outport", "y"),
        )
        inner.wire(f"{source}#out:1", f"{gain}#in:1")
        inner.wire(f"{gain}#out:1", f"{out}#in:1")
        subsystem = plant.block("SubSystem", name, inner=inner.xml())
        plant.wire(plant.positions[number], f"{subsystem}#in:1")
        plant.wire(plant.chain("Clock", f"Time {name}"), f"{subsystem}#{side}")
        if name == "Fast":
            plant.drive(f"{subsystem}#out:1", plant.positions[1])
    imported = import_simulink(write_model(tmp_path / "a.slx", plant), tmp_path / "out")
    assert [entry.element for entry in imported.report.of("approximated")] == ["Fast"]
    blocks = blocks_of(tmp_path / "out")
    assert [blocks[name]["fate"] for name in ("Fast", "Fast/When", "Shown")] == [
        "approximated"
    ] * 2 + ["exact"]
    assert "is not read" in blocks["Fast"]["text"]


def test_an_import_is_reported_in_spanish(tmp_path, monkeypatch, capsys):
    """The headline, the counts, what is lost and the lines below the report."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("SIMROB_LANGUAGE", "es")
    assert run_command(["import", str(lossy(tmp_path)), "--out", "out"]) == ExitCode.BEYOND
    shown = capsys.readouterr()
    lines = shown.out.splitlines()
    assert lines[0] == "se pierde: 2 Worm and Gear Constraints y 1 Thing of Next Year"
    assert any(
        re.match(r"a\.slx: \d+ bloques, \d+ cuerpos, \d+ articulaciones; ", line) for line in lines
    )
    assert any(line.startswith("siguiente simrob run ") for line in lines)
    assert "se pierde: Worm: " in shown.err
    names = r"\S*[/_.]\S*|Worm and Gear Constraints?|Thing of Next Year|simrob \w+"
    english = r"\b(the|of|and|is|are|lost|left open|blocks|bodies|joints|its|not|by)\b"
    assert re.findall(english, re.sub(names, " ", shown.out + shown.err)) == []


def test_the_words_of_a_headline_have_plurals_in_spanish():
    def lost(noun):
        return BlockOutcome("a", "b", "mechanics", "lost", "", noun)

    opened = BlockOutcome("a", "b", "signals", "open", "", "")
    text = fidelity(
        [lost("cable"), lost("pulley"), lost("pulley"), opened], prescribed=2, assumed=1
    )
    assert text == (
        "1 cable and 2 pulleys lost; 1 figure assumed; 2 joints prescribed; 1 control block left open"
    )
    assert in_language(text, "es") == (
        "se pierde: 1 cable y 2 poleas; 1 número supuesto; 2 articulaciones prescritas; "
        "1 bloque de control sin conectar"
    )
