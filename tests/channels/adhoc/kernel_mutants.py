"""Whether the oracle and the tests of the ad hoc radio's laws find errors in its kernels.

    python -m tests.channels.adhoc.kernel_mutants [COUNT [SEED]]

draws so many errors, 60 if not given, and says of each whether a test finds it, and of how many in all. Where one is
missed, a test is missing; but for those which change nothing that can be seen, and stand here with the reason.
"""

import os
import sys
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from tempfile import TemporaryDirectory

from tests.checkout import ROOT
from tests.mutants import Mutant, drawn_mutants, is_found

PACKAGE = "cosim.channels.adhoc"
KERNELS = ("advance", "agenda", "air", "dcf", "errors", "log", "reach", "reception")
ORACLE = "tests/channels/adhoc/test_dcf_equals_oracle.py"
TESTS = (
    *("test_room", "test_channel", "test_forwarding", "test_reception", "test_reach", "test_phy_errors"),
    *("test_jamming_adhoc", "test_adhoc_tables"),
)
FIRST = (*(f"tests/channels/adhoc/{name}.py" for name in TESTS), ORACLE, "-m", "not soak")
"""The tests that most errors fail, those that take least time before the others."""
THEN = (ORACLE, "-m", "soak")
"""What only some more cases of the oracle find."""
FIRST_LIMIT_S, THEN_LIMIT_S = 300.0, 900.0
"""Wall clock after which tests count as stopped for good by an error; without one they take a fifth of it."""
HARMLESS = {
    "if overlap > 1:": "a part of a frame that lasts a nanosecond has next to no bit",
    "after = 1 if common.bianchi_counting else common.difs": "what comes next waits for DIFS anyway",
    "_finish(network, log, address, True, 1, now)": "what comes next waits for DIFS anyway",
    "if last.time < agenda[low].time or (last.time == agenda[low].time and (last.rank <= agenda[low].rank)):": (
        "no two events have one rank"
    ),
    "y = reach * ((eighth + 0.5 - 0.5 * side * node)) / 8.0": "the same places, the sides of a middle in another order",
    "begin, link = frame.begin, frame.source << 17 | address": "other draws, as likely as these: pins differ",
    "return (words[0] << 21 | words[2] >> 11) * 2.0**-53 < elementary.exp(station.log_chance)": "other last bits",
    "return ((words[0] << 21 | words[1] >> 11) * 2.0 ** (-53) <= elementary.exp(station.log_chance))": (
        "once in 2**53 draws"
    ),
}
"""Lines with an error of which no law of the radio says anything, and why."""


def drawn(count: int, seed: int) -> list[Mutant]:
    """Return *count* errors in the kernels as they are now."""
    folder = ROOT.joinpath(*PACKAGE.split("."))
    sources = {name: (folder / f"{name}.py").read_text(encoding="utf-8") for name in KERNELS}
    return drawn_mutants(sources, count, seed)


def judged(mutant: Mutant) -> str:
    """Return whether a test finds *mutant*: ``found``, ``MISSED``, or ``harmless`` if it stands above."""
    if mutant.text in HARMLESS:
        return "harmless"
    with TemporaryDirectory() as folder:
        found = is_found(mutant, PACKAGE, FIRST, Path(folder), FIRST_LIMIT_S) or is_found(
            mutant, PACKAGE, THEN, Path(folder), THEN_LIMIT_S
        )
    return "found" if found else "MISSED"


def main(count: int = 60, seed: int = 1) -> None:
    """Draw errors, and print which are found, as many at a time as there are processors."""
    told: Counter[str] = Counter()
    errors = drawn(count, seed)
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        for mutant, said in zip(errors, pool.map(judged, errors), strict=True):
            told[said] += 1
            reason = f" ({HARMLESS[mutant.text]})" if said == "harmless" else ""
            print(f"{said:8s} {mutant}{reason}", flush=True)
    print(
        f"{told['found']} of {count - told['harmless']} errors found; {told['harmless']} more change nothing to be seen"
    )


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
