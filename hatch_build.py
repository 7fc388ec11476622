"""What the wheel says of itself: README.md as its description, whose links lead somewhere on a package's page, too."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Any

from hatchling.metadata.plugin.interface import MetadataHookInterface

PLACE = "SIMROB_URL"
"""Variable with the address of the files of a release; unless it is set, no address is made up."""
_LINK = re.compile(r"(!?)\[([^\]]*)\]\((?!https?:|#)([^)\s]+)\)")


def described(text: str, place: str) -> str:
    """Return a page whose relative links lead to an address; without one, pictures go and links become text."""

    def link(found: re.Match[str]) -> str:
        mark, shown, target = found.groups()
        return f"{mark}[{shown}]({place.rstrip('/')}/{target})" if place else "" if mark else shown

    return _LINK.sub(link, text)


class Description(MetadataHookInterface):
    """Gives the wheel its description, and its address where it has one."""

    def update(self, metadata: dict[str, Any]) -> None:
        """Add to the metadata."""
        place = os.environ.get(PLACE, "")
        text = described(Path(self.root, "README.md").read_text(encoding="utf-8"), place)
        metadata["readme"] = {"content-type": "text/markdown", "text": text}
        if place:
            metadata["urls"] = {"Source": place}
