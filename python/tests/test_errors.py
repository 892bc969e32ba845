"""Wrong arguments: the exception of the category, which names the argument."""

import copy
import pickle

import mrvis
import numpy as np
import pytest
from known import SQUARE, UP

TILE = b"v 0 0 0\nv 1 0 0\nv 1 1 0\no tile\nf 1 2 3\n"
ONE = np.float32([[0.5, 0.5, 0.1]])
TWO = np.float32([[0.5, 0.5, 0.9]])


@pytest.mark.parametrize(
    ("arguments", "options", "names"),
    [
        ((ONE[:, :2], TWO), {}, r"`origins` has shape \(1, 2\)"),
        ((ONE, TWO.reshape(1, 1, 3)), {}, r"`targets` has shape \(1, 1, 3\)"),
        ((ONE, TWO.astype(complex)), {}, "`targets`.*complex"),
        ((np.array([["a", "b", "c"]]), TWO), {}, "`origins`.*dtype"),
        (([[1, 2], [3]], TWO), {}, "`origins`"),
        ((ONE, np.vstack([TWO, TWO])), {}, "`targets` has 2 positions"),
        ((ONE * np.nan, TWO), {}, r"`origins`\[0\]"),
        ((ONE, TWO * np.inf), {}, r"`targets`\[0\]"),
        ((ONE, ONE), {}, r"`targets`\[0\].*no length"),
        ((ONE, TWO), {"feature_size": -1}, "`feature_size` -1"),
        ((ONE, TWO), {"feature_size": [0.1, np.nan]}, "`feature_size`"),
        ((ONE, TWO), {"feature_size": "large"}, "`feature_size`"),
        ((ONE, TWO), {"emitter_size": np.nan}, "`emitter_size`"),
        ((ONE, TWO), {"bundles": 2}, "`bundles` 2"),
        ((ONE, TWO), {"bundles": 0}, "`bundles` 0"),
        ((ONE, TWO), {"bundles": -1}, "`bundles` -1"),
        ((ONE, TWO), {"bundles": [0, -1]}, r"`bundles`\[1\] -1"),
        ((ONE, TWO), {"bundles": [0, 2]}, "`bundles`"),
        ((ONE, TWO), {"bundles": [0.0, 1.0]}, "`bundles`.*float64"),
        ((ONE, TWO), {"engine": "fast"}, '`engine` "fast".*"exact"'),
        ((ONE, TWO), {"engine": "mr"}, "`feature_size`: the engine `mr` needs one"),
        ((ONE, TWO), {"relative_to": (0, 1)}, "`relative_to`"),
        ((ONE, TWO), {"out": np.zeros(1)}, "`out`.*float32"),
        ((ONE, TWO), {"out": np.zeros(2, np.float32)}, r"`out` has shape \(2,\)"),
        ((ONE, TWO), {"out": np.zeros((1, 2), np.float32)[:, 0][:0]}, "`out`"),
    ],
)
def test_segments(model, arguments, options, names):
    with pytest.raises(mrvis.InputError, match=names) as caught:
        model.visibility(*arguments, **options)
    assert isinstance(caught.value, ValueError) and isinstance(caught.value, mrvis.Error)


def test_read_only_arrays(model):
    fixed = np.zeros(1, np.float32)
    fixed.flags.writeable = False
    with pytest.raises(mrvis.InputError, match="`out`"):
        model.visibility(ONE, TWO, out=fixed)
    ends = ONE.copy(), TWO.copy()
    for end in ends:
        end.flags.writeable = False
    assert model.visibility(*ends).transmittance == 1


@pytest.mark.parametrize(
    ("options", "names"),
    [
        ({"points": [[0, 0]]}, "`points`"),
        ({"points": [[0, 0, np.nan]]}, r"`points`\[0\]: `position`"),
        ({"normals": [[0, 0, 1]] * 2}, "`normals` has 2 rows"),
        ({"normals": [0, 0, 0]}, r"`points`\[0\]: `normal`"),
        ({"source": 9}, "`source` 9"),
        ({"source": -1}, "`source` -1"),
        ({"rays": 0}, "`rays` 0"),
        ({"rays": -5}, "`rays` -5"),
        ({"feature_size": [1, 2]}, "`feature_size` has 2 entries"),
    ],
)
def test_sources(model, options, names):
    arguments = {"points": [[0.5, 0.5, 0]], "normals": [0, 0, 1], **options}
    with pytest.raises(mrvis.InputError, match=names):
        model.source_visibility(**arguments)


@pytest.mark.parametrize(
    ("options", "names"),
    [
        ({"positions": SQUARE[:, :2]}, "`positions`"),
        ({"positions": SQUARE * np.nan}, r"`positions`\[0\]"),
        ({"indices": [[0, 1, 4]]}, r"`indices`\[2\] 4 of mesh `tile`: must be below 4"),
        ({"indices": [[0, 1, -2]]}, r"`indices`\[2\] -2"),
        ({"indices": [[0.0, 1.0, 2.0]]}, "`indices`.*float64"),
        ({"indices": [0, 1, 2, 3]}, "`indices` holds 4"),
        ({"indices": np.zeros((1, 1, 3), int)}, r"`indices` has shape \[1, 1, 3\]"),
        ({"indices": []}, "`indices` is empty"),
        ({"polygon_sizes": [2, 4]}, r"`polygon_sizes`\[0\] 2"),
        ({"material": 7}, "`material`"),
        ({"material": [0]}, "`material`"),
    ],
)
def test_meshes(options, names):
    builder = mrvis.SceneBuilder()
    builder.add_material("grey", (0.5, 0.5, 0.5))
    arguments = {"positions": SQUARE, "indices": UP, **options}
    with pytest.raises(mrvis.InputError, match=names):
        builder.add_object("tile", **arguments)


def builder_with_tile(**options):
    builder = mrvis.SceneBuilder()
    builder.add_material("grey", (0.5, 0.5, 0.5))
    builder.add_object("t", SQUARE, UP, **options)


def test_other_inputs(model, light):
    for names, call in [
        ("`reflectance` 2", lambda: mrvis.SceneBuilder().add_material("a", (2, 0, 0))),
        ("`transform`", lambda: mrvis.SceneBuilder().add_instance(0, "a", np.eye(2))),
        ("`transform`.*last row", lambda: mrvis.SceneBuilder().add_instance(0, "a", np.ones((4, 4)))),
        ("^`name`: .*`nothing`.*cornell", lambda: mrvis.Scene.generate("nothing")),
        ("`format`", lambda: mrvis.Scene.from_bytes(b"", "stl")),
        ("`threads` 9999", lambda: mrvis.Model(model.scene, threads=9999)),
        ("`threads` -1", lambda: mrvis.Model(model.scene, threads=-1)),
        ('`builder` "octree"', lambda: mrvis.Model(model.scene, builder="octree")),
        ('`detail` "all"', lambda: mrvis.Model(model.scene, detail="all")),
        ("^`error` -1: must be", lambda: model.solve(error=-1)),
        ("^`error` NaN: must be", lambda: model.solve(error=np.nan)),
        ("^`min_area` 2: ", lambda: model.solve(min_area=2.0)),
        ("^`max_links` 0: must", lambda: model.solve(max_links=0)),
        ("^`light_rays` 0: must", lambda: model.solve(light_rays=0)),
        ("^`gather_rays` 0: must", lambda: model.solve(gather_rays=0)),
        ("^`audit` 2000000: must", lambda: model.solve(audit=2_000_000)),
        ("^`max_seconds` 0: must", lambda: model.solve(max_seconds=0)),
        ("^`target_error` -1: must", lambda: model.solve(target_error=-1)),
        ("^`feature_size` -1: must", lambda: model.solve(feature_size=-1)),
        ("^`feature_sizes` -1 of `floor`: must", lambda: model.solve(feature_sizes={"floor": -1})),
        ("called `sofa`", lambda: model.solve(importance=["sofa"])),
        ("^`points` 0: must", lambda: model.bench(points=0)),
        ("^`audit` 2: must", lambda: model.bench(audit=2)),
        ("^`feature_size` -1: ", lambda: model.bench(feature_size=[-1])),
        ("^`points` 100000000 with `rays` 65536 .*`points` or `rays`$", lambda: model.bench(points=10**8, rays=65536)),
        ('detail="optics"', lambda: mrvis.Model(model.scene, detail="rays").bench()),
        ("^`samples` 1: must", lambda: model.reference([[0, 0, 0]], [0, 0, 1], samples=1)),
        ("^`samples` -1: must", lambda: model.reference([[0, 0, 0]], [0, 0, 1], samples=-1)),
        (r"`points`\[0\].*normal longer", lambda: model.reference([[0, 0, 0]], [0, 0, 0])),
        ("^`rays` 0: must lie", lambda: model.form_factors(rays=0)),
        ("^`pair_rays` 1: must lie", lambda: model.form_factors(pair_rays=1)),
        ("^`max_triangles` -1: must", lambda: model.scene.flattened(-1)),
        ("^`sides` 3: must", lambda: mrvis.Scene.from_bytes(b"", "obj", sides=3)),
        ("^`threads` 5000: must", lambda: mrvis.Scene.from_bytes(b"v 0 0 0", "obj", threads=5000)),
        ("^`emitters` lamp=-3 W: ", lambda: mrvis.Scene.from_bytes(TILE, "obj", emitters={"lamp": -3.0})),
        ("called `lamp`", lambda: mrvis.Scene.from_bytes(TILE, "obj", emitters={"lamp": 3.0})),
        (r"^`material`\[1\] 9 of mesh `t`: ", lambda: builder_with_tile(material=[0, 9])),
        ('`grouping` "face"', lambda: model.form_factors(grouping="face")),
        ("`points`.*normal longer", lambda: light.irradiance([[0, 0, 0]], [0, 0, 0])),
        ("^`size` -1: must", lambda: light.image(size=(-1, 5))),
        ("^`size` .0, 5.: ", lambda: light.image(size=(0, 5))),
        ("^`size`: must be", lambda: light.image(size=5)),
        ("`size`", lambda: light.image(size=(1 << 40, 1 << 40))),
        ("`out`", lambda: light.image(size=(4, 4), out=np.zeros((4, 4, 3)))),
        ("`camera.angle`", lambda: light.image(mrvis.Camera((0, 0, 0), (1, 0, 0), angle=200))),
        ("^`texels` -1: must", lambda: light.lightmap(-1)),
        ("^`texels` 0: must", lambda: light.lightmap(0)),
        ("`reference`", lambda: mrvis.fbem([1, 2], [[1, 2]])),
        ("`approximation`.*texel 1,0", lambda: mrvis.fbem([[1, 2]], [[1, np.nan]])),
        ("same size", lambda: mrvis.fbem([[1, 2]], [[1, 2, 3]])),
        ("^`exponent` 0.5: ", lambda: mrvis.fbem([[1, 2]], [[1, 2]], exponent=0.5)),
        ("^`white` 0: ", lambda: mrvis.fbem([[1, 2]], [[1, 2]], white=0)),
        ("^`threshold` 2: ", lambda: mrvis.fbem([[1, 2]], [[1, 2]], threshold=2)),
        ("^`size` -1: ", lambda: mrvis.fbem([[1, 2]], [[1, 2]], -1)),
        ("^`texel` 0: ", lambda: mrvis.fbem([[1, 2]], [[1, 2]], texel=0)),
    ]:
        with pytest.raises(mrvis.InputError, match=names) as caught:
            call()
        # Nothing of Rust is named.
        assert not any(mark in str(caught.value) for mark in ("::", "⟨")), caught.value
    with pytest.raises(TypeError, match="unexpected keyword argument 'eror'"):
        model.solve(eror=0.1)
    with pytest.raises(TypeError, match="`error`"):
        model.solve(error="small")


def test_categories(cornell, tmp_path):
    with pytest.raises(mrvis.IoError) as caught:
        mrvis.Scene.load(tmp_path / "none.obj")
    assert isinstance(caught.value, OSError) and caught.value.errno == 2 and caught.value.filename.endswith("none.obj")
    with pytest.raises(mrvis.OutOfMemoryError, match="`max_bytes`") as caught:
        cornell.form_factors(max_bytes=10)
    assert isinstance(caught.value, MemoryError)
    with pytest.raises(mrvis.InputError, match='detail="optics"'):
        cornell.solve(engine="mr")
    broken = tmp_path / "broken.obj"
    broken.write_text("v 0 0 zero\n")
    with pytest.raises(mrvis.InputError, match="broken.obj:1"):
        mrvis.Scene.load(broken)


def test_nothing_is_pickled(model, light, cornell):
    for thing in (model.scene, model, light, cornell.form_factors(grouping="object"), mrvis.SceneBuilder()):
        for act in (pickle.dumps, copy.deepcopy):
            with pytest.raises(TypeError, match=f"mrvis.{type(thing).__name__} cannot be pickled"):
                act(thing)
        assert repr(thing).startswith("<") and "mrvis." in repr(thing)
    camera = light.automatic_camera()
    assert pickle.loads(pickle.dumps(camera)) == camera
