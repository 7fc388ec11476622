"""Block pictures: what stands in the Diagram stands in the picture, and the committed pictures are the present ones."""

import re
from pathlib import Path

import pytest
from pydrake.systems.controllers import PidController
from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.systems.primitives import (
    Demultiplexer,
    MatrixGain,
    Multiplexer,
    PassThrough,
    Selector,
)

from simrob_drake.blocks.contacts import ContactReader
from simrob_drake.blocks.events import EventTimes, SteadySteps
from simrob_drake.errors import InvalidParameter, OutputError, SimrobError
from simrob_drake.files import diagrams_root
from simrob_drake.results.block_diagram import picture as block_picture
from simrob_drake.results.block_diagram.dot import dot_text
from simrob_drake.results.block_diagram.graph import BlockGraph
from simrob_drake.results.block_diagram.mermaid import mermaid_text
from simrob_drake.results.block_diagram.picture import save_block_picture, station_dot, station_mermaid
from simrob_drake.results.block_diagram.reading import read_blocks
from simrob_drake.stations.closed import closed_station
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.load import load_station, station_names
from simrob_drake.stations.resolve import resolve
from simrob_drake.stations.station import add_station, build_station

PLUMBING = (Selector, Multiplexer, Demultiplexer, PassThrough, MatrixGain, EventTimes, SteadySteps, ContactReader)
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
]

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
    file = diagrams_root() / f"{name}.dot"
    renew = f"{file.name} is not the station's picture; renew: python -m simrob_drake.results.block_diagram.picture"
    assert file.is_file(), renew
    assert file.read_text(encoding="utf-8") == station_dot(load_station(name)), renew
    assert file.with_suffix(".svg").is_file(), renew


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
    missing = {system.get_name() for system in systems if not isinstance(system, PLUMBING)} - set(drawn)
    multiplexed_forces = {"external_forces"}  # adds the robots' forces up for the plant's port
    assert missing <= multiplexed_forces
    assert set(drawn) <= {system.get_name() for system in systems}
    assert not [key for key, block in graph.blocks.items() if block.role == "own"]


def test_texts_are_the_same_every_time_and_name_every_block(variant: Variant) -> None:
    config, _, graph = variant
    dot, mermaid = dot_text(graph), mermaid_text(graph)
    assert dot == station_dot(config)
    assert len(re.findall("tooltip=", dot)) == len(graph.blocks)
    for block in graph.blocks.values():
        assert block.label.replace("\n", "\\n") in dot
        assert block.label.replace("\n", "<br/>") in mermaid


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
            continue  # a branch of a line, or an output of the station: neither is a system
        reached, waiting = set(starts), list(starts)
        while waiting:
            fresh = onward.get(waiting.pop(), set()) - reached
            reached |= fresh
            waiting += fresh
        assert reached & set(ends), f"{source} -> {target}"


def test_every_joint_has_a_row_with_its_own_figures() -> None:
    graph, _ = graph_of(load_station("irb120_dynamic", {"servo.kp": {"joint_2": 700}, "servo.torque_limit": 42}))
    for joint in range(1, 7):
        kp = 700 if joint == 2 else 1000
        assert label_of(graph, f"joint_{joint}.pd") == f"joint_{joint}: PD\nkp {kp}, kd 10"
        assert label_of(graph, f"joint_{joint}.saturation") == "Saturation\n±42 N·m"
        assert (f"joint_{joint}.pd", f"joint_{joint}.saturation") in graph.arrows


def test_integral_parts_are_drawn_where_there_are_some() -> None:
    graph, _ = graph_of(load_station("double_pendulum", {"servo.ki": {"joint_2": 5}, "servo.integral_limit": 20}))
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
    labels = {}
    for realization in ("per_joint", "vector", "implicit"):
        graph, _ = graph_of(load_station("double_pendulum", {"servo.realization": realization}))
        servos = [
            block.label.split("\n")[0] for block in graph.blocks.values() if block.role == "servo" and block.label
        ]
        labels[realization] = servos, graph.blocks["plant"].label
    assert labels["per_joint"][0] == ["joint_1: PD", "Saturation", "joint_2: PD", "Saturation"]
    assert labels["vector"][0] == ["2 joints: PD", "Saturation"]
    assert labels["implicit"][0] == []
    assert "joint_2: kp 100, kd 100, ±50 N·m" in labels["implicit"][1]
    assert "kp" not in labels["per_joint"][1] + labels["vector"][1]


def test_of_many_joints_the_first_and_the_last_are_drawn(tmp_path: Path) -> None:
    station = tmp_path / "chain.yaml"
    station.write_text(f"robot: {{urdf: {chain_urdf(tmp_path, 12).name}}}\n", encoding="utf-8")
    config = load_station(station)
    graph, _ = graph_of(config)
    labels = [block.label for block in graph.blocks.values() if block.role == "servo" and block.label]
    assert [label.split("\n")[0] for label in labels] == ["axis_1: PD", "Saturation", "⋮", "axis_12: PD", "Saturation"]
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
    shown = {name for b in graph.blocks.values() if b.shape == "port" for name in b.label.split("\n")}
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
        ({"kind": "hold"}, "hold the start"),
        ({"kind": "ramp", "target_deg": 30, "duration": 2, "start": 1}, "ramp to 30 deg in 2 s,\nfrom 1 s"),
        ({"kind": "move", "target_deg": [10, 20]}, "move to 10, 20 deg in 1 s"),
        ({"kind": "sine", "amplitude_deg": 5, "frequency": 0.5}, "sine ±5 deg, 0.5 Hz"),
        ({"kind": "sequence", "targets": [{"time": 2, "target_deg": 10}]}, "sequence of 1 postures in\n2 s"),
    ],
)
def test_references_say_what_they_do(reference: dict, text: str) -> None:
    station = load_station("double_pendulum").model_dump()
    graph, _ = graph_of(StationConfig.model_validate({**station, "reference": reference}))
    assert label_of(graph, "reference_source") == text


def test_axes_that_slide_have_their_own_units() -> None:
    dynamic = {"mode": "dynamic", "reference": {"kind": "move", "target_deg": {"belt": 1, "joint_2": 20}}}
    each, _ = graph_of(load_station("irb120_on_belt", dynamic))
    assert label_of(each, "belt.saturation") == "Saturation\n±500 N"
    assert label_of(each, "joint_1.saturation") == "Saturation\n±150 N·m"
    assert label_of(each, "stops.force") == "Joint stops\n5.73e+05 N/m, N·m/rad\n573 N·s/m, N·m·s/rad"
    assert label_of(each, "reference_source") == "move to belt 1 m, joint_2\n20 deg in 1 s"
    together, _ = graph_of(load_station("irb120_on_belt", {**dynamic, "servo.realization": "vector"}))
    assert label_of(together, "servo.saturation") == "Saturation\n±500 N, ±150, 150, 100, 30, 30, 15 N·m"
    inside, _ = graph_of(load_station("irb120_on_belt", {**dynamic, "servo.realization": "implicit"}))
    assert "belt: kp 4e+04, kd 4000, ±500 N\njoint_1: kp 1000, kd 10, ±150 N·m" in label_of(inside, "plant")


@pytest.mark.parametrize("suffix", [".dot", ".mmd"])
def test_texts_are_written_without_graphviz(tmp_path: Path, suffix: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    config = load_station("double_pendulum")
    file = save_block_picture(config, str(tmp_path / f"picture{suffix}"))
    text = station_dot(config) if suffix == ".dot" else station_mermaid(config)
    assert file.read_text(encoding="utf-8") == text


def test_without_graphviz_a_drawing_names_the_remedy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(SimrobError, match=r"install Graphviz, or choose a \.dot or \.mmd file"):
        save_block_picture(load_station("double_pendulum"), tmp_path / "picture.svg")


def test_an_unknown_suffix_names_the_known_ones(tmp_path: Path) -> None:
    with pytest.raises(InvalidParameter, match=r"picture\.jpg.*\.dot, \.mmd, \.svg"):
        save_block_picture(load_station("double_pendulum"), tmp_path / "picture.jpg")


def test_a_file_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match=r"missing.picture\.dot cannot be written"):
        save_block_picture(load_station("double_pendulum"), tmp_path / "missing" / "picture.dot")


@pytest.mark.long
@pytest.mark.graphviz
def test_the_pictures_of_all_stations_are_drawn(tmp_path: Path) -> None:
    block_picture.main(tmp_path)
    for name in station_names():
        drawing = (tmp_path / f"{name}.svg").read_text(encoding="utf-8")
        assert drawing.rstrip().endswith("</svg>")
        assert "scene_graph" in drawing
