"""Cases of hostile input: files that are damaged or out of all measure, and options, made from a seed."""

import os
import random
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

import trimesh
import yaml

from simrob_drake.paths import diagrams_root

STATIONS = ("double_pendulum", "irb120_kinematic", "irb120_dynamic", "bouncing_ball")
SHORT = ["--duration", "0.01", "--no-recording", "--out", "out"]
VALUES = (
    *("null", "true", "''", "[]", "{}", "x", "0", "-1", "1", ".nan", ".inf", "1e300", "1e-300", "1e999", "99999999999"),
    *("!!bool maybe", "!!int x", "!!float ''", "2001-99-99", "!!binary x", "!!python/name:os.system", "!!set {a, b}"),
    *('"\\ud800"', '"\\0"', '"a\\0b"', "é\u202e", "'[bold]x'", f"'{'x' * 300}'", f"{'y' * 5000}"),
    *("1:2:3", "0x1F", "1_0", "~", "irb120", "humanoid", "none.urdf", "a/" * 900),
    *("[1, 2]", "[[[[]]]]", "{a: {b: {c: 1}}}", "{kind: x}", "{kind: sine}", "[1e300, -1e300, .nan]", "*nowhere"),
    *("/dev/zero", "/proc/kmsg", "/proc/self/mem", "pipe", "circle", ".", "..", "/", "../x"),
    *("&a [*a]", "[" * 300, f"[{'7, ' * 5000}]", f"{'9' * 5000}", "&b [1, 1]"),
)
"""Texts of YAML that are rarely right, whatever the key."""
URDF = """<?xml version="1.0"?><robot name="arm"><link name="base"/><link name="upper"><inertial><mass value="1"/>
<inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial><!-- a link --><visual><geometry>
<mesh filename="part.stl"/></geometry></visual><collision><geometry><box size="1 1 1"/></geometry></collision></link>
<joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/>
<limit lower="-1" upper="2" effort="10" velocity="3"/></joint></robot>"""
PROGRAM = """description: a wave
moves:
  - {target_deg: {left_elbow: -30}, duration: 0.5}
  - {walk: {steps: 4, amplitude: 0.5}}
  - {act: bow}
  - {attach: box}
references:
  - {target_deg: {left_elbow: 10}}
"""
ARM_PROGRAM = """station: two_arms
robot: left
moves:
  - {target_deg: {joint_1: -10}, duration: 0.5}
  - {move_j: {targets_deg: [0, 0, 0.1, 0, 0, 180], wobj: bar, solver: auto, check: limits}}
  - {move_l: {targets: [0, 0, -0.02], wobj: bar, speed: 0.3, points: 9}}
  - {attach: {piece: bar, tool: left_gripper}}
  - {tool: {pose: [0, 0, 0.01, 0, 0, 0]}}
  - {move_l: {targets: [[0, 0, -0.1], [0, 0, -0.02]], wobj: left, times: [0.5, 1.2]}}
  - {together: [{move_abs_j: [0, 0, 0, 0, 1.5, 0]}, {move_abs_j: {targets: [0, 0, 0, 0, 1.5, 0], robot: right}}]}
  - {wait: 0.1}
  - {release: {piece: bar, parent: world, fixed: true}}
"""
START = """{"positions": {"robot": [0.1, 0.2]}, "velocities": {"robot": [0.0, 0.0]},
"references": {"robot": [0.1, 0.2]}, "joints": {}, "blocks": {}}"""
TABLE = "time,joint_1,joint_2\n" + "".join(f"{step / 10},{step / 50},{-step / 50}\n" for step in range(20))
_FIGURE = re.compile(rb"(?<![\w.#-])-?\d+\.?\d*(?![\w.])")
MESHES = ("stl", "stl_ascii", "obj", "ply", "off", "dae", "glb")


@dataclass(frozen=True)
class Case:
    """One call of the command line in a folder of its own.

    Attributes:
        kind: what is hostile.
        arguments: of ``simrob``; ``program FILE`` loads a program of legs and does no more.
        files: that lie in the folder; beside them there are a named pipe, ``pipe``, and a link to itself, ``circle``.
    """

    kind: str
    arguments: list[str]
    files: Mapping[str, bytes] = field(default_factory=dict)

    def put(self, folder: Path) -> None:
        """Write the files into a folder."""
        os.mkfifo(folder / "pipe")
        (folder / "circle").symlink_to("circle")
        for name, content in self.files.items():
            (folder / name).write_bytes(content)


def case(number: int, seed: int = 1) -> Case:
    """Return the case of a number; the same one every time."""
    chance = random.Random(f"{seed} {number}")
    return _KINDS[number % len(_KINDS)](chance)


def damaged(data: bytes, chance: random.Random) -> bytes:
    """Return the bytes with one kind of damage, as disks, editors and foes do it; mostly a slight one."""
    figures = list(_FIGURE.finditer(data))
    if figures and chance.random() < 0.7:
        figure = chance.choice(figures)
        value = float(figure[0]) * chance.choice([-1, 0.1, 0.5, 0.99, 1.01, 2, 10])
        other = f"{value if b'.' in figure[0] else round(value):g}".encode()
        return data[: figure.start()] + other + data[figure.end() :]
    place, length = chance.randrange(len(data)), chance.choice([1, 2, 4, 30, 300])
    before, within, after = data[:place], data[place : place + length], data[place + length :]
    words = re.split(rb"([\s,\"<>=]+)", data)
    odd = (b"nan", b"-1", b"1e999", b"99999999999999", b"", b"\0", b"1e-320", b"\xed\xa0\x80", b"9" * 5000, b"null")
    words[2 * chance.randrange((len(words) + 1) // 2)] = chance.choice(odd)
    letter, other = data[place : place + 1], chance.choice([b"", b"9", b"}", b"-", b";"])
    choices = [
        before,
        before + after,
        before + chance.randbytes(length) + after,
        before + within * chance.choice([2, 50, 5000]) + after,
        *[b"".join(words)] * 4,
        data.replace(letter, other, chance.choice([1, 5, 1000])),
        data.decode("latin-1").encode("utf-16"),
    ]
    return chance.choice(choices)


def _station(chance: random.Random) -> Case:
    name = chance.choice(STATIONS)
    text = (diagrams_root() / f"{name}.yaml").read_text()
    content = damaged_values(text, chance) if chance.random() < 0.7 else damaged(text.encode(), chance)
    arguments = ["check", "case.yaml"] if chance.random() < 0.7 else ["run", "case.yaml", *SHORT]
    return Case("station", arguments, {"case.yaml": content})


def damaged_values(text: str, chance: random.Random) -> bytes:
    """Return a YAML text with hostile values in place of some of its own, or under keys of others."""
    content = yaml.safe_load(text)
    others = [key for name in STATIONS for key in _keys(yaml.safe_load((diagrams_root() / f"{name}.yaml").read_text()))]
    hostile = chance.choices(VALUES, k=chance.choice([1, 1, 2]))
    for number in range(len(hostile)):
        key = chance.choice([*_keys(content), *_keys(content), chance.choice(others)])
        node = content
        for part in key[:-1]:
            child = node.get(part)
            node[part] = node = child if isinstance(child, dict) else {}
        node[key[-1]] = f"@{number}@"
    result = yaml.safe_dump(content, sort_keys=False)
    for number, value in enumerate(hostile):
        result = re.sub(rf"'?@{number}@'?", lambda _, value=value: value, result)  # type: ignore[misc]
    return result.encode("utf-8", "surrogatepass")


def _keys(content: object, above: tuple[str, ...] = ()) -> list[tuple[str, ...]]:
    """Return the paths of all keys of a mapping."""
    if not isinstance(content, dict):
        return []
    return [found for key, value in content.items() for found in ((*above, key), *_keys(value, (*above, key)))]


def _option(chance: random.Random) -> Case:
    name = chance.choice(STATIONS)
    keys = _keys(yaml.safe_load((diagrams_root() / f"{name}.yaml").read_text()))
    value = chance.choice(VALUES).replace("\0", "")
    plain = value.strip("'\"")[:4000]
    setting = f"{'.'.join(chance.choice(keys))}={value}"
    return Case(
        "option",
        chance.choice(
            [
                ["check", name, "--set", setting],
                ["check", name, "--set", setting],
                ["run", name, *SHORT, "--set", setting],
                ["run", name, "--no-recording", "--duration", plain, "--out", "out"],
                ["run", plain, *SHORT],
                ["run", "double_pendulum", "--duration", "0.01", "--no-recording", "--out", plain],
                ["check", chance.choice([plain, f"{plain}.yaml", f"{plain}.urdf", f"{plain}.slx", f"{plain}.xacro"])],
                ["diagram", name, "--out", chance.choice([plain, f"{plain}.svg", f"{plain}.mmd"])],
                ["walk", "roid1_dynamic", chance.choice(["--amplitude", "--gait", "--steps", "--robot"]), plain],
                ["act", "roid1_dynamic", plain],
                ["import", f"{plain}.urdf", "--out", plain],
                [plain, name],
            ]
        ),
    )


def _table(chance: random.Random) -> Case:
    laws = ["cubic", "linear", "hermite"]
    reference = f"reference={{kind: table, file: t.csv, interpolation: {chance.choice(laws)}}}"
    content = chance.choice(
        [
            *[damaged(TABLE.encode(), chance)] * 6,
            damaged(damaged(TABLE.encode(), chance), chance),
            TABLE.replace(",", chance.choice([";", "\t", " "])).encode(),
            TABLE.replace("joint_2", "joint_1").encode(),
            TABLE.replace("0.2,", "0.1000000000000000001,").encode(),
            TABLE.encode() * chance.choice([2, 3000]),
            b"time,joint_1,joint_2\n" + b"".join(b"%d,0,0\n" % step for step in range(chance.choice([10**5, 10**6]))),
            b"," * 3_000_000,
            b'"' + TABLE.encode() * 1000,
        ]
    )
    return Case("table", ["run", "double_pendulum", *SHORT, "--set", reference], {"t.csv": content})


def _program(chance: random.Random) -> Case:
    command, program = chance.choice([("program", PROGRAM), ("check", ARM_PROGRAM)])
    content = program.replace(chance.choice(re.findall(r"[-\w.]+|\{.*\}", program)), chance.choice(VALUES), 1)
    slight = [damaged(program.encode(), chance)] * 4
    choices = [content.encode("utf-8", "surrogatepass"), *slight, multiplied(chance)]
    return Case("program", [command, "p.yaml"], {"p.yaml": chance.choice(choices)})


def multiplied(chance: random.Random) -> bytes:
    """Return a text of YAML that means far more than it says."""
    key, times = chance.choice(["moves", "description", "robot", "duration"]), chance.choice([2, 9])
    way = chance.choice(["[{}]", "{{<<: [{}]}}"])
    first = "&a0 {x: 1}" if "<<" in way else f"&a0 [{'x, ' * 9}]"
    steps = (f"a{n}: &a{n} {way.format(', '.join([f'*a{n - 1}'] * times))}" for n in range(1, chance.choice([5, 30])))
    last = chance.choice(["*a4", "'" + "x" * 900_000 + "'", "- " * 20_000 + "1", "1:" * 300_000 + "1", "[" * 100_000])
    return "\n".join([f"a0: {first}", *steps, f"{key}: {last}"]).encode()


@cache
def mesh(kind: str) -> bytes:
    """Return a mesh file."""
    data = trimesh.creation.icosphere(subdivisions=1).export(file_type=kind)
    return data if isinstance(data, bytes) else str(data).encode()


def _mesh(chance: random.Random) -> Case:
    kind = chance.choice(MESHES)
    ending = kind.removesuffix("_ascii")
    data = mesh(kind)
    special = {
        "stl": b"\0" * 80 + b"\x03\0\0\0" + data[84:],
        "obj": b"mtllib part.obj\n" + data,
        "dae": data.replace(b"<asset>", b'<asset><unit meter="0"/>'),
        "ply": data.replace(b"element vertex 42", b"element vertex 999999999"),
        "off": b"OFF\n999999999 999999999 0\n0 0 0\n",
        "glb": data[:12] + b"\xff\xff\xff\x7f" + data[16:],
    }
    content = special.get(kind, data) if chance.random() < 0.1 else damaged(data, chance)
    name = chance.choice([f"part.{ending}"] * 9 + ["pipe", "/dev/zero", "circle"])
    station = f"pieces: {{part: {{mesh: {name}, density: 1000, free: true}}}}\nfloor: {{size: 1}}\nduration: 0.01\n"
    return Case("mesh", ["check", "case.yaml"], {"case.yaml": station.encode(), f"part.{ending}": content})


def _urdf(chance: random.Random) -> Case:
    choices = [
        *[damaged(URDF.encode(), chance)] * 8,
        URDF.replace("part.stl", chance.choice(["pipe", "/dev/zero", "circle", "x" * 5000, "", "."])).encode(),
        URDF.encode() + b"<!--" * 1_000_000,
        URDF.replace("</robot>", "<a/>" * 1_000_000 + "</robot>").encode(),
        b"<robot>" + b"<link>" * 100_000,
        URDF.encode() + b" " * 11_000_000,
    ]
    files = {"arm.urdf": chance.choice(choices), "part.stl": mesh("stl")}
    return Case("URDF", chance.choice([["check", "arm.urdf"], ["import", "arm.urdf", "--out", "made"]]), files)


def _start(chance: random.Random) -> Case:
    choices = [
        *[damaged(START.encode(), chance)] * 6,
        b"[" * 100_000,
        START.replace("0.2", chance.choice(["NaN", "null", "Infinity", "1e999", "[1]", '"x"', "{}", "1e300"])).encode(),
        START.replace(
            "{}", chance.choice(['{"robot/joint_1": [[0], [0]]}', '{"x": 3}', "[]", '{"a": [[NaN], []]}'])
        ).encode(),
    ]
    name = chance.choice(["start.json"] * 9 + ["pipe", "/dev/zero", "circle", "."])
    arguments = ["run", "double_pendulum", *SHORT, "--set", f"start={name}"]
    return Case("start", arguments, {"start.json": chance.choice(choices)})


def _multiplied(chance: random.Random) -> Case:
    return Case("station", ["check", "case.yaml"], {"case.yaml": multiplied(chance)})


_KINDS: tuple[Callable[[random.Random], Case], ...] = (
    *(_station, _option, _table, _program, _mesh) * 3,
    *(_station, _option, _urdf, _start, _multiplied),
)
