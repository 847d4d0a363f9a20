from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from yolino.benchmark import SECTIONS, read_result, summary
from yolino.benchmark.summary import ROWS

ROOT = Path(__file__).parents[2]


def _result(**sections: dict[str, tuple[float | None, str]]) -> dict[str, Any]:
    return {
        "sections": {
            name: {
                "measures": {key: {"value": value, "unit": unit} for key, (value, unit) in measures.items()}
            }
            for name, measures in sections.items()
        }
    }


def test_a_row_has_its_numbers_with_units() -> None:
    result = _result(nms={"ours_500": (0.03012, "ms"), "speedup_500": (75.4, "x")})
    head, line, row = summary(result).splitlines()
    assert head == "| what | median | beside it, in the same run |"
    assert line == "|---|---|---|"
    assert row == "| NMS of 500 candidates | 0.0301 ms | scikit-learn, same clusters: 75.4 x slower |"


def test_what_was_not_measured_is_left_out() -> None:
    assert summary(_result(growth={})) == "The summary has no row for growth: leave out --summary."
    nothing = summary(_result(nms={"ours_500": (None, "ms"), "speedup_500": (75.0, "x")}))
    assert nothing == "The summary has no row for nms: leave out --summary."
    (row,) = summary(_result(nms={"ours_500": (0.03, "ms"), "speedup_500": (None, "x")})).splitlines()[2:]
    assert row == "| NMS of 500 candidates | 0.03 ms |  |"


def test_every_row_names_a_section() -> None:
    named = {name for row in ROWS for text in row for name in re.findall(r"\{(\w+)\.", text)}
    assert named <= set(SECTIONS)


def test_rows_of_a_model_name_it() -> None:
    measures = {f"onnxruntime_fp32_{what}": (13.4, "ms") for what in ("total", "fps", "network")}
    result = _result(engines=measures) | {"model": {"name": "cracks"}}
    assert "| cracks, image to polylines, ONNX Runtime fp32 | 13.4 ms (13.4 ms) |" in summary(result)


def test_the_table_of_the_readme_is_what_the_benchmark_printed() -> None:
    result = read_result(ROOT / "docs" / "benchmarks" / "two_cores.json")
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    between = text.partition("<!-- speed-table -->")[2].partition("<!-- /speed-table -->")[0]
    assert between.strip() == summary(result)
    assert len(summary(result).splitlines()) == len(ROWS) + 2
