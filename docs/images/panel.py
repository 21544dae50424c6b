"""Frames with linear axes, as SVG: what the pictures of the documentation are drawn with."""


class Panel:
    """A frame of a picture with linear axes; y grows upwards."""

    def __init__(self, box, x_range, y_range):
        self.box, self.x_range, self.y_range, self.parts = box, x_range, y_range, []

    def place(self, x, y):
        left, top, width, height = self.box
        return (left + width * (x - self.x_range[0]) / (self.x_range[1] - self.x_range[0]),
                top + height * (1 - (y - self.y_range[0]) / (self.y_range[1] - self.y_range[0])))

    def path(self, xs, ys, style, close=""):
        points = " L".join("{:.1f} {:.1f}".format(*self.place(x, y)) for x, y in zip(xs, ys))
        self.parts.append(f'<path d="M{points}{close}" {style}/>')

    def dot(self, x, y, style):
        self.parts.append('<circle cx="{:.1f}" cy="{:.1f}" r="3" {}/>'.format(*self.place(x, y), style))

    def text(self, x, y, text, anchor="middle"):
        self.parts.append(f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}">{text}</text>')

    def legend(self, entries):
        """Upper right: a swatch of each style (of a filled area; a line where it fills nothing) and what it stands for."""
        left, top, width, _ = self.box
        for row, (style, meaning) in enumerate(entries):
            y = top + 12 + 16 * row
            self.parts.append(f'<path d="M{left + width - 150:.1f} {y:.1f} h18 v8 h-18 Z" {style}/>' if 'fill="none"' not in style
                              else f'<path d="M{left + width - 150:.1f} {y + 4:.1f} h18" {style}/>')
            self.text(left + width - 126, y + 9, meaning, "start")

    def axes(self, x_ticks, y_ticks, title, x_label):
        left, top, width, height = self.box
        self.parts.append(f'<rect x="{left}" y="{top}" width="{width}" height="{height}" fill="none" stroke="#555"/>')
        for tick in x_ticks:
            self.text(self.place(tick, 0)[0], top + height + 16, f"{tick:g}")
        for tick in y_ticks:
            self.text(left - 6, self.place(0, tick)[1] + 4, f"{tick:g}", "end")
        self.text(left + width / 2, top - 8, title)
        self.text(left + width / 2, top + height + 34, x_label)


def picture(panels, width=800, height=410):
    """The whole file, on white."""
    parts = "\n".join(part for panel in panels for part in panel.parts)
    return (f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" font-family="sans-serif" font-size="12">\n'
            f'<rect width="{width}" height="{height}" fill="white"/>\n{parts}\n</svg>\n')
