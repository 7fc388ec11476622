"""Variables of `.mat` files."""

import io
from pathlib import Path
from typing import Any

import numpy as np

from simrob_drake.errors import InvalidParameter
from simrob_drake.files import content_of
from simrob_drake.simulink.values.functions import matrix
from simrob_drake.simulink.values.mat_bounds import LARGEST, check_bounds
from simrob_drake.simulink.values.syntax import NotUnderstood


def variables_of_mat(file: Path, option: str = "--variables") -> dict[str, Any]:
    """Return the variables of a file, by name.

    Raises:
        InvalidParameter: it cannot be read; the message names the option that asked for it.
    """
    from scipy.io import loadmat

    try:
        data = content_of(file, LARGEST)
        check_bounds(data)
        source: Any = io.BytesIO(data)  # which older stubs of scipy do not know of
        content = loadmat(source, squeeze_me=False, struct_as_record=True)
    except Exception as problem:  # readers of damaged files raise whatever they like
        reason = (
            "saved with -v7: version 7.3 is not read"
            if isinstance(problem, NotImplementedError)
            else f"readable: {problem}"
        )
        raise InvalidParameter(option, str(file), reason) from problem
    return {
        name: value for name, raw in content.items() if not name.startswith("__") and (value := _plain(raw)) is not None
    }


def _plain(raw: Any) -> Any:
    """Return a variable of a .mat file as a matrix, text or structure; None for objects."""
    if isinstance(raw, np.ndarray) and raw.dtype.names:
        first = raw.reshape(-1)[0] if raw.size else None
        return {} if first is None else {name: _plain(first[name]) for name in raw.dtype.names}
    if isinstance(raw, np.ndarray) and raw.dtype.kind in "US":
        return "".join(str(part) for part in raw.reshape(-1))
    try:
        return matrix(raw)
    except (NotUnderstood, TypeError, ValueError):
        return None
