#!/usr/bin/env python3
"""Error against time of exact rays and of multi-resolution (MR) visibility, as a curve.

    python3 examples/python/exact_against_mr.py --out exact_against_mr.png

Points on the ground of an orchard ask which part of the sky they see. The cells that begin with `# %%` run one by one in editors that
know them.
"""

# %% Arguments
import argparse
import time

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.ticker import LogFormatter

import mrvis

parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
parser.add_argument("scene", nargs="?", help="a scene file with an emitter; default: an orchard")
parser.add_argument("--points", type=int, default=2000, help="number of points on the ground")
parser.add_argument("--feature-size", type=float, default=0.5, help="smallest shadow of interest, scene units")
parser.add_argument("--out", default="exact_against_mr.png", help="picture to write")
arguments = parser.parse_args()

# %% The model: a scene prepared for queries
scene = mrvis.Scene.load(arguments.scene) if arguments.scene else mrvis.Scene.generate("forest")
model = mrvis.Model(scene)
print(scene, model, sep="\n")

# %% Points on the ground, in rows that neighbours share
low, high = scene.bounds
side = max(int(np.sqrt(arguments.points)), 2)
x, y = np.meshgrid(*(np.linspace(low[k], high[k], side + 2)[1:-1] for k in (0, 1)))
ground = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, low[2] + 1e-3 * (high[2] - low[2]))])
up = (0, 0, 1)

# %% Reference values, then both engines with more and more segments
reference = model.source_visibility(ground, up, rays=8192, seed=7, engine="exact").transmittance
rays = [4, 8, 16, 32, 64, 128, 256]
options = {"exact": {}, "mr": {"feature_size": arguments.feature_size}}
model.source_visibility(ground, up, engine="mr", **options["mr"])  # the first query measures the cost of exact rays
curves = {}
for engine in options:
    for count in rays:
        seconds = []
        for _ in range(3):
            begin = time.perf_counter()
            seen = model.source_visibility(ground, up, rays=count, engine=engine, **options[engine])
            seconds.append(time.perf_counter() - begin)
        error = np.sqrt(np.mean((seen.transmittance - reference) ** 2))
        curves.setdefault(engine, []).append((1e6 * min(seconds) / len(ground), 100 * error))

# %% The picture
figure, axes = plt.subplots(figsize=(7, 5), layout="constrained")
names = {"exact": "exact rays", "mr": f"multi-resolution, features of {arguments.feature_size:g} {scene.unit}"}
for (engine, curve), marker, above in zip(curves.items(), "os", (True, False)):
    microseconds, error = np.transpose(curve)
    axes.loglog(microseconds, error, marker=marker, label=names[engine])
    for count, at in list(zip(rays, curve))[::3]:
        offset = (5, 5) if above else (-5, -13)
        axes.annotate(str(count), at, textcoords="offset points", xytext=offset, ha="left" if above else "right", fontsize=8)
axes.set_xlabel("time per point (µs)")
axes.set_ylabel("RMS error of the visible fraction (%)")
axes.set_title("Visible fraction of the sky; numbers: segments per point")
for axis in (axes.xaxis, axes.yaxis):
    axis.set_major_formatter("{x:g}")
    axis.set_minor_formatter(LogFormatter(labelOnlyBase=False, minor_thresholds=(2, 0.7)))
axes.grid(True, which="both", alpha=0.3)
axes.legend()
figure.savefig(arguments.out, dpi=120)
print("wrote", arguments.out)
