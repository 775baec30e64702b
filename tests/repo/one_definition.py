#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""No two types of one name in one namespace: the linker would take either's functions for both. Types inside an
anonymous namespace or another type are their file's own.

one_definition.py ROOT
"""
import pathlib
import re
import subprocess
import sys

root = pathlib.Path(sys.argv[1])
files = subprocess.run(["git", "ls-files", "*.h", "*.cc"], cwd=root, capture_output=True, text=True, check=True).stdout.split()
opens = re.compile(r"^(?:inline )?namespace(?: ([\w:]+))? \{")
defines = re.compile(r"^(?:class|struct|enum class|enum) (?:\[\[\w+\]\] )?(\w+)(?: final)?(?: : [^;]*)? \{")
seen, twice = {}, 0
for name in files:
    spaces = []
    for number, line in enumerate((root / name).read_text().splitlines(), 1):
        if (space := opens.match(line)) and not line.rstrip().endswith("}"):
            spaces.append(space[1] or "")
        elif line.startswith("}  // namespace"):
            spaces.pop()
        elif (type_ := defines.match(line)) and "" not in spaces:
            qualified = "::".join([*spaces, type_[1]])
            where = f"{name}:{number}"
            if qualified in seen:
                print(f"{where}: {qualified} is defined in {seen[qualified]} already")
                twice += 1
            seen.setdefault(qualified, where)
sys.exit(twice > 0)
