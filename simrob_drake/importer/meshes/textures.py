"""Textures of meshes: images that are safe to decode, small enough to send to a browser, as PNG."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from PIL.Image import Image

_FORMATS = ("PNG", "JPEG", "BMP", "TGA", "GIF", "TIFF", "WEBP")
"""Formats that need nothing but the decoder; others start programs (EPS) or are never a texture."""
_LARGEST_SIDE = 1024
_MOST_PIXELS = 50_000_000


def usable(image: Any) -> Image | None:
    """Return an image that can be shown, at most 1024 pixels wide and high; None if it is none.

    Args:
        image: as opened by Pillow but not yet decoded; or None.
    """
    from PIL import Image as Pillow

    if image is None or image.format not in _FORMATS or image.width * image.height > _MOST_PIXELS:
        return None
    try:
        decoded = image.convert("RGBA" if "A" in image.getbands() or "transparency" in image.info else "RGB")
    except (OSError, SyntaxError, ValueError, MemoryError):  # what Pillow raises on damaged files
        return None
    decoded.thumbnail((_LARGEST_SIDE, _LARGEST_SIDE))
    return Pillow.frombytes(decoded.mode, decoded.size, decoded.tobytes())  # without the source's notes and profiles


def mean_colour(image: Image) -> tuple[float, float, float, float]:
    """Return the mean colour of an image, opaque."""
    mean = np.asarray(image.convert("RGB"), dtype=float).reshape(-1, 3).mean(axis=0) / 255
    red, green, blue = mean.round(4).tolist()
    return red, green, blue, 1.0


def as_png(image: Image) -> bytes:
    """Return an image as the bytes of a PNG file."""
    buffer = io.BytesIO()
    image.save(buffer, format="PNG", optimize=False)
    return buffer.getvalue()
