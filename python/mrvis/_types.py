"""Exceptions and plain records; the extension module makes them."""

from dataclasses import dataclass
from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray


class Error(Exception):
    """Any error of mrvis; its subclasses say what a caller can do. An error of this very class is a defect of mrvis."""


class InputError(Error, ValueError):
    """A scene, the content of a file or an argument is wrong: the message names it, its value and the cure."""


class UnsupportedError(Error):
    """This machine, the installed Embree or this version cannot do it."""


class OutOfMemoryError(Error, MemoryError):
    """There is not enough memory: ask for less."""


class CancelledError(Error):
    """``progress`` returned False before there was a result."""


class DeviceError(Error):
    """Embree failed."""


class IoError(Error, OSError):
    """A file or folder could not be read or written; ``errno`` and ``filename`` say more."""


class Method(IntEnum):
    """How an answer was found: values of ``Visibility.method``."""

    CLEAR = 0
    """No geometry lies between the ends."""
    COVERED = 1
    """One triangle covers the whole emitter end, or the emitter turns away from the point."""
    EXACT = 2
    """Triangles were tested; nothing was aggregated."""
    AGGREGATED = 3
    """Clusters were aggregated; no triangle was tested."""
    MIXED = 4
    """Clusters were aggregated and triangles were tested."""


@dataclass(frozen=True)
class Camera:
    """A pinhole camera, in the coordinates of the file."""

    eye: tuple[float, float, float]
    """Position, scene units."""
    target: tuple[float, float, float]
    """A point in the middle of the picture, other than ``eye``, scene units."""
    up: tuple[float, float, float] = (0.0, 0.0, 1.0)
    """Direction that is upwards in the picture, of any length above 0."""
    angle: float = 45.0
    """Angle of view from top to bottom, degrees, above 0 and below 180."""


@dataclass(frozen=True, eq=False, repr=False)
class Elements:
    """The light of a scene as plain arrays: E constant pieces of lit sides of surfaces, with V corners."""

    vertices: NDArray[np.float64]
    """Shape (V, 3): corners, each position once, scene units."""
    corners: NDArray[np.uint32]
    """Shape (E, 4): rows of ``vertices``, counterclockwise from the lit side; a triangle repeats its third corner."""
    radiosity: NDArray[np.float64]
    """Shape (E, 3): radiosity, emission included, W/m2, linear RGB."""
    irradiance: NDArray[np.float64]
    """Shape (E, 3): irradiance, W/m2, linear RGB."""
    error: NDArray[np.float64]
    """Shape (E, 3): standard uncertainty of the irradiance, W/m2, linear RGB."""
    exitance: NDArray[np.float64]
    """Shape (E, 3): exitance, W/m2, linear RGB."""
    albedo: NDArray[np.float32]
    """Shape (E, 3): diffuse reflectance in [0, 1), linear RGB."""
    area: NDArray[np.float64]
    """Shape (E,): area, scene units squared."""
    triangle: NDArray[np.uint32]
    """Shape (E,): a triangle of the scene that the element lies on."""
    object: NDArray[np.uint32]
    """Shape (E,): number in ``Scene.object_names``."""
    material: NDArray[np.uint32]
    """Shape (E,): number in ``Scene.material_names``."""
    front: NDArray[np.bool_]
    """Shape (E,): whether the element is on the front of its face."""

    def __len__(self) -> int:
        return len(self.area)

    def __repr__(self) -> str:
        return f"<mrvis.Elements: {len(self)} elements, {len(self.vertices)} vertices>"


@dataclass(frozen=True, eq=False, repr=False)
class Lightmap:
    """Irradiance of all surfaces in one image, and where each of T triangles with V vertices lies in it."""

    irradiance: NDArray[np.float32]
    """Shape (rows, columns, 3): W/m2, linear RGB, from the top."""
    positions: NDArray[np.float64]
    """Shape (V, 3): vertices, scene units."""
    triangles: NDArray[np.uint32]
    """Shape (T, 3): rows of ``positions``, counterclockwise from the lit side."""
    texcoords: NDArray[np.float32]
    """Shape (T, 3, 2): texture coordinates of the corners, from the lower left corner of the image."""
    note: str | None
    """Why the texture coordinates are not those of the scene; None if they are."""

    def __repr__(self) -> str:
        rows, columns, _ = self.irradiance.shape
        return f"<mrvis.Lightmap: {columns} x {rows} texels, {len(self.triangles)} triangles>"


@dataclass(frozen=True, eq=False)
class Instance:
    """A placed mesh of a model; its number is its place in ``Model.instances``."""

    name: str
    """Name of the node in the file, or a made-up one."""
    mesh: int
    """Number of the mesh: 0 holds the scene's own triangles, shared meshes follow in their order."""
    transform: NDArray[np.float64]
    """Shape (3, 4): from the frame of the mesh to that of the model, scene units relative to ``Scene.origin``."""
    material: int | None
    """Number in ``Scene.material_names`` that replaces the materials of the mesh, or None."""
    visible: bool
    """Whether it blocks and receives light."""
    removed: bool
    """Removed instances keep their place, so that the numbers of others do not change."""


@dataclass(frozen=True, eq=False, repr=False)
class Reference:
    """Irradiance at N points by path tracing."""

    irradiance: NDArray[np.float64]
    """Shape (N, 3): W/m2, linear RGB."""
    standard_errors: NDArray[np.float64]
    """Shape (N, 3): standard error of the irradiance, W/m2."""

    def __len__(self) -> int:
        return len(self.irradiance)

    def __repr__(self) -> str:
        return f"<mrvis.Reference: {len(self)} points>"


@dataclass(frozen=True, eq=False, repr=False)
class Bench:
    """What a benchmark measured."""

    record: dict[str, Any]
    """Everything, as ``mrvis bench --json`` writes it."""
    page: str
    """The report as one HTML page, which refers to no other file."""

    def __repr__(self) -> str:
        return f"<mrvis.Bench: {len(self.record.get('mr', []))} multi-resolution rows>"


@dataclass(frozen=True)
class Fbem:
    """The error of an image by the feature-based metric."""

    size: float
    """Feature size, scene units."""
    value: float
    """The metric, in the units of the image's values: for exponent 2 a root mean square."""
    masked_fraction: float
    """Fraction of the image inside features larger than ``size``."""
    inside: float
    """Part of ``value`` ** exponent inside the features."""
    outside: float
    """Part of ``value`` ** exponent outside."""
