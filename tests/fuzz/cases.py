"""Cases of hostile input, made from a seed: a table of what is damaged, and options."""

import os
import random
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import yaml

from tests.fuzz import formats, valid
from tests.fuzz.damage import BY_SUFFIX, VALUES, damaged, places, xml_damage, yaml_damage
from tests.fuzz.valid import EXAMPLES, Files, mesh, models_root, station

STATIONS = ("double_pendulum", "irb120_kinematic", "irb120_dynamic", "bouncing_ball")
LOOPS = (
    *(
        "humanoid_sequencer",
        "humanoid_height",
        "humanoid_fall_guard",
        "roid1_balance",
        "yobotics_walking",
    ),
    *("irb120_force_control", "irb120_motor_protection"),
)
MESHES = ("stl", "obj", "ply", "off", "dae", "glb")
SHORT = ["--duration", "0.01", "--no-recording", "--out", "out"]
CHECK, RUN = ["check", "case.yaml"], ["run", "case.yaml", *SHORT]
NO_FILES = ("pipe", "/dev/zero", "circle", ".")
"""What stands in the place of a file now and then."""


@dataclass(frozen=True)
class Case:
    """One call of the command line in a folder of its own.

    Attributes:
        kind: what is hostile.
        arguments: of ``simrob``; ``program``, ``study``, ``task`` or ``upload`` and a file load that and do no more.
        files: that lie in the folder, or what they link to; beside them there are a named pipe, ``pipe``, and a link to
            itself, ``circle``.
    """

    kind: str
    arguments: list[str]
    files: Files = field(default_factory=dict)

    def put(self, folder: Path) -> None:
        """Write the files into a folder."""
        os.mkfifo(folder / "pipe")
        (folder / "circle").symlink_to("circle")
        for name, content in self.files.items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            if isinstance(content, Path):
                (folder / name).symlink_to(folder.absolute() / content)
            else:
                (folder / name).write_bytes(content)


@dataclass(frozen=True)
class Class:
    """Files of a kind, one of which is damaged.

    Attributes:
        files: right ones, of which one set is chosen.
        hostile: names of those that may be damaged.
        commands: of which one reads them.
        damage: how; by the file's suffix unless given.
    """

    files: Sequence[Callable[[], Files]]
    hostile: Sequence[str]
    commands: Sequence[list[str]]
    damage: Callable[[bytes, random.Random], bytes] | None = None

    def case(self, kind: str, chance: random.Random, *, harm: bool = True) -> Case:
        """Return one of its cases; without harm its files are right."""
        files = dict(chance.choice(self.files)())
        name = chance.choice([name for name in self.hostile if name in files])
        content = files[name]
        assert isinstance(content, bytes)  # what is damaged is no link
        if not harm:
            pass
        elif chance.random() < 0.03:
            files[name] = Path(chance.choice(NO_FILES))
        else:
            files[name] = (self.damage or BY_SUFFIX.get(Path(name).suffix, damaged))(
                content, chance
            )
        return Case(kind, chance.choice(self.commands), files)


def _keys(name: str) -> list[tuple[str, ...]]:
    return [
        path
        for path in places(yaml.safe_load(station(name)))
        if all(isinstance(part, str) for part in path)
    ]


_OTHERS = [path for name in STATIONS for path in _keys(name)]


def _of(*sets: Files) -> list[Callable[[], Files]]:
    return [lambda files=files: files for files in sets]  # type: ignore[misc]


def _pieces(ending: str) -> Files:
    part = f"part.{ending.removesuffix('_ascii')}"
    text = f"floor: {{size: 1}}\npieces: {{part: {{mesh: {part}, scale: 1, density: 1000, free: true}}}}\n"
    return {"case.yaml": text.encode(), part: mesh(ending)}


def _imports(file: str) -> list[list[str]]:
    """Return the commands that read a robot's file."""
    return [["check", file], ["import", file, "--out", "../made"]]


def _begins(name: str, **overrides: float) -> Class:
    command = ["run", name, *SHORT, "--set", "start=start.json"]
    return Class([partial(valid.start, name, **overrides)], ["start.json"], [command])


_ROBOTS = [partial(valid.robot, name) for name in ("roid1", "yobotics")]
_STUDIES = [file.read_bytes() for file in sorted((EXAMPLES / "studies").glob("*.yaml"))]
_TASKS = [file.read_bytes() for file in sorted((models_root() / "tasks").glob("*.yaml"))]
_FOLLOWS = "reference={{kind: table, file: t.csv, interpolation: {}}}"
_LOG = ["compare", "double_pendulum", "--map", "yout.1=q.joint_2", "--with"]
_TUNE = ["tune", "study.yaml", "--workers", "1", "--out"]
CLASSES: Mapping[str, Class] = {
    "station": Class(
        _of(*({"case.yaml": station(name)} for name in STATIONS)),
        ["case.yaml"],
        [CHECK, CHECK, RUN],
        partial(yaml_damage, others=_OTHERS),
    ),
    "controllers": Class(
        _of(*({"case.yaml": station(name)} for name in LOOPS)),
        ["case.yaml"],
        [CHECK, CHECK, RUN],
        partial(yaml_damage, under="controllers"),
    ),
    "policies": Class([valid.network], ["net.onnx", "net.onnx", "case.yaml"], [CHECK, RUN, RUN]),
    "programs of legs": Class(
        _of({"p.yaml": valid.PROGRAM}), ["p.yaml"], [["program", "p.yaml"], ["check", "p.yaml"]]
    ),
    "programs of arms": Class(
        _of({"p.yaml": valid.ARM_PROGRAM}), ["p.yaml"], [["check", "p.yaml"]]
    ),
    "robots": Class(_ROBOTS, ["robot/robot.yaml"], [["check", "dynamic.yaml"]]),
    "gaits": Class(_ROBOTS, ["robot/gaits.yaml"], [["check", "walk.yaml"]]),
    "walking": Class(
        _ROBOTS,
        ["robot/gaits.yaml"],
        [["check", "walking.yaml"], ["run", "walking.yaml", *SHORT]],
        partial(yaml_damage, under="reacting"),
    ),
    "studies": Class(
        _of(*({"study.yaml": text} for text in (valid.STUDY, *_STUDIES))),
        ["study.yaml"],
        [["study", "study.yaml"]],
    ),
    "runs of studies": Class(
        _of({"study.yaml": valid.STUDY}), ["study.yaml"], [[*_TUNE, "out", "--trials", "1"]]
    ),
    "tasks": Class(
        _of(*({"task.yaml": text} for text in _TASKS)), ["task.yaml"], [["task", "task.yaml"]]
    ),
    "journals of sweeps": Class(
        [valid.sweep],
        ["sweep/rows.jsonl", "sweep/rows.jsonl", "sweep/sweep.yaml"],
        [["sweep", "sweep", "--workers", "1"]],
    ),
    "journals of studies": Class(
        [valid.study],
        ["study/rows.jsonl", "study/rows.jsonl", "study/study.yaml"],
        [[*_TUNE, "study"]],
    ),
    "winners": Class([valid.study], ["study/winner.yaml"], [["proof", "study"]]),
    "start": _begins("double_pendulum", servo__ki=10.0),
    "start of a free piece": _begins("bouncing_ball"),
    "start of a loop": _begins("roid1_balance"),
    "xacro": Class(
        _of({"arm.xacro": valid.XACRO, "limits.xacro": valid.LIMITS}),
        ["arm.xacro"],
        [["check", "arm.xacro"]],
    ),
    "URDF": Class(
        _of({"arm.urdf": valid.URDF, "part.stl": mesh("stl")}),
        ["arm.urdf"],
        [["check", "arm.urdf"], ["import", "arm.urdf", "--out", "../made"]],
    ),
    "mesh": Class(
        [partial(_pieces, ending) for ending in MESHES],
        [f"part.{ending}" for ending in MESHES],
        [CHECK],
    ),
    "MJCF": Class(_of({"arm.xml": formats.MJCF}), ["arm.xml"], _imports("arm.xml"), xml_damage),
    "SDF": Class(_of({"arm.sdf": formats.SDF}), ["arm.sdf"], _imports("arm.sdf"), xml_damage),
    "SRDF": Class(
        _of({"arm.urdf": valid.URDF, "arm.srdf": formats.SRDF, "part.stl": mesh("stl")}),
        ["arm.srdf"],
        [["check", "arm.urdf"], ["import", "arm.urdf", "--srdf", "arm.srdf", "--out", "../made"]],
        xml_damage,
    ),
    "RAPID": Class(
        _of({"Test.mod": formats.RAPID}),
        ["Test.mod"],
        [["import", "Test.mod", "--robot", "irb120", "--allow-losses", "--out", "../made"]],
    ),
    ".slx": Class(
        [lambda: {"model.slx": formats.simulink()}],
        ["model.slx"],
        [["import", "model.slx", "--out", "../made"]],
        formats.slx_damage,
    ),
    "networks": Class([valid.network], ["net.onnx"], [CHECK, RUN], formats.network_damage),
    "uploads": Class(
        [lambda: {"robot.zip": formats.archive()}],
        ["robot.zip"],
        [["upload", "robot.zip"]],
        formats.zip_damage,
    ),
    "programs": Class(
        _of({"p.yaml": valid.PROGRAM}, {"p.yaml": valid.ARM_PROGRAM}),
        ["p.yaml"],
        [["program", "p.yaml"], ["run", "p.yaml", *SHORT]],
    ),
    "table": Class(
        _of({"t.csv": valid.TABLE}),
        ["t.csv"],
        [
            ["run", "double_pendulum", *SHORT, "--set", _FOLLOWS.format(law)]
            for law in ("cubic", "linear", "hermite")
        ],
    ),
    "CSV log": Class(_of({"log.csv": valid.LOG}), ["log.csv"], [[*_LOG, "log.csv"]]),
    ".mat": Class(
        _of({"log.mat": valid.mat(compressed=True)}, {"log.mat": valid.mat()}),
        ["log.mat"],
        [[*_LOG, "log.mat"]],
    ),
}


def _option(chance: random.Random) -> Case:
    name = chance.choice(STATIONS)
    value = chance.choice(VALUES).replace("\0", "")
    plain = value.strip("'\"")[:4000]
    setting = f"{'.'.join(chance.choice(_keys(name)))}={value}"
    return Case(
        "option",
        chance.choice(
            [
                *[["check", name, "--set", setting]] * 2,
                ["run", name, *SHORT, "--set", setting],
                ["run", name, "--no-recording", "--duration", plain, "--out", "out"],
                ["run", plain, *SHORT],
                ["run", "double_pendulum", "--duration", "0.01", "--no-recording", "--out", plain],
                [
                    "check",
                    chance.choice(
                        [
                            plain,
                            *(f"{plain}.{end}" for end in ("yaml", "urdf", "slx", "xacro", "csv")),
                        ]
                    ),
                ],
                ["diagram", name, "--out", chance.choice([plain, f"{plain}.svg", f"{plain}.mmd"])],
                [
                    "walk",
                    "roid1_dynamic",
                    chance.choice(["--amplitude", "--gait", "--steps", "--robot"]),
                    plain,
                ],
                ["act", "roid1_dynamic", plain],
                ["import", f"{plain}.urdf", "--out", plain],
                [
                    "sweep",
                    name,
                    "--vary",
                    f"servo.kp={plain}",
                    "--workers",
                    "1",
                    "--out",
                    "out",
                    "--set",
                    "duration=0.01",
                ],
                ["linearize", name, "--at", plain, "--out", "out"],
                [
                    "pushes",
                    "roid1_walking",
                    chance.choice(["--start", "--phases", "--newtons", "--at"]),
                    plain,
                ],
                [plain, name],
            ]
        ),
    )


_KINDS = [*CLASSES, "option"]


def kind_of(number: int) -> str:
    """Return what is hostile in the case of a number."""
    return _KINDS[number % len(_KINDS)]


def case(number: int, seed: int = 1) -> Case:
    """Return the case of a number; the same one every time."""
    chance = random.Random(f"{seed} {number}")
    kind = kind_of(number)
    return CLASSES[kind].case(kind, chance) if kind in CLASSES else _option(chance)
