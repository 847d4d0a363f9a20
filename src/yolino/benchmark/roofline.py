"""Section `roofline`: the most that this machine computes in a second, by precision."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from yolino.benchmark.clock import Times, race
from yolino.benchmark.measure import Measure, Section
from yolino.benchmark.setup import Setup
from yolino.inference.engine_openvino import import_openvino, openvino_core

PRECISIONS = ("fp32", "bf16", "int8")
_EDGE = 1024
_BYTES = 2**28
_GIGA = 1e9
ABOUT = (
    f"The product of two {_EDGE}x{_EDGE} matrices with OpenVINO, by precision: nothing computes faster here. "
    "Networks reach a part of it (section `engines`). Memory: a copy of 256 MiB, bytes read and written."
)


def measure(setup: Setup) -> Section:
    """Times matrix products and a copy."""
    edge = 64 if setup.quick else _EDGE
    source = np.zeros((2**20 if setup.quick else _BYTES) // 8)
    target = np.empty_like(source)
    products = {name: matrix_product(name, edge, setup.threads) for name in precisions_here()}
    times = race({**products, "memory": lambda: np.copyto(target, source)}, **setup.pace)
    measures = {
        precision: _per_second(f"matrix product, {precision}", 2 * edge**3, times[precision], "GFLOP/s")
        for precision in products
    }
    measures["memory"] = _per_second("memory, one thread", 2 * source.nbytes, times["memory"], "GB/s")
    return Section("The most that this machine can do", ABOUT, measures)


def peaks(setup: Setup) -> dict[str, float]:
    """Gives the fastest matrix product of each precision in operations per second, in a second's time."""
    edge = 64 if setup.quick else _EDGE
    products = {name: matrix_product(name, edge, setup.threads) for name in precisions_here()}
    times = race(products, rounds=setup.repeats, seconds=min(setup.seconds, 1.0))
    return {name: 2 * edge**3 / float(taken.seconds.min()) for name, taken in times.items()}


def precisions_here() -> tuple[str, ...]:
    """Gives the precisions that this processor has; bf16 is computed in fp32 where it does not."""
    abilities = openvino_core().get_property("CPU", "OPTIMIZATION_CAPABILITIES")
    return tuple(name for name in PRECISIONS if name != "bf16" or "BF16" in abilities)


def matrix_product(precision: str, edge: int, threads: int) -> Callable[[], object]:
    """Gives a call that multiplies two square matrices with OpenVINO.

    Args:
        precision: "fp32", "bf16" or "int8".
        edge: Rows and columns.
        threads: Threads of the processor.
    """
    hint = {"fp32": "f32", "bf16": "bf16", "int8": "f32"}[precision]
    options = {
        "INFERENCE_PRECISION_HINT": hint,
        "PERFORMANCE_HINT": "LATENCY",
        "INFERENCE_NUM_THREADS": threads,
    }
    compiled = openvino_core().compile_model(_product_model(edge, precision == "int8"), "CPU", options)
    request = compiled.create_infer_request()
    pixels = np.random.default_rng(0).standard_normal((edge, edge)).astype(np.float32)
    return lambda: request.infer({0: pixels}, share_inputs=True, share_outputs=True)


def _product_model(edge: int, quantized: bool) -> Any:
    """Gives a model that multiplies its input with a constant; quantized: both as 8-bit integers."""
    openvino = import_openvino()
    ops = openvino.opset13

    given = ops.parameter([edge, edge], np.float32)
    rng = np.random.default_rng(0)
    if quantized:
        low, high = np.float32(-1.28), np.float32(1.27)
        left = ops.fake_quantize(given, low, high, low, high, 256)
        integers = ops.constant(rng.integers(-127, 128, (edge, edge)).astype(np.int8))
        right = ops.multiply(ops.convert(integers, "f32"), ops.constant(np.float32(0.01)))
    else:
        left = given
        right = ops.constant(rng.standard_normal((edge, edge)).astype(np.float32))
    return openvino.Model([ops.matmul(left, right, False, True)], [given])


def _per_second(title: str, amount: int, times: Times, unit: str) -> Measure:
    low, middle, high = (float(q) for q in np.quantile(amount / times.seconds / _GIGA, (0.25, 0.5, 0.75)))
    return Measure(title, middle, unit, low, high)


__all__ = ["PRECISIONS", "matrix_product", "measure", "peaks"]
