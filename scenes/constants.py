#!/usr/bin/env python3
"""Shows how a constant of the source code changes results: builds the command with several values and compares.

For each value the script copies the source code to the output folder, replaces the constant, builds the command (some
minutes each time) and runs one of four experiments. `solve` computes irradiance at 1,000 points of the generated scene
`desk-room` or of another one, with and without the local pass (`mrvis solve`). `elements` computes that of the elements of
a scene. `bench` compares multi-resolution visibility with exact rays in a generated forest of 25 trees (`mrvis bench`).
`form-factors` computes the matrix of a generated `urban-block` of about 1,000 facets. The script prints a Markdown table. It
needs only Python's standard library and the tools of `make build`.

    python3 scenes/constants.py solve transport/krylov.rs TOLERANCE 1e-5 1e-3
    python3 scenes/constants.py elements final_gather/sharing.rs RIDGE 1e-2 --scene scenes/real/valley.obj

The first line of the table is the value in the source code. The path is below `src` and may be shortened at its start.
"""

import argparse
import csv
import json
import os
import pathlib
import re
import shutil
import subprocess

import elements
from cornell import run
from room import points

ROOT = pathlib.Path(__file__).resolve().parent.parent
COPIED = ["Cargo.toml", "Cargo.lock", "build.rs", "rustfmt.toml", "src", "command", "ffi", "python", "benches", "examples", "tests"]


def definition(name):
    """A pattern for the value of a constant that is one expression on one line."""
    return re.compile(rf"(const {name}: [^=]+= )([^;]+)(;)")


def find(path, name):
    """The only source file whose path ends with `path` and that defines the constant."""
    files = [f for f in sorted((ROOT / "src").rglob("*.rs")) if f.as_posix().endswith("/" + path)]
    files = [f for f in files if definition(name).search(f.read_text(encoding="utf-8"))]
    if len(files) != 1:
        raise SystemExit(f"constants.py: {len(files)} files end with {path} and define {name}")
    return files[0]


def build(file, name, value, folder):
    """Builds the command with another value; returns its path."""
    copy = folder / "source"
    for part in COPIED:
        if (ROOT / part).is_dir():
            shutil.copytree(ROOT / part, copy / part, dirs_exist_ok=True)
        elif (ROOT / part).exists():
            os.makedirs(copy, exist_ok=True)
            shutil.copy2(ROOT / part, copy / part)
    text = file.read_text(encoding="utf-8")
    target = copy / file.relative_to(ROOT)
    target.write_text(definition(name).sub(rf"\g<1>{value}\g<3>", text, count=1), encoding="utf-8")
    environment = dict(os.environ, CARGO_TARGET_DIR=str(folder / "target"))
    private = ROOT / ".prefix" / "embree"
    if private.exists():
        environment.setdefault("EMBREE_DIR", str(private))
    subprocess.run(["cargo", "build", "--release", "--quiet"], cwd=copy, env=environment, check=True)
    return folder / "target" / "release" / "mrvis"


def read(path):
    with open(path, encoding="utf-8") as file:
        return json.load(file)


def solve(mrvis, name, first, args):
    """Error against a path-traced reference, and difference from the first value, in per cent of the mean irradiance."""
    scene, options = args.scene or "desk.obj", args.options.split()
    if first is None:
        run([mrvis, "generate", "desk-room", "--out", "desk.obj", "--quiet"])
        with open("points.csv", "w", encoding="utf-8") as file:
            file.write("x,y,z,nx,ny,nz\n")
            for place, normal in points(scene, args.points):
                file.write(",".join(repr(float(x)) for x in place + normal) + "\n")
        reference = ["reference", scene, "--points", "points.csv", "--samples", "4096", "--out", "reference.csv"]
        run([mrvis, *reference, *options, "--quiet"])
    figures = {}
    for kind, local in [("local pass", []), ("links", ["--local-rays", "0"])]:
        out = f"{kind.split()[0]}-{name}"
        seconds = run([mrvis, "solve", scene, "--points", "points.csv", "--quiet", "--out", out, *options, *local])
        compare = ["compare", "--quiet", "--json", "compare.json"]
        run([mrvis, *compare, "reference.csv", f"{out}/irradiance.csv"])
        found = read("compare.json")
        error = max(found["rms"] ** 2 - found["reference_noise"] ** 2, 0.0) ** 0.5
        run([mrvis, *compare, f"{kind.split()[0]}-{first or name}/irradiance.csv", f"{out}/irradiance.csv"])
        figures[f"{kind}: error"] = f"{100 * error:.2f} %"
        figures[f"{kind}: bias"] = f"{100 * found['bias']:+.2f} %"
        figures[f"{kind}: change"] = f"{100 * read('compare.json')['rms']:.3f} %"
        figures[f"{kind}: user time"] = f"{seconds:.2f} s"
    return figures


def of_elements(mrvis, name, first, args):
    """Errors of the irradiance of elements and of the exported mesh against path-traced references, relative to the mean irradiance."""
    options = args.options.split()
    seconds = run([mrvis, "solve", args.scene, "--output", "vtu,ply", "--audit", "0", "--quiet", "--out", name, *options])
    error, bias, of_mesh, at_points = elements.compare(mrvis, args.scene, name, options, count=300, samples=32)
    figures = {"error": error, "bias": bias, "mesh": of_mesh, "elements at points": at_points}
    return {**{key: f"{100 * value:.3f} %" for key, value in figures.items()}, "user time": f"{seconds:.2f} s"}


def bench(mrvis, name, first, args):
    """Errors of visible fractions, coverage of the stated intervals, and times, for two feature sizes."""
    if first is None:
        forest = ["generate", "forest", "--trees", "25", "--leaves", "500", "--trunks", "--out", "forest.obj", "--quiet"]
        run([mrvis, *forest])
    out = f"bench-{name}.json"
    command = [mrvis, "bench", "forest.obj", "--points", "2000", "--reference-rays", "1024", "--audit", "1", "--cache", "off"]
    command += ["--feature-size", "0.25", "--feature-size", "1", "--quiet", "--json", out]
    subprocess.run(command, check=False)
    figures = {}
    for row in (row for row in read(out)["mr"] if row["rays"] == 64):
        figures[f"s = {row['feature_size']}: RMS"] = f"{row['rms']:.5f}"
        figures[f"s = {row['feature_size']}: in bounds"] = f"{100 * row['interval_coverage']:.1f} %"
        figures[f"s = {row['feature_size']}: exact"] = f"{100 * row['handed_over']:.1f} %"
        figures[f"s = {row['feature_size']}: time"] = f"{1000 * row['seconds']:.1f} ms"
    return figures


def form_factors(mrvis, name, first, args):
    """Error of the matrix against one of 65,536 rays per facet and up to 4,096 per pair, and mean error of row sums before closure."""
    matrix = ["form-factors", "urban.obj", "--enforce=none", "--quiet"]
    if first is None:
        run([mrvis, "generate", "urban-block", "--count", "1000", "--out", "urban.obj", "--quiet"])
        run([mrvis, *matrix, "--rays", "65536", "--pair-rays", "4096", "--seed", "2", "--out", "reference.csv"])

    def entries(path):
        with open(path, encoding="utf-8") as file:
            return {(row["from"], row["to"]): float(row["factor"]) for row in csv.DictReader(file)}

    seconds = run([mrvis, *matrix, "--out", f"{name}.csv", "--json", f"{name}.json"])
    reference, found = entries("reference.csv"), entries(f"{name}.csv")
    square = sum((found.get(k, 0.0) - reference.get(k, 0.0)) ** 2 for k in reference.keys() | found.keys())
    return {
        "error": f"{100 * (square / sum(v * v for v in reference.values())) ** 0.5:.3f} %",
        "row sums": f"{100 * read(f'{name}.json')['report']['row_sum_error']:.3f} %",
        "user time": f"{seconds:.2f} s",
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    experiments = {"solve": solve, "elements": of_elements, "bench": bench, "form-factors": form_factors}
    parser.add_argument("experiment", choices=experiments)
    parser.add_argument("file", help="the file of the constant, for example transport/krylov.rs")
    parser.add_argument("name", help="name of the constant")
    parser.add_argument("values", nargs="*", help="other values, as Rust expressions")
    parser.add_argument("--out", default="out/constants", help="folder for all files (default: out/constants)")
    parser.add_argument("--scene", help="another scene for solve, and the one for elements")
    parser.add_argument("--points", type=int, default=1000, help="number of points of solve (default: 1000)")
    parser.add_argument("--options", default="", help="options of `mrvis solve` and `mrvis reference`, such as --options='--sky overcast:1000'")
    args = parser.parse_args()
    if args.scene:
        args.scene = str(pathlib.Path(args.scene).resolve())
    folder = pathlib.Path(args.out).resolve()
    file = find(args.file, args.name)
    committed = definition(args.name).search(file.read_text(encoding="utf-8")).group(2)
    work = folder / args.experiment
    os.makedirs(work, exist_ok=True)
    os.chdir(work)
    first = None
    for value in [committed, *args.values]:
        mrvis = str(build(file, args.name, value, folder))
        label = re.sub(r"\W+", "-", f"{args.name}-{value}")
        figures = experiments[args.experiment](mrvis, label, first, args)
        if first is None:
            print(f"| {args.name} | {' | '.join(figures)} |\n|{' --- |' * (len(figures) + 1)}")
        print(f"| {value} | {' | '.join(figures.values())} |", flush=True)
        first = first or label


if __name__ == "__main__":
    main()
