"""Seconds to encode 62 views of 224² (random pixels), per encoder, precision and threads; wall and CPU time, best of
three.

With one thread, CPU time is what the wall time would be on an idle machine. With more threads on a busy machine both
are worthless: threads spin while they wait for each other.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))

import numpy as np
import torch

from b23d.stages.encoders.load import load_encoder
from b23d.stages.encoders.weights import find_checkpoint

VIEWS = 62


def bench(name: str, precision: str, threads: int) -> None:
    torch.set_num_threads(threads)
    try:
        checkpoint = find_checkpoint(name)
    except FileNotFoundError as error:
        print(f"{name:<20} skipped: {error}")
        return
    started = time.perf_counter()
    encoder = load_encoder(checkpoint, precision=precision)  # type: ignore[arg-type]
    loading = time.perf_counter() - started
    images = np.random.default_rng(0).integers(0, 256, (VIEWS, 224, 224, 3), dtype=np.uint8)
    encoder.encode(images[:8])
    walls, processors = [], []
    for _ in range(3):
        wall, processor = time.perf_counter(), time.process_time()
        encoder.encode(images)
        walls.append(time.perf_counter() - wall)
        processors.append(time.process_time() - processor)
    print(
        f"{name:<20} {precision} → {encoder.precision} on {encoder.device}, {threads} thread(s): "
        f"{min(walls):5.2f} s wall, {min(processors):5.2f} s CPU; loading {loading:.2f} s",
        flush=True,
    )


if __name__ == "__main__":
    for name in ("efficientnet-lite0", "saliency-vit-s14"):
        for threads in (1, 2):
            bench(name, "auto", threads)
    bench("efficientnet-lite0", "bf16", 1)
    bench("saliency-vit-s14", "fp32", 1)
