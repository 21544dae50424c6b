"""What a person types: versions, help, mistakes, a part that is not installed."""
import os
import re
import shutil
import subprocess
import sys
import unittest

from support import KNOTHE, REPOSITORY, Case

COMMANDS = [["check"], ["offline"], ["model", "info"], ["model", "evaluate"], ["model", "import"], ["model", "verify"],
            ["simulate"], ["assimilate"], ["infer"], ["select"], ["dic"], ["serve"], ["reproduce"], ["forecast"], ["report"]]


class Test(Case):
    def test_version_is_the_name_and_three_numbers(self):
        outcome = self.expect(0, "--version")
        self.assertRegex(outcome.out, r"\Aknothe \d+\.\d+\.\d+\n\Z")
        cmake = (REPOSITORY / "CMakeLists.txt").read_text()
        self.assertIn(outcome.out.split()[1], re.search(r"project\(knothe VERSION (\S+)", cmake).group(1))

    def test_every_command_has_help_with_an_example(self):
        for command in COMMANDS:
            with self.subTest(command=command):
                out = self.expect(0, *command, "--help").out
                self.assertIn("Example:\n  knothe " + " ".join(command) + " ", out)

    def test_no_command_is_wrong_usage_and_lists_the_commands_by_task(self):
        listed = self.expect(2, stderr="--help").err
        self.assertEqual(self.expect(0, "help").out, listed)
        known = re.findall(r"^  ([a-z]+) ", self.expect(0, "--help").out.partition("Subcommands:")[2], re.MULTILINE)
        self.assertEqual(sorted(re.findall(r"^  ([a-z]+) ", listed, re.MULTILINE)), sorted(known))
        self.assertRegex(listed, r"\nAssimilate a test\n  assimilate ")

    def test_help_of_a_command_is_a_command_too(self):
        for command in COMMANDS:
            self.assertEqual(self.expect(0, "help", *command).out, self.expect(0, *command, "--help").out)
        self.expect(2, "help", "asimilate", stderr='did you mean "assimilate"?')
        self.assertEqual(self.expect(0, "-V").out, self.expect(0, "--version").out)

    def test_no_line_of_the_help_is_longer_than_people_read(self):
        for command in ([], ["help"], *([*command, "--help"] for command in COMMANDS)):
            outcome = self.run_knothe(*command)
            for line in (outcome.out + outcome.err).splitlines():
                self.assertLessEqual(len(line), 100 if "{" not in line else 140, line)

    def test_an_unknown_option_is_named_with_the_nearest_one(self):
        self.expect(2, "assimilate", "x.toml", "--jsn", stderr=["unknown option --jsn", 'did you mean "--json"?'])
        self.expect(2, "offline", "x.toml", "--outptu=m.h5", stderr=["unknown option --outptu", 'did you mean "--output"?'])

    def test_a_binary_file_is_no_project(self):
        (self.folder / "model.h5").write_bytes(b"\x89HDF\r\n\x1a\n\0\0\0")
        (self.folder / "picture.tif").write_bytes(b"II*\0\0\0\0")
        for name, kind in (("model.h5", " (HDF5)"), ("picture.tif", "")):
            self.expect(3, "assimilate", name, stderr=f"{name}: error: this is a binary file{kind}, not a project file: give the .toml")

    def test_an_unknown_command_is_named_with_the_nearest_one(self):
        self.expect(2, "asimilate", "x.toml", stderr=["asimilate", 'did you mean "assimilate"?'])

    def test_an_unknown_command_of_model_is_named(self):
        self.expect(2, "model", "inof", "x.h5", stderr=["inof", 'did you mean "info"?'])

    def test_help_of_an_unknown_command_is_no_success(self):
        self.expect(2, "asimilate", "--help", stderr='did you mean "assimilate"?')

    def test_what_is_read_is_not_written_over(self):
        for command in (["model", "import", "f", "-o", "./f"], ["simulate", "f", "-o", "f"], ["simulate", "p", "--model", "f", "-o", "f"],
                        ["offline", "f", "-o", "f"]):
            with self.subTest(command=command):
                (self.folder / "f").write_text("precious")
                self.expect(2, *command, stderr="is what the command reads; give another name")
                self.assertEqual((self.folder / "f").read_text(), "precious")

    def test_a_damaged_comparison_is_refused(self):
        (self.folder / "results").mkdir()
        (self.folder / "results" / "comparison.json").write_text("{}")
        self.expect(4, "report", "results", "-o", "r.html", stderr=["comparison.json", "not what `knothe infer --compare` writes"])

    def test_an_unknown_option_is_wrong_usage(self):
        self.expect(2, "assimilate", "x.toml", "--fast", stderr="--fast")

    def test_a_missing_argument_is_wrong_usage(self):
        self.expect(2, "assimilate", stderr="FILE")
        self.expect(2, "offline", "x.toml", stderr="--output")
        self.expect(2, "check", stderr="project file")

    def test_an_unknown_method_is_wrong_usage(self):
        self.expect(2, "assimilate", "x.toml", "--method", "magic", stderr="magic")

    def test_offline_without_its_sibling_says_how_to_get_it(self):
        alone = self.folder / "bin" / "knothe"
        alone.parent.mkdir()
        shutil.copy(KNOTHE, alone)
        environment = dict(os.environ, PATH=str(self.folder / "empty"))
        (self.folder / "p.toml").write_text("")
        for command in (["offline", "p.toml", "-o", "m.h5"], ["model", "verify", "p.toml", "m.h5"], ["simulate", "p.toml", "-o", "d.h5"]):
            with self.subTest(command=command):
                self.expect(1, *command, program=alone, env=environment,
                            stderr=["knothe-offline, which is not installed", "-DKNOTHE_OFFLINE=ON"])

    def test_the_reference_of_options_is_that_of_the_documentation(self):
        reference = (REPOSITORY / "docs" / "reference" / "project-file.md").read_text()
        self.assertEqual(self.expect(0, "check", "--options").out, reference,
                         "make it again: knothe check --options > docs/reference/project-file.md")

    def test_the_fields_of_lines_are_those_of_the_schema_and_of_the_types(self):
        schema = (REPOSITORY / "docs" / "reference" / "lines.schema.json").read_text()
        self.assertEqual(self.expect(0, "check", "--schema").out, schema,
                         "make it again: knothe check --schema > docs/reference/lines.schema.json; scripts/result_types.py")
        made = subprocess.run([sys.executable, REPOSITORY / "scripts" / "result_types.py", "--check"], capture_output=True, text=True)
        self.assertEqual(made.returncode, 0, made.stderr)

    def test_a_full_standard_output_is_an_io_error(self):
        (self.folder / "p.toml").write_text("")
        for arguments in (["check", "--options"], ["check", "p.toml"]):
            with open("/dev/full", "w") as full:
                ended = subprocess.run([KNOTHE, *arguments], cwd=self.folder, stdout=full, stderr=subprocess.PIPE, text=True)
            self.assertEqual(ended.returncode, 5, ended.stderr)
            self.assertIn("standard output", ended.stderr)


if __name__ == "__main__":
    unittest.main()
