"""The step-by-step model of the DCF reaches Bianchi's saturation throughput (IEEE JSAC 18(3), 2000) in his counting."""

import numpy as np
import pytest
from scipy.optimize import brentq

from tests.oracles.dcf import US, Arrival, Options, Timing, run

SHORT = Timing(
    slot=10 * US,
    sifs=3 * US,
    difs=23 * US,
    cca=5 * US,
    preamble=6 * US,
    delta=1 * US,
    cw_min=31,
    cw_max=255,
    data=lambda octets: (6 + octets) * US,
    broadcast=lambda octets: (6 + octets) * US,
    ack=8 * US,
    rts=9 * US,
    cts=8 * US,
    slow_ack=8 * US,
)
PAYLOAD = 60


def bianchi_throughput(n: int, rts: bool) -> float:
    """Return the share of time in which payload is transmitted: Bianchi's tau, p, P_tr, P_s, T_s, T_c and S."""
    w, m = 32, 3

    def tau(p: float) -> float:
        return 2 / (1 + w + p * w * sum((2 * p) ** i for i in range(m)))

    p = brentq(lambda p: p - 1 + (1 - tau(p)) ** (n - 1), 0, 1, xtol=1e-12)
    t = tau(p)
    some, one = 1 - (1 - t) ** n, n * t * (1 - t) ** (n - 1)
    data, sifs, difs, delta, ack = 6 + PAYLOAD, 3, 23, 1, 8
    success, collision = data + sifs + delta + ack + difs + delta, data + difs + delta
    if rts:
        success, collision = success + 9 + sifs + delta + 8 + sifs + delta, 9 + difs + delta
    return one * PAYLOAD / ((1 - some) * 10 + one * success + (some - one) * collision)


@pytest.mark.slow
@pytest.mark.parametrize("rts", [False, True])
@pytest.mark.parametrize("n", [2, 5])
def test_saturated_stations_reach_the_throughput_of_bianchi(n: int, rts: bool):
    end, batches = 150_000, 15
    arrivals = [Arrival(0, a, (a + 1) % n, PAYLOAD) for a in range(n) for _ in range(end // 100)]
    hears = [[a != b for b in range(n)] for a in range(n)]
    options = Options(bianchi_counting=True, rts_threshold=0 if rts else None, short_limit=None, long_limit=None)
    result = run(SHORT, hears, arrivals, options, (2000, n), end * US)
    done = [fate.done_ns for fate in result.fates if fate.done_ns is not None]
    shares = np.histogram(done, batches, (0, end * US))[0] * PAYLOAD / (end / batches)
    error = shares.std(ddof=1) / np.sqrt(batches)
    expected = bianchi_throughput(n, rts)
    assert error < 0.02 * expected
    assert abs(shares.mean() - expected) < 3 * error
