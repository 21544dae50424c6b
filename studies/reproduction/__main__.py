"""The published study (Rubio, Chamoin, Louf, Comptes Rendus Mecanique 347, 2019), section 6, figure by figure, beside its published values.

    knothe reproduce --quick -o reproduction/

runs this folder. By hand: `python3 studies/reproduction --quick`, with numpy, h5py and the package knothe where Python finds
them, and the program knothe on the PATH or named by the environment variable KNOTHE.
"""
import argparse
import json
import os
import signal
import sys
import time
from pathlib import Path

try:
    import h5py  # noqa: F401
    import numpy  # noqa: F401

    import knothe
except ImportError as error:
    print(f"knothe: the published study needs numpy, h5py and the package knothe: {error}", file=sys.stderr)
    sys.exit(1)

import beam
import bias
import law_and_modes
import open_questions
import record
import selection
import updating
from experiment import Subject


def figures_of(options):
    """One after the other, in the order of the paper, then what goes beyond it."""
    yield law_and_modes.figure_5(options)
    subject, soft = Subject(options.reference, options), Subject(options.soft, options)
    yield law_and_modes.figures_6_7(subject)
    yield updating.figures_8_9(subject, soft, options)
    yield law_and_modes.figures_10_12(subject)
    yield updating.figure_13(subject, soft, options)
    yield bias.figures_14_15(subject, options)
    yield bias.bias_onset(subject, options)
    yield selection.figures_16_17(subject, options)
    yield selection.figure_18(subject, options)
    yield open_questions.decompositions(subject, options)
    yield open_questions.supports_and_loading(subject, soft, options)
    yield open_questions.other_choices(subject, soft, options)


def show(figure, as_json):
    if as_json:
        for line in figure.row_records():
            print(json.dumps(line, ensure_ascii=False, allow_nan=False), flush=True)
        return
    print(figure.heading)
    for row in figure.rows:
        print(f"  {row.quantity}{'' if row.unit == '1' else f', {row.unit}'}\n    paper: {row.paper}\n    here:  {row.here}", flush=True)


def main():
    parser = argparse.ArgumentParser(prog="knothe reproduce", description="The published study, figure by figure.")
    parser.add_argument("--quick", action="store_true", help="fewer other choices and repetitions, same figures")
    parser.add_argument("--json", action="store_true", help="JSON lines on stdout, one per row")
    parser.add_argument("--seed", type=int, default=1, help="seed of nodes and noise")
    parser.add_argument("-o", "--output", type=Path, default=Path("reproduction"), help="folder for page, JSON file and models")
    arguments = parser.parse_args()
    options = beam.Options(arguments.output / "models", arguments.quick, arguments.seed,
                           processes=int(os.environ.get("KNOTHE_THREADS") or len(os.sched_getaffinity(0))))
    if options.quick:
        options.repetitions, options.others = 10, options.others[:1]
    for each in (signal.SIGTERM, signal.SIGHUP):
        if signal.getsignal(each) != signal.SIG_IGN:
            signal.signal(each, signal.default_int_handler)
    start, figures = time.monotonic(), []
    try:
        for figure in figures_of(options):
            figures.append(figure)
            show(figure, arguments.json)
    except KeyboardInterrupt:
        print("knothe: interrupted; the models that were built and the full-order runs that are finished are kept: the same command goes on "
              "from there", file=sys.stderr)
        return 130
    except beam.Failed as failure:  # the program has said why
        return failure.status
    elapsed = time.monotonic() - start
    file, page = record.write(arguments.output, figures, {
        "program": f"knothe {knothe.__version__}", "quick": options.quick, "seed": options.seed, "repetitions": options.repetitions,
        "reference": options.reference.what, "elapsed_s": round(elapsed, 3)}), str(arguments.output / "reproduce.html")
    try:
        beam.run("report", arguments.output, "-o", page)
    except beam.Failed as failure:
        return failure.status
    if arguments.json:
        print(json.dumps({"done": True, "figures": len(figures), "page": page, "record": file, "elapsed_s": round(elapsed, 3)}))
    else:
        print(f"{page} and {file} in {elapsed:.0f} s")
    return 0


if __name__ == "__main__":
    sys.exit(main())
