"""Compares the irradiance of elements (`solution.vtu`) and of the exported mesh (`solution.ply`) with path-traced references.

Elements are drawn with a probability proportional to their area, and points on them at random. The reference of an element is the mean
over its points; its noise is estimated from their spread and subtracted. It needs only Python's standard library.
"""

import array
import bisect
import collections
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


class Mesh:
    """The exported mesh of a solution (a `.ply` file of mrvis), whose triangles state their element, the number of the cell in the `.vtu` file."""

    def __init__(self, path):
        data = open(path, "rb").read()
        end = data.index(b"end_header\n") + len(b"end_header\n")
        head = data[:end].decode("ascii")
        counts = {name: int(count) for name, count in re.findall(r"element (\w+) (\d+)", head)}
        fields = re.findall(r"property (float|double|uchar) (\w+)", head)
        layout = struct.Struct("<" + "".join({"float": "f", "double": "d", "uchar": "B"}[kind] for kind, _ in fields))
        light = [name for _, name in fields].index("irradiance_r")
        faces = end + counts["vertex"] * layout.size
        self.vertices = [(v[:3], sum(v[light : light + 3]) / 3) for v in layout.iter_unpack(data[end:faces])]
        self.triangles = collections.defaultdict(list)
        for _, i, j, k, element in struct.iter_unpack("<BiiiI", data[faces:]):
            self.triangles[element].append((i, j, k))

    def light_at(self, element, place):
        """The irradiance at a point of an element by linear interpolation, mean of the channels; None if the element has no area in the file."""
        found = []
        for triangle in self.triangles[element]:
            (a, b, c), light = zip(*(self.vertices[i] for i in triangle))
            normal = cross(subtract(b, a), subtract(c, a))
            size = dot(normal, normal)
            if size > 0.0:
                to = subtract(place, a)
                v = dot(cross(to, subtract(c, a)), normal) / size
                w = dot(cross(subtract(b, a), to), normal) / size
                weights = (1.0 - v - w, v, w)
                found.append((min(weights), dot(weights, light)))
        return max(found)[1] if found else None


def dot(a, b):
    return sum(x * y for x, y in zip(a, b))


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


def irradiance(mrvis, scene, points, samples, seed, options):
    """Returns the path-traced irradiance at the points of a file, mean of the channels. Results are kept in the working folder."""
    digest = hashlib.sha256(pathlib.Path(points).read_bytes()).hexdigest()[:12]
    path = f"elements-{samples}-{seed}-{digest}.csv"
    if not os.path.exists(path):
        command = [mrvis, "reference", scene, "--points", points, "--samples", str(samples), "--seed", str(seed), "--quiet"]
        subprocess.run([*command, "--out", path, *options], check=True)
    with open(path, encoding="utf-8") as file:
        return [sum(float(row[channel]) for channel in ("Er", "Eg", "Eb")) / 3 for row in csv.DictReader(file)]


def compare(mrvis, scene, folder, options=(), count=500, each=16, samples=64, seed=7):
    """Returns the RMS error and the bias of the irradiance of elements in `folder`/solution.vtu, and the RMS errors of the mesh in
    `folder`/solution.ply and of elements at single points, all relative to the mean irradiance.

    `options` are options of `mrvis reference` that the solution needs as well, such as `--unit`. Errors at points are products of the
    differences from two independent references, which contain no noise of the references.
    """
    vtu, mesh = read_vtu(f"{folder}/solution.vtu"), Mesh(f"{folder}/solution.ply")
    drawn = list(draw_elements(vtu, count, each, seed))
    with open("elements.csv", "w", encoding="utf-8") as file:
        file.write("x,y,z,nx,ny,nz\n")
        for _, points in drawn:
            for place, normal in points:
                file.write(",".join(repr(float(x)) for x in place + normal) + "\n")
    pairs = list(zip(*(irradiance(mrvis, scene, "elements.csv", samples, of, options) for of in (1, 2))))
    level = sum(area * sum(light) / 3 for area, light in zip(vtu["area"], vtu["irradiance"])) / sum(vtu["area"])
    squares = mesh_squares = point_squares = bias = 0.0
    for k, (element, points) in enumerate(drawn):
        own = pairs[k * each : (k + 1) * each]
        means = [(a + b) / 2 for a, b in own]
        light = sum(vtu["irradiance"][element]) / 3
        difference = light - statistics.fmean(means)
        bias += difference
        squares += difference**2 - statistics.variance(means) / each
        point_squares += statistics.fmean((light - a) * (light - b) for a, b in own)
        on_mesh = [mesh.light_at(element, place) for place, _ in points]
        # Elements that are thinner than the rounding of coordinates have no area in the file.
        at = [light if value is None else value for value in on_mesh]
        mesh_squares += statistics.fmean((m - a) * (m - b) for m, (a, b) in zip(at, own))
    rms, of_mesh, at_points = (max(sum_ / count, 0.0) ** 0.5 / level for sum_ in (squares, mesh_squares, point_squares))
    return rms, bias / count / level, of_mesh, at_points
