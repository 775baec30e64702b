# SPDX-License-Identifier: Apache-2.0
"""A display in memory (Xvfb): what is on it, and keys pressed on it."""
import ctypes
import os
import pathlib
import struct
import subprocess
import time


class Display:
    def __init__(self, folder, width=2100, height=900):
        self.folder, self.width, self.height = pathlib.Path(folder), width, height
        read, write = os.pipe()
        self.process = subprocess.Popen(["Xvfb", "-displayfd", str(write), "-screen", "0", f"{width}x{height}x24", "-fbdir",
                                         str(self.folder), "-nolisten", "tcp"], pass_fds=[write], stdout=subprocess.DEVNULL,
                                        stderr=subprocess.DEVNULL)
        os.close(write)
        with os.fdopen(read) as answer:
            number = answer.readline().strip()
        assert number, "Xvfb does not start"
        self.name = f":{number}"
        # It tells its number before it lets anybody in.
        self.x11, self.xtst = ctypes.CDLL("libX11.so.6"), ctypes.CDLL("libXtst.so.6")
        self.x11.XOpenDisplay.restype = ctypes.c_void_p
        self.connection, end = None, time.monotonic() + 20
        while not self.connection:
            assert time.monotonic() < end, "Xvfb lets nobody in"
            time.sleep(0.05)
            self.connection = ctypes.c_void_p(self.x11.XOpenDisplay(self.name.encode()))

    def __enter__(self):
        return self

    def __exit__(self, *unused):
        self.process.terminate()
        self.process.wait()

    def pixels(self):
        """(width, height, rows of 32-bit blue, green, red, unused) of the whole screen: an XWD file."""
        data = (self.folder / "Xvfb_screen0").read_bytes()
        head = struct.unpack(">25I", data[:100])
        width, height, bytes_per_line, colors = head[4], head[5], head[12], head[19]
        start = head[0] + 12 * colors
        return width, height, [data[start + y * bytes_per_line: start + y * bytes_per_line + 4 * width] for y in range(height)]

    def press(self, key):
        """A letter, on the window in the middle: without a window manager keys go where the pointer is."""
        code = self.x11.XKeysymToKeycode(self.connection, ctypes.c_ulong(ord(key)))
        self.xtst.XTestFakeMotionEvent(self.connection, 0, self.width // 2, self.height // 2, ctypes.c_ulong(0))
        for down in (1, 0):
            self.xtst.XTestFakeKeyEvent(self.connection, code, down, ctypes.c_ulong(0))
        self.x11.XSync(self.connection, 0)
