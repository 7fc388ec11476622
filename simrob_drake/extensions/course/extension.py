"""What this extension adds to the toolbox. The core finds it by the entry points of pyproject.toml."""

from simrob_drake.base.extension import Extension
from simrob_drake.base.messages import message

EXTENSION = Extension(
    core=">=0.1",
    title=message("course.title_of_commands", "Teaching"),
    commands={
        "course": "simrob_drake.extensions.course.commands:teaching",
        "course list": "simrob_drake.extensions.course.commands:list_exercises",
        "course start": "simrob_drake.extensions.course.commands:start",
        "course check": "simrob_drake.extensions.course.commands:check",
    },
    messages={"course": "simrob_drake.extensions.course:languages"},
)
