"""What is copied, what is shared, and what is freed."""

import gc
import os
import subprocess
import sys
import tracemalloc

import mrvis
import numpy as np
import pytest
from known import squares


def traced(work):
    """Bytes that NumPy and Python allocate at most during the work."""
    tracemalloc.start()
    work()
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return peak


def test_answers_go_into_the_caller_s_array(model):
    ends = np.float32([[0.5, 0.5, 0.1]] * 8), np.float32([[0.5, 0.5, 0.9]] * 8)
    out = np.full(8, 7, np.float32)
    seen = model.visibility(*ends, out=out)
    assert seen.transmittance is out and np.shares_memory(seen.transmittance, out) and (out == 1).all()
    seen = model.source_visibility(ends[0].astype(float), (0, 0, 1), out=out)
    assert seen.transmittance is out
    # A part of a larger array, and what surrounds it.
    frame = np.full(10, 7, np.float32)
    assert np.shares_memory(model.visibility(*ends, out=frame[1:-1]).transmittance, frame)
    assert frame[0] == frame[-1] == 7 and (frame[1:-1] == 1).all()


def test_segments_are_borrowed(model):
    count = 100_000
    both = np.tile(np.float32([0.5, 0.5, 0.1, 0.5, 0.5, 0.9]), (count, 1))
    origins, targets = both[:, :3].copy(), both[:, 3:].copy()
    out = np.empty(count, np.float32)
    size, offsets = np.full(count, 0.1, np.float32), np.arange(count + 1, dtype=np.uint64)
    borrowed = {"out": out, "feature_size": size, "emitter_size": size, "bundles": offsets, "engine": "exact"}
    assert traced(lambda: model.visibility(origins, targets, **borrowed)) < 50_000
    assert traced(lambda: model.visibility(both[:, :3], both[:, 3:], **borrowed)) < 50_000
    assert traced(lambda: model.visibility(origins, targets, engine="exact")) < 50_000 + out.nbytes
    assert traced(lambda: model.visibility(np.asfortranarray(origins), targets, **borrowed)) > origins.nbytes


PEAK = """
import sys
import mrvis, numpy as np
from known import squares
def peak():
    with open("/proc/self/status") as file:
        return next(int(line.split()[1]) for line in file if line.startswith("VmHWM")) * 1024
model = mrvis.Model(squares(), detail="rays", threads=2)
count = 4_000_000
both = np.empty((count, 6), np.float32)
both[:] = [0.5, 0.5, 0.1, 0.5, 0.5, 0.9]
out = np.full(count, 7, np.float32)
layout = sys.argv[1]
origins, targets = both[:, :3], both[:, 3:]
bundles = np.arange(count + 1, dtype=np.uint64)
if layout == "columns":
    origins, targets = np.asfortranarray(origins), np.asfortranarray(targets)
few = slice(0, 60_000)
model.visibility(both[few, :3], both[few, 3:], out=out[few], bundles=bundles[:60_001])  # threads, buffers
before = peak()
model.visibility(origins, targets, out=out, bundles=bundles)
assert (out == 1).all()
print(peak() - before, origins.nbytes)
"""


@pytest.mark.skipif(not os.path.exists("/proc/self/status"), reason="the peak is read from /proc")
def test_a_large_batch_takes_no_memory():
    """The growth of the peak of resident memory, which counts what the crate takes as well as NumPy does."""

    def growth(layout):
        done = subprocess.run([sys.executable, "-c", PEAK, layout], capture_output=True, text=True, cwd=os.path.dirname(__file__))
        assert done.returncode == 0, done.stderr
        return map(int, done.stdout.split())

    grown, size = growth("rows")
    assert grown < size // 8, (grown, size)
    grown, size = growth("columns")
    assert grown > size, "the measurement sees copies"


def test_an_array_is_not_read_and_written_at_once(model):
    memory = np.tile(np.float32([0.5, 0.5, 0.1]), (4, 1))
    with pytest.raises(mrvis.InputError, match="`out`"):
        model.visibility(memory, memory + np.float32([0, 0, 0.5]), out=memory.reshape(-1)[:4])


def resident():
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * 4096


def test_a_thousand_cycles_do_not_grow():
    def cycles(count):
        for _ in range(count):
            model = mrvis.Model(squares(), detail="rays", threads=1)
            model.visibility(np.float32([[0.5, 0.5, 0.1]]), np.float32([[0.5, 0.5, 0.9]]))
            with pytest.raises(mrvis.InputError):
                model.visibility([[0, 0, 0]], [[0, 0, 0]])
        gc.collect()
        return resident()

    warm = cycles(200)
    assert cycles(800) < warm + (8 << 20)
