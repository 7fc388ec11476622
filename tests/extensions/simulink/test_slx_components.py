"""Blocks of components that a model has files of, in the Simscape language."""

import re

import numpy as np
from scipy.integrate import solve_ivp
from slx_files import Level, write_model
from test_slx_motion import TIGHT, hinges

from simrob_drake import load_station, simulate
from simrob_drake.extensions.simulink.importing import import_simulink

_STOP = """component stop
% Two stops
inputs
  w = {0, 'rad/s'}; % speed:left
  phi = {0, 'rad'}; % angle:left
end
outputs
  t = {0, 'N*m'}; % torque:right
end
parameters
  upper = {90, 'deg'}; % above it
  stiff = {5, 'N*m/rad'};
  damper = {20, 'N*cm*s/rad'};
end
parameters (Access=private)
  twice = 2*stiff;
end
equations
  assert(stiff > 0)
  if (phi > upper) % it is met
    t == -(twice*(phi - upper) ...
           + damper*w);
  elseif phi < {-3, 'deg'}
    t == -stiff*phi;
  else
    t == {30 'N*cm'};
  end
end
end
"""


def test_a_component_of_the_simscape_language_computes_physical_signals(tmp_path):
    """Its file beside the model says the law; one with nodes is lost by name, as one whose file is not there."""
    (tmp_path / "stop.ssc").write_text(_STOP, encoding="utf-8")
    (tmp_path / "other.ssc").write_text(
        "component other\nnodes\n R = foundation.electrical.electrical;\nend\nend\n"
    )
    level = Level()
    sensing = {"TorqueActuationMode": "InputTorque", "SensePosition": "on", "SenseVelocity": "on"}
    _, (joint, _) = hinges(level, sensing, {})
    stop = level.block(
        "SimscapeComponentBlock", "Stop", ClassName="stop", upper="20", upper_unit="deg"
    )
    for one, other in (("rconn:2", "lconn:2"), ("rconn:3", "lconn:1")):
        level.connect(f"{joint}#{one}", f"{stop}#{other}")
    level.connect(f"{stop}#rconn:1", f"{joint}#lconn:2")
    imported = import_simulink(write_model(tmp_path / "a.slx", level), tmp_path / "out")
    assert imported.fidelity == "mechanics complete"
    result = simulate(load_station(imported.station, TIGHT), duration=2.0, progress=False)

    def motion(_, y):
        return y[1], -10 * (y[0] - np.pi / 9) - 0.2 * y[1] if y[0] > np.pi / 9 else 0.3

    exact = solve_ivp(
        motion, (0, 2), [0, 0], rtol=1e-9, atol=1e-9, max_step=1e-3, t_eval=result.times
    )
    np.testing.assert_allclose(result["q.A"], exact.y[0], atol=1e-3)
    assert exact.y[0].max() > 0.4
    (tmp_path / "hard.ssc").write_text(_STOP.replace("-stiff*phi", "-airy(phi)"), encoding="utf-8")
    for name in ("other", "absent", "hard"):
        level.blocks = [re.sub(r"(ClassName\">)\w+", rf"\1{name}", one) for one in level.blocks]
        imported = import_simulink(write_model(tmp_path / "a.slx", level), tmp_path / name)
        lost = (
            "1 drive lost; 1 control block"
            if name == "hard"
            else "1 Revolute Joint and 1 SimscapeComponentBlock lost"
        )
        assert imported.fidelity.startswith(lost)
