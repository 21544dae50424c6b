"""What docs/how-to/send-measurements.md shows, against a running service: the block for Crappy, on a stand-in for its base class
(Crappy itself is not needed), and LabVIEW's request and function."""
import http.server
import json
import math
import os
import re
import socket
import sys
import threading
import types
import unittest

from documentation import blocks_of, free_port
from service_support import Service, ServiceCase
from support import REPOSITORY, exit_status, python_with, read_csv, write_csv

PAGE = REPOSITORY / "docs/how-to/send-measurements.md"
NAMES = ("gauge", "reaction_force")


class Block:
    """crappy.blocks.Block as far as a block without outputs needs it: `links` holds what has come since the last loop, of each link."""

    def __init__(self):
        self.freq, self.links = None, []

    def recv_all_data_raw(self):
        chunks, self.links = self.links, []
        return chunks


def module_of(name):
    """A file of the page, as a module."""
    source, = (text for language, text in blocks_of(PAGE) if language == "py" and text.startswith(f"# {name}"))
    module = types.ModuleType(name)
    exec(compile(source, name, "exec"), module.__dict__)
    return module


class Test(ServiceCase):
    def setUp(self):
        super().setUp()
        (self.folder / "data.csv").unlink()
        write_csv(self.folder / "data.csv", [{"time": "0.25", "sensor": name, "x": "", "y": "", "z": "", "component": name, "value": value, "std": std}
                                             for name, value, std in zip(NAMES, (1e-6, 100.0), (2e-5, 60.0))])
        self.edit('data = "data.h5"', '[data]\nfile = "data.csv"\n[data.sensors.gauge]\nkind = "strain"\nfrom = [-0.03, 0.0, 0.0]\nto = [0.03, 0.05, 0.0]')
        self.edit('results = "results/"\n', "")
        self.service, self.port = Service(self.folder, self.project_name), free_port()
        self.addCleanup(lambda: self.service.process.poll() is None and self.service.kill())
        self.service.start(port=self.port)
        self.address = f"http://127.0.0.1:{self.port}"

    def stored(self):
        """[(time, value or None)] of each sensor."""
        self.service.settled()
        self.expect(0, "export", "assimilation.journal", "-o", "export.csv")
        found = {name: [] for name in NAMES}
        for row in read_csv(self.folder / "export.csv"):
            found[row["sensor"]].append((float(row["time"]), float(row["value"]) if row["value"] else None))
        return found

    def test_the_block_for_crappy_sends_each_time_once_at_its_own_rates(self):
        if python_with("numpy") is None:
            self.skipTest("no python3 with numpy here")
        sys.modules["crappy"] = types.SimpleNamespace(blocks=types.SimpleNamespace(Block=Block))
        block = module_of("knothe_block.py").Knothe(self.address, "beam-1", 6.0, {"gauge": "e", "reaction_force": "F(N)"})
        block.prepare()
        block.loop()  # nothing has come
        ticks = lambda first, last, every: [round(k * every, 9) for k in range(round(first / every), round(last / every))]
        for second in range(7):
            if second == 3:
                self.service.kill()
            # The gauge begins late.
            times = {"F(N)": ticks(second, second + 1, 0.1), "e": ticks(max(second, 0.8), second + 1, 0.04)}
            block.links = [{"t(s)": t, label: [(20.0 if label == "F(N)" else 1e-6) * x for x in t]} for label, t in times.items()] + [{}]
            block.loop()
            if second == 4:
                self.service.start(port=self.port)
        block.loop()
        found, moments = self.stored(), [6.0 * (k + 1) / 12 for k in range(12)]
        self.assertEqual([round(6 * t, 9) for t, _ in found["gauge"]], moments)
        for (_, force), (_, strain), moment in zip(found["reaction_force"], found["gauge"], moments):
            self.assertAlmostEqual(force, 20 * moment, places=9)
            if moment < 0.8:
                self.assertIsNone(strain)
            else:
                self.assertAlmostEqual(strain, 1e-6 * moment, places=15)
        block.times, block.seq = [0.123], 0
        with self.assertRaisesRegex(RuntimeError, "0.123"):
            block.loop()

    def test_what_labview_sends_is_stored(self):
        request, = (text for language, text in blocks_of_all(PAGE) if language == "http")
        head, body = request.strip().split("\n\n")
        self.assertEqual(int(re.search(r"Content-Length: (\d+)", head)[1]), len(body))
        formatted, = (text for language, text in blocks_of_all(PAGE) if language == "text")
        self.assertTrue(formatted.startswith("%.;"))  # LabVIEW's own: a decimal point
        datum = json.loads(formatted.strip()[3:] % ("beam-1", 0, 0.25, 1.5e-6, 480.25))
        self.assertEqual(datum, json.loads(body))
        for duplicate in (False, True):
            with socket.create_connection(("127.0.0.1", self.port)) as client:
                client.sendall((head.replace("\n", "\r\n") + "\r\n\r\n" + body).encode())
                answer = client.recv(65536).decode()
            self.assertEqual(answer.split()[1], "200")
            self.assertIs(json.loads(answer.split("\r\n\r\n")[1])["duplicate"], duplicate)
        self.assertEqual(self.stored(), {"gauge": [(0.25, 1.5e-6)], "reaction_force": [(0.25, 480.25)]})

    def test_the_function_for_labviews_python_node_says_what_to_do(self):
        store = module_of("knothe_labview.py").store
        datum = ("", "beam-1", 3, 0.5, [math.nan, 900.0])
        self.assertEqual(store(self.address, *datum), "stored")
        self.assertEqual(store(self.address, *datum), "stored")
        self.assertIn("refused: ", store(self.address, "", "beam-1", 3, 0.5, [0.0, 900.0]))
        self.assertRegex(store(self.address, "", "beam-1", 4, 0.123, [0.0, 900.0]), "refused: .*0.123")
        self.service.kill()
        self.assertIn("again: ", store(self.address, *datum))
        self.service.start(port=self.port)
        self.assertEqual(store(self.address, *datum), "stored")
        self.assertEqual(self.stored(), {"gauge": [(0.5, None)], "reaction_force": [(0.5, 900.0)]})

    def test_only_what_may_succeed_is_sent_again(self):
        """The page's rule, and that both functions follow it: 501 is of the request, as 400 to 499 are."""
        if python_with("numpy") is None:
            self.skipTest("no python3 with numpy here")
        rule = dict(re.findall(r"^   \| (.*?) \| (.*?) \|$", PAGE.read_text(), re.M))
        self.assertIn("rejected", rule["400 to 499, or 501"])
        self.assertIn("again", rule["none, or 500 to 599 except 501"])

        class Refusing(http.server.BaseHTTPRequestHandler):
            def do_POST(self):
                self.rfile.read(int(self.headers["Content-Length"]))
                body = b'{"error":{"type":"X","message":"no"}}'
                self.send_response(self.server.status)
                self.send_header("Content-Length", str(len(body)))
                self.end_headers()
                self.wfile.write(body)

            def log_message(self, *_):
                pass

        server = http.server.HTTPServer(("127.0.0.1", 0), Refusing)
        threading.Thread(target=server.serve_forever, daemon=True).start()
        self.addCleanup(server.shutdown)
        sys.modules["crappy"] = types.SimpleNamespace(blocks=types.SimpleNamespace(Block=Block))
        store, address = module_of("knothe_labview.py").store, f"http://127.0.0.1:{server.server_port}"
        block = module_of("knothe_block.py").Knothe(self.address, "beam-1", 6.0, {"gauge": "e"})
        block.prepare()
        block.address, block.links = address, [{"t(s)": [0.0, 1.0], "e": [0.0, 1.0]}]
        for server.status in (400, 409, 411, 415, 501):
            self.assertEqual(store(address, "", "s", 0, 0.5, [0.0, 0.0]), "refused: no")
            with self.assertRaises(RuntimeError):
                block.loop()
        for server.status in (500, 502, 503, 504, 507):
            self.assertEqual(store(address, "", "s", 0, 0.5, [0.0, 0.0]), "again: no")
            block.loop()
            self.assertEqual(block.seq, 0)


def blocks_of_all(page):
    """Those in lists too, which are indented."""
    for found in re.finditer(r"^( *)```(\w*)\n(.*?)^\1```$", page.read_text(), re.MULTILINE | re.DOTALL):
        yield found[2], re.sub(f"(?m)^{found[1]}", "", found[3])


if __name__ == "__main__":
    if python_with("numpy") not in (None, sys.executable):  # which Crappy needs
        os.execv(python_with("numpy"), [python_with("numpy"), *sys.argv])
    sys.exit(exit_status(unittest.main(exit=False).result))
