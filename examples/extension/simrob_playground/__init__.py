"""An example of an extension: everything that it adds to simrob_drake is named here.

The strings name modules and the objects in them. A module is imported when a station, a program or a command first
uses the name, so this module itself imports nothing heavy.
"""

from simrob_drake import Extension

EXTENSION = Extension(
    core=">=0.1,<0.2",
    commands={"power": "simrob_playground.commands:power"},
    sensors={"joint_power": "simrob_playground.joint_power:JointPower"},
    moves={"nod": "simrob_playground.nod:NodMove"},
    gaits={"bobs": "simrob_playground.bob:Bob"},
    importers={".postures": "simrob_playground.posture_list:PostureList"},
    exporters={"csv": "simrob_playground.positions_csv:PositionsCsv"},
    plots={"joint_power": "simrob_playground.power_plot:power_plot"},
    measures={"standstill": "simrob_playground.standstill:STANDSTILL"},
    messages={"playground": "simrob_playground:languages"},
    panels={"move_counts": "simrob_playground.move_counts:MOVE_COUNTS"},
    robots={"playground": "simrob_playground:robots"},
    stations={"playground": "simrob_playground:stations"},
)
