"""Files that knothe 0.1.0 wrote (made_by_0.1.0/) are read for ever: model, measurements, journal, results folder.

What 0.1.0 printed of them stands beside them: numbers agree as far as maps of another build do.
"""
import shutil
import unittest

from service_support import Service
from support import SOURCE, Case, parse_line

OLD = SOURCE / "made_by_0.1.0"
FOUR = SOURCE / "journal_of_schema_4"  # of the same model: with alarms, a quarantined datum that was withdrawn and replaced


class Test(Case):
    def setUp(self):
        super().setUp()
        shutil.copytree(OLD, self.folder, dirs_exist_ok=True)

    def expect_as_then(self, lines, name):
        then = [parse_line(line) for line in (OLD / name).read_text().splitlines()]
        self.assertEqual(len(lines), len(then))
        for now, before in zip(lines[:-1], then[:-1]):
            self.assertLessEqual(set(before), set(now))
            self.assertEqual((now["step"], now["time"], now["used"]), (before["step"], before["time"], before["used"]))
            for k, mean in enumerate(before["mean"]):
                std = before["covariance"][k][k] ** 0.5
                self.assertAlmostEqual(now["mean"][k], mean, delta=0.01 * std)
                self.assertAlmostEqual(now["covariance"][k][k] ** 0.5, std, delta=0.01 * std)
            self.assertAlmostEqual(now["log_evidence"], before["log_evidence"], delta=0.01)
            for forecast, f in before["forecast"].items():
                if "bridge_residual_rms" in f:
                    continue  # a crack length was Eq. 33, which is `published` now (below)
                self.assertAlmostEqual(now["forecast"][forecast]["mean"], f["mean"], delta=0.02 * f["std"])

    def test_the_model_and_the_measurements_give_the_posterior_that_they_gave(self):
        self.expect_as_then(self.expect(0, "assimilate", "project.toml", "--json", "-o", "new/").lines(), "assimilated.jsonl")

    def test_the_journal_gives_the_posterior_that_it_gave_and_is_not_written_to(self):
        before = (self.folder / "project.journal").read_bytes()
        self.expect_as_then(self.expect(0, "replay", "project.journal", "--project", "project.toml", "--json").lines(), "replayed.jsonl")
        self.assertEqual((self.folder / "project.journal").read_bytes(), before)

    def test_the_journal_is_served_and_a_datum_of_it_withdrawn(self):
        service = Service(self.folder, "project.toml")
        self.addCleanup(lambda: service.process and service.process.poll() is None and service.kill())
        service.start()
        status = service.settled()
        steps = [line["step"] for line in service.states()]
        quarantined = service.get("/v1/quarantine")[1]["quarantined"]
        answer = service.post("/v1/withdraw", {"source": "daq", "session": "a", "seq": 7})
        self.assertEqual(answer, (200, {"withdrawn": True, "step": steps[-1]}))
        service.settled()
        self.assertEqual([line["step"] for line in service.states()], steps[:-1])
        self.assertEqual(service.stop(), 130)
        service.start()
        self.assertEqual(service.settled()["records"], status["records"])
        self.assertEqual([line["step"] for line in service.states()], steps[:-1])
        self.assertEqual(service.get("/v1/quarantine")[1]["quarantined"], quarantined)

    def test_a_journal_of_schema_4_is_read_and_goes_on(self):
        shutil.copy(FOUR / "project.journal", self.folder / "project.journal")
        before = (self.folder / "project.journal").read_bytes()
        lines = self.expect(0, "replay", "project.journal", "--project", "project.toml", "--json").lines()
        self.expect_as_then(lines, FOUR / "replayed.jsonl")
        self.assertEqual((self.folder / "project.journal").read_bytes(), before)
        service = Service(self.folder, "project.toml")
        self.addCleanup(lambda: service.process and service.process.poll() is None and service.kill())
        service.start()
        status = service.settled()
        self.assertEqual((status["records"], status["quarantined"]), (9, 0))
        alarms = service.get("/v1/alarms")[1]["alarms"]
        self.assertEqual([alarm["kind"] for alarm in alarms[:2]], ["threshold", "sensors"])
        self.assertEqual(service.get("/v1/logbook")[1]["logbook"], [])
        self.assertEqual(service.post(f"/v1/alarms/{alarms[0]['id']}/acknowledge", {"by": "Ada"})[0], 200)
        self.assertEqual(service.post("/v1/sensors", {"sensor": 3, "active": False, "by": "Ada"})[0], 200)
        service.settled()
        self.assertEqual(service.stop(), 130)
        again = self.expect(0, "replay", "project.journal", "--project", "project.toml", "--json").lines()
        self.assertEqual([line["mean"] for line in again[:-2]], [line["mean"] for line in lines[:-2]])
        self.assertEqual(again[-2]["missing"], lines[-2]["missing"] + 1)

    def test_the_results_folder_is_reported_and_forecast_from(self):
        self.expect(0, "report", "results", "-o", "report.html")
        (line,) = self.expect(0, "forecast", "project.toml", "--json").lines()
        last = parse_line((OLD / "assimilated.jsonl").read_text().splitlines()[-2])
        self.assertEqual(line["step"], last["step"])
        self.assertAlmostEqual(line["published"]["crack"]["mean"], last["forecast"]["crack"]["mean"], delta=1e-4)


if __name__ == "__main__":
    unittest.main()
