"""A trace for tests of the timeline, made row by row, so that a test knows each of its boxes."""

from pathlib import Path
from typing import Final, NamedTuple

from cosim.intervals import HOST
from cosim.trace import FRAMES, INTERVALS, MESSAGES, POSES, RECEPTIONS, TRANSMISSIONS, Trace
from cosim.units import MS, SLOT, US, S, Time

END: Final[Time] = 20 * S
PHASE: Final[Time] = 123_457
"""From where the master counts its slots."""
LOST: Final[Time] = PHASE + 19_752 * SLOT
"""Start of the first lost frame."""
SENTENCE: Final = f"DM1, robot 0 to 2, {LOST / S:.6f} s, channel 41, lost: payload"
"""What the page is to say of it."""
PAYLOAD: Final = "68656c6c6f20726f626f74"
"""hello robot, hexadecimal"""


class Frame(NamedTuple):
    """A frame of the trace."""

    start: Time
    source: int
    destination: int
    kind: str
    duration: Time
    channel: int
    outcome: str = "received"
    part: str = ""
    body: str = ""


def frames() -> list[Frame]:
    """Return all frames: robot 0 polls 1 and 2 by turns, and sends data; two frames are lost on the way to 2."""
    rows = []
    for poll, slot in enumerate(range(0, (END - 2 * SLOT) // SLOT, 24)):
        start = PHASE + slot * SLOT
        slave = 1 + poll % 2
        channel = slot * 7 % 79
        if start == LOST:
            rows.append(Frame(start, 0, 2, "DM1", 366 * US, 41, "bit_errors", "payload", PAYLOAD))
        elif poll % 40 == 39:
            lost = poll == 1_199
            outcome = ("bit_errors", "access_code") if lost else ("received", "")
            rows.append(Frame(start, 0, slave, "DM1", 366 * US, channel, *outcome, body=PAYLOAD))
        else:
            rows.append(Frame(start, 0, slave, "POLL", 126 * US, channel))
            rows.append(Frame(start + SLOT, slave, 0, "NULL", 126 * US, (channel + 5) % 79))
    return rows


def write_trace(folder: Path) -> list[Frame]:
    """Write the trace of three robots into *folder*, and return its frames."""
    trace = Trace((POSES, FRAMES, TRANSMISSIONS, RECEPTIONS, INTERVALS, MESSAGES))
    for tick in range(0, END + 1, 100 * MS):
        for robot in range(3):
            trace.row(POSES, tick, robot, 2.0 + 3 * robot, 4.0, 0.0)
    made = frames()
    for number, frame in enumerate(made):
        start, source, destination, kind, duration, channel, outcome, part, body = frame
        lt_addr, length = destination or source, len(body) // 2
        trace.row(FRAMES, start, source, destination, duration, kind, channel, lt_addr, length, outcome, part)
        trace.row(
            TRANSMISSIONS, start, source, kind, destination, 0, number, False, False, True, body, duration, channel,
            lt_addr, length,
        )  # fmt: skip
        trace.row(RECEPTIONS, start, source, destination, -60.0 - destination, 4.5 if part else 21.25, outcome, part)
        if body and not part:
            trace.row(MESSAGES, start + duration, destination, source, False, body)
    trace.row(INTERVALS, 0, 0, 3 * S, 0, "inquiry", "train=A")
    trace.row(INTERVALS, 3 * S, 0, END, 0, "link", "peer=1 role=master")
    trace.row(INTERVALS, 4 * S, 0, END, 0, "link", "peer=2 role=master")
    trace.row(INTERVALS, 18 * S, 2, 19 * S, HOST, "crashed", "")
    trace.write(folder)
    return made
