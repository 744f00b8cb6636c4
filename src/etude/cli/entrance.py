"""Entry point: reads the command line, runs one command, prints its outcome or its error.

Other projects on the package index use the name `etude` and install a package `etude` (`etude-sdk`).
Installed into one environment, their files and ours share one folder and pip warns of nothing:
docs/decisions/0048-name-on-the-index.md.

Python's own answer, a KeyboardInterrupt out of whatever runs, is not safe here. Compiled code calls Python to
pack its results, and an exception there came out as a SystemError or a segmentation fault; callbacks of the
compiler swallow it, and the command goes on. Nothing needs the exception: what a campaign commits survives a
kill at any system call, so ending at once loses nothing that an orderly retreat would keep.
"""

from __future__ import annotations

import contextlib
import gc
import os
import re
import signal
import sys
import threading
import traceback
from collections.abc import Callable, Sequence
from types import FrameType

from etude import __version__
from etude.errors import EtudeError, UsageError

MACHINE = "No stored data was lost; check the permissions and the disk, and run the command again."
KEPT = "Interrupted. All stored data is kept; run the same command again to continue."
OF_DEMO = "Interrupted. All stored data is kept; etude simulate continues in its folder."

SELDOM = 50_000
"""More objects than before, at which Python looks for circles among them. A program that loads modules makes
many that stay, and was looked through two hundred times; matrices are not in circles."""


INTERRUPTED = 130
"""The exit code, as a shell gives it; 143 where somebody ended the process (SIGTERM)."""
SIGNALS = {signal.SIGINT: signal.default_int_handler, signal.SIGTERM: signal.SIG_DFL}
"""Signals that end a command, and Python's default handlers."""
CURSOR = b"\r\x1b[K\x1b[?25h"
"""Clears the line of a progress bar, which is never finished now, and shows the cursor that it hid."""


def end_on_interrupt(message: str, line: Callable[[int], str] = lambda _: "") -> None:
    """From now on Ctrl-C prints `message` on stderr and `line` of the code, if any, on stdout, and ends with
    code 130; SIGTERM does so with 143.

    Does nothing where the signal is ignored (a job in the background), is handled already, or cannot be
    handled (outside the main thread).
    """
    if threading.current_thread() is not threading.main_thread():
        return
    if signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        return
    owner, screen = os.getpid(), _screen()

    def end(number: int, _: FrameType | None) -> None:
        code = 128 + number
        try:  # noqa: SIM105 - suppress() would be a call outside of it
            # C code may let us in with an error of its own pending: the first call then fails for it, and
            # takes it away. Without this line the words would be lost.
            os.getpid()
        except BaseException:
            pass
        try:
            if os.getpid() == owner:  # a forked child ends silently
                _end_children()
                _say(screen, message, line(code))
        finally:
            os._exit(code)

    for number, usual in SIGNALS.items():
        if signal.getsignal(number) is usual:
            signal.signal(number, end)


def ignore_from_now() -> None:
    """Ignores further signals: everything is printed, and the interpreter shuts down."""
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, signal.SIG_IGN)


def _screen() -> int:
    """Standard error as it is now: who reads a damaged file sends the one in place nowhere for a moment."""
    try:
        return os.dup(2)
    except OSError:  # there is none
        return 2


def _say(screen: int, message: str, line: str) -> None:
    # not by print: the signal may have come in the middle of one, and then it refuses to be entered again
    with contextlib.suppress(Exception):
        sys.stdout.flush()
    with contextlib.suppress(OSError):
        if os.isatty(screen):
            os.write(screen, CURSOR)
        os.write(screen, f"{message}\n".encode())
        if line:
            os.write(1, f"{line}\n".encode())


def _end_children() -> None:
    """Terminates child processes; workers of a study would wait for work forever."""
    processes = sys.modules.get("multiprocessing")
    if processes is not None:
        with contextlib.suppress(Exception):
            for child in processes.active_children():
                child.terminate()


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs one command; returns its exit code.

    0 ok, 1 a bug or a failing machine, 2 wrong usage, 3 unusable data, 4 unsafe or infeasible trajectory
    (no file is written), 5 stop rule reached, 6 the robot has changed, 7 the robot or its supervisor stopped,
    8 the link to it was lost, 130 interrupted, 143 ended by SIGTERM. As a program (without `arguments`)
    Ctrl-C ends the process itself; who calls with arguments gets the KeyboardInterrupt turned into 130.
    """
    if arguments is not None:
        return _guarded(list(arguments))
    gc.set_threshold(SELDOM)
    argv = sys.argv[1:]
    message = OF_DEMO if argv[:1] == ["demo"] else KEPT
    as_json = "--json" in argv
    end_on_interrupt(
        _block(message), lambda code: _error_line("Interrupted", message, "", "", code) if as_json else ""
    )
    code = _guarded(argv)
    ignore_from_now()
    gc.freeze()  # Python looks for circles once more at the end, among all that was loaded; nobody needs that
    return code


OURS = "etude"
OWN_ENVIRONMENT = (
    "Install Étude into a separate environment: python3 -m venv .venv && .venv/bin/pip install ."
)


def strangers() -> list[str]:
    """Other installed distributions whose files lie in the package `etude`: "etude-sdk 0.2.6".

    The list of files (RECORD) tells, since the name of a distribution does not say which packages it has.
    """
    from importlib import metadata  # here: every command imports this module, few need it

    others = []
    for distribution in metadata.distributions():
        name = re.sub(r"[-_.]+", "-", distribution.name or "").lower()  # as PEP 503 compares names
        if name != OURS and f"\n{OURS}/" in f"\n{distribution.read_text('RECORD') or ''}":
            others.append(f"{distribution.name} {distribution.version}")
    return sorted(others)


def conflict() -> str:
    """Sentence on other distributions that installed a package `etude` here; "" without any."""
    others = strangers()
    if not others:
        return ""
    names = ", ".join(others)
    return f"another distribution also installs a package etude ({names}), and its files overwrite ours"


def _guarded(arguments: list[str]) -> int:
    as_json = "--json" in arguments
    try:
        return _run(arguments)
    except SystemExit as exit:
        if (details := _plugin_error(exit)) is not None:
            return _report(as_json, "PluginError", *details, 2)
        return 2 if exit.code else 0  # tyro has printed the help
    except EtudeError as error:
        where = ", ".join(place for place in (error.where, _in_plugin(error)) if place)
        step = error.next_step or _usage_step(error, arguments)
        return _report(as_json, type(error).__name__, error.fact, where, step, error.exit_code)
    except KeyboardInterrupt:
        return _report(as_json, "Interrupted", KEPT, "", "", INTERRUPTED)
    except BrokenPipeError:
        # the reader closed our output (`etude status lab | head`)
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except Exception as error:
        return _report_unexpected(error, as_json)


def _report_unexpected(error: Exception, as_json: bool) -> int:
    """Reports an unexpected error of a plug-in, the machine or Étude. Returns the exit code."""
    if (details := _plugin_error(error)) is not None:
        return _report(as_json, "PluginError", *details, 2)
    if isinstance(error, OSError):  # the system's message helps more than a traceback
        where = "" if error.filename is None else str(error.filename)
        fact = f"the operating system refused: {error.strerror or error}"
        return _report(as_json, "MachineError", fact, where, MACHINE, 1)
    if isinstance(error, ImportError | AttributeError) and (clash := conflict()):
        return _report(as_json, "MachineError", f"{error}: {clash}", "", OWN_ENVIRONMENT, 1)
    traceback.print_exception(error)
    fact = f"this is a bug in etude: {type(error).__name__}: {error}"
    return _report(as_json, "Bug", fact, "", "No stored data was lost; please report it.", 1)


def _usage_step(error: EtudeError, arguments: Sequence[str]) -> str:
    """Next step after a wrong value of an option."""
    is_usage = isinstance(error, UsageError) and arguments
    return f"etude {arguments[0]} --help says what each option takes." if is_usage else ""


def _in_plugin(error: EtudeError) -> str:
    """The plug-in that called what raised the error; "" if none did, or it raised the error itself."""
    from etude.plugins import raised_in

    origin = raised_in(error)
    last = traceback.extract_tb(error.__traceback__)[-1]
    if origin is None or origin[1].startswith(f"{last.filename}:{last.lineno},"):
        return ""
    return f"in the plug-in {origin[0]}, {origin[1]}"


def _plugin_error(error: BaseException) -> tuple[str, str, str] | None:
    """Fact, place and next step of an error that arose in a plug-in's code; None if in ours."""
    from etude.plugins import raised_in

    origin = raised_in(error)
    if origin is None:
        return None
    name, line = origin
    step = "Repair the plug-in; the suites of etude.testing test it. No stored data was lost."
    message = " ".join(str(error).split())  # one sentence is one line
    return f"the plug-in {name} raised {type(error).__name__}: {message}", line, step


def _run(arguments: list[str]) -> int:
    _require_no_empty(arguments)
    if arguments == ["--version"]:
        print(f"etude {__version__}", flush=True)
        if clash := conflict():
            _tell(f"Warning: {clash}.\n{OWN_ENVIRONMENT}")
        return 0
    from etude.cli.outcome import TRUSTED, to_json
    from etude.cli.parse import command as command_of
    from etude.cli.terminal import fitted, progress_shown

    command = command_of(arguments)
    if command.trust and (files := command.trust_files()) is not None:
        _tell(TRUSTED.format(files))
    # a plug-in may print: what a machine reads from stdout is one line of JSON
    aside = command.json and not command.prints
    plain = contextlib.redirect_stdout(sys.stderr) if aside else contextlib.nullcontext()
    with plain, progress_shown(silent=command.json):
        outcome = command.run(_tell)
    line = fitted(outcome.text, sys.stdout)
    if command.json:
        line = to_json(outcome.data) if outcome.data else ""
    if line:
        print(line, flush=True)
    return outcome.exit_code


def _require_no_empty(arguments: Sequence[str]) -> None:
    """UsageError: an argument is empty, which would mean the working folder; options may be empty."""
    for before, argument in zip(["", *arguments], arguments, strict=False):
        if not argument and not before.startswith("--"):
            raise UsageError(
                "an argument is empty",
                next_step="Perhaps a shell variable is not set. Name the folder or file.",
            )


def _tell(text: str) -> None:
    from etude.cli.terminal import fitted

    print(fitted(text, sys.stderr), file=sys.stderr, flush=True)


def _report(as_json: bool, kind: str, fact: str, where: str, next_step: str, exit_code: int) -> int:
    _tell(_block(fact, where, next_step))
    if as_json:
        _print_error(kind, fact, where, next_step, exit_code)
    return exit_code


def _block(fact: str, where: str = "", next_step: str = "") -> str:
    first, _, remainder = fact.partition(" ")
    # files, code and keys keep their names
    named = bool(re.search(r"[/:._]", first)) or remainder.startswith("= ")
    lines = [f"etude: {fact if named else fact[:1].upper() + fact[1:]}"]
    lines += [f"  where: {where}"] if where else []
    lines += [f"  next:  {next_step}"] if next_step else []
    return "\n".join(lines)


def _print_error(kind: str, fact: str, where: str, next_step: str, exit_code: int) -> None:
    print(_error_line(kind, fact, where, next_step, exit_code), flush=True)


def _error_line(kind: str, fact: str, where: str, next_step: str, exit_code: int) -> str:
    from etude.cli.outcome import to_json

    error = {"kind": kind, "fact": fact, "where": where, "next_step": next_step, "exit_code": exit_code}
    return to_json({"error": error})
