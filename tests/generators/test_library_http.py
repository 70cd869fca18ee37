"""Downloads from a faulty server: each failure gives one line that names the asset and says what to do."""

from __future__ import annotations

import email.utils
import hashlib
import io
import multiprocessing
import os
import signal
import socket
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
import requests
import urllib3

from avs3d_bench.errors import Avs3dError
from generators.library.download import download
from generators.library.http import (
    CutError,
    FetchLimits,
    HttpError,
    Request,
    check_url,
    get_json,
    retry_after,
)
from tests.support.library_server import TOKEN, Reply, Server, json_reply, serving

DATA = bytes(range(256)) * 400
SHA = hashlib.sha256(DATA).hexdigest()
FAST = FetchLimits(timeout=0.4, total=5.0, backoff=0.01, attempts=3, max_wait=1.5)
ETAG = {"ETag": '"v1"'}


@pytest.fixture(scope="module")
def server() -> Iterator[Server]:
    with serving() as server:
        yield server


@pytest.fixture(autouse=True)
def _fresh(server: Server) -> None:
    server.routes.clear()
    server.calls.clear()


def request(server: Server, path: str = "/file", **changes: object) -> Request:
    return Request(server.url + path, "asset/one", "The Service", **changes)  # type: ignore[arg-type]


def leftovers(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.rglob("*") if path.is_file())


def one_line(error: BaseException) -> str:
    text = str(error)
    assert "\n" not in text
    assert text.startswith("asset/one: ")
    assert TOKEN not in text
    return text


def test_a_whole_file_takes_its_name_and_nothing_else_is_left(server: Server, tmp_path: Path) -> None:
    server.on("/file", Reply(DATA))
    found = download(request(server), tmp_path / "a" / "x.bin", FAST, sha256=SHA, size=len(DATA))
    assert (found.sha256, found.bytes) == (SHA, len(DATA))
    assert (tmp_path / "a" / "x.bin").read_bytes() == DATA
    assert leftovers(tmp_path) == ["x.bin"]


def test_a_cut_connection_is_resumed_where_it_was_cut(server: Server, tmp_path: Path) -> None:
    server.on("/file", Reply(DATA, headers=ETAG, cut=30_000, ranges=True), Reply(DATA, headers=ETAG, ranges=True))
    said: list[str] = []
    found = download(request(server), tmp_path / "x.bin", FAST, say=said.append)
    assert found.sha256 == SHA
    assert [call.headers.get("range") for call in server.calls] == [None, "bytes=30000-"]
    assert server.calls[1].headers["if-range"] == '"v1"'
    assert said == ["asset/one: interrupted, attempt 2 of 3 in 0 s"]
    assert leftovers(tmp_path) == ["x.bin"]


def test_a_later_run_goes_on_with_what_the_first_one_got(server: Server, tmp_path: Path) -> None:
    server.on("/file", Reply(DATA, headers=ETAG, cut=30_000, ranges=True), Reply(b"", 404))
    with pytest.raises(HttpError) as caught:
        download(request(server), tmp_path / "x.bin", FAST)
    assert "answered 404" in one_line(caught.value)
    assert leftovers(tmp_path) == ["x.bin.part", "x.bin.part.json"]
    server.calls.clear()
    server.on("/file", Reply(DATA, headers=ETAG, ranges=True))
    assert download(request(server), tmp_path / "x.bin", FAST).sha256 == SHA
    assert [call.headers.get("range") for call in server.calls] == ["bytes=30000-"]
    assert leftovers(tmp_path) == ["x.bin"]


@pytest.mark.parametrize(
    ("what", "second"),
    [
        ("ignores Range", Reply(DATA, headers=ETAG)),
        ("has another version by now", Reply(DATA, headers={"ETag": '"v2"'}, ranges=True)),
    ],
)
def test_a_server_that_cannot_resume_sends_it_all_again(
    server: Server, tmp_path: Path, what: str, second: Reply
) -> None:
    server.on("/file", Reply(DATA[::-1], headers=ETAG, cut=30_000), second)
    assert download(request(server), tmp_path / "x.bin", FAST).sha256 == SHA, what


def test_a_range_that_starts_elsewhere_is_not_trusted(server: Server, tmp_path: Path) -> None:
    rest = len(DATA) - 30_000
    wrong = Reply(DATA[10 : 10 + rest], 206, {**ETAG, "Content-Range": f"bytes 10-{9 + rest}/{len(DATA)}"})
    server.on("/file", Reply(DATA, headers=ETAG, cut=30_000), wrong, Reply(DATA, headers=ETAG))
    assert download(request(server), tmp_path / "x.bin", FAST).sha256 == SHA


def test_without_a_strong_validator_a_cut_file_is_begun_again(server: Server, tmp_path: Path) -> None:
    weak = {"ETag": 'W/"v1"'}
    server.on("/file", Reply(DATA[::-1], headers=weak, cut=30_000), Reply(DATA, headers=weak))
    assert download(request(server), tmp_path / "x.bin", FAST).sha256 == SHA
    assert [call.headers.get("range") for call in server.calls] == [None, None]


def test_a_connection_that_is_always_cut_ends_in_one_line(server: Server, tmp_path: Path) -> None:
    server.on("/file", Reply(DATA, cut=30_000))
    with pytest.raises(CutError) as caught:
        download(request(server), tmp_path / "x.bin", FAST)
    assert "cut after 30000 of 102400 bytes" in one_line(caught.value)
    assert "run the same command again" in str(caught.value)
    assert len(server.calls) == FAST.attempts
    assert leftovers(tmp_path) == []  # there is no validator to go on with


@pytest.mark.parametrize("date", [False, True], ids=["seconds", "date"])
def test_retry_after_is_honoured(server: Server, tmp_path: Path, date: bool) -> None:
    value = email.utils.formatdate(time.time() + 2, usegmt=True) if date else "1"
    server.on("/file", Reply(b"", 429, {"Retry-After": value}), Reply(DATA))
    said: list[str] = []
    limits = FetchLimits(timeout=1, total=10, backoff=60, max_wait=3)  # an own pause would take a minute
    started = time.monotonic()
    download(request(server), tmp_path / "x.bin", limits, say=said.append)
    assert 0.9 <= time.monotonic() - started < 30
    assert len(said) == 1
    assert said[0].startswith("asset/one: HTTP 429, attempt 2 of 5 in ")


def test_a_pause_beyond_the_limit_is_not_waited_for(server: Server, tmp_path: Path) -> None:
    server.on("/file", Reply(b"", 429, {"Retry-After": "86400"}))
    started = time.monotonic()
    with pytest.raises(HttpError) as caught:
        download(request(server), tmp_path / "x.bin", FAST)
    assert time.monotonic() - started < 30
    assert "asks to wait 86400 s (the limit is 1.5 s); run again after" in one_line(caught.value)
    assert leftovers(tmp_path) == []


def test_retry_after_in_both_forms_and_in_none(monkeypatch: pytest.MonkeyPatch) -> None:
    now = 1_700_000_000.0
    monkeypatch.setattr(time, "time", lambda: now)
    assert retry_after("17") == 17
    assert retry_after(email.utils.formatdate(now + 90, usegmt=True)) == 90
    assert retry_after(email.utils.formatdate(now - 90, usegmt=True)) == 0
    assert [retry_after(value) for value in (None, "soon", "-3", "1e9", "")] == [None] * 5


@pytest.mark.parametrize(
    ("status", "words"),
    [(401, "get a new key"), (403, "access is not allowed"), (404, "not found"), (410, "no longer available")],
)
def test_a_refusal_is_final_and_carries_the_advice(server: Server, tmp_path: Path, status: int, words: str) -> None:
    server.on("/file", Reply(b"<html>long page</html>", status))
    with pytest.raises(HttpError) as caught:
        download(request(server, token=TOKEN, advice={401: "get a new key"}), tmp_path / "x.bin", FAST)
    assert words in one_line(caught.value)
    assert caught.value.status == status
    assert len(server.calls) == 1
    assert leftovers(tmp_path) == []


def test_a_server_out_of_order_gets_a_few_more_chances(server: Server, tmp_path: Path) -> None:
    server.on("/file", Reply(b"", 503), Reply(b"", 502), Reply(DATA))
    assert download(request(server), tmp_path / "x.bin", FAST).sha256 == SHA
    server.on("/file", Reply(b"", 500))
    with pytest.raises(HttpError) as caught:
        download(request(server), tmp_path / "y.bin", FAST)
    assert "answered 500: server error; try again later" in one_line(caught.value)


@pytest.mark.parametrize("pinned", [{"sha256": "0" * 64}, {"size": len(DATA) - 1}, {"size": len(DATA) + 1}])
def test_a_file_that_is_not_the_pinned_one_is_thrown_away(
    server: Server, tmp_path: Path, pinned: dict[str, object]
) -> None:
    server.on("/file", Reply(DATA, length="size" not in pinned))
    with pytest.raises(Avs3dError) as caught:
        download(request(server), tmp_path / "x.bin", FAST, **pinned)  # type: ignore[arg-type]
    assert "not the file that was pinned" in one_line(caught.value)
    assert leftovers(tmp_path) == []


@pytest.mark.parametrize("honest", [True, False], ids=["announced", "unannounced"])
def test_a_file_that_is_too_large_is_not_stored(server: Server, tmp_path: Path, honest: bool) -> None:
    server.on("/file", Reply(DATA, length=honest))
    small = FetchLimits(timeout=1, max_bytes=50_000)
    with pytest.raises(Avs3dError) as caught:
        download(request(server), tmp_path / "x.bin", small)
    size = "0.1 MB" if honest else "more than promised"
    assert f"too large ({size}, the limit is 0.05 MB)" in one_line(caught.value)
    assert "--max-size" in str(caught.value)
    assert leftovers(tmp_path) == []


def test_an_empty_file_is_none(server: Server, tmp_path: Path) -> None:
    server.on("/file", Reply(b""))
    with pytest.raises(Avs3dError) as caught:
        download(request(server), tmp_path / "x.bin", FAST)
    assert "empty file" in one_line(caught.value)
    assert leftovers(tmp_path) == []


def test_a_server_that_does_not_answer_is_given_up(server: Server, tmp_path: Path) -> None:
    server.on("/file", Reply(DATA, hang=3))
    with pytest.raises(CutError) as caught:
        download(request(server), tmp_path / "x.bin", FetchLimits(timeout=0.2, attempts=2, backoff=0.01))
    assert "did not answer within 0.2 s" in one_line(caught.value)
    assert leftovers(tmp_path) == []


def test_a_server_that_drips_is_given_up_after_the_total_time(server: Server, tmp_path: Path) -> None:
    server.on("/file", Reply(DATA, drip=0.05))
    started = time.monotonic()
    with pytest.raises(CutError) as caught:
        download(request(server), tmp_path / "x.bin", FetchLimits(timeout=1, total=0.4, backoff=0.01))
    assert time.monotonic() - started < 30
    assert "--max-time" in one_line(caught.value)


def _child(url: str, target: Path) -> None:
    download(Request(url, "asset/one", "The Service"), target, FetchLimits())


def test_a_process_that_is_killed_leaves_a_part_that_the_next_one_goes_on_with(server: Server, tmp_path: Path) -> None:
    server.on(
        "/file", Reply(DATA, headers=ETAG, ranges=True, block=4096, drip=0.05), Reply(DATA, headers=ETAG, ranges=True)
    )
    child = multiprocessing.get_context("fork").Process(target=_child, args=(f"{server.url}/file", tmp_path / "x.bin"))
    child.start()
    part = tmp_path / "x.bin.part"
    while not (part.exists() and part.stat().st_size > 10_000):
        time.sleep(0.01)
    os.kill(child.pid or 0, signal.SIGKILL)
    child.join()
    assert leftovers(tmp_path) == ["x.bin.part", "x.bin.part.json"]
    have = part.stat().st_size
    assert download(request(server), tmp_path / "x.bin", FAST).sha256 == SHA
    assert server.calls[-1].headers["range"] == f"bytes={have}-"
    assert leftovers(tmp_path) == ["x.bin"]


def test_a_host_that_does_not_exist_is_not_tried_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def unknown(*_args: object, **_kwargs: object) -> None:
        raise socket.gaierror(socket.EAI_NONAME, "Name or service not known")

    monkeypatch.setattr(socket, "getaddrinfo", unknown)
    said: list[str] = []
    with pytest.raises(Avs3dError) as caught:
        download(Request("https://no.invalid/x", "asset/one", "The Service"), tmp_path / "x", FAST, say=said.append)
    assert "no address of no.invalid is known" in one_line(caught.value)
    assert said == []


def test_nobody_at_the_other_end(tmp_path: Path) -> None:
    with serving() as gone:
        url = gone.url
    with pytest.raises(CutError) as caught:
        download(Request(f"{url}/file", "asset/one", "The Service"), tmp_path / "x.bin", FAST)
    assert "no connection to 127.0.0.1" in one_line(caught.value)


def test_a_redirect_to_another_host_does_not_get_the_token(server: Server, tmp_path: Path) -> None:
    server.on("/file", Reply(b"", 302, {"Location": f"{server.elsewhere}/there?signature=abc"}))
    server.on("/there", Reply(DATA))
    assert download(request(server, token=TOKEN), tmp_path / "x.bin", FAST).sha256 == SHA
    first, second = server.calls
    assert first.headers["authorization"] == TOKEN
    assert "authorization" not in second.headers
    assert second.query == "signature=abc"


def test_a_redirect_on_the_same_host_keeps_the_token(server: Server, tmp_path: Path) -> None:
    server.on("/file", Reply(b"", 307, {"Location": "/there"}))
    server.on("/there", Reply(DATA))
    download(request(server, token=TOKEN), tmp_path / "x.bin", FAST)
    assert server.calls[1].headers["authorization"] == TOKEN


def test_a_redirect_with_a_body_without_end_is_followed_at_once(server: Server, tmp_path: Path) -> None:
    server.on("/file", Reply(DATA[:100], 302, {"Location": "/there"}, drip=0.05))
    server.on("/there", Reply(DATA))
    started = time.monotonic()
    assert download(request(server), tmp_path / "x.bin", FAST).sha256 == SHA
    assert time.monotonic() - started < 4  # the whole body would take 5 s


@pytest.mark.parametrize("token", [None, TOKEN])
def test_passwords_of_netrc_are_not_sent(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, token: str | None) -> None:
    netrc = tmp_path / "netrc"
    netrc.write_text("default login me password mine\n")
    monkeypatch.setenv("NETRC", str(netrc))
    sent: list[str | None] = []

    def send(_self: object, prepared: requests.PreparedRequest, **_settings: object) -> requests.Response:
        sent.append(prepared.headers.get("Authorization"))
        answer = requests.Response()
        answer.request, answer.url = prepared, str(prepared.url)
        answer.raw = urllib3.HTTPResponse(io.BytesIO(b"{}"), preload_content=False)
        answer.status_code = 200
        if len(sent) == 1:
            answer.status_code, answer.headers["Location"] = 302, "https://b.invalid/"
        return answer

    monkeypatch.setattr(requests.adapters.HTTPAdapter, "send", send)
    assert get_json(Request("https://a.invalid/", "asset/one", "The Service", token=token), FAST) == {}
    assert sent == [token, None]


def test_a_cut_between_chunks_is_a_cut(server: Server, tmp_path: Path) -> None:
    chunks = {"Transfer-Encoding": "chunked"}
    server.on("/file", Reply(b"5\r\nfirst\r\n5\r\nse", headers=chunks, length=False))
    with pytest.raises(CutError) as caught:
        download(request(server), tmp_path / "x.bin", FAST)
    assert "the connection was cut" in one_line(caught.value)
    assert leftovers(tmp_path) == []
    server.on("/file", Reply(b"5\r\nfirst\r\n0\r\n\r\n", headers=chunks, length=False))
    download(request(server), tmp_path / "x.bin", FAST)
    assert (tmp_path / "x.bin").read_bytes() == b"first"


def test_redirects_end(server: Server, tmp_path: Path) -> None:
    server.on("/file", Reply(b"", 302, {"Location": "/file"}))
    with pytest.raises(HttpError) as caught:
        download(request(server), tmp_path / "x.bin", FAST)
    assert "redirects more than 5 times" in one_line(caught.value)
    server.on("/file", Reply(b"", 302, {"Location": "http://example.org/file"}))
    with pytest.raises(Avs3dError) as refused:
        download(request(server), tmp_path / "x.bin", FAST)
    assert "is not an https address" in one_line(refused.value)


@pytest.mark.parametrize(
    "url", ["https://example.org/x", "http://127.0.0.1:80/x", "http://[::1]/x", "http://localhost/"]
)
def test_https_everywhere_and_http_at_home(url: str) -> None:
    check_url(url, "asset/one")


@pytest.mark.parametrize(
    "url", ["http://example.org/x", "ftp://example.org/x", "file:///etc/passwd", "/x", "https:///x"]
)
def test_other_addresses_are_refused_without_their_query(url: str) -> None:
    with pytest.raises(Avs3dError) as caught:
        check_url(f"{url}?signature={TOKEN}", "asset/one")
    one_line(caught.value)


def test_json_is_json_and_no_larger_than_an_answer(server: Server) -> None:
    server.on("/file", json_reply({"a": 1}))
    assert get_json(request(server), FAST) == {"a": 1}
    for body, words in ((b"<html>", "did not answer with JSON"), (b" " * 9_000_000, "more than 8 MB")):
        server.on("/file", Reply(body))
        with pytest.raises(Avs3dError) as caught:
            get_json(request(server), FAST)
        assert words in one_line(caught.value)
    server.on("/file", Reply(b'{"a": 1234}', cut=5), json_reply({"a": 2}))
    assert get_json(request(server), FAST) == {"a": 2}


def test_two_processes_do_not_write_into_the_same_file(server: Server, tmp_path: Path) -> None:
    server.on("/file", Reply(DATA, hang=0.4))
    results: list[str] = []

    def fetch() -> None:
        try:
            results.append(download(request(server), tmp_path / "x.bin", FetchLimits(timeout=5)).sha256)
        except Avs3dError as error:
            results.append(one_line(error))

    threads = [threading.Thread(target=fetch) for _ in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(results) == sorted([SHA, "asset/one: another avs3d is fetching it; wait for that one"])
    assert (tmp_path / "x.bin").read_bytes() == DATA
    assert leftovers(tmp_path) == ["x.bin"]


def test_a_folder_that_cannot_be_written_is_named(server: Server, tmp_path: Path) -> None:
    (tmp_path / "a").write_text("a file")
    server.on("/file", Reply(DATA))
    with pytest.raises(Avs3dError) as caught:
        download(request(server), tmp_path / "a" / "x.bin", FAST)
    assert one_line(caught.value).endswith("a: cannot write: file exists")


@pytest.mark.parametrize("value", ["9" * 400, "99999999999999", "Fri, 31 Dec 9999 23:59:59 GMT"])
def test_a_pause_without_end_is_one_line_too(server: Server, tmp_path: Path, value: str) -> None:
    server.on("/file", Reply(b"", 429, {"Retry-After": value}))
    with pytest.raises(HttpError) as caught:
        download(request(server), tmp_path / "x.bin", FAST)
    assert "asks to wait" in one_line(caught.value)


@pytest.mark.parametrize("length", ["²", "9" * 5000, "-5", "abc"])
def test_a_length_that_is_no_number_counts_as_none(server: Server, tmp_path: Path, length: str) -> None:
    server.on("/file", Reply(b'{"a": 1}', headers={"Content-Length": length}, length=False))
    assert download(request(server), tmp_path / "x.bin", FAST).bytes == 8
    assert get_json(request(server), FAST) == {"a": 1}


def test_json_that_is_nested_without_end_is_none(server: Server) -> None:
    server.on("/file", Reply(b"[" * 200_000 + b"]" * 200_000))
    with pytest.raises(Avs3dError) as caught:
        get_json(request(server), FAST)
    assert "did not answer with JSON" in one_line(caught.value)


@pytest.mark.parametrize("url", ["https://[", "https://h:99999999/x", "https://h:port/x", "http://[::1", "x", ""])
def test_an_address_that_cannot_be_read_is_refused(tmp_path: Path, url: str) -> None:
    with pytest.raises(Avs3dError) as caught:
        download(Request(url, "asset/one", "The Service", token=TOKEN), tmp_path / "x.bin", FAST)
    assert "is not an https address" in one_line(caught.value)


@pytest.mark.parametrize("location", ["https://[", "https://h:99999999/x", "https://a b/", "https://é.example/ü"])
def test_a_redirect_to_no_address_is_refused(server: Server, tmp_path: Path, location: str) -> None:
    server.on("/file", Reply(b"", 302, {"Location": location}))
    with pytest.raises(Avs3dError) as caught:
        download(request(server, token=TOKEN), tmp_path / "x.bin", FAST)
    assert "address" in one_line(caught.value)


def test_a_password_in_an_address_is_not_shown(server: Server, tmp_path: Path) -> None:
    server.on("/file", Reply(b"", 302, {"Location": f"https://user:{TOKEN}@no.invalid/"}))
    with pytest.raises(Avs3dError) as caught:
        download(request(server), tmp_path / "x.bin", FAST)
    one_line(caught.value)


def test_a_folder_that_another_process_tidies_away_is_made_again(
    server: Server, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    server.on("/file", Reply(DATA))
    folder, real, tidied = tmp_path / "incoming", os.open, []

    def late(path: object, flags: int, *rest: int) -> int:
        if str(path).endswith(".part") and not tidied:
            tidied.append(path)
            folder.rmdir()
        return real(path, flags, *rest)  # type: ignore[arg-type]

    monkeypatch.setattr(os, "open", late)
    assert download(request(server), folder / "x.bin", FAST).sha256 == SHA
    assert tidied
