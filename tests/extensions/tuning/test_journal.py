"""Journals that are damaged: one line says which line of which file, and what to do; nothing else is believed."""

import json

import pytest
import yaml

from simrob_drake.base.errors import InvalidConfig, SimrobError
from simrob_drake.cli import ExitCode
from simrob_drake.cli.app import run_command
from simrob_drake.extensions.tuning import sweep_folder
from simrob_drake.extensions.tuning.journal import ROWS, plain
from simrob_drake.extensions.tuning.study import Study
from simrob_drake.extensions.tuning.study_folder import WINNER, StudyFolder, winner_of
from simrob_drake.extensions.tuning.sweep import Sweep
from simrob_drake.extensions.tuning.sweep_folder import SweepFolder
from tests.extensions.tuning.test_study import PENDULUM

OVERRIDES = {"duration": 0.02, "reference.duration": 0.01}
SWEEP = Sweep(station="double_pendulum", vary={"servo.kp": "20,40"}, overrides=OVERRIDES)
STUDY = Study(
    **{
        **PENDULUM,
        "overrides": OVERRIDES,
        "trials": 2,
        "together": 2,
        "search": {},
        "method": "random",
    }
)
FOLDERS = {"sweep": (SweepFolder, SWEEP), "study": (StudyFolder, STUDY)}


@pytest.fixture(scope="module", autouse=True)
def _no_plots():
    """Draw nothing."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sweep_folder, "save_sweep_plots", lambda *_: None)
        yield


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Folders of a sweep and of a study that have ended, and the two lines of their journals."""
    found = {}
    for name, (kind, asked) in FOLDERS.items():
        folder = tmp_path_factory.mktemp(name) / name
        kind(folder, asked).run(progress=False)
        found[name] = folder, (folder / ROWS).read_bytes().splitlines(keepends=True)
    return found


def changed(line, **more):
    """Return a line whose first row has other columns; None leaves one out."""
    record = json.loads(line)
    row = {
        key: value
        for key, value in {**record["rows"][0], **more}.items()
        if more.get(key, value) is not None
    }
    return json.dumps({**record, "rows": [row]}).encode() + b"\n"


def swap(old, new):
    """Return what damages the second of two lines."""
    return lambda one, two: one + two.replace(old, new)


DAMAGES = {
    "a torn line in the middle": (lambda one, two: one[:40] + b"\n" + two, "line 1: is not JSON"),
    "null": (lambda one, two: one + b"null\n", "line 2: "),
    "a list": (lambda one, two: one + b"[]\n", "line 2: "),
    "an empty line": (lambda one, two: one + b"\n" + two, "line 2: is not JSON"),
    "a line twice": (lambda one, two: one + two + one, "line 3: run 1 stands there before"),
    "a number of none": (swap(b'"number": 2', b'"number": 77'), "line 2: run 77: is none"),
    "a number that is a text": (swap(b'"number": 2', b'"number": "2"'), "line 2: number"),
    "another kind of value": (
        lambda one, two: one + changed(two, tracking_error="x"),
        "line 2: tracking_error",
    ),
    "no end": (
        lambda one, two: one + changed(two, ended=None),
        "line 2: ended: this key is required",
    ),
    "no rows": (lambda one, two: b'{"number": 1, "rows": []}\n', "line 1: rows"),
    "not a number": (
        swap(b'"ended"', b'"a": NaN, "ended"'),
        "line 2: is not JSON: NaN is not a finite number",
    ),
    "beyond floats": (swap(b'"ended"', b'"a": 1e999, "ended"'), "1e999 is not a finite"),
    "a key twice": (swap(b'"ended"', b'"ended": "a", "ended"'), "a key occurs twice"),
    "of something else": (
        lambda one, two: one + changed(two, **{"servo.kp": 40.5}),
        "line 2: run 2: is ",
    ),
    "nested without end": (
        lambda one, two: one + b"[" * 10**6 + b"\n",
        "line 2: is not JSON: too many levels",
    ),
    "huge": (lambda one, two: one + b" " * 11 * 10**6 + b"\n", "line 2: is longer than 10 MB"),
    "binary": (
        lambda one, two: one + bytes(range(128, 250)) + b"\n",
        "line 2: is no text in UTF-8",
    ),
    "zeros": (lambda one, two: one + b"\0" * 5000 + b"\n", "line 2: is not JSON"),
}


@pytest.mark.parametrize("name", FOLDERS)
@pytest.mark.parametrize("kind", DAMAGES)
def test_a_damaged_line_is_named_and_is_made_again_when_it_is_deleted(whole, name, kind):
    if (name, kind) in (("study", "a number of none"), ("study", "of something else")):
        pytest.skip("more trials may be asked for, and what they are the search says: see below")
    damage, told = DAMAGES[kind]
    folder, (one, two) = whole[name]
    (folder / ROWS).write_bytes(damage(one, two))
    try:
        with pytest.raises(InvalidConfig) as refused:
            FOLDERS[name][0].there(folder)
    finally:
        (folder / ROWS).write_bytes(one + two)
    message = str(refused.value)
    assert told in message
    assert message.startswith(f"{folder / ROWS}: line ")
    assert message.endswith("; delete the line, and its run is made again")
    assert len(message) < 700


@pytest.mark.parametrize("name", FOLDERS)
def test_what_is_lost_is_made_again_to_the_last_byte(whole, name):
    """Behind a torn line, also where the first trial is lost and the second is there."""
    folder, (one, two) = whole[name]
    kind, asked = FOLDERS[name]
    for kept, torn, after in (
        (one, two[:-1], one + two),
        (two, b"\xc3", two + one),
        (b"", one[:9], one + two),
    ):
        (folder / ROWS).write_bytes(kept + torn)
        kind(folder, asked).run(progress=False)
        assert (folder / ROWS).read_bytes() == after


def test_trials_of_another_search_are_refused_when_it_goes_on(whole):
    folder, (one, two) = whole["study"]
    (folder / ROWS).write_bytes(one + changed(two, **{"servo.kp": 40.5}))
    with pytest.raises(
        InvalidConfig, match=r"rows\.jsonl: holds trials of a search by other versions"
    ):
        StudyFolder.there(folder).run(progress=False)
    (folder / ROWS).write_bytes(one + two)


@pytest.mark.parametrize("command", [["sweep", "sweep"], ["tune", "study.yaml", "--out", "study"]])
def test_the_commands_say_it_in_one_line(whole, command, tmp_path, monkeypatch, capsys):
    name = command[-1]
    folder, (one, two) = whole[name]
    monkeypatch.chdir(tmp_path)
    (tmp_path / name).symlink_to(folder)
    (tmp_path / "study.yaml").write_text(
        yaml.safe_dump(STUDY.model_dump(mode="json", exclude_defaults=True))
    )
    (folder / ROWS).write_bytes(one + b"null\n")
    try:
        assert run_command(command) == ExitCode.BAD_INPUT
    finally:
        (folder / ROWS).write_bytes(one + two)
    assert (
        capsys.readouterr().err.splitlines()[-1].startswith(f"simrob: {name}/rows.jsonl: line 2: ")
    )


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (
            "servo.kp: '1e3'\nservo.kd: 3",
            r"winner.yaml: servo.kp: must be a value that the study may try \(it is '1e3'\)",
        ),
        ("servo.kp: 30", "winner.yaml: must hold figures of servo.kp, servo.kd"),
        ("{servo.kp: .nan, servo.kd: 1}", "winner.yaml: servo.kp: must be a value .*nan"),
        ("[1]", "winner.yaml: must contain a mapping"),
    ],
)
def test_a_winner_that_was_edited_is_looked_at(tmp_path, text, told):
    (tmp_path / WINNER).write_text(text)
    with pytest.raises(SimrobError, match=told):
        winner_of(tmp_path, STUDY)


def test_plain_values_are_those_of_json():
    given = {
        "a": (1, float("nan")),
        3: [float("-inf"), True, None],
        "b": 10**400,
        "c": {"d": object},
    }
    assert plain(given) == {
        "a": [1, None],
        "3": [None, True, None],
        "b": str(10**400),
        "c": {"d": "<class 'object'>"},
    }
    assert json.loads(json.dumps(plain(given))) == plain(given)
