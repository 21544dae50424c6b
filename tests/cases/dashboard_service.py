"""The page on the real service, in headless Chromium: numbers, gaps, fields, kill -9 and restart. Skipped like dashboard.py."""
import os
import sys
import unittest

from dashboard import run_part
from support import KNOTHE, Case, exit_status


class Test(Case):
    project_name = "beam.toml"
    fixture = "beam"

    def test_numbers_and_restart(self):
        run_part(self, "service", KNOTHE=KNOTHE, KNOTHE_PROJECT=str(self.project))


if __name__ == "__main__":
    sys.exit(exit_status(unittest.main(exit=False).result))
