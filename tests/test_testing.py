"""check_machine: a machine that keeps the laws passes, and for each law a machine that breaks only that one fails."""

import itertools
from dataclasses import dataclass
from typing import Any, get_args

import numpy as np
import pytest

from cosim.errors import LocalProtocolError
from cosim.machine import (
    BROADCAST,
    Address,
    Command,
    Connected,
    Event,
    Fate,
    GoTo,
    Inquire,
    InquiryComplete,
    LinkCommand,
    LinkEvent,
    Lost,
    Outgoing,
    Page,
    Reception,
    Role,
    RoleChanged,
)
from cosim.observation import Observation
from cosim.testing import LawError, _inputs, check_machine
from cosim.units import MS, S, Time

PERIOD = 700 * MS


@dataclass(frozen=True, slots=True)
class Heard:
    number: int


@dataclass(frozen=True, slots=True)
class Malformed:
    length: int


class Beacon:
    """A machine that links to the next address, walks along a line, and broadcasts where it is now and then.

    Frames are b"B", the author, a number, and the sum of these, one byte each.
    """

    def __init__(self, address: Address, start: Time, seed: int = 1) -> None:
        self.finished = False
        self.address = address
        self.stream = np.random.default_rng([seed, address])
        self.deadline = start + PERIOD
        self.number = 0
        self.peers: set[Address] = set()
        self.arrived = False
        self.out: list[Outgoing | LinkCommand] = [Inquire(S, 8)]
        self.motion: list[Command] = []
        self.rows: list[Event] = []

    def receive(self, data: bytes, reception: Reception, now: Time) -> None:
        if reception.source == self.address:
            return
        if len(data) != 4 or data[:1] != b"B" or sum(data[:3]) % 256 != data[3]:
            self.rows.append(Malformed(len(data)))
            return
        self.rows.append(Heard(data[2]))
        self.deadline += 10 * MS

    def link(self, event: LinkEvent, now: Time) -> None:
        match event:
            case InquiryComplete(found=found) if self.address + 1 in found:
                self.out.append(Page(self.address + 1))
            case Connected(role=Role.PEER):
                raise LocalProtocolError("this machine speaks over links with roles")
            case Connected(peer=peer):
                self.peers.add(peer)
            case Lost(peer=peer):
                self.peers.discard(peer)
            case _:
                pass

    def observe(self, observation: Observation, now: Time) -> None:
        if observation.arrived and not self.arrived:
            self.motion.append(GoTo(observation.x_m + 1.0, 0.0))
        self.arrived = observation.arrived

    def wake(self, now: Time) -> None:
        while self.deadline <= now:
            self.number += 1
            body = b"B" + bytes([self.address, self.number % 256])
            self.out.append(Outgoing(BROADCAST, body + bytes([sum(body) % 256]), token=self.number))
            self.deadline += PERIOD + int(self.stream.integers(1, 50)) * MS

    def wake_at(self) -> Time | None:
        return self.deadline

    def outbox(self) -> list[Outgoing | LinkCommand]:
        drained, self.out = self.out, []
        return drained

    def commands(self) -> list[Command]:
        drained, self.motion = self.motion, []
        return drained

    def events(self) -> list[Event]:
        drained, self.rows = self.rows, []
        return drained


class SharesAStream(Beacon):
    shared = np.random.default_rng(7)

    def __init__(self, address: Address, start: Time) -> None:
        super().__init__(address, start)
        self.stream = self.shared


class ReportsAGlobalCount(Beacon):
    counter = itertools.count()

    def wake(self, now: Time) -> None:
        super().wake(now)
        self.rows.append(Heard(next(self.counter)))


class RaisesOnShortFrames(Beacon):
    def receive(self, data: bytes, reception: Reception, now: Time) -> None:
        data[3]
        super().receive(data, reception, now)


class RaisesOnDamagedFrames(Beacon):
    """Notices only frames that look right but for one byte, which random bytes never do."""

    def receive(self, data: bytes, reception: Reception, now: Time) -> None:
        if len(data) == 4 and data[:1] == b"B" and sum(data[:3]) % 256 != data[3]:
            raise ValueError("checksum")
        super().receive(data, reception, now)


class RaisesOnBytesWhenDriven(Beacon):
    def receive(self, data: bytes, reception: Reception, now: Time) -> None:
        if self.number > 3 and len(data) > 20:
            raise LocalProtocolError("no room")
        super().receive(data, reception, now)


class RaisesOnBytesWhenNew(Beacon):
    def receive(self, data: bytes, reception: Reception, now: Time) -> None:
        if self.number == 0 and len(data) > 20:
            raise AttributeError("no peer yet")
        super().receive(data, reception, now)


class SwallowsBadBytes(Beacon):
    def events(self) -> list[Event]:
        return [row for row in super().events() if not isinstance(row, Malformed)]


class SleepsInThePast(Beacon):
    def wake(self, now: Time) -> None:
        before = self.deadline
        super().wake(now)
        if self.number > 4:
            self.deadline = before


class AsksAtTheSameInstantForever(Beacon):
    def wake(self, now: Time) -> None:
        super().wake(now)
        self.deadline = now


class CountsWhenAskedForTheDeadline(Beacon):
    def wake_at(self) -> Time | None:
        self.deadline += 1
        return self.deadline


class WakesTwiceDifferently(Beacon):
    def wake(self, now: Time) -> None:
        super().wake(now)
        self.motion.append(GoTo(0.0, 0.0))


class KeepsItsOutbox(Beacon):
    def outbox(self) -> list[Outgoing | LinkCommand]:
        return [item for item in self.out if isinstance(item, Outgoing)]


class KeepsItsCommands(Beacon):
    def commands(self) -> list[Command]:
        return list(self.motion)


class KeepsItsEvents(Beacon):
    def events(self) -> list[Event]:
        return list(self.rows)


class TakesItsOwnFrameForAnothers(Beacon):
    """Puts off its next frame for its own, as for a peer's: seen in later deadlines only."""

    def receive(self, data: bytes, reception: Reception, now: Time) -> None:
        super().receive(data, reception._replace(source=-2), now)


class AnswersItself(Beacon):
    def receive(self, data: bytes, reception: Reception, now: Time) -> None:
        super().receive(data, reception, now)
        if reception.source == self.address:
            self.out.append(Outgoing(BROADCAST, data))


class CountsItsOwnFrames(Beacon):
    """The echo leaves nothing at once; the next frame has another number."""

    def receive(self, data: bytes, reception: Reception, now: Time) -> None:
        super().receive(data, reception, now)
        self.number += reception.source == self.address


class RaisesOnItsOwnFrames(Beacon):
    def receive(self, data: bytes, reception: Reception, now: Time) -> None:
        if reception.source == self.address:
            raise LookupError("who is that?")
        super().receive(data, reception, now)


class WakesOnRoundTimes(Beacon):
    """Takes time to begin at 0: its deadlines are multiples of a second of the clock."""

    def wake(self, now: Time) -> None:
        super().wake(now)
        self.deadline = (now // S + 1) * S


class SendsLessWhenItIsLate(Beacon):
    def wake(self, now: Time) -> None:
        super().wake(now)
        if now > 3600 * S:
            self.out.clear()


class RaisesOnALinkThatItHasNot(Beacon):
    def link(self, event: LinkEvent, now: Time) -> None:
        if isinstance(event, Lost):
            self.peers.remove(event.peer)
        super().link(event, now)


class RaisesOnFatesWhenDriven(Beacon):
    """A new machine takes any fate; later it insists on knowing the token."""

    def link(self, event: LinkEvent, now: Time) -> None:
        if isinstance(event, Fate) and event.token > self.number > 0:
            raise KeyError(event.token)
        super().link(event, now)


class RaisesOnABlockedBody(Beacon):
    def observe(self, observation: Observation, now: Time) -> None:
        if observation.blocked:
            raise ValueError("it does not know what to do now")
        super().observe(observation, now)


class RaisesOnAnEarlyWake(Beacon):
    def wake(self, now: Time) -> None:
        if now < self.deadline and self.number == 0:
            raise ValueError("not yet")
        super().wake(now)


class SendsText(Beacon):
    def outbox(self) -> list[Any]:
        return [item._replace(payload="B") if isinstance(item, Outgoing) else item for item in super().outbox()]


class SendsToAStranger(Beacon):
    def outbox(self) -> list[Any]:
        return [item._replace(destination=3) if isinstance(item, Outgoing) else item for item in super().outbox()]


class SendsByARadioThatItHasNot(Beacon):
    def outbox(self) -> list[Any]:
        return [item._replace(radio=1) if isinstance(item, Outgoing) else item for item in super().outbox()]


class PagesAStranger(Beacon):
    def link(self, event: LinkEvent, now: Time) -> None:
        super().link(event, now)
        if isinstance(event, Connected):
            self.out.append(Page(99))


class RaisesInAnOrdinaryRun(Beacon):
    def observe(self, observation: Observation, now: Time) -> None:
        super().observe(observation, now)
        if observation.x_m > 0.0:
            raise LocalProtocolError("off the track")


class SaysWhenNothingComesOfAnInput(Beacon):
    """Takes inputs without a word to its node where that leaves nothing."""

    def receive(self, data: bytes, reception: Reception, now: Time) -> bool:
        rows = len(self.rows)
        super().receive(data, reception, now)
        return len(self.rows) > rows

    def observe(self, observation: Observation, now: Time) -> bool:
        moves = len(self.motion)
        super().observe(observation, now)
        return len(self.motion) > moves

    def link(self, event: LinkEvent, now: Time) -> bool:
        waiting = len(self.out)
        super().link(event, now)
        return len(self.out) > waiting


class DeniesALinkCommand(Beacon):
    def link(self, event: LinkEvent, now: Time) -> bool:
        super().link(event, now)
        return False


class DeniesAnEvent(Beacon):
    def receive(self, data: bytes, reception: Reception, now: Time) -> bool:
        super().receive(data, reception, now)
        return False


class DeniesACommand(Beacon):
    def observe(self, observation: Observation, now: Time) -> bool:
        super().observe(observation, now)
        return False


class DeniesADeadline(SaysWhenNothingComesOfAnInput):
    def observe(self, observation: Observation, now: Time) -> bool:
        self.deadline -= 1 if now > S else 0
        return super().observe(observation, now)


@pytest.mark.slow
@pytest.mark.parametrize("kept", [Beacon, SaysWhenNothingComesOfAnInput])
def test_a_machine_that_keeps_the_laws_passes(kept: Any):
    check_machine(kept)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("broken", "law"),
    [
        (SharesAStream, "equal inputs give equal outputs"),
        (ReportsAGlobalCount, "equal inputs give equal outputs"),
        (RaisesOnShortFrames, "bytes never raise.*IndexError"),
        (RaisesOnDamagedFrames, "bytes never raise.*checksum"),
        (RaisesOnBytesWhenDriven, "bytes never raise.*no room"),
        (RaisesOnBytesWhenNew, "bytes never raise.*no peer yet"),
        (SwallowsBadBytes, "bytes that mean nothing become an event.*0 of"),
        (SleepsInThePast, r"after wake\(\d+\) wake_at\(\) is"),
        (AsksAtTheSameInstantForever, r"after wake\(\d+\) wake_at\(\) is"),
        (CountsWhenAskedForTheDeadline, "at the same instant"),
        (WakesTwiceDifferently, "wake is idempotent"),
        (KeepsItsOutbox, r"outbox\(\) drained twice"),
        (KeepsItsCommands, r"commands\(\) drained twice"),
        (KeepsItsEvents, r"events\(\) drained twice"),
        (TakesItsOwnFrameForAnothers, "own frames that come back change nothing.*wake_at"),
        (AnswersItself, "own frame.*fed back gave Outgoing"),
        (CountsItsOwnFrames, "own frames that come back change nothing.*outbox"),
        (RaisesOnItsOwnFrames, "own frame.*fed back raised LookupError"),
        (WakesOnRoundTimes, "a later start makes all deadlines later.*wake_at"),
        (SendsLessWhenItIsLate, "a later start makes all deadlines later.*outbox"),
        (RaisesOnALinkThatItHasNot, "taken or refused.*Lost.*KeyError"),
        (RaisesOnFatesWhenDriven, "taken or refused.*Fate.*KeyError"),
        (RaisesOnABlockedBody, "taken or refused.*blocked=True.*ValueError"),
        (RaisesOnAnEarlyWake, "taken or refused.*wake raised ValueError"),
        (SendsText, r"machine 0: outbox\(\): Outgoing.*type str, expected bytes"),
        (SendsToAStranger, r"outbox\(\): Outgoing.*3 is no robot of the team, expected 0 to 2"),
        (SendsByARadioThatItHasNot, r"outbox\(\): Outgoing.*has no radio 1"),
        (PagesAStranger, r"outbox\(\): Page.*99 is no robot"),
        (RaisesInAnOrdinaryRun, "a drive as in a run raised LocalProtocolError"),
        (DeniesAnEvent, r"nothing came of its input, but events\(\) is Heard"),
        (DeniesALinkCommand, r"nothing came of its input, but outbox\(\) is Page"),
        (DeniesACommand, r"nothing came of its input, but commands\(\) is GoTo"),
        (DeniesADeadline, r"nothing came of an input, but wake_at\(\) was \d+, now"),
    ],
)
def test_a_machine_that_breaks_a_law_is_told_which(broken: Any, law: str):
    with pytest.raises(LawError, match=law):
        check_machine(broken)


@pytest.mark.slow
def test_events_are_of_the_types_that_are_given():
    check_machine(Beacon, duration=S, events=(Heard, Malformed))
    with pytest.raises(LawError, match=r"machine \d: events\(\): Malformed.*: its type is not among"):
        check_machine(Beacon, duration=S, events=(Heard,))


def test_a_refusal_of_an_input_is_legal():
    class Picky(Beacon):
        def link(self, event: LinkEvent, now: Time) -> None:
            if isinstance(event, Fate) and event.token > self.number:
                raise LocalProtocolError(f"no payload {event.token}")
            super().link(event, now)

    check_machine(Picky, duration=2 * S)


def test_a_machine_may_stamp_its_frames_with_the_time():
    class Stamps(Beacon):
        def wake(self, now: Time) -> None:
            super().wake(now)
            self.out = [item if not isinstance(item, Outgoing) else Outgoing(-1, b"%d" % now) for item in self.out]

        def receive(self, data: bytes, reception: Reception, now: Time) -> None:
            if reception.source != self.address:
                self.rows.append(Malformed(len(data)))

    check_machine(Stamps, duration=2 * S)


def test_news_comes_by_each_radio_and_commands_go_to_those_that_there_are():
    class OfTwo(Beacon):
        def __init__(self, address: Address, start: Time) -> None:
            super().__init__(address, start)
            self.out.append(Inquire(S, 8, radio=1))

        def link(self, event: LinkEvent, now: Time) -> None:
            if event.radio == 0:
                super().link(event, now)
            elif isinstance(event, InquiryComplete) and self.address + 1 in event.found:
                self.out.append(Page(self.address + 1, radio=1))

    class Surprised(OfTwo):
        def link(self, event: LinkEvent, now: Time) -> None:
            if isinstance(event, RoleChanged) and event.radio == 1:
                raise KeyError(event.peer)
            super().link(event, now)

    check_machine(OfTwo, duration=2 * S, radios=2)
    with pytest.raises(LawError, match=r"outbox\(\): Inquire\(.*radio=1\): the robot has no radio 1"):
        check_machine(OfTwo, duration=2 * S)
    with pytest.raises(LawError, match=r"taken or refused.*RoleChanged\(.*radio=1\).*KeyError"):
        check_machine(Surprised, duration=2 * S, radios=2)
    check_machine(Beacon, duration=2 * S, radios=2)


def test_every_kind_of_link_event_is_among_the_inputs():
    assert {type(given) for given in _inputs(1, (0.0, 0.0))} == {*get_args(LinkEvent), Observation, type(None)}
