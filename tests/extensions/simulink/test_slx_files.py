"""Damaged, hostile and other files: one clear error each."""

import contextlib
import random
import zipfile

import pytest
from slx_files import INERTIA, Level, mask, pendulum, write_model

from simrob_drake.base.errors import InvalidModel, SimrobError
from simrob_drake.extensions.simulink.importing import import_simulink
from simrob_drake.extensions.simulink.reading.model_file import LARGEST_PART, read_model
from simrob_drake.extensions.simulink.simulink_model import read_simulink


def with_part(tmp_path, name, text):
    file = tmp_path / "model.slx"
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(name, text)
    return file


@pytest.mark.parametrize(
    ("name", "content", "told"),
    [
        ("a.slx", b"no zip at all", "not a zip"),
        ("a.slx", b"PK\x03\x04" + b"\0" * 50, "not a zip"),
        ("a.slxp", b"", "protected"),
        ("a.mdl", b"hello world", "no Simulink model"),
        ("a.mdl", b"Model {\n  Name \"x\"\n  System {", "cut off"),
        ("a.mdl", b"Model {\n  Name \"x\"\n}", "no model"),
    ],
)  # fmt: skip
def test_what_is_no_model(tmp_path, name, content, told):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InvalidModel, match=told):
        read_model(tmp_path / name)


def test_a_missing_file(tmp_path):
    with pytest.raises(InvalidModel, match="cannot be read"):
        read_model(tmp_path / "none.slx")


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("<ModelInformation/>", "no model"),
        ("<ModelInformation><Thing/></ModelInformation>", "newer format"),
        ("<ModelInformation>", "is not XML"),
        ('<!DOCTYPE a [<!ENTITY b "c">]><ModelInformation>&b;</ModelInformation>', "document type"),
        ("<a>" * 500 + "</a>" * 500, "nests"),
        (
            '<ModelInformation><Model><System Ref="gone"/></Model></ModelInformation>',
            "gone.xml: is missing",
        ),
        (
            '<ModelInformation><Model><System Ref="../../etc/passwd"/></Model></ModelInformation>',
            "is missing",
        ),
    ],
)
def test_diagrams_that_cannot_be(tmp_path, text, told):
    with pytest.raises(InvalidModel, match=told):
        read_model(with_part(tmp_path, "simulink/blockdiagram.xml", text))


def test_a_diagram_in_utf_16_hides_nothing(tmp_path):
    text = '<?xml version="1.0" encoding="UTF-16"?><!DOCTYPE a [<!ENTITY b "c">]><a>&b;</a>'
    with pytest.raises(InvalidModel, match="document type"):
        read_model(with_part(tmp_path, "simulink/blockdiagram.xml", text.encode("utf-16")))


def test_a_zip_that_grows_is_refused(tmp_path):
    with pytest.raises(InvalidModel, match="larger than"):
        read_model(with_part(tmp_path, "simulink/blockdiagram.xml", b" " * (LARGEST_PART + 2)))


def test_systems_that_contain_themselves_are_refused(tmp_path):
    level = Level()
    for name in "ab":
        level.block("SubSystem", name, inner='<System Ref="system_root"/>')
    with pytest.raises(InvalidModel, match=r"more than \d+"):
        read_model(write_model(tmp_path / "loop.slx", level))


def test_libraries_that_contain_themselves_are_refused(tmp_path):
    level = Level()
    level.block("SubSystem", "inner", ReferencedSubsystem="loop")
    with pytest.raises(InvalidModel, match="contain themselves"):
        read_simulink(write_model(tmp_path / "loop.slx", level, kind="Subsystem"))


def test_a_missing_library_is_named(tmp_path):
    level = Level()
    level.block("SubSystem", "Robot", ReferencedSubsystem="ABB")
    level.block("MyLib/Link", "Rod")
    level.connect("2#lconn:1", "1#rconn:1")
    level.block("Signals/Filter", "Smooth")
    report = read_simulink(write_model(tmp_path / "a.slx", level)).report
    found = [(entry.element, entry.kind) for entry in report.entries]
    assert found == [("Robot", "lost"), ("Rod", "lost"), ("Smooth", "open")]
    assert "ABB.slx is missing; give its folder with --library" in report.entries[0].text


def test_the_old_text_and_the_text_package_hold_the_same(tmp_path):
    text = """Model {
  Name "old"
  System {
    Block { BlockType Constant Name "a \\"quoted\\"
name" SID "1" Value "[1 2]" }
    Block { BlockType Gain Name "k" Gain "3" Port { PortNumber 1 Name "speed" } }
    Line { SrcBlock "a \\"quoted\\"
name" SrcPort 1 Branch { DstBlock "k" DstPort 1 } }
    Line { LineType "Connection" SrcBlock "k" SrcPort RConn1 DstBlock "k" DstPort LConn2 }
  }
}
"""
    (tmp_path / "old.mdl").write_text(text)
    model = read_model(tmp_path / "old.mdl")
    assert {block.name for block in model.system.blocks.values()} == {'a "quoted" name', "k"}
    ((start, ends),) = model.system.wires
    assert (start.side, start.number, [end.block for end in ends]) == ("out", 1, ["k"])
    assert [(port.side, port.number) for port in model.system.nets[0]] == [
        ("rconn", 1),
        ("lconn", 2),
    ]
    assert [*model.system.signals.values()] == ["speed"]
    package = "# MathWorks OPC Text Package\n__MWOPC_PACKAGE_BEGIN__ R2023a\n"
    with zipfile.ZipFile(pendulum(tmp_path / "new.slx")) as archive:
        for name in archive.namelist():
            package += f"__MWOPC_PART_BEGIN__ /{name}\n{archive.read(name).decode()}\n\n"
    (tmp_path / "new.mdl").write_text(package)
    assert read_model(tmp_path / "new.mdl").system == read_model(tmp_path / "new.slx").system


def test_links_and_masks_of_libraries(tmp_path):
    library = Level()
    library.block("SubSystem", "Twice", mask=mask(k="7", two="2*k"), inner='<System Ref="inside"/>')
    inside = Level(first=50)
    inside.block("Gain", "G", Gain="two + k")
    write_model(tmp_path / "MyLib.slx", library, kind="Library", inside=inside.xml())
    top = Level()
    top.block("MyLib/Twice", "one", two="5")
    model = read_simulink(write_model(tmp_path / "top.slx", top))
    gain = next(node for node in model.expanded.nodes if node.kind == "Gain")
    assert gain.path == "one/G"
    assert gain.number("Gain") == 12.0


@pytest.mark.parametrize("count", [100, pytest.param(500, marks=pytest.mark.long)])
def test_damaged_files_give_no_traceback(tmp_path, count):
    """Bytes changed in a zip, and parts changed and packed again: each is read, or refused in words."""
    original = pendulum(tmp_path / "good.slx")
    whole = original.read_bytes()
    with zipfile.ZipFile(original) as archive:
        parts = {name: archive.read(name) for name in archive.namelist()}
    chance = random.Random(17)
    read = 0
    for number in range(count):
        file = tmp_path / "damaged.slx"
        if number % 5 == 0:
            content = bytearray(whole[: chance.randrange(1, len(whole))] if number % 2 else whole)
            for _ in range(chance.randrange(1, 20)):
                content[chance.randrange(len(content))] = chance.randrange(256)
            file.write_bytes(content)
        else:
            changed = dict(parts)
            name = chance.choice([name for name in parts if "root" in name or "arm" in name])
            changed[name] = damaged(parts[name], chance)
            with zipfile.ZipFile(file, "w") as archive:
                for part, text in changed.items():
                    archive.writestr(part, text)
        with contextlib.suppress(SimrobError):
            import_simulink(file, tmp_path / "out", force=True, assume=True)
            read += 1
    assert 0.1 * count < read < 0.8 * count  # both happen


def damaged(content, chance):
    """Return a part with words lost, doubled, swapped or made strange."""
    pieces = content.decode().split("<P ")
    for _ in range(chance.randrange(1, 6)):
        place = chance.randrange(1, len(pieces))
        kind = chance.randrange(5)
        if kind == 0:
            del pieces[place]
        elif kind == 1:
            pieces.insert(place, chance.choice(pieces[1:]))
        elif kind == 2:
            pieces[place] = pieces[place].replace(
                ">", ">" + chance.choice(["[", "1e999", "-1", "q", "''", "1:9e9"]), 1
            )
        elif kind == 3:
            pieces[place] = pieces[place].replace("conn:", chance.choice(["conn:9", "in:", "x:"]))
        else:
            other = chance.randrange(1, len(pieces))
            pieces[place], pieces[other] = pieces[other], pieces[place]
        if len(pieces) < 3:
            break
    return "<P ".join(pieces)


@pytest.mark.parametrize(("value", "mass"), [("<Value>3</Value>", 3.0), ("<Value/>", 2.0)])
def test_a_choice_of_a_mask_counts_what_it_says(tmp_path, value, mass):
    """As the file lists its choices since R2022: with numbers, or by their places."""
    members = "".join(f"<EnumerationMember><DescriptiveName>{name}</DescriptiveName>{number}</EnumerationMember>"
                      for name, number in (("Left", "<Value>5</Value>"), ("Right", value)))  # fmt: skip
    chosen = (
        '<Mask><MaskParameter Name="side" Type="popup"><Value>Right</Value>'
        f"<EnumerationTypeOptions>{members}</EnumerationTypeOptions></MaskParameter></Mask>"
    )
    level, inner = Level(), Level(first=100)
    inner.block(INERTIA, "Load", Mass="side", MomentsOfInertia="[1 1 1]")
    level.block("SubSystem", "Arm", inner=inner.xml(), mask=chosen)
    (body,) = read_simulink(write_model(tmp_path / "a.slx", level)).bodies.bodies
    assert [solid.weight.mass for solid in body.solids] == [mass]


OBJECT = '<Object PropName="{}" ObjectID="1" ClassName="x">{}</Object>'


def said(**values):
    return "".join(f'<P Name="{name}" Class="char">{text}</P>' for name, text in values.items())


@pytest.mark.parametrize("several", [True, False])
def test_a_mask_of_objects_as_files_had_it_before_2016(tmp_path, several):
    """What its parameters say, a choice among them, is what the code in it computes a mass of."""
    options = '<Array PropName="TypeOptions" Type="Cell" Dimension="2*1"><Cell>light</Cell><Cell>heavy</Cell></Array>'
    rows = [
        said(Name="rho", Type="edit", Value="3/2"),
        said(Name="kind", Type="popup", Value="heavy") + options,
    ]
    if several:
        array = "".join(
            f'<Object ObjectID="{number}">{row}</Object>' for number, row in enumerate(rows)
        )
        code, parameters = (
            "m = 10 * rho * kind;",
            f'<Array PropName="Parameters" Dimension="1*2">{array}</Array>',
        )
    else:
        code, parameters = "m = 20 * rho;", OBJECT.format("Parameters", rows[0])
    level, inner = Level(), Level(first=100)
    inner.block(INERTIA, "Load", Mass="m", MomentsOfInertia="[1 1 1]")
    level.block(
        "SubSystem",
        "Arm",
        inner=inner.xml(),
        mask=OBJECT.format("MaskObject", said(Initialization=code) + parameters),
    )
    (body,) = read_simulink(write_model(tmp_path / "a.slx", level)).bodies.bodies
    assert [solid.weight.mass for solid in body.solids] == [pytest.approx(30.0)]
