"""packet_throughput: rates against the reference's table, and what a point of it costs."""

import math
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from pydantic import ValidationError

from cosim.channels.bluetooth.settings import BluetoothSettings
from cosim.channels.propagation import PropagationSettings
from cosim.errors import CosimError
from cosim.experiment import load_experiment
from cosim.report.sweep_report import report
from cosim.sweep import run_sweep
from cosim.units import SLOT, S
from experiments.packet_throughput import figures
from experiments.packet_throughput.throughput import (
    Parameters,
    delivered_within,
    distance_m,
    measure,
    pairs_of_a_run,
)
from tests.checkout import EXPERIMENTS

SWEEP = EXPERIMENTS / "packet_throughput" / "sweep.yaml"


@pytest.mark.parametrize(
    ("packet", "slots", "rate_kbps"),
    [("DM1", 2, 108.8), ("DH1", 2, 172.8), ("DM3", 4, 387.2), ("DH3", 4, 585.6), ("DM5", 6, 477.8), ("DH5", 6, 723.2)],
)
def test_without_errors_a_link_carries_the_best_rate_of_its_type(packet: str, slots: int, rate_kbps: float):
    """The specification's asymmetric rates; every packet of a window of 100 is acknowledged."""
    assert delivered_within(Parameters(packet=packet, es_n0_db=30), 100 * slots * SLOT, 1) == 100
    found = measure({"packet": packet, "es_n0_db": 30, "least_pairs": 100}, 1)
    assert found["throughput_kbps"] == pytest.approx(rate_kbps, abs=0.1)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("packet", "es_n0_db", "table_kbps", "best_kbps", "pairs"),
    [
        ("DM1", 8, 8.3, 108.8, 12_000),  # 10.0 without the access code and header of the return packet
        ("DH1", 12, 105.0, 172.8, 4000),
        ("DM3", 11, 280.4, 387.2, 4000),
        ("DH3", 13, 237.6, 585.6, 4000),
        ("DM5", 10, 27.5, 477.9, 6000),
        ("DH5", 14, 505.0, 723.2, 4000),
    ],
)
def test_rates_are_those_of_the_reference(
    packet: str, es_n0_db: float, table_kbps: float, best_kbps: float, pairs: int
):
    found = measure({"packet": packet, "es_n0_db": es_n0_db, "least_pairs": pairs, "most_pairs": pairs}, 7)
    share = table_kbps / best_kbps
    error_kbps = best_kbps * math.sqrt(share * (1 - share) / pairs)
    assert found["pairs"] == pairs
    assert found["throughput_kbps"] == pytest.approx(table_kbps, abs=3.5 * error_kbps + 0.05)  # printed to 0.1
    assert found["closed_form_kbps"] == pytest.approx(table_kbps, abs=0.05)
    assert found["difference_kbps"] == found["throughput_kbps"] - found["closed_form_kbps"]


def test_devices_are_as_far_apart_as_the_wanted_power_demands():
    settings = BluetoothSettings(propagation=PropagationSettings(), power_class=3, sensitivity_dbm=-80)
    # a bit error rate of 1e-3 at -80 dBm and about 12.65 dB, here to 0.05 dB; 0 dBm - 40.2 - 20 log10 d = -80
    assert distance_m(settings, 12.65) == pytest.approx(10 ** (39.8 / 20), rel=6e-3)
    assert distance_m(settings, 6.63) == pytest.approx(2 * distance_m(settings, 12.65), rel=1e-3)


def test_a_point_takes_the_packets_that_its_standard_error_needs():
    # DH1 at 12 dB: p = 105.0 / 172.8 = 0.6076, allowed 1.05 kb/s, wanted 0.3 of it: (172.8 / 0.315)^2 p (1 - p)
    needed = (172.8 / 0.315) ** 2 * 0.6076 * 0.3924
    assert pairs_of_a_run(Parameters(packet="DH1", es_n0_db=12, runs=1)) == pytest.approx(needed, rel=5e-3)
    assert pairs_of_a_run(Parameters(packet="DH1", es_n0_db=12, runs=20)) == pytest.approx(needed / 20, rel=5e-3)
    assert pairs_of_a_run(Parameters(packet="DH1", es_n0_db=30)) == 1000
    assert pairs_of_a_run(Parameters(packet="DH3", es_n0_db=12, most_pairs=5000)) == 5000


def test_a_link_that_no_receiver_would_notice_is_refused():
    with pytest.raises(ValidationError, match="es_n0_db"):
        Parameters(es_n0_db=0)


@pytest.mark.slow
def test_a_link_on_which_nothing_is_heard_any_more_is_lost_and_ends_the_run():
    # at 1 dB more than a quarter of all bits are wrong; a link is lost after 20 s without a frame
    with pytest.raises(CosimError, match=r"the link was lost at 2\d\."):
        delivered_within(Parameters(packet="DH1", es_n0_db=1), 25 * S, 1)


@pytest.mark.slow
def test_some_points_of_packet_throughput_are_reported(tmp_path: Path):
    sets = ["es_n0_db=14", "least_pairs=50", "most_pairs=50"]
    experiment = load_experiment(SWEEP, sets, quick=True, replicates=2)
    assert run_sweep(experiment, tmp_path, jobs=1).failures == ()
    made = report(tmp_path)
    found = {verdict.id: verdict for verdict in made.verdicts}
    assert found["dm1"].ours.startswith("14 dB 108.8")
    assert found["closed_form"].ours.startswith("the worst of 6 points")
    assert found["best"].ours in ("14 dB DH5", "14 dB DH3", "14 dB DM5")
    assert {path.name for path in made.figures} == {"throughput_kbps.png", "throughput.png"}


def runs(**rates: float) -> pd.DataFrame:
    """Two runs of each type at 11 dB with these rates."""
    known = {"DM1": 103.0, "DH1": 44.2, "DM3": 280.4, "DH3": 0.1, "DM5": 265.5, "DH5": 0.0} | rates
    rows = [
        {"packet": packet, "es_n0_db": 11, "throughput_kbps": rate, "closed_form_kbps": expected}
        for packet, rate, expected in zip(known, known.values(), (103.0, 44.2, 280.4, 0.1, 265.5, 0.0), strict=True)
        for _ in range(2)
    ]
    frame = pd.DataFrame(rows)
    return frame.assign(difference_kbps=frame["throughput_kbps"] - frame["closed_form_kbps"])


@pytest.mark.parametrize(
    ("rates", "holds"), [({}, True), ({"DM3": 283.1}, True), ({"DM3": 283.3}, False), ({"DH5": 0.11}, False)]
)
def test_a_point_may_be_1_percent_or_a_tenth_of_a_kilobit_away(rates: dict[str, float], holds: bool):
    nothing = pd.DataFrame()
    assert figures.within_closed_form(runs(**rates), nothing)[1] is holds
    assert (figures.dm3(runs(**rates), nothing)[1], figures.dh5(runs(**rates), nothing)[1]) == (
        rates.get("DM3") != 283.3,
        rates.get("DH5") is None,
    )


def test_the_best_type_is_told_where_all_types_were_run():
    nothing = pd.DataFrame()
    assert figures.best_types(runs(), nothing) == ("11 dB DM3", True)
    assert figures.best_types(runs(DM5=290.0), nothing) == ("11 dB DM5", False)
    assert figures.best_types(runs().query("packet != 'DH1'"), nothing) == ("-", None)


@pytest.mark.parametrize("rows", [pd.DataFrame(), pd.DataFrame({"packet": ["DM1"], "es_n0_db": [11]})])
def test_figures_without_data_answer_that_there_is_none(rows: pd.DataFrame):
    names = ("within_closed_form", "dm1", "dh1", "dm3", "dh3", "dm5", "dh5", "best_types")
    assert {getattr(figures, name)(rows, rows) for name in names} == {("-", None)}
    assert figures.draw(rows, rows, Path()) == []
    assert np.isclose(figures.tolerance_kbps(5.0), 0.1)
