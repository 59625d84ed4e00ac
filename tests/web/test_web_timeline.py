"""The timeline as pages ask for it: what is malformed is told in a line, a box tells all, a socket carries answers."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from websockets.sync.client import ClientConnection

from cosim.errors import UserError
from cosim.timeline.index import Files, opened
from cosim.web.messages import parsed
from cosim.web.recorded import Recorded
from cosim.web.timeline import MOST_CELLS, MOST_LANES, AskBox, Kept
from tests.timeline.made import made_rows, made_trace, read, written
from tests.timeline.test_timeline_windows import LAST, Page
from tests.web.served import Served, next_of

WINDOW = {"say": "window", "number": 7, "lanes": [0], "from_ns": "0", "to_ns": "1000", "step_ns": "16"}
FIND = {"say": "find", "from_ns": "0"}
BOX = {"say": "box", "lane": 0, "row": 0}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return written(tmp_path_factory.mktemp("made"), made_trace(made_rows(1, 500, LAST)))


@pytest.fixture
def page(folder: Path) -> Page:
    return Page(Recorded(folder))


@pytest.fixture
def socket(folder: Path) -> Iterator[ClientConnection]:
    served = Served(Recorded(folder, playing=False))
    with served.connect() as page:
        yield page
    served.stop()


@pytest.mark.parametrize(
    ("given", "told"),
    [
        (WINDOW | {"lanes": list(range(MOST_LANES + 1))}, "lanes"),
        (WINDOW | {"lanes": [-1]}, "lanes"),
        (WINDOW | {"lanes": [1 << 16]}, "lanes"),
        (WINDOW | {"from_ns": 0}, "from_ns"),
        (WINDOW | {"from_ns": "1e3"}, "from_ns"),
        (WINDOW | {"from_ns": "1" * 19}, "from_ns"),
        (WINDOW | {"to_ns": "\u0661"}, "to_ns"),
        (WINDOW | {"step_ns": ""}, "step_ns"),
        (WINDOW | {"number": 1 << 32}, "number"),
        (WINDOW | {"more": 1}, "more"),
        ({"say": "window"}, "number"),
        (BOX | {"row": 1 << 32}, "row"),
        (BOX | {"lane": None}, "lane"),
        (FIND | {"kind": -1}, "kind"),
        (FIND | {"robot": -2}, "robot"),
        (FIND | {"lanes": [0] * (MOST_LANES + 1)}, "lanes"),
        (FIND | {"back": "maybe"}, "back"),
    ],
)
def test_what_is_malformed_is_told_in_one_line(given: Any, told: str):
    with pytest.raises(UserError, match=told) as fault:
        parsed(json.dumps(given))
    assert "\n" not in str(fault.value)


@pytest.mark.parametrize(
    ("given", "told"),
    [
        (WINDOW | {"step_ns": "0"}, "step_ns"),
        (WINDOW | {"step_ns": "-4"}, "step_ns"),
        (WINDOW | {"from_ns": "1001"}, "from_ns <= to_ns"),
        (WINDOW | {"to_ns": str(2 * MOST_CELLS), "step_ns": "1"}, "cells"),
        (WINDOW | {"to_ns": "9" * 18, "from_ns": "-" + "9" * 18, "step_ns": "1"}, "cells"),
        (WINDOW | {"lanes": [0, 999]}, "there is no lane 999"),
        (BOX | {"lane": 999}, "there is no lane 999"),
        (BOX | {"row": (1 << 32) - 1}, "there is no row 4294967295"),
        (FIND | {"lanes": [999]}, "there is no lane 999"),
    ],
)
def test_what_cannot_be_asked_is_told_in_one_line(page: Page, given: Any, told: str):
    with pytest.raises(UserError, match=told) as fault:
        page.session.timeline.answer(parsed(json.dumps(given)))
    assert "\n" not in str(fault.value)


def test_extreme_times_are_answered(page: Page):
    for start, end in (("-" + "9" * 18, "-" + "9" * 18), ("9" * 18, "9" * 18), ("-" + "9" * 18, "9" * 18)):
        found = read(page.session.timeline.answer(parsed(json.dumps(WINDOW | {
            "from_ns": start, "to_ns": end, "step_ns": "9" * 18
        }))))  # fmt: skip
        assert found.number == 7
        assert len(found.boxes[0]) == (len(page.everything()[0]) if start < "0" < end != start else 0)


def row_of(rows: list[tuple[Any, ...]], box: Any) -> int:
    """Return the number of the row with the start and end of *box* among *rows*, sorted by time."""
    [number] = [at for at, row in enumerate(sorted(rows, key=lambda row: row[0])) if at == box.row]
    return number


def test_a_box_tells_all_of_its_row_and_who_heard_it(page: Page):
    rows = made_rows(1, 500, LAST)
    number = next(number for number, lane in page.lanes.items() if lane["what"] == "sent")
    for box in page.everything()[number][:20]:
        told = page.box(number, box.row)
        sent = rows["transmissions"][row_of(rows["transmissions"], box)]
        names = (
            "time_ns",
            "source",
            "kind",
            "destination",
            "reserves_ns",
            "number",
            "retry",
            "routed",
            "whole",
            "body",
        )
        assert [told["fields"][name] for name in names] == [str(sent[0]), *sent[1:4], "0", *sent[5:10]]
        assert told["transmission"] == told["fields"]
        assert (told["start_ns"], told["end_ns"]) == (str(box.start), str(box.end))
        heard = [row for row in rows["receptions"] if row[:2] == sent[:2]]
        assert [(each["receiver"], each["sinr_db"], each["outcome"], each["part"]) for each in told["receptions"]] == [
            (row[2], row[4], row[5], row[6]) for row in heard
        ]
        assert told["bytes"] == "c0ffee"
        assert told["decoded"] is None


def test_a_frame_at_a_receiver_is_told_with_its_transmission(page: Page):
    number = next(number for number, lane in page.lanes.items() if lane["what"] == "received")
    for box in page.everything()[number][:20]:
        told = page.box(number, box.row)
        assert told["table"] == "frames"
        sent = told["transmission"]
        assert [sent[name] for name in ("time_ns", "source", "kind")] == [
            told["fields"][name] for name in ("time_ns", "source", "kind")
        ]
        assert page.lanes[number]["robot"] in {each["receiver"] for each in told["receptions"]}
        assert told["bytes"] == "c0ffee"


def test_frames_of_one_instant_are_told_apart(tmp_path: Path):
    rows = made_rows(1, 0, LAST)
    sent = [(0, "DM1", 1), (0, "DM1", 2), (0, "POLL", 3), (3, "DM1", 1)]
    for number, (source, kind, to) in enumerate(sent):
        about = 0, 0, False, False, True, f"0{number}", 7, 1, 1, 3
        rows["transmissions"].append((50, source, kind, to, *about))
        rows["frames"].append((50, source, to, 7, kind, 1, 1, 3, "received", ""))
        if kind == "DM1":
            rows["receptions"].append((50, source, to, -60.0, float(number), "received", ""))
    page = Page(Recorded(written(tmp_path, made_trace(rows))))
    seen = 0
    for lane, boxes in page.everything().items():
        for box in boxes if page.lanes[lane]["what"] in ("sent", "received") else ():
            told = page.box(lane, box.row)
            source, kind, to = sent[box.row]
            assert told["bytes"] == f"0{box.row}"
            if kind == "DM1":
                assert [each["sinr_db"] for each in told["receptions"]] == [box.row]
            assert (told["transmission"]["source"], told["transmission"]["destination"]) == (source, to)
            seen += 1
    assert seen == 2 * len(sent)


def test_a_state_and_a_message_tell_their_fields(page: Page):
    fields = {
        "states": {"state", "detail"},
        "messages": {"payload", "sender"},
        "wakes": {"source"},
        "events": {"event"},
    }
    for what, told in fields.items():
        number = next(number for number, lane in page.lanes.items() if lane["what"] == what)
        box = page.everything()[number][0]
        answer = page.box(number, box.row)
        assert told <= answer["fields"].keys()
        assert answer["receptions"] == []
        assert answer["bytes"] == ("0a0b" if what == "messages" else "")


def test_a_row_of_another_lane_is_no_box(page: Page):
    lanes = [number for number, lane in page.lanes.items() if lane["what"] == "sent"]
    with pytest.raises(UserError, match="there is no box of row"):
        page.box(lanes[0], page.everything()[lanes[1]][0].row)


def test_bytes_are_decoded_if_somebody_can(folder: Path):
    index = opened(folder)
    number = next(number for number, lane in enumerate(index.lanes) if lane.named.what == "sent")
    row = int(index.lanes[number].boxes.rows[0])

    def said(decode: Any) -> Any:
        answer = Kept(index, folder, decode).answer(AskBox(say="box", lane=number, row=row))
        assert isinstance(answer, dict)
        return answer["decoded"]

    def broken(payload: bytes, sent: Any, nearby: Any) -> Any:
        raise ValueError("no message")

    assert said(lambda payload, sent, nearby: {"says": payload.hex(), "routed": sent["routed"]}) == {
        "says": "c0ffee",
        "routed": False,
    }
    assert said(broken) == "cannot be decoded: ValueError: no message"
    assert said(lambda payload, sent, nearby: {1, 2}).startswith("cannot be decoded: TypeError: ")  # no plain data
    assert said(None) is None


def test_files_that_are_not_there_have_no_rows(folder: Path, tmp_path: Path):
    assert Files(tmp_path).at("receptions", 0) == []
    with pytest.raises(UserError, match=r"holds no receptions\.parquet"):
        Files(tmp_path).row("receptions", 0)


# ---------------------------------------------------------------- over a WebSocket


def binary(socket: ClientConnection) -> bytes:
    """Return the next binary message."""
    while True:
        message = socket.recv(timeout=60)
        if isinstance(message, bytes):
            return message


def test_a_page_is_told_the_lanes_once_and_answered_in_order(socket: ClientConnection):
    told = next_of(socket, "lanes")
    numbers = [lane["lane"] for lane in told["lanes"]]
    assert told["peers"] is True
    for number in range(40):
        socket.send(json.dumps(WINDOW | {"number": number, "lanes": numbers, "to_ns": "5000"}))
        found = read(binary(socket))
        assert (found.number, sorted(found.boxes)) == (number, sorted(numbers))
    for number in range(20):
        socket.send(json.dumps(WINDOW | {"number": number}))
    assert [read(binary(socket)).number for _ in range(20)] == list(range(20))
    socket.send(json.dumps(FIND | {"number": 3}))
    found = next_of(socket, "found")
    assert found["number"] == 3
    socket.send(json.dumps(BOX | {"number": 4, "lane": found["lane"], "row": found["row"]}))
    box = next_of(socket, "box")
    assert (box["number"], box["start_ns"]) == (4, found["start_ns"])


def test_a_page_that_asks_what_there_is_not_gets_one_error_and_goes_on(socket: ClientConnection):
    socket.send(json.dumps(WINDOW | {"lanes": [999]}))
    assert next_of(socket, "error")["why"] == "there is no lane 999: expected 0 to 66"
    socket.send(json.dumps(WINDOW | {"lanes": "all"}))
    assert "lanes" in next_of(socket, "error")["why"]
    socket.send(json.dumps(WINDOW))
    assert read(binary(socket)).number == 7


def test_a_page_that_asks_too_much_at_once_is_told(socket: ClientConnection):
    next_of(socket, "lanes")
    count = 3000
    for number in range(count):
        socket.send(json.dumps(WINDOW | {"number": number}))
    answers, errors = [], 0
    while not answers or answers[-1] != 5000:
        message = socket.recv(timeout=60)
        if isinstance(message, bytes):
            answers.append(read(message).number)
            socket.send(json.dumps(WINDOW | {"number": 5000}))
        elif json.loads(message)["say"] == "error":
            errors += 1
            assert "too many questions wait" in message
    assert answers == sorted(answers)
    assert errors
