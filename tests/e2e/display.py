# SPDX-License-Identifier: Apache-2.0
"""A display in memory (Xvfb): what is on it, and keys pressed on it."""
import ctypes
import os
import pathlib
import struct
import subprocess


class Display:
    def __init__(self, folder, width=2100, height=900):
        self.folder = pathlib.Path(folder)
        read, write = os.pipe()
        self.process = subprocess.Popen(["Xvfb", "-displayfd", str(write), "-screen", "0", f"{width}x{height}x24", "-fbdir",
                                         str(self.folder), "-nolisten", "tcp"], pass_fds=[write], stdout=subprocess.DEVNULL,
                                        stderr=subprocess.DEVNULL)
        os.close(write)
        number = os.read(read, 16).decode().strip()
        os.close(read)
        assert number, "Xvfb does not start"
        self.name = f":{number}"

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
        """A letter, on the window that has the focus."""
        x11, xtst = ctypes.CDLL("libX11.so.6"), ctypes.CDLL("libXtst.so.6")
        x11.XOpenDisplay.restype = ctypes.c_void_p
        display = ctypes.c_void_p(x11.XOpenDisplay(self.name.encode()))
        code = x11.XKeysymToKeycode(display, ctypes.c_ulong(ord(key)))
        for down in (1, 0):
            xtst.XTestFakeKeyEvent(display, code, down, ctypes.c_ulong(0))
        x11.XSync(display, 0)
        x11.XCloseDisplay(display)
