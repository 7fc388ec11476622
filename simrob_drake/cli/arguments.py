"""Stations and changes of stations from the arguments of a command, and checks for options without an effect."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from simrob_drake.base.errors import InvalidParameter, Unsuitable
from simrob_drake.base.messages import compound, message
from simrob_drake.base.packages import Border
from simrob_drake.base.yaml_files import is_yaml_name, parse_yaml, read_yaml
from simrob_drake.cli.options import flag_of
from simrob_drake.cli.other_files import refuse_other
from simrob_drake.importer.importer import find_station_importer
from simrob_drake.robots.imports import ImportOptions
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.file_paths import with_absolute_paths
from simrob_drake.stations.load import load_station


class KeyChange(NamedTuple):
    """A change of a station.

    Attributes:
        key: dotted key that is changed.
        value: its new value.
    """

    key: str
    value: Any


class KeyText(NamedTuple):
    """An option of the form ``key.path=text``.

    Attributes:
        key: the dotted key.
        text: the text behind the equals sign.
    """

    key: str
    text: str


def station_from(
    station: str, settings: list[str] | None, *, allow_code: bool = False, **options: Any
) -> StationConfig:
    """Load a station with the changes of the command line.

    Args:
        station: name or file of the station.
        settings: values of the option ``--set``: texts ``key.path=value``, or YAML files with sections.
        allow_code: whether Python code that the file names may be run.
        **options: values of options that change a key of the station, by the key; None if the option is not given.

    Raises:
        SimrobError: the station or a change is wrong. The message names the option, or says what kind of file it is if
            it is no station.
    """
    values_of_options = {key: value for key, value in options.items() if value is not None}
    # For each changed key the option that changes it, for errors.
    option_of_key = {key: f"--{key}" for key in values_of_options}
    changes = changes_of(settings, "--set", others=option_of_key)
    option_of_key |= {key: f"--set {key}" for key in changes}
    # An importer may read a station from the file of another tool, which must not be refused as no station.
    if find_station_importer(station) is None:
        refuse_other(station)
    return load_station(
        station, {**values_of_options, **changes}, called=option_of_key, allow_code=allow_code
    )


def changes_of(
    texts: list[str] | None, option: str, *, others: Mapping[str, str] | None = None
) -> dict[str, Any]:
    """Read the changes of a station that an option gives, by dotted keys.

    Args:
        texts: values of the option: texts ``key.path=value``, or YAML files with sections.
        option: name of the option, for errors.
        others: other options that change keys, by the key.

    Raises:
        SimrobError: a text has another form, a key is changed twice, or a file cannot be read.
    """
    changes: dict[str, Any] = {}
    # A copy: the mapping belongs to the caller.
    option_of_key = dict(others or {})
    for text in texts or []:
        for key, value in _changes(text, option):
            # The last of two values would win without a word, and the user may have meant the first one.
            if key in option_of_key:
                raise Unsuitable(
                    compound("{option} {one}", option=option, one=text),
                    message(
                        "cli.gives_key_already",
                        "{option} already sets this key",
                        option=option_of_key[key],
                    ),
                    message("cli.leave_out_one", "leave out one of the two"),
                )
            changes[key] = value
            option_of_key[key] = f"{option} {key}"
    return changes


def _changes(text: str, option: str) -> Iterator[KeyChange]:
    """Yield the changes that one value of an option gives.

    Args:
        text: the value: ``key.path=value`` with a value in YAML, or a YAML file.
        option: name of the option, for errors.
    """
    # A text that is neither a change nor the name of a YAML file is reported as a change without "=".
    if "=" in text or not is_yaml_name(text):
        for key, value in texts_by_key([text], option):
            yield KeyChange(
                key, parse_yaml(value, compound("{option} {one}", option=option, one=text))
            )
        return
    file = Path(text).absolute()
    # Paths in the file begin at its folder, not at that of the station.
    sections = with_absolute_paths(read_yaml(file), file.parent, Border(file))
    for name, section in sections.items():
        # The keys of a section are changed one by one: other keys of the section in the station stay.
        if isinstance(section, Mapping) and section:
            for key, value in section.items():
                yield KeyChange(f"{name}.{key}", value)
        else:
            yield KeyChange(name, section)


def texts_by_key(texts: list[str] | None, option: str) -> Iterator[KeyText]:
    """Yield the keys and texts of an option of the form ``key.path=text``.

    Args:
        texts: values of the option; None if it is not given.
        option: name of the option, for errors.

    Raises:
        InvalidParameter: a value has another form.
    """
    for value in texts or []:
        # Only the first equals sign separates: the text may have more of them, as in a formula.
        key, equals, text = value.partition("=")
        has_form = bool(key.strip()) and bool(equals)
        if not has_form:
            raise InvalidParameter(
                option, value, message("cli.key_and_value", "of the form key.path=value")
            )
        yield KeyText(key.strip(), text)


def refuse(problem: str, /, **options: Any) -> None:
    """Check that options that would have no effect are not given.

    Args:
        problem: why the options have no effect, such as "this is a robot".
        options: value of each option, by the name of the command's parameter. An option whose value is None, 0, false
            or empty counts as not given.

    Raises:
        Unsuitable: an option is given; the message names the first one.
    """
    for name, value in options.items():
        # Every such option is None, false or empty by default.
        if value:
            raise Unsuitable(flag_of(name), problem)


def refuse_import(problem: str, options: ImportOptions | None) -> None:
    """Check that no options of an import are given where nothing is imported.

    Args:
        problem: why the options have no effect.
        options: the options; None if none is given.

    Raises:
        Unsuitable: an option is given; the message names the first one.
    """
    # An option with its default value has no effect anywhere, so it counts as not given.
    chosen = options.model_dump(exclude_defaults=True) if options else {}
    refuse(problem, **chosen)
