"""DrakeScene files of Drake: finding their packages, and loading them with Drake's own loader.

Drake's loader stops at the first problem with a message of its own, and downloads packages that are not there. So a
file is checked first: its keys, its tags, and the packages that it and its models name. Nothing is downloaded.
"""

import logging
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import yaml
from pydrake.common.yaml import yaml_load_typed
from pydrake.geometry import SceneGraph, SceneGraphConfig
from pydrake.multibody.parsing import (
    ModelDirectives,
    ModelInstanceInfo,
    PackageMap,
    Parser,
    ProcessModelDirectives,
)
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlant
from pydrake.systems.framework import DiagramBuilder

from simrob_drake.base.errors import InvalidConfig, SimrobError, shorten
from simrob_drake.base.files import NotRead, text_of
from simrob_drake.base.messages import compound, join_texts, message
from simrob_drake.base.packages import MANIFEST, PACKAGE_URI, Border, OutsideBorder, manifest_name
from simrob_drake.base.yaml_files import composed_yaml
from simrob_drake.extensions.drake_scenes.scenario import (
    DRIVERS,
    KEYS,
    OTHER_TAGS,
    ROTATIONS,
    Scenario,
)
from simrob_drake.importer.importer import SceneRequest

DIRECTIVES = "directives"
"""Key of the list of directives."""

_DIRECTIVE_KINDS = (
    "add_model",
    "add_model_instance",
    "add_frame",
    "add_weld",
    "add_collision_filter_group",
    "add_directives",
)
_DRAKE = "drake"  # the package that Drake itself is
_DRAKE_CACHE = Path("~/.cache/drake/package_map")  # folder of the packages that Drake downloaded
_PACKAGE = re.compile(r"package://([^/\s\"'<>]+)/")
_LARGEST_MODEL = 10_000_000  # bytes of a model file in which packages are looked for; published ones are far smaller
_MOST_FILES = 500  # files that a scene may consist of, so that files that name each other end


@dataclass
class DrakeScene:
    """A scene file, loaded into a plant of Drake.

    Attributes:
        file: the file.
        scenario: its content. For model directives alone everything but the directives is Drake's default.
        is_scenario: whether the file has further sections of a scenario.
        builder: owner of plant and scene graph; it is kept as long as they are.
        plant: finalized plant.
        scene_graph: scene graph of the plant.
        models: models that the directives add, in order.
        warnings: what Drake's parser says about the models.
        border: which files may be read.
    """

    file: Path
    scenario: Scenario
    is_scenario: bool
    builder: DiagramBuilder
    plant: MultibodyPlant
    scene_graph: SceneGraph
    models: list[ModelInstanceInfo]
    warnings: list[str] = field(default_factory=list)
    border: Border = field(default_factory=lambda: Border(Path.cwd()))


def load_scene(file: Path, request: SceneRequest) -> DrakeScene:
    """Load a scene file with Drake's loader.

    Args:
        file: file with model directives or a scenario.
        request: packages and folders that may be read, and which scenario of several is meant.

    Raises:
        InvalidConfig: the file has an unknown key, tag, directive, driver or package, or Drake cannot load it.
    """
    path = file.resolve()
    border = Border(path, request.mesh_path, request.packages)
    scene = _find_scene(path, request.scenario)
    checks = _Checks(border)
    checks.check(path, scene.node)
    scenario = _typed(path, scene.name)
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlant(scenario.plant_config, builder)
    if scenario.scene_graph_config != SceneGraphConfig():
        scene_graph.set_config(scenario.scene_graph_config)
    # The plant owns no scene graph, and the parser takes the one that the plant is registered with.
    parser = Parser(plant, scene_graph)
    for name in list(parser.package_map().GetPackageNames()):
        if name != _DRAKE:
            parser.package_map().Remove(name)  # such as drake_models, which Drake would download
    for name, folder in checks.packages.items():
        if name != _DRAKE:
            parser.package_map().Add(name, str(folder))
    with _drake_problems(path), _warnings_of_drake() as warnings:
        models = list(
            ProcessModelDirectives(ModelDirectives(directives=scenario.directives), parser)
        )
        _set_initial_positions(plant, scenario)
        plant.Finalize()
    has_more = any(key != DIRECTIVES for key in _keys(scene.node))
    return DrakeScene(
        path, scenario, has_more, builder, plant, scene_graph, models, warnings, border
    )


def _set_initial_positions(plant: MultibodyPlant, scenario: Scenario) -> None:
    """Set the default positions of joints from the section ``initial_position``."""
    for model, joints in scenario.initial_position.items():
        instance = plant.GetModelInstanceByName(model)
        for joint, positions in joints.items():
            plant.GetJointByName(joint, instance).set_default_positions(positions)


class _NamedScene(NamedTuple):
    """The mapping of a scene in a file.

    Attributes:
        name: name of the scenario, the key of the mapping; empty if the whole file is the scene.
        node: the mapping.
    """

    name: str
    node: yaml.MappingNode


def _find_scene(path: Path, scenario: str) -> _NamedScene:
    """Parse a scene file, and find the scene that is meant.

    Args:
        path: the file.
        scenario: name of one scenario of several. Empty for a file with one scene or one scenario.

    Raises:
        InvalidConfig: the file cannot be read, or there is no such scenario.
    """
    try:
        root = composed_yaml(text_of(path))
    except NotRead as problem:
        raise InvalidConfig(
            path, "", message("base.cannot_be_read", "cannot be read ({problem})", problem=problem)
        ) from None
    except (yaml.YAMLError, ValueError) as problem:
        text = " ".join(str(problem).split())
        raise InvalidConfig(
            path, "", message("base.not_yaml", "is not YAML: {problem}", problem=text)
        ) from None
    # it has the key `directives`, see find_station_importer()
    assert isinstance(root, yaml.MappingNode)
    named = {key: value for key, value in _items(root) if isinstance(value, yaml.MappingNode)}
    scenes = {key: value for key, value in named.items() if DIRECTIVES in _merged_items(value)}
    if DIRECTIVES in _keys(root) and not scenario:
        return _NamedScene("", root)
    if not scenario and len(scenes) == 1:
        scenario = next(iter(scenes))
    if scenario in scenes:
        return _NamedScene(scenario, scenes[scenario])
    listed = ", ".join(scenes)
    if scenario:
        raise InvalidConfig(
            path,
            scenario,
            message(
                "drake_scenes.no_such_scenario",
                "is no scenario of the file; it has: {known}",
                known=listed or "-",
            ),
        )
    raise InvalidConfig(
        path,
        "",
        message(
            "drake_scenes.several_scenarios",
            "has the scenarios {known}; choose one: simrob import --scenario NAME, or add_directives: {file}#NAME",
            known=listed,
            file=path.name,
        ),
    )


def _typed(path: Path, scenario: str) -> Scenario:
    """Read a scene file with Drake's loader of YAML.

    Raises:
        InvalidConfig: a value does not fit its key.
    """
    with _drake_problems(path):
        loaded: Scenario = yaml_load_typed(
            schema=Scenario,
            filename=str(path),
            child_name=scenario or None,
            defaults=Scenario(),
            retain_map_defaults=True,
        )
    return loaded


class _Checks:
    """Checks of a scene file and of all files that it names."""

    def __init__(self, border: Border) -> None:
        """Begin with a border: which files may be read, and where packages are."""
        self._border = border
        self._seen = set[Path]()
        self.packages = dict[str, Path]()

    def check(self, path: Path, node: yaml.MappingNode) -> None:
        """Check the mapping of a scene.

        Args:
            path: its file.
            node: the mapping.

        Raises:
            InvalidConfig: a key, tag, directive, driver or package is unknown.
        """
        self._seen.add(path)
        for key, line in _keys_and_lines(node):
            if key not in (*KEYS, "<<"):
                raise _unknown(path, line, message("drake_scenes.key", "key"), key, KEYS)
        for key, value in _merged_items(node).items():
            if key == "model_drivers":
                self._check_drivers(path, value)
            elif key == DIRECTIVES:
                self._check_directives(path, value)
            self._check_tags(path, value, with_drivers=key == "model_drivers")

    def _check_drivers(self, path: Path, node: yaml.Node) -> None:
        """Check that each driver is known."""
        for model, driver in _items(node):
            tag = driver.tag.removeprefix("!")
            if tag not in DRIVERS:
                found = tag if driver.tag.startswith("!") else str(driver.value)
                problem = message(
                    "drake_scenes.unknown_driver",
                    "the driver {driver} (line {line}) is none of those that a station has: {known}",
                    driver=shorten(found),
                    line=driver.start_mark.line + 1,
                    known=join_texts(DRIVERS),
                )
                raise InvalidConfig(path, f"model_drivers.{model}", problem)

    def _check_tags(self, path: Path, node: yaml.Node, *, with_drivers: bool) -> None:
        """Check that all tags in a value are those that Drake has."""
        known = (*ROTATIONS, *OTHER_TAGS, *(DRIVERS if with_drivers else ()))
        for inner in _descendants(node):
            name = inner.tag.removeprefix("!")
            # Tags of YAML itself, such as that of a mapping, have a longer form.
            if inner.tag.startswith("!") and name not in known:
                raise _unknown(
                    path,
                    inner.start_mark.line + 1,
                    message("drake_scenes.tag", "tag"),
                    f"!{name}",
                    known,
                )

    def _check_directives(self, path: Path, node: yaml.Node) -> None:
        """Check the directives of a file, and the files that they name."""
        for entry in node.value if isinstance(node, yaml.SequenceNode) else ():
            for kind, value in _items(entry):
                if kind not in _DIRECTIVE_KINDS:
                    line = entry.start_mark.line + 1
                    raise _unknown(
                        path,
                        line,
                        message("drake_scenes.directive", "directive"),
                        kind,
                        _DIRECTIVE_KINDS,
                    )
                named = next((inner for key, inner in _items(value) if key == "file"), None)
                if named is not None:
                    self._check_file(path, kind, named)

    def _check_file(self, path: Path, kind: str, node: yaml.Node) -> None:
        """Check the file that a directive names.

        Args:
            path: file with the directive.
            kind: kind of the directive.
            node: value of its key ``file``.
        """
        where = f"{kind}.file"
        uri = str(node.value)
        line = node.start_mark.line + 1
        if uri.startswith(PACKAGE_URI):
            found = self._in_package(path, where, uri, line)
        elif uri.startswith("file://"):
            found = Path(uri.removeprefix("file://"))
        else:
            # Drake resolves such a path from the folder of the file only for some formats, so nothing is guessed.
            problem = message(
                "drake_scenes.no_uri",
                "{uri} (line {line}) must begin with package:// or file://",
                uri=shorten(uri),
                line=line,
            )
            raise InvalidConfig(path, where, problem)
        found = self._readable(path, where, found)
        if not found.is_file():
            problem = message(
                "drake_scenes.no_file",
                "{uri} (line {line}): there is no file {file}",
                uri=shorten(uri),
                line=line,
                file=found,
            )
            raise InvalidConfig(path, where, problem)
        if found in self._seen:
            return
        self._seen.add(found)
        if len(self._seen) > _MOST_FILES:
            problem = message(
                "drake_scenes.too_many_files", "names more than {most} files", most=_MOST_FILES
            )
            raise InvalidConfig(path, "", problem)
        if kind == "add_directives":
            self.check(found, _find_scene(found, "").node)
        else:
            self._check_model(found)

    def _check_model(self, path: Path) -> None:
        """Check that the packages are there that a model file names."""
        try:
            text = text_of(path, _LARGEST_MODEL)
        except NotRead as problem:
            raise InvalidConfig(
                path,
                "",
                message("base.cannot_be_read", "cannot be read ({problem})", problem=problem),
            ) from None
        # A model may name files of the package that it is in, which Drake's parser finds itself.
        own = [manifest_name(folder) for folder in path.parents if (folder / MANIFEST).is_file()]
        for name in dict.fromkeys(_PACKAGE.findall(text)):
            if name not in own:
                line = text[: text.index(f"{PACKAGE_URI}{name}/")].count("\n") + 1
                self._in_package(path, "", f"{PACKAGE_URI}{name}/", line)

    def _in_package(self, path: Path, where: str, uri: str, line: int) -> Path:
        """Find the file that a URI ``package://NAME/path`` names, and note the folder of the package.

        Args:
            path: file with the URI, for errors.
            where: key of the URI in the file.
            uri: the URI.
            line: its line.

        Raises:
            InvalidConfig: there is no such package.
        """
        name, _, rest = uri.removeprefix(PACKAGE_URI).partition("/")
        folder = self._package(name)
        if folder is None:
            problem = message(
                "drake_scenes.unknown_package",
                "package://{name} (line {line}): no package {name} is on this computer, and nothing is downloaded; "
                "give its folder with packages.{name}, --mesh-path or ROS_PACKAGE_PATH",
                name=name,
                line=line,
            )
            raise InvalidConfig(path, where, problem)
        self.packages[name] = folder
        return folder / rest

    def _package(self, name: str) -> Path | None:
        """Find the folder of a package. None if it is not there.

        Drake's own package, the ones that it downloaded, and those next to the scene are found, too.
        """
        found = self._border.package(name)
        if found is not None:
            return found
        # An export has its models in a package next to the scene.
        near = self._border.source.parent
        folders = [folder for folder in near.iterdir() if folder.is_dir()]
        if name == _DRAKE:
            folders.append(Path(PackageMap().GetPath(_DRAKE)))
        downloaded = _DRAKE_CACHE.expanduser()
        if downloaded.is_dir():
            folders += sorted(downloaded.glob("*"))
        return next((folder for folder in folders if manifest_name(folder) == name), None)

    def _readable(self, path: Path, where: str, file: Path) -> Path:
        """Check that a file may be read. Files of packages may. Returns its path without symbolic links.

        Raises:
            InvalidConfig: the file lies outside of the packages and folders that may be read.
        """
        found = file.resolve()
        if any(found.is_relative_to(folder.resolve()) for folder in self.packages.values()):
            return found
        try:
            return self._border.readable(file)
        except OutsideBorder as problem:
            raise InvalidConfig(
                path,
                where,
                compound("{path} {problem}", path=shorten(str(file), 300), problem=problem),
            ) from None


def _unknown(path: Path, line: int, kind: str, name: str, known: Sequence[str]) -> InvalidConfig:
    """Make the error for an unknown name in a scene, with the closest known one."""
    return InvalidConfig(
        path,
        "",
        message(
            "drake_scenes.unknown_name",
            "the {kind} {name} (line {line}) is unknown; known are {known}",
            kind=kind,
            name=shorten(name),
            line=line,
            known=join_texts(known),
        ),
    )


def _items(node: yaml.Node) -> list[tuple[str, yaml.Node]]:
    """List the keys of a mapping with their values. Other nodes have none."""
    if not isinstance(node, yaml.MappingNode):
        return []
    return [(str(key.value), value) for key, value in node.value]


def _keys(node: yaml.Node) -> list[str]:
    """List the keys of a mapping."""
    return [key for key, _ in _items(node)]


def _merged_items(node: yaml.Node) -> dict[str, yaml.Node]:
    """Find the values of a mapping by key, with those of the mappings that it merges in by the key ``<<``."""
    items = dict(_items(node))
    merged = items.pop("<<", None)
    for source in merged.value if isinstance(merged, yaml.SequenceNode) else [merged]:
        if isinstance(source, yaml.MappingNode):
            items = {**_merged_items(source), **items}
    return items


def _keys_and_lines(node: yaml.MappingNode) -> Iterator[tuple[str, int]]:
    """Yield the keys of a mapping with their lines, counted from 1."""
    for key, _ in node.value:
        yield str(key.value), key.start_mark.line + 1


def _descendants(node: yaml.Node) -> Iterator[yaml.Node]:
    """Yield a node and all nodes in it, each once."""
    waiting = [node]
    seen = set[int]()
    while waiting:
        inner = waiting.pop()
        if id(inner) in seen:  # an alias names a node that is elsewhere, too
            continue
        seen.add(id(inner))
        yield inner
        if isinstance(inner, yaml.MappingNode):
            waiting += [value for _, value in inner.value]
        elif isinstance(inner, yaml.SequenceNode):
            waiting += inner.value


@contextmanager
def _drake_problems(path: Path) -> Iterator[None]:
    """Context manager around code of Drake, whose errors become errors that name the file."""
    try:
        yield
    except SimrobError:
        raise
    except (
        RuntimeError,
        ValueError,
        SystemExit,
        LookupError,
        TypeError,
        AttributeError,
        OSError,
    ) as problem:
        # Failed assertions of Drake come as SystemExit.
        text = shorten(" ".join(str(problem).split()), 500)
        raise InvalidConfig(
            path,
            "",
            message(
                "robots.drake_cannot_read", "Drake cannot read this file: {problem}", problem=text
            ),
        ) from problem


class _Collector(logging.Handler):
    """Collects the warnings of Drake's parser."""

    def __init__(self) -> None:
        """Begin without warnings."""
        super().__init__(logging.WARNING)
        self.texts = list[str]()

    def emit(self, record: logging.LogRecord) -> None:
        """Keep the text of a warning, once, without the path of the file in front."""
        text = " ".join(record.getMessage().split())
        text = re.sub(r"^\S*/([^/\s]+:\d*:?) ", r"\1 ", text)
        if text not in self.texts:
            self.texts.append(text)


@contextmanager
def _warnings_of_drake() -> Iterator[list[str]]:
    """Context manager that collects the warnings of Drake's parser instead of printing them."""
    logger = logging.getLogger("drake")
    collector = _Collector()
    propagates = logger.propagate
    logger.addHandler(collector)
    logger.propagate = False
    try:
        yield collector.texts
    finally:
        logger.removeHandler(collector)
        logger.propagate = propagates
