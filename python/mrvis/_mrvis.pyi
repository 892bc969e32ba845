"""Types of the extension module. What each argument means, its shape, unit, default and whether it is copied, is said here and in the
docstrings of the module ``mrvis``."""

from collections.abc import Callable, Mapping, Sequence
from os import PathLike
from typing import Any, Final, Literal, TypeAlias, TypedDict, Unpack, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._types import Bench, Camera, Elements, Fbem, Instance, Lightmap, Reference

__all__ = [
    "FormFactors",
    "Model",
    "Scene",
    "SceneBuilder",
    "Solution",
    "Visibility",
    "__version__",
    "fbem",
    "fbem_spectrum",
]

__version__: Final[str]

_Engine: TypeAlias = Literal["auto", "exact", "mr", "average"]
_Vector: TypeAlias = Sequence[float] | NDArray[np.floating[Any]]
_Progress: TypeAlias = Callable[[str, float], bool | None]

class _LoadOptions(TypedDict, total=False):
    unit: str | None
    emitters: Mapping[str, float] | None
    two_sided_emission: bool | None
    sides: Literal[1, 2] | None
    up: Literal["y", "z"] | None
    threads: int | None

class _PrepareOptions(TypedDict, total=False):
    detail: Literal["rays", "clusters", "optics"] | None
    threads: int | None
    cache: str | PathLike[str] | None
    builder: Literal["grids", "kdtree", "goldsmith-salmon", "sah"] | None

class _VisibilityOptions(TypedDict, total=False):
    feature_size: float | ArrayLike | None
    emitter_size: float | ArrayLike | None
    engine: _Engine | None
    relative_to: _Vector | None
    intervals: bool | None
    methods: bool | None
    segments: bool | None

class _SourceOptions(TypedDict, total=False):
    feature_size: float | ArrayLike | None
    rays: int | None
    seed: int | None
    engine: _Engine | None

class _FormFactorOptions(TypedDict, total=False):
    grouping: Literal["polygon", "object", "material"] | None
    rays: int | None
    pair_rays: int | None
    closure: bool | None
    max_bytes: int | None
    seed: int | None

class _SolveOptions(TypedDict, total=False):
    error: float | None
    engine: _Engine | None
    feature_size: float | None
    feature_sizes: Mapping[str, float] | None
    importance: Sequence[str] | None
    min_area: float | None
    direct_only: bool | None
    max_seconds: float | None
    max_links: int | None
    target_error: float | None
    audit: int | None
    light_rays: int | None
    gather_rays: int | None
    seed: int | None

class _BenchOptions(TypedDict, total=False):
    points: int | None
    rays: int | None
    feature_size: float | Sequence[float] | None
    receivers: Sequence[str] | None
    reference_rays: int | None
    threads: int | None
    audit: float | None
    seed: int | None

class _FbemOptions(TypedDict, total=False):
    texel: float | None
    exponent: float | None
    filter: Literal["whole", "unmasked"] | None
    features: Literal["both", "shadow"] | None
    morphology: Literal["euclid", "paper8", "paper4"] | None
    white: float | None
    threshold: float | None

@final
class Scene:
    @staticmethod
    def load(path: str | PathLike[str], **options: Unpack[_LoadOptions]) -> Scene: ...
    @staticmethod
    def from_bytes(
        data: bytes,
        format: Literal["obj", "gltf", "glb", "ply"],
        folder: str | PathLike[str] | None = None,
        **options: Unpack[_LoadOptions],
    ) -> Scene: ...
    @staticmethod
    def generate(name: str) -> Scene: ...
    def flattened(self, max_triangles: int | None = None) -> Scene: ...
    def with_sky(
        self, sky: str | None = None, *, sun: str | None = None, place: str | None = None, time: str | None = None
    ) -> Scene: ...
    @property
    def unit(self) -> str: ...
    @property
    def origin(self) -> NDArray[np.float64]: ...
    @property
    def bounds(self) -> NDArray[np.float64]: ...
    @property
    def triangle_count(self) -> int: ...
    @property
    def visible_triangle_count(self) -> int: ...
    @property
    def object_names(self) -> list[str]: ...
    @property
    def material_names(self) -> list[str]: ...
    @property
    def emitter_names(self) -> list[str]: ...
    @property
    def cameras(self) -> list[tuple[str, Camera]]: ...
    @property
    def repairs(self) -> list[str]: ...

@final
class SceneBuilder:
    def __new__(cls) -> SceneBuilder: ...
    def add_material(self, name: str, reflectance: _Vector, emission: _Vector | None = None) -> int: ...
    def add_object(
        self,
        name: str,
        positions: ArrayLike,
        indices: ArrayLike,
        *,
        polygon_sizes: ArrayLike | None = None,
        material: int | ArrayLike | None = None,
    ) -> None: ...
    def add_shared_mesh(
        self,
        name: str,
        positions: ArrayLike,
        indices: ArrayLike,
        *,
        polygon_sizes: ArrayLike | None = None,
        material: int | ArrayLike | None = None,
    ) -> int: ...
    def add_instance(self, mesh: int, name: str, transform: ArrayLike) -> None: ...
    def finish(self, **options: Unpack[_LoadOptions]) -> Scene: ...

@final
class Model:
    def __new__(
        cls, scene: Scene, *, progress: _Progress | None = None, **options: Unpack[_PrepareOptions]
    ) -> Model: ...
    @property
    def scene(self) -> Scene: ...
    @property
    def detail(self) -> Literal["rays", "clusters", "optics"]: ...
    @property
    def source_count(self) -> int: ...
    @property
    def embree_version(self) -> str: ...
    @property
    def report(self) -> dict[str, Any]: ...
    @property
    def instance_names(self) -> list[str]: ...
    @property
    def instances(self) -> list[Instance]: ...
    def moved(self, transforms: dict[int, ArrayLike]) -> Model: ...
    def with_instance(
        self, mesh: int, name: str, transform: ArrayLike, *, material: int | None = None
    ) -> Model: ...
    def without_instances(self, instances: Sequence[int]) -> Model: ...
    def shown(self, visible: dict[int, bool]) -> Model: ...
    def visibility(
        self,
        origins: ArrayLike,
        targets: ArrayLike,
        *,
        bundles: int | ArrayLike | None = None,
        out: NDArray[np.float32] | None = None,
        progress: _Progress | None = None,
        **options: Unpack[_VisibilityOptions],
    ) -> Visibility: ...
    def source_visibility(
        self,
        points: ArrayLike,
        normals: ArrayLike,
        source: int | None = None,
        *,
        out: NDArray[np.float32] | None = None,
        progress: _Progress | None = None,
        **options: Unpack[_SourceOptions],
    ) -> Visibility: ...
    def form_factors(
        self, *, progress: _Progress | None = None, **options: Unpack[_FormFactorOptions]
    ) -> FormFactors: ...
    def solve(self, *, progress: _Progress | None = None, **options: Unpack[_SolveOptions]) -> Solution: ...
    def reference(
        self,
        points: ArrayLike,
        normals: ArrayLike,
        *,
        samples: int | None = None,
        seed: int | None = None,
        progress: _Progress | None = None,
    ) -> Reference: ...
    def bench(self, *, progress: _Progress | None = None, **options: Unpack[_BenchOptions]) -> Bench: ...

@final
class Visibility:
    @property
    def transmittance(self) -> NDArray[np.float32]: ...
    @property
    def lo(self) -> NDArray[np.float32] | None: ...
    @property
    def hi(self) -> NDArray[np.float32] | None: ...
    @property
    def method(self) -> NDArray[np.uint8] | None: ...
    @property
    def segments(self) -> NDArray[np.float32] | None: ...
    @property
    def cost(self) -> dict[str, int]: ...
    def __len__(self) -> int: ...

@final
class FormFactors:
    @property
    def matrix(self) -> Any: ...
    @property
    def data(self) -> NDArray[np.float32]: ...
    @property
    def indices(self) -> NDArray[np.int32 | np.int64]: ...
    @property
    def indptr(self) -> NDArray[np.int32 | np.int64]: ...
    @property
    def names(self) -> list[str]: ...
    @property
    def areas(self) -> NDArray[np.float64]: ...
    @property
    def escaped(self) -> NDArray[np.float32]: ...
    @property
    def lost(self) -> NDArray[np.float32]: ...
    @property
    def rays(self) -> int: ...
    @property
    def row_sum_error(self) -> float: ...
    def __len__(self) -> int: ...

@final
class Solution:
    @property
    def model(self) -> Model: ...
    def irradiance(
        self, points: ArrayLike, normals: ArrayLike, *, progress: _Progress | None = None
    ) -> NDArray[np.float64]: ...
    def elements(self) -> Elements: ...
    def json(self) -> dict[str, Any]: ...
    def automatic_camera(self, *, progress: _Progress | None = None) -> Camera: ...
    def image(
        self,
        camera: Camera | None = None,
        size: tuple[int, int] | None = None,
        *,
        gather: bool = False,
        look_inside: bool = False,
        out: NDArray[np.float32] | None = None,
        progress: _Progress | None = None,
    ) -> NDArray[np.float32]: ...
    def lightmap(self, texels: int | None = None, *, progress: _Progress | None = None) -> Lightmap: ...
    def page(self, *, progress: _Progress | None = None) -> str: ...
    @property
    def mean_irradiance(self) -> NDArray[np.float64]: ...
    @property
    def error_estimate(self) -> float | None: ...
    @property
    def warnings(self) -> list[str]: ...
    @property
    def interrupted(self) -> bool: ...

def fbem(
    reference: ArrayLike, approximation: ArrayLike, size: float = 0.0, **options: Unpack[_FbemOptions]
) -> Fbem: ...
def fbem_spectrum(
    reference: ArrayLike, approximation: ArrayLike, sizes: Sequence[float], **options: Unpack[_FbemOptions]
) -> list[Fbem]: ...
