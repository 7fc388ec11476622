"""The schemas beside the models are those of the code, and every file of a model names its own."""

import json
from pathlib import Path

import pytest

from simrob_drake.base.files import models_root
from simrob_drake.base.yaml_files import read_yaml
from simrob_drake.programs.gaits.registry import load_gaits
from simrob_drake.programs.program import Program
from simrob_drake.programs.schemas import model_schemas
from simrob_drake.robots.catalog import load_robot_file
from simrob_drake.robots.pieces import described_piece

LOADERS = {
    "robot": load_robot_file,
    "piece": described_piece,
    "gaits": lambda file: load_gaits(file.parent.name),
}
FILES = [file for kind in LOADERS for file in sorted(models_root().rglob(f"{kind}.yaml"))]
PROGRAMS = sorted((Path(__file__).parents[2] / "examples").glob("*.yaml"))


@pytest.mark.parametrize("name", model_schemas())
def test_the_schema_file_is_up_to_date(name: str) -> None:
    assert json.loads((models_root() / name).read_text()) == model_schemas()[name], (
        "renew it: make pictures"
    )


@pytest.mark.parametrize("file", FILES, ids=lambda file: str(file.relative_to(models_root())))
def test_a_file_names_its_schema_and_keeps_to_it(file: Path) -> None:
    mark, _, schema = file.read_text().partition("\n")[0].partition("$schema=")

    assert mark == "# yaml-language-server: "
    assert (file.parent / schema).resolve() == models_root() / f"{file.stem}.schema.json"

    LOADERS[file.stem](file)
    known, content = model_schemas()[f"{file.stem}.schema.json"], read_yaml(file)

    assert set(known["required"]) <= set(content) <= set(known["properties"])


@pytest.mark.parametrize("file", PROGRAMS, ids=lambda file: file.stem)
def test_a_program_keeps_to_the_schema(file: Path) -> None:
    from jsonschema import Draft202012Validator

    _, _, schema = file.read_text().partition("\n")[0].partition("$schema=")
    assert (file.parent / schema).resolve() == models_root() / "program.schema.json"
    checker = Draft202012Validator(model_schemas()["program.schema.json"])
    assert [error.message for error in checker.iter_errors(read_yaml(file))] == []
    broken = {**read_yaml(file), "moves": [{"move_l": {"target": [0, 0, 1]}}]}
    assert list(checker.iter_errors(broken)) != []
    Program.load(file)


@pytest.mark.parametrize("name", model_schemas())
def test_every_key_is_explained(name: str) -> None:
    schema = model_schemas()[name]
    sections = {"": schema, **schema["$defs"]}

    sections = {
        where: next(iter(section.get("anyOf", [section]))) for where, section in sections.items()
    }

    keys = {
        f"{where}.{key}": entry
        for where, section in sections.items()
        for key, entry in section["properties"].items()
    }
    assert [
        key for key, entry in keys.items() if not {"description", "$ref"} & set(entry)
    ] == []  # a section explains itself
    assert all(section.get("description") for where, section in sections.items() if where)


def test_a_robot_has_a_urdf_with_root_and_axes_or_a_table() -> None:
    robot = model_schemas()["robot.schema.json"]

    assert robot["oneOf"] == [{"required": ["urdf", "root", "axes"]}, {"required": ["dh"]}]
    assert {branch["type"] for branch in robot["properties"]["axes"]["anyOf"]} == {
        "object",
        "array",
    }
    assert "folder" not in robot["properties"]
