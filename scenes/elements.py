"""Compares the irradiance of elements (`solution.vtu`) and of the exported mesh (`solution.ply`) with path-traced references.

Elements are drawn with a probability proportional to their area. The reference of an element is the mean over points that are
drawn on it at random; its noise is estimated from their spread and subtracted. It needs only Python's standard library.
"""

import array
import bisect
import csv
import hashlib
import os
import pathlib
import random
import re
import statistics
import struct
import subprocess


def read_vtu(path):
    """Returns the arrays of a `.vtu` file with appended raw data as {name: list of tuples or numbers}."""
    data = open(path, "rb").read()
    start = data.index(b"_", data.index(b"<AppendedData")) + 1
    codes = {"Float64": "d", "Float32": "f", "UInt64": "Q", "UInt32": "I", "UInt8": "B"}
    found = {}
    for kind, name, components, offset in re.findall(
        rb'<DataArray type="(\w+)" Name="(\w+)" NumberOfComponents="(\d+)" format="appended" offset="(\d+)"', data[:start]
    ):
        at, width = start + int(offset), int(components)
        size = struct.unpack_from("<Q", data, at)[0]
        values = array.array(codes[kind.decode()])
        values.frombytes(data[at + 8 : at + 8 + size])
        found[name.decode()] = list(zip(*[iter(values)] * width)) if width > 1 else list(values)
    return found


def on_mesh(vtu, path):
    """Returns the mean irradiance of the exported mesh (a `.ply` file of mrvis) over each element, by linear interpolation.

    Triangles state their element, the number of the cell in the `.vtu` file.
    """
    data = open(path, "rb").read()
    end = data.index(b"end_header\n") + len(b"end_header\n")
    head = data[:end].decode("ascii")
    counts = {name: int(count) for name, count in re.findall(r"element (\w+) (\d+)", head)}
    fields = re.findall(r"property (float|double|uchar) (\w+)", head)
    layout = struct.Struct("<" + "".join({"float": "f", "double": "d", "uchar": "B"}[kind] for kind, _ in fields))
    light = [name for _, name in fields].index("irradiance_r")
    faces = end + counts["vertex"] * layout.size
    vertices = [(v[:3], v[light : light + 3]) for v in layout.iter_unpack(data[end:faces])]
    filled, sums = [0.0] * len(vtu["area"]), [[0.0, 0.0, 0.0] for _ in vtu["area"]]
    for _, i, j, k, element in struct.iter_unpack("<BiiiI", data[faces:]):
        corners = [vertices[i], vertices[j], vertices[k]]
        a, b, c = (place for place, _ in corners)
        own = 0.5 * length(cross(subtract(b, a), subtract(c, a)))
        filled[element] += own
        for channel in range(3):
            sums[element][channel] += own * sum(irradiance[channel] for _, irradiance in corners) / 3
    # Elements that are thinner than the rounding of coordinates have no area in the file.
    means = [[s / f if f > 0.0 else e for s, e in zip(row, own)] for row, f, own in zip(sums, filled, vtu["irradiance"])]
    return means


def subtract(a, b):
    return tuple(x - y for x, y in zip(a, b))


def cross(a, b):
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def length(a):
    return sum(x * x for x in a) ** 0.5


def draw_elements(vtu, count, each, seed):
    """Yields (element, [(position, unit normal), ...]) for `count` elements drawn by area, with `each` points."""
    draw, sums, total = random.Random(seed), [], 0.0
    for area in vtu["area"]:
        total += area
        sums.append(total)
    for k in range(count):
        e = min(bisect.bisect(sums, (k + draw.random()) / count * total), len(sums) - 1)
        begin = vtu["offsets"][e - 1] if e else 0
        corners = [vtu["points"][i] for i in vtu["connectivity"][begin : vtu["offsets"][e]]]
        halves = [(corners[0], corners[i], corners[i + 1]) for i in range(1, len(corners) - 1)]
        normals = [cross(subtract(b, a), subtract(c, a)) for a, b, c in halves]
        sizes = [length(n) for n in normals]
        made = []
        for i in range(each):
            # Stratified over the halves of a quadrilateral by area.
            pick = (i + draw.random()) / each * sum(sizes)
            h = 0 if pick < sizes[0] or len(halves) == 1 else 1
            (a, b, c), normal = halves[h], normals[h]
            r, v = draw.random() ** 0.5, draw.random()
            place = tuple(p + r * ((1 - v) * (q - p) + v * (s - p)) for p, q, s in zip(a, b, c))
            made.append((place, tuple(x / sizes[h] for x in normal)))
        yield e, made


def compare(mrvis, scene, folder, options=(), count=500, each=16, samples=128, seed=7):
    """Returns the RMS error and the bias of the irradiance of the elements in `folder`/solution.vtu, the RMS error of the mean
    that the mesh in `folder`/solution.ply has over the elements, and the RMS error of elements at single points, all relative to the
    mean irradiance; the reference's noise is subtracted.

    `options` are options of `mrvis reference` that the solution needs as well, such as `--unit`. References are kept in the working
    folder for other solutions with the same elements.
    """
    vtu = read_vtu(f"{folder}/solution.vtu")
    mesh = on_mesh(vtu, f"{folder}/solution.ply")
    drawn = list(draw_elements(vtu, count, each, seed))
    with open("elements.csv", "w", encoding="utf-8") as file:
        file.write("x,y,z,nx,ny,nz\n")
        for _, points in drawn:
            for place, normal in points:
                file.write(",".join(repr(float(x)) for x in place + normal) + "\n")
    digest = hashlib.sha256(pathlib.Path("elements.csv").read_bytes()).hexdigest()[:12]
    reference = f"elements-{samples}-{digest}.csv"
    if not os.path.exists(reference):
        command = [mrvis, "reference", scene, "--points", "elements.csv", "--samples", str(samples), "--quiet"]
        subprocess.run([*command, "--out", reference, *options], check=True)
    with open(reference, encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    values = [sum(float(row[channel]) for channel in ("Er", "Eg", "Eb")) / 3 for row in rows]
    variances = [sum(float(row[channel]) ** 2 for channel in ("Er_se", "Eg_se", "Eb_se")) / 9 for row in rows]
    level = sum(area * sum(light) / 3 for area, light in zip(vtu["area"], vtu["irradiance"])) / sum(vtu["area"])
    squares, mesh_squares, noise, bias = 0.0, 0.0, 0.0, 0.0
    point_squares = -sum(variances) / each
    for k, (element, _) in enumerate(drawn):
        own = values[k * each : (k + 1) * each]
        light = sum(vtu["irradiance"][element]) / 3
        difference = light - statistics.fmean(own)
        point_squares += statistics.fmean((light - value) ** 2 for value in own)
        squares += difference**2
        mesh_squares += (sum(mesh[element]) / 3 - statistics.fmean(own)) ** 2
        noise += statistics.variance(own) / each
        bias += difference
    rms, of_mesh = (max((sum_ - noise) / count, 0.0) ** 0.5 / level for sum_ in (squares, mesh_squares))
    return rms, bias / count / level, of_mesh, max(point_squares / count, 0.0) ** 0.5 / level
