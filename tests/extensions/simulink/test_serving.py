"""A station over TCP: the steps of one in the same process, hostile lines, and the client functions in GNU Octave."""

import json
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import threading
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from simrob_drake import load_station
from simrob_drake.base.errors import InvalidParameter, OutputError
from simrob_drake.extensions.simulink.stepping.server import CLIENT, LOCAL, StationServer
from simrob_drake.extensions.simulink.stepping.station import SteppedStation, with_fixed_steps

TOKEN = "a secret of ours"
STEP = 2e-3


class Client:
    """A line each way."""

    def __init__(self, port, token=TOKEN):
        self._socket = socket.create_connection((LOCAL, port), timeout=20)
        self._file = self._socket.makefile("rwb")
        self.described = self.send(token)

    def send(self, line):
        self._file.write(line.encode(errors="surrogateescape") + b"\n")
        self._file.flush()
        return json.loads(self._file.readline() or b"null")

    def ask(self, do, **more):
        return self.send(json.dumps({"do": do, **more}))

    def close(self):
        self._file.close()
        self._socket.close()


@contextmanager
def served(config):
    server = StationServer(config, port=0, token=TOKEN)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    try:
        yield server.server_address[1]
    finally:
        server.shutdown()
        server.server_close()


@pytest.fixture(scope="module")
def config():
    return with_fixed_steps(load_station("double_pendulum"), STEP)


@pytest.fixture(scope="module")
def port(config):
    with served(config) as port:
        yield port


def steps(station, count, wanted):
    """Return the outputs of a station of this process at each step."""
    rows = []
    for _ in range(count):
        for name, value in zip(station.inputs, wanted, strict=True):
            station.set(name, value)
        station.advance(station.time + STEP)
        rows.append([station.get(name) for name in station.outputs])
    return np.array(rows)


def test_steps_are_those_of_a_station_here(port, config):
    """Of two clients each has a station of its own; one has another gain and less gravity, the other resets."""
    one, other, here = Client(port), Client(port), SteppedStation(config)
    assert one.described["station"] == "double_pendulum"
    assert [entry["name"] for entry in one.described["inputs"]] == list(here.inputs)
    torque = next(entry for entry in one.described["outputs"] if entry["name"] == "torque.joint_1")
    assert torque["unit"] == "N·m"
    changed = {"servo.kp.joint_1": 40.0, "gravity": 3.0}
    first = other.ask("reset", parameters=list(changed.items()))
    assert first["time"] == 0
    rows = []
    for _ in range(20):
        rows.append(one.ask("step", inputs=[0.9, 0.1], dt=STEP)["outputs"])
        other.ask("step", inputs=[0.9, 0.1], dt=STEP)
    expected = steps(here, 20, [0.9, 0.1])
    np.testing.assert_array_equal(rows, expected)
    held = other.ask("step", dt=STEP)
    here.reset(changed)
    np.testing.assert_array_equal(held["outputs"], steps(here, 21, [0.9, 0.1])[-1])
    assert (held["time"], held["stopped"]) == (pytest.approx(21 * STEP), "")
    one.ask("reset")
    assert one.ask("step", inputs=[0.9, 0.1], dt=STEP)["outputs"] == list(expected[0])
    one.close()
    other.close()


def test_what_cannot_be_is_told_in_a_line_and_the_station_goes_on(port):
    client = Client(port)
    for line, told in (
        ("{", "request: is not JSON"),
        ("[1]", "request"),
        ('{"do": "stap"}', "do"),
        ('{"do": "step"}', "request: dt is None; it must be a time [s]"),
        ('{"do": "step", "dt": 0}', "dt"),
        ('{"do": "step", "dt": 1e9}', "dt"),
        ('{"do": "step", "dt": 0.01, "inputs": [1]}', "request: inputs is 1 numbers; it must be 2"),
        ('{"do": "step", "dt": 0.01, "inputs": [1, null]}', "inputs"),
        ('{"do": "step", "dt": 0.01, "inputs": [1, NaN]}', "is not a finite number"),
        (
            '{"do": "reset", "parameters": [["gravitas", 1]]}',
            "there is no parameter 'gravitas'; did you mean",
        ),
        ('{"do": "reset", "parameters": [["robot.model", 1]]}', "there is no parameter"),
        ('{"do": "reset", "parameters": [["gravity", 1e6]]}', "at most 10000"),
        ("\udcff", "utf-8"),
    ):
        answer = client.send(line)
        assert told in answer["error"], (line, answer)
        assert "\n" not in answer["error"]
    assert client.ask("step", inputs=[0.9, 0.1], dt=STEP)["time"] == pytest.approx(STEP)
    client.close()


def test_a_run_that_a_monitor_ends():
    with served(
        load_station("double_pendulum", {"monitors.settled": {"hold": 0.05, "speed_deg": 100}})
    ) as port:
        client = Client(port)
        assert "stood still" in client.ask("step", dt=1.0)["stopped"]
        assert "was ended: the robot has stood still" in client.ask("step", dt=1.0)["error"]
        assert client.ask("reset")["stopped"] == ""
        client.close()


def test_only_who_knows_the_token_is_served(port, config):
    assert "error" in Client(port, "another").described
    assert "error" in Client(port, "").described
    long = Client(port)
    assert "is longer than" in long.send("x" * 1_000_001)["error"]
    with served(config) as own:
        clients = [Client(own) for _ in range(8)]
        assert "8 clients are connected already" in Client(own).described["error"]
        for client in clients:
            client.close()
    with pytest.raises(
        InvalidParameter, match="SIMROB_TOKEN is of 3 letters; it must be of 8 or more"
    ):
        StationServer(config, port=0, token="abc")
    with pytest.raises(OutputError, match=f"nothing can listen at 127.0.0.1, port {port}"):
        StationServer(config, port=port)
    with pytest.raises(InvalidParameter, match="kinematic"):
        StationServer(load_station("irb120_kinematic"), port=0)


@pytest.mark.long
def test_the_command_tells_where_and_ends_when_interrupted():
    code = "import sys; from simrob_drake.cli.__main__ import main; sys.exit(main())"
    command = [
        sys.executable,
        "-c",
        code,
        "serve",
        "double_pendulum",
        "--step",
        "2e-3",
        "--port",
        "0",
    ]
    environment = {**os.environ, "SIMROB_TOKEN": TOKEN, "PYTHONUNBUFFERED": "1"}
    with subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, text=True) as process:
        first, token, folder = (process.stdout.readline() for _ in range(3))
        client = Client(int(re.search(r"at 127.0.0.1, port (\d+)", first)[1]))
        assert client.ask("step", dt=0.01)["time"] == 0.01
        assert TOKEN in token
        assert str(CLIENT) in folder
        process.send_signal(signal.SIGINT)
        assert process.wait(20) == 0


BRIDGE = """
import socket, sys
talk = socket.create_connection(("127.0.0.1", int(sys.argv[1]))).makefile("rwb")
for line in sys.stdin.buffer:
    talk.write(line)
    talk.flush()
    sys.stdout.buffer.write(talk.readline())
    sys.stdout.buffer.flush()
"""
SCRIPT = """
[to, from] = popen2('%(python)s', {'%(bridge)s', '%(port)d'});
function line = exchange(to, from, text)
  fputs(to, [text "\\n"]);
  fflush(to);
  line = '';
  while isempty(line) || line(end) != "\\n"
    part = fgets(from);
    if ischar(part)
      line = [line part];
    else
      fclear(from);
      pause(0.001);
    end
  end
end
session = simrob_open(@(text) exchange(to, from, text), '%(token)s');
[first, time] = simrob_reset(session, {'servo.kp.joint_1', 40; 'gravity', 3});
rows = zeros(10, numel(session.outputs.name));
for step = 1:10
  [outputs, time, stopped] = simrob_step(session, [0.9 0.1], %(step)g);
  rows(step, :) = outputs;
end
refused = '';
try
  simrob_reset(session, {'gravitas', 1});
catch problem
  refused = problem.message;
end
names = session.outputs.name; units = session.parameters.unit; start = session.inputs.value;
save('-v7', 'found.mat', 'rows', 'time', 'stopped', 'refused', 'names', 'units', 'start', 'first');
"""


@pytest.mark.skipif(shutil.which("octave-cli") is None, reason="without GNU Octave")
def test_the_functions_for_matlab_run_in_octave(port, config, tmp_path):
    from scipy.io import loadmat

    (tmp_path / "bridge.py").write_text(BRIDGE)
    values = {
        "python": sys.executable,
        "bridge": tmp_path / "bridge.py",
        "port": port,
        "token": TOKEN,
        "step": STEP,
    }
    (tmp_path / "script.m").write_text(SCRIPT % values)
    command = ["octave-cli", "--no-init-file", "--quiet", "--path", str(CLIENT), "script.m"]
    subprocess.run(command, cwd=tmp_path, check=True, timeout=60)
    found = loadmat(tmp_path / "found.mat", simplify_cells=True)
    here = SteppedStation(config)
    np.testing.assert_allclose(found["start"], [here.get(name) for name in here.inputs], rtol=1e-14)
    here.reset({"servo.kp.joint_1": 40.0, "gravity": 3.0})
    assert list(found["names"]) == list(here.outputs)
    np.testing.assert_allclose(
        found["first"], [here.get(name) for name in here.outputs], rtol=1e-12, atol=1e-14
    )
    np.testing.assert_allclose(found["rows"], steps(here, 10, [0.9, 0.1]), rtol=1e-9, atol=1e-12)
    assert found["time"] == pytest.approx(10 * STEP)
    assert "there is no parameter 'gravitas'" in found["refused"]
    assert "m/s²" in list(found["units"])


def test_the_client_is_plain_and_whole():
    """Each file is one function or class of its name."""
    for file in Path(CLIENT).glob("*.m"):
        first = file.read_text().splitlines()[0]
        assert re.match(rf"(function .*\b|classdef ){file.stem}\b", first), file
