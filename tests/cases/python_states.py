"""`knothe.states`: filters against dense Gaussian conditioning, quadrature and published errors; intervals against drawn cases; what is refused."""
import math
import re
import subprocess
import sys
import unittest
import warnings

try:
    import numpy as np
except ImportError:
    print(f"skipped: {sys.executable} has no numpy (Debian: python3-numpy)")
    sys.exit(77)

from support import REPOSITORY, CaseInItsFolder, by_form

sys.path.insert(0, str(REPOSITORY / "bench"))
import knothe
import knothe.states
import state_filters
from knothe.states import LinearModel, Localisation, StepModel, bouc_wen, estimate, lugre, oscillator, with_unknown_input

GAUSSIAN = ("kalman", "extended", "unscented")


def two_storeys(**options):
    """Shaken, seen by an accelerometer and a displacement sensor."""
    stiffness = np.array([[30.0, -10.0], [-10.0, 10.0]])
    return oscillator(np.diag([1.0, 1.5]), 0.02 * stiffness + 0.1 * np.eye(2), stiffness, dt=0.1,
                      **{"noise": [[0.02**2, 5e-4], [5e-4, 0.1**2]], "observe": [("displacement", 0), ("acceleration", 1)], "inputs": [[1.0], [0.5]],
                         "force_noise": [0.3, 0.2], "covariance": 0.5, "mean": [0.1, 0.2, 0.0, -0.3], **options})


class Dense:
    """All states of a linear model as one Gaussian vector, conditioned by matrices of the whole trajectory: no recursion."""

    def __init__(self, a, b, q, h, feedthrough, noise, mean, covariance, data, inputs):
        steps, d = len(data), len(mean)
        self.shape = steps, d
        # x = L (x_0, w_1, w_2, ...) + what the inputs do
        transfer, offset = np.zeros((steps * d, steps * d)), np.zeros((steps, d))
        offset[0] = mean
        for k in range(steps):
            for j in range(k + 1):
                block = np.eye(d)
                for i in range(j + 1, k + 1):
                    block = a[i - 1] @ block
                transfer[k * d:(k + 1) * d, j * d:(j + 1) * d] = block
            if k:
                offset[k] = a[k - 1] @ offset[k - 1] + b[k - 1] @ inputs[k - 1]
        sources = np.zeros((steps * d, steps * d))
        for k, part in enumerate([covariance, *q]):
            sources[k * d:(k + 1) * d, k * d:(k + 1) * d] = part
        self.mean, self.covariance = offset.ravel(), transfer @ sources @ transfer.T
        self.h, self.noise = np.kron(np.eye(steps), h), np.kron(np.eye(steps), noise)
        self.data, self.predicted = data.ravel(), self.h @ self.mean + (inputs @ feedthrough.T).ravel()

    def given(self, steps):
        """Means, covariances and log evidence of the data of the first steps."""
        seen = np.isfinite(self.data) & (np.arange(len(self.data)) < steps * len(self.data) // self.shape[0])
        h, innovation = self.h[seen], (self.data - self.predicted)[seen]
        spread = h @ self.covariance @ h.T + self.noise[np.ix_(seen, seen)]
        gain = np.linalg.solve(spread, h @ self.covariance).T
        evidence = -0.5 * (innovation @ np.linalg.solve(spread, innovation) + np.linalg.slogdet(spread)[1] + len(innovation) * math.log(2 * math.pi))
        mean, covariance = self.mean + gain @ innovation, self.covariance - gain @ h @ self.covariance
        count, d = self.shape
        return mean.reshape(count, d), np.array([covariance[k * d:(k + 1) * d, k * d:(k + 1) * d] for k in range(count)]), evidence


def growth_step(x, p, u, t, dt):
    return x / 2 + 25 * x / (1 + x**2) + 8 * np.cos(1.2 * t)


GROWTH = {"mean": [0.0], "covariance": 2.0, "noise": 1.0, "process_noise": math.sqrt(10.0)}  # Gordon, Salmond and Smith 1993


class Test(CaseInItsFolder):
    def setUp(self):
        super().setUp()
        self.rng = np.random.default_rng(1)

    def test_linear_models_are_the_dense_gaussian(self):
        """Missing values, correlated noise, inputs that the data see, uneven times: means, covariances, evidence and smoothing to 1e-9."""
        steps = 40
        times = np.cumsum(0.05 + 0.1 * self.rng.random(steps))
        inputs, model = self.rng.standard_normal((steps, 1)), two_storeys()
        data = 0.3 * self.rng.standard_normal((steps, 2))
        data[[4, 20, 21, 22]], data[8:15, 0], data[30, 1] = np.nan, np.nan, np.nan
        stiffness, mass, noise = np.array([[30.0, -10.0], [-10.0, 10.0]]), np.diag([1.0, 1.5]), np.array([[0.02**2, 5e-4], [5e-4, 0.1**2]])
        damping, flexibility = 0.02 * stiffness + 0.1 * np.eye(2), np.linalg.inv(mass)
        continuous = np.block([[np.zeros((2, 2)), np.eye(2)], [-flexibility @ stiffness, -flexibility @ damping]])
        load = np.r_[np.zeros((2, 1)), flexibility @ [[1.0], [0.5]]]
        random = np.zeros((4, 4))
        random[2:, 2:] = flexibility @ np.diag([0.09, 0.04]) @ flexibility

        def over(dt):
            """exp(A s) by its eigenvectors, integrals over s by Gauss and Legendre."""
            values, vectors = np.linalg.eig(continuous)
            nodes, weights = np.polynomial.legendre.leggauss(24)
            nodes, weights = 0.5 * dt * (nodes + 1), 0.5 * dt * weights
            moved = [(vectors * np.exp(values * s) @ np.linalg.inv(vectors)).real for s in [dt, *nodes]]
            return (moved[0], sum(w * m @ load for w, m in zip(weights, moved[1:])), sum(w * m @ random @ m.T for w, m in zip(weights, moved[1:])))

        a, b, q = zip(*map(over, np.diff(times)))
        h = np.array([[1.0, 0, 0, 0], continuous[3]])
        exact = Dense(a, b, q, h, np.array([[0.0], load[3]]), noise, np.array([0.1, 0.2, 0.0, -0.3]), 0.25 * np.eye(4), data, inputs)
        for method in GAUSSIAN:
            with self.subTest(method):
                found = estimate(model, data, method, times=times, inputs=inputs)
                for k in (1, 5, 16, 31, steps):
                    mean, covariance, evidence = exact.given(k)
                    np.testing.assert_allclose(found.mean[k - 1], mean[k - 1], atol=1e-9, rtol=0)
                    np.testing.assert_allclose(found.covariance[k - 1], covariance[k - 1], atol=1e-9, rtol=0)
                    self.assertAlmostEqual(found.log_evidence_increments[:k].sum(), evidence, delta=1e-9 * abs(evidence))
                self.assertAlmostEqual(found.log_evidence, evidence, delta=1e-9 * abs(evidence))
                smoothed = found.smooth()
                np.testing.assert_allclose(smoothed.mean, mean, atol=1e-9, rtol=0)
                np.testing.assert_allclose(smoothed.covariance, covariance, atol=1e-9, rtol=0)
        self.assertEqual(estimate(model, data, times=times, inputs=inputs).method, "kalman")

    def test_ensembles_converge_to_the_kalman_filter(self):
        model, inputs = two_storeys(noise=[0.05, 0.3]), self.rng.standard_normal((30, 1))
        _, data = model.simulate(30, inputs=inputs, seed=3)
        data[[7, 12], 0] = np.nan
        exact = estimate(model, data, inputs=inputs)
        for method, members in (("ensemble", 4000), ("map", 4000), ("particle", 8000)):
            with self.subTest(method):
                options = {"order": 1} if method == "map" else {}
                found = estimate(model, data, method, inputs=inputs, members=members, **options)
                # each mean is off by about a standard deviation by the root of what is effective; a filter adds some of each step
                error = np.sqrt(np.mean(((found.mean - exact.mean) / exact.std)**2))
                self.assertLess(error, 6 / math.sqrt(members))
                self.assertLess(abs(np.mean(found.std / exact.std) - 1), 0.02)
                self.assertLess(abs(found.log_evidence - exact.log_evidence), 1.0)
                again = estimate(model, data, method, inputs=inputs, members=members, **options)
                np.testing.assert_array_equal(found.mean, again.mean)
                lower, upper = found.interval(0.9)
                np.testing.assert_allclose((upper - lower) / exact.std, 2 * 1.6449, rtol=0.2)

    def test_a_nonlinear_model_is_as_by_dense_quadrature(self):
        """The growth model, whose posterior has two modes: a grid of 4,001 states against particles; evidence and means."""
        model = StepModel(growth_step, lambda x, p, u, t: x**2 / 20, **GROWTH)
        _, data = model.simulate(40, seed=4)
        x = np.linspace(-40, 40, 4001)
        density, evidence, means, deviations = np.exp(-0.5 * x**2 / 4), 0.0, [], []
        density /= density.sum()
        for k, (datum,) in enumerate(data):
            if k:
                moved = growth_step(x, None, None, k - 1.0, 1.0)
                density = np.exp(-0.5 * (x[:, None] - moved)**2 / 10) @ density
                density /= density.sum()
            density = density * np.exp(-0.5 * (datum - x**2 / 20)**2) / math.sqrt(2 * math.pi)
            evidence += math.log(density.sum())
            density /= density.sum()
            means.append(density @ x)
            deviations.append(math.sqrt(density @ (x - means[-1])**2))
        found = estimate(model, data, "particle", members=10000)
        self.assertTrue(found.trusted, found.remark)
        self.assertLess(abs(found.log_evidence - evidence), 0.3)
        self.assertLess(np.max(np.abs(found.mean[:, 0] - means) / deviations), 0.1)
        self.assertLess(np.mean(np.abs(found.std[:, 0] / deviations - 1)), 0.05)  # of a mode that has 1 % of the mass there are 100 particles
        self.assertLess(estimate(model, data, "unscented").log_evidence, evidence - 5)  # what a Gaussian does not know

    def test_particles_are_tempered_where_a_datum_is_far_out(self):
        """One datum of 12 standard deviations: the exact posterior is Gaussian, and no untempered particle is there."""
        model = LinearModel(lambda p, dt: ([[1.0]], np.zeros((1, 0)), [[1.0]]), [[1.0]], mean=[0.0], covariance=1e-3, noise=0.1)
        data = [[0.0], [12.0]]
        exact, found = estimate(model, data), estimate(model, data, "particle", members=2000)
        self.assertLess(abs(found.mean[1, 0] - exact.mean[1, 0]), 0.3 * exact.std[1, 0])
        self.assertLess(abs(found.log_evidence - exact.log_evidence), 1.0)

    def test_maps_move_an_ensemble_to_a_posterior_that_is_not_gaussian(self):
        """A skewed state that is seen, and a hidden one that depends on it nonlinearly: means and standard deviations as by quadrature.
        Linear maps are off."""
        def skewed(x, p, u, t, dt):
            seen = np.exp(x[:, 0])
            return np.c_[seen, np.tanh(2 * (seen - 1.5)) + 0.3 * x[:, 1]]

        model = StepModel(skewed, [[1.0, 0.0]], mean=[0.0, 0.0], covariance=[0.7, 1.0], noise=0.6)
        x = np.linspace(-4, 4, 20001)
        weight = np.exp(-0.5 * ((x / 0.7)**2 + ((2.0 - np.exp(x)) / 0.6)**2))
        weight /= weight.sum()
        values = np.exp(x), np.tanh(2 * (np.exp(x) - 1.5))
        mean = np.array([weight @ each for each in values])
        deviation = np.sqrt([weight @ (each - each_mean)**2 + extra for each, each_mean, extra in zip(values, mean, (0.0, 0.09))])
        errors = {}
        for order in (1, 3):
            found = estimate(model, [[np.nan], [2.0]], "map", members=4000, order=order)
            errors[order] = np.abs(np.r_[(found.mean[1] - mean) / deviation, found.std[1] / deviation - 1]).max()
        self.assertLess(errors[3], 0.1)
        self.assertGreater(errors[1], 0.3)

    def test_lorenz_63_by_the_stochastic_map_filter(self):
        """Spantini et al. 2022: an RMSE of 0.37, where the ensemble Kalman filter stays near 0.5."""
        cycles, seeds, members = by_form((250, (1,), 200), (1200, (1, 2, 3), 500))
        rmse = {method: np.mean([state_filters.measured(63, cycles, seed, method, members=members, **options)[0] for seed in seeds])
                for method, options in (("map", {"inflation": 1.05}), ("ensemble", {}))}
        print(rmse)
        if cycles > 1000:
            self.assertLess(abs(rmse["map"] - 0.37), 0.03)
        self.assertLess(rmse["map"], 0.85 * rmse["ensemble"])

    def test_lorenz_96_by_the_stochastic_map_filter(self):
        """Forty states, every second one observed, 100 members: the published local ensemble transform filter has 0.84 (DAPPER's table, tuned). The
        short form only follows the truth for a while: a climatology is off by 3.6."""
        cycles = by_form(30, 600)
        near = Localisation.ring(40, 5.0, range(0, 40, 2))
        rmse = {method: state_filters.measured(96, cycles, 1, method, members=100, localisation=near, inflation=1.05)[0] for method in ("map", "ensemble")}
        print(rmse)
        self.assertLess(max(rmse.values()), 1.3)
        if cycles > 100:
            self.assertLess(rmse["map"], rmse["ensemble"])

    def test_stiffness_and_damping_average_the_states(self):
        """One unknown parameter: mean, evidence and states as by a sum over 200 values of it, by the law of total variance."""
        model = oscillator(1.0, 0.4, "k", dt=0.1, noise=0.02, force_noise=0.3, covariance=0.1, parameters={"k": 9.0})
        _, data = model.simulate(60, seed=5)
        found = estimate(model, data, parameters={"k": knothe.Lognormal(2.2, 0.3)}, draws=1000, inference={"method": "grid"})
        logarithms = np.linspace(2.2 - 1.2, 2.2 + 1.2, 200)
        runs = [estimate(oscillator(1.0, 0.4, math.exp(value), dt=0.1, noise=0.02, force_noise=0.3, covariance=0.1), data) for value in logarithms]
        prior = np.exp(-0.5 * ((logarithms - 2.2) / 0.3)**2) / (0.3 * math.sqrt(2 * math.pi)) * (logarithms[1] - logarithms[0])
        evidences = np.array([run.log_evidence for run in runs])
        weights = prior * np.exp(evidences - evidences.max())
        self.assertLess(abs(found.log_evidence - evidences.max() - math.log(weights.sum())), 0.01)
        weights /= weights.sum()
        k = np.exp(logarithms)
        self.assertLess(abs(found.parameters.mean[0] - weights @ k), 0.05 * found.parameters.std[0])
        means, covariances = (np.array([getattr(run, name) for run in runs]) for name in ("mean", "covariance"))
        mean = np.tensordot(weights, means, 1)
        apart = means - mean
        variance = np.tensordot(weights, np.diagonal(covariances, axis1=2, axis2=3) + apart**2, 1)
        self.assertLess(np.abs((found.mean - mean) / np.sqrt(variance)).max(), 0.05)
        np.testing.assert_allclose(found.std, np.sqrt(variance), rtol=0.03)
        smoothed = np.array([run.smooth().mean for run in runs])
        self.assertLess(np.abs((found.smooth().mean - np.tensordot(weights, smoothed, 1)) / np.sqrt(variance)).max(), 0.1)

    def test_ninety_percent_intervals_of_oscillators(self):
        """Stiffness and damping drawn from their priors, process noise: 90 % intervals hold the states and the parameters as often as they say."""
        cases = by_form(3, 120)
        priors = {"c": knothe.Lognormal(-1.0, 0.4), "k": knothe.Lognormal(2.2, 0.3)}
        held, of_states = [], []
        for case in range(cases):
            rng = np.random.default_rng(100 + case)
            truth = {name: math.exp(prior.mu + prior.sigma * rng.standard_normal()) for name, prior in priors.items()}
            model = oscillator(1.0, "c", "k", dt=0.15, noise=0.02, force_noise=0.3, covariance=0.2, parameters=truth)
            states, data = model.simulate(60, seed=rng)
            found = estimate(model, data, parameters=priors, inference={"method": "grid"})
            lower, upper = found.interval(0.9)
            of_states.append(np.mean((lower < states) & (states < upper)))
            ends = np.quantile(found.parameters.draws(4000), [0.05, 0.95], axis=0)
            held += [low < truth[name] < high for name, low, high in zip(priors, *ends)]
        # a share of n independent cases, 3.3 standard deviations; the states of a case are not independent, 1 in 6 counted
        print(np.mean(held), np.mean(of_states))
        self.assertLess(abs(np.mean(held) - 0.9), 3.3 * math.sqrt(0.09 / len(held)))
        self.assertLess(abs(np.mean(of_states) - 0.9), 3.3 * math.sqrt(0.09 / (20 * cases)))

    def test_a_hysteretic_oscillator_is_identified(self):
        model = bouc_wen(1.0, 0.2, "k", share=0.3, beta="beta", gamma=10.0, dt=0.05, noise=1e-3, force_noise=0.05, covariance=[0.01, 0.01, 1e-3],
                         substeps=2, parameters={"k": 30.0, "beta": 20.0})
        load = 3 * np.sin(0.12 * np.arange(90)) + 2 * np.sin(0.31 * np.arange(90))
        states, data = model.simulate(90, inputs=load, seed=6)
        found = estimate(model, data, inputs=load, parameters={"k": knothe.Lognormal(3.3, 0.3), "beta": knothe.Lognormal(2.8, 0.4)},
                         inference={"method": "grid"}, draws=50)
        self.assertLess(np.max(np.abs(found.parameters.mean - [30.0, 20.0]) / found.parameters.std), 3.0)
        self.assertTrue(np.all(found.parameters.std < [1.5, 4.0]), found.parameters.std)  # of priors of 9 and 7
        self.assertLess(np.sqrt(np.mean(((found.mean - states) / found.std)**2)), 1.5)
        self.assertEqual(found.verdict.level, "ok", found.verdict.reasons)

    def test_forecasts_under_another_excitation(self):
        """A friction damper, its stiffness (long form) and friction learnt under a sine: under a random load, not seen before, the displacement is in the
        90 % interval in 85 to 95 % of all samples (long form); of the one case of the short form in more than half."""
        cases, shares, covered = by_form(1, 30), [], []
        for case in range(cases):
            rng = np.random.default_rng(case)
            truth = {"k": 100 * math.exp(0.1 * rng.standard_normal()), "coulomb": math.exp(0.15 * rng.standard_normal())}
            model = lugre(1.0, 0.5, "k", coulomb="coulomb", static=lambda p: 1.3 * p["coulomb"], stribeck=0.05, sigma0=2e3, sigma1=20.0, dt=0.02,
                          noise=1e-3, force_noise=0.1, substeps=4, parameters=truth)
            load = np.r_[3 * np.sin(2 * np.pi * 1.5 * 0.02 * np.arange(80)), 4 * np.convolve(rng.standard_normal(158), np.hanning(9) / 2, "valid")]
            states, data = model.simulate(len(load), inputs=load, seed=rng)
            priors = {"k": knothe.Lognormal(math.log(100), 0.1), "coulomb": knothe.Lognormal(0.0, 0.15)}
            found = estimate(model, data[:80], inputs=load[:80], draws=60, inference={"method": "grid"},
                             parameters=by_form({"coulomb": priors["coulomb"]}, priors))
            covered += [abs(mean - truth[name]) < 1.645 * std
                        for name, mean, std in zip(found.parameters.parameters, found.parameters.mean, found.parameters.std)]
            ahead = found.forecast(len(load) - 80, inputs=load[80:])
            shares.append(np.mean((ahead.lower[:, 0] < states[80:, 0]) & (states[80:, 0] < ahead.upper[:, 0])))
        print(np.mean(shares), np.mean(covered))
        self.assertTrue(0.85 <= np.mean(shares) <= 0.95 if cases > 10 else np.mean(shares) > 0.5, shares)

    def test_an_unknown_load_is_found(self):
        """As a state: the linear model's equals the same model with the input written into its matrices; and a hysteretic one finds it too."""
        model = oscillator(1.0, 0.4, 9.0, dt=0.1, noise=1e-3, inputs=[[1.0]], covariance=0.01)
        load = np.sin(0.05 * np.arange(150))
        _, data = model.simulate(150, inputs=load, seed=7)
        found = estimate(with_unknown_input(model, 1.0, correlation_time=2.0), data, inputs=np.zeros(150))
        a, b, q = model.transition({}, 0.1)
        factor = math.exp(-0.05)
        by_hand = LinearModel(lambda p, dt: (np.block([[a, b], [np.zeros((1, 2)), factor]]), np.zeros((3, 0)), np.diag([0, 0, 1 - factor**2])),
                              [[1.0, 0.0, 0.0]], mean=[0.0] * 3, covariance=[0.01, 0.01, 1.0], noise=1e-3, dt=0.1)
        np.testing.assert_allclose(found.mean, estimate(by_hand, data).mean, atol=1e-9)
        self.assertLess(np.mean(np.abs(found.smooth().mean[:-1, 2] - load[:-1])), 0.1)
        yielding = bouc_wen(1.0, 0.4, 30.0, share=0.5, beta=20.0, gamma=10.0, dt=0.1, noise=1e-3)
        _, data = yielding.simulate(150, inputs=2 * load, seed=8)
        found = estimate(with_unknown_input(yielding, 1.0), data, inputs=np.zeros(150))
        self.assertLess(np.mean(np.abs(found.smooth().mean[:-1, 3] - 2 * load[:-1])), 0.3)

    def test_a_forecast_is_the_filter_without_data(self):
        model, inputs = two_storeys(noise=[0.05, 0.3]), self.rng.standard_normal((40, 1))
        _, data = model.simulate(25, inputs=inputs[:25], seed=2)
        for method in ("kalman", "unscented", "ensemble"):
            with self.subTest(method):
                found = estimate(model, data, method, inputs=inputs[:25])
                ahead = found.forecast(15, inputs=inputs[25:])
                alone = estimate(model, np.r_[data, np.full((15, 2), np.nan)], method, inputs=inputs)
                np.testing.assert_allclose(ahead.mean, alone.mean[25:], atol=1e-12)
                np.testing.assert_allclose(ahead.covariance, alone.covariance[25:], atol=1e-12)
                np.testing.assert_allclose(ahead.lower, alone.interval(0.9)[0][25:], atol=1e-12)
                np.testing.assert_array_equal(ahead.mean, found.forecast(15, inputs=inputs[25:]).mean)
                self.assertTrue(np.all(np.isnan(alone.innovations[25:])))
        np.testing.assert_allclose(ahead.times, 0.1 * np.arange(25, 40))
        self.assertTrue(np.all(ahead.data_std > [0.05, 0.3]))

    def test_the_verdict_judges_the_innovations(self):
        def judged(**wrong):
            return estimate(oscillator(1.0, 0.4, wrong.pop("k", 9.0), dt=0.1, **{"noise": 0.02, "force_noise": 0.3, "covariance": 0.1, **wrong}), data)

        _, data = oscillator(1.0, 0.4, 9.0, dt=0.1, noise=0.02, force_noise=0.3, covariance=0.1).simulate(400, seed=9)
        right = judged()
        self.assertEqual((right.verdict.level, right.verdict.reasons), ("ok", []))
        self.assertIn("Result: usable>", repr(right))
        for wrong, code, text in (({"noise": 0.01, "force_noise": 0.1}, "fit", "times as large as forecast"),
                                  ({"k": 30.0, "force_noise": 0.3}, "fit", "the model, its process noise or the noise of the data is not right"),
                                  ({"noise": 0.1, "force_noise": 1.0}, "fit", "stated too large"),
                                  ({"noise": 0.05, "force_noise": 0.02}, "model", "correlated in time")):
            with self.subTest(wrong):
                verdict = judged(**wrong).verdict
                self.assertNotEqual(verdict.level, "ok")
                self.assertIn(code, [reason.code for reason in verdict.reasons])
                self.assertIn(text, " ".join(reason.message for reason in verdict.reasons))
        self.assertIn("Result: do not use", judged(noise=0.005, force_noise=0.03)._repr_html_())

    def test_right_models_are_rarely_doubted(self):
        """Of 200 drawn cases of a right model none is doubted (limits of 3e-5), and probabilities of the misfit are uniform."""
        model, probabilities = oscillator(1.0, 0.4, 9.0, dt=0.2, noise=0.05, force_noise=0.3, covariance=0.1), []
        for seed in range(200):
            verdict = estimate(model, model.simulate(40, seed=seed)[1]).verdict
            self.assertEqual(verdict.level, "ok", verdict.reasons)
            probabilities.append(verdict.fit_probability)
        distance = np.max(np.abs(np.sort(probabilities) - (np.arange(200) + 0.5) / 200))
        self.assertLess(distance, 1.95 / math.sqrt(200))  # Kolmogorov's, at 0.1 %

    def test_particles_without_process_noise_say_that_they_stay_together(self):
        model = StepModel(lambda x, p, u, t, dt: 0.99 * x, [[1.0]], mean=[0.0], covariance=1.0, noise=0.02)
        _, data = model.simulate(50, seed=1)
        with self.assertWarnsRegex(knothe.UntrustedWarning, "members were effective: give more members, or jitter|they stay together: give jitter"):
            found = estimate(model, data, "particle")
        self.assertFalse(found.trusted)
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            self.assertTrue(estimate(model, data, "particle", jitter=0.2).trusted)

    def test_the_page_runs_from_top_to_bottom(self):
        blocks = re.findall(r"^```py\n(.*?)^```", (REPOSITORY / "docs/how-to/states.md").read_text(), re.M | re.S)
        self.assertEqual(len(blocks), 3)
        done = subprocess.run([sys.executable, "-c", "\n".join(blocks)], capture_output=True, text=True, timeout=250)
        self.assertEqual(done.returncode, 0, done.stderr[-3000:])
        self.assertIn("damage in k0 with probability > 99.9 %, loss 25 %", done.stdout)

    def test_what_is_wrong_is_told(self):
        model, data = two_storeys(), np.zeros((5, 2))
        one = {"mean": [0.0], "covariance": 1.0, "noise": 1.0}
        still = lambda x, p, u, t, dt: x
        usage = knothe.UsageError
        self.refused(usage, "the model has 1 input: give inputs, an array of 5 x 1", call=lambda: estimate(model, data))
        self.refused(usage, "inputs of shape (4, 1) for 5 data and 1 input", call=lambda: estimate(model, data, inputs=np.zeros((4, 1))))
        self.refused(usage, "method 'kf': there are auto, kalman", call=lambda: estimate(model, data, "kf", inputs=np.zeros(5)))
        self.refused(usage, "members is an option of ensemble, particle, map, not of method 'kalman'",
                     call=lambda: estimate(model, data, inputs=np.zeros(5), members=10))
        self.refused(usage, "'kalman' is for a LinearModel", call=lambda: estimate(StepModel(still, [[1.0]], **one), [[0.0]], "kalman"))
        self.refused(usage, "data: row 1 is infinite; a missing value is NaN", call=lambda: estimate(StepModel(still, [[1.0]], **one), [0.0, np.inf]))
        self.refused(usage, "times: 2 times for 3 rows of data: one each, strictly increasing",
                     call=lambda: estimate(StepModel(still, [[1.0]], **one), [0.0, 1.0, 2.0], times=[0.0, 1.0]))
        self.refused(usage, "covariance: the covariance is not positive semidefinite: its smallest eigenvalue is -1",
                     call=lambda: StepModel(still, np.eye(2), mean=[0, 0], covariance=[[1, 2], [2, 1]], noise=1.0))
        self.refused(usage, "covariance: the covariance is not symmetric",
                     call=lambda: StepModel(still, np.eye(2), mean=[0, 0], covariance=[[1, 2], [0, 1]], noise=1.0))
        self.refused(usage, "noise: a standard deviation of 0: it must be > 0",
                     call=lambda: estimate(StepModel(still, [[1.0]], mean=[0.0], covariance=1.0, noise=0.0), [0.0]))
        self.refused(usage, "process_noise: 2 standard deviations for 1 value", call=lambda: StepModel(still, [[1.0]], process_noise=[1, 2], **one))
        self.refused(usage, "an observation matrix of shape (1, 2) for 1 state", call=lambda: StepModel(still, [[1.0, 0.0]], **one))
        self.refused(usage, "process_noise is that of a step of 1, but the data are 0.5 apart: give it as a function of (p, dt)",
                     call=lambda: estimate(StepModel(still, [[1.0]], process_noise=1.0, **one), [0.0, 1.0], times=[0.0, 0.5]))
        self.refused(usage, "step: 3 states of 1 number gave an array of shape (3,)",
                     call=lambda: estimate(StepModel(lambda x, p, u, t, dt: x[:, 0], [[1.0]], **one), [0.0, 0.0]))
        self.refused(knothe.DataError, "observe gives 1 values, but a datum has 2", call=lambda: estimate(StepModel(still, [[1.0]], **one), [[0.0, 1.0]]))
        burst = StepModel(lambda x, p, u, t, dt: np.where((t > 1) & (x > 0.5), np.nan, x), [[1.0]], **one)
        self.refused(knothe.DataError, "step: at time 3 the model of member ", "which is not finite", call=lambda: estimate(burst, np.zeros(5), "ensemble"))
        with self.assertWarnsRegex(knothe.UntrustedWarning, "the model failed for [0-9]+ members, which have no weight"):
            self.assertTrue(np.all(np.isfinite(estimate(burst, np.zeros(5), "particle").mean)))
        gone = StepModel(lambda x, p, u, t, dt: np.nan * x, [[1.0]], **one)
        self.refused(knothe.NumericalError, "at time 1 the model of every member has failed", call=lambda: estimate(gone, np.zeros(3), "particle"))
        self.refused(usage, "parameters are found by the evidence of kalman, extended, unscented; that of 'map' is random",
                     call=lambda: estimate(model, data, "map", inputs=np.zeros(5), parameters={"k": knothe.Normal(0, 1)}))
        self.refused(usage, "parameter 'k' has no value", call=lambda: oscillator(1.0, 0.1, "k", dt=0.1, noise=1.0))
        self.refused(usage, "stiffness of shape (1, 1) for 2 degrees of freedom", call=lambda: oscillator(np.eye(2), np.eye(2), 1.0, dt=0.1, noise=1.0))
        self.refused(usage, "observe: 'position' of degree of freedom 0: give displacement, velocity, acceleration of 0 to 0",
                     call=lambda: oscillator(1.0, 0.1, 1.0, dt=0.1, noise=1.0, observe="position"))
        self.refused(usage, "100 members for maps of order 2 and 40 states: give 242 members, a lower order, or a localisation",
                     call=lambda: estimate(state_filters.model_96(), np.zeros((1, 20)), "map", members=100))
        self.refused(usage, "with 2 places of data, for 4 states and data of 2 values",
                     call=lambda: estimate(model, data, "ensemble", inputs=np.zeros(5), localisation=Localisation.ring(3, 1.0, [0, 1])))
        self.refused(usage, "smooth: method 'ensemble' has no smoother",
                     call=lambda: estimate(StepModel(still, [[1.0]], **one), [0.0], "ensemble").smooth())
        self.refused(usage, "a probability of 0.8: give 0.5, 0.9 or 0.95", call=lambda: estimate(StepModel(still, [[1.0]], **one), [0.0]).interval(0.8))
        self.refused(usage, "input 0: the model has 0 inputs", call=lambda: with_unknown_input(StepModel(still, [[1.0]], **one), 1.0))


if __name__ == "__main__":
    unittest.main()
