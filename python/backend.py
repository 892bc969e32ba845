"""Build backend of the package: maturin, which packs Embree into wheels unless pip calls it. Here it does so then, too."""

import json
import os
import pathlib
import shutil
import subprocess

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


def forget_patched_library():
    """Removes the library of the last build: maturin changed it to load the packed Embree, and would look for that now, because Cargo
    does not link what did not change (issue 2680 of maturin)."""
    command = ["cargo", "metadata", "--format-version", "1", "--no-deps"]
    target = pathlib.Path(json.loads(subprocess.check_output(command))["target_directory"])
    shutil.rmtree(target / "maturin", ignore_errors=True)
    for library in [*target.glob("*/deps/lib_mrvis.so"), *target.glob("*/*/deps/lib_mrvis.so")]:
        library.unlink()


def build_wheel(wheel_directory, config_settings=None, metadata_directory=None):
    forget_patched_library()
    os.environ["MATURIN_PEP517_ARGS"] = "--compatibility pypi " + os.environ.get("MATURIN_PEP517_ARGS", "")
    return maturin.build_wheel(wheel_directory, config_settings, metadata_directory)
