"""`knothe offline`, `model verify` and `simulate` without a model: what the sibling program does."""
import contextlib
import json
import os
import pathlib
import re
import shutil
import signal
import subprocess
import time
import unittest

from support import KNOTHE, REPOSITORY, Case


class Test(Case):
    project_name = "offline.toml"

    def build(self, name="model.h5", *arguments):
        return self.expect(0, "offline", self.project_name, "-o", name, *arguments)

    def parts(self):
        folder = self.folder / "model.h5.parts"
        return list(folder.glob("run-*.h5")) if folder.exists() else []

    def interrupt(self, ready, kept, *arguments, send=os.killpg, number=signal.SIGINT):
        """The words `kept` of what `knothe offline` says that gets a signal once `ready`(): by default Ctrl-C, which reaches the
        whole process group, as from a terminal. Where the look at it came too late, the work being over, it begins again."""
        for _ in range(5):
            with subprocess.Popen([KNOTHE, "offline", self.project_name, "-o", "model.h5", *arguments], cwd=self.folder, stdout=subprocess.PIPE,
                                  stderr=subprocess.PIPE, text=True, start_new_session=True) as process:
                try:
                    while not ready() and process.poll() is None:
                        time.sleep(0.005)
                    if process.poll() is None:
                        send(process.pid, number)
                    _, message = process.communicate(timeout=60)
                finally:
                    process.kill()
            found = re.search(kept, message)
            if found:
                self.assertEqual(process.returncode, 130, message)
                self.assertFalse((self.folder / "model.h5").exists())
                return found
            late = process.returncode == 0 or "9 of 9 runs are kept" in message or "full-order run; nothing of this run is kept" in message
            self.assertTrue(late, f"{process.returncode} {message}")  # the last: of the runs that judge the model
            self.forget()
        self.fail("the signal never found it at work")

    def forget(self):
        """Neither a model nor parts of one."""
        shutil.rmtree(self.folder / "model.h5.parts", ignore_errors=True)
        (self.folder / "model.h5").unlink(missing_ok=True)

    def test_stdout_is_json_lines(self):
        lines = self.build("model.h5", "--json").lines()
        runs = [line for line in lines if "run" in line]
        self.assertEqual(len(runs), 9)
        self.assertEqual([run["resumed"] for run in runs], 9 * [False])
        self.assertTrue(all(run["steps_without_equilibrium"] == [] for run in runs))
        self.assertEqual((lines[-1]["done"], lines[-1]["model"]), (True, "model.h5"))
        self.assertEqual([line for line in lines if "form" in line], [])

    def test_other_numbers_of_modes_are_studied_on_request(self):
        lines = self.build("model.h5", "--study", "--json").lines()
        self.assertEqual({line["form"] for line in lines if "form" in line}, {"canonical", "tree"})

    def test_latin_gives_the_model_that_snapshots_give(self):
        """Two ways to the same solutions: the same forces and openings at the same parameters, but for micrometres and newtons."""
        self.build("snapshots.h5")
        out = self.build("latin.h5", "--method", "latin", "--json").lines()
        stages = [line for line in out if "round" in line]
        self.assertGreater(len(stages), 5)
        self.assertTrue(all(stage["points"] <= 9 and stage["space_modes"] >= stage["working_modes"] for stage in stages))
        self.assertLess(max(stage["correction_m"] for stage in stages if stage["points"] == 9 and stage["last_step"] == 20), 1e-3)
        self.assertEqual((out[-1]["done"], out[-1]["model"]), (True, "latin.h5"))
        self.assertFalse((self.folder / "latin.h5.parts").exists())
        text = self.expect(0, "model", "verify", self.project_name, "latin.h5", "--points", "2", "--json").lines()[-1]
        other = self.expect(0, "model", "verify", self.project_name, "snapshots.h5", "--points", "2", "--json").lines()[-1]
        self.assertAlmostEqual(text["max_error_m"] * 1e6, other["max_error_m"] * 1e6, delta=0.3)
        self.assertAlmostEqual(text["relative_error"], other["relative_error"], delta=1e-3)

    def test_latin_starts_from_a_model_of_few_snapshots(self):
        """The hybrid: the model of four snapshots on the corners, then the whole grid; the elastic start gives the same."""
        text = self.project.read_text()
        self.project.write_text(text.replace("nodes = 3", "nodes = 2").replace("modes = 6", "modes = 4"))
        self.build("corners.h5")
        self.project.write_text(text.replace('method = "snapshots"', 'method = "latin"'))
        elastic = self.build("elastic.h5", "--json").lines()
        hybrid_text = text.replace('method = "snapshots"', 'method = "latin"\nlatin = { start = "corners.h5" }')
        self.project.write_text(hybrid_text)
        hybrid = self.build("hybrid.h5", "--json").lines()
        self.assertLess(sum("round" in line for line in hybrid), sum("round" in line for line in elastic))
        self.assertAlmostEqual(hybrid[-1]["max_error_m"] * 1e6, elastic[-1]["max_error_m"] * 1e6, delta=0.2)
        point = ["--at", "Y0=0.93,Ad=1.17", "--step", "14", "--json"]
        values = [self.expect(0, "model", "evaluate", name, *point).lines()[-1]["values"] for name in ("elastic.h5", "hybrid.h5")]
        self.assertLess(max(abs(a - b) for a, b in zip(*values)), 3e-7)
        self.project.write_text(hybrid_text.replace("element = 0.01", "element = 0.02"))
        self.expect(4, "offline", self.project_name, "-o", "model.h5",
                    stderr=["corners.h5: LATIN-PGD cannot start from this model", "another mesh"])
        self.project.write_text(hybrid_text.replace("corners.h5", "corner.h5"))
        self.expect(4, "offline", self.project_name, "-o", "model.h5", stderr="corner.h5")

    def test_latin_interrupted_goes_on_from_there(self):
        """That the solution is the same to the bit wherever it stops is in latin_pgd_test.cpp; here a signal and the message."""
        text = self.project.read_text().replace("steps = 20", "steps = 400")  # long enough for the signal to find it at work
        self.project.write_text(text[:text.index("[simulate]")])

        def begun():
            if not (self.folder / "model.h5.parts").exists():  # made when LATIN begins
                return False
            time.sleep(0.05)  # some steps
            return True

        kept = self.interrupt(begun, r"at step (\d+) of 400; steps before it are kept in model.h5.parts/latin-", "--method", "latin")
        self.assertEqual(list(self.folder.glob("**/*.tmp*")), [])
        self.assertEqual(len(list((self.folder / "model.h5.parts").iterdir())), 1)
        self.assertIn(f"LATIN-PGD goes on from step {kept.group(1)} of 400", self.build("model.h5", "--method", "latin").err)
        self.assertFalse((self.folder / "model.h5.parts").exists())
        self.build("whole.h5", "--method", "latin")
        self.assertEqual((self.folder / "model.h5").read_bytes(), (self.folder / "whole.h5").read_bytes())

    def test_a_box_without_equilibrium_is_told(self):
        """Where the law has no stress for a strain nothing is begun; where no equilibrium is found the
        point is named, and the model is whole."""
        text = self.project.read_text()
        text = text[:text.index("[simulate]")].replace("nodes = 3", "nodes = 2").replace("modes = 6", "modes = 3")
        for method in ("snapshots", "latin"):
            self.project.write_text(text.replace("upper = 1.2", "upper = 1.5").replace(
                "layers = 1 }", 'layers = 1 }\ndamage = { regularisation = "crack-band" }'))
            self.expect(3, "offline", self.project_name, "-o", "model.h5", "--method", method,
                        stderr=["at Y0 = 324 J/m3, Ad = 0.003375 m3/J the crack band needs cells of at most", "a smaller box of parameters"])
            self.assertEqual([path.name for path in self.folder.glob("model.h5*")], [])
            self.project.write_text(text.replace("lower = 0.8", "lower = 1e-6", 1).replace("upper = 1.2", "upper = 1e6")
                                    .replace("steps = 20", "steps = 2").replace("element = 0.01", "element = 0.02"))
            self.assertRegex(self.build("model.h5", "--method", method).err,
                             r"warning: at parameters \(1e-06, 1e\+06\) .*; see the output equilibrium_residual of the model")
            self.expect(0, "model", "evaluate", "model.h5", "--at", "Y0=1e-6,Ad=1e6", "--step", "1")
            shutil.rmtree(self.folder / "model.h5.parts", ignore_errors=True)
            (self.folder / "model.h5").unlink()

    def test_mesh_study_tells_how_much_the_meshes_differ(self):
        """On coarse meshes and in few steps; the study itself is in docs/explanation/mechanics.md."""
        lines = self.expect(0, "model", "mesh-study", self.project_name, "--elements", "0.02,0.01", "--laws", "none,crack-band",
                            "--steps", "8", "-o", "study.html", "--json").lines()
        self.assertEqual([(line["law"], line["element_m"]) for line in lines if "dofs" in line],
                         [("none", 0.02), ("none", 0.01), ("crack-band", 0.02), ("crack-band", 0.01)])
        gap = {line["law"]: line["curve"] for line in lines if "from_m" in line}
        self.assertLess(gap["crack-band"], 0.7 * gap["none"])
        self.assertIn("crack band", (self.folder / "study.html").read_text())
        self.expect(2, "model", "mesh-study", self.project_name, "--laws", "crackband", stderr="crack-band")

    def test_regularised_laws_do_not_depend_on_the_mesh(self):
        """The study of docs/explanation/mechanics.md between the two finest meshes, label nightly: less than 3 % for load curve and crack."""
        shutil.copy(REPOSITORY / "examples/beam/beam.toml", self.folder)
        lines = self.expect(0, "model", "mesh-study", "beam.toml", "--elements", "0.0025,0.00125", "--laws", "crack-band,gradient",
                            "--steps", "50", "--json", timeout=1700).lines()
        gaps = {line["law"]: line for line in lines if "from_m" in line}
        self.assertEqual(sorted(gaps), ["crack-band", "gradient"])
        for law, gap in gaps.items():
            self.assertLess(max(gap["curve"], gap["crack_length"]), 0.03, (law, gap))

    def test_modes_and_grid_are_found_by_their_error(self):
        text = (self.folder / self.project_name).read_text()
        self.project.write_text(text.replace("[offline]", "[offline]\nadaptive = { error = 3e-7, grid_error = 5e-7, runs = 40 }", 1))
        built = self.build("model.h5", "--json")
        grid = [float(x) for x in re.findall(r"off the grid at most ([0-9.]+) µm", built.err)]
        modes = re.findall(r"(\d+) modes: at most ([0-9.]+) µm", built.err)
        self.assertTrue(len(grid) > 1 and grid[-1] <= 0.5 < grid[0], built.err)
        self.assertLessEqual(float(modes[-1][1]), 0.3)
        self.assertTrue(all(float(error) > 0.3 for _, error in modes[:-1]))

    def test_modes_are_found_by_the_shift_of_the_posterior(self):
        text = self.project.read_text().replace("[offline]", "[offline]\nadaptive = { posterior_shift = 0.2 }", 1)
        text = text.replace("nodes = 3", "nodes = 4").replace("noise_std = 1e-15", "noise_std = 1e-6").replace("Y0 = 0.8, Ad = 1.2", "Y0 = 0.95, Ad = 1.1")
        self.project.write_text(text)
        self.expect(3, "offline", self.project_name, "-o", "model.h5", stderr=["posterior_shift", "[parameters]"])
        self.assertEqual(self.parts(), [])  # told before anything is computed
        text += '\n[parameters]\nY0 = { prior = "normal", mean = 1.0, std = 0.1 }\nAd = { prior = "normal", mean = 1.0, std = 0.1 }\n'
        self.project.write_text(text)
        built = self.build("model.h5", "--study", "--json")
        tried = [(int(m), float(shift)) for m, shift in re.findall(r"(\d+) modes: posterior shift ([0-9.]+) std", built.err)]
        self.assertTrue(tried[-1][1] <= 0.2 and all(shift > 0.2 for _, shift in tried[:-1]), built.err)
        (info,) = self.expect(0, "model", "info", "model.h5", "--json").lines()
        self.assertEqual(info["parameter_modes"], tried[-1][0])
        # The project's truth is one of the three that judged.
        (line,) = [line for line in built.lines() if line.get("form") == "tree" and line["modes"] == tried[-1][0]]
        self.assertLessEqual(line["shift_of_mean"]["worst"], tried[-1][1] + 5e-4)
        (self.folder / "model.h5").unlink()
        self.project.write_text(text.replace("posterior_shift = 0.2", "posterior_shift = 1e-9"))
        missed = self.run_knothe("offline", self.project_name, "-o", "model.h5")
        self.assertEqual(missed.status, 6)
        self.assertIn("where 1e-09 std is wanted: ask for less, or give \"modes\"", missed.err)
        self.assertFalse((self.folder / "model.h5").exists())

    def test_a_project_whose_data_are_pictures_has_its_model_too(self):
        """No dofs are chosen there, so there are no data to judge a shift of the posterior by."""
        text = re.sub(r"dofs = .*\nnoise_std = .*\n", "", self.project.read_text())
        prior = '{ prior = "normal", mean = 1.0, std = 0.1 }'
        text = text.replace("[offline]", f"[parameters]\nY0 = {prior}\nAd = {prior}\n\n[offline]", 1)
        self.project.write_text(text + "\n[simulate.camera]\nwidth = 400\nheight = 200\n\n[dic]\nscale = 5e-4\n")
        lines = self.build("model.h5", "--json").lines()
        self.assertTrue(lines[-1]["done"])
        self.assertFalse([line for line in lines if "error_of_std" in line])

    def test_a_sparse_grid_computes_few_points_and_keeps_them(self):
        text = self.project.read_text()
        self.project.write_text(text.replace("[offline]", "[offline]\nsparse_level = 1", 1))
        lines = self.build("model.h5", "--json").lines()
        runs = [line["run"] for line in lines if "run" in line]
        self.assertEqual(runs, [[0.8, 1.0], [1.0, 0.8], [1.0, 1.0], [1.0, 1.2], [1.2, 1.0]])
        self.assertLess(self.expect(0, "model", "verify", self.project_name, "model.h5", "--points", "2", "--json").lines()[-1]["relative_error"], 0.1)
        self.project.write_text(text.replace("[offline]", "[offline]\nsparse_level = 1\nadaptive = { grid_error = 1e-9, runs = 9 }", 1))
        risen = self.build("model.h5")
        self.assertIn("9 full-order runs (5 reused from an earlier call)", risen.out)
        self.assertIn("more than [offline.adaptive] runs = 9", risen.err)
        self.project.write_text(text.replace('method = "snapshots"', 'method = "latin"\nsparse_level = 1', 1))
        self.expect(3, "offline", self.project_name, "-o", "model.h5", stderr="needs method")

    def test_five_parameters_are_assimilated(self):
        """examples/beam_five on elements of 20 mm: the model says what the truth was, and its correlations are told."""
        text = (REPOSITORY / "examples/beam_five/beam_five.toml").read_text()
        text = text.replace("element = 0.01", "element = 0.02").replace("steps = 30", "steps = 12").replace("sparse_level = 4", "sparse_level = 2")
        (self.folder / "beam_five.toml").write_text(text)
        self.expect(0, "offline", "beam_five.toml", "-o", "beam_five.h5")
        self.expect(0, "simulate", "beam_five.toml", "--model", "beam_five.h5", "-o", "data.h5")
        last = self.expect(0, "assimilate", "beam_five.toml", "--json").lines()[-2]
        truth = (1.0, 1.0, 1.03, 0.8, 0.5)
        for i, true in enumerate(truth):
            self.assertLess(abs(last["mean"][i] - true), 4 * last["covariance"][i][i] ** 0.5, (i, last))
        self.assertLess(last["covariance"][4][4] ** 0.5, 0.25)  # the load's offset is found: its prior has 0.5

    def mpirun(self, *words, **options):
        """A job of two ranks, not yet waited for."""
        if shutil.which("mpirun") is None:
            self.skipTest("no mpirun")
        environment = {**os.environ, "OMPI_ALLOW_RUN_AS_ROOT": "1", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
                       "TMPDIR": str(self.folder)}  # jobs that begin and end at the same time share no folder
        command = ["mpirun", "--oversubscribe", "--mca", "mpi_yield_when_idle", "1", "-np", "2", str(pathlib.Path(KNOTHE).parent / "knothe-offline")]
        return subprocess.Popen([*command, *words], cwd=self.folder, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                                text=True, **options)

    def finish(self, process):
        out, message = process.communicate(timeout=300)
        self.assertEqual(process.returncode, 0, message)
        return out

    def test_ranks_of_an_mpi_job_give_the_same_model(self):
        job = self.mpirun("offline", self.project_name, "-o", "model.h5")
        self.build("serial.h5")
        self.assertEqual(self.finish(job).count("9 full-order runs"), 1)
        self.assertEqual((self.folder / "model.h5").read_bytes(), (self.folder / "serial.h5").read_bytes())

    def test_latin_in_an_mpi_job_is_done_once(self):
        job = self.mpirun("offline", self.project_name, "--method", "latin", "-o", "model.h5")
        self.assertEqual(self.finish(job).count("LATIN-PGD: 9 grid points"), 1)
        self.build("serial.h5", "--method", "latin")
        self.assertEqual((self.folder / "model.h5").read_bytes(), (self.folder / "serial.h5").read_bytes())
        self.assertEqual(self.parts(), [])

    def test_a_rank_that_dies_ends_the_job_and_its_runs_are_kept(self):
        for _ in range(5):
            job = self.mpirun("offline", self.project_name, "-o", "model.h5")
            children = pathlib.Path(f"/proc/{job.pid}/task/{job.pid}/children")
            while not self.parts() and job.poll() is None:
                time.sleep(0.005)
            ranks = children.read_text().split() if job.poll() is None else []
            with contextlib.suppress(ProcessLookupError):
                if ranks:
                    os.kill(int(ranks[-1]), signal.SIGKILL)
            _, message = job.communicate(timeout=60)
            if job.returncode != 0 and not (self.folder / "model.h5").exists():
                break
            self.forget()  # the job was faster than the look at it
        else:
            self.fail("the job was always faster than the look at it")
        self.assertIn("killed", message.lower())
        there = len(self.parts())
        self.assertGreater(there, 0)
        kept = int(re.search(r"9 full-order runs \((\d+) reused", self.build("model.h5").out).group(1))
        self.assertTrue(there <= kept <= 9, (there, kept))  # a process of the other rank may have ended its run a moment later

    def test_one_model_on_two_ranks_is_that_on_one(self):
        text = self.project.read_text()
        self.project.write_text(text.replace("element = 0.01", "element = 0.02").replace("displacement = 4e-4", "displacement = 1.6e-4"))
        words = ("full-order", self.project_name, "--steps", "4", "--json")
        job = self.mpirun(*words)
        serial = self.expect(0, "model", *words, "-o", "field.vtu").lines()
        both = [json.loads(line) for line in self.finish(job).splitlines()]
        self.assertEqual((serial[0]["ranks"], both[0]["ranks"]), (1, 2))
        self.assertEqual([line["step"] for line in both[1:-1]], list(range(4)))
        for one, two in zip(serial[1:-1], both[1:-1]):
            self.assertAlmostEqual(one["force_N"], two["force_N"], delta=1e-4)
            self.assertAlmostEqual(one["crack_mouth_opening_m"], two["crack_mouth_opening_m"], delta=1e-11)
        self.assertGreater(serial[-1]["crack_length_m"], 0.03)
        self.assertAlmostEqual(serial[-1]["crack_length_m"], both[-1]["crack_length_m"], delta=1e-7)
        self.assertIn(b'Name="damage"', (self.folder / "field.vtu").read_bytes())
        self.expect(3, "model", "full-order", self.project_name, "--refinements", "9", stderr="take 0 to 6")

    def test_a_method_that_is_not_there_is_refused(self):
        self.expect(2, "offline", self.project_name, "-o", "m.h5", "--method", "latim", stderr="latin")

    def test_interrupted_it_says_what_is_kept_and_goes_on_from_there(self):
        whole = self.build("whole.h5")
        self.assertIn("9 full-order runs (0 reused", whole.out)
        kept = int(self.interrupt(lambda: len(self.parts()) >= 2, r"interrupted; ([2-8]) of 9 runs are kept in model.h5.parts").group(1))
        self.assertEqual(kept, len(self.parts()))
        (self.folder / "model.h5.parts" / ".run-9.h5.1-0.part").write_text("what a kill in the middle of writing leaves")
        self.assertIn(f"9 full-order runs ({kept} reused from an earlier call)", self.build().out)
        self.assertEqual((self.folder / "model.h5").read_bytes(), (self.folder / "whole.h5").read_bytes())
        for name in ("model.h5", "whole.h5"):  # made, and the runs are no longer needed
            self.assertFalse((self.folder / f"{name}.parts").exists())

    def test_a_signal_to_knothe_alone_ends_its_sibling(self):
        kept = self.interrupt(self.parts, r"interrupted; ([1-8]) of 9 runs are kept", send=os.kill, number=signal.SIGTERM)
        self.assertEqual(int(kept.group(1)), len(self.parts()))

    def test_a_damaged_finished_run_is_computed_again(self):
        self.build("whole.h5")
        kept = int(self.interrupt(lambda: len(self.parts()) >= 3, r"interrupted; ([3-8]) of 9 runs are kept").group(1))
        part = self.parts()[0]
        part.write_bytes(part.read_bytes()[:1000])
        self.assertIn(f"({kept - 1} reused", self.build().out)
        self.assertEqual((self.folder / "model.h5").read_bytes(), (self.folder / "whole.h5").read_bytes())

    def test_the_number_of_processes_does_not_matter(self):
        self.build("two.h5")
        self.edit("processes = 2", "processes = 1")
        self.build("one.h5")
        point = ["--at", "Y0=0.93,Ad=1.17", "--step", "14", "--derivatives", "--json"]
        two, one = [self.expect(0, "model", "evaluate", name, *point).out for name in ("two.h5", "one.h5")]
        self.assertEqual(two, one)

    def test_the_model_agrees_with_the_full_order_solver_at_a_grid_node(self):
        """Data of the full-order model without noise, and of the separated one: within the error that the model states."""
        self.build()
        (info,) = self.expect(0, "model", "info", "model.h5", "--json").lines()
        self.expect(0, "simulate", self.project_name, "-o", "full.h5")
        self.expect(0, "simulate", self.project_name, "--model", "model.h5", "-o", "reduced.h5")
        values = []
        for name in ("full", "reduced"):
            subprocess.run([os.environ["KNOTHE_DATA_TO_CSV"], f"{name}.h5", f"{name}.csv"], cwd=self.folder, check=True)
            lines = (self.folder / f"{name}.csv").read_text().splitlines()[1:]
            self.assertEqual(len(lines), 20 * 20)
            values.append([float(line.split(",")[6]) for line in lines])
        worst = max(abs(a - b) for a, b in zip(*values))
        self.assertLessEqual(worst, info["max_error_m"] + 1e-12)
        self.assertGreater(max(map(abs, values[0])), 1e-4)

    def test_verify_gives_a_line_per_point_and_their_worst(self):
        self.build()
        lines = self.expect(0, "model", "verify", self.project_name, "model.h5", "--points", "2", "--json").lines()
        self.assertEqual(len(lines), 3)
        self.assertTrue(all(0.8 <= p <= 1.2 for line in lines[:2] for p in line["point"]))
        self.assertEqual((lines[2]["done"], lines[2]["points"]), (True, 2))
        self.assertAlmostEqual(lines[2]["max_error_m"], max(line["max_error_m"] for line in lines[:2]), delta=1e-15)
        self.assertLess(lines[2]["relative_error"], 0.05)

    def test_verify_of_another_projects_model_is_refused(self):
        self.build()
        self.edit("steps = 20", "steps = 10")
        self.expect(4, "model", "verify", self.project_name, "model.h5", "--points", "1", stderr=["model.h5", "20 steps", "10"])

    def test_a_project_without_offline_is_told_so(self):
        self.project.write_text('model = "m.h5"\n')
        self.expect(3, "offline", self.project_name, "-o", "m.h5", stderr="[offline]")

    def test_a_model_that_cannot_be_written_is_an_io_error(self):
        (self.folder / "file").write_text("in the way\n")
        self.expect(5, "offline", self.project_name, "-o", "file/model.h5", stderr="file/model.h5")


if __name__ == "__main__":
    unittest.main()
