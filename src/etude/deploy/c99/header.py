"""The header: all that somebody needs who has never seen where the model comes from."""

from __future__ import annotations

from dataclasses import dataclass
from textwrap import wrap

from etude import __version__
from etude.deploy.c99.plan import UNBOUNDED, Plan, parts_in_c


@dataclass(frozen=True)
class Form:
    """How a model is written.

    Attributes:
        single: numbers are float. variance: with variances. fade: with commands that fade, too.
        digest: SHA-256 of the model's file.
    """

    single: bool = False
    variance: bool = False
    fade: bool = False
    digest: str = ""

    @property
    def real(self) -> str:
        return "float" if self.single else "double"


def header(plan: Plan, form: Form) -> str:
    """NAME.h"""
    own, upper = plan.name, plan.name.upper()
    states, commands = parts_in_c(plan)
    memory = f"    {own}_real memory[{plan.memory}];\n" if plan.memory else ""
    return f"""\
/* {own}: commands of the robot {_plain(plan.name)} from its states, as learned by Etude {__version__}.
   Model (SHA-256 of its file): {form.digest or "none"}

   How to call it, in a loop:

       {own}_state state;
       {own}_real input[{upper}_INPUTS], command[{upper}_COMMANDS];
       unsigned flags;
       {own}_init(&state);
       for (;;) {{
           input[{upper}_{states[0].upper()}] = ...;   all of the table below, each in its unit
           flags = {own}_mean(&state, input, command);
           ... add command[{upper}_COMMAND_{commands[0].upper()}] ... to what your feedback commands
       }}

   The states are those of the motion that is asked for, its set-points: nothing measures accelerations well.
{_words(plan)}   Call it once for each sample, in the order of time{_remembers(plan)}.
   Compile {own}.c as C99 and link the mathematical library (-lm); nothing else is needed. There is no
   allocation, no global variable that changes, no input or output. One state may not be used by two threads
   at once; several states may.

   Inputs, in this order, with the range that they are clamped to, and in brackets that of the data which the
   model was trained on:
{_inputs(plan, states)}

   Commands, in this order, with their limits, to which they are clamped:
{_commands(plan, commands)}

   Flags, as bits of what functions return; 0: the answer is as good as the model.
     1 {upper}_NOT_A_NUMBER  an input was NaN or infinite: its last good value, or the middle, is used
     2 {upper}_CLAMPED       an input was outside the range that it is clamped to
     4 {upper}_UNTRAINED     an input was outside the data that the model was trained on: it extrapolates
     8 {upper}_LIMITED       a command was clamped to its limit
    16 {upper}_NO_ANSWER     a command was no number; it is 0
   Every command is a finite number, whatever the inputs, with -ffast-math too. */
#ifndef {upper}_H
#define {upper}_H

#ifdef __cplusplus
extern "C" {{
#endif

#define {upper}_MODEL "{form.digest}"
#define {upper}_INPUTS {len(states)}
#define {upper}_COMMANDS {len(commands)}

typedef {form.real} {own}_real;

enum {{
{_enum(upper, states)}
}};

enum {{
{_enum(f"{upper}_COMMAND", commands)}
}};

enum {{
    {upper}_NOT_A_NUMBER = 1,
    {upper}_CLAMPED = 2,
    {upper}_UNTRAINED = 4,
    {upper}_LIMITED = 8,
    {upper}_NO_ANSWER = 16
}};

/* What is remembered from one call to the next. */
typedef struct {{
    {own}_real last[{upper}_INPUTS];
{memory}}} {own}_state;

/* Ranges that inputs are clamped to, and limits of the commands. */
extern const {own}_real {own}_low[{upper}_INPUTS], {own}_high[{upper}_INPUTS];
extern const {own}_real {own}_least[{upper}_COMMANDS], {own}_most[{upper}_COMMANDS];

/* Begins anew: nothing is remembered. */
void {own}_init({own}_state *state);

/* Commands from the states. Returns flags. */
unsigned {own}_mean({own}_state *state, const {own}_real *input, {own}_real *command);

/* The part of the commands that holds the robot still in that position (gravity): rates count as 0. */
unsigned {own}_gravity(const {own}_real *input, {own}_real *command);
{_more(own, form)}
#ifdef __cplusplus
}}
#endif

#endif
"""


def _plain(text: str) -> str:
    return text.replace("*/", "* /")


def _words(plan: Plan) -> str:
    lines = wrap(_plain(plan.words), 100)
    return "".join(f"   {line}\n" for line in lines)


def _remembers(plan: Plan) -> str:
    if not plan.memory:
        return ""
    rate = plan.rate
    return f": what friction\n   remembers of the way is kept in the state. At least {rate:g} times a second"


def _more(own: str, form: Form) -> str:
    state = f"{own}_state *state, const {own}_real *input"
    rest = f"{state}, {own}_real *command, {own}_real *variance"
    text = ""
    if form.variance:
        text += f"""
/* The same, with the variance of each command (its unit squared), noise included. */
unsigned {own}_predict({rest});
"""
    if form.fade:
        text += f"""
/* Commands that fade to those of physics, or to zero where the model has none, as the predicted deviation
   comes near that before any data: what to add to a feedback. variance as above. */
unsigned {own}_faded({rest});
"""
    return text


def _inputs(plan: Plan, states: list[str]) -> str:
    lines = []
    for i, ((channel, part), label, name) in enumerate(zip(plan.parts, plan.labels, states, strict=True)):
        unit = channel.units[part] or "1"
        told = "" if label == name else f"  ({_plain(label)})"
        known = abs(plan.trained_low[i]) < UNBOUNDED
        trained = f"{plan.trained_low[i]:.6g} .. {plan.trained_high[i]:.6g}" if known else "not known"
        ranges = f"{plan.low[i]:.6g} .. {plan.high[i]:.6g} ({trained})"
        lines.append(f"    {i:3} {name:<28} {unit:<8} {ranges}{told}")
    return "\n".join(lines)


def _commands(plan: Plan, commands: list[str]) -> str:
    lines = []
    for j, (name, old) in enumerate(zip(commands, plan.model.commands, strict=True)):
        told = "" if name == old else f"  ({_plain(old)})"
        lines.append(
            f"    {j:3} {name:<28} {plan.units[j] or '1':<8} {plan.least[j]:.6g} .. {plan.most[j]:.6g}{told}"
        )
    return "\n".join(lines)


def _enum(prefix: str, names: list[str]) -> str:
    return ",\n".join(f"    {prefix}_{name.upper()} = {i}" for i, name in enumerate(names))
