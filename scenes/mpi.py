#!/usr/bin/env python3
"""Measures how a command shares its work between two MPI ranks, and estimates its time on up to 1,024.

    python3 scenes/mpi.py [--binary target/release/mrvis] -- solve office.obj --error 0.01 --output none --out out/office

runs the command with one thread alone and with `mpirun -n 2 ... --mpi`, and prints a Markdown table. The command must be built with
`--features mpi`. Times are those of the processor, which other programs on the machine hardly change; measured times of the clock are
printed above the table. docs/measurements.md explains the model. It needs only Python's standard library.
"""

import argparse
import json
import math
import os
import pathlib
import resource
import statistics
import subprocess
import tempfile
import time

ROOT = pathlib.Path(__file__).resolve().parent.parent
# Latency of a message, s, and bytes a second of a rank. InfiniBand: 2 us and 10 GB/s; 10 gigabit Ethernet: 50 us and 1.1 GB/s.
NETWORKS = {"InfiniBand": (2e-6, 1e10), "10 Gb Ethernet": (5e-5, 1.1e9)}
RANKS = [1, 2, 4, 8, 16, 64, 256, 1024]


def largest(count):
    """Expected largest of so many normally distributed numbers, standard deviations above the mean (Blom 1958)."""
    return statistics.NormalDist().inv_cdf((count - 0.375) / (count + 0.25)) if count > 1 else 0.0


def cost(ranks, m, latency, bandwidth):
    """Seconds on so many ranks: serial part, the slowest share of the rest, messages of rings, bytes of the other ranks."""
    if ranks == 1:
        return m["serial"] + m["shared"], 0.0, 0.0
    # Rows are dealt one by one or in small blocks: the deviation of a share falls with the root of its rows.
    uneven = m["uneven"] * math.sqrt(ranks / 2) * largest(ranks) / largest(2)
    transfer = 2 * m["gathers"] * (ranks - 1) * latency + m["bytes"] * (ranks - 1) / ranks / bandwidth
    return m["serial"] + m["shared"] / ranks * (1 + uneven) + transfer, uneven, transfer


def run(words):
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    start = time.monotonic()
    environment = {"OMPI_ALLOW_RUN_AS_ROOT": "1", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1", **os.environ}
    subprocess.run(words, check=True, env=environment, stdout=subprocess.DEVNULL)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.monotonic() - start, sum(getattr(after, k) - getattr(before, k) for k in ("ru_utime", "ru_stime"))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--binary", default=ROOT / "target/release/mrvis")
    parser.add_argument("command", nargs="+")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        record = pathlib.Path(folder) / "record.json"
        words = [str(args.binary), *args.command, "--threads", "1", "--json", str(record)]
        alone_s, alone_cpu = run(words)
        launcher = ["mpirun", "-n", "2", "--bind-to", "none", "--oversubscribe"]
        two_s, _ = run([*launcher, *words, "--mpi"])
        sharing = json.loads(record.read_text())["sharing"]
    busy = statistics.mean(sharing["busy_s"])
    # serial + shared = alone and serial + shared / 2 = busy
    shared = max(2 * (alone_cpu - busy), 0.0)
    m = {"serial": alone_cpu - shared, "shared": shared, "bytes": sharing["bytes"], "gathers": sharing["gathers"]}
    m["uneven"] = (sharing["slowest_s"] - busy) / (shared / 2) if shared else 0.0
    print(f"Clock: {alone_s:.1f} s alone, {two_s:.1f} s on two ranks, {alone_s / two_s:.2f} times as fast.")
    print(
        f"Processor: {alone_cpu:.1f} s alone; on two ranks the slower one takes {sharing['slowest_s']:.1f} s, "
        f"{alone_cpu / sharing['slowest_s']:.2f} times as fast. Serial {m['serial']:.1f} s, shared {shared:.1f} s, shares uneven by "
        f"{100 * m['uneven']:.1f} %; {m['gathers']} gatherings of {m['bytes'] / 1e6:.0f} MB in all."
    )
    print("\n| ranks | shares uneven by | " + " | ".join(f"{name}: messages and bytes | time | speed-up" for name in NETWORKS) + " |")
    print("| --- | --- |" + " --- | --- | --- |" * len(NETWORKS))
    for ranks in RANKS:
        cells = []
        for latency, bandwidth in NETWORKS.values():
            seconds, uneven, transfer = cost(ranks, m, latency, bandwidth)
            cells.append(f"{transfer:.2f} s | {seconds:.1f} s | {alone_cpu / seconds:.1f}")
        print(f"| {ranks:,} | {100 * uneven:.1f} % | " + " | ".join(cells) + " |")


if __name__ == "__main__":
    main()
