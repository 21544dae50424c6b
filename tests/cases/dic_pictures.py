"""Speckle pictures under known displacements, without a library: for the cases of `knothe dic`."""
import math
import random
import struct


class Speckle:
    """Smooth dots in the material frame; a deformed picture is drawn exactly, by solving X + u(X) = x."""

    def __init__(self, width=160, height=120, radius=2.0, seed=1, margin=30):
        self.width, self.height = width, height
        generator = random.Random(seed)
        self.cell = 4 * radius
        self.dots = {}
        count = int(2.5 * (width + 2 * margin) * (height + 2 * margin) / (2 * math.pi * radius ** 2))
        for _ in range(count):
            x = generator.uniform(-margin, width + margin)
            y = generator.uniform(-margin, height + margin)
            key = (math.floor(x / self.cell), math.floor(y / self.cell))
            self.dots.setdefault(key, []).append((x, y, generator.choice((-0.42, 0.42))))
        self.factor = 1 / (2 * radius ** 2)

    def at(self, x, y):
        i, j = math.floor(x / self.cell), math.floor(y / self.cell)
        total = 0.0
        for k in (i - 1, i, i + 1):
            for m in (j - 1, j, j + 1):
                for dx, dy, a in self.dots.get((k, m), ()):
                    total += a * math.exp(-self.factor * ((x - dx) ** 2 + (y - dy) ** 2))
        return 0.5 + 0.42 * math.tanh(total)

    def picture(self, displacement=None, noise=0.0, seed=0, top=255, gain=1.0, offset=0.0):
        """Rows of whole grey levels 0 … top; `displacement(X, Y)` gives (u, v) of a material point, px."""
        generator = random.Random(seed)
        rows = []
        for y in range(self.height):
            row = []
            for x in range(self.width):
                px, py = float(x), float(y)
                if displacement:
                    for _ in range(30):
                        u, v = displacement(px, py)
                        px, py = x - u, y - v
                level = gain * top * self.at(px, py) + offset
                if noise:
                    level += generator.gauss(0, noise)
                row.append(max(0, min(top, round(level))))
            rows.append(row)
        return rows


def write_pgm(path, rows, top=255):
    data = bytearray()
    for row in rows:
        for level in row:
            data += bytes([level]) if top < 256 else struct.pack(">H", level)
    path.write_bytes(b"P5\n%d %d\n%d\n" % (len(rows[0]), len(rows), top) + bytes(data))


def write_tiff16(path, rows):
    """Uncompressed, 16 bits a pixel."""
    height, width = len(rows), len(rows[0])
    write_tiff(path, width, height, b"".join(struct.pack(f"<{width}H", *row) for row in rows))


def write_tiff(path, width, height, data, bits=16, compression=1):
    """Little-endian, `data` the only strip."""
    write_pages(path, width, height, [data], bits, compression)


def write_pages(path, width, height, pages, bits=8, compression=1):
    """Each page: its data, then its directory."""
    out = struct.pack("<2sHI", b"II", 42, 8 + len(pages[0]))
    for k, data in enumerate(pages):
        tags = [(256, 3, width), (257, 3, height), (258, 3, bits), (259, 3, compression), (262, 3, 1), (273, 4, len(out)), (277, 3, 1),
                (278, 3, height), (279, 4, len(data))]
        directory = struct.pack("<H", len(tags)) + b"".join(
            struct.pack("<HHI", tag, kind, 1) + (struct.pack("<HH", value, 0) if kind == 3 else struct.pack("<I", value))
            for tag, kind, value in tags)
        out += data + directory
        out += struct.pack("<I", len(out) + 4 + len(pages[k + 1]) if k + 1 < len(pages) else 0)
    path.write_bytes(out)
