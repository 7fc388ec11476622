"""Block pictures: what stands in the Diagram stands in the picture, and the committed pictures are the present ones."""

import re
import xml.etree.ElementTree as ET
from itertools import combinations, product
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from pydrake.systems.controllers import PidController
from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.systems.primitives import (
    Demultiplexer,
    MatrixGain,
    Multiplexer,
    PassThrough,
    Selector,
)

from simrob_drake.base.errors import InvalidParameter, OutputError, SimrobError
from simrob_drake.base.files import diagrams_root
from simrob_drake.blocks.contacts import ContactReader
from simrob_drake.blocks.monitor import EventTimes, SteadySteps
from simrob_drake.parts.controllers import KINDS
from simrob_drake.results.block_diagram.graph import BlockGraph
from simrob_drake.results.block_diagram.layout import Layout, text_width
from simrob_drake.results.block_diagram.picture import (
    Drawing,
    loop_svg,
    save_block_picture,
    station_dot,
    station_svg,
)
from simrob_drake.results.block_diagram.reading import dot_text, mermaid_text, read_blocks
from simrob_drake.results.block_diagram.routing import Routing
from simrob_drake.stations.closed import closed_station
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.load import load_station, station_names
from simrob_drake.stations.resolve import resolve
from simrob_drake.stations.station import add_station, build_station

PLUMBING = (
    Selector,
    Multiplexer,
    Demultiplexer,
    PassThrough,
    MatrixGain,
    EventTimes,
    SteadySteps,
    ContactReader,
)
EVERYTHING = {
    "servo.ki": 50,
    "inputs": ["feedforward", "reference_velocity", "external_force"],
    "monitors": {"torque_limit": {}, "settled": {}},
}
VARIANTS = [
    *((name, None) for name in station_names()),
    ("irb120_dynamic", EVERYTHING),
    ("irb120_dynamic", {**EVERYTHING, "servo.realization": "vector"}),
    ("irb120_dynamic", {**EVERYTHING, "servo.realization": "implicit"}),
    ("irb120_dynamic", {"servo.feedforward": "gravity", "servo.law": "cascade"}),
    ("irb120_dynamic", {"servo.law": "computed_torque"}),
    ("two_irb120", {"robots.left.servo": {"feedforward": "inverse_dynamics"}}),
    ("irb120_dynamic", {"reference": {"kind": "sine", "amplitude_deg": 5}}),
    ("two_irb120", {"servo.realization": "per_joint", "solver": {"kind": "discrete"}}),
    ("two_irb120", {"mode": "kinematic"}),
    ("yobotics_terrain", {"servo.realization": "vector"}),
]

Corners = tuple[tuple[float, float], tuple[float, float]]
Variant = tuple[StationConfig, Diagram, BlockGraph]


def graph_of(config: StationConfig) -> tuple[BlockGraph, list]:
    closed = closed_station(resolve(config))
    return read_blocks(closed.diagram, closed.ports), closed.diagram.GetSystems()


def label_of(graph: BlockGraph, system: str) -> str:
    (block,) = [block for block in graph.blocks.values() if system in block.systems]
    return block.label


def chain_urdf(folder: Path, joints: int) -> Path:
    """Write a chain of equal links, one joint between each two."""
    inertia = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
    links = "".join(f'<link name="link_{k}">{inertia}</link>' for k in range(joints + 1))
    limit = '<axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="{}" velocity="1"/>'
    chain = "".join(
        f'<joint name="axis_{k}" type="revolute"><parent link="link_{k - 1}"/><child link="link_{k}"/>'
        f"{limit.format(10 * k)}</joint>"
        f'<transmission name="t_{k}"><type>transmission_interface/SimpleTransmission</type>'
        f'<joint name="axis_{k}"/><actuator name="motor_{k}"/></transmission>'
        for k in range(1, joints + 1)
    )
    file = folder / "chain.urdf"
    file.write_text(f'<robot name="chain">{links}{chain}</robot>')
    return file


@pytest.mark.parametrize("name", station_names())
def test_the_committed_picture_is_the_present_one(name: str) -> None:
    file = diagrams_root() / f"{name}.svg"

    renew = f"{file.name} is not the station's picture; renew: python -m simrob_drake.results.block_diagram.picture"
    assert file.is_file(), renew
    assert file.read_text(encoding="utf-8") == station_svg(load_station(name)), renew


@pytest.fixture(scope="module", params=VARIANTS, ids=lambda variant: f"{variant[0]}-{variant[1]}")
def variant(request: pytest.FixtureRequest) -> Variant:
    """A station, its diagram, and the picture that is read from it."""
    config = load_station(*request.param)
    closed = closed_station(resolve(config))
    return config, closed.diagram, read_blocks(closed.diagram, closed.ports)


def test_every_system_that_is_no_plumbing_is_drawn(variant: Variant) -> None:
    _, diagram, graph = variant
    systems = diagram.GetSystems()

    drawn = [system for block in graph.blocks.values() for system in block.systems]
    assert len(drawn) == len(set(drawn))

    missing = {system.get_name() for system in systems if not isinstance(system, PLUMBING)} - set(
        drawn
    )
    multiplexed_forces = {"external_forces"}  # adds the robots' forces up for the plant's port

    assert missing <= multiplexed_forces
    assert set(drawn) <= {system.get_name() for system in systems}
    assert not [key for key, block in graph.blocks.items() if block.role == "own"]


def test_texts_are_the_same_every_time_and_name_every_block(variant: Variant) -> None:
    config, _, graph = variant
    dot, mermaid = dot_text(graph), mermaid_text(graph)

    assert dot == station_dot(config)

    ports = {
        key: block
        for key, block in graph.blocks.items()
        if block.role == "sensor" and block.shape == "port"
    }
    groups = {(block.robot, *graph.sources(key)) for key, block in ports.items()}

    assert len(re.findall("tooltip=", dot)) == len(graph.blocks) - len(ports) + len(groups)
    for block in graph.blocks.values():
        assert block.text.replace("\n", "\\n") in dot
        assert block.text.replace("\n", "<br/>") in mermaid


def test_every_arrow_of_the_picture_is_a_way_in_the_diagram(
    variant: Variant,
) -> None:
    _, diagram, graph = variant
    onward: dict[str, set[str]] = {}

    for (target, _), (source, _) in diagram.connection_map().items():
        onward.setdefault(source.get_name(), set()).add(target.get_name())

    for source, target in graph.arrows:
        starts, ends = graph.blocks[source].systems, graph.blocks[target].systems
        if not starts or not ends:
            continue  # an output of the station, or a servo in an actuator: neither is a system
        reached, waiting = set(starts), list(starts)
        while waiting:
            fresh = onward.get(waiting.pop(), set()) - reached
            reached |= fresh
            waiting += fresh
        assert reached & set(ends), f"{source} -> {target}"


def test_no_line_runs_through_a_word_or_a_block(variant: Variant) -> None:
    svg = "{http://www.w3.org/2000/svg}"
    (frame,) = ET.fromstring(Drawing(variant[2]).svg()).findall(f"{svg}g")
    blocks = [outline(node.find(f"{svg}path")) for node in frame.findall(f"{svg}g")]
    lines = [ends(line) for line in frame.findall(f"{svg}path") if line.get("fill") == "none"]

    words = [box(text) for text in frame.findall(f"{svg}text")]

    assert len(blocks) == len(variant[2].blocks)
    for (left, top), (right, bottom) in [*words, *blocks]:
        for (x, y), (end, low) in lines:
            clear = end <= left or x >= right or low <= top or y >= bottom
            assert clear, (
                f"the line from {x, y} to {end, low} runs through what stands at {left, top}"
            )
        others = [(corner, end) for corner, end in blocks if corner != (left, top)]
        assert all(c <= left or a >= right or d <= top or b >= bottom for (a, b), (c, d) in others)


def test_lines_of_two_signals_cross_and_never_go_along_each_other(variant: Variant) -> None:
    ways = [[sorted(way) for way in net.polylines] for net in Routing(Layout(variant[2])).lines]
    for one, other in combinations(ways, 2):
        for ((a, b), (c, d)), ((e, f), (g, h)) in product(one, other):
            level = b == d and f == h and abs(b - f) < 3 and min(c, g) - max(a, e) > 3
            upright = a == c and e == g and abs(a - e) < 3 and min(d, h) - max(b, f) > 3
            together = level or upright
            assert not together, ((a, b), (c, d), (e, f), (g, h))


def ends(line: ET.Element) -> Corners:
    """Return the left upper and the right lower end of a line, which is level or upright."""
    points = [
        tuple(map(float, point.split())) for point in line.get("d", "").strip("MZ").split("L")
    ]
    first, last = min(points), max(points)
    assert first[0] == last[0] or first[1] == last[1]
    return (first[0], min(first[1], last[1])), (last[0], max(first[1], last[1]))


def outline(path: ET.Element | None) -> Corners:
    """Return the corners of a block."""
    assert path is not None
    points = [
        tuple(map(float, point.split())) for point in path.get("d", "").strip("MZ").split("L")
    ]
    (left, top), _, (right, bottom), _ = points
    return (left, top), (right, bottom)


def box(text: ET.Element) -> Corners:
    """Return the corners of a word that stands outside of the blocks."""
    x, y, size = (float(text.get(name, "11")) for name in ("x", "y", "font-size"))
    width = text_width(text.text or "", size)
    left = x - width / 2 if text.get("text-anchor") == "middle" else x
    return (left, y - 0.75 * size), (left + width, y + 0.1 * size)


def test_every_joint_has_a_row_with_its_own_figures() -> None:
    graph, _ = graph_of(
        load_station("irb120_dynamic", {"servo.kp": {"joint_2": 700}, "servo.torque_limit": 42})
    )
    for joint in range(1, 7):
        kp = 700 if joint == 2 else 1000
        assert label_of(graph, f"joint_{joint}.pd") == f"joint_{joint}: PD\nkp {kp}, kd 10"
        assert label_of(graph, f"joint_{joint}.saturation") == "Saturation\n±42 N·m"
        assert (f"joint_{joint}.pd", f"joint_{joint}.saturation") in graph.arrows


def test_integral_parts_are_drawn_where_there_are_some() -> None:
    graph, _ = graph_of(
        load_station("double_pendulum", {"servo.ki": {"joint_2": 5}, "servo.integral_limit": 20})
    )

    assert label_of(graph, "joint_2.integrator") == "joint_2: I\nki 5, ±20 N·m"
    assert ("joint_2.integral", "joint_2.pd") in graph.arrows
    assert not any(key.startswith("joint_1.integr") for key in graph.blocks)


def test_the_feedback_closes_the_loop_of_every_joint() -> None:
    graph, _ = graph_of(load_station("irb120_dynamic"))

    assert graph.arrows["plant", "joint_signals"] == ["q", "v"]
    assert graph.arrows["reference_source", "joint_signals"] == ["q_ref"]
    assert graph.arrows["torque", "plant"] == ["τ"]
    assert {target for source, target in graph.arrows if source == "joint_signals"} == {
        f"joint_{joint}.pd" for joint in range(1, 7)
    }


def test_each_realization_has_its_own_structure() -> None:
    drawn = {}
    for realization in ("per_joint", "vector", "implicit"):
        graph, _ = graph_of(load_station("double_pendulum", {"servo.realization": realization}))
        drawn[realization] = (
            [b for b in graph.blocks.values() if b.role == "servo" and b.label],
            graph,
        )

    labels = {
        name: [block.label.split("\n")[0] for block in blocks]
        for name, (blocks, _) in drawn.items()
    }
    assert labels["per_joint"] == ["joint_1: PD", "Saturation", "joint_2: PD", "Saturation"]
    assert labels["vector"] == ["2 joints: PD", "Saturation"]
    (inside,), graph = drawn["implicit"]
    assert (inside.label, inside.within, inside.systems) == (
        "2 joints,\nin the actuators",
        "plant",
        [],
    )
    assert inside.inside == ("PD\nkp 100, kd 100", "Saturation\n±50 N·m")
    assert graph.arrows["reference_source", "servo"] == ["q_ref"]
    assert (graph.arrows["servo", "plant"], graph.arrows["plant", "servo"]) == (["τ"], ["q", "v"])
    assert not {"kp", "PD"} & set(graph.blocks["plant"].label.split())


def test_a_loop_shows_what_it_does_at_each_sample() -> None:
    graph, _ = graph_of(load_station("zjudancer_walking"))

    steps = [part.split("\n")[0] for part in graph.blocks["controller.walk"].inside]
    assert steps == ["Estimator", "Planner", "Legs"]
    assert graph.arrows["reference_source", "layers"] == ["q_ref", "v_ref"]
    assert ("controller.walk", "layers") in graph.arrows
    assert graph.arrows["layers", "servo"] == ["q_ref"]
    for kind, section in KINDS.models.items():
        assert kind in ("own", "signal_flow") or section.stages, kind


def test_a_signal_flow_is_drawn_block_by_block() -> None:
    of = {"error": {"kind": "sum", "of": [{"q_ref.joint_2": 1, "q.joint_2": -1}]}}
    of |= {"limit": {"kind": "saturation", "of": "error", "lower": -5, "upper": 5}}
    law = {"kind": "signal_flow", "blocks": of, "torque": {"joint_2": "limit"}}

    graph, _ = graph_of(load_station("double_pendulum", {"controllers": {"law": law}}))

    ends = {
        source: target
        for source, target in graph.arrows
        if "law." in source and "output" not in target
    }
    assert ends == {"controller.law.error": "controller.law.limit", "controller.law.limit": "controller.law.torque",
                    "controller.law.torque": "joint_signals"}  # fmt: skip
    assert graph.arrows["plant", "controller.law.error"] == ["q"]
    assert graph.arrows["reference_source", "controller.law.error"] == ["q_ref"]
    assert ("controller.law.limit", "output law.limit") in graph.arrows
    assert graph.blocks["controller.law.limit"].label == "limit\nsaturation"


@pytest.mark.parametrize("realization", ["per_joint", "vector", "implicit"])
def test_what_feeds_torques_forward_leads_to_the_servos(realization: str) -> None:
    law = {"kind": "signal_flow", "torque": {"joint_2": {"one": 1}}}
    config = load_station(
        "double_pendulum", {"servo.realization": realization, "controllers": {"law": law}}
    )
    graph, _ = graph_of(config)

    (servo,) = graph.targets("controller.law.torque")

    assert graph.blocks[servo].role == "servo"
    assert servo in graph.targets("reference_source")

    text = dot_text(graph)
    assert f'"controller.law.torque" -> "{servo}"' in text
    assert f'"reference_source" -> "{servo}"' in text


def test_of_many_joints_the_first_and_the_last_are_drawn(tmp_path: Path) -> None:
    station = tmp_path / "chain.yaml"
    station.write_text(f"robot: {{urdf: {chain_urdf(tmp_path, 12).name}}}\n", encoding="utf-8")
    config = load_station(station)

    graph, _ = graph_of(config)

    labels = [
        block.label for block in graph.blocks.values() if block.role == "servo" and block.label
    ]
    assert [label.split("\n")[0] for label in labels] == [
        "axis_1: PD",
        "Saturation",
        "⋮",
        "axis_12: PD",
        "Saturation",
    ]
    assert "10 joints,\naxis_2 to axis_11" in labels[2]
    assert len(graph.blocks["more"].systems) == 20


def test_a_kinematic_station_shows_motion_that_becomes_torque() -> None:
    graph, _ = graph_of(load_station("irb120_kinematic"))

    assert graph.arrows["reference_source", "inverse_dynamics"] == ["q", "v", "a"]
    assert graph.arrows["inverse_dynamics", "output torque"] == ["τ"]
    assert graph.arrows["geometry_poses", "scene_graph"] == ["poses"]
    assert "plant" not in graph.blocks


def test_several_robots_share_one_plant() -> None:
    graph, _ = graph_of(load_station("two_irb120"))
    for robot in ("left", "right"):
        roles = {block.role for block in graph.blocks.values() if block.robot == robot}
        assert roles == {"reference", "servo", "sensor"}
        assert (f"{robot}.servo.saturation", "plant") in graph.arrows
    assert graph.blocks["plant"].robot == graph.blocks["scene_graph"].robot == ""


def test_every_output_of_the_station_is_drawn() -> None:
    closed = closed_station(resolve(load_station("irb120_dynamic")))
    ports, graph = closed.ports, read_blocks(closed.diagram, closed.ports)

    shown = {
        name for b in graph.blocks.values() if b.shape == "port" for name in b.label.split(" = ")
    }
    assert shown == set(ports.outputs) - {"reference"}


def test_a_users_own_block_has_a_cluster_of_its_own() -> None:
    builder = DiagramBuilder()
    ports = add_station(builder, load_station("double_pendulum"))
    mine = builder.AddNamedSystem("my_controller", PidController([1.0], [0.0], [1.0]))
    builder.Connect(ports.outputs["position"], mine.get_input_port_estimated_state())

    graph = read_blocks(builder.Build(), ports)

    assert graph.blocks["my_controller"].role == "own"
    assert graph.arrows["plant", "my_controller"] == ["q"]
    assert "my_controller\\nPidController" in dot_text(graph)


def test_a_station_as_one_box_shows_its_open_inputs() -> None:
    station = build_station(load_station("double_pendulum"))
    graph = read_blocks(station, station.ports)

    assert graph.blocks["input reference"].shape == "port"
    assert graph.arrows["input reference", "joint_signals"] == ["q_ref"]


@pytest.mark.parametrize(
    ("reference", "text"),
    [
        ({"kind": "hold"}, "hold the initial posture"),
        (
            {"kind": "ramp", "target_deg": 30, "duration": 2, "start": 1},
            "ramp to 30 deg in 2 s,\nfrom 1 s",
        ),
        ({"kind": "move", "target_deg": [10, 20]}, "move to 10, 20 deg in 1 s"),
        ({"kind": "sine", "amplitude_deg": 5, "frequency": 0.5}, "sine ±5 deg, 0.5 Hz"),
        (
            {"kind": "sequence", "targets": [{"time": 2, "target_deg": 10}]},
            "sequence of 1 posture in 2\ns",
        ),
    ],
)
def test_references_say_what_they_do(reference: dict, text: str) -> None:
    station = load_station("double_pendulum").model_dump()
    graph, _ = graph_of(StationConfig.model_validate({**station, "reference": reference}))
    assert label_of(graph, "reference_source") == text


def test_axes_that_slide_have_their_own_units() -> None:
    dynamic = {
        "mode": "dynamic",
        "reference": {"kind": "move", "target_deg": {"belt": 1, "joint_2": 20}},
    }
    each, _ = graph_of(load_station("irb120_on_belt", dynamic))

    assert label_of(each, "belt.saturation") == "Saturation\n±500 N"
    assert label_of(each, "joint_1.saturation") == "Saturation\n±150 N·m"
    assert (
        label_of(each, "stops.force") == "Joint stops\n5.73e+05 N/m, N·m/rad\n573 N·s/m, N·m·s/rad"
    )
    assert label_of(each, "reference_source") == "move to belt 1 m, joint_2\n20 deg in 1 s"

    together, _ = graph_of(
        load_station("irb120_on_belt", {**dynamic, "servo.realization": "vector"})
    )
    assert (
        label_of(together, "servo.saturation")
        == "Saturation\n±500 N, ±150, 150, 100,\n30, 30, 15 N·m"
    )

    inside, _ = graph_of(
        load_station("irb120_on_belt", {**dynamic, "servo.realization": "implicit"})
    )
    assert inside.blocks["servo"].inside == (
        "PD\nkp 4e+04, 1000, 1000,\n1000, 1000, 1000, 1000\nkd 4000, 10, 10, 10, 10,\n10, 10",
        "Saturation\n±500 N, ±150, 150, 100,\n30, 30, 15 N·m",
    )


@pytest.mark.parametrize(
    ("suffix", "start"),
    [
        (".svg", b"<svg"),
        (".dot", b"digraph"),
        (".mmd", b"---"),
        (".png", b"\x89PNG"),
        (".pdf", b"%PDF"),
    ],
)
def test_every_kind_of_file_is_written_without_another_program(
    tmp_path: Path, suffix: str, start: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    config = load_station("double_pendulum")

    content = save_block_picture(config, str(tmp_path / f"picture{suffix}")).read_bytes()

    assert content.startswith(start)
    assert content == save_block_picture(config, tmp_path / f"again{suffix}").read_bytes()


def test_a_picture_of_pixels_shows_all_of_the_drawing(tmp_path: Path) -> None:
    # whose wires go over blocks
    file = save_block_picture(load_station("humanoid_balance"), tmp_path / "picture.png")
    drawn = np.flatnonzero((np.asarray(Image.open(file).convert("L")) < 200).any(axis=1))

    assert drawn[0] < 60  # the title, 30 px below the edge at two pixels each
    assert Image.open(file).height - drawn[-1] < 60  # the legend


def test_an_unknown_suffix_names_the_known_ones(tmp_path: Path) -> None:
    with pytest.raises(
        InvalidParameter,
        match=r"the picture.s file is .*; it must be a file that ends in \.svg or \.png or \.pdf or \.dot or \.mmd",
    ):
        save_block_picture(load_station("double_pendulum"), tmp_path / "picture.jpg")


def test_a_file_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match=r"missing.picture\.dot cannot be written"):
        save_block_picture(load_station("double_pendulum"), tmp_path / "missing" / "picture.dot")


def test_a_loop_alone_is_drawn_with_what_it_reads_and_moves():
    drawn = loop_svg(load_station("yobotics_terrain"), "touchdown")
    titles = re.findall(r"<title>(.*?)</title>", drawn)

    feet = {f"sensor.{foot}" for foot in ("rear_left", "front_left", "rear_right", "front_right")}
    assert {*titles} == {"controller.touchdown", "plant", "layers", *feet}
    with pytest.raises(SimrobError, match="did you mean 'touchdown'"):
        loop_svg(load_station("yobotics_terrain"), "touchdwn")
