"""Faults to plant in the Bluetooth channel that the comparison over the whole band finds."""

from typing import NamedTuple


class Fault(NamedTuple):
    """What is wrong, whose cases find it, and *new* in place of *old* in the source of *module*."""

    name: str
    comparison: str
    module: str
    old: str
    new: str


BAND_FAULTS = [
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
        "if carrier < interference_mw(",
        "if lost != section and carrier < interference_mw(",
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
        "elif fate.header_heard:",
        "elif fate.heard is Heard.RECEIVED:",
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
]
