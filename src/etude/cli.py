"""The entrance: reads the command line, runs one command, prints its outcome or its error."""

from __future__ import annotations

import gc
import os
import sys
import traceback
from collections.abc import Sequence

from etude import __version__
from etude.distribution import NEXT_STEP, conflict
from etude.errors import EtudeError
from etude.interrupt import INTERRUPTED, end_on_interrupt, ignore_from_now

MACHINE = "Nothing committed was lost; check the permissions and the disk, and run the command again."
KEPT = "Interrupted. Everything that was committed is kept; run the same command again to go on."

SELDOM = 50_000
"""More objects than before, at which Python looks for circles among them. A program that loads modules makes
many that stay, and was looked through two hundred times; matrices are not in circles."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs one command; returns its exit code.

    0 ok, 1 a bug or a failing machine, 2 wrong usage, 3 unusable data, 4 unsafe or infeasible trajectory
    (no file is written), 5 stop rule reached, 6 the robot has changed, 130 interrupted. As a program (without
    `arguments`) Ctrl-C ends the process itself; who calls with arguments gets the KeyboardInterrupt turned
    into 130.
    """
    if arguments is not None:
        return _guarded(list(arguments))
    gc.set_threshold(SELDOM)
    given = sys.argv[1:]
    line = _error_line("Interrupted", KEPT, "", "", INTERRUPTED) if "--json" in given else ""
    end_on_interrupt(_block(KEPT), line)
    code = _guarded(given)
    ignore_from_now()
    gc.freeze()  # Python looks for circles once more at the end, among all that was loaded; nobody needs that
    return code


def _guarded(given: list[str]) -> int:
    as_json = "--json" in given
    try:
        return _run(given)
    except SystemExit as exit:  # tyro has printed the help (0) or what is wrong with the arguments (2)
        if exit.code and as_json:
            _print_error("UsageError", "wrong arguments", "", "See etude --help.", 2)
        return 2 if exit.code else 0
    except EtudeError as error:
        return _report(
            as_json, type(error).__name__, error.fact, error.where, error.next_step, error.exit_code
        )
    except KeyboardInterrupt:
        return _report(as_json, "Interrupted", KEPT, "", "", INTERRUPTED)
    except BrokenPipeError:
        # the reader of our output went away (`etude status lab | head`); there is nobody left to tell
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except OSError as error:  # a file or folder nobody foresaw: the machine's failing, whose words help more
        where = "" if error.filename is None else str(error.filename)
        fact = f"the machine refused: {error.strerror or error}"
        return _report(as_json, "MachineError", fact, where, MACHINE, 1)
    except Exception as error:
        if isinstance(error, ImportError | AttributeError) and (told := conflict()):
            return _report(as_json, "MachineError", f"{error}: {told}", "", NEXT_STEP, 1)
        traceback.print_exc()
        fact = f"this is a bug in etude: {type(error).__name__}: {error}"
        return _report(as_json, "Bug", fact, "", "Nothing committed was lost; please report it.", 1)


def _run(given: list[str]) -> int:
    if given == ["--version"]:
        print(f"etude {__version__}", flush=True)
        if told := conflict():
            _say(f"Warning: {told}.\n{NEXT_STEP}")
        return 0
    from etude.commands import parse
    from etude.commands.outcome import to_json
    from etude.commands.progress_bar import progress_shown
    from etude.commands.terminal import fitted

    command = parse.command(given)
    if getattr(command, "trust", False):
        _trust(command)
    with progress_shown(silent=command.json):
        outcome = command.run(_say)
    line = fitted(outcome.text, sys.stdout)
    if command.json:
        line = to_json(outcome.data) if outcome.data else ""
    if line:
        print(line, flush=True)
    return outcome.exit_code


def _trust(command: object) -> None:
    """Puts the command's folder on this user's list."""
    from etude.errors import UsageError

    folder = getattr(command, "folder", None)
    if folder is None:
        raise UsageError(
            "--trust is of commands that have a campaign's folder", next_step="etude status FOLDER --trust."
        )
    from etude.campaign.record.config_file import trust_campaign

    trust_campaign(folder)
    _say(f"Trusted from now on, by you: code that the files in {folder} name.")


def _say(text: str) -> None:
    from etude.commands.terminal import fitted

    print(fitted(text, sys.stderr), file=sys.stderr, flush=True)


def _report(as_json: bool, kind: str, fact: str, where: str, next_step: str, exit_code: int) -> int:
    _say(_block(fact, where, next_step))
    if as_json:
        _print_error(kind, fact, where, next_step, exit_code)
    return exit_code


def _block(fact: str, where: str = "", next_step: str = "") -> str:
    named = "/" in fact.partition(" ")[0]  # a file keeps its name
    lines = [f"etude: {fact if named else fact[:1].upper() + fact[1:]}"]
    lines += [f"  where: {where}"] if where else []
    lines += [f"  next:  {next_step}"] if next_step else []
    return "\n".join(lines)


def _print_error(kind: str, fact: str, where: str, next_step: str, exit_code: int) -> None:
    print(_error_line(kind, fact, where, next_step, exit_code), flush=True)


def _error_line(kind: str, fact: str, where: str, next_step: str, exit_code: int) -> str:
    from etude.commands.outcome import to_json

    error = {"kind": kind, "fact": fact, "where": where, "next_step": next_step, "exit_code": exit_code}
    return to_json({"error": error})


if __name__ == "__main__":
    sys.exit(main())
