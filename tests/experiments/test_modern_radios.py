"""modern_radios: its cells, what the stations put on the air, and its claims and table on made-up runs."""

import math
from pathlib import Path

import pandas as pd
import pytest

from cosim.results import RunStore
from cosim.scenario import build
from cosim.simulation import Simulation
from cosim.trace import TRANSMISSIONS
from experiments.modern_radios import figures
from experiments.modern_radios.comparing import NO_CELL, RADIOS, STATIONS, TASKS, Parameters, Radio, Task, measure

ROOT = Path(__file__).parents[2]
NOTHING = pd.DataFrame()


@pytest.mark.parametrize("task", TASKS)
@pytest.mark.parametrize("radio", RADIOS)
def test_each_cell_is_a_scenario_or_has_a_reason(task: Task, radio: Radio) -> None:
    alone, others = (Parameters(task=task, radio=radio, air=air) for air in ("alone", "others"))
    if alone.missing() is not None:
        assert math.isnan(measure({"task": task, "radio": radio}, 1)["time_s"])
        return
    scenario = alone.scenario(1)
    assert scenario.team.size <= 4
    if others.missing() is None:
        kinds = [each.kind for each in others.scenario(1).radios]
        assert len(set(kinds)) == len(kinds) == 3  # the robots' own, and each other technology
        pairs = others.scenario(1).channel.background  # type: ignore[attr-defined]
        assert [pair.radio for pair in pairs] == [1, 1, 2, 2]
    assert getattr(scenario.channel, "background", ()) == ()


@pytest.mark.parametrize(
    ("kind", "data_ns", "answer_ns"),
    [
        # DH5 of 339 bytes and the slot after it; Low Energy: 244 + 7 octets of L2CAP and ATT, 10 of the packet, and an
        # empty packet, after 150 us each; 802.11b: 192 us of preamble and header, 1536 octets; SIFS, an ACK at 2 Mb/s
        ("bluetooth", 6 * 625_000, 0),
        ("ble", (244 + 7 + 10) * 8_000 + 150_000, 80_000 + 150_000),
        ("adhoc", 192_000 + 1536 * 8_000_000 // 11_000 + 10_000, 248_000),
    ],
)
def test_a_pair_is_on_the_air_for_15_percent_of_the_time(kind: str, data_ns: int, answer_ns: int) -> None:
    settings, octets, interval_s = STATIONS[kind]
    share = (data_ns + answer_ns) / (interval_s * 1e9)
    assert share == pytest.approx(0.15, rel=0.02)
    plain = {
        "duration_s": 20,
        "floorplan": {"map": "walls", "bounds_m": [0, 0, 10, 10]},
        "team": {"size": 1},
        "channel": {
            "kind": "radios",
            "radios": [{"kind": "ideal"}, settings],
            "background": [
                {"radio": 1, "places_m": [[1, 1], [5, 1]], "payload_bytes": octets, "interval_s": interval_s}
            ],
        },
        "protocol": {"use": "agents"},
    }
    simulation = Simulation(build(plain, "pair", Path()), 1, (TRANSMISSIONS,))
    metrics = simulation.run().metrics
    sent = pd.DataFrame(simulation.trace.columns(TRANSMISSIONS.name))
    carrying = sent[sent["length"] >= octets]  # of Low Energy with what L2CAP and ATT put before it
    assert len(carrying) > 0.9 * metrics["radio_1_background_received"] > 300
    assert carrying["kind"].nunique() == 1  # one packet a payload


def made(ratios: dict[tuple[str, str, str], float], failed: int = 0) -> pd.DataFrame:
    """Return five runs of each cell: with messages that arrive at once 100 s and a bit; others *ratios* times that."""
    rows = []
    for (task, radio, air), ratio in ratios.items():
        for number in range(5):
            cut = number < failed and radio != "ideal"
            row = {"task": task, "radio": radio, "air": air, "replicate": number, "done": 0.0 if cut else 1.0}
            rows.append(row | {"time_s": ratio * (100.0 + number), "radio_energy_j": math.nan})
    return pd.DataFrame(rows)


def test_claims_hold_fail_and_stay_open() -> None:
    ideal = {("reflection", "ideal", "alone"): 1.0}
    cell = "reflection", "bluetooth", "alone"
    beside = "reflection", "bluetooth", "others"
    assert figures.costs_little("reflection", "bluetooth", made(ideal | {cell: 1.05}), NOTHING)[1] is True
    assert figures.costs_little("reflection", "bluetooth", made(ideal | {cell: 1.2}), NOTHING)[1] is False
    assert figures.costs_little("reflection", "bluetooth", made(ideal | {cell: 1.05}, failed=1), NOTHING)[1] is None
    assert figures.undisturbed("reflection", "bluetooth", made({cell: 2.0, beside: 2.1}), NOTHING)[1] is True
    assert figures.undisturbed("reflection", "bluetooth", made({cell: 1.0, beside: 1.2}), NOTHING)[1] is False
    assert figures.undisturbed("reflection", "bluetooth", NOTHING, NOTHING) == ("-", None)


def test_each_row_has_its_test() -> None:
    rows = pd.read_csv(Path(figures.__file__).parent / "published.csv")
    assert all(hasattr(figures, name) for name in rows["test"])
    assert len(rows) == 2 * 5 * len(RADIOS[1:]) - 5 - 2 * len(NO_CELL)  # light is not disturbed by radio


def test_ratios_have_the_interval_of_student_on_their_logarithms() -> None:
    runs = made({("reflection", "ideal", "alone"): 1.0, ("reflection", "optical", "alone"): 1.0})
    runs = runs[runs["replicate"] < 3].assign(time_s=[10.0, 10.0, 10.0, 10.0, 20.0, 40.0])
    ratio = figures.times(runs, "reflection", "optical", "alone")
    half = 4.302653 * math.log(2) / math.sqrt(3)  # t of two degrees of freedom, 97.5 %
    assert ratio.mean == pytest.approx(2.0)
    assert (ratio.low, ratio.high) == pytest.approx((2.0 * math.exp(-half), 2.0 * math.exp(half)), rel=1e-6)


def test_the_table_tells_every_cell(tmp_path: Path) -> None:
    ideal = {("reflection", "ideal", "alone"): 1.0}
    runs = made(ideal | {("reflection", "802.11b", "others"): 1.5}, failed=2)
    table = figures.table(runs)
    assert "| ideal | 102 s | no data |" in table
    assert "| 802.11b, others on the air | x 1.50 (1.50 to 1.50), 2 of 5 not done |" in table
    assert "| LE broadcasts | no data | no data | needs a link | needs a link | needs a link |" in table
    assert "*needs a link*: aggregation: searchers answer their host alone, which takes a link; pseudonet:" in table
    assert "optical, others on the air |" not in table
    assert table.endswith("optical, others on the air (nothing at 2.4 GHz disturbs it).")
    assert len(table.splitlines()) == 2 + 2 * len(RADIOS) - 2 + 4  # all radios, alone and with others, but for two
    (picture,) = figures.draw(runs, NOTHING, tmp_path)
    assert picture.stat().st_size > 10_000
    assert (tmp_path / "modern_radios.md").read_text() == table + "\n"


@pytest.mark.parametrize("page", ["README.md", "experiments/modern_radios/README.md"])
def test_the_pages_have_the_table_of_the_kept_rows(page: str) -> None:
    table = figures.table(RunStore(ROOT / "results" / "modern_radios").present())
    assert table in (ROOT / page).read_text(encoding="utf-8")
