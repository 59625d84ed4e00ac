"""Captures read back: by tshark, field by field, and by hand, block by block."""

import os
import re
import shutil
import struct
import subprocess
from collections.abc import Sequence
from pathlib import Path

import pytest

TYPES = {"NULL": 0, "POLL": 1, "FHS": 2, "DM1": 3, "DH1": 4, "DM3": 10, "DH3": 11, "DM5": 14, "DH5": 15}
"""Bluetooth's packet types, as headers have them (Core 5.4, Vol 2 Part B, table 6.2)."""
SUBTYPES = {"0x0020": "DATA", "0x001d": "ACK", "0x001b": "RTS", "0x001c": "CTS"}
"""Frames of 802.11, by what tshark calls type and subtype."""


def find_tshark() -> str:
    """Return the program; skip the test, or in CI fail it, if there is none."""
    found = shutil.which("tshark")
    if found is None:
        if os.environ.get("CI"):
            pytest.fail("CI has no tshark")
        pytest.skip("there is no tshark here (Debian: apt-get install tshark)")
    return found


def read_fields(program: str, path: Path, names: Sequence[str], *options: str) -> list[list[str]]:
    """Return for every packet what tshark prints for *names*; a field that occurs twice has commas."""
    command = [program, "-n", *options, "-r", str(path), "-T", "fields", "-E", "separator=|"]
    command += [f"-e{name}" for name in names]
    done = subprocess.run(command, capture_output=True, text=True, check=True, env=os.environ | {"LC_ALL": "C"})
    return [line.split("|") for line in done.stdout.splitlines()]


def experts(program: str, path: Path) -> list[str]:
    """Return what tshark's expert has to say of a file: lines of severity with number, or of number and remark."""
    done = subprocess.run([program, "-r", str(path), "-q", "-z", "expert"], capture_output=True, text=True, check=True)
    return [" ".join(line.split()) for line in done.stdout.splitlines() if re.search(r"\d", line)]


def blocks(path: Path) -> list[tuple[int, bytes]]:
    """Return types and bodies of the blocks of a pcapng file."""
    data, found = path.read_bytes(), []
    while data:
        kind, length = struct.unpack_from("<II", data)
        assert length % 4 == 0
        assert struct.unpack_from("<I", data, length - 4) == (length,)
        found.append((kind, data[8 : length - 4]))
        data = data[length:]
    return found
