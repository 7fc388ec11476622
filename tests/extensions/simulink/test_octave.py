"""Code of masks outside the subset, run by GNU Octave where the user allows it."""

import shutil
import sys

import numpy as np
import pytest
from slx_files import INERTIA, REVOLUTE, WORLD, Level, mask, write_model

from simrob_drake.base.errors import InvalidModel, InvalidParameter
from simrob_drake.extensions.simulink.simulink_model import read_simulink, undefined_variables

CODE = "set_param(gcb, 'x', '1'); total = feval('plus', m, 2*m); parts.one = total;"
FAKE = """#!{python}
import sys
from pathlib import Path
from scipy.io import loadmat, savemat
given = loadmat("given.mat")
assert "feval('plus'" in Path(sys.argv[-1]).read_text() and Path("set_param.m").is_file()
m = given["m"].item()
savemat("found.mat", {{"total": 3 * m, "parts": {{"one": 3 * m}}, "m": 99.0}})
"""


def model(tmp_path):
    """A hinge with a body whose mass is what a call in its mask's code gives."""
    level, inner = Level(), Level(first=50)
    world = level.block(WORLD, "World")
    joint, body = (
        inner.block(REVOLUTE, "J"),
        inner.block(INERTIA, "Rod", Mass="total", MomentsOfInertia="parts.one*[1 1 1]"),
    )
    port = inner.block("PMIOPort", "F", Side="Left")
    inner.connect(f"{port}#rconn:1", f"{joint}#lconn:1")
    inner.connect(f"{joint}#rconn:1", f"{body}#rconn:1")
    arm = level.block("SubSystem", "Arm", mask=mask(CODE, m="0.5"), inner=inner.xml())
    level.connect(f"{world}#rconn:1", f"{arm}#lconn:1")
    return write_model(tmp_path / "a.slx", level)


def figures(read):
    (solid,) = (solid for body in read.bodies.bodies for solid in body.solids)
    return solid.weight


def test_without_it_the_variables_are_named(tmp_path):
    problem = undefined_variables(read_simulink(model(tmp_path)))
    assert isinstance(problem, InvalidModel)
    assert "total (it is set by code of 'Arm' that only MATLAB runs) (Arm/Rod: Mass)" in str(
        problem
    )


@pytest.mark.skipif(sys.platform == "win32", reason="a script as a program")
def test_a_program_gets_what_is_known_and_gives_what_is_not(tmp_path, monkeypatch):
    program = tmp_path / "bin" / "octave-cli"
    program.parent.mkdir()
    program.write_text(FAKE.format(python=sys.executable))
    program.chmod(0o755)
    monkeypatch.setenv("PATH", str(program.parent))
    read = read_simulink(model(tmp_path), octave=True)
    assert undefined_variables(read) is None
    assert figures(read).mass == 1.5


@pytest.mark.skipif(shutil.which("octave-cli") is None, reason="without GNU Octave")
def test_octave_itself(tmp_path):
    weight = figures(read_simulink(model(tmp_path), octave=True))
    assert weight.mass == 1.5
    np.testing.assert_allclose(np.diagonal(weight.inertia), 1.5)


def test_without_the_program_it_is_refused(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(
        InvalidParameter,
        match=r"--octave: no program .* is found; install GNU Octave, or leave it out",
    ):
        read_simulink(model(tmp_path), octave=True)
