"""Lengths that masks set, told by how long a pendulum swings."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from slx_files import INERTIA, REVOLUTE, TO_PHYSICS, TRANSFORM, WORLD, Level, mask, write_model
from test_mechanics import FIGURES, TOUCH
from test_slx_signals import Plant

from simrob_drake import load_station, simulate
from simrob_drake.extensions.simulink.importing import import_simulink

TIGHT = {"solver.accuracy": 1e-6, "solver.max_step": 0.01}
CHOICE = """shape = Simulink.Mask.get(gcb);
end_of = shape.getParameter('ends');
if strcmp(end_of.Value, 'round')
    set_param(char([gcb '/Rod']), 'TranslationStandardOffset', num2str(get_param(gcb, 'value@reach') - 0.1));
end"""


def point_on_a_rod(path, around, offset="0.9", **options):
    """A point of 1 kg on a rod without mass, on a hinge about world -y that begins at 0.5 rad from level."""
    inside = Level(first=100)
    rod = inside.block(TRANSFORM, "Rod", TranslationMethod="StandardAxis", TranslationStandardAxis="+X",
                       TranslationStandardOffset=offset)  # fmt: skip
    point = inside.block(INERTIA, "Point", InertiaType="PointMass", Mass="1")
    port = inside.block("PMIOPort", "B", Side="Left")
    inside.connect(f"{port}#conn:1", f"{rod}#lconn:1")
    inside.connect(f"{rod}#rconn:1", f"{point}#rconn:1")
    top = Level()
    world = top.block(WORLD, "World")
    mount = top.block(TRANSFORM, "Mount", RotationMethod="StandardAxis", RotationStandardAxis="+X", RotationAngle="90",
                      RotationAngleUnits="deg")  # fmt: skip
    joint = top.block(REVOLUTE, "Hinge", PositionTargetSpecify="on", PositionTargetValue="0.5")
    arm = top.block("SubSystem", "Arm", mask=around, inner=inside.xml())
    top.connect(f"{world}#rconn:1", f"{mount}#lconn:1")
    top.connect(f"{mount}#rconn:1", f"{joint}#lconn:1")
    top.connect(f"{joint}#rconn:1", f"{arm}#lconn:1")
    return write_model(path, top, **options)


def assert_swings(station, length):
    """About -y: q'' = -(g/l) cos q, with q up from level."""
    result = simulate(load_station(station, TIGHT), duration=1.0, progress=False)

    def law(_, y):
        return y[1], -9.80665 / length * np.cos(y[0])

    exact = solve_ivp(law, (0, 1), (0.5, 0.0), t_eval=result.times, rtol=1e-9, atol=1e-9).y[0]
    np.testing.assert_allclose(result["q.Hinge"], exact, atol=1e-4)


@pytest.mark.parametrize(("ends", "length"), [("round", 0.5), ("flat", 0.9)])
def test_code_asks_its_mask_for_a_choice_and_sets_a_length(tmp_path, ends, length):
    around = mask(CHOICE, reach="0.6", ends=ends).replace(
        'Name="ends" Type="edit"', 'Name="ends" Type="edit" Evaluate="off"'
    )
    imported = import_simulink(point_on_a_rod(tmp_path / "a.slx", around), tmp_path / "out")
    assert imported.fidelity == "mechanics complete"
    assert_swings(imported.station, length)


def test_a_length_that_only_matlab_can_set_is_as_saved_and_the_report_says_so(tmp_path):
    around = mask(
        "if ishandle(gcf) set_param([gcb '/Rod'], 'TranslationStandardOffset', '0.5'); end",
        reach="0.6",
    )
    imported = import_simulink(point_on_a_rod(tmp_path / "a.slx", around), tmp_path / "out")
    (said,) = [entry for entry in imported.report.entries if "taken as saved" in entry.text]
    assert (said.kind, said.element) == ("approximated", "Arm")
    assert_swings(imported.station, 0.9)


def test_code_sets_what_a_mask_says_by_a_variable_that_is_not_there(tmp_path):
    around = mask("if reach > 0, length = reach; end", reach="0.6", length="2 * wall")
    imported = import_simulink(
        point_on_a_rod(tmp_path / "a.slx", around, offset="length"), tmp_path / "out"
    )
    assert imported.fidelity == "mechanics complete"
    assert_swings(imported.station, 0.6)


def test_a_structure_beside_the_model_may_have_a_function_s_name(tmp_path):
    (tmp_path / "sizes.m").write_text("floor.depth = 0.5;\nabs = 3;\n")
    model = point_on_a_rod(tmp_path / "a.slx", mask(), offset="floor.depth + abs(-0.2)")
    imported = import_simulink(model, tmp_path / "out", assume=True)
    assert_swings(imported.station, 0.7)


@pytest.mark.parametrize("values", ["a", "a'"])
def test_a_time_series_that_a_script_beside_the_model_makes_drives(tmp_path, values):
    """Torques of 1 and 2 N·m that rise with time, on an inertia of 1 kg m² each."""
    (tmp_path / "way.m").write_text(
        f"t = 0:0.5:1;\na = [flip(1 - t); 2*t];\npulls = timeseries({values}, t);\n"
    )
    plant = Plant()
    plant.drive(*plant.split(plant.chain("FromWorkspace", "Pulls", VariableName="pulls")))
    imported = import_simulink(
        write_model(tmp_path / "a.slx", plant), tmp_path / "out", assume=True
    )
    result = simulate(load_station(imported.station, TIGHT), duration=1.0, progress=False)
    for name, slope in (("A", 1.0), ("B", 2.0)):
        np.testing.assert_allclose(result[f"q.{name}"], slope * result.times**3 / 6, atol=1e-5)


def test_what_others_put_in_is_held_at_its_only_open_frame(tmp_path):
    """A subsystem of its own: a hinge on a shelf that hangs on a port, and a ball that falls on the shelf."""
    level = Level()
    port = level.block("PMIOPort", "B", Side="Left")
    shelf = level.block(TRANSFORM, "Shelf", TranslationMethod="StandardAxis", TranslationStandardAxis="+Z",
                        TranslationStandardOffset="0.5")  # fmt: skip
    plane = level.block("sm_lib/Curves and Surfaces/Infinite Plane", "Top")
    joint = level.block(
        "sm_lib/Joints/6-DOF Joint",
        "Free",
        PzPositionTargetSpecify="on",
        PzPositionTargetValue="0.06",
    )
    ball = level.block(
        "sm_lib/Body Elements/Spherical Solid",
        "Ball",
        SphereRadius="0.05",
        ExportEntireGeometry="on",
    )
    finger, around = (
        level.block("PMIOPort", "G", Side="Left"),
        level.block(TOUCH, "Outside", **FIGURES),
    )
    touch = level.block(TOUCH, "Touch", **FIGURES)
    level.connect(f"{port}#conn:1", f"{shelf}#lconn:1")
    level.connect(f"{shelf}#rconn:1", f"{plane}#lconn:1", f"{joint}#lconn:1")
    level.connect(f"{joint}#rconn:1", f"{ball}#rconn:1")
    level.connect(f"{ball}#lconn:1", f"{touch}#lconn:1", f"{around}#lconn:1")
    level.connect(f"{plane}#rconn:1", f"{touch}#rconn:1")
    level.connect(f"{finger}#conn:1", f"{around}#rconn:1")
    imported = import_simulink(
        write_model(tmp_path / "a.slx", level, kind="Subsystem"), tmp_path / "out"
    )
    assert imported.fidelity == "mechanics complete"
    words = [entry.text for entry in imported.report.entries]
    assert "stands in the world, in place of what this is put into" in words
    assert "the contact: with what this is put into" in words
    result = simulate(load_station(imported.station), duration=1.0, progress=False)
    assert result.piece_pose("Ball")[-1, 2] == pytest.approx(0.55, abs=2e-3)


def test_of_two_scripts_that_one_counts_whose_structures_are_long_enough(tmp_path):
    (tmp_path / "parts").mkdir()
    (tmp_path / "old.m").write_text("part.rod(1).reach = 0.9;\n")
    (tmp_path / "parts" / "new.m").write_text(
        "part.rod(1).reach = 0.8;\npart.rod(2).reach = 0.5;\n"
    )
    model = point_on_a_rod(tmp_path / "a.slx", mask(), offset="part.rod(2).reach")
    imported = import_simulink(model, tmp_path / "out", libraries=[tmp_path / "parts"], assume=True)
    assert_swings(imported.station, 0.5)


@pytest.mark.parametrize(("kind", "figures", "inertia"), [
    ("General Variable Mass", {"VariableInertiaType": "PointMass", "MassType": "TimeVarying"}, 2 * 0.5**2),
    ("Variable Spherical Solid", {"RadiusType": "CalculateFromMass", "MassType": "ProvidedByInput", "Density": "300"},
     2 * 0.5**2 + 0.4 * 2 * (3 * 2 / (4 * np.pi * 300)) ** (2 / 3)),
])  # fmt: skip
@pytest.mark.parametrize("source", ["Constant", "Clock"])
def test_a_mass_from_an_input_that_is_constant(tmp_path, kind, figures, inertia, source):
    """Against a damper of 1 N·m·s/rad an inertia J, 0.5 m from a hinge, slows down as exp(-t/J)."""
    level = Level()
    world = level.block(WORLD, "World")
    start = {
        "VelocityTargetSpecify": "on",
        "VelocityTargetValue": "3",
        "VelocityTargetValueUnits": "rad/s",
    }
    damped = {"DampingCoefficient": "1", "DampingCoefficientUnits": "N*m*s/rad"}
    joint = level.block(REVOLUTE, "Hinge", **damped, **start)
    arm = level.block(
        TRANSFORM, "Arm", TranslationMethod="Cartesian", TranslationCartesianOffset="[0.5 0 0]"
    )
    body = level.block(f"sm_lib/Body Elements/Variable Mass/{kind}", "Body", **figures)
    held = level.block(INERTIA, "Little", Mass="1e-6", MomentsOfInertia="[1e-6 1e-6 1e-6]")
    given, into = level.block(source, "Mass", Value="2000"), level.block(TO_PHYSICS, "In", Unit="g")
    level.connect(f"{world}#rconn:1", f"{joint}#lconn:1")
    level.connect(f"{joint}#rconn:1", f"{arm}#lconn:1", f"{held}#rconn:1")
    level.connect(f"{arm}#rconn:1", f"{body}#rconn:1")
    level.connect(f"{into}#rconn:1", f"{body}#lconn:1")
    level.wire(f"{given}#out:1", f"{into}#in:1")
    imported = import_simulink(write_model(tmp_path / "a.slx", level), tmp_path / "out")
    if source == "Clock":
        assert imported.fidelity == "1 variable mass lost"
        return
    assert imported.fidelity == "mechanics complete"
    result = simulate(load_station(imported.station, TIGHT), duration=0.5, progress=False)
    np.testing.assert_allclose(result["v.Hinge"], 3 * np.exp(-result.times / inertia), atol=1e-4)


@pytest.mark.parametrize(("code", "fidelity"), [
    ("function y = law(t)\nglobal pull\ny = pull * t;\n", "mechanics complete"),
    ("function y = law(t)\nglobal pull\npull = pull + 1;\ny = pull * t;\n", "1 drive lost; 1 control block left open"),
])  # fmt: skip
def test_functions_take_global_variables_from_the_script_that_sets_them(tmp_path, code, fidelity):
    """The gain of u = -K x with the least cost for a double integrator, against its closed form."""
    (tmp_path / "law.m").write_text(code)
    (tmp_path / "before.m").write_text(
        "global A B pull\nA = [0 1; 0 0];\nB = [0; 1];\npull = [1 0] * gains(9)';\n"
    )
    (tmp_path / "gains.m").write_text(
        "function K = gains(q)\nglobal A B\nplant = ss(A, B, eye(2), 0);\nK = lqr(plant, diag([q 1]), 1);\n"
    )
    plant = Plant()
    clock = plant.chain("Clock", "Clock")
    plant.drive(
        plant.chain("MATLABFcn", "Law", clock, MATLABFcn="law"),
        plant.chain("Constant", "None", Value="0"),
    )
    imported = import_simulink(
        write_model(tmp_path / "a.slx", plant), tmp_path / "out", assume=True
    )
    assert imported.fidelity == fidelity
    if fidelity == "mechanics complete":
        result = simulate(load_station(imported.station, TIGHT), duration=1.0, progress=False)
        np.testing.assert_allclose(result["q.A"], 3 * result.times**3 / 6, atol=1e-5)


@pytest.mark.parametrize("wrong", [
    "struct('Time', 1:3, 'Data', 1:2)", "struct('Time', 'a', 'Data', 1)", "struct('Time', 1)",
    "struct('time', 1, 'signals', 3)", "timeseries(1:3, 1:2)",
])  # fmt: skip
def test_a_time_series_that_is_none_is_left_open(tmp_path, wrong):
    plant = Plant()
    plant.drive(*plant.split(plant.chain("FromWorkspace", "Pulls", VariableName=wrong)))
    imported = import_simulink(write_model(tmp_path / "a.slx", plant), tmp_path / "out")
    assert imported.fidelity == "2 drives lost; 1 control block left open"


@pytest.mark.parametrize(
    "figures", [{"Density": "0"}, {"DensityUnits": "parsec"}, {"Density": "[1 2]"}]
)
def test_a_ball_of_no_density_is_lost_alone(tmp_path, figures):
    level = Level()
    world, joint = level.block(WORLD, "World"), level.block(REVOLUTE, "Hinge")
    ball = level.block("sm_lib/Body Elements/Variable Mass/Variable Spherical Solid", "Ball",
                       RadiusType="CalculateFromMass", MassType="ProvidedByInput", **figures)  # fmt: skip
    rod = level.block(INERTIA, "Rod", Mass="1", MomentsOfInertia="[1 1 1]")
    given, into = (
        level.block("Constant", "Mass", Value="2"),
        level.block(TO_PHYSICS, "In", Unit="kg"),
    )
    level.connect(f"{world}#rconn:1", f"{joint}#lconn:1")
    level.connect(f"{joint}#rconn:1", f"{ball}#rconn:1", f"{rod}#rconn:1")
    level.connect(f"{into}#rconn:1", f"{ball}#lconn:1")
    level.wire(f"{given}#out:1", f"{into}#in:1")
    imported = import_simulink(write_model(tmp_path / "a.slx", level), tmp_path / "out")
    assert imported.fidelity == "1 variable mass lost"
