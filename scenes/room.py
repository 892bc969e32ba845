#!/usr/bin/env python3
"""Measures error and time of `mrvis solve` in a furnished room, with exact and multi-resolution visibility.

The script draws random points on the fronts of all faces, evenly by area. It computes a path-traced reference
(`mrvis reference`) once and keeps it in the output folder, solves with several options, compares each solution with the
reference (`mrvis compare`) and prints a Markdown table. Elements are read back from `solution.vtu`, drawn by area, and compared
with path-traced means, and so is the mesh of `solution.ply` at points of the same elements (`elements.py`). It needs only Python's
standard library; `make scenes` assembles the rooms.

    python3 scenes/room.py scenes/real/livingroom.obj --out out/livingroom-solved
"""

import argparse
import bisect
import json
import os
import pathlib
import random
import time

import elements
from cornell import cross, run, subtract, unit

SEED = 5
# Name and options of `mrvis solve`.
RUNS = [
    ("exact", []),
    ("MR", ["--visibility", "mr"]),
    ("exact, fine", ["--error", "0.007"]),
    ("MR, fine", ["--error", "0.007", "--visibility", "mr"]),
    ("exact, links alone", ["--local-rays", "0"]),
    ("MR, links alone", ["--local-rays", "0", "--visibility", "mr"]),
]


def triangles(path):
    """Yields the corners of all triangles of an OBJ file; polygons are divided into fans."""
    corners = []
    with open(path, encoding="utf-8", errors="replace") as file:
        for line in file:
            words = line.split()
            if words[:1] == ["v"]:
                corners.append(tuple(map(float, words[1:4])))
            elif words[:1] == ["f"]:
                index = [int(w.split("/")[0]) for w in words[1:]]
                a, *rest = [corners[i - 1 if i > 0 else i] for i in index]
                yield from ((a, b, c) for b, c in zip(rest, rest[1:]))


def points(path, count):
    """Yields `count` positions and unit normals, stratified by area."""
    faces, sums, area = [], [], 0.0
    for a, b, c in triangles(path):
        normal = cross(subtract(b, a), subtract(c, a))
        size = sum(x * x for x in normal) ** 0.5
        if size > 0.0:
            area += size
            faces.append((a, b, c, unit(normal)))
            sums.append(area)
    draw = random.Random(SEED)
    for k in range(count):
        at = bisect.bisect(sums, (k + draw.random()) / count * area)
        a, b, c, normal = faces[min(at, len(faces) - 1)]
        r, v = draw.random() ** 0.5, draw.random()
        yield tuple(p + r * ((1 - v) * (q - p) + v * (s - p)) for p, q, s in zip(a, b, c)), normal


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scene", help="an OBJ file")
    parser.add_argument("--mrvis", default="target/release/mrvis", help="path of the command (default: target/release/mrvis)")
    parser.add_argument("--out", default="out/room", help="folder for all files (default: out/room)")
    parser.add_argument("--points", type=int, default=2000, help="number of points (default: 2000)")
    parser.add_argument("--samples", type=int, default=4096, help="paths per point of the reference (default: 4096)")
    parser.add_argument("--options", help="options of `mrvis solve` to measure instead of the usual ones, such as --options='--max-seconds 14'; not those that change the light, such as --direct-only")
    parser.add_argument("--elements", type=int, default=500, help="number of elements, with 16 points each (default: 500)")
    args = parser.parse_args()
    mrvis, scene = (str(pathlib.Path(p).resolve()) for p in (args.mrvis, args.scene))
    os.makedirs(args.out, exist_ok=True)
    os.chdir(args.out)
    with open("points.csv", "w", encoding="utf-8") as file:
        file.write("x,y,z,nx,ny,nz\n")
        for place, normal in points(scene, args.points):
            file.write(",".join(repr(float(x)) for x in place + normal) + "\n")
    common = [scene, "--points", "points.csv", "--quiet"]
    reference = f"reference-{args.points}-{args.samples}.csv"
    if not os.path.exists(reference):
        seconds = run([mrvis, "reference", *common, "--samples", str(args.samples), "--out", reference])
        print(f"{reference}: {seconds:.0f} s of user time", flush=True)
    # This run measures the clusters and keeps them in the user's cache folder. The times below do not include it.
    run([mrvis, "solve", *common, "--visibility", "mr", "--error", "1", "--out", "warm"])
    print(f"\n| {args.points} points | options | RMS / mean | bias | RMS of elements | bias | RMS of the mesh at points | RMS of elements at points | time | user time |")
    print("| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |")
    runs = RUNS if args.options is None else [("", args.options.split())]
    for name, options in runs:
        begun = time.monotonic()
        seconds = run([mrvis, "solve", *common, "--out", "solution", "--output", "vtu,ply", *options])
        wall = time.monotonic() - begun
        run([mrvis, "compare", reference, "solution/irradiance.csv", "--quiet", "--json", "compare.json"])
        with open("compare.json", encoding="utf-8") as file:
            found = json.load(file)
        # The difference includes the noise of the reference, which is independent of the error of the solution.
        rms = max(found["rms"] ** 2 - found["reference_noise"] ** 2, 0.0) ** 0.5
        of_elements, bias, of_mesh, at_points = elements.compare(mrvis, scene, "solution", count=args.elements)
        options = " ".join(options) or "none"
        print(
            f"| {name} | `{options}` | {100 * rms:.1f} % | {100 * found['bias']:+.1f} % | {100 * of_elements:.1f} % "
            f"| {100 * bias:+.1f} % | {100 * of_mesh:.1f} % | {100 * at_points:.1f} % | {wall:.1f} s | {seconds:.1f} s |",
            flush=True,
        )
    print("\nThe noise of the references is subtracted.")


if __name__ == "__main__":
    main()
