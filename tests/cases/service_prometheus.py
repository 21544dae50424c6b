"""Metrics, dashboard and alerts of `knothe serve`, judged by a real Prometheus; skipped where Debian's is not installed."""
import json
import os
import shutil
import socket
import subprocess
import sys
import time
import unittest
import urllib.parse
import urllib.request

from service_support import ServiceCase
from support import REPOSITORY, exit_status

PROMETHEUS, PROMTOOL = (shutil.which(name) for name in ("prometheus", "promtool"))


def expressions(value):
    """What the panels of the Grafana file ask for."""
    if isinstance(value, dict):
        yield from ([value["expr"]] if "expr" in value else [])
        for entry in value.values():
            yield from expressions(entry)
    elif isinstance(value, list):
        for entry in value:
            yield from expressions(entry)


class Prometheus:
    """Scrapes a service every 0.5 s and evaluates the alerts of deploy/ as often."""

    def __init__(self, folder, target):
        shutil.copy(REPOSITORY / "deploy" / "alerts.yml", folder / "alerts.yml")
        (folder / "prometheus.yml").write_text(
            "global: { scrape_interval: 500ms, evaluation_interval: 500ms }\nrule_files: [alerts.yml]\n"
            f"scrape_configs:\n  - job_name: knothe\n    static_configs: [{{ targets: ['127.0.0.1:{target}'] }}]\n")
        with socket.socket() as one:
            one.bind(("127.0.0.1", 0))
            self.port = one.getsockname()[1]
        with open(folder / "prometheus.log", "w") as log:
            self.process = subprocess.Popen(
                [PROMETHEUS, f"--config.file={folder}/prometheus.yml", f"--storage.tsdb.path={folder}/prometheus",
                 f"--web.listen-address=127.0.0.1:{self.port}"], cwd=folder, stdin=subprocess.DEVNULL, stdout=log, stderr=log)

    def ask(self, path, **query):
        try:
            with urllib.request.urlopen(f"http://127.0.0.1:{self.port}/api/v1/{path}?{urllib.parse.urlencode(query)}", timeout=10) as answer:
                return json.load(answer)["data"]
        except OSError:
            return {}  # not there yet

    def wait_for(self, what, found, seconds=60):
        end = time.monotonic() + seconds
        while not found():
            assert time.monotonic() < end, f"did not come: {what}"
            time.sleep(0.1)

    def stop(self):
        self.process.terminate()
        self.process.wait(30)


@unittest.skipUnless(PROMETHEUS and PROMTOOL, "the Debian package prometheus is not installed")
class Test(ServiceCase):
    def test_promtool_finds_nothing_to_say(self):
        service = self.serve(extra='[serve.notify]\nwebhook = "http://127.0.0.1:1/"\n')
        for datum in self.data[:3]:
            service.send(datum)
        service.settled(3)
        checked = subprocess.run([PROMTOOL, "check", "metrics"], input=service.get("/metrics")[1], capture_output=True)
        self.assertEqual((checked.returncode, checked.stdout, checked.stderr), (0, b"", b""))
        checked = subprocess.run([PROMTOOL, "check", "rules", REPOSITORY / "deploy" / "alerts.yml"], capture_output=True)
        self.assertEqual(checked.returncode, 0, checked.stderr)

    def test_every_panel_has_data_and_an_injected_bias_raises_an_alert(self):
        service = self.serve(extra="budget = 60.0\nstale_after = 3600.0\n")
        for datum in self.data[:3]:
            service.send(datum)
        service.settled(3)
        prometheus = Prometheus(self.folder, service.port)
        self.addCleanup(prometheus.stop)
        dashboard = json.loads((REPOSITORY / "deploy" / "grafana.json").read_text())
        site = [entry for entry in dashboard["templating"]["list"] if entry["name"] == "site"]
        self.assertEqual([entry["query"] for entry in site], ["label_values(knothe_state, site)"])
        asked = [text.replace("$site", "assimilation") for text in expressions(dashboard["panels"])]
        self.assertGreater(len(asked), 15)
        for text in asked:
            prometheus.wait_for(text, lambda: prometheus.ask("query", query=text).get("result"))
        firing = lambda: {alert["labels"]["alertname"] for alert in prometheus.ask("alerts").get("alerts", []) if alert["state"] == "firing"}
        self.assertEqual(firing(), set())
        shifted = [value + (3e-5 if k % 2 else -3e-5) for k, value in enumerate(self.data[3]["values"])]
        service.send(self.data[3] | {"values": shifted})
        prometheus.wait_for("the alert", lambda: "KnotheBiased" in firing())


if __name__ == "__main__":
    sys.exit(exit_status(unittest.main(exit=False, verbosity=2).result))
