"""Helps of all commands in Spanish: each text is translated, and the outputs have no English words."""

import re
from collections.abc import Iterator

import pytest

from simrob_drake.base.messages import in_language, set_output_language
from simrob_drake.cli import ExitCode
from simrob_drake.cli.app import run_command, whole_command
from simrob_drake.cli.command_table import all_commands, subcommand_functions
from simrob_drake.cli.language import LANGUAGE_VARIABLE, requested_language
from tests.widths import too_wide

ENGLISH = re.compile(
    r"\b(the|of|and|with|is|are|at|not|must|should|to|that|which|given|default|show|run|write|folder|file|name|by|for|"
    r"options|arguments|commands|usage|required|from|its|are|each|when|where|how|what|all|take|make)\b",
    re.IGNORECASE,
)
SAME_IN_EACH_LANGUAGE = re.compile(
    r"""
    `[^`]*`                             # code
    | simrob[│\s]+\w+                    # commands, which may be broken over two lines
    | ^.{0,40}--[\w-]+                  # options, and what stands in front of them
    | <[^>]*> | [\[{][^\]}]*[\]}]        # types and usages
    | ^│[ ]\w+[ ]{2,}                   # names of commands in their list
    | \b[A-Z][A-Z_.|:]+\b               # values to replace, such as FILE.png
    | \S*[/=_.|]\S*                     # paths, settings and names of axes
    """,
    re.VERBOSE | re.MULTILINE,
)


def commands_with_helps() -> list[list[str]]:
    """Arguments that show each help of the command line."""
    names = [[name] for name in all_commands()]
    below = [[name, word] for name in all_commands() for word in subcommand_functions(name)]
    return [[], *names, *below]


@pytest.fixture(autouse=True)
def _english_afterwards(monkeypatch) -> Iterator[None]:
    monkeypatch.delenv(LANGUAGE_VARIABLE, raising=False)
    yield
    set_output_language("en")


def helps_in(language: str) -> dict[str, str]:
    """Helps of all commands, options and arguments in a language, by command and name."""
    set_output_language(language)
    found = {}
    for name, entry in all_commands().items():
        found[name] = in_language(entry.help, language)
        whole = whole_command(name)
        for command in [whole, *getattr(whole, "commands", {}).values()]:
            called = name if command is whole else f"{name} {command.name}"
            found[f"{called}, whole"] = command.help
            found |= {f"{called} {option.name}": option.help for option in command.params}
    return found


def test_each_help_is_translated():
    english, spanish = helps_in("en"), helps_in("es")

    assert len(english) > 300
    assert english.keys() == spanish.keys()
    assert [name for name in english if not english[name]] == []
    assert {name: text for name, text in english.items() if spanish[name] == text} == {}


@pytest.mark.parametrize(
    "command", commands_with_helps(), ids=lambda command: " ".join(command) or "simrob"
)
def test_a_help_in_spanish_has_no_english_words(command, capsys, monkeypatch):
    monkeypatch.setenv(LANGUAGE_VARIABLE, "es")

    assert run_command([*command, "--help"]) == ExitCode.DONE
    out = capsys.readouterr().out
    assert "Uso: simrob" in out
    assert "Muestra esta ayuda" in out
    assert too_wide(out) == []
    assert ENGLISH.findall(SAME_IN_EACH_LANGUAGE.sub(" ", out)) == []


@pytest.mark.parametrize(
    "command", commands_with_helps(), ids=lambda command: " ".join(command) or "simrob"
)
def test_a_help_in_english_has_english_words(command, capsys):
    """The pattern that finds English words is one that can find them."""
    assert run_command([*command, "--help"]) == ExitCode.DONE
    out = capsys.readouterr().out
    assert "Usage: simrob" in out
    assert too_wide(out) == []
    assert len(ENGLISH.findall(SAME_IN_EACH_LANGUAGE.sub(" ", out))) >= 3


@pytest.mark.parametrize(
    ("arguments", "language"),
    [
        (["run", "--language", "es", "--help"], "es"),
        (["run", "--help", "--language=es"], "es"),
        (["run", "--language", "es", "--language", "en"], "en"),
        (["run", "--language", "fr"], "en"),
        (["run", "--language"], "en"),
        ([], "en"),
    ],
)
def test_the_option_counts_before_it_is_parsed(arguments, language):
    assert requested_language(arguments) == language


def test_a_help_is_in_the_language_of_the_option(capsys):
    run_command(["run", "--help", "--language", "es"])

    assert "Simula una estación" in capsys.readouterr().out

    run_command(["run", "--help"])
    assert "Run a station" in capsys.readouterr().out


def test_examples_are_the_same_in_each_language():
    english, spanish = helps_in("en"), helps_in("es")
    for name, text in english.items():
        own = [line for line in text.splitlines() if line.startswith("simrob ")]
        assert [line for line in spanish[name].splitlines() if line.startswith("simrob ")] == own


@pytest.mark.parametrize("command", commands_with_helps()[1:], ids=" ".join)
def test_each_example_has_a_line_of_its_own(command, capsys):
    """A block by indentation is lost if one paragraph stands before the examples; a long line would be broken."""
    run_command([*command, "--help"])
    lines = [line.strip() for line in capsys.readouterr().out.splitlines()]

    text = whole_command(command[0])

    whole = text.commands[command[1]] if len(command) > 1 else text
    examples = [line for line in whole.help.splitlines() if line.startswith("simrob ")]
    assert [line for line in lines if line in examples] == examples


def test_extension_points_are_named_in_spanish(capsys, monkeypatch):
    monkeypatch.setenv(LANGUAGE_VARIABLE, "es")

    assert run_command(["extensions"]) == ExitCode.DONE
    out = capsys.readouterr().out
    for words in (
        "órdenes: compare",
        "otros ficheros: tuning",
        "motores de simulación: mujoco",
        "exportadores: mjcf",
    ):
        assert words in out
    assert not re.search(r"commands:|other files:|engines:|messages:", out)
