"""Kinds of sections of a station file, which differ in their key ``kind``: the kinds of sensor, of monitor, ...

Each kind has a class of its own, a pydantic model with the keys of the section. All kinds of sensor, for example, are a
*family*. The class of a kind is imported when a station names the kind: a station uses few, and pydantic takes long to
make such classes. Installed extensions add kinds to each family.
"""

from collections.abc import Iterator, Mapping
from functools import cached_property, lru_cache, reduce
from importlib import import_module
from operator import or_
from typing import Annotated, Any

from pydantic import BaseModel, BeforeValidator, Field, GetJsonSchemaHandler, TypeAdapter
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema, SchemaValidator, core_schema

from simrob_drake.base.extension import (
    additions,
    classes_of_extensions,
    load_addition_class,
    register_core_names,
)
from simrob_drake.base.known_extensions import check_provided
from simrob_drake.base.messages import message


class Kinds:
    """A family of kinds. As the annotation of a type, it checks a section by the class of the kind that it names."""

    def __init__(
        self,
        family: str,
        classes: Mapping[str, str],
        *,
        base: type[BaseModel],
        point: str,
        base_of_extensions: str = "",
    ) -> None:
        """Declare the kinds of the core.

        Args:
            family: name of the module or package that has the classes.
            classes: for each kind its class in the family: ``Class``, or ``module.Class`` in a package.
            base: class that the class of every kind is derived from.
            point: extension point at which extensions add further kinds, such as ``sensors``.
            base_of_extensions: import string of the class that kinds of extensions are derived from; `base` if empty.
        """
        self._family = family
        self._classes = classes
        self._base = base
        self._point = point
        self._base_of_extensions = base_of_extensions
        # A cache of this object's own, so that it can be cleared: pydantic takes milliseconds to make a validator.
        self._validator = lru_cache(self._make_validator)
        # Extensions that would add a kind of the same name are refused.
        register_core_names(point, lambda: classes)

    def __iter__(self) -> Iterator[str]:
        yield from self._classes
        yield from additions(self._point)

    def __contains__(self, name: object) -> bool:
        if not isinstance(name, str):
            return False
        return name in self._classes or name in additions(self._point)

    def model(self, kind: str) -> type[BaseModel]:
        """Import the class of a kind.

        Args:
            kind: name of a kind that the family has, of the core or of an extension.

        Raises:
            KeyError: there is no such kind.
            BrokenExtension: the kind is one of an extension whose module cannot be imported, or its class is not
                derived from the one that kinds of extensions must be derived from.
        """
        if kind not in self._classes:
            # A kind of an extension. Its module is imported here, when a station uses the kind.
            added: type[BaseModel] = load_addition_class(
                additions(self._point)[kind], self._extension_base
            )
            return added
        # The module is imported only here: a station pays for the kinds that it names. The text is
        # "package.module.Class".
        module, _, name = f"{self._family}.{self._classes[kind]}".rpartition(".")
        model: type[BaseModel] = getattr(import_module(module), name)
        return model

    @property
    def _extension_base(self) -> type[BaseModel]:
        """Class that kinds of extensions are derived from. It is imported here, when an extension has such a kind."""
        if not self._base_of_extensions:
            return self._base
        module, _, name = self._base_of_extensions.partition(":")
        base: type[BaseModel] = getattr(import_module(module), name)
        return base

    @cached_property
    def models(self) -> dict[str, type[BaseModel]]:
        """Classes of all kinds, by kind; all of them are imported. Kinds of broken extensions are missing."""
        # A class of the core that cannot be imported is an error; a broken kind of an extension is left out.
        core = {kind: self.model(kind) for kind in self._classes}
        return core | classes_of_extensions(self._point, self._extension_base)

    def forget_extensions(self) -> None:
        """Forget the validators and the mapping `models`, which contain the kinds of the installed extensions.

        It is for tests that install other extensions.
        """
        self._validator.cache_clear()
        # A cached_property keeps its value in the object's dictionary.
        self.__dict__.pop("models", None)

    @property
    def names_are_kinds(self) -> BeforeValidator:
        """Validator of a mapping of sections: a section without ``kind`` has the kind of the section's name.

        For example, ``sensors: {imu: {rate: 100}}`` and ``sensors: {imu: }`` are sensors of the kind ``imu``. A section
        that has a kind, or whose name is no kind, is not changed.
        """

        def with_kinds(entries: Any) -> Any:
            """Add the missing kinds to a mapping of sections by name, and return it as a new mapping.

            Wrong content is left to pydantic, which reports it.
            """
            if not isinstance(entries, dict):
                return entries
            completed = {}
            for name, entry in entries.items():
                # An empty section is None.
                lacks_kind = entry is None or (isinstance(entry, dict) and "kind" not in entry)
                if lacks_kind and name in self:
                    completed[name] = {"kind": name, **(entry or {})}
                else:
                    completed[name] = entry
            return completed

        return BeforeValidator(with_kinds)

    def __get_pydantic_core_schema__(self, _source: Any, _handler: Any) -> CoreSchema:
        """Make pydantic check a section by the class of the kind that it names.

        The schema is a plain function, instead of pydantic's own union of classes, which would import the classes of
        all kinds.
        """
        return core_schema.no_info_plain_validator_function(self._check)

    def __get_pydantic_json_schema__(
        self, _schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        """Make the JSON schema of a section of any kind. This imports the classes of all kinds."""
        union: Any = Annotated[reduce(or_, self.models.values()), Field(discriminator="kind")]
        return handler(TypeAdapter(union).core_schema)

    def _check(self, section: Any) -> Any:
        """Convert a section to an object of the class of its kind.

        Args:
            section: content of the section, or an object that was checked before.

        Raises:
            ValidationError: the section is wrong, by pydantic.
            SimrobError: an extension that is not installed has this kind, or the module of an extension is broken.
        """
        # pydantic also validates a section that is already an object, such as one given in Python.
        kind = section.get("kind") if isinstance(section, dict) else getattr(section, "kind", None)
        if isinstance(kind, str) and kind not in self:
            check_provided(
                self._point, kind, message("parts.the_kind", "the kind {kind}", kind=kind)
            )
        # For an unknown kind, the validator of all kinds makes the error, which lists them.
        known_kind = kind if kind in self else None
        return self._validator(known_kind).validate_python(section)

    def _make_validator(self, kind: str | None) -> SchemaValidator:
        """Make the validator of sections of a kind.

        If the kind is None, it is a validator of all kinds, whose error for an unknown kind lists them.
        """
        models = self.models if kind is None else {kind: self.model(kind)}
        for model in models.values():
            model.model_rebuild()  # finds classes that were not imported yet when the model was made
        choices = {name: model.__pydantic_core_schema__ for name, model in models.items()}
        return SchemaValidator(core_schema.tagged_union_schema(choices, discriminator="kind"))
