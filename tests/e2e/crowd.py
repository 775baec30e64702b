# SPDX-License-Identifier: Apache-2.0
"""Viewers in numbers, without decoding: they join, read or stall, and leave politely or not."""
import random
import selectors
import socket
import time


def handshake(port, receive_buffer=0):
    """A WebSocket opened by hand."""
    s = socket.socket()
    if receive_buffer:
        s.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, receive_buffer)
    s.settimeout(5)
    s.connect(("127.0.0.1", port))
    s.sendall((f"GET /watch HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
               "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n\r\n").encode())
    return s


def frame(opcode, payload):
    """A masked frame of up to 125 bytes."""
    mask = bytes([1, 2, 3, 4])
    return bytes([0x80 | opcode, 0x80 | len(payload)]) + mask + bytes(b ^ mask[i % 4] for i, b in enumerate(payload))


class Crowd:
    """At most `size` viewers; a seeded dice says who does what. Step() is called often."""

    def __init__(self, port, size, seed):
        self.port, self.size, self.dice = port, size, random.Random(seed)
        self.selector = selectors.DefaultSelector()
        self.viewers = {}  # socket -> "reads", "dawdles" or "stalls"
        self.counts = {"joined": 0, "stalled": 0, "left": 0, "cut off": 0, "closed by the server": 0}
        self.bytes = 0
        self.next_act = 0

    def join(self):
        kind = self.dice.choices(["reads", "dawdles", "stalls"], [6, 2, 2])[0]
        s = handshake(self.port, 8192 if kind == "stalls" else 0)
        s.setblocking(False)
        self.viewers[s] = kind
        self.counts["joined"] += 1
        self.counts["stalled"] += kind == "stalls"
        if kind != "stalls":
            self.selector.register(s, selectors.EVENT_READ)

    def leave(self, s, how):
        if self.viewers.pop(s) != "stalls":
            self.selector.unregister(s)
        self.counts[how] += 1
        s.close()

    def act(self):
        """One person's decision."""
        if len(self.viewers) < self.size and (not self.viewers or self.dice.random() < 0.5):
            return self.join()
        s = self.dice.choice(list(self.viewers))
        action = self.dice.choice(["leave", "cut", "subscribe", "keyframe", "ping"])
        try:
            if action == "leave":
                s.send(frame(8, b"\x03\xe8"))
                self.leave(s, "left")
            elif action == "cut":
                s.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\1\0\0\0\0\0\0\0")
                self.leave(s, "cut off")
            elif action == "subscribe":
                streams = self.dice.choice(['"color"', '"depth"', '"color","depth"', '"mesh"', '"color","depth","mesh"', ""])
                s.send(frame(1, ('{"type":"subscribe","streams":[%s]}' % streams).encode()))
            else:
                s.send(frame(1, b'{"type":"keyframe"}' if action == "keyframe" else b'{"type":"ping","viewer_us":1}'))
        except OSError:
            if s in self.viewers:
                self.leave(s, "closed by the server")

    def step(self, seconds):
        """Reads what there is and acts some times a second."""
        end = time.monotonic() + seconds
        while (now := time.monotonic()) < end:
            if now >= self.next_act:
                self.next_act = now + self.dice.uniform(0.05, 0.4)
                self.act()
            for key, _ in self.selector.select(0.02):
                s = key.fileobj
                try:
                    got = s.recv(1024 if self.viewers[s] == "dawdles" else 1 << 18)
                    self.bytes += len(got)
                    if not got:
                        self.leave(s, "closed by the server")
                except OSError:
                    self.leave(s, "closed by the server")

    def go_home(self):
        for s in list(self.viewers):
            self.leave(s, "left")
