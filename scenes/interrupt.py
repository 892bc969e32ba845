"""Measures how long after an interruption (SIGINT) the command `mrvis` ends.

    python3 scenes/interrupt.py [--moments N] [--from S] [--until S] -- COMMAND [ARGUMENT ...]

The command is started N times. The signal comes at evenly spread moments between S and S seconds after the start; without
`--until` a run without interruption gives the end. Each line states the moment, the delay, the processor time that the command used
after the signal (all cores together; on a loaded machine the delay is longer), the exit code and the stage that the progress bar
showed. The last lines state quantiles of both. Python's standard library suffices; it needs Linux.
"""

import argparse
import os
import pty
import re
import signal
import subprocess
import threading
import time


class Run:
    """A run of the command, with its standard error on a terminal, where the progress bar appears."""

    def __init__(self, command):
        ours, theirs = pty.openpty()
        self.shown = b""
        self.begun = time.monotonic()
        self.child = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=theirs, stdin=subprocess.DEVNULL)
        os.close(theirs)
        threading.Thread(target=self.read, args=(ours,), daemon=True).start()

    def read(self, terminal):
        try:
            while data := os.read(terminal, 1 << 16):
                self.shown = (self.shown + data)[-4096:]
        except OSError:
            pass
        os.close(terminal)

    def stage(self):
        text = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", self.shown.decode(errors="replace"))
        lines = [line.strip() for line in re.split(r"[\r\n]+", text) if line.strip()]
        return re.split(r"  |[░█]| \d+s| \d+ %", lines[-1].lstrip("⠁⠂⠄⡀⢀⠠⠐⠈ "))[0] if lines else ""

    def processor_time(self):
        fields = open(f"/proc/{self.child.pid}/stat").read().rsplit(")", 1)[1].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    def wait(self):
        """Returns the time of the end, processor time and exit code."""
        _, status, usage = os.wait4(self.child.pid, 0)
        self.child.returncode = os.waitstatus_to_exitcode(status)
        return time.monotonic() - self.begun, usage.ru_utime + usage.ru_stime, self.child.returncode


def main():
    parser = argparse.ArgumentParser(description="Measures how long after an interruption the command mrvis ends.")
    parser.add_argument("--moments", type=int, default=20)
    parser.add_argument("--from", type=float, default=0.2, dest="begin")
    parser.add_argument("--until", type=float)
    parser.add_argument("command", nargs="+")
    options = parser.parse_args()
    end = options.until or Run(options.command).wait()[0]
    delays, works = [], []
    for k in range(options.moments):
        moment = options.begin + (end - options.begin) * (k + 0.5) / options.moments
        run = Run(options.command)
        try:
            run.child.wait(moment)
            break
        except subprocess.TimeoutExpired:
            stage, used, sent = run.stage(), run.processor_time(), time.monotonic() - run.begun
        run.child.send_signal(signal.SIGINT)
        ended, all_used, code = run.wait()
        delays.append(ended - sent)
        works.append(max(all_used - used, 0.0))
        print(
            f"{sent:7.2f} s  delay {delays[-1]:6.2f} s  processor {works[-1]:6.2f} s  code {code:4d}  {stage}", flush=True
        )
    for name, values in (("delay", sorted(delays)), ("processor time", sorted(works))):
        at = lambda part: values[min(int(part * len(values)), len(values) - 1)]
        print(f"{len(values)} interruptions, {name}: median {at(0.5):.2f} s, 90 % {at(0.9):.2f} s, largest {at(1):.2f} s")


if __name__ == "__main__":
    main()
