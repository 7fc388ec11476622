"""Robots on legs of which only the tree is known: what is seen in them, what they can do, and what they cannot."""

import re
import xml.etree.ElementTree as ET

import numpy as np
import pytest
import yaml

from simrob_drake.base.errors import SimrobError
from simrob_drake.base.messages import message, set_output_language
from simrob_drake.cli import ExitCode
from simrob_drake.cli.app import run_command
from simrob_drake.extensions.legged import making, report
from simrob_drake.extensions.legged.anatomy import Anatomy, anatomy_of
from simrob_drake.extensions.legged.making import STAND, WALK, make_legged
from simrob_drake.extensions.legged.report import Attempt, FastestAxis
from simrob_drake.extensions.legged.scaling import (
    EXAMPLES,
    Build,
    asked_speed,
    climb_of,
    gains,
    walk_of,
)
from simrob_drake.extensions.legged.soles import soles_of
from simrob_drake.importer.importing import robot_from_file
from simrob_drake.programs.gaits.climb import Climb
from simrob_drake.robots.catalog import load_robot, load_robot_file
from simrob_drake.robots.gaits_file import gaits_file
from simrob_drake.robots.imports import ImportOptions
from simrob_drake.stations.checks import check_station
from simrob_drake.stations.draft import at_home
from simrob_drake.stations.load import ONLY_ROBOT, load_station
from simrob_drake.stations.stances import Stance, Stances
from tests.extensions.legged.conftest import arm, biped, dog, spider


def seen(file) -> tuple[Anatomy, Stance]:
    robot = robot_from_file(file, ImportOptions(base="floating"))
    clearance = at_home(robot)
    anatomy = anatomy_of(clearance, clearance.station.robots[ONLY_ROBOT])
    stances = Stances(clearance, anatomy.robot).bent_stances(
        [limb.leg for limb in anatomy.legs], (0.85,)
    )
    good = (one for one in stances if not anatomy.has_soles or anatomy.knees_ahead(one.posture))
    return anatomy, next(good)


def test_limbs_of_a_quadruped_are_told_by_geometry(tmp_path):
    anatomy, stance = seen(dog().write(tmp_path))
    assert [limb.name for limb in anatomy.legs] == [
        "front_right",
        "front_left",
        "rear_right",
        "rear_left",
    ]
    assert anatomy.groups == [
        ["front_right_foot", "rear_left_foot"],
        ["front_left_foot", "rear_right_foot"],
    ]
    named = dict(zip(anatomy.robot.axes, anatomy.names, strict=True))
    assert [named[f"j1{joint}"] for joint in "abc"] == [
        f"front_right_{part}" for part in ("hip_roll", "hip_pitch", "knee")
    ]
    signs = dict(zip(anatomy.names, anatomy.signs(stance.posture), strict=True))
    assert (signs["front_left_hip_roll"], signs["front_right_hip_roll"]) == (1, -1)  # outward
    assert signs["rear_left_hip_pitch"] == -1  # forward
    (sole, *_) = soles_of(anatomy, stance)
    assert not sole.flat
    assert sole.radius == pytest.approx(0.02)


@pytest.mark.long
def test_limbs_of_a_biped_are_told_by_geometry(tmp_path):
    anatomy, stance = seen(biped().write(tmp_path))
    assert [limb.name for limb in anatomy.legs] == ["right", "left"]
    assert anatomy.facing == 0.0
    named = dict(zip(anatomy.robot.axes, anatomy.names, strict=True))
    ankle = ["left_knee", "left_ankle_pitch", "left_ankle_roll"]
    assert [named[f"p{n}j"] for n in range(6)] == [
        "left_hip_yaw",
        "left_hip_roll",
        "left_hip_pitch",
        *ankle,
    ]
    assert sorted(anatomy.robot.axes[axis] for (axis,) in anatomy.arms) == [
        "pshoulder",
        "qshoulder",
    ]
    assert [anatomy.robot.axes[axis] for axis in anatomy.head] == ["neck"]
    for limb in anatomy.legs:
        assert limb.knee.straight == pytest.approx(0.0, abs=1e-6)
    for sole in soles_of(anatomy, stance):
        assert sole.flat
        assert np.ptp(sole.points, axis=0)[:2] + 2 * sole.radius == pytest.approx(
            [0.14, 0.08], abs=1e-3
        )


def changed(tree, name: str, **values: str):
    """Change attributes of an element of a joint or a link, as in ``limit__lower``, of both legs of a biped."""
    for side in "pq":
        for key, value in values.items():
            path, attribute = key.split("__")
            tree.robot.find(f"*[@name='{side}{name}']//{path}").set(attribute, value)
    return tree


@pytest.mark.long
def test_where_a_joint_lies_along_its_axis_does_not_tell_where_a_biped_looks(tmp_path):
    moved = changed(
        changed(biped(), "5j", origin__xyz="0.05 0 0"),
        "5",
        **{"collision/origin__xyz": "-0.03 0 -0.03"},
    )
    assert seen(moved.write(tmp_path))[0].facing == 0.0


@pytest.mark.parametrize(
    ("lower", "upper", "facing"), [("-1.57", "0.25", 0.0), ("-0.25", "1.57", np.pi)]
)
def test_a_biped_whose_knees_bend_both_ways_looks_where_its_thighs_go_farther(
    tmp_path, lower, upper, facing
):
    even = changed(biped(), "5", **{"collision/origin__xyz": "0 0 -0.03"})
    anatomy, _ = seen(changed(even, "2j", limit__lower=lower, limit__upper=upper).write(tmp_path))
    assert abs(anatomy.facing) == facing


@pytest.mark.long
def test_legs_that_lie_level_at_zero_are_found_and_stood_on(tmp_path):
    anatomy, stance = seen(spider().write(tmp_path))
    assert len(anatomy.legs) == 6
    assert stance.height > 0.05
    assert stance.standing.carrying_links.keys() == {f"c{number}" for number in range(6)}


@pytest.mark.long
def test_a_body_as_wide_as_it_is_long_looks_where_its_legs_are_pairs(tmp_path):
    anatomy, _ = seen(spider(0.07, turned=True).write(tmp_path))
    assert anatomy.facing == np.pi / 2
    assert [limb.left for limb in anatomy.legs] == [False, True] * 3


def test_legs_whose_drawings_differ_by_a_little_are_a_pair(tmp_path):
    tree = biped()
    # 0.30 and 0.31 m if rounded to centimetres
    tree.robot.find("joint[@name='p3j']/origin").set("xyz", "0 0 -0.1505")
    for side in "pq":
        tree.robot.find(f"joint[@name='{side}2j']/origin").set("xyz", "0 0 -0.0048")
    assert len(seen(tree.write(tmp_path))[0].legs) == 2


@pytest.mark.long
def test_legs_are_a_pair_wherever_their_joints_are_drawn_along_their_axes(tmp_path):
    tree = biped()
    for joint, at in (("p1j", "0.03 0 -0.04"), ("p2j", "-0.03 0 0"), ("q1j", "0 0 -0.04")):
        tree.robot.find(f"joint[@name='{joint}']/origin").set("xyz", at)
    anatomy, _ = seen(tree.write(tmp_path))
    assert sorted(limb.leg.foot.name() for limb in anatomy.legs) == ["p5", "q5"]


@pytest.mark.long
def test_legs_without_limits_stand_alike(tmp_path):
    tree = biped()
    for ankle in ("p4j", "q4j"):
        tree.robot.find(f"joint[@name='{ankle}']/origin").set("xyz", "0.02 0 -0.15")
    for joint in tree.robot.iterfind("joint"):
        joint.set("type", "continuous")
        for bound in ("lower", "upper"):
            del joint.find("limit").attrib[bound]
    anatomy, stance = seen(tree.write(tmp_path))
    right, left = (stance.posture[limb.leg.axes] for limb in anatomy.legs)
    assert np.abs(right - left * [-1, -1, 1, 1, 1, -1]).max() < np.deg2rad(3)
    assert np.abs(stance.posture).max() < np.deg2rad(100)


def test_a_walk_scales_as_pendulums_do():
    (model, *_) = EXAMPLES[2]
    build, half, four = model.build, 0.5, 0.25
    small = Build(
        four * build.height,
        build.mass,
        four * build.spread,
        (four * build.sole[0], four * build.sole[1]),
    )
    known = gaits_file(load_robot(model.name)).section("reacting")
    own = {"height": 0.1, "groups": [["right_foot"], ["left_foot"]], "posture": {}}
    walk = walk_of(small, model, **own)
    assert walk["step_time"] == pytest.approx(half * known["step_time"], rel=0.01)
    assert walk["lift"] == pytest.approx(four * known["lift"], rel=0.01)
    assert walk["max_speed"]["ahead"] == pytest.approx(half * known["max_speed"]["ahead"], rel=0.01)
    assert walk["feedback"]["com_rate"] == pytest.approx(
        known["feedback"]["com_rate"] / half, rel=0.01
    )
    assert gains(small, model)["kp"] == pytest.approx(four * gains(build, model)["kp"], rel=0.01)
    climb, stairs = (
        climb_of(small, walk, 0.5),
        gaits_file(load_robot(model.name)).section("climbs")["climb"],
    )
    assert climb["step_time"] == pytest.approx(half * Climb(**stairs).step_time, rel=0.01)
    assert climb["lift"] == pytest.approx(0.5 * four * Climb(**stairs).lift, rel=0.01)
    assert climb["overhang"] == pytest.approx(four * Climb(**stairs).overhang, rel=0.02)
    assert 0.94 * 0.1 < climb["bearing"]["height"] < 0.1
    assert asked_speed(walk, 0.5) == pytest.approx(asked_speed(walk) / 2, rel=0.01)
    (dogs,) = EXAMPLES[4]
    large = Build(4.0 * dogs.build.height, 1.0, 2.0 * dogs.build.spread, (0.0, 0.0))
    walk = {"groups": [["a", "b"], ["c", "d"]], "bearing": {"height": 1.2, "posture_deg": {}}}
    climb, known = (
        climb_of(large, walk),
        Climb(**gaits_file(load_robot(dogs.name)).section("climbs")["climb"]),
    )
    assert climb["rise"] == pytest.approx(4.0 * known.rise, rel=0.01)
    # their feet are nearer together
    assert climb["inside"] == pytest.approx(2.0 * known.inside, rel=0.01)
    assert climb["step_time"] == pytest.approx(2.0 * known.step_time, rel=0.01)
    assert "feet" not in climb


LESS = {
    "no legs": (arm, "made has no legs"),
    "legs of unlike length": (lambda: dog(left=0.14), "legs of unlike length"),
    "a foot without a shape": (
        lambda: dog(ball=False),
        "c0, c1, c2, c3 at the ends of its chains have no collision shape",
    ),
    "joints too weak": (lambda: dog(effort=0.5), "requires .*, but its limit is 0.5 N·m"),
}


@pytest.mark.parametrize(
    ("tree", "said"),
    [
        pytest.param(*given, id=name, marks=[] if "shape" in name else pytest.mark.long)
        for name, given in LESS.items()
    ],
)
def test_what_cannot_be_done_is_one_line_and_the_rest_is_kept(tmp_path, capsys, tree, said):
    file, folder = tree().write(tmp_path), tmp_path / "out"
    assert run_command(["legged", str(file), "--out", str(folder)]) == ExitCode.BAD_INPUT
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert re.search(said, line)
    assert load_robot_file(folder / "robot.yaml").base == "floating"
    assert load_station(folder / STAND).mode == "dynamic"
    assert re.search(said, (folder / "legged.md").read_text())


def test_meshes_that_are_not_there_are_told_with_what_cannot_be_done(tmp_path):
    tree = dog()
    for number in range(4):
        geometry = tree.robot.find(f"link[@name='c{number}']/collision/geometry")
        geometry.remove(geometry[0])
        ET.SubElement(geometry, "mesh", filename="feet/ball.stl")
    made = make_legged(tree.write(tmp_path), tmp_path / "out")
    assert (
        "4 collision shapes were not read, the first: link 'c0' <collision>: mesh 'feet/ball.stl'"
        in made.problem
    )


@pytest.mark.long
def test_masses_that_are_made_up_are_told_link_by_link(tmp_path):
    tree = dog(ball=False)
    for link in tree.robot.iterfind("link"):
        link.remove(link.find("inertial"))
    made = make_legged(tree.write(tmp_path), tmp_path / "made")
    said = dict(line.split(": ", 1) for line in made.assumed)
    assert said["link 'a0'"].startswith(
        "has neither inertia nor shape; estimated as a small ball: 0.1 kg"
    )
    assert "from its shapes" in said["link 'trunk'"]
    assert "no collision shape" in made.problem
    assert "tune first" not in (tmp_path / "made" / "legged.md").read_text()


def lowered(tree, height):
    """Draw all of a robot from a point so far below its trunk [m]: the root's frame is then near the ground."""
    for element in (*tree.robot.find("link[@name='trunk']"), *tree.robot.iterfind("joint[parent]")):
        if element.tag == "joint" and element.find("parent").get("link") != "trunk":
            continue
        origin = element.find("origin")
        if origin is None:
            origin = ET.SubElement(element, "origin", xyz="0 0 0")
        x, y, z = map(float, origin.get("xyz", "0 0 0").split())
        origin.set("xyz", f"{x} {y} {z + height}")
    return tree


@pytest.mark.long
def test_a_root_under_the_ground_is_moved_up_to_the_hips(tmp_path, monkeypatch):
    monkeypatch.setattr(making, "attempt", lambda _, trial, speed=0.0: Attempt(trial, True, "done"))
    monkeypatch.setattr(making, "attempt_climb", lambda *_, **__: Attempt("climbs", True, "done"))
    made = make_legged(lowered(dog(), 0.5).write(tmp_path), tmp_path / "out")
    assert made.problem == ""
    (root,) = [line for line in made.found if "frame of the root" in line]
    assert (
        root
        == "the frame of the root trunk is 0.500 m below the hips in the source; here it is level with them"
    )
    station = load_station(tmp_path / "out" / STAND)
    other = tmp_path / "other"
    other.mkdir()
    usual = make_legged(dog().write(other), tmp_path / "same")
    same = load_station(tmp_path / "same" / STAND)
    assert usual.found == [line for line in made.found if line != root]
    assert station.robots["robot"].base == pytest.approx(same.robots["robot"].base, abs=1e-4)
    assert station.monitors["fall"].height == pytest.approx(same.monitors["fall"].height, abs=1e-3)
    assert station.monitors["fall"].height > 0.1


@pytest.mark.long
def test_an_unexpected_error_of_one_trial_loses_nothing(tmp_path, monkeypatch):
    def fails(config, **_):
        raise RuntimeError(f"no memory for {config.name}")

    monkeypatch.setattr(report, "simulate", fails)
    made = make_legged(dog().write(tmp_path), tmp_path / "out")
    assert [one.trial for one in made.attempts] == ["stands", "walks"]
    assert made.attempts[0].outcome == "unexpected error: RuntimeError: no memory for standing"
    assert made.problem.startswith("made does not walk: unexpected error")
    assert load_station(tmp_path / "out" / WALK).controllers.keys() == {"walk"}


def test_an_unexpected_error_between_trials_keeps_what_was_made(tmp_path, monkeypatch):
    def breaks(self):
        raise IndexError("nothing under the feet")

    monkeypatch.setattr(making._Making, "run", breaks)
    made = make_legged(dog().write(tmp_path), tmp_path / "out")
    assert made.problem == "unexpected error: IndexError: nothing under the feet"
    assert load_station(tmp_path / "out" / STAND).mode == "dynamic"


def test_a_report_is_in_the_language_of_the_output(tmp_path):
    outcome = message("legged.fell", "falls at {time:.1f} s", time=1.5)
    mass = message("legged.arm", "arm: {axes}", axes="left_elbow")
    made = report.Made(
        tmp_path, name="dog", found=[mass], attempts=[Attempt("walks", False, outcome)]
    )

    set_output_language("es")
    try:
        report.save_report(made, tmp_path)
    finally:
        set_output_language("en")

    lines = (tmp_path / report.REPORT).read_text(encoding="utf-8").splitlines()
    assert {"## Encontrado", "- brazo: left_elbow", "## Supuesto", "- nada"} <= set(lines)
    assert "| marcha | no | se cae a los 1,5 s |" in lines
    assert "- ajuste primero: `step_time`, `bearing.height` y `zmp_inward` en gaits.yaml" in lines


@pytest.mark.long
def test_the_report_names_the_folder_that_stays(tmp_path, monkeypatch):
    def refused(file, *_):
        raise SimrobError(f"{file}: wrong")

    monkeypatch.setattr(report, "load_station", refused)
    made = make_legged(dog().write(tmp_path), tmp_path / "out")
    assert made.attempts[0].outcome == f"{tmp_path / 'out' / STAND}: wrong"
    assert ".simrob-part" not in (tmp_path / "out" / "legged.md").read_text() + made.problem


@pytest.mark.long
def test_a_biped_whose_feet_have_no_shape_is_told_which(tmp_path):
    tree = biped()
    for side in "pq":
        foot = tree.robot.find(f"link[@name='{side}5']")
        foot.remove(foot.find("collision"))
    made = make_legged(tree.write(tmp_path), tmp_path / "out")
    assert "p5, q5" in made.problem
    assert "no collision shape" in made.problem
    assert (tmp_path / "out" / STAND).is_file()


@pytest.mark.long
def test_a_walk_that_is_too_fast_for_its_motors_is_tried_with_slower_steps(tmp_path, monkeypatch):
    """The longest step time is the first with which the joints are slow enough."""
    step_times = list[float]()

    def tried(station, trial, speed=0.0):
        fastest = None
        if trial == "walks":
            step_times.append(
                yaml.safe_load((station.parent / "gaits.yaml").read_text())["reacting"]["step_time"]
            )
            fastest = FastestAxis("left_knee", 0.9 if step_times[-1] > 1.9 * step_times[0] else 1.5)
        return Attempt(trial, True, "done", fastest=fastest)

    monkeypatch.setattr(making, "attempt", tried)
    monkeypatch.setattr(making, "attempt_climb", lambda *_, **__: Attempt("climbs", True, "done"))
    made = make_legged(dog().write(tmp_path), tmp_path / "out")
    assert np.array(step_times) / step_times[0] == pytest.approx([1, 1.25, 1.5, 2], rel=0.01)
    written = yaml.safe_load((tmp_path / "out" / "gaits.yaml").read_text())["reacting"]["step_time"]
    assert written == step_times[-1]
    assert made.too_fast == []
    assert any(line.startswith("step time: 2 times") for line in made.assumed)


@pytest.mark.long
def test_joints_that_are_faster_than_their_motors_stand_under_next(tmp_path, monkeypatch):
    fastest = FastestAxis("left_knee", 1.78)
    monkeypatch.setattr(
        making, "attempt", lambda _, trial, speed=0.0: Attempt(trial, True, "done", fastest=fastest)
    )
    monkeypatch.setattr(making, "attempt_climb", lambda *_, **__: Attempt("climbs", True, "done"))
    make_legged(dog().write(tmp_path), tmp_path / "out")
    _, following = (tmp_path / "out" / "legged.md").read_text().split("## Next")
    assert (
        "walks: left_knee turns at 178% of the speed of its motor; give the walk a longer step_time"
        in following
    )


def test_feet_that_a_robot_has_already_are_told(tmp_path):
    file = dog().write(tmp_path)
    points = {f"c{number}": [[0, 0, -0.2]] for number in range(4)}
    feet = {"default": "balls", "contacts": {"balls": {"radius": 0.02, "points": points}}}
    axes = [f"j{number}{part}" for number in range(4) for part in "abc"]
    described = {"urdf": file.name, "base": "floating", "root": "trunk", "axes": axes, "feet": feet}
    (file.parent / "robot.yaml").write_text(yaml.safe_dump(described))
    made = make_legged(file, tmp_path / "out")
    assert "has feet of its own in the robot.yaml beside made.urdf" in made.problem
    assert (tmp_path / "out" / STAND).is_file()


def test_a_root_that_the_urdf_has_not_is_told(tmp_path):
    file = dog().write(tmp_path)
    description = {"urdf": file.name, "base": "floating", "root": "pelvis", "axes": ["j0a"]}
    (file.parent / "robot.yaml").write_text(yaml.safe_dump(description))
    with pytest.raises(ValueError, match="root is pelvis; it must be trunk, the root link"):
        make_legged(file, tmp_path / "out")


@pytest.mark.long
@pytest.mark.parametrize("tree", [dog, biped], ids=["quadruped", "biped"])
def test_a_robot_walks_from_its_tree_alone(tmp_path, tree):
    made = make_legged(tree().write(tmp_path), tmp_path / "out")
    assert made.problem == ""
    kicks = ["kicks"] if tree is biped else []
    trials = ["stands", "shifts its weight", "steps", "walks", *kicks, "climbs"]
    assert [attempt.trial for attempt in made.attempts if attempt.done] == trials
    assert made.attempts[3].ahead > 1.0
    assert (tmp_path / "out" / "legged.png").is_file()
    for station in (STAND, WALK):
        assert not [
            finding
            for finding in check_station(load_station(tmp_path / "out" / station))
            if finding.level == "error"
        ]


def test_a_tuned_walk_tells_how_many_trials_were_made_and_keeps_the_best(tmp_path, monkeypatch):
    class Searched:
        trials = [({}, np.array([2.0]))] * 8
        best = {"controllers.walk.gait.lift": 0.03}, np.array([1.0])

        def __init__(self, *_, **__): ...

        def run(self, **_):
            return True, ["Proven."]

    tuning = pytest.importorskip("simrob_drake.extensions.legged.tuning")
    monkeypatch.setattr(tuning, "attempt", lambda *_: None)
    monkeypatch.setattr(tuning, "_study", lambda *_: {})
    monkeypatch.setattr(tuning, "Study", dict)
    monkeypatch.setattr(tuning, "Proof", type("Proof", (), {"of": staticmethod(lambda *_: None)}))
    for name in ("StudyFolder", "ProofFolder"):
        monkeypatch.setattr(tuning, name, Searched)
    (tmp_path / WALK).write_text(
        yaml.safe_dump({"controllers": {"walk": {"commands": [{"ahead": 0.1}]}}})
    )
    (tmp_path / "gaits.yaml").write_text(yaml.safe_dump({"reacting": {"lift": 0.02}}))
    said = list(tuning.tune_walk(tmp_path, 0.0))
    assert said == [
        "tuned: 8 trials, cost 2 before and 1 with the best",
        "lift: 0.02 -> 0.03",
        "Proven.",
    ]
    assert yaml.safe_load((tmp_path / "gaits.yaml").read_text()) == {"reacting": {"lift": 0.03}}
