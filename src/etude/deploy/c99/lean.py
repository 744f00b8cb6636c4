"""NAME_lean.h and .c: accelerations that hold against the learned drag, as a function of velocity."""

from __future__ import annotations

import re
from importlib import resources
from typing import Any

from etude.deploy.c99.header import Form
from etude.deploy.c99.source import prelude, resolved
from etude.deploy.c99.tables import tables
from etude.models.gp.c99 import real
from etude.types import Code


def lean_files(inputs: Any, name: str, form: Form) -> tuple[dict[str, bytes], Code | None]:
    """Both files of a vehicle's inputs, and the code of its drag; without the capability a drag of 0.

    Args:
        inputs: of the model; see `protocols.SupportsDrag`.
        name: prefix in C. form: numbers are float, or double.
    """
    told = getattr(inputs, "drag_c", None)
    code: Code | None = None if told is None else told(f"{name}_force")
    dx, dy = (0.0, 0.0) if code is None else inputs.drag[:2]
    body = _STILL.replace("@NAME@", name) if code is None else code.body
    text, _ = tables(code.data if code is not None else {}, form.single)
    words = {"VARIANCE": False, "SINGLE": form.single}
    own = _template("lean.c", {"NAME": name, "UPPER": name.upper(), "DX": real(dx), "DY": real(dy)})
    rest = f"{resolved(body, words)}\n{own}"
    head = f"""/* {name}_lean.c: written by a program; {name}_lean.h says how to call it. */
#include "{name}_lean.h"

#include <math.h>
#include <stdint.h>
#include <string.h>

#define VARIANCE 0

typedef {name}_real real;

"""
    source = "\n".join([head + resolved(prelude(rest), words), text, rest])
    header = _template("lean.h", {"NAME": name, "UPPER": name.upper()})
    return {f"{name}_lean.h": header.encode(), f"{name}_lean.c": source.encode()}, code


def _template(name: str, words: dict[str, str]) -> str:
    text = resources.files("etude.deploy.c99").joinpath(name).read_text(encoding="utf-8")
    return re.sub(r"@([A-Z0-9]+)@", lambda found: words[found[1]], text)


_STILL = """\
static void @NAME@_force(const real *velocity, real *force)
{
    (void)velocity;
    force[0] = force[1] = R(0.0);
}
"""
