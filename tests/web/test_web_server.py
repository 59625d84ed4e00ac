"""The server as pages meet it: who may ask, what is refused, and what is left when pages come and go."""

import gc
import json
import socket
import threading
import time
from base64 import b64encode
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from itertools import pairwise
from pathlib import Path
from typing import Any, ClassVar

import pytest
from websockets.exceptions import ConnectionClosedError, InvalidStatus

from cosim.errors import UserError
from cosim.scenario import Scenario
from cosim.web.guard import HOST
from cosim.web.history import Cursor
from cosim.web.live import Live
from cosim.web.messages import LONGEST, AskPresent, Plain, Wish
from cosim.web.server import MOST_PAGES, STATIC, listening
from cosim.web.timeline import NO_TIMELINE, Timeline
from protocols.deployment.operator.page import PAGE as PLAYBOOK
from tests.web.console import PLAIN
from tests.web.served import Served, next_of, until_closed

PATIENT = PLAIN | {"duration_s": 1000, "protocol": {"use": "tests.web.console:SPEC", "parameters": {"patient": True}}}


@pytest.fixture
def session() -> Iterator[Live]:
    made = Live(Scenario.model_validate(PATIENT), 1, attended=True)
    yield made
    made.close()


@pytest.fixture
def served(session: Live) -> Iterator[Served]:
    made = Served(session)
    yield made
    made.stop()


def refused(served: Served, **more: Any) -> int:
    """Return the status with which a WebSocket is refused."""
    with pytest.raises(InvalidStatus) as told:
        served.connect(**more)
    return told.value.response.status_code


# ---------------------------------------------------------------- who may ask


@pytest.mark.parametrize("path", ["/", "/static/view.js", "/static/floor.js", "/static/common.css", "/static/view.css"])
def test_the_page_and_all_that_it_loads_are_there(served: Served, path: str):
    answer, _ = served.get(path)
    assert answer.status == 200
    assert "default-src 'self'" in answer.headers["content-security-policy"]
    assert answer.headers["cache-control"] == "no-cache"


@pytest.mark.parametrize("folder", [STATIC, PLAYBOOK.html.parent])
def test_nothing_is_loaded_from_elsewhere(folder: Path):
    for path in folder.rglob("*.*"):
        text = path.read_text(encoding="utf-8").replace("http://www.w3.org/2000/svg", "")  # a name, not an address
        assert "http://" not in text
        assert "https://" not in text


@pytest.mark.parametrize("path", ["/nothing", "/static/../server.py", "/static/%2e%2e/server.py", "/static/nothing.js"])
def test_nothing_else_is_there(served: Served, path: str):
    assert served.get(path)[0].status == 404


@pytest.mark.parametrize("host", ["evil.example", "evil.example:PORT", HOST, f"{HOST}:1", "localhost", "[::1]:PORT"])
def test_another_name_is_refused(served: Served, host: str):
    """So is a page of that name: it was made to point here (DNS rebinding)."""
    host = host.replace("PORT", str(served.port))
    for path in ("/", "/static/view.js"):
        answer, text = served.get(path, Host=host)
        assert (answer.status, text) == (403, "this server does not go by that name\n")
    assert refused(served, host=host) == 403
    assert refused(served, host=host, origin=f"http://{host}") == 403


@pytest.mark.parametrize(
    "origin", ["http://evil.example", "https://HERE", f"http://{HOST}:1", "http://localhost", "null"]
)
def test_a_page_from_elsewhere_is_refused(served: Served, origin: str):
    origin = origin.replace("HERE", f"{HOST}:{served.port}")
    assert served.get("/", Origin=origin)[0].status == 403
    assert refused(served, origin=origin) == 403


@pytest.mark.parametrize("name", [HOST, "localhost"])
def test_the_own_page_is_answered(served: Served, name: str):
    host = f"{name}:{served.port}"
    with served.connect(host, origin=f"http://{host}") as page:
        assert next_of(page, "scene")


def test_a_secret_is_asked_for_if_there_is_one(session: Live):
    served = Served(session, "yes")
    for query in ("", "?token=", "?token=no", "?token=yes2", "?other=yes"):
        assert refused(served, query=query) == 403
    with served.connect(query="?token=yes") as page:
        assert next_of(page, "scene")
    served.stop()


# ---------------------------------------------------------------- what pages say, and how they go


def test_malformed_messages_are_answered_by_an_error_and_ignored(served: Served):
    with served.connect() as page:
        for text in ("nonsense", "[1]", '{"say": "fly"}', b"\xff\x00", '{"say": "seek", "time_s": 1}'):
            page.send(text)
            assert next_of(page, "error")["why"]
        page.send(json.dumps({"say": "operator", "robot": 3, "data": {"request": 7}}))
        assert next_of(page, "error")["data"] == {"request": 7}  # whoever has asked that need not wait
        page.send(json.dumps({"say": "operator", "robot": 2, "data": {"request": 8}}))
        assert next_of(page, "operator")["data"] == {"answer": 8, "robot": 2}


def test_a_flood_of_malformed_messages_hangs_nothing(served: Served):
    with served.connect() as page:
        for _ in range(3000):
            page.send("{")
        page.send('{"say": "pause"}')
        assert next_of(page, "error")
        while next_of(page, "now")["state"] != "paused":
            pass


def test_a_message_that_is_too_long_ends_the_connection_only(served: Served):
    with served.connect() as page, served.connect() as other:
        half = "x" * (LONGEST // 2)
        page.send([half, half, "x"])  # too long with its last byte: nothing is on its way when the server closes
        assert until_closed(page) == 1009
        assert next_of(other, "now")


def test_a_second_page_sees_what_the_first_one_does(served: Served):
    with served.connect() as one, served.connect() as two:
        one.send('{"say": "pause"}')
        seen = []
        for page in (one, two):
            while (now := next_of(page, "now"))["state"] != "paused":
                pass
            seen.append((now["time_s"], now["robots"]))
        assert seen[0] == seen[1]


def test_each_connection_has_a_number_that_no_other_has_had(served: Served):
    """All pages are told all that robots answer: by numbers made of it each knows what is for it."""
    numbers = []
    with served.connect() as first:
        for _ in range(2):
            with served.connect() as page:
                numbers.append(next_of(page, "scene")["page"])
        numbers.append(next_of(first, "scene")["page"])
    assert len(set(numbers)) == 3


def test_a_closed_page_leaves_nothing(served: Served):
    threads = threading.active_count()
    for _ in range(5):
        with ExitStack() as stack:
            pages = [stack.enter_context(served.connect()) for _ in range(4)]
            served.wait_for(4)
            pages[0].close()
            pages[1].socket.close()  # gone without a word
            pages[2].socket.shutdown(socket.SHUT_RDWR)
            pages[3].close()
            served.wait_for(0)
    eventually(lambda: not served.uvicorn.server_state.tasks and threading.active_count() <= threads)


@pytest.mark.slow
def test_too_many_pages_are_turned_away(served: Served):
    with ExitStack() as stack:
        for _ in range(MOST_PAGES):
            stack.enter_context(served.connect())
        served.wait_for(MOST_PAGES)
        with served.connect() as page:
            assert until_closed(page) == 1013
        assert served.server.open == MOST_PAGES
    served.wait_for(0)
    with served.connect() as page:
        assert next_of(page, "scene")


class Loud:
    """A session that has half a megabyte to say whenever it is asked, and says when it was."""

    scene: ClassVar[Plain] = {}
    timeline: ClassVar[Timeline] = NO_TIMELINE

    def __init__(self) -> None:
        self.looked = 0
        """How often it was asked."""

    def wish(self, wish: Wish) -> None:
        raise AssertionError("nobody asks")

    def look(self, cursor: Cursor | None) -> tuple[list[Plain], Cursor]:
        self.looked += 1
        return [{"say": "now", "at_s": time.monotonic(), "much": "x" * 500_000}], Cursor(0, 0, 0, ())

    def close(self) -> None:
        pass


@pytest.mark.slow
def test_a_page_that_sleeps_gets_the_newest_when_it_wakes_and_holds_up_nobody():
    served = Served(Loud())
    with served.connect(max_queue=1) as sleeper, served.connect() as other:
        begun_s, count = time.monotonic(), 0
        while time.monotonic() < begun_s + 2 or count < 10:
            next_of(other, "now")
            count += 1
        times = [next_of(sleeper, "now")["at_s"] for _ in range(25)]
        assert max(after - before for before, after in pairwise(times)) > 0.8  # what it slept through was not composed
        assert times[-1] > begun_s + 1.9
    served.stop()


@contextmanager
def deaf(served: Served, loud: Loud) -> Iterator[None]:
    """Open a WebSocket from which nothing is read; go on when the server waits for it, and composes nothing more."""
    lines = ["GET /socket HTTP/1.1", f"Host: {HOST}:{served.port}", "Upgrade: websocket", "Connection: Upgrade"]
    lines += ["Sec-WebSocket-Version: 13", f"Sec-WebSocket-Key: {b64encode(bytes(16)).decode()}", "", ""]
    with socket.socket() as way:
        way.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        way.connect((HOST, served.port))
        way.sendall("\r\n".join(lines).encode())
        served.wait_for(1)
        before = 0
        while before != (before := loud.looked):
            time.sleep(0.5)
        yield
        assert loud.looked == before


def eventually(holds: Callable[[], bool]) -> None:
    end_s = time.monotonic() + 30
    while not holds():
        assert time.monotonic() < end_s
        time.sleep(0.01)


def test_a_page_that_reads_nothing_for_long_is_given_up(caplog: pytest.LogCaptureFixture):
    caplog.set_level("INFO", "cosim.web.server")
    loud = Loud()
    served = Served(loud, patience_s=1.5)
    with deaf(served, loud):
        served.wait_for(0)
        eventually(lambda: not served.uvicorn.server_state.tasks)
    eventually(lambda: not served.uvicorn.server_state.connections)
    served.stop()
    assert [record.getMessage() for record in caplog.records] == ["page 0: it has read nothing for 1.5 s"]


class Failing(Loud):
    """A session of which nothing can be read any more."""

    def __init__(self, fault: Exception) -> None:
        super().__init__()
        self.fault = fault

    def look(self, cursor: Cursor | None) -> tuple[list[Plain], Cursor]:
        raise self.fault


@pytest.mark.parametrize(
    ("fault", "said"),
    [
        (OSError(5, "Input/output error"), "OSError: [Errno 5] Input/output error"),
        (RuntimeError("ä" * 99), "RuntimeError: ä"),
    ],
)
def test_a_session_that_fails_tells_its_pages_why(fault: Exception, said: str, capfd: pytest.CaptureFixture[str]):
    served = Served(Failing(fault))
    with served.connect() as page:
        next_of(page, "scene")
        with pytest.raises(ConnectionClosedError) as closed:
            page.recv(timeout=60)
    served.stop()
    assert closed.value.rcvd is not None
    assert closed.value.rcvd.code == 1011
    assert closed.value.rcvd.reason.startswith(said)
    assert str(fault) in capfd.readouterr().err  # with its place


class Slow(Loud):
    """A session that computes for as long as is wished."""

    def __init__(self) -> None:
        super().__init__()
        self.wishes: list[Wish] = []
        self.computed: list[int] = []
        """The robots that it was asked about."""
        self.go_on = threading.Event()

    def look(self, cursor: Cursor | None) -> tuple[list[Plain], Cursor]:
        return [], Cursor(0, 0, 0, ())

    def wish(self, wish: Wish) -> None:
        self.wishes.append(wish)

    def answer(self, asked: AskPresent) -> Plain:
        self.computed.append(asked.robot)
        assert self.go_on.wait(60)
        if asked.robot == 2:
            raise UserError("there is no robot 2")
        return {"say": "map", "robot": asked.robot}


def asked(robot: int) -> str:
    return json.dumps({"say": "map", "robot": robot})


def test_a_page_is_heard_while_an_answer_is_computed_and_has_answers_in_their_order():
    slow = Slow()
    served = Served(slow)
    with served.connect() as page:
        for robot in (3, 2, 1):
            page.send(asked(robot))
        page.send(json.dumps({"say": "pause"}))
        eventually(lambda: bool(slow.wishes))
        slow.go_on.set()
        assert next_of(page, "map")["robot"] == 3
        assert "there is no robot 2" in str(next_of(page, "error"))
        assert next_of(page, "map")["robot"] == 1
    served.stop()


def test_a_page_is_heard_while_a_reach_is_computed(monkeypatch: pytest.MonkeyPatch):
    def reach(_: Plain, robot: int, __: tuple[float, float]) -> Plain:
        assert slow.go_on.wait(60)
        return {"say": "reach", "robot": robot}

    slow = Slow()
    monkeypatch.setattr("cosim.web.server.reach", reach)
    served = Served(slow)
    with served.connect() as page:
        page.send(json.dumps({"say": "reach", "robot": 3, "x_m": 1.0, "y_m": 2.0}))
        page.send(asked(1))
        page.send(json.dumps({"say": "pause"}))
        eventually(lambda: bool(slow.wishes))
        assert slow.computed == []
        slow.go_on.set()
        assert next_of(page, "reach")["robot"] == 3
        assert next_of(page, "map")["robot"] == 1
    served.stop()


def test_a_page_that_asks_for_too_much_at_once_is_told_so_and_gets_all_other_answers():
    slow = Slow()
    served = Served(slow)
    with served.connect() as page:
        page.send(asked(3))
        eventually(lambda: slow.computed == [3])
        for robot in range(4, 38):  # 32 may wait
            page.send(asked(robot))
        for _ in range(2):
            assert "too many questions wait" in next_of(page, "error")["why"]
        slow.go_on.set()
        assert [next_of(page, "map")["robot"] for _ in range(33)] == list(range(3, 36))
    served.stop()


def test_a_question_that_waits_already_is_answered_once():
    """A page asks again until it knows: what takes long is neither computed as often, nor called too much."""
    slow = Slow()
    served = Served(slow)
    with served.connect() as page:
        page.send(asked(1))
        eventually(lambda: slow.computed == [1])
        for _ in range(100):
            page.send(asked(1))  # as things are when the first one has been answered
            page.send(asked(3))
        page.send("{")
        assert "too many" not in next_of(page, "error")["why"]
        slow.go_on.set()
        assert [next_of(page, "map")["robot"] for _ in range(3)] == [1, 1, 3]
    assert slow.computed == [1, 1, 3]
    served.stop()


def test_what_a_page_that_has_left_still_asked_is_not_computed():
    slow = Slow()
    served = Served(slow)
    with served.connect() as page:
        for robot in (3, 4, 5):
            page.send(asked(robot))
        eventually(lambda: slow.computed == [3])
    served.wait_for(0)
    eventually(lambda: not served.uvicorn.server_state.tasks)
    slow.go_on.set()
    with served.connect() as page:
        page.send(asked(7))
        assert next_of(page, "map")["robot"] == 7
    assert slow.computed == [3, 7]
    served.stop()


class Broken(Slow):
    """A session that cannot answer."""

    def answer(self, asked: AskPresent) -> Plain:
        raise RuntimeError("it is broken")


def test_a_session_that_fails_to_answer_tells_its_page_why(capfd: pytest.CaptureFixture[str]):
    served = Served(Broken())
    with served.connect() as page:
        page.send(asked(1))
        with pytest.raises(ConnectionClosedError) as closed:
            next_of(page, "map")
    served.stop()
    assert closed.value.rcvd is not None
    assert (closed.value.rcvd.code, closed.value.rcvd.reason) == (1011, "RuntimeError: it is broken")
    assert "in answer" in capfd.readouterr().err  # with its place


@pytest.mark.filterwarnings("ignore:unclosed:ResourceWarning")  # what was not read has been left in the connection
def test_a_page_that_reads_nothing_holds_up_the_end_for_two_seconds_at_most(capfd: pytest.CaptureFixture[str]):
    loud = Loud()
    served = Served(loud)
    with deaf(served, loud):
        begun_s = time.monotonic()
        served.stop()
        assert time.monotonic() - begun_s < 10
    told = capfd.readouterr()
    assert (told.out, len(told.err.splitlines())) == ("", 1)
    assert "timeout graceful shutdown exceeded" in told.err
    del served
    gc.collect()  # now, while it is no error


def test_a_server_that_is_ended_ends_its_pages_and_its_run(session: Live):
    served = Served(session)
    with served.connect() as page:
        assert next_of(page, "now")
        begun_s = time.monotonic()
        served.stop()
        assert time.monotonic() - begun_s < 10
        assert until_closed(page) == 1012
    assert not session.running


def test_a_server_that_is_ended_says_nothing_of_it(session: Live, capfd: pytest.CaptureFixture[str]):
    served = Served(session)
    with served.connect() as page:
        assert next_of(page, "now")
        served.stop()
    assert capfd.readouterr() == ("", "")


def test_a_port_that_is_taken_is_told_in_one_line():
    with listening(0) as taken, pytest.raises(UserError, match=r"--port \d+: Address already in use"):
        listening(taken.getsockname()[1])


def test_only_this_computer_is_listened_to():
    with listening(0) as listener:
        assert listener.getsockname()[0] == HOST
