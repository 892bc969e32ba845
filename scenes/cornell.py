#!/usr/bin/env python3
"""Measures error and time of `mrvis solve` in the Cornell box.

The script takes 64 x 64 points on each of the five walls, except under the blocks and on the emitter. It computes a
path-traced reference (`mrvis reference`) once and keeps it in the output folder, solves on one thread with several
options, compares each solution with the reference (`mrvis compare`) and prints a Markdown table. It needs only Python's
standard library.

    python3 scenes/cornell.py --out out/cornell
"""

import argparse
import json
import os
import pathlib
import resource
import subprocess

import elements

SIDE = 64
WALLS = {
    # Corners in mm, counter-clockwise seen from inside, as `mrvis generate cornell` writes them.
    "floor": [(552.8, 0, 0), (0, 0, 0), (0, 0, 559.2), (549.6, 0, 559.2)],
    "back": [(549.6, 0, 559.2), (0, 0, 559.2), (0, 548.8, 559.2), (556, 548.8, 559.2)],
    "right": [(0, 0, 559.2), (0, 0, 0), (0, 548.8, 0), (0, 548.8, 559.2)],
    "left": [(552.8, 0, 0), (549.6, 0, 559.2), (556, 548.8, 559.2), (556, 548.8, 0)],
    "ceiling": [(556, 548.8, 0), (556, 548.8, 559.2), (0, 548.8, 559.2), (0, 548.8, 0)],
}
# Areas without points, seen from above: x and z of the corners, mm.
BLOCKS = [
    [(290, 114), (240, 272), (82, 225), (130, 65)],
    [(472, 406), (314, 456), (265, 296), (423, 247)],
]
LAMP = [(343, 227), (343, 332), (213, 332), (213, 227)]
# Name, options of `mrvis solve`, and whether only direct light is compared.
RUNS = [
    ("all bounces, default", [], False),
    ("all bounces, fine", ["--error", "0.0015", "--gather-rays", "1600"], False),
    ("direct light", ["--direct-only"], True),
]


def subtract(a, b):
    return tuple(x - y for x, y in zip(a, b))


def cross(a, b):
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def unit(a):
    length = sum(x * x for x in a) ** 0.5
    return tuple(x / length for x in a)


def inside(polygon, x, z):
    """Whether the point (x, z) lies in a convex polygon of either orientation."""
    turns = []
    for (ax, az), (bx, bz) in zip(polygon, polygon[1:] + polygon[:1]):
        turns.append((bx - ax) * (z - az) - (bz - az) * (x - ax))
    return all(t >= 0 for t in turns) or all(t <= 0 for t in turns)


def points():
    """Yields positions and unit normals. Each wall is two triangles, as in the OBJ file, because not all are planar."""
    for name, (a, b, c, d) in WALLS.items():
        for i in range(SIDE):
            for j in range(SIDE):
                u, v = (i + 0.5) / SIDE, (j + 0.5) / SIDE
                if u >= v:
                    place = tuple(p + u * (q - p) + v * (r - q) for p, q, r in zip(a, b, c))
                    normal = cross(subtract(b, a), subtract(c, a))
                else:
                    place = tuple(p + v * (s - p) + u * (r - s) for p, r, s in zip(a, c, d))
                    normal = cross(subtract(c, a), subtract(d, a))
                hidden = {"floor": BLOCKS, "ceiling": [LAMP]}.get(name, [])
                if not any(inside(polygon, place[0], place[2]) for polygon in hidden):
                    yield place, unit(normal)


def run(arguments):
    """Runs a command and returns its user time in seconds."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
    subprocess.run(arguments, check=True)
    return resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - before


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--mrvis", default="target/release/mrvis", help="path of the command (default: target/release/mrvis)")
    parser.add_argument("--out", default="out/cornell", help="folder for all files (default: out/cornell)")
    parser.add_argument("--samples", type=int, default=2048, help="paths per point of the reference (default: 2048)")
    args = parser.parse_args()
    mrvis = str(pathlib.Path(args.mrvis).resolve())
    os.makedirs(args.out, exist_ok=True)
    os.chdir(args.out)
    run([mrvis, "generate", "cornell", "--out", "cornell.obj", "--quiet"])
    with open("points.csv", "w", encoding="utf-8") as file:
        file.write("x,y,z,nx,ny,nz\n")
        count = 0
        for place, normal in points():
            file.write(",".join(repr(float(x)) for x in place + normal) + "\n")
            count += 1
    scene = ["cornell.obj", "--unit", "mm", "--points", "points.csv", "--quiet"]
    for direct in [False, True]:
        name = f"reference-{'direct' if direct else 'all'}-{args.samples}.csv"
        if not os.path.exists(name):
            options = ["--samples", str(args.samples), "--out", name] + ["--direct-only"] * direct
            print(f"{name}: {run([mrvis, 'reference', *scene, *options]):.0f} s", flush=True)
    print(f"\n| {count} points | options | RMS / mean | bias | RMS of elements | bias | RMS of the mesh at points | user time |")
    print("| --- | --- | --- | --- | --- | --- | --- | --- |")
    for name, options, direct in RUNS:
        seconds = run([mrvis, "solve", *scene, "--threads", "1", "--out", "solution", "--output", "vtu,ply", *options])
        reference = f"reference-{'direct' if direct else 'all'}-{args.samples}.csv"
        compare = [mrvis, "compare", reference, "solution/irradiance.csv", "--quiet", "--json", "compare.json"]
        run(compare)
        with open("compare.json", encoding="utf-8") as file:
            found = json.load(file)
        # The difference includes the noise of the reference, which is independent of the error of the solution.
        noise = found["reference_noise"]
        rms = max(found["rms"] ** 2 - noise**2, 0.0) ** 0.5
        columns = "- | - | -"
        if not direct:
            error, bias, of_mesh, _ = elements.compare(mrvis, "cornell.obj", "solution", ["--unit", "mm"])
            columns = f"{100 * error:.2f} % | {100 * bias:+.2f} % | {100 * of_mesh:.2f} %"
        options = " ".join(options) or "none"
        print(f"| {name} | `{options}` | {100 * rms:.2f} % | {100 * found['bias']:+.2f} % | {columns} | {seconds:.2f} s |")
    print("\nThe noise of the references is subtracted.")


if __name__ == "__main__":
    main()
