"""C99 of a vehicle's inputs and of its inverse models."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from etude.models.c99 import mean_function, posteriors_code
from etude.models.gp.c99 import real
from etude.types import Code
from etude_quadrotor.vehicle import GRAVITY

FORCE, RATES, TURNING = "specific_force", "rates", "angular_acceleration"


def inputs_code(name: str, inputs: Any) -> Code:
    """Code of `QuadrotorInputs`: the states in order, without memory."""
    reads = tuple(dict.fromkeys(channel for channel, *_ in inputs.columns))
    lines, place = [], 0
    for channel in reads:
        parts = sum(source == channel for source, *_ in inputs.columns)
        lines += [f"    x[{place + i}] = c_{channel}[{i}];" for i in range(parts)]
        place += parts
    arguments = ", ".join([*(f"const real *c_{channel}" for channel in reads), "real *memory", "real *x"])
    body = "\n".join([f"static void {name}({arguments})", "{", "    (void)memory;", *lines, "}", ""])
    return Code(body, {}, reads=reads, operations=(place, 0))


def vehicle_code(name: str, model: Any, heights: tuple[float, float]) -> Code:
    """Code of a `VehicleInverse`: voltages from Euler's equation, the allocation and steady motors."""
    vehicle, theta = model.vehicle, model.coefficients
    reads: tuple[str, ...] = (FORCE, RATES, TURNING)
    if theta[:2].any():
        reads += ("body_velocity",)
    if theta[2:4].any():
        reads += ("altitude",)
    call = ", ".join([*(f"c_{channel}" for channel in reads), "command"])
    lines = _loads(model, reads, heights)
    for rotor, row in enumerate(vehicle.mixer()):
        slope = vehicle.resistance * vehicle.torque_constant / vehicle.motor_constant
        by_speed = vehicle.motor_constant * (1.0 + theta[4])
        lines += [
            f"    squares = {' + '.join(f'{real(a)} * load[{i}]' for i, a in enumerate(row))};",
            "    squares = squares > R(0.0) ? squares : R(0.0);",
            f"    command[{rotor}] = {real(slope)} * squares + {real(by_speed)} * SQRT(squares)"
            f" + {real(theta[9 + rotor])};",
        ]
    return Code(
        mean_function(name, reads, lines, _hovering(name, reads, call)), {}, reads=reads, operations=(200, 0)
    )


def drag_code(name: str, model: Any) -> Code:
    """Code of a `DragModel`: lines, and the processes of their residuals."""
    parts, lines = [], []
    for j, (slope, posterior) in enumerate(zip(model.linear, model.residual, strict=True)):
        lines.append(f"    force[{j}] = {real(-float(slope))} * velocity[{j}];")
        if posterior is not None:
            parts.append(posteriors_code(f"{name}_{j}", [posterior]))
            lines += [f"    {name}_{j}(velocity, &more, 0);", f"    force[{j}] += more;"]
    data: dict[str, Any] = {}
    for part in parts:
        data |= part.data
    scratch = ["    real more;"] if parts else []
    head = f"static void {name}(const real *velocity, real *force)\n{{"
    body = "\n".join([*(part.body for part in parts), head, *scratch, *lines, "}", ""])
    work = max((part.work for part in parts), default=0)
    return Code(body, data, work=work, operations=(sum(part.operations[0] for part in parts) + 4, 0))


def _loads(model: Any, reads: Sequence[str], heights: tuple[float, float]) -> list[str]:
    vehicle, theta = model.vehicle, model.coefficients
    jx, jy, jz = (real(j) for j in vehicle.inertia)
    lines = [
        "    real load[4], squares, lift;",
        f"    lift = {real(vehicle.mass)} * c_{FORCE}[2];",
        f"    load[0] = lift + {real(theta[5])} * (lift - {real(vehicle.mass * GRAVITY)});",
    ]
    w, a = f"c_{RATES}", f"c_{TURNING}"
    turns = (
        f"{jx} * {a}[0] + ({jz} - {jy}) * {w}[1] * {w}[2]",
        f"{jy} * {a}[1] + ({jx} - {jz}) * {w}[2] * {w}[0]",
        f"{jz} * {a}[2] + ({jy} - {jx}) * {w}[0] * {w}[1]",
    )
    lines += [f"    load[{1 + i}] = {real(1.0 + theta[6 + i])} * ({turn});" for i, turn in enumerate(turns)]
    if "body_velocity" in reads:
        lines += [
            f"    load[0] += {real(theta[1])} * c_body_velocity[2];",
            f"    load[1] -= {real(theta[0])} * c_body_velocity[1];",
            f"    load[2] += {real(theta[0])} * c_body_velocity[0];",
        ]
    if "altitude" in reads:
        height = f"(c_altitude[0] > R(0.0) ? c_altitude[0] : R(0.0)) / {real(vehicle.arm)}"
        lines += [
            f"    squares = {height};",
            f"    load[0] -= lift * ({real(theta[2])} * EXP(-squares / {real(heights[0])})"
            f" + {real(theta[3])} * EXP(-squares / {real(heights[1])}));",
        ]
    return lines


def features_code(name: str, model: Any, least_lift: float) -> Code:
    """Code of a `LinearInverse`: least squares on physical features."""
    reads = (FORCE, RATES, TURNING, *model.uses)
    f, w, a = (f"c_{channel}" for channel in reads[:3])
    features = [
        *(f"{f}[{i}]" for i in range(3)),
        "root",
        *(f"{w}[{i}]" for i in range(3)),
        *(f"{w}[{i}] * {w}[{j}]" for i, j in ((1, 2), (2, 0), (0, 1))),
        *(f"{a}[{i}]" for i in range(3)),
        *(f"{a}[{i}] / root" for i in range(3)),
    ]
    for channel in model.uses:
        width = 1 if channel == "altitude" else 3
        features += [f"c_{channel}[{i}]" for i in range(width)]
    lift = f"{f}[2] / {real(GRAVITY)}"
    lines = [f"    const real lift = {lift};"]
    lines += [f"    const real root = SQRT(lift > {real(least_lift)} ? lift : {real(least_lift)});"]
    tables = {
        f"{name}_centre": model.centre,
        f"{name}_weights": (model.weights / model.spread[:, None]).T.copy(),
    }
    size = len(features)
    lines += [f"    real own[{size}];", "    int i, j;"]
    lines += [f"    own[{i}] = {feature} - {name}_centre[{i}];" for i, feature in enumerate(features)]
    count = len(model.offset)
    offsets = ", ".join(real(value) for value in model.offset)
    lines.insert(0, f"    static const real offset[{count}] = {{{offsets}}};")
    lines += [
        f"    for (j = 0; j < {count}; ++j) {{",
        "        command[j] = offset[j];",
        f"        for (i = 0; i < {size}; ++i)",
        f"            command[j] += {name}_weights[{size} * j + i] * own[i];",
        "    }",
    ]
    call = ", ".join([*(f"c_{channel}" for channel in reads), "command"])
    body = mean_function(name, reads, lines, _hovering(name, reads, call))
    # a product and a sum of each term for each command, and about four more to make it
    return Code(body, tables, reads=reads, work=size, operations=((2 * count + 4) * size, 0))


def _hovering(name: str, reads: Sequence[str], call: str) -> list[str]:
    """Code of the states level and at rest, at the present altitude."""
    from etude_quadrotor.channels import STILL

    nothing = "static const real still[3] = {R(0.0), R(0.0), R(0.0)}"
    lines = [f"    {nothing}, weight[3] = {{R(0.0), R(0.0), {real(GRAVITY)}}};"]
    for channel in reads:
        if channel == FORCE or channel in STILL:
            lines.append(f"    c_{channel} = {'weight' if channel == FORCE else 'still'};")
    return [*lines, f"    {name}({call});"]
