"""Problems that pydantic finds in values: each type has a message of ours, in both languages."""

from typing import Annotated, Any, Literal

import pytest
from pydantic import BeforeValidator, Field, TypeAdapter, ValidationError
from pydantic_core import PydanticCustomError

from simrob_drake.base.errors import InvalidConfig
from simrob_drake.base.messages import Message, in_language, message
from simrob_drake.base.sections import validate_section
from simrob_drake.base.value_problems import value_problem
from simrob_drake.stations.load import load_station
from simrob_drake.stations.solver_config import ContinuousSolver

Finite = Annotated[float, Field(allow_inf_nan=False)]
TwoOrMore = Annotated[list[int], Field(min_length=2)]
ShortText = Annotated[str, Field(max_length=2)]

CASES: list[tuple[Any, Any, str, str]] = [
    (Annotated[float, Field(gt=0)], -1.5, "must be greater than 0", "debe ser mayor que 0"),
    (Annotated[float, Field(ge=0.5)], 0, "must be at least 0.5", "debe ser 0,5 como mínimo"),
    (Annotated[float, Field(lt=2)], 2, "must be less than 2", "debe ser menor que 2"),
    (Annotated[float, Field(le=1e4)], 1e6, "must be at most 10000", "debe ser 10000 como máximo"),
    (
        Annotated[int, Field(multiple_of=5)],
        7,
        "must be a multiple of 5",
        "debe ser un múltiplo de 5",
    ),
    (
        Annotated[float, Field(allow_inf_nan=False)],
        float("nan"),
        "must be a finite number",
        "debe ser un número finito",
    ),
    (float, "x", "must be a number", "debe ser un número"),
    (Annotated[float, Field(strict=True)], "1", "must be a number", "debe ser un número"),
    (int, 1.5, "must be an integer", "debe ser un número entero"),
    (Annotated[bool, Field(strict=True)], 1, "must be true or false", "debe ser true o false"),
    (str, 3, "must be a text", "debe ser un texto"),
    (tuple[float, float], 3, "must be a list", "debe ser una lista"),
    (list[int], "a", "must be a list", "debe ser una lista"),
    (
        Annotated[list[int], Field(min_length=2)],
        [1],
        "needs at least 2 values, not 1",
        "necesita al menos 2 valores, no 1",
    ),
    (
        Annotated[list[int], Field(max_length=1)],
        [1, 2],
        "takes at most 1 value",
        "admite como mucho 1 valor",
    ),
    (
        Annotated[str, Field(min_length=1)],
        "",
        "must have at least 1 character",
        "debe tener al menos 1 carácter",
    ),
    (
        Annotated[str, Field(max_length=2)],
        "abc",
        "must have at most 2 characters",
        "debe tener como mucho 2 caracteres",
    ),
    (
        Annotated[str, Field(pattern="^a")],
        "b",
        "must match the pattern ^a",
        "debe seguir el patrón ^a",
    ),
    (Literal["a", "b"], "c", "must be one of 'a', 'b'", "debe ser uno de 'a', 'b'"),
    (None, 3, "must be null", "debe ser null"),
    (
        dict[str, int],
        3,
        "must be a mapping of keys to values",
        "debe ser un conjunto de claves con sus valores",
    ),
]


def first_finding(kind: Any, value: Any) -> Any:
    """First problem that pydantic finds in a value of a type."""
    with pytest.raises(ValidationError) as raised:
        TypeAdapter(kind).validate_python(value)
    return raised.value.errors()[0]


@pytest.mark.parametrize(("kind", "value", "english", "spanish"), CASES)
def test_a_problem_has_a_message_by_its_type(
    kind: Any, value: Any, english: str, spanish: str
) -> None:
    problem = value_problem(first_finding(kind, value))
    assert problem == english
    assert in_language(problem, "es") == spanish


def test_the_text_of_pydantic_plays_no_part() -> None:
    finding = {**first_finding(float, "x"), "msg": "anything"}
    assert value_problem(finding) == "must be a number"


def test_an_unknown_type_keeps_the_words_of_pydantic() -> None:
    def refuse(value: object) -> None:
        raise PydanticCustomError("odd", "Strange value")

    problem = value_problem(first_finding(Annotated[float, BeforeValidator(refuse)], 1))
    assert problem == "strange value"
    assert not isinstance(problem, Message)


def test_a_message_of_a_validator_goes_first() -> None:
    def refuse(value: object) -> None:
        raise ValueError(message("base.too_long", "too long"))

    problem = value_problem(first_finding(Annotated[float, BeforeValidator(refuse)], 1))
    assert in_language(problem, "es") == "demasiado largo"


def test_a_section_and_a_station_have_them() -> None:
    with pytest.raises(InvalidConfig) as raised:
        validate_section(ContinuousSolver, {"kind": "continuous", "accuracy": "high"}, "a.yaml")
    assert (
        in_language(raised.value.message, "es")
        == "a.yaml: accuracy: debe ser un número (es 'high')"
    )
    with pytest.raises(InvalidConfig) as raised:
        load_station("double_pendulum", {"duration": -1})
    assert in_language(raised.value.message, "es").endswith(
        "duration: debe ser mayor que 0 (es -1)"
    )
