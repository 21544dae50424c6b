"""`knothe serve` before clients that mean harm, or do not know better: it answers, stays, and stays small."""
import json
import os
import pathlib
import re
import resource
import socket
import struct
import threading
import time
import unittest

from service_support import ServiceCase

DEEP = "[" * 100_000 + "]" * 100_000


class Test(ServiceCase):
    def raw(self, service, sent, wait=10):
        """All that comes back for these bytes; the connection is closed, or silent for `wait` seconds then."""
        with socket.create_connection(("127.0.0.1", service.port), timeout=wait) as one:
            answer = b""
            try:
                one.sendall(sent)
                while piece := one.recv(65536):
                    answer += piece
            except OSError:
                pass
            return answer

    def metric(self, service, name):
        return float(re.search(rf"^{name}(?:{{.*}})? (\S+)$", service.get("/metrics")[1].decode(), re.MULTILINE)[1])

    def request(self, method, path, *headers, body=b""):
        return "\r\n".join([f"{method} {path} HTTP/1.1", "Host: localhost", *headers, "", ""]).encode() + body

    def memory(self, service):
        status = pathlib.Path(f"/proc/{service.process.pid}/status").read_text()
        return 1024 * int(next(line for line in status.splitlines() if line.startswith("VmHWM")).split()[1])

    def test_json_nested_deep_is_refused_everywhere(self):
        service = self.serve()
        for path in ("/Evaluate", "/ModelInfo", "/Gradient", "/v1/measurements", "/v1/quarantine", "/v1/withdraw"):
            for body in (DEEP, f'{{"name":{DEEP}}}', f'{{"name":"forward","config":{DEEP}}}', f'{{"values":{DEEP}}}',
                         '{"a":' * 100_000 + "1" + "}" * 100_000):
                status, answer = service.post(path, body)
                self.assertEqual(status, 400, path)
                self.assertRegex(answer["error"]["message"], "nested deeper than")
        self.assertEqual(service.get("/livez")[0], 200)

    def test_many_small_objects_hold_up_nothing(self):
        """In a time that goes with their number. Compared each with all others, as the JSON library does, they would take hours."""
        service = self.serve()
        many = '{"name":"forward","input":[' + "{}," * 2_000_000 + "{}]}"
        status, answer = service.post("/Evaluate", many)
        self.assertEqual(status, 400, answer)
        self.expect_error(service.post("/v1/measurements", "[" + "{}," * 20_000 + "{}]"), 400, "Malformed")
        self.expect_stored(service.send(self.data[0]), 0)

    def test_a_key_that_comes_twice_is_refused(self):
        service = self.serve()
        key = '"source":"camera","session":"s","seq":0'
        answer = service.post("/v1/withdraw", f'{{{key},"seq":1}}')
        self.expect_error(answer, 400, "Malformed")
        self.assertIn('"seq" comes twice', answer[1]["error"]["message"])
        self.expect_error(service.post("/ModelInfo", '{"name":"forward","name":"predict"}'), 400, "InvalidInput")
        self.expect_error(service.post("/v1/withdraw", '{"source":"camera","session":"s","seq":1.5}'), 400, "Malformed")
        self.expect_error(service.post("/v1/withdraw", '{"source":"camera","session":"s","seq":1.0}'), 400, "Malformed")

    def test_no_trailer_and_no_head_ends_the_service(self):
        service = self.serve()
        chunked = self.request("POST", "/Evaluate", "Transfer-Encoding: chunked", body=b"2\r\n{}\r\n0\r\n")
        for trailer in (b"X: " + b"y" * 70_000, b"z" * 70_000 + b": 1", b"X: y\r\n" * 20_000):
            self.assertRegex(self.raw(service, chunked + trailer + b"\r\n\r\n"), rb"^HTTP/1.1 (400|431) ")
        self.assertRegex(self.raw(service, chunked + b"X: y\r\n\r\n", wait=1), rb"^HTTP/1.1 400 .*InvalidInput|^HTTP/1.1 400")
        for head in (b"GET /" + b"x" * 70_000 + b" HTTP/1.1\r\n\r\n", b"GET / HTTP/1.1\r\n" + b"y" * 70_000 + b": 1\r\n\r\n"):
            self.assertRegex(self.raw(service, head), rb"^HTTP/1.1 431 ")
        self.assertEqual(service.get("/livez")[0], 200)

    def test_what_is_said_twice_or_behind_the_body_is_not_taken(self):
        """Of an array whose time, number and source are headers."""
        service = self.serve()
        values = self.data[0]["values"]
        text = f"{{'descr': '<f8', 'fortran_order': False, 'shape': ({len(values)},), }}"
        text += " " * (-(len(text) + 11) % 64) + "\n"
        array = b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text.encode() + struct.pack(f"<{len(values)}d", *values)
        head = ("Content-Type: application/x-npy", "source: camera", "session: s", "seq: 0")
        times = [f"time: {self.data[step]['time']}" for step in (0, 1)]

        def send(*more, trailer=b""):
            body = b"%x\r\n%s\r\n0\r\n%s\r\n" % (len(array), array, trailer)
            return self.raw(service, self.request("POST", "/v1/measurements", "Transfer-Encoding: chunked", *head, *more, body=body), wait=2)

        self.assertIn(b" 400 ", send(*times))
        self.assertIn(b"the headers seq and X-Knothe-seq say", send(times[0], "X-Knothe-Seq: 1"))
        self.assertEqual(service.get("/v1/status")[1]["records"], 0)
        self.assertIn(b'"step":0', send(times[0], trailer=times[1].encode() + b"\r\nseq: 7\r\n"))
        self.assertIn(b'"duplicate":true', send(times[0]))

    def test_a_transfer_encoding_that_is_not_known_ends_the_connection(self):
        service = self.serve()
        hidden = b"GET /v1/sites HTTP/1.1\r\nHost: localhost\r\n\r\n"
        for headers, status in (("Transfer-Encoding: gzip",), 501), (("Transfer-Encoding: xchunked",), 501), (("Transfer-Encoding: gzip, chunked",), 501), \
                (("Transfer-Encoding: identity", f"Content-Length: {len(hidden)}"), 400), \
                (("Transfer-Encoding: chunked", f"Content-Length: {len(hidden)}"), 400), \
                (("Transfer-Encoding: chunked", "Transfer-Encoding: identity"), 400), \
                (("Content-Length: 0", f"Content-Length: {len(hidden)}"), 400):
            answer = self.raw(service, self.request("POST", "/Evaluate", *headers, body=hidden))
            self.assertEqual(answer.count(b"HTTP/1.1 "), 1, answer)
            self.assertIn(f"HTTP/1.1 {status} ".encode(), answer, headers)

    def test_bodies_that_nobody_wants_are_not_read_and_all_together_are_bounded(self):
        for name in ("read", "ingest"):
            (self.folder / name).write_text("0123456789abcdef\n")
        service = self.serve(extra='read_token = "read"\ningest_token = "ingest"\nmax_connections = 300\n')
        before = self.memory(service)
        megabytes = b"x" * (8 << 20)

        def send(head):
            with socket.create_connection(("127.0.0.1", service.port), timeout=20) as one:
                try:
                    one.sendall(head)
                    one.sendall(megabytes[:-1])  # one byte is missing: whoever wants it waits for that
                    time.sleep(2)
                except OSError:
                    pass

        token = "Authorization: Bearer 0123456789abcdef"
        for head in (self.request("GET", "/livez", f"Content-Length: {len(megabytes)}"),
                     self.request("POST", "/Evaluate", f"Content-Length: {len(megabytes)}"),
                     self.request("POST", "/Evaluate", token, f"Content-Length: {len(megabytes)}"),
                     self.request("POST", "/v1/measurements", token, f"Content-Length: {len(megabytes)}")):
            threads = [threading.Thread(target=send, args=(head,)) for _ in range(25)]
            for thread in threads:
                thread.start()
            for thread in threads:
                thread.join()
        if "KNOTHE_SANITIZED" not in os.environ:  # the address sanitizer keeps what is freed
            # 64 MB, and what the parser and malloc need.
            self.assertLess(self.memory(service) - before, 150e6)
        self.expect_error(service.request("GET", "/livez", b"{}")[::2], 413, "TooLarge")
        self.assertEqual(service.post("/v1/measurements", self.data[0], Authorization="bearer 0123456789abcdef")[0], 200)
        self.assertEqual(service.get("/v1/state", Authorization="BEARER 0123456789abcdeF")[0], 401)

    def test_what_a_body_is_must_be_said(self):
        service = self.serve()
        self.assertIn(b"HTTP/1.1 411 ", self.raw(service, self.request("POST", "/v1/measurements")))
        for kind, status in (("text/plain", 415), ("application/x-www-form-urlencoded", 415), ("application/jsonx", 415),
                             ("Application/JSON; charset=utf-8", 404), ("", 404)):
            headers = {"Content-Type": kind} if kind else {}
            answer = service.request("POST", "/v1/withdraw", '{"source":"c","session":"s","seq":0}', headers)
            self.assertEqual(answer[0], status, kind)
        self.assertIn("x-npy", service.request("POST", "/v1/measurements", "{}", {"Content-Type": "text/csv"})[2]["error"]["message"])
        self.expect_error(service.request("POST", "/v1/withdraw", "{}", {"Content-Type": "application/x-npy"})[::2], 415, "UnsupportedType")

    @unittest.skipIf("KNOTHE_SANITIZED" in os.environ, "the sanitizers' own memory is counted too")
    def test_answers_that_nobody_reads_are_bounded(self):
        soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
        resource.setrlimit(resource.RLIMIT_NOFILE, (min(hard, 4096), hard))
        self.addCleanup(resource.setrlimit, resource.RLIMIT_NOFILE, (soft, hard))
        service = self.serve(preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_NOFILE, (4096, hard)))
        before, silent = self.memory(service), []
        page = len(service.request("GET", "/")[2])
        for _ in range(1000):
            one = socket.socket()
            one.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
            one.connect(("127.0.0.1", service.port))
            one.sendall(20 * self.request("GET", "/"))
            silent.append(one)
        service.wait_until(lambda: service.get("/livez")[0] == 200)
        self.assertEqual(len(service.request("GET", "/")[2]), page)
        self.assertLess(self.memory(service) - before, 100e6)
        for one in silent:
            one.close()

    def test_heads_are_read_as_http_means_them(self):
        service = self.serve()
        for host in ("LOCALHOST", "LocalHost:1", "[::1]:1"):
            self.assertIn(b" 200 OK", self.raw(service, f"GET /livez HTTP/1.0\r\nHost: {host}\r\n\r\n".encode()))
        for host in ("localhost.example", "localhost:1@evil.example", "localhost@evil.example", "localhost, evil.example", "[::1", "[::1]evil.example"):
            self.assertIn(b" 403 ", self.raw(service, f"GET /livez HTTP/1.0\r\nHost: {host}\r\n\r\n".encode()), host)
        for head in self.request("GET", "/livez", "Host: localhost"), b"GET /livez HTTP/1.1\r\n\r\n":  # two, none
            answer = self.raw(service, head)
            self.assertIn(b" 400 ", answer)
            self.assertIn(b"has one Host: header", answer)
        self.assertIn(b" 200 ", self.raw(service, b"GET /livez HTTP/1.0\r\n\r\n"))
        answer = self.raw(service, self.request("HEAD", "/v1/events"), wait=5)
        self.assertTrue(answer.startswith(b"HTTP/1.1 200 ") and answer.endswith(b"\r\n\r\n"), answer)
        self.assertIn(b"text/event-stream", answer)
        for bogus in ("x", "-1", "1.5", "99999999999999999999999"):
            answer = service.get("/v1/events", Last_Event_ID=bogus)
            self.expect_error(answer, 400, "Malformed")
            self.assertIn("Last-Event-ID", answer[1]["error"]["message"])
        self.expect_error(service.get("/v1/events?from=x"), 400, "Malformed")
        self.expect_error(service.get("/v1/events?site=x"), 404, "UnknownSite")

    def test_targets_heads_and_hosts_are_as_rfc_9112_has_them(self):
        service = self.serve()
        at = f"127.0.0.1:{service.port}"
        for target in (f"http://{at}/livez", f"HTTP://{at}/livez", "http://localhost/livez?x=1"):
            self.assertIn(b" 200 OK", self.raw(service, f"GET {target} HTTP/1.1\r\nHost: other.example\r\nConnection: close\r\n\r\n".encode()), target)
        self.assertIn(b"text/html", self.raw(service, f"GET http://{at} HTTP/1.1\r\nHost: {at}\r\nConnection: close\r\n\r\n".encode()))
        self.assertIn(b'{"sites":', self.raw(service, f"GET http://{at}/v1/sites HTTP/1.1\r\nHost: {at}\r\nConnection: close\r\n\r\n".encode()))
        self.assertIn(b" 403 ", self.raw(service, b"GET http://evil.example/livez HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n"))
        for host in ("", " ", ":80"):
            self.assertIn(b" 403 ", self.raw(service, f"GET /livez HTTP/1.1\r\nHost:{host}\r\nConnection: close\r\n\r\n".encode()), host)
        for path, status in (("/nothing", 404), ("/v1/measurements", 405), ("/v1/state", 404), ("/livez", 200)):
            answer = self.raw(service, self.request("HEAD", path, "Connection: close"))
            self.assertIn(f" {status} ".encode(), answer)
            self.assertTrue(answer.endswith(b"\r\n\r\n"), answer)
        body = json.dumps(self.data[0]).encode()
        for version, expected in (("1.0", False), ("1.1", True)):
            head = f"POST /v1/measurements HTTP/{version}\r\nHost: localhost\r\nExpect: 100-continue\r\nConnection: close\r\nContent-Length: {len(body)}\r\n\r\n"
            answer = self.raw(service, head.encode() + body)
            self.assertEqual(b"100 Continue" in answer, expected, answer)
            self.assertIn(b" 200 OK", answer)

    def test_a_page_behind_a_proxy_may_press_its_buttons_with_a_token(self):
        """docs/how-to/nginx.md: the host is the loopback address, the browser's origin the public name."""
        (self.folder / "read").write_text("the reader's secret words\n")
        (self.folder / "ingest").write_text("the sender's secret words\n")
        service = self.serve(extra='read_token = "read"\ningest_token = "ingest"\n')
        ask = lambda token: service.post("/v1/notes", {"by": "Ada", "text": "a note"}, None, Origin="https://knothe.example.org",
                                         **({"Authorization": f"Bearer {token}"} if token else {}))
        self.assertEqual(ask("the sender's secret words")[0], 200)
        for token in ("", "the reader's secret words", "the sender's secret word"):
            self.expect_error(ask(token), 403, "WrongOrigin")
        self.assertEqual(service.get("/v1/sites", Origin="https://knothe.example.org", Authorization="Bearer the reader's secret words")[0], 200)
        self.expect_error(service.get("/", Origin="https://knothe.example.org"), 403, "WrongOrigin")

    def test_idle_connections_beyond_the_open_files_leave_room_for_data(self):
        service = self.serve(preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_NOFILE, (64, 64)))
        self.assertIn("the limit of open files is too low", service.logged())
        crowd = [socket.create_connection(("127.0.0.1", service.port)) for _ in range(200)]
        self.expect_stored(service.send(self.data[0]), 0)
        self.assertLess(self.metric(service, "knothe_connections"), 64)
        for one in crowd:
            one.close()

    def test_a_crowd_does_not_keep_data_out(self):
        soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
        resource.setrlimit(resource.RLIMIT_NOFILE, (min(hard, 4096), hard))
        self.addCleanup(resource.setrlimit, resource.RLIMIT_NOFILE, (soft, hard))
        service = self.serve(preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_NOFILE, (1024, hard)))
        sender = service.connection()
        self.expect_stored(service.send(self.data[0], sender), 0)
        events = self.request("GET", "/v1/events")
        crowd = []
        for k in range(2200):
            one = socket.create_connection(("127.0.0.1", service.port))
            one.sendall(events if k % 2 else b"GET /livez HT")
            crowd.append(one)
        self.expect_stored(service.send(self.data[1], sender), 1)  # the connection that brings data is still there
        self.expect_stored(service.send(self.data[2]), 2)  # and a new one is taken
        self.assertEqual(service.get("/livez")[0], 200)
        streams = float(re.search(r"^knothe_event_streams (\S+)$", service.get("/metrics")[1].decode(), re.MULTILINE)[1])
        self.assertLessEqual(streams, 768)
        for one in crowd:
            one.close()

    def test_large_bodies_hold_up_nobody(self):
        service = self.serve()
        large = {**self.data[0], "values": [0.125] * 1_300_000}
        body = json.dumps(large, separators=(",", ":"))
        answers = []
        senders = [threading.Thread(target=lambda: answers.append(service.post("/v1/measurements", body))) for _ in range(4)]
        for one in senders:
            one.start()
        while any(one.is_alive() for one in senders):
            self.assertEqual(service.get("/livez")[0], 200)  # measured: 12 ms at worst; it was 1 s
        for status, answer in answers:
            self.expect_error((status, answer), 400, "WrongSize")


if __name__ == "__main__":
    unittest.main()
