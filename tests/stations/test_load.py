"""Station files: the accepted and the refused ones, with the messages of the refusals."""

import numpy as np
import pytest

from simrob_drake import simulate
from simrob_drake.base.errors import SimrobError
from simrob_drake.cli.arguments import changes_of
from simrob_drake.parts.references import Hold
from simrob_drake.stations.change_of_kind import KeyLosses, KeysLeftOut, settings_with
from simrob_drake.stations.load import load_station, station_names, station_yaml, with_settings
from simrob_drake.stations.resolve import resolve


@pytest.mark.parametrize("name", station_names())
def test_a_resolved_station_loads_to_an_equal_one(name, tmp_path):
    config = load_station(name)
    (tmp_path / "station.yaml").write_text(station_yaml(config))
    assert load_station(tmp_path / "station.yaml") == config


def test_overrides_change_what_they_name_and_nothing_else():
    config = load_station("irb120_dynamic", {"servo.kp": 500, "pieces": {"load": {"mass": 2}}})
    expected = load_station("irb120_dynamic").model_dump()

    expected["servo"]["kp"], expected["pieces"]["load"]["mass"] = 500.0, 2.0

    assert config.model_dump() == expected


def test_an_empty_mapping_takes_everything_away():
    assert load_station("irb120_dynamic", {"pieces": {}}).pieces == {}


def test_a_new_kind_begins_from_its_defaults_and_names_what_was_given_for_the_old_one():
    """A target to which a ramp goes must not become the posture at which a hold stands."""
    with pytest.warns(
        KeysLeftOut, match="reference.kind changes from ramp to hold.*dropped.*target_deg"
    ):
        config = load_station("irb120_dynamic", {"reference.kind": "hold"})
    assert config.reference == Hold(kind="hold")
    with pytest.warns(KeysLeftOut, match="solver.*accuracy.*max_step"):
        config = load_station(
            "irb120_dynamic", {"solver.time_step": 0.002, "solver.kind": "discrete"}
        )
    assert config.solver.model_dump() == {"kind": "discrete", "scheme": "sap", "time_step": 0.002}


def test_the_arm_with_force_control_holds_its_start():
    """The header of the station's file advises these settings."""
    with pytest.warns(KeysLeftOut, match="target_deg, start, duration, blend"):
        station = load_station("irb120_force_control", {"reference.kind": "hold"})

    result = simulate(station, duration=0.3, progress=False)
    angle = np.rad2deg(result["q_ref.joint_1"])
    np.testing.assert_allclose(angle, -10.0, atol=1e-9)


@pytest.mark.parametrize(
    ("station", "sections", "key", "changes", "left", "kept"),
    [
        ("irb120_dynamic", {}, "reference", {"kind": "hold"}, ["target_deg"], {"target_deg": None}),
        (
            "irb120_dynamic",
            {},
            "reference",
            {"kind": "hold", "target_deg": 5},
            ["target_deg"],
            {"target_deg": 5.0},
        ),
        (
            "two_irb120",
            {},
            "robots.left.reference",
            {"kind": "hold"},
            ["target_deg"],
            {"target_deg": None},
        ),
        (
            "irb120_dynamic",
            {"solver.accuracy": 1e-3, "solver.max_step": 0.01},
            "solver",
            {"kind": "mujoco"},
            ["accuracy", "max_step"],
            {"time_step": 2e-3},
        ),
        (
            "irb120_dynamic",
            {"solver": {"kind": "mujoco", "time_step": 1e-4}},
            "solver",
            {"kind": "discrete"},
            ["time_step"],
            {"time_step": 1e-3},
        ),
        (
            "irb120_dynamic",
            {
                "forces": {
                    "hand": {"kind": "sine", "at": "link_6", "amplitude": [1, 0, 0], "frequency": 2}
                }
            },
            "forces.hand",
            {"kind": "push", "force": [1, 0, 0]},
            ["at", "amplitude", "frequency"],
            {"at": None},
        ),
        (
            "irb120_force_stop",
            {"monitors": {"stop": {"kind": "contact", "hold": 0.3}}},
            "monitors.stop",
            {"kind": "force_limit", "limit": 20},
            ["hold"],
            {"hold": 0.0},
        ),
        (
            "irb120_dynamic",
            {"sensors": {"seen": {"kind": "encoders", "rate": 50}}},
            "sensors.seen",
            {"kind": "joint_torque"},
            ["rate"],
            {},
        ),
    ],
)
def test_no_section_keeps_keys_of_another_kind(
    station, sections, key, changes, left, kept, tmp_path
):
    """Keys of the old kind are dropped from a station's file, and from a configuration that is loaded already."""
    if "mujoco" in f"{sections} {changes}":
        pytest.importorskip("simrob_drake.extensions.mujoco")
    before = load_station(station, sections)
    file = tmp_path / "station.yaml"

    file.write_text(station_yaml(before))

    dotted = {f"{key}.{name}": value for name, value in changes.items()}
    for change in (lambda: load_station(file, dotted), lambda: with_settings(before, dotted)):
        with pytest.warns(KeysLeftOut) as told:
            section = change()
        for part in key.split("."):
            section = section[part] if isinstance(section, dict) else getattr(section, part)
        assert section.kind == changes["kind"]
        for name, value in kept.items():
            assert getattr(section, name) == value
        message = str(told[0].message)
        assert key in message
        assert all(name in message for name in left), message


def test_a_file_of_settings_changes_a_kind_as_a_key_does(tmp_path):
    file = tmp_path / "held.yaml"
    file.write_text("reference: {kind: hold}\n")

    with pytest.warns(KeysLeftOut, match="target_deg"):
        config = load_station("irb120_dynamic", changes_of([str(file)], "--set"))
    assert config.reference == Hold(kind="hold")


def test_a_kind_that_stays_keeps_all_keys(recwarn):
    config = load_station("irb120_dynamic", {"reference.kind": "ramp", "reference.duration": 2})

    assert (config.reference.target_deg, config.reference.duration) == (30, 2)

    named = load_station("humanoid_dynamic", {"monitors.fall.kind": "fall"})
    assert named.monitors["fall"] == load_station("humanoid_dynamic").monitors["fall"]
    assert not [one for one in recwarn if one.category is KeysLeftOut]


def test_settings_that_come_later_take_back_those_of_another_kind():
    """Later settings replace earlier ones in the pendant, and in the changes of a program."""
    before = {"reference.kind": "move", "reference.target_deg": 30, "servo.kp": 500}

    assert settings_with(before, {"reference.kind": "hold"}) == {
        "reference.kind": "hold",
        "servo.kp": 500,
    }
    both = settings_with(before, {"reference.kind": "hold", "reference.target_deg": 5})
    assert both["reference.target_deg"] == 5
    assert settings_with(before, {"reference.kind": "move"}) == before
    assert settings_with({"sensors.a.rate": 5}, {"sensors.a": {"kind": "imu"}}) == {
        "sensors.a": {"kind": "imu"}
    }


def test_a_section_of_another_kind_takes_the_place_of_the_old_one():
    # and not at the ramp's 30 degrees
    held = load_station("irb120_dynamic", {"reference": {"kind": "hold"}})
    assert held.reference == Hold(kind="hold")

    of_robot = load_station("two_irb120", {"robots": {"left": {"reference": {"kind": "hold"}}}})
    assert of_robot.robots["left"].reference == Hold(kind="hold")
    assert of_robot.robots["right"].reference.target_deg is not None

    sine = {"kind": "sine", "amplitude": [0, 0, 1], "frequency": 1}
    push = {"kind": "push", "start": 1, "force": [0, 0, 1]}
    assert load_station("irb120_cobot", {"forces": {"hand": push}}).forces["hand"].kind == "push"

    both = load_station("irb120_cobot", {"forces": {"hand": {**sine, "frequency": 2}}}).forces[
        "hand"
    ]
    assert (both.kind, both.frequency) == ("sine", 2)

    same = load_station("irb120_dynamic", {"reference": {"kind": "ramp", "duration": 2}}).reference
    assert (same.target_deg, same.duration) == (30, 2)

    named = load_station(
        "irb120_dynamic", {"monitors": {"settled": {"hold": 1}}, "monitors.settled.kind": "settled"}
    )
    assert named.monitors["settled"].hold == 1


def test_gains_may_be_given_by_axis():
    config = load_station("irb120_dynamic", {"servo": {"kd": None}})

    assert config.servo.kd is None

    config = load_station("irb120_dynamic", {"servo": {"kp": {"joint_2": 2000}}})
    assert config.servo.kp == {"joint_2": 2000.0}


def test_one_axis_can_be_changed_where_the_file_has_a_number_for_all():
    for key in ("servo.kp.joint_2", "servo.kp.1"):
        station = load_station("irb120_dynamic", {key: 5, "servo.kd.joint_6": 1})
        (robot,) = resolve(station).robots.values()
        np.testing.assert_array_equal(robot.gains.kp, [1000, 5, 1000, 1000, 1000, 1000])
        np.testing.assert_array_equal(robot.gains.kd, [10, 10, 10, 10, 10, 1])


@pytest.mark.parametrize("overrides", [{"pieces.load": None}, {"pieces": {"load": None}}])
def test_none_takes_out_a_piece(overrides):
    assert list(load_station("irb120_dynamic", overrides).pieces) == ["gripper"]
    assert load_station("humanoid_dynamic", {"monitors.fall": None}).monitors == {}


def test_a_monitor_named_as_its_kind_needs_no_kind():
    config = load_station(
        "irb120_dynamic", {"monitors": {"settled": {"hold": 1}, "early": {"kind": "joint_limit"}}}
    )
    assert config.monitors["settled"].hold == 1
    assert config.monitors["early"].kind == "joint_limit"


def test_paths_start_at_the_file_that_names_them(tmp_path, monkeypatch):
    (tmp_path / "own.yaml").write_text(
        "robot: {model: irb120}\nreference: {kind: table, file: move.csv}\n"
    )
    monkeypatch.chdir(tmp_path.parent)

    assert load_station(tmp_path / "own.yaml").reference.file == tmp_path / "move.csv"

    config = load_station(tmp_path / "own.yaml", {"reference.file": "other.csv"})
    assert config.reference.file == tmp_path.parent / "other.csv"


WRONG = [
    ({"servo.kpp": 4}, r"servo\.kpp: unknown key; did you mean 'kp'\?"),
    ({"servo.kp": "abc"}, r"servo\.kp: .*number \(it is 'abc'\)"),
    ({"servo.kp": True}, r"servo\.kp: .*number"),
    ({"servo.kp": -1}, r"servo\.kp: a gain must be between 0 and 1e"),
    ({"servo.kp": float("nan")}, r"servo\.kp: .*finite"),
    ({"servo.kp": {"joint_22": 1}}, r"servo\.kp"),
    ({"servo.kd": [1, 2]}, r"servo\.kd is \[1\.0, 2\.0\]; it must be one number, or 6"),
    ({"servo.torque_limit": 0}, r"servo\.torque_limit: a torque limit must be positive"),
    ({"servo.torque_limit": [1, 2, 3, -4, 5, 6]}, r"torque limit must be positive"),
    (
        {"servo.realization": "vectr"},
        r"servo\.realization: there is no 'vectr'; did you mean 'vector'\?",
    ),
    ({"solver.scheme": "rada"}, r"solver\.scheme: there is no 'rada'; did you mean 'radau3'\?"),
    ({"solver.kind": "discrete", "solver.accuracy": 1}, r"solver\.accuracy: unknown key"),
    ({"solver.max_step": 0}, r"solver\.max_step: .*greater than 0"),
    ({"reference.kind": "mov"}, r"reference\.kind: there is no 'mov'; did you mean 'move'\?"),
    ({"reference.target_deg": {"joint_7": 1}}, r"no axis of irb120 .* 'joint_7'; did you mean"),
    ({"reference.kind": "sequence"}, r"reference\.targets: this key is required"),
    (
        {
            "reference": {
                "kind": "sequence",
                "targets": [{"time": 2, "target_deg": 1}, {"time": 1, "target_deg": 2}],
            }
        },
        r"times of a sequence must increase",
    ),
    ({"robot.model": "irb12"}, r"no robot 'irb12'; did you mean 'irb120'\?"),
    ({"robot.modell": "x"}, r"robot\.modell: unknown key; did you mean 'model'\?"),
    ({"robot.urdf": "x.urdf"}, r"x\.urdf.*there is no such file"),
    ({"robot.base": [0, 0, 0]}, r"robot\.base: needs 6 values"),
    (
        {"robot.initial_deg": {"joint_2": 400}},
        r"initial_deg of joint_2 is 400; it must be within -110 to 110 deg",
    ),
    ({"robot.tcp": "lod"}, r"no tool of robot 'lod'; did you mean 'load'\?"),
    ({"pieces.load.mass": -1}, r"pieces\.load\.mass: .*at least 0"),
    ({"pieces.load.model": "pencl"}, r"no piece 'pencl'; did you mean 'pencil'\?"),
    (
        {"pieces.load.parent": "griper"},
        r"no parent for pieces\.load 'griper'; did you mean 'gripper'\?",
    ),
    (
        {"pieces.gripper.parent": "load"},
        r"pieces\.gripper\.parent is load; .* not mounted on this piece",
    ),
    (
        {"pieces.load.inertia": [1, 0, 0]},
        r"pieces\.load\.inertia: no body can have this inertia: a principal moment is negative",
    ),
    (
        {"monitors.a.kind": "settle"},
        r"monitors\.a\.kind: there is no 'settle'; did you mean 'settled'\?",
    ),
    ({"monitors.settled.hld": 1}, r"monitors\.settled\.hld: unknown key; did you mean 'hold'\?"),
    ({"monitors.settled.robot": "arm"}, r"no robot for monitors\.settled 'arm'"),
    ({"pieces.load.density": 0}, r"pieces\.load\.density: .*greater than 0"),
    ({"pieces.load": {"density": 1, "mass": 1}}, r"pieces\.load: .*either mass or density"),
    ({"pieces.load.scale": 2}, r"pieces\.load: .*scale needs the key mesh"),
    ({"pieces.load.mesh": "a.stl"}, r"pieces\.load: .*only one of model and mesh"),
    ({"pieces.load.frame": "tpc"}, r"no frame of gripper 'tpc'; did you mean 'tcp'\?"),
    (
        {"pieces.gripper.frame": "tcp"},
        r"no tool or link of robot for pieces\.gripper\.frame 'tcp'; known: base_link, .* tool0",
    ),
    ({"inputs": ["feedforwrd"]}, r"inputs: there is no 'feedforwrd'; did you mean 'feedforward'\?"),
    ({"duration": -1}, r"duration: .*greater than 0"),
    ({"duraton": 1}, r"duraton: unknown key; did you mean 'duration'\?"),
    ({"servo.kp.joint_9": 1}, r"servo\.kp: is 1000, so it has no key 'joint_9'"),
    ({"servo.kp.6": 1}, r"servo\.kp\.6: has no entry '6'; the entries are 0 to 5"),
    ({"robots": {"a": {"model": "irb120"}}}, r"either the section robot or the section robots"),
]


@pytest.mark.parametrize(
    ("overrides", "message"), WRONG, ids=[str(next(iter(case[0]))) for case in WRONG]
)
def test_wrong_entries_are_named_with_what_would_be_right(overrides, message):
    with pytest.raises(SimrobError, match=message) as caught:
        load_station("irb120_dynamic", overrides)
    # nobody touched the file
    assert str(caught.value).startswith(tuple(f"override {key}" for key in overrides))
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 400


BLAMED = [
    ({"duration": 2, "servo.kp": -1}, "override servo.kp: a gain must be between 0"),
    (
        {"reference.kind": "sequence", "reference.targets": 3},
        "override reference.targets: must be a list",
    ),
    ({"servo": {"kp": 1, "kpp": 1}}, "override servo: servo.kpp: unknown key"),
    ({"robot.base": [0, 0]}, "override robot.base: needs 6 values"),
    (
        {"contact": {}, "contact.friction": 0.01},
        "override contact.friction: must be .* keys among: static, dynamic",
    ),
    (
        {"servo": 3},
        "override servo: must be a section with keys among: realization, law, .*it is 3",
    ),
    ({"pieces": 3}, "override pieces: must be a section of names with their entries"),
    (
        {"monitors.fal": {}},
        "override monitors.fal: .*fal.kind: this key is required; known: joint_limit, .*, fall",
    ),
    (
        {"mode": "kinematic", "forces.push": {"force": [1, 0, 0]}},
        "override mode, override forces.push: forces.push: a kinematic station has no forces; leave it out",
    ),
]


@pytest.mark.parametrize(("overrides", "message"), BLAMED)
def test_the_override_that_is_wrong_is_blamed(overrides, message):
    with pytest.raises(SimrobError, match=f"^{message}"):
        load_station("irb120_dynamic", overrides)


def test_overrides_are_called_what_the_caller_calls_them():
    with pytest.raises(SimrobError, match=r"^--duration: must be greater than 0"):
        load_station("irb120_dynamic", {"duration": -1}, called={"duration": "--duration"})


def test_a_bad_file_is_to_blame_whatever_is_overridden(tmp_path):
    file = tmp_path / "bad.yaml"
    file.write_text("robot: {model: irb120}\nservo: {kp: -1}\n")
    with pytest.raises(SimrobError, match=r"bad.yaml: servo.kp: a gain"):
        load_station(file, {"duration": 2})


def test_a_folder_is_no_station_but_may_hold_one(tmp_path):
    with pytest.raises(
        SimrobError, match=r"is a folder, but a station is given by its name or a YAML file$"
    ):
        load_station(tmp_path)

    (tmp_path / "station.yaml").write_text("robot: {model: irb120}")
    with pytest.raises(SimrobError, match=r"did you mean .*/station.yaml?"):
        load_station(tmp_path)

    (tmp_path / "k.yaml").mkdir()
    with pytest.raises(SimrobError, match=r"k.yaml: is a folder"):
        load_station(tmp_path / "k.yaml")


def test_samples_are_not_more_than_fit():
    with pytest.raises(SimrobError, match=r"^override sample_rate: must be at most 10000"):
        load_station("irb120_dynamic", {"sample_rate": 1e9})
    with pytest.raises(
        SimrobError,
        match=r"duration is 1e.09 s; it must be at most 10000 s at a sample_rate of 100 Hz",
    ):
        load_station("irb120_dynamic", {"duration": 1e9})
    assert load_station("irb120_dynamic", {"duration": 100, "sample_rate": 1e4}).sample_rate == 1e4


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("robot: [", r"is not YAML: while parsing a flow .* \(line \d+, column \d+\)$"),
        ("- a\n- b", "must contain a mapping"),
        ("robot: {model: irb120}\nduration: 1\nduration: 2", "'duration' occurs twice"),
        ("description: nothing else", "robots is empty; .*something that moves"),
        ("robots: {}", "robots is empty; .*something that moves"),
        ("robots: {two words: {model: irb120}}", "not a valid name"),
        (
            "name: ../../../tmp/x\nrobot: {model: irb120}",
            r"bad\.yaml: name: must be a valid folder name",
        ),
        ("name: /tmp/x\nrobot: {model: irb120}", r"bad\.yaml: name: must be .* \(it is '/tmp/x'\)"),
        ("name: ..\nrobot: {model: irb120}", "name: must be a valid folder name"),
        ("name: ''\nrobot: {model: irb120}", "name: must be a valid folder name"),
        (f"name: {'n' * 201}\nrobot: {{model: irb120}}", "name: must be a valid folder name"),
        ("robot: {model: irb120}\nduration: !!python/object/apply:os.getcwd []", "is not YAML"),
    ],
)
def test_files_that_are_no_stations_are_refused(tmp_path, text, message):
    (tmp_path / "bad.yaml").write_text(text)
    with pytest.raises(SimrobError, match=message):
        load_station(tmp_path / "bad.yaml")


def test_an_unknown_station_is_named_with_the_nearest():
    with pytest.raises(SimrobError, match="did you mean 'irb120_dynamic'"):
        load_station("irb120_dynamik")
    with pytest.raises(SimrobError, match=r"nowhere\.yaml: there is no such file"):
        load_station("nowhere.yaml")


@pytest.mark.parametrize(
    ("station", "piece", "choices"),
    [
        ("two_irb120", "left_gripper", "world, left, right, right_gripper"),
        ("irb120_dynamic", "load", "world, robot, gripper"),
        ("bouncing_ball", "slab", "world, ball"),
    ],
)
def test_a_piece_says_what_it_hangs_on(station, piece, choices):
    match = rf"pieces\.{piece}\.parent is left out; .*one of {choices}, or the piece must have free: true$"
    with pytest.raises(SimrobError, match=match):
        load_station(
            station,
            {f"pieces.{piece}": {"model": "box", "parent": None, "pose": [0, 0, 0.1, 0, 0, 0]}},
        )


def test_numbers_in_exponents_are_numbers(tmp_path):
    (tmp_path / "own.yaml").write_text("robot: {model: irb120}\nduration: 1e-1\n")
    assert load_station(tmp_path / "own.yaml").duration == pytest.approx(0.1)


def test_defaults_that_a_function_makes_were_not_given_by_anybody():
    """Pydantic gives no default for such a field unless it is asked to call the function."""
    entry = {"kind": "leg_odometry", "reads": {}}
    losses = KeyLosses(counts_defaults=False)

    losses.begin_new_kind(entry, ["sensors", "base"], "imu")

    assert not losses.texts

    entry = {"kind": "leg_odometry", "reads": {"q": "robot.q"}}
    losses.begin_new_kind(entry, ["sensors", "base"], "imu")

    assert "reads" in losses.texts[0]


def test_a_robot_may_be_called_as_the_key_of_an_origin():
    """New content of the robot `model` does not remove the robot `urdf`, as a key `model` removes the key `urdf`."""
    content = {"robots": {name: {"model": "irb120"} for name in ("model", "urdf")}}

    config = load_station(content, {"robots.model": {"model": "double_pendulum"}})

    models = {name: robot.model for name, robot in config.robots.items()}
    assert models == {"model": "double_pendulum", "urdf": "irb120"}


def test_the_file_of_a_robot_is_no_station_and_the_command_that_makes_one_is_named(tmp_path):
    """The error listed all stations of the package."""
    file = tmp_path / "arm.urdf"
    file.write_text("<robot name='arm'/>")

    with pytest.raises(SimrobError, match=r"is the file of a robot.*; simrob station .*arm\.urdf"):
        load_station(file)


def test_an_index_in_the_servos_of_several_robots_does_not_empty_them():
    """It replaced the gain by an empty list, and the error spoke of that list."""
    with pytest.raises(SimrobError, match=r"servo\.kp: is 1000, so it has no key '0'"):
        load_station("two_irb120", {"servo.kp.0": 500})


@pytest.mark.parametrize("wrong", ["meshes", 5])
def test_folders_of_meshes_that_are_no_list_are_refused_beside_the_argument_too(tmp_path, wrong):
    """A text was taken for the folders of its letters, and a number gave a bare TypeError."""
    robot = {"urdf": "arm.urdf", "import_options": {"mesh_path": wrong}}

    with pytest.raises(SimrobError, match=r"import_options\.mesh_path"):
        load_station({"robot": robot}, mesh_path=[tmp_path])
