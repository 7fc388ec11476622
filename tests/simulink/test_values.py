"""MATLAB expressions, code, workspaces and units."""

import numpy as np
import pytest

from simrob_drake.errors import InvalidParameter
from simrob_drake.simulink.values.evaluate import UndefinedVariable
from simrob_drake.simulink.values.syntax import NotUnderstood
from simrob_drake.simulink.values.units import UnknownUnit, factor
from simrob_drake.simulink.values.workspace import Workspace, given_variables

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
        ("max([1 7 3])", [[7]]),
        ("sum([1 2;3 4])", [[4, 6]]),
        ("cosd(60)", [[0.5]]),
        ("linspace(0,1,3)", [[0, 0.5, 1]]),
        ("repmat([1 2],2,1)", [[1, 2], [1, 2]]),
        ("(1<2) && ~(3==4)", [[1]]),
        ("zeros(2,1)", [[0], [0]]),
        ("1 ... of two\n + 2", [[3]]),
    ],
)  # fmt: skip
def test_expressions(text, expected):
    np.testing.assert_allclose(Workspace(variables=dict(VARIABLES)).value(text), expected, atol=1e-12)


def test_texts_and_structures():
    workspace = Workspace(variables=dict(VARIABLES))
    assert workspace.value("'it''s'") == "it's"
    assert workspace.value("['a' 'b']") == "ab"
    assert workspace.value("tool.name") == "gripper"


@pytest.mark.parametrize(
    "text",
    ["1 +", "[1 2", "(1", "1)", "{1}", "@sin", "v(0)", "v(4)", "v(1.5)", "[1 2]+[1 2 3]", "ones(1e4,1e4)", "1:1e9",
     "tool+1", "'a'*2", "__import__('os')", "system('ls')(", "(" * 200 + "1" + ")" * 200, "eye(-1)"],
)  # fmt: skip
def test_what_is_no_expression_is_refused(text):
    with pytest.raises((NotUnderstood, UndefinedVariable)):
        Workspace(variables=dict(VARIABLES)).value(text)


def test_unknown_names_are_told():
    with pytest.raises(UndefinedVariable) as told:
        Workspace(variables=dict(VARIABLES)).value("2*q0_(1)")
    assert told.value.name == "q0_"
    with pytest.raises(UndefinedVariable) as told:
        Workspace(variables=dict(VARIABLES)).value("tool.mass")
    assert told.value.name == "tool.mass"


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
    workspace = Workspace(name="Mask", variables={"kind": "b"}, code=code)
    expected = {"contact.b": 100, "r": [[0, 0, 2]], "d": 1, "e": 2, "s": [[1, 4, 9]], "m": [[1, 2], [3, 4]]}
    for name, value in expected.items():
        np.testing.assert_allclose(workspace.value(name), np.atleast_2d(value), err_msg=name)
    for name in ("f", "g"):
        with pytest.raises(UndefinedVariable) as told:
            workspace.value(name)
        assert "Mask" in told.value.why


def test_masks_look_outward_and_are_evaluated_outside():
    outer = Workspace(variables={"a": 2.0, "b": 5.0})
    inner = Workspace(outer=outer, pending={"a": lambda: outer.value("a*10")})
    assert inner.value("a + b") == 25.0
    broken = Workspace(outer=outer, pending={"c": lambda: outer.value("missing")})
    for _ in range(2):
        with pytest.raises(UndefinedVariable, match="missing"):
            broken.value("c")


def test_variables_of_the_user(tmp_path):
    from scipy.io import savemat

    savemat(tmp_path / "a.mat", {"q0": [1.0, 2.0], "tool": {"mass": 3.0, "name": "x"}})
    (tmp_path / "b.m").write_text("Kq = 10*eye(2); % gains\n")
    given = given_variables({"tool.mass": "4", "w": "2*q0(2)"}, [tmp_path / "a.mat", tmp_path / "b.m"])
    assert given["tool"]["mass"] == 4
    assert given["tool"]["name"] == "x"
    assert given["w"] == 4
    assert given["Kq"][1, 1] == 10
    with pytest.raises(InvalidParameter, match="--set x"):
        given_variables({"x": "[1 2"}, [])
    (tmp_path / "c.mat").write_text("no")
    with pytest.raises(InvalidParameter, match=r"c\.mat"):
        given_variables({}, [tmp_path / "c.mat"])


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
