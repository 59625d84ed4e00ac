"""Faults to plant in single rooms of the Bluetooth channel: inquiry, page and polling."""

from tests.oracles.faults_band import Fault

ROOM_FAULTS = [
    Fault("the window opens a tick late", "inquiry", "scanning", "edge + part * WINDOW)", "edge + part * WINDOW + 1)"),
    Fault("the window closes a tick late", "inquiry", "scanning", "(part + 1) * WINDOW)", "(part + 1) * WINDOW + 1)"),
    Fault(
        "the window opens 1 ns late",
        "inquiry",
        "scanning",
        "tick_at(ph, pm, opening - 1) + 1",
        "tick_at(ph, pm, opening) + 1",
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
        "links[HEARD_UP, k] = time_of(piconet, last + 2) + HEADER_AIR\n    piconet[IDLE]",
        "links[HEARD_UP, k] = time_of(piconet, last) + HEADER_AIR\n    piconet[IDLE]",
    ),
    Fault("broadcasts outlive the last link", "polling", "queues", "(master_alone and p.lt_addr == EVERYONE)", "False"),
    Fault("what has been on the air is flushed", "polling", "piconet", " and not payload.tries", ""),
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
        "piconet",
        "deadline = min(sides) + self._settings.supervision",
        "deadline = min(sides) + self._settings.supervision + 1",
    ),
]
