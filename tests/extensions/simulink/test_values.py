"""MATLAB expressions, code, workspaces and units."""

import io
import struct
import zlib

import numpy as np
import pytest
from scipy.io import savemat
from slx_files import INERTIA, Level, write_model

from simrob_drake.base.errors import InvalidParameter
from simrob_drake.extensions.simulink.reading.model_file import Libraries
from simrob_drake.extensions.simulink.simulink_model import read_simulink
from simrob_drake.extensions.simulink.values import mat
from simrob_drake.extensions.simulink.values.code import CodeRun
from simrob_drake.extensions.simulink.values.evaluate import UndefinedVariable
from simrob_drake.extensions.simulink.values.mat import variables_of_mat
from simrob_drake.extensions.simulink.values.syntax import NotUnderstood
from simrob_drake.extensions.simulink.values.units import UnknownUnit, factor
from simrob_drake.extensions.simulink.values.workspace import Variables, variables_of

VARIABLES = {
    "L": 3.0,
    "v": np.array([[1.0, 2.0, 3.0]]),
    "tool": {"base": np.array([[1.0, 2, 3, 4, 5, 6]]), "name": "gripper"},
}


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("1e3", [[1000]]),
        ("-2^2", [[-4]]),
        ("2^-1", [[0.5]]),
        ("find([0 2 0 3 4] > 1, 2)", [[2, 4]]),
        ("find([0; 2; 3])", [[2], [3]]),
        ("2^3^2", [[64]]),
        ("[1 -2 3]", [[1, -2, 3]]),
        ("[1 - 2]", [[-1]]),
        ("[1 , 2; 3 4]'", [[1, 3], [2, 4]]),
        ("[v' v']", [[1, 1], [2, 2], [3, 3]]),
        ("[L/2 0 3*L/2]", [[1.5, 0, 4.5]]),
        ("v(2)", [[2]]),
        ("v(end)", [[3]]),
        ("v(2:end)", [[2, 3]]),
        ("v(:)", [[1], [2], [3]]),
        ("tool.base(4:6)", [[4, 5, 6]]),
        ("tool.base(1,end)", [[6]]),
        ("(90:-45:-90)*pi/180", [[np.pi / 2, np.pi / 4, 0, -np.pi / 4, -np.pi / 2]]),
        ("0:0.1:0.3", [[0, 0.1, 0.2, 0.3]]),
        ("diag([1 2])*[3;4]", [[3], [8]]),
        ("1e2*eye(2)", [[100, 0], [0, 100]]),
        ("[1 2].*[3 4] + 1", [[4, 9]]),
        ("[2 4]/2", [[1, 2]]),
        ("[2 1;1 3]\\[3;5]", [[0.8], [1.4]]),
        ("norm([3 4])", [[5]]),
        ("[norm([3 -4], 1) norm([3; 4], 2) norm([3 4; 0 0])]", [[7, 5, 5]]),
        ("max([1 7 3])", [[7]]),
        ("sum([1 2;3 4])", [[4, 6]]),
        ("cosd(60)", [[0.5]]),
        ("linspace(0,1,3)", [[0, 0.5, 1]]),
        ("inv([2 0; 1 4])", [[0.5, 0], [-0.125, 0.25]]),
        ("[det([2 0; 1 4]) trace([2 0; 1 4])]", [[8, 6]]),
        ("kron([1 2], [1; 3])", [[1, 2], [3, 6]]),
        ("[fliplr(v); transpose(v')]", [[3, 2, 1], [1, 2, 3]]),
        ("flipud([v; -v])", [[-1, -2, -3], [1, 2, 3]]),
        ("[diff(v) cumsum(v)]", [[1, 1, 1, 3, 6]]),
        ("diff([1 2; 4 8])", [[3, 6]]),
        ("unwrap([0; 7])", [[0], [7 - 2 * np.pi]]),
        ("repmat([1 2],2,1)", [[1, 2], [1, 2]]),
        ("(1<2) && ~(3==4)", [[1]]),
        ("zeros(2,1)", [[0], [0]]),
        ("1 ... of two\n + 2", [[3]]),
        ("1 + 2 ...", [[3]]),
        ("[int16(2.5) uint8([-3 300]) int8(-2.5) int32(NaN)]/4", [[0.75, 0, 63.75, -0.75, 0]]),
    ],
)  # fmt: skip
def test_expressions(text, expected):
    np.testing.assert_allclose(
        Variables(variables=dict(VARIABLES)).value(text), expected, atol=1e-12
    )


def test_texts_and_structures():
    workspace = Variables(variables=dict(VARIABLES))
    assert workspace.value("'it''s'") == "it's"
    assert workspace.value("['a' 'b']") == "ab"
    assert workspace.value('["on" "off"]') == ["on", "off"]  # strings stay apart, unlike texts
    assert workspace.value("tool.name") == "gripper"


@pytest.mark.parametrize(
    "text",
    ["1 +", "[1 2", "(1", "sum(1 2)", "sum([1 2]; 1)", "[v(1)v(2)]", "1)", "{1", "{1}+1",
     "@sin", "v(0)", "v(4)", "v(1.5)", "[1 2]+[1 2 3]", "ones(1e4,1e4)", "1:1e9",
     "tool+1", "'a'*2", "__import__('os')", "system('ls')(", "(" * 200 + "1" + ")" * 200, "eye(-1)"],
)  # fmt: skip
def test_what_is_no_expression_is_refused(text):
    with pytest.raises((NotUnderstood, UndefinedVariable)):
        Variables(variables=dict(VARIABLES)).value(text)


def test_unknown_names_are_told():
    with pytest.raises(UndefinedVariable) as told:
        Variables(variables=dict(VARIABLES)).value("2*q0_(1)")
    assert told.value.name == "q0_"
    with pytest.raises(UndefinedVariable) as told:
        Variables(variables=dict(VARIABLES)).value("tool.mass")
    assert told.value.name == "tool.mass"
    with pytest.raises(UndefinedVariable) as told:  # which is a function's name as well
        Variables(variables=dict(VARIABLES)).value("linspace(0, tf, 5)")
    assert told.value.name == "tf"


@pytest.mark.long
def test_mask_code():
    code = """% a comment with x = 7
contact.k = 1e3; % [N/m]
contact.b = contact.k/10; r(3) = 2;
if contact.k > 5 && true
  d = 1;
elseif contact.k > 1
  d = 2;
else, d = 3;
end
switch kind
  case 'a'
    e = 1;
  case {'b', 'c'}
    e = 2;
end
for i = 1:3
  s(i) = i^2;
end
m = [1 2
     3 4];
set_param(gcb, 'Value', 'x=1'); f = get_param(gcb, 'Name');
while true, g = 1; end
"""
    workspace = Variables(name="Mask", variables={"kind": "b"}, code=code)
    expected = {
        "contact.b": 100,
        "r": [[0, 0, 2]],
        "d": 1,
        "e": 2,
        "s": [[1, 4, 9]],
        "m": [[1, 2], [3, 4]],
    }
    for name, value in expected.items():
        np.testing.assert_allclose(workspace.value(name), np.atleast_2d(value), err_msg=name)
    for name in ("f", "g"):
        with pytest.raises(UndefinedVariable) as told:
            workspace.value(name)
        assert "Mask" in told.value.why


def test_what_a_function_of_a_file_does_not_tell_is_unknown(tmp_path):
    (tmp_path / "odd.m").write_text("function y = odd(u)\ny = webread(u);\nend\n")
    level = Level()
    level.block(INERTIA, "Wheel", Mass="odd(2)")
    file = write_model(tmp_path / "a.slx", level)
    (entry,) = read_simulink(file, assume=True).report.of("defaulted")
    assert "Mass = odd(2) is unknown" in entry.text


def test_a_side_of_a_matrix_may_be_left_to_it():
    workspace = Variables(
        name="Mask",
        variables={},
        code="a = reshape([1 2; 3 4], [], 1); b = reshape([1 2; 3 4], 1, []);",
    )
    assert [workspace.value(name).tolist() for name in "ab"] == [
        [[1], [3], [2], [4]],
        [[1, 3, 2, 4]],
    ]


def test_code_that_makes_itself_without_end_is_passed_over():
    workspace = Variables(
        name="Mask", variables={}, code="s = 'eval(s)';\neval(s);\nb = 2;\neval('c = 3;');"
    )
    assert [float(workspace.value(name)[0, 0]) for name in ("b", "c")] == [2, 3]


def test_a_semicolon_behind_an_expression_changes_nothing():
    np.testing.assert_allclose(Variables(variables=VARIABLES).value("[L, 4]/2; "), [[1.5, 2.0]])


def test_masks_look_outward_and_are_evaluated_outside():
    outer = Variables(variables={"a": 2.0, "b": 5.0})
    inner = Variables(outer=outer, pending={"a": lambda: outer.value("a*10")})
    assert inner.value("a + b") == 25.0
    broken = Variables(outer=outer, pending={"c": lambda: outer.value("missing")})
    for _ in range(2):
        with pytest.raises(UndefinedVariable, match="missing"):
            broken.value("c")


def test_variables_of_the_user(tmp_path):
    savemat(tmp_path / "a.mat", {"q0": [1.0, 2.0], "tool": {"mass": 3.0, "name": "x"}})
    (tmp_path / "b.m").write_text("Kq = 10*eye(2); % gains\n")
    given = variables_of({"tool.mass": "4", "w": "2*q0(2)"}, [tmp_path / "a.mat", tmp_path / "b.m"])
    assert given["tool"]["mass"] == 4
    assert given["tool"]["name"] == "x"
    assert given["w"] == 4
    assert given["Kq"][1, 1] == 10
    with pytest.raises(InvalidParameter, match="--set x"):
        variables_of({"x": "[1 2"}, [])
    (tmp_path / "c.mat").write_text("no")
    with pytest.raises(InvalidParameter, match=r"c\.mat"):
        variables_of({}, [tmp_path / "c.mat"])


def element(kind: int, content: bytes) -> bytes:
    """Return an element of a .mat file of version 5."""
    return struct.pack("<II", kind, len(content)) + content + bytes(-len(content) % 8)


def mat_matrix(kind: int, sizes: tuple[int, int], content: bytes) -> bytes:
    flags, name = element(6, struct.pack("<II", kind, 0)), element(1, b"c")
    return element(14, flags + element(5, struct.pack("<2i", *sizes)) + name + content)


def nested(depth: int) -> bytes:
    number = mat_matrix(6, (1, 1), element(9, struct.pack("<d", 1.0)))
    for _ in range(depth):
        number = mat_matrix(1, (1, 1), number)
    return number


def packed(size: int) -> bytes:
    squeezer = zlib.compressobj()
    whole = element(6, bytes(8)) + element(5, struct.pack("<2i", 1, size)) + element(1, b"c")
    start = struct.pack("<II", 14, len(whole) + 8 + size) + whole + struct.pack("<II", 2, size)
    parts = [
        squeezer.compress(start),
        *(squeezer.compress(bytes(10**6)) for _ in range(size // 10**6)),
    ]
    content = b"".join(parts) + squeezer.flush()
    return struct.pack("<II", 15, len(content)) + content


DATA_FILE = """
%============= Solid =============%
smiData.Solid(3).mass = 0.0;
smiData.Solid(3).ID = "";
smiData.Solid(1).mass = 0.5;  % kg
smiData.Solid(1).ID = "plate*:*Default(2)";
smiData.Solid(2).mass = 7; smiData.Solid(2).inertia(2) = 4;
one(1).mass = 3; one.size = 2;
"""


@pytest.mark.parametrize("kind", ["m", "mat"])
def test_structures_of_several_elements(tmp_path, kind):
    """The data files that MATLAB writes beside an imported assembly, as a script, and saved."""
    file = tmp_path / "data.m"
    file.write_text(DATA_FILE, encoding="utf-8")
    if kind == "mat":
        several = np.array(
            [(0.5, [0, 0]), (7, [0, 4]), (0, [])], dtype=[("mass", object), ("inertia", object)]
        )
        file = tmp_path / "data.mat"
        savemat(file, {"smiData": {"Solid": several}, "one": {"mass": 3, "size": 2}})
    known = Variables(variables=variables_of({}, [file]))
    for text, expected in (("smiData.Solid(1).mass", 0.5), ("smiData.Solid(2).inertia(2)", 4), ("one(1).mass", 3),
                           ("smiData.Solid(end).mass", 0), ("one.size", 2)):  # fmt: skip
        assert known.value(text)[0, 0] == expected, text
    for wrong in ("smiData.Solid(4).mass", "smiData.Solid.mass", "one(2).mass"):
        with pytest.raises(NotUnderstood):
            known.value(wrong)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (nested(5000), "nests cells or structures more than 50 deep"),
        (
            mat_matrix(1, (1, 500_000_000), b""),
            "counts 1 x 500000000 entries, and has no bytes for them",
        ),
        (mat_matrix(6, (-4, -4), b""), "counts -4 x -4 entries"),
        (None, "unpacks to more than 200 MB"),
        (mat_matrix(6, (0, 0), b"") * 2000, "holds more than 6000 elements"),
    ],
    ids=["deep", "empty", "negative", "packed", "many"],
)
def test_mat_files_that_grow_beyond_bounds_are_refused(tmp_path, monkeypatch, content, words):
    """The first one ended the process, the second took 4 GB and half a minute."""
    monkeypatch.setattr(mat, "_MOST_ELEMENTS", 6000)
    file = tmp_path / "bomb.mat"
    bomb = packed(300_000_000) if content is None else content
    file.write_bytes(b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM" + bomb)
    with pytest.raises(InvalidParameter, match=words):
        variables_of_mat(file)


@pytest.mark.parametrize("compressed", [False, True])
def test_mat_files_within_bounds_are_read(tmp_path, compressed):
    deep: object = 7.0
    for _ in range(10):
        deep = {"inner": deep}
    content = {
        "deep": deep,
        "list": np.array([[1.0, "two"]], dtype=object),
        "none": np.zeros((0, 3)),
        "long": np.eye(300),
    }
    savemat(tmp_path / "a.mat", content, do_compression=compressed)
    found = variables_of_mat(tmp_path / "a.mat")
    assert np.array_equal(found["long"], np.eye(300))
    for _ in range(9):
        found["deep"] = found["deep"]["inner"]
    assert found["deep"] == {"inner": 7.0}


@pytest.mark.parametrize(
    ("unit", "like", "expected"),
    [
        ("cm", "m", 0.01),
        ("deg", "rad", np.pi / 180),
        ("kg/(m^3)", "kg/m^3", 1),
        ("g/cm^3", "kg/m^3", 1000),
        ("N*m/(deg/s)", "N*m*s/rad", 180 / np.pi),
        ("m^2*kg/s/rad", "N*m*s/rad", 1),
        ("kg/s", "N*s/m", 1),
        ("lbf", "N", 4.4482216152605),
        ("rpm", "rad/s", np.pi / 30),
        ("1/s", "Hz", 1),
    ],
)
def test_units(unit, like, expected):
    assert factor(unit, like) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("unit", ["kg", "furlong", "m/", "m)", "(m", "m^99", "", "m m", "2*m"])
def test_units_that_do_not_fit(unit):
    with pytest.raises(UnknownUnit):
        factor(unit, "m")


@pytest.mark.parametrize(
    ("code", "name", "value"),
    [
        ("n = 1; while n < 20, n = 3*n; end", "n", 27),
        ("c = {2, 'a', [3 4]}; x = c{3}(2) + length(c);", "x", 7),
        ("s = struct('P', 4, 'kind', 'b'); x = s.P + strcmp(s.kind, \"b\");", "x", 5),
        ("if ~exist('y', 'var'), y = 2; end, x = y;", "x", 2),
        ("[a, b] = twice(3); x = a + b;", "x", 9 + 10 + 2),
        ("x = twice(3);", "x", 9),
        ("figures; x = arm.mass;", "x", 1.5),
        ("run('some/where/figures.m'), x = arm.mass;", "x", 1.5),
        ("load data; x = k;", "x", 8),
        ("x = 2./[1 4] + 3.*[1 1] + [1 2].^2 + 1.5;", "x", [[7.5, 9.0]]),
        (
            "a = [1 2 4]; x = diff(a) * circshift(a, 1)(1:2)' + polyval([1 0 2], 3);",
            "x",
            4 + 2 + 11,
        ),
        ("arm.mass = 1; arm.mass = unknowable(1); arm.length = 2; x = arm.length;", "x", 2),
        ("x = counted(1, 5, 6);", "x", 2),
        (
            "for i = 1:2, p(2*i-1,:) = [i 1]; p(2*i,:) = [0 i]; end, x = p;",
            "x",
            [[1, 1], [0, 1], [2, 1], [0, 2]],
        ),
        ("p = []; p(end+1,:) = [1 2]; p(end+1,:) = [3 4]; x = p;", "x", [[1, 2], [3, 4]]),
        (
            "x = [rot90([1 2; 3 4]) rot90([1 2; 3 4], -1); find([0 3 5]) find([0; 1; 1])'];",
            "x",
            [[2, 4, 3, 1], [1, 3, 4, 2], [2, 3, 2, 3]],
        ),
        # of a number that is not whole the floor
        (
            "n = 5; x = linspace(0, 1, n/2);",
            "x",
            [[0.0, 1.0]],
        ),
        (
            "[a, b] = max([3 9 2]); [c, d] = min([4 1; 0 7]); x = [a b c d];",
            "x",
            [[9, 2, 0, 1, 2, 1]],
        ),
        ("[c, i, k] = unique([5 3 5]); x = [c i' k'];", "x", [[3, 5, 2, 1, 2, 1, 2]]),
        (
            "x = [isscalar(2) isscalar([1 2]) isinf([1 -Inf]) atan2d(1, 1) asind(0.5)];",
            "x",
            [[1, 0, 0, 1, 45, 30]],
        ),
        ("x = interp1([1 2 4], [5 6 0], [3 2]);", "x", [[3.0, 6.0]]),
        ("y = 2;", "twice(3) + twice(y, 1)", 9 + 4),  # an expression of a block
        (
            "x = 1; c = {}; if nargs(c) > 0 && c{1} > 2, x = 5; end, if true || c{1}, x = x + 1; end",
            "x",
            2,
        ),
        (
            "t = {'a.x', 4; 'a.y', 0.5}; for k = 1:length(t), eval([t{k,1} '=' num2str(t{k,2}) ';']); end",
            "a.x + a.y",
            4.5,
        ),
    ],
)
def test_code_calls_functions_and_takes_scripts_and_variables_of_files(tmp_path, code, name, value):
    """What a function sets stays in it; a field that is not understood leaves the others."""
    (tmp_path / "twice.m").write_text(
        "function [a, b] = twice(u, k)\nif nargin < 2, k = 10; end\na = u^2; x = 7;\nb = g(a, k);\nend\n"
        "function y = g(a, k)\ny = k + 2 + 0*a;\nend\n"
    )
    (tmp_path / "figures.m").write_text("arm.mass = 1.5; % kg\n")
    (tmp_path / "nargs.m").write_text("function n = nargs(c)\nn = numel(c);\n")
    (tmp_path / "counted.m").write_text(
        "function n = counted(u, varargin)\nn = length(varargin);\n"
    )
    savemat(tmp_path / "data.mat", {"k": 8.0})
    level = Variables(name="here", code=code, files=Libraries([tmp_path]))
    np.testing.assert_allclose(level.value(name), value)
    if "unknowable" in code:
        with pytest.raises(UndefinedVariable):
            level.value("arm.mass")


def test_code_of_a_mask_may_ask_for_its_own_parameters():
    texts = {"radius": "2*r", "side": "left"}
    code = (
        "x = get_param(gcb, 'value@radius'); "
        "y = strcmp(get_param(gcb, 'side'), 'left'); "
        "z = get_param('a/b', 'side');"
    )
    mask = Variables(code=code, texts=texts, pending={"radius": lambda: 6.0})
    assert (mask.value("x"), mask.value("y")) == (6.0, 1.0)
    with pytest.raises(UndefinedVariable):
        mask.value("z")


def test_a_file_that_is_not_there_is_named(tmp_path):
    level = Variables(
        name="callbacks", code="x = 1; load other.mat; run nothing.m", files=Libraries([tmp_path])
    )
    assert level.value("x") == 1
    with pytest.raises(UndefinedVariable) as problem:
        level.value("y")
    assert (
        problem.value.why
        == "'callbacks' takes variables from nothing.m, other.mat, which is not there"
    )


def test_a_script_called_as_the_file_that_is_not_there_comes_before_a_heap_of_variables(tmp_path):
    level = Level()
    level.block(INERTIA, "Rod", Mass="m", CenterOfMass="[x y z]")
    source = {"WSDataSource": "MAT-File", "WSSourceFileName": "C:\\at home\\rod_figures.mat"}
    (tmp_path / "rod_figures.m").write_text("m = 2;")
    (tmp_path / "heap.m").write_text("m = 3; x = 0; y = 0; z = 0;")
    read = read_simulink(write_model(tmp_path / "a.slx", level, source=source), assume=True)
    assert read.bodies.bodies[0].solids[0].weight.mass == 2.0
    assert any("heap.m set it otherwise" in entry.text for entry in read.report.entries)


def test_a_model_takes_variables_from_where_it_keeps_them(tmp_path):
    """From callbacks, a script or a `.mat` file, the model file itself; what a user gives comes first."""

    def value(name, given=None, **where):
        level = Level()
        level.block(INERTIA, "Rod", Mass=name)
        read = read_simulink(write_model(tmp_path / "a.slx", level, **where), variables=given)
        return read.bodies.bodies[0].solids[0].weight.mass, [
            entry.text for entry in read.report.of("defaulted")
        ]

    (tmp_path / "figures.m").write_text("k = 3;")
    savemat(tmp_path / "kept.mat", {"k": 4.0})
    assert value("k", callbacks={"PreLoadFcn": "figures", "InitFcn": "k = 2*k;"}) == (6.0, [])
    assert value("k", {"k": np.array([[9.0]])}, callbacks={"PreLoadFcn": "figures"}) == (9.0, [])
    assert value("k", {"half": np.array([[9.0]])}, callbacks={"InitFcn": "k = 2*half;"}) == (
        18.0,
        [],
    )
    assert value(
        "k", source={"WSDataSource": "MATLAB File", "WSSourceFileName": "C:\\at home\\figures.m"}
    ) == (3.0, [])
    assert value("k", source={"WSDataSource": "MAT-File", "WSSourceFileName": "kept.mat"}) == (
        4.0,
        [],
    )
    whole = io.BytesIO()
    savemat(whole, {"w": {"k": 5.0, "name": "a"}})
    data = bytearray(whole.getvalue())
    # a model file holds it without a name, and most of the header
    data[168:176] = struct.pack("<II", 1, 0)
    assert value("k", stored=bytes(data[124:128]) + bytes(4) + bytes(data[128:])) == (5.0, [])
    assert value("k", stored=b"damaged", callbacks={"InitFcn": "k = 2; load('gone.mat')"}) == (
        2.0, ["takes variables from gone.mat, which lies in none of the folders"])  # fmt: skip


def test_what_an_index_of_three_dimensions_sets_is_not_known():
    run = CodeRun({})
    run.run("a = [1 2]; a(1, 1, 2) = 5; b = [1 2]; b(2, :) = [3 4];")
    assert run.unknown == {"a"}
    np.testing.assert_array_equal(run.variables["b"], [[1, 2], [3, 4]])
