"""Xacro files that try to run code, to read what is not theirs or to take the machine: all refused, in one line."""

import importlib.util
import math
import os
import subprocess
import sys

import pytest

from simrob_drake.base.errors import InvalidConfig, InvalidModel
from simrob_drake.importer.importing import examine_robot
from simrob_drake.importer.reading import child
from simrob_drake.importer.reading.expressions import NotAllowed, evaluate, symbols
from simrob_drake.robots.imports import ImportReport
from simrob_drake.stations.load import load_station

HEAD = '<robot name="arm" xmlns:xacro="http://www.ros.org/wiki/xacro"><link name="base"/>'
REWRITES_THE_GUARD = (
    "${(lambda p,s,d: (s.modules['__main__'].__dict__.update(_HARMLESS=p('H',(),d(__contains__=lambda s,e: 1==1))()), "
    "s.modules['os'].system('touch FILE')))((lambda: ().__class__.__class__)(), (lambda: [c for c in "
    "().__class__.__base__.__subclasses__() if c.__name__=='_wrap_close'][0].__init__.__globals__['sys'])(), dict)}"
)
SUBCLASSES = "().__class__.__base__.__subclasses__()"
FINDS_A_MODULE = f"[c.__init__.__globals__['system']('touch FILE') for c in {SUBCLASSES}]"
ATTACKS = {
    "a lambda that rewrites its guard": REWRITES_THE_GUARD,
    "no lambda, a comprehension": f"${{{FINDS_A_MODULE}}}",
    "the module behind a function": "${xacro.load_yaml.__globals__['os'].system('touch FILE')}",
    "the frame behind a generator": "${(x for x in [1]).gi_frame.f_builtins['open']('FILE', 'w')}",
    "the module behind a method": "${''.join.__self__.__class__}",
    "types that make types": "${python.type('X', (), dict())}",
    "a key that is an attribute": "${python.vars(math)}",
    "the other eval": "$(eval find.__globals__['os'].environ)",
    "a function that calls what it is given": "${list(map(xacro.load_yaml.run, ['FILE']))}",
    "an argument list": "${max(*[str.__class__])}",
    "the end of the process": f"${{{SUBCLASSES}[0].__init__.__globals__['_exit'](0)}}",
}
GREED = [
    "10 ** 10 ** 10",
    "(2 ** 2000) ** 2",
    "'x' * 10 ** 10",
    "'%99999999d' % 1",
    "'%*d' % (99999999, 1)",
    "[0] * 10 ** 10",
    "list(range(10 ** 10))",
    "('x' * 100000).join(['y' for i in range(900)])",
    "('x' * 1000).replace('x', 'y' * 10000)",
    "[[[[[[[0] * 9] * 9] * 9] * 9] * 9] * 9] * 9",
    "[[0] * 9000 for i in range(9000)]",
    "python.sum([[0] * 9, [1]], [])",
    "1 " + "+ 1" * 10000,
    "(" * 5000 + "1" + ")" * 5000,
    "-" * 15000 + "1",
]
SAME = [
    "2 * (3 - 1) / 4 // 1 % 7 ** 2",
    "-1.5e-3 + +2",
    "'a' + 'b' * 3",
    "'%.3f %s' % (pi, [1])",
    "1 < 2 <= 2 != 3 == 3",
    "1 < 2 > 5 or None and 3",
    "not '' and 'a' in 'cab' and 4 not in [1, 2]",
    "'right' if max(1, 2) is None else 'left'",
    "[1, (2, 'x'), {'a': True}][2]['a']",
    "'abcdef'[1:-1:2] + 'xyz'[-1]",
    "round(radians(30) * sin(1) + atan2(1, 2), 5)",
    "list(map(float, '1 2.5'.split()))",
    "[k.upper() + str(v) for k, v in dict(a=1, b=[2]).items()]",
    "sorted([3, 1, 2], reverse=True) + list(range(3))",
    "' '.join([f.strip() for f in 'A ;b'.lower().split(';')])",
    "len([1, 2].pop(0) * 'ab') + int('7') + 'abc'.find('c')",
    "round(12345.678, 2) + round(12345, -2)",
    "sqrt(16) + ceil(1.2) + hypot(3, 4) + degrees(pi)",
]

NAMES = symbols(abs_filename=str, load_yaml=str)
installed = pytest.mark.skipif(
    importlib.util.find_spec("xacro") is None, reason="needs the extra xacro"
)


def xacro_file(folder, text):
    """Write a xacro file with a text as an attribute."""
    escaped = (
        text.replace("FILE", str(folder / "owned")).replace("<", "&lt;").replace('"', "&quot;")
    )
    (folder / "arm.xacro").write_text(f'{HEAD}<link name="{escaped}"/></robot>')
    return folder / "arm.xacro"


@installed
@pytest.mark.parametrize("attack", ATTACKS.values(), ids=ATTACKS)
def test_no_code_runs(tmp_path, attack):
    with pytest.raises(InvalidModel) as refusal:
        examine_robot(xacro_file(tmp_path, attack))
    told = str(refusal.value)
    assert "xacro cannot expand the file" in told
    assert "is not allowed" in told or "is no function" in told or "there is no key" in told
    assert not (tmp_path / "owned").exists()


@pytest.mark.long
@installed
def test_nor_does_it_through_a_station(tmp_path):
    file = xacro_file(tmp_path, REWRITES_THE_GUARD)
    (tmp_path / "station.yaml").write_text("robot: {urdf: arm.xacro}\n")

    with pytest.raises(InvalidConfig, match="Lambda is not allowed in an expression"):
        load_station(tmp_path / "station.yaml")
    assert not (tmp_path / "owned").exists()

    plain = [sys.executable, "-c", "import os, subprocess, xacro; xacro.main()", str(file)]
    subprocess.run(plain, capture_output=True, check=False)

    assert (tmp_path / "owned").exists()  # so it was not xacro that refused it


@pytest.mark.parametrize("greed", GREED)
def test_nothing_grows_without_bound(greed):
    with pytest.raises((NotAllowed, TypeError, RecursionError, MemoryError, SyntaxError)):
        evaluate(greed, NAMES)


def test_nor_do_lists_that_double_each_other():
    names = dict(NAMES, p=[0])
    for _ in range(15):
        names["p"] = evaluate("[p, p]", names)
    with pytest.raises(NotAllowed, match="a value of more than 1000000 characters"):
        evaluate("[[p, p], [p, p]]", names)


@pytest.mark.parametrize("text", SAME)
def test_what_is_allowed_means_what_it_means_in_python(text):
    assert evaluate(text, NAMES) == eval(text, vars(math).copy())


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("lambda: 1", "Lambda is not allowed"),
        ("f'{1}'", "JoinedStr is not allowed"),
        ("(x := 1)", "NamedExpr is not allowed"),
        ("[x for x in [1] if x]", "a comprehension with conditions"),
        ("b'x'", "a value of the type bytes"),
        ("1j", "a value of the type complex"),
        ("1 << 2", "LShift is not allowed"),
        ("max(**dict(a=1))", "** before an argument is not allowed"),
        ("'x'.encode()", ".encode of a str is not allowed"),
        ("len.run", ".run of a Function is not allowed"),
        ("3(1)", "3 is no function"),
        ("math.gremlin", "there is no key 'gremlin'"),
        ("open('x')", "name 'open' is not defined"),
    ],
)
def test_what_is_not_allowed_is_named(text, problem):
    with pytest.raises((NotAllowed, NameError)) as refusal:
        evaluate(text, NAMES)
    assert problem in str(refusal.value)


ENTRY_KINDS = """
import ctypes, os, socket, subprocess
from simrob_drake.importer.reading import child
print(SHUT)
deeds = dict(
    read=lambda: open("/etc/hostname"), folder=lambda: os.listdir("/"), write=lambda: open("FILE", "w"),
    node=lambda: os.mknod("FILE"), start=lambda: subprocess.run(["touch", "FILE"]), fork=os.fork,
    signal=lambda: os.kill(os.getpid(), 0), connect=lambda: socket.socket(), link=lambda: os.symlink("a", "FILE"),
)
for name, deed in deeds.items():
    try:
        deed()
    except (OSError, MemoryError):
        continue
    print(name)
print("end", len(os.environ))
"""


def confined(folder, shut):
    """Return what a process that was shut in by a call could still do, behind what that call said."""
    code = ENTRY_KINDS.replace("FILE", str(folder / "owned")).replace("SHUT", shut)
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=False
    )
    return done.stdout.split()


@pytest.mark.skipif(sys.platform != "linux", reason="other systems have neither of them")
def test_what_would_get_through_is_held_by_the_system(tmp_path):
    said, *done, end, variables = confined(tmp_path, "*child.confine(20), 'all'")
    if said != "all":
        pytest.skip(f"this kernel has no {said}")

    assert done == []
    assert (end, variables) == ("end", "0")
    assert not (tmp_path / "owned").exists()


@pytest.mark.skipif(sys.platform != "linux", reason="other systems have neither of them")
def test_each_of_the_two_holds_alone(tmp_path):
    alone = "child._shut_files(child._system())"
    said, *done, end, _ = confined(tmp_path, alone)
    if said == "True":
        assert end == "end"
        assert not {"read", "folder", "write", "node", "link"} & set(done)


def test_a_system_without_any_says_so(monkeypatch):
    monkeypatch.setattr(child.sys, "platform", "darwin")
    monkeypatch.setattr(child.resource, "setrlimit", lambda *_: None)

    monkeypatch.setattr(os, "environ", {})

    assert child.confine(20) == ["Landlock", "seccomp"]


@pytest.mark.parametrize("line", ["5", "[]", "null", "{}", '{"end": 1}', "no JSON"])
def test_a_process_that_sends_anything_else_has_failed(tmp_path, monkeypatch, line):
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "hostile.py").write_text(f"print({line!r}, flush=True)\n")

    with pytest.raises(child.ChildFailed):
        child.in_child("hostile", {}, lambda *_: None, ImportReport(tmp_path), seconds=20)
