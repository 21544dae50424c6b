"""A tower of ten storeys that is pulled at its top and let go: free vibration by modes, a function of numpy.

k: stiffness of the five lower storeys, N/m; zeta: damping ratio of every mode. Displacements of the floors 5 and 10 at 40 times.

usage: python3 ../umbridge/server.py 4242 tower.py
"""
import numpy as np

MASS, UPPER, PULL = 2.0e5, 1.5e8, 4.0e5  # kg and N/m of a storey, N
TIMES = 0.1 * np.arange(1, 41)  # s
FLOORS = [4, 9]
OUTPUTS = len(TIMES) * len(FLOORS)


def evaluate(k, zeta):
    stiffness = np.array([k] * 5 + [UPPER] * 5)
    matrix = np.diag(stiffness + np.append(stiffness[1:], 0.0)) - np.diag(stiffness[1:], 1) - np.diag(stiffness[1:], -1)
    start = np.linalg.solve(matrix, PULL * np.eye(10)[9])
    squares, modes = np.linalg.eigh(matrix / MASS)
    omega = np.sqrt(squares)
    damped = omega * np.sqrt(1 - zeta**2)
    phase = np.outer(TIMES, damped)
    amplitudes = np.exp(-zeta * np.outer(TIMES, omega)) * (np.cos(phase) + zeta * omega / damped * np.sin(phase))
    return ((amplitudes * (modes.T @ start)) @ modes.T)[:, FLOORS].ravel()
