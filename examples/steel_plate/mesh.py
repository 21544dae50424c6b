# Writes mesh.inp for CalculiX: the plate with its hole, transitions and half of its heads, in quadratic shells. No arguments.
import numpy as np

LENGTH, WIDTH, RADIUS, TRANSITION = 40.0, 10.0, 4.0, 25.0  # mm; of the parallel part half the length, half the width
ACROSS = 12  # elements


def half_width(x):
    beyond = np.clip(np.abs(x) - LENGTH, 0, 15)
    return WIDTH + TRANSITION - np.sqrt(TRANSITION**2 - beyond**2)


def blocks():
    """x and y of nodes and middles of edges, [along, across], of four quarters of a ring and six strips."""
    across = np.linspace(-1, 1, 2 * ACROSS + 1)
    corners = np.linspace(0, 1, 7) ** 1.5  # finer at the hole
    outwards = np.interp(np.linspace(0, 1, 13), np.linspace(0, 1, 7), corners)[:, None]
    for quarter in range(4):
        angle = (across / 4 + quarter / 2) * np.pi
        circle = RADIUS * np.array([np.cos(angle), np.sin(angle)])[:, None]
        square = circle * (WIDTH / np.abs(circle).max(axis=0))
        yield circle + outwards * (square - circle)
    for begin, end, n in (-65, -55, 3), (-55, -40, 5), (-40, -10, 12), (10, 40, 12), (40, 55, 5), (55, 65, 3):
        x = np.linspace(begin, end, 2 * n + 1)[:, None] + 0 * across
        yield np.array([x, half_width(x) * np.tan(across * np.pi / 4)])


numbers, elements = {}, []
for x, y in blocks():
    for i in range(0, len(x) - 2, 2):
        for j in range(0, 2 * ACROSS, 2):
            around = (0, 0), (2, 0), (2, 2), (0, 2), (1, 0), (2, 1), (1, 2), (0, 1)
            places = [(round(x[i + a, j + b], 4) + 0.0, round(y[i + a, j + b], 4) + 0.0) for a, b in around]
            elements.append([numbers.setdefault(place, len(numbers) + 1) for place in places])
places = {number: place for place, number in numbers.items()}

with open("mesh.inp", "w") as file:
    print("*NODE, NSET=ALL", file=file)
    for (x, y), number in numbers.items():
        print(f"{number}, {x / 1e3:.7f}, {y / 1e3:.7f}, 0", file=file)
    print("*ELEMENT, TYPE=S8R, ELSET=PLATE", file=file)
    for number, nodes in enumerate(elements, 1):
        print(number, *nodes, sep=", ", file=file)
    for name, end, corner in ("LEFT", -65, 0), ("RIGHT", 65, 1):
        print(f"*ELSET, ELSET={name}", *[k for k, nodes in enumerate(elements, 1) if places[nodes[corner]][0] == end], sep="\n", file=file)
    for name, at in ("L65", -65), ("L61", -61.6667), ("L58", -58.3333), ("L55", -55), ("R55", 55), ("R58", 58.3333), ("R61", 61.6667), ("R65", 65):
        print(f"*NSET, NSET={name}", *[number for (x, _), number in numbers.items() if x == at], sep="\n", file=file)
    for name, place in ("PIN", (-10.0, 0.0)), ("ROLLER", (10.0, 0.0)), ("EDGE", (0.0, 10.0)):
        print(f"*NSET, NSET={name}\n{numbers[place]}", file=file)
