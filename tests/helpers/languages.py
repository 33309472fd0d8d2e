"""Right-hand sides in other languages, compiled and run."""

import ctypes
import json
import shutil
import subprocess

import numpy as np
from scipy.io import loadmat, savemat

GCC, NODE, OCTAVE = (shutil.which(name) for name in ("gcc", "node", "octave-cli"))

STRICT = ("-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-Wconversion", "-Wdouble-promotion")


def in_c(folder, texts, constants, real="double"):
    """Functions (x, u, p) → f of C texts; `constants` are the names of each one's p, in its order."""
    for i, (text, names) in enumerate(zip(texts, constants, strict=True)):
        struct = f"static struct {{ {real} {', '.join(names)}; }} p;" if names else ""
        given = "".join(f"    p.{n} = values[{k}];\n" for k, n in enumerate(names)) or "    (void)values;\n"
        (folder / f"f{i}.c").write_text(
            f"#include <math.h>\n{struct}\n{text}\n"
            f"void rhs_{i}(const {real} x[], const {real} u[], const {real} values[], {real} f[]);\n"
            f"void rhs_{i}(const {real} x[], const {real} u[], const {real} values[], {real} f[])\n"
            f"{{\n{given}    right_hand_side(x, u, f);\n}}\n"
        )
    files = [f"f{i}.c" for i in range(len(texts))]
    command = [GCC, *STRICT, "-fno-builtin", "-shared", "-fPIC", *files, "-o", "all.so", "-lm"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    library, kind = ctypes.CDLL(str(folder / "all.so")), np.dtype("f8" if real == "double" else "f4")
    array = np.ctypeslib.ndpointer(kind, flags="C_CONTIGUOUS")

    def function(i):
        f = getattr(library, f"rhs_{i}")
        f.argtypes, f.restype = [array] * 4, None

        def call(x, u, p, size):
            out = np.zeros(size, kind)
            f(*(np.ascontiguousarray(np.append(a, 0.0), kind) for a in (x, u, p)), out)
            return out

        return call

    return [function(i) for i in range(len(texts))]


def in_node(folder, texts, constants, points):
    """f at the points [(x, u, p, size), …] of each text, shape (texts, points, size)."""
    given = [[{"x": list(x), "u": list(u), "p": dict(zip(names, map(float, p), strict=True)), "size": size}
              for x, u, p, size in of_one] for names, of_one in zip(constants, points, strict=True)]  # fmt: skip
    (folder / "points.json").write_text(json.dumps(given))
    models = ",\n".join(f"(() => {{ {text} return model; }})()" for text in texts)
    (folder / "run.mjs").write_text(
        f"import {{ readFileSync }} from 'fs';\nconst models = [{models}];\n"
        "const given = JSON.parse(readFileSync('points.json', 'utf8'));\n"
        "const found = given.map((points, i) => points.map(({ x, u, p, size }) => {\n"
        "  const f = new Float64Array(size); models[i](p)(x, u, f); return Array.from(f, String); }));\n"
        "process.stdout.write(JSON.stringify(found));\n"
    )
    done = subprocess.run([NODE, "run.mjs"], cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return [[np.array(f, dtype=float) for f in of_one] for of_one in json.loads(done.stdout)]


def in_octave(folder, texts, constants, points):
    """As :func:`in_node`; rates of states that relax behind the derivatives."""
    script = []
    for i, (text, names, of_one) in enumerate(zip(texts, constants, points, strict=True)):
        (folder / f"f{i}.m").write_text(
            f"function [f, rates] = f{i}(x, u, p)\n  [f, rates] = rhs(x, u, p);\nend\n\n{text}"
        )
        x, u, p = ([np.append(point[k], 0.0) for point in of_one] for k in range(3))
        savemat(folder / f"in{i}.mat", {"x": x, "u": u, "p": p})
        fields = " ".join(f"q.{n} = p(k, {j + 1});" for j, n in enumerate(names))
        script.append(
            f"clear x u p q y; load in{i}.mat; y = []; for k = 1:rows(x), q = struct(); {fields}\n"
            f"  [f, r] = f{i}(x(k, :)', u(k, :)', q); y(k, :) = [f; r]'; end; save('-v6', 'out{i}.mat', 'y');"
        )
    (folder / "script.m").write_text("\n".join(script) + "\n")
    done = subprocess.run([OCTAVE, "-q", "script.m"], cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return [loadmat(folder / f"out{i}.mat")["y"] for i in range(len(texts))]
