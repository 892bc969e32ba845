"""Models that several tests ask."""

import os

import mrvis
import numpy as np
import pytest
from known import squares

MAX_SECONDS = 20  # of processor time, with that of programs that a test starts


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item):
    before = sum(os.times()[:4])
    outcome = yield
    seconds = sum(os.times()[:4]) - before
    assert seconds < MAX_SECONDS, f"{item.name} took {seconds:.0f} s of processor time, at most {MAX_SECONDS} s"
    return outcome


@pytest.fixture(scope="session")
def model():
    return mrvis.Model(squares())


@pytest.fixture(scope="session")
def cubes():
    return mrvis.Model(mrvis.Scene.generate("cubes"))


@pytest.fixture(scope="session")
def cornell():
    return mrvis.Model(mrvis.Scene.generate("cornell"), detail="clusters")


@pytest.fixture(scope="session")
def light(cornell):
    return cornell.solve(error=0.1)


@pytest.fixture(scope="session")
def ground(cubes):
    """Segments from a grid on the ground of the scene upwards: origins and targets, shape (N, 3), float32."""
    low, high = cubes.scene.bounds
    x, y = np.meshgrid(*(np.linspace(low[k], high[k], 34)[1:-1] for k in (0, 1)))
    origins = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, low[2] + 0.01)]).astype(np.float32)
    targets = origins.copy()
    targets[:, 2] = high[2] - 0.01
    return origins, targets
