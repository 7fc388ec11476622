"""Sections of a station file that come in kinds, which their key ``kind`` tells apart."""

from typing import Any, get_args

from pydantic import BaseModel, BeforeValidator


def models_by_kind(union: Any) -> dict[str, type[BaseModel]]:
    """Return the models of a union that is annotated with its discriminator, by their kinds."""
    models = get_args(get_args(union)[0])
    return {get_args(model.model_fields["kind"].annotation)[0]: model for model in models}


def named_by_kind(union: Any) -> BeforeValidator:
    """Let an entry of a mapping of entries do without the key ``kind`` where its name is one."""
    kinds = models_by_kind(union)

    def with_kinds(entries: Any) -> Any:
        if not isinstance(entries, dict):
            return entries
        return {
            name: {"kind": name, **(entry or {})} if name in kinds and isinstance(entry, dict | None) else entry
            for name, entry in entries.items()
        }

    return BeforeValidator(with_kinds)
