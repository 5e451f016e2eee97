"""What stands beside an exported policy of an arm, so that it can be built and run at once."""

import os
from pathlib import Path
from typing import Any

import numpy as np

from .._errors import ConfigurationError
from ..xla import HIT, Field
from ._c_source import CSource, write_text

_BESIDE = ("CMakeLists.txt", "main.c", "example.cpp")

_CMAKE = """\
# Written by jaxrmp.
cmake_minimum_required(VERSION 3.10)
project({name} C CXX)

if(NOT CMAKE_BUILD_TYPE)
  set(CMAKE_BUILD_TYPE Release)
endif()

add_library({name} STATIC {name}.c)
set_target_properties({name} PROPERTIES C_STANDARD 99 C_EXTENSIONS OFF POSITION_INDEPENDENT_CODE ON)
target_include_directories({name} PUBLIC ${{CMAKE_CURRENT_SOURCE_DIR}})
if(UNIX)
  target_link_libraries({name} PUBLIC m)
endif()
# Faster, on the machine that it is built on alone: -DCMAKE_C_FLAGS="-O3 -march=native"

add_executable({name}_main main.c)
set_target_properties({name}_main PROPERTIES C_STANDARD 99 C_EXTENSIONS OFF)
target_link_libraries({name}_main {name})

add_executable({name}_example example.cpp)
target_link_libraries({name}_example {name})
"""

_MAIN = """\
/* Written by jaxrmp. Runs {name} at 1 kHz from {start}, with joints that do what they are told: where it comes to rest,
   and what a call takes. */

#include <stdio.h>
#include <time.h>

#include "{name}.h"

#define JOINTS {n}
#define LONGEST 60000 /* steps */

static {name}_in in = {{
{values}
}};

int main(void) {{
    const double dt = 0.001, at_rest = 1e-4; /* s, rad/s */
    double q[JOINTS], qd[JOINTS] = {{0}}, fastest = 1;
    {name}_out out;
    long steps = 0;
    int finite = 1;
    for (int i = 0; i < JOINTS; i++) q[i] = in.q[i];
    clock_t start = clock();
    for (; finite && steps < LONGEST && (steps < 100 || fastest > at_rest); steps++) {{
        {name}(&in, &out);
{checks}        fastest = 0;
        for (int i = 0; i < JOINTS; i++) {{
            qd[i] += dt * out.qdd[i];
            q[i] += dt * qd[i];
            fastest = qd[i] > fastest ? qd[i] : -qd[i] > fastest ? -qd[i] : fastest;
            if (qd[i] != qd[i]) finite = 0;
            in.q[i] = q[i];
            in.qd[i] = qd[i];
        }}
    }}
    double seconds = (double)(clock() - start) / CLOCKS_PER_SEC;
    printf("after %.3f s at", steps * dt);
    for (int i = 0; i < JOINTS; i++) printf(" %.6f", q[i]);
    printf("\\nfastest joint %.1e per second\\n", fastest);
{more}    printf("%.2f us a call\\n", seconds / steps * 1e6);
    if (!finite) puts("stopped: the policy gave what is not a number");
    return finite && fastest <= at_rest ? 0 : 1;
}}
"""

_EXAMPLE = """\
// Written by jaxrmp. One cycle of a controller in C++: what is measured goes in, the acceleration to command comes out.

#include <algorithm>
#include <cstdio>

#include "{name}.h"

int main() {{
    {name}_in in{{}};
    const {real} q[{n}] = {{{q}}};
    std::copy(q, q + {n}, in.q);
{copies}
    {name}_out out;
    {name}(&in, &out);
    for ({real} a : out.qdd) std::printf("%.6f ", static_cast<double>(a));
    std::printf("\\n%s, fingerprint %s\\n", {upper}_VERSION, {upper}_FINGERPRINT);
}}
"""


def write_project(found: CSource, at: dict[str, Any], start: str, folder: str | os.PathLike) -> tuple[Path, ...]:
    """Write a policy of joints, its `CMakeLists.txt`, `main.c`, which runs it at 1 kHz, and `example.cpp`.

    **Arguments**: `found`, with the inputs `q` and `qd` and the output `qdd`; `at`, values of its inputs, by the names
    of their fields, zero by default; `start`, what they are, in words; `folder`, made if it is not there.
    **Returns** the files. **Raises** `OSError`, and `ConfigurationError`, before it writes, where one of the last three
    is there and not of jaxrmp.
    """
    for file in (Path(folder) / name for name in _BESIDE):
        if file.exists() and "Written by jaxrmp." not in file.read_text(errors="replace").partition("\n")[0]:
            raise ConfigurationError(
                f"{file} is there and was not written by jaxrmp: name another folder, or move it away."
            )
    given = {f.name: np.asarray(at[f.name], f.dtype).reshape(-1) for f in found.inputs if f.name in at and f.size}
    q = next(f for f in found.inputs if f.name == "q")
    numbers = {name: ", ".join(map(_number, values)) for name, values in given.items()}
    values = "\n".join(f"    .{name} = {{{text}}}," for name, text in numbers.items())
    more = "".join(
        f'    printf("{f.name} %.6g\\n", out.{f.name});\n' for f in found.outputs if not f.shape and f.dtype.kind == "f"
    )
    checks = ""
    if any(f.name == HIT.name for f in found.outputs):
        checks = f'        if (out.{HIT.name}) {{ puts("stopped: a loop was cut off at its count"); return 1; }}\n'
    fixed = [f for f in found.inputs if f.name in given and f.name not in ("q", "qd")]
    real = "float" if q.dtype.itemsize == 4 else "double"
    words = {"name": found.name, "n": q.size, "q": numbers["q"], "upper": found.name.upper(), "real": real}
    texts = {
        "CMakeLists.txt": _CMAKE.format(**words),
        "main.c": _MAIN.format(**words, start=start, values=values, more=more, checks=checks),
        "example.cpp": _EXAMPLE.format(**words, copies="\n".join(_copied(f, numbers[f.name], real) for f in fixed)),
    }
    return *found.write(folder), *(write_text(Path(folder) / file, text) for file, text in texts.items())


def _copied(field: Field, text: str, real: str) -> str:
    kind = real if field.dtype.kind == "f" else "unsigned char"
    to = f"in.{field.name}" if field.shape else f"&in.{field.name}"
    return (
        f"    const {kind} {field.name}[{field.size}] = {{{text}}};\n"
        f"    std::copy({field.name}, {field.name} + {field.size}, {to});"
    )


def _number(value: Any) -> str:
    return str(int(value)) if value.dtype.kind == "b" else f"{value!s}{'f' if value.dtype.itemsize == 4 else ''}"
