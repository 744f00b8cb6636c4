"""The terminal: 80 columns, helps without Python types, colour and progress where they belong."""

from __future__ import annotations

import fcntl
import json
import os
import pty
import re
import shutil
import struct
import subprocess
import sys
import termios
from dataclasses import fields
from pathlib import Path
from typing import Any, get_args, get_type_hints

import pytest

import etude
from etude import cli
from etude.cli import doctor, entrance, parse
from etude.cli import terminal as progress_bar
from etude.cli.outcome import table
from etude.cli.parse import COMMANDS, class_of
from etude.cli.terminal import coloured, fitted, width
from etude.progress import counted, part, watched

ESCAPE = re.compile(r"\x1b\[[0-9;?]*[a-zA-Z]")
NAMES = sorted(COMMANDS)
NOISE = re.compile(r"\{None\}|\bSTR\b|\bINT\b|\bFLOAT\b|\[\w+ \[|\(default: (None|False|''|)\)|,\}")


@pytest.fixture(autouse=True)
def eighty(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")


def widest(text: str) -> int:
    return max(len(line) for line in ESCAPE.sub("", text).splitlines())


@pytest.mark.parametrize("name", ["", *NAMES])
def test_helps_fit_and_speak_of_no_types(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main([*name.split(), "--help"]) == 0
    text = capsys.readouterr().out
    assert widest(text) <= 80
    assert not NOISE.search(text), NOISE.search(text)
    assert text.startswith(f"usage: etude {name}".rstrip())


def test_every_option_of_every_command_is_explained() -> None:
    for own in map(class_of, COMMANDS):
        silent = {f.name for f in fields(own)} - set(parse._field_texts(own))
        hints = get_type_hints(own, include_extras=True)
        assert [n for n in silent if not any(getattr(a, "help", None) for a in get_args(hints[n])[1:])] == []


def test_the_usual_outputs_fit(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Sentences of a pipe stay whole, for whoever searches them; everything in columns fits."""
    lab = str(tmp_path / "lab")
    start = ["init", lab, "--robot", "arm4", "--preset", "thesis"]
    for words in (start, ["ask", lab], ["status", lab], ["doctor"]):
        assert cli.main(words) == 0
        text = capsys.readouterr().out
        columns = [line for line in text.splitlines() if "  " in line.strip() and str(tmp_path) not in line]
        if words[0] in ("ask", "status"):
            assert widest("\n".join(columns)) <= 80
        assert widest(_on_terminal(text)) <= 80


def _on_terminal(text: str) -> str:
    """As a terminal shows it; what cannot be broken, such as a path, is left out."""
    shown = fitted(text, Terminal()).splitlines()  # type: ignore[arg-type]
    return "\n".join(line for line in shown if max((len(w) for w in line.split()), default=0) < 60)


class Terminal:
    """A stream that is one."""

    def isatty(self) -> bool:
        return True


def test_a_wide_table_is_continued_below() -> None:
    rows = [[f"row{i}", *(f"{i}.{j}" for j in range(12))] for i in range(2)]
    text = table(["what", *(f"a_long_heading_{j}" for j in range(12))], rows)
    assert widest(text) <= 80
    assert all(f"{i}.{j}" in text.split() for i in range(2) for j in range(12))
    assert text.count("row1") == 3
    keyed = table(["a", "b", *("x" * 30 for _ in range(3))], [["k", "l", "1", "2", "3"]], keys=2)
    assert keyed.count("k  l") == 2
    assert table(["a", "b"], [["c", "d"]]) == "a  b\nc  d"
    assert table(["one"], []) == "one"


def test_colour_is_for_terminals_whose_owner_wants_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("NO_COLOR", raising=False)
    monkeypatch.setenv("TERM", "xterm")
    terminal: Any = Terminal()
    assert coloured(terminal)
    assert "\x1b[1;31metude: \x1b[0mno" in fitted("etude: no", terminal)
    assert fitted("etude: no", sys.stdout) == "etude: no"
    monkeypatch.setenv("NO_COLOR", "1")
    assert fitted("etude: no", terminal) == "etude: no"
    monkeypatch.delenv("NO_COLOR")
    monkeypatch.setenv("TERM", "dumb")
    assert not coloured(terminal)


def test_long_sentences_hang_below_their_beginning(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NO_COLOR", "1")
    terminal: Any = Terminal()
    lines = fitted("  - " + "word " * 40, terminal).splitlines()
    assert len(lines) == 3
    assert all(line.startswith("    w") for line in lines[1:])
    path = "/" + "x" * 100
    assert path in fitted(f"  where: {path}", terminal)
    monkeypatch.setenv("COLUMNS", "10")
    assert width() == 40


def _in_terminal(words: list[str], **environment: str) -> tuple[str, int]:
    """What a terminal of 80 columns sees of `etude words`, and its exit code."""
    child, terminal = pty.fork()
    if child == 0:
        os.environ.update({"TERM": "xterm", **environment})
        os.execv(sys.executable, [sys.executable, "-m", "etude", *words])
    fcntl.ioctl(terminal, termios.TIOCSWINSZ, struct.pack("HHHH", 24, 80, 0, 0))
    seen = b""
    while True:
        try:
            more = os.read(terminal, 65536)
        except OSError:  # Linux says so at the end
            break
        if not more:
            break
        seen += more
    os.close(terminal)
    return seen.decode(), os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


def test_in_a_real_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("COLUMNS")
    monkeypatch.delenv("NO_COLOR", raising=False)
    said, code = _in_terminal(["status", "nowhere"])
    assert code == 2
    assert "\x1b[1;31metude: \x1b[0m" in said
    assert "\x1b[" not in _in_terminal(["doctor", "--help"], NO_COLOR="1")[0]


# progress


def test_parts_and_counts_add_up_and_never_go_back() -> None:
    told: list[float] = []
    with watched(told.append):
        with part(0.25):
            for _ in counted(range(4)):
                list(counted("ab"))
        for i in counted([1.0, 3.0], cost=lambda own: own, whole=0.75):
            if i == 3.0:
                break
    assert told == sorted(told)
    assert told[-1] == pytest.approx(1.0)
    assert any(abs(own - 0.25) < 1e-12 for own in told)
    assert any(abs(own - (0.25 + 0.75 / 4)) < 1e-12 for own in told)
    assert list(counted(range(3))) == [0, 1, 2], "without anybody who watches"


def test_a_part_that_fails_leaves_the_rest_right() -> None:
    told: list[float] = []
    with watched(told.append):
        with pytest.raises(ValueError, match="no"):
            _fails_in(0.5)
        assert told[-1] == pytest.approx(0.5)


def _fails_in(share: float) -> None:
    with part(share):
        for _ in counted(range(2)):
            raise ValueError("no")


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    now = [0.0]
    monkeypatch.setattr(progress_bar, "monotonic", lambda: now[0])
    return now


def _work(clock: list[float], seconds: float) -> None:
    for _ in counted(range(10)):
        clock[0] += seconds / 10


def test_one_plain_line_where_there_is_no_terminal(
    clock: list[float], capsys: pytest.CaptureFixture[str]
) -> None:
    with progress_bar.progress_shown(silent=False):
        _work(clock, 20.0)
    assert capsys.readouterr().err == "10 % done, about 18 s left.\n"
    with progress_bar.progress_shown(silent=False):  # what comes later takes longer than what is done
        for done in counted(range(10)):
            clock[0] += 2.0 if done < 2 else 60.0
    said = capsys.readouterr().err.splitlines()
    assert said[0] == "10 % done, about 18 s left."
    assert 2 < len(said) < 6
    with progress_bar.progress_shown(silent=False):
        _work(clock, 1.9)
    with progress_bar.progress_shown(silent=True):
        _work(clock, 20.0)
    assert capsys.readouterr() == ("", "")


def test_a_bar_with_the_time_left_on_a_terminal(clock: list[float], monkeypatch: pytest.MonkeyPatch) -> None:
    from io import StringIO

    class Screen(StringIO):
        def isatty(self) -> bool:
            return True

    screen = Screen()
    monkeypatch.setattr(sys, "stderr", screen)
    monkeypatch.setenv("TERM", "xterm")
    with progress_bar.progress_shown(silent=False):
        _work(clock, 400.0)
    said = ESCAPE.sub("", screen.getvalue())
    assert "about 6 min left" in said
    assert "about 40 s left" in said
    assert screen.getvalue().endswith("\x1b[2K"), "the line is cleared at the end"


def test_ctrl_c_clears_the_bar_and_shows_the_cursor_again() -> None:
    master, screen = pty.openpty()
    entrance._say(screen, "Interrupted.", "")
    seen = os.read(master, 1000)
    while b"." not in seen:  # a terminal gives what is there, not all that was written
        seen += os.read(master, 1000)
    assert seen.startswith(b"\r\x1b[K\x1b[?25hInterrupted.")
    os.close(master)
    os.close(screen)


@pytest.mark.parametrize(
    ("done", "elapsed", "words"),
    [
        (0.5, 10.0, "about 10 s"),
        (0.1, 60.0, "about 9 min"),
        (0.01, 180.0, "about 5.0 h"),
        (0.99, 2.0, "about 1 s"),
    ],
)
def test_the_time_left_in_words(done: float, elapsed: float, words: str) -> None:
    assert progress_bar.time_left(done, elapsed) == words


def test_json_says_nothing_of_progress(
    tmp_path: Path, clock: list[float], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    real = doctor.examined
    monkeypatch.setattr(doctor, "examined", lambda: [_work(clock, 20.0), *real()][1:])
    assert cli.main(["doctor", "--json"]) == 0
    assert capsys.readouterr().err == ""
    assert cli.main(["doctor"]) == 0
    assert capsys.readouterr().err == "10 % done, about 18 s left.\n"


def test_a_design_says_how_far_it_is(tmp_path: Path) -> None:
    campaign, _ = etude.create_campaign(tmp_path / "lab", "arm4")
    told: list[float] = []
    with watched(told.append):
        etude.ask(campaign)
    assert told == sorted(told)
    assert len({round(own, 3) for own in told}) > 20
    assert told[-1] == pytest.approx(1.0)


# completion


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_a_shell_completes(shell: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "etude"
    assert cli.main(["--tyro-write-completion", shell, str(file)]) == 0
    assert capsys.readouterr().out == ""
    if shutil.which(shell) is None:
        pytest.skip(f"there is no {shell} here")
    script = {
        "bash": f"source {file}; COMP_WORDS=(etude re); COMP_CWORD=1; "
        "$(complete -p etude | sed 's/.*-F \\([^ ]*\\).*/\\1/'); echo ${COMPREPLY[@]}",
        "zsh": f"zsh -n {file} && echo report",
        "fish": f"source {file}; complete -C 'etude re'",
    }[shell]
    done = subprocess.run([shell, "-c", script], capture_output=True, text=True, check=True)
    assert "report" in done.stdout.split()


# doctor


def test_the_doctor_says_what_is_missing_and_the_line_that_installs_it(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    stated = {"Provides-Extra": ["ros", "test"], "Requires-Dist": ["numpy>=1", 'rosbags>=1; extra == "ros"']}
    monkeypatch.setattr(doctor, "_metadata_lines", lambda what: stated[what])
    monkeypatch.setattr(doctor, "_is_installed", lambda library: library != "rosbags")
    monkeypatch.setattr(doctor.shutil, "which", lambda name: None)
    monkeypatch.setattr(sys, "platform", "linux")
    assert cli.main(["doctor", "--json"]) == 0
    checks = {own["name"]: own for own in json.loads(capsys.readouterr().out)["checks"]}
    assert {"etude", "numpy", "BLAS", "cores", "gcc", "clang", "cmake", "browser", "numba cache"} <= set(
        checks
    )
    assert checks["gcc"]["light"] == checks["browser"]["light"] == "yellow"
    assert "extra test" not in checks
    ros = checks["extra ros"]
    assert (ros["light"], ros["sentence"]) == ("yellow", "rosbags missing: pip install 'rosbags>=1'")
    assert "thread" in checks["BLAS"]["sentence"]


def test_a_library_that_is_needed_and_missing_is_red(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    libraries, missing = doctor._libraries, ["no_such_library"]
    monkeypatch.setattr(doctor, "_libraries", lambda extra: [*libraries(extra), *(missing * (not extra))])
    assert cli.main(["doctor"]) == 1
    assert "WRONG  no_such_library" in capsys.readouterr().out


def test_a_folder_that_cannot_be_written_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(doctor.tempfile, "TemporaryFile", _refuse)
    here, cache = doctor.places()
    assert (here.light, cache.light) == ("yellow", "yellow")
    assert "NUMBA_CACHE_DIR" in cache.sentence
    assert list(tmp_path.iterdir()) == []


def _refuse(**_: object) -> None:
    raise PermissionError
