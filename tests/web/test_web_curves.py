"""Curves over time against what pandas makes of the tables of a run, recorded and live; and what the page draws."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from cosim.errors import UserError
from cosim.intervals import Interval
from cosim.present import Present
from cosim.scenario import load
from cosim.simulation import Simulation
from cosim.timeline.codes import Codes
from cosim.timeline.curves import Drawn, Parts, curves, series_of, values
from cosim.timeline.growing import Growing
from cosim.timeline.index import opened
from cosim.timeline.queues import COLUMNS, Queues
from cosim.timeline.spectrum import areas
from cosim.trace import TABLES, StoredTable
from cosim.units import MS, S
from cosim.web.live import Tap
from cosim.web.recorded import Recorded
from cosim.web.scenes import scene_of, write_scene
from cosim.web.timeline import AskChannels, AskCurves, Grown
from tests.web.browser import Browser, pixels, tab
from tests.web.served import Served

SCENARIO = Path(__file__).parents[2] / "docs" / "pictures" / "jammer_with_afh.yaml"
END = 9 * S
PARTS = Parts(3_900_000_001, 170_000_003, 31)
"""A window that begins and ends within links, calls and packets."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the trace of four robots that make a piconet, polls included, and of a jammer from 7 s on."""
    folder = tmp_path_factory.mktemp("trace")
    scenario = load(SCENARIO)
    run = Simulation(scenario, 1, tuple(TABLES.values()))
    run.begin()
    run.advance(END)
    run.outcome()
    run.trace.write(folder)
    write_scene(scene_of(scenario, run.floorplan, 1), folder)
    return folder


@pytest.fixture(scope="module", params=["recorded", "live"])
def drawn(request: pytest.FixtureRequest, folder: Path) -> Drawn:
    """Return the lanes of the run: those of its files, and those of a run whose rows come second by second."""
    if request.param == "recorded":
        index, payloads = opened(folder), StoredTable(folder / "payloads.parquet")
        return Drawn(index.lanes, index.codes, queues=Queues({name: payloads.column(name) for name in COLUMNS}))
    growing = Growing(TABLES.values())
    tables = {name: pd.read_parquet(folder / f"{name}.parquet") for name in ("transmissions", "frames", "messages")}
    for name in ("intervals", "payloads"):
        tables[name] = pd.read_parquet(folder / f"{name}.parquet").sort_values("end_ns", kind="stable")
    for now in range(S, END + 2 * S, S):
        new = {}
        for name, table in tables.items():
            ends = table["end_ns" if name in ("intervals", "payloads") else "time_ns"]
            new[name] = [tuple(row) for row in table[(ends >= now - S) & (ends < now)].itertuples(index=False)]
        growing.take(new, Present(min(now, END)))
    return Drawn(growing.lanes, growing.codes, queues=growing.queues)


def table(folder: Path, name: str) -> pd.DataFrame:
    return pd.read_parquet(folder / f"{name}.parquet")


def windows() -> Iterator[tuple[int, int]]:
    """Yield from when to when each part is."""
    for part in range(PARTS.number):
        yield PARTS.start + part * PARTS.step, PARTS.start + (part + 1) * PARTS.step


def per_second(times: "pd.Series[int]") -> list[float]:
    return [float(((times >= low) & (times < high)).sum()) * 1e9 / PARTS.step for low, high in windows()]


def lasting(starts: "pd.Series[int]", ends: "pd.Series[int]") -> list[float]:
    """Return how much of each part the rows take, added up one by one."""
    return [
        sum(max(0, min(end, high) - max(start, low)) for start, end in zip(starts, ends, strict=True)) / PARTS.step
        for low, high in windows()
    ]


def mean(drawn: Drawn, name: str, robot: int | None = None) -> Any:
    found = values(name, drawn, PARTS, robot)
    assert found is not None
    return found.mean


@pytest.mark.parametrize("robot", [None, 0, 2])
def test_counts_are_the_rows_of_the_tables(drawn: Drawn, folder: Path, robot: int | None):
    messages, frames, sent = (table(folder, name) for name in ("messages", "frames", "transmissions"))
    lost = frames[(frames.destination >= 0) & (frames.outcome != "received")]
    of = slice(None) if robot is None else robot
    expected = {
        "delivered": messages.set_index("source").time_ns,
        "lost": lost.set_index("destination").time_ns,
        "sent": sent.set_index("source").time_ns,
    }
    for name, times in expected.items():
        rows = times if robot is None else times[times.index == of]
        assert mean(drawn, name, robot) == pytest.approx(per_second(rows)), name
    assert per_second(lost.time_ns)[20] > 10


@pytest.mark.parametrize("robot", [None, 2])
def test_levels_are_the_time_that_rows_last(drawn: Drawn, folder: Path, robot: int | None):
    intervals, sent = table(folder, "intervals"), table(folder, "transmissions")
    if robot is not None:
        intervals, sent = intervals[intervals.robot == robot], sent[sent.source == robot]
    for state in ("slave", "page", "page_scan", "inquiry_backoff"):
        rows = intervals[intervals.state == state]
        if f"state:{state}" in [each.name for each in curves(drawn)]:
            assert mean(drawn, f"state:{state}", robot) == pytest.approx(lasting(rows.start_ns, rows.end_ns)), state
    expected = lasting(sent.time_ns, sent.time_ns + sent.duration_ns)
    assert mean(drawn, "sending", robot) == pytest.approx(expected)
    assert max(expected) > 0.005


@pytest.mark.parametrize("robot", [None, 1])
def test_poll_gaps_are_those_between_packets_of_a_master_to_a_slave(drawn: Drawn, folder: Path, robot: int | None):
    intervals, sent = table(folder, "intervals"), table(folder, "transmissions")
    links = intervals[intervals.state == "slave"]
    gaps: list[tuple[int, int]] = []
    for link in links.itertuples():
        master = int(link.detail.split()[0].removeprefix("master="))
        to_slave = sent[(sent.source == master) & (sent.destination == link.robot)]
        polls = to_slave.time_ns[(to_slave.time_ns >= link.start_ns) & (to_slave.time_ns < link.end_ns)].sort_values()
        if robot is None or robot == link.robot:
            gaps += zip(polls[1:], polls.diff()[1:] / MS, strict=True)
    found = values("poll_gap", drawn, PARTS, robot)
    assert found is not None
    for part, (low, high) in enumerate(windows()):
        here = [gap for end, gap in gaps if low <= end < high]
        told = [column[part] for column in found]
        if here:
            assert told == pytest.approx([sum(here) / len(here), min(here), max(here)])
        else:
            assert np.isnan(told).all()
    assert len(gaps) > 150
    assert np.isnan(found.mean[0])  # no link yet: no gap is not a gap of 0


# ---------------------------------------------------------------- queues


def lengths(payloads: pd.DataFrame, low: int, high: int) -> list[float]:
    """Return mean, least and greatest of how many of *payloads* are held in [low, high), looked at between changes."""
    changes = pd.concat([payloads.time_ns, payloads.end_ns])
    edges = [low, *sorted(set(changes[(changes > low) & (changes < high)])), high]
    held = [int(((payloads.time_ns <= at) & (payloads.end_ns > at)).sum()) for at in edges[:-1]]
    mean = sum(number * length for number, length in zip(held, np.diff(edges).tolist(), strict=True)) / (high - low)
    return [mean, min(held), max(held)]


@pytest.mark.parametrize("robot", [None, 0, 2])
def test_queues_are_as_long_as_radios_hold_payloads(drawn: Drawn, folder: Path, robot: int | None):
    payloads = table(folder, "payloads")
    payloads = payloads if robot is None else payloads[payloads.source == robot]
    found = values("queue_length", drawn, PARTS, robot)
    assert found is not None
    for part, (low, high) in enumerate(windows()):
        assert [column[part] for column in found] == pytest.approx(lengths(payloads, low, high)), part
    assert found.most is not None
    assert max(found.most) >= 3 - (robot or 0)
    assert found.mean[0] == 0


@pytest.mark.parametrize("robot", [None, 0, 2])
def test_messages_wait_from_their_acceptance_to_their_first_frame(drawn: Drawn, folder: Path, robot: int | None):
    payloads = table(folder, "payloads")
    payloads = payloads[payloads.begun_ns >= 0]
    payloads = payloads if robot is None else payloads[payloads.source == robot]
    found = values("message_wait", drawn, PARTS, robot)
    assert found is not None
    for part, (low, high) in enumerate(windows()):
        here = payloads[(payloads.begun_ns >= low) & (payloads.begun_ns < high)]
        waits = (here.begun_ns - here.time_ns) / MS
        told = [column[part] for column in found]
        if len(waits):
            assert told == pytest.approx([waits.mean(), waits.min(), waits.max()])
        else:
            assert np.isnan(told).all()
    assert np.nansum(found.mean) > 5


def test_a_run_under_way_tells_of_what_is_held_now(folder: Path):
    run = Simulation(load(SCENARIO), 1, tuple(TABLES.values()), Tap)
    trace: Any = run.trace
    grown = Grown(trace.tables.values())
    payloads, kept = table(folder, "payloads"), 0
    run.begin()
    for now in range(4_850_000_000, 5_300_000_000, 17_000_001):
        run.advance(now)
        grown.take(trace.grown(), run.present)
        asked = {"from_ns": str(now - 50 * MS), "to_ns": str(now), "step_ns": str(5 * MS)}
        told = grown.answer(AskCurves(say="curves", number=1, names=["queue_length", "message_wait"], **asked))
        assert isinstance(told, dict)
        length, wait = told["curves"]
        before = payloads[payloads.time_ns < now]
        for part in range(10):
            low = now - 50 * MS + part * 5 * MS
            expected = lengths(before, low, low + 5 * MS)
            assert [length[name][part] for name in ("mean", "least", "most")] == pytest.approx(expected)
            begun = before[(before.begun_ns >= low) & (before.begun_ns < low + 5 * MS)]
            waited_ms = (begun.begun_ns - begun.time_ns).mean() / MS
            assert wait["mean"][part] == (None if begun.empty else pytest.approx(waited_ms))
        kept += int((before.end_ns > now).sum())
    assert kept > 5
    lanes = grown.told(None)[0]
    assert lanes is not None
    units = {each["name"]: each["unit"] for each in lanes["curves"]}
    assert (units["queue_length"], units["message_wait"]) == ("payloads", "ms")


# ---------------------------------------------------------------- RF channels


JAMMED = range(30, 51)


def asked(folder: Path, robot: int | None, window: tuple[int, int]) -> dict[str, Any]:
    """Return what the timeline tells of channels."""
    question = AskChannels(
        say="channels", number=5, robot=robot, from_ns=str(window[0]), to_ns=str(window[1])
    )  # fmt: skip
    told = Recorded(folder).timeline.answer(question)
    assert isinstance(told, dict)
    return told


@pytest.mark.parametrize("robot", [None, 0, 2])
def test_channels_are_left_out_as_the_master_says_and_no_frame_is_there(folder: Path, robot: int | None):
    told = asked(folder, robot, (0, END))
    jams, sets = ([area for area in told["areas"] if area["what"] == what] for what in ("jammer", "afh"))
    (jam,) = jams
    assert (jam["start_ns"], jam["end_ns"], jam["robot"]) == (str(7 * S), str(END), -1)
    assert jam["channels"] == [[JAMMED[0], JAMMED[-1]]]
    sent = table(folder, "transmissions")
    piconet = sent[~sent.kind.isin(["ID", "FHS"])]
    assert len(sets) >= 2
    for area in sets:
        out = {channel for first, last in area["channels"] for channel in range(first, last + 1)}
        assert area["robot"] == 0
        assert out < set(JAMMED)
        within = piconet[(piconet.time_ns >= int(area["start_ns"])) & (piconet.time_ns < int(area["end_ns"]))]
        assert len(within) > 15
        assert out.isdisjoint(within.channel)


def test_shares_of_lost_frames_are_those_of_the_table(folder: Path):
    window = 7 * S, 8_765_432_101
    frames = table(folder, "frames")
    frames = frames[(frames.time_ns >= window[0]) & (frames.time_ns < window[1])]
    told = {channel: (count, lost) for channel, count, lost in asked(folder, None, window)["channels"]}
    each = frames.assign(lost=frames.outcome != "received").groupby(["channel", "time_ns", "source", "kind"]).lost.any()
    for channel, (count, lost) in told.items():
        here = each[each.index.get_level_values("channel") == channel]
        assert (count, lost) == (len(here), int(here.sum())), channel
    assert sum(lost for channel, (_, lost) in told.items() if channel in JAMMED) > 30


def test_areas_of_a_run_under_way_are_those_of_its_rows(folder: Path):
    growing = Growing(TABLES.values())
    rows = table(folder, "intervals")
    done = [tuple(row) for row in rows[rows.state == "afh"].itertuples(index=False)]
    under_way = [Interval(*row) for row in rows[rows.state == "jammer"].itertuples(index=False)]
    growing.take({"intervals": done}, Present(END, under_way))
    found, more = areas(growing.lanes, growing.codes, growing, (0, END))
    expected = asked(folder, None, (0, END))["areas"]
    assert [(each.what, str(each.start), each.channels) for each in found] == [
        (each["what"], each["start_ns"], each["channels"]) for each in expected
    ]
    assert more == 0


# ---------------------------------------------------------------- metrics


def test_a_metric_is_the_mean_of_its_steps_over_the_time(folder: Path):
    rows = table(folder, "metrics")
    rows = rows[rows.metric == "coverage"]
    step = 700_000_001
    told = Recorded(folder).timeline.answer(
        AskCurves(
            say="curves",
            number=1,
            names=["metric:coverage"],
            from_ns=str(S + 5),
            to_ns=str(9 * step),
            step_ns=str(step),
        )
    )
    assert isinstance(told, dict)
    (curve,) = told["curves"]
    begins = [S + 5 + part * step for part in range(len(curve["mean"]))]
    for part, begin in enumerate(begins):
        inside = rows[(rows.time_ns > begin) & (rows.time_ns < begin + step)]
        times = [begin, *inside.time_ns, begin + step]
        held = [rows[rows.time_ns <= begin].value.iloc[-1], *inside.value]
        mean = sum(value * (end - start) for value, start, end in zip(held, times, times[1:], strict=False)) / step
        found = [curve[name][part] for name in ("mean", "least", "most")]
        assert found == pytest.approx([mean, min(held), max(held)])
    assert len(rows) > 3


def test_a_metric_of_robots_is_that_of_the_chosen_one_or_the_sum():
    rows = [(0, 0, "battery_j", 5.0, "J"), (10, 1, "battery_j", 7.0, "J"), (20, 0, "battery_j", 1.0, "J")]
    names = ("time_ns", "source", "metric", "value", "unit")
    series = series_of(dict(zip(names, zip(*rows, strict=True), strict=True)))
    drawn = Drawn([], Codes(), series)
    assert [(each.name, each.unit) for each in curves(drawn)] == [("metric:battery_j", "J")]
    for robot, expected in ((0, [5, 5, 1]), (1, [np.nan, 7, 7]), (None, [np.nan, 12, 8]), (2, None)):
        found = values("metric:battery_j", drawn, Parts(0, 10, 3), robot)
        assert (None if found is None else found.mean.tolist()) == pytest.approx(expected, nan_ok=True), robot


@pytest.mark.parametrize("words", [("0", "-1", "1"), ("0", "10", "0"), ("0", "100000", "1")])
def test_parts_that_cannot_be_are_told(folder: Path, words: tuple[str, str, str]):
    asked = dict(zip(("from_ns", "to_ns", "step_ns"), words, strict=True))
    with pytest.raises(UserError, match="curves: expected"):
        Recorded(folder).timeline.answer(AskCurves(say="curves", number=1, names=["lost"], **asked))


def test_what_there_is_none_of_is_left_out(folder: Path):
    names = ["no", "state:no", "metric:no", "sent:no", "state:", "queue", "lost"]
    asked = AskCurves(say="curves", number=7, names=names, from_ns="0", to_ns="10", step_ns="3")
    told = Recorded(folder).timeline.answer(asked)
    assert isinstance(told, dict)
    assert told["number"] == 7
    assert told["curves"] == [{"name": "lost", "mean": [0.0] * 4, "least": None, "most": None}]


@pytest.mark.slow
def test_curves_are_chosen_and_told(browser: Browser, folder: Path):
    served = Served(Recorded(folder, playing=False))
    with tab(browser, served, own=True) as page:
        assert not page.locator(".tl-plots").is_visible()  # lanes come first where there is little room
        page.locator(".tl-overlay").press("v")
        page.wait_for_function("() => document.querySelector('.tl-values').textContent.includes('lost/s')")
        for name in ("state:slave", "queue_length", "message_wait"):
            page.locator(f".tl-curves button[value='{name}']").press("Enter")
        chosen = "curves=delivered,lost,state:slave,queue_length,message_wait"
        page.wait_for_function("words => decodeURIComponent(location.hash).includes(words)", arg=chosen)
        page.wait_for_function("() => document.querySelector('.tl-values').textContent.includes('slave')")
        page.wait_for_function("() => document.querySelector('.tl-values').textContent.includes(' payloads')")
        ranges = page.locator(".tl-values div span").all_inner_texts()
        assert ranges[2] == "0 to 3"
        assert [each.split(" ")[-1] for each in ranges[3:]] == ["payloads", "ms"]
        page.locator("summary", has_text="Curves as a table").click()
        for title in ("slave", "queue length (payloads)", "message wait (ms)"):
            page.wait_for_selector(f".tl-listing th:has-text('{title}')")
        page.evaluate("document.querySelector('.tl-plots canvas').id = 'curves'")
        assert pixels(page, "accent", "curves") > 20
        assert pixels(page, "bad", "curves") > 20
        lanes, drawn = (page.locator(part).bounding_box() for part in (".tl-stage", ".tl-plots canvas"))
        assert (drawn["x"], drawn["width"]) == (pytest.approx(lanes["x"], abs=1), pytest.approx(lanes["width"], abs=1))
        strips = "document.getElementById('timeline').timeline.boxes().filter(({ what }) => what === 'piconet').length"
        page.locator(".tl-labels li button").last.press("Enter")  # scrolls there
        page.wait_for_function(f"() => {strips} >= 3")  # each member of the only piconet
        page.locator(".tl-overlay").press("b")
        page.wait_for_function(f"() => {strips} === 0 && location.hash.includes('piconets=no')")
        page.locator(".tl-overlay").press("c")
        page.locator("summary", has_text="Table of the window").click()
        page.wait_for_selector(".tl-listing th:has-text('left out by the piconet of robot 0')")
        page.evaluate("document.querySelector('.tl-shares canvas').id = 'shares'")
        assert pixels(page, "bad", "shares") > 20
        page.locator(".tl-overlay").press("g")  # higher lanes have their names beside them
        last = page.locator(".tl-labels li.channel", has_text="0: 2402 MHz").last
        stage, label = (part.bounding_box() for part in (page.locator(".tl-stage"), last))
        assert label["y"] + label["height"] / 2 == pytest.approx(stage["y"] + stage["height"], abs=6)
    served.stop()
