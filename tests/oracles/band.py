"""The slot-by-slot oracle of the whole band: piconets, inquiries, pages and jammers on one air, with noise.

Every tick of every master, inquirer and pager is visited; every frame and every ID goes on the air as a concrete
(start, end, source, channel), and each is judged at its end by looking at all others. Slow, and meant to be obviously
right. It takes from cosim the hop functions, the probabilities of errors and Philox, which have oracles of their own.
"""

from collections.abc import Callable
from functools import partial

from tests.oracles.band_diary import Diary
from tests.oracles.band_piconets import Piconet
from tests.oracles.band_scene import Book, Flush, Input, Inquire, Join, PageFor, Scan, Scene, Send, Share, Suspend
from tests.oracles.band_searches import Inquiry, Page
from tests.oracles.band_stage import DELIVER, HOST, Device, Link, Stage


def live(scene: Scene, draw: Callable[[int, int, int], int], watched: bool = False) -> Book:
    """Live through *scene*; *draw* (device, bound, tick) gives the scanners' back-offs; if *watched*, keep a diary."""
    stage = Stage(scene, draw)
    diary = Diary(stage)
    if watched:
        diary.start()
    masters = {wish.master if isinstance(wish, Join) else wish.device for wish in scene.inputs if is_founding(wish)}
    for address in sorted(masters):
        Piconet(stage, stage.devices[address]).start()
    for wish in scene.inputs:
        stage.at(wish.time, HOST, 0, partial(act, stage, wish))
    stage.run()
    stage.book.intervals = [tuple(row) for row in diary.close(scene.end)]
    return stage.book


def is_founding(wish: Input) -> bool:
    return isinstance(wish, Join | PageFor)


def act(stage: Stage, wish: Input) -> None:
    """Do what a host does now."""
    match wish:
        case Join(_, master, slave, lt_addr, due):
            link = Link(master, slave, lt_addr, due)
            stage.come_up(link, stage.devices[slave])
            stage.come_up(link, stage.devices[master])
        case Send():
            stage.send(wish)
        case Flush():
            stage.flush(wish)
        case Suspend(_, master, until):
            stage.devices[master].absent_until = until
        case Share(_, device, _, parts, _):
            stage.devices[device].share = wish if parts else None
        case Scan(_, device, enabled):
            stage.devices[device].scan_asked, stage.devices[device].scan_refused = enabled, not enabled
            stage.update_scan(stage.devices[device])
        case Inquire(_, device, duration, enough):
            search(stage, stage.devices[device], Inquiry(stage, stage.devices[device], duration, enough))
        case PageFor(_, device, peer, offset):
            search(stage, stage.devices[device], Page(stage, stage.devices[device], stage.devices[peer], offset))


def search(stage: Stage, device: Device, procedure: Inquiry | Page) -> None:
    """Begin a procedure now, or when the piconets of *device* can be left alone."""
    if device.procedure is not None:
        stage.doubt("a device has two procedures at once")
        return
    pauses = [pause_of(stage, device, link) for link in device.alive()]
    again = max((pause for pause in pauses if pause is not None), default=None)
    if again is not None:
        stage.at(again, DELIVER, device.address, partial(search, stage, device, procedure))
        return
    device.procedure = procedure
    stage.update_scan(device)
    procedure.begin()


def pause_of(stage: Stage, device: Device, link: Link) -> int | None:
    """Return when to ask again because of the piconet of *link*, or None if it can do without *device*.

    A slot pair that reaches beyond the next TX slot is waited for; a master also serves the links that are due first.
    """
    master = stage.devices[link.master]
    tick = master.clock.first_transmit_tick(stage.now)
    if master.free > tick:
        return master.clock.start(master.free)
    if master is device and any(own.due <= tick for own in master.own()):
        return master.clock.start(tick + 4)
    return None
