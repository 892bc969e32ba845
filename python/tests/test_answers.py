"""Answers: closed forms, and the same bits on any number of threads."""

import base64
import json

import mrvis
import numpy as np
import pytest
from known import DOWN, SQUARE, UP, opposite, squares


def test_blocked_and_clear_segments():
    builder = mrvis.SceneBuilder()
    builder.add_material("grey", (0.5, 0.5, 0.5))
    builder.add_object("blocker", SQUARE + [0, 0, 1], UP)
    builder.add_object("floor", SQUARE * [4, 4, 1], UP)
    model = mrvis.Model(builder.finish(), detail="rays")
    x = np.array([0.25, 0.75, 1.25, 3.0], dtype=np.float32)
    origins = np.column_stack([x, x, np.full(4, 0.1, np.float32)])
    seen = model.visibility(origins, origins + np.float32([0, 0, 5]), intervals=True, methods=True, segments=True)
    assert seen.transmittance.tolist() == [0, 0, 1, 1] == seen.segments.tolist()
    assert seen.cost["segments"] == 4 and len(seen) == 4
    assert set(seen.method) <= {mrvis.Method.EXACT, mrvis.Method.CLEAR}
    assert np.all(seen.lo <= seen.transmittance) and np.all(seen.transmittance <= seen.hi)
    bundles = model.visibility(origins, origins + np.float32([0, 0, 5]), bundles=[0, 1, 4, 4])
    assert bundles.transmittance == pytest.approx([0, 2 / 3, 1])
    assert model.visibility(origins, origins + [0, 0, 5], bundles=4).transmittance.tolist() == [0.5]


def test_all_layouts_give_the_same_bits(cubes, ground):
    origins, targets = ground
    want = cubes.visibility(origins, targets, engine="exact").transmittance
    assert 0 < want.mean() < 1
    both = np.hstack([origins, targets])
    twice = np.repeat(both, 2, axis=0)
    for from_, to in [
        (both[:, :3], both[:, 3:]),
        (twice[::2, :3], twice[::2, 3:]),
        (np.asfortranarray(origins), targets),
        (origins.astype(">f4"), targets.tolist()),
        (np.ascontiguousarray(origins[::-1])[::-1], targets),
    ]:
        assert np.array_equal(cubes.visibility(from_, to, engine="exact").transmittance, want)
    moved = cubes.visibility(origins - np.float32([0, 0, 1]), targets.astype(np.float64) - [0, 0, 1], relative_to=(0, 0, 1))
    assert np.mean(moved.transmittance != want) < 0.01
    one = cubes.visibility(origins, targets[0], engine="exact")
    assert np.array_equal(one.transmittance, cubes.visibility(origins, np.tile(targets[0], (len(origins), 1)), engine="exact").transmittance)


@pytest.mark.parametrize("builder", ["kdtree", "goldsmith-salmon", "sah"])
def test_builders_change_clusters_and_no_exact_answer(cubes, ground, builder):
    other = mrvis.Model(cubes.scene, builder=builder)
    exact, averaged = ({"engine": "exact"}, {"engine": "mr", "feature_size": 1.0})
    ask = lambda model, how: model.visibility(*ground, **how).transmittance
    assert np.array_equal(ask(other, exact), ask(cubes, exact))
    assert not np.array_equal(ask(other, averaged), ask(cubes, averaged))


@pytest.mark.parametrize("height", [0.5, 1.0, 3.0])
def test_form_factor_of_squares(height):
    factors = mrvis.Model(squares(height), detail="rays").form_factors(grouping="object")
    x = 1 / height
    r = np.hypot(1, x)
    want = 2 / (np.pi * x * x) * (np.log(r * r / np.sqrt(1 + 2 * x * x)) + 2 * x * r * np.arctan(x / r) - 2 * x * np.arctan(x))
    assert factors.names == ["floor", "lamp"] and factors.areas == pytest.approx([1, 1])
    assert factors.matrix.toarray() == pytest.approx(np.array([[0, want], [want, 0]]), abs=2e-3)


def test_form_factors_are_sparse_rows(cornell):
    factors = cornell.form_factors(rays=512, pair_rays=64)
    matrix = factors.matrix
    assert np.shares_memory(matrix.data, factors.data) and np.shares_memory(matrix.indices, factors.indices)
    assert matrix.shape == (len(factors),) * 2 and factors.indptr[-1] == len(factors.data)
    rows = matrix.sum(axis=1) + factors.escaped + factors.lost
    assert rows == pytest.approx(1, abs=0.15) and rows.mean() == pytest.approx(1, abs=0.02)  # 512 rays a polygon
    exchange = factors.areas[:, None] * matrix.toarray()
    assert exchange == pytest.approx(exchange.T, rel=1e-5)


def test_irradiance_below_a_lamp():
    solution = mrvis.Model(squares(), detail="clusters").solve(direct_only=True)
    points = np.array([[0.5, 0.5, 0], [0.25, 0.5, 0]], dtype=np.float32)
    found = solution.irradiance(points, (0, 0, 2))
    quarter = [4 * opposite(0.5, 0.5, 1), 2 * opposite(0.25, 0.5, 1) + 2 * opposite(0.75, 0.5, 1)]
    assert found.shape == (2, 3) and found.dtype == np.float64 and found.base is not None
    assert found == pytest.approx(np.outer(quarter, [10 * np.pi] * 3), rel=0.01)
    assert solution.irradiance(points, [0, 0, -1]).max() == 0


def test_elements_hold_the_light(light):
    elements = light.elements()
    assert len(elements) == len(elements.corners) and elements.corners.max() < len(elements.vertices)
    a, b, c, d = (elements.vertices[elements.corners[:, k]] for k in range(4))
    area = np.linalg.norm(np.cross(c - a, d - b), axis=1) / 2
    triangle = elements.corners[:, 2] == elements.corners[:, 3]
    area[triangle] = np.linalg.norm(np.cross(b - a, c - a), axis=1)[triangle] / 2
    assert area == pytest.approx(elements.area, rel=1e-4)
    reflected = elements.radiosity - elements.exitance
    assert reflected == pytest.approx(elements.albedo * elements.irradiance, rel=1e-4, abs=1e-9)
    assert elements.error.min() >= 0 and elements.front.any()


def test_records_of_a_solution(light):
    record = light.json()
    assert json.loads(json.dumps(record)) == record and record["mean_irradiance"] == pytest.approx(light.mean_irradiance)
    assert light.error_estimate > 0 and not light.interrupted and isinstance(light.warnings, list)
    assert light.page().startswith("<!")
    lightmap = light.lightmap(4096)
    assert lightmap.irradiance.shape[2] == 3 and lightmap.texcoords.shape == (len(lightmap.triangles), 3, 2)
    assert lightmap.triangles.max() < len(lightmap.positions) and "texels" in repr(lightmap)


def test_picture(light):
    picture = light.image(size=(40, 30))
    assert picture.shape == (30, 40, 3) and picture.dtype == np.float32 and picture.max() > 0
    camera = light.automatic_camera()
    out = np.zeros((30, 40, 3), np.float32)
    assert light.image(camera, (40, 30), out=out) is out and np.array_equal(out, picture)
    away = mrvis.Camera(eye=camera.eye, target=tuple(2 * np.array(camera.eye) - camera.target), up=camera.up)
    assert not np.array_equal(light.image(away, (40, 30)), picture)


def test_same_bits_on_any_number_of_threads(ground):
    origins, targets = ground
    scene = mrvis.Scene.generate("cubes")
    found = []
    for threads in (1, 2, 3):
        model = mrvis.Model(scene, threads=threads)
        visibility = model.visibility(origins, targets, bundles=16, feature_size=4, engine="mr", intervals=True)
        source = model.source_visibility(origins[::8], (0, 0, 1), feature_size=4, engine="mr")
        found.append([visibility.transmittance, visibility.lo, visibility.hi, source.transmittance, source.lo, source.hi])
        assert source.cost["aggregated"] > 0
    for other in found[1:]:
        assert all(np.array_equal(a, b) for a, b in zip(found[0], other))


def test_source_visibility(model):
    seen = model.source_visibility([[0.5, 0.5, 0], [0.5, 0.5, 0]], [[0, 0, 1], [0, 0, -1]])
    assert seen.transmittance.tolist() == [1, 0] and seen.method[1] == mrvis.Method.COVERED


def test_instances_move():
    builder = mrvis.SceneBuilder()
    builder.add_material("grey", (0.5, 0.5, 0.5))
    builder.add_object("floor", SQUARE * [9, 9, 1], UP)
    mesh = builder.add_shared_mesh("plate", SQUARE, DOWN)
    builder.add_instance(mesh, "a", np.eye(4))
    shift = np.hstack([np.eye(3), [[3], [3], [1]]])
    builder.add_instance(mesh, "b", shift)
    model = mrvis.Model(builder.finish(), detail="rays")
    number = model.instance_names.index("b")
    ray = np.float32([[3.5, 3.5, 0.5]]), np.float32([[3.5, 3.5, 2.5]])
    assert model.visibility(*ray).transmittance == 0
    moved = np.array(shift)
    moved[:, 3] = [6, 6, 1] - model.scene.origin
    assert model.moved({number: moved}).visibility(*ray).transmittance == 1
    with pytest.raises(mrvis.InputError, match="placed meshes"):
        model.form_factors()
    flat = model.scene.flattened()
    assert flat.triangle_count == model.scene.visible_triangle_count == 6
    assert len(mrvis.Model(flat, detail="rays").form_factors(grouping="object").areas) == 3
    with pytest.raises(mrvis.InputError, match="triangles"):
        model.scene.flattened(5)


def test_light_of_sky_and_sun(tmp_path):
    builder = mrvis.SceneBuilder()
    builder.add_material("grey", (0.5, 0.5, 0.5))
    builder.add_object("ground", SQUARE * [4, 4, 1], UP)
    scene = builder.finish().with_sky("uniform:100", sun="180,30:800")
    light = mrvis.Model(scene).solve(error=0.05)
    found = light.irradiance([[2, 2, 0]], [0, 0, 1])
    assert found == pytest.approx(500, rel=3e-3)
    with pytest.raises(mrvis.InputError, match="17 is no type of CIE sky"):
        scene.with_sky("cie:17")
    # A face of which the upward axis cannot be guessed.
    (tmp_path / "face.obj").write_text("v 0 0 0\nv 0 0 4\nv 4 0 4\nv 4 0 0\nv 0 9 0\nv 0 9 1\nv 1 9 1\nf 1 2 3 4\nf 5 6 7\n")
    under = mrvis.Scene.load(tmp_path / "face.obj", up="y").with_sky("uniform:100")
    assert mrvis.Model(under).solve(error=0.05).irradiance([[3, 0, 3]], [0, 1, 0]) == pytest.approx(100, rel=0.02)
    with pytest.raises(mrvis.InputError, match="must be y or z"):
        mrvis.Scene.load(tmp_path / "face.obj", up="x")


def test_feature_based_error():
    image = np.ones((32, 32), np.float32)
    image[8:16, 8:16] = 0
    other = image + np.float32(0.1) * (np.arange(32) % 2 - 0.5)
    plain = mrvis.fbem(image, other)
    assert mrvis.fbem(image, image).value == 0
    assert plain.value == pytest.approx(np.sqrt(np.mean((image - other).astype(float) ** 2)))
    spectrum = mrvis.fbem_spectrum(image, other, [0, 4, 64], features="shadow")
    assert [f.size for f in spectrum] == [0, 4, 64] and spectrum[0].value == plain.value
    assert spectrum[2].masked_fraction == 0 and spectrum[2].value < plain.value / 2


def test_scenes_from_files_and_bytes(tmp_path):
    text = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\no tile\nf 1 2 3 4\n"
    path = tmp_path / "tile.obj"
    path.write_text(text)
    for scene in (mrvis.Scene.load(path, emitters={"tile": 3.0}), mrvis.Scene.from_bytes(text.encode(), "obj", emitters={"tile": 3.0})):
        assert scene.object_names == ["tile"] and scene.emitter_names and scene.triangle_count == 2
        assert scene.bounds.tolist() == [[0, 0, 0], [1, 1, 0]] and scene.unit == "m"


def test_polygons():
    quads = np.array([[0, 1, 2, 3]], dtype=np.int64)
    flat = [0, 1, 2, 3]
    for options in ({"indices": quads}, {"indices": flat, "polygon_sizes": np.int32([4])}):
        builder = mrvis.SceneBuilder()
        builder.add_material("grey", (0.5, 0.5, 0.5))
        builder.add_object("tile", SQUARE.astype(np.float32), material=[0], **options)
        assert builder.finish().triangle_count == 2


def test_seeds_have_64_bits(cornell):
    # Beside the blocks, whose shadows have soft edges.
    x, z = np.meshgrid(np.linspace(50, 500, 12), np.linspace(50, 500, 12))
    points, up = np.column_stack([x.ravel(), np.ones(x.size), z.ravel()]), (0, 1, 0)
    calls = {
        "source": lambda seed: cornell.source_visibility(points, up, seed=seed, rays=16).transmittance,
        "factors": lambda seed: cornell.form_factors(seed=seed, rays=16, pair_rays=16, grouping="object").data,
        "reference": lambda seed: cornell.reference(points, up, samples=8, seed=seed).irradiance,
        "solve": lambda seed: cornell.solve(error=0.9, seed=seed).mean_irradiance,
    }
    for name, call in calls.items():
        seeds = (0, np.uint64(2**63 + 1), 2**64 - 2**33)
        answers = [call(seed) for seed in seeds]
        assert np.array_equal(answers[1], call(seeds[1])), name
        for k, answer in enumerate(answers):
            assert not any(np.array_equal(answer, other) for other in answers[:k]), (name, seeds[k])
        for seed in (-1, 2**64, -(2**63) - 1, 2**200, 10**5000):
            with pytest.raises(ValueError, match=r"`seed` .*: must be a whole number from 0 to 18446744073709551615"):
                call(seed)
        with pytest.raises(TypeError, match="`seed`.*float"):
            call(1.0)


def test_path_tracing_finds_the_light_of_the_closed_form():
    found = mrvis.Model(squares(), detail="rays").reference([[0.5, 0.5, 0]], (0, 0, 1), samples=4096)
    want = 10 * np.pi * 4 * opposite(0.5, 0.5, 1)
    assert found.irradiance.shape == found.standard_errors.shape == (1, 3) and len(found) == 1
    assert found.irradiance == pytest.approx(np.full((1, 3), want), rel=0.02)
    assert 0 <= found.standard_errors.max() < 0.02 * want


def test_path_tracing_agrees_with_the_solution(cornell):
    # Points of the floor in front of the blocks.
    points = np.column_stack([np.linspace(150, 400, 6), np.zeros(6), np.full(6, 30)])
    reference = cornell.reference(points, (0, 1, 0), samples=2048).irradiance
    found = cornell.solve(error=0.02).irradiance(points, (0, 1, 0))
    assert reference.min() > 0
    assert np.sqrt(np.mean((found - reference) ** 2)) < 0.1 * reference.mean()


def test_benchmark():
    stages = []
    model = mrvis.Model(squares())
    found = model.bench(points=50, rays=4, reference_rays=32, feature_size=2.0, progress=lambda stage, part: stages.append(stage))
    assert found.page.startswith("<!") and len(set(stages)) > 1
    record = found.record
    assert json.loads(json.dumps(record)) == record and record["mr"] and "mrvis.Bench" in repr(found)


def test_instances_come_and_go():
    builder = mrvis.SceneBuilder()
    builder.add_material("grey", (0.5, 0.5, 0.5))
    builder.add_object("floor", SQUARE * [9, 9, 1], UP)
    mesh = builder.add_shared_mesh("plate", SQUARE, DOWN)
    builder.add_instance(mesh, "a", np.eye(4) + np.array([[0, 0, 0, 3], [0, 0, 0, 3], [0, 0, 0, 1], [0, 0, 0, 0]]))
    model = mrvis.Model(builder.finish(), detail="rays")
    here, there = (np.float32([[x, x, 0.5]]) for x in (3.5, 6.5))

    def clear(model):
        return [float(model.visibility(p, p + np.float32([0, 0, 2])).transmittance[0]) for p in (here, there)]

    own, a = model.instances
    assert (own.mesh, a.name, a.visible, a.removed, a.material) == (0, "a", True, False, None) and a.transform.shape == (3, 4)
    assert clear(model) == [0, 1]
    further = a.transform + np.array([[0, 0, 0, 3], [0, 0, 0, 3], [0, 0, 0, 0]])
    more = model.with_instance(a.mesh, "b", further)
    assert clear(more) == [0, 0] and more.instance_names[1:] == ["a", "b"]
    assert clear(more.shown({2: False})) == [0, 1] and clear(more.shown({2: False}).shown({2: True})) == [0, 0]
    fewer = more.without_instances([1])
    assert clear(fewer) == [1, 0] and fewer.instances[1].removed and clear(model) == [0, 1]
    for call, message in [
        (lambda: fewer.without_instances([1]), "^`instance` 1: does not exist"),
        (lambda: model.moved({0: np.eye(4)}), "^`instance` 0: the scene"),
        (lambda: model.moved({-1: np.eye(4)}), "`transforms` -1"),
        (lambda: model.shown({9: True}), "^`instance` 9: does not exist"),
        (lambda: model.with_instance(7, "c", np.eye(4)), "mesh 7 must lie"),
        (lambda: model.with_instance(1, "c", np.eye(4), material=5), "material 5 must be"),
    ]:
        with pytest.raises(mrvis.InputError, match=message):
            call()


def test_cameras_of_a_file():
    triangle = base64.b64encode(np.float32([[0, 0, 0], [1, 0, 0], [0, 1, 0]]).tobytes()).decode()
    document = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0, 1]}],
        "nodes": [{"mesh": 0}, {"name": "door", "camera": 0, "translation": [0.25, 0.25, 5]}],
        "cameras": [{"type": "perspective", "perspective": {"yfov": 0.5, "znear": 0.1}}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0]}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "buffers": [{"byteLength": 36, "uri": "data:application/octet-stream;base64," + triangle}],
    }
    scene = mrvis.Scene.from_bytes(json.dumps(document).encode(), "gltf")
    [(name, camera)] = scene.cameras
    assert name == "door" and camera.eye == pytest.approx((0.25, 0.25, 5)) and camera.angle == pytest.approx(np.degrees(0.5))
    assert np.subtract(camera.target, camera.eye)[2] < 0 and camera.up == pytest.approx((0, 1, 0))
