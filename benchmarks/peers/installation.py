"""Where the peers are installed, by whom, and what of them is missing here and why.

ns-3's programs are compiled if a compiler and its library are here; IR-SIM and GrADyS-SIM come into an environment of
their own, so that nothing of theirs is ever mixed with ours. All of it is in the folder ``.venv-peers``.
"""

import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

from benchmarks.peers.pairs import COSIM, GRADYS, IRSIM, NS3, Program

HERE = Path(__file__).parent
HOME = HERE.parents[1] / ".venv-peers"
PYTHON = HOME / "bin" / "python"
PACKAGES = {IRSIM: ("ir-sim", "2.12.0"), GRADYS: ("gradysim", "0.8.2")}
"""Name and version of each package."""
NS3_PROGRAMS = ("ns3_waypoints", "ns3_saturation")
NS3_LIBRARIES = tuple(
    f"-lns3-{module}"
    for module in (
        *("core", "wifi", "aodv", "internet", "mobility", "network", "applications", "propagation", "stats"),
        *("bridge", "spectrum", "antenna", "traffic-control", "point-to-point"),
    )
)


class Peer(NamedTuple):
    """A simulator, as it is here."""

    version: str = ""
    missing: str = ""
    """Why it is not here; empty if it is."""


def install() -> dict[str, Peer]:
    """Install what is not here yet, as far as it can be had, and return all peers by name."""
    HOME.mkdir(exist_ok=True)
    _, wrong = ("", "") if PYTHON.exists() else _run(sys.executable, "-m", "venv", HOME)
    packages = {peer: Peer(missing=wrong) if wrong else _package(*wanted) for peer, wanted in PACKAGES.items()}
    return {NS3: _ns3(), **packages}


def command(program: Program, seed: int) -> list[str]:
    """Return the command that runs *program* with *seed*, from the folder above ``benchmarks``."""
    options = [*program.options, f"--seed={seed}"]
    if program.simulator == COSIM:
        return [sys.executable, "-m", f"benchmarks.peers.{program.name}", *options]
    if program.simulator == NS3:
        return [str(HOME / program.name), *options]
    return [str(PYTHON), str(HERE / f"{program.name}.py"), *options]


def _ns3() -> Peer:
    """Compile the programs that are older than their sources."""
    for name in NS3_PROGRAMS:
        source, program = HERE / f"{name}.cc", HOME / name
        if not program.exists() or program.stat().st_mtime < source.stat().st_mtime:
            _, wrong = _run("g++", "-O2", "-std=c++17", source, "-o", program, *NS3_LIBRARIES)
            if wrong:
                return Peer(missing=f"Debian has its library as libns3-dev ({wrong})")
    version, unknown = _run("pkg-config", "--modversion", "ns3-core")
    return Peer("of unknown version" if unknown else version)


def _package(name: str, version: str) -> Peer:
    """Install a package, unless that version of it is there."""
    tell = f"from importlib.metadata import version; print(version({name!r}))"
    if _run(PYTHON, "-c", tell)[0] != version:
        _, wrong = _run(PYTHON, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", f"{name}=={version}")
        if wrong:
            return Peer(missing=f"pip cannot install {name} ({wrong})")
    return Peer(version)


def _run(*line: str | Path) -> tuple[str, str]:
    """Run a command, and return what it said and why it failed, a line each; the second is empty if it did not."""
    try:
        done = subprocess.run(line, capture_output=True, text=True)
    except FileNotFoundError:
        return "", f"there is no {line[0]}"
    if done.returncode == 0:
        return done.stdout.strip(), ""
    said = (done.stderr or done.stdout).strip().splitlines() or [f"exit {done.returncode}"]
    return "", next((each for each in said if "error" in each.lower()), said[-1]).strip()
