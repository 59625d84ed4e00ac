"""What robots write to each other: letters and news keep what they say, and anything else is refused."""

import math
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cosim.errors import WireError
from protocols.deployment.messages import messages, status
from protocols.deployment.messages.messages import Facts, Look, Ordered, Picture, Told, YieldRequest
from protocols.deployment.messages.status import News
from protocols.deployment.tasks.facts import Ended, Heard, Record, Switched, Terminated
from protocols.deployment.tasks.orders import Halt, Order, Result, Retreat
from protocols.deployment.tasks.plan import Between, Deployment, Explore, Go, Instant, Photo, Plan, Task

GO = Task(name="play/go", act=Go(robot=1, place_m=(3.0, 4.5), behind=2, behind_m=1.5))
DEPLOY = Task(name="play/deploy", act=Deployment(strategy="wave", robots=(0, 2), places_m=((1.0, 1.0), (2.0, 1.0))))
PLAN = Plan(
    number=3,
    play="play",
    robots=(0, 1, 2),
    root=Task(name="play", subtasks=(GO, DEPLOY, Task(name="play/photo", act=Photo(robot=0)))),
    constraints=(Between(later=Instant(task="play/go"), at_most_s=5.0, why="hurry"),),
)
FACTS = (
    Ended(task="play/go", robot=1, result=Result.DONE, at=7),
    Heard(robot=2, again=False, at=9),
    Switched(strategy="group", at=10),
    Terminated(task="play", at=11),
)
LETTERS = [
    Told(host=0, record=Record(plan=PLAN, start=5, starts_m={0: (1.0, 2.0)}, facts=FACTS), calls=2),
    Facts(plan=3, facts=FACTS),
    Ordered(term=1, order=Order(plan=3, serial=4, task="play/go", robot=1, errand=GO.act)),
    Ordered(term=0, order=Order(plan=3, serial=5, task="x", robot=1, errand=Halt(robot=1))),
    Ordered(term=0, order=Order(plan=3, serial=5, task="x", robot=1, errand=Explore(robots=(1, 2)))),
    Ordered(
        term=0,
        order=Order(plan=3, serial=6, task="x", robot=1, errand=Retreat(robot=1, post_m=(1.0, 1.0), passing=2)),
    ),
    YieldRequest(robot=1, from_m=(1.0, 2.0), way_m=((3.0, 4.0),)),
    Look(request=7),
    Picture(request=7, robot=1, at_m=(1.0, 2.0), heading_rad=0.5, view_rad=1.0, columns_m=(1.5, None, 2.0)),
]


@pytest.mark.parametrize("letter", LETTERS, ids=lambda letter: letter.say)
def test_a_letter_is_read_as_it_was_written(letter: messages.Letter) -> None:
    assert messages.decode(messages.encode(letter), size=3) == letter


@pytest.mark.parametrize(
    ("letter", "text"),
    [
        (LETTERS[7], b'{"say":"look","request":7}'),
        (LETTERS[6], b'{"say":"aside","robot":1,"from_m":[1.0,2.0],"way_m":[[3.0,4.0]]}'),
        (
            LETTERS[3],
            b'{"say":"order","term":0,"order":{"plan":3,"serial":5,"task":"x","robot":1,'
            b'"errand":{"act":"halt","robot":1}}}',
        ),
        (
            Facts(plan=3, facts=FACTS[1:2]),
            b'{"say":"facts","plan":3,"facts":[{"fact":"heard","robot":2,"again":false,"at":9}]}',
        ),
    ],
)
def test_letters_are_these_bytes(letter: messages.Letter, text: bytes) -> None:
    assert messages.encode(letter) == text


@pytest.mark.parametrize("letter", [each for each in LETTERS if not isinstance(each, Look)], ids=lambda each: each.say)
def test_a_letter_that_names_a_robot_of_another_team_is_refused(letter: messages.Letter) -> None:
    if isinstance(letter, Ordered) and isinstance(letter.order.errand, Halt):
        letter = letter.model_copy(update={"order": letter.order.model_copy(update={"errand": Halt(robot=2)})})
    size = 1 if isinstance(letter, YieldRequest | Picture) else 2
    with pytest.raises(WireError, match="is not of the team"):
        messages.decode(messages.encode(letter), size=size)


@pytest.mark.parametrize(
    ("letter", "was", "now"),
    [
        pytest.param(LETTERS[2], b'"behind":2', b'"behind":1', id="behind itself"),
        pytest.param(LETTERS[5], b'"passing":2', b'"passing":1', id="makes room for itself"),
        pytest.param(LETTERS[2], b"[3.0,4.5]", b"[3.0,-2e9]", id="a place too far"),
        pytest.param(LETTERS[6], b"[1.0,2.0]", b"[1.0,1e39]", id="asked from too far"),
        pytest.param(LETTERS[0], b'"0":[1.0,2.0]', b'"0":[1e300,2.0]', id="a start too far"),
        pytest.param(LETTERS[0], b'"at_most_s":5.0', b'"at_most_s":2e9', id="a bound too late"),
        pytest.param(LETTERS[0], b'"label":""', b'"label":"","time_out_s":1e300', id="a time-out too late"),
        pytest.param(LETTERS[0], b'{"act":"photo","robot":0}', b'{"act":"wait","seconds":2e9}', id="a long wait"),
    ],
)
def test_a_letter_that_nobody_could_act_on_is_refused(letter: messages.Letter, was: bytes, now: bytes) -> None:
    data = messages.encode(letter)
    assert data.count(was) >= 1
    assert messages.decode(data, size=3) == letter
    with pytest.raises(WireError):
        messages.decode(data.replace(was, now, 1), size=3)


@pytest.mark.parametrize("number", range(4), ids=["term", "order", "plan", "facts"])
@pytest.mark.parametrize("beyond", [1, 2**30])
def test_a_letter_of_a_term_or_plan_that_no_team_reaches_is_refused(number: int, beyond: int) -> None:
    most = status.MOST_TERM if number == 0 else status.MOST_PLAN
    order = Order(plan=3, serial=5, task="x", robot=1, errand=Halt(robot=1))

    def letter(value: int) -> messages.Letter:
        return (
            Ordered(term=value, order=order),
            Ordered(term=0, order=order.model_copy(update={"plan": value})),
            Told(host=0, record=Record(plan=PLAN.model_copy(update={"number": value}), start=0)),
            Facts(plan=value),
        )[number]

    assert messages.decode(messages.encode(letter(most)), size=3) == letter(most)
    with pytest.raises(WireError, match="a letter of term"):
        messages.decode(messages.encode(letter(most + beyond)), size=3)


@given(st.binary(max_size=80))
def test_any_bytes_are_a_letter_or_refused(data: bytes) -> None:
    try:
        messages.decode(data, size=3)
    except WireError:
        return
    raise AssertionError(f"{data!r} was read as a letter")


def test_a_letter_that_is_too_long_is_refused_unread() -> None:
    with pytest.raises(WireError, match="more than"):
        messages.decode(b" " * (messages.MOST_BYTES + 1), size=3)


numbers = st.floats(-1000.0, 1000.0, width=32)


@given(
    st.builds(
        News,
        host=st.integers(0, 7),
        term=st.integers(0, status.MOST_TERM),
        plan=st.integers(0, status.MOST_PLAN),
        calls=st.integers(0, 255),
        digest=st.integers(0, 0xFFFFFFFF),
        serial=st.none() | st.integers(0, 10**9),
        idle=st.booleans(),
        x_m=numbers,
        y_m=numbers,
        heading_rad=numbers,
        speed_mps=numbers,
        goal_m=st.none() | st.tuples(numbers, numbers),
        task=st.text("abc/-~2", max_size=100),
    )
)
def test_news_are_read_as_they_were_told(news: News) -> None:
    assert status.decode(status.encode(news), size=8) == news


def test_news_are_these_bytes() -> None:
    news = News(1, 2, 3, 4, 5, None, True, 1.0, -2.0, 0.5, 0.0, (1.5, 2.0), "a/b")
    head = "01 0002 00000003 04 00000005 ffffffff 03"
    pose = "3f800000 c0000000 3f000000 00000000 3fc00000 40000000"
    assert status.encode(news) == bytes.fromhex(head + pose) + b"a/b"


def test_of_a_long_name_the_end_is_told() -> None:
    news = News(0, 0, 0, 0, 0, None, True, 0.0, 0.0, 0.0, 0.0, None, "x" * 100 + "/stage-2/robot-1" * 5)
    assert status.decode(status.encode(news), size=8).task == news.task[-status.TASK_BYTES :]


@pytest.mark.parametrize("change", ["host", "term", "plan", "flags", "nan", "short", "long"])
def test_news_that_make_no_sense_are_refused(change: str) -> None:
    data = bytearray(status.encode(News(0, 0, 0, 0, 0, None, True, 1.0, 2.0, 0.0, 0.0, None, "")))
    match change:
        case "host":
            data[0] = 8
        case "term":
            data[1:3] = struct.pack(">H", status.MOST_TERM + 1)
        case "plan":
            data[3:7] = struct.pack(">I", status.MOST_PLAN + 1)
        case "flags":
            data[16] = 8
        case "nan":
            data[17:21] = struct.pack(">f", math.nan)
        case "short":
            del data[-1]
        case "long":
            data += bytes(status.TASK_BYTES + 1)
    with pytest.raises(WireError):
        status.decode(bytes(data), size=8)
