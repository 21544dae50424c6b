"""What the how-to pages tell people to type at a running service, typed at one: each block by bash, at the port of the test. Only what
stands for the reader's own is replaced: the numbers of data and steps, and the identifier of an alarm."""
import json
import pathlib
import re
import shutil
import subprocess
import sys
import textwrap
import unittest

from service_logbook import Webhook
from service_support import ServiceCase
from support import KNOTHE, REPOSITORY

for needed in ("bash", "curl", "sqlite3"):
    if shutil.which(needed) is None:
        print(f"skipped: there is no {needed} here")
        sys.exit(77)


class Test(ServiceCase):
    def begin(self, extra=""):
        self.project_name = "beam.toml"
        shutil.copy(self.folder / "assimilation.toml", self.project)
        self.edit('"model.h5"', '"beam.h5"')
        shutil.copy(self.folder / "model.h5", self.folder / "beam.h5")
        self.service = self.serve(extra=extra)
        for datum in self.data:
            datum.update(source="camera", session="test-1")

    def send(self, *numbers):
        for k in numbers:
            self.assertEqual(self.service.send(self.data[k])[0], 200)
        self.service.settled()

    def blocks(self, page):
        """The blocks of commands of a page, in their order."""
        text = (REPOSITORY / f"docs/how-to/{page}.md").read_text()
        return [textwrap.dedent(block) for block in re.findall(r"^ *```(?:sh|bash)\n(.*?)^ *```$", text, re.M | re.S)]

    def typed(self, block, **replaced):
        """Types a block; the last line that it printed, as JSON where it is that."""
        for old, new in replaced.items():
            self.assertIn(old := old.lstrip("_"), block)
            block = re.sub(rf"\b{old}\b", str(new), block)
        path = f"{pathlib.Path(KNOTHE).parent}:/usr/bin:/bin"
        done = subprocess.run(["bash", "-euo", "pipefail", "-c", block.replace(":8080", f":{self.service.port}")], cwd=self.folder,
                              env={"PATH": path}, capture_output=True, text=True, timeout=120)
        self.assertEqual(done.returncode, 0, f"{block}\n{done.stdout}{done.stderr}")
        last = done.stdout.strip().splitlines()[-1] if done.stdout.strip() else ""
        return json.loads(last) if last.startswith("{") else last

    def test_withdraw(self):
        self.begin()
        self.send(*range(8))
        wrong = self.data[8] | {"values": [value + 0.05 for value in self.data[8]["values"]]}
        self.service.send(wrong)
        self.service.settled()
        keys, withdraw, quarantine = self.blocks("withdraw")
        self.assertRegex(self.typed(keys), r"^camera\|test-1\|8\|")
        self.assertEqual(self.typed(withdraw, _39=5), {"withdrawn": True, "step": 5})
        self.service.settled()
        self.assertEqual(self.service.send(self.data[5])[1]["replacement"], True)
        listed, release = quarantine.split("\n", 1)
        self.assertEqual([entry["seq"] for entry in self.typed(listed)["quarantined"]], [8], self.typed(listed))
        self.assertIs(self.typed(release, _41=8)["accepted"], True)
        self.service.settled()
        self.assertEqual(self.typed(listed)["quarantined"], [])

    def test_alarms(self):
        hook = Webhook()
        self.addCleanup(hook.stop)
        self.begin(extra=f'[serve.notify]\nwebhook = "{hook.url}"\n')
        test, acknowledge, switch_off, note = self.blocks("alarms")
        self.typed(f"{test.strip()} || [ $? = 1 ]")  # the clock of this machine may not be synchronised
        self.assertIn("test", json.dumps(hook.accepted[-1][1]))
        self.send(0, 1)
        self.service.send(self.data[2] | {"values": [value + 0.05 for value in self.data[2]["values"]]})
        self.service.settled()
        alarm, *_ = self.service.get("/v1/alarms")[1]["alarms"]
        self.assertEqual(self.typed(acknowledge, _4294967298=alarm["id"])["by"], "Ada")
        self.assertEqual(self.service.get("/v1/alarms")[1]["alarms"][0]["acknowledged"]["comment"], "grip has slipped")
        self.typed(switch_off, _57=4)
        self.typed(note, _61=4)
        kinds = [entry["kind"] for entry in self.service.get("/v1/logbook")[1]["logbook"]]
        self.assertEqual(kinds, ["acknowledgement", "sensor_off", "note"])
        self.send(3, 4)

    def test_next_specimen(self):
        self.begin()
        self.send(0, 1)
        begin, back, _ = self.blocks("next-specimen")  # the last is run by population.py
        self.typed(begin)
        self.service.wait_until(lambda: self.service.get("/v1/status")[1]["test"] == "specimen-2")
        self.send(0, 1, 2)
        self.typed(back.replace("specimen-1", ""))
        self.service.wait_until(lambda: self.service.get("/v1/status")[1].get("test", "") == "")
        self.assertEqual(len(self.service.states()), 2)

    def test_back_up(self):
        self.begin()
        self.send(*range(4))
        (self.folder / "backup").mkdir()
        copy, check, recover, export = (block.replace("/backup", "backup") for block in self.blocks("back-up"))
        self.typed(copy)
        self.typed(check)
        self.service.kill()
        self.typed(recover)
        self.typed(export)
        self.assertTrue((self.folder / "beam.csv").stat().st_size > 100 and (self.folder / "results/steps.jsonl").exists())


if __name__ == "__main__":
    unittest.main()
