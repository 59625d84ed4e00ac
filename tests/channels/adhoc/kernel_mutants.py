"""Whether the oracle and the tests of the ad hoc radio's laws find errors in its kernels.

    python -m tests.channels.adhoc.kernel_mutants [COUNT [SEED]]

draws so many errors, 60 if not given, and says of each whether a test finds it, and of how many in all. What is missed
either changes nothing that can be seen, or a test is missing.
"""

import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from tests.checkout import ROOT
from tests.mutants import Mutant, drawn_mutants, is_found

PACKAGE = "cosim.channels.adhoc"
KERNELS = ("advance", "agenda", "air", "dcf", "errors", "reach", "reception")
TESTS = (
    *("test_dcf_equals_oracle", "test_room", "test_phy_errors", "test_channel", "test_reach", "test_reception"),
    "test_jamming_adhoc",
)
FIRST = (*(f"tests/channels/adhoc/{name}.py" for name in TESTS), "-m", "not soak")
THEN = ("tests/channels/adhoc/test_dcf_equals_oracle.py", "-m", "soak")
"""What only some more cases of the oracle find."""
LIMIT_S = 600.0


def drawn(count: int, seed: int) -> list[Mutant]:
    """Return *count* errors in the kernels as they are now."""
    folder = ROOT.joinpath(*PACKAGE.split("."))
    sources = {name: (folder / f"{name}.py").read_text(encoding="utf-8") for name in KERNELS}
    return drawn_mutants(sources, count, seed)


def found(mutant: Mutant, folder: Path) -> bool:
    """Return whether a test finds *mutant*."""
    return any(is_found(mutant, PACKAGE, tests, folder, LIMIT_S) for tests in (FIRST, THEN))


def main(count: int = 60, seed: int = 1) -> None:
    """Draw errors, and print which are found."""
    missed = 0
    with TemporaryDirectory() as folder:
        for mutant in drawn(count, seed):
            right = found(mutant, Path(folder))
            missed += not right
            print("found " if right else "MISSED", mutant, flush=True)
    print(f"{count - missed} of {count} errors found")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
