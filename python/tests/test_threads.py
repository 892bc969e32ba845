"""The GIL, progress, cancellation and signals."""

import os
import signal
import threading
import time
from concurrent.futures import ThreadPoolExecutor

import mrvis
import numpy as np
import pytest
from known import squares


def test_python_goes_on_meanwhile(cubes, ground):
    origins, targets = (np.repeat(end, 500, axis=0) for end in ground)
    ticks, done = [], threading.Event()

    def tick():
        while not done.is_set():
            ticks.append(time.perf_counter())
            time.sleep(0.001)

    thread = threading.Thread(target=tick)
    thread.start()
    begin = time.perf_counter()
    cubes.visibility(origins, targets, engine="exact")
    end = time.perf_counter()
    done.set()
    thread.join()
    during = sum(begin < t < end for t in ticks)
    assert during >= 3, f"{during} ticks in {end - begin:.3f} s"


def test_several_threads_ask_at_once(cubes, ground):
    want = cubes.visibility(*ground).transmittance
    with ThreadPoolExecutor(4) as pool:
        for found in pool.map(lambda _: cubes.visibility(*ground).transmittance, range(16)):
            assert np.array_equal(found, want)


def test_progress_is_told():
    told = []
    model = mrvis.Model(squares(reflectance=0.5), detail="clusters")
    model.solve(error=0.1, progress=lambda stage, part: told.append((stage, part, threading.get_ident())))
    stages, parts, threads = zip(*told)
    assert len(set(stages)) > 1 and all(0 <= part <= 1 for part in parts) and set(threads) == {threading.get_ident()}


def test_false_cancels():
    scene = mrvis.Scene.generate("cubes")
    with pytest.raises(mrvis.CancelledError):
        mrvis.Model(scene, progress=lambda stage, part: False)
    calls = []
    with pytest.raises(mrvis.CancelledError):
        points = np.tile([0.0, 0.0, 0.01], (20_000, 1))
        mrvis.Model(scene).source_visibility(points, (0, 0, 1), rays=1024, engine="exact", progress=lambda *a: calls.append(a) or len(calls) < 3)
    assert len(calls) == 3


def test_a_solution_that_is_stopped_is_what_was_reached(cornell):
    stopped = cornell.solve(error=1e-3, progress=lambda stage, part: False)
    assert stopped.interrupted and stopped.mean_irradiance.min() >= 0


def test_what_progress_raises_is_raised():
    def fail(stage, part):
        raise KeyError(stage)

    with pytest.raises(KeyError):
        mrvis.Model(mrvis.Scene.generate("cubes"), progress=fail)


def test_ctrl_c(cornell):
    # Programs in the background of a shell begin with signals ignored.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    timer = threading.Timer(0.3, lambda: os.kill(os.getpid(), signal.SIGINT))
    begin = time.perf_counter()
    timer.start()
    with pytest.raises(KeyboardInterrupt):
        cornell.solve(error=1e-4, max_links=100_000_000)
    signal.signal(signal.SIGINT, before)
    assert time.perf_counter() - begin < 10
