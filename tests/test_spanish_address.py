"""Spanish texts address the reader as usted: messages, the pendant's page, pages of the docs, and the course."""

import re
from pathlib import Path

import pytest
import yaml

from simrob_drake.base.messages import catalogue
from tests.test_message_catalogues import PACKAGE, templates

ROOT = Path(__file__).parent.parent

PRONOUNS_AND_VERBS = (
    r"tú|tu|tus|ti|contigo|tuy[oa]s?|te fías|puedes|quieres|tienes|necesitas|debes|haces|sabes|eres|estás|verás|"
    r"podrás|tendrás|prefieres|conoces|querías|harías|pon|haz|ten|mantén"
)
WITH_PRONOUN = (
    r"(?:quíta|ajústa|pon|haz|déja|míra|úsa|ábre|escríbe|cópia|cámbia|créa|añáde|estíma|nómbra|conviérte|sustitúye|permíte|"
    r"expórta|expánde|da|pruéba|ejecúta|instála|descárga|bórra|búsca|simúla|divíde|redúce|úne|bája|súbe|guárda)"
    r"(?:lo|la|los|las|le|les)"
)
OF_TU = re.compile(rf"\b(?:{PRONOUNS_AND_VERBS}|{WITH_PRONOUN})\b", re.IGNORECASE)
"""Forms that only a text with tú has. Imperatives such as "usa" are also what he, she or it does."""

IMPERATIVES = (
    "activa|alivia|añade|baja|borra|busca|cambia|comprueba|conecta|convierte|copia|corrige|crea|da|deja|di|divide|"
    "ejecuta|elige|empieza|escribe|espera|exporta|guarda|importa|instala|interrumpe|lee|lleva|llama|mira|mueve|nombra|"
    "pide|prueba|pulsa|quita|repite|sal|sigue|simula|sube|termina|toma|une|usa|ve"
)
ENGLISH_IMPERATIVES = (
    "turn|lighten|add|lower|delete|try|change|check|connect|convert|copy|make|give|let|say|split|run|choose|begin|"
    "start|write|wait|export|keep|import|install|interrupt|read|carry|call|see|move|name|ask|press|leave|remove|repeat|"
    "go|raise|end|take|join|use|set|put|list|open|pick|reduce|replace|allow|download|estimate|bring|rename"
)
DESCRIPTIVE = {"stations.load_over_rating"}
"""Messages that begin with what something does, and give an order after that."""

CLAUSE = r"(?:^|[;:.] |, or |, |\b(?:o|y|or|and) )"


def prose(page: Path) -> str:
    """Text of a page without code."""
    text = re.sub(
        r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE
    )
    return re.sub(r"`[^`]*`", "", text)


def spanish_values(content: object, is_spanish: bool = False) -> list[str]:
    """Texts below a key ``es`` in the content of a YAML file, or all of them if the file is Spanish."""
    if isinstance(content, dict):
        return [
            text
            for key, value in content.items()
            for text in spanish_values(value, is_spanish or key == "es")
        ]
    if isinstance(content, list):
        return [text for value in content for text in spanish_values(value, is_spanish)]
    return [str(content)] if is_spanish else []


def yaml_texts(file: Path, *, is_spanish: bool) -> str:
    """Spanish texts of a YAML file, one a line."""
    return "\n".join(spanish_values(yaml.safe_load(file.read_text(encoding="utf-8")), is_spanish))


def spanish_texts() -> dict[str, str]:
    """All Spanish texts of the repository, by file."""
    found = {}
    for page in [ROOT / "README.es.md", *(ROOT / "docs" / "es").rglob("*.md")]:
        found[page.relative_to(ROOT).as_posix()] = prose(page)
    for template in (ROOT / "course").glob("*/template_es.py"):
        found[template.relative_to(ROOT).as_posix()] = template.read_text(encoding="utf-8")
    catalogues = [
        *PACKAGE.glob("base/languages/es/*.yaml"),
        *PACKAGE.glob("extensions/*/languages/es.yaml"),
    ]
    page_texts = [*PACKAGE.glob("extensions/pendant/pages/strings/es.yaml")]
    for file in [*catalogues, *page_texts]:
        found[file.relative_to(ROOT).as_posix()] = yaml_texts(file, is_spanish=True)
    both = [*(ROOT / "course").glob("*/*.yaml"), *PACKAGE.glob("extensions/pendant/lessons/*.yaml")]
    for file in [*both, *PACKAGE.glob("extensions/course/*.yaml")]:
        found[file.relative_to(ROOT).as_posix()] = yaml_texts(file, is_spanish=False)
    return {file: text for file, text in found.items() if text}


TEXTS = spanish_texts()


def test_all_sorts_of_texts_are_found():
    for part in (
        "README.es.md",
        "docs/es/curso/",
        "/strings/es.yaml",
        "/lessons/",
        "exercise.yaml",
        "template_es.py",
    ):
        assert any(part in file for file in TEXTS), part
    assert sum(map(len, TEXTS.values())) > 500_000


@pytest.mark.parametrize("file", TEXTS)
def test_no_text_says_tu(file):
    assert OF_TU.findall(re.sub(r"\{[^}]*\}", "", TEXTS[file])) == []


@pytest.mark.parametrize(
    "text", ["pon servo.kp a 300", "quítalo", "tu estación", "¿querías decir kp?", "Puedes girarlo"]
)
def test_a_form_of_tu_is_found(text):
    assert OF_TU.search(text)


@pytest.mark.parametrize(
    "text", ["ponga servo.kp a 300", "quítelo", "su estación", "¿quería decir kp?", "se usa kp"]
)
def test_a_form_of_usted_is_left_alone(text):
    assert OF_TU.search(text) is None


def test_no_message_gives_an_order_to_tu():
    """Where the English sentence gives an order, no clause of the Spanish one begins with an imperative of tú."""
    english_order = re.compile(rf"{CLAUSE}(?:{ENGLISH_IMPERATIVES})\b", re.IGNORECASE)
    order_to_tu = re.compile(rf"{CLAUSE}(?:{IMPERATIVES})\b(?![/.=_])", re.IGNORECASE)
    found = {}

    for message_id, own in templates().items():
        (english,) = own
        spanish = catalogue(message_id.partition(".")[0], "es").get(message_id, "")
        is_help = re.search(r"\.(command|help|import)_", message_id)
        if not is_help and message_id not in DESCRIPTIVE and english_order.search(english):
            orders = order_to_tu.findall(spanish)
            if orders:
                found[message_id] = spanish

    assert found == {}
