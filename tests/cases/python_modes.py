"""`knothe.modes`: pairing against all permutations, evidence against quadrature, and how often a drawn loss of stiffness is found."""
import itertools
import math
import sys
import unittest

try:
    import numpy as np
except ImportError:
    print(f"skipped: {sys.executable} has no numpy (Debian: python3-numpy)")
    sys.exit(77)

from support import REPOSITORY, CaseInItsFolder, by_form

sys.path.insert(0, str(REPOSITORY / "bench"))
import damaged_frames
import knothe
import knothe.modes
from knothe.modes import Modes, Scatter, assurance, frame, learn, log_likelihood, of_matrices


class Test(CaseInItsFolder):
    def setUp(self):
        super().setUp()
        self.rng = np.random.default_rng(1)

    def test_a_uniform_frame_has_the_modes_of_the_formula(self):
        """w = 2 sqrt(k / m) sin((2 j - 1) pi / (4 n + 2)), shapes sin((2 j - 1) i pi / (2 n + 1))."""
        n, k, m = 5, 3e6, 2e4
        frequencies, shapes = frame([k] * n, [m] * n)
        j = np.arange(1, n + 1)
        np.testing.assert_allclose(frequencies, math.sqrt(k / m) / math.pi * np.sin((2 * j - 1) * math.pi / (4 * n + 2)), rtol=1e-12)
        formula = np.sin(np.outer(2 * j - 1, j) * math.pi / (2 * n + 1))
        np.testing.assert_allclose(assurance(shapes, formula), np.eye(n), atol=1e-12)
        many, _ = frame([np.array([k, 2 * k])] * n, [m] * n)
        np.testing.assert_allclose(many[1], math.sqrt(2) * frequencies, rtol=1e-12)
        stiffness = np.array([[2.0, -1.0], [-1.0, 1.0]])
        np.testing.assert_allclose(of_matrices(stiffness, np.eye(2), sensors=[1])[1].shape, (2, 1))

    def test_the_likelihood_sums_over_all_pairings(self):
        """Against a sum over permutations, with a mode that is missing and some that may be spurious."""
        frequencies, shapes = frame([3e6, 2e6, 2.5e6, 1.5e6], [2e4] * 4)
        scatter = Scatter(0.2, 0.3, 0.07)
        session = Modes(frequencies[[2, 0, 1]] * [1.1, 0.9, 1.05], shapes[[2, 0, 1]] + 0.2 * self.rng.standard_normal((3, 4)))
        concentration = 0.5 / 0.3**2
        # Watson's constant by a sum of its series, M(1/2, 2, c) = sum of (1/2)_i / (2)_i c^i / i!
        terms = np.cumprod(np.r_[1.0, [(0.5 + i) / (2 + i) * concentration / (i + 1) for i in range(120)]])
        mac = assurance(session.shapes, shapes)
        apart = np.log(session.frequencies)[:, None] - np.log(frequencies)
        pair = (np.exp(-0.5 * (apart / 0.2)**2) / (0.2 * math.sqrt(2 * math.pi) * session.frequencies[:, None])
                * np.exp(concentration * mac) / terms.sum())
        alone = 1 / (math.log(10) * session.frequencies)
        total = 0.0
        for choice in itertools.product([None, 0, 1, 2, 3], repeat=3):
            used = [i for i in choice if i is not None]
            if len(set(used)) < len(used):
                continue
            density, free = 1.0, 4
            for j, i in enumerate(choice):
                density *= 0.07 * alone[j] if i is None else 0.93 * pair[j, i] / free
                free -= i is not None
            total += density
        found = log_likelihood(session, frequencies[None], shapes[None], scatter)
        self.assertAlmostEqual(found[0], math.log(total), delta=1e-6)

    def test_sign_scale_and_order_do_not_matter(self):
        frequencies, shapes = frame([3e6, 2e6, 2.5e6], [2e4] * 3)
        noisy = shapes + 0.01 * self.rng.standard_normal((3, 3))
        one = log_likelihood(Modes(frequencies, noisy), frequencies[None], shapes[None], Scatter(0.01, 0.05))
        for order in itertools.permutations(range(3)):
            turned = noisy[list(order)] * np.array([[-3.0], [1e-3], [50.0]])
            other = log_likelihood(Modes(frequencies[list(order)], turned), frequencies[None], -shapes[None], Scatter(0.01, 0.05))
            self.assertAlmostEqual(one[0], other[0], delta=1e-10)

    def test_shapes_tell_close_modes_apart(self):
        """Two modes 0.1 % apart, their frequencies known to 1 %: only shapes say which one has changed."""
        frequencies, shapes = np.array([[1.0, 1.001]]), np.array([[[1.0, 0.0], [0.0, 1.0]]])
        changed = np.array([[1.03, 1.001], [1.0, 1.031]])
        session = Modes([1.03, 1.001], [[1.0, 0.05], [0.02, 1.0]])
        with_shapes = log_likelihood(session, changed, np.repeat(shapes, 2, 0), Scatter(0.01, 0.05))
        without = log_likelihood(Modes([1.03, 1.001]), changed, None, Scatter(0.01, 0.05))
        self.assertGreater(with_shapes[0] - with_shapes[1], 3.0)
        self.assertLess(abs(without[0] - without[1]), 0.1)
        self.assertEqual(frequencies.shape, (1, 2))

    def test_the_odds_are_those_of_quadrature(self):
        """One stiffness, frequencies alone: baseline, loss and their evidence by sums over 2,000 stiffnesses and 900 losses."""
        structure = lambda p, temperature: (np.sqrt(p["k"])[:, None] / (2 * math.pi), None)
        baseline, inspection = [Modes([f]) for f in (1.003, 0.998, 1.006)], [Modes([0.975]), Modes([0.983])]
        scatter, prior = Scatter(0.008, spurious=0.0), knothe.Lognormal(math.log(39.0), 0.1)
        found = learn(structure, baseline, {"k": prior}, scatter, draws=4000).assess(inspection, ["k"])
        logarithms = np.linspace(math.log(39.0) - 0.6, math.log(39.0) + 0.6, 2000)

        def density(sessions, log_k):
            return math.prod(np.exp(-0.5 * ((math.log(s.frequencies[0]) - 0.5 * log_k + math.log(2 * math.pi)) / 0.008)**2) for s in sessions)

        weights = np.exp(-0.5 * ((logarithms - prior.mu) / 0.1)**2) * density(baseline, logarithms)
        weights /= weights.sum()
        losses = (np.arange(900) + 0.5) / 1000
        by_loss = np.array([weights @ density(inspection, logarithms + math.log(1 - loss)) for loss in losses])
        odds = 0.1 / 0.9 * by_loss.mean() / (weights @ density(inspection, logarithms))
        self.assertAlmostEqual(found.probability, odds / (1 + odds), delta=0.03)
        self.assertAlmostEqual(found.loss["k"], by_loss @ losses / by_loss.sum(), delta=0.1 * found.loss_std["k"])
        low, high = found.loss_interval["k"]
        share = by_loss[(losses > low) & (losses < high)].sum() / by_loss.sum()
        self.assertAlmostEqual(share, 0.9, delta=0.03)

    def test_losses_of_a_storey_are_found_and_located(self):
        """Frames of four storeys: 25 % of one storey found in 95 of 100 (long form), located in 90; at most 2 false alarms in 100."""
        cases = by_form(1, 100)
        found, located, false_alarms = damaged_frames.counted(cases, 0.25, evaluations=by_form(9000, 0))
        print(found, located, false_alarms)
        self.assertGreaterEqual(found, 0.95 * cases)
        self.assertGreaterEqual(located, 0.9 * cases)
        self.assertLessEqual(false_alarms, 0.02 * cases)

    def test_two_losses_at_once_do_not_pass_as_one(self):
        truth, draw = damaged_frames.drawn(3)
        hurt = {**truth, "k0": truth["k0"] * 0.6, "k3": truth["k3"] * 0.55}
        health = damaged_frames.learnt([draw(truth) for _ in range(8)], seed=1).assess([draw(hurt) for _ in range(3)], damaged_frames.ELEMENTS)
        self.assertTrue(health.alarm)
        self.assertNotEqual(health.verdict.level, "ok")
        self.assertIn("several elements, or another cause", health.verdict.reasons[0].message)
        self.assertIn(f"damage in {health.located} with probability > 99.9 %", repr(health))
        self.assertIn("loss, if so", health._repr_html_())

    def test_what_is_wrong_is_told(self):
        structure, one = lambda p, temperature: (np.ones(2), None), [Modes([1.0])]
        usage, priors = knothe.UsageError, {"k": knothe.Lognormal(3.7, 0.1)}
        self.refused(usage, "give at least one, in Hz, > 0; leave out a mode that was not identified", call=lambda: Modes([1.0, np.nan]))
        self.refused(usage, "shapes of shape (1, 2) for 2 frequencies: give a row for each", call=lambda: Modes([1.0, 2.0], [[1.0, 2.0]]))
        self.refused(usage, "a mode shape is zero or not finite", call=lambda: Modes([1.0], [[0.0, 0.0]]))
        self.refused(usage, "frequency and shape are shares between 0 and 1", call=lambda: Scatter(5.0))
        self.refused(usage, "learn: give at least one session", call=lambda: learn(structure, [], priors, Scatter(0.01)))
        baseline = learn(lambda p, temperature: (np.sqrt(p["k"])[:, None] / 6.28, None), one, priors, Scatter(0.01))
        self.refused(usage, "assess: give at least one session", call=lambda: baseline.assess([], ["k"]))
        self.refused(usage, "elements k2: there are parameters k", call=lambda: baseline.assess(one, ["k2"]))
        self.refused(usage, "3 storeys and 2 floors", call=lambda: frame([1.0, 1.0, 1.0], [1.0, 1.0]))
        self.refused(usage, "mode shapes at 3 sensors, but the model has them at 2",
                     call=lambda: log_likelihood(Modes([1.0], [[1.0, 1.0, 1.0]]), [[1.0]], [[[1.0, 0.5]]], Scatter(0.01)))
        self.refused(usage, "13 modes of the model: give the lowest 12", call=lambda: log_likelihood(Modes([1.0]), np.ones((1, 13)), None, Scatter(0.01)))
        self.refused(usage, "frequencies of shape (2,) for", "or leave out vectorized",
                     call=lambda: learn(structure, one, priors, Scatter(0.01)))


if __name__ == "__main__":
    unittest.main()
