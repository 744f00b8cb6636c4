"""C99 header of a model, with all that a reader needs who does not know the model's origin."""

from __future__ import annotations

from dataclasses import dataclass
from textwrap import wrap

from etude import __version__
from etude.deploy.model_states import outside_training_sentence
from etude.deploy.targets.c99.plan import UNBOUNDED, Plan, parts_in_c


@dataclass(frozen=True)
class CForm:
    """How a model is written.

    Attributes:
        single: numbers are float. variance: with variances. fade: commands fade to what is safe by their
            deviation,
            as `LearnedModel.predict` says; without it they are the mean of the posterior everywhere.
        digest: SHA-256 of the model's file.
    """

    single: bool = False
    variance: bool = False
    fade: bool = True
    digest: str = ""

    @property
    def deviations(self) -> bool:
        """Whether variances are computed, which fading takes."""
        return self.variance or self.fade

    @property
    def real(self) -> str:
        return "float" if self.single else "double"


def header(plan: Plan, form: CForm) -> str:
    """NAME.h"""
    parts = (
        _usage(plan, form),
        _describe_tables(plan, form),
        _opening(plan, form),
        _names(plan),
        _state(plan),
    )
    return "".join([*parts, _functions(plan, form), _CLOSING])


def _usage(plan: Plan, form: CForm) -> str:
    """First part of the comment: purpose and usage."""
    name, upper = plan.name, plan.name.upper()
    states, commands = parts_in_c(plan)
    return f"""\
/* {name}: commands of the robot {_plain(plan.name)} from its states, as learned by Etude {__version__}.
   Model (SHA-256 of its file): {form.digest or "none"}

   Usage in a loop:

       {name}_state state;
       {name}_real input[{upper}_INPUTS], command[{upper}_COMMANDS];
       unsigned flags;
       {name}_init(&state);
       for (;;) {{
           input[{upper}_{states[0].upper()}] = ...;   all inputs of the table below, in their units
           flags = {name}_mean(&state, input, command);
           ... add command[{upper}_COMMAND_{commands[0].upper()}] ... to the command of your feedback
       }}

   The states are the set-points of the planned motion, because accelerations cannot be measured well.
{_state_notes(plan)}   Call it once for each sample, in the order of time{_memory_note(plan)}.
   Compile {name}.c as C99 and link the mathematical library (-lm); nothing else is needed. There is no
   allocation, no global variable that changes, no input or output. One state may not be used by two threads
   at once; several states may.

"""


def _describe_tables(plan: Plan, form: CForm) -> str:
    """Second part of the comment: inputs, commands and flags."""
    upper = plan.name.upper()
    states, commands = parts_in_c(plan)
    return f"""\
   Inputs in this order, with their range in the training data. Outside this range:
{_outside_note(plan, form)}
{_inputs(plan, states)}

   Commands in this order, with the limits to which they are clamped:
{_commands(plan, commands)}

   Flags, as bits of the return value; 0: no restriction.
     1 {upper}_NOT_A_NUMBER  an input was NaN or infinite: its last good value, or the middle, is used
{_flags(upper, form)}
     8 {upper}_LIMITED       a command was clamped to its limit
    16 {upper}_NO_ANSWER     a command was not a number; it is 0
   Every command is a finite number, whatever the inputs, with -ffast-math too. */
"""


def _opening(plan: Plan, form: CForm) -> str:
    """The guard, sizes and the type of numbers."""
    name, upper = plan.name, plan.name.upper()
    states, commands = parts_in_c(plan)
    return f"""\
#ifndef {upper}_H
#define {upper}_H

#ifdef __cplusplus
extern "C" {{
#endif

#define {upper}_MODEL "{form.digest}"
#define {upper}_INPUTS {len(states)}
#define {upper}_COMMANDS {len(commands)}

typedef {form.real} {name}_real;

"""


def _names(plan: Plan) -> str:
    """Places of inputs and commands, and bits of flags."""
    upper = plan.name.upper()
    states, commands = parts_in_c(plan)
    return f"""\
enum {{
{_enum(upper, states)}
}};

enum {{
{_enum(f"{upper}_COMMAND", commands)}
}};

enum {{
    {upper}_NOT_A_NUMBER = 1,
    {upper}_FAR = 2,
    {upper}_UNTRAINED = 4,
    {upper}_LIMITED = 8,
    {upper}_NO_ANSWER = 16
}};

"""


def _state(plan: Plan) -> str:
    """State struct, public tables and initialisation."""
    name, upper = plan.name, plan.name.upper()
    memory = f"    {name}_real memory[{plan.memory}];\n" if plan.memory else ""
    return f"""\
/* What is remembered from one call to the next. */
typedef struct {{
    {name}_real last[{upper}_INPUTS];
{memory}}} {name}_state;

/* Ranges of the inputs that the model was trained on, and limits of the commands. */
extern const {name}_real {name}_low[{upper}_INPUTS], {name}_high[{upper}_INPUTS];
extern const {name}_real {name}_least[{upper}_COMMANDS], {name}_most[{upper}_COMMANDS];

/* Begins anew: nothing is remembered. */
void {name}_init({name}_state *state);

"""


def _functions(plan: Plan, form: CForm) -> str:
    name = plan.name
    return f"""\
/* Commands from the states{_fading_note(form)}. Returns flags. */
unsigned {name}_mean({name}_state *state, const {name}_real *input, {name}_real *command);

/* The same of an instant by itself: without the memory of friction, so no state is needed.
*/ unsigned {name}_instant(const {name}_real *input, {name}_real *command);

/* The part of the commands that holds the robot still in that position (gravity): rates count as 0. */
unsigned {name}_gravity(const {name}_real *input, {name}_real *command);
{_more(name, form)}"""


_CLOSING = """
#ifdef __cplusplus
}
#endif

#endif
"""


def _plain(text: str) -> str:
    return text.replace("*/", "* /").replace("/*", "/ *")  # -Wcomment refuses the second


def _state_notes(plan: Plan) -> str:
    lines = wrap(_plain(plan.state_text), 100)
    return "".join(f"   {line}\n" for line in lines)


def _memory_note(plan: Plan) -> str:
    if not plan.memory:
        return ""
    rate = plan.rate
    return f": what friction\n   remembers of the way is kept in the state. At least {rate:g} times a second"


def _more(name: str, form: CForm) -> str:
    if not form.deviations:
        return ""
    arguments = f"{name}_state *state, const {name}_real *input, {name}_real *command, {name}_real *variance"
    text = f"""
/* As {name}_mean, with the variance of each command given the data (its unit squared), noise included. */
unsigned {name}_predict({arguments});
"""
    # the name of it while fading was an option
    return text + (f"#define {name}_faded {name}_predict\n" if form.fade else "")


def _outside_note(plan: Plan, form: CForm) -> str:
    """Note on commands outside the training data."""
    if not form.fade:
        return "   commands are the posterior mean, however inaccurate it is there."
    return "\n".join(f"   {line}" for line in wrap(_plain(outside_training_sentence(plan.model)), 100))


def _fading_note(form: CForm) -> str:
    return ", faded by their own deviation" if form.fade else ", the posterior mean"


def _flags(upper: str, form: CForm) -> str:
    if form.fade:
        meanings = (
            ("FAR", "a command is physics alone, or a constant: no training data there"),
            (
                "UNTRAINED",
                "a command's deviation is more than twice that of training",
            ),
        )
    else:
        meanings = (
            ("FAR", "an input is beyond its range by more than half of its width"),
            ("UNTRAINED", "an input is outside the range that the model was trained on: it extrapolates"),
        )
    return "\n".join(
        f"     {bit} {f'{upper}_{name}':<{len(upper) + 14}} {meaning}"
        for bit, (name, meaning) in zip((2, 4), meanings, strict=True)
    )


def _inputs(plan: Plan, states: list[str]) -> str:
    lines = []
    for i, ((channel, part), label, name) in enumerate(zip(plan.parts, plan.labels, states, strict=True)):
        unit = channel.units[part] or "1"
        note = "" if label == name else f"  ({_plain(label)})"
        bounded = abs(plan.low[i]) < UNBOUNDED
        ranges = f"{plan.low[i]:.6g} .. {plan.high[i]:.6g}" if bounded else "(not known)"
        lines.append(f"    {i:3} {name:<28} {unit:<8} {ranges}{note}")
    return "\n".join(lines)


def _commands(plan: Plan, commands: list[str]) -> str:
    lines = []
    for j, (name, old) in enumerate(zip(commands, plan.model.commands, strict=True)):
        note = "" if name == old else f"  ({_plain(old)})"
        lines.append(
            f"    {j:3} {name:<28} {plan.units[j] or '1':<8} {plan.least[j]:.6g} .. {plan.most[j]:.6g}{note}"
        )
    return "\n".join(lines)


def _enum(prefix: str, names: list[str]) -> str:
    return ",\n".join(f"    {prefix}_{name.upper()} = {i}" for i, name in enumerate(names))
