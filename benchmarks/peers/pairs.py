"""The pairs: what is simulated by us and by others, and which share of their processor time ours is to take at most."""

from typing import NamedTuple

COSIM, NS3, IRSIM, GRADYS = "cosim", "ns-3", "IR-SIM", "GrADyS-SIM"


class Program(NamedTuple):
    """A program and its load, to which the seed is added."""

    simulator: str
    name: str
    options: tuple[str, ...]


class Pair(NamedTuple):
    """A row of the table."""

    name: str
    ours: Program
    theirs: Program | None
    """None where they cannot be had; then there is a bound in seconds."""
    did: str
    """What both programs tell, and what must be much the same in both: its key in their answers."""
    bound: float | None = None
    """The share of their time that ours was meant to take at most."""
    bound_s: float | None = None
    """The seconds that ours was meant to take at most."""
    note: str = ""


def _options(**load: str | float) -> tuple[str, ...]:
    return tuple(f"--{name}={value}" for name, value in load.items())


def _broadcasts(nodes: int, side: float, bound: float, bound_routed: float) -> tuple[Pair, Pair]:
    """Return the pairs in which we route nothing, and in which we too use AODV and send hellos: they do in both."""
    load = _options(nodes=nodes, side=side, seconds=60)
    theirs = Program(NS3, "ns3_waypoints", load)
    did = "received_per_payload"

    def pair(routing: str, title: str, bound: float) -> Pair:
        ours = Program(COSIM, "waypoints", load + _options(routing=routing))
        return Pair(f"{nodes} nodes on {side:g} m, payloads to all, 60 s, {title}", ours, theirs, did, bound)

    return pair("none", "AODV theirs only", bound), pair("aodv", "AODV and hellos in both", bound_routed)


def _saturated(nodes: int, bound: float) -> Pair:
    load = _options(nodes=nodes, seconds=60)
    ours, theirs = Program(COSIM, "saturation", load), Program(NS3, "ns3_saturation", load)
    return Pair(f"{nodes} saturated stations, 60 s", ours, theirs, "throughput_mbps", bound)


def _beams(robots: int, seconds: int) -> Pair:
    load = _options(robots=robots, beams=100, range=3, seconds=seconds)
    ours, theirs = Program(COSIM, "arena", load), Program(IRSIM, "irsim_arena", load)
    return Pair(f"{robots} robots with 100 beams of 3 m, {seconds} s", ours, theirs, "metres_per_robot", 0.01)


def _discs(nodes: int, side: float) -> Pair:
    load = _options(nodes=nodes, side=side, seconds=60)
    ours = Program(COSIM, "waypoints", load + _options(channel="disc", pause=0))
    theirs = Program(GRADYS, "gradysim_waypoints", load)
    return Pair(f"{nodes} nodes on {side:g} m, a disc for a radio, 60 s", ours, theirs, "received_per_payload")


UNICAST = _options(nodes=9, side=150, seconds=600, to="first")
PAIRS = (
    *_broadcasts(500, 1118, 0.1, 0.3),
    *_broadcasts(100, 150, 0.1, 0.3),
    Pair(
        "9 nodes on 150 m, payloads to one over AODV, 600 s",
        Program(COSIM, "waypoints", UNICAST + _options(routing="aodv")),
        Program(NS3, "ns3_waypoints", UNICAST),
        "received_per_payload",
        0.3,
    ),
    _saturated(5, 0.3),
    _saturated(20, 0.12),
    _saturated(50, 0.1),
    Pair(
        "1000 robots with 24 beams of 0.1 m, 60 s",
        Program(COSIM, "arena", _options(robots=1000, beams=24, range=0.1, seconds=60)),
        None,
        "metres_per_robot",
        bound_s=7.0,
        note="ARGoS3, which no package brings here, took 13.7 s for as much elsewhere",
    ),
    _beams(10, 60),
    _beams(100, 10),
    _discs(100, 500),
)
