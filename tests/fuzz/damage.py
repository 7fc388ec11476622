"""What disks, editors and foes do to files: bytes that are lost or doubled, and values that are out of all measure."""

import json
import random
import re
from collections.abc import Callable
from typing import Any

import yaml

VALUES = (
    *(
        "null",
        "true",
        "''",
        "[]",
        "{}",
        "x",
        "0",
        "-1",
        "1",
        "3",
        "0.5",
        "1e4",
        "1e6",
        "1e-4",
        ".nan",
        ".inf",
        "1e300",
        "1e-300",
        "1e999",
        "99999999999",
    ),
    *(
        "!!bool maybe",
        "!!int x",
        "!!float ''",
        "2001-99-99",
        "!!binary x",
        "!!python/name:os.system",
        "!!set {a, b}",
    ),
    *(
        '"\\ud800"',
        '"\\0"',
        '"a\\0b"',
        "é\u202e",
        "'[bold]x'",
        f"'{'x' * 300}'",
        f"{'y' * 5000}",
        "1e9",
        "1e-9",
    ),
    *(
        "1:2:3",
        "0x1F",
        "1_0",
        "~",
        "irb120",
        "humanoid",
        "none.urdf",
        "a/" * 900,
        "'1e3'",
        "5e-324",
        "1e15",
    ),
    *(
        "[1, 2]",
        "[[[[]]]]",
        "{a: {b: {c: 1}}}",
        "{kind: x}",
        "{kind: sine}",
        "[1e300, -1e300, .nan]",
        "*nowhere",
    ),
    *(
        "/dev/zero",
        "/proc/kmsg",
        "/proc/self/mem",
        "/etc/passwd",
        "pipe",
        "circle",
        ".",
        "..",
        "/",
        "../x",
    ),
    *("&a [*a]", "[" * 300, f"[{'7, ' * 5000}]", f"{'9' * 5000}", "&b [1, 1]"),
)
"""Texts of YAML that are rarely right, whatever the key."""
JSON_VALUES = (
    *(
        "null",
        "true",
        '""',
        "[]",
        "{}",
        "0",
        "-1",
        "1",
        "NaN",
        "-Infinity",
        "1e300",
        "5e-324",
        "1e999",
        "99999999999",
    ),
    *(
        '"x"',
        '"\\ud800"',
        '"\\u0000"',
        f'"{"y" * 5000}"',
        "[[]]",
        "[null]",
        '{"a": 1}',
        f"[{'7,' * 5000}7]",
        "9" * 5000,
    ),
)
"""Likewise of JSON, nearly."""
_FIGURE = re.compile(rb"(?<![\w.#-])-?\d+\.?\d*(?![\w.])")
_ODD = (
    b"nan",
    b"-1",
    b"1e999",
    b"99999999999999",
    b"",
    b"\0",
    b"1e-320",
    b"\xed\xa0\x80",
    b"9" * 5000,
    b"null",
)


def damaged(data: bytes, chance: random.Random) -> bytes:
    """Return the bytes with one kind of damage, as disks, editors and foes do it; mostly a slight one."""
    data = data or b"\0"
    figures = list(_FIGURE.finditer(data[:1_000_000]))
    if figures and chance.random() < 0.7:
        figure = chance.choice(figures)
        value = float(figure[0]) * chance.choice([-1, 0.1, 0.5, 0.99, 1.01, 2, 10])
        other = f"{value if b'.' in figure[0] else round(value):g}".encode()
        return data[: figure.start()] + other + data[figure.end() :]
    place, length = chance.randrange(len(data)), chance.choice([1, 2, 4, 30, 300])
    before, within, after = data[:place], data[place : place + length], data[place + length :]
    words = re.split(rb"([\s,\"<>=]+)", data)
    words[2 * chance.randrange((len(words) + 1) // 2)] = chance.choice(_ODD)
    letter, other = data[place : place + 1], chance.choice([b"", b"9", b"}", b"-", b";"])
    choices = [
        before,
        before + after,
        before + chance.randbytes(length) + after,
        before + within * chance.choice([2, 50, 5000]) + after,
        *[b"".join(words)] * 4,
        data.replace(letter, other, chance.choice([1, 5, 1000])),
        data.decode("latin-1").encode("utf-16"),
        data[:1] * chance.choice([0, 1, 100_000]),
        data + b" " * 11_000_000,
    ]
    return chance.choice(choices)


def places(content: object, above: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Return the paths of all values in mappings and lists."""
    entries = (
        content.items()
        if isinstance(content, dict)
        else enumerate(content)
        if isinstance(content, list)
        else ()
    )
    return [
        found for key, value in entries for found in ((*above, key), *places(value, (*above, key)))
    ]


def _with_values(
    content: Any, hostile: list[str], under: str, others: list[tuple[Any, ...]], chance: Any
) -> Any:
    """Return content with marks for hostile values in place of some of its own, or under keys of others."""
    for number in range(len(hostile)):
        known = [path for path in places(content) if path[0] == under or not under]
        path = chance.choice([*known, *known, *others])
        node = content
        for part in path[:-1]:
            child = node[part] if isinstance(node, list) else node.get(part)
            if not isinstance(child, dict | list):
                node[part] = child = {}
            node = child
        if isinstance(node, dict) or (isinstance(path[-1], int) and path[-1] < len(node)):
            node[path[-1]] = f"@{number}@"
    return content


def _marked(text: str, hostile: list[str]) -> bytes:
    for number, value in enumerate(hostile):
        text = re.sub(rf"['\"]?@{number}@['\"]?", lambda _, value=value: value, text)  # type: ignore[misc]
    return text.encode("utf-8", "surrogatepass")


def yaml_damage(
    data: bytes, chance: random.Random, under: str = "", others: list[tuple[Any, ...]] | None = None
) -> bytes:
    """Return a YAML text with hostile values in it, damaged as any file, or one that means more than it says.

    Args:
        data: the text.
        chance: what decides.
        under: the section whose values are changed; all unless given.
        others: paths of keys that other files have.
    """
    if chance.random() < 0.4:
        return damaged(data, chance)
    if chance.random() < 0.05:
        return multiplied(chance)
    hostile = chance.choices(VALUES, k=chance.choice([1, 1, 2]))
    content = _with_values(yaml.safe_load(data), hostile, under, others or [], chance)
    return _marked(yaml.safe_dump(content, sort_keys=False), hostile)


def json_damage(data: bytes, chance: random.Random) -> bytes:
    """Return a JSON text with hostile values in it, or damaged as any file."""
    if chance.random() < 0.4:
        return damaged(data, chance)
    hostile = chance.choices(JSON_VALUES, k=chance.choice([1, 1, 2]))
    return _marked(json.dumps(_with_values(json.loads(data), hostile, "", [], chance)), hostile)


def lines_damage(data: bytes, chance: random.Random) -> bytes:
    """Return lines of JSON of which one is damaged, lost, doubled or torn."""
    lines = data.splitlines(keepends=True)
    place = chance.randrange(len(lines))
    line = lines[place]
    torn = line[: chance.randrange(len(line))]
    lines[place : place + 1] = chance.choice(
        [
            *[[json_damage(line, chance) + b"\n"]] * 6,
            [],
            [line, line],
            [torn],
            [torn + b"\n"],
            [b"null\n"],
            [b"[]\n", line],
        ]
    )
    return b"".join(lines)


def csv_damage(data: bytes, chance: random.Random) -> bytes:
    """Return a table that is damaged, or out of all measure."""
    head, _, rest = data.partition(b"\n")
    return chance.choice(
        [
            *[damaged(data, chance)] * 6,
            damaged(damaged(data, chance), chance),
            data.replace(b",", chance.choice([b";", b"\t", b" "])),
            head.replace(head.split(b",")[-1], head.split(b",")[0]) + b"\n" + rest,
            data * chance.choice([2, 3000]),
            head
            + b"\n"
            + b"".join(b"%d,0,0\n" % step for step in range(chance.choice([10**5, 10**6]))),
            b"," * 3_000_000,
            b'"' + data * 1000,
            chance.choice([b"", b"\n", head, head + b"\n", b"\xef\xbb\xbf"]),
        ]
    )


def xml_damage(data: bytes, chance: random.Random) -> bytes:
    """Return XML that is damaged, or out of all measure."""
    name, last = data.rpartition(b"</")[::2]
    choices = [
        data + b"<!--" * 1_000_000,
        name + b"<a/>" * 1_000_000 + b"</" + last,
        b"<robot>" + b"<link>" * 100_000,
    ]
    return chance.choice([*[damaged(data, chance)] * 8, *choices])


def multiplied(chance: random.Random) -> bytes:
    """Return a text of YAML that means far more than it says."""
    key, times = chance.choice(["moves", "description", "robot", "duration"]), chance.choice([2, 9])
    way = chance.choice(["[{}]", "{{<<: [{}]}}"])
    first = "&a0 {x: 1}" if "<<" in way else f"&a0 [{'x, ' * 9}]"
    steps = (
        f"a{n}: &a{n} {way.format(', '.join([f'*a{n - 1}'] * times))}"
        for n in range(1, chance.choice([5, 30]))
    )
    last = chance.choice(
        ["*a4", "'" + "x" * 900_000 + "'", "- " * 20_000 + "1", "1:" * 300_000 + "1", "[" * 100_000]
    )
    return "\n".join([f"a0: {first}", *steps, f"{key}: {last}"]).encode()


BY_SUFFIX: dict[str, Callable[[bytes, random.Random], bytes]] = {
    ".yaml": yaml_damage,
    ".json": json_damage,
    ".jsonl": lines_damage,
    ".csv": csv_damage,
    ".urdf": xml_damage,
    ".xacro": xml_damage,
}
"""How files are damaged, by their suffix; all others by :func:`damaged`."""
