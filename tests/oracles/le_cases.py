"""Random cases for the channel ``ble``: settings, and what hosts do when."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from cosim.machine import BROADCAST, Disconnect, Flush, Inquire, LinkCommand, Outgoing, Page, Scan, Sniff
from cosim.units import MS, US, S
from tests.oracles.campaign import Choice, chance, pick

KINDS = ("inquire", "page", "payload", "broadcast", "world")
"""What a script may have in it: each brings its own and all before."""
SCANS = (
    *((0.03, 0.03), (0.0025, 0.0025), (0.06, 0.03), (0.06, 0.01), (0.005, 0.0025)),
    *((0.1, 0.1), (0.01, 0.009375), (0.5, 0.4)),
)
PARTS_MS = 1.25


@dataclass(frozen=True)
class Do:
    """A command of the host at *address*."""

    address: int
    command: LinkCommand


@dataclass(frozen=True)
class Send:
    """A payload of the host at *address*."""

    address: int
    outgoing: Outgoing


@dataclass(frozen=True)
class Power:
    """A device is switched on or off."""

    address: int
    on: bool


@dataclass(frozen=True)
class Move:
    """Someone is in another place from now on."""

    address: int
    x_m: float
    y_m: float


Act = Do | Send | Power | Move


@dataclass(frozen=True)
class Case:
    """A run: its devices, its settings, and what is done when."""

    size: int
    seed: int
    settings: dict[str, Any]
    script: tuple[tuple[int, Act], ...]
    until: int


def draw_case(choice: Choice, kind: str) -> Case:
    """Draw a case with what *kind* and those before it bring."""
    level = KINDS.index(kind)
    size = choice.integer(2, 5)
    length = choice.integer(4, 15) * S
    script = [*draw_script(choice, level, size, length)] + [(0, Move(a, float(a), 0.0)) for a in range(size)]
    ordered = tuple(sorted(script, key=lambda item: item[0]))
    seed, settings = choice.integer(0, 1 << 30), draw_settings(choice, level)
    if "propagation" in settings:  # with the second some packets are broken, with the third most are
        settings["sensitivity_dbm"] = pick(choice, (-99.0, -56.0, -51.0))
    return Case(size, seed, settings, ordered, length + 5 * S)


def draw_settings(choice: Choice, level: int) -> dict[str, Any]:
    """Draw the settings of a channel."""
    settings: dict[str, Any] = {
        "interference": pick(choice, ("none", "band")),
        "clock_ppm": pick(choice, (1, 20, 50, choice.integer(1, 500), 500)),
        "advertise": {"interval_s": pick(choice, (0.02, 0.02, 0.03, 0.1, 0.0225, 0.5))},
        "scan": draw_scan(choice) | pick(choice, ({}, {"active": True})),
        "listen": draw_scan(choice),
        "page_s": pick(choice, (5.12, 0.5, 0.1, choice.integer(20_000_000, 900_000_000) / 1e9)),
    }
    law = {"model": "log_distance", "exponent": 3.0, "shadowing_db": pick(choice, (0.0, 6.0))}
    settings |= pick(choice, ({}, {"range_m": 20.0}, {"range_m": 20.0}, {"propagation": law}))
    if level >= 1:
        settings["connection"] = draw_connection(choice)
    if level >= 3:
        phy = pick(choice, ("1M", "2M", "coded"))
        intervals = (0.02, 0.02, 0.05) if phy != "coded" else (0.06, 0.08)  # an event has to be shorter
        broadcast = {"events": pick(choice, (1, 2, 3, 5)), "interval_s": pick(choice, intervals), "phy": phy}
        settings["broadcast"] = broadcast
    return settings


def draw_scan(choice: Choice) -> dict[str, Any]:
    interval_s, window_s = pick(choice, SCANS)
    return {"interval_s": interval_s, "window_s": window_s}


def draw_connection(choice: Choice) -> dict[str, Any]:
    """Draw the settings of links: intervals in units of 1.25 ms, and parts of at least one."""
    units = pick(choice, (6, 6, 8, 24, 24, choice.integer(6, 40), 80))
    latency = pick(choice, (0, 0, 1, 2, 5))
    least = 2 * (1 + latency) * units * PARTS_MS + 10
    supervision_ms = max(100, 10 * int(least / 10 + 1), pick(choice, (100, 500, 1_000, 1_000)))
    phy = pick(choice, ("1M", "1M", "2M", "coded"))
    most = units if phy != "coded" else 1_250 * units // 5_198  # 27 octets each way are to fit into a part
    return {
        "interval_s": units * PARTS_MS / 1000,
        "latency": latency,
        "supervision_s": supervision_ms / 1000,
        "links": min(most, pick(choice, (1, 2, 3, min(8, most), most))),
        "phy": phy,
        "octets": pick(choice, (27, 251, 251, choice.integer(27, 251))),
    }


def draw_script(choice: Choice, level: int, size: int, length: int) -> list[tuple[int, Act]]:
    """Draw what is done, and when: at odd nanoseconds."""
    makers: list[Callable[[Choice, int, int], Act]] = [draw_inquire]
    makers += [draw_page, draw_page, draw_page, draw_scanning] * (level >= 1)
    makers += [draw_send, draw_send, draw_send, draw_send, draw_close, draw_flush] * (level >= 2)
    makers += [draw_broadcast, draw_broadcast, draw_broadcast] * (level >= 3)
    makers += [draw_power, draw_move, draw_move, draw_sniff, draw_sniff] * (level >= 4)
    script: list[tuple[int, Act]] = []
    for _ in range(choice.integer(3, 10 if level < 2 else 50)):
        time = choice.integer(0, length // MS) * MS + choice.integer(1, 499_999) * 2 + 1
        for _ in range(pick(choice, (1, 1, 1, 2, 5))):
            script.append((time, pick(choice, makers)(choice, size, token := len(script))))
            time += pick(choice, (2, 2, 150 * US, choice.integer(0, 10 * MS) * 2))
            assert token < 1_000
    return script


def one(choice: Choice, size: int) -> int:
    return choice.integer(0, size - 1)


def draw_inquire(choice: Choice, size: int, token: int) -> Act:
    duration = pick(choice, (choice.integer(1, 3_000) * MS + 111, 1_280 * MS + 1, 1))
    return Do(one(choice, size), Inquire(duration, pick(choice, (99, 1, 2, size - 1, 0))))


def draw_page(choice: Choice, size: int, token: int) -> Act:
    return Do(one(choice, size), Page(pick(choice, (*range(size), *range(size), size, -3))))


def draw_scanning(choice: Choice, size: int, token: int) -> Act:
    return Do(one(choice, size), Scan(not chance(choice, 3)))


def draw_send(choice: Choice, size: int, token: int) -> Act:
    length = pick(choice, (0, choice.integer(0, 20), choice.integer(20, 250), choice.integer(0, 600)))
    return Send(one(choice, size), Outgoing(one(choice, size), bytes([token % 256]) * length, token))


def draw_broadcast(choice: Choice, size: int, token: int) -> Act:
    length = pick(choice, (0, choice.integer(0, 20), choice.integer(236, 240), choice.integer(0, 600)))
    return Send(one(choice, size), Outgoing(BROADCAST, bytes([token % 256]) * length, token))


def draw_close(choice: Choice, size: int, token: int) -> Act:
    return Do(one(choice, size), Disconnect(one(choice, size)))


def draw_flush(choice: Choice, size: int, token: int) -> Act:
    return Do(one(choice, size), Flush(one(choice, size)))


def draw_sniff(choice: Choice, size: int, token: int) -> Act:
    slots = pick(choice, (0, 12 * choice.integer(1, 40), choice.integer(0, 500), choice.integer(1000, 7000)))
    return Do(one(choice, size), Sniff(one(choice, size), slots, 0, 2))


def draw_power(choice: Choice, size: int, token: int) -> Act:
    return Power(one(choice, size), not chance(choice, 3))


def draw_move(choice: Choice, size: int, token: int) -> Act:
    return Move(one(choice, size), float(choice.integer(0, 30)), float(choice.integer(0, 5)))
