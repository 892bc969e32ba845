"""Build backend of the package: maturin, which packs Embree into wheels unless pip calls it. Here it does so then, too."""

import os

import maturin
from maturin import (  # noqa: F401
    build_editable,
    build_sdist,
    get_requires_for_build_editable,
    get_requires_for_build_sdist,
    get_requires_for_build_wheel,
    prepare_metadata_for_build_editable,
    prepare_metadata_for_build_wheel,
)


def build_wheel(wheel_directory, config_settings=None, metadata_directory=None):
    os.environ["MATURIN_PEP517_ARGS"] = "--compatibility pypi " + os.environ.get("MATURIN_PEP517_ARGS", "")
    return maturin.build_wheel(wheel_directory, config_settings, metadata_directory)
