"""What the arguments and options of a command ask for, and those that would do nothing."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

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


def station_from(
    station: str, settings: list[str] | None, *, allow_code: bool = False, **options: Any
) -> StationConfig:
    """Return a station, a name or a file, with what the user wants changed.

    ``settings`` are texts ``key.path=value`` or YAML files; ``options`` values by the key that they mean, None if not
    given. Raises SimrobError: what cannot be; names the option, or what a file is that is no station.
    """
    overrides = {key: value for key, value in options.items() if value is not None}
    called = {key: f"--{key}" for key in overrides}
    changed = changes_of(settings, "--set", others=called)
    called |= {key: f"--set {key}" for key in changed}
    if find_station_importer(station) is None:
        refuse_other(station)
    return load_station(station, {**overrides, **changed}, called=called, allow_code=allow_code)


def changes_of(texts: list[str] | None, option: str, *, others: Mapping[str, str] | None = None) -> dict[str, Any]:
    """Return changes of a station by dotted keys, of texts ``key.path=value`` and of YAML files with sections.

    ``others`` is what else is given, by key. Raises SimrobError: another form, given twice, or a file that cannot be
    read.
    """
    found, called = dict[str, Any](), dict(others or {})
    for one in texts or []:
        for key, value in _changes(one, option):
            if key in called:
                raise Unsuitable(
                    compound("{option} {one}", option=option, one=one),
                    message("cli.gives_key_already", "{option} gives this key already", option=called[key]),
                    message("cli.leave_out_one", "leave out one of the two"),
                )
            found[key], called[key] = value, f"{option} {key}"
    return found


def _changes(one: str, option: str) -> Iterator[tuple[str, Any]]:
    if "=" in one or not is_yaml_name(one):
        for key, text in texts_by_key([one], option):
            yield key, parse_yaml(text, compound("{option} {one}", option=option, one=one))
        return
    file = Path(one).absolute()
    for name, section in with_absolute_paths(read_yaml(file), file.parent, Border(file)).items():
        entries = section.items() if isinstance(section, Mapping) else ()
        yield from ((f"{name}.{key}", value) for key, value in entries) if entries else [(name, section)]


def texts_by_key(texts: list[str] | None, option: str) -> Iterator[tuple[str, str]]:
    """Yield keys and texts of an option given as ``key.path=text``; raises InvalidParameter: given in another form."""
    for one in texts or []:
        key, equals, text = one.partition("=")
        if not (key.strip() and equals):
            raise InvalidParameter(option, one, message("cli.key_and_value", "of the form key.path=value"))
        yield key.strip(), text


def refuse(problem: str, /, **options: Any) -> None:
    """Check that options that would have no effect are not given.

    Args:
        problem: why the options have no effect, such as "this is a robot".
        options: value of each option, by the name of the command's parameter. An option whose value is None, false or
            empty is not given.

    Raises:
        Unsuitable: an option is given; the message names the first one.
    """
    for name, value in options.items():
        if value:
            raise Unsuitable(flag_of(name), problem)


def refuse_import(problem: str, options: ImportOptions | None) -> None:
    """Check that options of an import are not given where nothing is imported, as :func:`refuse` does."""
    refuse(problem, **(options.model_dump(exclude_defaults=True) if options else {}))
