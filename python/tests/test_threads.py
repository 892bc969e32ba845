"""The GIL, progress, cancellation and signals."""

import os
import subprocess
import sys
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


CHILD = """
import os, signal, threading, time
import mrvis, numpy as np
signal.signal(signal.SIGINT, signal.default_int_handler)  # programs in the background of a shell begin with signals ignored
{prepare}
pressed = []
def press():
    for _ in range({times}):
        time.sleep(0.3)
        pressed.append(time.perf_counter())
        os.kill(os.getpid(), signal.SIGINT)
threading.Thread(target=press, daemon=True).start()
print("begin", flush=True)
try:
    {work}
except KeyboardInterrupt:
    print(len(pressed), time.perf_counter() - pressed[-1])
"""

MODEL = "model = mrvis.Model(mrvis.Scene.generate('cornell'), detail='clusters')"
LONG = {
    "solve": (MODEL, "model.solve(error=1e-4, max_links=100_000_000)"),
    "form factors": (MODEL, "model.form_factors(rays=1 << 20, pair_rays=1 << 22)"),
    "reference": (MODEL, "model.reference(np.tile([278.0, 1, 280], (1000, 1)), (0, 1, 0), samples=1 << 16)"),
    "lightmap": (MODEL + "; light = model.solve(error=0.2, direct_only=True)", "light.lightmap(1 << 26)"),
    "fbem": (
        "a = np.random.default_rng(1).random((2000, 2000), np.float32); b = a + np.float32(0.1)",
        "mrvis.fbem_spectrum(a, b, np.linspace(1, 100, 40).tolist())",
    ),
    "visibility": (
        "model = mrvis.Model(mrvis.Scene.generate('cubes'), threads=1); n = 1 << 18; low, high = model.scene.bounds\n"
        "a, b = (np.tile(np.random.default_rng(k).uniform(low, high, (n, 3)).astype(np.float32), (64, 1)) for k in (1, 2))\n",
        "model.visibility(a, b, engine='exact', bundles=1 << 20)",
    ),
}


def child(call, times):
    """A process that does the work of a call and is interrupted so many times; the work begins now."""
    prepare, work = LONG[call]
    code = CHILD.format(prepare=prepare, work=work, times=times)
    process = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stdout.readline() == "begin\n", process.communicate()
    return process


def interrupted(call, times):
    """Interrupts a call in a process of its own; gives the number of interruptions until it ended, and seconds since the last."""
    process = child(call, times)
    out, errors = process.communicate(timeout=200)
    assert process.returncode == 0 and out, out + errors
    presses, late = out.split()
    return int(presses), float(late)


def takes_longer(call, seconds):
    """Whether the call takes longer if nobody interrupts it."""
    process = child(call, 0)
    try:
        process.communicate(timeout=seconds)
        return False
    except subprocess.TimeoutExpired:
        return True
    finally:
        process.kill()
        process.wait()


@pytest.mark.parametrize("call", [call if call in ("solve", "visibility") else pytest.param(call, marks=pytest.mark.long) for call in LONG])
def test_ctrl_c(call):
    presses, late = interrupted(call, 1)
    # An interruption that acts when the work is over is as late as the work is long.
    assert presses == 1 and takes_longer(call, 0.5 + 5 * late), f"{late} s late"


@pytest.mark.long
def test_a_second_ctrl_c_leaves_work_that_does_not_stop():
    # The error metric does not look whether it shall stop; it is left to itself half a second after the first interruption.
    presses, late = interrupted("fbem", 2)
    assert presses == 2 and takes_longer("fbem", 0.8 + 5 * late), f"{late} s late"


def test_form_factors_are_cancelled(cornell):
    parts = []
    with pytest.raises(mrvis.CancelledError):
        cornell.form_factors(rays=1 << 20, progress=lambda stage, part: parts.append(part) or part == 0)
    assert 0 < parts[-1] < 1


def test_visibility_is_cancelled(cubes, ground):
    origins, targets = (np.repeat(end, 2000, axis=0) for end in ground)
    told = []
    with pytest.raises(mrvis.CancelledError):
        cubes.visibility(origins, targets, engine="exact", progress=lambda *now: told.append(now) or False)
    assert told[0][0] == "visibility"


def test_progress_may_ask_the_model_at_work():
    """The answer does not wait for the end of the work, of whose model all threads are busy."""
    model = mrvis.Model(mrvis.Scene.generate("cubes"), threads=1)
    points, answers = [[0.0, 0.0, 0.01]], []

    def ask(stage, part):
        seen = model.source_visibility(points, (0, 0, 1), engine="exact", rays=16, progress=lambda stage, part: None)
        answers.append((part, seen.transmittance[0], model.visibility([[0, 0, 9.0]], [[1, 0, 9.0]]).transmittance[0]))
        return len(answers) < 3

    with pytest.raises(mrvis.CancelledError):
        model.form_factors(rays=1 << 18, progress=ask)
    parts, seen, clear = zip(*answers)
    assert len(answers) == 3 and parts[-1] < 1 and len(set(seen)) == 1 and set(clear) == {1}


FORKED = """
import os, sys, threading, time
import mrvis
def answer():
    model = mrvis.Model(mrvis.Scene.generate("cornell"), detail="clusters")
    return model.source_visibility([[278.0, 1, 280]], (0, 1, 0)).transmittance[0]
def in_child(call):
    child = os.fork()
    if child == 0:
        try:
            call()
        except mrvis.UnsupportedError as error:
            sys.exit(7 if "forked" in str(error) and "spawn" in str(error) else 1)
        sys.exit(0)
    for _ in range(600):
        ended, status = os.waitpid(child, os.WNOHANG)
        if ended:
            return os.waitstatus_to_exitcode(status)
        time.sleep(0.1)
    os.kill(child, 9)
    return "hangs"
before = in_child(answer)
model = mrvis.Model(mrvis.Scene.generate("cornell"), detail="clusters")
told = threading.Event()
work = threading.Thread(target=lambda: model.form_factors(rays=1 << 16, progress=lambda *_: told.set()))
work.start()
told.wait()
during = in_child(answer), in_child(lambda: model.solve(error=0.5)), in_child(lambda: model.scene.bounds)
work.join()
print(before, *during, in_child(lambda: model.visibility([[278.0, 1, 280]], [[278.0, 9, 280]])))
"""


def test_processes_that_are_forked():
    """Before the first call children may use the library; later they get an exception and end as others do."""
    done = subprocess.run([sys.executable, "-W", "ignore", "-c", FORKED], capture_output=True, text=True, timeout=300)
    assert done.stdout.split() == ["0", "7", "7", "0", "7"], done.stdout + done.stderr


def test_one_pool_a_model():
    """Calls on a model, on what updates make of it and on its solutions share its threads: their number stays."""
    model = mrvis.Model(mrvis.Scene.generate("cornell"), detail="clusters", threads=64)
    points, up = [[278.0, 1, 280]], (0, 1, 0)
    light = model.solve(error=0.5, direct_only=True)
    count = len(os.listdir("/proc/self/task"))
    for _ in range(10):
        model.source_visibility(points, up, rays=4)
        model.reference(points, up, samples=8)
        light.irradiance(points, up)
        model.form_factors(rays=16, grouping="object")
        model.shown({}).source_visibility(points, up)
        # Threads of a pool that is gone would still be ending; one more waits for a call of another test.
        assert len(os.listdir("/proc/self/task")) <= count + 1
