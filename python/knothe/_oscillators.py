"""Oscillators: linear with any number of degrees of freedom, and with hysteresis or friction."""
from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Union

import numpy as np
from numpy.typing import ArrayLike

from knothe._errors import UsageError
from knothe._step_models import LinearModel, Parameters, Spread, StepModel
from knothe._values import Array, counted

Quantity = Union[ArrayLike, str, Callable[[Parameters], ArrayLike]]
_OBSERVED = ("displacement", "velocity", "acceleration")

# Padé approximant of order 13 (Higham 2005, Table 2.3)
_PADE = (64764752532480000.0, 32382376266240000.0, 7771770303897600.0, 1187353796428800.0, 129060195264000.0, 10559470521600.0,
         670442572800.0, 33522128640.0, 1323241920.0, 40840800.0, 960960.0, 16380.0, 182.0, 1.0)


def exponential(matrix: Array) -> Array:
    """exp of a square matrix, by scaling and squaring (Higham 2005)."""
    norm = np.abs(matrix).sum(0).max()
    halvings = max(0, math.ceil(math.log2(norm / 5.4))) if norm > 0 else 0
    a = matrix / 2.0**halvings
    one, a2 = np.eye(len(a)), a @ a
    a4 = a2 @ a2
    a6 = a2 @ a4
    b = _PADE
    odd = a @ (a6 @ (b[13] * a6 + b[11] * a4 + b[9] * a2) + b[7] * a6 + b[5] * a4 + b[3] * a2 + b[1] * one)
    even = a6 @ (b[12] * a6 + b[10] * a4 + b[8] * a2) + b[6] * a6 + b[4] * a4 + b[2] * a2 + b[0] * one
    result = np.linalg.solve(even - odd, even + odd)
    for _ in range(halvings):
        result = result @ result
    return np.asarray(result)


def discretised(a: Array, b: Array, intensity: Array, dt: float) -> tuple[Array, Array, Array]:
    """Of dx = (a x + b u) dt + dw, u held over the step, E dw dwᵀ = intensity dt: A, B and Q.

    Q by Van Loan 1978 for a fraction of the step, in which nothing decays much, and then by doubling."""
    d, k = b.shape
    norm = np.abs(a * dt).sum(0).max()
    halvings = max(0, math.ceil(math.log2(norm))) if norm > 0 else 0
    h = dt / 2.0**halvings
    block = np.zeros((2 * d, 2 * d))
    block[:d, :d], block[:d, d:], block[d:, d:] = -a * h, intensity * h, a.T * h
    parts = exponential(block)
    transition = parts[d:, d:].T
    q = transition @ parts[:d, d:]
    for _ in range(halvings):
        q, transition = q + transition @ q @ transition.T, transition @ transition
    held = np.zeros((d, 0))
    if k:
        both = np.zeros((d + k, d + k))
        both[:d, :d], both[:d, d:] = a * dt, b * dt
        held = exponential(both)[:d, d:]
    return transition, held, 0.5 * (q + q.T)


def value_of(quantity: Quantity, p: Parameters) -> Any:
    """A number (or an array), the name of a parameter, or a function of the parameters."""
    if isinstance(quantity, str):
        if quantity not in p:
            raise UsageError(f"parameter {quantity!r} has no value: there are {', '.join(p) or 'none'}; give parameters={{{quantity!r}: ...}}")
        return p[quantity]
    return quantity(p) if callable(quantity) else quantity


def _observations(observe: "str | Sequence[str | tuple[str, int]]", dofs: int) -> list[tuple[str, int]]:
    """Pairs of what and where."""
    found: list[tuple[str, int]] = []
    given: "list[str | tuple[str, int]]" = [observe] if isinstance(observe, str) else list(observe)
    for each in given:
        pairs = [(each, k) for k in range(dofs)] if isinstance(each, str) else [(each[0], int(each[1]))]
        for what, where in pairs:
            if what not in _OBSERVED or not 0 <= where < dofs:
                raise UsageError(f"observe: {what!r} of degree of freedom {where}: give {', '.join(_OBSERVED)} of 0 to {dofs - 1}")
        found += pairs
    return found


def oscillator(mass: Quantity, damping: Quantity, stiffness: Quantity, *, dt: float, noise: Spread,
               observe: "str | Sequence[str | tuple[str, int]]" = "displacement", inputs: "ArrayLike | None" = None, force_noise: Quantity = 0.0,
               mean: "ArrayLike | None" = None, covariance: Spread = 0.0, parameters: "Mapping[str, float] | None" = None) -> LinearModel:
    """A linear oscillator of n degrees of freedom, M a + C v + K x = inputs u + random force, exact for inputs held over a step.

    Parameters
    ----------
    mass, damping, stiffness : float, array_like, str or callable of p
        n x n matrices (n = 1: numbers); the name of a parameter; or a function of the parameters.
    dt : float
        Time step, s.
    noise : as of `StepModel`
        Of the data.
    observe : str or sequence of str or (str, int)
        ``displacement``, ``velocity`` or ``acceleration``, of all degrees of freedom or of one: ``[("acceleration", 0)]``.
    inputs : array_like, shape (n, k), optional
        What each input does to each degree of freedom: forces; of a ground's acceleration the masses, negative.
    force_noise : float, array_like of n, str or callable of p
        White random force: its standard deviation over one second, N √s, independent at each degree of freedom.
    mean : array_like, shape (2 n,), optional
        Of the first displacements and velocities. By default, with `covariance` 0, it is at rest.
    covariance : as of `StepModel`
        Of that state.
    parameters : mapping of name to float, optional

    Returns
    -------
    LinearModel
        Its states are displacements, then velocities.

    Raises
    ------
    UsageError
        Matrices that do not fit, or a parameter without a value.

    Examples
    --------
    Two storeys on a shaken ground, of which the accelerations are measured:

    >>> stiffness = lambda p: p["k"] * np.array([[2.0, -1.0], [-1.0, 1.0]])
    >>> model = knothe.states.oscillator(np.eye(2), 0.1 * np.eye(2), stiffness, dt=0.02, noise=0.05, observe="acceleration",
    ...                                  inputs=[[-1.0], [-1.0]], parameters={"k": 100.0})
    >>> model.states
    ['x0', 'x1', 'v0', 'v1']
    """
    given: dict[str, float] = {name: float(value) for name, value in (parameters or {}).items()}

    def matrix_of(quantity: Quantity, p: Parameters) -> Array:
        return np.atleast_2d(np.asarray(value_of(quantity, p), float))

    n = len(matrix_of(mass, given))
    forces = np.zeros((n, 0)) if inputs is None else np.asarray(inputs, float).reshape(n, -1)
    seen = _observations(observe, n)
    for quantity, what in ((mass, "mass"), (damping, "damping"), (stiffness, "stiffness")):
        if matrix_of(quantity, given).shape != (n, n):
            raise UsageError(f"oscillator: {what} of shape {matrix_of(quantity, given).shape} for {counted(n, 'degree')} of freedom")

    def continuous(p: Parameters) -> tuple[Array, Array, Array]:
        flexibility = np.linalg.inv(matrix_of(mass, p))
        a, b = np.zeros((2 * n, 2 * n)), np.zeros((2 * n, forces.shape[1]))
        a[:n, n:], a[n:, :n], a[n:, n:] = np.eye(n), -flexibility @ matrix_of(stiffness, p), -flexibility @ matrix_of(damping, p)
        b[n:] = flexibility @ forces
        intensity = np.zeros((2 * n, 2 * n))
        random = flexibility * np.broadcast_to(np.asarray(value_of(force_noise, p), float), (n,))
        intensity[n:, n:] = random @ random.T
        return a, b, intensity

    def transition(p: Parameters, step: float) -> tuple[Array, Array, Array]:
        return discretised(*continuous(p), step)

    def observation(p: Parameters) -> tuple[Array, Array]:
        a, b, _ = continuous(p)
        kinds = {"displacement": (np.eye(2 * n)[:n], 0 * b[:n]), "velocity": (np.eye(2 * n)[n:], 0 * b[:n]), "acceleration": (a[n:], b[n:])}
        return np.array([kinds[what][0][where] for what, where in seen]), np.array([kinds[what][1][where] for what, where in seen])

    names = [f"{letter}{k if n > 1 else ''}" for letter in "xv" for k in range(n)]
    return LinearModel(transition, observation, mean=np.zeros(2 * n) if mean is None else mean, covariance=covariance, noise=noise, dt=dt,
                       inputs=forces.shape[1], parameters=given, states=names)


def runge_kutta(rates: Callable[[Array, float], Array], x: Array, t: float, dt: float, substeps: int) -> Array:
    """Classical, of fourth order."""
    h = dt / substeps
    for k in range(substeps):
        now = t + k * h
        first = rates(x, now)
        second = rates(x + 0.5 * h * first, now + 0.5 * h)
        third = rates(x + 0.5 * h * second, now + 0.5 * h)
        x = x + h / 6 * (first + 2 * second + 2 * third + rates(x + h * third, now + h))
    return x


def _with_internal_state(rate: Callable[[Array, Array, Parameters], Array], force: Callable[[Array, Array, Array, Parameters], Array],
                         mass: Quantity, force_noise: Quantity, observe: str, substeps: int, options: Mapping[str, Any],
                         relaxed: "Callable[[Array, Array, Parameters, float], Array] | None" = None) -> StepModel:
    """One degree of freedom with displacement, velocity and an internal variable z: m a = u - force(x, v, z), z' = rate(v, z).

    relaxed(v, z, p, h) is z after h at a constant velocity, exactly: for a z that is stiff."""
    seen = _observations(observe, 1)
    if len(seen) != 1:
        raise UsageError("observe: give one of displacement, velocity, acceleration")
    if substeps < 1:
        raise UsageError(f"{substeps!r} substeps: give at least one")

    def rates(x: Array, p: Parameters, u: Array) -> Array:
        acceleration = (u[..., 0] - force(x[..., 0], x[..., 1], x[..., 2], p)) / value_of(mass, p)
        return np.stack([x[..., 1], acceleration, rate(x[..., 1], x[..., 2], p)], -1)

    def step(x: Array, p: Parameters, u: Array, t: float, dt: float) -> Array:
        if relaxed is None:
            return runge_kutta(lambda state, _: rates(state, p, u), x, t, dt, substeps)
        h = dt / substeps
        for _ in range(substeps):  # the midpoint method, with z exactly
            middle = x + 0.5 * h * rates(x, p, u)
            middle[..., 2] = relaxed(x[..., 1], x[..., 2], p, 0.5 * h)
            after = x + h * rates(middle, p, u)
            after[..., 2] = relaxed(middle[..., 1], x[..., 2], p, h)
            x = after
        return x

    def observed(x: Array, p: Parameters, u: Array, t: float) -> Array:
        what = seen[0][0]
        return rates(x, p, u)[..., 1:2] if what == "acceleration" else x[..., :1] if what == "displacement" else x[..., 1:2]

    def process_noise(p: Parameters, dt: float) -> Array:
        """Of a random force, as if there were neither spring nor damper within the step."""
        variance = (float(value_of(force_noise, p)) / float(value_of(mass, p)))**2
        return variance * np.array([[dt**3 / 3, dt**2 / 2, 0], [dt**2 / 2, dt, 0], [0, 0, 0]])

    return StepModel(step, observed, process_noise=process_noise, inputs=1, states=["x", "v", "z"], **options)


def bouc_wen(mass: Quantity, damping: Quantity, stiffness: Quantity, *, share: Quantity, beta: Quantity, gamma: Quantity, power: Quantity = 1.0,
             dt: float, noise: Spread, observe: str = "displacement", force_noise: Quantity = 0.0, mean: ArrayLike = (0.0, 0.0, 0.0),
             covariance: Spread = 0.0, substeps: int = 4, parameters: "Mapping[str, float] | None" = None) -> StepModel:
    """An oscillator with hysteresis (Bouc 1967, Wen 1976) under one force u.

    m a + c v + share k x + (1 - share) k z = u;  z' = v - beta abs(v) abs(z)^(power - 1) z - gamma v abs(z)^power.

    Parameters
    ----------
    mass, damping, stiffness : float, str or callable of p
        m, c and k: a number, the name of a parameter, or a function of the parameters.
    share : float, str or callable of p
        Of the elastic force, 0 to 1.
    beta, gamma, power : float, str or callable of p
        Shape of the loops; z never exceeds (beta + gamma)^(-1 / power).
    dt : float
        Time step, s.
    noise : as of `StepModel`
    observe : str
        ``displacement``, ``velocity`` or ``acceleration``.
    force_noise : float, str or callable of p
        White random force: its standard deviation over one second, N √s.
    mean : array_like, shape (3,)
        Of the first displacement, velocity and z.
    covariance : as of `StepModel`
        Of that state.
    substeps : int
        Runge-Kutta steps within `dt`.
    parameters : mapping of name to float, optional

    Returns
    -------
    StepModel
        With one input.

    Examples
    --------
    >>> model = knothe.states.bouc_wen(1.0, 0.2, "k", share=0.3, beta=20.0, gamma=10.0, dt=0.05, noise=1e-3, parameters={"k": 30.0})
    >>> states, data = model.simulate(200, inputs=2 * np.sin(0.2 * np.arange(200)))
    >>> bool(abs(states[:, 2]).max() <= 1 / 30)
    True
    """
    def rate(v: Array, z: Array, p: Parameters) -> Array:
        n, size = value_of(power, p), np.abs(z)
        grown = size**n
        return np.asarray(v - value_of(beta, p) * np.abs(v) * np.sign(z) * grown - value_of(gamma, p) * v * grown)

    def force(x: Array, v: Array, z: Array, p: Parameters) -> Array:
        k, elastic = value_of(stiffness, p), value_of(share, p)
        return np.asarray(value_of(damping, p) * v + k * (elastic * x + (1 - elastic) * z))

    return _with_internal_state(rate, force, mass, force_noise, observe, substeps,
                                {"mean": mean, "covariance": covariance, "noise": noise, "dt": dt, "parameters": parameters})


def lugre(mass: Quantity, damping: Quantity, stiffness: Quantity, *, coulomb: Quantity, static: Quantity, stribeck: Quantity, sigma0: Quantity,
          sigma1: Quantity = 0.0, sigma2: Quantity = 0.0, dt: float, noise: Spread, observe: str = "displacement", force_noise: Quantity = 0.0,
          mean: ArrayLike = (0.0, 0.0, 0.0), covariance: Spread = 0.0, substeps: int = 10, parameters: "Mapping[str, float] | None" = None) -> StepModel:
    """An oscillator with friction as of LuGre (Canudas de Wit et al. 1995) under one force u.

    m a + c v + k x + F = u;  F = sigma0 z + sigma1 z' + sigma2 v;  z' = v - sigma0 abs(v) z / g(v);
    g(v) = coulomb + (static - coulomb) exp(-(v / stribeck)²).

    Parameters
    ----------
    mass, damping, stiffness : float, str or callable of p
        m, c and k: a number, the name of a parameter, or a function of the parameters.
    coulomb, static : float, str or callable of p
        Friction when sliding fast and at rest, N.
    stribeck : float, str or callable of p
        Velocity between these, m/s.
    sigma0, sigma1, sigma2 : float, str or callable of p
        Stiffness and damping of the bristles, N/m and N s/m, and viscous friction.
    dt : float
        Time step, s.
    noise : as of `StepModel`
    observe : str
        ``displacement``, ``velocity`` or ``acceleration``.
    force_noise : float, str or callable of p
        White random force: its standard deviation over one second, N √s.
    mean : array_like, shape (3,)
        Of the first displacement, velocity and z, the deflection of the bristles.
    covariance : as of `StepModel`
        Of that state.
    substeps : int
        Steps of the midpoint method within `dt`, enough for oscillations on the bristles; z itself is integrated exactly.
    parameters : mapping of name to float, optional

    Returns
    -------
    StepModel
        With one input.

    Examples
    --------
    Below its static friction it sticks:

    >>> model = knothe.states.lugre(1.0, 0.0, 0.0, coulomb=1.0, static=1.5, stribeck=0.01, sigma0=1e4, sigma1=200.0, dt=0.01, noise=1e-6)
    >>> states, _ = model.simulate(100, inputs=np.full(100, 0.9), noise=False)
    >>> bool(abs(states[-1, 0]) < 2e-4)
    True
    """
    def decay(v: Array, p: Parameters) -> Array:
        kinetic = value_of(coulomb, p)
        limit = kinetic + (value_of(static, p) - kinetic) * np.exp(-(v / value_of(stribeck, p))**2)
        return np.asarray(value_of(sigma0, p) * np.abs(v) / limit)

    def rate(v: Array, z: Array, p: Parameters) -> Array:
        return np.asarray(v - decay(v, p) * z)

    def relaxed(v: Array, z: Array, p: Parameters, h: float) -> Array:
        fallen = decay(v, p) * h
        share = np.where(fallen > 1e-12, -np.expm1(-fallen) / np.maximum(fallen, 1e-12), 1.0)
        return np.asarray(z * np.exp(-fallen) + h * v * share)

    def force(x: Array, v: Array, z: Array, p: Parameters) -> Array:
        friction = value_of(sigma0, p) * z + value_of(sigma1, p) * rate(v, z, p) + value_of(sigma2, p) * v
        return np.asarray(value_of(damping, p) * v + value_of(stiffness, p) * x + friction)

    return _with_internal_state(rate, force, mass, force_noise, observe, substeps,
                                {"mean": mean, "covariance": covariance, "noise": noise, "dt": dt, "parameters": parameters}, relaxed)
