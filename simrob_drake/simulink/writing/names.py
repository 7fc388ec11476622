"""Plain names for what blocks become: letters, digits and ``_``, each once."""

import re
import unicodedata


class UniqueNames:
    """Gives names, and never the same twice."""

    def __init__(self, taken: tuple[str, ...] = ()) -> None:
        """Take names that are not to be given."""
        self._taken = set(taken)

    def give(self, path: str) -> str:
        """Return a name for a path: its last part, with the parts before it where that is taken."""
        parts = [plain(part) for part in path.split("/")]
        for count in range(1, len(parts) + 1):
            name = "_".join(parts[-count:])
            if name not in self._taken:
                break
        number, base = 2, name
        while name in self._taken:
            name, number = f"{base}_{number}", number + 1
        self._taken.add(name)
        return name


def plain(text: str) -> str:
    """Return a text as a name."""
    ascii_text = unicodedata.normalize("NFKD", text).encode("ascii", "ignore").decode()
    name = re.sub(r"\W+", "_", ascii_text).strip("_")[:60]
    return name if name and not name[0].isdigit() else f"_{name}" if name else "block"
