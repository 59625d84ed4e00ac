"""The page of one experiment: what was asked, what the paper says, what we found, and how to find it again."""

import base64
import json
import math
import re
import shlex
from collections.abc import Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any, Final

import pandas as pd
import yaml

from cosim.report.claims import Claim, Verdict, source_folder
from cosim.report.markup import Html, first_section, identifier, joined, markdown, tag
from cosim.report.page import (
    chance_of,
    claims_table,
    counts,
    document,
    frame_table,
    limits_of,
    scrolling,
    terms,
    verdict_word,
)
from cosim.report.repeating import sweep_command
from cosim.report.saving import NUMBERS
from cosim.report.sensitivity import design_of, design_rows
from cosim.report.sweep_report import Report
from cosim.results import RunStore, versions
from cosim.trace import drafted
from cosim.upkeep import told_time

MOST_FAILURES: Final = 200
"""The most runs that failed which a page names."""
MOST_VALUES: Final = 20
"""The most numbers of an axis that a page names one by one."""
COLUMNS: Final = ("verdict", "claim", "published", "ours", "why")


def experiment_page(folder: Path, made: Report) -> str:
    """Return the page about the results in *folder*, of which *made* is the report."""
    return _Page(folder, made).text()


def write_page(path: Path, folder: Path, made: Report) -> None:
    """Write the page about the results in *folder*, of which *made* is the report, to *path*."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with drafted(path) as draft:
        draft.write_text(experiment_page(folder, made), encoding="utf-8")


class _Page:
    """What a page is made of, read once."""

    def __init__(self, folder: Path, made: Report) -> None:
        self._folder = folder
        self._made = made
        self._sweep = RunStore(folder).description()
        self._runs = RunStore(folder).present()
        self._source = source_folder(self._sweep)

    def text(self) -> str:
        """Return the page."""
        sections = {
            "question": ("The question", self._question()),
            "claims": ("Claims: ours beside the published", self._claims()),
            "figures": ("Figures", self._figures()),
            "tables": ("Tables", self._tables()),
            "parameters": ("Parameters", self._parameters()),
            "failures": ("Runs that failed", self._failures()),
            "repeat": ("How to repeat it", self._repeat()),
        }
        there = {id_: (heading, contents) for id_, (heading, contents) in sections.items() if contents}
        head = [counts(verdict.verdict for verdict in self._made.verdicts), tag("p", self._size(), class_="quiet")]
        return document(self._made.name, "Experiment", _sentence(self._sweep.about), head, there)

    # ---------------------------------------------------------------- sections

    def _question(self) -> Html:
        """Return the first section of the experiment's README."""
        readme = self._source / "README.md" if self._source else None
        if readme is None or not readme.is_file():
            return Html()
        return markdown(first_section(readme.read_text(encoding="utf-8", errors="replace")))

    def _claims(self) -> Html:
        pairs = list(zip(self._made.claims, self._made.verdicts, strict=True))
        if not pairs:
            return tag("p", "No published.csv beside the experiment: nothing to hold ours against.")
        rows = [
            (
                identifier("claim", verdict.id),
                (verdict_word(verdict.verdict), _claim(claim), verdict.published, verdict.ours, _why(claim, verdict)),
            )
            for claim, verdict in pairs
        ]
        verdicts = self._made.verdicts
        return joined([*chance_of(verdicts), *limits_of(verdicts), claims_table("Claims", COLUMNS, rows)])

    def _figures(self) -> Html:
        return joined([_figure(path, number) for number, path in enumerate(self._made.figures, start=1)])

    def _tables(self) -> Html:
        parts = [joined([tag("h3", title), frame_table(table, title)]) for title, table in self._made.tables.items()]
        known = self._columns()
        if parts and len(known):
            told = tag("summary", "What the columns are")
            parts.append(tag("details", told, frame_table(known, "What the columns are")))
        return joined(parts)

    def _columns(self) -> pd.DataFrame:
        """Return unit and meaning of the columns in the tables, as far as they are declared."""
        shown = {str(column) for table in self._made.tables.values() for column in table}
        found = {}
        for table in ("runs", "observations"):
            for column in RunStore(self._folder).present_rows(table).schema:
                notes = column.metadata or {}
                if column.name in shown - set(self._sweep.axes) and notes.get(b"meaning"):
                    found[column.name] = (notes.get(b"unit", b"").decode(), notes[b"meaning"].decode())
        rows = [(name, *told) for name, told in found.items()]
        return pd.DataFrame(rows, columns=["column", "unit", "meaning"])

    def _parameters(self) -> Html:
        axes = pd.DataFrame(
            [(name, axis.path or "several settings", _values(axis.values)) for name, axis in self._sweep.axes.items()],
            columns=["axis", "setting", "values"],
        )
        design = f"{self._design()}, the same seeds for each: differences are paired by seed"
        parts = [tag("h3", "Axes"), frame_table(axes, "Axes")] if len(axes) else []
        parts += [tag("p", f"Design: {design}.")] if len(axes) else []
        if self._base is not None:
            text = yaml.safe_dump(self._base, sort_keys=False, allow_unicode=True)
            code = tag("pre", tag("code", text), tabindex="0", role="group", aria_label="settings")
            parts.append(tag("details", tag("summary", "All settings before the axes"), code))
        return joined(parts)

    def _design(self) -> str:
        """Return which combinations of the axes' values were run."""
        arms = len(self._sweep.configurations)
        every = math.prod(len(axis.values) for axis in self._sweep.axes.values())
        drawn = design_rows(self._sweep)
        kind = design_of(drawn)
        if arms == every:
            return "every combination of the axes' values"
        if drawn:
            return f"{len(drawn)} points of a design{f' of the kind {kind}' if kind else ''}"
        return f"{_counted(arms, 'arm')}, not all {every} combinations of the axes' values"

    def _failures(self) -> Html:
        failed = self._runs[self._runs["status"] != "done"]
        if failed.empty:
            return tag("p", "None.")
        shown = [*(axis for axis in self._sweep.axes if axis in failed), "seed", "error"]
        left = len(failed) - MOST_FAILURES
        told = tag("p", f"{len(failed)} of {len(self._runs)} runs; no estimate and no claim counts them.")
        more = tag("p", f"and {left} more, in the table runs", class_="quiet") if left > 0 else ""
        return joined([told, frame_table(failed[shown].head(MOST_FAILURES), "Runs that failed"), more])

    def _repeat(self) -> Html:
        command = sweep_command(self._sweep, self._base, self._folder)
        report = shlex.join(["cosim", "report", str(self._folder), "-o", "report.html"])
        if command is None:
            told = "No command makes these runs: the experiment's files have changed since, or are not here."
            how = tag("p", told)
        else:
            code = tag("code", f"{command}\n{report}")
            how = tag("pre", code, tabindex="0", role="group", aria_label="commands")
        return joined([how, terms(self._makings)])

    # ---------------------------------------------------------------- facts

    def _size(self) -> str:
        there = f"{self._made.runs} of {self._sweep.runs} runs" if self._made.missing else f"{self._sweep.runs} runs"
        arms, replicates = len(self._sweep.configurations), self._sweep.replicates
        return f"{there}: {_counted(arms, 'arm')}, {_counted(replicates, 'replicate')}; {self._made.failures} failed"

    @cached_property
    def _metadata(self) -> dict[str, list[str]]:
        """The metadata of the parts that hold the present runs, and each's values."""
        import pyarrow.parquet as pq

        found: dict[str, dict[str, None]] = {}
        for part in sorted((self._folder / "runs").glob("*.parquet")):
            file = pq.ParquetFile(part)
            made = file.read(["code"])["code"].to_pylist()
            if {*self._sweep.codes, *self._sweep.accepted}.intersection(made):
                for key, value in (file.schema_arrow.metadata or {}).items():
                    found.setdefault(key.decode(), {})[value.decode()] = None
        return {key: list(values) for key, values in found.items()}

    @cached_property
    def _base(self) -> dict[str, Any] | None:
        """The settings before the axes; None if several sweeps had others."""
        known = self._metadata.get("scenario", [])
        return json.loads(known[-1]) if known else None

    @cached_property
    def _makings(self) -> Mapping[str, object]:
        seeds = sorted(set(self._runs["seed"]))
        libraries = {name: self._metadata.get(f"version.{name}", []) for name in versions()}
        told = {
            "seeds": f"{_ranges(seeds)}, the same for every arm" if seeds else "none",
            "replicates": self._sweep.replicates,
            "time the runs took": told_time(self._runs["wall_s"].sum()),
            "digest of the code": tag("code", self._sweep.code),
            "commit": tag("code", ", ".join(filter(None, self._metadata.get("commit", []))) or "not known"),
        }
        known = {name: " and ".join(filter(None, found)) for name, found in libraries.items()}
        return told | {name: found for name, found in known.items() if found}


# ---------------------------------------------------------------- parts


def _claim(claim: Claim) -> Html:
    where = ", ".join(filter(None, (f"paper {claim.paper}" if claim.paper.isdigit() else claim.paper, claim.section)))
    return joined([tag("span", claim.claim), tag("small", tag("code", claim.id), f" · {where}")])


def _why(claim: Claim, verdict: Verdict) -> Html:
    """Return the reason of *verdict*, and of what it was asked; what a function asks is in its reason."""
    if not claim.quantity or claim.test.isidentifier():
        return joined([verdict.reason])
    where = [" where ", tag("code", claim.where)] if claim.where else []
    return joined([verdict.reason, tag("small", f"{claim.test}; the mean of ", tag("code", claim.quantity), *where)])


def _figure(path: Path, number: int) -> Html:
    """Return the figure in the file *path*: what was drawn as SVG, if it is there, and the numbers behind it."""
    name = path.stem.replace("_", " ")
    svg, numbers = path.with_suffix(".svg"), path.with_suffix(NUMBERS)
    table = pd.read_csv(numbers) if numbers.is_file() else pd.DataFrame()
    if svg.is_file():
        picture = _inline(svg.read_text(encoding="utf-8"), f"f{number}", _described(name, table))
    else:
        data = base64.b64encode(path.read_bytes()).decode()
        picture = tag("img", src=f"data:image/png;base64,{data}", alt=name)
    parts = [tag("figcaption", name), scrolling(picture, f"figure {name}")]
    if len(table):
        parts.append(_numbers(table, numbers))
    return tag("figure", *parts)


def _inline(svg: str, prefix: str, label: str) -> Html:
    """Return *svg* for the middle of a page: its ids begin with *prefix*, so that no other figure has them."""
    svg = re.sub(r'\bid="', f'id="{prefix}-', svg)
    svg = re.sub(r'href="#', f'href="#{prefix}-', svg)
    svg = re.sub(r"url\(#", f"url(#{prefix}-", svg)
    title = tag("title", label, id=f"{prefix}-title")
    return Html(
        re.sub(
            r"<svg ([^>]*)>",
            lambda found: f'<svg role="img" aria-labelledby="{prefix}-title" {found[1]}>{title}',
            svg,
            count=1,
        )
    )


def _described(name: str, table: pd.DataFrame) -> str:
    """Return what somebody who does not see a figure is told of it."""
    parts = [name]
    for column in ("panel", "series"):
        labels = [str(each) for each in table.get(column, pd.Series(dtype=str)).dropna().unique()]
        if labels:
            parts.append(f"{_counted(len(labels), column)}: {', '.join(labels[:12])}".replace("seriess", "series"))
    return "; ".join([*parts, "the numbers stand below"] if len(table) else parts)


def _numbers(table: pd.DataFrame, file: Path) -> Html:
    """Return *table*, the numbers in a figure, to be opened, and as a file to be kept."""
    shown = table.dropna(axis="columns", how="all")
    data = base64.b64encode(table.to_csv(index=False).encode()).decode()
    link = tag("a", f"{file.name}", href=f"data:text/csv;base64,{data}", download=file.name)
    return tag(
        "details",
        tag("summary", f"The numbers in this figure ({len(table)} points)"),
        tag("p", "As a file: ", link, class_="quiet"),
        frame_table(shown, f"numbers of {file.stem}"),
    )


def _values(values: Sequence[Any]) -> str:
    """Return the *values* of an axis; of very many numbers their range."""
    if len(values) > MOST_VALUES and all(isinstance(each, int | float) for each in values):
        return f"{len(set(values))} numbers, {min(values):g} to {max(values):g}"
    return ", ".join(map(str, values))


def _sentence(text: str) -> str:
    text = text.strip()
    return f"{text[:1].upper()}{text[1:]}{'' if not text or text[-1] in '.?!' else '.'}"


def _counted(count: int, name: str) -> str:
    return f"{count} {name}" if count == 1 else f"{count} {name}s"


def _ranges(numbers: list[int]) -> str:
    """Return ascending *numbers* with those in a row joined: 1 to 4, 7."""
    runs: list[list[int]] = []
    for each in numbers:
        if runs and each == runs[-1][-1] + 1:
            runs[-1].append(each)
        else:
            runs.append([each])
    return ", ".join(str(run[0]) if len(run) == 1 else f"{run[0]} to {run[-1]}" for run in runs)
