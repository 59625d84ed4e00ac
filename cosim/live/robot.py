"""The process of one robot's machine: it waits for datagrams, for its pipe and for the machine's deadlines.

A datagram is an octet, 1 for what is meant for all and 0 for what is meant for the receiver alone, then the payload;
whom it comes from is told by its port. Only 127.0.0.1 is sent to and heard.
"""

import os
import select
import signal
import socket
import time
import traceback
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from multiprocessing.connection import Connection
from typing import Any, Final, NamedTuple, TypeAlias

from cosim.arrays import Floats
from cosim.errors import LocalProtocolError
from cosim.live.handing import handed
from cosim.machine import BROADCAST, OPERATOR, Address, Command, Event, LinkEvent, Machine, Outgoing, Reception
from cosim.node import misuse, shown
from cosim.observation import Observation, Seen
from cosim.robots.senses import Senses
from cosim.units import S, Time

HOST: Final = "127.0.0.1"
"""The loopback interface: nothing here is ever bound to, or sent to, another address."""
MOST_OCTETS: Final = 65_507
"""Bytes of the longest datagram."""
PATIENCE_S: Final = 0.5
"""The longest wait before it is looked whether the team's process is still there."""
MOST_AT_ONCE: Final = 64
"""Number of datagrams that are taken before the machine is drained, and deadlines are looked at."""
BUFFER: Final = 1 << 20
"""Bytes that a socket holds while its machine computes."""


# ---------------------------------------------------------------- what goes by pipe


class Begin(NamedTuple):
    """The run begins, by the monotonic clock that all processes of a computer have in common."""

    at_ns: int
    peers: tuple[Address, ...]
    """The robots that hear this one."""


class Sensed(NamedTuple):
    """What a robot senses at a tick."""

    own: tuple[Any, ...]
    """x_m, y_m, heading_rad, speed_mps, arrived, blocked."""
    picture: Seen
    poses: Floats | None
    """What scanners start from, of all robots; None if they have none."""
    tick: int
    peers: tuple[Address, ...]


class News(NamedTuple):
    """News about a link or a payload."""

    event: LinkEvent


class Typed(NamedTuple):
    """What the operator has typed at the robot's console."""

    payload: bytes


class End(NamedTuple):
    """The run is over: the machine is to be handed back."""


class Report(NamedTuple):
    """What a machine has left in its queues. Payloads stand there as zeros: they have gone by UDP."""

    at: Time
    finished: bool
    events: list[Event]
    items: list[Any]
    commands: list[Command]


class Handed(NamedTuple):
    """The machine at the end, pickled."""

    machine: bytes


class Failed(NamedTuple):
    """Why the process has ended."""

    why: str


Told: TypeAlias = Begin | Sensed | News | Typed | End
Answer: TypeAlias = Report | Handed | Failed


def bound_socket() -> socket.socket:
    """Return a UDP socket at a free port of the loopback interface."""
    one = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    one.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER)
    one.bind((HOST, 0))
    one.setblocking(False)
    return one


class _TeamGoneError(Exception):
    """The team's process is gone: its pipe has ended."""


@contextmanager
def _pipe_alone() -> Iterator[None]:
    """Tell the end of the team's pipe from the errors of the same kinds that a machine may raise of its own."""
    try:
        yield
    except (EOFError, BrokenPipeError, ConnectionResetError) as error:
        raise _TeamGoneError from error


class Host:
    """What one process drives: a machine, its socket and its pipe."""

    def __init__(
        self,
        robot: Address,
        machine: Machine,
        senses: Senses | None,
        radios: Sequence[int],
        sockets: Sequence[socket.socket],
        pipe: Connection,
    ) -> None:
        """Drive *machine* by the socket of *robot*, and close those of the others."""
        self._robot = robot
        self._machine = machine
        self._senses = senses
        self._radios = radios
        self._ports = [each.getsockname()[1] for each in sockets]
        self._robots = {port: other for other, port in enumerate(self._ports)}
        self._socket = sockets[robot]
        self._pipe = pipe
        self._peers: tuple[Address, ...] = ()
        self._begun_ns = 0
        self._last: Time = 0
        self._over = False
        self._told_finished = machine.finished
        for other, each in enumerate(sockets):
            if other != robot:
                each.close()

    def run(self) -> None:
        """Drive the machine until the run is over, or the team's process is gone; tell that why it fails."""
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # the team's process hears Ctrl-C, and ends this one
        try:
            self._play()
        except _TeamGoneError:
            return
        except LocalProtocolError as error:
            why = str(error)
        except Exception:  # noqa: BLE001  # a machine may raise anything: it goes to the team's process, which raises it
            why = f"robot {self._robot}: its machine has failed\n\n{traceback.format_exc()}"
        else:
            return
        with suppress(_TeamGoneError):
            self._answer(Failed(why))

    def _told(self) -> Told:
        with _pipe_alone():
            told: Told = self._pipe.recv()
            return told

    def _answer(self, answer: Answer) -> None:
        with _pipe_alone():
            self._pipe.send(answer)

    def _play(self) -> None:
        parent = os.getppid()
        self._take(self._told())
        self._drain()
        while not self._over:
            self._wait()
            due = self._machine.wake_at()
            now = self._now()
            if due is not None and due <= now:
                self._machine.wake(now)
            self._drain()
            if os.getppid() != parent:
                return
        self._answer(Handed(handed(self._machine)))

    def _now(self) -> Time:
        """Return the time of the run, which never goes back."""
        self._last = max(self._last, time.monotonic_ns() - self._begun_ns)
        return self._last

    def _wait(self) -> None:
        """Wait for input until the machine's deadline, and take it."""
        due = self._machine.wake_at()
        left_s = PATIENCE_S if due is None else (due - self._now()) / S
        inputs: list[Any] = [self._socket, self._pipe]
        ready, _, _ = select.select(inputs, [], [], min(max(left_s, 0.0), PATIENCE_S))
        if self._socket in ready:
            self._hear()
        while not self._over and self._pipe.poll():
            self._take(self._told())

    def _hear(self) -> None:
        for _ in range(MOST_AT_ONCE):
            try:
                data, (host, port) = self._socket.recvfrom(MOST_OCTETS)
            except BlockingIOError:
                return
            except OSError:  # what was sent to a robot that is dead has come back
                continue
            source = self._robots.get(port)
            if host == HOST and source is not None and data:
                self._machine.receive(data[1:], Reception(source, data[0] == 1), self._now())

    def _take(self, told: Told) -> None:
        match told:
            case Begin(at_ns, peers):
                self._begun_ns, self._peers = at_ns, peers
                time.sleep(max(0.0, (at_ns - time.monotonic_ns()) / S))
            case Sensed(own, picture, poses, tick, peers):
                self._peers = peers
                view = None
                if self._senses is not None and poses is not None:
                    view = self._senses.view_from(self._robot, poses, tick)
                self._machine.observe(Observation(*own)._replace(picture=picture, view=view), self._now())
            case News(event):
                self._machine.link(event, self._now())
            case Typed(payload):
                self._machine.receive(payload, Reception(OPERATOR, False), self._now())
            case End():
                self._over = True

    def _drain(self) -> None:
        """Send what the machine wants sent, and report all that it has left."""
        machine, now = self._machine, self._now()
        events, items = machine.events(), []
        for item in machine.outbox():
            wrong = misuse(item, len(self._ports), self._radios)
            if wrong is not None:
                raise LocalProtocolError(f"robot {self._robot} at {now / S:.6f} s: {shown(item)}: {wrong}")
            if isinstance(item, Outgoing) and item.destination != OPERATOR:
                self._send(item)
                item = item._replace(payload=bytes(len(item.payload)))
            items.append(item)
        commands, finished = machine.commands(), machine.finished
        if events or items or commands or finished != self._told_finished:
            self._told_finished = finished
            self._answer(Report(now, finished, list(events), items, list(commands)))

    def _send(self, item: Outgoing) -> None:
        """Send a payload to all who hear this robot, or to one of them."""
        to_all = item.destination == BROADCAST
        data = bytes((to_all,)) + item.payload
        if len(data) > MOST_OCTETS:
            raise LocalProtocolError(f"robot {self._robot}: a payload of {len(item.payload)} bytes fits no datagram")
        for peer in self._peers:
            if to_all or peer == item.destination:
                with suppress(OSError):  # a full buffer, or a robot that is dead: it is lost, as on any radio
                    self._socket.sendto(data, (HOST, self._ports[peer]))
