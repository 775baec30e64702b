# SPDX-License-Identifier: Apache-2.0
"""Starts agents, servers and viewers as a studio would: real processes, real LCM, real sockets. Runs the programs that end by
themselves, and the evaluators of the shared test data on what they wrote."""
import atexit
import json
import os
import pathlib
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
import urllib.request

ROOT = pathlib.Path(__file__).resolve().parents[2]
DEMO = ROOT / "deploy" / "demo"
SHARED = ROOT.parent / "shared"  # not part of the repository
DATA, TOOLS = SHARED / "data", SHARED / "tools"
PYTHON = "/usr/bin/python3"  # Debian's: python3-opencv and python3-numpy belong to it


def free_port():
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        return s.getsockname()[1]


class Studio:
    """One rig network and one server port; everything started here is killed on leaving the `with`."""

    def __init__(self, build):
        self.build = pathlib.Path(build)
        self.port = free_port()
        self.lcm = f"udpm://239.255.76.67:{free_port()}?ttl=0&recv_buf_size=4194304"
        self.url = f"http://127.0.0.1:{self.port}/"
        self.running = []

    def __enter__(self):
        return self

    def __exit__(self, *unused):
        for process in self.running:
            if process.poll() is None:
                process.kill()
            process.wait()

    def start(self, *command):
        process = subprocess.Popen([str(c) for c in command], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        os.set_blocking(process.stderr.fileno(), False)
        self.running.append(process)
        return process

    def agent(self, source="synthetic", *more):
        return self.start(self.build / "mixstage-agent", "--source", source, "--lcm", self.lcm, "--log-level", "warn", *more)

    def server(self, *more, rig=DEMO / "rig.json", scene=DEMO / "scene.yaml"):
        command = [self.build / "mixstage-server", "--log-level", "warn", "run", "--listen", f"127.0.0.1:{self.port}",
                   "--lcm", self.lcm, "--rig", rig]
        if scene:
            command += ["--scene", scene]
        process = self.start(*command, *more)
        self.wait_for(self.healthy, 20, "the server does not answer")
        return process

    def healthy(self):
        try:
            with urllib.request.urlopen(self.url + "healthz", timeout=1) as answer:
                return json.load(answer)
        except OSError:
            return None

    def metrics(self):
        with urllib.request.urlopen(self.url + "metrics", timeout=2) as answer:
            text = answer.read().decode()
        values = {}
        for line in text.splitlines():
            if line and not line.startswith("#"):
                name, value = line.rsplit(" ", 1)
                values[name] = float(value)
        return values

    def view(self, seconds, *more, expect=0):
        """mixstage-view for some seconds; its JSON line."""
        run = subprocess.run([str(self.build / "mixstage-view"), self.url, "--seconds", str(seconds), *map(str, more)],
                             capture_output=True, text=True, timeout=seconds + 60)
        assert run.returncode == expect, f"mixstage-view ended with {run.returncode}: {run.stderr.strip()}"
        return json.loads(run.stdout.strip().splitlines()[-1]) if expect == 0 else run.stderr

    def wait_until_live(self):
        """The synthetic room takes a moment to be drawn, the empty set a second to be learnt."""
        self.wait_for(lambda: self.healthy()["state"] == "live", 30, f"the show is not live but {self.healthy()}")

    @staticmethod
    def wait_for(condition, seconds, why):
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            value = condition()
            if value:
                return value
            time.sleep(0.05)
        raise AssertionError(f"{why} within {seconds} s")


def crash(process):
    process.send_signal(signal.SIGKILL)
    process.wait()


def resident_mb(process):
    for line in open(f"/proc/{process.pid}/status"):
        if line.startswith("VmRSS"):
            return int(line.split()[1]) / 1024
    return 0


class Skip(Exception):
    """What a test needs is not here; says what."""


def folders(name):
    """BUILD_DIR and OUT_DIR of the command line; without an OUT_DIR a new folder that goes with the program."""
    build = pathlib.Path(sys.argv[1] if len(sys.argv) > 1 else "build").resolve()
    if len(sys.argv) > 2:
        return build, pathlib.Path(sys.argv[2]).resolve()
    out = pathlib.Path(tempfile.mkdtemp(prefix=f"mixstage-{name}-")).resolve()
    atexit.register(shutil.rmtree, out, ignore_errors=True)
    return build, out


def program(*command, expect=0):
    """A program run to its end, which is one of the exit codes `expect`; what it wrote in `stdout` and `stderr`."""
    run = subprocess.run([str(c) for c in command], capture_output=True, text=True, timeout=900)
    expected = expect if isinstance(expect, tuple) else (expect,)
    assert run.returncode in expected, f"{pathlib.Path(command[0]).name} ended with {run.returncode}, not {expect}: {run.stderr.strip()[-500:]}"
    return run


def evaluate(tool, *arguments):
    """The score that an evaluator of the shared test data gives."""
    if not (TOOLS / tool).exists():
        raise Skip(f"{TOOLS / tool} is not here")
    run = subprocess.run([PYTHON, str(TOOLS / tool), *map(str, arguments), "--json"], capture_output=True, text=True, timeout=900)
    assert run.returncode == 0, f"{tool}: {run.stdout} {run.stderr}"
    return json.loads(run.stdout)


def run_on_data(tests):
    """run_all, where the shared test data is here."""
    if DATA.is_dir():
        return run_all(tests)
    for test in tests:
        print(f"SKIP {test.__name__}: the shared test data is not beside this checkout ({DATA})", flush=True)
    return 0


def run_all(tests):
    """Prints ok, FAIL or SKIP for each test function; the number that failed."""
    failed = 0
    for test in tests:
        try:
            note = test()
            print(f"ok {test.__name__}" + (f" ({note})" if note else ""), flush=True)
        except Skip as reason:
            print(f"SKIP {test.__name__}: {reason}", flush=True)
        except Exception as error:  # a test's own failure, whatever it is, is one line
            failed += 1
            print(f"FAIL {test.__name__}: {type(error).__name__} {error}", flush=True)
    return failed
