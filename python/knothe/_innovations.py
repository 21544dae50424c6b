"""The verdict of a filter: are the innovations what the model forecasts?"""
from __future__ import annotations

import math

import numpy as np

from knothe._filters import Filter, Particles
from knothe._inference import InferenceResult
from knothe._posterior import Reason, Verdict
from knothe._values import Array

# As of the verdict of an assimilation (docs/explanation/verdict.md)
_CAUTION, _REJECT, _LARGE = 3e-5, 1e-12, 1.5
_CORRELATED = 0.3
_LAGS = 10


def chi_squared_above(value: float, count: int) -> float:
    """P(χ² > value) for a whole number of degrees of freedom (Abramowitz and Stegun 26.4.4 and 26.4.5)."""
    half = 0.5 * value
    if half <= 0 or count == 0:
        return 1.0
    exponents = np.arange(count // 2) + 0.5 * (count % 2)
    logarithms = exponents * math.log(half) - half - np.array([math.lgamma(exponent + 1) for exponent in exponents])
    total = math.fsum(np.exp(logarithms)) + (math.erfc(math.sqrt(half)) if count % 2 else 0.0)
    return min(total, 1.0)


def whitened(innovations: Array, covariances: Array) -> Array:
    """Independent N(0, 1) of a model that is right (a linear one: exactly); NaN where a value is missing."""
    result = np.full_like(innovations, np.nan)
    for k, (innovation, covariance) in enumerate(zip(innovations, covariances)):
        seen = np.flatnonzero(np.isfinite(innovation))
        if len(seen):
            result[k, seen] = np.linalg.solve(np.linalg.cholesky(covariance[seen[:, None], seen]), innovation[seen])
    return result


def _of_size(white: Array) -> tuple[list[Reason], float]:
    values = white[np.isfinite(white)]
    total, count = float(values @ values), len(values)
    above = chi_squared_above(total, count)
    if not count:
        return [], 1.0
    factor = math.sqrt(total / count)
    if above < _CAUTION:
        level = "reject" if above < _REJECT or factor > _LARGE else "caution"
        return [Reason("fit", level, f"innovations are {factor:.2g} times as large as forecast (probability {above:.1g}): the model, its process noise "
                       "or the noise of the data is not right", factor, _LARGE, "noise_level")], above
    if 1 - above < _CAUTION:
        return [Reason("fit", "caution", f"innovations are only {factor:.2g} times as large as forecast: the process noise or the noise of the data "
                       "is stated too large, and so are the intervals", factor, 1.0, "noise_level")], above
    return [], above


def _of_independence(white: Array) -> list[Reason]:
    """Portmanteau test of each value's innovations with those up to 10 times later."""
    statistic, count, largest = 0.0, 0, 0.0
    for series in white.T:
        variance = float(np.nanmean(series**2)) if np.isfinite(series).any() else 0.0
        for lag in range(1, min(_LAGS, len(series) // 5) + 1):
            products = series[lag:] * series[:-lag]
            products = products[np.isfinite(products)]
            if variance > 0 and len(products) >= 20:
                correlation = float(products.mean()) / variance
                statistic, count, largest = statistic + len(products) * correlation**2, count + 1, max(largest, abs(correlation))
    probability = chi_squared_above(statistic, count)
    if count and probability < _CAUTION:
        level = "reject" if probability < _REJECT and largest > _CORRELATED else "caution"
        return [Reason("model", level, f"innovations are correlated in time (up to {largest:.2f}, probability {probability:.1g}): the model lacks "
                       "something that lasts, or has too little process noise", largest, _CORRELATED)]
    return []


def _of_computation(belief: Filter, parameters: "InferenceResult | None") -> list[Reason]:
    reasons = []
    if isinstance(belief, Particles):
        if belief.failed:
            reasons.append(Reason("computation", "caution", f"the model failed for {belief.failed} members, which have no weight", belief.failed, 0.0))
        least = belief.fewest * len(belief.members)
        if least < 25:
            reasons.append(Reason("computation", "caution", f"at one time only {least:.1f} members were effective: give more members, or jitter",
                                  least, 25.0))
        elif belief.unmoved:
            reasons.append(Reason("computation", "caution", "members were resampled, and without process noise they stay together: give jitter",
                                  0.0, 0.0))
    if parameters is not None and not parameters.trusted:
        reasons.append(Reason("computation", "caution", f"the parameters' posterior is not trusted: {parameters.remark}", 0.0, 0.0))
    return reasons


def verdict_of(innovations: Array, covariances: Array, belief: Filter, parameters: "InferenceResult | None") -> Verdict:
    """Of sizes (normalised innovations squared), independence and computation."""
    white = whitened(innovations, covariances)
    size, probability = _of_size(white)
    reasons = [*size, *_of_independence(white), *_of_computation(belief, parameters)]
    level = "reject" if any(reason.level == "reject" for reason in reasons) else "caution" if reasons else "ok"
    return Verdict(level, reasons, probability, np.zeros(0), np.zeros(0))
