"""Pages that are served: to this machine alone, by GET alone, renewed when something happened."""

from __future__ import annotations

import http.client
import json
import os
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from space_campaign import write_space
from synthetic_campaign import write_campaign

from chromium import chromium, complaints
from etude import cli
from etude.campaign import abandon, open_campaign
from etude.drivers import Sample
from etude.errors import UsageError
from etude.report import HOST, Pages, digest_of, server
from etude.report.build import live_report
from etude.report.live import MOST, PORT, POSES
from etude.report.run_view import RunView


@contextmanager
def running(pages: Pages) -> Iterator[int]:
    """Served on a free port while the block runs."""
    with server(pages, 0) as found:
        thread = threading.Thread(target=found.serve_forever, kwargs={"poll_interval": 0.01})
        thread.start()
        try:
            yield int(found.server_address[1])
        finally:
            found.shutdown()
            thread.join()


def asked(port: int, path: str, method: str = "GET", **headers: str) -> tuple[int, str]:
    connection = http.client.HTTPConnection(HOST, port, timeout=30)
    connection.putrequest(method, path, skip_host="Host" in headers)  # the path as it is, dots and all
    for name, value in headers.items():
        connection.putheader(name, value)
    connection.endheaders()
    answer = connection.getresponse()
    try:
        return answer.status, answer.read().decode()
    finally:
        connection.close()


def plain(words: dict[str, str]) -> Pages:
    return Pages(lambda: {"index.html": lambda: f"<body>{words['now']}</body>"}, lambda: words["now"])


def test_files_are_read_once_for_all_who_ask_and_again_when_something_happened() -> None:
    words, made = {"now": "one"}, []
    pages = plain(words)
    own = pages.made

    def counting() -> Any:
        made.append(1)
        return own()

    pages.made = counting
    with running(pages) as port:
        assert [asked(port, "/")[1][:9], asked(port, "/index.html?x=1")[1][:9]] == ["<body>one"] * 2
        assert len(made) == 1
        words["now"] = "two"
        assert asked(port, "/digest") == (200, "two")
        assert asked(port, "/")[1].startswith("<body>two<script>")
        assert len(made) == 2


@pytest.mark.parametrize(
    "path",
    ["/../../etc/passwd", "/..%2f..%2fetc/passwd", "//etc/passwd", "/journal.jsonl", "/%00", "/\\..\\x"],
)
def test_nothing_but_the_pages_is_found(path: str) -> None:
    with running(plain({"now": "one"})) as port:
        assert asked(port, path)[0] == 404


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "PATCH"])
def test_nothing_can_be_written(method: str) -> None:
    with running(plain({"now": "one"})) as port:
        assert asked(port, "/", method)[0] == 501
        assert asked(port, "/", "HEAD") == (200, "")


def test_only_this_machine_is_answered() -> None:
    with running(plain({"now": "one"})) as port:
        assert asked(port, "/", Host="elsewhere.example")[0] == 403
        assert asked(port, "/digest", Host=f"elsewhere.example:{port}")[0] == 403
        assert asked(port, "/", Host=f"localhost:{port}")[0] == 200
        others = {own[4][0] for own in socket.getaddrinfo(socket.gethostname(), None, socket.AF_INET)}
        for address in others - {HOST}:
            if not address.startswith("127."):
                with pytest.raises(OSError):  # noqa: PT011 - refused, or no way there
                    socket.create_connection((address, port), timeout=5)


MALFORMED = {
    "no Host": b"GET / HTTP/1.1\r\n\r\n",
    "two Hosts": b"GET / HTTP/1.1\r\nHost: 127.0.0.1:PORT\r\nHost: 127.0.0.1:PORT\r\n\r\n",
    "no path": b"GET http://[ HTTP/1.1\r\nHost: 127.0.0.1:PORT\r\n\r\n",
    "a path of a host": b"GET evil HTTP/1.1\r\nHost: 127.0.0.1:PORT\r\n\r\n",
    "no version": b"GET / HTTP/x\r\nHost: 127.0.0.1:PORT\r\n\r\n",
    "noise": bytes(range(128, 255)) + b"\r\n\r\n",
    "zeros": b"\0 \0 \0\r\n\r\n",
}


def sent(port: int, data: bytes) -> bytes:
    with socket.create_connection((HOST, port), timeout=30) as one:
        one.sendall(data.replace(b"PORT", str(port).encode()))
        return b"".join(iter(lambda: one.recv(4096), b""))


@pytest.mark.parametrize("what", MALFORMED)
def test_a_malformed_request_is_answered_with_400(what: str, capfd: pytest.CaptureFixture[str]) -> None:
    with running(plain({"now": "one"})) as port:
        found = sent(port, MALFORMED[what])
        assert b" 400 " in found.splitlines()[0] or b"Error code: 400" in found
        assert asked(port, "/")[0] == 200
    assert "Traceback" not in capfd.readouterr().err


def test_who_says_nothing_holds_no_place_for_long(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("etude.report.live._Handler.timeout", 0.2)
    with running(plain({"now": "one"})) as port:
        assert sent(port, b"GET / HTTP/1.1\r\n") == b""  # the server ends it


def test_who_speaks_slowly_is_ended(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("etude.report.live.LONGEST_S", 0.3)
    with running(plain({"now": "one"})) as port, socket.create_connection((HOST, port), timeout=30) as one:
        one.sendall(b"GET / HTTP/1.1\r\nHost: ")
        assert one.recv(10) == b""


def test_so_many_are_answered_at_once_and_then_again() -> None:
    with running(plain({"now": "one"})) as port:
        held = [socket.create_connection((HOST, port), timeout=30) for _ in range(MOST)]
        try:
            for one in held:
                one.sendall(b"GET / HTTP/1.1\r\n")
            assert b" 503 " in sent(port, b"")
        finally:
            for one in held:
                one.close()
        for _ in range(200):
            with suppress(OSError, http.client.HTTPException):
                if asked(port, "/")[0] == 200:
                    return
    raise AssertionError("no place was given back")


def test_a_port_in_use_is_said_with_one_that_is_free(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_campaign(tmp_path)
    with socket.create_server((HOST, 0)) as other:
        port = str(other.getsockname()[1])
        assert cli.main(["report", str(tmp_path), "--serve", "--port", port]) == 2
        said = capsys.readouterr().err
        assert f"Port {port} is in use" in said
        free = int(said.partition("Free now: --port ")[2].partition(";")[0])
        with server(plain({"now": "one"}), free) as found:
            assert found.server_address[1] == free
    with pytest.raises(UsageError, match="cannot be opened"):
        server(plain({"now": "one"}), 70_000)
    assert cli.main(["report", str(tmp_path), "--serve", "--json"]) == 2
    assert json.loads(capsys.readouterr().out)["error"]["where"] == "--json"


def test_without_a_port_the_next_free_one_is_taken() -> None:
    pages = plain({"now": "one"})
    with server(pages, None) as first, server(pages, None) as second:
        ports = [first.server_address[1], second.server_address[1]]
        assert PORT <= ports[0] < ports[1]


def test_the_digest_sees_files_and_folders(tmp_path: Path) -> None:
    seen = [digest_of([tmp_path / "a", tmp_path / "b"])]
    (tmp_path / "a").write_text("1")
    seen.append(digest_of([tmp_path / "a", tmp_path / "b"]))
    (tmp_path / "b").mkdir()
    (tmp_path / "b" / "c").write_text("1")
    seen.append(digest_of([tmp_path / "a", tmp_path / "b"]))
    (tmp_path / "b" / "c").write_text("12")
    seen.append(digest_of([tmp_path / "a", tmp_path / "b"]))
    assert len(set(seen)) == 4
    assert seen[-1] == digest_of([tmp_path / "a", tmp_path / "b"])


def test_an_edited_journal_is_said_on_the_page(tmp_path: Path) -> None:
    write_campaign(tmp_path)
    pages = live_report(tmp_path)
    with running(pages) as port:
        path = tmp_path / "journal.jsonl"
        path.write_text(path.read_text().replace('"asked"', '"asket"', 1))
        status, words = asked(port, "/")
        assert status == 503
        assert "journal" in words


def test_ctrl_c_ends_it_with_130_and_no_traceback(tmp_path: Path) -> None:
    write_campaign(tmp_path)
    before = sorted(path.name for path in tmp_path.iterdir())
    command = [sys.executable, "-m", "etude", "report", str(tmp_path), "--serve"]
    with subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as started:
        assert started.stderr is not None
        line = started.stderr.readline()
        port = int(line.partition(f"http://{HOST}:")[2].partition("/")[0])
        assert "Étude report" in asked(port, "/")[1]
        os.kill(started.pid, signal.SIGINT)
        out, err = started.communicate(timeout=60)
    assert started.returncode == 130
    assert (out, "Traceback" in err) == ("", False)
    assert sorted(path.name for path in tmp_path.iterdir()) == before, "nothing is written"


@pytest.mark.slow
@pytest.mark.browser
def test_a_new_event_renews_the_page_by_itself(tmp_path: Path) -> None:
    write_campaign(tmp_path)
    with chromium() as browser, running(live_report(tmp_path)) as port:
        browser.execute_cdp_cmd("Network.enable", {})
        browser.get(f"http://{HOST}:{port}/")
        assert "Étude report" in browser.title
        browser.execute_script("window.before = true;")
        from selenium.webdriver.support.ui import WebDriverWait

        def renewed(wanted: bool) -> Any:
            return lambda b: b.execute_script("return !window.before") is wanted

        waiting = "return document.body.textContent.includes('abandoned')"
        assert not browser.execute_script(waiting)
        abandon(open_campaign(tmp_path), 6)
        WebDriverWait(browser, 60).until(renewed(True))
        assert browser.execute_script(waiting)
        assert complaints(browser) == []
        loaded = browser.execute_script("return performance.getEntriesByType('resource').map((e) => e.name)")
        assert {own.split("/")[2] for own in loaded if own.startswith("http")} <= {f"{HOST}:{port}"}


def events(port: int, count: int) -> list[str]:
    """The first messages of the stream of poses."""
    connection = http.client.HTTPConnection(HOST, port, timeout=30)
    connection.request("GET", POSES)
    answer = connection.getresponse()
    assert answer.getheader("Content-Type", "").startswith("text/event-stream")
    found: list[str] = []
    while len(found) < count and (line := answer.readline().decode()):
        found += [line.removeprefix("data: ").strip()] if line.startswith("data: ") else []
    connection.close()
    return found


def test_each_new_pose_is_sent_once_and_to_this_machine_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    words = iter(["a", "a", "b", "b", "c"] + 10_000 * ["c"])
    pages = plain({"now": "one"})
    with running(pages) as port:
        assert asked(port, POSES)[0] == 404
    pages.pose = lambda: next(words)
    monkeypatch.setattr("etude.report.live.POSES_HZ", 200.0)
    with running(pages) as port:
        assert asked(port, POSES, Host="elsewhere.example")[0] == 403
        assert events(port, 3) == ["a", "b", "c"]
        monkeypatch.setattr("etude.report.live.LONGEST_S", 0.3)
        assert events(port, 1_000) == ["c"], "a stream ends like any request; a browser asks again"
        assert asked(port, "/")[0] == 200


@pytest.mark.browser
def test_the_robot_is_drawn_where_it_is_asked_to_be_and_where_it_is(tmp_path: Path) -> None:
    from selenium.webdriver.support.ui import WebDriverWait

    write_space(tmp_path)
    campaign = open_campaign(tmp_path)
    planned = SimpleNamespace(joints=campaign.axes[::-1], part="motion", speed=100, number=1)
    with chromium() as browser, RunView(tmp_path) as view:
        browser.get(view.address)
        assert "The next motion is being planned" in browser.page_source
        view.show(1)
        WebDriverWait(browser, 30).until(lambda b: "trajectory 1" in b.title)
        now = (
            "const s = document.querySelector('.space').scene; if (!s) return null;"
            "const text = (c) => document.querySelector(c).textContent;"
            "return [s.time(), s.real()?.q, s.frames().slice(12, 24), text('.piece'), text('.time')]"
        )

        def shown(part: str, at: float, asked: list[float], q: list[float]) -> Any:
            sample = Sample(9.0, np.array(q[::-1]), asked=np.array(asked[::-1]), at=at)
            planned.part = part

            def there(page: Any) -> Any:
                view.put(campaign, planned, sample)  # type: ignore[arg-type]
                found = page.execute_script(now)
                return found if found and found[1] == q and part in found[3] else None

            return WebDriverWait(browser, 30, poll_frequency=0.05).until(there)

        own, plain = [0.2, 0.4, 1.0], [0.1, 0.5, 1.1]
        time, _, turned, piece, words = shown("motion", 2.5, own, plain)
        assert (time, piece, words) == (2.5, "motion 1 at 100 %", "2.50 s")
        assert turned[:2] == pytest.approx([np.cos(0.2), -np.sin(0.2)], abs=1e-6), "solid: where it is asked"
        nearest = "return document.querySelector('.nearest').textContent"
        assert "shown along" not in browser.execute_script(nearest)
        _, _, turned, piece, words = shown("approach", 1.0, [0.3, 0.4, 1.0], own)
        assert (piece, words) == ("approach 1 at 100 %", ""), "it is not on the motion that is drawn"
        assert turned[:2] == pytest.approx([np.cos(0.3), -np.sin(0.3)], abs=1e-6)
        assert browser.execute_script(nearest).startswith("shown along")
        assert complaints(browser) == []


def test_a_page_that_is_busy_or_gone_delays_no_set_point(tmp_path: Path) -> None:
    write_space(tmp_path)
    campaign = open_campaign(tmp_path)
    planned = SimpleNamespace(joints=campaign.axes, part="motion", speed=100, number=1)

    def put() -> None:
        view._last_sent = 0.0
        view.put(campaign, planned, Sample(0.0, np.zeros(3), at=1.0))  # type: ignore[arg-type]

    with RunView(tmp_path) as view:
        process = view._process
        assert process is not None
        process.send_signal(signal.SIGSTOP)  # it takes nothing
        for _ in range(2_000):
            put()
        process.kill()
        process.wait()
        put()
