"""Clients that send half, nothing, or slowly, over real connections: they cost nothing and keep nothing."""

import socket
import threading
import time
from contextlib import suppress
from dataclasses import replace
from urllib.parse import urlsplit

import h11
import pytest
from browser.test_service_in_browser import served
from hypothesis import given
from hypothesis import strategies as st
from support.command_lines import call
from support.tools import require

from orchestrator.service import server
from orchestrator.service.client import Client
from orchestrator.service.files import Files
from orchestrator.service.records import Allowance
from service.conftest import ALONE, FAKE, fmu

require("starlette", "uvicorn")


@pytest.fixture
def address(tmp_path):
    settings = replace(ALONE, limits=Allowance(upload=10_000, patience=0.6, upload_time=2.0))
    with served(tmp_path / "data", settings, FAKE) as url:
        yield url


def connected(address: str, head: str, path: str = "/api/runs?name=a.fmu", method: str = "POST") -> socket.socket:
    parts = urlsplit(address)
    client = socket.create_connection((parts.hostname, parts.port), timeout=20)
    client.sendall(f"{method} {path} HTTP/1.1\r\nHost: {parts.netloc}\r\n{head}\r\n\r\n".encode())
    return client


def answer(client: socket.socket) -> bytes:
    received = b""
    try:
        while piece := client.recv(1 << 16):
            received += piece
            if b"\r\n\r\n" in received:
                break
    except OSError:
        pass
    return received


def nothing_is_left(tmp_path, address: str) -> None:
    """And the service answers as before."""
    root = Files(tmp_path / "data").root
    for _ in range(100):
        if not list((root / "incoming").iterdir()):
            break
        time.sleep(0.05)
    assert list((root / "incoming").iterdir()) == [] and list((root / "fmus").iterdir()) == []
    assert Client(address).ask("GET", "/api/runs")["answer"] == []


def test_half_an_upload_leaves_nothing(address, tmp_path):
    for _ in range(10):
        with connected(address, "Content-Length: 5000") as client:
            client.sendall(b"PK" + bytes(1000))
    nothing_is_left(tmp_path, address)


def test_a_silent_client_is_answered_after_a_while(address, tmp_path):
    with connected(address, "Content-Length: 5000") as client:
        client.sendall(b"PK")
        begin = time.monotonic()
        assert b" 408 " in answer(client) and time.monotonic() - begin < 10
    nothing_is_left(tmp_path, address)


def test_one_byte_after_the_other_ends_with_the_time_of_an_upload(address, tmp_path):
    with connected(address, "Content-Length: 5000") as client:
        client.settimeout(0.05)
        received = b""
        for _ in range(200):
            try:
                client.sendall(b"P")
                received += client.recv(1000)
            except TimeoutError:
                continue
            except OSError:
                break
            if received:
                break
        assert b" 408 " in received
    nothing_is_left(tmp_path, address)


def test_more_than_is_taken_is_refused_at_once(address, tmp_path):
    with connected(address, "Content-Length: 99999999999") as client:
        assert b" 413 " in answer(client)
    nothing_is_left(tmp_path, address)


@pytest.mark.parametrize("path", ["/api/runs?name=a.fmu", "/join", "/"])
def test_a_body_in_chunks_is_refused(address, tmp_path, path):
    """One of 256 kB may have 43,000 of them: 20 clients had others wait for a minute."""
    with connected(address, "Transfer-Encoding: chunked", path) as client:
        client.sendall(b"1\r\nP\r\n" * 3)
        refused = answer(client)
        assert b" 411 " in refused and b"length" in refused
    nothing_is_left(tmp_path, address)


def test_a_head_request_in_chunks_is_answered(address, caplog):
    with connected(address, "Transfer-Encoding: chunked", "/", method="HEAD") as client:
        refused = answer(client)
        assert b" 411 " in refused and refused.endswith(b"\r\n\r\n")
    assert not [record for record in caplog.records if record.exc_info]


@pytest.mark.parametrize("lines, status", [(60, b" 200 "), (150, b" 431 ")])
def test_a_head_has_few_lines(address, lines, status):
    with connected(address, "\r\n".join(f"a{number}: 1" for number in range(lines)), "/join", method="GET") as client:
        assert status in answer(client)


@pytest.mark.parametrize("line", [f"a: {'x' * 20_000}", f"Connection: {',' * 501}", f"Cookie: {'a=b; ' * 501}"])
def test_a_head_has_few_bytes_and_signs(address, line):
    """Of 16,000 commas each is read, three times and more: 380 connections had others wait for 1.5 s."""
    with connected(address, line, "/join", method="GET") as client:
        assert b" 431 " in answer(client)


def test_signs_are_counted_in_whole_heads_alone():
    """In each packet of one byte they were counted anew, in 16 kB: 380 connections had others wait for 0.7 s."""
    parser = server.Parser(h11.SERVER)
    parser.receive_data(b"GET / HTTP/1.1\r\nHost: a\r\n" + 150 * b"a: b\r\n")
    assert parser.next_event() is h11.NEED_DATA
    parser.receive_data(b"\r\n")
    with pytest.raises(h11.RemoteProtocolError):
        parser.next_event()


@pytest.mark.parametrize("length, status", [(4096, b" 200 "), (4097, b" 414 ")])
def test_an_address_that_is_asked_for_is_short(address, length, status):
    """Of 8,000 signs in it, each was read: 380 connections had others wait for 1.8 s."""
    with connected(address, "", f"/join?{'%' * (length - 6)}", method="GET") as client:
        assert status in answer(client)


def test_what_is_no_request_makes_no_traceback(address, caplog):
    """Each packet of a stranger made 4 kB of the log, and the answer under way was written into by another."""
    for junk in (b"ZZ\r\n\r\n", b"GET / HTTP/1.1\r\n\r\n", b"\0" * 100):
        with connected(address, "", "/join", method="GET") as client:
            client.sendall(junk)
            assert b"HTTP/1.1 " in answer(client)
    with connected(address, "Content-Length: 4", "/join") as client:
        client.sendall(b"key=ZZ\r\n\r\n")
        assert answer(client).split()[1] in (b"400", b"403")  # by what comes first: the rest of the body, or the answer
    assert not [record for record in caplog.records if record.exc_info or record.levelname == "ERROR"]


@pytest.mark.parametrize("byte", ["\0", "\v", "\f", "\rb"])
@pytest.mark.parametrize("many", [" ", "\t", " \t", "c"])
def test_a_head_has_no_bytes_before_which_its_parser_goes_back(address, many, byte):
    """Blanks before one kept everybody waiting for 1.5 s, before any turn, and letters did on 380 connections."""
    with connected(address, f"a: b{many * 5000}{byte}", "/join", method="GET") as client:
        refused = b"".join(iter(lambda: client.recv(1 << 16), b""))
        assert b" 400 " in refused and b"in none" in refused


@given(
    heads=st.lists(
        st.tuples(
            st.integers(0, 98),
            st.sampled_from([0, 50, 300]),
            st.sampled_from([5, 17_000]),
            st.sampled_from([b""] * 5 + [b"\0", b"\r", b"\re", b"\r\r"]),
        ),
        max_size=3,
    ),
    cuts=st.lists(st.integers(0, 40_000), max_size=20),
)
def test_a_head_is_the_same_in_whatever_pieces_it_comes(heads, cuts):
    """Each packet had the whole head searched again: 300 connections had others wait for 2 s."""
    sent = b"".join(
        b"GET / HTTP/1.1\r\nHost: a\r\n"
        + lines * b"b: c\r\n"
        + b"d:%b%b%b\r\n\r\n" % (blanks * b" ", letters * b"e", bad)
        for lines, blanks, letters, bad in heads
    )

    def events(pieces: list[bytes]) -> list[object]:
        parser, told = server.Parser(h11.SERVER), []
        for piece in pieces:
            parser.receive_data(piece)
            try:
                while (event := parser.next_event()) not in (h11.NEED_DATA, h11.PAUSED):
                    told.append(type(event).__name__)
                    if isinstance(event, h11.EndOfMessage):
                        parser.send(h11.Response(status_code=204, headers=[]))
                        parser.send(h11.EndOfMessage())
                        parser.start_next_cycle()
            except h11.RemoteProtocolError:
                return [*told, "refused"]
        return told

    at = [0, *sorted(cut for cut in cuts if cut < len(sent)), len(sent)]
    assert events([sent[a:b] for a, b in zip(at, at[1:], strict=False) if a < b]) == events([sent] if sent else [])


@pytest.mark.parametrize("upgrade", ["h2c", "websocket"])
def test_who_offers_another_protocol_is_answered_by_this_one(address, upgrade):
    """As Java's client and ``curl --http2`` do."""
    with connected(address, f"Connection: Upgrade\r\nUpgrade: {upgrade}", "/join", method="GET") as client:
        assert b" 200 " in answer(client)


def test_requests_may_be_sent_before_the_answer_to_the_one_before(address):
    with connected(address, "\r\nGET /nothing HTTP/1.1\r\nHost: a", "/join", method="GET") as client:
        client.sendall(b"GET /nothing HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: close\r\n\r\n")
        received = b""
        while piece := client.recv(1 << 16):
            received += piece
        assert received.count(b"HTTP/1.1 200") == 1 and received.count(b"HTTP/1.1 4") == 2


def test_a_body_may_follow_the_answer_to_the_request_before(address):
    """A server in front uses a connection again at once: nine of ten uploads behind a file lost theirs."""
    head = "\r\nPOST /join HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: close\r\nContent-Length: 1"
    with connected(address, head, "/join", method="GET") as client:
        assert b" 200 " in answer(client)
        client.sendall(b"k")
        assert b"HTTP/1.1 403 " in b"".join(iter(lambda: client.recv(1 << 16), b""))


def test_a_body_that_nobody_reads_ends_the_connection(address):
    """It came without a limit, and outside of the turns."""
    with connected(address, "Content-Length: 99999999999", "/join", method="GET") as client:
        assert b" 200 " in answer(client)
        with pytest.raises(OSError):
            for _ in range(10_000):
                client.sendall(bytes(1 << 16))


def test_a_stranger_keeps_a_connection_for_a_few_seconds_only(tmp_path):
    """500 of them would lock everybody out: a key may not take as long as an upload."""
    settings = replace(ALONE, limits=Allowance(patience=60.0, upload_time=60.0))
    with served(tmp_path / "data", settings, FAKE) as url, connected(url, "Content-Length: 4000", "/join") as client:
        client.sendall(b"k")
        begin = time.monotonic()
        assert b" 408 " in answer(client) and time.monotonic() - begin < 20


def test_connections_without_a_request_are_closed(address, tmp_path, monkeypatch):
    """1,100 of them kept jobs from being started, as their process had no files left to open."""
    monkeypatch.setattr(server, "HEAD_TIME", 0.5)
    with connected(address, "Content-Length: 0", "/none") as one, connected(address, "", "/none") as other:
        parts = urlsplit(address)
        with socket.create_connection((parts.hostname, parts.port), timeout=20) as silent:
            assert silent.recv(1) == b""
        with socket.create_connection((parts.hostname, parts.port), timeout=20) as half:
            half.sendall(b"GET / HTTP/1.1\r\nHost: ")
            assert half.recv(1) == b""
        assert answer(one) and answer(other)
    nothing_is_left(tmp_path, address)


def test_more_connections_than_there_may_be_are_closed_at_once(address, tmp_path, monkeypatch):
    monkeypatch.setattr(server, "MAX_CONNECTIONS", 2)
    monkeypatch.setattr(server, "SPARE", 1)
    parts = urlsplit(address)
    clients = [socket.create_connection((parts.hostname, parts.port), timeout=20) for _ in range(5)]
    closed = 0
    for client in clients[3:]:
        try:
            closed += client.recv(1) == b""
        except ConnectionError:
            closed += 1
    for client in clients:
        client.close()
    assert closed == 2
    nothing_is_left(tmp_path, address)


def test_a_client_that_leaves_the_end_of_an_answer_is_gone_after_a_while(address, monkeypatch):
    """It was told to close, and nobody looked at it again: 450 would have locked everybody out for good."""
    monkeypatch.setattr(server, "HEAD_TIME", 0.3)
    made, lost, gone = server.Connection.connection_made, server.Connection.connection_lost, threading.Event()

    def with_a_small_buffer(self, transport):
        transport.get_extra_info("socket").setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 4096)
        made(self, transport)

    monkeypatch.setattr(server.Connection, "connection_made", with_a_small_buffer)
    monkeypatch.setattr(server.Connection, "connection_lost", lambda self, exc: [lost(self, exc), gone.set()])
    parts = urlsplit(address)
    with socket.socket() as client:
        client.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2048)
        client.connect((parts.hostname, parts.port))
        client.sendall(f"GET /static/style.css HTTP/1.1\r\nHost: {parts.netloc}\r\n\r\n".encode() * 3)
        assert gone.wait(20)


def test_a_client_that_takes_nothing_of_an_answer_is_gone_after_a_while(tmp_path, monkeypatch):
    """490 of them held two files each, and the jobs of others could not be started."""
    monkeypatch.setattr(server, "HEAD_TIME", 0.3)
    size, file = 20_000_000, "evaluation/cases.csv"
    with served(tmp_path / "data", ALONE, FAKE) as url:
        run = Client(url).ask("POST", "/api/runs?name=a.fmu", fmu(evaluating={"files": {file: "x" * size}}))
        Client(url).follow(run["id"], lambda run: None)
        parts = urlsplit(url)
        with socket.socket() as client:
            client.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
            client.settimeout(20)
            client.connect((parts.hostname, parts.port))
            client.sendall(f"GET /api/runs/{run['id']}/files/{file} HTTP/1.1\r\nHost: {parts.netloc}\r\n\r\n".encode())
            time.sleep(5.0)
            taken = 0
            with suppress(ConnectionError):
                while piece := client.recv(1 << 20):
                    taken += len(piece)
        assert taken < size


def test_a_run_whose_binding_is_refused_waits_for_nobody(address, tmp_path):
    (tmp_path / "my.fmu").write_bytes(fmu(checking={"wait": 60}))
    refused = call("submit", "my.fmu", "--to", address, "--set", f"K={'x' * 600_000}", folder=tmp_path)
    assert refused.code == 2 and "66 kB that are taken" in refused.err
    nothing_is_left(tmp_path, address)


def test_what_is_no_http_disturbs_nobody(address, tmp_path):
    parts = urlsplit(address)
    for nonsense in (b"\x16\x03\x01", b"GET / HTTP/9.9\r\n\r\n", b"A" * 100_000, b"GET /%00%ff\xff HTTP/1.1\r\n\r\n"):
        with socket.create_connection((parts.hostname, parts.port), timeout=5) as client:
            client.sendall(nonsense)
    nothing_is_left(tmp_path, address)
    assert Client(address).ask("POST", "/api/runs?name=a.fmu", fmu())["state"] == "received"
