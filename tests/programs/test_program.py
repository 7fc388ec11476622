"""A program is data: it changes by copies, and comes back from YAML as it went."""

import numpy as np
import pytest

from simrob_drake import Program
from simrob_drake.base.errors import (
    InvalidConfig,
    InvalidParameter,
    OutputError,
    SimrobError,
    UnknownName,
)
from simrob_drake.programs.errors import JointLimitExceeded
from simrob_drake.programs.moves.joints import move_of
from simrob_drake.programs.stages import postures_of
from simrob_drake.robots.catalog import load_robot

pytestmark = pytest.mark.usefixtures("no_plots")

WAVE = Program(
    description="raise an arm, wave",
    moves=(
        move_of({"HomDL": 120}, 1.0),
        move_of({"CodD": np.float32(0.1), "HomIF": -10}, 0.5),
        move_of({"CodD": 40}, 2),
    ),
    references=(move_of({"left_knee": 20}, 0.5),),
)


def damaged(tmp_path, text):
    file = tmp_path / "program.yaml"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(InvalidConfig) as problem:
        Program.load(file)
    message = str(problem.value)
    assert message.startswith(f"{file}: ")
    assert "\n" not in message
    return message.removeprefix(f"{file}: ")


class TestChanges:
    def test_each_gives_another_program(self):
        knee = move_of({"RodD": 5}, 1)

        assert [move.duration for move in WAVE.moves] == [1.0, 0.5, 2.0]
        assert WAVE.duration == 3.5
        assert WAVE.without_move(1).moves == (WAVE.moves[0], WAVE.moves[2])
        assert WAVE.without_move(-1).moves == WAVE.moves[:2]
        assert WAVE.with_inserted_move(0, knee).moves == (knee, *WAVE.moves)
        assert WAVE.with_inserted_move(3, knee).moves == (*WAVE.moves, knee)
        assert WAVE.with_replaced_move(2, knee).moves == (*WAVE.moves[:2], knee)
        assert WAVE.with_added_moves(knee, knee).moves == (*WAVE.moves, knee, knee)
        assert len(WAVE.moves) == 3
        assert WAVE.without_move(0).references == WAVE.references

    @pytest.mark.parametrize("index", [3, -4])
    def test_a_number_that_is_none_is_named(self, index):
        with pytest.raises(
            InvalidParameter,
            match=rf"index is {index}; it must be from -3 to 2: the program has 3 moves",
        ):
            WAVE.without_move(index)

    def test_nothing_can_be_taken_from_nothing(self):
        with pytest.raises(InvalidParameter, match="the program has none"):
            Program().without_move(0)

    def test_it_does_not_change_itself(self):
        with pytest.raises(ValueError, match="frozen"):
            WAVE.moves = ()


class TestFiles:
    def test_it_comes_back_as_it_went(self, tmp_path):
        file = WAVE.save(tmp_path / "wave.yaml")

        assert Program.load(file) == WAVE
        assert WAVE.without_move(0).save(file) == file  # in place of the old one
        assert Program.load(file) == WAVE.without_move(0)
        assert [path.name for path in tmp_path.iterdir()] == ["wave.yaml"]

    def test_a_folder_that_is_not_there_is_made_and_no_other_file_is_touched(self, tmp_path):
        other = tmp_path / "new" / ".wave.yaml.new"
        other.parent.mkdir()
        other.write_text("another's")
        WAVE.save(tmp_path / "new" / "inner" / "wave.yaml")

        WAVE.save(tmp_path / "new" / "wave.yaml")

        assert other.read_text() == "another's"
        with pytest.raises(OutputError, match="cannot be written: File exists"):
            WAVE.save(tmp_path / "new" / "wave.yaml" / "wave.yaml")

    @pytest.mark.parametrize(
        ("text", "message"),
        [
            ("moves: [{target_deg: {a: 1}", "is not YAML"),
            ("moves:\n  - {target_deg: {a: 1}}\n  - {target_deg: {a: ", "line 4"),
            ("- 1", "must contain a mapping"),
            ("movs: []", "movs: unknown key; did you mean 'moves'?"),
            ("moves: 3", "moves: "),
            ("moves: [3]", "move 1: must be a mapping of keys to values (it is 3)"),
            (
                "moves: [{target_deg: {a: 1}}, {target: {a: 1}}]",
                "move 2: target: unknown key; did you mean 'target_deg'?",
            ),
            ("moves: [{target_deg: {}}]", "move 1: target_deg: "),
            ("moves: [{target_deg: {a: .nan}}]", "move 1: target_deg.a: "),
            ("moves: [{target_deg: {a: '1'}}]", "move 1: target_deg.a: "),
            ("moves: [{target_deg: {a: 1}, duration: 0}]", "move 1: duration: "),
            ("moves: [{target_deg: {a: 1}, duration: yes}]", "move 1: duration: "),
            ("references: [{target_deg: {a: 1}, duration: -1}]", "reference 1: duration: "),
            ("automatic: true", "automatic needs references, and the program has none"),
            ("references: [{target_deg: {a: 1}}]\nautomatic: {timeout: 0}", "automatic.timeout"),
        ],
    )
    def test_a_damaged_one_tells_where(self, tmp_path, text, message):
        assert message in damaged(tmp_path, text)

    def test_one_that_is_missing_is_an_error(self, tmp_path):
        with pytest.raises(InvalidConfig, match="cannot be read"):
            Program.load(tmp_path / "none.yaml")


class TestOnARobot:
    def test_signs_and_units_are_those_of_the_axes(self):
        """Of the thesis's signs (annex, p. 128): both arms forward is +HomDF and +HomIF, each in its joint's sense."""
        model = load_robot("humanoid")
        start = np.linspace(-0.1, 0.1, 18)

        times, postures = postures_of(model, WAVE.moves, start)

        np.testing.assert_allclose(times, [0, 1, 1.5, 3.5])
        np.testing.assert_array_equal(postures[0], start)

        expected = start.copy()
        expected[model.axis_index("right_shoulder_roll")] = np.deg2rad(120)
        np.testing.assert_allclose(postures[1], expected)
        expected[model.axis_index("right_elbow")] = np.deg2rad(40)
        expected[model.axis_index("left_shoulder_pitch")] = np.deg2rad(-10)
        np.testing.assert_allclose(postures[3], expected)

    def test_one_program_fits_every_humanoid(self):
        wave = Program(moves=(move_of({"HomIF": 30, "CadDF": 30, "left_elbow": 5}, 1),))
        for name in ("humanoid", "roid1", "zjudancer"):
            model = load_robot(name)
            _, postures = postures_of(model, wave.moves, np.zeros(len(model.axes)))
            moved = {axis for axis, angle in zip(model.axes, postures[-1], strict=True) if angle}
            assert moved == {"left_shoulder_pitch", "right_hip_pitch", "left_elbow"}

    def test_a_limit_tells_by_how_much(self):
        model = load_robot("humanoid")
        _, upper = np.rad2deg(model.axis_limits)

        knee = model.axis_index("left_knee")

        with pytest.raises(JointLimitExceeded) as problem:
            postures_of(
                model,
                [move_of({"HomDF": 1}, 1), move_of({"RodI": upper[knee] + 12.5}, 1)],
                np.zeros(18),
            )
        assert (problem.value.axis, problem.value.value) == (
            "left_knee",
            pytest.approx(np.deg2rad(upper[knee] + 12.5)),
        )
        assert f"12.5 deg beyond its limit of {upper[knee]:.4g} deg" in str(problem.value)
        assert str(problem.value).startswith("move 2: left_knee")

    def test_the_limit_itself_can_be_reached(self):
        model = load_robot("humanoid")
        lower, upper = np.rad2deg(model.axis_limits)
        for bounds in (lower, upper):
            targets = dict(zip(model.axes, bounds, strict=True))
            _, postures = postures_of(model, [move_of(targets, 1)], np.zeros(18))
            np.testing.assert_allclose(np.rad2deg(postures[1]), bounds)

    def test_an_unknown_axis_has_a_nearest_name(self):
        with pytest.raises(UnknownName, match=r"did you mean 'left_knee'\?"):
            postures_of(load_robot("roid1"), [move_of({"left_kne": 1}, 1)], np.zeros(22))

    def test_an_axis_stands_once(self):
        with pytest.raises(
            InvalidParameter, match="left_knee: its axis has a target under another name"
        ):
            postures_of(
                load_robot("humanoid"), [move_of({"RodI": 1, "left_knee": 2}, 1)], np.zeros(18)
            )


@pytest.mark.parametrize("duration", [0, -1.0, float("nan"), float("inf"), True, "1", None])
def test_a_duration_is_a_positive_time(duration):
    with pytest.raises(InvalidParameter, match=r"duration is .*; it must be a positive time \[s\]"):
        move_of({"RodI": 1}, duration)


@pytest.mark.parametrize(
    "targets", [{}, {"RodI": float("nan")}, {"RodI": "1"}, {"RodI": True}, [1, 2], None]
)
def test_targets_are_finite_numbers_by_axis(targets):
    with pytest.raises(SimrobError, match="target_deg"):
        move_of(targets, 1)
