"""Models that step: what a filter asks of them, for one state or for many, at one set of parameters or at many."""
from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Union

import numpy as np
from numpy.typing import ArrayLike

from knothe._errors import DataError, UsageError
from knothe._values import Array, counted, numbers

Parameters = Mapping[str, Any]
Spread = Union[ArrayLike, Callable[..., ArrayLike]]


def covariance_of(spread: ArrayLike, size: int, what: str, positive: bool = False) -> Array:
    """Of standard deviations (one for all, or one each) or of a covariance, which is checked."""
    given = numbers(spread, what)
    if not np.all(np.isfinite(given)):
        raise UsageError(f"{what}: a value is not finite")
    if np.ndim(spread) < 2:
        deviations = np.broadcast_to(given.ravel(), (size,)) if given.size in (1, size) else None
        if deviations is None:
            raise UsageError(f"{what}: {counted(given.size, 'standard deviation')} for {counted(size, 'value')}")
        if np.any(deviations < 0) or positive and np.any(deviations == 0):
            raise UsageError(f"{what}: a standard deviation of {deviations.min():g}: it must be {'> 0' if positive else '>= 0'}")
        return np.diag(deviations**2)
    if given.shape != (size, size):
        raise UsageError(f"{what}: a covariance of shape {given.shape} for {counted(size, 'value')}")
    largest = np.abs(given).max(initial=0.0)
    if np.abs(given - given.T).max() > 1e-9 * largest:
        raise UsageError(f"{what}: the covariance is not symmetric")
    least = float(np.linalg.eigvalsh(given)[0])
    if least < -1e-9 * largest or positive and least <= 0:
        raise UsageError(f"{what}: the covariance is not positive {'definite' if positive else 'semidefinite'}: its smallest eigenvalue is "
                         f"{least:.3g}")
    return 0.5 * (given + given.T)


def root_of(covariance: Array) -> Array:
    """L with L Lᵀ = covariance, of one or of many; these may be singular."""
    try:
        return np.linalg.cholesky(covariance)
    except np.linalg.LinAlgError:
        pass
    try:  # one of many that lost its last digits would cost all the others a decomposition into eigenvalues
        return np.linalg.cholesky(covariance * (1 + 1e-12 * np.eye(covariance.shape[-1])))
    except np.linalg.LinAlgError:
        finite = np.isfinite(covariance).all((-1, -2), keepdims=True)
        values, vectors = np.linalg.eigh(np.where(finite, covariance, 0.0))
        return np.asarray(np.where(finite, vectors * np.sqrt(np.maximum(values, 0.0))[..., None, :], np.nan))


class Points:
    """Values of the parameters, of one model run or of b at once: what is called with `at` gets numbers."""

    def __init__(self, values: Mapping[str, ArrayLike], count: int = 1) -> None:
        self.count = count
        self._values: dict[str, Array] = {name: np.broadcast_to(np.asarray(value, float), (count,)) for name, value in values.items()}

    def at(self, k: int) -> dict[str, float]:
        return {name: float(value[k]) for name, value in self._values.items()}

    def rows(self, each: int) -> dict[str, Any]:
        """For states in rows, `each` of them at every point: numbers if there is one point, else a value for each row."""
        if self.count == 1:
            return self.at(0)
        return {name: np.repeat(value, each) for name, value in self._values.items()}

    def stacked(self, function: "Callable[[dict[str, float]], Array]") -> Array:
        return np.stack([function(self.at(k)) for k in range(self.count)])


class StepModel:
    """A simulator that steps, and what is measured of its state.

    x at t + dt = step(x, p, u, t, dt) + process noise;  data at t = observe(x, p, u, t) + noise.

    Parameters
    ----------
    step : callable
        ``step(x, p, u, t, dt)``: the state after `dt`. x has shape (n, d), one state a row; p maps names to values (numbers, or
        arrays of n where several are tried at once); u is the input from t to t + dt, shape (k,) (with an unknown one, which
        differs between states, (n, k): ``u[..., 0]`` suits both). Whatever else the model remembers belongs into the state.
    observe : callable or array_like, shape (m, d)
        ``observe(x, p, u, t)``, shape (n, m), or the matrix of a linear observation.
    mean : array_like, shape (d,), or callable of p
        Of the state at the time of the first datum.
    covariance : array_like or callable of p
        Of that state: standard deviations (one, or d), or a d x d covariance.
    noise : array_like or callable of p
        Of the data, independent from time to time: standard deviations (one, or m), or an m x m covariance.
    process_noise : array_like or callable of (p, dt), optional
        What a step adds: standard deviations (one, or d), or a d x d covariance. None: the model is exact.
    dt : float
        Time from one datum to the next, unless `estimate` is given times.
    inputs : int
        k.
    parameters : mapping of name to float, optional
        Values of p, where `estimate` is not asked to find them.
    vectorized : bool
        If false, `step` and `observe` are called with one state at a time, shapes (d,) and (m,).
    states : sequence of str, optional
        Names of the d states.

    Raises
    ------
    UsageError
        Arrays that do not fit, or a covariance that is none.

    Examples
    --------
    A pendulum whose length is a parameter, pushed at random:

    >>> def step(x, p, u, t, dt):
    ...     velocity = x[:, 1] - dt * 9.81 / p["length"] * np.sin(x[:, 0])
    ...     return np.c_[x[:, 0] + dt * velocity, velocity]
    >>> pendulum = knothe.states.StepModel(step, [[1.0, 0.0]], mean=[0.5, 0.0], covariance=0.1, noise=0.02,
    ...                                    process_noise=[0.0, 0.01], dt=0.02, parameters={"length": 1.0})
    >>> truth, angles = pendulum.simulate(200, seed=2)
    >>> found = knothe.states.estimate(pendulum, angles)
    >>> bool(np.mean(abs(found.mean[:, 0] - truth[:, 0]) < 2 * found.std[:, 0]) > 0.9)
    True
    """

    def __init__(self, step: Callable[..., ArrayLike], observe: "Callable[..., ArrayLike] | ArrayLike", *, mean: "ArrayLike | Callable[..., ArrayLike]",
                 covariance: Spread, noise: Spread, process_noise: "Spread | None" = None, dt: float = 1.0, inputs: int = 0,
                 parameters: "Mapping[str, float] | None" = None, vectorized: bool = True, states: "Sequence[str] | None" = None) -> None:
        if not callable(step):
            raise UsageError(f"StepModel: step={step!r} is not a function of (x, p, u, t, dt)")
        if not (np.isfinite(dt) and dt > 0):
            raise UsageError(f"StepModel: dt={dt!r}: a time step is > 0")
        self.parameters: dict[str, float] = {name: float(value) for name, value in (parameters or {}).items()}
        self._kept_noise: "tuple[Points, float, Array] | None" = None
        self.dt, self.inputs, self.vectorized = float(dt), int(inputs), bool(vectorized)
        self._step, self._mean, self._covariance, self._noise, self._process_noise = step, mean, covariance, noise, process_noise
        self._observe: "Callable[..., ArrayLike] | None" = observe if callable(observe) else None
        self._matrix: "Array | None" = None if callable(observe) else np.atleast_2d(numbers(observe, "observe"))
        self.dimension = len(self._initial_mean(self.parameters))
        if self._matrix is not None and self._matrix.shape[1] != self.dimension:
            raise UsageError(f"StepModel: an observation matrix of shape {self._matrix.shape} for {counted(self.dimension, 'state')}")
        self.states = [f"x{k}" for k in range(self.dimension)] if states is None else [str(name) for name in states]
        if len(self.states) != self.dimension:
            raise UsageError(f"StepModel: {counted(len(self.states), 'name')} for {counted(self.dimension, 'state')}")
        for what, spread in (("covariance", covariance), ("process_noise", process_noise)):
            if spread is not None and not callable(spread):
                covariance_of(spread, self.dimension, what)

    def _initial_mean(self, p: Parameters) -> Array:
        return numbers(self._mean(p) if callable(self._mean) else self._mean, "mean").ravel()

    def _first(self, points: Points) -> tuple[Array, Array]:
        """Mean and covariance of the first state, shapes (b, d) and (b, d, d)."""
        spread = self._covariance
        means = points.stacked(self._initial_mean)
        if means.shape[1] != self.dimension or not np.all(np.isfinite(means)):
            raise UsageError(f"mean: {means[0]} is not a state of {counted(self.dimension, 'finite number')}")
        return means, points.stacked(lambda p: covariance_of(spread(p) if callable(spread) else spread, self.dimension, "covariance"))

    def _data_noise(self, points: Points, count: int) -> Array:
        """Covariance of the noise of `count` data, shape (b, m, m)."""
        spread = self._noise
        return points.stacked(lambda p: covariance_of(spread(p) if callable(spread) else spread, count, "noise", positive=True))

    def _added_noise(self, points: Points, dt: float) -> "Array | None":
        """What a step adds, shape (b, d, d); kept, as data are mostly evenly spaced."""
        spread: Any = self._process_noise
        if spread is None:
            return None
        if not callable(spread) and abs(dt - self.dt) > 1e-9 * self.dt:
            raise UsageError(f"process_noise is that of a step of {self.dt:g}, but the data are {dt:g} apart: give it as a function of (p, dt)")
        if self._kept_noise is None or self._kept_noise[0] is not points or abs(self._kept_noise[1] - dt) > 1e-9 * dt:
            added = points.stacked(lambda p: covariance_of(spread(p, dt) if callable(spread) else spread, self.dimension, "process_noise"))
            self._kept_noise = points, dt, added
        return self._kept_noise[2]

    def _called(self, function: Callable[..., ArrayLike], states: Array, p: Parameters, *rest: Any) -> Array:
        if self.vectorized:
            return np.asarray(function(states, p, *rest), float)
        if any(np.ndim(value) for value in p.values()):
            return np.array([function(state, {name: value[k] for name, value in p.items()}, *rest) for k, state in enumerate(states)], float)
        return np.array([function(state, p, *rest) for state in states], float)

    def _advance(self, states: Array, points: Points, u: Array, t: float, dt: float) -> Array:
        """States of shape (b, s, d) after a step; not finite where the model failed."""
        rows = states.reshape(-1, self.dimension)
        after = self._called(self._step, rows, points.rows(states.shape[1]), u, t, dt)
        if after.shape != rows.shape:
            raise UsageError(f"step: {rows.shape[0]} states of {counted(self.dimension, 'number')} gave an array of shape {after.shape}")
        return after.reshape(states.shape)

    def _seen(self, states: Array, points: Points, u: Array, t: float) -> Array:
        """What would be measured of states of shape (b, s, d), without noise: (b, s, m)."""
        if self._matrix is not None:
            return states @ self._matrix.T
        rows = states.reshape(-1, self.dimension)
        assert self._observe is not None
        seen = self._called(self._observe, rows, points.rows(states.shape[1]), u, t)
        if seen.ndim != 2 or len(seen) != len(rows):
            raise UsageError(f"observe: {len(rows)} states gave an array of shape {seen.shape}: give one row of data for each")
        return seen.reshape(*states.shape[:2], -1)

    def _failure(self) -> str:
        """Why the model failed last, for a message."""
        return ""

    def simulate(self, steps: int, *, inputs: "ArrayLike | None" = None, parameters: "Mapping[str, float] | None" = None,
                 state: "ArrayLike | None" = None, seed: "int | np.random.Generator" = 1, noise: bool = True) -> tuple[Array, Array]:
        """Draws states and data.

        Parameters
        ----------
        steps : int
            Number of data.
        inputs : array_like, shape (steps, k), optional
        parameters : mapping of name to float, optional
            In place of the model's own.
        state : array_like, shape (d,), optional
            The first one; else drawn.
        seed : int or numpy.random.Generator
        noise : bool
            If false, neither the steps nor the data have any.

        Returns
        -------
        states : ndarray, shape (steps, d)
        data : ndarray, shape (steps, m)

        Examples
        --------
        >>> model = knothe.states.oscillator(1.0, 0.2, 4.0, dt=0.1, noise=0.01)
        >>> states, data = model.simulate(50, state=[1.0, 0.0], noise=False)
        >>> bool(np.allclose(data[:, 0], states[:, 0]))
        True
        """
        generator = np.random.default_rng(seed)
        points = Points({**self.parameters, **(parameters or {})})
        u = inputs_of(inputs, steps, self.inputs)
        mean, covariance = self._first(points)
        x = mean if state is None else numbers(state, "state").reshape(1, self.dimension)
        if state is None and noise:
            x = x + (root_of(covariance[0]) @ generator.standard_normal(self.dimension))
        states, data = [], []
        for k in range(steps):
            seen = self._seen(x[None], points, u[k], k * self.dt)[0]
            if noise:
                seen = seen + root_of(self._data_noise(points, seen.shape[1])[0]) @ generator.standard_normal(seen.shape[1])
            states.append(x[0])
            data.append(seen[0])
            if k + 1 == steps:
                break
            x = self._advance(x[None], points, u[k], k * self.dt, self.dt)[0]
            added = self._added_noise(points, self.dt) if noise else None
            if added is not None:
                x = x + root_of(added[0]) @ generator.standard_normal(self.dimension)
            require_finite(x, (k + 1) * self.dt, "step", self)
        return np.array(states), np.array(data)

    def __repr__(self) -> str:
        found = f", parameters {', '.join(self.parameters)}" if self.parameters else ""
        return f"<{type(self).__name__}: states {', '.join(self.states)}{found}>"


class LinearModel(StepModel):
    """A linear model: x at t + dt = A x + B u + process noise of covariance Q;  data = H x + D u + noise.

    Parameters
    ----------
    transition : callable
        ``transition(p, dt)``: A, B and Q, shapes (d, d), (d, k) and (d, d).
    observation : array_like, shape (m, d), or callable of p
        H; a function of p gives H and D, shape (m, k).
    mean, covariance, noise, dt, inputs, parameters, states
        As of `StepModel`.

    Examples
    --------
    A random walk, seen with noise:

    >>> walk = knothe.states.LinearModel(lambda p, dt: ([[1.0]], np.zeros((1, 0)), [[0.1 * dt]]), [[1.0]], mean=[0.0],
    ...                                  covariance=1.0, noise=0.5)
    >>> found = knothe.states.estimate(walk, [[0.2], [np.nan], [0.4]])
    >>> found.method, bool(found.std[1, 0] > found.std[2, 0])
    ('kalman', True)
    """

    def __init__(self, transition: Callable[[Parameters, float], "tuple[ArrayLike, ArrayLike, ArrayLike]"],
                 observation: "ArrayLike | Callable[[Parameters], tuple[ArrayLike, ArrayLike]]", *,
                 mean: "ArrayLike | Callable[..., ArrayLike]", covariance: Spread, noise: Spread, dt: float = 1.0, inputs: int = 0,
                 parameters: "Mapping[str, float] | None" = None, states: "Sequence[str] | None" = None) -> None:
        self.transition, self._observation = transition, observation
        self._kept: "tuple[Points, float, tuple[Array, Array, Array]] | None" = None
        self._kept_observation: "tuple[Points, tuple[Array, Array]] | None" = None
        super().__init__(self._nothing, self._nothing, mean=mean, covariance=covariance, noise=noise, dt=dt, inputs=inputs, parameters=parameters,
                         states=states)

    @staticmethod
    def _nothing(*_: Any) -> ArrayLike:
        raise AssertionError("a linear model is asked for its matrices")

    def _matrices(self, points: Points, dt: float) -> tuple[Array, Array, Array]:
        """A, B and Q of all points; kept, as data are mostly evenly spaced."""
        if self._kept is None or self._kept[0] is not points or abs(self._kept[1] - dt) > 1e-9 * dt:
            d, k = self.dimension, self.inputs
            triples = [tuple(np.asarray(each, float) for each in self.transition(points.at(i), dt)) for i in range(points.count)]
            for matrix, shape, name in zip(triples[0], ((d, d), (d, k), (d, d)), "ABQ"):
                if matrix.shape != shape:
                    raise UsageError(f"transition: {name} of shape {matrix.shape} for {counted(d, 'state')} and {counted(k, 'input')}: "
                                     f"it must be {shape}")
            if points.count == 1:
                covariance_of(triples[0][2], d, "transition: Q")
            self._kept = points, dt, tuple(np.stack(each) for each in zip(*triples))  # type: ignore[assignment]
        return self._kept[2]  # type: ignore[index]

    def _observation_matrices(self, points: Points) -> tuple[Array, Array]:
        """H and D of all points, shapes (b, m, d) and (b, m, k); kept."""
        if self._kept_observation is not None and self._kept_observation[0] is points:
            return self._kept_observation[1]
        if not callable(self._observation):
            matrix = np.atleast_2d(numbers(self._observation, "observation"))
            pairs = [(matrix, np.zeros((len(matrix), self.inputs)))]
        else:
            pairs = [tuple(np.asarray(each, float) for each in self._observation(points.at(i))) for i in range(points.count)]  # type: ignore[misc]
        h, feedthrough = pairs[0]
        if h.ndim != 2 or h.shape[1] != self.dimension or feedthrough.shape != (len(h), self.inputs):
            raise UsageError(f"observation: H and D of shapes {h.shape} and {feedthrough.shape} for {counted(self.dimension, 'state')} and "
                             f"{counted(self.inputs, 'input')}")
        stacked: Any = tuple(np.broadcast_to(np.stack(each), (points.count, *each[0].shape)) for each in zip(*pairs))
        self._kept_observation = points, stacked
        return self._kept_observation[1]

    def _added_noise(self, points: Points, dt: float) -> "Array | None":
        return self._matrices(points, dt)[2]

    def _advance(self, states: Array, points: Points, u: Array, t: float, dt: float) -> Array:
        a, b, _ = self._matrices(points, dt)
        return states @ a.swapaxes(1, 2) + (b @ u)[:, None]

    def _seen(self, states: Array, points: Points, u: Array, t: float) -> Array:
        h, feedthrough = self._observation_matrices(points)
        return states @ h.swapaxes(1, 2) + (feedthrough @ u)[:, None]


def require_finite(states: Array, t: float, what: str, model: StepModel) -> None:
    """Of members in rows."""
    failed = np.flatnonzero(~np.isfinite(states).all(axis=-1))
    if len(failed):
        raise DataError(f"{what}: at time {t:g} the model of member {failed[0]} gave {states[failed[0]]}, which is not finite"
                        + (f" (and of {len(failed) - 1} more)" if len(failed) > 1 else "") + model._failure())


def inputs_of(inputs: "ArrayLike | None", steps: int, count: int) -> Array:
    """One row for each datum."""
    if inputs is None:
        if count:
            raise UsageError(f"the model has {counted(count, 'input')}: give inputs, an array of {steps} x {count}")
        return np.zeros((steps, 0))
    given = numbers(inputs, "inputs")
    given = given.reshape(-1, 1) if np.ndim(inputs) == 1 else given
    if given.shape != (steps, count):
        raise UsageError(f"inputs of shape {np.shape(inputs)} for {counted(steps, 'datum')} and {counted(count, 'input')}".replace("datums", "data"))
    if not np.all(np.isfinite(given)):
        raise UsageError(f"inputs: row {int(np.flatnonzero(~np.isfinite(given).all(1))[0])} is not finite")
    return given


def with_unknown_input(model: StepModel, std: float, *, correlation_time: "float | None" = None, of: int = 0) -> StepModel:
    """The model with an input that is not known as a further state, which is added to what is given for that input.

    It is held from one datum to the next. With a correlation time it is an Ornstein-Uhlenbeck process of standard deviation `std`, else a
    random walk from 0 that gains `std` in the square root of a second.

    Parameters
    ----------
    model : StepModel
        With at least one input.
    std : float
        In units of the input (a random walk: in those by the square root of time).
    correlation_time : float, optional
    of : int
        Which input.

    Returns
    -------
    StepModel
        With d + 1 states, the last one the input; linear if `model` is.

    Raises
    ------
    UsageError
        The model has no such input.

    Examples
    --------
    >>> model = knothe.states.oscillator(1.0, 0.4, 9.0, dt=0.1, noise=1e-3, inputs=[[1.0]], covariance=0.01)
    >>> forced = knothe.states.with_unknown_input(model, 1.0, correlation_time=2.0)
    >>> load = np.sin(0.5 * 0.1 * np.arange(200))
    >>> _, data = model.simulate(200, inputs=load)
    >>> found = knothe.states.estimate(forced, data, inputs=np.zeros((200, 1)))
    >>> bool(np.mean(abs(found.smooth().mean[:-1, 2] - load[:-1])) < 0.15)
    True
    """
    if not 0 <= of < model.inputs:
        raise UsageError(f"with_unknown_input: input {of}: the model has {counted(model.inputs, 'input')}")
    if not std > 0 or correlation_time is not None and not correlation_time > 0:
        raise UsageError("with_unknown_input: std and correlation_time are > 0")
    d = model.dimension

    def decay(dt: float) -> tuple[float, float]:
        """Factor and variance of one step."""
        if correlation_time is None:
            return 1.0, std**2 * dt
        factor = float(np.exp(-dt / correlation_time))
        return factor, std**2 * (1 - factor**2)

    def mean(p: Parameters) -> Array:
        return np.r_[model._initial_mean(p), 0.0]

    def bordered(matrix: Array, corner: float) -> Array:
        full = np.zeros((d + 1, d + 1))
        full[:d, :d], full[d, d] = matrix, corner
        return full

    def covariance(p: Parameters) -> Array:
        spread = model._covariance
        return bordered(covariance_of(spread(p) if callable(spread) else spread, d, "covariance"), std**2 if correlation_time is not None else 0.0)

    common: dict[str, Any] = {"mean": mean, "covariance": covariance, "noise": model._noise, "dt": model.dt, "inputs": model.inputs,
                              "parameters": model.parameters, "states": [*model.states, f"input {of}"]}
    if isinstance(model, LinearModel):
        linear = model

        def transition(p: Parameters, dt: float) -> tuple[Array, Array, Array]:
            a, b, q = (np.asarray(each, float) for each in linear.transition(p, dt))
            factor, variance = decay(dt)
            full = bordered(a, factor)
            full[:d, d] = b[:, of]
            return full, np.vstack([b, np.zeros((1, linear.inputs))]), bordered(q, variance)

        def observation(p: Parameters) -> tuple[Array, Array]:
            h, feedthrough = linear._observation_matrices(Points(p))
            return np.hstack([h[0], feedthrough[0][:, [of]]]), feedthrough[0]

        return LinearModel(transition, observation, **common)

    def with_input(x: Array, u: Array) -> Array:
        """A row for each state."""
        rows = np.broadcast_to(u, (*x.shape[:-1], model.inputs)).copy()
        rows[..., of] += x[..., d]
        return rows

    def step(x: Array, p: Parameters, u: Array, t: float, dt: float) -> Array:
        return np.concatenate([model._step(x[..., :d], p, with_input(x, u), t, dt), decay(dt)[0] * x[..., d:]], -1)

    def observe(x: Array, p: Parameters, u: Array, t: float) -> ArrayLike:
        if model._observe is None:
            assert model._matrix is not None
            return np.asarray(x[..., :d] @ model._matrix.T)
        return model._observe(x[..., :d], p, with_input(x, u), t)

    def process_noise(p: Parameters, dt: float) -> Array:
        own = model._added_noise(Points(p), dt)
        return bordered(np.zeros((d, d)) if own is None else own[0], decay(dt)[1])

    return StepModel(step, observe, process_noise=process_noise, vectorized=model.vectorized, **common)
