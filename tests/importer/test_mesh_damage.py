"""Damaged mesh files: each gives a mesh or one clear line, never another error, nor memory without end."""

import json
import random
from pathlib import Path

import numpy as np
import pytest
import trimesh
from trimesh.visual.material import PBRMaterial

from simrob_drake.base.packages import OutsideBorder
from simrob_drake.importer.meshes.checks import UnreadableMesh
from simrob_drake.importer.meshes.library import Mesh, MeshLibrary
from simrob_drake.importer.meshes.places import MeshPlaces

KINDS = ["stl", "stl_ascii", "obj", "ply", "ply_ascii", "off", "dae", "glb", "gltf"]


def content(kind: str) -> bytes:
    mesh = trimesh.creation.icosphere(subdivisions=1)
    mesh.visual = trimesh.visual.TextureVisuals(
        uv=mesh.vertices[:, :2], material=PBRMaterial(baseColorFactor=[200, 30, 30, 255])
    )
    if kind == "gltf":
        files = trimesh.Scene([mesh]).export(file_type="gltf", embed_buffers=True)
        return bytes(files["model.gltf"])
    if kind == "ply_ascii":
        return bytes(mesh.export(file_type="ply", encoding="ascii"))
    data = mesh.export(file_type=kind)
    return data if isinstance(data, bytes) else data.encode()


def damaged(data: bytes, chance: random.Random) -> bytes:
    """Return the bytes with one kind of damage, as disks, editors and foes do it."""
    place, length = chance.randrange(len(data)), chance.choice([1, 2, 4, 30, 300])
    before, within, after = data[:place], data[place : place + length], data[place + length :]
    words, other = data.split(b" "), content(chance.choice(KINDS))
    words[chance.randrange(len(words))] = chance.choice(
        [b"nan", b"-1", b"1e999", b"99999999999999", b"", b"\0"]
    )
    choices = [
        before,
        before + after,
        before + chance.randbytes(length) + after,
        before + within * chance.choice([2, 50]) + after,
        b" ".join(words),
        data.replace(
            data[place : place + 1],
            chance.choice([b"", b"9", b"}", b"-"]),
            chance.choice([1, 5, 1000]),
        ),
        before + other[chance.randrange(len(other)) :],
    ]
    return chance.choice(choices)


def outcome(path: Path) -> Mesh | str:
    try:
        return MeshLibrary(MeshPlaces(path.parent / "arm.urdf")).load(path.name, (1.0, 1.0, 1.0))
    except (UnreadableMesh, OutsideBorder) as problem:
        return str(problem)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.filterwarnings("ignore")
def test_damage_gives_a_mesh_or_one_line(tmp_path: Path, kind: str) -> None:
    chance, whole = random.Random(f"{kind} 1"), content(kind)
    read = 0

    for index in range(120):
        path = tmp_path / f"{index}.{kind.removesuffix('_ascii')}"
        path.write_bytes(damaged(whole, chance))
        mesh = outcome(path)
        if isinstance(mesh, str):
            assert mesh.strip()
            assert "\n" not in mesh
            continue
        read += 1
        for part in mesh.parts:
            assert np.isfinite(part.vertices).all()
            assert 0 <= part.faces.min() <= part.faces.max() < len(part.vertices)
    assert 0 < read < 120  # damage of both sorts is tried


@pytest.mark.parametrize(
    "change",
    [
        {"accessors": [{"count": 10**15, "type": "VEC3", "componentType": 5126}]},
        {"accessors": [{"count": -1, "type": "VEC3", "componentType": 5126}]},
        {"accessors": {}},
        {"bufferViews": [{"buffer": 0, "byteLength": 10**12}]},
        {"bufferViews": [{"buffer": 0, "byteLength": 10_000}] * 40_000},
        {"nodes": [{"mesh": 0}] * 100_000},
        {"nodes": [{"mesh": 10**9}]},
        {"nodes": [{"mesh": 0, "matrix": [float("nan")] * 16}]},
        {"nodes": [{"mesh": 0, "matrix": [0] * 16}]},
        {"scenes": 7},
        {"meshes": [None]},
        {"buffers": [{"uri": "data:;base64,!!!!", "byteLength": 10}]},
        {"asset": {"version": "one"}},
        {"asset": 3},
    ],
    ids=lambda change: next(iter(change)),
)
def test_a_gltf_that_lies_is_named(tmp_path: Path, change: dict[str, object]) -> None:
    header = json.loads(content("gltf")) | change
    (tmp_path / "a.gltf").write_text(json.dumps(header))
    assert isinstance(outcome(tmp_path / "a.gltf"), str)


@pytest.mark.parametrize(
    "nodes", [[{"mesh": 0, "children": [0]}], [{"mesh": 0, "children": [1]}, {"children": [0]}]]
)
def test_gltf_nodes_within_themselves_come_to_an_end(
    tmp_path: Path, nodes: list[dict[str, object]]
) -> None:
    (tmp_path / "a.gltf").write_text(json.dumps(json.loads(content("gltf")) | {"nodes": nodes}))
    outcome(tmp_path / "a.gltf")
