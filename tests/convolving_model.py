"""The striped model with convolutions in it, so that there is something to quantize; and images for it."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import cv2
import numpy as np

from striped_model import make_striped_model, striped_header
from yolino.header import Header

SIZE = (256, 256)


def convolving_header(fit: str = "stretch", **changes: object) -> Header:
    return dataclasses.replace(striped_header(), fit=fit, **changes)  # type: ignore[arg-type]


def make_convolving_model(path: Path, header: Header) -> Path:
    """Writes a model that finds what the striped one finds.

    Gray is 64 channels of a convolution, added up by a second one; a third is the head, which copies. What
    the cells make of it, the moments of the light, is the decoding.
    """
    import onnx

    node = onnx.helper.make_node
    model = onnx.version_converter.convert_version(onnx.load(make_striped_model(path, header)), 17)
    graph = model.graph
    del graph.value_info[:]  # shapes that will not be true any more
    gone = [one for one in graph.node if one.output[0] in ("gray", "above", "light2", "light")]
    for one in gone:
        graph.node.remove(one)
    weights = {
        "to_gray": np.full((64, 3, 1, 1), 1 / 3),
        "gray_bias": np.linspace(-1, 1, 64),
        "to_one": np.full((1, 64, 1, 1), 1 / 64),
        "copy": np.ones((1, 1, 1, 1)),
    }
    graph.initializer.extend(
        onnx.numpy_helper.from_array(array.astype(np.float32), name) for name, array in weights.items()
    )
    first = [
        node("Transpose", ["pixels"], ["planes"], perm=[0, 3, 1, 2]),
        node("Conv", ["planes", "to_gray", "gray_bias"], ["gray"], name="first"),
        node("Conv", ["gray", "to_one"], ["one_gray"], name="second"),
        node("Sub", ["one_gray", "dark"], ["above"]),
        node("Relu", ["above"], ["seen"]),
        node("Conv", ["seen", "copy"], ["light"], name="head"),
    ]
    nodes = [graph.node[0], *first, *graph.node[1:]]
    del graph.node[:]
    graph.node.extend(nodes)
    onnx.checker.check_model(model)
    path.write_bytes(model.SerializeToString())
    return path


def write_drive(folder: Path, count: int = 6, *, labelled: bool = True) -> Path:
    """Writes images of two bright lines each, labelled like TuSimple's, with the splits all and empty."""
    (folder / "clips").mkdir(parents=True)
    rows, records = list(range(20, 240, 10)), []
    for i in range(count):
        image = np.zeros((*SIZE, 3), np.uint8)
        lanes = []
        for x, slope in ((60 + 5 * i, 0.3), (150, 0.1 * i)):
            lane = [round(x + slope * (y - 20)) for y in rows]
            cv2.line(image, (lane[0], rows[0]), (lane[-1], rows[-1]), (255,) * 3, 7, cv2.LINE_AA)
            lanes.append(lane)
        cv2.imwrite(str(folder / "clips" / f"{i}.png"), image)
        records.append({"raw_file": f"clips/{i}.png", "lanes": lanes * labelled, "h_samples": rows})
    text = "\n".join(json.dumps(record) for record in records)
    (folder / "labels.json").write_text(text + "\n", encoding="utf-8")
    (folder / "none.json").write_text("", encoding="utf-8")
    description = folder / "data.yaml"
    description.write_text(
        "format: tusimple\nroot: .\nsplits: {all: [labels.json], empty: [none.json]}\n", encoding="utf-8"
    )
    return description
