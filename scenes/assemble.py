#!/usr/bin/env python3
"""Assembles scenes of real furniture, trees and architecture from installable packages, and three outdoor scenes by formula.

    python3 scenes/assemble.py [livingroom kitchen office park sponza garden orchard valley] [--out scenes/real] [--force]

Furniture and trees come from Debian's package sweethome3d-furniture (models under CC0 and CC-BY; every OBJ file and
CREDITS.txt hold the credits), Sponza comes from the crate `bvh`. layouts.py lists the pieces and their positions. The
script needs only Python's standard library. Equal inputs give equal files.

Each scene is one OBJ file with its MTL file: metres, z up (sponza: y up, its own scale), one object (`o`) per piece of
furniture, the polygons of the original models, and copies of the textures. Only the light panels and skies have a Ke.
"""

import argparse
import hashlib
import json
import math
import os
import random
import re
import shutil
import subprocess
import sys
import tempfile
import zipfile

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path.insert(0, HERE)
sys.dont_write_bytecode = True
import layouts  # noqa: E402
import outdoor  # noqa: E402

CATALOGUES = {
    # short name in layouts.py: (file, licence)
    "CC0": ("BlendSwap-CC-0.sh3f", "CC0 1.0"),
    "CCBY": ("BlendSwap-CC-BY.sh3f", "CC-BY 3.0"),
    "Kator": ("KatorLegaz.sh3f", "CC-BY 3.0 US, (C) Andrew Kator & Jennifer Legaz"),
    "Scopia": ("Scopia.sh3f", "CC-BY 3.0, (C) Emmanuel Puybaret / eTeks and Scopia Visual Interfaces Systems"),
}
BOOK_COLOURS = (
    (0.35, 0.07, 0.06), (0.08, 0.16, 0.30), (0.10, 0.25, 0.12), (0.45, 0.36, 0.20), (0.60, 0.58, 0.52), (0.12, 0.10, 0.10)
)
BVH_CRATE = "=0.12.0"
SPONZA_SHA256 = "f109270c87e563790153e557890c1029eea4fda4ce360b4164fa8682627bd90d"


def say(text):
    print(f"mrvis: scenes: {text}", file=sys.stderr, flush=True)


def stop(text):
    say(text)
    sys.exit(1)


# --- models -----------------------------------------------------------------------------------------------------------


class Model:
    """A model of a catalogue: vertices, polygons by material, materials, size in metres, credit line."""


def unescape(text):
    return re.sub(r"\\u([0-9a-fA-F]{4})", lambda m: chr(int(m[1], 16)), text).strip()


class Catalogue:
    def __init__(self, folder):
        self.folder, self.zips, self.entries, self.models = folder, {}, {}, {}

    def open(self, short):
        if short not in self.zips:
            path = os.path.join(self.folder, CATALOGUES[short][0])
            if not os.path.exists(path):
                stop(f"{path} is missing: install the Debian package sweethome3d-furniture (`make scenes` does)")
            archive = zipfile.ZipFile(path)
            items = {}
            for line in archive.read("PluginFurnitureCatalog.properties").decode("latin-1").splitlines():
                match = re.match(r"(\w+)#(\d+)\s*=\s*(.*)", line)
                if match:
                    items.setdefault(match[2], {})[match[1]] = unescape(match[3])
            self.zips[short] = archive
            self.entries[short] = {item["id"].split("#")[1]: item for item in items.values() if "model" in item}
        return self.zips[short], self.entries[short]

    def model(self, name):
        if name not in self.models:
            self.models[name] = self.read(name)
        return self.models[name]

    def read(self, name):
        short, key = name.split("/", 1)
        archive, entries = self.open(short)
        if key not in entries:
            stop(f"{CATALOGUES[short][0]} has no model {key!r}")
        entry = entries[key]
        path = entry["model"].lstrip("/")
        model = Model()
        model.name, model.archive, model.folder = name, archive, os.path.dirname(path)
        model.size = tuple(float(entry[k]) / 100 for k in ("width", "depth", "height"))
        model.elevation = float(entry.get("elevation", 0)) / 100
        model.credit = f"{entry['name']} ({name}) by {entry.get('creator', 'unknown')}, {CATALOGUES[short][1]}"
        parse_obj(model, archive.read(path).decode("latin-1"))
        rotation = [float(x) for x in entry.get("modelRotation", "1 0 0 0 1 0 0 0 1").split()]
        if rotation != [1, 0, 0, 0, 1, 0, 0, 0, 1]:
            a, b, c, d, e, f, g, h, i = rotation
            model.vertices = [
                (a * x + b * y + c * z, d * x + e * y + f * z, g * x + h * y + i * z) for x, y, z in model.vertices
            ]
        # Catalogue axes: x right, y up, z to the front. Axes here: x right, z up, the front faces -y.
        model.vertices = [(x, -z, y) for x, y, z in model.vertices]
        model.low = [min(v[k] for v in model.vertices) for k in range(3)]
        model.high = [max(v[k] for v in model.vertices) for k in range(3)]
        return model


def parse_obj(model, text):
    """Sets vertices used by faces, texture coordinates, and faces as (material, ((v, vt or -1), ...))."""
    points, texcoords, faces, libraries = [], [], [], []
    material = "default"
    for line in text.replace("\\\n", " ").splitlines():
        head, _, rest = line.partition(" ")
        if head == "v":
            x, y, z = rest.split()[:3]
            points.append((float(x), float(y), float(z)))
        elif head == "vt":
            texcoords.append(tuple(float(t) for t in rest.split()[:2]))
        elif head == "f":
            corners = []
            for token in rest.split():
                index = token.split("/")
                v = int(index[0])
                t = int(index[1]) if len(index) > 1 and index[1] else 0
                corners.append((v - 1 if v > 0 else len(points) + v, t - 1 if t > 0 else (len(texcoords) + t if t else -1)))
            if len(corners) >= 3:
                faces.append((material, corners))
        elif head == "usemtl":
            material = rest.strip()
        elif head == "mtllib":
            libraries.append(rest.strip())
    textured = set()
    model.materials = {}
    for library in libraries:
        try:
            parse_mtl(model, model.archive.read(f"{model.folder}/{library}").decode("latin-1"))
        except KeyError:
            pass
    for key, lines in model.materials.items():
        if any(line.startswith("map_Kd") for line in lines):
            textured.add(key)
    used, keep, model.faces, used_t, keep_t = {}, [], [], {}, []
    for material, corners in faces:
        out = []
        for v, t in corners:
            if v not in used:
                used[v] = len(keep)
                keep.append(points[v])
            if t >= 0 and material in textured:  # omit coordinates that no texture uses
                if t not in used_t:
                    used_t[t] = len(keep_t)
                    keep_t.append(texcoords[t])
                t = used_t[t]
            else:
                t = -1
            out.append((used[v], t))
        model.faces.append((material, out))
    model.vertices, model.texcoords = keep, keep_t


def parse_mtl(model, text):
    current = None
    for line in text.splitlines():
        words = line.split()
        if not words:
            continue
        if words[0] == "newmtl":
            current = model.materials.setdefault(line.split(None, 1)[1].strip() if len(words) > 1 else "default", [])
        elif current is not None and words[0] in ("Kd", "Ks", "Ns", "d", "Tr", "illum", "map_Kd"):
            current.append(line.strip())


# --- a scene ----------------------------------------------------------------------------------------------------------


def clean(text):
    return re.sub(r"[^A-Za-z0-9_.-]+", "_", text)


class Scene:
    def __init__(self, name, catalogue, out, stamp):
        self.name, self.catalogue, self.out = name, catalogue, out
        self.count_v = self.count_t = self.triangles = 0
        self.texcoord_base, self.written, self.mtl, self.textures, self.credits = {}, {}, [], {}, {}
        self.kept, self.boxes = {}, {}
        self.obj = tempfile.TemporaryFile("w+", encoding="utf-8", newline="\n")
        self.stamp = stamp

    # materials

    def material(self, name, kd, ke=None):
        if name not in self.written:
            self.written[name] = name
            self.mtl += [f"newmtl {name}", "Kd %.4g %.4g %.4g" % tuple(kd)]
            if ke:
                self.mtl.append("Ke %.6g %.6g %.6g" % tuple(ke))
            self.mtl.append("")
        return name

    def model_material(self, model, name):
        key = (model.name, name)
        if key in self.written:
            return self.written[key]
        written = base = clean(model.name.replace("/", "_") + "__" + name)
        count = 1
        while written in self.written.values():  # different names can become equal in `clean`
            count += 1
            written = f"{base}_{count}"
        self.written[key] = written
        self.mtl.append(f"newmtl {written}")
        lines = model.materials.get(name)
        if not lines:
            lines = ["Kd 0.6 0.6 0.6"]
        for line in lines:
            if line.startswith("map_Kd"):
                file = line.split(None, 1)[1].strip()
                line = self.texture(model, file)
            if line:
                self.mtl.append(line)
        self.mtl.append("")
        return written

    def texture(self, model, file):
        path = f"{model.folder}/{file}".replace("\\", "/")
        try:
            data = model.archive.read(path)
        except KeyError:
            return None
        name = clean(f"{model.name.replace('/', '_')}__{os.path.basename(file)}")
        self.textures[name] = data
        return f"map_Kd textures/{name}"

    # geometry

    def emit(self, name, vertices, faces, texcoord_base=0):
        """Writes one object. Faces are (material, ((vertex, texture coordinate or -1), ...)), with indices from 0."""
        w = self.obj.write
        w(f"o {name}\n")
        w("".join(["v %.6f %.6f %.6f\n" % v for v in vertices]))
        base, material, lines = self.count_v + 1, None, []
        tbase = texcoord_base + 1
        for face_material, corners in faces:
            if face_material != material:
                material = face_material
                lines.append(f"usemtl {material}\n")
            lines.append(
                "f "
                + " ".join([f"{v + base}/{t + tbase}" if t >= 0 else f"{v + base}" for v, t in corners])
                + "\n"
            )
            self.triangles += len(corners) - 2
        w("".join(lines))
        self.count_v += len(vertices)

    def quad(self, name, corners, material):
        """Writes a quadrilateral; its corners are counter-clockwise seen from the front."""
        self.quads(name, [corners], material)

    def quads(self, name, quads, material):
        vertices, faces = [], []
        for corners in quads:
            faces.append((material, [(len(vertices) + k, -1) for k in range(4)]))
            vertices += corners
        self.emit(name, vertices, faces)

    def box_quads(self, x0, y0, z0, x1, y1, z1):
        p = lambda x, y, z: (x, y, z)
        return [
            [p(x0, y0, z0), p(x0, y1, z0), p(x1, y1, z0), p(x1, y0, z0)],
            [p(x0, y0, z1), p(x1, y0, z1), p(x1, y1, z1), p(x0, y1, z1)],
            [p(x0, y0, z0), p(x1, y0, z0), p(x1, y0, z1), p(x0, y0, z1)],
            [p(x1, y1, z0), p(x0, y1, z0), p(x0, y1, z1), p(x1, y1, z1)],
            [p(x0, y1, z0), p(x0, y0, z0), p(x0, y0, z1), p(x0, y1, z1)],
            [p(x1, y0, z0), p(x1, y1, z0), p(x1, y1, z1), p(x1, y0, z1)],
        ]

    def light_panel(self, name, x, y, z, width, depth, ke, thick=0.03):
        """Writes an emitting rectangle that faces down at height z, and a frame of the given thickness above it."""
        x0, x1, y0, y1 = x - width / 2, x + width / 2, y - depth / 2, y + depth / 2
        light = self.material(f"{name}_light", (0.8, 0.8, 0.8), ke)
        self.quad(name, [(x0, y0, z), (x0, y1, z), (x1, y1, z), (x1, y0, z)], light)
        if thick:
            frame = self.material("panel_frame", (0.7, 0.7, 0.7))
            self.quads(f"{name}_frame", self.box_quads(x0, y0, z, x1, y1, z + thick)[2:], frame)

    def piece(self, piece, room):
        model = self.catalogue.model(piece["model"])
        self.credits[model.name] = model.credit
        width, depth, height = (s * piece.get("scale", 1) for s in piece.get("size", model.size))
        scale = [
            wanted / (high - low) if high > low else 1.0
            for wanted, low, high in zip((width, depth, height), model.low, model.high)
        ]
        turn = piece.get("turn", 0)
        if "wall" in piece:
            turn = {"S": 180, "N": 0, "E": -90, "W": 90}[piece["wall"]]
            off, along = depth / 2 + piece.get("gap", 0.005), piece["along"]
            x, y = {
                "S": (along, off),
                "N": (along, room["size"][1] - off),
                "W": (off, along),
                "E": (room["size"][0] - off, along),
            }[piece["wall"]]
        else:
            x, y = piece["x"], piece["y"]
        c, s = math.cos(math.radians(turn)), math.sin(math.radians(turn))
        if piece.get("hang"):
            z = room["size"][2] - height
        elif "z" in piece:
            z = piece["z"]
        elif "on" in piece:
            steps = [k / 4 * 0.42 for k in range(-4, 5)]
            spots = [
                (x + c * u * width - s * v * depth, y + s * u * width + c * v * depth) for u in steps for v in steps
            ]
            z = self.top_of(piece["on"], spots, piece.get("below", math.inf), piece["name"])
        else:
            z = model.elevation
        mx, my, mz = ((model.low[k] + model.high[k]) / 2 for k in range(3))
        mz = model.low[2]
        ax, bx = c * scale[0], -s * scale[1]
        ay, by = s * scale[0], c * scale[1]
        tx, ty = x - ax * mx - bx * my, y - ay * mx - by * my
        cz, tz = scale[2], z - scale[2] * mz
        vertices = [(ax * u + bx * v + tx, ay * u + by * v + ty, cz * w + tz) for u, v, w in model.vertices]
        names = {m: self.model_material(model, m) for m in dict.fromkeys(m for m, _ in model.faces)}
        if model.texcoords and model.name not in self.texcoord_base:
            self.texcoord_base[model.name] = self.count_t
            self.obj.write("".join(["vt %.5f %.5f\n" % t for t in model.texcoords]))
            self.count_t += len(model.texcoords)
        faces = [(names[m], corners) for m, corners in model.faces]
        self.emit(piece["name"], vertices, faces, self.texcoord_base.get(model.name, 0))
        self.boxes[piece["name"]] = [f(v[k] for v in vertices) for f in (min, max) for k in range(3)]
        if piece["name"] in room["supports"]:
            self.kept[piece["name"]] = [
                (vertices[a[0]], vertices[b[0]], vertices[d[0]])
                for _, corners in model.faces
                for a, b, d in zip([corners[0]] * (len(corners) - 2), corners[1:], corners[2:])
            ]

    # pieces on other pieces

    def crossings(self, triangles, x, y):
        """Heights, ascending, at which the vertical line through (x, y) intersects the triangles."""
        found = []
        for (ax, ay, az), (bx, by, bz), (cx, cy, cz) in triangles:
            if (ax < x and bx < x and cx < x) or (ax > x and bx > x and cx > x):
                continue
            if (ay < y and by < y and cy < y) or (ay > y and by > y and cy > y):
                continue
            d = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
            if abs(d) < 1e-14:
                continue
            u = ((x - ax) * (cy - ay) - (y - ay) * (cx - ax)) / d
            v = ((bx - ax) * (y - ay) - (by - ay) * (x - ax)) / d
            if u >= 0 and v >= 0 and u + v <= 1:
                found.append(az + u * (bz - az) + v * (cz - az))
        return sorted(found)

    def top_of(self, support, spots, below, name):
        if support not in self.kept:
            stop(f"{self.name}: {name!r} stands on {support!r}, which must be placed before it: see layouts.py")
        x0, x1, y0, y1 = (f(p[k] for p in spots) for k in (0, 1) for f in (min, max))
        under = [
            t for t in self.kept[support]
            if max(p[0] for p in t) >= x0 and min(p[0] for p in t) <= x1
            and max(p[1] for p in t) >= y0 and min(p[1] for p in t) <= y1
        ]
        heights = [z for x, y in spots for z in self.crossings(under, x, y) if z < below]
        if not heights:
            stop(f"{self.name}: {name!r} is not above {support!r}: see layouts.py")
        return max(heights)

    def books(self, spec):
        """Fills each board of a bookcase with books where the free height above the board is more than 0.17 m."""
        rng = random.Random(spec["seed"])
        support, side = spec["on"], spec["turn"]
        x0, y0, _, x1, y1, z_top = self.boxes[support]
        along_x = side in (0, 180)
        start, end = (x0, x1) if along_x else (y0, y1)
        middle = (y0 + y1) / 2 if along_x else (x0 + x1) / 2
        room_depth = (y1 - y0) if along_x else (x1 - x0)
        front = {0: -1, 180: 1, 90: 1, -90: -1}[side]
        leather = [
            self.material(f"book_{k}", kd)
            for k, kd in enumerate(BOOK_COLOURS)
        ]
        shelf = self.kept[support]
        depths = [middle - front * room_depth * f for f in (0.15, 0.0, -0.15)]
        quads, materials = [], []
        position, pause = start + 0.01, 0
        while position < end - 0.02:
            thick = 0.014 + 0.034 * rng.random() ** 2
            levels = None
            for t in (0.0, 0.5, 1.0):
                at = position + t * thick
                free = []
                lines = [self.crossings(shelf, *((at, d) if along_x else (d, at))) for d in depths]
                for k, z in enumerate(lines[1]):
                    above = lines[1][k + 1] if k + 1 < len(lines[1]) else (z_top if spec.get("top") is None else z + spec["top"])
                    boards = all(any(abs(o - z) < 0.004 for o in other) for other in (lines[0], lines[2]))
                    if boards and above - z > 0.17:
                        free.append((z, above))
                near = lambda a, b: abs(a[0] - b[0]) < 0.003
                levels = free if levels is None else [a for a in levels if any(near(a, b) for b in free)]
            for z, above in levels or ():
                if rng.random() < 0.12:
                    continue
                tall = min(above - z - 0.02, 0.17 + 0.13 * rng.random())
                deep = min(room_depth - 0.09, 0.12 + 0.09 * rng.random())
                rear = middle - front * (room_depth / 2 - 0.035)
                a, b = sorted((rear, rear + front * deep))
                p0, p1 = position, position + thick - 0.001
                box = (p0, a, z, p1, b, z + tall) if along_x else (a, p0, z, b, p1, z + tall)
                quads += self.box_quads(*box)
                materials += [leather[rng.randrange(len(leather))]] * 6
            position += thick
            if rng.random() < 0.02:
                position += 0.06 * rng.random()
        vertices, faces = [], []
        for corners, material in zip(quads, materials):
            faces.append((material, [(len(vertices) + k, -1) for k in range(4)]))
            vertices += corners
        if not faces:
            stop(f"{self.name}: no board of {support!r} has space for books")
        # The six faces of a book share vertices, so that the book is a closed part (each edge has two faces).
        welded, index = [], {}
        for k, (material, corners) in enumerate(faces):
            out = []
            for v, _ in corners:
                key = (k // 6, vertices[v])
                if key not in index:
                    index[key] = len(welded)
                    welded.append(vertices[v])
                out.append((index[key], -1))
            faces[k] = (material, out)
        self.emit(spec["name"], welded, faces)

    def shell(self, room):
        """Writes floor, ceiling and walls, facing inwards, with openings through the walls."""
        w, d, h = room["size"]
        wall = self.material("wall", room.get("wall_kd", (0.72, 0.70, 0.66)))
        floor = self.material("floor", room.get("floor_kd", (0.42, 0.30, 0.20)))
        ceiling = self.material("ceiling", (0.80, 0.80, 0.79))
        self.quad("floor", [(0, 0, 0), (w, 0, 0), (w, d, 0), (0, d, 0)], floor)
        self.quad("ceiling", [(0, 0, h), (0, d, h), (w, d, h), (w, 0, h)], ceiling)
        for side, long_name in (("S", "south"), ("N", "north"), ("W", "west"), ("E", "east")):
            length = w if side in "SN" else d
            place = {
                "S": lambda u, z, o: (u, -o, z),
                "N": lambda u, z, o: (u, d + o, z),
                "W": lambda u, z, o: (-o, u, z),
                "E": lambda u, z, o: (w + o, u, z),
            }[side]
            flip = side in "SE"  # the corners below are in the order for the other two walls
            quads = []

            def add(corners):
                corners = [place(*p) for p in corners]
                quads.append(corners[::-1] if flip else corners)

            holes = sorted((o for o in room.get("openings", ()) if o["wall"] == side), key=lambda o: o["from"])
            u = 0.0
            for hole in holes:
                a, b, z0, z1, t = hole["from"], hole["to"], hole["bottom"], hole["top"], hole.get("thick", 0.3)
                add([(a, 0, 0), (a, h, 0), (u, h, 0), (u, 0, 0)])
                add([(b, z1, 0), (b, h, 0), (a, h, 0), (a, z1, 0)])
                if z0 > 0:
                    add([(b, 0, 0), (b, z0, 0), (a, z0, 0), (a, 0, 0)])
                add([(a, z0, 0), (a, z0, t), (b, z0, t), (b, z0, 0)][::-1])
                add([(a, z1, 0), (a, z1, t), (b, z1, t), (b, z1, 0)])
                add([(a, z0, 0), (a, z0, t), (a, z1, t), (a, z1, 0)])
                add([(b, z0, 0), (b, z0, t), (b, z1, t), (b, z1, 0)][::-1])
                u = b
            add([(length, 0, 0), (length, h, 0), (u, h, 0), (u, 0, 0)])
            self.quads(f"wall_{long_name}", quads, wall)

    # files

    def write(self, up="z", unit="metres"):
        os.makedirs(os.path.join(self.out, "textures"), exist_ok=True)
        for name, data in sorted(self.textures.items()):
            with open(os.path.join(self.out, "textures", name), "wb") as file:
                file.write(data)
        origin = [
            "# The models below were scaled, turned, placed and given other material names; normals were left out.",
            "# Credits and licences of the models:",
            *[f"#   {self.credits[k]}" for k in sorted(self.credits)],
        ]
        head = [
            f"# {self.name}: assembled by mrvis scenes/assemble.py ({self.stamp})",
            f"# units: {unit}, {up} up; {self.triangles} triangles after triangulation",
            *(origin if self.credits else []),
            f"mtllib {self.name}.mtl",
        ]
        with replacing(os.path.join(self.out, f"{self.name}.mtl")) as file:
            file.write("\n".join(head[:1] + origin[1:] * bool(self.credits) + [""] + self.mtl) + "\n")
        self.obj.seek(0)
        with replacing(os.path.join(self.out, f"{self.name}.obj")) as file:
            file.write("\n".join(head) + "\n")
            shutil.copyfileobj(self.obj, file, 1 << 20)
        self.obj.close()


class replacing:
    """Opens a temporary file for writing and renames it when it is complete."""

    def __init__(self, path):
        self.path = path

    def __enter__(self):
        self.file = open(self.path + ".part", "w", encoding="utf-8", newline="\n")
        return self.file

    def __exit__(self, kind, *_):
        self.file.close()
        if kind is None:
            os.replace(self.path + ".part", self.path)
        else:
            os.unlink(self.path + ".part")


# --- the scenes -------------------------------------------------------------------------------------------------------


def furnished(name, catalogue, out, stamp):
    layout = layouts.SCENES[name]
    scene = Scene(name, catalogue, out, stamp)
    room = dict(layout["room"])
    room["supports"] = {p["on"] for p in layout["pieces"] if "on" in p} | {b["on"] for b in layout.get("books", ())}
    if room.get("outdoors"):
        w, d, _ = room["size"]
        for ground in layout["ground"]:
            x0, y0, x1, y1 = ground["box"]
            z = ground.get("z", 0.0)
            material = scene.material(ground["name"], ground["kd"])
            scene.quad(ground["name"], [(x0, y0, z), (x1, y0, z), (x1, y1, z), (x0, y1, z)], material)
    else:
        scene.shell(room)
    for light in layout["lights"]:
        scene.light_panel(**light)
    names = set()
    for piece in layout["pieces"]:
        if piece["name"] in names:
            stop(f"{name}: two pieces have the name {piece['name']!r}")
        names.add(piece["name"])
        scene.piece(piece, room)
    for spec in layout.get("books", ()):
        scene.books(spec)
    scene.write()
    return scene


def sponza(name, catalogue, out, stamp):
    source = fetch_sponza()
    scene = Scene(name, catalogue, out, stamp)
    for material in sorted(set(re.findall(r"^usemtl\s+(\S+)", source, re.M))):
        scene.material(material, (0.55, 0.51, 0.44))
    lines = [line for line in source.splitlines() if not line.startswith("mtllib")]
    scene.count_v = sum(1 for line in lines if line.startswith("v "))
    scene.triangles = sum(len(line.split()) - 3 for line in lines if line.startswith("f "))
    # Groups (`g`) become objects (`o`) as in the other scenes.
    scene.obj.write("\n".join(re.sub(r"^g ", "o ", line) for line in lines) + "\n")
    panel = layouts.SPONZA_PANEL
    x0, z0, x1, z1 = panel["box"]
    y = panel["height"]
    light = scene.material("sky_panel_light", (0.8, 0.8, 0.8), panel["ke"])
    scene.quad("sky_panel", [(x0, y, z0), (x1, y, z0), (x1, y, z1), (x0, y, z1)], light)
    scene.credits["sponza"] = (
        f"Sponza atrium, modelled by Marko Dabrovic, as shipped in the crate bvh {BVH_CRATE[1:]} (media/sponza.obj);"
        " light panel and materials added"
    )
    scene.write(up="y", unit="the model's own, about metres")
    return scene


OUTDOOR = {"garden": outdoor.garden, "orchard": outdoor.orchard, "valley": outdoor.valley}


def by_formula(name, catalogue, out, stamp):
    scene = Scene(name, catalogue, out, stamp)
    OUTDOOR[name](scene)
    scene.write()
    return scene


# By scene, what writes it: functions of its name, the catalogue, the folder and the fingerprint.
MAKERS = {
    **dict.fromkeys(layouts.SCENES, furnished),
    "sponza": sponza,
    **dict.fromkeys(OUTDOOR, by_formula),
}


def fetch_sponza():
    """Returns media/sponza.obj of the crate `bvh`. cargo fetches the crate as a dependency of a temporary package."""
    cargo = os.environ.get("CARGO", "cargo")
    with tempfile.TemporaryDirectory() as work:
        with open(os.path.join(work, "Cargo.toml"), "w") as file:
            file.write(
                '[package]\nname = "fetch"\nversion = "0.0.0"\nedition = "2021"\n[lib]\npath = "lib.rs"\n'
                f'[dependencies]\nbvh = "{BVH_CRATE}"\n[workspace]\n'
            )
        open(os.path.join(work, "lib.rs"), "w").close()
        try:
            answer = subprocess.run(
                [cargo, "metadata", "--format-version", "1"],
                cwd=work, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
            )
        except OSError as error:
            stop(f"sponza needs cargo to fetch the crate bvh: {error}")
        if answer.returncode != 0:
            stop("sponza: cargo could not fetch the crate bvh:\n" + answer.stderr.strip())
        packages = json.loads(answer.stdout)["packages"]
        manifest = next(p["manifest_path"] for p in packages if p["name"] == "bvh")
        path = os.path.join(os.path.dirname(manifest), "media", "sponza.obj")
        if not os.path.exists(path):
            stop("sponza: the crate bvh has no media/sponza.obj")
        with open(path, "rb") as file:
            data = file.read()
    if hashlib.sha256(data).hexdigest() != SPONZA_SHA256:
        stop("sponza: media/sponza.obj of the crate bvh has an unexpected SHA-256 hash")
    return data.decode("utf-8")


# --- checks and the command -------------------------------------------------------------------------------------------


def check(path):
    """Reads a written file and checks indices, numbers and materials. Returns the numbers of vertices and triangles."""
    known = set()
    with open(path[:-4] + ".mtl", encoding="utf-8") as file:
        for line in file:
            if line.startswith("newmtl "):
                known.add(line[7:].strip())
    v = t = triangles = 0
    with open(path, encoding="utf-8") as file:
        for number, line in enumerate(file, 1):
            if line.startswith("v "):
                if not all(map(math.isfinite, map(float, line[2:].split()))):
                    stop(f"{path}:{number}: not a finite vertex")
                v += 1
            elif line.startswith("vt "):
                t += 1
            elif line.startswith("f "):
                corners = line[2:].split()
                for corner in corners:
                    index = corner.split("/")
                    if not 1 <= int(index[0]) <= v or (len(index) > 1 and index[1] and not 1 <= int(index[1]) <= t):
                        stop(f"{path}:{number}: index out of range: {corner}")
                triangles += len(corners) - 2
            elif line.startswith("usemtl ") and line[7:].strip() not in known:
                stop(f"{path}:{number}: unknown material {line[7:].strip()}")
    return v, triangles


def fingerprint(name, folder):
    digest = hashlib.sha256(name.encode())
    for file in ("assemble.py", "layouts.py", "outdoor.py"):
        with open(os.path.join(HERE, file), "rb") as data:
            digest.update(data.read())
    for file, _ in CATALOGUES.values():
        path = os.path.join(folder, file)
        digest.update(f"{file} {os.path.getsize(path) if os.path.exists(path) else None}".encode())
    return digest.hexdigest()[:16]


def up_to_date(path, stamp):
    try:
        with open(path, encoding="utf-8") as file:
            return stamp in file.readline() and os.path.exists(path[:-4] + ".mtl")
    except OSError:
        return False


def main():
    every = list(MAKERS)
    parser = argparse.ArgumentParser(description="Assembles scenes of real furniture, trees and architecture.", epilog="scenes: " + ", ".join(every))
    parser.add_argument("scenes", nargs="*", metavar="SCENE", help="scenes to assemble (default: all)")
    parser.add_argument("--out", default=os.path.join(HERE, "real"), help="folder to write into (default: scenes/real)")
    parser.add_argument("--force", action="store_true", help="also write scenes that are up to date")
    parser.add_argument("--furniture", default="/usr/share/sweethome3d/furniture", help="folder of the .sh3f catalogues")
    args = parser.parse_args()
    wanted = args.scenes or every
    unknown = [name for name in wanted if name not in every]
    if unknown:
        parser.error(f"unknown scene: {', '.join(unknown)}; available: {', '.join(every)}")
    os.makedirs(args.out, exist_ok=True)
    for name in wanted:
        path = os.path.join(args.out, f"{name}.obj")
        stamp = fingerprint(name, args.furniture)
        if not args.force and up_to_date(path, stamp):
            say(f"{name} is up to date")
            continue
        catalogue = Catalogue(args.furniture)  # one per scene, to free the memory of the previous one
        MAKERS[name](name, catalogue, args.out, stamp)
        vertices, triangles = check(path)
        size = os.path.getsize(path) / 1e6
        say(f"{name}: {triangles} triangles, {vertices} vertices, {size:.0f} MB, in {os.path.relpath(path)}")
    write_credits(args.out)


def write_credits(out):
    lines = ["Credits and licences of the models in these scenes (also at the head of each OBJ file).", ""]
    for file in sorted(os.listdir(out)):
        if file.endswith(".obj"):
            lines.append(file)
            with open(os.path.join(out, file), encoding="utf-8") as data:
                for line in data:
                    if line.startswith("#   "):
                        lines.append("  " + line[4:].rstrip())
                    elif not line.startswith("#"):
                        break
            lines.append("")
    with replacing(os.path.join(out, "CREDITS.txt")) as file:
        file.write("\n".join(lines))


if __name__ == "__main__":
    main()
