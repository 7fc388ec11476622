r"""A linear model with names: x' = A x + B u, y = C x + D u, all of them differences from where it was made."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
import yaml
from pydrake.systems.primitives import LinearSystem

from simrob_drake.base.errors import InvalidParameter, one_of, quote_value
from simrob_drake.base.folders import filled_at_once
from simrob_drake.base.frames import Vector, finite
from simrob_drake.base.messages import message
from simrob_drake.results.colours import looks

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MODEL_FILE = "linear.yaml"
_MATRICES, _POINT, _NAMES = (
    ("A", "B", "C", "D"),
    ("x0", "u0", "y0"),
    ("states", "inputs", "outputs"),
)
_POINTS = 600
_BEYOND = 10.0  # how many times slower and faster than the slowest and the fastest motion the frequencies go


@dataclass(frozen=True)
class Mode:
    """A motion of its own, exp(s t): one pole, or two that are conjugate."""

    pole: complex  # s, with the positive imaginary part [1/s]
    mostly: str  # the axis, or other state, that has the largest part in it

    @property
    def frequency(self) -> float:
        """At which it swings [Hz]; 0 if it does not."""
        return abs(self.pole.imag) / (2 * np.pi)

    @property
    def damping(self) -> float:
        """Damping ratio: 1 and more do not swing, below 0 it grows; a pole at zero counts as 0."""
        return -self.pole.real / abs(self.pole) if self.pole else 0.0

    @property
    def time_constant(self) -> float:
        """In which it fades to a third, 1/e [s]; negative if it grows, infinite if it stays."""
        return -1.0 / self.pole.real if self.pole.real else np.inf


@dataclass(frozen=True, eq=False)
class LinearModel:
    """A station near a rest, as a linear system with named states and ports.

    Attributes:
        name: of the station.
        A, B, C, D: its matrices, of shapes (n, n), (n, m), (p, n), (p, m).
        states, inputs, outputs: the names: ``q.<axis>`` [rad or m], ``reference.<axis>``, ``tcp.x`` and so on.
        x0, u0, y0: where it was made, shapes (n,), (m,), (p,); the tool's turns ``tcp.rx`` ... count from there.
        notes: what of the station is no part of it, in words.
    """

    name: str
    A: Vector
    B: Vector
    C: Vector
    D: Vector
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    x0: Vector
    u0: Vector
    y0: Vector
    notes: tuple[str, ...] = ()

    def __repr__(self) -> str:
        sizes = f"{len(self.states)} states, {len(self.inputs)} inputs, {len(self.outputs)} outputs"
        return f"<{type(self).__name__} of {self.name}: {sizes}, {'' if self.is_stable else 'not '}stable>"

    @property
    def poles(self) -> npt.NDArray[np.complex128]:
        """The eigenvalues of A [1/s], the slowest first."""
        poles = np.linalg.eigvals(self.A).astype(complex)
        return poles[np.lexsort((poles.imag, np.abs(poles).round(9)))]

    @property
    def is_stable(self) -> bool:
        """Whether all motions fade."""
        return bool((self.poles.real < 0).all())

    @property
    def modes(self) -> list[Mode]:
        """The motions of its own, the slowest first; a state's part is that in both eigenvectors of the pole."""
        poles, right = np.linalg.eig(self.A)
        parts = np.abs(np.linalg.pinv(right).T * right)
        owners = [re.sub(r"(^|\.)[qv]\.", r"\1", state) for state in self.states]  # an axis has two
        names = list(dict.fromkeys(owners))
        shares = np.array(
            [parts[[owner == name for owner in owners]].sum(axis=0) for name in names]
        )
        mostly = [names[row] for row in shares.argmax(axis=0)]
        modes = [
            Mode(complex(pole), name)
            for pole, name in zip(poles, mostly, strict=True)
            if pole.imag >= 0
        ]
        return sorted(modes, key=lambda mode: abs(mode.pole))

    def response(self, frequencies: npt.ArrayLike) -> npt.NDArray[np.complex128]:
        """Return C (jw - A)^-1 B + D at frequencies (k,) [Hz]: shape (k, p, m), complex."""
        found = np.atleast_1d(finite(frequencies))
        if not found.size or found.ndim != 1:
            raise InvalidParameter(
                "frequencies",
                quote_value(frequencies),
                message("linear.finite_frequencies", "finite numbers [Hz]"),
            )
        resolvents = 2j * np.pi * found[:, np.newaxis, np.newaxis] * np.eye(len(self.A)) - self.A
        return np.asarray(self.C @ np.linalg.solve(resolvents, self.B.astype(complex)) + self.D)

    def part(
        self, *, inputs: Sequence[str] | None = None, outputs: Sequence[str] | None = None
    ) -> "LinearModel":
        """Return the model between some of its ports.

        Args:
            inputs: their names, or the beginnings of several before a dot, as ``reference``; all unless given.
            outputs: likewise.

        Raises:
            UnknownName: no such input or output.
        """
        columns, rows = (
            _places("input", inputs, self.inputs),
            _places("output", outputs, self.outputs),
        )
        return replace(
            self,
            B=self.B[:, columns],
            C=self.C[rows],
            D=self.D[np.ix_(rows, columns)],
            inputs=tuple(self.inputs[column] for column in columns),
            outputs=tuple(self.outputs[row] for row in rows),
            u0=self.u0[columns],
            y0=self.y0[rows],
        )

    def system(self) -> LinearSystem:
        """Return it as a block of Drake."""
        return LinearSystem(self.A, self.B, self.C, self.D)

    def save(self, folder: Path | str, *, force: bool = False) -> Path:
        """Write ``linear.npz`` (matrices and names), ``linear.yaml`` (names, poles, notes) and ``bode.png``.

        Raises:
            OutputError: the folder cannot be written, or exists.
        """
        target = Path(folder)
        with filled_at_once(target, marker=MODEL_FILE, force=force) as work:
            (work / MODEL_FILE).write_text(
                yaml.safe_dump(self._content(), sort_keys=False, allow_unicode=True)
            )
            np.savez(
                work / "linear.npz",
                **{key: getattr(self, key) for key in (*_MATRICES, *_POINT, *_NAMES)},
            )
            bode_figure(self).savefig(work / "bode.png", dpi=110)
        return target

    def _content(self) -> dict[str, object]:
        modes = [
            {
                "pole": [mode.pole.real, mode.pole.imag],
                "frequency": mode.frequency,
                "damping": mode.damping,
                "mostly": mode.mostly,
            }
            for mode in self.modes
        ]
        names = {key: list(getattr(self, key)) for key in _NAMES}
        at = {key: getattr(self, key).tolist() for key in _POINT}
        return {"station": self.name, "notes": list(self.notes), "modes": modes, **names, **at}


def _places(kind: str, names: Sequence[str] | None, known: tuple[str, ...]) -> list[int]:
    if names is None:
        return list(range(len(known)))
    places = []
    for name in names:
        found = [
            place
            for place, other in enumerate(known)
            if other == name or other.rpartition(".")[0] == name
        ]
        if not found:
            one_of(
                kind, name, [*dict.fromkeys(other.rpartition(".")[0] for other in known), *known]
            )
        places += found
    return places


def bode_figure(model: LinearModel, pairs: Sequence[tuple[str, str]] | None = None) -> "Figure":
    """Draw magnitude [dB] and phase [deg] over frequency [Hz] of pairs of an input and an output of a model.

    Every axis from its reference to its position unless given. Raises UnknownName: no such input or output.
    """
    from matplotlib.figure import Figure  # it is loaded where it is needed

    from simrob_drake.results.plots.grid import style

    own = [
        (name, name.replace("reference.", "q.")) for name in model.inputs if "reference." in name
    ]
    chosen = own if pairs is None else list(pairs)
    sizes = np.abs(model.poles[model.poles != 0]) / (2 * np.pi)
    slowest, fastest = (sizes.min(), sizes.max()) if sizes.size else (1.0, 1.0)
    frequencies = np.geomspace(slowest / _BEYOND, fastest * _BEYOND, _POINTS)
    figure = Figure(figsize=(9, 6.5), layout="constrained")
    magnitude, phase = figure.subplots(2, 1, sharex=True)
    style(magnitude, f"{model.name}: Bode plot")
    style(phase, "")
    for (source, sink), (colour, line) in zip(chosen, looks(len(chosen)), strict=True):
        response = model.part(inputs=[source], outputs=[sink]).response(frequencies)[:, 0, 0]
        size = 20 * np.log10(np.maximum(np.abs(response), 1e-30))
        magnitude.semilogx(frequencies, size, line, color=colour, label=f"{source} → {sink}")
        phase.semilogx(frequencies, np.rad2deg(np.unwrap(np.angle(response))), line, color=colour)
    magnitude.set_ylabel("magnitude [dB]")
    phase.set_ylabel("phase [deg]")
    phase.set_xlabel("frequency [Hz]")
    figure.legend(loc="outside right upper", fontsize=8, frameon=False)
    return figure
