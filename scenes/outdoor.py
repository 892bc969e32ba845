"""A garden, an orchard and a mountain valley, made by formulas and random numbers. Garden and valley lie under a closed sky of uniform colour, the
orchard under a bright part of the sky."""

import math
import random

SKY = (1.0, 1.1, 1.3)


def garden(scene):
    """Fourteen trees of 3,000 leaves, four hedges of 6,000, a bench, a wall and a house on a disc of 80 m. Metres."""
    draw = random.Random(3)
    grass, leaf = scene.material("grass", (0.2, 0.35, 0.12)), scene.material("leaf", (0.15, 0.4, 0.1))
    wood, stone = scene.material("wood", (0.45, 0.3, 0.2)), scene.material("stone", (0.6, 0.58, 0.55))
    radius, around, rings = 40.0, 60, 6
    dome(scene, radius, around, 12, 0.0)
    vertices = [(0.0, 0.0, 0.0)]
    for ring in range(1, rings + 1):
        for i in range(around):
            angle, r = 2 * math.pi * i / around, radius * ring / rings
            vertices.append((r * math.cos(angle), r * math.sin(angle), 0.0))
    faces = [[0, 1 + i, 1 + (i + 1) % around] for i in range(around)]
    for ring in range(rings - 1):
        for i in range(around):
            a, b = 1 + around * ring + i, 1 + around * ring + (i + 1) % around
            faces += [[a, a + around, b + around], [a, b + around, b]]
    mesh(scene, "ground", grass, vertices, faces)
    for tree in range(14):
        angle, distance = draw.uniform(0, 2 * math.pi), draw.uniform(3, 16)
        x, y, height, r = distance * math.cos(angle), distance * math.sin(angle), draw.uniform(1.2, 3), draw.uniform(0.5, 1.5)
        scene.quads(f"trunk_{tree}", scene.box_quads(x - 0.06, y - 0.06, 0, x + 0.06, y + 0.06, height), wood)
        leaves = []
        for _ in range(3000):
            p = in_ball(draw)
            leaves.append(diamond(draw, (x + r * p[0], y + r * p[1], height + 0.9 * r * (1 + p[2])), 0.09))
        scene.quads(f"crown_{tree}", leaves, leaf)
    for hedge, (x, y) in enumerate([(-9, -9), (9, -9), (-9, 9), (6, 6)]):
        place = lambda: (x + draw.uniform(-3, 3), y + draw.uniform(-0.35, 0.35), draw.uniform(0.05, 1.2))
        scene.quads(f"hedge_{hedge}", [diamond(draw, place(), 0.06) for _ in range(6000)], leaf)
    boxes = [(1.2, -1.2, 0.4, 2.8, -0.8, 0.45), (1.27, -1.2, 0, 1.33, -0.8, 0.399), (2.67, -1.2, 0, 2.73, -0.8, 0.399)]
    scene.quads("bench", [quad for box in boxes for quad in scene.box_quads(*box)], wood)
    scene.quads("wall", scene.box_quads(-7, 2.85, 0, -1, 3.15, 1.6), stone)
    scene.quads("house", scene.box_quads(6, -2.5, 0, 10, 2.5, 3), stone)


def orchard(scene):
    """Thirty trees of 3,000 leaves in five rows, two hedges of 8,000, a bench and a wall on a meadow of 36 m by 30 m. Metres."""
    draw = random.Random(7)
    grass, leaf = scene.material("grass", (0.2, 0.35, 0.12)), scene.material("leaf", (0.15, 0.4, 0.1))
    wood, stone = scene.material("wood", (0.45, 0.3, 0.2)), scene.material("stone", (0.6, 0.58, 0.55))
    scene.quads("meadow", [[(-18, -15, 0), (18, -15, 0), (18, 15, 0), (-18, 15, 0)]], grass)
    for row in range(5):
        for place in range(6):
            x, y = 5.4 * (place - 2.5) + draw.uniform(-0.4, 0.4), 5.2 * (row - 2) + draw.uniform(-0.4, 0.4)
            height, r = draw.uniform(1.4, 2.0), draw.uniform(1.1, 1.6)
            name = f"{row + 1}_{place + 1}"
            scene.quads(f"trunk_{name}", scene.box_quads(x - 0.08, y - 0.08, 0, x + 0.08, y + 0.08, height + 0.5 * r), wood)
            leaves = []
            for _ in range(3000):
                p = in_ball(draw)
                leaves.append(diamond(draw, (x + r * p[0], y + r * p[1], height + 0.9 * r * (1 + p[2])), 0.09))
            scene.quads(f"crown_{name}", leaves, leaf)
    for hedge, y in enumerate([-14.2, 14.2]):
        at = lambda: (draw.uniform(-16, 16), y + draw.uniform(-0.35, 0.35), draw.uniform(0.05, 1.2))
        scene.quads(f"hedge_{hedge + 1}", [diamond(draw, at(), 0.08) for _ in range(8000)], leaf)
    boxes = [(-0.8, 2.4, 0.4, 0.8, 2.8, 0.45), (-0.73, 2.4, 0, -0.67, 2.8, 0.399), (0.67, 2.4, 0, 0.73, 2.8, 0.399)]
    scene.quads("bench", [quad for box in boxes for quad in scene.box_quads(*box)], wood)
    scene.quads("wall", scene.box_quads(-16.6, -12, 0, -16.3, 12, 1.8), stone)
    sky = scene.material("sky", (0.0, 0.0, 0.0), SKY)
    scene.quads("sky", [[(-20, 20, 40), (20, 20, 40), (20, -20, 40), (-20, -20, 40)]], sky)


def valley(scene):
    """A height field of 257 by 257 posts, 20 m apart, by midpoint displacement. Metres."""
    draw, posts, spacing = random.Random(5), 257, 20.0
    heights = [[0.0] * posts for _ in range(posts)]
    step, deviation = posts - 1, 700.0
    while step > 1:
        half = step // 2
        for i in range(half, posts, step):
            for j in range(half, posts, step):
                corners = [heights[i + a][j + b] for a in (-half, half) for b in (-half, half)]
                heights[i][j] = sum(corners) / 4 + draw.gauss(0, deviation)
        for i in range(0, posts, half):
            for j in range((i + half) % step, posts, step):
                near = [(i - half, j), (i + half, j), (i, j - half), (i, j + half)]
                known = [heights[a][b] for a, b in near if 0 <= a < posts and 0 <= b < posts]
                heights[i][j] = sum(known) / len(known) + draw.gauss(0, 0.7 * deviation)
        step, deviation = half, 0.48 * deviation
    vertices = [
        ((j - posts // 2) * spacing, (i - posts // 2) * spacing, heights[i][j]) for i in range(posts) for j in range(posts)
    ]
    faces = []
    for i in range(posts - 1):
        for j in range(posts - 1):
            a = i * posts + j
            faces += [[a, a + 1, a + posts + 1], [a, a + posts + 1, a + posts]]
    mesh(scene, "terrain", scene.material("rock", (0.3, 0.28, 0.25)), vertices, faces)
    dome(scene, 4200.0, 48, 12, min(map(min, heights)) - 10.0)


def dome(scene, radius, around, up, base):
    """Half a sphere that emits inwards, above the height `base`."""
    vertices, faces = [], []
    for j in range(up):
        height = math.pi / 2 * j / up
        for i in range(around):
            angle = 2 * math.pi * i / around
            flat = radius * math.cos(height)
            vertices.append((flat * math.cos(angle), flat * math.sin(angle), base + radius * math.sin(height)))
    vertices.append((0.0, 0.0, base + radius))
    for j in range(up):
        for i in range(around):
            a, b = j * around + i, j * around + (i + 1) % around
            faces.append([b, a, len(vertices) - 1] if j == up - 1 else [b, a, a + around, b + around])
    mesh(scene, "sky", scene.material("sky", (0.0, 0.0, 0.0), SKY), vertices, faces)


def mesh(scene, name, material, vertices, faces):
    scene.emit(name, vertices, [(material, [(v, -1) for v in face]) for face in faces])


def in_ball(draw):
    """A random point of the unit ball."""
    while True:
        p = [draw.uniform(-1, 1) for _ in range(3)]
        if sum(x * x for x in p) <= 1:
            return p


def diamond(draw, centre, length):
    """The corners of a leaf of random orientation: a rhombus with diagonals of `length` and 0.6 times that."""
    normal = unit([draw.gauss(0, 1) for _ in range(3)])
    along = [draw.gauss(0, 1) for _ in range(3)]
    height = sum(a * n for a, n in zip(along, normal))
    along = [0.5 * length * x for x in unit([a - height * n for a, n in zip(along, normal)])]
    across = [normal[1] * along[2] - normal[2] * along[1], normal[2] * along[0] - normal[0] * along[2],
              normal[0] * along[1] - normal[1] * along[0]]
    at = lambda u, v: tuple(c + u * a + 0.6 * v * b for c, a, b in zip(centre, along, across))
    return [at(-1, 0), at(0, -1), at(1, 0), at(0, 1)]


def unit(v):
    length = math.sqrt(sum(x * x for x in v))
    return [x / length for x in v]
