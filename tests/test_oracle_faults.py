"""Faults planted in the Bluetooth channel, one wherever it might go wrong: its comparison with the oracle finds them.

Each is one replacement in the source of one module; the cases are those of the default runs of the comparisons.
"""

from typing import NamedTuple

import pytest

from cosim.errors import LocalProtocolError
from tests import test_oracle_band, test_oracle_inquiry, test_oracle_page, test_oracle_polling
from tests.band_channel import run_channel
from tests.oracles.campaign import plant

COMPARISONS = {
    "band": test_oracle_band,
    "inquiry": test_oracle_inquiry,
    "page": test_oracle_page,
    "polling": test_oracle_polling,
}


class Fault(NamedTuple):
    """What is wrong, whose cases find it, and *new* in place of *old* in the source of *module*."""

    name: str
    comparison: str
    module: str
    old: str
    new: str


FAULTS = [
    Fault(
        "a frame that just ends there counts",
        "band",
        "medium",
        "frames[other, i, 1] > start:",
        "frames[other, i, 1] >= start:",
    ),
    Fault(
        "a frame that just begins there counts",
        "band",
        "medium",
        "frames[other, i, 0] < end and",
        "frames[other, i, 0] <= end and",
    ),
    Fault(
        "the filter weakens 1 MHz too much",
        "band",
        "medium",
        "WEIGHTS: Final = (1.0, 10.0**-1.1,",
        "WEIGHTS: Final = (1.0, 10.0**-1.2,",
    ),
    Fault("the filter weakens 2 MHz too little", "band", "medium", "10.0**-4.1,", "10.0**-3.9,"),
    Fault("3 MHz away is as near as 2", "band", "medium", "min(abs(apart), 3)", "min(abs(apart), 2)"),
    Fault(
        "an equal neighbour destroys", "band", "medium", "if carrier < interference_mw", "if carrier <= interference_mw"
    ),
    Fault(
        "only the last interferer counts",
        "band",
        "medium",
        "total += power * _weight(mode, frames",
        "total = power * _weight(mode, frames",
    ),
    Fault(
        "draws of both directions are exchanged", "band", "medium", "source << 16 | receiver", "receiver << 16 | source"
    ),
    Fault(
        "noise comes before interference",
        "band",
        "medium",
        "        if carrier < interference_mw(medium, source, receiver, channel, since, until):\n            return COLLIDED + section\n        if lost == section:\n            return BIT_ERRORS + section\n",
        "        if lost == section:\n            return BIT_ERRORS + section\n        if carrier < interference_mw(medium, source, receiver, channel, since, until):\n            return COLLIDED + section\n",
    ),
    Fault("Es/N0 of 0 dB is not enough", "band", "medium", ">= DETECTABLE_DB", "> DETECTABLE_DB"),
    Fault("IDs fill the receive slots", "band", "medium", "tick & 2 == 0", "tick & 2 != 0"),
    Fault("the second train is the first", "band", "medium", "else 32 - train[T_KOFFSET]", "else train[T_KOFFSET]"),
    Fault(
        "an ID that has begun before counts not",
        "band",
        "medium",
        "max(start - ID_AIR + 1, train[T_FROM])",
        "max(start, train[T_FROM])",
    ),
    Fault(
        "jammers jam where they are not", "band", "medium", "if weight > 0.0 and jams(", "if weight > 0.0 and not jams("
    ),
    Fault("only the last frame is remembered", "band", "medium", "RING: Final = 8", "RING: Final = 1"),
    Fault(
        "the answer is as strong as the question",
        "band",
        "band",
        "medium.power_dbm[slave, master]",
        "medium.power_dbm[master, slave]",
    ),
    Fault(
        "NULLs are not on the air",
        "band",
        "band",
        "        put(medium.frames, medium.cursor, links[SLAVE, k], answer, answer + HEADER_AIR, channel)\n",
        "",
    ),
    Fault("idle slots go on one too far", "band", "band", "(until - 1 if starts[p]", "(until if starts[p]"),
    Fault("two piconets are as calm as one", "band", "band", "running(band) <= 1", "running(band) <= 2"),
    Fault(
        "presence is looked at too late",
        "band",
        "band",
        "links[JOINED, k] and piconet[PAIR_HERE]",
        "links[JOINED, k] and links[HERE, k]",
    ),
    Fault(
        "a POLL is heard at its start",
        "band",
        "band",
        "links[HEARD_UP if up else HEARD_DOWN, k] = time_of(piconet, tick) + HEADER_AIR",
        "links[HEARD_UP if up else HEARD_DOWN, k] = time_of(piconet, tick)",
    ),
    Fault(
        "the air is calm though a link does not hear",
        "band",
        "band",
        "            and heard_of(band.medium, power[slave, p])\n",
        "",
    ),
    Fault("who is alone is not exposed", "band", "radio", "            bands.expose(self.band, self._master)\n", ""),
    Fault(
        "idle frames end with the old powers",
        "band",
        "radio",
        "self.advance(now, now - 1)\n        self._disturb()",
        "self.advance(now)\n        self._disturb()",
    ),
    Fault(
        "jammers' old powers",
        "band",
        "radio",
        "self.advance(now, now - 1)\n        self.band.medium.jam_mw",
        "self.advance(now)\n        self.band.medium.jam_mw",
    ),
    Fault(
        "pages leave the air calm",
        "band",
        "radio",
        "        self.advance(frame.start)\n        self._disturb()\n",
        "        self.advance(frame.start)\n",
    ),
    Fault(
        "calm frames are forgotten",
        "band",
        "radio",
        "            self._in_flight.append((source, start, start + duration, channel))",
        "            pass",
    ),
    Fault("the calm after a page comes too early", "band", "radio", "        self._stray_until(end)\n", ""),
    Fault("IDs go on for a slot", "band", "radio", "train[T_TO] = at\n", "train[T_TO] = at + 625_000\n"),
    Fault(
        "trains are forgotten at once",
        "band",
        "radio",
        "kept = [row for row in range(count) if medium.trains[row, T_TO] + 2 * LONGEST_FRAME > now]",
        "kept = [row for row in range(count) if medium.trains[row, T_TO] > now]",
    ),
    Fault(
        "a part is left too late", "band", "polling", "if into + need <= links[COUNT, k]:", "if into < links[COUNT, k]:"
    ),
    Fault(
        "the answer needs one slot",
        "band",
        "polling",
        "need = 2 * (slots + piconet[LONGEST])",
        "need = 2 * (slots + 1)",
    ),
    Fault("the slave's SEQN does not change", "band", "polling", "links[SEQ_UP, k] ^= 1", "links[SEQ_UP, k] ^= 0"),
    Fault("the master's SEQN does not change", "band", "polling", "links[SEQ_DOWN, k] ^= 1", "links[SEQ_DOWN, k] ^= 0"),
    Fault(
        "ARQN outlives its packet", "band", "polling", "    links[ARQN, k] = 0\n    piconet[NEXT]", "    piconet[NEXT]"
    ),
    Fault("slots are decided before hosts act", "band", "slots", "self._decide, AIR)", "self._decide)"),
    Fault(
        "a broken payload is taken",
        "band",
        "slots",
        "if question is not None and fate.heard is Heard.RECEIVED:",
        "if question is not None:",
    ),
    Fault(
        "a broken answer is acknowledged",
        "band",
        "slots",
        "answer is not None and fate.heard is Heard.RECEIVED and polling",
        "answer is not None and polling",
    ),
    Fault(
        "a broken broadcast is taken",
        "band",
        "slots",
        "fate.heard is Heard.RECEIVED and payload is not None and not payload.taken",
        "payload is not None and not payload.taken",
    ),
    Fault(
        "a broken question is not answered",
        "band",
        "slots",
        "        if not fate.header_heard:\n            self._assess(frame, False)",
        "        if fate.heard is not Heard.RECEIVED:\n            self._assess(frame, False)",
    ),
    Fault(
        "a broken broadcast is not heard",
        "band",
        "slots",
        "            if fate.header_heard:\n                self._broadcast_heard(k)",
        "            if fate.heard is Heard.RECEIVED:\n                self._broadcast_heard(k)",
    ),
    Fault(
        "the answer is as strong as the question, with payloads",
        "band",
        "slots",
        "air.carrier(slave, self.address)",
        "air.carrier(self.address, slave)",
    ),
    Fault("what has been chosen is flushed", "band", "slots", ".chosen = True", ".chosen = False"),
    Fault("one broadcast too many", "band", "slots", "payload.tries >= self._n_bc", "payload.tries > self._n_bc"),
    Fault(
        "the slave answers with its head, acknowledged or not",
        "band",
        "slots",
        "answer = waiting[acknowledges] if len(waiting) > acknowledges else None",
        "answer = waiting[0] if waiting else None",
    ),
    Fault("repeated broadcasts are delivered again", "band", "slots", "not payload.taken >> k & 1", "True"),
    Fault(
        "a broadcast overtakes",
        "band",
        "queues",
        "                if not waiting_for:\n                    yield payload",
        "                yield payload",
    ),
    Fault(
        "payloads for one slave overtake each other",
        "band",
        "queues",
        "if payload.lt_addr not in waiting_for:",
        "if True:",
    ),
    Fault(
        "one is in the piconet of the first link",
        "band",
        "attendance",
        "self._latest[-1] == master",
        "self._latest[0] == master",
    ),
    Fault(
        "a page keeps nobody away",
        "band",
        "attendance",
        "self._planned(master)._replace(here=False)",
        "self._planned(master)",
    ),
    Fault("parts begin a slot late", "band", "attendance", "2 * first, 2 * count", "2 * first + 2, 2 * count"),
    Fault(
        "a resumed piconet waits a slot pair",
        "band",
        "piconet",
        "self.links.piconet[NEXT] = max(int(self.links.piconet[NEXT]), first)",
        "self.links.piconet[NEXT] = max(int(self.links.piconet[NEXT]), first + 4)",
    ),
    Fault(
        "a payload behind an absent slave's is not thought of",
        "band",
        "intake",
        "overtaking = piconet[polling.SHARED] or",
        "overtaking = False and",
    ),
    Fault("what is about to be on the air is flushed", "band", "intake", " and not payload.chosen", ""),
    Fault(
        "replies that end with the inquiry are lost",
        "band",
        "inquiry",
        "if self._over_since < reply.end",
        "if self._over_since <= reply.end",
    ),
    Fault(
        "the last of equal replies is taken",
        "band",
        "inquiry",
        "key=lambda reply: (reply.frame.start, reply.frame.source)",
        "key=lambda reply: (reply.frame.start, -reply.frame.source)",
    ),
    Fault(
        "an FHS is locked on whatever hits it",
        "band",
        "inquiry",
        "return None if fate is GOOD else fate",
        "return None",
    ),
    Fault("an FHS has no payload", "band", "inquiry", "FHS_BITS, HEADER)", "0, HEADER)"),
    Fault(
        "an ID is heard whatever hits it",
        "band",
        "inquiry",
        "if self._air.judge(frame, self.address, carrier_dbm) is not GOOD:",
        "if False:",
    ),
    Fault("a page's FHS has no payload", "band", "paging", 'FHS_BITS if frame.kind == "FHS" else 0', "0"),
    Fault(
        "a page ID is heard whatever hits it",
        "band",
        "paging",
        "if self.air.judge(frame, self.scanner.address, carrier_dbm) is not GOOD:",
        "if False:",
    ),
    Fault(
        "a connected device goes on scanning",
        "band",
        "controller",
        "(not self._attendance.linked or self._insists)",
        "True",
    ),
    Fault(
        "a slave pages in the midst of a slot pair",
        "band",
        "procedures",
        "pauses = [piconet.pair_ends() for piconet in owner.masters.values()]",
        "pauses = []",
    ),
    Fault("a broadcast is heard by those who are away", "band", "slots", "k in present", "True"),
    Fault("links time out before frames end", "band", "supervision", "self._look, WAKE)", "self._look)"),
    Fault(
        "a procedure's interruption lasts a slot pair too long",
        "band",
        "procedures",
        "self._retry = self._kernel.at(again, self._begin)",
        "self._retry = self._kernel.at(again + 1_250_000, self._begin)",
    ),
    Fault("the window opens a tick late", "inquiry", "scanning", "edge + part * WINDOW)", "edge + part * WINDOW + 1)"),
    Fault("the window closes a tick late", "inquiry", "scanning", "(part + 1) * WINDOW)", "(part + 1) * WINDOW + 1)"),
    Fault(
        "the window opens 1 ns late",
        "inquiry",
        "scanning",
        "_tick(ph, pm, opening - 1) + 1",
        "_tick(ph, pm, opening) + 1",
    ),
    Fault("the window closes 1 ns early", "inquiry", "scanning", "closing - ID_AIR", "closing - ID_AIR - 1"),
    Fault("an ID across the close is heard", "inquiry", "scanning", "closing - ID_AIR", "closing"),
    Fault("listening starts 1 ns late", "inquiry", "scanning", "since - 1) + 1", "since) + 1"),
    Fault(
        "the scanner's block ends a tick late", "inquiry", "scanning", "(block + 1) << 12) - 1)", "(block + 1) << 12))"
    ),
    Fault("the inquirer's block ends a tick late", "inquiry", "scanning", "<< 12) - est - 1", "<< 12) - est"),
    Fault(
        "the transmit slot that begins now is missed", "inquiry", "scanning", "clock.tick(now - 1)", "clock.tick(now)"
    ),
    Fault("the train ends a tick late", "inquiry", "scanning", "(turn + 1) * switch - 1", "(turn + 1) * switch"),
    Fault(
        "the train in use changes a tick late",
        "inquiry",
        "scanning",
        "(tick - self.first) // (32",
        "(tick - self.first - 1) // (32",
    ),
    Fault("the second window is not 16 on", "inquiry", "scanning", "n + 16 * part", "n + 15 * part"),
    Fault("the scanner's clock stops at 28 bits", "inquiry", "scanning", "_solve((block", "_solve((min(block, 0xFFFF)"),
    Fault("N is not counted", "inquiry", "inquiry", "self.n += 1", "self.n += 0"),
    Fault("the back-off is short by one", "inquiry", "inquiry", "slots * SLOT", "max(slots - 1, 0) * SLOT"),
    Fault(
        "the short back-off begins too late",
        "inquiry",
        "inquiry",
        "SHORT_BACKOFF_BELOW: Final = 4096",
        "SHORT_BACKOFF_BELOW: Final = 4095",
    ),
    Fault("the response time-out is short by one slot", "inquiry", "inquiry", "128 * SLOT", "127 * SLOT"),
    Fault("the response time-out is long by one slot", "inquiry", "inquiry", "128 * SLOT", "129 * SLOT"),
    Fault(
        "the answer is a tick late", "inquiry", "inquiry", "start + RESPONSE_DELAY", "start + RESPONSE_DELAY + 312_500"
    ),
    Fault(
        "the answer is expected a slot pair late",
        "inquiry",
        "inquiry",
        "listens = reply.frame, reply.tick + 2",
        "listens = reply.frame, reply.tick + 6",
    ),
    Fault(
        "the answer in a second window is not 16 on", "inquiry", "inquiry", "16 * meeting.second", "0 * meeting.second"
    ),
    Fault(
        "IDs are sent while an FHS is received",
        "inquiry",
        "inquiry",
        "frame.start < start < self._locked.end",
        "frame.start < start < 0",
    ),
    Fault(
        "a second FHS can be locked on",
        "inquiry",
        "inquiry",
        "frame.start < self._locked.end",
        "frame.start < self._locked.frame.start",
    ),
    Fault(
        "a scanner that is off still answers", "inquiry", "inquiry", "self._answering.cancel()", "self._answering.time"
    ),
    Fault("one reply too many is waited for", "inquiry", "inquiry", ">= self._enough", "> self._enough"),
    Fault("the inquiry ends a tick early", "inquiry", "inquiry", "self.ids.end + 1", "self.ids.end"),
    Fault("the clock in the FHS does not wrap", "inquiry", "inquiry", "* 4 % CLOCK_RANGE", "* 4"),
    Fault(
        "the train of the exchange is read too late",
        "page",
        "paging",
        "train(meeting.tick)]",
        "train(meeting.tick + 4)]",
    ),
    Fault("the second window is not 16 on", "page", "paging", "meeting.second << 16", "meeting.second << 15"),
    Fault(
        "the response is late by one tick",
        "page",
        "paging",
        "start + RESPONSE_DELAY, self._respond",
        "start + RESPONSE_DELAY + 312_500, self._respond",
    ),
    Fault(
        "the first FHS is late by one slot pair", "page", "paging", "self._base + 4, partial", "self._base + 8, partial"
    ),
    Fault("the FHS goes out three times", "page", "paging", "FHS_TRIES: Final = 4", "FHS_TRIES: Final = 3"),
    Fault(
        "paging goes on a slot pair late",
        "page",
        "paging",
        "self._fail(self._base + 4 * (n + 1))",
        "self._fail(self._base + 4 * (n + 2))",
    ),
    Fault("the response time-out is too long", "page", "paging", "[Time] = 8 * SLOT", "[Time] = 16 * SLOT"),
    Fault("the connection time-out is short by one slot", "page", "paging", "[Time] = 32 * SLOT", "[Time] = 31 * SLOT"),
    Fault("there are fifteen POLLs", "page", "paging", "POLL_TRIES: Final = 16", "POLL_TRIES: Final = 15"),
    Fault(
        "the channel clock stops at 28 bits",
        "page",
        "paging",
        "hop_address, tick)",
        "hop_address, min(tick, (1 << 28) - 1))",
    ),
    Fault(
        "the page lasts a slot pair too long",
        "page",
        "paging",
        "2 * settings.timeout_slots",
        "2 * settings.timeout_slots + 4",
    ),
    Fault("the exchange under way is cut off", "page", "paging", "max(tick, self.ids.end)", "self.ids.end"),
    Fault(
        "T_poll is long by a slot pair",
        "polling",
        "polling",
        "links[DUE, k] = tick + piconet[T_POLL]",
        "links[DUE, k] = tick + piconet[T_POLL] + 4",
    ),
    Fault(
        "of equals the last is polled",
        "polling",
        "polling",
        "due[k] < due[best]):\n                best = k\n        return (max",
        "due[k] <= due[best]):\n                best = k\n        return (max",
    ),
    Fault(
        "skipped periods poll one time too often",
        "polling",
        "polling",
        "(end - 1 - last) // piconet[T_POLL] + 1",
        "(end - 1 - last) // piconet[T_POLL] + 2",
    ),
    Fault(
        "skipped periods leave the slot behind open",
        "polling",
        "polling",
        "piconet[NEXT] = last + (periods - 1) * piconet[T_POLL] + 4",
        "piconet[NEXT] = last + (periods - 1) * piconet[T_POLL] + 8",
    ),
    Fault(
        "who is alone hears NULLs early",
        "polling",
        "polling",
        "links[HEARD_UP, k] = time_of(piconet, tick + 2) + HEADER_AIR\n    piconet[IDLE]",
        "links[HEARD_UP, k] = time_of(piconet, tick) + HEADER_AIR\n    piconet[IDLE]",
    ),
    Fault("broadcasts outlive the last link", "polling", "queues", "(master_alone and p.lt_addr == EVERYONE)", "False"),
    Fault("what has been on the air is flushed", "polling", "intake", " and not payload.tries", ""),
    Fault("T_poll is long by one slot", "polling", "polling", "2 * t_poll_slots", "2 * t_poll_slots + 2"),
    Fault("after an answer a slot pair is lost", "polling", "polling", "tick + 2 * slots\n", "tick + 2 * slots + 4\n"),
    Fault(
        "the master forgets to repeat SEQN",
        "polling",
        "polling",
        "if first:\n        links[SEQ_DOWN, k] ^= 1",
        "links[SEQ_DOWN, k] ^= 1",
    ),
    Fault("ARQN outlives its packet", "polling", "polling", "links[ARQN, k] = 0\n    piconet[NEXT]", "piconet[NEXT]"),
    Fault("one broadcast too many", "polling", "slots", ">= self._n_bc", "> self._n_bc"),
    Fault(
        "a resumed piconet waits a slot pair",
        "polling",
        "piconet",
        "int(self.links.piconet[NEXT]), first)",
        "int(self.links.piconet[NEXT]), first + 4)",
    ),
    Fault(
        "broadcasts outlive the last link",
        "polling",
        "queues",
        "master_alone and p.lt_addr",
        "not master_alone and p.lt_addr",
    ),
    Fault(
        "supervision is long by 1 ns",
        "polling",
        "supervision",
        "deadline = min(sides) + self._timeout",
        "deadline = min(sides) + self._timeout + 1",
    ),
]


@pytest.mark.slow
@pytest.mark.parametrize("fault", FAULTS, ids=[f"{fault.comparison}: {fault.name}" for fault in FAULTS])
def test_a_planted_fault_is_found(fault: Fault, monkeypatch: pytest.MonkeyPatch) -> None:
    cases = COMPARISONS[fault.comparison].default_cases()
    channel = plant(monkeypatch, fault.module, fault.old, fault.new).BluetoothChannel
    for case, slow in cases:
        try:
            if run_channel(case, channel) != slow:
                return
        except (LocalProtocolError, IndexError):  # something was to happen in the past, or taken from an empty queue
            return
    pytest.fail("no case shows it")
