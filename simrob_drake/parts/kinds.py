"""Sections of a station file that come in kinds, which their key ``kind`` tells apart.

Their modules are imported when a file names them: a station uses few, and classes of checked sections are dear to make.
"""

from collections.abc import Iterator, Mapping
from functools import cached_property, lru_cache, reduce
from importlib import import_module
from operator import or_
from typing import Annotated, Any

from pydantic import BaseModel, BeforeValidator, Field, GetJsonSchemaHandler, TypeAdapter
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema, SchemaValidator, core_schema


class Kinds:
    """A family of kinds: as the annotation of a type it checks a section as the kind that the section names."""

    def __init__(self, family: str, places: Mapping[str, str]) -> None:
        """Take the module of a family, and by kind the class in it: ``Class``, or ``module.Class`` of a package's."""
        self._family, self._places = family, places
        self._validator = lru_cache(self._validator_of)

    def __iter__(self) -> Iterator[str]:
        return iter(self._places)

    def model(self, kind: str) -> type[BaseModel]:
        """Return the class of a kind, which is imported."""
        module, _, name = f"{self._family}.{self._places[kind]}".rpartition(".")
        model: type[BaseModel] = getattr(import_module(module), name)
        return model

    @cached_property
    def models(self) -> dict[str, type[BaseModel]]:
        """The classes of all kinds."""
        return {kind: self.model(kind) for kind in self}

    @property
    def names_are_kinds(self) -> BeforeValidator:
        """Of a mapping of sections: one may do without the key ``kind`` where its name is one."""

        def with_kinds(entries: Any) -> Any:
            if not isinstance(entries, dict):
                return entries
            return {
                name: {"kind": name, **(entry or {})} if name in self and isinstance(entry, dict | None) else entry
                for name, entry in entries.items()
            }

        return BeforeValidator(with_kinds)

    def __contains__(self, name: object) -> bool:
        return isinstance(name, str) and name in self._places

    def __get_pydantic_core_schema__(self, _source: Any, _handler: Any) -> CoreSchema:
        """Check a section as the kind that it names, which is imported now."""
        return core_schema.no_info_plain_validator_function(self._checked)

    def __get_pydantic_json_schema__(self, _schema: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        """Return the schema of a section of any kind."""
        union: Any = Annotated[reduce(or_, self.models.values()), Field(discriminator="kind")]
        return handler(TypeAdapter(union).core_schema)

    def _checked(self, section: Any) -> Any:
        kind = section.get("kind") if isinstance(section, dict) else getattr(section, "kind", None)
        return self._validator(kind if kind in self else None).validate_python(section)

    def _validator_of(self, kind: str | None) -> SchemaValidator:
        """Return what checks a section of a kind; without one, what says which there are."""
        models = self.models if kind is None else {kind: self.model(kind)}
        for model in models.values():
            model.model_rebuild()
        choices = {name: model.__pydantic_core_schema__ for name, model in models.items()}
        return SchemaValidator(core_schema.tagged_union_schema(choices, discriminator="kind"))
