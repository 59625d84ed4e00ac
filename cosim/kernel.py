"""The clock: SimPy's event queue, in integer nanoseconds, with cancellable handles and a stated order of equal times.

Events are executed in the order (time, priority, insertion). The priorities are the phases of one instant:

    STOP  -3   the end of a run; a run is half-open, so nothing at its end is executed
    FAULT -2   something fails, or works again
    WORLD -1   robots move, then sense
    (0)        SimPy's own urgent events
    DELIVER 1  frames and link events arrive
    WAKE   2   deadlines of machines
    AIR    3   slot boundaries: what a radio sends is decided after everything else of that instant

Nothing may be scheduled at the present instant into a phase that has already passed: it would run late and silently.
SimPy cannot take events out of its queue; a cancelled handle stays there as an empty event until its time comes. An
alarm can be changed: it and what is due soon wait beside the queue.
"""

from bisect import insort
from collections.abc import Callable
from heapq import heappush
from operator import index
from typing import Any, Final

import simpy

from cosim.errors import LocalProtocolError
from cosim.units import Time

STOP: Final = -3
FAULT: Final = -2
WORLD: Final = -1
DELIVER: Final = 1
WAKE: Final = 2
AIR: Final = 3
END: Final = (1 << 62, STOP)
"""An instant and phase after all others."""

Callback = Callable[[], None]
_Entry = tuple[Time, int, int, Callback]
"""Instant, priority and number of an event, and what it calls."""


class Handle(simpy.Event):
    """A callback that waits in the queue of a :class:`Kernel`; made by ``at`` and ``after`` only."""

    __slots__ = ("_kernel", "callback", "priority", "time")
    _ok = True
    _value: Any = None

    def __init__(self, kernel: "Kernel", time: Time, priority: int, callback: Callback) -> None:
        self.env = kernel.environment
        self.callbacks: Any = [Handle._fire]
        self._kernel = kernel
        self.priority = priority
        self.callback = callback
        self.time = time

    def cancel(self) -> None:
        """Make sure that the callback is not called (any more). Cancelling twice, or too late, is harmless."""
        if self.callbacks is not None:
            self.callbacks.clear()

    def _fire(self) -> None:
        kernel = self._kernel
        kernel.phase = (self.time, self.priority)
        kernel.executed += 1
        self.callback()


class Alarm:
    """A callback at one instant at a time, which may be changed for little; made by ``alarm`` only.

    It is for models with a queue of their own, of whose next event the kernel is to know: mostly that is the next of
    all. So it stays beside the queue, with few others.
    """

    __slots__ = ("_callback", "_entry", "_kernel")

    def __init__(self, kernel: "Kernel", callback: Callback) -> None:
        self._kernel = kernel
        self._callback = callback
        self._entry: _Entry | None = None

    def set(self, time: Time, priority: int) -> None:
        """Have the callback called at *time*, in the phase *priority*, and not when it would have been.

        Raise :exc:`LocalProtocolError` if that is over, and :exc:`TypeError` if *time* is not an integer.
        """
        kernel, entry, time = self._kernel, self._entry, index(time)
        if time < kernel.environment._now or (time, priority) < kernel.phase:
            raise kernel._over_error(time, priority)
        if entry in kernel._beside:
            kernel._beside.remove(entry)
        self._entry = entry = time, priority, next(kernel.environment._eid), self._callback
        insort(kernel._beside, entry)


class Repeated(Handle):
    """A callback that is called every so often; made by ``every`` only. It enters the queue anew, not a new event."""

    __slots__ = ("_period",)

    def __init__(self, kernel: "Kernel", time: Time, priority: int, callback: Callback, period: Time) -> None:
        super().__init__(kernel, time, priority, callback)
        self.callbacks = [Repeated._fire]
        self._period = period

    def cancel(self) -> None:
        """Make sure that the callback is not called any more, also from inside of it."""
        super().cancel()
        self._period = 0

    def _fire(self) -> None:
        kernel, environment, callback, priority = self._kernel, self.env, self.callback, self.priority
        queue: list[Any] = environment._queue
        time, beside = self.time, kernel._beside
        while True:
            kernel.phase = (time, priority)
            kernel.executed += 1
            callback()
            period = self._period
            if not period:
                break
            self.time = time = time + period
            if not queue or queue[0][0] <= time or (beside and beside[0][0] <= time):
                self.callbacks = [Repeated._fire]
                heappush(queue, (time, priority, next(environment._eid), self))
                break
            environment._now = time  # nothing comes before it: it does without the queue


class Kernel:
    """Simulated time and the queue of what will happen. An exception in a callback leaves ``run`` as it is."""

    def __init__(self) -> None:
        self.environment = simpy.Environment(initial_time=0)
        self.phase: tuple[Time, int] = (0, STOP)
        self.executed = 0
        self._ends: list[simpy.Event] = []
        self._over = False
        """True once an end of the present run is reached."""
        self._beside: list[_Entry] = []
        """Events that are mostly the very next, and do without the queue: in their order, and only a few."""

    @property
    def now(self) -> Time:
        """The present instant in nanoseconds."""
        return self.environment._now  # type: ignore[return-value]  # SimPy allows floats; the kernel does not

    def at(self, time: Time, callback: Callback, priority: int = DELIVER) -> Handle:
        """Call *callback* at the absolute *time*, in the phase *priority*.

        Raise :exc:`LocalProtocolError` if *time* lies in the past, or now but in a phase that is over, and
        :exc:`TypeError` if it is not an integer (a float clock would break every comparison of slots).
        """
        time, environment = index(time), self.environment
        now = environment._now
        if time <= now and (time < now or (time, priority) < self.phase):
            raise self._over_error(time, priority)
        handle = Handle(self, time, priority, callback)
        heappush(environment._queue, (time, priority, next(environment._eid), handle))  # type: ignore[misc]
        return handle

    def after(self, delay: Time, callback: Callback, priority: int = DELIVER) -> Handle:
        """Call *callback* once *delay* nanoseconds have passed; raise as :meth:`at` does."""
        return self.at(self.now + index(delay), callback, priority)

    def every(self, period: Time, callback: Callback, priority: int = DELIVER) -> Handle:
        """Call *callback* whenever another *period* nanoseconds have passed, until the handle is cancelled.

        Each time counts as scheduled when the callback of the time before has returned. Cheaper than a callback that
        calls :meth:`after`. Raise :exc:`LocalProtocolError` if *period* is not positive.
        """
        period = index(period)
        if period < 1:
            raise LocalProtocolError(f"every {period} ns: time would not go on")
        handle = Repeated(self, self.now + period, priority, callback, period)
        self._schedule(handle.time, priority, handle)
        return handle

    def soon(self, callback: Callback) -> None:
        """Call *callback* at this instant, as a new event, in the phase DELIVER or the present one if that is later.

        Mostly that is the very next event: then it does without the queue.
        """
        now, (time, phase) = self.now, self.phase
        phase = max(DELIVER, phase) if time == now else DELIVER
        insort(self._beside, (now, phase, next(self.environment._eid), callback))

    def alarm(self, callback: Callback) -> Alarm:
        """Return an alarm that calls *callback*, and is not set yet."""
        return Alarm(self, callback)

    def peek(self) -> tuple[Time, int]:
        """Return the instant and priority of the next event, also of one that is cancelled; ``END`` if there is none.

        A model that has a queue of its own may run ahead to what comes before that: nothing else happens until then.
        """
        queue, beside = self.environment._queue, self._beside
        first = queue[0][:2] if queue else END
        return min(first, beside[0][:2]) if beside else first  # type: ignore[return-value]

    def run(self, until: Time) -> None:
        """Execute everything strictly before *until* and set the clock to it: ``run(a); run(b)`` equals ``run(b)``.

        Raise :exc:`LocalProtocolError` if *until* lies in the past, or inside of another run.
        """
        until = index(until)
        if self._ends:
            raise LocalProtocolError(f"cannot run until {until} ns: this is inside of a run")
        if until < self.now:
            raise LocalProtocolError(f"cannot run until {until} ns: it is {self.now} ns")
        self._over = False
        self._end(until)
        try:
            self._go_on()
        finally:
            for end in self._ends:
                end.callbacks = []  # one that has not been reached must not end a later run
            self._ends.clear()

    def _go_on(self) -> None:
        """Execute one event after another until the present run is over; its end is in the queue."""
        environment, beside = self.environment, self._beside
        queue, step = environment._queue, environment.step
        while not self._over:
            if beside and beside[0] < queue[0]:  # type: ignore[operator]  # no two have one number
                time, priority, _, callback = beside.pop(0)
                environment._now = time
                self.phase = (time, priority)
                self.executed += 1
                callback()
            else:
                step()

    def stop(self) -> None:
        """End the present ``run`` at this instant, right after the callback that calls this.

        Raise :exc:`LocalProtocolError` outside of a run.
        """
        if not self._ends:
            raise LocalProtocolError(f"nothing to stop at {self.now} ns: nothing runs")
        self._end(self.now)

    def _over_error(self, time: Time, priority: int) -> LocalProtocolError:
        return LocalProtocolError(
            f"scheduled at {time} ns, priority {priority}, but it is {self.now} ns, phase {self.phase[1]}"
        )

    def _end(self, time: Time) -> None:
        """Have the present run end at *time*."""
        event = simpy.Event(self.environment)
        event._ok = True
        event._value = None
        event.callbacks.append(self._reach_end)
        self._schedule(time, STOP, event)
        self._ends.append(event)

    def _reach_end(self, event: simpy.Event) -> None:
        self._over = True

    def _schedule(self, time: Time, priority: int, event: simpy.Event) -> None:
        environment = self.environment
        heappush(environment._queue, (time, priority, next(environment._eid), event))  # type: ignore[misc]
