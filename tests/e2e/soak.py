#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""A long show with a restless crowd: real server, synthetic agent, viewers that join, leave and stall.

soak.py BUILD_DIR [FRAMES] [SEED]: prints a table and, for each claim, ok or FAIL. After a tenth of the frames (at least
400) everything has been in use once; from then on memory, threads and descriptors may not grow, seen while nobody watches.
"""
import os
import pathlib
import sys
import time

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
from crowd import Crowd
from programs import Studio, resident_mb, run_all

BUILD = pathlib.Path(sys.argv[1] if len(sys.argv) > 1 else "build").resolve()
FRAMES = int(sys.argv[2]) if len(sys.argv) > 2 else 10_000
SEED = int(sys.argv[3]) if len(sys.argv) > 3 else 1
WARM_UP = max(400, FRAMES // 10)
LOOKS = 5  # at the programs while nobody watches, after the warm-up
GROWTH_MB = 2.0

# Drops that have a reason which a loaded machine or a stalled viewer gives; any other is a bug.
REASONS = {"late", "viewer_slow", "lost", "incomplete", "late_slice"}


def threads(process):
    return len(os.listdir(f"/proc/{process.pid}/task"))


def descriptors(process):
    """The fewest within a second: a connection of ours may still be closing."""
    counts = []
    for _ in range(20):
        counts.append(len(os.listdir(f"/proc/{process.pid}/fd")))
        time.sleep(0.05)
    return min(counts)


class Look:
    """The programs at rest, between two crowds."""

    def __init__(self, studio, server, agent, started):
        values = studio.metrics()
        self.drops = {name.split('"')[1]: int(value) for name, value in values.items() if name.startswith("mixstage_drops_total")}
        self.shown = int(values["mixstage_frames_total"])
        self.seconds = time.monotonic() - started
        self.server_mb, self.agent_mb = resident_mb(server), resident_mb(agent)
        self.server_threads, self.agent_threads = threads(server), threads(agent)
        self.server_descriptors, self.agent_descriptors = descriptors(server), descriptors(agent)

    HEAD = "seconds   shown    late  v.slow   other  server MB  agent MB  threads  descriptors"

    def row(self):
        other = sum(count for reason, count in self.drops.items() if reason not in ("late", "viewer_slow"))
        return (f"{self.seconds:7.0f} {self.shown:7d} {self.drops.get('late', 0):7d} {self.drops.get('viewer_slow', 0):7d} "
                f"{other:7d} {self.server_mb:10.1f} {self.agent_mb:9.1f} {self.server_threads:4d} +{self.agent_threads:2d} "
                f"{self.server_descriptors:9d} +{self.agent_descriptors:2d}")



looks, crowd_counts = [], {}


def a_long_show_keeps_running():
    with Studio(BUILD) as studio:
        server, agent = studio.server(), studio.agent()
        studio.wait_until_live()
        started = time.monotonic()
        crowd = Crowd(studio.port, 8, SEED)
        first = Look(studio, server, agent, started).shown
        print(Look.HEAD)
        for target in [WARM_UP + (FRAMES - WARM_UP) * i // LOOKS for i in range(LOOKS + 1)]:
            while (now := studio.metrics()["mixstage_frames_total"] - first) < target:
                crowd.step(min(2.0, (target - now) / 30))
                assert server.poll() is None and agent.poll() is None, "a program ended"
                assert time.monotonic() - started < 60 + FRAMES / 5, f"only {now:.0f} pictures so far"
            crowd.go_home()
            studio.wait_for(lambda: studio.metrics()["mixstage_viewers"] == 0, 20, "viewers who left are still counted")
            time.sleep(0.5)  # sockets close, queues run empty
            looks.append(Look(studio, server, agent, started))
            print(looks[-1].row(), flush=True)
        crowd_counts.update(crowd.counts)
        seen = studio.view(3)
        assert seen["frames"] > 20 and seen["lost"] == 0, seen
        return ", ".join(f"{count} {what}" for what, count in crowd.counts.items()) + f", {crowd.bytes / 1e6:.0f} MB read"


def memory_does_not_grow():
    assert len(looks) > LOOKS, "the show broke off"
    for name in ("server_mb", "agent_mb"):
        grown = max(getattr(look, name) for look in looks) - getattr(looks[0], name)
        assert grown <= GROWTH_MB, f"{name[:-3]} grew by {grown:.1f} MB"
    return f"server {looks[0].server_mb:.1f} to {looks[-1].server_mb:.1f} MB"


def threads_and_descriptors_stay():
    assert len(looks) > LOOKS, "the show broke off"
    for name in ("server_threads", "agent_threads", "server_descriptors", "agent_descriptors"):
        values = [getattr(look, name) for look in looks]
        assert len(set(values)) == 1, f"{name.replace('_', ' ')}: {values}"


def every_drop_has_a_reason():
    assert len(looks) > LOOKS, "the show broke off"
    unknown = set(looks[-1].drops) - REASONS
    assert not unknown, {reason: looks[-1].drops[reason] for reason in unknown}
    return str(looks[-1].drops)


if __name__ == "__main__":
    tests = [a_long_show_keeps_running, memory_does_not_grow, threads_and_descriptors_stay, every_drop_has_a_reason]
    sys.exit(1 if run_all(tests) else 0)
