"""Messages of the whole package: an id has one template, and each language has a template with the same fields."""

import ast
import inspect
import re
import string
from collections import defaultdict
from functools import cache
from pathlib import Path

import pytest

import simrob_drake
from simrob_drake.base import errors, messages
from simrob_drake.base.messages import Message, catalogue, in_language
from simrob_drake.cli.command_table import all_commands, subcommand_functions
from simrob_drake.cli.help import command_message
from simrob_drake.cli.options import import_option_messages

PACKAGE = Path(simrob_drake.__file__).parent
LANGUAGES = ("es",)
NOT_CONVERTED: tuple[str, ...] = ()
"""Folders of the package whose errors still have plain texts. It may only become shorter."""

OF_CRITERIA = ({".title_"}, {".beyond_"})
"""Literal parts of ids that are made of the name of a criterion, with its title and its sentence as templates."""

UNITS = r"\b(rad|mm|kg|deg|Hz|m|s|N|real|time|rad/s|m/s)\b"


@cache
def modules() -> dict[str, ast.Module]:
    """Syntax trees of all modules by their paths in the package."""
    return {
        str(file.relative_to(PACKAGE)): ast.parse(file.read_text())
        for file in PACKAGE.rglob("*.py")
    }


def calls_of(name: str) -> list[tuple[str, ast.Call]]:
    """All calls of a function by its plain name, with the modules that have them."""
    found = []
    for module, tree in modules().items():
        calls = (
            node
            for node in ast.walk(tree)
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name)
        )
        found += [(f"{module}:{call.lineno}", call) for call in calls if call.func.id == name]
    return found


def literal(node: ast.expr) -> str | None:
    """Text of a literal. Returns None for any other expression."""
    return node.value if isinstance(node, ast.Constant) and isinstance(node.value, str) else None


@cache
def templates() -> dict[str, dict[str, list[str]]]:
    """For each id its English templates, and for each template the places that have it."""
    found: dict[str, dict[str, list[str]]] = defaultdict(lambda: defaultdict(list))
    for place, call in calls_of("message"):
        if place.startswith("base/messages.py"):
            continue
        message_id, template = (literal(argument) for argument in call.args[:2])
        if message_id is None and isinstance(call.args[0], ast.JoinedStr):
            # The first word of a criterion's ids is a field of it, with "results" for those of the core.
            fixed_parts = {literal(part) for part in call.args[0].values} - {None}
            assert fixed_parts in OF_CRITERIA, f"{place}: the id is no literal"
            continue
        assert message_id is not None, f"{place}: the id is no literal"
        assert template is not None, f"{place}: the template of {message_id} is no literal"
        found[message_id][template].append(place)
    # after the simpler checks, since the import takes long
    from simrob_drake.results.verdict.judge import (
        CRITERIA,
    )

    for criterion in CRITERIA:
        assert criterion.catalogue == "results"
        found[f"results.title_{criterion.name}"][criterion.title].append("results/verdict")
        found[f"results.beyond_{criterion.name}"][criterion.sentence].append("results/verdict")
    for help_text in docstring_helps():
        found[help_text.id][help_text.template].append("cli/help")
    return found


def docstring_helps() -> list[Message]:
    """Helps of all commands and of the options of an import, which are made of docstrings."""
    found = [*import_option_messages().values()]
    for name, entry in all_commands().items():
        below = {
            f"{name} {word}": function for word, function in subcommand_functions(name).items()
        }
        helps = [entry.help]
        helps += [
            command_message(own, inspect.getdoc(run) or "", entry.package)
            for own, run in below.items()
        ]
        # A help with examples is made of its sentences, a line in front of the examples, and the examples.
        found += [text if text.id else text.fields["part_0"] for text in helps]
    return found


def fields_of(template: str) -> set[str]:
    """Names of the fields of a template."""
    return {name for _, name, _, _ in string.Formatter().parse(template) if name is not None}


def test_an_id_has_one_template():
    assert {found: list(own) for found, own in templates().items() if len(own) > 1} == {}
    assert len(templates()) > 1500


def test_an_id_is_its_package_and_some_words():
    shape = re.compile(r"[a-z]+(_[a-z]+)*\.[a-z0-9]+(_[a-z0-9]+){0,6}")

    assert [found for found in templates() if not shape.fullmatch(found)] == []

    packages = {
        *messages.core_packages(),
        *(path.name for path in (PACKAGE / "extensions").iterdir()),
    }
    assert {found.partition(".")[0] for found in templates()} <= packages


@pytest.mark.parametrize("language", LANGUAGES)
def test_a_language_has_exactly_these_ids(language):
    used = set(templates())
    packages = {found.partition(".")[0] for found in used}

    written = {found for package in packages for found in catalogue(package, language)}

    assert sorted(used - written) == []
    assert sorted(written - used) == []


@pytest.mark.parametrize("language", LANGUAGES)
def test_a_template_has_the_same_fields_in_each_language(language):
    different = []
    for found, own in templates().items():
        (english,) = own
        other = catalogue(found.partition(".")[0], language).get(found, english)
        if fields_of(english) != fields_of(other):
            different.append(found)
    assert different == []


def value_for(specification: str) -> object:
    """Value that a format specification can format: a number, or a text if there is no specification."""
    return 2.5 if specification else "R1"


@pytest.mark.parametrize("language", LANGUAGES)
def test_every_template_is_filled_in_each_language(language):
    for found, own in templates().items():
        (english,) = own
        parts = [part for part in string.Formatter().parse(english) if part[1] is not None]
        fields = {name: value_for(specification or "") for _, name, specification, _ in parts}
        # A field that has a number in one place is a number in all.
        fields |= {
            name: value_for(specification) for _, name, specification, _ in parts if specification
        }
        text = Message(found, english, fields)
        assert "{" not in str(text).replace("{{", "") or "{{" in english, found
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(
                messages.warnings, "warn", lambda reason, *_, **__: pytest.fail(str(reason))
            )
            translated = in_language(text, language)
        assert translated.strip(), found


def test_a_compound_has_no_words():
    """It would need words in other languages, and has no id."""
    with_words = []
    for place, call in calls_of("compound"):
        template = literal(call.args[0])
        if template is None or place.startswith("base/messages.py"):
            continue
        text = re.sub(r"<\w+>", "", re.sub(r"\{[^}]*\}", "", template))
        if re.search(r"[A-Za-z]{2}", re.sub(UNITS, "", text)):
            with_words.append(f"{place}: {template}")
    assert with_words == []


def error_classes() -> set[str]:
    """Names of our error classes: those that are derived from SimrobError."""
    bases = defaultdict(set)
    for tree in modules().values():
        for node in ast.walk(tree):
            if isinstance(node, ast.ClassDef):
                bases[node.name] |= {ast.unparse(base).rpartition(".")[2] for base in node.bases}
    found = {"SimrobError"}
    while more := {name for name, own in bases.items() if own & found} - found:
        found |= more
    return found


def test_no_error_of_ours_is_raised_with_a_plain_sentence():
    classes = error_classes()

    assert len(classes) > 20

    plain = []
    for module, tree in modules().items():
        if module.startswith(NOT_CONVERTED):
            continue
        for node in ast.walk(tree):
            if not (isinstance(node, ast.Call) and getattr(node.func, "id", "") in classes):
                continue
            for argument in node.args:
                text = literal(argument) or ""
                if isinstance(argument, ast.JoinedStr):
                    text = "".join(literal(part) or "x" for part in argument.values)
                # Options and keys, such as `--set duration`, are the same in each language.
                has_words = " " in text.strip() and not re.fullmatch(
                    r"--\w+ \w+|[\w.]+: x|x x x|\w+, \w+", text
                )
                if has_words:
                    plain.append(f"{module}:{node.lineno}: {text}")

    assert plain == []


def test_errors_of_the_base_keep_their_messages():
    nearest = errors.UnknownName("robot", "irb12", ["irb120"])

    assert in_language(nearest.message, "es") == "no hay robot 'irb12'; ¿quería decir 'irb120'?"

    positive = errors.InvalidParameter(
        "gain", 2.5, messages.message("base.a_number", "a finite number")
    )
    assert in_language(positive.message, "es") == "gain es 2.5; debe ser un número finito"
    assert in_language(errors.Unsuitable("gain", "R1").message, "es") == "gain: R1; quítelo"

    line = messages.message("base.line", "line {line}", line=3)
    located = errors.InvalidConfig(
        "a.yaml", line, messages.message("base.no_mapping", "must contain a mapping")
    )

    assert (
        in_language(located.message, "es")
        == "a.yaml: línea 3: debe contener claves con sus valores"
    )
