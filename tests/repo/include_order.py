#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Fails when a folder includes one that stands after it: the order of the folders is the order of the data.

include_order.py [REPOSITORY]
"""
import pathlib
import re
import sys

ORDER = [
    "proto/base", "proto/geometry", "proto/codec", "proto/lcm", "proto/link", "proto/take", "proto/watch",
    "proto/synthetic", "server/gl", "server/raster", "capture_agent", "server/calibration", "server/ingest",
    "server/depth", "server/environment", "server/tracking", "server/segmentation", "server/scene", "server/physics", "server/render",
    "server/composite", "server/delivery", "server/pipeline", "server/app", "viewer_client/native",
]
# Two programs that only share what stands in proto: neither may reach into the other.
FORBIDDEN = [("server/", "capture_agent"), ("viewer_client/", "server/"), ("viewer_client/", "capture_agent")]
INCLUDE = re.compile(r'^\s*#\s*include\s*"([^"]+)"')


def folder_of(path):
    best = max((f for f in ORDER if path == f or path.startswith(f + "/")), key=len, default=None)
    return best


def main():
    root = pathlib.Path(sys.argv[1] if len(sys.argv) > 1 else ".").resolve()
    errors, seen = [], 0
    for top in ("proto", "server", "capture_agent", "viewer_client/native"):
        for file in sorted((root / top).rglob("*")):
            if file.suffix not in (".h", ".cc"):
                continue
            here = str(file.relative_to(root))
            own = folder_of(here)
            if own is None:
                errors.append(f"{here}: its folder is not in the order of tests/repo/include_order.py")
                continue
            for number, line in enumerate(file.read_text().splitlines(), 1):
                match = INCLUDE.match(line)
                if not match:
                    continue
                seen += 1
                target = folder_of(match.group(1))
                if target is None:
                    errors.append(f'{here}:{number}: "{match.group(1)}" is not rooted at the repository')
                elif ORDER.index(target) > ORDER.index(own):
                    errors.append(f"{here}:{number}: {own} includes {target}, which stands after it")
                elif any(own.startswith(a) and target.startswith(b) for a, b in FORBIDDEN):
                    errors.append(f"{here}:{number}: {own} must not include {target}")
    print("\n".join(errors) if errors else f"{seen} includes follow the order")
    if seen == 0:
        print("no include was found: wrong folder?")
    return 1 if errors or seen == 0 else 0


if __name__ == "__main__":
    sys.exit(main())
