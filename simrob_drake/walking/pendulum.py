r"""The divergent component of a walk's linear inverted pendulum, in closed form (Englsberger 2015, Khadiv 2020).

With the centre of mass c, :math:`\omega = \sqrt{g/h}` and the zero-moment point p,

.. math:: \xi = c + \dot c / \omega, \qquad \dot\xi = \omega (\xi - p), \qquad \dot c = \omega (\xi - c) .

In a step of time T the zero-moment point goes from :math:`p_0` to :math:`p_1` on a straight line in the time D, and
stays there; then what comes after it decides where :math:`\xi` must be at its start:

.. math:: \xi_0 = w_0 p_0 + w_1 p_1 + e^{-\omega T} \xi_T, \qquad
    w_0 = 1 - \frac{1 - e^{-\omega D}}{\omega D}, \quad w_1 = 1 - e^{-\omega T} - w_0 .
"""

import math
from typing import NamedTuple


class Weights(NamedTuple):
    """What of a step its zero-moment point at its start, that at its end, and the end of the step count for."""

    start: float
    rest: float
    end: float


def weights(omega: float, time: float, transfer: float) -> Weights:
    """Return the weights of a step [1].

    Args:
        omega: of the pendulum [1/s].
        time: T, that the step still takes [s].
        transfer: D, that the zero-moment point still goes [s].
    """
    way = omega * transfer
    start = 1.0 - (1.0 - math.exp(-way)) / way if way > 1e-9 else 0.0
    end = math.exp(-omega * time)
    return Weights(start, 1.0 - end - start, end)
