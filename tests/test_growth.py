"""Growth with the number of nodes, as ``python -m benchmarks.growth`` measures, prints and keeps it."""

from collections.abc import Sequence

import pytest

from benchmarks import growth
from benchmarks.growth import BEGIN, COLUMNS, SIZES, Row, Size, command, rows, side_m
from benchmarks.peers.waypoints import Load, scenario
from benchmarks.tables import END, README


def test_all_sizes_are_as_dense():
    assert side_m(500) == 1118.0
    assert [nodes / side_m(nodes) ** 2 for nodes in SIZES] == pytest.approx([500 / 1118.0**2] * 4)
    words = command(2000)
    assert "--nodes=2000" in words
    assert "--side=2236.0" in words
    assert "--neglect=10.0" in words


def test_what_is_neglected_is_what_the_load_says():
    load = Load(nodes=2, side=100.0, seconds=1.0)
    assert scenario(load).channel.neglect_db is None
    assert scenario(load._replace(neglect=10.0)).channel.neglect_db == 10.0


def test_times_are_compared_with_those_of_500_nodes_in_the_same_round():
    rounds = [
        [Size(100, 0.25, 1.0, 150.4), Size(500, 0.5, 4.0, 160.0), Size(5000, 2.0, 50.0, 255.0)],
        [Size(100, 0.5, 2.0, 150.4), Size(500, 1.0, 8.0, 160.0), Size(5000, 4.0, 80.0, 255.0)],  # a slow machine
        [Size(100, 0.25, 1.2, 151.0), Size(500, 0.5, 4.0, 161.0), Size(5000, 2.0, 48.0, 256.0)],
    ]
    assert [*rows(rounds)] == [
        Row("100", "0.25", "1.20", "150", "0.25 (0.25 to 0.3)"),
        Row("500", "0.50", "4.00", "160", "1"),
        Row("5000", "2.00", "50.00", "255", "12 (10 to 12.5)"),
    ]


@pytest.fixture
def measured(monkeypatch, tmp_path) -> list[int]:
    """Measure without running anything, write beside the tests; return the sizes that were measured."""
    seen: list[int] = []

    def measure(nodes: int) -> Size:
        seen.append(nodes)
        return Size(nodes, 0.001 * nodes, 0.01 * nodes, 150.0 + 0.02 * nodes)

    monkeypatch.setattr(growth, "measured", measure)
    monkeypatch.setattr(growth, "README", tmp_path / "README.md")
    monkeypatch.setattr(growth, "FIGURE", tmp_path / "growth.svg")
    return seen


def test_all_sizes_are_measured_and_printed_and_nothing_is_kept_unasked(measured, capsys):
    growth.main(["--rounds", "3"])
    assert tuple(measured) == SIZES * 3
    lines = capsys.readouterr().out.splitlines()
    assert "neglect_db 10; medians of 3 rounds" in lines[0]
    assert lines[-1].split() == ["5000", "5.00", "50.00", "250", "10", "(10", "to", "10)"]
    assert not growth.FIGURE.exists()


def test_table_and_figure_are_kept_if_that_is_asked_for(measured):
    growth.README.write_text(f"before\n{BEGIN}\nold\n{END}\nafter\n")
    growth.main(["--write"])
    assert tuple(measured) == SIZES * 7
    page = growth.README.read_text()
    assert page.startswith(f"before\n{BEGIN}\n")
    assert "| 2000 | 2.00 | 20.00 | 190 | 4 (4 to 4) |" in page
    assert page.endswith(f"{END}\nafter\n")
    assert "old" not in page
    assert growth.FIGURE.read_text().startswith("<?xml")


def test_the_page_has_a_table_of_all_sizes():
    table = README.read_text(encoding="utf-8").partition(BEGIN)[2].partition(END)[0]
    first: Sequence[str] = [line.split(" | ")[0] for line in table.splitlines() if line.startswith("|")]
    assert first == [f"| {name}" for name in (COLUMNS.nodes, "---", *map(str, SIZES))]


def test_a_run_in_a_process_of_its_own_tells_what_it_took(monkeypatch):
    monkeypatch.setattr(growth, "SECONDS", 2.0)
    size = growth.measured(2)
    assert size.nodes == 2
    assert size.run_s > 0.0
    assert 20.0 < size.memory_mb < 4000.0
