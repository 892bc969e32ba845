"""Visibility and radiosity in scenes full of small detail.

A ``Scene`` is read from a file, built from arrays or generated. A ``Model`` is a scene prepared for queries: visibility of segments and of
light sources, form factors, and the light of the scene as a ``Solution``.

Lengths are in scene units, metres unless the scene says otherwise. Irradiance and radiosity are in W/m2, radiance in W/(m2 sr); light is
linear RGB. Positions are rows of arrays of shape (N, 3) in the coordinates of the file. Arrays are borrowed without a copy where the
description of an argument says so; they must not be changed by other threads during a call. Calls release the GIL. ``docs/python.md``
says more.
"""

from ._mrvis import (
    FormFactors,
    Model,
    Scene,
    SceneBuilder,
    Solution,
    Visibility,
    __version__,
    fbem,
    fbem_spectrum,
)
from ._types import (
    Bench,
    Camera,
    CancelledError,
    DeviceError,
    Elements,
    Error,
    Fbem,
    InputError,
    Instance,
    IoError,
    Lightmap,
    Method,
    OutOfMemoryError,
    Reference,
    UnsupportedError,
)

__all__ = [
    "Bench",
    "Camera",
    "CancelledError",
    "DeviceError",
    "Elements",
    "Error",
    "Fbem",
    "FormFactors",
    "InputError",
    "Instance",
    "IoError",
    "Lightmap",
    "Method",
    "Model",
    "OutOfMemoryError",
    "Reference",
    "Scene",
    "SceneBuilder",
    "Solution",
    "UnsupportedError",
    "Visibility",
    "__version__",
    "fbem",
    "fbem_spectrum",
]
