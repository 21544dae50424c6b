"""A concrete wall in a fire, by FEniCS (Debian: python3-dolfinx): conduction of heat in the plane,

    C ∂T/∂t = div(k grad T),   k ∂T/∂n = h (T_gas(t) − T) on the side of the fire,

with implicit steps of 30 s. k: conductivity, W/(m K); h: heat transfer from gas to wall, W/(m2 K). Temperatures in K above the
start, at three depths beside a thermal bridge of steel, every three minutes for an hour.

usage: python3 ../umbridge/server.py 4242 wall.py
"""
import math

import numpy as np
import ufl
from dolfinx import fem, mesh
from mpi4py import MPI
from petsc4py import PETSc

WIDTH, DEPTH = 0.10, 0.15  # m, half of a strip around the bridge; y is the depth below the face in the fire
GAUGES = [(0.05, 0.01), (0.05, 0.03), (0.05, 0.06)]  # m, at nodes
CAPACITY = 2.3e6  # J/(m3 K)
STEP, EVERY, COUNT = 30.0, 6, 20  # s; a row every sixth step
OUTPUTS = COUNT * len(GAUGES)

domain = mesh.create_rectangle(MPI.COMM_SELF, [(0.0, 0.0), (WIDTH, DEPTH)], [20, 30], mesh.CellType.quadrilateral)
space = fem.FunctionSpace(domain, ("CG", 1))
before = fem.Function(space)
k, h, gas = (fem.Constant(domain, PETSc.ScalarType(1.0)) for _ in range(3))

face = mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[1], 0.0))
ds = ufl.Measure("ds", domain, subdomain_data=mesh.meshtags(domain, 1, np.sort(face), np.ones(len(face), np.int32)))
bridge = ufl.conditional(ufl.lt(ufl.SpatialCoordinate(domain)[0], 0.0125), 10.0, 1.0)  # steel conducts ten times as well
t, v = ufl.TrialFunction(space), ufl.TestFunction(space)
left = fem.form(CAPACITY / STEP * t * v * ufl.dx + k * bridge * ufl.dot(ufl.grad(t), ufl.grad(v)) * ufl.dx + h * t * v * ds(1))
right = fem.form(CAPACITY / STEP * before * v * ufl.dx + h * gas * v * ds(1))
nodes = [fem.locate_dofs_geometrical(space, lambda x, at=at: np.isclose(x[0], at[0]) & np.isclose(x[1], at[1]))[0] for at in GAUGES]


def fire(time):
    """The standard fire of ISO 834: K above the start, time in s."""
    return 345.0 * math.log10(8.0 * time / 60.0 + 1.0)


def evaluate(conductivity, transfer):
    k.value, h.value = conductivity, transfer
    matrix = fem.petsc.assemble_matrix(left)
    matrix.assemble()
    solver = PETSc.KSP().create(MPI.COMM_SELF)
    solver.setOperators(matrix)
    solver.setType("preonly")
    solver.getPC().setType("lu")
    before.x.array[:] = 0.0
    rows = []
    for i in range(1, EVERY * COUNT + 1):
        gas.value = fire(i * STEP)
        load = fem.petsc.assemble_vector(right)
        solver.solve(load, before.vector)
        load.destroy()
        if i % EVERY == 0:
            rows += [before.x.array[node] for node in nodes]
    solver.destroy()
    matrix.destroy()
    return rows
