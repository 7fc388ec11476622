"""Messages for users: sentences with an id and fields, which other languages have words for.

The English template of a message stands in the code where it is used::

    message("results.ran_to_its_end", "ran to its end at {time:g} s", time=end)

A :class:`Message` is its English text, so that code, logs and files use it as they use any text. A page that shows
another language calls :func:`in_language`, which finds the template by the id and never by the English text.

The first word of an id is the package that uses the message. The templates of the core are in ``base/languages``, one
folder for each language and one YAML file for each package; an extension announces a folder of its own (see
``Extension.messages``).
"""

import re
import string
import warnings
from collections.abc import Callable, Iterable, Mapping
from contextvars import ContextVar
from functools import cache
from numbers import Number
from pathlib import Path
from typing import Any

import yaml

SOURCE_LANGUAGE = "en"
"""Language of the templates in the code."""

_CORE = Path(__file__).parents[1]
_CORE_CATALOGUES = _CORE / "base" / "languages"

_WITH_DECIMAL_COMMA = frozenset({"es"})
"""Languages that write 23,5 for the number 23.5."""

_SWAPPED_SEPARATORS = str.maketrans(".,", ",.")
"""Exchanges the decimal point and the comma between thousands: 1,234.5 becomes 1.234,5."""

# A context variable instead of a global: threads that serve users of different languages do not disturb each other.
_output_language: ContextVar[str] = ContextVar("output_language", default=SOURCE_LANGUAGE)


def set_output_language(language: str) -> None:
    """Set the language of what this context writes from now on, such as lines on the screen and words in plots.

    Args:
        language: code of the language, such as ``es``.
    """
    _output_language.set(language)


def output_language() -> str:
    """Language of the output, see :func:`set_output_language`. A process that is started for the output needs it."""
    return _output_language.get()


def translate(text: str) -> str:
    """Render a message in the language of the output, see :func:`set_output_language`. Other texts stay."""
    return in_language(text, _output_language.get())


def with_decimal_sign(number: str) -> str:
    """Write a number, given as Python formats it, with the decimal sign of the language of the output."""
    is_with_comma = _output_language.get() in _WITH_DECIMAL_COMMA
    return number.translate(_SWAPPED_SEPARATORS) if is_with_comma else number


class MessageWarning(UserWarning):
    """Warning that a template of another language cannot be filled, so that the English one is shown."""


class Message(str):
    """The English text of a message, with what other languages need.

    Attributes:
        id: stable name of the message, such as ``results.ran_to_its_end``. It is empty for a compound, whose template
            has no words and is the same in each language.
        template: the English template, with format specifications as in :meth:`str.format`. A specification with a
            bar chooses singular or plural: ``{count} {count:step|steps}``.
        fields: values of the template's fields: numbers, texts and other messages.
        longest: largest length of the text, in any language. A longer one is cut at its end, see :func:`one_line`. None
            if it is not limited.
        is_sentence: whether the text begins with a capital letter, in any language.
    """

    id: str
    template: str
    fields: Mapping[str, Any]
    longest: int | None
    is_sentence: bool

    def __new__(
        cls,
        message_id: str,
        template: str,
        fields: Mapping[str, Any],
        longest: int | None = None,
        is_sentence: bool = False,
    ) -> "Message":
        """Create the message, and fill its template in English. The arguments are the attributes.

        Raises:
            KeyError: the template has a field without a value.
        """
        # The text itself is the English one, so comparisons, logs and JSON need to know nothing of messages.
        text = _fill(template, fields, SOURCE_LANGUAGE)
        created = super().__new__(cls, _with_attributes(text, longest, is_sentence=is_sentence))
        created.id = message_id
        created.template = template
        created.fields = dict(fields)
        created.longest = longest
        created.is_sentence = is_sentence
        return created

    def __str__(self) -> str:
        """Return the message itself, so that ``str(error)`` keeps its id."""
        return self

    def __add__(self, other: str) -> "Message":
        """Append a text, in which a message keeps its id."""
        return join_texts([self, other], "")

    def __radd__(self, other: str) -> "Message":
        """Put a text in front, in which a message keeps its id."""
        return join_texts([other, self], "")

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle and copy the message with its id and its fields."""
        # Python's own way would call the class with the text alone, as for a plain str, and fail.
        return Message, (self.id, self.template, self.fields, self.longest, self.is_sentence)

    def limited_to(self, length: int) -> "Message":
        """Return this message with a largest length in any language. A smaller one than before stays."""
        shorter = length if self.longest is None else min(length, self.longest)
        return Message(self.id, self.template, self.fields, shorter, self.is_sentence)

    def as_sentence(self) -> "Message":
        """Return this message with a capital letter at its beginning, in any language."""
        return Message(self.id, self.template, self.fields, self.longest, is_sentence=True)


# A YAML file has a message as plain English text. PyYAML dumps a str only if its class is str itself, not a subclass,
# and each of the two dumpers has its own table of classes.
for _dumper in (yaml.SafeDumper, yaml.CSafeDumper):
    _dumper.add_representer(Message, lambda dumper, text: dumper.represent_str(str.__str__(text)))


def message(message_id: str, template: str, /, **fields: object) -> Message:
    """Create a message.

    Args:
        message_id: stable name of the message: its package, a dot, and two to five words, such as
            ``results.ran_to_its_end``.
        template: the English text, see :class:`Message`.
        fields: values of the template's fields. Give numbers as numbers, with a format in the template, so that a
            language writes its own decimal sign. An error stands for its message.
    """
    return Message(
        message_id, template, {name: _field_value(value) for name, value in fields.items()}
    )


def compound(template: str, /, **fields: object) -> Message:
    """Create a message of other messages, names and numbers: its template has no words, such as ``{place}: {problem}``.

    No catalogue has an entry for it: each part is rendered in its language.
    """
    return message("", template, **fields)


def join_texts(parts: Iterable[str], separator: str = ", ") -> Message:
    """Join texts to a message, in which each part keeps its own id.

    Args:
        parts: messages or other texts.
        separator: text between two parts. If it has words, it is a message, such as `` and ``.
    """
    fields = {f"part_{number}": part for number, part in enumerate(parts)}
    # A separator with words is a field of the template, so that the other language's words are filled in.
    if isinstance(separator, Message):
        template = "{separator}".join(f"{{{name}}}" for name in fields)
        return compound(template, separator=separator, **fields)
    # A separator without words is a part of the template. Its braces would be read as fields.
    between = separator.replace("{", "{{").replace("}", "}}")
    return compound(between.join(f"{{{name}}}" for name in fields), **fields)


def replace_text(text: str, old: str, new: str) -> str:
    """Replace a part of a text, such as the path of a temporary file. A message keeps its id.

    Args:
        text: the text. In a message, the part is replaced in the values of the fields, not in the template.
        old: the part.
        new: what takes its place.
    """
    if not isinstance(text, Message):
        return text.replace(old, new)
    fields = {
        name: replace_text(value, old, new) if isinstance(value, str) else value
        for name, value in text.fields.items()
    }
    return Message(text.id, text.template, fields, text.longest, text.is_sentence)


def message_of(error: BaseException) -> str:
    """Message of an error: a Message if the error has one, or was raised with one, otherwise its text."""
    # A SimrobError has the attribute; a ValueError of a validator has only its argument.
    candidates = [getattr(error, "message", None), *error.args[:1]]
    return next(
        (candidate for candidate in candidates if isinstance(candidate, Message)), str(error)
    )


def number_in_language(digits: str, language: str) -> str:
    """Write a number with the decimal sign of a language.

    Args:
        digits: the number as Python writes it, such as ``1,234.5``.
        language: the language, such as ``es``.
    """
    return digits.translate(_SWAPPED_SEPARATORS) if language in _WITH_DECIMAL_COMMA else digits


def in_language(text: str, language: str) -> str:
    """Render a message in a language. A text that is no :class:`Message` is returned unchanged.

    Args:
        text: the message, or another text such as a name.
        language: the language, such as ``es``. A message without a template in it is rendered in English, and its
            fields, where they are messages, in the language.
    """
    if not isinstance(text, Message) or language == SOURCE_LANGUAGE:
        return str.__str__(text)
    template = _template(text.id, language)
    if template is not None:
        try:
            filled = _fill(template, text.fields, language)
            return _with_attributes(filled, text.longest, is_sentence=text.is_sentence)
        except (KeyError, IndexError, ValueError) as problem:
            reason = f"{type(problem).__name__}: {problem}"
            sentence = f"the template of {text.id} in '{language}' cannot be filled ({reason}); English is shown"
            warnings.warn(sentence, MessageWarning, stacklevel=2)
    # The English template is filled in the other language all the same: its fields may be messages with a template
    # there, and numbers get the decimal sign of that language.
    return _with_attributes(
        _fill(text.template, text.fields, language), text.longest, is_sentence=text.is_sentence
    )


def as_data(text: str) -> Any:
    """Convert a message to data that JSON has, with all that other languages need. Other texts stay texts."""
    if not isinstance(text, Message):
        return text
    fields = {
        name: as_data(value) if isinstance(value, str) else _python_number(value)
        for name, value in text.fields.items()
    }
    return {
        "id": text.id,
        "template": text.template,
        "fields": fields,
        "longest": text.longest,
        "is_sentence": text.is_sentence,
    }


def from_data(data: Any) -> Any:
    """Restore a message that :func:`as_data` has converted. Other data, such as texts and numbers, are unchanged.

    Raises:
        ValueError: the template is not one that a message may have, such as one that would make a text of a gigabyte,
            or a field of it has no value. The data may come from a file that somebody else wrote.
        TypeError: the fields are no mapping, or the template is no text.
    """
    if not (isinstance(data, Mapping) and {"id", "template", "fields"} <= data.keys()):
        return data
    _check_template(data["template"])
    if not isinstance(data["fields"], Mapping):
        raise TypeError("the fields of a message must be a mapping")
    fields = {name: from_data(value) for name, value in data["fields"].items()}
    try:
        return Message(
            data["id"],
            data["template"],
            fields,
            data.get("longest"),
            data.get("is_sentence", False),
        )
    except KeyError as missing:
        raise ValueError(f"the field {missing} of a message has no value") from missing


def _check_template(template: str) -> None:
    """Check that a template has plain fields only: names, with short format specifications or plurals.

    Raises:
        ValueError: the template takes attributes or entries of its fields, or gives a field a width.
    """
    for _, name, specification, conversion in string.Formatter().parse(template):
        # The formatter yields the text after the last field as an entry without a field.
        if name is None:
            continue
        # A name such as {text.__class__} would read attributes of Python objects.
        is_plain = name.isidentifier() and conversion is None
        # A width such as {text:1000000000} would make a text of a gigabyte; so could a field inside the specification.
        is_short = "|" in (specification or "") or _SPECIFICATION.fullmatch(specification or "")
        if not (is_plain and is_short) or "{" in (specification or ""):
            raise ValueError(
                f"a field {name!r} with the format {specification!r} is none of a message"
            )


_SPECIFICATION = re.compile(r"[+z]?,?(\.\d{1,2})?[a-z%]?")
"""Format specifications of templates: sign, precision and type, without a width."""


def catalogue(package: str, language: str) -> Mapping[str, str]:
    """Templates of a package in a language, by the ids of the messages. Empty for a language without templates.

    Args:
        package: first word of the ids.
        language: the language, such as ``es``.
    """
    return _read_catalogue(_catalogue_file(package, language))


def register_catalogues(find_folder: Callable[[str], Path | None]) -> None:
    """Declare where messages of extensions are.

    Args:
        find_folder: returns the folder with one file ``<language>.yaml`` for each language, for the first word of ids,
            or None if no extension has such ids.
    """
    _folder_finders.append(find_folder)


_folder_finders: list[Callable[[str], Path | None]] = []


def core_packages() -> list[str]:
    """List the names of the core's packages, with which the ids of its messages begin."""
    return sorted(path.stem for path in _CORE.iterdir() if path.stem.isidentifier())


def _field_value(value: object) -> Any:
    """Value of a field as a message keeps it: numbers and texts, which survive pickling and have no references.

    An error becomes its message, and any other object its text.
    """
    if isinstance(value, BaseException):
        return message_of(value)
    return value if isinstance(value, str | Number) else str(value)


def _python_number(value: Any) -> Any:
    """Convert a number of numpy to one of Python, for JSON."""
    return value.item() if hasattr(value, "item") else value


def one_line(text: str, length: int) -> str:
    """Write a text on one line, without control characters, and cut its end if it is long.

    Args:
        text: the text.
        length: largest length of the result.
    """
    # A text may be very long: only its beginning is examined.
    head = text[: 100 * length]
    line = " ".join(head.split())
    # Control characters could change the state of a terminal.
    shown = "".join(
        letter if letter.isprintable() else "\N{REPLACEMENT CHARACTER}" for letter in line
    )
    is_whole = len(shown) <= length and len(text) <= 100 * length
    return shown if is_whole else shown[: length - 1] + "…"


def _with_attributes(text: str, longest: int | None, *, is_sentence: bool) -> str:
    """Apply the attributes ``longest`` and ``is_sentence`` of a message to its filled template."""
    if longest is not None:
        text = one_line(text, longest)
    return text[:1].upper() + text[1:] if is_sentence else text


def _fill(template: str, fields: Mapping[str, Any], language: str) -> str:
    """Fill a template with the values of its fields, in a language."""
    # Python's own formatting is ten times as fast, and English without plurals needs nothing else.
    if language == SOURCE_LANGUAGE and "|" not in template:
        return template.format(**fields)
    return _Filler(language).vformat(template, (), fields)


class _Filler(string.Formatter):
    """Fills templates in one language: messages in fields, decimal signs, and plurals."""

    def __init__(self, language: str) -> None:
        """Create the formatter.

        Args:
            language: the language, such as ``es``.
        """
        self._language = language

    def format_field(self, value: Any, format_spec: str) -> str:
        """Format the value of a field.

        Args:
            value: the value.
            format_spec: its format specification. With a bar, it is the singular and the plural of a word, of which
                the number chooses one.
        """
        # A pair of words such as "step|steps" is no format specification of Python, so it is handled first.
        if "|" in format_spec:
            singular, plural = format_spec.split("|")
            return singular if value == 1 else plural
        if isinstance(value, str):
            return format(in_language(value, self._language), format_spec)
        text = format(value, format_spec)
        # Python counts True and False as numbers.
        is_number = isinstance(value, Number) and not isinstance(value, bool)
        return number_in_language(text, self._language) if is_number else text


def _template(message_id: str, language: str) -> str | None:
    """Template of a message in a language. Returns None if there is none, or if the message is a compound."""
    package, dot, _ = message_id.partition(".")
    return catalogue(package, language).get(message_id) if dot else None


# One search for each package and language: it may have to look at all installed extensions.
@cache
def _catalogue_file(package: str, language: str) -> Path | None:
    """Find the file with the templates of a package in a language. Returns None if there is none."""
    core_file = _CORE_CATALOGUES / language / f"{package}.yaml"
    if core_file.is_file():
        return core_file
    for find_folder in _folder_finders:
        folder = find_folder(package)
        if folder is not None:
            file = folder / f"{language}.yaml"
            return file if file.is_file() else None
    return None


@cache
def _read_catalogue(file: Path | None) -> Mapping[str, str]:
    """Read a file of templates once.

    Returns an empty mapping if the file is None, and with a warning if it cannot be read or holds no mapping.
    """
    if file is None:
        return {}
    try:
        content = yaml.load(file.read_text(encoding="utf-8"), yaml.CSafeLoader)
    except (OSError, ValueError, yaml.YAMLError) as problem:
        warnings.warn(
            f"{file} cannot be read ({problem}); its messages are in English",
            MessageWarning,
            stacklevel=2,
        )
        return {}
    # A file that is damaged must not stop a run: its messages are shown in English.
    if not isinstance(content, dict):
        warnings.warn(
            f"{file} must hold a mapping of ids to templates", MessageWarning, stacklevel=2
        )
        return {}
    return {str(name): str(template) for name, template in content.items()}
