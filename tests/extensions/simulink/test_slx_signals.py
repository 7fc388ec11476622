"""Control laws found by what they compute, however they are drawn."""

import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation
from slx_files import (
    FROM_PHYSICS,
    INERTIA,
    REVOLUTE,
    TO_PHYSICS,
    WORLD,
    Level,
    mask,
    pendulum,
    write_model,
)

from simrob_drake import load_station, simulate
from simrob_drake.base.errors import InvalidModel
from simrob_drake.extensions.simulink.importing import import_simulink
from simrob_drake.extensions.simulink.signals.forms import evaluated, flat, terms_of
from simrob_drake.extensions.simulink.simulink_model import read_simulink
from simrob_drake.extensions.simulink.tables import table


class Plant(Level):
    """Two driven hinges side by side whose positions and speeds are sensed, and converters around them."""

    def __init__(self, *, motion=False):
        super().__init__()
        world = self.block(WORLD, "World")
        self.positions, self.speeds, self.drives = [], [], []
        mode = (
            {"MotionActuationMode": "InputMotion"}
            if motion
            else {"TorqueActuationMode": "InputTorque"}
        )
        for name in ("A", "B"):
            joint = self.block(REVOLUTE, name, SensePosition="on", SenseVelocity="on", **mode)
            rod = self.block(INERTIA, f"Rod {name}", Mass="1", MomentsOfInertia="[1 1 1]")
            self.connect(f"{world}#rconn:1", f"{joint}#lconn:1")
            self.connect(f"{joint}#rconn:1", f"{rod}#rconn:1")
            into = self.block(TO_PHYSICS, f"into {name}", Unit="1")
            self.connect(f"{into}#rconn:1", f"{joint}#lconn:2")
            self.drives.append(into)
            for number, found in ((2, self.positions), (3, self.speeds)):
                out = self.block(FROM_PHYSICS, f"out {name} {number}", Unit="inherit")
                self.connect(f"{joint}#rconn:{number}", f"{out}#lconn:1")
                found.append(f"{out}#out:1")

    def chain(self, kind, name, *sources, **parameters):
        """Add a block behind others, and return its output."""
        sid = self.block(kind, name, **parameters)
        for number, source in enumerate(sources):
            self.wire(source, f"{sid}#in:{number + 1}")
        return f"{sid}#out:1"

    def drive(self, *signals):
        for signal, into in zip(signals, self.drives, strict=True):
            self.wire(signal, f"{into}#in:1")

    def split(self, signal):
        sid = self.block("Demux", "Split", Outputs="2")
        self.wire(signal, f"{sid}#in:1")
        return f"{sid}#out:1", f"{sid}#out:2"

    def laws(self, tmp_path):
        model = read_simulink(write_model(tmp_path / "a.slx", self), servos=True)
        return {freedom.name: law for freedom, law in model.laws.items()}, model.report


def test_matrix_gains_through_mux_demux_and_tags(tmp_path):
    plant = Plant()
    q = plant.chain("Mux", "q", *plant.positions, Inputs="2")
    plant.chain("Goto", "to", q, GotoTag="all")
    back = plant.chain("From", "from", GotoTag="all")
    w = plant.chain(
        "Selector",
        "w",
        plant.chain("Mux", "w all", *reversed(plant.speeds), Inputs="2"),
        Indices="[2 1]",
    )
    wanted = plant.chain("Inport", "q_ref", PortDimensions="2")
    error = plant.chain("Sum", "e", back, wanted, Inputs="-+|")
    stiff = plant.chain(
        "Gain", "Kp", error, Gain="[10 0; 0 20]", Multiplication="Matrix(K*u) (u vector)"
    )
    damp = plant.chain("Gain", "Kd", w, Gain="[1 2]")
    total = plant.chain("Sum", "T", stiff, damp, Inputs="|+-")
    plant.drive(
        *plant.split(
            plant.chain("Saturate", "Sat", total, UpperLimit="[5 6]", LowerLimit="[-5 -6]")
        )
    )
    laws, report = plant.laws(tmp_path)
    assert [(law.kp, law.kd, law.limit) for law in laws.values()] == [(10, 1, 5), (20, 2, 6)]
    assert [term.index for law in laws.values() for term in law.reference.terms] == [0, 1]
    assert report.entries == []


def test_a_pid_block_with_its_limit(tmp_path):
    plant = Plant()
    for number in (0, 1):
        error = plant.chain("Sum", f"e{number}", plant.chain("Constant", f"c{number}", Value="0.5"),
                            plant.positions[number], Inputs="+-")  # fmt: skip
        output = plant.chain(
            "slpidlib/PID Controller", f"PID{number}", error, P="7", I="3", D="2", Controller="PID",
            LimitOutput="on", UpperSaturationLimit="9", LowerSaturationLimit="-9",
        )  # fmt: skip
        plant.wire(output, f"{plant.drives[number]}#in:1")
    laws, _ = plant.laws(tmp_path)
    assert [(law.kp, law.ki, law.kd, law.limit) for law in laws.values()] == [(7, 3, 2, 9)] * 2


def test_an_integral_beside_a_proportional_part(tmp_path):
    plant = Plant()
    for number in (0, 1):
        error = plant.chain("Sum", f"e{number}", plant.chain("Inport", f"r{number}", Port=number + 1),
                            plant.positions[number], Inputs="+-")  # fmt: skip
        total = plant.chain(
            "Sum", f"T{number}", plant.chain("Gain", f"P{number}", error, Gain="4"),
            plant.chain("Integrator", f"I{number}", plant.chain("Gain", f"Ki{number}", error, Gain="2")),
            plant.chain("Gain", f"D{number}", plant.chain("Derivative", f"d{number}", plant.positions[number])),
            Inputs="++-",
        )  # fmt: skip
        plant.wire(total, f"{plant.drives[number]}#in:1")
    laws, _ = plant.laws(tmp_path)
    assert [(law.kp, law.ki, law.kd) for law in laws.values()] == [(4, 2, 1)] * 2


def test_what_is_no_servo_is_told(tmp_path):
    plant = Plant()
    strange = plant.chain("MATLABFcn", "Brain", plant.positions[0], MATLABFcn="unheard")
    coupled = plant.chain(
        "Sum", "T", plant.chain("Gain", "k", plant.positions[0], Gain="-3"), plant.positions[1]
    )
    plant.drive(coupled, strange)
    laws, report = plant.laws(tmp_path)
    net = {(term.kind, term.of.name): value for term, value in laws["A"].net.terms.items()}
    assert net == {("q", "A"): -3, ("q", "B"): 1}
    told = "MATLABFcn: left open; its code uses unheard, which is not known"
    assert [(entry.element, entry.text) for entry in report.of("open")] == [("Brain", told)]


def test_an_algebraic_loop_is_late_by_a_filter(tmp_path):
    """T = -3 q - T / 2 has the solution T = -2 q."""
    plant = Plant()
    total = plant.block("Sum", "T", Inputs="+-")
    pull = plant.chain("Gain", "k", plant.positions[0], Gain="-3")
    half = plant.chain("Gain", "half", f"{total}#out:1", Gain="0.5")
    plant.wire(pull, f"{total}#in:1")
    plant.wire(half, f"{total}#in:2")
    plant.wire(plant.chain("Sum", "all", f"{total}#out:1", plant.chain("Constant", "push", Value="1")),
               f"{plant.drives[0]}#in:1")  # fmt: skip
    imported = import_simulink(write_model(tmp_path / "a.slx", plant, stop="2"), tmp_path / "out")
    result = simulate(imported.station, progress=False)
    np.testing.assert_allclose(
        result["q.A"], 0.5 * (1 - np.cos(np.sqrt(2) * result.times)), atol=2e-3
    )
    (entry,) = (entry for entry in imported.report.of("approximated") if "loop" in entry.text)
    assert "late by 0.001 s: T → half → T" in entry.text


def test_a_loop_of_a_vector_leaves_no_block_open_that_takes_an_element_of_it(tmp_path):
    """Both of T = -3 q - T / 2 at once, swapped in the loop and back: T = -2 q, beside a push of 1."""
    plant = Plant()
    total = plant.block("Sum", "T", Inputs="+-")
    pull = plant.chain(
        "Gain", "k", plant.chain("Mux", "q", *plant.positions, Inputs="2"), Gain="-3"
    )
    half = plant.chain("Gain", "half", f"{total}#out:1", Gain="0.5")
    each = [plant.chain("Fcn", f"of {index}", half, Expr=f"u({index})") for index in (2, 1)]
    half = plant.chain(
        "Selector", "back", plant.chain("Mux", "swapped", *each, Inputs="2"), Indices="[2 1]"
    )
    plant.wire(pull, f"{total}#in:1")
    plant.wire(half, f"{total}#in:2")
    plant.drive(*plant.split(plant.chain("Bias", "all", f"{total}#out:1", Bias="1")))
    imported = import_simulink(write_model(tmp_path / "a.slx", plant, stop="1"), tmp_path / "out")
    assert (imported.fidelity, imported.report.of("open")) == ("mechanics complete", [])
    result = simulate(imported.station, progress=False)
    np.testing.assert_allclose(
        result["q.B"], 0.5 * (1 - np.cos(np.sqrt(2) * result.times)), atol=2e-3
    )


@pytest.mark.parametrize(
    ("kind", "parameters", "told"),
    [
        ("Gain", {"Gain": "[1 2 3]"}, "3 numbers for a signal of 2"),
        ("Gain", {"Gain": "ones(2,3)", "Multiplication": "Matrix(K*u)"}, "2 × 3 for a signal of 2"),
        ("Selector", {"Indices": "[1 5]"}, "element 5 of a signal of 2"),
        ("Sum", {"Inputs": "+x"}, "signs"),
    ],
)
def test_vectors_that_do_not_fit_are_left_open(tmp_path, kind, parameters, told):
    plant = Plant()
    q = plant.chain("Mux", "q", *plant.positions, Inputs="2")
    plant.drive(*plant.split(plant.chain(kind, "Odd", q, **parameters)))
    _, report = plant.laws(tmp_path)
    assert [entry.element for entry in report.of("open")] == ["Odd"]
    assert told in report.of("open")[0].text


def test_sources_move_a_kinematic_station(tmp_path):
    plant = Plant(motion=True)
    ramp = plant.chain("simulink/Sources/Ramp", "ramp", slope="0.5", start="0.2", X0="0.1")
    wave = plant.chain("Sin", "wave", Amplitude="0.3", Frequency="2", Bias="0", Phase="0")
    plant.drive(ramp, wave)
    station = import_simulink(
        write_model(tmp_path / "a.slx", plant, stop="2"), tmp_path / "out"
    ).station
    config = load_station(station)
    assert (config.mode, config.duration) == ("kinematic", 2.0)
    result = simulate(config, progress=False)
    times = result.times
    middle = (times > 0.3) & (times < 1.9)
    np.testing.assert_allclose(
        result["q.A"][middle], (0.1 + 0.5 * np.maximum(times - 0.2, 0))[middle], atol=1e-4
    )
    np.testing.assert_allclose(result["q.B"][middle], 0.3 * np.sin(2 * times)[middle], atol=1e-4)


def test_a_step_moves_a_dynamic_station(tmp_path):
    plant = Plant()
    step = plant.chain("Step", "step", Time="0.5", After="0.4", Before="0")
    for number in (0, 1):
        error = plant.chain("Sum", f"e{number}", step, plant.positions[number], Inputs="+-")
        law = plant.chain("Sum", f"T{number}", plant.chain("Gain", f"P{number}", error, Gain="100"),
                          plant.chain("Gain", f"D{number}", plant.speeds[number], Gain="20"), Inputs="+-")  # fmt: skip
        plant.wire(law, f"{plant.drives[number]}#in:1")
    station = import_simulink(
        write_model(tmp_path / "a.slx", plant, stop="3"), tmp_path / "out"
    ).station
    result = simulate(station, progress=False)
    np.testing.assert_allclose(result["q.A"][result.times < 0.49], 0.0, atol=1e-6)
    late = result.times - 0.5
    # critically damped: I = 1
    expected = np.where(late > 0, 0.4 * (1 - (1 + 10 * late) * np.exp(-10 * late)), 0.0)
    np.testing.assert_allclose(result["q.A"], expected, atol=1e-3)  # radau3 at accuracy 1e-2


def test_the_axes_stand_in_the_order_of_the_inputs(tmp_path):
    plant = Plant()
    wanted = plant.split(plant.chain("Inport", "q_ref", PortDimensions="2"))
    for number in (0, 1):
        error = plant.chain(
            "Sum", f"e{number}", wanted[1 - number], plant.positions[number], Inputs="+-"
        )
        plant.wire(
            plant.chain("Gain", f"P{number}", error, Gain="5"), f"{plant.drives[number]}#in:1"
        )
    files = import_simulink(write_model(tmp_path / "a.slx", plant), tmp_path / "out").files
    names = [axis for robot in files.robots.values() for axis in robot.axes.values()]
    assert sorted(names) == ["A", "B"]


def test_300_blocks_are_read_in_time(tmp_path):
    from time import perf_counter

    level = Level()
    world = level.block(WORLD, "World")
    before = f"{world}#rconn:1"
    for number in range(100):
        joint = level.block(REVOLUTE, f"J{number}")
        rod = level.block(INERTIA, f"R{number}", Mass="1", MomentsOfInertia="[1 1 1]")
        off = level.block("sm_lib/Frames and Transforms/Rigid Transform", f"T{number}",
                          TranslationMethod="Cartesian", TranslationCartesianOffset="[0.1 0 0]")  # fmt: skip
        level.connect(before, f"{joint}#lconn:1")
        level.connect(f"{joint}#rconn:1", f"{rod}#rconn:1", f"{off}#lconn:1")
        before = f"{off}#rconn:1"
    file = write_model(tmp_path / "long.slx", level)
    began = perf_counter()
    imported = import_simulink(file, tmp_path / "out")
    assert perf_counter() - began < 5.0
    (robot,) = imported.files.robots.values()
    assert len(robot.axes) == 100


def test_the_units_of_converters_count(tmp_path):
    file = pendulum(tmp_path / "a.slx")
    import zipfile

    with zipfile.ZipFile(file) as archive:
        parts = {name: archive.read(name).decode() for name in archive.namelist()}
    for unit, kp in (("deg", 200 * 180 / np.pi), ("rad", 200.0)):
        name = "simulink/systems/arm.xml"
        text = parts[name].replace('<P Name="Unit">inherit</P>', f'<P Name="Unit">{unit}</P>', 1)
        with zipfile.ZipFile(file, "w") as archive:
            for part, content in {**parts, name: text}.items():
                archive.writestr(part, content)
        (law,) = read_simulink(file, servos=True).laws.values()
        assert law.kp == pytest.approx(kp)
    with zipfile.ZipFile(file, "w") as archive:
        for part, content in parts.items():
            archive.writestr(
                part, content.replace('<P Name="Unit">inherit</P>', '<P Name="Unit">kg</P>', 1)
            )
    (entry,) = read_simulink(file).report.of("open")
    assert entry.element == "Arm/q out"
    assert "Unit: the unit kg does not fit" in entry.text


def test_buses_by_the_names_of_their_lines(tmp_path):
    plant = Plant()
    bus = plant.chain(
        "BusCreator", "bus", plant.positions[1], plant.speeds[1], plant.positions[0], Inputs="3"
    )
    plant.lines = [line.replace(f'"Src">{plant.speeds[1]}<', f'"Name">speed</P><P Name="Src">{plant.speeds[1]}<')
                   for line in plant.lines]  # fmt: skip
    picked = plant.block("BusSelector", "pick", OutputSignals="speed,signal3")
    plant.wire(bus, f"{picked}#in:1")
    plant.drive(
        plant.chain("Gain", "a", f"{picked}#out:2", Gain="-5"),
        plant.chain("Gain", "b", f"{picked}#out:1", Gain="-7"),
    )
    laws, _ = plant.laws(tmp_path)
    assert (laws["A"].kp, laws["A"].kd, laws["B"].kp, laws["B"].kd) == (5, 0, 0, 7)


def test_physical_signals_are_followed_without_converters(tmp_path):
    level = Level()
    world, joint = level.block(WORLD, "World"), level.block(
        REVOLUTE, "J", SensePosition="on", TorqueActuationMode="InputTorque"
    )  # fmt: skip
    rod = level.block(INERTIA, "Rod", Mass="1", MomentsOfInertia="[1 1 1]")
    rest = level.block("fl_lib/Physical Signals/Sources/PS Constant", "rest", constant="0.5")
    error = level.block("fl_lib/Physical Signals/Functions/PS Subtract", "error")
    gain = level.block("fl_lib/Physical Signals/Functions/PS Gain", "gain", gain="8")
    level.connect(f"{world}#rconn:1", f"{joint}#lconn:1")
    level.connect(f"{joint}#rconn:1", f"{rod}#rconn:1")
    level.connect(f"{rest}#rconn:1", f"{error}#lconn:1")
    level.connect(f"{joint}#rconn:2", f"{error}#lconn:2")
    level.connect(f"{error}#rconn:1", f"{gain}#lconn:1")
    level.connect(f"{gain}#rconn:1", f"{joint}#lconn:2")
    file = write_model(tmp_path / "a.slx", level)
    config = load_station(import_simulink(file, tmp_path / "servo", servos=True).station)
    assert config.servo.kp == 8
    assert config.reference.target_deg == {"J": pytest.approx(np.rad2deg(0.5))}
    flow = load_station(import_simulink(file, tmp_path / "out").station).controllers["law"]
    assert flow.torque == {"J": {"one": 4.0, "q.J": -8.0}}


def test_a_bus_knows_signals_by_the_names_that_blocks_within_subsystems_give_them(tmp_path):
    """As outputs of MATLAB Functions have them, and files since R2020 have all names: by the port, not by the line."""
    level, inner = Level(), Level(first=20)
    named = (
        '<PortProperties><Port Type="out" Index="1"><P Name="Name">turn</P></Port></PortProperties>'
    )
    gain = inner.block("Gain", "double", Gain="2", ports=named)
    inner.wire(f"{inner.block('Inport', 'u')}#out:1", f"{gain}#in:1")
    inner.wire(f"{gain}#out:1", f"{inner.block('Outport', 'y')}#in:1")
    source = level.block("Constant", "five", Value="5")
    within = level.block("SubSystem", "S", inner=inner.xml())
    bus = level.block("BusCreator", "bus", Inputs="2")
    level.wire(f"{source}#out:1", f"{within}#in:1", f"{bus}#in:1")
    goto, tag = level.block("Goto", "to"), level.block("From", "from")
    level.wire(f"{within}#out:1", f"{goto}#in:1")
    level.wire(f"{tag}#out:1", f"{bus}#in:2")
    level.wire(f"{bus}#out:1", f"{level.block('BusSelector', 'pick', OutputSignals='turn')}#in:1")
    model = read_simulink(write_model(tmp_path / "a.slx", level))
    (picked,) = (node for node in model.expanded.nodes if node.block.name == "pick")
    assert flat(model.tracer.output(picked)) == [10.0]


def test_a_bus_in_a_subsystem_knows_the_names_that_signals_have_outside(tmp_path):
    level, inner = Level(), Level(first=20)
    named = '<PortProperties><Port Type="out" Index="1"><P Name="Name">speed</P></Port></PortProperties>'
    bus = inner.block("BusCreator", "bus", Inputs="2")
    inner.wire(f"{inner.block('Constant', 'C', Value='1')}#out:1", f"{bus}#in:1")
    inner.wire(f"{inner.block('Inport', 'u')}#out:1", f"{bus}#in:2")
    inner.wire(f"{bus}#out:1", f"{inner.block('BusSelector', 'pick', OutputSignals='speed')}#in:1")
    source = level.block("Constant", "five", Value="5", ports=named)
    level.wire(f"{source}#out:1", f"{level.block('SubSystem', 'S', inner=inner.xml())}#in:1")
    model = read_simulink(write_model(tmp_path / "a.slx", level))
    (picked,) = (node for node in model.expanded.nodes if node.block.name == "pick")
    assert flat(model.tracer.output(picked)) == [5.0]


@pytest.mark.parametrize(("choice", "unknown"), [("two", False), ("", True)])
def test_variants(tmp_path, choice, unknown):
    """A variant subsystem takes the choice that is named; of one that only MATLAB knows the first is assumed."""
    level = Level()
    world = level.block(WORLD, "World")
    inner = Level(first=20)
    for label, mass in (("one", 1), ("two", 2)):
        part = Level(first=mass * 100)
        rod = part.block(INERTIA, "Rod", Mass=mass, MomentsOfInertia="[1 1 1]")
        port = part.block("PMIOPort", "F", Side="Left")
        joint = part.block(REVOLUTE, "J")
        part.connect(f"{port}#rconn:1", f"{joint}#lconn:1")
        part.connect(f"{joint}#rconn:1", f"{rod}#rconn:1")
        inner.block("SubSystem", label, VariantControl=label, inner=part.xml())
    inner.block("PMIOPort", "F", Side="Left")
    parts = level.block(
        "SubSystem", "Choice", Variant="on", LabelModeActiveChoice=choice, inner=inner.xml()
    )
    level.connect(f"{world}#rconn:1", f"{parts}#lconn:1")
    file = write_model(tmp_path / "a.slx", level)
    if unknown:
        with pytest.raises(
            InvalidModel, match=r"one, two \(Choice: which variant it is\); give them with --set"
        ):
            import_simulink(file, tmp_path / "out")
    (robot,) = import_simulink(file, tmp_path / "out", assume=True).files.robots.values()
    assert robot.mass == (1 if unknown else 2)


@pytest.mark.parametrize(("law", "gain"), [("Stiff", 7.0), ("Soft", 3.0), ("Plain", 1.0)])
def test_the_code_of_a_mask_chooses_the_variant_within(tmp_path, law, gain):
    """A library's block is saved with some choice; what its mask is told in a model counts there."""
    choices = Level(first=200)
    for label, factor in (("Stiff_One", 7), ("Soft_One", 3)):
        part = Level(first=300 + 10 * factor)
        taken, times, given = (
            part.block("Inport", "u"),
            part.block("Gain", "k", Gain=factor),
            part.block("Outport", "y"),
        )
        part.wire(f"{taken}#out:1", f"{times}#in:1")
        part.wire(f"{times}#out:1", f"{given}#in:1")
        choices.block("SubSystem", label, VariantControl=label, inner=part.xml())
    for kind, name in (("Inport", "u"), ("Outport", "y")):
        choices.block(kind, name)
    outer = Level(first=100)
    taken, given = outer.block("Inport", "u"), outer.block("Outport", "y")
    inner = outer.block(
        "SubSystem", "The\nLaw", Variant="on", LabelModeActiveChoice="Soft_One", inner=choices.xml()
    )
    outer.wire(f"{taken}#out:1", f"{inner}#in:1")
    outer.wire(f"{inner}#out:1", f"{given}#in:1")
    code = "if strcmp(get_param(gcb, 'law'), 'Stiff')\n"
    code += " set_param([gcb '/The Law'], 'OverrideUsingVariant', 'Stiff_One');\n"
    code += "elseif strcmp(get_param(gcb, 'law'), 'Plain')\n set_param([gcb '/The Law'], 'Commented', 'through');\nend"
    plant = Plant()
    masked = plant.block("SubSystem", "Force", law=law, inner=mask(code, law="Soft") + outer.xml())
    plant.wire(plant.positions[0], f"{masked}#in:1")
    plant.drive(f"{masked}#out:1", plant.positions[1])
    model = read_simulink(write_model(tmp_path / "a.slx", plant))
    assert [*terms_of(next(iter(model.laws.values())).net).values()] == [gain]


def test_the_ports_of_a_variant_go_to_those_of_the_same_name_in_its_choice(tmp_path):
    choice = Level(first=300)
    gain, taken = choice.block("Gain", "k", Gain="7"), choice.block("Inport", "second")
    ends = [choice.block("Outport", "other", Port="1"), choice.block("Outport", "first", Port="2")]
    choice.wire(f"{taken}#out:1", f"{gain}#in:1", f"{ends[0]}#in:1")
    choice.wire(f"{gain}#out:1", f"{ends[1]}#in:1")
    outer = Level(first=200)
    outer.block("SubSystem", "Law", VariantControl="a", inner=choice.xml())
    for kind, names in (("Inport", ("first", "second")), ("Outport", ("first", "other"))):
        for number, name in enumerate(names, start=1):
            outer.block(kind, name, Port=str(number))
    plant = Plant()
    law = plant.block(
        "SubSystem", "Choice", Variant="on", LabelModeActiveChoice="a", inner=outer.xml()
    )
    for number, position in enumerate(plant.positions, start=1):
        plant.wire(position, f"{law}#in:{number}")
    plant.drive(f"{law}#out:1", f"{law}#out:2")
    model = read_simulink(write_model(tmp_path / "a.slx", plant))
    assert [list(terms_of(law.net).values()) for law in model.laws.values()] == [[7.0], [1.0]]
    assert [term.of.name for law in model.laws.values() for term in terms_of(law.net)] == ["B", "B"]


def element(level, kind, name, signal, number=1):
    """Add a port block that is one signal of a bus."""
    said = {"PortNumber": number, "PortName": "bus", "Element": signal}
    listed = "".join(f'<P Name="{key}">{text}</P>' for key, text in said.items())
    return level.block(kind, name, ports=f'<List ListType="InterfaceData">{listed}</List>')


def test_ports_of_a_subsystem_that_are_signals_of_a_bus(tmp_path):
    """Each Out Bus Element is one signal of the output, and each In Bus Element takes one of the input."""
    level, maker, taker = Level(), Level(first=20), Level(first=40)
    for number, (name, value) in enumerate((("a", 2), ("b.x", 3), ("b.y", 5)), start=1):
        source = maker.block("Constant", f"C{number}", Value=value)
        maker.wire(
            f"{source}#out:1", f"{element(maker, 'Outport', f'Out Bus Element{number}', name)}#in:1"
        )
    gain = taker.block("Gain", "ten", Gain="10")
    taker.wire(f"{element(taker, 'Inport', 'In Bus Element', 'b.y')}#out:1", f"{gain}#in:1")
    whole = element(taker, "Inport", "In Bus Element1", "b")
    pick = taker.block("BusSelector", "within", OutputSignals="x")
    taker.wire(f"{whole}#out:1", f"{pick}#in:1")
    taker.wire(f"{gain}#out:1", f"{taker.block('Outport', 'y')}#in:1")
    made, taken = (
        level.block("SubSystem", name, inner=own.xml())
        for name, own in (("M", maker), ("T", taker))
    )
    picked = level.block("BusSelector", "pick", OutputSignals="b.x,a,c")
    level.wire(f"{made}#out:1", f"{taken}#in:1", f"{picked}#in:1")
    level.wire(f"{taken}#out:1", f"{level.block('Scope', 'S')}#in:1")
    tracer = (model := read_simulink(write_model(tmp_path / "a.slx", level))).tracer
    named = {node.block.name: node for node in model.expanded.nodes}
    assert [flat(tracer.output(named[name])) for name in ("ten", "within")] == [[50.0], [3.0]]
    assert [flat(tracer.output(named["pick"], number)) for number in (1, 2)] == [[3.0], [2.0]]
    assert flat(tracer.output(named["M"])) == [2.0, 3.0, 5.0]
    tracer.output(named["pick"], 3)
    assert tracer.opened[named["pick"]] == "the signal c of its bus is not found"


def test_a_bus_that_is_made_under_a_condition_is_left_open(tmp_path):
    level, maker = Level(), Level(first=20)
    maker.block("EnablePort", "Enable")
    source = maker.block("Constant", "C", Value="2")
    maker.wire(f"{source}#out:1", f"{element(maker, 'Outport', 'Out Bus Element', 'a')}#in:1")
    made = level.block("SubSystem", "M", inner=maker.xml())
    level.wire(f"{level.block('Clock', 'On')}#out:1", f"{made}#enable")
    level.wire(f"{made}#out:1", f"{level.block('BusSelector', 'pick', OutputSignals='a')}#in:1")
    model = read_simulink(write_model(tmp_path / "a.slx", level))
    named = {node.block.name: node for node in model.expanded.nodes}
    for name in ("pick", "M"):
        model.tracer.output(named[name])
        assert "under a condition" in model.tracer.opened[named[name]]


def test_a_bus_that_the_choice_of_a_variant_makes(tmp_path):
    level, inner = Level(), Level(first=20)
    for number, label in enumerate(("one", "two"), start=1):
        part = Level(first=number * 100)
        for name, value in (("a", 2 * number), ("b", 3 * number)):
            source = part.block("Constant", f"C{name}", Value=value)
            part.wire(f"{source}#out:1", f"{element(part, 'Outport', f'Out {name}', name)}#in:1")
        inner.block("SubSystem", label, VariantControl=label, inner=part.xml())
    inner.block("Outport", "bus")
    made = level.block(
        "SubSystem", "Choice", Variant="on", LabelModeActiveChoice="two", inner=inner.xml()
    )
    level.wire(f"{made}#out:1", f"{level.block('BusSelector', 'pick', OutputSignals='b')}#in:1")
    model = read_simulink(write_model(tmp_path / "a.slx", level))
    (picked,) = (node for node in model.expanded.nodes if node.block.name == "pick")
    assert flat(model.tracer.output(picked)) == [6.0]


def test_elements_of_a_data_store_are_what_is_written_or_what_they_begin_with(tmp_path):
    plant = Plant()
    plant.block(
        "DataStoreMemory",
        "M",
        DataStoreName="Servo",
        InitialValue="struct('goal',1,'gains',struct('P',7,'D',[2 3]))",
    )
    write = plant.block(
        "DataStoreWrite", "W", DataStoreName="Servo", DataStoreElements="Servo.other#Servo.goal"
    )
    for place, number in enumerate(("4", "5"), start=1):
        plant.wire(f"{plant.block('Constant', number, Value=number)}#out:1", f"{write}#in:{place}")
    names = "Servo.goal#Servo.gains.P#Servo.gains.D#Servo.gains"
    plant.block("DataStoreRead", "R", DataStoreName="Servo", DataStoreElements=names)
    model = read_simulink(write_model(tmp_path / "a.slx", plant))
    node = next(one for one in model.expanded.nodes if one.block.name == "R")
    assert [flat(model.tracer.output(node, number)) for number in (1, 2, 3)] == [
        [5.0],
        [7.0],
        [2.0, 3.0],
    ]
    (whole,) = flat(model.tracer.output(node, 4))  # a structure is no signal: left open
    assert [term.kind for term in terms_of(whole)] == ["open"]
    plant.block("DataStoreMemory", "Other", DataStoreName="Bus", InitialValue="0")
    part = plant.block("DataStoreWrite", "Part", DataStoreName="Bus", DataStoreElements="Bus.x")
    plant.wire(f"{plant.block('Constant', 'x', Value='3')}#out:1", f"{part}#in:1")
    whole = plant.block("DataStoreRead", "All", DataStoreName="Bus")
    model = read_simulink(write_model(tmp_path / "b.slx", plant))
    node = next(one for one in model.expanded.nodes if one.block.sid == whole)
    (whole,) = flat(model.tracer.output(node, 1))  # parts of it are written
    assert [term.kind for term in terms_of(whole)] == ["open"]


@pytest.mark.parametrize(
    ("kind", "parameters"),
    [
        ("DiscreteIntegrator", {}),
        ("DiscreteTransferFcn", {}),
        ("slpidlib/PID 1dof", {"TimeDomain": "Discrete-time"}),
    ],
)
def test_a_sampled_block_that_is_left_open_says_that_no_sample_time_is_known(
    tmp_path, kind, parameters
):
    plant = Plant()
    plant.drive(plant.chain(kind, "Sampled", plant.positions[0], **parameters), plant.positions[1])
    _, report = plant.laws(tmp_path)
    told = f"{kind.rpartition('/')[2]}: left open; nothing says its sample time"
    assert [(entry.element, entry.text) for entry in report.of("open")] == [("Sampled", told)]


def test_a_scalar_times_a_matrix_from_the_right(tmp_path):
    plant = Plant()
    both = plant.chain("Gain", "K", plant.positions[0], Gain="[3; 4]", Multiplication="Matrix(u*K)")
    plant.drive(*plant.split(both))
    laws, _ = plant.laws(tmp_path)
    assert [list(law.net.terms.values()) for law in laws.values()] == [[3], [4]]


def test_a_loop_without_states_is_told_of_once(tmp_path):
    """Its shape is found by following it before: what is met on that way, as the delay, is not told again."""
    plant = Plant()
    total = plant.block("Sum", "Loop", Inputs="++")
    late = plant.chain("Memory", "Late", f"{total}#out:1")
    plant.wire(plant.positions[0], f"{total}#in:1")
    plant.wire(late, f"{total}#in:2")
    plant.drive(late, plant.positions[1])
    _, report = plant.laws(tmp_path)
    assert sorted(entry.element for entry in report.of("approximated")) == ["Late", "Late"]


def test_transform_sensors_compute_angles_distances_and_their_rates(tmp_path):
    level, rng = Level(), np.random.default_rng(4)
    world = level.block(WORLD, "World")
    joint = level.block("sm_lib/Joints/6-DOF Joint", "Free")
    body = level.block(INERTIA, "Body")
    names = (
        "Angle",
        "Axis",
        "Q",
        "R",
        "X",
        "Rad",
        "Azim",
        "Dist",
        "Inc",
        "RadDot",
        "AzimDot",
        "DistDot",
    )
    sensor = level.block(
        "sm_lib/Frames and Transforms/Transform Sensor",
        "Sensor",
        **{f"Sense{name}": "on" for name in names},
    )
    level.connect(f"{world}#rconn:1", f"{joint}#lconn:1", f"{sensor}#lconn:1")
    level.connect(f"{joint}#rconn:1", f"{body}#rconn:1", f"{sensor}#rconn:1")
    tracer = read_simulink(write_model(tmp_path / "a.slx", level)).tracer
    (node,) = (node for node in tracer.network.expanded.nodes if node.block.name == "Sensor")
    turn, place, velocity = Rotation.random(rng=rng), rng.normal(size=3), rng.normal(size=3)
    parts = [*place, *turn.as_quat(scalar_first=True), *velocity, 0.0, 0.0, 0.0]

    def leaf(term):
        return None if term.kind == "block" else 1.0 if term.kind == "one" else parts[term.index]

    ports = [name for name in table("sensing") if name in names]
    found = {}
    for port, name in enumerate(ports, start=2):
        values = tracer.physical(node, "rconn", port)
        found[name] = np.array([evaluated(value, leaf, {}) for value in values.flat]).reshape(
            values.shape
        )
    x, y, z = place
    rotation_vector = turn.as_rotvec()
    expected = {
        "Angle": [np.linalg.norm(rotation_vector)], "Axis": rotation_vector / np.linalg.norm(rotation_vector),
        "Q": parts[3:7], "R": turn.as_matrix(), "X": [x], "Rad": [np.hypot(x, y)], "Azim": [np.arctan2(y, x)],
        "Dist": [np.linalg.norm(place)], "Inc": [np.arctan2(z, np.hypot(x, y))],
        "RadDot": place[:2] @ velocity[:2] / np.hypot(x, y), "DistDot": place @ velocity / np.linalg.norm(place),
        "AzimDot": (x * velocity[1] - y * velocity[0]) / np.hypot(x, y) ** 2,
    }  # fmt: skip
    sign = np.sign(found["Q"] @ expected["Q"])
    assert sign == 1
    for name in names:
        np.testing.assert_allclose(
            found[name], np.reshape(expected[name], found[name].shape), atol=1e-12, err_msg=name
        )


@pytest.mark.parametrize("kind", ["Integrator", "DiscreteIntegrator", "slpidlib/PID 1dof"])
def test_a_reset_that_is_left_out_is_told(tmp_path, kind):
    plant = Plant()
    plant.drive(
        plant.chain(kind, "I", plant.positions[0], ExternalReset="rising", SampleTime="0.01"),
        plant.positions[1],
    )
    _, report = plant.laws(tmp_path)
    assert ("I", "its reset is left out") in {
        (entry.element, entry.text) for entry in report.of("approximated")
    }


@pytest.mark.parametrize("zeros", ["0", "[1 2; 2 4]"])
def test_a_matrix_without_an_inverse_is_left_open(tmp_path, zeros):
    """Both once ended an import with a Python error."""
    plant = Plant()
    nothing = plant.chain("Constant", "Zeros", Value=zeros)
    ratio = plant.chain("Product", "Ratio", nothing, Inputs="/", Multiplication="Matrix(*)")
    plant.drive(
        plant.chain("Sum", "All", plant.chain("Reshape", "Flat", ratio), Inputs="+"),
        plant.positions[1],
    )
    _, report = plant.laws(tmp_path)
    assert [entry.element for entry in report.of("open")] == ["Ratio"]


@pytest.mark.parametrize(
    ("kind", "parameters"),
    [
        ("TransferFcn", {"Numerator": "[0.5 1]", "Denominator": "[1 3]"}),
        ("StateSpace", {"A": "-3", "B": "1", "C": "-0.5", "D": "0.5"}),
        (
            "DiscreteIntegrator",
            {"SampleTime": "0.01", "IntegratorMethod": "Integration: Trapezoidal"},
        ),
        ("ZeroOrderHold", {"SampleTime": "0.01"}),
    ],
)
def test_a_loop_through_what_answers_at_once_is_late(tmp_path, kind, parameters):
    plant = Plant()
    total = plant.block("Sum", "Loop", Inputs="+-")
    answer = plant.chain(kind, "Answer", f"{total}#out:1", **parameters)
    plant.wire(plant.positions[0], f"{total}#in:1")
    plant.wire(answer, f"{total}#in:2")
    plant.drive(answer, plant.positions[1])
    _, report = plant.laws(tmp_path)
    assert any(
        "an algebraic loop, late by 0.001 s" in entry.text for entry in report.of("approximated")
    )


@pytest.mark.parametrize("parameters", [{}, {"InitialCondition": "[1 2]"}])
def test_elements_of_a_vector_are_integrated_each(tmp_path, parameters):
    plant = Plant()
    both = plant.chain(
        "Integrator", "I", plant.chain("Mux", "q", *plant.positions, Inputs="2"), **parameters
    )
    plant.drive(*plant.split(both))
    laws, _ = plant.laws(tmp_path)
    blocks = [term.of for name in "AB" for term in laws[name].net.terms]
    assert [block.parameters["initial"] for block in blocks] == ([1, 2] if parameters else [0, 0])
    assert [[term.of.name for term in terms_of(block.inputs()[0])] for block in blocks] == [
        ["A"],
        ["B"],
    ]


def test_a_loop_carries_as_many_elements_as_come_into_it(tmp_path):
    plant = Plant()
    total = plant.block("Sum", "Rate", Inputs="+-")
    both = plant.chain("Integrator", "I", f"{total}#out:1")
    plant.wire(plant.chain("Mux", "q", *plant.positions, Inputs="2"), f"{total}#in:1")
    plant.wire(both, f"{total}#in:2")
    plant.drive(*plant.split(both))
    laws, _ = plant.laws(tmp_path)
    blocks = [term.of for name in "AB" for term in laws[name].net.terms]
    rates = [
        {getattr(term.of, "name", term.of): own for term, own in block.inputs()[0].terms.items()}
        for block in blocks
    ]
    assert rates == [{"A": 1, blocks[0]: -1}, {"B": 1, blocks[1]: -1}]


@pytest.mark.parametrize("row", [False, True])
def test_a_matrix_times_what_has_no_width_or_lies_in_a_row(tmp_path, row):
    """An input of the model becomes as wide as the matrix asks."""
    plant = Plant()
    source = plant.chain("Inport", "u")
    if row:
        source = plant.chain("Reshape", "Row", plant.chain("Mux", "q", *plant.positions, Inputs="2"),
                             OutputDimensionality="Row vector (2-D)")  # fmt: skip
    both = plant.chain("Gain", "K", source, Gain="[1 2; 3 4]", Multiplication="Matrix(K*u)")
    plant.drive(*plant.split(both))
    laws, _ = plant.laws(tmp_path)
    terms = [
        {getattr(term.of, "name", term.index): own for term, own in law.net.terms.items()}
        for law in laws.values()
    ]
    assert terms == ([{"A": 1, "B": 2}, {"A": 3, "B": 4}] if row else [{0: 1, 1: 2}, {0: 3, 1: 4}])


def test_what_an_open_block_takes_and_a_sample_time_are_found_at_any_input(tmp_path):
    plant = Plant()
    held = plant.chain("ZeroOrderHold", "Held", plant.positions[1], SampleTime="0.05")
    brain = plant.chain("Unheard", "Brain", plant.positions[0], held)
    plant.drive(brain, plant.chain("DiscreteIntegrator", "I", brain))
    imported = import_simulink(write_model(tmp_path / "a.slx", plant), tmp_path / "out")
    blocks = yaml.safe_load(imported.station.read_text())["controllers"]["law"]["blocks"]
    assert blocks["Brain_in_2"]["of"] == [{"Held": 1.0}]
    assert blocks["I"]["period"] == 0.05


def test_a_block_that_is_commented_through_hands_its_signal_on(tmp_path):
    plant = Plant()
    through = plant.chain("Gain", "K", plant.positions[0], Gain="7", Commented="through")
    plant.drive(through, plant.positions[1])
    laws, _ = plant.laws(tmp_path)
    assert laws["A"].net.terms == {
        term: 1 for term in laws["A"].net.terms if (term.kind, term.of.name) == ("q", "A")
    }
