"""The installed package: it finds its library, its types are those of the stubs, the example runs."""

import os
import subprocess
import sys
from pathlib import Path

import mrvis
import pytest

PROJECT = Path(__file__).resolve().parents[2]


def run(*command, **options):
    done = subprocess.run([str(part) for part in command], capture_output=True, text=True, **options)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.mark.wheel
def test_it_loads_its_own_embree(tmp_path):
    code = "import mrvis; print(mrvis.Model(mrvis.Scene.generate('cornell'), detail='rays').embree_version); print(open('/proc/self/maps').read())"
    shown = run(sys.executable, "-c", code, cwd=tmp_path, env={})
    assert shown.startswith("4.")
    libraries = {line.split()[-1] for line in shown.splitlines() if "libembree4" in line}
    assert libraries and all(Path(library).is_relative_to(Path(mrvis.__file__).parents[1]) for library in libraries), libraries


def test_version():
    assert f'\nversion = "{mrvis.__version__}"' in (PROJECT / "Cargo.toml").read_text()


def test_everything_is_described():
    for name in mrvis.__all__:
        thing = getattr(mrvis, name)
        assert name == "__version__" or thing.__doc__, name
        for member, value in vars(thing).items() if isinstance(thing, type) else []:
            if not member.startswith("_") and (callable(value) or type(value).__name__ == "getset_descriptor"):
                assert value.__doc__, f"{name}.{member}"


def test_stubs(tmp_path):
    pytest.importorskip("mypy")
    environment = {**os.environ, "MYPY_CACHE_DIR": str(tmp_path)}
    run(sys.executable, "-m", "mypy.stubtest", "mrvis", cwd=tmp_path, env=environment)


def test_example(tmp_path):
    pytest.importorskip("matplotlib")
    picture = tmp_path / "curve.png"
    environment = {**os.environ, "MPLBACKEND": "Agg"}
    # A panel over a few hundred leaves.
    squares = [(0, 0, 9, 9, -1)] + [(k % 20 * 0.9, k // 20 * 0.9, 2 + k % 7 / 9, 0.2, 1) for k in range(300)]
    lines = ["mtllib leaves.mtl"]
    for x, y, z, size, turn in squares:
        corners = [(x, y), (x + size, y), (x + size, y + size), (x, y + size)][::turn]
        lines += [f"v {a} {b} {z}" for a, b in corners] + ["usemtl " + ("panel" if turn < 0 else "leaf"), "f -4 -3 -2 -1"]
    (tmp_path / "leaves.obj").write_text("\n".join(lines))
    (tmp_path / "leaves.mtl").write_text("newmtl panel\nKe 1 1 1\nnewmtl leaf\nKd .5 .5 .5\n")
    run(sys.executable, PROJECT / "examples/python/exact_against_mr.py", "leaves.obj", "--points", 64, "--out", picture, cwd=tmp_path, env=environment)
    assert picture.read_bytes()[:4] == b"\x89PNG"


def test_first_program(tmp_path):
    text = (PROJECT / "docs/python.md").read_text()
    program = text.split("```python\n")[1].split("```")[0]
    # It needs NumPy alone.
    (tmp_path / "scipy.py").write_text("raise ImportError('there is no SciPy')")
    assert "1000, 3" in program and run(sys.executable, "-c", program, cwd=tmp_path)
