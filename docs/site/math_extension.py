"""Lets mkdocstrings read the package's docstrings as Markdown."""

from typing import Any

from griffe import Extension, Object

from docs.site.texts import markdown


class Formulas(Extension):
    """Turns formulas and roles of each docstring into MathML and links."""

    def on_object(self, *, obj: Object, **_: Any) -> None:
        """Rewrite the docstring of an object, as soon as it is read."""
        if obj.docstring:
            obj.docstring.value = markdown(obj.docstring.value)
