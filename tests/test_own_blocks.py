"""Blocks of a user's own in a station: wired by name, recorded, resumed, drawn, saved, and told about when wrong."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest
from pydrake.common.value import Value
from pydrake.systems.framework import DiagramBuilder, LeafSystem

from simrob_drake import build_station, load_station, simulate
from simrob_drake.base.errors import SimrobError
from simrob_drake.cli.app import run_command
from simrob_drake.results.block_diagram.picture import station_dot
from simrob_drake.results.plots.own import save_plots

pytestmark = pytest.mark.usefixtures("no_plots")

QUICK = {
    "pieces": {},
    "floor": None,
    "solver": {"kind": "discrete", "time_step": 1e-3},
    "servo.realization": "implicit",
    "reference": {"kind": "hold", "target_deg": 0},
}


def arm(**overrides):
    """Return the arm alone under a discrete solver, whose runs go on to the last bit."""
    return load_station("irb120_dynamic", {**QUICK, **overrides})


class Nod(LeafSystem):
    """Let joint 5 nod.

    Ports:
        out ``reference`` (6) [rad].
    """

    def __init__(self, *, amplitude: float = 0.3, size: int = 6) -> None:
        super().__init__()
        self.parameters = {"amplitude": amplitude, "size": size}
        self.DeclareVectorOutputPort("reference", size, self._calc)

    def _calc(self, context, output):
        reference = np.zeros(output.size())
        reference[min(4, output.size() - 1)] = self.parameters["amplitude"] * np.sin(
            2 * context.get_time()
        )
        output.SetFromVector(reference)


class Mirror(LeafSystem):
    """Give what it reads from one port, with a gain, through another.

    Ports:
        in  ``source`` (size): called as the station's output that is read.
        out ``target`` (size): called as the station's input that is driven, or as a signal.
    """

    units = {"seen": "N·m"}  # noqa: RUF012

    def __init__(self, source, target="seen", *, size=6, gain=1.0, offset=0.0, name="") -> None:
        super().__init__()
        self.parameters = {
            "source": source, "target": target, "size": size, "gain": gain, "offset": offset, "name": name
        }  # fmt: skip
        self.set_name(name)
        self._in = self.DeclareVectorInputPort(source, size)
        self.DeclareVectorOutputPort(target, size, self._calc)

    def _calc(self, context, output):
        output.SetFromVector(
            self.parameters["gain"] * self._in.Eval(context) + self.parameters["offset"]
        )


class Memory(LeafSystem):
    """A sampled and a continuous integral of the position's error, and a count: a state of every kind.

    Ports:
        in  ``position`` (6) [rad].
        out ``reference`` (6) is the sampled integral; ``integral`` (6) the continuous one.
    """

    def __init__(self, *, gain: float = 2.0, goal: float = 0.2) -> None:
        super().__init__()
        self.parameters = {"gain": gain, "goal": goal}
        self._position = self.DeclareVectorInputPort("position", 6)
        self.DeclareContinuousState(6)
        self._sum = self.DeclareDiscreteState(6)
        self._count = self.DeclareAbstractState(Value({"samples": 0}))
        self.DeclareStateOutputPort("reference", self._sum)
        self.DeclareVectorOutputPort("integral", 6, self._calc, {self.xc_ticket()})
        self.DeclarePeriodicUnrestrictedUpdateEvent(0.01, 0.0, self._update)

    def _rate(self, context):
        return self.parameters["gain"] * (self.parameters["goal"] - self._position.Eval(context))

    def DoCalcTimeDerivatives(self, context, derivatives):
        derivatives.SetFromVector(self._rate(context))

    def _update(self, context, state):
        total = context.get_discrete_state(self._sum).value() + 0.01 * self._rate(context)
        state.get_mutable_discrete_state(self._sum).set_value(total)
        count = context.get_abstract_state(self._count).get_value()
        state.get_mutable_abstract_state(self._count).set_value({"samples": count["samples"] + 1})

    def _calc(self, context, output):
        output.SetFromVector(context.get_continuous_state_vector().CopyToVector())


class Faulty(LeafSystem):
    """Fail at a time, in an output or in an update."""

    def __init__(self, *, at: float = 0.05, where: str = "output", port: str = "reference") -> None:
        super().__init__()
        self.parameters = {"at": at, "where": where, "port": port}
        self.DeclareVectorOutputPort(port, 6, self._calc, {self.time_ticket()})
        self._state = self.DeclareDiscreteState(1)
        self.DeclarePeriodicDiscreteUpdateEvent(0.01, 0.0, self._update)

    def _calc(self, context, output):
        self._fail(context, "output")
        output.SetFromVector(np.zeros(6))

    def _update(self, context, state):
        self._fail(context, "update")

    def _fail(self, context, where):
        if where == self.parameters["where"] and context.get_time() > self.parameters["at"] - 1e-9:
            raise ZeroDivisionError("no more numbers")


class TestWiredByName:
    def test_an_output_called_reference_is_what_the_arm_is_asked(self):
        result = simulate(arm(), blocks=[Nod()], duration=1.0, progress=False)

        np.testing.assert_allclose(
            result["q_ref.joint_5"], 0.3 * np.sin(2 * result.times), atol=1e-12
        )
        late = result.times > 0.5
        np.testing.assert_allclose(
            result["q.joint_5"][late], result["q_ref.joint_5"][late], atol=0.02
        )
        assert np.ptp(result["q_ref.joint_1"]) == 0

    @pytest.mark.parametrize("realization", ["per_joint", "vector", "implicit"])
    def test_a_feedforward_of_a_file_reaches_the_servos_of_a_station_that_is_only_built_and_of_its_picture(
        self, realization
    ):
        own = {"kind": "own", "class": f"{__file__}:Torque", "parameters": {"values": [1.0] * 6}}
        config = load_station(
            "irb120_dynamic",
            {"servo.realization": realization, "controllers": {"weight": own}},
            allow_code=True,
        )
        station = build_station(config)

        outputs = [
            station.get_output_port(index).get_name() for index in range(station.num_output_ports())
        ]

        assert "weight.feedforward" not in outputs  # else it would be a signal that drives nothing

        arrows = [
            line
            for line in station_dot(config).splitlines()
            if '"controller.weight"' in line and "->" in line
        ]
        assert any("τ_ff" in line and "output" not in line for line in arrows)

    def test_it_reads_what_the_station_tells_and_its_signals_have_units(self):
        blocks = {"watch": Mirror("torque", gain=2), "hand": Mirror("tcp_pose", "place", size=7)}
        result = simulate(arm(), blocks=blocks, duration=0.2, progress=False)

        np.testing.assert_array_equal(result["watch.seen.joint_2"], 2 * result["tau.joint_2"])
        np.testing.assert_array_equal(result["hand.place.2"], result["tcp.z"])
        assert result.units["watch.seen.joint_2"] == "N·m"
        assert result.units["hand.place.2"] == "1"

    def test_a_feedforward_of_its_own_carries_the_arm(self):
        """The torque at rest, fed forward, leaves nothing to the proportional part."""
        at_rest = simulate(arm(), duration=1.0, progress=False)
        carried = simulate(
            arm(), blocks=[Torque(at_rest.axes("tau")[-1])], duration=1.0, progress=False
        )

        assert np.abs(at_rest.axes("q")[-1]).max() > 5e-3
        # where it hangs the torque is a little another
        assert np.abs(carried.axes("q")[-1]).max() < 3e-4

    def test_a_force_of_its_own_acts_at_the_tool(self):
        pushed = simulate(
            arm(), blocks={"hand": Torque([0, 0, 20.0], port="external_force")}, duration=0.5
        )
        force = {"kind": "push", "start": 0, "duration": 1, "force": [0, 0, 20.0]}

        same = simulate(arm(forces={"push": force}), duration=0.5, progress=False)

        np.testing.assert_allclose(pushed.axes("q"), same.axes("q"), atol=1e-12)
        assert (
            np.abs(pushed.axes("q")[-1] - simulate(arm(), duration=0.5).axes("q")[-1]).max() > 1e-3
        )

    def test_it_reads_a_force_sensor(self):
        result = simulate(
            "bouncing_ball",
            blocks={"felt": Mirror("force.floor", size=3)},
            duration=0.3,
            progress=False,
        )

        assert result["force.floor.z"].max() > 10

        seen = np.column_stack([result[f"felt.seen.{place}"] for place in range(3)])
        np.testing.assert_array_equal(seen, result.vector("force.floor"))

    def test_one_block_reads_another(self):
        blocks = {"nod": Telling(), "watch": Mirror("nod.phase", "twice", size=1, gain=2)}
        result = simulate(arm(), blocks=blocks, duration=0.2, progress=False)

        np.testing.assert_allclose(result["watch.twice"], 2 * result["nod.phase"])
        assert result["nod.phase"][-1] == pytest.approx(0.2)

    def test_blocks_change_nothing_that_they_only_read(self):
        alone = simulate(arm(), duration=0.3, progress=False)
        watched = simulate(arm(), blocks={"watch": Mirror("torque")}, duration=0.3, progress=False)
        np.testing.assert_array_equal(watched.values[:, : len(alone.names)], alone.values)

    def test_a_station_of_two_robots_has_prefixes(self):
        config = load_station("two_irb120", {"duration": 0.1})
        first = next(iter(config.robots))
        source = Torque(np.full(6, 0.1), port=f"{first}.reference")

        result = simulate(config, blocks={"source": source}, progress=False)

        np.testing.assert_array_equal(result[f"{first}.q_ref.joint_1"], 0.1)

    def test_monitors_end_a_run_with_blocks(self):
        stop = {"torque_limit": {"hold": 0.05}}
        config = arm(monitors=stop, **{"servo.torque_limit": 5})

        result = simulate(config, blocks=[Nod()], duration=1.0, progress=False)

        assert (result.ending, result.stopped_by) == ("monitor", "torque_limit")


class Torque(LeafSystem):
    """Constant values for an input of the station."""

    def __init__(self, values, *, port="feedforward") -> None:
        super().__init__()
        self.parameters = {"values": np.asarray(values).tolist(), "port": port}
        self.DeclareVectorOutputPort(port, len(values), self._calc)

    def _calc(self, context, output):
        output.SetFromVector(self.parameters["values"])


class Telling(LeafSystem):
    """A block without inputs that tells the time."""

    def __init__(self) -> None:
        super().__init__()
        self.DeclareVectorOutputPort(
            "phase", 1, lambda context, output: output.SetAtIndex(0, context.get_time())
        )


class TestItsMemory:
    def run(self, duration, start=None):
        return simulate(
            arm(), blocks={"memory": Memory()}, duration=duration, start=start, progress=False
        )

    def test_states_of_every_kind_are_kept(self):
        state = self.run(0.1).final_state

        kept = state.blocks["controller.memory"]
        np.testing.assert_allclose(kept.continuous, kept.discrete[0], rtol=0.1)
        assert kept.continuous.min() > 0.03
        assert kept.abstract == ({"samples": 10},)

        again = type(state).from_json(state.to_json()).blocks["controller.memory"]
        np.testing.assert_array_equal(again.continuous, kept.continuous)
        np.testing.assert_array_equal(again.discrete[0], kept.discrete[0])
        assert again.abstract == kept.abstract

    def test_a_run_goes_on_as_if_it_had_never_stopped(self):
        """To the last bit; a continuous state but for the rounding of times, which begin at zero again."""
        whole, first = self.run(0.2), self.run(0.1)
        second = self.run(0.1, type(first.final_state).from_json(first.final_state.to_json()))

        assert np.abs(second["q.joint_2"] - first["q.joint_2"]).max() > 1e-3
        for name in whole.names:
            rounding = 1e-13 if "integral" in name else 0
            np.testing.assert_allclose(
                second[name][1:], whole[name][11:], rtol=rounding, atol=0, err_msg=name
            )
        assert second.final_state.blocks["controller.memory"].abstract == ({"samples": 20},)


class TestWhatIsLeft:
    @pytest.mark.long
    def test_a_block_stands_in_the_picture_and_in_the_plots(self, tmp_path):
        result = simulate(arm(), blocks={"watch": Mirror("torque")}, duration=0.1, progress=False)
        text = station_dot(result.config)

        assert "watch\\nMirror" in text
        assert "own blocks" in text
        assert {"controller_watch.png", "position.png"} <= {
            file.name for file in save_plots(result, tmp_path)
        }
        assert result.notes["watch"] == {"kind": "Mirror"}

    def test_the_saved_station_runs_again(self, tmp_path):
        result = simulate(
            arm(), blocks={"nod": Nod(amplitude=0.2), "memory": Mirror("torque")}, duration=0.2
        )
        folder = result.save(tmp_path / "run", recording=False)

        with pytest.raises(
            SimrobError, match=r"controllers\.nod.*test_own_blocks.*allow_code=True.*--allow-code"
        ):
            load_station(folder / "station.yaml")
        with pytest.raises(SimrobError, match="--allow-code"):
            simulate(folder / "station.yaml")

        config = load_station(folder / "station.yaml", allow_code=True)
        again = simulate(config, progress=False)

        assert again.names == result.names
        np.testing.assert_array_equal(again.values, result.values)

    def test_a_block_of_a_result_takes_other_values(self, tmp_path):
        result = simulate(arm(), blocks={"nod": Nod()}, duration=0.1, progress=False)
        folder = result.save(tmp_path / "run", recording=False)
        changes = {"controllers.nod.parameters.amplitude": 0.1, "duration": 0.3}

        again = simulate(
            load_station(folder / "station.yaml", changes, allow_code=True), progress=False
        )

        np.testing.assert_allclose(
            again["q_ref.joint_5"], 0.1 * np.sin(2 * again.times), atol=1e-12
        )


CODE = """
from pydrake.systems.framework import LeafSystem
from beside import VALUE


class Hold(LeafSystem):
    def __init__(self, *, size=6):
        super().__init__()
        self.DeclareVectorOutputPort("reference", size, lambda context, output: output.SetFromVector([VALUE] * size))


class NoBlock:
    pass
"""

STATION = """
robot: {model: irb120}
reference: {kind: hold}
solver: {kind: discrete, time_step: 0.001}
duration: 0.1
controllers:
  loop: {kind: own, class: "%s"}
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder with a station, a module for it and one that this imports; the process stands elsewhere."""
    place = tmp_path / "stations"
    place.mkdir()
    (place / "holding.py").write_text(CODE)
    (place / "beside.py").write_text("VALUE = 0.125\n")
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    yield place
    for name in ("beside", "own_code_holding"):
        sys.modules.pop(name, None)


def written(folder, named):
    file = folder / "station.yaml"
    file.write_text(STATION % named)
    return file


class TestCodeThatAFileNames:
    @pytest.mark.parametrize(
        "named", ["holding.py:Hold", "holding:Hold", "./../stations/holding.py:Hold"]
    )
    def test_it_lies_beside_the_station(self, folder, named):
        config = load_station(written(folder, named), allow_code=True)

        assert Path(config.controllers["loop"].class_.partition(":")[0]).is_absolute()

        result = simulate(config, progress=False)
        np.testing.assert_array_equal(result["q_ref.joint_3"], 0.125)

    def test_it_is_on_python_s_path(self, folder):
        written_ = written(folder, "pydrake.systems.primitives:ConstantVectorSource")
        changes = {"controllers.loop.parameters": {"source_value": [1.0, 2.0]}}

        result = simulate(load_station(written_, changes, allow_code=True), progress=False)

        np.testing.assert_array_equal(result["loop.y0.1"], 2.0)

    def test_nothing_of_it_runs_where_it_is_not_allowed(self, folder):
        (folder / "holding.py").write_text("raise SystemExit('it ran')")
        file = written(folder, "holding.py:Hold")

        for run in (load_station, simulate):
            with pytest.raises(
                SimrobError, match=r"station\.yaml: controllers\.loop: would run.*holding\.py:Hold"
            ):
                run(file)
        with pytest.raises(
            SimrobError, match=r"override controllers.*: would run the Python code.*allow_code=True"
        ):
            load_station(
                "irb120_dynamic",
                {"controllers": {"loop": {"kind": "own", "class": "holding:Hold"}}},
            )

    @pytest.mark.parametrize(
        ("named", "told"),
        [
            ("missing.py:Hold", r"controllers\.loop\.class.*there is no file .*missing\.py"),
            ("nowhere.at_all:Hold", "controllers.loop.class.*No module named"),
            ("holding:Held", "controllers.loop.class.*no attribute 'Held'"),
            ("holding:NoBlock", "controllers.loop.class.*subclass of pydrake's LeafSystem"),
        ],
    )
    def test_what_it_cannot_be(self, folder, named, told):
        with pytest.raises(SimrobError, match=told):
            simulate(load_station(written(folder, named), allow_code=True))

    def test_what_its_constructor_does_not_take(self, folder):
        changes = {"controllers.loop.parameters": {"sice": 6}}
        with pytest.raises(SimrobError, match=r"controllers\.loop\.parameters.*sice"):
            simulate(load_station(written(folder, "holding:Hold"), changes, allow_code=True))

    def test_the_command_line_asks(self, folder, capsys):
        file = str(written(folder, "holding:Hold"))

        assert run_command(["run", file, "--no-recording", "--out", "r"]) == 2
        assert "--allow-code" in capsys.readouterr().err
        assert run_command(["run", file, "--no-recording", "--out", "r", "--allow-code"]) == 0
        assert json.loads(Path("r/summary.json").read_text())["stopped_by"] is None
        assert run_command(["check", file, "--allow-code"]) == 0
        assert run_command(["diagram", file, "--allow-code"]) == 0
        assert "loop\\nHold" in capsys.readouterr().out
        assert run_command(["diagram", file]) == 2


class TestWrong:
    @pytest.mark.parametrize(
        ("blocks", "told"),
        [
            ([Nod, Nod], "LeafSystem"),
            ({"nod": 3}, "blocks: nod is 3; it must be a Drake LeafSystem"),
            ("nod", "blocks is"),
        ],
    )
    def test_no_leaf_system(self, blocks, told):
        with pytest.raises(SimrobError, match=told):
            simulate(arm(), blocks=blocks, duration=0.1)

    def test_a_whole_diagram(self):
        builder = DiagramBuilder()
        builder.AddSystem(Nod())
        with pytest.raises(SimrobError, match=r"LeafSystem.*simulate_diagram"):
            simulate(arm(), blocks={"mine": builder.Build()}, duration=0.1)

    def test_two_drivers_of_one_input(self):
        with pytest.raises(
            SimrobError, match=r"input reference: the blocks nod and other both drive it"
        ):
            simulate(arm(), blocks={"nod": Nod(), "other": Nod()}, duration=0.1)

    def test_two_of_one_name(self):
        with pytest.raises(SimrobError, match="two blocks have the name nod"):
            simulate(arm(), blocks=[Nod(), Nod()], duration=0.1)

    def test_a_name_that_is_not_plain(self):
        with pytest.raises(SimrobError, match=r"my block.*a name of letters, digits and _"):
            simulate(arm(), blocks={"my block": Nod()}, duration=0.1)

    def test_an_input_that_nothing_feeds(self):
        with pytest.raises(
            SimrobError, match="input of the block watch called 'positon'; did you mean 'position'"
        ):
            simulate(arm(), blocks={"watch": Mirror("positon")}, duration=0.1)

    def test_sizes(self):
        with pytest.raises(
            SimrobError, match=r"input position of the block watch is of size 7; .* of size 6"
        ):
            simulate(arm(), blocks={"watch": Mirror("position", size=7)}, duration=0.1)
        with pytest.raises(
            SimrobError, match=r"output reference of the block nod is of size 5; .* of size 6"
        ):
            simulate(arm(), blocks={"nod": Nod(size=5)}, duration=0.1)

    def test_a_loop_without_a_state_in_it(self):
        blocks = {"back": Mirror("forth.there", "here"), "forth": Mirror("back.here", "there")}
        with pytest.raises(SimrobError, match=r"blocks back, forth.*algebraic loop"):
            simulate(arm(), blocks=blocks, duration=0.1)

    def test_a_block_of_another_run(self):
        nod = Nod()
        simulate(arm(), blocks=[nod], duration=0.01, progress=False)
        with pytest.raises(
            SimrobError,
            match=r"blocks nod cannot be .*: a block belongs to one diagram only, so create a new one",
        ):
            simulate(arm(), blocks=[nod], duration=0.01)

    def test_one_block_under_two_names(self):
        watch = Mirror("torque")
        with pytest.raises(SimrobError, match="blocks: two: the same block is given twice"):
            simulate(arm(), blocks={"one": watch, "two": watch}, duration=0.01)


class TestAnExceptionInside:
    @pytest.mark.parametrize(
        ("where", "told"), [("output", "its output reference"), ("update", "_update|_fail")]
    )
    @pytest.mark.parametrize("solver", ["discrete", "continuous"])
    def test_ends_the_run_and_is_told(self, tmp_path, where, told, solver):
        config = arm() if solver == "discrete" else load_station("irb120_dynamic")
        result = simulate(
            config, blocks={"shaky": Faulty(where=where)}, duration=0.5, progress=False
        )

        assert (result.ending, result.stopped_by) == ("failed", "shaky")
        assert "block shaky failed at 0.0" in result.message
        assert "ZeroDivisionError: no more numbers" in result.message
        assert any(part in result.message for part in told.split("|"))
        assert 0.03 < result.stop_time < 0.0501
        assert np.isfinite(result.axes("q")).all()

        folder = result.save(tmp_path / "run", recording=False)
        assert json.loads((folder / "summary.json").read_text())["stopped_by"] == "shaky"
        assert len((folder / "signals.csv").read_text().splitlines()) == len(result.times) + 1

    def test_at_the_first_look(self, tmp_path):
        result = simulate(arm(), blocks={"shaky": Faulty(at=0.0)}, duration=0.5, progress=False)

        assert (result.ending, result.stopped_by, result.stop_time) == ("failed", "shaky", 0.0)
        assert result.save(tmp_path / "run", recording=False).is_dir()
        with pytest.raises(
            SimrobError, match=r"start: references of robot is .*run in which a block failed"
        ):
            simulate(arm(), start=result.final_state)

    @pytest.mark.long
    def test_in_a_kinematic_station_the_run_is_known_up_to_there(self, tmp_path):
        result = simulate(
            "irb120_kinematic", blocks={"shaky": Faulty()}, duration=0.5, progress=False
        )

        assert (result.ending, result.stopped_by) == ("failed", "shaky")
        assert "failed at 0.05 s in its output reference" in result.message
        assert result.stop_time == pytest.approx(0.04)
        assert np.isfinite(result.axes("q")).all()

        folder = result.save(tmp_path / "run")
        assert json.loads((folder / "summary.json").read_text())["stop_time"] == pytest.approx(0.04)

    def test_in_an_output_that_only_reports(self):
        config = load_station("irb120_dynamic")
        result = simulate(
            config, blocks={"shaky": Faulty(port="told")}, duration=0.5, progress=False
        )

        assert (result.ending, result.stopped_by) == ("failed", "shaky")
        assert "failed at 0.05 s in its output told" in result.message

        whole = simulate(config, duration=0.5, progress=False)
        np.testing.assert_allclose(
            result.axes("q"), whole.axes("q")[: len(result.times)], atol=1e-3
        )
        assert result.stop_time == pytest.approx(0.04)

    def test_on_the_command_line_it_is_no_success(self, folder, capsys):
        lines = (folder / "holding.py").read_text().replace("[VALUE] * size", "[VALUE / 0] * size")
        (folder / "holding.py").write_text(lines)

        file = str(written(folder, "holding:Hold"))

        assert run_command(["run", file, "--no-recording", "--out", "r", "--allow-code"]) == 3
        assert "block loop failed at 0 s" in capsys.readouterr().out
        assert Path("r/signals.csv").is_file()
