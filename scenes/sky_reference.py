#!/usr/bin/env python3
"""Values of other programs that the tests of src/sky compare with: writes src/sky/tests/reference.csv, or compares with it.

    python3 -m venv venv && venv/bin/pip install pvlib pyradiance
    venv/bin/python scenes/sky_reference.py src/sky/tests/reference.csv          # write
    venv/bin/python scenes/sky_reference.py --check src/sky/tests/reference.csv  # fail if a value differs by 1e-4

Radiance of the sky is traced with Radiance (`gendaylit` or `gensky`, `oconv`, `rtrace`) and divided by that at the zenith. Irradiances of clear
skies and positions of the sun are pvlib's. The sun of a sky is in the south; directions are azimuth clockwise from north and elevation, degrees.
"""

import csv
import importlib.metadata
import math
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import pandas
import pvlib
import pyradiance

FOLDER = Path(pyradiance.__file__).parent
ENVIRONMENT = os.environ | {"RAYPATH": str(FOLDER / "lib")}
COLUMNS = ["what", "a", "b", "c", "azimuth", "elevation", "value"]

# Clearness and brightness, one pair or two a bin, and elevations of the sun.
PEREZ = [
    (1.03, 0.20, 25), (1.03, 0.45, 50), (1.15, 0.30, 40), (1.35, 0.35, 15), (1.35, 0.25, 60), (1.7, 0.30, 35), (2.3, 0.25, 50),
    (3.5, 0.17, 20), (5.0, 0.12, 45), (5.0, 0.10, 70), (8.0, 0.07, 30), (8.0, 0.08, 60),
]
# Not at the sun's cusp, where the direction of a printed unit vector matters.
DIRECTIONS = [(0, 10), (0, 45), (90, 5), (90, 30), (140, 60), (180, 12), (180, 80), (185, 38), (240, 25), (300, 70)]


def run(program, *arguments, text=None):
    command = [str(FOLDER / "bin" / program), *map(str, arguments)]
    done = subprocess.run(command, input=text, capture_output=True, text=True, env=ENVIRONMENT, check=True)
    return done.stdout


def traced(description, directions):
    """Radiance in directions by rtrace, without the blend with the ground near the horizon that the .cal files add."""
    glow = "\nskyfunc glow glow\n0\n0\n4 1 1 1 0\nglow source dome\n0\n0\n4 0 0 1 180\n"
    sky = description[description.index("void brightfunc"):] + glow
    rays = []
    for azimuth, elevation in directions:
        a, e = math.radians(azimuth), math.radians(elevation)
        rays.append(f"0 0 0 {math.sin(a) * math.cos(e):.9f} {math.cos(a) * math.cos(e):.9f} {math.sin(e):.9f}")
    with tempfile.TemporaryDirectory() as folder:
        octree = Path(folder) / "sky.oct"
        command = [str(FOLDER / "bin" / "oconv"), "-"]
        octree.write_bytes(subprocess.run(command, input=sky.encode(), capture_output=True, env=ENVIRONMENT, check=True).stdout)
        lines = run("rtrace", "-h", "-ab", 0, "-w", octree, text="\n".join(rays) + "\n").split("\n")
    values = [float(line.split()[0]) for line in lines if line.strip()]
    weights = [(math.sin(math.radians(e)) + 1.01) ** 10 for _, e in directions]
    return [v * (w + 1 / w) / w for v, w in zip(values, weights)]


def radiances():
    directions = [(0, 90), *DIRECTIONS]
    for clearness, brightness, elevation in PEREZ:
        sky = run("gendaylit", "-ang", elevation, 0, "-P", clearness, brightness, "-O", 1, "-g", 0)
        zenith, *values = traced(sky, directions)
        for (azimuth, height), value in zip(DIRECTIONS, values):
            yield "perez", clearness, brightness, elevation, azimuth, height, value / zenith
    for name, option, elevations in [("clear", "-s", [20, 45, 65]), ("overcast", "-c", [40])]:
        for elevation in elevations:
            zenith, *values = traced(run("gensky", "-ang", elevation, 0, option, "-g", 0), directions)
            for (azimuth, height), value in zip(DIRECTIONS, values):
                yield name, "", "", elevation, azimuth, height, value / zenith


def efficacies():
    """Luminous efficacy of diffuse and direct light: ratios of gendaylit's two outputs, which have four digits."""
    for direct, diffuse, elevation in [(600, 150, 40), (50, 200, 30), (850, 90, 55), (300, 250, 50), (5, 120, 25)]:
        outputs = []
        for kind in (1, 2):
            words = run("gendaylit", "-ang", elevation, 0, "-W", direct, diffuse, "-O", kind, "-g", 0).split()
            sun = float(words[words.index("light") + 5])
            sky = float(words[words.index("perezlum.cal") + 3])
            outputs.append((sun, sky))
        (sun, sky), (lux_sun, lux_sky) = outputs
        yield "direct efficacy", direct, diffuse, elevation, "", "", lux_sun / sun
        yield "diffuse efficacy", direct, diffuse, elevation, "", "", lux_sky / sky


def clear_skies():
    for turbidity, elevation, altitude in [(2, 60, 0), (3, 30, 0), (3, 75, 500), (4.5, 45, 1500), (6, 10, 0), (2.5, 5, 2500)]:
        mass = pvlib.atmosphere.get_relative_airmass(90 - elevation, "kastenyoung1989")
        mass = pvlib.atmosphere.get_absolute_airmass(mass, pvlib.atmosphere.alt2pres(altitude))
        sky = pvlib.clearsky.ineichen(90 - elevation, mass, turbidity, altitude, 1367.0)
        yield "clear direct", turbidity, elevation, altitude, "", "", sky["dni"]
        yield "clear diffuse", turbidity, elevation, altitude, "", "", sky["dhi"]


def positions():
    for time, latitude, longitude in [
        ("2026-06-21T12:00:00+02:00", 48.137, 11.575),
        ("2026-12-21T09:30:00-05:00", 40.713, -74.006),
        ("1999-03-20T15:45:30+09:00", -33.9, 151.2),
        ("2024-02-29T23:10:00+00:00", 64.1, -140.0),
        ("2050-09-01T06:00:00+00:00", 0.0, 30.0),
    ]:
        when = pandas.DatetimeIndex([pandas.Timestamp(time)])
        at = pvlib.solarposition.spa_python(when, latitude, longitude, 0, pvlib.atmosphere.alt2pres(0), 12, delta_t=None)
        yield "sun", time, latitude, longitude, at["azimuth"].iloc[0], at["apparent_elevation"].iloc[0], ""


def rows():
    for source in (radiances, efficacies, clear_skies, positions):
        for row in source():
            # Angles of the sun need more digits.
            yield [str(v) if not isinstance(v, float) else f"{v:.9g}" if k in (4, 5) else f"{v:.6g}" for k, v in enumerate(row)]


def main():
    path = Path(sys.argv[-1])
    if "--check" not in sys.argv:
        with path.open("w", newline="") as file:
            versions = [f"{name} {importlib.metadata.version(name)}" for name in ("pyradiance", "pvlib")]
            print("# Written by scenes/sky_reference.py: values of", " and ".join(versions), file=file)
            csv.writer(file, lineterminator="\n").writerows([COLUMNS, *rows()])
        return
    with path.open() as file:
        stored = list(csv.reader(line for line in file if not line.startswith("#")))[1:]
    fresh = list(rows())
    assert len(stored) == len(fresh), f"{len(stored)} rows stored, {len(fresh)} computed"
    for old, new in zip(stored, fresh):
        for a, b in zip(old, new):
            if a != b and abs(float(a) - float(b)) > 1e-4 * abs(float(b)):
                sys.exit(f"stored {old}, computed {new}: write the file again")
    print(f"{len(stored)} values as stored")


if __name__ == "__main__":
    main()
