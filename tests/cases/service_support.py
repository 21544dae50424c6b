"""A running `knothe serve` for tests, and the few requests that they make. Python's own modules only."""
import contextlib
import http.client
import json
import os
import queue
import re
import shutil
import signal
import socket
import ssl
import subprocess
import threading
import time
import urllib.parse

from support import KNOTHE, Case, parse_line, read_csv


class Service:
    """`knothe serve PROJECT` at a free port, or a given one; restarted with the same journal by `start` again."""

    def __init__(self, folder, project, *arguments, program=KNOTHE, **options):
        self.folder, self.project, self.arguments, self.program, self.options = folder, project, arguments, program, options
        self.process = None

    def start(self, wait=True, port=0):
        self.log = open(self.folder / "serve.log", "ab")
        self.process = subprocess.Popen([self.program, "serve", self.project, "--port", str(port), *self.arguments], cwd=self.folder,
                                        stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=self.log, **self.options)
        line = self.process.stdout.readline().decode()
        if not line:
            return self
        self.port = int(re.search(r":(\d+)/$", line.strip())[1])
        self.wait_until(lambda: not wait or self.get("/readyz")[0] == 200)
        return self

    def wait_until(self, condition, seconds=100):
        """Waits for an event; where it does not come, says what the service has logged."""
        end = time.monotonic() + seconds
        while not condition():
            assert time.monotonic() < end, self.logged()[-4000:]
            time.sleep(0.02)

    def logged(self):
        return (self.folder / "serve.log").read_text()

    def kill(self):
        self.process.send_signal(signal.SIGKILL)
        self.end()

    def stop(self):
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGINT)
        return self.end()

    def end(self):
        status = self.process.wait(timeout=60)
        self.process.stdout.close()
        self.log.close()
        return status

    def connection(self):
        return http.client.HTTPConnection("127.0.0.1", self.port, timeout=60)

    def request(self, method, path, body=None, headers=None, connection=None):
        """Status, headers, body (JSON where it is)."""
        one = connection or self.connection()
        try:
            one.request(method, path, body, headers or {})
            answer = one.getresponse()
            content = answer.read()
        except ConnectionError as error:  # by a service that has ended, or by one that closes a connection: which, its log says
            time.sleep(0.1)
            error.add_note(f"exit status: {self.process.poll()}; its log ends:\n{self.logged()[-4000:]}")
            raise
        if connection is None:
            one.close()
        if answer.headers.get("Content-Type") == "application/json" and content:
            content = json.loads(content)
        return answer.status, answer.headers, content

    def get(self, path, **headers):
        status, _, content = self.request("GET", path, headers={k.replace("_", "-"): v for k, v in headers.items()})
        return status, content

    def post(self, path, value, connection=None, **headers):
        body = value if isinstance(value, (bytes, str)) else json.dumps(value)
        status, _, content = self.request("POST", path, body, {"Content-Type": "application/json", **headers}, connection)
        return status, content

    def send(self, datum, connection=None):
        return self.post("/v1/measurements", datum, connection)

    def settled(self, records=None, seconds=100):
        """Waits until all that was accepted is in the lines."""
        status = {}

        def done():
            status.update(self.get("/v1/status")[1])
            return status["pending"] == 0 and status["behind"] == 0 and (records is None or status["records"] == records)

        self.wait_until(done, seconds)
        return status

    def states(self):
        return self.get("/v1/states")[1]


class Events:
    """A reader of /v1/events in a thread of its own."""

    def __init__(self, service, query="", **headers):
        self.connection = service.connection()
        self.connection.request("GET", "/v1/events" + query, headers={k.replace("_", "-"): v for k, v in headers.items()})
        self.socket = self.connection.sock  # http.client forgets it where the answer says that it will be the last
        self.answer = self.connection.getresponse()
        self.events = []
        self.thread = threading.Thread(target=self.read, daemon=True)
        self.thread.start()

    def read(self):
        event = {}
        try:
            for line in self.answer:
                line = line.decode().rstrip("\n")
                if line:
                    key, _, value = line.partition(": ")
                    event[key] = value
                elif event:
                    self.events.append(event)
                    event = {}
        except (OSError, ValueError, AttributeError, http.client.HTTPException):
            pass

    def steps(self):
        return [(int(e["id"]), parse_line(e["data"])) for e in list(self.events) if e.get("event") == "step"]

    def wait_for(self, condition, seconds=60):
        end = time.monotonic() + seconds
        while not condition(self):
            assert time.monotonic() < end, f"did not come: {self.events[-3:]}"
            time.sleep(0.01)

    def close(self):
        try:
            self.socket.shutdown(socket.SHUT_RDWR)
        except OSError:
            pass
        self.thread.join(10)


class ServiceCase(Case):
    project_name = "assimilation.toml"
    fixture = "analytic"

    def setUp(self):
        super().setUp()
        rows = read_csv(self.folder / "data.csv")
        self.data = []
        for row in rows:
            if not self.data or self.data[-1]["time"] != float(row["time"]):
                self.data.append({"source": "camera", "session": "s", "seq": len(self.data), "time": float(row["time"]), "values": []})
            self.data[-1]["values"].append(float(row["value"]))

    def serve(self, *arguments, extra="", **options):
        if extra:
            self.project.write_text(self.project.read_text() + "\n[serve]\n" + extra)
        service = Service(self.folder, self.project_name, *arguments, **options)
        self.addCleanup(lambda: service.process and service.process.poll() is None and service.kill())
        return service.start()

    def expect_stored(self, answer, step=None, duplicate=False):
        status, body = answer
        self.assertEqual(status, 200, body)
        self.assertIs(body["accepted"], True)
        self.assertIs(body["duplicate"], duplicate)
        if step is not None:
            self.assertEqual(body["step"], step)

    def expect_error(self, answer, status, kind):
        self.assertEqual(answer[0], status, answer[1])
        self.assertEqual(answer[1]["error"]["type"], kind, answer[1])
        self.assertTrue(answer[1]["error"]["message"])


def make_certificates(folder):
    """An authority `ca.pem` and, signed by it, the certificate of a broker at 127.0.0.1."""
    run = lambda *arguments: subprocess.run(["openssl", *arguments], cwd=folder, check=True, capture_output=True)
    run("req", "-x509", "-newkey", "rsa:2048", "-nodes", "-keyout", "ca.key", "-out", "ca.pem", "-days", "2", "-subj", "/CN=authority of a test")
    run("req", "-newkey", "rsa:2048", "-nodes", "-keyout", "broker.key", "-out", "broker.csr", "-subj", "/CN=127.0.0.1")
    (folder / "names").write_text("subjectAltName=IP:127.0.0.1\n")
    run("x509", "-req", "-in", "broker.csr", "-CA", "ca.pem", "-CAkey", "ca.key", "-CAcreateserial", "-out", "broker.pem", "-days", "2", "-extfile", "names")


def packet(kind, body):
    """Of MQTT."""
    length, left = b"", len(body)
    while True:
        left, digit = divmod(left, 128)[0], left % 128
        length += bytes([digit | (0x80 if left else 0)])
        if not left:
            return bytes([kind]) + length + body


def text(value):
    return len(value).to_bytes(2, "big") + value


class Broker:
    """Debian's Mosquitto at a free port; with `password`, of the user `gauge`, it speaks TLS with the certificates of `make_certificates`."""

    def __init__(self, folder, password=None):
        self.folder, self.password = folder, password
        access = "allow_anonymous true\n"
        if password:
            subprocess.run(["mosquitto_passwd", "-b", "-c", str(folder / "passwords"), "gauge", password], check=True, capture_output=True)
            os.chmod(folder, 0o755)  # Mosquitto may give up being root before it reads
            for name in ("passwords", "ca.pem", "broker.pem", "broker.key"):
                os.chmod(folder / name, 0o644)
            access = f"password_file {folder}/passwords\ncafile {folder}/ca.pem\ncertfile {folder}/broker.pem\nkeyfile {folder}/broker.key\n"
        for _ in range(10):
            if self.started(f"{access}user root\nlog_dest stderr\n"):
                return
        raise AssertionError((folder / "mosquitto.log").read_text())

    def started(self, options):
        """Starts Mosquitto at a port that was free just now; False if another program took it meanwhile: then it ends."""
        with socket.socket() as one:
            one.bind(("127.0.0.1", 0))
            self.port = one.getsockname()[1]
        (self.folder / "mosquitto.conf").write_text(f"listener {self.port} 127.0.0.1\n{options}")
        program = shutil.which("mosquitto") or "/usr/sbin/mosquitto"
        with open(self.folder / "mosquitto.log", "w") as log:
            self.process = subprocess.Popen([program, "-c", str(self.folder / "mosquitto.conf")], stdin=subprocess.DEVNULL,
                                            stdout=log, stderr=log)
        while self.process.poll() is None:
            if " running" in (self.folder / "mosquitto.log").read_text():
                return True
            time.sleep(0.02)
        return False

    def listen(self, topic):
        """A queue of the payloads that are published at a topic from now on; of a broker without a password."""
        one = socket.create_connection(("127.0.0.1", self.port))
        stream = one.makefile("rb")
        one.sendall(packet(0x10, text(b"MQTT") + b"\x04\x02\x00\x00" + text(b"listener%d" % time.monotonic_ns())))
        assert stream.read(4)[:1] == b"\x20"
        one.sendall(packet(0x82, b"\x00\x01" + text(topic.encode()) + b"\x00"))
        assert stream.read(5)[:1] == b"\x90"
        payloads = queue.Queue()

        def read():
            while first := stream.read(1):
                length, shift = 0, 0
                while (digit := stream.read(1)[0]) & 0x80:
                    length, shift = length | (digit & 0x7F) << shift, shift + 7
                body = stream.read(length | digit << shift)
                if first[0] >> 4 == 3:
                    payloads.put(body[2 + int.from_bytes(body[:2], "big"):])

        threading.Thread(target=read, daemon=True).start()
        return payloads

    def publish(self, topic, payload, retain=False):
        """One message of QoS 1; returns when the broker has it."""
        answer = lambda: b"".join(one.recv(1) for _ in range(4))
        with contextlib.ExitStack() as stack:
            one = stack.enter_context(socket.create_connection(("127.0.0.1", self.port)))
            flags, more = b"\x02", b""
            if self.password:
                one = stack.enter_context(ssl.create_default_context(cafile=self.folder / "ca.pem").wrap_socket(one, server_hostname="127.0.0.1"))
                flags, more = b"\xc2", text(b"gauge") + text(self.password.encode())
            one.sendall(packet(0x10, text(b"MQTT") + b"\x04" + flags + b"\x00\x3c" + text(b"sender") + more))
            assert answer()[:1] == b"\x20"
            one.sendall(packet(0x33 if retain else 0x32, text(topic.encode()) + b"\x00\x01" + payload))
            assert answer()[:1] == b"\x40"

    def stop(self):
        self.process.terminate()
        self.process.wait(10)


def comparable(line):
    """A line without what depends on when and how it was computed."""
    return {k: v for k, v in line.items() if k not in ("elapsed_us", "wall_clock", "event", "received_at", "site", "data")}
