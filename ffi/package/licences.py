#!/usr/bin/env python3
"""Prints the licences of the crates that the command and the library contain: `licences.py PROJECT`.

Each crate is named with its version and the licence that it states. The texts of its files follow; a text that another crate has
too is printed once, with a reference afterwards.
"""

import json
import pathlib
import subprocess
import sys

NAMES = ("license", "licence", "copying", "copyright", "notice", "unlicense")


def linked(metadata):
    """Packages that are linked into the command and the C library: reached by normal dependencies of this platform, no macros or build
    scripts."""
    nodes = {node["id"]: node for node in metadata["resolve"]["nodes"]}
    packages = {package["id"]: package for package in metadata["packages"]}
    own = set(metadata["workspace_members"])
    seen, waiting = set(), [i for i in own if packages[i]["name"] in ("mrvis-command", "mrvis-ffi")]
    while waiting:
        node = nodes[waiting.pop()]
        for dependency in node["deps"]:
            normal = any(kind["kind"] is None for kind in dependency["dep_kinds"])
            macro = any("proc-macro" in target["kind"] for target in packages[dependency["pkg"]]["targets"])
            if normal and not macro and dependency["pkg"] not in seen:
                seen.add(dependency["pkg"])
                waiting.append(dependency["pkg"])
    return sorted((packages[i] for i in seen - own), key=lambda p: (p["name"], p["version"]))


def main():
    project = pathlib.Path(sys.argv[1])
    host = next(line.split()[1] for line in subprocess.check_output(["rustc", "-vV"], text=True).splitlines() if line.startswith("host:"))
    command = ["cargo", "metadata", "--format-version=1", "--locked", f"--filter-platform={host}"]
    metadata = json.loads(subprocess.check_output(command, cwd=project))
    first = {}
    for package in linked(metadata):
        title = f"{package['name']} {package['version']}"
        print("=" * 100, f"{title}: {package['license'] or 'see below'}", sep="\n")
        print(", ".join(package["authors"]) or package["repository"] or "", end="\n\n")
        folder = pathlib.Path(package["manifest_path"]).parent
        files = [f for f in sorted(folder.iterdir()) if f.is_file() and f.name.lower().startswith(NAMES)]
        for file in files:
            text = file.read_text(errors="replace").strip()
            key = " ".join(text.split())
            if key in first:
                print(f"{file.name}: as that of {first[key]}\n")
            else:
                first[key] = title
                print(f"{file.name}:\n\n{text}\n")


if __name__ == "__main__":
    main()
