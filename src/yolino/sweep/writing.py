"""Writes the table of a sweep as Markdown, CSV and JSON."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from yolino.io import write_atomic
from yolino.sweep.description import METRICS, Numbers, Sweep
from yolino.sweep.facts import facts
from yolino.sweep.progress import duration
from yolino.sweep.result import Result, Row
from yolino.sweep.table import (
    NOTHING,
    cells,
    heading,
    legend,
    mean,
    metrics,
    notes,
    read_rows,
    settings,
    short,
    spread,
)

LINES = ("f1", "recall", "precision")
LOWER_IS_BETTER = ("fp", "fn")


def write_tables(sweep: Sweep, out: Path) -> None:
    """Writes `table.md`, `table.csv` and `table.json` from the finished runs.

    Raises:
        ValueError: A result file is broken.
        OSError: A file cannot be written.
    """
    rows = read_rows(sweep, out)
    write_atomic(out / "table.md", markdown(sweep, rows))
    write_atomic(out / "table.csv", as_csv(sweep, rows))
    write_atomic(out / "table.json", as_json(sweep, rows))


def markdown(sweep: Sweep, rows: Mapping[str, Row]) -> str:
    """Gives the page: the table by groups, what it rests on, and each run with its intervals."""
    lines = [f"# {sweep.layout.title}", "", *_sentences(facts(sweep, rows)), legend(sweep, rows)]
    for group in sweep.layout.groups:
        best = _best([rows[name] for name in group.rows])
        body = [cells(sweep, rows, name, best) for name in group.rows]
        lines += ["", f"## {group.title}"] if group.title else []
        lines += ["", *_table(heading(sweep, rows), body)]
    shown = metrics(sweep, rows)
    several = [row for row in rows.values() if len(row.results) > 1]
    if several:
        lines += ["", "## Least and largest over the seeds", ""]
        head = ["Row", "Seeds", *(METRICS[metric] for metric in shown)]
        lines += _table(head, [_spreads(row, shown) for row in several])
    runs = [result for row in rows.values() for result in row.results.values()]
    if runs:
        lines += ["", "## Runs, with 95 % bootstrap intervals", "", _RUNS, ""]
        head = ["Run", *(METRICS[metric] for metric in shown), *_DETAILS]
        lines += _table(head, [_details(result, shown) for result in runs])
    if problems := notes(rows):
        lines += ["", "## Not in the table", "", *(f"- {note}" for note in problems)]
    return "\n".join(lines) + "\n"


_RUNS = (
    "Lines F1, Rec, Prec: the points of the polylines. Thr.: threshold of segments, and of lines. Best: step "
    "of the best checkpoint."
)
_DETAILS = ("Lines F1", "Lines Rec", "Lines Prec", "Thr.", "Best", "Steps", "Time", "Parameters")


def _sentences(sentences: Sequence[str]) -> list[str]:
    return [line for sentence in sentences for line in (sentence, "")]


def _table(head: Sequence[str], body: Sequence[Sequence[str]]) -> list[str]:
    rule = ["---", *["---:"] * (len(head) - 1)]
    return ["| " + " | ".join(line) + " |" for line in (head, rule, *body)]


def _best(rows: Sequence[Row]) -> dict[str, float]:
    """Gives the best value of each score; none where all are alike."""
    best = {}
    for metric in METRICS:
        values = [mean(list(row.results.values()), metric) for row in rows]
        known = [value for value in values if value is not None]
        if len(set(known)) > 1:
            best[metric] = min(known) if metric in LOWER_IS_BETTER else max(known)
    return best


def _spreads(row: Row, shown: Sequence[str]) -> list[str]:
    results = list(row.results.values())
    ranges = [spread(results, metric) for metric in shown]
    texts = [NOTHING if two is None else f"{short(two[0])} .. {short(two[1])}" for two in ranges]
    return [row.name, ", ".join(map(str, row.results)), *texts]


def _details(result: Result, shown: Sequence[str]) -> list[str]:
    scores = [_with_interval(result, metric) for metric in (*shown, *LINES)]
    return [
        f"{result.row}, seed {result.seed}",
        *scores,
        _thresholds(result),
        str(result.step),
        str(result.steps),
        duration(result.seconds),
        f"{result.parameters / 1e6:.2f} M",
    ]


def _thresholds(result: Result) -> str:
    lines = result.threshold if result.line_threshold is None else result.line_threshold
    return f"{result.threshold:g}" if lines == result.threshold else f"{result.threshold:g}, {lines:g}"


def _with_interval(result: Result, metric: str) -> str:
    if metric not in result.scores:
        return NOTHING
    low, high = result.intervals[metric]
    return f"{short(result.scores[metric])} ({short(low)} .. {short(high)})"


def as_csv(sweep: Sweep, rows: Mapping[str, Row]) -> str:
    """Gives a line for each row: its settings, means and ranges over its seeds, and what was reported."""
    scores = [f"{m}{end}" for m in (*METRICS, *LINES) for end in ("", "_min", "_max")]
    reported = [f"reported_{m}" for m in METRICS]
    runs = ["seeds", "steps", "minutes", "parameters"]
    stream, fixed = io.StringIO(), ["row", *scores, *reported, *runs, "problem"]
    # A setting that is called like one of these, such as `steps`, has its whole key.
    names = {heading: key if heading in fixed else heading for heading, key in sweep.layout.columns.items()}
    header = dict.fromkeys(["row", *names.values(), *fixed])
    writer = csv.DictWriter(stream, list(header), lineterminator="\n", restval="")
    writer.writeheader()
    for row in rows.values():
        told = {names[heading]: value for heading, value in settings(sweep, row).items()}
        writer.writerow(told | _flat(sweep, row))
    return stream.getvalue()


def _flat(sweep: Sweep, row: Row) -> dict[str, Any]:
    results = list(row.results.values())
    line: dict[str, Any] = {"row": row.name, "problem": "; ".join(row.problems.values())}
    for metric in (*METRICS, *LINES):
        value, two = mean(results, metric), spread(results, metric)
        line |= {metric: "" if value is None else f"{value:.5f}"}
        line |= {} if two is None else {f"{metric}_min": f"{two[0]:.5f}", f"{metric}_max": f"{two[1]:.5f}"}
    for metric in METRICS:
        number = sweep.layout.numbers.get(row.name, Numbers()).of(metric)
        line[f"reported_{metric}"] = "" if number is None else number
    if results:
        minutes = sum(result.seconds for result in results) / len(results) / 60
        line |= {"seeds": " ".join(map(str, row.results)), "steps": results[0].steps}
        line |= {"minutes": f"{minutes:.2f}", "parameters": results[0].parameters}
    return line


def as_json(sweep: Sweep, rows: Mapping[str, Row]) -> str:
    """Gives everything: the sentences, the groups, and each row with its runs, means and ranges."""
    found = []
    for row in rows.values():
        results = list(row.results.values())
        names = [metric for metric in (*METRICS, *LINES) if mean(results, metric) is not None]
        reported = sweep.layout.numbers.get(row.name, Numbers())
        found.append(
            {
                "row": row.name,
                "settings": settings(sweep, row),
                "mean": {metric: mean(results, metric) for metric in names},
                "range": {metric: spread(results, metric) for metric in names if len(results) > 1},
                "reported": {m: reported.of(m) for m in METRICS if reported.of(m) is not None},
                "problems": {str(seed): problem for seed, problem in row.problems.items()},
                "runs": [result.model_dump(mode="json") for result in results],
            }
        )
    document = {
        "title": sweep.layout.title,
        "facts": facts(sweep, rows),
        "groups": [{"title": group.title, "rows": list(group.rows)} for group in sweep.layout.groups],
        "rows": found,
    }
    return json.dumps(document, indent=1, ensure_ascii=False) + "\n"


__all__ = ["LINES", "as_csv", "as_json", "markdown", "write_tables"]
