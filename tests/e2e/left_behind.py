#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Things left behind in the set become the room's on a director's command, over real sockets.

left_behind.py BUILD_DIR [OUT_DIR]      OUT_DIR keeps the take
"""
import os
import pathlib
import sys
import tempfile
import time

import cv2

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
from programs import Studio, folders, program, run_all
from run import Viewer, demo_scene

BUILD, OUT = folders("left-behind")
BOX = (slice(300, 420), slice(420, 520))  # rows, columns


def take():
    """One picture of the synthetic set for a minute, in which a green box stands that the clean plate lacks."""
    folder = pathlib.Path(OUT) / "take"
    program(BUILD / "tests" / "make_synthetic_take", folder, 0.2, 0.4)
    first = {name: next(line for line in (folder / f"{name}.txt").read_text().splitlines() if not line.startswith("#")).split()[1]
             for name in ("rgb", "depth", "amplitude")}
    picture = cv2.imread(str(folder / first["rgb"]))
    picture[BOX] = (40, 160, 30)
    cv2.imwrite(str(folder / "rgb/box.jpg"), picture, [cv2.IMWRITE_JPEG_QUALITY, 95])
    for name, file, rate in (("rgb", "rgb/box.jpg", 30), ("depth", first["depth"], 12.5), ("amplitude", first["amplitude"], 12.5)):
        (folder / f"{name}.txt").write_text("".join(f"{1 + i / rate:.6f} {file}\n" for i in range(int(60 * rate))))
    return folder


def a_thing_becomes_the_room_on_command_and_foreground_again():
    with tempfile.TemporaryDirectory() as folder, Studio(BUILD) as studio:
        box = take()
        studio.server("--clean-plate", box / "clean_plate", rig=box / "rig.json", scene=demo_scene(folder) / "scene.yaml")
        studio.agent(f"take:{box}", "--rate", "real")
        studio.wait_until_live()
        anna = Viewer(studio.port)

        def adopted():
            """True, or why it was refused."""
            number = anna.edit("adopt", u=470, v=360)
            while True:
                message = anna.message()
                if message["type"] == "scene" and message.get("adopted"):
                    return True
                if message["type"] == "refused" and message["id"] == number:
                    return message["reason"]

        def is_foreground_again():
            anna.wait("scene", lambda m: "adopted" not in m)
            assert adopted() is True

        assert adopted() is True
        time.sleep(0.3)  # the frames that were on their way
        # What is the room's is no foreground: there is nothing to adopt any more.
        number = anna.edit("adopt", u=470, v=360)
        assert "foreground" in anna.wait("refused", lambda m: m["id"] == number)["reason"]
        anna.edit("undo")
        is_foreground_again()
        anna.edit("forget")
        is_foreground_again()
        assert not anna.scene["unsaved"], "scene.yaml has no part in it"


TESTS = [a_thing_becomes_the_room_on_command_and_foreground_again]

if __name__ == "__main__":
    sys.exit(1 if run_all(TESTS) else 0)
